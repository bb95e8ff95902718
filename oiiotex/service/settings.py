# SPDX-License-Identifier: Apache-2.0
"""What a resident process is started with, and where it listens: other settings are another process."""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import warnings
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from .. import __version__
from ..errors import Error
from ..opencl.cache_folders import require_private
from ..session import Session
from ..session.settings import Settings

IDLE = 600.0  # s without a client after which it ends


@dataclass(frozen=True, kw_only=True)
class ResidentSettings(Settings):
    """Those of a run that outlast it.

    Attributes
    ----------
    idle : float
        Seconds without a client after which it ends.
    """

    idle: float = IDLE

    @classmethod
    def of(cls, session: Session) -> ResidentSettings:
        """Those of a session, but for what belongs to one line; the environment's color config becomes a word."""
        config = session.settings.colorconfig or os.environ.get("OCIO")
        if config and os.path.exists(config):
            config = os.path.abspath(config)
        of_all = replace(session.settings, colorconfig=config, all_parts=False, profile=False, words=())
        return cls(**asdict(of_all))

    def text(self) -> str:
        """As JSON."""
        return json.dumps(asdict(self))

    def socket(self) -> Path:
        """Where its process listens, in a folder that is the user's alone.

        Raises
        ------
        Error
            The folder is somebody else's, or open to others.
        """
        facts = self.text(), __version__, str(Path(__file__).parent), os.environ.get("OIIOTEX_DEVICE")
        name = hashlib.sha256(repr(facts).encode()).hexdigest()[:16]
        return runtime_folder() / f"{name}.socket"


def runtime_folder() -> Path:
    """A folder of the user alone, in memory where the system has such a one ($XDG_RUNTIME_DIR)."""
    import platformdirs

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that there is no $XDG_RUNTIME_DIR: what stands in for it is looked at below
        folder = Path(platformdirs.user_runtime_dir("oiiotex"))
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    try:
        require_private(folder, others=0o077)
    except Error as error:
        raise Error(f"{error}; set XDG_RUNTIME_DIR to one") from None
    return folder


def reserved_folder(path: Path) -> Path:
    """A folder in memory of a file that this process alone works on; another's again when it ends.

    Raises
    ------
    Error
        Another process has reserved it, or as by `runtime_folder`.
    """
    name = hashlib.sha256(str(path.resolve()).encode(errors="surrogateescape")).hexdigest()[:16]
    folder = runtime_folder() / f"live-{name}"
    folder.mkdir(mode=0o700, exist_ok=True)
    lock = os.open(folder / "lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)  # held as long as the process lives
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(lock)
        raise Error(f"{path} is open in another --texlive: end that one, or name another file by document=") from None
    return folder
