# SPDX-License-Identifier: Apache-2.0
"""Access kinds whose functions get buffers with the source pixels that a window of the result needs."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from ...engine.core.access import Gather, Neighborhood
from ...engine.core.demand import cached, materialized
from ...engine.core.image import Image, Part, Pixels
from ...engine.core.parameters import image
from ...engine.core.tiling import repeated
from ...engine.core.window import Window
from ...engine.deferred import oiio
from ...engine.errors import ImageError, ParameterError
from .kinds import HostOp, checked, once, sample

if TYPE_CHECKING:
    from ...engine.session.facts import Facts

_MOST_NEIGHBORS = 1 << 24  # of a pixel
_CELL = 256  # side of the squares in which oblique reads are done: a band of rows would need the whole source


@dataclass(frozen=True, kw_only=True)
class _Resampled(HostOp):
    """An op whose result has other coordinates than its source, or needs pixels around it."""

    scattered: ClassVar[bool] = False  # it reads columns or oblique strips, which files deliver slowly

    source: Image = image(help="Input image.")

    def target(self, specs: Sequence[oiio.ImageSpec]) -> oiio.ImageSpec:
        """The result's windows, in a copy of the first spec."""
        return oiio.ImageSpec(specs[0])

    def needs(self, window: Window, specs: Sequence[oiio.ImageSpec]) -> Sequence[Window]:
        """For each input, the window that a window of the result reads; it may reach beyond the data window."""
        raise NotImplementedError

    def apply(self, target: oiio.ImageSpec, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """The result over the data window of `target`, from buffers with the pixels that it reads."""
        raise NotImplementedError

    def result(self, parts: Sequence[Part], facts: Facts) -> Part:
        """The result, not yet computed."""
        specs = [part.spec for part in parts]
        needs = functools.partial(self.needs, specs=specs)
        return remapped(self, parts, self.target(specs), needs, self.apply, facts, scattered=self.scattered)


@dataclass(frozen=True, kw_only=True)
class Remap(_Resampled, Gather):
    """Gather: a window of the result reads another window of its source."""


@dataclass(frozen=True, kw_only=True)
class Area(_Resampled, Neighborhood):
    """Neighborhood: its function gets the window with a halo, and the window itself as a ROI."""

    wraps: ClassVar[bool] = True

    def needs(self, window: Window, specs: Sequence[oiio.ImageSpec]) -> Sequence[Window]:
        """The window with its halo."""
        return [window.grown(*self.halo())]

    def neighborhood(self) -> tuple[int, int]:
        """Columns and rows of the neighborhood of a pixel."""
        x, y = self.halo()
        return 2 * x + 1, 2 * y + 1

    def apply(self, target: oiio.ImageSpec, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """The function's result for this window."""
        return self.called(buffers[0], Window.data(target).roi(target.nchannels))

    def result(self, parts: Sequence[Part], facts: Facts) -> Part:
        """The result, not yet computed; a kernel that is too large is refused."""
        require_kernel(*self.neighborhood(), facts)
        return super().result(parts, facts)


def require_kernel(width: int, height: int, facts: Facts) -> None:
    """Refuse a kernel that takes too long (more than 2^24 pixels: ParameterError) or exceeds the memory budget."""
    if width * height > _MOST_NEIGHBORS:
        raise ParameterError(
            f"kernel {width}x{height}",
            expected=f"at most {_MOST_NEIGHBORS} pixels",
            hint="use a smaller image or kernel",
        )
    facts.require(width * height * 4, "a kernel", "use a smaller kernel")


def require_pixels(*windows: Window) -> None:
    """Refuse results without a pixel: the data and the display window."""
    for window in windows:
        if window.empty:
            data = windows[0]
            raise ImageError(f"the result would have {max(0, data.width)}x{max(0, data.height)} pixels")


def remapped(
    op: HostOp,
    parts: Sequence[Part],
    target: oiio.ImageSpec,
    needs: Callable[[Window], Sequence[Window]],
    apply: Callable[..., oiio.ImageBuf],
    facts: Facts,
    *,
    scattered: bool = False,
) -> Part:
    """The result of a resampling op over the windows of `target`, not yet computed.

    `needs` and `apply` are those of `Remap` and `Area`. With `op.wraps` a tile is repeated beyond its border. With
    `scattered` reads, sources are first copied to memory or a temporary file.
    Raises ImageError if the result has no pixel.
    """
    whole = Window.data(target)
    require_pixels(whole, Window.display(target))
    bring = functools.partial(materialized, budget=facts.budget)
    near = [once(part, bring) if scattered else cached(part, facts.cache) for part in parts]
    near = [repeated(part) for part in near] if op.wraps else near

    def at(window: Window) -> oiio.ImageBuf:
        pieces = [(part, _seen(wanted, part)) for part, wanted in zip(near, needs(window), strict=True)]
        facts.require(sum(w.width * w.height * part.spec.nchannels * 4 for part, w in pieces), op.flag())
        return checked(apply(window.apply_to(target), *(part.buffer(w) for part, w in pieces)))

    corner = Window.sized(whole.left, whole.top, 1, 1)
    samples = [sample(part, Window.sized(*part.window[:2], 16, 16) & part.window) for part in parts]
    spec = whole.apply_to(checked(apply(corner.apply_to(target), *samples)).spec())
    part = Part(parts[0].name, spec, at)
    return dataclasses.replace(part, fetch=_in_cells(part)) if scattered else part


def with_edges(wanted: Window, spec: oiio.ImageSpec) -> Window:
    """A window with the edge of the display window, which OpenImageIO repeats beyond the data window."""
    data, display = Window.data(spec), Window.display(spec)
    if not wanted.empty and wanted & data == wanted:
        return wanted
    return wanted | Window(
        min(max(wanted.left, display.left), display.right - 1),
        min(max(wanted.top, display.top), display.bottom - 1),
        min(max(wanted.right, display.left + 1), display.right),
        min(max(wanted.bottom, display.top + 1), display.bottom),
    )


def _seen(wanted: Window, part: Part) -> Window:
    """The readable part of a window: at least the nearest pixel; all of a deep part, which has no row access."""
    whole = part.window
    seen = whole if part.spec.deep else with_edges(wanted, part.spec) & whole
    if not seen.empty:
        return seen
    x, y = min(max(wanted.left, whole.left), whole.right - 1), min(max(wanted.top, whole.top), whole.bottom - 1)
    return Window.sized(x, y, 1, 1)


def _in_cells(part: Part) -> Callable[[Window], Pixels]:
    def fetch(window: Window) -> Pixels:
        if window.width <= _CELL and window.height <= _CELL:
            return part.fetch(window)
        out = oiio.ImageBuf(window.apply_to(part.spec), False)
        for cell in window.cells(_CELL, _CELL):
            out.set_pixels(cell.roi(part.spec.nchannels), part.read(cell))
        return out

    return fetch
