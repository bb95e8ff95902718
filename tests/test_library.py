# SPDX-License-Identifier: Apache-2.0
"""A library from a folder: what is found by names, made by lines, delivered, kept, judged, and what survives faults."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import zipfile
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import errors
from oiiotex.cli.progress import Display
from oiiotex.library import asset as making
from oiiotex.library import catalogue as catalogues
from oiiotex.library import ingest
from oiiotex.library.catalogue import Catalogue
from oiiotex.library.main import run
from oiiotex.library.report import write_report
from oiiotex.library.upkeep import Search, check, orphans
from oiiotex.materials import documents
from oiiotex.materials import preview as pictures
from oiiotex.materials.naming import read_name
from oiiotex.recipes import found as finding
from oiiotex.recipes.found import MapFile, materials
from oiiotex.recipes.lines import require_lines, steps_of
from oiiotex.recipes.recipe import Recipe, commented_recipe, load_recipe, recipe_of
from tests import pictures as drawn
from tests.conftest import load, save

LINE = '[[product]]\nname = "tile"\nline = "$maps $outputs"\n'
OPENGL = 'schema = 1\n[find]\nnormals = "opengl"\n'


def recipe(text: str = LINE, before: str = "schema = 1\n") -> Recipe:
    import tomllib

    return recipe_of(tomllib.loads(before + text), "recipe")


def bumps(side: int = 24, seed: int = 1) -> np.ndarray:
    """A map of normals: OpenGL's, 0 to 1."""
    heights = drawn.smooth_noise(side, side, 6, seed)
    dy, dx = np.gradient(heights)
    vectors = np.dstack([-4 * dx, 4 * dy, np.ones_like(dx)])
    return 0.5 + 0.5 * vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


@pytest.fixture
def photos(tmp_path: Path) -> Path:
    """Two materials, one of them of three maps."""
    folder = tmp_path / "photos"
    (folder / "scans").mkdir(parents=True)
    save(drawn.pebbles(24, 24, 1), folder / "gravel.png")
    save(drawn.bricks(24, 24, 2), folder / "scans" / "wall_diff_1k.png")
    save(bumps(), folder / "scans" / "wall_nor_gl_1k.png")
    save(drawn.noise(24, 24, 3)[..., None], folder / "scans" / "wall_rough_1k.png")
    return folder


@pytest.fixture
def here(monkeypatch):
    """Jobs are done in this process: starting others takes a second."""
    monkeypatch.setattr(ingest, "_in_processes", lambda jobs, workers: ((making.make(job), job) for job in jobs))
    for name in ("_THUMBNAIL", "_REPEATED", "_LIT", "_RIVALS", "CARD"):
        monkeypatch.setattr(pictures, name, 48)


def brought_in(photos: Path, library: Path, how: Recipe, **settings: object) -> tuple[ingest.Tally, list[str]]:
    said: list[str] = []
    tally = ingest.ingest(photos, library, how, ingest.Settings(**settings), said.append, Display(terminal=False))
    return tally, said


# --- found by names ---


@pytest.mark.parametrize(
    ("stem", "read"),
    [
        ("aerial_rocks_02_nor_gl_2k", ("aerial_rocks_02", "normal", "opengl", ("2k",))),
        ("aerial_rocks_02_diff_4k", ("aerial_rocks_02", "color", "", ("4k",))),
        ("Rock053_2K-JPG_NormalDX", ("Rock053", "normal", "directx", ("jpg", "2k"))),
        ("Rock053_1K_Color", ("Rock053", "color", "", ("1k",))),
        ("Rock053_1K-PNG_AmbientOcclusion", ("Rock053", "ao", "", ("png", "1k"))),
        ("tlzxbbr_2K_Albedo", ("tlzxbbr", "color", "", ("2k",))),
        ("Stone_Wall_Base_Color", ("Stone_Wall", "color", "", ())),
        ("lambert1_Normal_OpenGL", ("lambert1", "normal", "opengl", ())),
        ("metal_plate_metal_1k", ("metal_plate", "metal", "", ("1k",))),
        ("rusty_metal_albedo", ("rusty_metal", "color", "", ())),
        ("forest_arm_2k", ("forest", "arm", "", ("2k",))),
        ("rock_disp_1024x1024", ("rock", "height", "", ("1024x1024",))),
        ("roughness", ("", "roughness", "", ())),
        ("IMG_2041", ("IMG_2041", "", "", ())),
        ("opengl", ("opengl", "", "", ())),
        ("beach_4k", ("beach", "", "", ("4k",))),
    ],
)
def test_names_are_read_as_people_write_them(stem, read):
    assert read_name(stem) == read


def test_further_words_of_a_recipe_say_a_role():
    assert read_name("wall_kd", {"color": ("kd",)}).role == "color"


def names_of(folder: Path, how: Recipe) -> dict[str, tuple[dict[str, str], tuple[str, ...]]]:
    return {m.name: ({role: str(file) for role, file in m.maps.items()}, m.questions) for m in materials(folder, how)}


def touched(folder: Path, *names: str) -> Path:
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    return folder


