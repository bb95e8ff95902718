# SPDX-License-Identifier: Apache-2.0
"""The bundle, built once for all tests."""

from __future__ import annotations

import fcntl
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.hosts.builds import kept

SOURCE = Path(__file__).parents[3] / "hosts" / "openfx"


def without_compiler() -> str:
    """What is missing to build it, in words; empty if nothing is."""
    for program in ("cmake", "c++"):
        if shutil.which(program) is None:
            return f"no {program}: apt install cmake g++ nlohmann-json3-dev"
    line = ["c++", "-E", "-x", "c++", "-include", "nlohmann/json.hpp", "-"]
    if subprocess.run(line, stdin=subprocess.DEVNULL, capture_output=True).returncode:
        return "no header nlohmann/json.hpp: apt install nlohmann-json3-dev"
    return "" if sys.platform == "linux" else "the plugin is for Linux"


def built(name: str, sanitize: str = "", compiler: str = "") -> Path:
    """The plugin's file, in a kept folder of this name; skips if there is no compiler.

    `compiler`: a line that compiles C++; default: that of the machine.
    """
    missing = without_compiler()
    if missing:
        pytest.skip(f"THE OPENFX PLUGIN IS NOT BUILT: {missing}")
    folder = kept(name, SOURCE, sanitize, compiler)
    with open(folder / "lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (folder / "made").exists():
            settings = {"OIIOTEX_PYTHON": sys.executable, "OIIOTEX_SANITIZE": sanitize, "CMAKE_INSTALL_PREFIX": folder}
            words = [f"-D{key}={value}" for key, value in settings.items()]
            lines = (["-S", SOURCE, "-B", folder / "work", *words], ["--build", folder / "work"])
            said, environment = "", os.environ | ({"CXX": compiler} if compiler else {})
            for line in (*lines, ["--install", folder / "work"]):
                done = subprocess.run(["cmake", *map(str, line)], capture_output=True, text=True, env=environment)
                said += done.stdout + done.stderr
                assert done.returncode == 0, said
            assert "warning" not in said, said
            shutil.rmtree(folder / "work")
            (folder / "made").touch()
    return folder / "lib/OFX/Plugins/oiiotex.ofx.bundle/Contents/Linux-x86-64/oiiotex.ofx"
