# SPDX-License-Identifier: Apache-2.0
"""Promise 1 for the host's ops: a result has the same pixels whichever windows it is read by.

Every op of `host.OPS` has an entry in `SAMPLES`; an empty one needs a file, or what no built-in color config has, or
its result is deep. Sources give any window but say that it is dear, as
files do, lie off the origin, and are larger than the pieces in which ops keep rows.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex.engine.core import demand
from oiiotex.engine.core.access import Neighborhood, Pointwise
from oiiotex.engine.core.image import Image, Part, Pixels, dtype_of, in_memory
from oiiotex.engine.core.op import Op
from oiiotex.engine.core.window import Window
from oiiotex.engine.session import Session
from oiiotex.oiiotool import host
from oiiotex.oiiotool.host import remapping
from oiiotex.oiiotool.host.kinds import HostOp, Respec

from ..conftest import made_by
from ..sources import spec_of

DISPLAY = Window.sized(-3, 5, 43, 33)
DATA = {
    "inset": Window.sized(2, 9, 31, 23),  # inside the display window
    "overscan": DISPLAY.grown(6, 4),
    "aside": Window.sized(30, -2, 29, 21),  # half beside it
}

XTRANS = "GRBGBR BGGRGG RGGBGG GBRGRB RGGBGG BGGRGG"
SLANTED = (0.7, 0.2, 0, -0.3, 1.4, 0, 5, 3, 1)
LEANING = (1.2, 0.1, 0.003, -0.1, 0.8, 0.001, 5, 3, 1)
COLORS = {"topleft": (0.1,), "topright": (0.2, 0.3), "bottomleft": (0.5, 1, 2), "bottomright": (1, 0, 0)}

# for each op: arguments of the uses that are tried; images are filled in
SAMPLES: dict[str, list[dict[str, Any]]] = {
    # arithmetic, ranges
    **{name: [{}] for name in ("add", "sub", "mul", "div", "scale", "absdiff", "min", "max", "mad", "abs", "invert")},
    **{
        name: [{"value": (0.5,)}, {"value": (0.5, 2)}]
        for name in ("addc", "subc", "mulc", "divc", "absdiffc", "powc", "maxc", "minc")
    },
    "polar": [{}],
    "unpolar": [{}],
    "clamp": [{"min": "0.2", "max": "0.8"}],
    "contrast": [{"black": (0.1,), "white": (0.8,)}],
    "saturate": [{"scale": 0.5}],
    "rangecompress": [{}],
    "rangeexpand": [{}],
    "normalize": [{}],
    "noise": [{}],
    "fixnan": [{"strategy": "black"}, {"strategy": "box3"}],
    # compositing, channels
    **{name: [{}] for name in ("over", "zover", "premult", "unpremult", "repremult")},
    "ch": [{"channels": "B,A,R"}],
    "nchannels": [{"count": 2}, {"count": 6}],
    "chappend": [{}],
    "chnames": [{"names": "X,Y"}],
    "chsum": [{}],
    "maxchan": [{}],
    "minchan": [{}],
    "colormap": [{"map": "inferno"}],
    "cryptomatte-colors": [],
    "cryptomatte-unfold": [],
    # color
    "iscolorspace": [{"space": "lin_rec709_scene"}],
    "tocolorspace": [{"to_space": "g22_rec709_scene"}],
    "colorconvert": [{"from_space": "lin_rec709_scene", "to_space": "srgb_rec709_scene"}],
    "ccmatrix": [{"matrix": (0.5, 0.2, 0, 0.1, 0.7, 0, 0, 0.3, 1)}],
    "ociolook": [],
    "ociodisplay": [{"display": "sRGB - Display", "view": "Un-tone-mapped"}],
    "ociofiletransform": [],
    "ocionamedtransform": [],
    # metadata
    "attrib": [{"attribute": "a", "value": "1"}],
    "sattrib": [{"attribute": "a", "value": "1"}],
    "eraseattrib": [{"pattern": "a.*"}],
    "caption": [{"text": "words"}],
    "keyword": [{"keyword": "word"}],
    "clear-keywords": [{}],
    "orientation": [{"orientation": 6}],
    **{name: [{}] for name in ("orientcw", "orientccw", "orient180", "fullpixels", "pastemeta")},
    "origin": [{"place": "+7-3"}],
    "originoffset": [{"offset": "+7-3"}],
    "fullsize": [{"size": "20x30+1+2"}],
    "cicp": [{"codes": "1,13,0,1"}],
    "iccread": [],
    # geometry
    "crop": [{"size": "19x40+5+2"}],
    "croptofull": [{}],
    "cut": [{"size": "19x40+5+2"}],
    "trim": [{}],
    "paste": [{"position": "+7-3"}, {"position": "-", "mergeroi": True, "all": True}],
    "mosaic": [{"size": (2, 2), "pad": 3}, {"size": (3, 1), "fit": (23, 19)}],
    **{name: [{}] for name in ("flip", "flop", "rotate180", "rotate90", "rotate270", "transpose", "reorient")},
    "cshift": [{"shift": "+17-50"}],
    "resize": [
        {"size": "50%"},
        {"size": "61x17", "highlightcomp": True},
        {"size": "20x50", "filter": "radial-lanczos3"},
        {"size": "31x40", "filter": "disk"},
        {"size": "31x23", "from_": "10x8+3.5+2.25", "filter": "cubic"},
        {"size": "50x50", "to": "20x20+9+9", "edgeclamp": True},
    ],
    "resample": [{"size": "61x17"}, {"size": "40%", "interp": False}],
    "fit": [
        {"size": "50x30", "pad": True},
        {"size": "33x50+2-3", "fillmode": "height"},
        {"size": "33x50", "exact": True},
        {"size": "43x33-3+5"},
    ],
    "pixelaspect": [{"aspect": 1.7}],
    "warp": [
        {"matrix": SLANTED, "recompute_roi": True},
        {"matrix": LEANING, "filter": "triangle"},
        {"matrix": (*SLANTED[:8], -1), "wrap": "periodic"},
        {"matrix": SLANTED, "wrap": "clamp", "highlightcomp": True},
        {"matrix": SLANTED, "wrap": "mirror"},
    ],
    "rotate": [{"angle": 33.0}, {"angle": -90.0, "recompute_roi": True, "center": (1, 2)}],
    "st_warp": [{}, {"chan_s": 1, "chan_t": 0, "flip_s": True, "filter": "triangle"}],
    # filters
    "blur": [{"size": "7x4"}, {"size": "3.5x1", "kernel": "lanczos3"}],
    "convolve": [{}],
    "median": [{"size": "5x4"}, {"size": "1x1"}],
    "dilate": [{"size": "4x3"}],
    "erode": [{"size": "1x7"}],
    "unsharp": [{}, {"width": 7.0}, {"kernel": "median", "width": 4.0, "threshold": 0.2}],
    "laplacian": [{}],
    "fillholes": [{}],
    "flatten": [{}],
    "deepen": [],  # deep results are held whole: tests/engine/test_deep.py
    "deepmerge": [],
    "deepholdout": [],
    "fft": [{}],
    "ifft": [{}],
    "decorrstretch": [{}],
    "demosaic": [
        {},
        {"algorithm": "linear", "layout": "GRBG"},
        {"pattern": "xtrans", "layout": XTRANS},
    ],
    # drawing, patterns
    "box": [
        {"corners": "1,2,20,30", "color": (0.5,)},
        {"corners": "25,20,-9,7"},
        {"corners": "1,2,50,9", "fill": True},
    ],
    "line": [{"points": "-9,-2,30,17,5,60,7,7", "color": (0.5, 0.2, 0.1, 0.5)}],
    "point": [{"points": "10,12,11,12,12,12,30,3"}],
    "text": [{"text": "Words", "x": 3, "y": 25}, {"text": "Agq", "xalign": "center", "yalign": "top", "shadow": 3}],
    "fill": [{"size": "21x50+3+1", "top": (1, 0, 0), "bottom": (0, 0.5, 1)}, {"size": "30x9+3+12", **COLORS}],
    "create": [{"size": "21x13-3+4", "channels": 3}],
    "pattern": [
        {"size": "31x23-7+9", "channels": 5, "pattern": pattern, "type": "half"}
        for pattern in (
            "black",
            "constant:color=0.3,1",
            "fill:top=0.1,0.2:bottom=0.9",
            "fill:topleft=0.1:topright=0.2:bottomleft=0.5,1,2:bottomright=1",
            "checker:width=5:height=3",
            "noise:type=gaussian",
            "noise:type=blue:seed=3",
            "noise:type=salt:portion=0.3",
        )
    ],
    "kernel": [{"kernel": "gaussian", "size": "9x5"}],
}


def dear(window: Window, channels: int, type: str, seed: int, low: float = -0.5, high: float = 2.5) -> Part:
    """A part that gives any window it has, and nothing else."""
    spec = spec_of(window, DISPLAY, channels, type)
    spec.attribute("Orientation", 5)
    if channels == 4:
        spec.channelnames, spec.z_channel = ("R", "G", "B", "A"), -1
    spec.attribute("raw:FilterPattern", "RGGB")
    spec.attribute("oiio:ColorSpace", "lin_rec709_scene")
    pixels = np.random.default_rng(seed).random((window.height, window.width, channels), np.float32)
    pixels = (pixels * (high - low) + low).astype(dtype_of(spec))
    pixels[:2, :3] = 0
    if channels == 4:
        pixels[..., 3] = np.random.default_rng(seed).integers(0, 3, pixels.shape[:2]) / 2

    def fetch(wanted: Window) -> np.ndarray:
        assert not wanted.empty and wanted & window == wanted, wanted
        return pixels[wanted.inside(window)]

    return Part("dear", spec, fetch)


def images_for(op: type[Op], data: Window, type: str) -> dict[str, Any]:
    """The images that an op wants."""

    def picture(seed: int, channels: int = 4, window: Window = data) -> Image:
        return Image((dear(window, channels, type, seed),), f"picture {seed}")

    if op.name in ("polar", "unpolar"):
        return {"source": picture(1, 2)}
    if op.name == "demosaic":
        return {"source": picture(1, 1)}
    if op.name == "scale":
        return {"a": picture(1), "b": picture(2, 1)}
    if op.name == "zover":
        return {slot.name: with_depth(picture(n)) for n, slot in enumerate(op.images())}
    if op.name == "convolve":
        return {"source": picture(1), "kernel": picture(2, 1, Window(-2, -1, 4, 2))}
    if op.name == "st_warp":
        st = dear(data.shifted(3, 2), 2, "float", 2, 0, 1)
        return {"source": picture(1), "st": Image((st,), "st")}
    if op.name == "flatten":
        flat = picture(1).first
        return {"source": Image((in_memory("deep", oiio.ImageBufAlgo.deepen(flat.buffer(flat.window))),), "deep")}
    if op.name == "ifft":
        square = oiio.ImageBuf(oiio.ImageSpec(20, 15, 1, "float"))
        oiio.ImageBufAlgo.noise(square, "uniform", 0, 1)
        return {"source": Image((in_memory("fft", oiio.ImageBufAlgo.fft(square)),), "fft")}
    given: dict[str, Any] = {}
    for n, slot in enumerate(op.images()):
        many = tuple(picture(seed, window=data.shifted(seed, -2 * seed)) for seed in range(3))
        given[slot.name] = many if slot.many else picture(n, window=data.shifted(2 * n, -n))
    if op.name == "chappend":
        given = {"sources": many[:2]}
    return given


def with_depth(given: Image) -> Image:
    """Its third channel is depth."""

    def rename(spec: oiio.ImageSpec) -> None:
        spec.channelnames = ("R", "G", "Z", "A")
        spec.z_channel = 2

    return Image((given.first.respecced(rename),), given.source)


def computed(op: type[Op], arguments: dict[str, Any], data: Window, type: str, session: Session) -> Part:
    """The op's result."""
    return made_by(op(**images_for(op, data, type), **arguments), session).first


