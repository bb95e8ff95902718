# SPDX-License-Identifier: Apache-2.0
"""A test that CI skips for an unlisted reason fails the run."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from tests import conftest, skips

ROOT = Path(__file__).parents[2]


def test_a_skip_in_ci_is_a_failure_unless_it_is_listed(tmp_path):
    (tmp_path / "test_it.py").write_text(
        "import pytest\ndef test_passes(): pass\n"
        "def test_skipped(): pytest.skip('no numpy: pip install numpy')\n"
        "def test_listed(): pytest.skip('nothing is unreadable for root')\n"
    )
    line = [sys.executable, "-m", "pytest", "-p", "tests.conftest", "-n", "1", str(tmp_path)]
    done = subprocess.run(line, cwd=ROOT, env=os.environ | {"CI": "true"}, capture_output=True, text=True, timeout=100)
    assert done.returncode == 1, done.stdout + done.stderr
    assert "SKIPPED IN CI: Skipped: no numpy" in done.stdout and done.stdout.count("SKIPPED IN CI") == 1


@pytest.mark.parametrize(("ci", "status"), [("true", pytest.ExitCode.TESTS_FAILED), ("", pytest.ExitCode.OK)])
def test_elsewhere_a_skip_is_none(monkeypatch, ci, status):
    monkeypatch.setenv("CI", ci)
    reports = SimpleNamespace(stats={"skipped": [SimpleNamespace(longrepr="no fish")]}, write_line=lambda text: None)
    config = SimpleNamespace(pluginmanager=SimpleNamespace(get_plugin=lambda name: reports))
    session = SimpleNamespace(config=config, exitstatus=pytest.ExitCode.OK)
    conftest.pytest_sessionfinish(session)
    assert session.exitstatus == status


def test_the_reasons_of_one_kind_are_told_once():
    assert skips.unexpected(["no fish", "no fish", "no test photos: set OIIOTEX_TEST_DATA"]) == ["no fish"]
