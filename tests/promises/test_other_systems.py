# SPDX-License-Identifier: Apache-2.0
"""Windows and macOS, simulated: what their Python lacks is removed before the program starts.

This shows that no line depends on it, except for functions of users and groups, which `os.name` guards, and for files
of scratch data. Nothing has been run on these systems: docs/start/install.md.
"""

from __future__ import annotations

import subprocess
import sys

import pytest

LACKS = {
    "Windows": {
        "modules": "fcntl resource termios",
        "os": "memfd_create fchmod chown statvfs fork mkfifo O_NOFOLLOW O_NONBLOCK sched_getaffinity",
        "signal": "SIGHUP SIGKILL SIGALRM SIGUSR1 pthread_sigmask alarm SIG_BLOCK SIG_SETMASK SIGPIPE",
        "socket": "AF_UNIX SO_PEERCRED send_fds recv_fds",
    },
    "macOS": {
        "modules": "",
        "os": "memfd_create MFD_CLOEXEC MFD_ALLOW_SEALING sched_getaffinity posix_fallocate",
        "signal": "",
        "socket": "SO_PEERCRED",
    },
}
SCRIPT = """
import builtins, os, signal, socket, sys
lacks, line = eval(sys.argv[1]), sys.argv[2:]
there = builtins.__import__
def imported(name, globals=None, locals=None, names=(), level=0):
    if name in lacks["modules"].split() and (globals or {}).get("__name__", "").startswith("oiiotex"):
        raise ImportError(f"No module named {name!r}", name=name)
    return there(name, globals, locals, names, level)
builtins.__import__ = imported
for module in (os, signal, socket):
    for name in lacks[module.__name__].split():
        if hasattr(module, name):
            delattr(module, name)
from oiiotex.oiiotool.cli.main import main
main(line)
"""


def run(system: str, *line: object) -> subprocess.CompletedProcess:
    words = [sys.executable, "-c", SCRIPT, repr(LACKS[system]), *map(str, line)]
    return subprocess.run(words, capture_output=True, text=True)


@pytest.mark.parametrize("system", LACKS)
def test_lines_run(system, photo, tmp_path):
    out = tmp_path / "out.exr"
    done = run(system, photo, "--texsuperpixel:count=20", "-o", out)
    assert done.returncode == 0 and out.exists(), done.stderr


@pytest.mark.parametrize("system", LACKS)
def test_the_resident_process_is_refused_in_one_line(system, photo, tmp_path):
    done = run(system, photo, "--iscolorspace", "srgb_rec709_scene", "--texlive:open=0")
    assert done.returncode == 1 and done.stderr.count("\n") == 1 and "requires Linux" in done.stderr, done.stderr
