# SPDX-License-Identifier: Apache-2.0
"""Nothing of the current folder is run by what we start."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from oiiotex.opencl import runtime

IMPORTED = ("oiiotex", "numpy", "pyopencl", "ziglang", "multiprocessing", "pytools", "runpy", "json", "platformdirs")


def plant(folder: Path) -> Path:
    """Modules in the current folder, named like those that are imported; each notes that it has run."""
    mark = folder / "ran"
    for name in IMPORTED:
        (folder / name).mkdir()
        (folder / name / "__init__.py").write_text(
            f"open({str(mark)!r}, 'a').write(__name__ + chr(10)); raise SystemExit(9)"
        )
        (folder / name / "__main__.py").write_text(f"open({str(mark)!r}, 'a').write('main of {name}')")
    zig = folder / "ziglang" / "zig"
    zig.write_text(f"#!/bin/sh\necho zig >> {mark}\n")
    zig.chmod(0o755)
    return mark


def test_nothing_of_the_current_folder_is_run_by_what_we_start(tmp_path):
    mark = plant(tmp_path)
    script = (
        "from oiiotex.opencl import runtime as r\n"
        "d = next(d for d in oiiotex.opencl.device.devices() if d.kind == 'cpu')\n"
        "r.cache_folder()\n"
        "sys.path.insert(0, '')\n"  # as `python -c` has it
        "print(r._try_in_subprocess(d.handle, r.tried(d.handle).works))\n"
        "print(r._zig())\n"
    )
    command = [sys.executable, "-P", "-c", f"import sys, oiiotex.opencl.device\n{script}"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300)
    lines = done.stdout.splitlines()
    assert lines and lines[0] in ("(16, '')", "(32, '')"), done
    assert str(tmp_path) not in lines[1]
    assert not mark.exists(), mark.read_text()


def test_lld_is_the_program_of_the_wheel():
    zig = runtime._zig()
    if zig is None:
        pytest.skip("no ziglang")
    text = Path(runtime._path_with_lld().split(os.pathsep)[0], "ld").read_text()
    assert f"exec {shlex.quote(str(zig))} ld.lld" in text and "python" not in text.replace(str(zig), "")


def test_frames_in_parallel_run_nothing_of_the_current_folder(tmp_path, photo):
    words = ["--frames", "1-2", "--parallel-frames", str(photo), "--mulc", "0.5", "-o", "out.#.png"]
    mark = plant(tmp_path)
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"}
    script = f"import sys; from oiiotex.cli.main import main; main({words!r})"
    for command in ([str(Path(sys.executable).with_name("oiiotex")), *words], [sys.executable, "-P", "-c", script]):
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=300)
        assert done.returncode == 0, done
        assert not mark.exists(), mark.read_text()
        for name in ("out.0001.png", "out.0002.png"):
            (tmp_path / name).unlink()
