# SPDX-License-Identifier: Apache-2.0
"""The kernels of superpixels under Oclgrind: no access out of bounds, no data race."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from oiiotex import device

SCRIPT = """
import numpy as np
from oiiotex.analysis import labgrid
from oiiotex.analysis.hierarchy import hierarchy
from oiiotex.analysis.superpixels import superpixels
from oiiotex.device import Device, choose
from oiiotex.working import lens_of
from tests.test_superpixels import image_of, session_of
Device.lanes = {lanes}
opened = Device(choose("Oclgrind"))
class Names(set):
    def append(self, item): self.add(item[0])
opened._events, opened.record = Names(), True
pixels = np.random.default_rng(0).random((19, 27, 4))
pixels[3:8, 5:9, 3] = 0
session, image = session_of(opened), image_of(pixels)
for budget in (labgrid._HOST_BYTES, 0):
    labgrid._HOST_BYTES, labgrid.BAND_BYTES = budget, 1000
    found = superpixels(image, lens_of(image, session.color), session, sigma=5.0, iterations=3)
hierarchy(found, session, np.array([5.0, 8.0, 11.0, 14.0]))
opened.finish()
print(*sorted(opened._events))
"""


@pytest.mark.skipif(not any(d.platform == "Oclgrind" for d in device.devices()), reason="Oclgrind is not installed")
@pytest.mark.parametrize("lanes", [1, 16, 32])
def test_oclgrind_finds_nothing(tmp_path, lanes):
    log = tmp_path / "log"
    checks = {"OCLGRIND_DATA_RACES": "1", "OCLGRIND_LOG": str(log)}
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT.format(lanes=lanes)],
        env={**os.environ, **checks},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    found = log.read_text() if log.exists() else ""
    assert not found, found[:3000]
    source = (device.resources.files("oiiotex") / "cl" / "superpixels.cl").read_text()
    kernels = {line.split("(")[0].split()[-1] for line in source.splitlines() if "__kernel" in line}
    assert kernels - set(done.stdout.split()) <= ({"superpixels_clear"} if lanes > 1 else set()), "a kernel did not run"
