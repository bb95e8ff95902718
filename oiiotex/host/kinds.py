# SPDX-License-Identifier: Apache-2.0
"""The access kinds over ImageBufs: how an ImageBufAlgo function is computed window by window.

An op of the host declares its parameters as any `Op` and says in `apply` which ImageBufAlgo function computes it. The
kinds differ in what `apply` is given: pixel for pixel (`PointOp`), with a halo (`Area`), from elsewhere (`Remap`), or
the whole image (`AtOnce`); `Respec` changes no pixel. OpenImageIO's functions give a window the same pixels whatever
lies around it, as long as what they look at is there (tests/test_streaming.py holds every op to it).
"""

from __future__ import annotations

import dataclasses
import functools
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from ..core.access import Gather, Neighbourhood, Pointwise, Whole
from ..core.demand import cached, materialized
from ..core.image import Image, Part, Pixels, cropped, in_memory
from ..core.op import Kind, Op, Output, Space
from ..core.parameters import Parameter, declared, image, param
from ..core.window import Window
from ..deferred import oiio
from ..errors import ImageError, ParameterError, one_line
from .subimages import chosen

if TYPE_CHECKING:
    from ..session import Session


@dataclass(frozen=True, kw_only=True)
class HostOp(Op):
    """Works part by part: on the first, on all, or on some."""

    prefix: ClassVar[str] = "--"
    mixes: ClassVar[bool] = True  # its pixels are other values than those of its source, not the same elsewhere
    keeps: ClassVar[bool] = False  # parts that it does not work on stay
    space: ClassVar[Space] = Space.ANY
    outputs: ClassVar[tuple[Output, ...]] = (Output("image", Kind.PIXELS, "the result"),)
    function: ClassVar[str]  # of ImageBufAlgo, where one makes the pixels

    subimages: str | None = param(
        None, help="parts to work on, by number or name with commas between them, or all; -N leaves one out"
    )
    allsubimages: bool | None = param(None, help="work on all parts; as -a says when left out")

    def result(self, parts: Sequence[Part], session: Session) -> Part:
        """The op's result from one part of each input."""
        raise NotImplementedError

    def of_buffers(self, *arguments: Any) -> oiio.ImageBuf:
        """What its `function` makes of buffers and values."""
        result: oiio.ImageBuf = getattr(oiio.ImageBufAlgo, self.function)(*arguments)
        return result

    def provenance(self) -> dict[str, Any]:
        """Nothing: files made by oiiotool's ops say what oiiotool says."""
        return {}

    def idle(self, parts: Sequence[Part]) -> bool:
        """Whether none of these parts of the first image would change: the image then goes on as it is."""
        return False

    def compute(self, session: Session) -> Image:
        """The result for each part worked on; unless it keeps them, the others are dropped, as oiiotool does."""
        inputs = self.inputs()
        first = inputs[0]
        wanted = chosen(self.subimages, first)
        everything = self.allsubimages if self.allsubimages is not None else session.settings.all_parts
        count = len(first.parts) if everything or self.subimages else 1
        if self.idle([part for n, part in enumerate(first.parts[:count]) if wanted is None or n in wanted]):
            return first
        parts = []
        for n, part in enumerate(first.parts[:count]):
            operands = [given.parts[min(n, len(given.parts) - 1)] for given in inputs]
            parts.append(self._worked(operands, session) if wanted is None or n in wanted else part)
        return Image((*parts, *(first.parts[count:] if self.keeps else ())), first.source)

    def _worked(self, parts: Sequence[Part], session: Session) -> Part:
        """The op's result; ids and coordinates stay what they are, and are refused where they would be mixed."""
        part = parts[0]
        if not part.exact:
            return self.result(parts, session)
        if self.mixes:
            raise ImageError(
                f"part '{part.name}' holds {_content(part)}, which the op would change: leave it out, with"
                f" :subimages=-{part.name} or without -a"
            )
        return dataclasses.replace(self.result(parts, session), stored=part.stored, exact=True)

    def inputs(self) -> list[Image]:
        """The images that it was given, in the order of declaration."""
        return [given for _, given in self.given()]


@dataclass(frozen=True, kw_only=True)
class Hosted(HostOp):
    """Makes one image its own way: from none, from many, from all parts. The modifiers for parts are not its."""

    _OF_PARTS: ClassVar[tuple[str, ...]] = ("subimages", "allsubimages")

    def __post_init__(self) -> None:
        for name in self._OF_PARTS:
            if getattr(self, name) is not None:
                raise ParameterError(f"{self.name}: it has no modifier '{name}'")
        super().__post_init__()

    @classmethod
    def parameters(cls) -> tuple[Parameter, ...]:
        """The declared parameters."""
        return tuple(p for p in declared(cls)[1] if p.name not in cls._OF_PARTS)


def _content(part: Part) -> str:
    """What a part holds that must stay as it is."""
    return "source coordinates" if part.spec.format == oiio.FLOAT else "ids"


