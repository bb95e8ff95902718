# SPDX-License-Identifier: Apache-2.0
"""Ops that draw on a copy of the image, and generators of new images."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, make_dataclass
from typing import Any, ClassVar, TypeAlias

from ...engine.core.access import AnyWindow, Pointwise
from ...engine.core.image import Image, Part, derived_spec, in_memory, type_named
from ...engine.core.op import Plan
from ...engine.core.parameters import Numbers, argument, image, nearest, param, parse_modifiers
from ...engine.core.window import Window
from ...engine.deferred import np, oiio
from ...engine.errors import ParameterError
from ...engine.session.facts import Facts
from .arithmetic import per_channel
from .geometry_text import Box, box_of, parse_box, parse_size
from .kinds import Hosted, HostOp, checked, fields_of, like, op, worked
from .remapping import require_kernel
from .spatial.filtering import kernel_of, kernel_size

Painter: TypeAlias = "Callable[[oiio.ImageBuf], Any]"

_POINTS = {"points": (str, argument(help="Pixel coordinates X1,Y1,X2,Y2,...", example="10,20,200,150"))}
_SIZE = argument(help="Data and display window: WxH or WxH+X+Y.", example="640x480")
_CHANNELS = argument(ge=1, le=1024, help="Number of channels.")
_FAR = 1 << 28  # coordinates beyond it overflow in OpenImageIO's line drawing


def _color(help: str, unset: str = "white") -> Any:
    return param(None, help=help, unset=unset, example="1,0.5,0")


def _color_of(given: Numbers | None, count: int) -> tuple[float, ...]:
    """One value for all channels, or one per channel; 1 for channels without a value."""
    return per_channel(given or (), count, 1.0)


def _gradient(corners: Sequence[Sequence[float]], region: Window, window: Window) -> np.ndarray:
    """A window of a region filled with a gradient, (height, width, channels), as ImageBufAlgo::fill fills all of it.

    `corners` are two colors (top, bottom) or four (top left, top right, bottom left, bottom right).
    """
    colors = [np.array(color, np.float32) for color in corners]
    y = np.arange(window.top - region.top, window.bottom - region.top).astype(np.float32)
    v = (y / np.float32(max(1, region.height - 1)))[:, None, None]
    if len(colors) == 2:
        rows = colors[0] * (np.float32(1) - v) + colors[1] * v
        return np.broadcast_to(rows, (window.height, window.width, rows.shape[2]))
    x = np.arange(window.left - region.left, window.right - region.left).astype(np.float32)
    u = (x / np.float32(max(1, region.width - 1)))[None, :, None]
    above = colors[0] * (np.float32(1) - u) + colors[1] * u
    below = colors[2] * (np.float32(1) - u) + colors[3] * u
    return (np.float32(1) - v) * above + v * below


@dataclass(frozen=True, kw_only=True)
class Colors:
    """Colors of a fill: one, or a gradient between two or four."""

    color: Numbers | None = param(None, help="Uniform color.", example="1,0.5,0")
    top: Numbers | None = param(None, help="Color at the top of a vertical gradient. Requires bottom.", example="0,0,1")
    bottom: Numbers | None = param(None, help="Color at the bottom. Requires top.", example="0,0,0")
    left: Numbers | None = param(None, help="Color at the left of a horizontal gradient. Requires right.", example="1")
    right: Numbers | None = param(None, help="Color at the right. Requires left.", example="0")
    topleft: Numbers | None = param(None, help="Corner color. Requires all four corners.", example="1,0,0")
    topright: Numbers | None = param(None, help="Corner color. Requires all four corners.", example="0,1,0")
    bottomleft: Numbers | None = param(None, help="Corner color. Requires all four corners.", example="0,0,1")
    bottomright: Numbers | None = param(None, help="Corner color. Requires all four corners.", example="0,0,0")

    def corners(self, count: int) -> tuple[tuple[float, ...], ...]:
        """Colors of `count` channels: one, two (top, bottom) or four; none if a gradient is incomplete."""
        corners = ("topleft", "topright", "bottomleft", "bottomright")
        for names in (corners, ("top", "bottom"), ("left", "right"), ("color",)):
            given = [getattr(self, name) for name in names]
            if None not in given:
                colors = tuple(_color_of(each, count) for each in given)
                return colors * 2 if names == ("left", "right") else colors
        return ()

    def paint(self, buffer: oiio.ImageBuf, spec: oiio.ImageSpec) -> None:
        """Fill a window of an image with this spec."""
        if colors := self.corners(spec.nchannels):
            _fill(buffer, colors, Window.data(spec))


@dataclass(frozen=True, kw_only=True)
class Drawn(HostOp, Pointwise):
    """Draws at absolute coordinates: its function gets a buffer and the spec of the whole image."""

    keeps: ClassVar[bool] = True
    untiles: ClassVar[bool] = True

    source: Image = image(help="Input image.")

    def draw(self, buffer: oiio.ImageBuf, spec: oiio.ImageSpec) -> None:
        """Draw on a window of an image with this spec, by the function."""
        self.called(buffer, spec)

    def result(self, parts: Sequence[Part], facts: Facts) -> Part:
        """The drawing, not yet computed."""
        part = worked(parts[0])
        spec = part.window.apply_to(derived_spec(part.spec))

        def fetch(window: Window) -> oiio.ImageBuf:
            buffer = part.buffer(window).copy()
            self.draw(buffer, spec)
            return checked(buffer)

        self.draw(oiio.ImageBuf(Window.sized(spec.x, spec.y, 1, 1).apply_to(spec)), spec)  # reports wrong arguments
        return Part(part.name, spec, fetch)


def _coordinates(text: str, least: int, step: int) -> list[int]:
    try:
        coordinates = [int(word) for word in text.split(",")]
    except ValueError:
        coordinates = []
    if len(coordinates) < least or len(coordinates) % step or any(abs(n) > _FAR for n in coordinates):
        raise ParameterError(f"'{text}'", expected="comma-separated integers, X,Y for each point")
    return coordinates


def _with_alpha(buffer: oiio.ImageBuf, alpha: float, draw: Callable[[oiio.ImageBuf], object]) -> None:
    """Draw with an alpha, also on a buffer without one: ImageBufAlgo's Python functions take one value per channel."""
    spec = buffer.spec()
    if spec.alpha_channel >= 0 or alpha == 1:
        draw(buffer)
        return
    names = (*spec.channelnames, "alpha.A" if "A" in spec.channelnames else "A")
    copy = oiio.ImageBuf(like(spec, nchannels=len(names), channelnames=names, alpha_channel=spec.nchannels))
    oiio.ImageBufAlgo.paste(copy, 0, 0, 0, 0, buffer)
    draw(copy)
    oiio.ImageBufAlgo.paste(buffer, 0, 0, 0, 0, checked(copy))


