# SPDX-License-Identifier: Apache-2.0
"""Ops on windows: crops, cuts, pastes, mosaics."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from ..core.access import Gather, ScanThenMap
from ..core.demand import bands
from ..core.image import Image, Part, derived_spec
from ..core.op import Op
from ..core.parameters import Size, argument, image, param
from ..core.window import Window
from ..deferred import oiio
from ..errors import ParameterError
from ..session import Session
from .geometry_text import box_of, parse_box, parse_offset
from .kinds import Hosted, Remap, remapped
from .scaling import Fit


@dataclass(frozen=True, kw_only=True)
class Cropped(Remap):
    """Another data window, black where there was nothing."""

    mixes: ClassVar[bool] = False
    deep: ClassVar[bool] = True

    source: Image = image(help="the image")

    def window(self, spec: oiio.ImageSpec) -> Window:
        """The new data window."""
        raise NotImplementedError

    def idle(self, parts: Sequence[Part]) -> bool:
        """All data windows stay."""
        return all(self.window(part.spec) == part.window for part in parts)

    def target(self, specs: Sequence[oiio.ImageSpec]) -> oiio.ImageSpec:
        """The new data window."""
        return self.window(specs[0]).apply_to(specs[0])

    def needs(self, window: Window, specs: Sequence[oiio.ImageSpec]) -> Sequence[Window]:
        """The same window."""
        return [window]

    def apply(self, target: oiio.ImageSpec, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """Cropped or padded."""
        return oiio.ImageBufAlgo.crop(buffers[0], roi=Window.data(target).roi(target.nchannels))


@dataclass(frozen=True, kw_only=True)
class Crop(Cropped):
    """Set the data window, cropping or padding with black."""

    name: ClassVar[str] = "crop"

    size: str = argument(help="the data window: WxH+X+Y, X0,Y0,X1,Y1, WxH or +X+Y")

    def window(self, spec: oiio.ImageSpec) -> Window:
        """As given; what the text leaves out stays."""
        return parse_box(self.size, box_of(Window.data(spec))).window()


@dataclass(frozen=True, kw_only=True)
class CropToFull(Cropped):
    """Crop or pad to the display window."""

    name: ClassVar[str] = "croptofull"

    def window(self, spec: oiio.ImageSpec) -> Window:
        """The display window."""
        return Window.display(spec)


@dataclass(frozen=True, kw_only=True)
class Cut(Crop):
    """Cut out a window and move it to the origin."""

    name: ClassVar[str] = "cut"

    def idle(self, parts: Sequence[Part]) -> bool:
        """Never: the display window changes."""
        return False

    def target(self, specs: Sequence[oiio.ImageSpec]) -> oiio.ImageSpec:
        """Of the window's size, at the origin."""
        window = self.window(specs[0])
        spec = Window.sized(0, 0, window.width, window.height).apply_to(specs[0])
        Window.data(spec).show_in(spec)
        return spec

    def needs(self, window: Window, specs: Sequence[oiio.ImageSpec]) -> Sequence[Window]:
        """The window where it was."""
        origin = self.window(specs[0])
        return [window.shifted(origin.left, origin.top)]

    def result(self, parts: Sequence[Part], session: Session) -> Part:
        """The cut, not yet computed."""
        target = self.target([parts[0].spec])
        origin = self.window(parts[0].spec)

        def apply(spec: oiio.ImageSpec, buffer: oiio.ImageBuf) -> oiio.ImageBuf:
            there = Window.data(spec).shifted(origin.left, origin.top)
            result = oiio.ImageBufAlgo.crop(buffer, roi=there.roi(spec.nchannels))
            changed = result.specmod()
            changed.x, changed.y = spec.x, spec.y
            result.set_full(target.full_x, target.full_width, target.full_y, target.full_height, 0, 1)
            return result

        return remapped(self, parts, target, lambda w: self.needs(w, [parts[0].spec]), apply, session)


@dataclass(frozen=True, kw_only=True)
class Trim(Hosted, ScanThenMap):
    """Crop all parts to the smallest window around all that is not zero in any of them."""

    name: ClassVar[str] = "trim"
    deep: ClassVar[bool] = True

    source: Image = image(help="the image")

    def compute(self, session: Session) -> Image:
        """One data window for all parts, as many programs expect of a file."""
        window: Window | None = None
        for part in self.source.parts:
            nonzero = _nonzero(part)
            if nonzero is not None:
                window = nonzero if window is None else window | nonzero
        if window is None:  # all is zero: one such pixel is left
            whole = self.source.first.window
            window = Window.sized(whole.left, whole.top, 1, 1)
        return Crop(source=self.source, size=str(window), allsubimages=True).compute(session)


def _nonzero(part: Part) -> Window | None:
    window: Window | None = None
    for band in (part.window,) if part.spec.deep else bands(part):
        roi = oiio.ImageBufAlgo.nonzero_region(part.buffer(band))
        if roi.npixels:
            nonzero = Window(roi.xbegin, roi.ybegin, roi.xend, roi.yend)
            window = nonzero if window is None else window | nonzero
    return window


