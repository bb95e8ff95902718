# SPDX-License-Identifier: Apache-2.0
"""Ops that resample at arbitrary coordinates, and the filters that they share with resizing."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar

from ....engine.core.access import Gather
from ....engine.core.image import Image, Part, derived_spec, in_memory, pixels_of
from ....engine.core.parameters import Numbers, argument, image, nearest, param
from ....engine.core.tiling import repeated, tiling_of
from ....engine.core.window import Window, warp_needs
from ....engine.deferred import np, oiio
from ....engine.errors import ImageError, ParameterError
from ....engine.session.facts import Facts
from ..kinds import HostOp, checked, filled, like, once, worked
from ..remapping import remapped, require_kernel

# OpenImageIO's filters and their widths in pixels
FILTERS = {
    "box": 1, "triangle": 2, "gaussian": 3, "sharp-gaussian": 2, "catmull-rom": 4, "blackman-harris": 3, "sinc": 4,
    "lanczos3": 6, "radial-lanczos3": 6, "nuke-lanczos6": 6, "mitchell": 4, "bspline": 4, "disk": 1, "cubic": 4,
    "keys": 4, "simon": 4, "rifman": 4,
}  # fmt: skip
HIGHLIGHTS = param(False, help="Compress highlights before filtering and expand them afterwards, to avoid ringing.")
_FAR = 1 << 24  # px
_BESIDE = 8  # px around a tile that --st_warp reads: more than half of the widest filter
_WRAPS = ("default", "black", "clamp", "periodic", "mirror")


def known_filter(name: str) -> str:
    """The name of a filter, or '' for the op's default; raises ParameterError for an unknown one."""
    if name and name not in FILTERS:
        problem, expected = f"unknown filter{nearest(name, FILTERS)}", f"one of {', '.join(FILTERS)}"
        raise ParameterError(problem, parameter="filter", value=name, expected=expected)
    return name


def blank(target: oiio.ImageSpec, source: oiio.ImageBuf) -> oiio.ImageBuf:
    """Black pixels over the target's data window, of the type of another buffer."""
    spec = oiio.ImageSpec(target)
    spec.set_format(source.spec().format)
    return oiio.ImageBuf(spec)


def compressed(
    work: Callable[[oiio.ImageBuf], oiio.ImageBuf], buffer: oiio.ImageBuf, highlights: bool
) -> oiio.ImageBuf:
    """`work` applied to the buffer; with `highlights`, to compressed values, so that bright spots do not ring."""
    if not highlights:
        return work(buffer)
    result = checked(work(checked(oiio.ImageBufAlgo.rangecompress(buffer))))
    oiio.ImageBufAlgo.rangeexpand(result, result)
    return result


def _clamped_at_edges(
    warped: oiio.ImageBuf, buffer: oiio.ImageBuf, data: Window, matrix: np.ndarray, filter: str
) -> oiio.ImageBuf:
    """A warp normalized by the filter weights inside the data window: the option `edgeclamp` of oiiotool.

    ImageBufAlgo's Python function lacks that option. A warped image of ones holds the sum of the weights inside;
    dividing by it gives the same values, to the last bit or two. `warped` is black outside `data`, the data window of
    the whole source; `matrix`, (3, 3), must only scale and translate.
    """
    gray = {"nchannels": 1, "channelnames": ("Y",), "alpha_channel": -1, "z_channel": -1}
    ones, share = (oiio.ImageBuf(like(given.spec(), **gray, format=oiio.TypeFloat)) for given in (buffer, warped))
    oiio.ImageBufAlgo.fill(ones, (1.0,))
    oiio.ImageBufAlgo.warp(share, ones, tuple(float(v) for v in matrix.ravel()), filter, 0.0, False, "default")
    window = Window.data(warped.spec())
    inverse = np.linalg.inv(matrix.astype(np.float64)).astype(np.float32)
    s = (np.arange(window.left, window.right, dtype=np.float32) + np.float32(0.5)) * inverse[0, 0] + inverse[2, 0]
    t = (np.arange(window.top, window.bottom, dtype=np.float32) + np.float32(0.5)) * inverse[1, 1] + inverse[2, 1]
    inside = ((t >= data.top - 1) & (t < data.bottom))[:, None] & ((s >= data.left - 1) & (s < data.right))[None]
    weight = pixels_of(share, oiio.FLOAT)
    values = pixels_of(warped, oiio.FLOAT)
    counts = (weight > 0) & inside[..., None]
    warped.set_pixels(warped.roi, np.where(counts, values / np.where(counts, weight, np.float32(1)), np.float32(0)))
    return warped


