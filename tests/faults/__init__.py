# SPDX-License-Identifier: Apache-2.0
"""What happens when disks fill up, writers are killed and inputs are broken. Shared: the program as a process, waiting
for what it does, and the line it ends with."""

from __future__ import annotations

import contextlib
import errno
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

PROGRAM = [sys.executable, "-m", "oiiotex"]
OLD = b"the user's own"
SLOW = ["--pattern", "noise", "3000x3000", "3", "--blur", "9x9", "-d", "half", "--compression", "none"]


def slow(*values: object) -> object:
    return pytest.param(*values, marks=pytest.mark.slow)


def line_of(done: subprocess.CompletedProcess, code: int = 1) -> str:
    """The one line on stderr of a run that failed as it should."""
    lines = done.stderr.splitlines()
    assert (done.returncode, len(lines)) == (code, 1), done
    assert lines[0].startswith("oiiotex ERROR: ")
    return lines[0]


def half_files(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir() if ".oiiotex-" in path.name]


def half_written(folder: Path) -> bool:
    """Whether a frame is being written: a name that is only tried is empty."""
    sizes = []
    for name in half_files(folder):
        with contextlib.suppress(FileNotFoundError):
            sizes.append((folder / name).stat().st_size)
    return any(sizes)


def wait_for(what: Callable[[], object], run: subprocess.Popen, seconds: float = 60) -> None:
    end = time.monotonic() + seconds
    while not what():
        assert run.poll() is None, f"ended with {run.returncode} before that: {run.communicate()}"
        assert time.monotonic() < end, "has not happened"
        time.sleep(0.01)


def start(folder: Path, *words: object) -> subprocess.Popen:
    command = [*PROGRAM, "--noprogress", *map(str, words)]
    return subprocess.Popen(
        command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )


def nobody_left(run: subprocess.Popen) -> bool:
    """Whether all processes of a run's session are gone, shortly after it."""
    for _ in range(500):
        try:
            os.killpg(run.pid, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.02)
    return False


def full_disk(patch: pytest.MonkeyPatch, number: int = errno.ENOSPC) -> None:
    """Have what is written beside files fail, as a full disk does, until the patch is undone."""

    def refused(*_: object) -> None:
        raise OSError(number, os.strerror(number))

    patch.setattr("oiiotex.engine.io.atomic.temporary_beside", refused)
