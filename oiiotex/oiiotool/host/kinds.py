# SPDX-License-Identifier: Apache-2.0
"""oiiotool's ops as a table, and the access kinds over ImageBufs that compute them.

A row (`op`) holds an op's name, help, kind, function and parameters. The kinds differ in the arguments that the
function gets before the parameters' values: pointwise buffers (`PointOp`), buffers with a halo or from elsewhere
(remapping.py), whole images (`AtOnce`), or only a spec (`Respec`). OpenImageIO's functions compute the same pixels
through any window, as long as the pixels that they read are there (tests/promises/test_streaming.py checks every op).
"""

from __future__ import annotations

import dataclasses
import functools
import operator
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from ...engine.core.access import Neighborhood, Pointwise, Whole
from ...engine.core.attributes import ATLAS, EDGES
from ...engine.core.image import Image, Part, Pixels, cropped, in_memory
from ...engine.core.op import Kind, Op, Output, Plan, Space, no_pixels
from ...engine.core.parameters import Parameter, declared, image, param
from ...engine.core.tiling import retiled, shared_tiling, tiling_of
from ...engine.core.window import Window
from ...engine.deferred import oiio
from ...engine.errors import ImageError, ParameterError, one_line
from ...engine.io.cryptomatte import require_no_ids, require_unmixed

if TYPE_CHECKING:
    from ...engine.session import Session
    from ...engine.session.facts import Facts

_OF_PARTS = ("subimages", "allsubimages")


@dataclass(frozen=True, kw_only=True)
class HostOp(Op):
    """Works part by part: on the first, on all, or on selected ones."""

    prefix: ClassVar[str] = "--"
    turns: ClassVar[bool] = False
    mixes: ClassVar[bool] = True  # it computes new values; otherwise it only moves or copies the source's
    spares: ClassVar[bool] = False  # it copies channels that are not color, such as ids of Cryptomatte
    keeps: ClassVar[bool] = False  # parts that it does not work on are kept
    wraps: ClassVar[bool] = False  # it reads pixels around a pixel, of a tile beyond its border
    untiles: ClassVar[bool] = False  # its result does not tile, even if its source does
    space: ClassVar[Space] = Space.ANY
    outputs: ClassVar[tuple[Output, ...]] = (Output("image", Kind.PIXELS, "Result."),)
    function: ClassVar[str | Callable[..., Any]]  # the name of one of ImageBufAlgo, or ours

    subimages: str | None = param(
        None, unset="the first part, or all with allsubimages", example="0,2", advanced=True,
        help="Comma-separated parts (subimages) to work on, by number or name, or all. -N excludes part N.",
    )  # fmt: skip
    allsubimages: bool | None = param(None, unset="1 with -a, else 0", help="Work on all parts.", advanced=True)

    def result(self, parts: Sequence[Part], facts: Facts) -> Part:
        """The op's result from one part of each input."""
        raise NotImplementedError

    def operands_after(self, *given: Any) -> Sequence[Any]:
        """The function's further arguments: by default the parameters' values, in the order of declaration."""
        return [getattr(self, p.attribute) for p in self.parameters() if p.name not in _OF_PARTS]

    def called(self, *given: Any) -> Any:
        """The function's result for the arguments that its kind gives it and the parameters' values."""
        function = self.function
        called: Callable[..., Any] = getattr(oiio.ImageBufAlgo, function) if isinstance(function, str) else function
        return called(*given, *self.operands_after(*given))

    def tiling(self, parts: Sequence[Part], made: Part) -> str:
        """Axes along which its result tiles: those along which all images do that it takes the pixels from."""
        return "none" if self.untiles else shared_tiling(part.spec for part in (parts[:1] if self.wraps else parts))

    def provenance(self) -> dict[str, Any]:
        """Nothing: files made by oiiotool's ops carry oiiotool's metadata."""
        return {}

    def idle(self, parts: Sequence[Part]) -> bool:
        """Whether none of these parts of the first image would change: the image is then passed through."""
        return False

    def plan(self, facts: Facts) -> Plan:
        """The result, not yet computed."""
        return Plan(self.of_parts(facts, self.result))

    def of_parts(self, facts: Facts, result: Callable[[Sequence[Part], Facts], Part]) -> Image:
        """`result` for each selected part; the others are dropped, as by oiiotool, unless the op keeps them."""
        inputs = self.inputs()
        first = inputs[0]
        chosen = _chosen(self.subimages, first)
        everything = self.allsubimages if self.allsubimages is not None else facts.settings.all_parts
        count = len(first.parts) if everything or self.subimages else 1
        if self.idle([part for n, part in enumerate(first.parts[:count]) if n in chosen]):
            return first
        parts = []
        for n, part in enumerate(first.parts[:count]):
            operands = [given.parts[min(n, len(given.parts) - 1)] for given in inputs]
            parts.append(self._worked(operands, facts, result) if n in chosen else part)
        return Image((*parts, *(first.parts[count:] if self.keeps else ())), first.source)

    def _worked(self, parts: Sequence[Part], facts: Facts, result: Callable[[Sequence[Part], Facts], Part]) -> Part:
        """The op's result, tagged as a tile if it is one.

        Ids and coordinates keep their type, and an op that would mix them is refused.
        """
        part = parts[0]
        if self.mixes and not self.spares:
            require_unmixed(part, self.flag())

        def tile() -> Part:
            made = result(parts, facts)
            if self.mixes and not isinstance(self, Pointwise) and made.stored is None and not part.exact:
                require_no_ids(part, self.flag())
            return self._without_lost_edges(retiled(made, self.tiling(parts, made)), part)

        if not part.exact:
            made, typed = tile(), next((one for one in parts if one.typed), None)
            return made if typed is None else dataclasses.replace(made, stored=typed.stored, typed=True)
        if self.mixes:
            content = "source coordinates" if part.spec.format == oiio.FLOAT else "ids"
            raise ImageError(
                f"part '{part.name}' holds {content}, which must not be interpolated",
                hint=f"exclude it: :subimages=-{part.name}, or no -a",
            )
        return dataclasses.replace(tile(), stored=part.stored, exact=True)

    def _without_lost_edges(self, made: Part, part: Part) -> Part:
        """The result without the attributes of Wang tiles that no longer hold.

        Values may change, and an atlas, which repeats, may be resized or filtered. Tiles that were moved or cut fit no
        longer.
        """
        tiling = tiling_of(made.spec)
        still = isinstance(self, Pointwise) and tiling == tiling_of(part.spec) and made.window.size == part.window.size
        around = len(self.inputs()) == 1 and (self.rescales or isinstance(self, Neighborhood))
        stays = {EDGES: still, ATLAS: still or (around and tiling == "xy")}
        for name, kept in stays.items():
            if not kept and made.spec.getattribute(name) is not None:
                made = made.respecced(operator.methodcaller("erase_attribute", name))
        return made

    def inputs(self) -> list[Image]:
        """The given images, in the order of declaration."""
        return [given for _, given in self.given()]


