# SPDX-License-Identifier: Apache-2.0
"""Tile sets of two materials for Tiled and Godot."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import OpenImageIO as oiio
import pytest
from oiiotex_studio.library.commands import run

from oiiotex.engine.errors import Error
from oiiotex.synthesis.wang.transition import LAYOUT, controls
from tests.any_filter import buffer
from tests.conftest import load

SIDE = 16  # px; of a tile


def atlas(path: Path, count: int, channels: int = 3, marked: bool = True) -> Path:
    """An atlas of one color for each tile, so that tests need no cuts."""
    columns, rows = LAYOUT[count]
    numbers = np.arange(columns * rows).reshape(rows, columns).repeat(SIDE, 0).repeat(SIDE, 1)
    image = buffer(np.repeat(numbers[..., None] / 255, channels, 2), oiio.UINT8)
    if marked:
        image.specmod().attribute("oiiotex:filter", "transition")
        image.specmod().attribute("oiiotex:atlas", str(LAYOUT[count]))
    assert image.write(str(path))
    return path


@pytest.mark.parametrize("count", [16, 47])
def test_the_tile_set_says_where_each_material_lies(tmp_path, count):
    run(["tileset", str(tmp_path / "ground"), f"color={atlas(tmp_path / 'a.png', count)}", "--materials", "gräs,sand"])
    root = ElementTree.parse(tmp_path / "ground/ground.tsx").getroot()
    wangset = root.find("wangsets/wangset")
    assert [one.get("name") for one in wangset.iter("wangcolor")] == ["gräs", "sand"]
    points = controls(count)
    assert root.get("tilecount") == str(len(points)) and root.find("image").get("source") == "ground_color.png"
    for number, tile in enumerate(wangset.iter("wangtile")):
        told = [int(value) for value in tile.get("wangid").split(",")]
        grid = points[number] + 1
        if count == 16:
            assert told[::2] == [0] * 4
            grid = np.pad(grid[:, [0, 0, 1]][[0, 0, 1]], 0)
        clockwise = [grid[0, 1], grid[0, 2], grid[1, 2], grid[2, 2], grid[2, 1], grid[2, 0], grid[1, 0], grid[0, 0]]
        assert told[1::2] == clockwise[1::2] and (count == 16 or told == clockwise)


@pytest.mark.parametrize("count", [16, 47])
def test_tiles_of_the_example_map_fit_each_other(tmp_path, count):
    run(["tileset", str(tmp_path / "ground"), f"color={atlas(tmp_path / 'a.png', count)}"])
    text = ElementTree.parse(tmp_path / "ground/ground.tmx").getroot().find("layer/data").text
    cells = np.array([[int(cell) for cell in line.strip(",").split(",")] for line in text.split()]) - 1
    points = controls(count)[cells]
    assert len(np.unique(cells)) > 8
    np.testing.assert_array_equal(points[:, :-1, :, -1], points[:, 1:, :, 0])
    np.testing.assert_array_equal(points[:-1, :, -1], points[1:, :, 0])


def test_godot_gets_terrains_and_normals(tmp_path):
    files = [f"color={atlas(tmp_path / 'a.png', 47)}", f"normal={atlas(tmp_path / 'n.png', 47)}"]
    run(["tileset", str(tmp_path / "ground"), *files, "--materials", 'grass,"s"'])
    text = (tmp_path / "ground/ground.tres").read_text()
    assert re.findall(r'path="([^"]*)"', text) == ["ground_color.png", "ground_normal.png"]
    assert 'normal_texture = ExtResource("2")' in text and 'texture = SubResource("lit")' in text
    assert 'terrain_set_0/terrain_1/name = "\\"s\\""' in text and "terrain_set_0/mode = 0" in text
    assert len(re.findall(r"^\d:\d/0 = 0$", text, re.M)) == 48
    down, right = {"top": 0, "bottom": 2}, {"left": 0, "right": 2}
    bits = re.findall(r"^(\d):(\d)/0/terrains_peering_bit/([a-z_]+)_(?:side|corner) = (\d)$", text, re.M)
    assert len(bits) == 48 * 8
    for column, row, name, value in bits:
        words = name.split("_")
        y, x = (next((places[word] for word in words if word in places), 1) for places in (down, right))
        assert controls(47)[int(row) * 8 + int(column)][y, x] == int(value)
    assert text.index("terrain_set_0/mode") < text.index("sources/0 =")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["color=plain.png"], "is not an atlas of --textransition"),
        (["normal=a.png"], "expected color=FILE"),
        (["color=a.png", "normal=b.png"], "does not have the size of a.png"),
        (["color=a.png", "--materials", "grass"], "expected two names"),
        (["color=a.png", "--name", "../x"], "--name"),
        (["color=missing.png"], "missing.png"),
    ],
)
def test_what_is_no_such_atlas_is_refused(tmp_path, monkeypatch, words, message):
    monkeypatch.chdir(tmp_path)
    atlas(tmp_path / "a.png", 16)
    atlas(tmp_path / "b.png", 47)
    atlas(tmp_path / "plain.png", 16, marked=False)
    with pytest.raises(Error, match=re.escape(message)):
        run(["tileset", "ground", *words])
    assert not (tmp_path / "ground").exists()


@pytest.mark.skipif(shutil.which("tiled") is None, reason="no Tiled")
def test_tiled_reads_the_set_and_draws_the_map(tmp_path):
    run(["tileset", str(tmp_path / "ground"), f"color={atlas(tmp_path / 'a.png', 47)}"])
    quiet = {**os.environ, "QT_QPA_PLATFORM": "offscreen", "XDG_RUNTIME_DIR": str(tmp_path)}
    folder = tmp_path / "ground"
    words = ["tiled", "--export-tileset", "json", str(folder / "ground.tsx"), str(tmp_path / "set.json")]
    subprocess.run(words, check=True, env=quiet, timeout=120)
    wangset = json.loads((tmp_path / "set.json").read_text())["wangsets"][0]
    assert wangset["type"] == "mixed" and len(wangset["wangtiles"]) == 48
    words = ["tmxrasterizer", str(folder / "ground.tmx"), str(tmp_path / "map.png")]
    subprocess.run(words, check=True, env=quiet, timeout=120)
    text = ElementTree.parse(folder / "ground.tmx").getroot().find("layer/data").text
    cells = np.array([[int(cell) for cell in line.strip(",").split(",")] for line in text.split()]) - 1
    np.testing.assert_array_equal(load(tmp_path / "map.png")[SIDE // 2 :: SIDE, SIDE // 2 :: SIDE, 0], cells)
