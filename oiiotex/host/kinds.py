# SPDX-License-Identifier: Apache-2.0
"""The host's ops as a table, and the access kinds over ImageBufs by which their functions are computed.

A row (`op`) says an op's name, help, kind, function and parameters. The kinds differ in what the function is given
before the parameters' values: buffers pixel for pixel (`PointOp`), with a halo or from elsewhere (remapping.py), whole
images (`AtOnce`), or a spec alone (`Respec`). OpenImageIO's functions give a window the same pixels whatever lies
around it, as long as what they look at is there (tests/test_streaming.py holds every op to it).
"""

from __future__ import annotations

import dataclasses
import functools
import operator
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from ..core.access import Pointwise, Whole
from ..core.image import Image, Part, Pixels, cropped, in_memory
from ..core.op import Kind, Op, Output, Space
from ..core.parameters import Parameter, declared, image, param
from ..core.window import Window
from ..deferred import oiio
from ..errors import ImageError, ParameterError, one_line

if TYPE_CHECKING:
    from ..session import Session

_OF_PARTS = ("subimages", "allsubimages")


@dataclass(frozen=True, kw_only=True)
class HostOp(Op):
    """Works part by part: on the first, on all, or on some."""

    prefix: ClassVar[str] = "--"
    mixes: ClassVar[bool] = True  # its pixels are other values than those of its source, not the same elsewhere
    keeps: ClassVar[bool] = False  # parts that it does not work on stay
    space: ClassVar[Space] = Space.ANY
    outputs: ClassVar[tuple[Output, ...]] = (Output("image", Kind.PIXELS, "the result"),)
    function: ClassVar[str | Callable[..., Any]]  # of ImageBufAlgo by its name, or ours

    subimages: str | None = param(
        None, help="parts to work on, by number or name with commas between them, or all; -N leaves one out"
    )
    allsubimages: bool | None = param(None, help="work on all parts; as -a says when left out")

    def result(self, parts: Sequence[Part], session: Session) -> Part:
        """The op's result from one part of each input."""
        raise NotImplementedError

    def operands_after(self, *given: Any) -> Sequence[Any]:
        """What the function takes after what its kind gives it: the parameters' values, in the order of declaration."""
        return [getattr(self, p.attribute) for p in self.parameters() if p.name not in _OF_PARTS]

    def called(self, *given: Any) -> Any:
        """What the function makes of buffers, or of what else its kind gives it, and of the parameters' values."""
        function = self.function
        called: Callable[..., Any] = getattr(oiio.ImageBufAlgo, function) if isinstance(function, str) else function
        return called(*given, *self.operands_after(*given))

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
        wanted = _chosen(self.subimages, first)
        everything = self.allsubimages if self.allsubimages is not None else session.settings.all_parts
        count = len(first.parts) if everything or self.subimages else 1
        if self.idle([part for n, part in enumerate(first.parts[:count]) if n in wanted]):
            return first
        parts = []
        for n, part in enumerate(first.parts[:count]):
            operands = [given.parts[min(n, len(given.parts) - 1)] for given in inputs]
            parts.append(self._worked(operands, session) if n in wanted else part)
        return Image((*parts, *(first.parts[count:] if self.keeps else ())), first.source)

    def _worked(self, parts: Sequence[Part], session: Session) -> Part:
        """The op's result; ids and coordinates stay what they are, and are refused where they would be mixed."""
        part = parts[0]
        if not part.exact:
            made, typed = self.result(parts, session), next((one for one in parts if one.typed), None)
            return made if typed is None else dataclasses.replace(made, stored=typed.stored, typed=True)
        if self.mixes:
            content = "source coordinates" if part.spec.format == oiio.FLOAT else "ids"
            raise ImageError(
                f"part '{part.name}' holds {content}, which the op would change: leave it out, with"
                f" :subimages=-{part.name} or without -a"
            )
        return dataclasses.replace(self.result(parts, session), stored=part.stored, exact=True)

    def inputs(self) -> list[Image]:
        """The images that it was given, in the order of declaration."""
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
        Its access kind, with the inputs and parameters that it shares with others.
    function : str or callable
        What computes it: of ImageBufAlgo by its name, or ours. Default: ImageBufAlgo's function of the op's name.
    **members
        Its parameters, in the order in which the function takes their values: a field, of the type of its default, or
        (type, field). All else is a fact of the class, such as `aliases`, or a method.
    """
    fields = fields_of(members)
    facts = members | {"__doc__": help, "name": name}
    facts["function"] = staticmethod(function) if callable(function) else function or name
    for field, *_ in fields:
        del facts[field]
    return dataclasses.make_dataclass(name, fields, bases=(kind,), namespace=facts, frozen=True, kw_only=True)


def fields_of(members: dict[str, Any]) -> list[tuple[str, type, Any]]:
    """Those members that are parameters: (name, type, field), as `make_dataclass` takes them."""
    fields = []
    for name, value in members.items():
        if isinstance(value, dataclasses.Field):
            fields.append((name, type(value.default), value))
        elif isinstance(value, tuple) and isinstance(value[-1], dataclasses.Field):
            fields.append((name, *value))
    return fields


def _chosen(subimages: str | None, first: Image) -> set[int]:
    """The numbers of the parts that a `subimages` modifier means."""
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
            raise ParameterError(
                f"subimages={subimages}: {first.source} has no part '{bare}'; it has {', '.join(names)}"
            )
    return (included or set(range(len(names)))) - excluded


@dataclass(frozen=True, kw_only=True)
class Hosted(HostOp):
    """Makes one image its own way: from none, from many, from all parts. The modifiers for parts are not its."""

    def __post_init__(self) -> None:
        for name in _OF_PARTS:
            if getattr(self, name) is not None:
                raise ParameterError(f"{self.name}: it has no modifier '{name}'")
        super().__post_init__()

    @classmethod
    def parameters(cls) -> tuple[Parameter, ...]:
        """The declared parameters."""
        return tuple(p for p in declared(cls)[1] if p.name not in _OF_PARTS)


def checked(buffer: oiio.ImageBuf) -> oiio.ImageBuf:
    """The buffer, unless it holds an error of OpenImageIO, which is raised as ImageError."""
    if buffer.has_error:
        raise ImageError(one_line(buffer.geterror()))
    return buffer


def like(spec: oiio.ImageSpec, **changes: Any) -> oiio.ImageSpec:
    """A copy of a spec with some of its attributes changed."""
    copy = oiio.ImageSpec(spec)
    for name, value in changes.items():
        setattr(copy, name, value)
    return copy


def filled(spec: oiio.ImageSpec, pixels: Pixels) -> oiio.ImageBuf:
    """A buffer of that spec with those pixels."""
    buffer = oiio.ImageBuf(spec)
    buffer.set_pixels(buffer.roi, pixels)
    return buffer


def window_of(roi: oiio.ROI) -> Window:
    """A region as a window."""
    return Window(roi.xbegin, roi.ybegin, roi.xend, roi.yend)


def sample(part: Part, window: Window) -> oiio.ImageBuf:
    """Black pixels of the part's kind: what an op makes of them tells the spec of its result."""
    spec = window.apply_to(part.spec)
    spec.set_format(part.working_type)
    return oiio.ImageBuf(spec)


