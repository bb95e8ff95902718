# SPDX-License-Identifier: Apache-2.0
"""What images say of themselves, through formats that would drop it; data are tagged as data."""

from __future__ import annotations

import logging

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from oiiotex.engine.core.attributes import OURS, SOURCE, TAG
from oiiotex.engine.core.image import from_buffer
from oiiotex.engine.io.description import describe, restore
from oiiotex.engine.io.reading import read
from oiiotex.engine.io.writing import write
from oiiotex.oiiotool.cli.running.line_run import run
from tests import pictures
from tests.any_filter import buffer
from tests.conftest import save

pytestmark = pytest.mark.usefixtures("few_places")
ALBEDO, ROUGH = pictures.bricks(64, 80, 2), pictures.smooth_noise(64, 80, 5, 2)[..., None]
MATERIAL = "--texstationarize:kinds=color,normal,data:iterations=2:size=48x40:patch=7"


@pytest.fixture
def folder(tmp_path):
    """A photo in formats that say color spaces, and maps that are tagged as OpenImageIO's readers tag them."""
    save(ALBEDO, tmp_path / "albedo.png")
    save(ALBEDO, tmp_path / "albedo.exr", "half", "ACEScg")
    save(0.5 + 0 * ALBEDO + np.array([0, 0, 0.5]), tmp_path / "normal.png")
    save(ROUGH, tmp_path / "rough.png", "uint16")
    return tmp_path


def spec_of(path, part: int = 0) -> oiio.ImageSpec:
    return read(path).parts[part].spec


# --- data are data ---


@pytest.mark.parametrize("suffix", ["exr", "png", "tif", "jpg"])
def test_maps_that_are_no_colors_are_tagged_as_data(folder, suffix):
    assert spec_of(folder / "normal.png")[TAG] == "srgb_rec709_scene"  # as any PNG
    assert run(["albedo.png", "normal.png", "rough.png", MATERIAL, "-o:all=1", f"m%d.{suffix}"], folder) == 0
    tags = [spec_of(folder / f"m{n}.{suffix}").get_string_attribute(TAG) for n in (1, 2, 3)]
    assert tags == ["srgb_rec709_scene", "data", "data"]


def test_maps_that_are_no_colors_are_tagged_in_all_variants_and_without_kinds():
    given = [buffer(ALBEDO), buffer(ALBEDO), buffer(ROUGH)]
    quick = {"iterations": 2, "patch": 7, "size": (48, 40)}
    sets = filters.stationarize(given[0], maps=given[1:], variants=2, kinds=("color", "normal", "color"), **quick)
    assert [one.spec()[TAG] for one in sets] == ["srgb_rec709_scene", "data", "srgb_rec709_scene"] * 2
    left_out = filters.stationarize(given[0], maps=given[1:], **quick)
    assert [one.spec()[TAG] for one in left_out] == ["srgb_rec709_scene", "data", "data"]


@pytest.mark.parametrize("name", ["quilt", "flatten", "cut"])
def test_what_is_said_to_be_data_leaves_as_data(name):
    photo = buffer(ALBEDO)
    photo.specmod().attribute("Exif:ColorSpace", 1)
    made = getattr(filters, name)(photo, data=True).spec()
    assert made[TAG] == "data"
    assert made.getattribute("Exif:ColorSpace") is None


def test_a_file_tagged_as_data_is_taken_as_data(folder):
    assert run(["albedo.png", "normal.png", "rough.png", MATERIAL, "-o:all=1", "m%d.png"], folder) == 0
    assert run(["m2.png", "--texflatten", "-o", "out.exr"], folder) == 0
    assert spec_of(folder / "out.exr")[TAG] == "data"


# --- TIFF and others carry what they do not say ---


