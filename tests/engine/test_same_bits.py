# SPDX-License-Identifier: Apache-2.0
"""Every CPU runtime of the machine gives the same bits: PoCL of PyPI, of the system, Intel's; Oclgrind on tiny images.

Each runs in a process of its own: two of them bring two LLVMs.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from oiiotex.engine.opencl import device_choice as devices
from oiiotex.engine.opencl.device import DeviceInfo

ROOT = Path(__file__).parents[2]
MADE = """
import hashlib, json, sys
import numpy as np
import OpenImageIO as oiio
from oiiotex import filters
from oiiotex.engine.session import Session
from tests import pictures
from tests.any_filter import buffer
tiny = int(sys.argv[2])
session = Session(device_name=sys.argv[1], threads=tiny)  # Oclgrind takes commands from one thread alone
side = 24 if tiny else 56
photo = buffer(pictures.stained(pictures.pebbles(side, side + 4, seed=3)))
made = {
    "tile": filters.stationarize(photo, size=(16, 14), sigma=6, iterations=1, seed=1, session=session),
    "label map": filters.label(photo, session=session),
    "window": filters.synth(photo, size=(40, 30), seed=2, session=session) if not tiny else None,
}
def bits(image):
    image = next(iter(image.values())) if isinstance(image, dict) else image
    array = image.get_pixels(image.spec().format)
    return hashlib.sha256(repr((array.shape, array.dtype)).encode() + array.tobytes()).hexdigest()
print(json.dumps({name: bits(image) for name, image in made.items() if image is not None}))
"""


def bits(device: str, tiny: bool) -> dict[str, str]:
    done = subprocess.run(
        [sys.executable, "-c", MADE, device, str(int(tiny))], cwd=ROOT, capture_output=True, text=True, timeout=900
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def runtimes(kind: str) -> list[DeviceInfo]:
    return [d for d in devices.devices() if d.kind == kind and getattr(devices.trial_of(d), "works", True)]


@pytest.mark.parametrize("tiny", [False, pytest.param(True, marks=pytest.mark.slow)], ids=["cpus", "with a checker"])
def test_all_runtimes_make_the_same_bits(capsys, tiny):
    found = runtimes("cpu") + [d for d in runtimes("other") if tiny and d.platform == "Oclgrind"]
    made = {f"{d.platform}, {d.version}": bits(str(d.number), tiny) for d in found}
    with capsys.disabled():
        print(f"\nthe same bits are asked of {len(made)}: {'; '.join(made)}")
    first, *others = made
    for other in others:
        assert made[other] == made[first], f"{other} is not {first}"
