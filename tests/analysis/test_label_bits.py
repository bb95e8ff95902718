# SPDX-License-Identifier: Apache-2.0
"""Labels and their memberships are the same bits whatever numpy, the C library and the BLAS know of the processor."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.labels.bits import SETTINGS

ROOT = Path(__file__).parents[2]
MADE = """
import hashlib, json
import OpenImageIO as oiio
from oiiotex import filters
from tests.analysis.test_labels import buffer, quarters
made = filters.label(buffer(quarters(144)[0]), membership=True)
def bits(image):
    kind = oiio.UINT32 if image.spec().format == oiio.UINT32 else oiio.FLOAT
    return hashlib.sha256(image.get_pixels(kind).tobytes()).hexdigest()
print(json.dumps({name: bits(image) for name, image in made.items()}))
"""


def bits(setting: str) -> dict[str, str]:
    """Of every part: levels, memberships, fits."""
    environment = os.environ | SETTINGS[setting]
    words = [sys.executable, "-c", MADE]
    done = subprocess.run(words, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.fixture(scope="module")
def as_it_is() -> dict[str, str]:
    made = bits("as it is")
    assert {"label.1", "membership.1", "fit.1"} < set(made)
    return made


@pytest.mark.parametrize(
    "setting",
    [pytest.param(name, marks=() if name == "no AVX2" else pytest.mark.slow) for name in list(SETTINGS)[1:]],
)
def test_no_processor_and_no_blas_shows(as_it_is, setting):
    assert bits(setting) == as_it_is
