# SPDX-License-Identifier: Apache-2.0
"""Promise 15: what is tagged periodic is periodic after every op that can keep it so, and not tagged after others.

Every op of `host.OPS` runs on a tile with the uses of test_streaming.py: its result is as seamless as the tile, or not
tagged. A tile that is shifted circularly before an op over a neighborhood gives the shifted result, to the bit, and a
resampled or warped tile is a window of the resampled or warped plane.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest
from scipy.ndimage import gaussian_filter

from oiiotex import filters
from oiiotex.engine.core import demand
from oiiotex.engine.core.access import Neighborhood, Pointwise
from oiiotex.engine.core.image import Image, Part, from_pixels
from oiiotex.engine.core.tiling import tiling_of
from oiiotex.engine.core.window import Window
from oiiotex.engine.session import Session
from oiiotex.oiiotool import host
from oiiotex.oiiotool.host.kinds import HostOp
from oiiotex.synthesis.quality.seam_measures import seam_ratio

from ..conftest import made_by, oiiotex
from .test_streaming import SAMPLES, windows_of

SIDE = 256
TILE = gaussian_filter(np.random.default_rng(3).random((SIDE, SIDE, 4)), (1, 1, 0), mode="wrap")
TILE = (0.5 + (TILE - 0.5) / TILE.std() * 0.1).astype(np.float32)
SHIFT = (101, 29)  # rows, columns
MOST = 1.15  # times the seam before
USES = SAMPLES | {
    "fit": [{"size": "150x150"}, {"size": "90x200"}, *SAMPLES["fit"]],
    "fill": [{"size": "20x30+3+1", "color": (0.2,)}],
}
KEPT = {
    "blur", "convolve", "median", "dilate", "erode", "unsharp", "laplacian", "fillholes", "resize", "resample", "fit",
    "pixelaspect", "fixnan", "st_warp", "cshift", "flip", "flop", "rotate90", "rotate180", "rotate270", "transpose",
    "mulc", "tocolorspace", "ch", "add", "over", "attrib",
}  # fmt: skip
DROPPED = {
    "crop", "cut", "paste", "mosaic", "warp", "rotate", "origin", "originoffset", "fullsize", "box", "line", "text",
    "fft", "demosaic",
}  # fmt: skip
# that neither declare what becomes of a tile, nor work pixel by pixel, nor only move pixels
OTHERS = {
    "pixelaspect": "wraps as resize", "decorrstretch": "points, after statistics", "reorient": "moves",
    "deepen": "points", "flatten": "points", "deepmerge": "points", "deepholdout": "points",
    "trim": "drops with its windows", "paste": "drops with its windows", "mosaic": "drops with its windows",
}  # fmt: skip
CHAIN: list[tuple[str, dict[str, Any]]] = [
    ("blur", {"size": "13x9"}), ("resize", {"size": "150%"}), ("median", {"size": "3x3"}),
    ("cshift", {"shift": "+17+40"}), ("unsharp", {}), ("dilate", {"size": "3x3"}), ("rotate90", {}),
    ("resample", {"size": "70%"}), ("erode", {"size": "3x3"}), ("fit", {"size": "150x150"}), ("blur", {"size": "3x3"}),
]  # fmt: skip


def tile(modes: str = "periodic,periodic", pixels: np.ndarray = TILE, **attributes: Any) -> Part:
    height, width, channels = pixels.shape
    spec = oiio.ImageSpec(width, height, channels, "float")
    for name, value in {"wrapmodes": modes, "oiio:ColorSpace": "lin_rec709_scene", **attributes}.items():
        spec.attribute(name, value)
    return from_pixels("tile", np.ascontiguousarray(pixels, np.float32), spec)


def images_for(op: type[HostOp], pixels: np.ndarray = TILE) -> dict[str, Any]:
    """Images that all tile, of the kinds that the op takes."""
    rgba = Image((tile(pixels=pixels),), "rgba")
    given: dict[str, Any] = {s.name: (rgba, rgba) if s.many else rgba for s in op.images()}
    if op.name in ("polar", "unpolar", "ifft"):
        given = {"source": Image((tile(pixels=pixels[..., :2]),), "two")}
    elif op.name == "demosaic":
        given = {"source": Image((tile(pixels=pixels[..., :1], **{"raw:FilterPattern": "RGGB"}),), "raw")}
    elif op.name == "scale":
        given["b"] = Image((tile(pixels=pixels[..., :1]),), "gray")
    elif op.name == "fillholes":
        seen = (gaussian_filter(pixels[..., 3], 3, mode="wrap") < 0.52).astype(np.float32)[..., None]
        given = {"source": Image((tile(pixels=pixels * [1, 1, 1, 0] * seen + [0, 0, 0, 1] * seen),), "holes")}
    elif op.name == "convolve":
        spec = oiio.ImageSpec(5, 3, 1, "float")
        spec.x, spec.y = -1, -1
        given["kernel"] = Image(
            (from_pixels("kernel", np.arange(1, 16, dtype=np.float32).reshape(3, 5, 1), spec),), "k"
        )
    elif op.name == "st_warp":
        t, s = (np.indices(pixels.shape[:2]) + 0.5) / np.reshape(pixels.shape[:2], (2, 1, 1))
        wave = 0.02 * np.sin(2 * np.pi * np.stack([t, s], -1)) + 0.3  # it reads beyond the border, and coordinates > 1
        given["st"] = Image((tile(pixels=np.stack([s, t], -1) + wave),), "st")
    return given


def seams(pixels: np.ndarray, axes: str) -> list[float]:
    return [seam_ratio(np.asarray(pixels, np.float32), "yx".index(axis)) for axis in axes if axis in "xy"]


def result_of(op: type[HostOp], arguments: dict[str, Any], pixels: np.ndarray = TILE) -> Part:
    return made_by(op(**images_for(op, pixels), **arguments), Session()).first


CASES = [
    pytest.param(op, n, id=f"{op.name}-{n}")
    for op in host.OPS
    for n in range(len(USES[op.name]))
    if op.images() and op.name not in ("zover", "flatten")
]
BEFORE = max(seams(TILE, "xy"))


@pytest.mark.parametrize(("op", "number"), CASES)
def test_a_tile_stays_a_tile_or_is_not_called_one(op: type[HostOp], number: int):
    made = result_of(op, USES[op.name][number])
    axes = tiling_of(made.spec)
    assert "periodic" not in made.spec.get_string_attribute("wrapmodes") or axes != "none"
    if axes != "none" and op.name != "pixelaspect":  # jumps between enlarged pixels are unequal: see below
        pixels = np.nan_to_num(made.pixels())
        assert all(seam <= MOST * BEFORE for seam in seams(pixels, axes)), seams(pixels, axes)
    if number == 0:
        assert op.name not in KEPT or axes == "xy"
        assert op.name not in DROPPED or axes == "none"


def test_what_must_keep_a_tile_or_must_not_is_tried():
    assert {op.name for op in host.OPS} >= KEPT | DROPPED
    assert {op.name for op in host.OPS if op.wraps} <= KEPT
    assert {op.name for op in host.OPS if op.untiles} <= DROPPED | {"ifft", "point", "fill"}


def test_every_op_is_classified():
    """One that reads around a pixel wraps; one that cuts, moves or draws drops the tag."""
    undeclared = {
        op.name for op in host.OPS
        if op.images() and not (op.wraps or op.untiles or issubclass(op, Pointwise) or not op.mixes)
    }  # fmt: skip
    assert undeclared == OTHERS.keys()
    assert not [op.name for op in host.OPS if issubclass(op, Neighborhood) and not (op.wraps or op.untiles)]
    assert not [op.name for op in host.OPS if op.wraps and op.untiles]


def test_a_chain_keeps_a_tile():
    part, before = tile(), BEFORE
    for name, arguments in CHAIN:
        op = next(op for op in host.OPS if op.name == name)
        part = made_by(op(source=Image((part,), "tile"), **arguments), Session()).first
        assert tiling_of(part.spec) == "xy", name
        after = max(seams(part.pixels(), "xy"))
        assert after <= MOST * max(1.0, before), (name, before, after)
        before = after


@pytest.mark.parametrize(
    ("op", "number"), [case for case in CASES if issubclass(case.values[0], Neighborhood) and case.values[0].wraps]
)
def test_where_a_tile_begins_does_not_show(op: type[HostOp], number: int):
    arguments = USES[op.name][number]
    made, turned = (result_of(op, arguments, pixels) for pixels in (TILE, np.roll(TILE, SHIFT, (0, 1))))
    np.testing.assert_array_equal(turned.pixels(), np.roll(made.pixels(), SHIFT, (0, 1)))


@pytest.mark.parametrize(
    ("name", "arguments", "of_plane"),
    [
        ("resize", {"size": "200%"}, {"size": "200%"}),
        ("resize", {"size": "100x37"}, {"size": "300x111"}),
        ("resample", {"size": "300%"}, {"size": "300%"}),
        ("fit", {"size": "150x150"}, {"size": "450x450"}),
        ("pixelaspect", {"aspect": 0.5}, {"aspect": 0.5}),
    ],
)
def test_a_resampled_tile_is_the_resampled_plane(name: str, arguments: dict[str, Any], of_plane: dict[str, Any]):
    op = next(op for op in host.OPS if op.name == name)
    plane = Image((tile("black,black", np.tile(TILE, (3, 3, 1))),), "plane")
    made, whole = (
        made_by(op(source=source, **values), Session()).first.pixels()
        for source, values in ((Image((tile(),), "tile"), arguments), (plane, of_plane))
    )
    height, width, _ = made.shape
    np.testing.assert_allclose(made, whole[height : 2 * height, width : 2 * width], atol=5e-5)


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("rotate", {"angle": 30.0}),
        ("warp", {"matrix": (1.2, 0.3, 0, -0.2, 0.9, 0, 31.5, -17, 1)}),
    ],
)
def test_a_warped_tile_has_no_border(name: str, arguments: dict[str, Any]):
    op = next(op for op in host.OPS if op.name == name)
    spec = tile().spec
    plane_spec = oiio.ImageSpec(5 * SIDE, 5 * SIDE, 4, "float")
    plane_spec.x = plane_spec.y = -2 * SIDE
    plane_spec.full_x, plane_spec.full_y, plane_spec.full_width, plane_spec.full_height = 0, 0, SIDE, SIDE
    plane = from_pixels("plane", np.tile(TILE, (5, 5, 1)), plane_spec)
    made, whole = (made_by(op(source=Image((part,), "i"), **arguments), Session()).first for part in (tile(), plane))
    window = Window.data(spec)
    np.testing.assert_allclose(made.pixels(), whole.read(window), atol=5e-5)
    if name == "warp":
        black = made_by(op(source=Image((tile(),), "i"), wrap="black", **arguments), Session()).first.pixels()
        untagged = Image((tile("black,black"),), "i")
        np.testing.assert_array_equal(black, made_by(op(source=untagged, **arguments), Session()).first.pixels())


@pytest.mark.parametrize(("modes", "axes"), [("periodic,black", "x"), ("clamp,periodic", "y"), ("black,black", "none")])
def test_a_tile_along_one_axis(modes: str, axes: str):
    blur = next(op for op in host.OPS if op.name == "blur")
    made = made_by(blur(source=Image((tile(modes),), "tile"), size="9x9"), Session()).first
    assert tiling_of(made.spec) == axes
    pixels = made.pixels()
    for axis, name in enumerate("yx"):
        assert (seam_ratio(pixels, axis) <= MOST * BEFORE) == (name in axes)
    turned = next(op for op in host.OPS if op.name == "rotate90")(source=Image((tile(modes),), "tile"))
    assert tiling_of(made_by(turned, Session()).first.spec) == {"x": "y", "y": "x"}.get(axes, axes)


FILTERS: list[tuple[str, dict[str, Any]]] = [
    ("flatten", {"radius": 40}),
    ("estimateheight", {"light": 120.0, "sigma": 32}),
    ("estimateroughness", {"sigma": 16}),
    ("estimateao", {"radius": 8, "relief": 6}),
    ("lab", {}),
]


def photo(modes: str, glint: float = 1.0) -> oiio.ImageBuf:
    """A tile of three channels with slow and fast variation that is not even at the border.

    `glint`: by how much its lightest fiftieth is brighter, as highlights are.
    """
    t, s = np.indices((SIDE, SIDE)) / SIDE
    slow = 1 + 0.4 * np.sin(2 * np.pi * (s + t) + 1)
    light = np.where(TILE[..., :1] > np.quantile(TILE[..., 0], 0.98), glint, 1.0)
    part = tile(modes, TILE[..., :3] * slow[..., None] * light)
    made = oiio.ImageBuf(part.spec)
    made.set_pixels(made.roi, part.pixels())
    return made


@pytest.mark.parametrize(("name", "arguments"), FILTERS)
def test_a_map_of_a_tile_is_a_tile(name: str, arguments: dict[str, Any]):
    glint = 4.0 if name == "estimateroughness" else 1.0
    result = getattr(filters, name)(photo("periodic,periodic", glint), **arguments)
    pixels = result.get_pixels("float")
    assert tiling_of(result.spec()) == "xy"
    assert max(seams(pixels, "xy")) <= MOST * max(seams(photo("").get_pixels("float"), "xy"))
    untagged = getattr(filters, name)(photo("black,black", glint), **arguments)
    assert tiling_of(untagged.spec()) == "none"
    if name != "lab":
        assert np.abs(untagged.get_pixels("float") - pixels).max() > 1e-4
        given = getattr(filters, name)(photo("periodic,periodic", glint), tiled="none", **arguments)
        assert tiling_of(given.spec()) == "none"
        np.testing.assert_array_equal(given.get_pixels("float"), untagged.get_pixels("float"))


def test_help_says_what_becomes_of_a_tile():
    assert "is repeated beyond its border" in oiiotex("--help", "blur").stdout
    assert "The result does not tile" in oiiotex("--help", "--cut").stdout
    assert "tile" not in oiiotex("--help", "mulc").stdout


def test_textures_carry_the_tag(tmp_path):
    tiled = tmp_path / "tile.exr"
    photo("periodic,black").write(str(tiled))
    for modifiers, modes in (
        ("", "periodic,black"),
        (":wrap=clamp", "clamp,clamp"),
        (":twrap=mirror", "periodic,mirror"),
    ):
        oiiotex(tiled, "--blur", "3x3", f"-otex{modifiers}", tmp_path / "tile.tx")
        assert oiio.ImageBuf(str(tmp_path / "tile.tx")).spec().get_string_attribute("wrapmodes") == modes
    oiiotex(tiled, "--cut", "64x64+3+3", "-otex", tmp_path / "cut.tx")
    assert oiio.ImageBuf(str(tmp_path / "cut.tx")).spec().get_string_attribute("wrapmodes") == "black,black"


@pytest.mark.parametrize(
    ("op", "number"), [case for case in CASES if case.values[0].wraps and case.values[0].name != "fillholes"]
)
def test_windows_of_a_tile_do_not_show(op: type[HostOp], number: int, monkeypatch: pytest.MonkeyPatch):
    """It streams: a window reads what it needs of the other border, and gives the same pixels in any pieces."""
    monkeypatch.setattr(demand, "BAND_BYTES", 8 << 10)
    pixels = np.ascontiguousarray(TILE[:61, :47])
    whole = result_of(op, USES[op.name][number], pixels).pixels()
    part = result_of(op, USES[op.name][number], pixels)
    for windows in windows_of(part.window):
        for window in windows:
            np.testing.assert_array_equal(part.read(window), whole[window.inside(part.window)], str(window))


@pytest.mark.parametrize(
    ("name", "arguments", "left"),
    [
        ("abs", {}, ["oiiotex:atlas", "oiiotex:edges"]),
        ("resize", {"size": "50%"}, ["oiiotex:atlas"]),
        ("blur", {"size": "3x3"}, ["oiiotex:atlas"]),
        ("crop", {"size": "20x20+0+0"}, []),
        ("flip", {}, []),
        ("rotate90", {}, []),
        ("cshift", {"shift": "+3+4"}, []),
        ("rotate", {"angle": 10.0}, []),
    ],
)
def test_wang_tiles_that_no_longer_fit_are_not_called_so(name, arguments, left):
    (op,) = (op for op in host.OPS if op.name == name)
    source = Image((tile(**{"oiiotex:atlas": "2x2", "oiiotex:edges": "n0e0s0w0"}),), "atlas")
    made = made_by(op(source=source, **arguments), Session()).first
    assert [one for one in ("oiiotex:atlas", "oiiotex:edges") if made.spec.getattribute(one)] == left


@pytest.mark.parametrize("name", ["flatten", "quilt"])
def test_what_is_made_of_wang_tiles_is_none(name):
    source = tile(pixels=TILE[..., :3], **{"oiiotex:atlas": "2x2", "oiiotex:edges": "n0e0s0w0"})
    made = getattr(filters, name)(source.buffer(source.window)).spec()
    assert not made.getattribute("oiiotex:atlas") and not made.getattribute("oiiotex:edges")
