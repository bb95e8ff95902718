# SPDX-License-Identifier: Apache-2.0
"""`make demo` and `make test` begin here: if no OpenCL device can compile, install what is missing."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from pathlib import Path

from oiiotex.engine.errors import DeviceError, NoDeviceError
from oiiotex.engine.opencl import device_choice

_PROJECT = Path(__file__).parents[1]


def step(remedy: str) -> list[str]:
    """The command for this Python's pip and this checkout; empty if it cannot be run."""
    words = shlex.split(remedy)
    if words[:2] == ["pip", "install"]:
        extra = words[2].removeprefix("oiiotex")
        return [sys.executable, "-m", "pip", "install", "-q", "-e", f"{_PROJECT}{extra}"]
    if words[:2] == ["apt", "install"] and os.geteuid() == 0:
        return ["apt-get", "install", "-y", "-q", *words[2:]]
    return []


def main() -> None:
    """Make sure that a device works; exit with the remedy otherwise."""
    try:
        print(f"device: {device_choice.choose().name}")
    except NoDeviceError as error:
        command = step(error.remedy)
        if not command or error.remedy in sys.argv[1:]:
            sys.exit(str(error))
        print(f"{error}\nmake now runs: {shlex.join(command)}", flush=True)
        subprocess.run(command, check=True)
        # a new process, because runtimes are searched once per process; the arguments prevent repeated steps
        os.execv(sys.executable, [sys.executable, "-m", "tools.device", *sys.argv[1:], error.remedy])
    except DeviceError as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