def test_maps_are_gathered_by_folder_and_name_also_out_of_archives(tmp_path):
    touched(tmp_path, "a/moss_diff_1k.jpg", "a/moss_nor_gl_1k.exr", "a/moss_nor_dx_1k.exr", "b/moss_diff_1k.jpg")
    touched(tmp_path, "clay/albedo.png", "clay/rough.png", ".hidden/y.png", "photo 1.jpg")
    with zipfile.ZipFile(tmp_path / "Rock053_1K.zip", "w") as archive:
        archive.writestr("Rock053_1K_Color.jpg", b"")
        archive.writestr("Rock053_1K_NormalGL.jpg", b"")
        archive.writestr("preview.txt", b"")
    found = names_of(tmp_path, recipe())
    assert sorted(found) == ["Rock053", "a_moss", "b_moss", "clay", "photo_1"]
    assert found["a_moss"] == ({"color": "a/moss_diff_1k.jpg", "normal": "a/moss_nor_gl_1k.exr"}, ())
    assert found["Rock053"][0]["normal"] == "Rock053_1K.zip!Rock053_1K_NormalGL.jpg"
    assert found["clay"] == ({"color": "clay/albedo.png", "roughness": "clay/rough.png"}, ())


def test_what_is_ambiguous_is_asked_for_and_the_recipe_answers(tmp_path):
    touched(tmp_path, "m_col_1k.png", "m_col_2k.png", "m_normal.png", "m_thing.png", "o_rough.png")
    found = names_of(tmp_path, recipe())
    assert [re.sub(r"\W.*", "", question) for question in found["m"][1]] == ["which", "are"]
    assert "which is its colour?" in found["o"][1][0]
    answered = '[find]\nprefer = ["2k"]\nskip = false\n[assets.o]\nskip = true\n[assets.m]\nnormals = "directx"\n'
    found = materials(tmp_path, recipe(answered + LINE))
    by_name = {material.name: material for material in found}
    assert "o" not in by_name and by_name["m"].questions == ()
    assert by_name["m"].maps["color"].path == "m_col_2k.png"
    assert by_name["m"].maps["normal"].hand == "directx"
    assert by_name["m_thing"].maps["color"].path == "m_thing.png"


def test_a_nameless_file_beside_maps_is_asked_for(tmp_path):
    touched(tmp_path, "rock/rock.png", "rock/rock_rough.png")
    (question,) = names_of(tmp_path, recipe())["rock"][1]
    assert question.startswith("what is rock/rock.png?")
    told = recipe('[assets.rock]\nmaps = { color = "rock/rock.png" }\n' + LINE)
    assert names_of(tmp_path, told)["rock"] == ({"color": "rock/rock.png", "roughness": "rock/rock_rough.png"}, ())


def test_packed_maps_are_channels(tmp_path):
    touched(tmp_path, "f_diff.png", "f_arm.png", "f_rough.png")
    (material,) = materials(tmp_path, recipe())
    assert material.maps["ao"] == MapFile("f_arm.png", channel="R")
    assert material.maps["metal"].channel == "B"
    assert material.maps["roughness"] == MapFile("f_rough.png")
    (step,) = steps_of(recipe(), material.maps)
    assert "source/ao.png --iscolorspace data --ch R" in " ".join(step.words)


def test_what_is_known_lies_beside_the_photo_or_in_the_recipe(tmp_path):
    touched(tmp_path, "moss_diff.png")
    (tmp_path / "moss.toml").write_text('licence = "CC-BY-4.0"\ntags = ["green"]\nsize_m = [2, 2]\n')
    told = recipe('[find]\nauthor = "we"\ntags = ["scan"]\n[assets.moss]\nauthor = "she"\n' + LINE)
    (material,) = materials(tmp_path, told)
    facts = material.facts
    assert (facts.licence, facts.author, facts.tags, facts.size_m) == ("CC-BY-4.0", "she", ("scan", "green"), (2, 2))


def test_what_cannot_be_read_is_asked_for_and_a_library_is_no_photo(tmp_path):
    touched(tmp_path, "a.png", "b.png", "lib/library.sqlite", "lib/assets/x/k/thumbnail.jpg", "other.toml")
    (tmp_path / "bad.zip").write_bytes(b"no archive")
    with zipfile.ZipFile(tmp_path / "name.zip", "w") as archive:
        archive.writestr("\u00e9.png", b"")
    (tmp_path / "name.zip").write_bytes((tmp_path / "name.zip").read_bytes().replace(b"\xc3\xa9", b"\xff\xff"))
    (tmp_path / "b.toml").write_text("licence = 3\n")
    found = {material.name: material for material in materials(tmp_path, recipe())}
    assert sorted(found) == ["a", "b", "bad", "name"] and found["a"].questions == ()
    assert "name.zip: 'utf-8' codec" in found["name"].questions[0]
    assert "bad.zip" in found["bad"].questions[0] and "licence: allowed is a text" in found["b"].questions[0]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="NOT RUN: no pipes with names")
def test_a_pipe_is_no_photo(tmp_path):
    touched(tmp_path, "a.png")
    for name in ("a.toml", "b.png", "c.zip"):
        os.mkfifo(tmp_path / name)
    assert list(names_of(tmp_path, recipe())) == ["a"]