@dataclass(frozen=True, kw_only=True)
class Colored(Drawn):
    """Draws in one color."""

    color: Numbers | None = _color("One value for all channels, or one per channel and a further one for alpha.")


def _box(buffer: oiio.ImageBuf, spec: oiio.ImageSpec, corners: str, fill: bool, color: Numbers | None) -> None:
    """The visible part of the box."""
    x1, y1, x2, y2 = _coordinates(corners, 4, 4)
    values = _color_of(color, spec.nchannels + 1)
    if fill and (Window(x1, y1, x2 + 1, y2 + 1) & Window.data(buffer.spec())).empty:
        return
    _with_alpha(buffer, values[-1], lambda b: oiio.ImageBufAlgo.render_box(b, x1, y1, x2, y2, values, fill))


def _line(buffer: oiio.ImageBuf, spec: oiio.ImageSpec, text: str, color: Numbers | None) -> None:
    """The lines; a shared end point is drawn once."""
    points = _coordinates(text, 4, 2)
    values = _color_of(color, spec.nchannels + 1)
    closed = len(points) > 4 and points[:2] == points[-2:]

    def lines(b: oiio.ImageBuf) -> None:
        for n in range(0, len(points) - 3, 2):
            x1, y1, x2, y2 = points[n : n + 4]
            oiio.ImageBufAlgo.render_line(b, x1, y1, x2, y2, values, closed or n > 0)

    _with_alpha(buffer, values[-1], lines)


