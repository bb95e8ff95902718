# SPDX-License-Identifier: Apache-2.0
"""The Python edge: an op's declaration as a function on OpenImageIO.ImageBuf."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import OpenImageIO as oiio

from .. import __version__
from ..errors import ImageError, ParameterError
from ..images import Image, Part, cropped, from_buffer, to_buffer
from ..op import Op
from ..params import nearest
from ..session import Session
from ..windows import Window

Images = oiio.ImageBuf | Mapping[str, oiio.ImageBuf]
"""An image of one part, or of several by their names, as the functions return them."""


def function_of(op: type[Op]) -> Callable[..., Any]:
    """A function of the op's images (positional) and parameters (keywords), with `session=` for the rest.

    Images that may be left out are keywords, too; one may be the name of a part of the first image. It returns an
    ImageBuf, or a dict of them by name where the op was asked for more than one; a list of these where it makes
    several images.
    """

    def function(
        *images: Images,
        roi: oiio.ROI | None = None,
        nthreads: int = 0,
        session: Session | None = None,
        **values: Any,
    ) -> Any:
        session = session or Session(threads=nthreads)
        made = result(_bound(op, images, values), session)
        return [_outputs(op, one, roi) for one in made] if isinstance(made, tuple) else _outputs(op, made, roi)

    function.__name__ = function.__qualname__ = op.name
    function.__doc__ = _docstring(op)
    function.__signature__ = _signature(op)  # type: ignore[attr-defined]
    return function


def result(op: Op, session: Session) -> Image | tuple[Image, ...]:
    """The op computed, its parts saying how they were made."""
    facts = {"oiiotex:version": __version__, **op.provenance()}

    def mark(spec: oiio.ImageSpec) -> None:
        for name, value in facts.items():
            spec.attribute(name, value)

    def marked(image: Image) -> Image:
        return Image(tuple(part.respecced(mark) for part in image.parts), image.source)

    made = op.compute(session)
    return tuple(map(marked, made)) if isinstance(made, tuple) else marked(made)


def _bound(op: type[Op], images: tuple[Images, ...], values: dict[str, Any]) -> Op:
    declared = op.taken(values)
    many = declared[0] if len(declared) == 1 and declared[0].many else None
    if not images if many else len(images) != len(declared):
        raise ParameterError(
            f"{op.name} takes {'one image or more' if many else f'{len(declared)} images'}"
            f" ({', '.join(i.name for i in declared)}), not {len(images)}"
        )
    optional = [i.name for i in op.optional_images()]
    further = op.further_images()
    known = [p.name for p in op.parameters()] + optional + ([further.name] if further else [])
    for name in values:
        if name not in known:
            raise ParameterError(f"{op.name}: unknown parameter '{name}'{nearest(name, known)}")
    held = tuple(map(_image, images))
    given: dict[str, Any] = {many.name: held} if many else {i.name: h for i, h in zip(declared, held, strict=True)}
    for name in optional:
        if values.get(name) is not None:
            given[name] = _keyword(op, name, values[name], held[0] if held else None)
    if further is not None and further.name in values:
        more = tuple(map(_image, values[further.name]))
        values = {further.count: 1 + len(more)} | values | {further.name: more}
    return op(**{**{i.name: None for i in op.images()}, **values, **given})


def _image(buffers: Images) -> Image:
    if not isinstance(buffers, Mapping):
        return from_buffer(buffers)
    if not buffers:
        raise ImageError("an image has at least one part")
    parts = [replace(from_buffer(buffer).first, name=name) for name, buffer in buffers.items()]
    return Image(tuple(parts), parts[0].name)


def _keyword(op: type[Op], name: str, value: Images | str, first: Image | None) -> Image:
    if not isinstance(value, str):
        return _image(value)
    part = first.part(value) if first is not None else None
    if part is None:
        has = ", ".join(p.name for p in first.parts) if first is not None else "none"
        raise ParameterError(f"{op.name}: {name}={value}: the image has no such part; it has {has}")
    return Image((part,), value)


def _outputs(op: type[Op], image: Image, roi: oiio.ROI | None) -> Any:
    buffers = [to_buffer(part if roi is None else _within(part, roi, op)) for part in image.parts]
    if len(buffers) == 1:
        return buffers[0]
    names = [part.name for part in image.parts]
    if op.outputs[0].name not in names[1:]:  # else the first is what was kept
        names[0] = op.outputs[0].name
    return dict(zip(names, buffers, strict=True))


def _within(part: Part, roi: oiio.ROI, op: type[Op]) -> Part:
    """The part's pixels in a region, its display window and metadata as they are."""
    window = Window(roi.xbegin, roi.ybegin, roi.xend, roi.yend) & part.window if roi.defined else part.window
    if window.empty:
        raise ParameterError(f"{op.name}: roi {roi} is outside the result {part.window}")
    return cropped(part, window)


def _signature(op: type[Op]) -> inspect.Signature:
    kinds = inspect.Parameter
    positional = [
        kinds(i.name, kinds.VAR_POSITIONAL if i.many else kinds.POSITIONAL_ONLY, annotation=Images) for i in op.images()
    ]
    further = [op.further_images()] if op.further_images() else []
    named = (*op.optional_images(), *further, *op.parameters())
    keywords = [kinds(p.name, kinds.KEYWORD_ONLY, default=p.default) for p in named]
    roi = kinds("roi", kinds.KEYWORD_ONLY, default=None, annotation=oiio.ROI | None)
    nthreads = kinds("nthreads", kinds.KEYWORD_ONLY, default=0, annotation=int)
    session = kinds("session", kinds.KEYWORD_ONLY, default=None, annotation=Session | None)
    return inspect.Signature([*positional, *keywords, roi, nthreads, session])


def _docstring(op: type[Op]) -> str:
    lines = [inspect.getdoc(op) or "", "", "Parameters", "----------"]
    for i in op.images():
        star = "*" if i.many else ""
        lines += [f"{star}{i.name} : ImageBuf, or a dict of them by part", f"    {i.help}"]
    for i in op.optional_images():
        lines += [f"{i.name} : ImageBuf, dict of them, or the name of a part of the first image; default None"]
        lines += [f"    {i.help}"]
    further = op.further_images()
    lines += [f"{further.name} : sequence of ImageBufs or dicts, default ()", f"    {further.help}"] if further else []
    for p in op.parameters():
        lines += [f"{p.name} : {p.allowed()}, default {p.default}", f"    {p.help}"]
    lines += ["roi : OpenImageIO.ROI, optional", "    compute only this region of the result"]
    lines += ["nthreads : int", "    CPU threads, where no session says it; 0: as many as the process may use"]
    lines += ["session : Session, optional", "    device, memory budget, colour config, progress"]
    lines += ["", "Returns", "-------", "ImageBuf, or a dict of them by name where more than one was asked for"]
    lines += ["    (a list of these where there are several images)"] if op.further_images() else []
    lines += [f"    {o.name}: {o.help}" for o in op.outputs]
    lines += ["", "Raises", "------", "oiiotex.Error", "    with one line that says what is wrong and what is allowed"]
    return "\n".join(lines)
