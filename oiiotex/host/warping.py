# SPDX-License-Identifier: Apache-2.0
"""Ops that resample at slanted or arbitrary places, and what they share with the scalings."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar

from ..core.access import Gather
from ..core.image import Image, Part, derived_spec, in_memory, pixels_of
from ..core.op import Op
from ..core.parameters import Numbers, argument, image, nearest, param
from ..core.window import Window, warp_needs
from ..deferred import np, oiio
from ..errors import ImageError, ParameterError
from ..session import Session
from .kinds import HostOp, checked, once, remapped, require_kernel, worked

# OpenImageIO's filters and their widths in pixels
FILTERS = {
    "box": 1, "triangle": 2, "gaussian": 3, "sharp-gaussian": 2, "catmull-rom": 4, "blackman-harris": 3, "sinc": 4,
    "lanczos3": 6, "radial-lanczos3": 6, "nuke-lanczos6": 6, "mitchell": 4, "bspline": 4, "disk": 1, "cubic": 4,
    "keys": 4, "simon": 4, "rifman": 4,
}  # fmt: skip
_WRAPS = ("default", "black", "clamp", "periodic", "mirror")


def known_filter(name: str) -> str:
    """The name of a filter, or nothing for the op's own choice.

    Raises
    ------
    ParameterError
        There is none of that name.
    """
    if name and name not in FILTERS:
        raise ParameterError(f"filter={name}: no such filter{nearest(name, FILTERS)}; there is {', '.join(FILTERS)}")
    return name


def blank(target: oiio.ImageSpec, like: oiio.ImageBuf) -> oiio.ImageBuf:
    """Black pixels over the target's data window, of the type of another buffer."""
    spec = oiio.ImageSpec(target)
    spec.set_format(like.spec().format)
    return oiio.ImageBuf(spec)


def compressed(work: Callable[[oiio.ImageBuf], oiio.ImageBuf], buffer: oiio.ImageBuf) -> oiio.ImageBuf:
    """What `work` makes of the buffer, done on compressed values: bright spots do not ring."""
    result = checked(work(checked(oiio.ImageBufAlgo.rangecompress(buffer))))
    oiio.ImageBufAlgo.rangeexpand(result, result)
    return result


def clamped_at_edges(
    warped: oiio.ImageBuf, buffer: oiio.ImageBuf, data: Window, matrix: np.ndarray, filter: str
) -> oiio.ImageBuf:
    """What a warp would be if the filter's weights counted only where there are pixels: ImageBufAlgo's `edgeclamp`.

    Its Python function does not take that option. A warped image of ones holds the share of the weights that counted;
    what is divided by it has the value, to the last bit or two.

    Parameters
    ----------
    warped : oiio.ImageBuf
        What the warp made of `buffer`, with black outside.
    buffer : oiio.ImageBuf
    data : Window
        The data window of the whole source.
    matrix : array of shape (3, 3)
        Scales and moves, nothing else.
    filter : str
    """
    ones, share = (oiio.ImageBuf(_one_channel(given.spec())) for given in (buffer, warped))
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


def _one_channel(spec: oiio.ImageSpec) -> oiio.ImageSpec:
    new = oiio.ImageSpec(spec)
    new.nchannels, new.channelnames = 1, ("Y",)
    new.alpha_channel = new.z_channel = -1
    new.set_format(oiio.FLOAT)
    return new


def require_filter(inverse: np.ndarray, filter: str, session: Session) -> None:
    """Refuse a reduction under which a filter looks at too many pixels, as `require_kernel` does.

    Parameters
    ----------
    inverse : array of shape (3, 3)
        From the result to the source. One that is no perspective: of those, no figure holds for all pixels.
    filter : str
        One of `FILTERS`.
    """
    if np.array_equal(inverse[:, 2], (0, 0, 1)):
        across, down = FILTERS[filter] * np.maximum(1, np.abs(inverse[:2, :2]).max(axis=0))
        require_kernel(math.ceil(across), math.ceil(down), session)


def forward_window(matrix: np.ndarray, window: Window) -> Window:
    """The smallest window around a warped one, computed in float as ImageBufAlgo::warp does."""
    m = matrix.astype(np.float32)
    corners = []
    for y in (np.float32(window.top) + np.float32(0.5), np.float32(window.bottom) - np.float32(0.5)):
        for x in (np.float32(window.left) + np.float32(0.5), np.float32(window.right) - np.float32(0.5)):
            a, b, w = (x * m[0, k] + y * m[1, k] + m[2, k] for k in range(3))
            corners.append((a / w, b / w))
    (left, top), (right, bottom) = np.min(corners, axis=0), np.max(corners, axis=0)
    if not np.all(np.isfinite((left, top, right, bottom))):
        raise ImageError("the result would have no end")
    return Window(math.floor(left), math.floor(top), math.floor(right) + 1, math.floor(bottom) + 1)


