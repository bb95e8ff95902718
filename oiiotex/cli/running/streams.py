# SPDX-License-Identifier: Apache-2.0
"""Standard streams: ours are for what we say; what libraries print of their own accord goes nowhere."""

from __future__ import annotations

import io
import os
import sys
import warnings

_loud = 2  # where the real stderr is


def open_standard_streams() -> None:
    """What came closed goes nowhere: else the next file opened would get its number, and what libraries print."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # gets the lowest number that is free
    sys.stdout = sys.stdout or open(os.devnull, "w")  # noqa: SIM115 - open as long as the process
    sys.stderr = sys.stderr or open(os.devnull, "w")  # noqa: SIM115
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="surrogateescape")  # names that are not UTF-8 are printed as they are
        if sys.stdout.isatty():
            encoding = sys.stdout.encoding
            sys.stdout = _Terminal(sys.stdout.detach(), encoding, "backslashreplace", line_buffering=True)


class _Terminal(io.TextIOWrapper):
    """Names and metadata come from strangers: on a terminal what would steer it is shown as Python writes it."""

    def write(self, text: str) -> int:
        """Write a text."""
        super().write("".join(c if c.isprintable() or c in "\n\t" else ascii(c)[1:-1] for c in text))
        return len(text)


def quiet_libraries() -> None:
    """An error is one line, of ours: libpng, libjpeg and others print theirs too, past Python."""
    global _loud
    if _loud != 2:
        return
    warnings.simplefilter("ignore")
    sys.stderr.flush()
    _loud = os.dup(2)
    sys.stderr = open(_loud, "w", buffering=1, errors="backslashreplace", closefd=False)  # noqa: SIM115
    drop(2)


def stderr() -> int:
    """The descriptor of the real stderr, for processes that are started."""
    return _loud


def drop(number: int) -> None:
    """What is printed there from here on goes nowhere, and what is read there is empty."""
    nowhere = os.open(os.devnull, os.O_RDWR)
    os.dup2(nowhere, number)
    os.close(nowhere)
