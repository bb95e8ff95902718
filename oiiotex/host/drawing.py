# SPDX-License-Identifier: Apache-2.0
"""Ops that draw on a copy of the image."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar

from ..core.access import Pointwise
from ..core.image import Image, Part, derived_spec
from ..core.op import Op
from ..core.parameters import Numbers, argument, image, param
from ..core.window import Window
from ..deferred import np, oiio
from ..errors import ParameterError
from ..session import Session
from .arithmetic import per_channel
from .geometry_text import box_of, parse_box
from .kinds import HostOp, checked, worked

_FAR = 1 << 28  # coordinates beyond it overflow where lines are drawn


def colour_of(given: Numbers | None, count: int) -> tuple[float, ...]:
    """One value for all channels, or one for each; 1 for those that get none."""
    return per_channel(given or (), count, 1.0)


def gradient(corners: Sequence[Sequence[float]], region: Window, window: Window) -> np.ndarray:
    """A window of a region filled between colours, computed as ImageBufAlgo::fill does over the whole region.

    Parameters
    ----------
    corners : two colours (top, bottom) or four (top left, top right, bottom left, bottom right)
    region, window : Window

    Returns
    -------
    array of float32, (height, width, channels)
    """
    colours = [np.array(colour, np.float32) for colour in corners]
    y = np.arange(window.top - region.top, window.bottom - region.top).astype(np.float32)
    v = (y / np.float32(max(1, region.height - 1)))[:, None, None]
    if len(colours) == 2:
        rows = colours[0] * (np.float32(1) - v) + colours[1] * v
        return np.broadcast_to(rows, (window.height, window.width, rows.shape[2]))
    x = np.arange(window.left - region.left, window.right - region.left).astype(np.float32)
    u = (x / np.float32(max(1, region.width - 1)))[None, :, None]
    above = colours[0] * (np.float32(1) - u) + colours[1] * u
    below = colours[2] * (np.float32(1) - u) + colours[3] * u
    return (np.float32(1) - v) * above + v * below


@dataclass(frozen=True, kw_only=True)
class Colours:
    """Of a fill: one, or between two or four."""

    color: Numbers | None = param(None, help="of all")
    top: Numbers | None = param(None, help="with bottom")
    bottom: Numbers | None = param(None, help="with top")
    left: Numbers | None = param(None, help="with right")
    right: Numbers | None = param(None, help="with left")
    topleft: Numbers | None = param(None, help="with the other corners")
    topright: Numbers | None = param(None, help="with the other corners")
    bottomleft: Numbers | None = param(None, help="with the other corners")
    bottomright: Numbers | None = param(None, help="with the other corners")

    def corners(self, count: int) -> tuple[tuple[float, ...], ...]:
        """Colours of so many channels: one, two (top, bottom) or four; none where too few are given."""
        names = ("topleft", "topright", "bottomleft", "bottomright")
        for wanted in (names, ("top", "bottom"), ("left", "right"), ("color",)):
            given = [getattr(self, name) for name in wanted]
            if None not in given:
                colours = tuple(colour_of(each, count) for each in given)
                return colours * 2 if wanted == ("left", "right") else colours
        return ()


@dataclass(frozen=True, kw_only=True)
class Drawn(HostOp, Pointwise):
    """The image with something drawn on it, at absolute coordinates."""

    keeps: ClassVar[bool] = True

    source: Image = image(help="the image")

    def draw(self, buffer: oiio.ImageBuf, spec: oiio.ImageSpec) -> None:
        """Draw on a window of an image of that spec."""
        raise NotImplementedError

    def result(self, parts: Sequence[Part], session: Session) -> Part:
        """The drawing, not yet computed."""
        part = worked(parts[0])
        spec = part.window.apply_to(derived_spec(part.spec))

        def fetch(window: Window) -> oiio.ImageBuf:
            buffer = part.buffer(window).copy()
            self.draw(buffer, spec)
            return checked(buffer)

        self.draw(oiio.ImageBuf(Window.sized(spec.x, spec.y, 1, 1).apply_to(spec)), spec)  # what is wrong shows now
        return Part(part.name, spec, fetch)


def _coordinates(text: str, least: int, step: int) -> list[int]:
    try:
        coordinates = [int(word) for word in text.split(",")]
    except ValueError:
        coordinates = []
    if len(coordinates) < least or len(coordinates) % step or any(abs(n) > _FAR for n in coordinates):
        raise ParameterError(f"'{text}': whole numbers with commas between them are wanted, X,Y for each point")
    return coordinates


def _with_alpha(buffer: oiio.ImageBuf, alpha: float, draw: Callable[[oiio.ImageBuf], object]) -> None:
    """Draw with an alpha on what may have none: ImageBufAlgo's Python functions take no more values than channels."""
    spec = buffer.spec()
    if spec.alpha_channel >= 0 or alpha == 1:
        draw(buffer)
        return
    wider = oiio.ImageSpec(spec)
    wider.nchannels = wider.nchannels + 1
    wider.channelnames = (*spec.channelnames, "A" if "A" not in spec.channelnames else "alpha.A")
    wider.alpha_channel = spec.nchannels
    copy = oiio.ImageBuf(wider)
    oiio.ImageBufAlgo.paste(copy, 0, 0, 0, 0, buffer)
    draw(copy)
    oiio.ImageBufAlgo.paste(buffer, 0, 0, 0, 0, checked(copy))