def test_an_archive_of_zeros_is_not_unpacked(tmp_path, monkeypatch):
    monkeypatch.setattr(finding, "_LARGE", 1 << 18)
    with zipfile.ZipFile(tmp_path / "a.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("bomb.png", bytes(1 << 20))
        archive.writestr("small.png", bytes(1 << 17))
        archive.writestr("photo.png", os.urandom(1 << 10) * (1 << 9))  # 512 KB, and packed by far less than zeros
    with pytest.raises(errors.Error, match=r"a\.zip!bomb\.png: unpacks to over 200 times its size"):
        finding.extract(tmp_path, MapFile("a.zip", "bomb.png"), tmp_path / "bomb.png")
    assert not (tmp_path / "bomb.png").exists()
    for name in ("small.png", "photo.png"):
        finding.extract(tmp_path, MapFile("a.zip", name), tmp_path / name)
        assert (tmp_path / name).stat().st_size >= 1 << 17


# --- recipes and lines ---


def test_the_printed_recipe_holds_also_with_all_its_offers_taken(tmp_path):
    path = tmp_path / "recipe.toml"
    path.write_text(commented_recipe())
    plain = load_recipe(path)
    assert require_lines(plain) == "tile"
    offers = re.sub(r"(?m)^# (?=\[|[a-z_]+ = )", "", commented_recipe())
    path.write_text(offers)
    full = load_recipe(path)
    assert [product.name for product in full.products] == ["tile", "wang", "labels", "palette", "dominant"]
    require_lines(full)
    assert (plain.deliver, plain.find.photos) == (full.deliver, full.find.photos)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('[[product]]\nname = "t"\nline = "$maps --texnothing $outputs"\n', "unknown option '--texnothing'"),
        ('[[product]]\nname = "t"\nline = "$maps --texflatten:sgma=2 $outputs"\n', "sgma"),
        ('[[product]]\nname = "t"\nline = "$color -o $output"\n', "0 products have [$]outputs"),
        ('[[product]]\nname = "t"\nline = "$map $outputs"\n', "[$]map is no placeholder"),
        ('[[product]]\nname = "t"\nline = "x$color $outputs"\n', "[$]color must be a word of its own"),
        ('[[product]]\nname = "t"\nline = "$maps \\"$outputs"\n', "No closing quotation"),
        ('[[product]]\nname = "t"\nline = "$maps --texlive $outputs"\n', "t: --texlive: nobody looks on"),
        ('[[product]]\nname = "t"\nline = "$maps $outputs --tev"\n', "--tev: nobody looks on"),
        ('[[product]]\nname = "t"\nline = "$maps --farm dask=local:2 $outputs"\n', "--farm: .*ingest. spreads"),
        ('[[product]]\nname = "t"\nline = "$maps --share 1/2 $outputs"\n', "--share: .*ingest. spreads"),
        ('[[product]]\nname = "t"\nline = "$maps $outputs --join"\n', "--join: .*ingest. spreads"),
        ('[[product]]\nname = "t"\nline = "$maps $outputs $outputs"\n', "[$]outputs stands twice"),
        ('[[product]]\nname = "t"\nline = "$maps $outputs x.png"\n', "'x.png' behind [$]outputs: only options"),
        ('[[product]]\nname = "T"\nline = "$maps $outputs"\n', "name 'T': allowed are a-z"),
        ('[[product]]\nname = "t"\n', "line must be given"),
        ("", "there is no .*product"),
        (LINE + "[deliver]\nformat = 'png'\n", "format 'png': allowed are exr, tiff"),
        (LINE + "[deliver]\ntx = 1\n", "tx: allowed is true or false"),
        (LINE + "[delivr]\ntx = true\n", "unknown key 'delivr'.*deliver"),
        (LINE + "[judge]\nlimits = ['seam']\n", "'seam': allowed is NAME>NUMBER"),
        (LINE + "[roles.colr]\nspace = 'data'\n", "roles 'colr': allowed are color"),
        (LINE + "[assets.x]\nsize_m = [1]\n", "allowed are width and height in metres"),
    ],
)
def test_what_a_recipe_says_wrong_is_one_line(text, says):
    with pytest.raises(errors.Error, match=says):
        require_lines(recipe(text))


def test_lines_get_files_kinds_and_folders(photos):
    told = recipe(
        '[[product]]\nname = "tile"\nline = "$maps --texpatchmatch:n=$n:kinds=$kinds:report=$report $outputs"\n'
        '[[product]]\nname = "again"\nline = "$tile.color --flip -o $folder/$$x.png"\n'
        '[[product]]\nname = "high"\nline = "$height -o $output"\n'
        '[[product]]\nname = "higher"\nline = "$high.high -o $output"\n'
    )
    (wall,) = [m for m in materials(photos, told) if m.name == "wall"]
    steps = steps_of(told, wall.maps)
    assert [step.product for step in steps] == ["tile", "again"]  # it has no heights
    assert " ".join(steps[0].words) == (
        "source/color.png --iscolorspace srgb_rec709_scene source/normal.png --iscolorspace data"
        " source/roughness.png --iscolorspace data"
        " --texpatchmatch:n=3:kinds=colour,normal,data:report=tile/report.json"
        " -d half -o tile/roughness.exr --pop -d half -o tile/normal.exr --pop"
        " --tocolorspace lin_rec709_scene -d half -o tile/color.exr"
    )
    assert steps[1].words == ("tile/color.exr", "--flip", "-o", "again/$x.png")
    assert steps[1].takes == ("tile",)


# --- made and delivered ---


