# SPDX-License-Identifier: Apache-2.0
"""Random sequences of actions end without a crash, also under the address and undefined-behavior sanitizers."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.hosts.openfx.build import built

ROOT = Path(__file__).parents[3]


def run(file: Path, seed: int, count: int, kills: int, **environment: str) -> str:
    """What the program prints."""
    words = [sys.executable, "-m", "tests.hosts.openfx.sequences", str(file), str(seed), str(count), str(kills)]
    done = subprocess.run(words, cwd=ROOT, env=os.environ | environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-4000:]
    return done.stdout


@pytest.fixture(scope="session")
def sanitized() -> tuple[Path, str]:
    """The plugin with sanitizers, and the libraries that must be loaded first: exceptions are intercepted, too."""
    file = built("openfx_sanitized", "address,undefined")
    lines = [["c++", f"-print-file-name={name}"] for name in ("libasan.so", "libstdc++.so.6")]
    found = [subprocess.run(line, capture_output=True, text=True).stdout.strip() for line in lines]
    if not all(map(os.path.isabs, found)):
        pytest.skip("THE SANITIZERS ARE NOT RUN: c++ has no libasan.so")
    return file, " ".join(found)


def test_forty_sequences(plugin: Path, resident: Callable[[], int]):
    assert run(plugin, 1, 40, 2).endswith("2 kills\n")


@pytest.mark.slow
def test_five_hundred_sequences(sanitized: tuple[Path, str], resident: Callable[[], int]):
    file, library = sanitized
    said = run(file, 3, 500, 50, LD_PRELOAD=library, ASAN_OPTIONS="detect_leaks=0")  # Python leaks on purpose
    assert said.endswith("50 kills\n")