def op(
    name: str,
    help: str,
    kind: type[HostOp],
    function: str | Callable[..., Any] | None = None,
    /,
    **members: Any,
) -> type[HostOp]:
    """An op, as a row of a table.

    Parameters
    ----------
    name, help : str
    kind : type
        Its access kind, with the inputs and parameters that it shares with other ops.
    function : str or callable
        What computes it: the name of a function of ImageBufAlgo, or ours. Default: the op's name.
    **members
        Its parameters, in the order in which the function takes their values: a field, of the type of its default, or
        (type, field). Other members are attributes of the class, such as `aliases`, or methods.
    """
    fields = fields_of(members)
    facts = members | {"__doc__": help, "name": name}
    facts["function"] = staticmethod(function) if callable(function) else function or name
    for field, *_ in fields:
        del facts[field]
    return dataclasses.make_dataclass(name, fields, bases=(kind,), namespace=facts, frozen=True, kw_only=True)


def fields_of(members: dict[str, Any]) -> list[tuple[str, type, Any]]:
    """The members that are parameters: (name, type, field), as `make_dataclass` takes them."""
    fields = []
    for name, value in members.items():
        if isinstance(value, dataclasses.Field):
            fields.append((name, type(value.default), value))
        elif isinstance(value, tuple) and isinstance(value[-1], dataclasses.Field):
            fields.append((name, *value))
    return fields


def _chosen(subimages: str | None, first: Image) -> set[int]:
    """The numbers of the parts that a `subimages` modifier selects."""
    names = [part.name for part in first.parts]
    included: set[int] = set()
    excluded: set[int] = set()
    for word in filter(None, (w.strip() for w in (subimages or "").split(","))):
        bare = word.removeprefix("-")
        if bare == "all":
            included |= set(range(len(names)))
        elif bare.isdigit() or bare in names:
            (excluded if word != bare else included).add(int(bare) if bare.isdigit() else names.index(bare))
        else:
            problem, hint = f"{first.source} has no part '{bare}'", f"it has {', '.join(names)}"
            raise ParameterError(problem, parameter="subimages", value=subimages, hint=hint)
    return (included or set(range(len(names)))) - excluded


@dataclass(frozen=True, kw_only=True)
class Hosted(HostOp):
    """Makes one image from none, from several, or from all parts; it has no modifiers that select parts."""

    def __post_init__(self) -> None:
        for name in _OF_PARTS:
            if getattr(self, name) is not None:
                raise ParameterError(f"unknown modifier '{name}'")
        super().__post_init__()

    @classmethod
    def parameters(cls) -> tuple[Parameter, ...]:
        """The declared parameters."""
        return tuple(p for p in declared(cls)[1] if p.name not in _OF_PARTS)