@dataclass(frozen=True, kw_only=True)
class Coloured(Drawn):
    """Drawn in a colour."""

    color: Numbers | None = param(None, help="one value for all channels, or one for each and one more for alpha")


@dataclass(frozen=True, kw_only=True)
class Box(Coloured):
    """Draw a box."""

    name: ClassVar[str] = "box"

    corners: str = argument(help="X1,Y1,X2,Y2: two opposite corners, both inside")
    fill: bool = param(False, help="filled")

    def draw(self, buffer: oiio.ImageBuf, spec: oiio.ImageSpec) -> None:
        """The box, as far as it is seen."""
        x1, y1, x2, y2 = _coordinates(self.corners, 4, 4)
        colour = colour_of(self.color, spec.nchannels + 1)
        if self.fill and (Window(x1, y1, x2 + 1, y2 + 1) & Window.data(buffer.spec())).empty:
            return
        _with_alpha(buffer, colour[-1], lambda b: oiio.ImageBufAlgo.render_box(b, x1, y1, x2, y2, colour, self.fill))


@dataclass(frozen=True, kw_only=True)
class Line(Coloured):
    """Draw lines from point to point."""

    name: ClassVar[str] = "line"

    points: str = argument(help="X1,Y1,X2,Y2,...")

    def draw(self, buffer: oiio.ImageBuf, spec: oiio.ImageSpec) -> None:
        """The lines; a point that two share is drawn once."""
        points = _coordinates(self.points, 4, 2)
        colour = colour_of(self.color, spec.nchannels + 1)
        closed = len(points) > 4 and points[:2] == points[-2:]

        def lines(b: oiio.ImageBuf) -> None:
            for n in range(0, len(points) - 3, 2):
                x1, y1, x2, y2 = points[n : n + 4]
                oiio.ImageBufAlgo.render_line(b, x1, y1, x2, y2, colour, closed or n > 0)

        _with_alpha(buffer, colour[-1], lines)


@dataclass(frozen=True, kw_only=True)
class Point(Drawn):
    """Draw points."""

    name: ClassVar[str] = "point"

    points: str = argument(help="X1,Y1,X2,Y2,...")
    color: Numbers | None = param(None, help="one value for all channels, or one for each")

    def draw(self, buffer: oiio.ImageBuf, spec: oiio.ImageSpec) -> None:
        """The points that are seen."""
        points = _coordinates(self.points, 2, 2)
        colour = colour_of(self.color, spec.nchannels)
        seen = Window.data(buffer.spec())
        for x, y in zip(points[::2], points[1::2], strict=True):
            if seen.left <= x < seen.right and seen.top <= y < seen.bottom:
                oiio.ImageBufAlgo.render_point(buffer, x, y, colour)


