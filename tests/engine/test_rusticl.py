# SPDX-License-Identifier: Apache-2.0
"""Kernels under rusticl, Mesa's OpenCL: the front end (SPIR-V, NIR) of AMD's and Intel's GPUs, executed on the CPU.

Its library is found where the system has it, or by OIIOTEX_RUSTICL; other tests do not see it. Its llvmpipe ends the
loops of a work-item after 65,535 iterations in total, so oiiotex refuses it (`opencl.probe`). The tests use it
nevertheless, with the code of GPUs (one lane), whose work-items are short enough here.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.gpu.run import run_tests
from tests.engine.test_same_bits import ROOT, bits

LIBRARY = os.environ.get("OIIOTEX_RUSTICL") or next(map(str, Path("/usr/lib").glob("*/libRusticlOpenCL.so.1")), "")
SECONDS = 900  # in which the tests end on any machine
# Those that compare a kernel with an oracle. What the program does with kernels is the same on all devices; patches of
# 21 px exceed the 65,535 iterations.
FILES = [
    str(next(ROOT.glob(f"tests/*/test_{name}.py")).relative_to(ROOT))
    for name in ("candidates", "histograms", "label_kernels", "moments", "patchmatch", "quilting", "squares",
                 "steerable", "superpixels")
]  # fmt: skip
FILES.append("tests/synthesis/test_use_prices.py::test_what_is_used_too_much_is_dear")
# the answer that its probe does not give
WORKS = """
from oiiotex.engine.opencl import device_choice, runtime
info = next(d for d in device_choice.devices() if d.platform == "rusticl")
runtime.keep(info.handle, runtime.Trial(runtime.Attempt(), lanes=1, failures=()))
"""
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not LIBRARY, reason="NOTHING RUN ON RUSTICL: not installed: mesa-opencl-icd"),
]


@pytest.fixture
def rusticl(tmp_path, monkeypatch):
    (tmp_path / "rusticl.icd").write_text(LIBRARY)
    monkeypatch.setenv("OCL_ICD_VENDORS", str(tmp_path))
    monkeypatch.setenv("RUSTICL_ENABLE", "llvmpipe")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    subprocess.run([sys.executable, "-c", WORKS], cwd=ROOT, check=True, timeout=60)


def test_rusticl_makes_the_same_bits(rusticl):
    assert bits("rusticl", tiny=False) == bits("0", tiny=False)


def test_tests_of_kernels_pass_on_rusticl(rusticl):
    done = run_tests(FILES, "rusticl", SECONDS)
    assert not done["failed"] and not done["ended"], done
    assert done["passed"] + done["skipped"] == done["collected"] > 200, done
