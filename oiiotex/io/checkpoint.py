# SPDX-License-Identifier: Apache-2.0
"""Finished pieces of an image lie beside its file until that is whole, so that a run that was killed goes on.

Who writes a file opens a `Checkpoint` for it (`Resources.checkpoints`); an op that can make any window asks it
for its pieces, whatever other ops lie between.
"""

from __future__ import annotations

import contextlib
import io
import logging
import re
import zlib
from collections.abc import Callable
from pathlib import Path

from ..core.window import Window
from ..deferred import np
from ..errors import Error
from .atomic import make_folders, temporary_beside

log = logging.getLogger("oiiotex")

# whole, or left by a kill
_NAME = re.compile(r"\.?[0-9a-f]{32}\.\d+x\d+[+-]\d+[+-]\d+(\.oiiotex-\w+-\d+-[0-9a-f]+)?\.piece")
_SPEED = 1  # of zlib: it takes a tenth of what synthesis takes, and its checksum tells a spoiled piece


class Checkpoint:
    """The folder of pieces of one file, `<file>.parts`; it is there from the first piece on.

    Attributes
    ----------
    folder : Path
    count : int
        Pieces of this run that lie there.
    """

    def __init__(self, path: Path):
        self.folder = Path(f"{path}.parts")
        self.count = 0
        self._works = True

    def piece(self, key: str, place: Window, make: Callable[[], np.ndarray]) -> np.ndarray:
        """The piece at that place: as a run before has left it, else made now and kept.

        Parameters
        ----------
        key : str
            A hash, in hexadecimal digits, of all that determines the piece beside its place.
        place : Window
        make : callable
        """
        file = self._file(key, place)
        pixels = _read(file)
        if pixels is None:
            pixels = make()
            self._keep(file, pixels)
        else:
            self.count += 1
        return pixels

    def kept(self, key: str, place: Window) -> np.ndarray | None:
        """That piece as a run before has left it, whole; else None."""
        pixels = _read(self._file(key, place))
        self.count += pixels is not None
        return pixels

    def keep(self, key: str, place: Window, pixels: np.ndarray) -> None:
        """Keep that piece."""
        self._keep(self._file(key, place), pixels)

    def holds(self, key: str, place: Window) -> bool:
        """Whether that piece is there, whole."""
        return _read(self._file(key, place)) is not None

    def _file(self, key: str, place: Window) -> Path:
        return self.folder / f"{key[:32]}.{place}.piece"

    def _keep(self, file: Path, pixels: np.ndarray) -> None:
        if not self._works:
            return
        plain = io.BytesIO()
        np.save(plain, pixels, allow_pickle=False)
        try:
            make_folders(self.folder)  # --create-dir makes those above it later
            with temporary_beside(file) as temporary:
                temporary.write_bytes(zlib.compress(plain.getbuffer(), _SPEED))
            self.count += 1
        except (OSError, Error) as error:  # the run itself may still end well
            self._works = False
            log.warning("resume: pieces cannot be kept in %s: %s", self.folder, error)

    def discard(self) -> None:
        """Remove all pieces, if this run kept or used any; what is not ours stays."""
        if not self.count:
            return
        self.count = 0
        with contextlib.suppress(OSError):
            for entry in list(self.folder.iterdir()):
                if _NAME.fullmatch(entry.name):
                    entry.unlink(missing_ok=True)
            self.folder.rmdir()


def _read(file: Path) -> np.ndarray | None:
    """What a piece's file holds; None where it is absent or spoiled."""
    try:
        return np.load(io.BytesIO(zlib.decompress(file.read_bytes())), allow_pickle=False)
    except (OSError, ValueError, EOFError, zlib.error):
        return None
