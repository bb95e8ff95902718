# SPDX-License-Identifier: Apache-2.0
"""Started by `client.connect`."""

import sys

from .resident import main

main(sys.argv[1])