def _point(buffer: oiio.ImageBuf, spec: oiio.ImageSpec, text: str, color: Numbers | None) -> None:
    """The visible points."""
    points = _coordinates(text, 2, 2)
    seen = Window.data(buffer.spec())
    for x, y in zip(points[::2], points[1::2], strict=True):
        if not (Window.sized(x, y, 1, 1) & seen).empty:
            oiio.ImageBufAlgo.render_point(buffer, x, y, _color_of(color, spec.nchannels))


@dataclass(frozen=True, kw_only=True)
class Text(Colored):
    """Draw text."""

    name: ClassVar[str] = "text"

    text: str = argument(help="Text to draw.", example="draft")
    x: int | None = param(None, unit="px", unset="center of the data window", example="20", help="Horizontal position.")
    y: int | None = param(None, unit="px", unset="center of the data window", example="40", help="Vertical position.")
    size: int = param(16, ge=1, le=4096, unit="px", help="Font size.")
    font: str = param("", unset="DroidSans", example="DejaVuSans", help="Name or file of the font.")
    xalign: str = param("left", choices=("left", "l", "center", "c", "right", "r"), help="Part of the text at x.")
    yalign: str = param(
        "base", choices=("base", "baseline", "top", "t", "center", "c", "bottom", "b"), help="Part of the text at y."
    )
    shadow: int = param(0, ge=0, le=256, unit="px", help="Width of the dark outline.")
    render: bool = param(True, help="Draw the text. Set to 0 to only measure it.", advanced=True)
    measure: bool = param(False, help="Set TEXT_X, TEXT_Y, TEXT_WIDTH and TEXT_HEIGHT to its extent.", advanced=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        trial = oiio.ImageBuf(oiio.ImageSpec(1, 1, 1, oiio.UINT8))
        oiio.ImageBufAlgo.render_text(trial, 0, 0, "", self.size, self.font)
        checked(trial)  # `text_size` would print errors about a font itself

    def user_variables(self) -> dict[str, int | float | str]:
        """The bounding box of the text at (0, 0), with `measure`."""
        if not self.measure:
            return {}
        roi = oiio.ImageBufAlgo.text_size(self.text, self.size, self.font)
        return {"TEXT_X": roi.xbegin, "TEXT_Y": roi.ybegin, "TEXT_WIDTH": roi.width, "TEXT_HEIGHT": roi.height}

    def draw(self, buffer: oiio.ImageBuf, spec: oiio.ImageSpec) -> None:
        """The visible part of the text."""
        x = self.x if self.x is not None else spec.x + spec.width // 2
        y = self.y if self.y is not None else spec.y + spec.height // 2
        if not self.render or (self._there(x, y) & Window.data(buffer.spec())).empty:
            return
        color = _color_of(self.color, spec.nchannels + 1)
        # a fourth value is alpha only for images of three channels
        alpha = color[3] if spec.nchannels == 3 else 1.0
        colors = (*color[: spec.nchannels], alpha)
        if spec.alpha_channel < 0 and spec.nchannels == 4:
            alpha = 0.0  # any that is not 1: the function would take the fourth channel for alpha
            colors = (*color[:4], 1.0)

        def write(b: oiio.ImageBuf) -> None:
            oiio.ImageBufAlgo.render_text(
                b, x, y, self.text, self.size, self.font, colors, self.xalign, self.yalign, self.shadow
            )

        _with_alpha(buffer, alpha, write)

    def _there(self, x: int, y: int) -> Window:
        """The window that the text covers."""
        roi = oiio.ImageBufAlgo.text_size(self.text, self.size, self.font)
        if roi.xbegin > roi.xend:
            return Window(0, 0, 0, 0)
        x -= {"r": roi.width, "c": roi.width // 2 + roi.xbegin}.get(self.xalign[0], 0)
        y -= {"t": roi.ybegin, "c": roi.height // 2 + roi.ybegin}.get(self.yalign[0], 0)
        y -= roi.yend if self.yalign in ("bottom", "b") else 0
        return Window(roi.xbegin, roi.ybegin, roi.xend, roi.yend).shifted(x, y).grown(self.shadow + 1)


@dataclass(frozen=True, kw_only=True)
class Fill(Colors, Drawn):
    """Fill a region with a color or a gradient."""

    name: ClassVar[str] = "fill"
    keeps: ClassVar[bool] = False

    size: str = argument(help="Region to fill: WxH+X+Y, X0,Y0,X1,Y1, WxH or +X+Y.", example="640x480+10+20")
    color: Numbers | None = _color("Uniform color.", "white, without a gradient")

    def draw(self, buffer: oiio.ImageBuf, spec: oiio.ImageSpec) -> None:
        """The visible part of the region."""
        whole = Window.data(spec)
        region = parse_box(self.size, box_of(whole), scaling=True).window() & whole
        _fill(buffer, self.corners(spec.nchannels) or ((1.0,) * spec.nchannels,), region)


def _fill(buffer: oiio.ImageBuf, colors: Sequence[Sequence[float]], region: Window) -> None:
    """Fill the part of a region that a buffer holds with one color, or a gradient between two or four."""
    seen = region & Window.data(buffer.spec())
    if seen.empty:
        return
    roi = seen.roi(buffer.nchannels)
    if len(colors) == 1:
        oiio.ImageBufAlgo.fill(buffer, colors[0], roi)
    else:
        buffer.set_pixels(roi, np.ascontiguousarray(_gradient(colors, region, seen)))


DRAWING = (
    op("box", "Draw a rectangle.", Colored, _box,
       corners=(str, argument(help="Two opposite corners X1,Y1,X2,Y2, both included.", example="10,20,200,150")),
       fill=param(False, help="Fill the rectangle instead of drawing its outline.")),
    op("line", "Draw a polyline.", Colored, _line, **_POINTS),
    op("point", "Draw single pixels.", Drawn, _point, **_POINTS,
       color=(Numbers | None, _color("One value for all channels, or one per channel."))),
    Text,
    Fill,
)  # fmt: skip


# --- generators ---


@dataclass(frozen=True, kw_only=True)
class NewImage(Hosted, AnyWindow):
    """A new image."""

    size: str = _SIZE
    channels: int = _CHANNELS
    type: str = param("float", help="Pixel type, such as uint8, uint16, half or float.", example="half")

    def painter(self, spec: oiio.ImageSpec) -> Painter:
        """A function that paints a window of the image, which is black before; here it does nothing."""
        return lambda buffer: None

    def plan(self, facts: Facts) -> Plan:
        """The image, not yet computed; data and display window are the same."""
        window = parse_box(self.size, Box(0, 0, 64, 64)).window()
        if window.empty:
            raise ParameterError(parameter="size", value=self.size, expected="at least one pixel")
        spec = window.apply_to(oiio.ImageSpec(1, 1, self.channels, type_named(self.type)))
        window.show_in(spec)
        paint = self.painter(spec)

        def fetch(window: Window) -> oiio.ImageBuf:
            buffer = oiio.ImageBuf(window.apply_to(spec))
            paint(buffer)
            return checked(buffer)

        return Plan(Image((Part("part0", spec, fetch, ready=True),), "new"))


def _paint_checker(use: Any, buffer: oiio.ImageBuf, spec: oiio.ImageSpec) -> None:
    """A checkerboard."""
    dark = (0.0,) * spec.nchannels if use.color1 is None else _color_of(use.color1, spec.nchannels)
    light = _color_of(use.color2, spec.nchannels)
    oiio.ImageBufAlgo.checker(buffer, use.width, use.height or use.width, use.depth, dark, light)


def _paint_noise(use: Any, buffer: oiio.ImageBuf, spec: oiio.ImageSpec) -> None:
    """Random values that depend only on the seed and the pixel's coordinates."""
    values = {"gaussian": (use.mean, use.stddev), "salt": (use.value, use.portion)}
    a, b = values.get(use.type, (use.min, use.max))
    oiio.ImageBufAlgo.noise(buffer, use.type, a, b, use.mono, use.seed)


def _pattern(paint: Callable[..., object], **members: Any) -> type[Any]:
    """The options of a pattern. `paint` gets the options, a buffer and the spec of the whole image."""
    return make_dataclass("Options", fields_of(members), namespace={"paint": paint}, frozen=True, kw_only=True)


_KINDS = {
    "black": _pattern(lambda use, buffer, spec: None),
    "constant": _pattern(
        lambda use, buffer, spec: oiio.ImageBufAlgo.fill(buffer, _color_of(use.color, spec.nchannels)),
        color=(Numbers | None, _color("One value for all channels, or one per channel."))),
    "fill": Colors,
    "checker": _pattern(
        _paint_checker,
        width=param(8, ge=1, unit="px", help="Width of a square."),
        height=(int | None, param(None, ge=1, unit="px", unset="width", help="Height of a square.")),
        depth=param(1, ge=1, unit="px", help="Depth of a cube. Accepted for oiiotool compatibility."),
        color1=(Numbers | None, _color("Color of the first square.", "black")),
        color2=(Numbers | None, _color("Color of the second square."))),
    "noise": _pattern(
        _paint_noise,
        type=param("gaussian", choices=("gaussian", "white", "uniform", "blue", "salt"), help="Noise distribution."),
        mean=param(0.5, help="Mean of gaussian noise."),
        stddev=param(0.1, help="Standard deviation of gaussian noise."),
        min=param(0.5, help="Minimum of white, uniform or blue noise."),
        max=param(1.0, help="Maximum of white, uniform or blue noise."),
        value=param(0.01, help="Value of the pixels that salt noise replaces."),
        portion=param(0.0, help="Fraction of the pixels that salt noise replaces."),
        mono=param(False, help="Use the same noise in all channels."),
        seed=param(0, help="Seed of the random numbers.")),
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Pattern(NewImage):
    """Create an image with a pattern."""

    name: ClassVar[str] = "pattern"

    pattern: str = argument(
        help="Pattern: black, constant, fill, checker or noise, with options.", example="checker:width=16"
    )
    size: str = _SIZE
    channels: int = _CHANNELS

    def painter(self, spec: oiio.ImageSpec) -> Painter:
        """The pattern's painter, with the options in the argument."""
        name, *words = self.pattern.split(":")
        kind = _KINDS.get(name.lower())
        if kind is None:
            raise ParameterError(f"unknown pattern '{name}'{nearest(name, _KINDS)}", expected=", ".join(_KINDS))
        pairs = [word.partition("=") for word in words]
        if not all(equals for _, equals, _ in pairs):
            raise ParameterError(f"'{self.pattern}'", expected="options as NAME=VALUE")
        options = kind(**parse_modifiers(kind, {key: value.strip("\"'") for key, _, value in pairs}))
        return lambda buffer: options.paint(buffer, spec)


@dataclass(frozen=True, kw_only=True)
class Kernel(Hosted, AnyWindow):
    """Create a convolution kernel, centered at the origin."""

    name: ClassVar[str] = "kernel"
    kernel: str = argument(help="Kernel, such as gaussian, box, binomial or laplacian.", example="gaussian")
    size: str = argument(help="Width and height WxH, in integer or fractional pixels.", example="5x5")

    def plan(self, facts: Facts) -> Plan:
        """The kernel; its values sum to 1."""
        require_kernel(*kernel_size(self.kernel, *parse_size(self.size)), facts)
        return Plan(Image((in_memory("kernel", kernel_of(self.kernel, *parse_size(self.size))),), "kernel"))


PATTERNS = (op("create", "Create a black image.", NewImage), Pattern, Kernel)
