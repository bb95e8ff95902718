# SPDX-License-Identifier: Apache-2.0
"""Images out of nothing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, TypeAlias

from ..core.access import AnyWindow
from ..core.image import Image, Part, in_memory, type_named
from ..core.op import Op
from ..core.parameters import Numbers, argument, nearest, param, parse_modifiers
from ..core.window import Window
from ..deferred import oiio
from ..errors import ParameterError
from ..session import Session
from .drawing import Colours, colour_of, fill
from .filtering import kernel_of, kernel_size
from .geometry_text import Box, parse_box, parse_size
from .kinds import Hosted, checked, require_kernel

Painter: TypeAlias = "Callable[[oiio.ImageBuf], Any]"


@dataclass(frozen=True, kw_only=True)
class NewImage(Hosted, AnyWindow):
    """A new image."""

    size: str = argument(help="WxH or WxH+X+Y")
    channels: int = argument(ge=1, le=1024, help="how many channels")
    type: str = param("float", help="pixel type: uint8, uint16, half, float ...")

    def spec(self) -> oiio.ImageSpec:
        """Data and display window the same."""
        window = parse_box(self.size, Box(0, 0, 64, 64)).window()
        if window.empty:
            raise ParameterError(f"size={self.size}: it needs one pixel at least")
        spec = oiio.ImageSpec(window.width, window.height, self.channels, type_named(self.type))
        spec.x, spec.y, spec.full_x, spec.full_y = window.left, window.top, window.left, window.top
        return spec

    def painter(self, spec: oiio.ImageSpec) -> Painter:
        """What paints a window of the image, which is black before."""
        raise NotImplementedError

    def compute(self, session: Session) -> Image:
        """The image, none of it computed yet."""
        spec = self.spec()
        paint = self.painter(spec)

        def fetch(window: Window) -> oiio.ImageBuf:
            buffer = oiio.ImageBuf(window.apply_to(spec))
            paint(buffer)
            return checked(buffer)

        return Image((Part("part0", spec, fetch, ready=True),), "new")


@dataclass(frozen=True, kw_only=True)
class Create(NewImage):
    """Create a black image."""

    name: ClassVar[str] = "create"

    def painter(self, spec: oiio.ImageSpec) -> Painter:
        """Nothing to paint."""
        return lambda buffer: None


@dataclass(frozen=True, kw_only=True)
class Black:
    """Black."""


@dataclass(frozen=True, kw_only=True)
class Constant:
    """One colour."""

    color: Numbers | None = param(None, help="one value for all channels, or one for each; white when left out")


@dataclass(frozen=True, kw_only=True)
class Checker:
    """A checkerboard."""

    width: int = param(8, ge=1, unit="px", help="of a square")
    height: int | None = param(None, ge=1, unit="px", help="of a square; the width when left out")
    depth: int = param(1, ge=1, unit="px", help="of a cube; images here have one slice")
    color1: Numbers | None = param(None, help="black when left out")
    color2: Numbers | None = param(None, help="white when left out")


@dataclass(frozen=True, kw_only=True)
class Noise:
    """Random values, the same wherever and whenever."""

    type: str = param("gaussian", choices=("gaussian", "white", "uniform", "blue", "salt"), help="its distribution")
    mean: float = param(0.5, help="gaussian")
    stddev: float = param(0.1, help="gaussian")
    min: float = param(0.5, help="white, uniform, blue")
    max: float = param(1.0, help="white, uniform, blue")
    value: float = param(0.01, help="salt")
    portion: float = param(0.0, help="salt: how many of the pixels")
    mono: bool = param(False, help="the same in all channels")
    seed: int = param(0, help="another one, other values")


_PATTERNS = {"black": Black, "constant": Constant, "fill": Colours, "checker": Checker, "noise": Noise}


@dataclass(frozen=True, kw_only=True)
class Pattern(NewImage):
    """Create an image with a pattern."""

    name: ClassVar[str] = "pattern"

    pattern: str = argument(help="black, constant, fill, checker or noise; options behind it: checker:width=16")
    size: str = argument(help="WxH or WxH+X+Y")
    channels: int = argument(ge=1, le=1024, help="how many channels")

    def options(self) -> Any:
        """The options in the pattern's word."""
        name, *words = self.pattern.split(":")
        kind = _PATTERNS.get(name.lower())
        if kind is None:
            raise ParameterError(f"no pattern '{name}'{nearest(name, _PATTERNS)}; there is {', '.join(_PATTERNS)}")
        pairs = [word.partition("=") for word in words]
        if not all(equals for _, equals, _ in pairs):
            raise ParameterError(f"'{self.pattern}': an option is NAME=VALUE")
        return kind(**parse_modifiers(kind, {key: value.strip("\"'") for key, _, value in pairs}))

    def painter(self, spec: oiio.ImageSpec) -> Painter:
        """By the pattern."""
        options, count, whole = self.options(), spec.nchannels, Window.data(spec)
        if isinstance(options, Constant):
            return lambda buffer: oiio.ImageBufAlgo.fill(buffer, colour_of(options.color, count))
        if isinstance(options, Colours):
            colours = options.corners(count)
            return lambda buffer: fill(buffer, colours, whole) if colours else None
        if isinstance(options, Checker):
            dark = colour_of(options.color1, count) if options.color1 is not None else (0.0,) * count
            size = (options.width, options.height or options.width, options.depth)
            return lambda buffer: oiio.ImageBufAlgo.checker(buffer, *size, dark, colour_of(options.color2, count))
        if isinstance(options, Noise):
            values = {"gaussian": (options.mean, options.stddev), "salt": (options.value, options.portion)}
            a, b = values.get(options.type, (options.min, options.max))
            return lambda buffer: oiio.ImageBufAlgo.noise(buffer, options.type, a, b, options.mono, options.seed)
        return lambda buffer: None


@dataclass(frozen=True, kw_only=True)
class Kernel(Hosted, AnyWindow):
    """Create a filter kernel, its middle at the origin."""

    name: ClassVar[str] = "kernel"

    kernel: str = argument(help="name of the kernel: gaussian, box, binomial, laplacian ...")
    size: str = argument(help="width x height: 5x5, 3.5x1")

    def compute(self, session: Session) -> Image:
        """The kernel; its values sum to 1."""
        width, height = parse_size(self.size)
        require_kernel(*kernel_size(self.kernel, width, height), session)
        return Image((in_memory("kernel", kernel_of(self.kernel, width, height)),), "kernel")


OPS: tuple[type[Op], ...] = (Create, Pattern, Kernel)
