# SPDX-License-Identifier: Apache-2.0
"""CPUs that nobody here has: a tile on each, emulated by qemu-user, is equal to the bit to this machine's own.

What the program starts is emulated too: `sys.executable` is a script that starts the emulator. qemu up to version 8
may end with a segmentation fault of its own where a program has signals and threads (bugs.launchpad.net/qemu/+bug/
1907969): there is one thread of kernels, and a run that ended so is made once more.
"""

from __future__ import annotations

import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import load

QEMU = shutil.which("qemu-x86_64")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(QEMU is None, reason="no qemu-x86_64: apt install qemu-user"),
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the emulator runs programs of Linux"),
]
# qemu's CPU, what Linux would say of it, the way that works: LLVM 14 knows the second
HASWELL = "abm avx avx2 bmi1 bmi2 cx16 f16c fma lahf_lm movbe pclmulqdq pni popcnt sse4_1 sse4_2 ssse3 xsave"
ZEN2 = f"{HASWELL} adx aes sse4a"
CPUS = {
    "unknown AMD": ("max,vendor=AuthenticAMD,family=26,model=2", ZEN2, "CPU set to znver2"),
    "Haswell": ("Haswell", HASWELL, "default settings"),
}  # fmt: skip
RUN = """
import json, sys
sys.executable, flags, lines = sys.argv[1:]
from oiiotex.engine.opencl import cpu, runtime
cpu.cpu = lambda: {"flags": flags}  # /proc/cpuinfo is the machine's
runtime._PROBE_SECONDS = 900  # an emulator is slow
from oiiotex.oiiotool.cli.running.line_run import run
for words in json.loads(lines):
    assert run(words) == 0, words
"""
# a CPU unlike all others has every kernel of a tile; the other the most of them
LINES = {name: [f"--tex{op}:size=64x64:iterations=1", "-d", "float", "-o"]
         for name, op in zip(CPUS, ("stationarize", "patchmatch"), strict=True)}  # fmt: skip


@pytest.fixture
def native(tmp_path: Path, name: str) -> tuple[Path, np.ndarray]:
    """The photo and its tile, by this machine's CPU."""
    from tests import pictures
    from tests.conftest import oiiotex, save

    photo = save(pictures.stained(pictures.bricks(64, 64, seed=1)), tmp_path / "photo.png")
    done = oiiotex(photo, *LINES[name], tmp_path / "native.tif", "--device", "cpu")
    assert done.returncode == 0, done.stderr
    return photo, load(tmp_path / "native.tif")


@pytest.mark.parametrize("name", CPUS)
def test_a_tile_of_an_emulated_cpu_is_the_same(tmp_path, capsys, native, name):
    cpu, flags, way = CPUS[name]
    python = tmp_path / "python"
    # -0: by that name Python finds its environment
    real = os.path.realpath(sys.executable)
    python.write_text(f'#!/bin/sh\nexec {QEMU} -cpu {cpu} -0 {shlex.join([sys.executable, real])} "$@"\n')
    python.chmod(0o755)
    (tmp_path / "pocl").mkdir()
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache"), "POCL_CACHE_DIR": str(tmp_path / "pocl")}
    environment |= dict.fromkeys(("POCL_MAX_PTHREAD_COUNT", "OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1")
    photo, tile = native

    start = time.perf_counter()
    made = ["--noprogress", str(photo), *LINES[name], str(tmp_path / "tile.tif"), "--device", "cpu"]
    command = [python, "-X", "faulthandler", "-c", RUN, python, flags, json.dumps([made, ["--devices", "-v"]])]
    for _ in range(2):
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=3000)
        with capsys.disabled():
            print(f"\n{name}: {time.perf_counter() - start:.0f} s {done.stderr[-2000:] if done.returncode else ''}")
        if done.returncode != -signal.SIGSEGV:
            break
    assert done.returncode == 0, done.stderr
    listing = done.stdout
    assert f"{way}, system linker: works" in listing, listing
    assert "16 lanes" in listing  # whatever this machine's registers are
    if name == "unknown AMD":
        assert "default settings, system linker: error: unknown target CPU 'generic'" in listing
    assert np.array_equal(load(tmp_path / "tile.tif"), tile)