def test_an_asset_holds_what_is_delivered(photos, tmp_path, here):
    library = tmp_path / "library"
    tally, said = brought_in(photos, library, recipe(LINE + "[deliver]\nusd = true\n"))
    assert (tally.made, tally.counts, tally.status) == (2, {"ok": 2}, 0)
    assert any(re.match(r"wall: ok, \d+ files, \d+\.\d s", line) for line in said)
    with Catalogue(library) as catalogue:
        wall = catalogue.assets()["wall"]
        assert list(check(catalogue)) == []
    folder = library / wall.folder
    assert wall.folder.startswith("assets/wall/")
    given = load(photos / "scans/wall_nor_gl_1k.png") / 255
    np.testing.assert_allclose(load(folder / "tile/normal.exr"), given, atol=1e-3)
    code = load(photos / "scans/wall_diff_1k.png") / 255
    linear = np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(load(folder / "tile/color.exr"), linear, atol=2e-3)
    texture = oiio.ImageBuf(str(folder / "tx/roughness.tx"))
    assert (texture.nmiplevels, texture.spec().get_string_attribute("wrapmodes")) == (5, "periodic,periodic")
    sidecar = json.loads((folder / "asset.json").read_text())
    assert sidecar["schema"] == "oiiotex.asset/1" and sidecar["normals"] == "opengl"
    assert sidecar["lines"]["tile"].startswith("oiiotex source/color.png --iscolorspace srgb_rec709_scene ")
    assert {source["role"] for source in sidecar["sources"]} == {"color", "normal", "roughness"}
    assert not list((library / catalogues.WORK).glob("run-*"))
    for name in ("thumbnail", "preview_2x2", "lit", "image_and_hextiled", "card"):
        assert load(folder / f"{name}.jpg").std() > 2


def test_tiff_and_spaces_of_their_own(photos, tmp_path, here):
    told = recipe(LINE + '[deliver]\nformat = "tiff"\ncolour = ""\ntx = false\nmaterialx = false\n')
    brought_in(photos, tmp_path / "library", told)
    (path,) = (tmp_path / "library").glob("assets/wall/*/tile/color.tif")
    assert oiio.ImageBuf(str(path)).spec().format == oiio.UINT16
    np.testing.assert_array_equal(load(path), load(photos / "scans/wall_diff_1k.png").astype(np.uint16) * 257)


def test_packed_maps_and_archives_are_delivered_as_maps(tmp_path, here):
    folder = tmp_path / "photos"
    folder.mkdir()
    packed = np.dstack([drawn.noise(16, 16, n) for n in range(3)])
    with zipfile.ZipFile(folder / "pack.zip", "w") as archive:
        archive.write(save(drawn.bricks(16, 16, 2), tmp_path / "a.png"), "maps/f_diff_1k.png")
        archive.write(save(packed, tmp_path / "b.png"), "maps/f_arm_1k.png")
    tally, _ = brought_in(folder, tmp_path / "library", recipe())
    assert tally.counts == {"ok": 1}
    for channel, role in enumerate(("ao", "roughness", "metal")):
        (path,) = (tmp_path / "library").glob(f"assets/f/*/tile/{role}.exr")
        np.testing.assert_allclose(load(path)[..., 0], load(tmp_path / "b.png")[..., channel] / 255, atol=1e-3)


def test_normals_of_directx_are_turned_on_request(photos, tmp_path, here):
    (photos / "scans/wall_nor_gl_1k.png").rename(photos / "scans/wall_nor_dx_1k.png")
    given = load(photos / "scans/wall_nor_dx_1k.png") / 255
    brought_in(photos, tmp_path / "a", recipe())
    (path,) = (tmp_path / "a").glob("assets/wall/*/tile/normal.exr")
    np.testing.assert_allclose(load(path), given * [1, -1, 1] + [0, 1, 0], atol=1e-3)
    brought_in(photos, tmp_path / "b", recipe(LINE + '[deliver]\nnormals = ""\n'))
    (path,) = (tmp_path / "b").glob("assets/wall/*/tile/normal.exr")
    np.testing.assert_allclose(load(path), given, atol=1e-3)
    document = next(path.parents[1].glob("*.mtlx")).read_text()
    assert 'name="normal_turned"' in document and 'name="flip_g" type="boolean" value="true"' in document


def test_materialx_and_usd_are_what_their_libraries_take(tmp_path):
    mx = pytest.importorskip("MaterialX", reason="NOT RUN: no MaterialX")
    roles = ("color", "gloss", "height", "metal", "ao", "opacity", "emission", "normal")
    maps = {role: f"tile/{role}.exr" for role in roles}
    (tmp_path / "tile").mkdir()
    for file in maps.values():
        (tmp_path / file).touch()
    described = documents.Described("a b", maps, "lin_rec709_scene", "directx", lattice=False)
    documents.write_materialx(described, tmp_path)
    assert documents.materialx_faults(tmp_path / "a b.mtlx") == []
    document = mx.createDocument()
    mx.readFromXmlFile(document, str(tmp_path / "a b.mtlx"))
    assert [m.getName() for m in document.getMaterialNodes()] == ["a_b", "a_b_hextiled"]
    (tmp_path / "tile/ao.exr").unlink()
    assert "ao.exr is not there" in documents.materialx_faults(tmp_path / "a b.mtlx")[0]
    documents.write_materialx(documents.Described("brick", maps, "ACEScg", "opengl", lattice=True), tmp_path)
    assert "hextiled" not in (tmp_path / "brick.mtlx").read_text()
    pxr = pytest.importorskip("pxr.UsdShade", reason="NOT RUN: no usd-core")
    from pxr import Usd

    documents.write_usd(described, tmp_path)
    stage = Usd.Stage.Open(str(tmp_path / "a b.usda"))
    material = pxr.Material(stage.GetDefaultPrim())
    surface = material.ComputeSurfaceSource()[0]
    assert surface.GetIdAttr().Get() == "UsdPreviewSurface"
    normal = surface.GetInput("normal").GetConnectedSources()[0][0].source.GetPrim()
    assert pxr.Shader(normal).GetInput("scale").Get() == (2, -2, 2, 1)
    variants = stage.GetDefaultPrim().GetVariantSets().GetVariantSet("shading")
    assert variants.GetVariantNames() == ["materialx", "preview"]


