# SPDX-License-Identifier: Apache-2.0
"""The public benchmark: tools from a file, the table, the page for votes and their score."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

from benchmarks.tilebench import compare as bench
from benchmarks.tilebench import votes
from benchmarks.tiles import drifts
from benchmarks.tiles.first_tile import measured
from tests.browser import chromium
from tools.demo import save


def test_a_tool_is_added_by_four_lines(tmp_path):
    file = tmp_path / "tools.toml"
    file.write_text('[[tool]]\nname = "copy"\ninstall = "x"\ncommand = ["cp", "{photo}", "{tile}"]\n')
    (tool,) = bench.listed(file)
    save(np.zeros((8, 9, 3), np.uint8), tmp_path / "photo.png")
    assert tool.available() and bench.made(tool, tmp_path / "photo.png", tmp_path / "tile.png", 8) >= 0
    assert (tmp_path / "tile.png").read_bytes() == (tmp_path / "photo.png").read_bytes()


def test_our_line_makes_a_tile(tmp_path, photo):
    tool = bench.ours("ours", "--flip")
    assert bench.made(tool, photo, tmp_path / "tile.png", 8) > 0


def test_names_of_tools_differ_and_can_be_file_names():
    names = [tool.name for tool in bench.tools()]
    assert len(names) == len(set(names)) and all(re.fullmatch(r"[\w-]+", name) and "--" not in name for name in names)


def test_the_clean_texture_keeps_all_bands_and_the_photo_keeps_the_drift():
    clean = bench.photos(64)["made_moss"]
    known, photo = drifts.Clean.of(clean), drifts.drifted(clean, "gradient+stain")
    rows = {name: {"x": measured(tile, known, bench.color.rgb2lab(photo)) | {"seconds": 1.0}}
            for name, tile in (("clean", clean), ("photo", photo))}  # fmt: skip
    cells = {line.split("|")[1].strip(): line.split("|")[2:] for line in bench.table(rows).splitlines()[2:]}
    assert [cells["clean"][n].strip() for n in (0, 1, 2)] == ["1 of 1", "1.00", "1.00"]
    assert float(cells["photo"][2]) < 0.05 and "failed" not in bench.table(rows | {"other": {"x": {"failed": "no"}}})


def test_a_vote_for_each_and_none():
    first = {"photo": "p", "first": "a", "second": "b", "better": "first"}
    assert votes.score([first]) == {"a": 1.0, "b": 0.0}
    assert votes.score([first, first | {"better": "second"}, first | {"better": "same"}]) == {"a": 0.5, "b": 0.5}


@pytest.mark.slow
def test_the_page_pairs_tiles_of_a_photo_and_counts_votes(tmp_path):
    names = ["p--a.png", "p--b.png", "q--a.png", "p--c.png"]
    (tmp_path / "vote.html").write_text(votes.page(names))
    with chromium() as browser:
        page = browser.new_page()
        page.goto((tmp_path / "vote.html").as_uri())
        for key in "120":
            page.keyboard.press(key)
        assert page.inner_text("#count") == "3 of 3"
        with page.expect_download() as saved:
            page.click("#save")
        told = json.loads(saved.value.path().read_text())["votes"]
    assert {frozenset((v["first"], v["second"])) for v in told} == {frozenset(p) for p in ("ab", "ac", "bc")}
    assert [v["better"] for v in told] == ["first", "second", "same"] and {v["photo"] for v in told} == {"p"}
