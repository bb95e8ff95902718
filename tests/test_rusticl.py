# SPDX-License-Identifier: Apache-2.0
"""Kernels under rusticl, Mesa's OpenCL: the front end (SPIR-V, NIR) of AMD's and Intel's GPUs, executed on the CPU.

Its library is found where the system has it, or by OIIOTEX_RUSTICL; other tests do not see it.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from benchmarks.gpu.run import kernel_tests, run_tests
from tests.test_same_bits import bits

LIBRARY = os.environ.get("OIIOTEX_RUSTICL") or next(map(str, Path("/usr/lib").glob("*/libRusticlOpenCL.so.1")), "")
SECONDS = 180  # for all tests of kernels; what does not fit is counted
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not LIBRARY, reason="NOTHING RUN ON RUSTICL: not installed: mesa-opencl-icd"),
]


@pytest.fixture
def rusticl(tmp_path, monkeypatch):
    (tmp_path / "rusticl.icd").write_text(LIBRARY)
    monkeypatch.setenv("OCL_ICD_VENDORS", str(tmp_path))
    monkeypatch.setenv("RUSTICL_ENABLE", "llvmpipe")


def test_rusticl_makes_the_same_bits(rusticl):
    assert bits("rusticl", tiny=False) == bits("0", tiny=False)


def test_tests_of_kernels_pass_on_rusticl(rusticl, capsys):
    files = [file for file in kernel_tests() if "promises" not in file]  # the other tests have run its kernels
    done = run_tests(files, "rusticl", SECONDS)
    with capsys.disabled():
        print(f"\nrusticl: {done['passed']} of {done['collected']} passed, {done['skipped']} skipped {done['ended']}")
    assert not done["failed"], done["failures"]
    assert done["passed"] > 10, done  # slow machines run fewer within the time