def test_blenders_catalogues_have_ids_that_stay():
    text = documents.blender_catalogue(["Materials/ground", "Materials"])
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    assert lines[0] == "VERSION 1"
    shape = re.compile(r"[0-9a-f-]{36}:Materials(/ground:Materials-ground|:Materials)")
    assert len(lines) == 3 and all(map(shape.fullmatch, lines[1:]))
    assert text == documents.blender_catalogue(["Materials", "Materials/ground"])


# --- pictures ---


def test_hex_tiling_keeps_colours_and_breaks_repetition():
    assert np.allclose(pictures.hex_tiled(np.full((32, 32, 3), 0.3), 3, 64), 0.3, atol=1e-6)
    tile = drawn.pebbles(64, 64, 1)
    shown = pictures.hex_tiled(tile, 4, 256)
    assert np.allclose(shown.mean((0, 1)), tile.mean((0, 1)), atol=0.03)
    plain = np.tile(tile, (4, 4, 1))
    assert np.abs(plain - np.roll(plain, 64, 1)).max() == 0
    assert np.abs(shown - np.roll(shown, 64, 1)).mean() > 0.02
    waves = 0.5 + 0.4 * np.cos(2 * np.pi * np.arange(256) / 256)
    smooth = np.broadcast_to(waves[:, None, None] * waves[None, :, None], (256, 256, 3))
    coarse, fine = (np.abs(np.diff(pictures.hex_tiled(smooth, 2, side), axis=1)).max() for side in (128, 512))
    assert fine < 0.4 * coarse  # nothing jumps where hexagons meet


def looks(normal: tuple[float, float, float], colour: float = 0.4, **maps: float) -> pictures.Looks:
    plain = {"roughness": 0.8, "metal": 0.0, "ao": 1.0} | maps
    made = {name: np.full((16, 16, 1), value, np.float32) for name, value in plain.items()}
    direction = np.float32(normal) / np.linalg.norm(normal)
    return pictures.Looks(
        np.full((16, 16, 3), colour, np.float32), np.broadcast_to(direction, (16, 16, 3)).astype(np.float32), **made
    )


def test_light_comes_from_the_upper_left():
    ball = looks((0, 0, 1)).sphere(64)
    assert ball[16, 16].mean() > 2 * ball[48, 48].mean()
    leaning = {side: looks((dx, dy, 1)).plane(64)[48].mean() for side, dx, dy in
               (("left", -0.4, 0), ("right", 0.4, 0), ("up", 0, 0.4), ("down", 0, -0.4))}  # fmt: skip
    assert leaning["left"] > leaning["right"] and leaning["up"] > leaning["down"]


def test_a_white_furnace_gives_no_more_than_it_gets(monkeypatch):
    """Diffuse light alone, from all around, on white: what comes back is what there is."""
    monkeypatch.setattr(pictures, "_LIGHTS", ())
    monkeypatch.setattr(pictures, "_SKY", 1.0)
    monkeypatch.setattr(pictures, "_GROUND", 1.0)
    ball = looks((0, 0, 1), colour=1.0, metal=1.0).sphere(64)
    np.testing.assert_allclose(ball[24:40, 24:40], 1, atol=1e-5)


def test_rough_metal_is_duller_than_smooth():
    smooth, rough = (looks((0, 0, 1), metal=1.0, roughness=r).sphere(96).max() for r in (0.2, 0.9))
    assert smooth > 2 * rough


# --- kept ---


def test_a_second_run_makes_only_what_has_changed(photos, tmp_path, here, monkeypatch):
    library = tmp_path / "library"
    brought_in(photos, library, recipe())
    tally, said = brought_in(photos, library, recipe())
    assert (tally.made, tally.unchanged, said) == (0, 2, [])
    save(drawn.pebbles(24, 24, 9), photos / "gravel.png")
    tally, said = brought_in(photos, library, recipe())
    assert (tally.made, tally.unchanged) == (1, 1) and said[0].startswith("gravel: ok")
    with Catalogue(library) as catalogue:
        assert len(orphans(catalogue)) == 1
    lines = []
    work = making.work
    monkeypatch.setattr(making, "work", lambda job: (lines.append(job), work(job))[1])
    tally, _ = brought_in(photos, library, recipe(LINE + "[judge]\nlimits = ['normal_length>0.5']\n"))
    assert (tally.made, lines) == (2, [])  # judged anew, by the same pixels
    with Catalogue(library) as catalogue:
        assert list(check(catalogue)) == []
    assert run(["gc", str(library)]) == 0
    with Catalogue(library) as catalogue:
        assert (orphans(catalogue), list(check(catalogue))) == ([], [])
    assert len(list(library.glob("assets/*/*"))) == 2