@dataclass(frozen=True, kw_only=True)
class Warped(HostOp, Gather):
    """Resampled through a matrix."""

    source: Image = image(help="the image")
    filter: str = param("", help="name of the filter; lanczos3 when left out")
    recompute_roi: bool = param(False, help="the data window becomes what the warped one covers")
    highlightcomp: bool = param(False, help="compress bright values meanwhile, so that they do not ring")

    def warped(self, part: Part, matrix: np.ndarray, wrap: str, session: Session) -> Part:
        """The part through a matrix, not yet computed.

        Parameters
        ----------
        part : Part
        matrix : array of shape (3, 3)
            From the source to the result, for row vectors (x, y, 1) in pixels.
        wrap : str
            What lies beyond the image: default (black), black, clamp, periodic or mirror.

        Raises
        ------
        ParameterError
            No such filter, or a matrix that has no inverse.
        ImageError
            The result's data window would have no end, or no pixel.
        """
        known_filter(self.filter)
        wide = FILTERS[self.filter or "lanczos3"]
        try:
            inverse = np.linalg.inv(matrix.astype(np.float32).astype(np.float64))
        except np.linalg.LinAlgError:
            raise ParameterError("a matrix that has an inverse is wanted") from None
        require_filter(inverse, self.filter or "lanczos3", session)
        data = part.window
        target = (forward_window(matrix, data) if self.recompute_roi else data).apply_to(part.spec)
        values = tuple(float(v) for v in matrix.astype(np.float32).ravel())

        def needs(window: Window) -> Sequence[Window]:
            wanted = warp_needs(inverse, window, wide, data)
            if wrap in ("periodic", "mirror") and wanted & data != wanted:
                return [data]  # what comes in from the other side may be anywhere
            return [wanted]

        def apply(spec: oiio.ImageSpec, buffer: oiio.ImageBuf) -> oiio.ImageBuf:
            def warp(buffer: oiio.ImageBuf) -> oiio.ImageBuf:
                roi = Window.data(spec).roi(spec.nchannels)
                return oiio.ImageBufAlgo.warp(buffer, values, self.filter, 0.0, False, wrap, roi)

            return compressed(warp, buffer) if self.highlightcomp else warp(buffer)

        return remapped(self, [part], target, needs, apply, session, scattered=True)


@dataclass(frozen=True, kw_only=True)
class Warp(Warped):
    """Warp by a 3x3 matrix."""

    name: ClassVar[str] = "warp"

    matrix: Numbers = argument(help="9 values with commas between them; it maps row vectors (x, y, 1)")
    wrap: str = param("default", choices=_WRAPS, help="what lies beyond the image; black by default")

    def result(self, parts: Sequence[Part], session: Session) -> Part:
        """The warped part, not yet computed."""
        if len(self.matrix) != 9:
            raise ParameterError(f"matrix={self.matrix}: 9 values are wanted")
        return self.warped(parts[0], np.array(self.matrix).reshape(3, 3), self.wrap, session)


@dataclass(frozen=True, kw_only=True)
class Rotate(Warped):
    """Rotate clockwise by an angle, about the centre of the display window."""

    name: ClassVar[str] = "rotate"

    angle: float = argument(unit="degrees", ge=-1e9, le=1e9, help="clockwise")
    center: Numbers | None = param(None, help="X,Y that stays; the centre of the display window when left out")

    def result(self, parts: Sequence[Part], session: Session) -> Part:
        """The rotated part, not yet computed."""
        display = Window.display(parts[0].spec)
        x, y = 0.5 * (display.left + display.right), 0.5 * (display.top + display.bottom)
        if self.center is not None:
            if len(self.center) != 2:
                raise ParameterError(f"center={self.center}: allowed is X,Y")
            x, y = self.center
        radians = float(np.float32(self.angle) * np.float32(math.pi / 180))
        return self.warped(parts[0], _rotation(radians, x, y), "black", session)


def _rotation(radians: float, x: float, y: float) -> np.ndarray:
    """The matrix of ImageBufAlgo::rotate, rounded as it rounds: a pixel more or less would be another window."""
    c, s = np.float32(math.cos(radians)), np.float32(math.sin(radians))
    turn = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]], np.float32)
    move = np.array([[1, 0, 0], [0, 1, 0], [-x, -y, 1]], np.float32)
    back = np.array([[1, 0, 0], [0, 1, 0], [x, y, 1]], np.float32)
    return _product(_product(move, turn), back)


def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Matrix product in float, terms added from the left."""
    return a[:, :1] * b[:1] + a[:, 1:2] * b[1:2] + a[:, 2:] * b[2:]


@dataclass(frozen=True, kw_only=True)
class STWarp(HostOp, Gather):
    """Warp by an image whose channels say where each pixel comes from, as shares of width and height."""

    name: ClassVar[str] = "st_warp"

    source: Image = image(help="the image")
    st: Image = image(help="the coordinates")
    filter: str = param("", help="name of the filter; lanczos3 when left out")
    chan_s: int = param(0, ge=0, help="channel that holds s")
    chan_t: int = param(1, ge=0, help="channel that holds t")
    flip_s: bool = param(False, help="s counts from the right")
    flip_t: bool = param(False, help="t counts from below")

    def result(self, parts: Sequence[Part], session: Session) -> Part:
        """The warped part, not yet computed: any of its windows may look at any place of the source."""
        source, st = worked(parts[0]), parts[1]
        known_filter(self.filter)
        for name, channel in (("chan_s", self.chan_s), ("chan_t", self.chan_t)):
            if channel >= st.spec.nchannels:
                raise ParameterError(f"{name}={channel}: the coordinates have {st.spec.nchannels} channel(s)")
        if (source.window & st.window).empty:
            raise ImageError("image and coordinates share no pixel")
        session.resources.require(source.spec.width * source.spec.height * source.pixel_bytes, self.flag())
        cached = once(source, lambda part: in_memory(part.name, part.buffer(part.window)))
        spec = derived_spec(source.spec)

        def fetch(window: Window) -> oiio.ImageBuf:
            whole = cached.buffer(cached.window)
            result = blank(window.apply_to(spec), whole)
            seen = window & st.window
            if not seen.empty:
                oiio.ImageBufAlgo.st_warp(
                    result, whole, st.buffer(seen), self.filter, 0.0, self.chan_s, self.chan_t, self.flip_s,
                    self.flip_t, seen.roi(spec.nchannels),
                )  # fmt: skip
            return checked(result)

        return Part(source.name, spec, fetch)


OPS: tuple[type[Op], ...] = (Warp, Rotate, STWarp)
