# SPDX-License-Identifier: Apache-2.0
"""The program `oiiotex-library`. Commands are imported after signal handlers are installed."""

from __future__ import annotations

import sys

from ..api.lines import exit_with


def main(words: list[str] | None = None) -> None:
    """Run the command line and exit: 0: success, 1: error, 3: assets need attention, 128 + N: ended by signal N."""
    exit_with(sys.argv[1:] if words is None else words, _line)


def _line(words: list[str]) -> int:
    from .commands import run

    return run(words)


if __name__ == "__main__":
    main()
