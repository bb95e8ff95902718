# SPDX-License-Identifier: Apache-2.0
"""Checkpoints: finished pieces of an image are kept next to its file until it is complete, so a killed run can resume.

The writer of a file opens a `Checkpoint` for it (`Resources.checkpoints`); an op that can compute any window asks it
for its pieces, whatever other ops lie between.
"""

from __future__ import annotations

import contextlib
import logging
import re
import weakref
from collections.abc import Callable
from pathlib import Path

from ..core.window import Window
from ..deferred import np
from ..errors import Error, reason_of
from .atomic import make_folders, temporary_beside
from .sealed import read_arrays, write_arrays

log = logging.getLogger("oiiotex")

_unfinished: weakref.WeakSet[Checkpoint] = weakref.WeakSet()  # those with pieces
# complete, or left by a killed process
_NAME = re.compile(r"\.?[0-9a-f]{32}\.\d+x\d+[+-]\d+[+-]\d+(\.oiiotex-\w+-\d+-[0-9a-f]+)?\.piece")


class Checkpoint:
    """The folder of pieces of one file, `<file>.parts`, made with the first piece.

    Attributes
    ----------
    folder : Path
    count : int
        Number of pieces that this run has written or used.
    """

    def __init__(self, path: Path):
        self.folder = Path(f"{path}.parts")
        self.count = 0
        self._works = True

    def piece(self, key: str, place: Window, make: Callable[[], np.ndarray]) -> np.ndarray:
        """The piece at `place`: from an earlier run, or made now and kept.

        Parameters
        ----------
        key : str
            A hexadecimal hash of everything that determines the piece, except its place.
        place : Window
        make : callable
        """
        pixels = self.kept(key, place)
        if pixels is None:
            pixels = make()
            self.keep(key, place, pixels)
        return pixels

    def kept(self, key: str, place: Window) -> np.ndarray | None:
        """The complete piece from an earlier run, or None."""
        pixels = _read(self._file(key, place))
        if pixels is not None:
            self._add()
        return pixels

    def keep(self, key: str, place: Window, pixels: np.ndarray) -> None:
        """Write a piece."""
        if not self._works:
            return
        try:
            make_folders(self.folder)  # --create-dir makes those above it later
            with temporary_beside(self._file(key, place)) as temporary:
                write_arrays(temporary, [pixels])
            self._add()
        except (OSError, Error) as error:  # the run itself may still succeed
            self._works = False
            log.warning("resume: cannot write checkpoints to %s: %s", self.folder, reason_of(error))

    def holds(self, key: str, place: Window) -> bool:
        """Whether the complete piece exists."""
        return _read(self._file(key, place)) is not None

    def _add(self) -> None:
        self.count += 1
        _unfinished.add(self)

    def say_kept(self) -> None:
        """Name the folder, once, if it has pieces: the run is interrupted."""
        if self in _unfinished:
            _unfinished.discard(self)
            log.warning("%d finished pieces are stored in %s; repeat the run to resume", self.count, self.folder)

    def _file(self, key: str, place: Window) -> Path:
        return self.folder / f"{key[:32]}.{place}.piece"

    def discard(self) -> None:
        """Remove all pieces, if this run wrote or used any; other files are kept."""
        if not self.count:
            return
        self.count = 0
        _unfinished.discard(self)
        with contextlib.suppress(OSError):
            for entry in list(self.folder.iterdir()):
                if _NAME.fullmatch(entry.name):
                    entry.unlink(missing_ok=True)
            self.folder.rmdir()


def say_all_kept() -> None:
    """`Checkpoint.say_kept` of all: the process ends without unwinding."""
    for checkpoint in list(_unfinished):
        checkpoint.say_kept()


def _read(file: Path) -> np.ndarray | None:
    """The piece in a file; None if it is missing or damaged."""
    try:
        (pixels,) = read_arrays(file)
    except (OSError, ValueError):
        return None
    return pixels.copy()  # Windows removes no file that is mapped
