# SPDX-License-Identifier: Apache-2.0
"""An op's declaration for Python: signature, forms of a call, docstring. The stub is generated from it.

Types are strings, so no large library is imported.
"""

from __future__ import annotations

import dataclasses
import inspect
import textwrap
from pathlib import Path

from ..engine.core.op import Kind, Op, Output
from ..engine.core.parameters import Numbers, Parameter, Size, SizeRule, Words
from ..engine.errors import PYTHON, spelled

_NAMES = {
    int: "int", float: "float", bool: "bool", str: "str", Path: "FileName", Size: "tuple[int, int]",
    Numbers: "float | Sequence[float]", Words: "Sequence[str]", SizeRule: "Literal['pow2']",
}  # fmt: skip
_COMMON: tuple[tuple[str, str, int | None, str], ...] = (  # name, type, default, help
    ("colorspace", "str | None", None, "Color space of the required images. Default: the one in their metadata."),
    ("roi", "ROI | None", None, "Region of the result to compute. Default: all of it."),
    ("nthreads", "int", 0, "Number of CPU threads if no session is given. 0: all that the process may use."),
    ("session", "Session | None", None, "Device, memory budget, color config and progress, shared by several calls."),
    ("as_array", "bool", False, "Return arrays of pixels instead of ImageBufs, without color space and metadata."),
)
SINGLE, PARTS, ARRAY = "ImageBuf", "dict[str, ImageBuf]", "Array"


def annotation(parameter: Parameter) -> str:
    """The type of a parameter, or of an input image, as a string."""
    if parameter.kind is None:
        name = "Sequence[ImageLike]" if parameter.count else "ImageLike"
        return name if parameter.default is not None else f"{name} | None"
    if parameter.choices:
        literals = ", ".join(repr(choice) for choice in parameter.choices if choice is not None)
        names = [f"Literal[{literals}]"]
    else:
        names = [_NAMES[kind] for kind in parameter.kind]
    optional = ["None"] if parameter.default is None else []
    return " | ".join(dict.fromkeys([*names, *optional]))


@dataclasses.dataclass(frozen=True)
class Form:
    """One way to call an op: the differences from its full signature, and the resulting return type.

    Attributes
    ----------
    narrowed : dict of str to str
        Narrowed types of the parameters that select this way.
    required : tuple of str
        Those of them that are required.
    returns : str
    """

    narrowed: dict[str, str]
    required: tuple[str, ...]
    returns: str


def forms(op: type[Op]) -> tuple[Form, ...]:
    """The ways to call an op, from the simplest to the most general, as overloads for type checkers."""
    asked = {o.asked_by: o for o in op.outputs if o.asked_by and o.kind.is_image and not o.instead}
    flags = {p.name: p for p in op.parameters() if p.name in asked and bool in (p.kind or ())}
    # the call alone does not determine the number of parts of outputs that may be several or none
    certain = [n for n in flags if not asked[n].name.endswith(".N") or asked[n].of]
    plain = SINGLE if not op.main().name.endswith(".N") else f"{SINGLE} | {PARTS}"
    several = _several(op)
    alone = {name: "Literal[1]" if name in {p.name for p in op.parameters()} else "tuple[()]" for name in several}
    if "onepart" in {p.name for p in op.parameters()}:  # one part for many
        alone["onepart"] = "Literal[False]"
    quiet = {n: _without_true(p, asked[n]) for n, p in flags.items()}
    one_part = {i.name: "Picture" for i in op.images()[:1] if op.carries}
    every = f"{SINGLE} | {PARTS}" if flags or op.carries or plain != SINGLE else SINGLE
    last = f"{every} | list[{SINGLE}] | list[{PARTS}]" if several else every
    ways = [Form(quiet | alone | one_part, (), plain)]
    ways += [Form({name: "Literal[True]"} | alone, (name,), PARTS) for name in certain]
    return (*(form for form in ways if form.returns != last), Form({}, (), last))


def _several(op: type[Op]) -> tuple[str, ...]:
    """The parameters and inputs that make it return several images."""
    further = op.further_images()
    if further is None:
        return ()
    known = {further.name, *(p.name for p in op.parameters())}
    return tuple(name for name in ("variants", further.name) if name in known)


def _without_true(parameter: Parameter, output: Output) -> str:
    named = Path in (parameter.kind or ()) and output.kind is not Kind.CRYPTOMATTE
    return "FileName | Literal[False]" if named else "Literal[False]"