def _forward_window(matrix: np.ndarray, window: Window) -> Window:
    """The smallest window around a warped one, computed in float as ImageBufAlgo::warp does."""
    m = matrix.astype(np.float32)
    corners = []
    for y in (np.float32(window.top) + np.float32(0.5), np.float32(window.bottom) - np.float32(0.5)):
        for x in (np.float32(window.left) + np.float32(0.5), np.float32(window.right) - np.float32(0.5)):
            a, b, w = (x * m[0, k] + y * m[1, k] + m[2, k] for k in range(3))
            corners.append((a / w, b / w))
    (left, top), (right, bottom) = np.min(corners, axis=0), np.max(corners, axis=0)
    if not np.all(np.isfinite((left, top, right, bottom))):
        raise ImageError("the warped image is unbounded", hint="use recompute_roi=0 or another matrix")
    return Window(math.floor(left), math.floor(top), math.floor(right) + 1, math.floor(bottom) + 1)


def warped(
    op: HostOp, part: Part, target: oiio.ImageSpec, matrix: np.ndarray, filter: str, highlights: bool,
    facts: Facts, *, wrap: str = "default", edgeclamp: bool = False, scattered: bool = False,
) -> Part:  # fmt: skip
    """The part warped by a matrix, over the windows of `target`, not yet computed.

    `matrix`, (3, 3), maps row vectors (x, y, 1) in pixels from the source to the result. Raises ParameterError for an
    unknown filter, and for a singular matrix.
    """
    wide = FILTERS[known_filter(filter) or "lanczos3"]
    matrix, data = matrix.astype(np.float32), part.window
    try:
        inverse = np.linalg.inv(matrix.astype(np.float64))
    except np.linalg.LinAlgError:
        raise ParameterError("singular matrix", expected="an invertible matrix") from None
    if np.array_equal(inverse[:, 2], (0, 0, 1)):  # in a perspective the scale varies from pixel to pixel
        across, down = wide * np.maximum(1, np.abs(inverse[:2, :2]).max(axis=0))
        require_kernel(math.ceil(across), math.ceil(down), facts)
    values = tuple(float(v) for v in matrix.ravel())

    def needs(window: Window) -> Sequence[Window]:
        wanted = warp_needs(inverse, window, wide, data)
        if wrap in ("periodic", "mirror") and wanted & data != wanted:
            return [data]  # wrapped pixels may come from anywhere
        return [wanted]

    def apply(spec: oiio.ImageSpec, buffer: oiio.ImageBuf) -> oiio.ImageBuf:
        def warp(buffer: oiio.ImageBuf) -> oiio.ImageBuf:
            result = blank(spec, buffer)
            oiio.ImageBufAlgo.warp(result, buffer, values, filter, 0.0, False, wrap)
            return _clamped_at_edges(result, buffer, data, matrix, filter) if edgeclamp else result

        return compressed(warp, buffer, highlights)

    return remapped(op, [part], target, needs, apply, facts, scattered=scattered)


def _black_beside(part: Part, tiling: str) -> Part:
    """The part in a display window that is far larger along the axes along which it does not tile.

    ImageBufAlgo::warp repeats the display window along both axes.
    """

    def widen(spec: oiio.ImageSpec) -> None:
        Window.display(spec).grown(_FAR * ("x" not in tiling), _FAR * ("y" not in tiling)).show_in(spec)

    return part.respecced(widen)


@dataclass(frozen=True, kw_only=True)
class Warped(HostOp, Gather):
    """Warps by a matrix."""

    rescales: ClassVar[bool] = True
    untiles: ClassVar[bool] = True
    source: Image = image(help="Input image.")
    filter: str = param("", unset="lanczos3", help="Name of the resampling filter.", example="mitchell")
    recompute_roi: bool = param(False, help="Grow or shrink the data window to the warped image.")
    highlightcomp: bool = HIGHLIGHTS

    def warped(self, part: Part, matrix: np.ndarray, wrap: str, facts: Facts) -> Part:
        """The part warped by a matrix, not yet computed; by default a tile is repeated beyond its border."""
        target = (_forward_window(matrix, part.window) if self.recompute_roi else part.window).apply_to(part.spec)
        tiling = tiling_of(part.spec)
        if wrap == "default" and tiling != "none":
            part, wrap = _black_beside(part, tiling), "periodic"
        return warped(self, part, target, matrix, self.filter, self.highlightcomp, facts, wrap=wrap, scattered=True)


@dataclass(frozen=True, kw_only=True)
class Warp(Warped):
    """Warp the image by a 3x3 matrix."""

    name: ClassVar[str] = "warp"

    matrix: Numbers = argument(
        help="9 values, row by row. The matrix maps row vectors (x, y, 1) from the source to the result.",
        example="0.5,0,0,0,0.5,0,0,0,1",
    )
    wrap: str = param(
        "default",
        choices=_WRAPS,
        help="Pixels outside the image. `default` is black, or periodic along the"
        " axes that the image's wrapmodes call periodic.",
    )

    def result(self, parts: Sequence[Part], facts: Facts) -> Part:
        """The warped part, not yet computed."""
        if len(self.matrix) != 9:
            raise ParameterError(parameter="matrix", value=self.matrix, expected="9 values")
        return self.warped(parts[0], np.array(self.matrix).reshape(3, 3), self.wrap, facts)