@dataclass(frozen=True, kw_only=True)
class Text(Coloured):
    """Write text."""

    name: ClassVar[str] = "text"

    text: str = argument(help="the text")
    x: int | None = param(None, unit="px", help="where it starts; the middle of the data window when left out")
    y: int | None = param(None, unit="px", help="its baseline; the middle of the data window when left out")
    size: int = param(16, ge=1, le=4096, unit="px", help="height")
    font: str = param("", help="name or file of the font; DroidSans when left out")
    xalign: str = param("left", choices=("left", "l", "center", "c", "right", "r"), help="what of the text is at x")
    yalign: str = param(
        "base", choices=("base", "baseline", "top", "t", "center", "c", "bottom", "b"), help="what of the text is at y"
    )
    shadow: int = param(0, ge=0, le=256, unit="px", help="width of a dark rim")
    render: bool = param(True, help="draw it; else nothing happens")
    measure: bool = param(False, help="set the variables TEXT_X, TEXT_Y, TEXT_WIDTH and TEXT_HEIGHT to its box")

    def __post_init__(self) -> None:
        super().__post_init__()
        trial = oiio.ImageBuf(oiio.ImageSpec(1, 1, 1, oiio.UINT8))
        oiio.ImageBufAlgo.render_text(trial, 0, 0, "", self.size, self.font)
        checked(trial)  # `text_size` would print of its own accord what is wrong with a font

    def facts(self) -> dict[str, int | float | str]:
        """The box of the text around (0, 0), where it is asked for."""
        if not self.measure:
            return {}
        roi = oiio.ImageBufAlgo.text_size(self.text, self.size, self.font)
        return {"TEXT_X": roi.xbegin, "TEXT_Y": roi.ybegin, "TEXT_WIDTH": roi.width, "TEXT_HEIGHT": roi.height}

    def draw(self, buffer: oiio.ImageBuf, spec: oiio.ImageSpec) -> None:
        """What is seen of the text."""
        x = self.x if self.x is not None else spec.x + spec.width // 2
        y = self.y if self.y is not None else spec.y + spec.height // 2
        if not self.render or (self._there(x, y) & Window.data(buffer.spec())).empty:
            return
        colour = colour_of(self.color, spec.nchannels + 1)
        # a fourth value is alpha where there are three channels, and else none is
        alpha = colour[3] if spec.nchannels == 3 else 1.0
        colours = (*colour[: spec.nchannels], alpha)
        if spec.alpha_channel < 0 and spec.nchannels == 4:
            alpha = 0.0  # any that is not 1: the function would take the fourth channel for alpha
            colours = (*colour[:4], 1.0)

        def write(b: oiio.ImageBuf) -> None:
            oiio.ImageBufAlgo.render_text(
                b, x, y, self.text, self.size, self.font, colours, self.xalign, self.yalign, self.shadow
            )

        _with_alpha(buffer, alpha, write)

    def _there(self, x: int, y: int) -> Window:
        """What the text covers."""
        roi = oiio.ImageBufAlgo.text_size(self.text, self.size, self.font)
        if roi.xbegin > roi.xend:
            return Window(0, 0, 0, 0)
        x -= {"r": roi.width, "c": roi.width // 2 + roi.xbegin}.get(self.xalign[0], 0)
        y -= {"t": roi.ybegin, "c": roi.height // 2 + roi.ybegin}.get(self.yalign[0], 0)
        y -= roi.yend if self.yalign in ("bottom", "b") else 0
        return Window(roi.xbegin, roi.ybegin, roi.xend, roi.yend).shifted(x, y).grown(self.shadow + 1)


@dataclass(frozen=True, kw_only=True)
class Fill(Colours, Drawn):
    """Fill a window with a colour, or between colours."""

    name: ClassVar[str] = "fill"
    keeps: ClassVar[bool] = False

    size: str = argument(help="what is filled: WxH+X+Y, X0,Y0,X1,Y1, WxH or +X+Y")
    color: Numbers | None = param(None, help="of all; white when no colour is given")

    def draw(self, buffer: oiio.ImageBuf, spec: oiio.ImageSpec) -> None:
        """What is seen of the window."""
        whole = Window.data(spec)
        region = parse_box(self.size, box_of(whole), scaling=True).window() & whole
        fill(buffer, self.corners(spec.nchannels) or ((1.0,) * spec.nchannels,), region)


def fill(buffer: oiio.ImageBuf, colours: Sequence[Sequence[float]], region: Window) -> None:
    """Fill what a buffer holds of a region with one colour, or between two or four."""
    seen = region & Window.data(buffer.spec())
    if seen.empty:
        return
    roi = seen.roi(buffer.nchannels)
    if len(colours) == 1:
        oiio.ImageBufAlgo.fill(buffer, colours[0], roi)
    else:
        buffer.set_pixels(roi, np.ascontiguousarray(gradient(colours, region, seen)))


OPS: tuple[type[Op], ...] = (Box, Line, Point, Text, Fill)
