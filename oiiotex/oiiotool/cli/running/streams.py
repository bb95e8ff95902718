# SPDX-License-Identifier: Apache-2.0
"""Standard streams: our own output passes, output of libraries is discarded."""

from __future__ import annotations

import io
import os
import sys
import warnings

_loud = 2  # descriptor of the real stderr


def open_standard_streams() -> None:
    """Open closed streams to nowhere: else the next file would get their numbers, and the output of libraries."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number
    sys.stdout = sys.stdout or open(os.devnull, "w")  # noqa: SIM115 - open as long as the process
    sys.stderr = sys.stderr or open(os.devnull, "w")  # noqa: SIM115
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="surrogateescape")  # print names that are not UTF-8 unchanged
        if sys.stdout.isatty():
            encoding = sys.stdout.encoding
            sys.stdout = _Terminal(sys.stdout.detach(), encoding, "backslashreplace", line_buffering=True)


class _Terminal(io.TextIOWrapper):
    """A terminal on which control characters in names and metadata are printed escaped."""

    def write(self, text: str) -> int:
        """Write a string with its control characters escaped."""
        super().write("".join(c if c.isprintable() or c in "\n\t" else ascii(c)[1:-1] for c in text))
        return len(text)


def quiet_libraries() -> None:
    """Discard what libpng, libjpeg and others print on stderr: an error is one line, ours."""
    global _loud
    if _loud != 2:
        return
    warnings.simplefilter("ignore")
    sys.stderr.flush()
    _loud = os.dup(2)
    sys.stderr = open(_loud, "w", buffering=1, errors="backslashreplace", closefd=False)  # noqa: SIM115
    drop(2)


def stderr() -> int:
    """The descriptor of the real stderr, for child processes."""
    return _loud


def drop(number: int) -> None:
    """Redirect a descriptor to nowhere."""
    nowhere = os.open(os.devnull, os.O_RDWR)
    os.dup2(nowhere, number)
    os.close(nowhere)
