# SPDX-License-Identifier: Apache-2.0
"""Ops that resize."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from ....engine.core.access import Gather
from ....engine.core.demand import cached
from ....engine.core.image import Image, Part, copied, cropped, in_memory
from ....engine.core.op import Plan, no_pixels
from ....engine.core.parameters import argument, image, param
from ....engine.core.window import Window
from ....engine.deferred import np, oiio
from ....engine.errors import ParameterError
from ....engine.session import Session
from ....engine.session.facts import Facts
from ..geometry_text import Box, box_of, parse_box
from ..kinds import Hosted, HostOp, checked
from ..remapping import Remap, remapped, require_pixels
from .warping import FILTERS, HIGHLIGHTS, blank, compressed, known_filter, warped

_STACK = 6 << 20  # bytes; ImageBufAlgo::resize keeps a row's weights on a thread's stack, and crashes if it overflows
_SIZE = argument(
    help="New display window: 640x480, 50%, 200%x50%, or 0x480 to keep the aspect ratio.", example="640x480"
)
_FILTER = param(
    "",
    unset="blackman-harris to enlarge, lanczos3 to reduce",
    example="mitchell",
    help="Name of the resampling filter.",
)
_UNSEPARABLE = ("radial-lanczos3", "nuke-lanczos6", "disk")


def scaled(op: HostOp, part: Part, target: oiio.ImageSpec, filter: str, highlights: bool, facts: Facts) -> Part:
    """The part with its display window mapped onto that of `target`, over the data window of `target`.

    With filter '', OpenImageIO chooses. Raises ParameterError for an unknown filter, and for a display window that is
    empty or too wide.
    """
    source, box = Window.display(part.spec), Window.display(target)
    if box.empty:
        raise ParameterError(f"the result would have {box.width}x{box.height} pixels")
    across, down = source.width / box.width, source.height / box.height
    wide = 3 if not filter and min(across, down) < 1 else FILTERS.get(filter, 6)  # as ImageBufAlgo::resize chooses
    taps = 2 * math.floor(wide / 2 * max(1, across)) + 1
    if 4 * taps * box.width > _STACK:
        expected = f"at most {_STACK // (4 * taps)} with this filter"
        raise ParameterError(f"the result would be {box.width} pixels wide", expected=expected)
    support = FILTERS.get(known_filter(filter), 6) / 2
    reach = [support * max(1, across), support * max(1, down)]
    if filter in _UNSEPARABLE:  # ImageBufAlgo::resize then reads a square, which either scale can make large
        reach = [support * max(1, 1 / across) * max(across, down)] * 2
    x, y = (math.ceil(r) + 3 for r in reach)

    def needs(window: Window) -> Sequence[Window]:
        return [_scaled_back(window, box, source).grown(x, y)]

    def apply(spec: oiio.ImageSpec, buffer: oiio.ImageBuf) -> oiio.ImageBuf:
        def resize(buffer: oiio.ImageBuf) -> oiio.ImageBuf:
            result = blank(spec, buffer)
            oiio.ImageBufAlgo.resize(result, buffer, filter)
            return result

        return compressed(resize, buffer, highlights)

    return remapped(op, [part], target, needs, apply, facts)


def _scaled_back(window: Window, box: Window, source: Window) -> Window:
    """The window in `source` that maps to a window in `box`, rounded outwards."""
    across, down = source.width / box.width, source.height / box.height
    return Window(
        math.floor((window.left - box.left) * across) + source.left,
        math.floor((window.top - box.top) * down) + source.top,
        math.ceil((window.right - box.left) * across) + source.left,
        math.ceil((window.bottom - box.top) * down) + source.top,
    )


def _sized(spec: oiio.ImageSpec, size: str) -> oiio.ImageSpec:
    """A spec with the given display window; the data window is scaled with it if the size changes."""
    box = parse_box(size, box_of(Window.display(spec)), scaling=True).window()
    data = box
    if (box.width, box.height) != (spec.full_width, spec.full_height):
        across, down = (
            np.float32(box.width) / np.float32(spec.full_width),
            np.float32(box.height) / np.float32(spec.full_height),
        )
        data = Window.sized(
            box.left + math.floor(np.float32(spec.x - spec.full_x) * across),
            box.top + math.floor(np.float32(spec.y - spec.full_y) * down),
            math.ceil(np.float32(spec.width) * across),
            math.ceil(np.float32(spec.height) * down),
        )
    new = data.apply_to(spec)
    box.show_in(new)
    return new


def _same_size(spec: oiio.ImageSpec, size: str) -> bool:
    target = _sized(spec, size)
    return (target.full_width, target.full_height) == (spec.full_width, spec.full_height)


@dataclass(frozen=True, kw_only=True)
class Resize(HostOp, Gather):
    """Resize (upscale or downscale) with a filter."""

    name: ClassVar[str] = "resize"
    rescales: ClassVar[bool] = True
    wraps: ClassVar[bool] = True

    source: Image = image(help="Input image.")
    size: str = _SIZE
    filter: str = _FILTER
    highlightcomp: bool = HIGHLIGHTS
    from_: str | None = param(
        None, unset="display window", example="100.5x80+10+20", advanced=True,
        help="Source region WxH+X+Y, in integer or fractional pixels. It is mapped to the region set by to.",
    )  # fmt: skip
    to: str | None = param(
        None, unset="new display window", example="640x480+0+0", advanced=True,
        help="Region WxH+X+Y of the result, in integer or fractional pixels.",
    )  # fmt: skip
    edgeclamp: bool = param(
        False, help="With from and to, ignore pixels outside the image instead of blending with black.", advanced=True
    )

    def boxes(self, spec: oiio.ImageSpec) -> tuple[Box, Box] | None:
        """Source and target regions; None if they are the two display windows."""
        shown, sized = Window.display(spec), Window.display(_sized(spec, self.size))
        begin = parse_box(self.from_, box_of(shown), whole=False) if self.from_ else box_of(shown)
        end = parse_box(self.to, box_of(sized), whole=False) if self.to else box_of(sized)
        if min(*begin[2:], *end[2:]) <= 0:
            raise ParameterError(f"from={self.from_}, to={self.to}", expected="a width and height > 0")
        return None if begin == box_of(shown) and end == box_of(sized) else (begin, end)

    def tiling(self, parts: Sequence[Part], made: Part) -> str:
        """Those of its source, unless regions are mapped."""
        return "none" if self.from_ or self.to else super().tiling(parts, made)

    def idle(self, parts: Sequence[Part]) -> bool:
        """Whether no size changes."""
        return all(_same_size(part.spec, self.size) and self.boxes(part.spec) is None for part in parts)

    def result(self, parts: Sequence[Part], facts: Facts) -> Part:
        """The resized part, not yet computed."""
        spec = parts[0].spec
        boxes = self.boxes(spec) if not Window.display(_sized(spec, self.size)).empty else None
        target = _sized(spec, self.size)
        if boxes is None:
            if _same_size(spec, self.size):  # next to parts that change: oiiotool then fills the display window
                target = Window.display(target).apply_to(target)
            return scaled(self, parts[0], target, self.filter, self.highlightcomp, facts)
        target = Window.display(target).apply_to(target)
        return warped(
            self, parts[0], target, _mapping(*boxes), self.filter, self.highlightcomp, facts, edgeclamp=self.edgeclamp
        )


def _mapping(begin: Box, end: Box) -> np.ndarray:
    """The matrix that maps one box onto another, in float, as Imath's translate and scale build it."""
    across, down = np.float32(end.width) / np.float32(begin.width), np.float32(end.height) / np.float32(begin.height)
    x = -np.float32(begin.x) * across + np.float32(end.x)
    y = -np.float32(begin.y) * down + np.float32(end.y)
    return np.array([[across, 0, 0], [0, down, 0], [x, y, 1]], np.float32)


