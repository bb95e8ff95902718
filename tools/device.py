# SPDX-License-Identifier: Apache-2.0
"""`make demo` and `make test` begin here: where no OpenCL device can compile, the step that helps is taken."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from pathlib import Path

from oiiotex.errors import DeviceError, NoDeviceError
from oiiotex.opencl import device

_PROJECT = Path(__file__).parents[1]


def step(remedy: str) -> list[str]:
    """The command as it is run here: with this Python's pip and this checkout; empty where it cannot be run."""
    words = shlex.split(remedy)
    if words[:2] == ["pip", "install"]:
        extra = words[2].removeprefix("oiiotex")
        return [sys.executable, "-m", "pip", "install", "-q", "-e", f"{_PROJECT}{extra}"]
    if words[:2] == ["apt", "install"] and os.geteuid() == 0:
        return ["apt-get", "install", "-y", "-q", *words[2:]]
    return []


def main() -> None:
    """Make sure that a device works; exits with what helps where that is not in our hands."""
    try:
        print(f"device: {device.choose().name}")
    except NoDeviceError as error:
        command = step(error.remedy)
        if not command or error.remedy in sys.argv[1:]:
            sys.exit(str(error))
        print(f"{error}\nmake does this now: {shlex.join(command)}", flush=True)
        subprocess.run(command, check=True)
        # anew: runtimes are looked for once per process; the steps taken go along, none is taken twice
        os.execv(sys.executable, [sys.executable, "-m", "tools.device", *sys.argv[1:], error.remedy])
    except DeviceError as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
