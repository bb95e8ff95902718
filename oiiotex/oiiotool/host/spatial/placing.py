# SPDX-License-Identifier: Apache-2.0
"""Ops that move pixels without resampling: crop, cut, paste, mosaic, flips, quarter turns, shifts."""

from __future__ import annotations

import dataclasses
import functools
import operator
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from ....engine.core.access import Gather, ScanThenMap
from ....engine.core.demand import bands, cached, materialized, on_a_torus
from ....engine.core.image import IDS, Image, Part, copied, cropped, derived_spec, dtype_of, pixels_of
from ....engine.core.op import Plan
from ....engine.core.parameters import Size, argument, image, param
from ....engine.core.upright import Turn, orientation_of, upright
from ....engine.core.window import Window
from ....engine.deferred import np, oiio
from ....engine.errors import ImageError, ParameterError
from ....engine.session import Session
from ....engine.session.facts import Facts
from ..geometry_text import box_of, parse_box, parse_offset
from ..kinds import Hosted, HostOp, once, op, window_of
from ..remapping import require_pixels
from .scaling import Fit


@dataclass(frozen=True, kw_only=True)
class Cropped(HostOp, Gather):
    """Another data window, padded with black."""

    mixes: ClassVar[bool] = False
    deep: ClassVar[bool] = True

    source: Image = image(help="Input image.")

    def window(self, spec: oiio.ImageSpec) -> Window:
        """The new data window."""
        raise NotImplementedError

    def idle(self, parts: Sequence[Part]) -> bool:
        """Whether no data window changes."""
        return all(self.window(part.spec) == part.window for part in parts)

    def result(self, parts: Sequence[Part], facts: Facts) -> Part:
        """The crop, not yet computed."""
        part, window = parts[0], self.window(parts[0].spec)
        require_pixels(window)
        spec = window.apply_to(part.spec)
        if not part.spec.deep:
            return copied(spec, cropped(cached(part, facts.cache), window).fetch, part)

        def fetch(wanted: Window) -> oiio.ImageBuf:
            return oiio.ImageBufAlgo.crop(part.buffer(part.window), roi=wanted.roi(spec.nchannels))

        return Part(part.name, spec, fetch)


@dataclass(frozen=True, kw_only=True)
class Crop(Cropped):
    """Set the data window, cropping or padding with black."""

    name: ClassVar[str] = "crop"

    size: str = argument(help="Data window: WxH+X+Y, X0,Y0,X1,Y1, WxH or +X+Y.", example="640x480+10+20")

    def window(self, spec: oiio.ImageSpec) -> Window:
        """The given window; missing numbers are those of the data window."""
        return parse_box(self.size, box_of(Window.data(spec))).window()


@dataclass(frozen=True, kw_only=True)
class Cut(Crop):
    """Cut out a region and move it to the origin."""

    name: ClassVar[str] = "cut"
    untiles: ClassVar[bool] = True

    def idle(self, parts: Sequence[Part]) -> bool:
        """Never: the display window changes."""
        return False

    def result(self, parts: Sequence[Part], facts: Facts) -> Part:
        """The cut, not yet computed."""
        cut = super().result(parts, facts)
        return cut.respecced(_begin_at_origin)


def _begin_at_origin(spec: oiio.ImageSpec) -> None:
    """Move the data window to the origin, and the display window onto it."""
    spec.x = spec.y = 0
    Window.data(spec).show_in(spec)


@dataclass(frozen=True, kw_only=True)
class Trim(Hosted, ScanThenMap):
    """Crop all parts to the smallest window that contains every nonzero pixel."""

    name: ClassVar[str] = "trim"
    deep: ClassVar[bool] = True

    source: Image = image(help="Input image.")

    def plan(self, facts: Facts) -> Plan:
        """The window depends on the pixels."""
        return Plan()

    def make(self, plan: Plan, session: Session) -> Image:
        """One data window for all parts, as many programs expect in a file."""
        nonzero = [window for part in self.source.parts for window in _nonzero(part)]
        first_pixel = Window.sized(*self.source.first.window[:2], 1, 1)  # of an image that is zero everywhere
        window = functools.reduce(operator.or_, nonzero or [first_pixel])
        crop = Crop(source=self.source, size=str(window), allsubimages=True)
        return crop.of_parts(session.resources, crop.result)


def _nonzero(part: Part) -> Iterator[Window]:
    """Windows around the nonzero pixels."""
    for band in (part.window,) if part.spec.deep else bands(part):
        roi = oiio.ImageBufAlgo.nonzero_region(part.buffer(band))
        if roi.npixels:
            yield window_of(roi)


