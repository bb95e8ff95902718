# SPDX-License-Identifier: Apache-2.0
"""Maps of one material, made anew together."""

from __future__ import annotations

import logging

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from oiiotex.engine import errors
from tests import pictures
from tests.any_filter import buffer, pixels
from tests.conftest import load, oiiotex, save

pytestmark = pytest.mark.usefixtures("few_places")
ALBEDO = pictures.bricks(64, 80, 2)
QUICK = {"iterations": 3, "patch": 7, "size": (72, 48)}
KINDS = "color,normal,data"


def normals() -> np.ndarray:
    """Of a height field, encoded in 0 .. 1."""
    down, right = np.gradient(8 * pictures.smooth_noise(64, 80, 7, 1))
    vectors = np.stack([-right, -down, np.ones_like(down)], -1)
    return 0.5 + 0.5 * vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


NORMAL = normals()
ROUGH = pictures.smooth_noise(64, 80, 5, 2)[..., None]


def images(normal: np.ndarray = NORMAL) -> list[oiio.ImageBuf]:
    return [
        buffer(ALBEDO),
        buffer(normal, oiio.HALF, space=""),
        buffer(ROUGH, oiio.UINT16, space="", names=("Y",)),
    ]


def made(given: list[oiio.ImageBuf] | None = None, **more: object):
    first, *others = given or images()
    return filters.stationarize(first, maps=others, **{**QUICK, "kinds": KINDS.split(","), **more})


def test_all_maps_come_from_the_same_places():
    tiles = made(st=True, flattening=0)
    st = tiles[0]["st"]
    assert [t.spec().format for t in (tiles[0]["tile"], *tiles[1:])] == [oiio.FLOAT, oiio.HALF, oiio.UINT16]
    for tile, source in zip((tiles[0]["tile"], *tiles[1:]), images(), strict=True):
        np.testing.assert_array_equal(pixels(tile), pixels(filters.warp(source, st)))
    known = {v.tobytes() for v in pixels(images()[1]).reshape(-1, 3)}
    assert all(v.tobytes() in known for v in pixels(tiles[1]).reshape(-1, 3))  # no normal is averaged


def test_match_says_which_maps_patches_are_compared_by():
    alone = filters.stationarize(buffer(ALBEDO), **QUICK)
    np.testing.assert_array_equal(pixels(made(mapweights=(1, 0, 0))[0]), pixels(alone))
    assert (pixels(made()[0]) != pixels(alone)).any()
    rough = filters.stationarize(images()[2], data=True, **QUICK)
    by_rough = made(mapweights=(0, 0, 1))
    assert pixels(by_rough[2]).shape == pixels(rough).shape
    jumps = [np.abs(np.diff(pixels(m[2]).astype(float), axis=1)).mean() for m in (made(mapweights=(1, 0, 0)), by_rough)]
    assert jumps[1] < jumps[0]  # what is compared by hangs together


def test_maps_that_are_no_colors_are_never_color_managed():
    """Their tag does not matter, and they need none."""
    tagged = [buffer(ALBEDO), buffer(NORMAL, oiio.HALF, "lin_rec709_scene"), images()[2]]
    for a, b in zip(made(), made(tagged), strict=True):
        np.testing.assert_array_equal(pixels(a), pixels(b))
    as_data = filters.stationarize(images()[0], maps=images()[1:], **QUICK)  # without kinds: data
    assert len(as_data) == 3
    with pytest.raises(errors.ColorError, match="add colorspace=NAME"):
        made(kinds=["color", "color", "data"])


def test_signed_normals_are_as_good_as_encoded_ones():
    signed = [images()[0], buffer(2 * NORMAL - 1, space=""), images()[2]]
    encoded = [images()[0], buffer(NORMAL, space=""), images()[2]]
    assert (pixels(made(signed)[0]) == pixels(made(encoded)[0])).mean() > 0.98  # but for the rounding of 2 n - 1


