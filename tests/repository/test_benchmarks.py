# SPDX-License-Identifier: Apache-2.0
"""`python -m benchmarks` renews what its pages say was measured, and every script of a topic can still be imported."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks import __main__ as front
from benchmarks.tiles.stationarization import DEFAULT, FLAT_TEXTURE, TEXTURE, Photo
from oiiotex.engine.session import Session
from tests import pictures
from tests.conftest import save

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "benchmarks"
PAGES = sorted(front.FOLDER.glob("*.md"))
TOPICS = sorted(path.parent for path in FOLDER.glob("*/__init__.py") if path.parent.name != "shared")
MODULES = sorted(path for path in FOLDER.glob("*/*.py") if not path.name.startswith(("__init__", "test_", "lite0")))
ENTRIES = """# A topic

Text by hand.

## One

Of one.

`python -m benchmarks.speed.programs --help` (a machine, 2000-01-01)

| old | table |

more of the old

## Two

`python -m benchmarks.speed.programs --unknown` (a machine, 2000-01-02)

| kept |
"""


def test_every_topic_has_a_page_and_every_page_is_listed():
    assert [page.stem for page in PAGES] == [topic.name for topic in TOPICS]
    readme = (FOLDER / "README.md").read_text()
    for page in PAGES:
        assert f"](results/{page.name})" in readme
    assert len(readme.splitlines()) <= 100


@pytest.mark.parametrize("topic", TOPICS, ids=lambda path: path.name)
def test_a_topic_has_at_most_twelve_files(topic):
    assert len(list(topic.glob("*.py"))) <= 12


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.stem)
def test_every_table_has_its_command_and_its_date(page):
    text = page.read_text()
    found = [match[0] for match in front.ENTRY.finditer(text)]
    assert found
    assert len(set(front.commands(page))) == len(found), "a command stands twice"
    for entry in found:
        head, _, body = entry.partition("\n")
        assert re.search(r", 20\d\d-\d\d-\d\d(, inputs [0-9a-f]{8})?\)$", head), head
        assert body.strip(), f"{head}: nothing below it"


def test_a_table_is_renewed_and_all_else_is_kept(tmp_path, capfd):
    page = tmp_path / "topic.md"
    page.write_text(ENTRIES)
    assert front.commands(page) == [
        "-m benchmarks.speed.programs --help", "-m benchmarks.speed.programs --unknown",
    ]  # fmt: skip
    assert front.renew(page, ["--help"])
    text = page.read_text()
    assert "old" not in text and "```\nusage: programs.py" in text
    assert "2000-01-01" not in text
    before, _, after = ENTRIES.partition("`python -m benchmarks.speed.programs --help` (a machine, 2000-01-01)\n")
    assert text.startswith(before) and text.endswith(after[after.index("## Two") :])
    assert not front.renew(page, ["--unknown"])  # its table stays
    assert page.read_text() == text
    assert "exit status 2" in capfd.readouterr().err


@pytest.mark.parametrize("words", [["nothing"], ["tiles", "nothing"]])
def test_what_is_not_there_is_refused(words):
    with pytest.raises(SystemExit, match=r"nothing.*: expected"):
        front.main(words)


@pytest.mark.slow
def test_every_script_can_be_imported():
    """In one process: each alone takes a second."""
    code = "import importlib, sys\n"
    code += "OPTIONAL = {'numba', 'llvmlite', 'torch', 'matplotlib', 'cv2'}\n"
    code += "for name in sys.argv[1:]:\n"
    code += "    try:\n        importlib.import_module(name)\n"
    code += "    except ModuleNotFoundError as error:\n"
    code += "        if error.name not in OPTIONAL:\n            raise\n"
    names = [".".join(path.relative_to(ROOT).with_suffix("").parts) for path in MODULES]
    assert len(names) > 30
    done = subprocess.run([sys.executable, "-c", code, *names], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]


def test_the_default_tile_is_measured_against_the_photo_and_the_flattened_photo(tmp_path):
    """The tile is made of the flattened photo, so it is nearer to that."""
    lit = pictures.moss(64, 64, 1) * np.linspace(0.4, 1, 64, dtype=np.float32)[:, None]
    photo = Photo(save(lit, tmp_path / "lit.png"), 64, Session())
    found = photo.costs(DEFAULT, 0, ["histogram"])
    assert set(found) == {"histogram", TEXTURE, FLAT_TEXTURE}
    assert 0 < found[FLAT_TEXTURE] < found[TEXTURE]
