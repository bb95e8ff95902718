# SPDX-License-Identifier: Apache-2.0
"""Cryptomatte as renderers write it: ids stay as they are, and mattes unfold by name.

The files are written with OpenImageIO by the specification, with hashes of another implementation than ours.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from oiiotex.engine.errors import Error
from oiiotex.oiiotool.cli.running.line_run import run
from tests.any_filter import apply, buffer, of

NAMES = ("chair", "table", "lamp.001")
BITS = (0x6A3C2B11, 0x41D5E0F7, 0x3EEE1234)  # any normal floats: manifests say which name has which
WIDTH, HEIGHT = 24, 16
RANKS = [f"crypto_object{n:02}.{c}" for n in range(2) for c in "RGBA"]


def rendered(folder: Path, name: str = "crypto.exr", kind: str = "float", manifest: str = "header") -> Path:
    """Beauty and four ranks; the objects cover 1, or 0.5 + 0.25 + 0.25 in a band."""
    codes = np.array(BITS, np.uint32).view(np.float32)
    pixels = np.zeros((HEIGHT, WIDTH, 12), np.float32)
    pixels[..., :3], pixels[..., 3] = np.linspace(0, 1, WIDTH)[None, :, None], 1
    pixels[..., 4], pixels[..., 5] = codes[0], 1
    pixels[4:9, :, 4:10] = codes[1], 0.5, codes[0], 0.25, codes[2], 0.25
    spec = oiio.ImageSpec(WIDTH, HEIGHT, 12, oiio.FLOAT)
    spec.channelnames = ("R", "G", "B", "A", *RANKS)
    table = json.dumps({one: f"{bits:08x}" for one, bits in zip(NAMES, BITS, strict=True)})
    facts = {"name": "crypto_object", "hash": "MurmurHash3_32", "conversion": "uint32_to_float32"}
    if manifest == "header":
        facts["manifest"] = table
    else:
        facts["manif_file"] = manifest
        if "/" not in manifest:
            (folder / manifest).write_text(table)
    for key, value in facts.items():
        spec.attribute(f"cryptomatte/7d3a21f/{key}", value)
    buffer = oiio.ImageBuf(spec)
    buffer.set_pixels(buffer.roi, pixels)
    buffer.set_write_format(kind)
    assert buffer.write(str(folder / name))
    return folder / name


def ids_of(path: Path) -> set[int]:
    """All ids in the ranks of a file."""
    buffer = oiio.ImageBuf(str(path))
    places = [n for n, one in enumerate(buffer.spec().channelnames) if one in RANKS and one[-1] in "RB"]
    assert len(places) == 4 and all(buffer.nativespec().channelformat(n) == oiio.FLOAT for n in places)
    return set(np.unique(buffer.get_pixels(oiio.FLOAT)[..., places].view(np.uint32))) - {0}


KEEPING = """--flip|--resample:interp=0 7x9|--rotate90|--cut 12x8+3+2|--cshift +5+3|-d half|--flip -d half|--iscolorspace lin_ap1_scene --tocolorspace lin_ap0_scene
--dup --mosaic 2x1 --chnames R,G,B,A,{names}|--ch R,G,B,A,{names}|--ccmatrix 2,0,0,0,2,0,0,0,2""".replace("\n", "|")  # noqa: E501


@pytest.mark.parametrize("steps", KEEPING.split("|"))
def test_ids_stay(tmp_path, steps):
    source = rendered(tmp_path)
    run(["crypto.exr", *steps.format(names=",".join(RANKS)).split(), "-o", "out.exr"], tmp_path)
    assert ids_of(tmp_path / "out.exr") == ids_of(source) == set(BITS)


MIXING = """--resize 50%|--resample 50%|--fit 10x10|--rotate 30|--warp 0.5,0,0,0,0.5,0,0,0,1|--blur 3x3|--median 3x3
--mulc 0.5|--erode 3x3|--fillholes|--dup --add|--pixelaspect 2|--mosaic:fit=8x8 1x1
--unsharp|--laplacian""".replace("\n", "|")


@pytest.mark.parametrize("steps", MIXING.split("|"))
def test_ops_that_would_change_ids_say_what_to_do(tmp_path, steps):
    rendered(tmp_path)
    with pytest.raises(
        Error, match=r"crypto_object00\.R and others are Cryptomatte.*--cryptomatte-unfold.*--ch R,G,B,A$"
    ):
        run(["crypto.exr", *steps.split(), "-o", "no.exr"], tmp_path)
    run(["crypto.exr", "--ch", "R,G,B,A", *steps.split(), "-o", "yes.exr"], tmp_path)


@of(list(filters.FILTERS))
def test_no_filter_makes_an_id(op):
    """Each keeps the ids of the mattes, has no mattes in its result, or says what to do."""
    y, x = np.indices((64, 72))
    codes = np.array(BITS, np.uint32).view(np.float32)
    label = (x // 19 + y // 23) % 3
    pixels = np.random.default_rng(0).random((64, 72, 12), np.float32)
    pixels[..., 3] = 1
    pixels[..., 4::2] = codes[np.stack([label, (label + 1) % 3, label, (label + 2) % 3], -1)]
    try:
        made = apply(op, buffer(pixels, space="lin_rec709_scene", names=("R", "G", "B", "A", *RANKS)))
    except Error as error:
        assert "are Cryptomatte" in str(error) or op.name == "estimateheight"  # it refuses colors of several materials
        return
    for result in made if isinstance(made, list) else [made]:
        places = [n for n, name in enumerate(result.spec().channelnames) if name in RANKS and name[-1] in "RB"]
        ids = np.ascontiguousarray(result.get_pixels(oiio.FLOAT)[..., places]).view(np.uint32)
        assert set(np.unique(ids)) <= {0, *BITS}


def test_half_leaves_mattes_float_and_says_so(tmp_path, caplog):
    rendered(tmp_path)
    run(["crypto.exr", "-d", "half", "-o", "out.exr"], tmp_path)
    assert "crypto_object00.R to crypto_object01.A stay float" in caplog.text
    assert oiio.ImageInput.open(str(tmp_path / "out.exr")).spec().channelformat(0) == oiio.HALF


@pytest.mark.parametrize("words", ["-d uint8 -o no.tif", "-d half -o no.tif", "--nchannels 6 -d uint16 -o no.tif"])
def test_formats_that_cannot_hold_mattes_are_named(tmp_path, words):
    rendered(tmp_path)
    with pytest.raises(Error, match=r"no\.tif.*Cryptomatte.*use EXR"):
        run(["crypto.exr", *words.split()], tmp_path)


@pytest.mark.parametrize(
    "words", ["--cryptomatte-colors crypto_object", "--cryptomatte-unfold chair", "--texfill:data=1:matte=chair"]
)
def test_half_ids_are_called_so(tmp_path, words):
    rendered(tmp_path, kind="half")
    with pytest.raises(Error, match="ids are half; Cryptomatte needs float"):
        run(["crypto.exr", *words.split(), "-o", "no.exr"], tmp_path)


@pytest.mark.parametrize("manifest", ["header", "names.json"])
def test_mattes_unfold_to_channels(tmp_path, manifest):
    rendered(tmp_path, manifest=manifest)
    run(["crypto.exr", "--cryptomatte-unfold", "t*,chair,3eee1234", "-o", "mattes.exr"], tmp_path)
    buffer = oiio.ImageBuf(str(tmp_path / "mattes.exr"))
    mattes = dict(zip(buffer.spec().channelnames, np.moveaxis(buffer.get_pixels(oiio.FLOAT), -1, 0), strict=True))
    expected = {"chair": (1, 0.25), "table": (0, 0.5), "3eee1234": (0, 0.25)}
    assert set(mattes) == set(expected)
    for name, (outside, inside) in expected.items():
        band = np.full((HEIGHT, WIDTH), outside, np.float32)
        band[4:9] = inside
        np.testing.assert_array_equal(mattes[name], band)


def test_mattes_unfold_to_files(tmp_path):
    rendered(tmp_path)
    (tmp_path / "out").mkdir()
    run(["crypto.exr", "--cryptomatte-unfold:folder=out", "*", "-o", "all.exr"], tmp_path)
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == sorted(f"{name}.exr" for name in NAMES)
    table = oiio.ImageBuf(str(tmp_path / "out" / "table.exr"))
    assert table.spec().nchannels == 1 and table.getpixel(0, 5)[0] == 0.5 and table.getpixel(0, 0)[0] == 0


def renamed(folder: Path, *names: str) -> None:
    """The Cryptomatte with other names in its manifest."""
    buffer = oiio.ImageBuf(str(rendered(folder)))
    table = {name: f"{bits:08x}" for name, bits in zip(names, BITS, strict=False)}
    buffer.specmod().attribute("cryptomatte/7d3a21f/manifest", json.dumps(table))
    buffer.write(str(folder / "renamed.exr"))


def test_names_of_a_hierarchy_are_joined_in_files(tmp_path):
    (tmp_path / "out").mkdir()
    renamed(tmp_path, "/obj/chair", "label.1/1")
    line = ["renamed.exr", "--cryptomatte-unfold:folder=out", "/obj/*,label*", "-o", "all.exr"]
    run(line, tmp_path)
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["label.1_1.exr", "obj_chair.exr"]
    renamed(tmp_path, "obj/chair", "obj_chair")
    with pytest.raises(Error, match="obj/chair and obj_chair would be the same file"):
        run(["renamed.exr", "--cryptomatte-unfold:folder=out", "obj*", "-o", "all.exr"], tmp_path)


def test_a_name_or_a_manifest_that_is_a_path_is_refused(tmp_path):
    (tmp_path / "out").mkdir()
    path = rendered(tmp_path)
    buffer = oiio.ImageBuf(str(path))
    buffer.specmod().attribute("cryptomatte/7d3a21f/manifest", json.dumps({"../evil": f"{BITS[0]:08x}"}))
    buffer.write(str(tmp_path / "evil.exr"))
    with pytest.raises(Error, match=r"matte '\.\.': expected a printable name"):
        run(["evil.exr", "--cryptomatte-unfold:folder=out", "*", "-o", "no.exr"], tmp_path)
    rendered(tmp_path, "side.exr", manifest="../names.json")
    with pytest.raises(Error, match=r"manifest file '\.\./names\.json'"):
        run(["side.exr", "--cryptomatte-unfold", "*", "-o", "no.exr"], tmp_path)
    assert not list((tmp_path / "out").iterdir())


def test_an_unknown_name_lists_others(tmp_path):
    rendered(tmp_path)
    with pytest.raises(Error, match="no matte 'tabel': expected a name such as table"):
        run(["crypto.exr", "--cryptomatte-unfold", "tabel", "-o", "no.exr"], tmp_path)
