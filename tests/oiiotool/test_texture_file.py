# SPDX-License-Identifier: Apache-2.0
"""`wall.oiiotex`: what is wrong is said in one line, and tiles of levels are windows of --texsynth."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from oiiotex.engine.core.window import Window
from oiiotex.engine.errors import Error, ImageError
from oiiotex.engine.session import Session
from oiiotex.oiiotool.service.door import answer
from oiiotex.oiiotool.service.texture_file import TextureFile, read_texture_file, tile_side
from oiiotex.oiiotool.service.textures import OpenTexture, opened
from oiiotex.synthesis.wang.tiles import Edges, edges_of
from tests import pictures
from tests.conftest import save

WALL = {"oiiotex": 1, "photo": "photo.exr", "size": "1000x70000", "seed": 3}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """With a photo of 32 px that says no space, one that does, and a graph of it."""
    path = tmp_path_factory.mktemp("texture")
    pixels = pictures.stained(pictures.bricks(32, 40, seed=1))
    save(pixels, path / "photo.exr", "half")
    save(pixels, path / "tagged.exr", "half", "lin_rec709_scene")
    graph = {"exemplars": [{"id": "a", "file": "tagged.exr"}], "edges": [{"from": "a", "to": "a", "r": 2}]}
    (path / "loop.json").write_text(json.dumps(graph))
    return path


@pytest.fixture(scope="module")
def session() -> Session:
    """As a resident process has one."""
    session = Session(budget=1 << 30)
    session.resources.memories = 48
    return session


def wall(folder: Path, name: str = "wall.oiiotex", **changes: object) -> str:
    """The name of a document; None leaves a key out."""
    path = folder / name
    path.write_text(json.dumps({key: value for key, value in (WALL | changes).items() if value is not None}))
    return str(path)


@pytest.mark.parametrize(
    ("changes", "query", "text"),
    [
        ({"oiiotex": 2}, "", r"oiiotex: expected 1 \(the version of the format\), not 2"),
        ({"oiiotex": True}, "", "the version of the format"),
        ({"photo": None}, "", "expected one of photo, graph and tiles, not none"),
        ({"graph": "loop.json"}, "", "not photo and graph"),
        ({"photo": "nowhere.exr"}, "", "nowhere.exr: No such file"),
        ({"photo": 7}, "", "photo: expected a string of 1 to 1000 characters without NUL, not 7"),
        ({"fotograph": "x.exr"}, "", "unknown key 'fotograph'.*; expected oiiotex, photo, graph, tiles"),
        ({"size": None}, "", "size is missing: expected WIDTHxHEIGHT"),
        ({"size": "0x4"}, "", "size=0x4: expected"),
        ({"size": f"{2**31}x4"}, "", r"1 to 2147482624 px \(2\^31 - 1024\)"),
        ({"size": "2147482624x131073"}, "", r"expected at most 2\^48 px in total"),
        ({"plan": "loop.json"}, "", "size conflicts with plan, which requires a photo and defines the rest"),
        ({"plan": "loop.json", "size": None, "seed": None}, "?seed=7", "seed conflicts with plan"),
        ({"tiles": "photo.exr"}, "", "not photo and tiles"),
        ({"photo": None, "tiles": "photo.exr", "lod": 3}, "", "lod conflicts with tiles, which have one level"),
        ({"seed": -1}, "", "seed: expected an integer from 0 to 4294967295, not -1"),
        ({"seed": True}, "", "seed: expected an integer .*, not True"),
        ({"lod": 61}, "", "lod: expected an integer from 0 to 60, not 61"),
        ({"autocc": 1}, "", "autocc: expected true or false, not 1"),
        ({"photo": None, "graph": "loop.json", "colorspace": "ACEScg"}, "", "colorspace requires photo"),
        ({}, "?sed=7", r"'\?sed=7': expected seed, size"),
        ({}, "?seed=seven", "seed: expected an integer .*, not 'seven'"),
        ({}, "?size=8", "size=8: expected WIDTHxHEIGHT"),
        ({}, f"?seed={'9' * 9000}", r"the query after '\?' has 9005 characters: expected at most 1000"),
        ({}, f"?size={'9' * 990}", r"size=9{60}: expected WIDTHxHEIGHT"),
        ({}, f"?seed={'9' * 990}", r"seed: expected an integer .*, not 9{60}\.\.\."),
        ({"colorspace": "x" * 1001}, "", r"colorspace: expected a string of 1 to 1000 characters .*, not 'x{59}\.\.\."),
        ({"photo": "a\0b"}, "", r"photo: expected a string .* without NUL, not 'a\\x00b'"),
    ],
)
def test_what_is_wrong_in_a_document_is_said(folder, changes, query, text):
    with pytest.raises(ImageError, match=text) as caught:
        read_texture_file(wall(folder, **changes) + query)
    assert str(caught.value).startswith(str(folder / "wall.oiiotex"))


@pytest.mark.parametrize(
    ("content", "text"),
    [
        ("{", "not JSON"),
        ("[1]", "expected an object of oiiotex, photo, graph, tiles, size, not a list"),
        ("", "not JSON"),
    ],
)
def test_what_is_no_document_is_said(folder, content, text):
    (folder / "bad.oiiotex").write_text(content)
    with pytest.raises(ImageError, match=text):
        read_texture_file(str(folder / "bad.oiiotex"))
    assert text in answer(json.dumps({"name": str(folder / "bad.oiiotex")}))["error"]
    with pytest.raises(ImageError, match="No such file"):
        read_texture_file(str(folder / "none.oiiotex?seed=7"))


def test_a_name_that_is_too_long_is_said(folder):
    for name in (
        "x" * 9000,
        f"{'x/' * 4000}wall.oiiotex",
        f"{'x' * 300}.oiiotex",
        "a\0.oiiotex",
        f"{'x' * 9000}?seed=7",
    ):
        with pytest.raises(ImageError, match=r"has \d+ characters: expected at most 4096|File name too long") as caught:
            read_texture_file(name)
        assert len(str(caught.value)) < 500
    for word in ("{", "[]", "7", '{"name": 7}', '{"texture": "{}"}', '{"texture": 7}', "[" * 100_000):
        assert answer(word) == {"error": "malformed request"}


def test_files_outside_the_documents_folder_are_refused_unless_they_are_allowed(folder, tmp_path, monkeypatch):
    monkeypatch.delenv("OIIOTEX_TEXTURE_PATH", raising=False)
    (tmp_path / "below").mkdir()
    photo, below = folder / "tagged.exr", tmp_path / "below" / "photo.exr"
    below.write_bytes(photo.read_bytes())
    (tmp_path / "link.exr").symlink_to(photo)
    (tmp_path / "inside.exr").symlink_to(below)
    (tmp_path / "folder").symlink_to(folder)
    up = os.path.relpath(photo, tmp_path)
    for where in ("below/photo.exr", str(below), "below/../below/photo.exr", "inside.exr"):
        file = read_texture_file(wall(tmp_path, photo=where))
        assert os.path.samefile(file.photo, below)
    graph = {"exemplars": [{"id": "a", "file": str(photo)}], "edges": [{"from": "a", "to": "a", "r": 2}]}
    (tmp_path / "graph.json").write_text(json.dumps(graph))
    elsewhere = (
        {"photo": str(photo)}, {"photo": up}, {"photo": "link.exr"}, {"photo": "folder/tagged.exr"},
        {"photo": "/nowhere.exr"}, {"photo": None, "graph": str(folder / "loop.json")}, {"photo": None, "tiles": up},
        {"photo": "below/photo.exr", "plan": "/etc/passwd", "size": None, "seed": None},
        {"photo": None, "graph": "graph.json"},
    )  # fmt: skip
    for changes in elsewhere:
        text = "is outside the document's folder.*: expected a file in it, or in a folder of .OIIOTEX_TEXTURE_PATH"
        with pytest.raises(ImageError, match=text):
            read_texture_file(wall(tmp_path, **changes))
    monkeypatch.setenv("OIIOTEX_TEXTURE_PATH", os.pathsep.join(("/none", "relative", "", str(folder))))
    for changes in (*elsewhere[:4], elsewhere[8]):
        assert read_texture_file(wall(tmp_path, **changes))
    with pytest.raises(ImageError, match="is outside"):
        read_texture_file(wall(tmp_path, photo="/etc/passwd"))


@pytest.mark.skipif(os.geteuid() == 0, reason="nothing is unreadable for root")
def test_a_file_that_may_not_be_read_is_said(folder):
    path = Path(wall(folder, "theirs.oiiotex"))
    path.chmod(0)
    with pytest.raises(ImageError, match="Permission denied"):
        read_texture_file(str(path))


def test_a_name_overrides_and_a_text_brings_it_all_back(folder):
    name = wall(folder, colorspace="ACEScg", device="cpu", note="words")
    file = read_texture_file(f"{name}?seed=9&size=64x32")
    assert (file.seed, file.width, file.height, file.device) == (9, 64, 32, "cpu")
    assert file.photo == str(folder / "photo.exr") and file.settings().device_name == "cpu"
    assert TextureFile.of_text(file.text()) == file
    literal = Path(f"{name}?seed=9")
    literal.write_text(Path(name).read_text())  # a file of that very name is that file
    assert read_texture_file(str(literal)).seed == 3


def test_tiles_grow_where_a_cache_could_not_count_them(folder):
    for size, tile in (("9x9", 64), (f"{2**20}x{2**20}", 64), (f"{2**21}x{2**20}", 128), ("2147482624x131072", 1024)):
        file = read_texture_file(wall(folder, size=size))
        assert tile_side(file.width, file.height) == tile


def test_tiles_are_windows_of_the_levels(folder, session):
    file = read_texture_file(wall(folder, colorspace="lin_rec709_scene"))
    texture = opened(file.text(), session)
    assert (texture.spec.width, texture.spec.height, texture.levels) == (1000, 70000, 17)
    assert texture.spec["oiio:ColorSpace"] == "lin_rec709_scene" and texture.spec.format == oiio.TypeDesc("half")
    photo = oiio.ImageBuf(str(folder / "photo.exr"))
    for level, left, top, width, height in ((0, 250, 60000, 64, 64), (2, 64, 0, 300, 20), (5, 0, 64, 64, 64)):
        tile = texture.tile(level, Window.sized(left, top, width, height), session)
        window = f"{width}x{height}+{left}+{top}"
        same = filters.synth(photo, window=window, lod=5 - level, seed=3, colorspace="lin_rec709_scene")
        np.testing.assert_array_equal(tile.astype(np.float32), same.get_pixels(oiio.FLOAT))
    coarsest = texture.tile(5, Window(0, 0, 1, 1), session)
    assert (texture.tile(9, Window(0, 64, 64, 128), session) == coarsest).all()


def test_a_graph_is_a_texture_too_at_any_level(folder, session):
    name = wall(folder, photo=None, graph="loop.json")
    texture = opened(read_texture_file(f"{name}?lod=7").text(), session)
    tile = texture.tile(1, Window(128, 0, 192, 64), session)
    same = filters.synth(graph=folder / "loop.json", window="64x64+128+0", lod=6, seed=3)
    np.testing.assert_array_equal(tile.astype(np.float32), same.get_pixels(oiio.FLOAT))


def test_a_plan_is_a_texture_of_one_level(folder, session):
    photo = oiio.ImageBuf(str(folder / "tagged.exr"))
    whole = filters.quilt(photo, size=(300, 130), patch=16, seed=5, planfile=folder / "plan.npz").get_pixels(oiio.FLOAT)
    name = wall(folder, photo="tagged.exr", plan="plan.npz", size=None, seed=None)
    texture = opened(read_texture_file(name).text(), session)
    assert (texture.spec.width, texture.spec.height, texture.spec.tile_width, texture.levels) == (300, 130, 64, 1)
    tile = texture.tile(0, Window(256, 64, 320, 192), session).astype(np.float32)
    np.testing.assert_array_equal(tile[:66, :44], whole[64:, 256:])
    assert not tile[66:].any() and not tile[:, 44:].any()


def wang_set(folder: Path, count: int, edges: list[Edges], spaces: tuple[str, ...] = ("lin_rec709_scene",)) -> str:
    """A file of tiles of 12 x 8 px whose pixels are (tile, row, column)."""
    y, x = np.mgrid[:8, :12]
    tiles = []
    for number in range(count):
        spec = oiio.ImageSpec(12, 8, 3, "half")
        spec.attribute("oiio:subimagename", f"tile{number}")
        spec.attribute("oiio:ColorSpace", spaces[number % len(spaces)])
        if edges:
            spec.attribute("oiiotex:edges", str(edges[number]))
        tiles.append((spec, np.stack([np.full_like(y, number), y, x], axis=-1).astype(np.float32)))
    out = oiio.ImageOutput.create(str(folder / "set.exr"))
    assert out.open(str(folder / "set.exr"), tuple(spec for spec, _ in tiles))
    for number, (spec, pixels) in enumerate(tiles):
        assert number == 0 or out.open(str(folder / "set.exr"), spec, "AppendSubimage")
        assert out.write_image(pixels)
    out.close()
    return "set.exr"


@pytest.mark.parametrize("count", [3, 20])
def test_tiles_lie_beside_tiles_with_the_same_edges(folder, session, count):
    edges = edges_of(count)
    name = wall(folder, photo=None, tiles=wang_set(folder, count, edges))
    texture = OpenTexture(read_texture_file(name).text(), session)
    assert (texture.spec.width, texture.spec.height, texture.levels) == (1000, 70000, 1)
    place = Window(-36, -16, 300, 240)
    plane = texture.tile(0, place, session).astype(int)
    np.testing.assert_array_equal(plane[..., 1], np.mgrid[-16:240, -36:300][0] % 8)
    np.testing.assert_array_equal(plane[..., 2], np.mgrid[-16:240, -36:300][1] % 12)
    tiles = plane[::8, ::12, 0]
    assert len(np.unique(tiles)) == count
    for one, below in zip(tiles[:-1].ravel(), tiles[1:].ravel(), strict=True):
        assert edges[one].south == edges[below].north
    for one, beside in zip(tiles[:, :-1].ravel(), tiles[:, 1:].ravel(), strict=True):
        assert edges[one].east == edges[beside].west
    part = texture.tile(0, Window(5, 3, 50, 44), session)
    np.testing.assert_array_equal(part, plane[3 + 16 : 44 + 16, 5 + 36 : 50 + 36])
    other = OpenTexture(read_texture_file(f"{name}?seed=4").text(), session).tile(0, place, session)
    assert (other[..., 0] != plane[..., 0]).any()


@pytest.mark.parametrize("last", [[], [Edges(999, 999, 999, 999)]])  # 10^12 sets of four colors are not looked through
def test_tiles_that_want_those_before_are_refused(folder, session, last):
    edges = edges_of(8) + last
    name = wall(folder, photo=None, tiles=wang_set(folder, len(edges), edges))
    with pytest.raises(
        ImageError, match=rf"set\.exr: {len(edges)} tiles are not a complete set: none has the edges n0e0s"
    ):
        OpenTexture(read_texture_file(name).text(), session)


def test_tiles_that_lost_their_edges_or_differ_in_color_space_are_refused(folder, session):
    name = wall(folder, photo=None, tiles=wang_set(folder, 16, []))
    with pytest.raises(ImageError, match=r"set\.exr: 16 tiles without edge colors .*; write the set as EXR"):
        OpenTexture(read_texture_file(name).text(), session)
    name = wall(folder, photo=None, tiles=wang_set(folder, 3, [], ("lin_rec709_scene", "srgb_rec709_scene")))
    with pytest.raises(ImageError, match=r"part 'tile1' .*size"):
        OpenTexture(read_texture_file(name).text(), session)


def test_color_is_not_guessed_and_a_changed_photo_is_no_longer_the_same(folder, session):
    with pytest.raises(Error, match="has no color space tag"):
        OpenTexture(read_texture_file(wall(folder)).text(), session)
    file = read_texture_file(wall(folder, photo="tagged.exr"))
    os.utime(folder / "tagged.exr", ns=(1, 1))
    with pytest.raises(ImageError, match=r"tagged\.exr .*changed"):
        OpenTexture(file.text(), session)


@pytest.mark.parametrize(
    ("level", "window"),
    [(0, (0, 0, 0, 4)), (0, (0, 0, 1 << 20, 1 << 20)), (0, (1 << 50, 0, (1 << 50) + 1, 1)), (17, (0, 0, 1, 1))],
)
def test_what_is_no_tile_is_refused(folder, session, level, window):
    texture = opened(read_texture_file(wall(folder, colorspace="lin_rec709_scene")).text(), session)
    with pytest.raises(ImageError, match=r"expected (1 to 16777216 px, near|0 to 16)"):
        texture.tile(level, Window(*window), session)


def test_a_pipe_with_the_suffix_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "wall.oiiotex")
    with pytest.raises(ImageError, match="not a regular file"):
        read_texture_file(str(tmp_path / "wall.oiiotex"))
