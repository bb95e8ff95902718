# SPDX-License-Identifier: Apache-2.0
"""The program as `python -m oiiotex`."""

from .oiiotool.cli.main import main

main()
