# SPDX-License-Identifier: Apache-2.0
"""The resident process, started by `client.connect`."""

import sys

from .resident import main

main(sys.argv[1])
