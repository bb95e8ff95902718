# SPDX-License-Identifier: Apache-2.0
"""A test that CI skips for an unlisted reason fails the run."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests import skips

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize(
    ("reason", "ci", "code"),
    [
        ("no numpy: pip install numpy", "true", 1),
        ("no numpy: pip install numpy", "", 0),
        ("nothing is unreadable for root", "true", 0),
    ],
)
def test_a_skip_in_ci_is_a_failure_unless_it_is_listed(tmp_path, reason, ci, code):
    (tmp_path / "test_it.py").write_text(
        f"import pytest\ndef test_passes(): pass\ndef test_skipped(): pytest.skip({reason!r})\n"
    )
    line = [sys.executable, "-m", "pytest", "-p", "tests.conftest", "-n", "1", str(tmp_path)]
    done = subprocess.run(line, cwd=ROOT, env=os.environ | {"CI": ci}, capture_output=True, text=True, timeout=100)
    assert done.returncode == code, done.stdout + done.stderr
    assert (f"SKIPPED IN CI: Skipped: {reason}" in done.stdout) == bool(code)


def test_the_reasons_of_one_kind_are_told_once():
    assert skips.unexpected(["no fish", "no fish", "no test photos: set OIIOTEX_TEST_DATA"]) == ["no fish"]