@pytest.mark.parametrize(("file", "depth"), [
    ("t.tif", "uint8"), ("t.tif", "uint16"), ("t.tif", "float"), ("t.jpg", "uint8"), ("t.png", "uint8"),
    ("t.png", "uint16"), ("t.tx", "uint16"), ("t.tx", "float"), ("t.exr", "half"),
])  # fmt: skip
def test_color_space_and_provenance_arrive(folder, caplog, file, depth):
    option = "-otex" if file == "t.tx" else "-o"
    with caplog.at_level(logging.WARNING):
        assert run(["albedo.exr", "--sattrib", "ImageDescription", "a wall\nby me", "--texquilt:seed=7:size=48x40",
                    "-d", depth, option, file], folder) == 0  # fmt: skip
    assert not caplog.messages
    spec = spec_of(folder / file)
    assert spec[TAG] in ("ACEScg", "lin_ap1_scene")
    assert (spec["oiiotex:filter"], spec.get_int_attribute("oiiotex:seed")) == ("quilt", 7)
    assert spec["ImageDescription"] == "a wall\nby me"
    assert run([file, "--texquilt:size=40x32", "-o", "again.exr"], folder) == 0  # not refused


def test_the_photo_is_named_with_the_hash_of_its_pixels(folder):
    pixels = oiio.ImageBuf(str(folder / "albedo.png"))
    said = f"albedo.png SHA-1 {oiio.ImageBufAlgo.computePixelHashSHA1(pixels)}"
    assert run(["albedo.png", "--texquilt:size=48x40", "-o", "q.tif", "--texflatten", "-o", "f.exr"], folder) == 0
    assert spec_of(folder / "q.tif")[SOURCE] == said
    assert spec_of(folder / "f.exr")[SOURCE] == said  # what a tile was made of, whatever is done to it
    assert run(["albedo.png", "normal.png", "rough.png", MATERIAL, "-o:all=1", "m%d.tif"], folder) == 0
    assert [spec_of(folder / f"m{n}.tif")[SOURCE].split()[0] for n in (1, 2, 3)] == [
        "albedo.png", "normal.png", "rough.png"]  # fmt: skip


@pytest.mark.parametrize("op", ["quilt:size=48x40", "synth:size=48x40", "flatten"])
def test_seeds_beyond_31_bits_are_noted(folder, op):
    seed = 2**32 - 1
    words = [f"--tex{op}:seed={seed}"] if op != "flatten" else [f"--texquilt:size=48x40:seed={seed}", "--texflatten"]
    for name in ("s.exr", "s.tif", "s.png"):
        assert run(["albedo.exr", *words, "-d", "uint8" if name == "s.png" else "float", "-o", name], folder) == 0
        assert spec_of(folder / name)["oiiotex:seed"] == str(seed)


def test_without_software_attributes_the_color_space_is_said_alone(folder):
    assert (
        run(["albedo.exr", "--nosoftwareattrib", "--texquilt:size=48x40", "-d", "uint16", "-o", "t.tif"], folder) == 0
    )
    spec = spec_of(folder / "t.tif")
    assert not [a.name for a in spec.extra_attribs if a.name.startswith(OURS)]


def test_tiff_holds_labels_with_their_names(folder):
    assert run(["albedo.png", "--texlabel:photo=1", "-o", "l.tif"], folder) == 0
    held = read(folder / "l.tif")
    assert [p.name for p in held.parts][1:] and all(p.name.startswith("label.") for p in held.parts[1:])
    assert held.parts[1].spec.get_int_attribute("oiiotex:labels") >= 1
    assert held.parts[1].spec.get_float_attribute("oiiotex:rho") > 0
    assert held.parts[1].spec[TAG] == "data"
    assert run(["l.tif", "--texquilt:label=1", "-o", "q.exr"], folder) == 0