def checked(buffer: oiio.ImageBuf) -> oiio.ImageBuf:
    """The buffer, unless it holds an error of OpenImageIO.

    Raises
    ------
    ImageError
        With OpenImageIO's text.
    """
    if buffer.has_error:
        raise ImageError(one_line(buffer.geterror()))
    return buffer


def _blank(part: Part, window: Window) -> oiio.ImageBuf:
    """Black pixels of the part's kind: what an op makes of them tells the spec of its result."""
    spec = window.apply_to(part.spec)
    spec.set_format(part.working_type)
    return oiio.ImageBuf(spec)


@dataclass(frozen=True, kw_only=True)
class PointOp(HostOp, Pointwise):
    """What it makes of buffers, pixel for pixel."""

    def apply(self, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """The result over the data window that all buffers have."""
        return self.of_buffers(*buffers)

    def window(self, parts: Sequence[Part]) -> Window:
        """The result's data window: that of all inputs together."""
        whole = parts[0].window
        for part in parts[1:]:
            whole |= part.window
        return whole

    def result(self, parts: Sequence[Part], session: Session) -> Part:
        """The result, not yet computed."""
        return pointwise(parts, self.window(parts), self.apply)


def pointwise(parts: Sequence[Part], whole: Window, apply: Callable[..., oiio.ImageBuf]) -> Part:
    """What `apply` makes of the pixels of parts over the data window `whole`, not yet computed."""
    corner = Window.sized(whole.left, whole.top, 1, 1)
    spec = checked(apply(*(_blank(part, corner) for part in parts))).spec()

    def fetch(window: Window) -> oiio.ImageBuf:
        return checked(apply(*(_padded(part, window) for part in parts)))

    return Part(parts[0].name, whole.apply_to(spec), fetch)


def _padded(part: Part, window: Window) -> oiio.ImageBuf:
    """The part's pixels over a window, black where it has none."""
    if window & part.window == window:
        return part.buffer(window)
    return cropped(part, window).buffer(window)


@dataclass(frozen=True, kw_only=True)
class _Resampled(HostOp):
    """What it makes of buffers that hold what a window looks at."""

    scattered: ClassVar[bool] = False  # it reads columns or slanted strips, which no file gives quickly

    def target(self, specs: Sequence[oiio.ImageSpec]) -> oiio.ImageSpec:
        """The result's windows, in a copy of the first spec."""
        return oiio.ImageSpec(specs[0])

    def needs(self, window: Window, specs: Sequence[oiio.ImageSpec]) -> Sequence[Window]:
        """For each input, the window that a window of the result looks at; it may reach beyond the data window."""
        raise NotImplementedError

    def apply(self, target: oiio.ImageSpec, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """The result over the data window of `target`, from buffers that hold what it looks at."""
        raise NotImplementedError

    def result(self, parts: Sequence[Part], session: Session) -> Part:
        """The result, not yet computed."""
        specs = [part.spec for part in parts]
        needs = functools.partial(self.needs, specs=specs)
        return remapped(self, parts, self.target(specs), needs, self.apply, session, scattered=self.scattered)


@dataclass(frozen=True, kw_only=True)
class Remap(_Resampled, Gather):
    """A window follows from another window of its source."""


@dataclass(frozen=True, kw_only=True)
class Area(_Resampled, Neighbourhood):
    """A window follows from the same window with a halo."""

    def needs(self, window: Window, specs: Sequence[oiio.ImageSpec]) -> Sequence[Window]:
        """The window with its halo."""
        return [window.grown(*self.halo())]

    def neighbourhood(self) -> tuple[int, int]:
        """Columns and rows of what it looks at around a pixel."""
        x, y = self.halo()
        return 2 * x + 1, 2 * y + 1

    def result(self, parts: Sequence[Part], session: Session) -> Part:
        """The result, not yet computed; too large a kernel is refused."""
        require_kernel(*self.neighbourhood(), session)
        return super().result(parts, session)


def require_kernel(width: int, height: int, session: Session) -> None:
    """Refuse a kernel that nobody waits for, or whose values do not fit the memory budget.

    Raises
    ------
    ParameterError
        It has more than 2^24 pixels: OpenImageIO looks at each of them for each pixel.
    ImageError
        It does not fit.
    """
    if width * height > _MOST_NEIGHBOURS:
        size = f"{width}x{height}"
        raise ParameterError(
            f"kernel {size}: expected at most {_MOST_NEIGHBOURS} pixels; use a smaller image or kernel"
        )
    session.resources.require(width * height * 4, "a kernel", "use a smaller kernel")


_MOST_NEIGHBOURS = 1 << 24  # of a pixel
_CELL = 256  # side of the squares in which slanted reads are done: a band of rows would need all of its source


def remapped(
    op: HostOp,
    parts: Sequence[Part],
    target: oiio.ImageSpec,
    needs: Callable[[Window], Sequence[Window]],
    apply: Callable[..., oiio.ImageBuf],
    session: Session,
    *,
    scattered: bool = False,
) -> Part:
    """The result of an op that looks elsewhere, not yet computed.

    Parameters
    ----------
    op : HostOp
        Named in messages.
    parts : sequence of Part
    target : oiio.ImageSpec
        The result's windows.
    needs, apply : callable
        As `Remap` and `Area` have them.
    scattered : bool
        Sources are brought where any window can be read, when the first is asked for.

    Raises
    ------
    ImageError
        The result has no pixel.
    """
    whole = Window.data(target)
    if whole.empty or target.full_width < 1 or target.full_height < 1:
        raise ImageError(
            f"the result would be {max(0, whole.width)}x{max(0, whole.height)} pixels: it needs one at least"
        )
    bring = functools.partial(materialized, budget=session.resources.budget)
    near = [once(part, bring) if scattered else cached(part, session.resources.cache) for part in parts]

    def at(window: Window) -> oiio.ImageBuf:
        pieces = [(part, _seen(wanted, part)) for part, wanted in zip(near, needs(window), strict=True)]
        session.resources.require(sum(w.width * w.height * part.spec.nchannels * 4 for part, w in pieces), op.flag())
        buffers = [part.buffer(w) for part, w in pieces]
        return checked(apply(window.apply_to(target), *buffers))

    corner = Window.sized(whole.left, whole.top, 1, 1)
    samples = [_blank(part, Window.sized(*part.window[:2], 16, 16) & part.window) for part in parts]
    spec = whole.apply_to(checked(apply(corner.apply_to(target), *samples)).spec())
    part = Part(parts[0].name, spec, at)
    return dataclasses.replace(part, fetch=_in_cells(part)) if scattered else part


def with_edges(wanted: Window, spec: oiio.ImageSpec) -> Window:
    """A window, with the edge of the display window, which OpenImageIO repeats beyond the data window."""
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
    """What an op sees of a window: a pixel at least, be it far away; all of a deep part, whose rows cannot be read."""
    seen = part.window if part.spec.deep else with_edges(wanted, part.spec) & part.window
    return _nearest(wanted, part.window) if seen.empty else seen


def _in_cells(part: Part) -> Callable[[Window], Pixels]:
    def fetch(window: Window) -> Pixels:
        if window.width <= _CELL and window.height <= _CELL:
            return part.fetch(window)
        out = oiio.ImageBuf(window.apply_to(part.spec), False)
        for cell in window.cells(_CELL, _CELL):
            out.set_pixels(cell.roi(part.spec.nchannels), part.read(cell))
        return out

    return fetch


def once(part: Part, bring: Callable[[Part], Part]) -> Part:
    """The part where `bring` leaves its pixels, where any can be read in any order, when the first is asked for."""
    if part.ready:
        return part
    lock = threading.Lock()
    kept: list[Part] = []

    def fetch(window: Window) -> Pixels:
        with lock:
            if not kept:
                kept.append(bring(part))
        return kept[0].fetch(window)

    return dataclasses.replace(part, fetch=fetch, ready=True)


def worked(part: Part) -> Part:
    """The part as ops of the host see it: its working type, written as computed pixels are."""
    spec = part.window.apply_to(part.spec)
    spec.set_format(part.working_type)
    return Part(part.name, spec, part.buffer, ready=part.ready)


def _nearest(wanted: Window, whole: Window) -> Window:
    """The pixel of `whole` that lies nearest to a window outside it."""
    x = min(max(wanted.left, whole.left), whole.right - 1)
    y = min(max(wanted.top, whole.top), whole.bottom - 1)
    return Window.sized(x, y, 1, 1)


@dataclass(frozen=True, kw_only=True)
class AtOnce(HostOp, Whole):
    """What it makes of whole buffers, held."""

    def apply(self, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """The result from whole images."""
        raise NotImplementedError

    def result_bytes(self, parts: Sequence[Part]) -> int:
        """Bytes that it needs beside its inputs."""
        return _bytes(parts[0])

    def result(self, parts: Sequence[Part], session: Session) -> Part:
        """The computed result."""
        session.resources.require(sum(map(_bytes, parts)) + self.result_bytes(parts), self.flag())
        return in_memory(parts[0].name, checked(self.apply(*(part.buffer(part.window) for part in parts))))


def _bytes(part: Part) -> int:
    return part.spec.width * part.spec.height * part.spec.nchannels * 4


@dataclass(frozen=True, kw_only=True)
class Respec(HostOp, Pointwise):
    """Pixels stay; windows, channel names or metadata change."""

    mixes: ClassVar[bool] = False
    keeps: ClassVar[bool] = True
    deep: ClassVar[bool] = True

    source: Image = image(help="the image")

    def change(self, spec: oiio.ImageSpec) -> None:
        """Make the change."""
        raise NotImplementedError

    def result(self, parts: Sequence[Part], session: Session) -> Part:
        """The part under its new spec, in its own type."""
        return parts[0].respecced(self.change)
