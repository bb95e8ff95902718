# SPDX-License-Identifier: Apache-2.0
"""The Python edge: an op's declaration as a function on OpenImageIO.ImageBuf."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import OpenImageIO as oiio

from ..errors import ParameterError
from ..images import Image, from_buffer, to_buffer
from ..op import Op
from ..params import nearest
from ..session import Session


def function_of(op: type[Op]) -> Callable[..., Any]:
    """A function of the op's images (positional ImageBufs) and parameters (keywords), with `session=` for the rest.

    It returns an ImageBuf, or a dict of them by name where the op was asked for more than one.
    """

    def function(*images: oiio.ImageBuf, session: Session | None = None, **values: Any) -> Any:
        return _outputs(op, _bound(op, images, values).compute(session or Session()))

    function.__name__ = function.__qualname__ = op.name
    function.__doc__ = _docstring(op)
    function.__signature__ = _signature(op)  # type: ignore[attr-defined]
    return function


def _bound(op: type[Op], images: tuple[oiio.ImageBuf, ...], values: dict[str, Any]) -> Op:
    declared = op.images()
    if len(images) != len(declared):
        raise ParameterError(
            f"{op.name} takes {len(declared)} images ({', '.join(i.name for i in declared)}), not {len(images)}"
        )
    known = [p.name for p in op.parameters()]
    for name in values:
        if name not in known:
            raise ParameterError(f"{op.name}: unknown parameter '{name}'{nearest(name, known)}")
    given: dict[str, Image] = {i.name: from_buffer(buffer) for i, buffer in zip(declared, images, strict=True)}
    return op(**given, **values)


def _outputs(op: type[Op], image: Image) -> Any:
    buffers = [to_buffer(part) for part in image.parts]
    if len(buffers) == 1:
        return buffers[0]
    return {output.name: buffer for output, buffer in zip(op.outputs, buffers, strict=False)}


def _signature(op: type[Op]) -> inspect.Signature:
    kinds = inspect.Parameter
    positional = [kinds(i.name, kinds.POSITIONAL_ONLY, annotation=oiio.ImageBuf) for i in op.images()]
    keywords = [kinds(p.name, kinds.KEYWORD_ONLY, default=p.default) for p in op.parameters()]
    session = kinds("session", kinds.KEYWORD_ONLY, default=None, annotation=Session | None)
    return inspect.Signature([*positional, *keywords, session])


def _docstring(op: type[Op]) -> str:
    lines = [inspect.getdoc(op) or "", "", "Parameters", "----------"]
    for i in op.images():
        lines += [f"{i.name} : ImageBuf", f"    {i.help}"]
    for p in op.parameters():
        lines += [f"{p.name} : {p.allowed()}, default {p.default}", f"    {p.help}"]
    lines += ["session : Session, optional", "    device, memory budget, colour config, progress"]
    lines += ["", "Returns", "-------", "ImageBuf, or a dict of them by name where more than one was asked for"]
    lines += [f"    {o.name}: {o.help}" for o in op.outputs]
    lines += ["", "Raises", "------", "oiiotex.Error", "    with one line that says what is wrong and what is allowed"]
    return "\n".join(lines)