def signature(op: type[Op], form: Form | None = None, arrays: bool | None = None) -> inspect.Signature:
    """Signature of the op's function, or of one form of it, with or without arrays as results; types are strings."""
    form = form or forms(op)[-1]
    kinds = inspect.Parameter
    first = [
        kinds(
            i.name,
            kinds.VAR_POSITIONAL if i.many else kinds.POSITIONAL_ONLY,
            annotation=form.narrowed.get(i.name, annotation(i)) + (" | None" if i in replaceable(op) else ""),
            default=None if i in replaceable(op) else kinds.empty,
        )
        for i in op.images()
    ]
    keywords = [
        kinds(
            p.attribute,
            kinds.KEYWORD_ONLY,
            default=kinds.empty if p.name in form.required or p.required else p.default,
            annotation=form.narrowed.get(p.name, annotation(p)),
        )
        for p in _keywords(op)
        if not (form.narrowed and p.count and p.kind is None)
    ]
    common = [kinds(name, kinds.KEYWORD_ONLY, default=d, annotation=text) for name, text, d, _ in _COMMON]
    if arrays is not None:
        last = common[-1].replace(annotation=f"Literal[{arrays}]")
        common[-1] = last.replace(default=kinds.empty) if arrays else last
    returns = form.returns
    if arrays:  # calls that return one array are by far the most
        returns = ARRAY if returns == SINGLE else f"{ARRAY} | Any"
    return inspect.Signature([*first, *keywords, *common], return_annotation=returns)


def replaceable(op: type[Op]) -> tuple[Parameter, ...]:
    """The images that a graph or a label can replace, which are then optional."""
    taken = op.taken({"graph": "g", "replace": 1})
    return tuple(i for i in op.images() if i not in taken and not i.many)


def _keywords(op: type[Op]) -> tuple[Parameter, ...]:
    further = op.further_images()
    return (*op.optional_images(), *([] if further is None else [further]), *op.parameters())


def docstring(op: type[Op]) -> str:
    """The op's docstring in numpydoc format, with parameters, results and an example."""
    shown = signature(op).parameters
    lines = [inspect.getdoc(op) or "", *_section("Parameters")]
    for i in op.images():
        star = "*" if i.many else ""
        lines += _entry(f"{star}{i.name} : {shown[i.name].annotation}", spelled(i.help, PYTHON))
    few = [p for p in _keywords(op) if p.advanced]
    for p in _keywords(op):
        lines += [] if p in few else _described(p)
    for name, text, value, meaning in _COMMON:
        lines += _entry(f"{name} : {text}, default {value!r}", meaning)
    lines += [*_section("Returns"), forms(op)[-1].returns]
    lines += ["    A dict of parts by name if more than one part is requested."] if len(forms(op)) > 1 else []
    lines += ["    A list of these if several images are made."] if _several(op) else []
    for o in op.outputs:
        lines += _entry("", f"- {o.name}: {spelled(o.text, PYTHON)}", "      ")
    lines += _section("Other Parameters") if few else []
    lines += [line for p in few for line in _described(p)]
    lines += [
        *_section("Raises"),
        "oiiotex.Error",
        "    With the problem, the expected value and a hint, in one line.",
    ]
    example = op.example or (f'>>> made = filters.{op.name}("photo.png")' if len(op.images()) == 1 else "")
    if example:
        lines += [*_section("Examples"), ">>> from oiiotex import filters", *example.rstrip().splitlines()]
    return "\n".join(lines)


def _section(title: str) -> list[str]:
    return ["", title, "-" * len(title)]


def _entry(head: str, text: str, indent: str = "    ") -> list[str]:
    """A line of numpydoc, followed by its wrapped description."""
    return [head] * bool(head) + textwrap.wrap(
        text, 100, initial_indent="    ", subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
    )


def _described(p: Parameter) -> list[str]:
    default = "" if p.required else f", default {p.default!r}"
    text = spelled(p.help, PYTHON)
    text += " A string is the name of a part of the first image, or a file name." if p.kind is None else ""
    text += f" Expected: {spelled(p.expected, PYTHON)}." if p.ge is not None or p.le is not None or p.unit else ""
    text += f" Default: {spelled(p.unset, PYTHON)}." if p.unset else ""
    return _entry(f"{p.attribute} : {annotation(p)}{default}", text)
