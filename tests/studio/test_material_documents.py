# SPDX-License-Identifier: Apache-2.0
"""A material as pictures and as documents for other programs."""

from __future__ import annotations

import re

import numpy as np
import pytest
from oiiotex_studio.materials import blender_catalogs, documents, shaded, wang_documents
from oiiotex_studio.materials import preview as pictures
from oiiotex_studio.materials.hexagons import gaussianized

from oiiotex.engine import errors
from oiiotex.surfaces.charts import lighting
from tests import pictures as drawn


def test_materialx_and_usd_are_what_their_libraries_take(tmp_path):
    mx = pytest.importorskip("MaterialX", reason="NOT RUN: no MaterialX")
    roles = ("color", "gloss", "height", "metal", "ao", "opacity", "emission", "normal")
    maps = {role: f"tile/{role}.exr" for role in roles}
    (tmp_path / "tile").mkdir()
    for file in maps.values():
        (tmp_path / file).touch()
    plain = gaussianized(drawn.moss(16, 16, 1))
    hexes = {role: (file, plain) for role, file in maps.items() if role != "normal"}
    described = documents.Described("a b", maps, "lin_rec709_scene", "directx", hexes=hexes)
    documents.write_materialx(described, tmp_path)
    for name, category in (("a b", "open_pbr_surface"), ("a b_standard", "standard_surface")):
        assert documents.materialx_faults(tmp_path / f"{name}.mtlx") == []
        document = mx.createDocument()
        mx.readFromXmlFile(document, str(tmp_path / f"{name}.mtlx"))
        assert [m.getName() for m in document.getMaterialNodes()] == ["a_b", "a_b_hextiled"]
        for surface in document.getNodes(category):  # all roles but ao and height, which a surface has no inputs for
            assert len([one for one in surface.getInputs() if one.getOutputString()]) == len(roles) - 2
    (tmp_path / "tile/ao.exr").unlink()
    assert "ao.exr is missing" in documents.materialx_faults(tmp_path / "a b.mtlx")[0]
    text = (tmp_path / "a b.mtlx").read_bytes()
    (tmp_path / "bytes.mtlx").write_bytes(text.replace(b"ao.exr", b"\xb1o.exr"))
    assert "can't decode byte 0xb1" in documents.materialx_faults(tmp_path / "bytes.mtlx")[0]
    (tmp_path / "long.mtlx").write_bytes(text.replace(b"ao.exr", b"a" * 5000))
    assert "is missing" in documents.materialx_faults(tmp_path / "long.mtlx")[0]
    documents.write_materialx(documents.Described("brick", maps, "ACEScg", "opengl"), tmp_path)
    assert "hextiled" not in (tmp_path / "brick.mtlx").read_text()
    pxr = pytest.importorskip("pxr.UsdShade", reason="NOT RUN: no usd-core")
    from pxr import Usd

    (tmp_path / "tile/ao.exr").touch()
    documents.write_usd(described, tmp_path)
    stage = Usd.Stage.Open(str(tmp_path / "a b.usda"))
    material = pxr.Material(stage.GetDefaultPrim())
    surface = material.ComputeSurfaceSource()[0]
    assert surface.GetIdAttr().Get() == "UsdPreviewSurface"
    normal = surface.GetInput("normal").GetConnectedSources()[0][0].source.GetPrim()
    assert pxr.Shader(normal).GetInput("scale").Get() == (2, -2, 2, 1)
    variants = stage.GetDefaultPrim().GetVariantSets().GetVariantSet("shading")
    assert variants.GetVariantNames() == ["materialx", "preview"]
    written = (tmp_path / "a b.usda").read_text()
    assert "prepend references = @./a b.mtlx@</MaterialX/Materials/a_b>" in written
    pytest.importorskip("pxr.UsdValidation", reason="NOT RUN: usd-core without validators")
    assert documents.usd_faults(tmp_path / "a b.usda") == [] and (tmp_path / "a b.usda").read_text() == written
    for name, old, new, says in (
        ("no axis", 'upAxis = "Y"', "", "does not specify an upAxis"),
        ("lost", "./tile/metal.exr", "./tile/lost.exr", "lost.exr"),
        ("kind", 'info:id = "UsdPreviewSurface"', 'info:id = "UsdNothing"', "UsdNothing"),
    ):
        assert old in written
        (tmp_path / f"{name}.usda").write_text(written.replace(old, new))
        assert any(says in fault for fault in documents.usd_faults(tmp_path / f"{name}.usda")), name
    (tmp_path / "none.usda").write_text("nothing")
    assert "none.usda" in documents.usd_faults(tmp_path / "none.usda")[0]