@dataclass(frozen=True, kw_only=True)
class Rotate(Warped):
    """Rotate the image around a point, by default the center of the display window."""

    name: ClassVar[str] = "rotate"

    angle: float = argument(unit="degrees", ge=-1e9, le=1e9, help="Angle, clockwise.", example="30")
    center: Numbers | None = param(
        None, unset="center of the display window", help="Center of rotation X,Y, in pixels.", example="320,240"
    )

    def result(self, parts: Sequence[Part], facts: Facts) -> Part:
        """The rotated part, not yet computed."""
        display = Window.display(parts[0].spec)
        x, y = 0.5 * (display.left + display.right), 0.5 * (display.top + display.bottom)
        if self.center is not None:
            if len(self.center) != 2:
                raise ParameterError(parameter="center", value=self.center, expected="X,Y")
            x, y = self.center
        radians = float(np.float32(self.angle) * np.float32(math.pi / 180))
        return self.warped(parts[0], _rotation(radians, x, y), "default", facts)


def _rotation(radians: float, x: float, y: float) -> np.ndarray:
    """The matrix of ImageBufAlgo::rotate, with the same rounding: otherwise windows could differ by a pixel."""
    c, s = np.float32(math.cos(radians)), np.float32(math.sin(radians))
    turn = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]], np.float32)
    move, back = (np.array([[1, 0, 0], [0, 1, 0], [sign * x, sign * y, 1]], np.float32) for sign in (-1, 1))

    def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """The product in float, terms added from the left."""
        return a[:, :1] * b[:1] + a[:, 1:2] * b[1:2] + a[:, 2:] * b[2:]

    return product(product(move, turn), back)


def _without_turns(st: oiio.ImageBuf, channels: Sequence[int]) -> oiio.ImageBuf:
    """The ST map with these channels modulo 1: on a tile, where each coordinate has a pixel."""
    if not channels:
        return st
    values = pixels_of(st, oiio.FLOAT)
    values[..., channels] %= 1
    return filled(like(st.spec(), format=oiio.TypeFloat), values)


@dataclass(frozen=True, kw_only=True)
class STWarp(HostOp, Gather):
    """Warp an image by a second one that contains normalized source coordinates (an ST map)."""

    name: ClassVar[str] = "st_warp"
    rescales: ClassVar[bool] = True
    wraps: ClassVar[bool] = True

    source: Image = image(help="Image to warp.")
    st: Image = image(help="ST map: source coordinates from 0 to 1.")
    filter: str = param("", unset="lanczos3", help="Name of the resampling filter.", example="mitchell")
    chan_s: int = param(0, ge=0, help="Channel of the ST map that contains s.")
    chan_t: int = param(1, ge=0, help="Channel of the ST map that contains t.")
    flip_s: bool = param(False, help="Flip s: 0 is at the right.")
    flip_t: bool = param(False, help="Flip t: 0 is at the bottom.")

    def tiling(self, parts: Sequence[Part], made: Part) -> str:
        """Those of the ST map: a pixel is that at its coordinates."""
        return tiling_of(parts[1].spec) if parts[1].window == made.window else "none"

    def result(self, parts: Sequence[Part], facts: Facts) -> Part:
        """The warped part, not yet computed: any of its windows may read any pixel of the source."""
        source, st = worked(parts[0]), parts[1]
        known_filter(self.filter)
        for name, channel in (("chan_s", self.chan_s), ("chan_t", self.chan_t)):
            if channel >= st.spec.nchannels:
                raise ParameterError(
                    parameter=name, value=channel, expected=f"a channel below {st.spec.nchannels}, of the ST map"
                )
        if (source.window & st.window).empty:
            raise ImageError("the data windows of the image and the ST map do not overlap")
        facts.require(source.spec.width * source.spec.height * source.pixel_bytes, self.flag())
        cached = once(source, lambda part: in_memory(part.name, part.buffer(part.window)))
        plane, axes, spec = repeated(cached), tiling_of(source.spec), derived_spec(source.spec)
        around = cached.window.grown(_BESIDE) & plane.window
        turns = [channel for channel, axis in ((self.chan_s, "x"), (self.chan_t, "y")) if axis in axes]

        def fetch(window: Window) -> oiio.ImageBuf:
            whole = plane.buffer(around)
            result = blank(window.apply_to(spec), whole)
            seen = window & st.window
            if not seen.empty:
                oiio.ImageBufAlgo.st_warp(
                    result, whole, _without_turns(st.buffer(seen), turns), self.filter, 0.0, self.chan_s, self.chan_t,
                    self.flip_s, self.flip_t, seen.roi(spec.nchannels),
                )  # fmt: skip
            return checked(result)

        return Part(source.name, spec, fetch)


WARPING = (Warp, Rotate, STWarp)