@dataclass(frozen=True, kw_only=True)
class Resample(Remap):
    """Resize without a filter, by bilinear interpolation or the nearest pixel."""

    name: ClassVar[str] = "resample"
    rescales: ClassVar[bool] = True
    wraps: ClassVar[bool] = True
    deep: ClassVar[bool] = True

    size: str = _SIZE
    interp: bool = param(True, help="Interpolate bilinearly. If 0, take the nearest pixel, also of ids.")

    @property
    def mixes(self) -> bool:  # type: ignore[override]
        """Whether it interpolates: the nearest pixel is a copy, with all its channels."""
        return self.interp

    def idle(self, parts: Sequence[Part]) -> bool:
        """Whether no size changes."""
        return all(_same_size(part.spec, self.size) for part in parts)

    def target(self, specs: Sequence[oiio.ImageSpec]) -> oiio.ImageSpec:
        """The new display window, and the data window scaled with it."""
        spec = _sized(specs[0], self.size)
        # a part that does not change keeps its data window, next to parts that change
        return Window.data(specs[0]).apply_to(spec) if _same_size(specs[0], self.size) else spec

    def needs(self, window: Window, specs: Sequence[oiio.ImageSpec]) -> Sequence[Window]:
        """The window scaled back, and a pixel around it."""
        box = Window.display(self.target(specs))
        return [_scaled_back(window, box, Window.display(specs[0])).grown(3)]

    def result(self, parts: Sequence[Part], facts: Facts) -> Part:
        """The resampled part, not yet computed."""
        part = parts[0]
        if self.interp or part.spec.deep:
            return super().result(parts, facts)
        target = self.target([part.spec])
        require_pixels(Window.data(target), Window.display(target))
        near, box, source = cached(part, facts.cache), Window.display(target), Window.display(part.spec)

        def fetch(window: Window) -> np.ndarray:
            columns = _nearest(range(window.left, window.right), box.left, box.width, source.left, source.width)
            rows = _nearest(range(window.top, window.bottom), box.top, box.height, source.top, source.height)
            seen = Window(int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1)
            facts.require(seen.width * seen.height * part.pixel_bytes, self.flag())
            return cropped(near, seen).read(seen)[rows - seen.top][:, columns - seen.left]

        return copied(target, fetch, part)

    def apply(self, target: oiio.ImageSpec, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """The resampled window."""
        result = blank(target, *buffers)
        oiio.ImageBufAlgo.resample(result, buffers[0], self.interp)
        return result


def _nearest(places: range, begin: int, size: int, source_begin: int, source_size: int) -> np.ndarray:
    """The source coordinate of each place along an axis, as ImageBufAlgo::resample rounds it in float."""
    share = (np.array(places, np.float32) - np.float32(begin) + np.float32(0.5)) * (np.float32(1) / np.float32(size))
    return np.floor(np.float32(source_begin) + share * np.float32(source_size)).astype(np.int64)


@dataclass(frozen=True, kw_only=True)
class Fit(HostOp, Gather):
    """Resize to fit within a size, keeping the aspect ratio."""

    name: ClassVar[str] = "fit"
    rescales: ClassVar[bool] = True
    wraps: ClassVar[bool] = True

    source: Image = image(help="Input image.")
    size: str = argument(help="New display window: WxH or WxH+X+Y.", example="640x480")
    filter: str = _FILTER
    pad: bool = param(False, help="Pad the result to the size with black.")
    fillmode: str = param(
        "letterbox", choices=("letterbox", "width", "height"),
        help="Side to fit: width, height, or letterbox, which fits both, so that the whole image is visible.",
    )  # fmt: skip
    exact: bool = param(
        False, help="Keep the exact aspect ratio and center at subpixel precision. Needs the whole image in memory."
    )
    highlightcomp: bool = HIGHLIGHTS

    def plan(self, facts: Facts) -> Plan:
        """The fitted image, not yet computed; with `exact`, its windows follow from the work."""
        known_filter(self.filter)
        plan = super().plan(facts)
        return Plan() if self.exact else plan

    def make(self, plan: Plan, session: Session) -> Image:
        """The fitted image."""
        return self.of_parts(session.resources, self._exactly) if self.exact else plan.results

    def result(self, parts: Sequence[Part], facts: Facts) -> Part:
        """The fitted part; with `exact`, its memory is checked."""
        part, box = parts[0], self._box()
        if self.exact:
            pixels = part.spec.width * part.spec.height + box.width * box.height
            facts.require(pixels * part.spec.nchannels * 4 * 2, self.flag())
            return dataclasses.replace(part, fetch=no_pixels)
        return self._padded(self._fitted(part, box, facts), box)

    def tiling(self, parts: Sequence[Part], made: Part) -> str:
        """Those of its source, along the side that it fills, unless it is padded or off the pixel grid."""
        return "none" if self.exact or self.pad else super().tiling(parts, made)

    def _box(self) -> Window:
        box = parse_box(self.size, box_of(Window.display(self.source.first.spec))).window()
        if box.empty:
            raise ParameterError(parameter="size", value=self.size, expected="a width and height > 0")
        return box

    def _padded(self, fitted: Part, box: Window) -> Part:
        if self.pad and fitted.window != box:
            return dataclasses.replace(cropped(fitted, box), stored=None)
        return fitted

    def _fitted(self, part: Part, box: Window, facts: Facts) -> Part:
        spec, wide, high = part.spec, box.width, box.height
        shape = np.float32(spec.full_width) / np.float32(spec.full_height)
        if self._fills_height(spec, box):
            wide = int(np.float32(high) * shape + np.float32(0.5))
        else:
            high = int(np.float32(wide) / shape + np.float32(0.5))
        x, y = int((box.width - wide) / 2), int((box.height - high) / 2)  # towards zero, negative ones too

        def place(new: oiio.ImageSpec) -> None:
            box.show_in(new)
            new.x, new.y = new.x + x, new.y + y

        if (wide, high) == (spec.full_width, spec.full_height) and (box.left, box.top) == (spec.full_x, spec.full_y):
            return copied(part.spec, part.fetch, part).respecced(place)
        target = Window.sized(box.left, box.top, max(1, wide), max(1, high)).apply_to(spec)
        Window.sized(box.left, box.top, wide, high).show_in(target)
        return scaled(self, part, target, self.filter, self.highlightcomp, facts).respecced(place)

    def _fills_height(self, spec: oiio.ImageSpec, box: Window) -> bool:
        if self.fillmode != "letterbox":
            return self.fillmode == "height"
        return bool(
            np.float32(box.width) / np.float32(box.height) >= np.float32(spec.full_width) / np.float32(spec.full_height)
        )

    def _exactly(self, parts: Sequence[Part], _: Facts) -> Part:
        """In memory: only ImageBufAlgo::fit can give its filter a width and a height."""
        part, box = parts[0], self._box()

        def fit(buffer: oiio.ImageBuf) -> oiio.ImageBuf:
            result = blank(box.apply_to(part.spec), buffer)
            oiio.ImageBufAlgo.fit(result, buffer, self.filter, 0.0, self.fillmode, True)
            return result

        whole = part.buffer(part.window)
        return self._padded(in_memory(part.name, checked(compressed(fit, whole, self.highlightcomp))), box)


@dataclass(frozen=True, kw_only=True)
class PixelAspect(Hosted, Gather):
    """Scale up width or height to match a pixel aspect ratio."""

    name: ClassVar[str] = "pixelaspect"
    rescales: ClassVar[bool] = True

    source: Image = image(help="Input image.")
    aspect: float = argument(help="Pixel aspect ratio: width / height of a pixel.", example="1")
    filter: str = _FILTER
    highlightcomp: bool = HIGHLIGHTS

    def plan(self, facts: Facts) -> Plan:
        """Resized, with the new ratio in the metadata; the image itself if the size does not change."""
        spec = self.source.first.spec
        old = spec.get_float_attribute("PixelAspectRatio", 1.0)
        for name, ratio in (("aspect", self.aspect), ("PixelAspectRatio of the image", old)):
            if not 1e-9 < ratio < 1e9:
                raise ParameterError(parameter=name, value=f"{ratio:g}", expected="a ratio from 1e-9 to 1e9")
        factor = np.float32(old) / np.float32(self.aspect)
        across = factor if factor > 1 else np.float32(1)
        down = np.float32(1 / float(factor)) if factor < 1 else np.float32(1)
        wide = int(np.float32(spec.full_width) * across + np.float32(0.5))
        high = int(np.float32(spec.full_height) * down + np.float32(0.5))
        if (wide, high) == (spec.full_width, spec.full_height):
            return Plan(self.source)
        resize = Resize(source=self.source, size=f"{wide}x{high}", filter=self.filter, highlightcomp=self.highlightcomp)

        def change(new: oiio.ImageSpec) -> None:
            new.attribute("PixelAspectRatio", float(np.float32(self.aspect)))
            for name, scale in (("XResolution", across), ("YResolution", down)):
                density = new.get_float_attribute(name, 0.0)
                if density:
                    new.attribute(name, float(np.float32(density) * scale))

        first, *others = resize.of_parts(facts, resize.result).parts
        return Plan(Image((first.respecced(change), *others), self.source.source))


SCALING = (Resize, Resample, Fit, PixelAspect)
