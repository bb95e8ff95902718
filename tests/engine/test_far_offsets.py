# SPDX-License-Identifier: Apache-2.0
"""Sizes at which products pass 2^31, on a machine that could not hold them: tests/far_offsets.py says how."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from oiiotex.engine.opencl import device_choice as devices
from tests.far_offsets import CASES

ROOT = Path(__file__).parents[2]
pytestmark = [
    pytest.mark.skipif(sys.platform != "linux", reason="memory is mapped as Linux does it"),
    pytest.mark.skipif(devices.devices()[0].kind != "cpu", reason="a buffer is the host's memory on a CPU alone"),
]


@pytest.mark.slow
@pytest.mark.parametrize("case", [case.__name__ for case in CASES])
@pytest.mark.parametrize("lanes", [1, 32])
def test_kernels_reach_beyond_2_to_the_31(case, lanes):
    command = [sys.executable, "-m", "tests.far_offsets", str(lanes), case]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert (done.returncode, done.stdout.splitlines()[-1:]) == (0, ["all"]), done.stdout + done.stderr