def test_an_asset_whose_folder_has_gone_is_made_again(photos, tmp_path, here):
    library = tmp_path / "library"
    brought_in(photos, library, recipe())
    (folder,) = library.glob("assets/gravel/*")
    shutil.rmtree(folder)
    tally, _ = brought_in(photos, library, recipe())
    assert (tally.made, tally.unchanged) == (1, 1) and folder.is_dir()
    with Catalogue(library) as catalogue:
        assert list(check(catalogue)) == []


def test_nothing_is_exported_into_the_library(photos, tmp_path, here):
    library = tmp_path / "library"
    brought_in(photos, library, recipe())
    for target in (library, library / "assets", tmp_path / "photos/../library/new"):
        with pytest.raises(errors.Error, match="lies in the library: export to a folder outside of it"):
            run(["export", str(library), str(target)])
    with Catalogue(library) as catalogue:
        assert list(check(catalogue)) == [] and orphans(catalogue) == []


def test_an_export_replaces_assets_alone(photos, tmp_path, here):
    library, target = tmp_path / "library", tmp_path / "target"
    brought_in(photos, library, recipe())
    (target / "wall").mkdir(parents=True)
    (target / "wall/mine.txt").write_text("mine")
    for sidecar in (None, "[]", '{"schema": "mine/1"}'):
        if sidecar:
            (target / "wall/asset.json").write_text(sidecar)
        with pytest.raises(errors.Error, match="is no asset, and would be replaced by one: remove it"):
            run(["export", str(library), str(target)])
    assert (target / "wall/mine.txt").read_text() == "mine" and not (target / "gravel").exists()
    (target / "wall/asset.json").write_text('{"schema": "oiiotex.asset/0"}')
    run(["export", str(library), str(target)])
    assert (target / "wall/wall.mtlx").is_file() and not (target / "wall/mine.txt").exists()


def test_a_broken_catalogue_is_written_anew_from_the_folders(photos, tmp_path, here, monkeypatch):
    library = tmp_path / "library"
    brought_in(photos, library, recipe())
    (library / catalogues.FILE).write_bytes(b"no database" * 1000)
    with pytest.raises(
        errors.Error, match=r"library.sqlite: file is not a database: remove .*library.sqlite[*] and ingest"
    ):
        run(["list", str(library)])
    (library / catalogues.FILE).unlink()
    monkeypatch.setattr(ingest, "_in_processes", lambda jobs, workers: [pytest.fail(f"{job}") for job in jobs])
    brought_in(photos, library, recipe())
    with Catalogue(library) as catalogue:
        assert list(catalogue.assets()) == ["gravel", "wall"] and list(check(catalogue)) == []


def test_what_is_beyond_a_limit_waits_for_review(photos, tmp_path, here):
    save(drawn.noise(24, 24, 3)[..., None], photos / "scans" / "wall_disp_1k.png")
    told = recipe(LINE + "[judge]\nlimits = ['height_steps>0.1']\n")
    tally, said = brought_in(photos, tmp_path / "library", told)
    assert (tally.status, tally.counts) == (3, {"ok": 1, "review": 1})
    (folder,) = (tmp_path / "library").glob("review/wall/*")
    assert (folder / "reason.txt").read_text().startswith("height_steps>0.1: 0.")
    assert (folder / "card.jpg").is_file()


def test_a_photo_that_is_not_there_fails_alone(photos, tmp_path, here, monkeypatch):
    (photos / "linked_diff.png").symlink_to("nowhere.png")
    (photos / "gone_diff.png").touch()
    digest = ingest.digest_of
    monkeypatch.setattr(ingest, "digest_of", lambda p: (p.name == "gone_diff.png" and p.unlink(), digest(p))[1])
    tally, said = brought_in(photos, tmp_path / "library", recipe())
    assert (tally.status, tally.counts) == (1, {"failed": 2, "ok": 2})
    for name in ("gone", "linked"):
        assert f"{name}: failed: {name}_diff.png: cannot be read: No such file or directory" in said
    with Catalogue(tmp_path / "library") as catalogue:
        assert catalogue.assets()["linked"].status == "failed" and list(check(catalogue)) == []


def test_a_photo_whose_name_is_no_text_fails_alone(photos, tmp_path, here, capsys):
    try:
        (photos / os.fsdecode(b"caf\xe9_diff.png")).touch()
        (photos / os.fsdecode(b"caf\xe9_x_col.png")).touch()
        (photos / os.fsdecode(b"caf\xe9_x_col.jpg")).touch()
    except OSError:
        pytest.skip("NOT RUN: file names are text here")
    library = tmp_path / "library"
    tally, said = brought_in(photos, library, recipe())
    assert (tally.status, tally.counts) == (1, {"failed": 1, "asked": 1, "ok": 2})
    assert r"caf: failed: caf\udce9_diff.png: its name is not UTF-8: rename it" in said
    with Catalogue(library) as catalogue:
        write_report(catalogue, "library")
    assert run(["list", str(library), "--status", "asked"]) == 0 and r"caf\udce9_x_col" in capsys.readouterr().out


