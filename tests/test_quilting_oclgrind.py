# SPDX-License-Identifier: Apache-2.0
"""The kernels of quilting under Oclgrind: no access out of bounds, no data race."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from oiiotex import device

SCRIPT = """
import numpy as np
from oiiotex.analysis import regions
from oiiotex.device import Device, choose
from oiiotex.synthesis import quilting
from oiiotex.synthesis.plans import Grid, NONE, Plan
from oiiotex.windows import Window
Device.lanes = {lanes}
opened = Device(choose("Oclgrind"))
class Names(set):
    def append(self, item): self.add(item[0])
opened._events, opened.record = Names(), True
random = np.random.default_rng(0)
lab = random.integers(-300, 300, (19, 23, 3)).astype(np.int16)
labels = np.where(np.indices((19, 23))[1] < 12, 1, 2).astype(np.uint8)
for tile in (True, False):
    grid = Grid(27, 22, 12, 4, tile, tile)
    table = regions.content_table(*regions.window_keys(labels, 12), 12, grid.step)
    found = quilting.Exemplar(lab, table, (quilting.folded(labels), quilting.folded(labels + 3)), labels)
    keys = random.integers(0, len(table.keys), grid.shape).astype(np.int32)
    guide = random.integers(0, 3, (*grid.shape, quilting.GUIDE, quilting.GUIDE)).astype(np.uint16)
    rules = quilting.Rules(candidates=5, reach=1, reuse=1.0)
    made = quilting.Quilt(opened, found, grid, quilting.Demand(keys, guide), rules, 1 << 30)
    made.sources(Window(0, 0, 27, 22))
    plan = made.finished()
    plan.offsets[1:3, 1:3] = NONE
    made = quilting.Quilt(opened, found, grid, quilting.Demand(keys, guide), rules, 1 << 30, plan=plan)
    made.sources(Window(3, 1, 20, 19))
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
        timeout=400,
    )
    assert done.returncode == 0, done.stderr
    found = log.read_text() if log.exists() else ""
    assert not found, found[:3000]
    kernels = {
        line.split("(")[0].split()[-1]
        for line in (device.resources.files("oiiotex") / "cl" / "quilting.cl").read_text().splitlines()
        if line.startswith("__kernel")
    }
    assert kernels <= set(done.stdout.split()), "a kernel did not run"
