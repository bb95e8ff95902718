# SPDX-License-Identifier: Apache-2.0
"""The kernels of multiscale synthesis under Oclgrind: no access out of bounds, no data race."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from oiiotex import device

SCRIPT = """
import numpy as np
from pathlib import Path
from oiiotex.device import Device, choose
from oiiotex.synthesis.candidates import Stacks, analyse
from oiiotex.synthesis.exemplars import Edge, Graph
from oiiotex.synthesis.multiscale import Settings, Synthesizer
from oiiotex.synthesis.superexemplar import unrolled
from oiiotex.windows import Window
Device.lanes = {lanes}
opened = Device(choose("Oclgrind"))
graph = Graph(("a",), (Path("a"),), 0, (Edge(0, 0, 1),), (1.0,))
levels = unrolled(graph, 4)
planes = np.random.default_rng(0).integers(-900, 900, (len(levels.stacks), 16, 16, 4)).astype(np.int16)
planes[..., 3] = 0
usable = np.ones(planes.shape[:3], bool)
usable[:, 3:6, 2:9] = False
class Names(set):
    def append(self, item): self.add(item[0])
opened._events, opened.record = Names(), True
made = analyse(opened, Stacks(levels, planes, usable), 16, True, 1 << 30, lambda done, total: None, None)
maker = Synthesizer(opened, made, Settings(seed=1, jitter=(0.0, 0.6), kept=0.8), 1 << 30)
maker.window(5, Window.sized(3, -2, 6, 5))
opened.finish()
print(*sorted(opened._events))
"""


@pytest.mark.skipif(not any(d.platform == "Oclgrind" for d in device.devices()), reason="Oclgrind is not installed")
@pytest.mark.parametrize("lanes", [1, 16, 32])
def test_oclgrind_finds_nothing(tmp_path, lanes):
    log = tmp_path / "log"
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT.format(lanes=lanes)],
        env={**os.environ, "OCLGRIND_DATA_RACES": "1", "OCLGRIND_LOG": str(log)},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    found = log.read_text() if log.exists() else ""
    assert not found, found[:3000]
    kernels = {
        line.split("(")[0].split()[-1]
        for name in ("candidates", "multiscale")
        for line in (device.resources.files("oiiotex") / "cl" / f"{name}.cl").read_text().splitlines()
        if line.startswith("__kernel")
    }
    assert kernels <= set(done.stdout.split()), "a kernel did not run"