def test_a_broken_material_fails_alone(photos, tmp_path, here):
    (photos / "broken_diff.png").write_bytes(b"no picture")
    library = tmp_path / "library"
    tally, said = brought_in(photos, library, recipe())
    assert (tally.status, tally.counts) == (1, {"failed": 1, "ok": 2})
    assert any(line.startswith("broken: failed: product tile: ") for line in said)
    save(drawn.pebbles(24, 24, 3), photos / "broken_diff.png")
    tally, _ = brought_in(photos, library, recipe())
    assert (tally.made, tally.unchanged, tally.status) == (1, 2, 0)
    (photos / "gravel.png").write_bytes(b"no picture")
    brought_in(photos, library, recipe())
    run(["gc", str(library)])
    assert list(library.glob("assets/gravel/*/asset.json"))  # what was good is not lost with what failed


def test_a_material_of_one_name_in_two_folders_is_asked_for(photos, tmp_path, here):
    library = tmp_path / "library"
    brought_in(photos, library, recipe())
    other = tmp_path / "other"
    other.mkdir()
    save(drawn.pebbles(24, 24, 7), other / "gravel.png")
    tally, said = brought_in(other, library, recipe())
    assert tally.status == 3 and "has a material of that name, too" in said[0]
    shutil.move(photos, tmp_path / "moved")
    tally, _ = brought_in(tmp_path / "moved", library, recipe())
    assert (tally.made, tally.status) == (0, 0)


def test_photos_and_library_are_two_folders(photos):
    with pytest.raises(errors.Error, match="photos and library are one folder"):
        brought_in(photos, photos, recipe())


def test_a_folder_that_is_there_is_taken_if_it_is_whole(photos, tmp_path, here):
    library = tmp_path / "library"
    brought_in(photos, library, recipe())
    for suffix in ("", "-wal", "-shm"):
        (library / f"library.sqlite{suffix}").unlink(missing_ok=True)
    (spoiled,) = library.glob("assets/wall/*/tile/normal.exr")
    whole = next(library.glob("assets/gravel/*/asset.json"))
    before = whole.stat().st_mtime_ns
    spoiled.write_bytes(spoiled.read_bytes()[:-5])
    tally, _ = brought_in(photos, library, recipe())
    assert tally.counts == {"ok": 2} and whole.stat().st_mtime_ns == before
    with Catalogue(library) as catalogue:
        assert list(check(catalogue)) == []


def test_check_finds_every_kind_of_damage(photos, tmp_path, here, capsys):
    library = tmp_path / "library"
    brought_in(photos, library, recipe())
    (folder,) = library.glob("assets/wall/*")
    spoiled = folder / "tx/color.tx"
    data = bytearray(spoiled.read_bytes())
    data[100] ^= 1
    spoiled.write_bytes(data)
    (folder / "tile/roughness.exr").unlink()
    assert run(["check", str(library)]) == 1
    text = capsys.readouterr().out
    assert "color.tx: is not what was written" in text and "roughness.exr: is not there" in text
    assert "wall.mtlx" in text and text.splitlines()[-1].startswith("2 assets, 3 faults")


def test_search_show_and_export(photos, tmp_path, here, capsys):
    library = tmp_path / "library"
    told = recipe('[assets.wall]\ntags = ["brick"]\nlicence = "CC0-1.0"\n' + LINE)
    brought_in(photos, library, told)
    with Catalogue(library) as catalogue:
        lab = catalogue.assets()["wall"].lab

        def names(**terms: object) -> list[str]:
            return [asset.name for asset, _ in Search(**terms).assets(catalogue)]

        assert names() == ["gravel", "wall"]
        assert names(tag="brick") == names(name="w*") == names(measures=("normal_length<0.5",)) == ["wall"]
        assert names(measures=("normal_length>0.5",)) == names(status="review") == names(size=">25x24") == []
        assert names(size="24x24") == names(size="<24x24") == ["gravel", "wall"]
        code = load(library / catalogue.assets()["wall"].folder / "thumbnail.jpg").mean((0, 1)).round().astype(int)
        near = names(color="#" + "".join(f"{v:02x}" for v in code), distance=200.0)
        assert near == ["wall", "gravel"] and 0 < lab[0] < 100
        with pytest.raises(errors.Error, match="--color red"):
            names(color="red")
    assert run(["show", str(library), "wall"]) == 0
    assert json.loads(capsys.readouterr().out)["licence"] == "CC0-1.0"
    out = tmp_path / "out"
    assert run(["export", str(library), str(out), "--tag", "brick"]) == 0
    assert sorted(p.name for p in out.iterdir()) == ["blender_assets.cats.txt", "index.json", "wall"]
    assert "Materials/brick" in (out / "blender_assets.cats.txt").read_text()
    assert run(["export", str(library), str(out), "--tag", "brick"]) == 0
    assert "0 copied, 1 as they were" in capsys.readouterr().out
    assert run(["list", str(library), "--tag", "brick"]) == 0
    assert capsys.readouterr().out.startswith("wall ok 24x24")


def test_the_report_is_one_page_that_asks_for_nothing(photos, tmp_path, here):
    library = tmp_path / "library"
    (photos / "a<b_diff.png").write_bytes(b"")
    brought_in(photos, library, recipe(LINE + "[judge]\nlimits = ['normal_length<1']\n"))
    with Catalogue(library) as catalogue:
        page = write_report(catalogue, "t & co").read_text()
    assert "t &amp; co" in page and "a_b" in page and page.count("<tr><td") == 3
    assert not re.search(r'(src|href)="(?!data:|review/|assets/)', page) and "http" not in page
    assert page.index(">failed<") < page.index(">review<") < page.index(">ok<")