def windows_of(whole: Window) -> Iterator[list[Window]]:
    """Ways to cut a window up."""
    yield list(whole.cells(whole.width, 1))[::3]
    yield list(whole.cells(1, whole.height))[1::4]
    yield list(whole.cells(17, 9))[::-1]
    random = np.random.default_rng(0)
    found = []
    for _ in range(8):
        x, y = (sorted(random.integers(0, side + 1, 2)) for side in (whole.width, whole.height))
        window = Window(whole.left + x[0], whole.top + y[0], whole.left + x[1], whole.top + y[1])
        found += [] if window.empty else [window]
    yield found


@pytest.fixture
def small_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ops keep few rows at a time, and slanted reads are done in small squares."""
    monkeypatch.setattr(demand, "BAND_BYTES", 8 << 10)
    monkeypatch.setattr(remapping, "_CELL", 16)


CASES = [
    pytest.param(op, number, id=f"{op.name}-{number}")
    for op in host.OPS
    for number in range(len(SAMPLES.get(op.name, [])))
]


def test_every_op_has_an_entry():
    assert {op.name for op in host.OPS} == set(SAMPLES)


@pytest.mark.parametrize("where", ["overscan", "aside"])
@pytest.mark.parametrize(("op", "number"), CASES)
def test_windows_do_not_show(op: type[HostOp], number: int, where: str, small_pieces: None):
    """Rows, columns, squares and random windows are pieces of the whole."""
    if issubclass(op, Pointwise) and where == "aside":
        where = "inset"  # it sees no borders
    arguments = SAMPLES[op.name][number]
    type = "half" if where == "overscan" else "float"
    whole = computed(op, arguments, DATA[where], type, Session())
    pixels = np.array(whole.read(whole.window))
    assert pixels.shape == (whole.spec.height, whole.spec.width, whole.spec.nchannels)
    assert pixels.dtype == dtype_of(whole.spec)
    for windows in windows_of(whole.window):
        part = computed(op, arguments, DATA[where], type, Session())
        assert part.window == whole.window
        for window in windows:
            np.testing.assert_array_equal(part.read(window), pixels[window.inside(whole.window)], str(window))
        for window in windows[:1]:
            buffer = part.buffer(window)
            assert Window.data(buffer.spec()) == window
            assert buffer.spec().channelnames == whole.spec.channelnames


@pytest.mark.parametrize(("op", "number"), CASES)
def test_pieces_do_not_show(op: type[HostOp], number: int, monkeypatch: pytest.MonkeyPatch):
    """Small pieces, squares and a spilled source give what one piece gives, from all of the source."""
    arguments, data = SAMPLES[op.name][number], DATA["inset"]
    at_once = computed(op, arguments, data, "float", Session())
    pixels = np.array(at_once.read(at_once.window))
    monkeypatch.setattr(demand, "BAND_BYTES", 4 << 10)
    monkeypatch.setattr(remapping, "_CELL", 8)
    small = computed(op, arguments, data, "float", Session(budget=60 << 10 if kinds_of(op) else 1 << 30))
    for window in small.window.cells(small.window.width, 5):
        np.testing.assert_array_equal(small.read(window), pixels[window.inside(small.window)], str(window))


def kinds_of(op: type[HostOp]) -> bool:
    """Whether it settles its sources."""
    return op.name in ("rotate90", "rotate270", "transpose")


@pytest.mark.parametrize(
    ("op", "number"), [one for one in CASES if issubclass(one.values[0], Pointwise | Neighborhood)]
)
def test_an_op_reads_what_its_access_kind_says(op: type[HostOp], number: int, monkeypatch: pytest.MonkeyPatch):
    """Nothing before a window is asked for; then that window, or what is around it as far as the halo says."""
    monkeypatch.setattr(remapping, "cached", lambda part, cache: part)
    asked: list[Window] = []

    def watched(given: Image) -> Image:
        part = given.first

        def fetch(window: Window) -> Pixels:
            asked.append(window)
            return part.fetch(window)

        return Image((dataclasses.replace(part, fetch=fetch),), given.source)

    images = images_for(op, DATA["inset"], "float")
    kernel = images.pop("kernel", None)  # is held
    images = {name: tuple(map(watched, v)) if isinstance(v, tuple) else watched(v) for name, v in images.items()}
    use = op(**images, **({} if kernel is None else {"kernel": kernel}), **SAMPLES[op.name][number])
    part = made_by(use).first
    assert asked == []
    source = window = Window.sized(15, 18, 4, 3)  # in the middle: no edge repeats
    if isinstance(use, Respec):  # which may call the same places otherwise
        window = source.shifted(*np.subtract(part.window, images["source"].first.window)[:2].tolist())
    part.read(window)
    assert asked and all(w & source.grown(*use.halo()) == w for w in asked)