@pytest.mark.parametrize("none", [0.5, 0.0], ids=["middle gray", "black, as around UV islands"])
def test_normals_of_length_0_are_never_a_source(caplog, none):
    broken = NORMAL.copy()
    broken[20:30, 30:50] = none
    with caplog.at_level(logging.WARNING):
        tiles = made(images(broken), st=True)
    assert "200 normals have length 0; these pixels are not used as a source" in caplog.text
    assert (np.abs(pixels(tiles[1]).astype(float) - none).max(-1) > 0.02).all()
    with pytest.raises(errors.ImageError, match="contains only normals of length 0"):
        made(images(np.full_like(NORMAL, none)))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"size": (40, 64)}, "is 80x64[+]0[+]0, .* is 40x64[+]0[+]0"),
        ({"x": 3}, "is 80x64[+]0[+]0, .* is 80x64[+]3[+]0"),
        ({"full_width": 90}, "is 80x64[+]0[+]0 in 90x64[+]0[+]0"),
    ],
)
def test_maps_of_different_sizes_or_windows_are_refused(change, said):
    width, height = change.get("size", (80, 64))
    spec = oiio.ImageSpec(width, height, 1, oiio.FLOAT)
    for name, value in change.items():
        if name != "size":
            setattr(spec, name, value)
    if "x" in change:
        spec.full_x = spec.x
    odd = oiio.ImageBuf(spec)
    oiio.ImageBufAlgo.fill(odd, (0.5,))
    with pytest.raises(errors.ImageError, match="must have the same size and windows: .*" + said):
        made([*images()[:2], odd])


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (
            {"kinds": ["color", "normal"]},
            "kinds=.'color', 'normal'.: expected one of .* for each of the 3 maps",
        ),
        ({"kinds": ("color", "bump", "data")}, "kinds=.'color', 'bump', 'data'.: expected"),
        ({"mapweights": (1, 1)}, "mapweights=.1.0, 1.0.: expected one number for each of the 3 maps"),
        ({"mapweights": (0, 0, 0)}, "mapweights=.0.0, 0.0, 0.0.: expected"),
    ],
)
def test_what_does_not_fit_the_maps_is_said(given, said):
    with pytest.raises(errors.ParameterError, match=said):
        made(**given)


def test_n_takes_and_pushes_images_of_the_stack(tmp_path):
    save(ALBEDO, tmp_path / "albedo.png")
    save(NORMAL, tmp_path / "normal.exr", "half")
    save(ROUGH, tmp_path / "rough.png", "uint16")
    op = f"--texstationarize:kinds={KINDS}:iterations=2:size=48x40:patch=7"
    inputs = ["albedo.png", "normal.exr", "rough.png"]
    one_by_one = ["-o", "rough_t.exr", "--pop", "-o", "normal_t.exr", "--pop", "-o", "albedo_t.exr"]
    together = ["-o:all=1", "map%d.exr", "--siappendall", "-o", "all.exr"]
    for written in (one_by_one, together):
        done = oiiotex(*inputs, op, "-d", "half", *written, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
    for n, name in enumerate(("albedo", "normal", "rough")):
        np.testing.assert_array_equal(load(tmp_path / f"{name}_t.exr"), load(tmp_path / "all.exr", n))
    assert (tmp_path / "map3.exr").exists()
    known = {v.tobytes() for v in load(tmp_path / "normal.exr").reshape(-1, 3)}
    assert {v.tobytes() for v in load(tmp_path / "normal_t.exr").reshape(-1, 3)} <= known
    done = oiiotex("albedo.png", "normal.exr", op, "-o", "x.exr", cwd=tmp_path)
    assert done.returncode == 1 and "expected 3 image(s) on the stack, found 2" in done.stderr


def test_too_many_channels_are_refused_in_a_whole_sentence():
    said = "33 channels to compare: expected at most 32; set mapweights of a map to 0 to ignore it$"
    with pytest.raises(errors.ParameterError, match=said):
        filters.stationarize(buffer(ALBEDO), maps=[buffer(ALBEDO)] * 10, **QUICK)