def _pasted(spec: oiio.ImageSpec, placed: Sequence[tuple[Part, int, int]]) -> Part:
    """Parts pasted onto black, later ones over earlier ones, each moved by (x, y).

    Parts of one type keep their bits; others are converted to the type of `spec`.
    """
    parts = [part for part, _, _ in placed]
    kinds = {str(part.spec.format) for part in parts}
    if len(kinds) == 1:
        spec.set_format(parts[0].spec.format)
    elif kinds & set(IDS):
        raise ImageError(f"ids cannot be combined with pixels of another type ({', '.join(sorted(kinds))})",
                         hint="read all images with -i:type=uint, or all with -i:type=float")  # fmt: skip

    def fetch(window: Window) -> np.ndarray:
        out = np.zeros((window.height, window.width, spec.nchannels), dtype_of(spec))
        for part, x, y in placed:
            seen = window.shifted(-x, -y) & part.window
            if not seen.empty:
                channels = min(spec.nchannels, part.spec.nchannels)
                out[seen.shifted(x, y).inside(window)][..., :channels] = _typed(part, seen, spec)[..., :channels]
        return out

    return copied(spec, fetch, *parts)


def _typed(part: Part, window: Window, spec: oiio.ImageSpec) -> np.ndarray:
    """Pixels of a window in the type of `spec`."""
    if part.spec.format == spec.format:
        return part.read(window)
    return pixels_of(part.buffer(window), spec.format)


@dataclass(frozen=True, kw_only=True)
class Paste(Hosted, Gather):
    """Paste the second image from the top of the stack over the top image."""

    name: ClassVar[str] = "paste"

    sources: tuple[Image, ...] = image(help="Images from front to back; the last one is the background.")
    position: str = argument(
        help="Offset +X+Y of the pasted image. - or auto: its data window as it is.", example="+100+50"
    )
    mergeroi: bool = param(False, help="Grow the windows to contain all images; otherwise keep the background's.")
    all: bool = param(False, help="Paste all images of the stack over the top image.")

    @classmethod
    def arity(cls, values: dict[str, Any], depth: int) -> int:
        """Two, or all."""
        return max(2, depth) if values.get("all") else 2

    def plan(self, facts: Facts) -> Plan:
        """The others pasted over the background, back to front."""
        x, y = (0, 0) if self.position in ("-", "auto") else parse_offset(self.position)
        back, *others = [given.first for given in reversed(self.sources)]
        around = [back, *(others if self.mergeroi else ())]
        whole = functools.reduce(operator.or_, (part.window for part in around))
        display = functools.reduce(operator.or_, (Window.display(part.spec) for part in around))
        spec = whole.apply_to(derived_spec(back.spec))
        spec.set_format(back.working_type)
        display.show_in(spec)
        placed = [(back, 0, 0), *((part, x, y) for part in others)]
        return Plan(Image((_pasted(spec, placed),), self.sources[-1].source))