@pytest.mark.parametrize(("file", "lost"), [
    ("t.hdr", "the color space ACEScg (it is read as lin_rec709_scene)"), ("t.tga", "the color space ACEScg"),
    ("t.tga", "how it was made (oiiotex:"), ("t.bmp", "the color space ACEScg (it is read as srgb_rec709_scene)"),
])  # fmt: skip
def test_what_a_format_cannot_say_is_warned_of(folder, caplog, file, lost):
    with caplog.at_level(logging.WARNING):
        assert run(["albedo.exr", "--iscolorspace", "ACEScg", "--texquilt:size=48x40", "-o", file], folder) == 0
    (line,) = caplog.messages
    assert line.startswith(f"{file}: ") and lost in line


def test_chains_without_our_filters_are_written_as_oiiotool_writes_them(folder, caplog):
    assert run(["albedo.exr", "-d", "uint16", "-o", "plain.tif"], folder) == 0
    assert spec_of(folder / "plain.tif").getattribute("ImageDescription") is None
    assert "plain.tif: tiff cannot store the color space lin_ap1_scene" in caplog.text


# --- foreign hands ---


def test_a_color_space_that_the_file_was_given_since_wins(folder):
    assert run(["albedo.exr", "--texquilt:size=48x40", "-d", "uint8", "-o:all=1", "t%d.tif"], folder) == 0
    for name in ("t1.tif", "t1.jpg", "t1.png"):
        other = oiio.ImageBuf(str(folder / "t1.tif"))  # another program: it knows nothing of ours
        other.specmod().attribute(TAG, "srgb_rec709_scene")
        other.write(str(folder / name))
        spec = spec_of(folder / name)
        assert spec[TAG] == "srgb_rec709_scene"


@pytest.mark.parametrize("text", [
    'oiiotex: {"oiiotex:seed": 1e999}', 'oiiotex: {"oiiotex:seed": 99999999999999999999}', 'oiiotex: {', "oiiotex: []",
    'oiiotex: {"oiiotex:filter": "\\ud800"}', 'oiiotex: {"oiiotex:colorspace": ["x"]}', "oiiotex: {}" + " " * 9,
    'oiiotex: {"oiiotex:colorspace": "\\udfff"}', 'oiiotex: ' + '{"a":' * 9999, 'oiiotex: {"compression": "none"}',
])  # fmt: skip
def test_what_foreign_files_say_there_is_not_trusted(text):
    spec = oiio.ImageSpec(2, 2, 3, oiio.UINT8)
    spec.attribute("ImageDescription", text)
    restore(spec, "tiff", "x.tif")
    assert {a.name for a in spec.extra_attribs} <= {"ImageDescription"}


def test_spaces_of_a_studios_own_config_arrive_in_exr_too(tmp_path):
    image = from_buffer(buffer(ALBEDO, oiio.HALF, "studio linear"))
    part = image.first.respecced(lambda spec: spec.attribute("oiiotex:filter", "x"))
    for name in ("a.exr", "a.png", "a.tif"):
        write(type(image)((part,), "x"), tmp_path / name)
        assert spec_of(tmp_path / name)[TAG] == "studio linear"
        assert spec_of(tmp_path / name).getattribute("oiiotex:colorspace") is None


def test_describing_changes_nothing_that_the_format_says_itself():
    spec = oiio.ImageSpec(2, 2, 3, oiio.UINT8)
    spec.attribute(TAG, "srgb_rec709_scene")
    for format_name in ("tiff", "png", "jpeg", "openexr", "targa"):
        described = oiio.ImageSpec(spec)
        describe(described, format_name)
        assert [(a.name, a.value) for a in described.extra_attribs] == [(TAG, "srgb_rec709_scene")]


# --- types ---


def test_copies_of_computed_images_keep_the_type_of_the_first_file(folder):
    for op in (
        "--texquilt:size=48x40",
        "--texflatten",
        "--texstationarize:size=40x40:iterations=2",
        "--texcut:size=40x40",
    ):
        assert run(["albedo.exr", "--addc", "0", op, "-o", "t.exr"], folder) == 0
        assert str(spec_of(folder / "t.exr").format) == "half", op