def checked(buffer: oiio.ImageBuf) -> oiio.ImageBuf:
    """The buffer; an OpenImageIO error that it holds is raised as ImageError."""
    if buffer.has_error:
        raise ImageError(one_line(buffer.geterror()))
    return buffer


def like(spec: oiio.ImageSpec, **changes: Any) -> oiio.ImageSpec:
    """A copy of a spec with changed attributes."""
    copy = oiio.ImageSpec(spec)
    for name, value in changes.items():
        setattr(copy, name, value)
    return copy


def filled(spec: oiio.ImageSpec, pixels: Pixels) -> oiio.ImageBuf:
    """A buffer with this spec and these pixels."""
    buffer = oiio.ImageBuf(spec)
    buffer.set_pixels(buffer.roi, pixels)
    return buffer


def window_of(roi: oiio.ROI) -> Window:
    """A region as a window."""
    return Window(roi.xbegin, roi.ybegin, roi.xend, roi.yend)


def sample(part: Part, window: Window) -> oiio.ImageBuf:
    """Black pixels with the part's channels and type: an op applied to them shows the spec of its result."""
    spec = window.apply_to(part.spec)
    spec.set_format(part.working_type)
    return oiio.ImageBuf(spec)


def worked(part: Part) -> Part:
    """The part as these ops see it: in its working type, and written as computed pixels are."""
    spec = part.window.apply_to(part.spec)
    spec.set_format(part.working_type)
    return Part(part.name, spec, part.buffer, ready=part.ready)


def once(part: Part, bring: Callable[[Part], Part]) -> Part:
    """The part as random-access `bring` returns it; it is called when the first pixels are requested."""
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


@dataclass(frozen=True, kw_only=True)
class PointOp(HostOp, Pointwise):
    """Pointwise: its function gets buffers with the same data window."""

    def apply(self, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """The result over the common data window of the buffers."""
        return self.called(*buffers)

    def result(self, parts: Sequence[Part], facts: Facts) -> Part:
        """The result, not yet computed, over the union of the inputs' data windows."""
        return pointwise(parts, functools.reduce(operator.or_, (part.window for part in parts)), self.apply)


@dataclass(frozen=True, kw_only=True)
class OneImage(PointOp):
    """One image, pixel by pixel."""

    source: Image = image(help="Input image.")


def pointwise(parts: Sequence[Part], whole: Window, apply: Callable[..., oiio.ImageBuf]) -> Part:
    """`apply` to the parts over the data window `whole`; a part is black outside its own data window."""
    corner = Window.sized(whole.left, whole.top, 1, 1)
    spec = checked(apply(*(sample(part, corner) for part in parts))).spec()

    def padded(part: Part, window: Window) -> oiio.ImageBuf:
        return (part if window & part.window == window else cropped(part, window)).buffer(window)

    def fetch(window: Window) -> oiio.ImageBuf:
        return checked(apply(*(padded(part, window) for part in parts)))

    return Part(parts[0].name, whole.apply_to(spec), fetch)


@dataclass(frozen=True, kw_only=True)
class AtOnce(HostOp, Whole):
    """Its function gets whole images in memory."""

    def result_bytes(self, parts: Sequence[Part]) -> int:
        """Bytes needed in addition to the inputs."""
        return _bytes(parts[0])

    def result(self, parts: Sequence[Part], facts: Facts) -> Part:
        """A part of which only the name and the kind are known: its memory is checked."""
        facts.require(sum(map(_bytes, parts)) + self.result_bytes(parts), self.flag())
        return dataclasses.replace(parts[0], fetch=no_pixels)

    def plan(self, facts: Facts) -> Plan:
        """The spec of the result is known when its function has returned it."""
        self.of_parts(facts, self.result)
        return Plan()

    def make(self, plan: Plan, session: Session) -> Image:
        """The computed result."""
        return self.of_parts(session.resources, self._computed)

    def _computed(self, parts: Sequence[Part], facts: Facts) -> Part:
        return in_memory(parts[0].name, checked(self.called(*(part.buffer(part.window) for part in parts))))


def _bytes(part: Part) -> int:
    return part.spec.width * part.spec.height * part.spec.nchannels * 4


@dataclass(frozen=True, kw_only=True)
class Respec(HostOp, Pointwise):
    """Its function changes only a spec: windows, channel names or metadata, never pixels."""

    mixes: ClassVar[bool] = False
    keeps: ClassVar[bool] = True
    deep: ClassVar[bool] = True

    source: Image = image(help="Input image.")

    def result(self, parts: Sequence[Part], facts: Facts) -> Part:
        """The part with its new spec, in its own type."""
        return parts[0].respecced(self.called)

    def tiling(self, parts: Sequence[Part], made: Part) -> str:
        """As its metadata say, if its windows still allow it."""
        return tiling_of(made.spec)
