# SPDX-License-Identifier: Apache-2.0
"""A studio's own filter, as the docs show it, joins without touching our code."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import load, oiiotex

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "your_own_filter.md"


def blocks() -> dict[str, str]:
    """The files that the page shows, by name."""
    return dict(re.findall(r"`([\w.]+)`:\n\n```\w+\n(.*?)```", PAGE.read_text(), re.DOTALL))


def installed(folder: Path, files: dict[str, str]) -> Path:
    """The package installed into a folder of its own."""
    (folder / "package").mkdir()
    for name, text in files.items():
        (folder / "package" / name).write_text(text)
    command = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--target", folder / "site"]
    done = subprocess.run([*command, folder / "package"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder / "site"


def seeing(site: Path) -> dict[str, str]:
    """An environment that sees what is installed there."""
    return {**os.environ, "PYTHONPATH": str(site), "PYTHONDONTWRITEBYTECODE": "1"}


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    return installed(tmp_path_factory.mktemp("studio"), blocks())


@pytest.fixture
def studio(site) -> dict[str, str]:
    return seeing(site)


def test_the_page_shows_a_filter_of_thirty_lines():
    code = [line for line in blocks()["studio_filters.py"].splitlines() if line.strip()]
    assert set(blocks()) == {"pyproject.toml", "studio_filters.py"}
    assert len(code) <= 30


def test_it_joins_the_chain(studio, photo, tmp_path):
    done = oiiotex(photo, "--flip", "--texposterize:steps=4", "--flip", "-o", "out.png", cwd=tmp_path, env=studio)
    assert (done.returncode, done.stderr) == (0, "")
    assert set(np.unique(load(tmp_path / "out.png"))) <= {0, 85, 170, 255}
    bad = oiiotex(photo, "--texposterize:stebs=4", "-o", "out.png", cwd=tmp_path, env=studio)
    assert "did you mean 'steps'" in bad.stderr


def test_it_joins_help_and_completion(studio):
    assert "--texposterize" in oiiotex("--help", env=studio).stdout
    assert ":steps" in oiiotex("--help", "posterize", env=studio).stdout
    assert "--texposterize" in oiiotex("--completion", "bash", env=studio).stdout


@pytest.mark.slow
def test_it_joins_the_promise_tests(studio):
    command = [sys.executable, "-m", "pytest", "tests/test_promises.py", "-k", "posterize", "-v"]
    done = subprocess.run(command, cwd=ROOT, env=studio, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-3000:]
    assert int(re.search(r"(\d+) passed", done.stdout)[1]) >= 10


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("class Posterize(Op)", "class Posterize"), "no subclass"),
        (('"posterize"', '"warp"'), "there is a filter 'warp' already"),
        (("import numpy", "import nothing_of_that_name"), "nothing_of_that_name"),
    ],
)
def test_a_broken_one_is_passed_over_with_a_warning(site, tmp_path, change, says):
    broken = shutil.copytree(site, tmp_path / "site") / "studio_filters.py"
    assert change[0] in broken.read_text()
    broken.write_text(broken.read_text().replace(*change))
    done = oiiotex("--help", env=seeing(tmp_path / "site"))
    assert done.returncode == 0 and "--texposterize" not in done.stdout
    assert says in done.stderr and len(done.stderr.strip().splitlines()) == 1