@dataclass(frozen=True, kw_only=True)
class Mosaic(Hosted, Gather):
    """Assemble images into a mosaic of rows and columns; empty cells are black."""

    name: ClassVar[str] = "mosaic"

    sources: tuple[Image, ...] = image(help="Images, row by row.")
    size: Size = argument(ge=1, help="Number of columns and rows.", example="3x2")
    pad: int = param(0, ge=0, unit="px", help="Black space between the images.")
    fit: Size | None = param(
        None, ge=1, help="Size of a cell. Each image is resized to fit, and padded.", example="256x256"
    )

    @classmethod
    def arity(cls, values: dict[str, Any], depth: int) -> int:
        """One image per cell, at most all on the stack; at least one."""
        size = values.get("size")
        return max(1, depth if size is None else min(size[0] * size[1], depth))

    def plan(self, facts: Facts) -> Plan:
        """The mosaic."""
        columns, rows = self.size
        if len(self.sources) > columns * rows:
            expected = f"at least {len(self.sources)} cells, one per image"
            raise ParameterError(parameter="size", value=self.size, expected=expected)
        parts = [given.first for given in self.sources]
        blanks = [oiio.TypeDesc(oiio.UINT8)] * (len(parts) < columns * rows)
        types = [*blanks, *(part.working_type for part in reversed(parts))]
        samples = [oiio.ImageBuf(oiio.ImageSpec(1, 1, 1, each)) for each in types]
        format = functools.reduce(oiio.ImageBufAlgo.channel_append, samples).spec().format  # holds all types
        channels = max(part.spec.nchannels for part in parts)
        wide, high = max(p.spec.full_width for p in parts), max(p.spec.full_height for p in parts)
        if self.fit:
            wide, high = self.fit
            fits = [Fit(source=given, size=str(self.fit), pad=True, allsubimages=False) for given in self.sources]
            parts = [fit.of_parts(facts, fit.result).first for fit in fits]
        across, down = wide + self.pad, high + self.pad
        whole = Window(0, 0, columns * across - self.pad, rows * down - self.pad)
        spec = whole.apply_to(oiio.ImageSpec(1, 1, channels, format))
        whole.show_in(spec)
        placed = [(part, n % columns * across, n // columns * down) for n, part in enumerate(parts)]
        return Plan(Image((dataclasses.replace(_pasted(spec, placed), name="mosaic"),), "mosaic"))


CROPPING = (
    Crop,
    op("croptofull", "Crop or pad to the display window.", Cropped, window=lambda use, spec: Window.display(spec)),
    Cut,
    Trim,
    Paste,
    Mosaic,
)


# --- flips, quarter turns and shifts ---


@dataclass(frozen=True, kw_only=True)
class Turned(HostOp, Gather):
    """Rows and columns swapped, or not, then mirrored within the display window."""

    mixes: ClassVar[bool] = False
    swaps: ClassVar[bool] = False
    mirrors: ClassVar[tuple[bool, bool]] = (False, False)  # columns, rows

    source: Image = image(help="Input image.")

    def turn(self, spec: oiio.ImageSpec) -> Turn:
        """The turn of an image: a rotation keeps the display window's corner, a transposition swaps its x and y."""
        shown = Window.display(spec)
        (x, y), size = shown[:2], shown.size[::-1] if self.swaps else shown.size
        corner = (x, y) if any(self.mirrors) or not self.swaps else (y, x)
        return Turn(shown, Window.sized(*corner, *size), self.swaps, self.mirrors)

    def tiling(self, parts: Sequence[Part], made: Part) -> str:
        """Those of its source, turned with it."""
        axes = super().tiling(parts, made)
        return {"x": "y", "y": "x"}.get(axes, axes) if self.swaps else axes

    def result(self, parts: Sequence[Part], facts: Facts) -> Part:
        """The turned part, not yet computed; OpenImageIO drops the metadata of a transposed image."""
        part, turn = parts[0], self.turn(parts[0].spec)
        spec = turn.spec(part.spec)
        if not any(self.mirrors):
            spec.erase_attribute(".*")
        bring = functools.partial(materialized, budget=facts.budget)
        near = once(part, bring) if self.swaps else cached(part, facts.cache)
        return copied(spec, lambda window: turn.pixels(near.read(turn.back(window))), part)


_SWAPS = {"swaps": True}
_TURNS = (
    op("flip", "Flip the image vertically (mirror top to bottom).", Turned, mirrors=(False, True)),
    op("flop", "Flop the image horizontally (mirror left to right).", Turned, mirrors=(True, False)),
    op("rotate180", "Rotate by 180 degrees.", Turned, aliases=("--flipflop",), mirrors=(True, True)),
    op("rotate90", "Rotate by 90 degrees clockwise.", Turned, mirrors=(True, False), **_SWAPS),
    op("rotate270", "Rotate by 270 degrees clockwise.", Turned, mirrors=(False, True), **_SWAPS),
    op("transpose", "Transpose the image: swap rows and columns.", Turned, **_SWAPS),
)


@dataclass(frozen=True, kw_only=True)
class Reorient(Hosted, Gather):
    """Rotate and flip the pixels to match the Orientation metadata."""

    name: ClassVar[str] = "reorient"

    source: Image = image(help="Input image.")

    def plan(self, facts: Facts) -> Plan:
        """The upright image; the image itself if it is already upright."""
        parts = self.source.parts
        if all(orientation_of(part.spec) == 1 for part in parts):
            return Plan(self.source)
        return Plan(upright(Image(parts if facts.settings.all_parts else parts[:1], self.source.source)))


@dataclass(frozen=True, kw_only=True)
class CircularShift(HostOp, Gather):
    """Shift the image circularly within its data window."""

    name: ClassVar[str] = "cshift"
    mixes: ClassVar[bool] = False

    source: Image = image(help="Input image.")
    shift: str = argument(help="Offset +X+Y, to the right and down.", example="+20-10")

    def result(self, parts: Sequence[Part], facts: Facts) -> Part:
        """The shifted part; its windows are read from the source with wraparound."""
        x, y = parse_offset(self.shift)
        source = cached(parts[0], facts.cache)
        return copied(source.spec, lambda window: on_a_torus(source, window.shifted(-x, -y)), source)


TURNING = (*_TURNS, Reorient, CircularShift)
