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

from oiiotex import plugin
from oiiotex.engine.core.op import Op
from tests.conftest import load, oiiotex, save

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "how-to" / "your_own_filter.md"


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
    assert set(blocks()) == {"pyproject.toml", "studio_filters.py", "studio_mix.py", "studio_color.py"}
    for name in ("studio_filters.py", "studio_mix.py", "studio_color.py"):  # by the public door alone
        assert set(re.findall(r"from (oiiotex[\w.]*) import", blocks()[name])) == {"oiiotex.plugin"}
    assert len(code) <= 30


def test_it_joins_the_chain(studio, photo, tmp_path):
    done = oiiotex(photo, "--flip", "--texposterize:steps=4", "--flip", "-o", "out.png", cwd=tmp_path, env=studio)
    assert (done.returncode, done.stderr) == (0, "")
    assert set(np.unique(load(tmp_path / "out.png"))) <= {0, 85, 170, 255}
    bad = oiiotex(photo, "--texposterize:stebs=4", "-o", "out.png", cwd=tmp_path, env=studio)
    assert "did you mean 'steps'" in bad.stderr


def test_a_filter_of_two_images_works_in_lab(studio, photo, tmp_path):
    space = ("--iscolorspace", "srgb_rec709_scene")
    dark = save(0.8 * load(photo)[:40] / 255.0, tmp_path / "dark.png")
    words = (photo, *space, dark, *space, "--texmatchlight", "-d", "float", "-o", "lit.exr")
    done = oiiotex(*words, cwd=tmp_path, env=studio)
    assert (done.returncode, done.stderr) == (0, "")
    means = []
    for name in ("lit.exr", dark):
        assert oiiotex(name, *space, "--texlab", "-d", "float", "-o", "lab.exr", cwd=tmp_path).returncode == 0
        means.append(load(tmp_path / "lab.exr")[..., :3].mean((0, 1)))
    np.testing.assert_allclose(*means, atol=0.1)


def test_a_filter_of_two_images_mixes_pixel_by_pixel(studio, tmp_path):
    random, space = np.random.default_rng(0), ("--iscolorspace", "srgb_rec709_scene")
    save(random.random((40, 50, 4)) * 0.5 + 0.5, tmp_path / "a.exr", "float", x=7, y=-5)
    save(random.random((30, 60, 3)), tmp_path / "b.exr", "float")
    words = ("a.exr", *space, "b.exr", *space, "--texlabmix:amount=0.25", "-o", "mix.exr")
    done = oiiotex(*words, cwd=tmp_path, env=studio)
    assert (done.returncode, done.stderr) == (0, "")
    a, _, mix = (load(tmp_path / f"{name}.exr") for name in ("a", "b", "mix"))
    np.testing.assert_array_equal(mix[..., 3], a[..., 3])
    np.testing.assert_allclose(mix[30:], a[30:], atol=1e-4)
    labs = []
    for name in ("a", "b", "mix"):
        assert oiiotex(f"{name}.exr", *space, "--texlab", "-o", "lab.exr", cwd=tmp_path).returncode == 0
        labs.append(load(tmp_path / "lab.exr")[:30, :50, :3])
    np.testing.assert_allclose(labs[2], 0.75 * labs[0] + 0.25 * labs[1], atol=0.05)


def test_what_the_page_names_is_at_the_door():
    tables = {}
    for table in re.findall(r"(?:^\|.*\n)+", PAGE.read_text(), re.MULTILINE):
        head, _, *rows = table.splitlines()
        tables[head.split("|")[1].strip()] = {
            name for row in rows for name in re.findall(r"`(\w+)`", row.split("|")[1])
        }
    assert tables["base"] >= {"Pointwise", "Whole"} and tables["kind"] >= {"PIXELS", "TABLE"}
    for name in tables["base"]:
        assert issubclass(getattr(plugin, name), Op), name
    assert tables["kind"] <= {kind.name for kind in plugin.Kind}


def test_its_function_joins_python(studio, photo, tmp_path):
    [block] = [code for code in re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL) if "class " not in code]
    code = f"import OpenImageIO as oiio\nbuf = oiio.ImageBuf({str(photo)!r})\n{block}print(steps.nchannels)"
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=studio, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "3\n"), done.stderr


def test_it_joins_help_and_completion(studio):
    assert "--texposterize" in oiiotex("--help", "texture", env=studio).stdout
    assert ":steps" in oiiotex("--help", "posterize", env=studio).stdout
    assert "--texposterize" in oiiotex("--completion", "bash", env=studio).stdout


@pytest.mark.slow
def test_it_joins_the_promise_tests(studio):
    which = "posterize or labmix or matchlight"
    command = [sys.executable, "-m", "pytest", "tests/promises/test_promises.py", "-k", which, "-vv"]
    done = subprocess.run(command, cwd=ROOT, env=studio, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-3000:]
    passed = [line for line in done.stdout.splitlines() if " PASSED" in line]
    assert all(sum(name in line for line in passed) >= 10 for name in which.split(" or ")), done.stdout[-3000:]


OPTIONS = """
from oiiotex.oiiotool.cli.language.parse import Option
def say(chain, word):
    "Say a word"
    if chain.acts():
        print("it says", word)
SAY, TAKEN = Option("--say WORD", say, heading="Viewing"), Option("--flip", say)
"""


def test_an_option_of_another_distribution_joins_the_line_and_the_help(tmp_path):
    facts = tmp_path / "further_options-1.dist-info"
    facts.mkdir()
    (tmp_path / "further_options.py").write_text(OPTIONS)
    (facts / "METADATA").write_text("Metadata-Version: 2.1\nName: further-options\nVersion: 1\n")
    (facts / "entry_points.txt").write_text("[oiiotex.options]\nsay = further_options:SAY\n")
    line = ("--pattern", "black", "4x4", "3", "--say", "yes", "-o", tmp_path / "out.png")
    done = oiiotex(*line, env=seeing(tmp_path))
    assert (done.returncode, done.stdout, done.stderr) == (0, "it says yes\n", "")
    done = oiiotex("--help", "viewing", env=seeing(tmp_path))
    assert "--say WORD" in done.stdout and not done.stderr
    for name, value, why in (
        ("say", "further_options:TAKEN", "expected an Option named --say"),
        ("flip", "further_options:TAKEN", "option '--flip' already exists"),
        ("say", "further_options:NONE", "NONE"),
    ):
        (facts / "entry_points.txt").write_text(f"[oiiotex.options]\n{name} = {value}\n")
        done = oiiotex("--help", "viewing", env=seeing(tmp_path))
        assert done.returncode == 0 and "--say" not in done.stdout
        assert f"option {name} of {value} is ignored: " in done.stderr and why in done.stderr
        assert len(done.stderr.strip().splitlines()) == 1


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("class Posterize(Pointwise)", "class Posterize"), "expected a subclass"),
        (('"posterize"', '"warp"'), "filter 'warp' already exists"),
        (("import numpy", "import nothing_of_that_name"), "nothing_of_that_name"),
        (("    steps: int", "    plan: int"), "Posterize.plan would hide a method"),
    ],
)
def test_a_broken_one_is_passed_over_with_a_warning(site, tmp_path, change, says):
    broken = shutil.copytree(site, tmp_path / "site") / "studio_filters.py"
    assert change[0] in broken.read_text()
    broken.write_text(broken.read_text().replace(*change))
    done = oiiotex("--help", "texture", env=seeing(tmp_path / "site"))
    assert done.returncode == 0 and "--texposterize" not in done.stdout
    assert says in done.stderr and len(done.stderr.strip().splitlines()) == 1
