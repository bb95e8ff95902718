# SPDX-License-Identifier: Apache-2.0
"""Settings of a resident process and its socket. Each set of settings has a separate process."""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import warnings
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from ... import __version__
from ...engine.errors import Error
from ...engine.io.cache_folders import require_private
from ...engine.session import Session
from ...engine.session.settings import Settings

IDLE = 600.0  # s without a client until the process ends
_RESERVED: dict[Path, int] = {}  # open lock files by folder


@dataclass(frozen=True, kw_only=True)
class ResidentSettings(Settings):
    """The settings of a run that also apply to later ones.

    Attributes
    ----------
    idle : float
        Seconds without a client until the process ends.
    """

    idle: float = IDLE

    @classmethod
    def of(cls, session: Session) -> ResidentSettings:
        """The settings of a session, without those of a single command line, and with $OCIO as `colorconfig`."""
        config = session.settings.colorconfig or os.environ.get("OCIO")
        if config and os.path.exists(config):
            config = os.path.abspath(config)
        of_all = replace(session.settings, colorconfig=config, all_parts=False, profile=False, words=())
        return cls(**asdict(of_all))

    def text(self) -> str:
        """The settings as JSON."""
        return json.dumps(asdict(self))

    def socket(self) -> Path:
        """The path of the socket, in a private folder.

        Raises
        ------
        Error
            The folder belongs to another user or is accessible to others.
        """
        facts = self.text(), __version__, str(Path(__file__).parent), os.environ.get("OIIOTEX_DEVICE")
        name = hashlib.sha256(repr(facts).encode()).hexdigest()[:16]
        return runtime_folder() / f"{name}.socket"


def runtime_folder() -> Path:
    """A private folder of the user, in memory if the system provides one ($XDG_RUNTIME_DIR)."""
    import platformdirs

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # no $XDG_RUNTIME_DIR: the substitute is checked below
        folder = Path(platformdirs.user_runtime_dir("oiiotex"))
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    try:
        require_private(folder, others=0o077)
    except Error as error:
        raise Error(f"{error}; set XDG_RUNTIME_DIR to a private folder") from None
    return folder


def reserved_folder(path: Path) -> Path:
    """A folder in memory for work on a file, reserved for this process until it ends or `release_folder` is called.

    Raises
    ------
    Error
        Another process has reserved it, or `runtime_folder` fails.
    """
    name = hashlib.sha256(str(path.resolve()).encode(errors="surrogateescape")).hexdigest()[:16]
    folder = runtime_folder() / f"live-{name}"
    folder.mkdir(mode=0o700, exist_ok=True)
    lock = os.open(folder / "lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(lock)
        raise Error(f"{path} is open in another --texlive: end it, or choose another file with document=") from None
    _RESERVED[folder] = lock
    return folder


def release_folder(folder: Path) -> None:
    """End the reservation of a folder, if it is reserved."""
    if (lock := _RESERVED.pop(folder, None)) is not None:
        os.close(lock)
