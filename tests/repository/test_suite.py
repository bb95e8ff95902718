# SPDX-License-Identifier: Apache-2.0
"""The suite itself: files that take more than their share of a run are named, and an unlisted skip fails in CI."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from types import SimpleNamespace

import pytest

from tests import budget, conftest, forked, skips

ROOT = Path(__file__).parents[2]
OWN = {"test_a": 30.0, "test_b": 60.0, "test_c": 10.0}


def test_shares_are_compared_and_not_times():
    assert budget.above(OWN, OWN) == []
    assert budget.above({file: 7 * own for file, own in OWN.items()}, OWN) == []
    (line,) = budget.above(OWN | {"test_c": 40.0}, OWN)
    assert line.startswith("ABOVE ITS BUDGET: test_c: 30.8 %")
    (line,) = budget.above(OWN | {"test_new": 9.0}, OWN)
    assert "test_new" in line and "0.0 % expected" in line


def test_a_run_of_a_few_files_is_not_compared():
    assert budget.above({"test_b": 60.0, "test_c": 90.0}, OWN) == budget.above({}, OWN) == []


def test_seconds_are_those_of_tests_by_file_with_those_of_forks(monkeypatch):
    def report(file: str, *keywords: str) -> SimpleNamespace:
        return SimpleNamespace(user_properties=[("cpu", 2.0), ("x", 9)], keywords=keywords, fspath=f"tests/{file}.py")

    spent = budget.of_reports([report("test_a"), report("test_a"), report("test_a", "slow"), object()])
    assert spent == {"fast": {"test_a": 4.0}, "slow": {"test_a": 2.0}}
    before = budget.seconds()
    monkeypatch.setattr(forked, "spent", forked.spent + 1000)
    assert 999 < budget.seconds() - before < 1100


def test_the_file_is_renewed_by_files(monkeypatch, tmp_path):
    monkeypatch.setattr(budget, "FILE", tmp_path / "budget.toml")
    for file in ("test_a", "test_b"):
        (tmp_path / f"{file}.py").touch()
    budget.write({"fast": OWN, "slow": {"test_a": 5.0}})
    budget.write({"fast": {"test_b": 1.0}, "slow": {}})
    assert budget.read() == {"fast": {"test_a": 30.0, "test_b": 1.0}, "slow": {"test_a": 5.0}}


def test_the_budget_names_files_that_are_there():
    files = {path.stem for path in Path(__file__).parents[1].rglob("test_*.py")}
    assert {file for kind in tomllib.loads(budget.FILE.read_text()).values() for file in kind} <= files


def test_the_budget_names_every_file_that_has_slow_or_fast_tests():
    """One without an entry is named as above its budget in every run, and nobody looks any more."""
    texts = {path.stem: path.read_text() for path in Path(__file__).parents[1].rglob("test_*.py")}
    slow = {file for file, text in texts.items() if re.search(r"^[^\"\n]*(mark\.slow|\bslow\()", text, re.M)}
    known = {kind: set(files) for kind, files in budget.read().items()}
    assert slow - known["slow"] == set()
    assert set(texts) - slow - known["fast"] == set()


# --- skips ---


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
