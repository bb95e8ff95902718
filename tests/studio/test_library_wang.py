# SPDX-License-Identifier: Apache-2.0
"""Wang tiles in a library: `wang = true` delivers what renderers need, and everything else follows."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from oiiotex_studio.library.catalog import Catalog
from oiiotex_studio.library.commands import run
from oiiotex_studio.library.report import write_report
from oiiotex_studio.library.upkeep import check
from oiiotex_studio.materials import preview
from oiiotex_studio.recipes.lines import require_lines

from oiiotex.engine import errors
from oiiotex.synthesis.wang.plane import index_image
from tests.any_filter import buffer
from tests.conftest import load
from tests.library_makings import brought_in, recipe
from tests.library_makings import here as here

ATLAS = """
[[product]]
name = "tile"
line = "$maps --texstationarize:kinds=$kinds:variants=16:size=16x16:pack=atlas:iterations=1 $outputs"
[deliver]
wang = true
"""
SIDE = 16  # px; of a tile


def atlas(path: Path, channels: int, space: str) -> oiio.ImageBuf:
    """An atlas of noise, so that tests need no synthesis."""
    pixels = np.rint(255 * np.random.default_rng(channels).random((4 * SIDE, 4 * SIDE, channels))) / 255
    image = buffer(pixels, oiio.UINT8, space)
    image.specmod().attribute("oiiotex:atlas", "4x4")
    path.parent.mkdir(parents=True, exist_ok=True)
    assert image.write(str(path))
    return image


@pytest.fixture
def library(tmp_path: Path, here: None, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A library of one material of two maps, which are atlases already: its line only passes them on."""
    atlas(tmp_path / "photos/wall_color.png", 3, "srgb_rec709_scene")
    atlas(tmp_path / "photos/wall_rough.png", 1, "")
    monkeypatch.setattr("oiiotex_studio.library.ingest.require_lines", lambda recipe: "tile")
    told = recipe(
        '[[product]]\nname = "tile"\nline = "$maps $outputs"\n[deliver]\nwang = true\n[assets.wall]\nsize_m=[2, 1]\n'
    )
    tally, said = brought_in(tmp_path / "photos", tmp_path / "library", told)
    assert tally.counts == {"ok": 1}, said
    return tmp_path / "library"


def test_everything_for_renderers_is_delivered(library, capsys):
    with Catalog(library) as catalog:
        wall = catalog.assets()["wall"]
        assert list(check(catalog)) == []
        assert catalog.measures()["wall"]["tiles"] == 16
        text = write_report(catalog, "library").read_text()
        assert sum(size for _, _, size, _ in catalog.files("wall")) == catalog.sizes()["wall"]
    folder = library / wall.folder
    assert f'<a href="{wall.folder}/wall.html">plane</a>' in text
    np.testing.assert_array_equal(load(folder / "tile/index.png"), index_image(16, 0))
    documents = {name: (folder / name).read_text() for name in ("wall.mtlx", "wall_standard.mtlx", "wall.usda")}
    for name in ("wall.mtlx", "wall_standard.mtlx"):
        assert all(
            f'value="{file}"' in documents[name] for file in ("tx/color.tx", "tx/roughness.tx", "tile/index.png")
        )
    assert "open_pbr_surface" in documents["wall.mtlx"] and "standard_surface" in documents["wall_standard.mtlx"]
    assert "@./tile/tile_color.exr@" in documents["wall.usda"] and "(2, 4)" in documents["wall.usda"]  # 1/0.5, 1/0.25
    assert load(folder / "tile/tile_color.exr").shape == (SIDE, SIDE, 3)
    sidecar = json.loads((folder / "asset.json").read_text())
    assert sidecar["tile_m"] == [0.5, 0.25]
    assert sidecar["wang"]["tiles"] == {"color": "tile/tile_color.exr", "roughness": "tile/tile_roughness.exr"}
    listed = {file["path"] for file in sidecar["files"]} | {"asset.json"}
    assert listed == {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    for name in ("thumbnail", "preview_plane", "lit", "compared", "card"):
        assert load(folder / f"{name}.jpg").std() > 2
    assert not (folder / "preview_2x2.jpg").exists()
    assert run(["list", str(library), "--measure", "tiles>1"]) == 0 and "wall" in capsys.readouterr().out
    assert run(["export", str(library), str(library.parent / "out")]) == 0
    assert (library.parent / "out/wall/tile/index.png").is_file()


def test_files_of_wang_tiles_are_not_taken_for_those_of_a_line(library, tmp_path):
    told = recipe('[[product]]\nname = "tile"\nline = "$maps $outputs"\n[deliver]\n')
    assert brought_in(tmp_path / "photos", library, told)[0].counts == {"ok": 1}
    with Catalog(library) as catalog:
        names = {path for path, *_ in catalog.files("wall")}
    assert "tile/color.exr" in names and not {"tile/index.png", "tile/tile_color.exr", "wall.html"} & names


def test_a_shader_renders_the_delivered_document(library, tmp_path, monkeypatch):
    asked = []

    def render(document, maps, resources, side, tile, columns):
        asked.append((document.is_file(), document.name, sorted(maps), tile, columns))
        return np.concatenate([np.zeros((side, side, 3)), np.ones((side, side, 1))], -1)

    monkeypatch.setattr("oiiotex_studio.library.asset.shaded_sphere", render)
    deliver = "[deliver]\nwang = true\nshader = true\n[assets.wall]\nsize_m = [2, 1]\n"
    told = recipe('[[product]]\nname = "tile"\nline = "$maps $outputs"\n' + deliver)
    tally, _ = brought_in(tmp_path / "photos", library, told)
    assert tally.counts == {"ok": 1}
    assert asked == [(True, "wall.mtlx", ["color", "roughness"], (0.5, 0.25), 4)]
    assert min(load(path).max() for path in library.glob("assets/wall/*/lit.jpg")) <= 4 / 255  # the new one is black


def test_pictures_show_the_plane():
    index = index_image(16, 0)
    color = np.kron(np.arange(16, dtype=np.float32).reshape(4, 4, 1) / 16, np.ones((4, 4, 3), np.float32))
    flat = np.ones((1, 1, 1), np.float32)
    looks = preview.Looks(color, np.array([[[0, 0, 1]]], np.float32), flat, flat, flat, 4, index)
    small = looks.pictures("sphere", False, np.zeros((preview.CARD, 8, 3)))["thumbnail.jpg"]
    shown = np.rint(16 * preview.decoded(small[2::4, 2::4, 0]))
    np.testing.assert_array_equal(shown, index[:4, :4, 2])


@pytest.mark.parametrize(
    ("told", "says"),
    [
        (
            ATLAS.replace(":pack=atlas", ""),
            "product tile: wang = true delivers atlases of Wang tiles; add :variants=16",
        ),
        (ATLAS + 'format = "tiff"\n', 'wang = true requires format = "exr"'),
        (ATLAS + 'shader = true\nshape = "plane"\n', "shader = true renders the MaterialX document: requires"),
    ],
)
def test_a_recipe_without_atlases_is_refused(told, says):
    with pytest.raises(errors.ParameterError, match=says.replace("=", ".")):
        require_lines(recipe(told))
    require_lines(recipe(ATLAS))