def pasted(spec: oiio.ImageSpec, window: Window, placed: Iterable[tuple[Part, int, int]]) -> oiio.ImageBuf:
    """A window of an image put together from others, the later ones over the earlier, each moved by (x, y)."""
    buffer = oiio.ImageBuf(window.apply_to(spec))
    for part, x, y in placed:
        seen = window.shifted(-x, -y) & part.window
        if not seen.empty:
            oiio.ImageBufAlgo.paste(buffer, x, y, 0, 0, part.buffer(seen))
    return buffer


@dataclass(frozen=True, kw_only=True)
class Paste(Hosted, Gather):
    """Paste the image below the top over the top one, or all over the top one."""

    name: ClassVar[str] = "paste"

    sources: tuple[Image, ...] = image(help="the background last, what is pasted before it, the nearest first")
    position: str = argument(help="+X+Y: how far what is pasted moves; - or auto: it stays where it is")
    mergeroi: bool = param(False, help="the windows grow around all images; else they are the background's")
    all: bool = param(False, help="paste all images of the stack")

    @classmethod
    def arity(cls, values: dict[str, Any], depth: int) -> int:
        """Two, or all."""
        return max(2, depth) if values.get("all") else 2

    def compute(self, session: Session) -> Image:
        """The background with the others on it, back to front."""
        x, y = (0, 0) if self.position in ("-", "auto") else parse_offset(self.position)
        behind, *others = [given.first for given in reversed(self.sources)]
        whole, display = behind.window, Window.display(behind.spec)
        if self.mergeroi:
            for part in others:
                whole |= part.window
                display |= Window.display(part.spec)
        spec = whole.apply_to(derived_spec(behind.spec))
        spec.set_format(behind.working_type)
        display.show_in(spec)
        placed = [(behind, 0, 0), *((part, x, y) for part in others)]
        return Image((Part(behind.name, spec, lambda window: pasted(spec, window, placed)),), self.sources[-1].source)


@dataclass(frozen=True, kw_only=True)
class Mosaic(Hosted, Gather):
    """Put images together in rows and columns; where they are too few, the rest stays black."""

    name: ClassVar[str] = "mosaic"

    sources: tuple[Image, ...] = image(help="the images, row by row")
    size: Size = argument(ge=1, help="columns x rows")
    pad: int = param(0, ge=0, unit="px", help="black between them")
    fit: Size | None = param(None, ge=1, help="resize each to fit in this size, and pad it to it")

    @classmethod
    def arity(cls, values: dict[str, Any], depth: int) -> int:
        """As many as there are cells, if there are so many images; one at least."""
        size = values.get("size")
        return max(1, depth if size is None else min(size[0] * size[1], depth))

    def compute(self, session: Session) -> Image:
        """The mosaic."""
        columns, rows = self.size
        if len(self.sources) > columns * rows:
            raise ParameterError(f"size={self.size}: {len(self.sources)} images are too many")
        parts = [given.first for given in self.sources]
        blanks = [oiio.TypeDesc(oiio.UINT8)] * (len(parts) < columns * rows)
        format = blanks[0] if blanks else parts[-1].working_type
        for part in reversed(parts):
            format = merged_type(format, part.working_type)
        channels = max(part.spec.nchannels for part in parts)
        wide, high = max(p.spec.full_width for p in parts), max(p.spec.full_height for p in parts)
        if self.fit:
            wide, high = self.fit
            fits = [Fit(source=given, size=str(self.fit), pad=True, allsubimages=False) for given in self.sources]
            parts = [fit.compute(session).first for fit in fits]
        across, down = wide + self.pad, high + self.pad
        whole = Window(0, 0, columns * across - self.pad, rows * down - self.pad)
        spec = whole.apply_to(oiio.ImageSpec(1, 1, channels, format))
        whole.show_in(spec)
        placed = [(part, n % columns * across, n // columns * down) for n, part in enumerate(parts)]
        return Image((Part("mosaic", spec, lambda window: pasted(spec, window, placed)),), "mosaic")


def merged_type(a: oiio.TypeDesc, b: oiio.TypeDesc) -> oiio.TypeDesc:
    """The pixel type that OpenImageIO takes for both: the wider where it holds the other's values, else float."""
    wider = {
        "uint": ("uint16", "uint8"), "int": ("int16", "uint16", "int8", "uint8"),
        "uint16": ("uint8",), "half": ("uint8", "int8"), "int16": ("int8", "uint8"), "double": ("float",),
    }  # fmt: skip
    for one, other in ((str(a), str(b)), (str(b), str(a))):
        if one == other or one == "double" or other in wider.get(one, ()):
            return oiio.TypeDesc(one)
    return oiio.TypeDesc("float")


OPS: tuple[type[Op], ...] = (Crop, CropToFull, Cut, Trim, Paste, Mosaic)