def test_blenders_catalogs_have_ids_that_stay():
    text = blender_catalogs.blender_catalog(["Materials/ground", "Materials"])
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    assert lines[0] == "VERSION 1"
    shape = re.compile(r"[0-9a-f-]{36}:Materials(/ground:Materials-ground|:Materials)")
    assert len(lines) == 3 and all(map(shape.fullmatch, lines[1:]))
    assert text == blender_catalogs.blender_catalog(["Materials", "Materials/ground"])
    renamed = lines[1].replace("Materials:Materials", "Stuff:Stuff")
    there = f"# mine\nVERSION 1\n{renamed}\n{lines[2]}\n{'0' * 36}:Own:Own\n"
    kept = blender_catalogs.blender_catalog(["Materials", "Materials/wood"], there)
    assert [line.split(":")[1] for line in kept.splitlines()[3:]] == ["Stuff", "Materials/wood", "Own"]


def test_hex_tiling_keeps_colors_and_breaks_repetition():
    assert np.allclose(pictures.hex_tiled(np.full((32, 32, 3), 0.3), 3, 64), 0.3, atol=1e-6)
    tile = drawn.pebbles(64, 64, 1)
    shown = pictures.hex_tiled(tile, 4, 256)
    assert np.allclose(shown.mean((0, 1)), tile.mean((0, 1)), atol=0.03)
    plain = np.tile(tile, (4, 4, 1))
    assert np.abs(plain - np.roll(plain, 64, 1)).max() == 0
    assert np.abs(shown - np.roll(shown, 64, 1)).mean() > 0.02
    waves = 0.5 + 0.4 * np.cos(2 * np.pi * np.arange(256) / 256)
    smooth = np.broadcast_to(waves[:, None, None] * waves[None, :, None], (256, 256, 3))
    coarse, fine = (np.abs(np.diff(pictures.hex_tiled(smooth, 2, side), axis=1)).max() for side in (256, 1024))
    assert fine < 0.4 * coarse  # nothing jumps where hexagons meet


def looks(normal: tuple[float, float, float], color: float = 0.4, **maps: float) -> pictures.Looks:
    plain = {"roughness": 0.8, "metal": 0.0, "ao": 1.0} | maps
    made = {name: np.full((16, 16, 1), value, np.float32) for name, value in plain.items()}
    direction = np.float32(normal) / np.linalg.norm(normal)
    return pictures.Looks(
        np.full((16, 16, 3), color, np.float32), np.broadcast_to(direction, (16, 16, 3)).astype(np.float32), **made
    )


def test_light_comes_from_the_upper_left():
    ball = looks((0, 0, 1)).sphere(64, 0, 64)[..., :3]
    assert ball[16, 16].mean() > 2 * ball[48, 48].mean()
    leaning = {side: looks((dx, dy, 1)).plane(64)[48].mean() for side, dx, dy in
               (("left", -0.4, 0), ("right", 0.4, 0), ("up", 0, 0.4), ("down", 0, -0.4))}  # fmt: skip
    assert leaning["left"] > leaning["right"] and leaning["up"] > leaning["down"]


def test_a_white_furnace_gives_no_more_than_it_gets(monkeypatch):
    """Diffuse light alone, from all around, on white: what comes back is what there is."""
    monkeypatch.setattr(lighting, "LIGHTS", ())
    monkeypatch.setattr(lighting, "SKY", 1.0)
    monkeypatch.setattr(lighting, "GROUND", 1.0)
    ball = looks((0, 0, 1), color=1.0, metal=1.0).sphere(64, 0, 64)
    np.testing.assert_allclose(ball[24:40, 24:40], 1, atol=1e-5)


def test_rough_metal_is_duller_than_smooth():
    smooth, rough = (looks((0, 0, 1), metal=1.0, roughness=r).sphere(96, 0, 96).max() for r in (0.2, 0.9))
    assert smooth > 2 * rough


def test_a_photo_alone_is_as_rough_in_documents_as_in_previews(tmp_path):
    pytest.importorskip("MaterialX", reason="NOT RUN: no MaterialX")
    pytest.importorskip("pxr.UsdShade", reason="NOT RUN: no usd-core")
    described = documents.Described("moss", {"color": "moss.exr"}, "lin_rec709_scene", "")
    documents.write_materialx(described, tmp_path)
    documents.write_usd(described, tmp_path)
    wang = wang_documents.WangMaterial("moss", described.maps, "index.png", 4, "lin_rec709_scene", "", (1, 1), 0)
    plain = [tmp_path / "moss.mtlx", tmp_path / "moss_standard.mtlx"]
    for path in (*plain, *wang_documents.write_wang_materialx(wang, tmp_path / "wang.mtlx")):
        if path.suffix == ".mtlx":
            assert re.search(r'name="(specular_roughness|bg)" type="float" value="0\.7"', path.read_text()), path.name
    assert "float inputs:roughness = 0.7" in (tmp_path / "moss.usda").read_text()


def test_a_shader_without_a_display_says_what_is_missing(tmp_path, monkeypatch):
    pytest.importorskip("MaterialX", reason="NOT RUN: no MaterialX")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setattr(shaded.sys, "platform", "linux")
    monkeypatch.setattr(shaded, "program", lambda name: None)
    with pytest.raises(errors.Error, match=r"requires a display, or Xvfb \(apt install xvfb\)"):
        shaded.shaded_sphere(tmp_path / "none.mtlx", {}, None, 64)