@pytest.mark.slow
def test_the_reports_columns_sort_in_a_browser(tmp_path):
    browser = shutil.which("chromium") or pytest.skip("NOT RUN: no chromium")
    with Catalogue(tmp_path, create=True) as catalogue:
        for name, seam in (("a", 1.2), ("b", None), ("c", 0.9), ("d", 10.5)):
            measures = {} if seam is None else {"seam": seam}
            catalogue.put(catalogues.Asset(name, "k", "ok"), (), measures)
        page = write_report(catalogue, "sorted").read_text()
    for clicks, order in ((1, "cadb"), (2, "dacb")):
        click = "<script>" + "heads.find(h=>h.textContent==='seam').click();" * clicks + "</script>"
        (tmp_path / "clicked.html").write_text(page.replace("</html>", f"{click}</html>"))
        flags = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking"]
        command = [browser, *flags, f"--user-data-dir={tmp_path}/profile", "--dump-dom"]
        done = subprocess.run(
            [*command, (tmp_path / "clicked.html").as_uri()], capture_output=True, text=True, timeout=100
        )
        assert "".join(re.findall(r'<tr><td data-v="(\w)"', done.stdout)) == order


# --- spread ---


def test_shares_are_made_apart_and_recorded_by_the_run_that_joins(photos, tmp_path, here, monkeypatch):
    library = tmp_path / "library"
    for share in ((1, 2), (2, 2)):
        tally, _ = brought_in(photos, library, recipe(), share=share)
        assert tally.made == 1
    assert not (library / catalogues.FILE).exists()
    monkeypatch.setattr(making, "make", None)  # nothing is made any more
    tally, _ = brought_in(photos, library, recipe())
    assert tally.counts == {"ok": 2}
    with Catalogue(library) as catalogue:
        assert list(check(catalogue)) == []


def test_a_job_template_has_shares_and_a_join(photos, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("r.toml").write_text("schema = 1\n" + LINE)
    assert run(["ingest", "photos", "lib", "--recipe", "r.toml", "--farm", "openjd=job.json,3"]) == 0
    template = json.loads(Path("job.json").read_text())
    words = template["steps"][0]["script"]["actions"]["onRun"]["args"]
    assert " ".join(words[4:]) == "ingest photos lib --recipe r.toml --share {{Task.Param.Share}}/3 --openjd"
    assert template["parameterDefinitions"][1]["default"] == "oiiotex-library"


def test_claims_of_a_dead_run_are_free_and_those_of_a_live_one_are_not(tmp_path):
    with Catalogue(tmp_path, create=True) as one, Catalogue(tmp_path) as two:
        with one.run() as run_one, two.run() as run_two:
            assert one.claim("moss", run_one) and not two.claim("moss", run_two)
            two.sweep()
            assert not two.claim("moss", run_two)
            one.release("moss", run_one)
            assert two.claim("moss", run_two)
        with one.run() as run_one:
            assert one.claim("moss", run_one)
        dead = tmp_path / catalogues.WORK / "run-0123456789abcdef"
        dead.mkdir()
        (dead / "half").touch()
        one.put(catalogues.Asset("moss", "k", "ok"))
        with one._transaction():
            one._data.execute("INSERT INTO claims VALUES ('moss', ?)", (dead.name,))
        with two.run() as run_two:
            assert two.claim("moss", run_two) and not dead.exists()


def dies_or_makes(job: making.Job) -> making.Outcome:
    """What a worker does whose material kills it."""
    if job.material.name.startswith("deadly"):
        os.kill(os.getpid(), 9)
    return making.Outcome(job.material.name, None, "made")


def test_a_material_that_kills_its_process_takes_no_other_with_it(tmp_path, monkeypatch):
    monkeypatch.setattr(ingest, "make", dies_or_makes)
    for name in ("a", "b", "deadly", "z"):
        save(drawn.noise(8, 8, 1)[..., None], touched(tmp_path, "p/x") and tmp_path / "p" / f"{name}.png")
    (tmp_path / "p/x").unlink()
    tally, said = brought_in(tmp_path / "p", tmp_path / "library", recipe(), workers=2)
    assert tally.counts == {"failed": 4}
    assert sorted(said) == [
        "a: failed: made", "b: failed: made",
        "deadly: failed: its process has ended of itself: killed, or out of memory?", "z: failed: made",
    ]  # fmt: skip


def test_what_is_short_of_memory_is_tried_alone_with_all_of_it(photos, tmp_path, monkeypatch):
    seen = []

    def outcomes(jobs, workers):
        for job in jobs:
            seen.append((workers, job.budget))
            text = "needs 9 MB of memory; the budget is 1 MB" if job.budget < 1 << 30 else "x"
            yield making.Outcome(job.material.name, None, text), job

    monkeypatch.setattr(ingest, "_in_processes", outcomes)
    _, said = brought_in(photos, tmp_path / "library", recipe(), workers=2, budget=1 << 30)
    assert seen == [(2, 1 << 29)] * 2 + [(1, 1 << 30)] * 2
    assert said == ["gravel: failed: x", "wall: failed: x"]