def worked(part: Part) -> Part:
    """The part as ops of the host see it: its working type, written as computed pixels are."""
    spec = part.window.apply_to(part.spec)
    spec.set_format(part.working_type)
    return Part(part.name, spec, part.buffer, ready=part.ready)


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


@dataclass(frozen=True, kw_only=True)
class PointOp(HostOp, Pointwise):
    """Its function gets buffers of one data window, pixel for pixel."""

    def apply(self, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """The result over the data window that all buffers have."""
        return self.called(*buffers)

    def result(self, parts: Sequence[Part], session: Session) -> Part:
        """The result, not yet computed, over the data windows of all inputs together."""
        return pointwise(parts, functools.reduce(operator.or_, (part.window for part in parts)), self.apply)


@dataclass(frozen=True, kw_only=True)
class OneImage(PointOp):
    """One image, pixel by pixel."""

    source: Image = image(help="the image")


def pointwise(parts: Sequence[Part], whole: Window, apply: Callable[..., oiio.ImageBuf]) -> Part:
    """What `apply` makes of the pixels of parts over the data window `whole`, black where one has none."""
    corner = Window.sized(whole.left, whole.top, 1, 1)
    spec = checked(apply(*(sample(part, corner) for part in parts))).spec()

    def padded(part: Part, window: Window) -> oiio.ImageBuf:
        return (part if window & part.window == window else cropped(part, window)).buffer(window)

    def fetch(window: Window) -> oiio.ImageBuf:
        return checked(apply(*(padded(part, window) for part in parts)))

    return Part(parts[0].name, whole.apply_to(spec), fetch)


@dataclass(frozen=True, kw_only=True)
class AtOnce(HostOp, Whole):
    """Its function gets whole images, held."""

    def result_bytes(self, parts: Sequence[Part]) -> int:
        """Bytes that it needs in addition to its inputs."""
        return _bytes(parts[0])

    def result(self, parts: Sequence[Part], session: Session) -> Part:
        """The computed result."""
        session.resources.require(sum(map(_bytes, parts)) + self.result_bytes(parts), self.flag())
        return in_memory(parts[0].name, checked(self.called(*(part.buffer(part.window) for part in parts))))


def _bytes(part: Part) -> int:
    return part.spec.width * part.spec.height * part.spec.nchannels * 4


@dataclass(frozen=True, kw_only=True)
class Respec(HostOp, Pointwise):
    """Its function changes a spec: pixels stay; windows, channel names or metadata change."""

    mixes: ClassVar[bool] = False
    keeps: ClassVar[bool] = True
    deep: ClassVar[bool] = True

    source: Image = image(help="the image")

    def result(self, parts: Sequence[Part], session: Session) -> Part:
        """The part under its new spec, in its own type."""
        return parts[0].respecced(self.called)
