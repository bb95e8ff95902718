# SPDX-License-Identifier: Apache-2.0
"""Help pages of ops, options and modifiers, and the table of --runstats."""

from __future__ import annotations

import itertools
import re
import shutil
import textwrap
from collections.abc import Iterator, Sequence

from .... import filters
from ....engine.core.op import Op
from ....engine.core.parameters import Parameter, nearest
from ....engine.errors import ParameterError
from ....engine.stats import Stats
from ..language.parse import Option, Refused, names_of
from ..vocabulary import LANGUAGE

_WIDEST = 110  # columns: longer lines are hard to read
_WRAPS = "An image that tiles (its wrapmodes are periodic) is repeated beyond its border."
_UNTILES = "The result does not tile: it loses periodic wrapmodes."


def declarations() -> Iterator[tuple[str, tuple[str, ...], str, tuple[Parameter, ...]]]:
    """Of each op and option: its name, its arguments, its summary, its modifiers."""
    for one in itertools.chain.from_iterable(LANGUAGE.group("all").values()):
        if isinstance(one, Option):
            yield one.name, one.arguments, one.help, one.parameters()
        else:
            yield one.flag(), tuple(p.name.upper() for p in one.arguments()), summary(one), one.modifiers()


def overview(word: str = "all") -> str:
    """All ops and options under their headings, or those of one group."""
    lines: list[str] = []
    for heading, group in LANGUAGE.group(word).items():
        hint = f" (--help {LANGUAGE.words[heading]})" if word == "all" else ""
        lines += [f"{heading}{hint}:", *map(_row, group), ""]
    return "\n".join(lines).rstrip()


def call(op: type[Op]) -> str:
    """An op with its arguments."""
    return " ".join((op.flag(), *(p.name.upper() for p in op.arguments())))


def _row(one: type[Op] | Option) -> str:
    name, text = (one.call, one.help) if isinstance(one, Option) else (call(one), summary(one))
    return f"  {name:28s} {text}" if len(name) <= 28 else f"  {name}\n{' ' * 31}{text}"


def find(name: str) -> type[Op] | Option | Refused:
    """The op or option of a name with or without dashes: --warp is the host's, and a bare 'warp' is --texwarp.

    Raises a ParameterError for an unknown name.
    """
    try:
        return LANGUAGE.find(name if name.startswith("-") else f"--tex{name}")
    except ParameterError:
        return LANGUAGE.find(name if name.startswith("-") else f"--{name}")


def page(name: str) -> str:
    """The page of an op or option, or with `:NAME` after it of one modifier."""
    name, colon, modifier = name.partition(":")
    declaration = find(name)
    if isinstance(declaration, Refused):
        return f"{declaration.name} of oiiotool is not supported: {declaration.reason}"
    if colon:
        return _modifier_page(declaration, modifier)
    if isinstance(declaration, Option):
        rows = _modifier_rows(declaration.parameters(), declaration)
        return "\n".join([declaration.call, "", _filled(f"{declaration.help}."), *(["", *rows] if rows else [])])
    return _op_page(declaration)


def _modifier_page(declaration: type[Op] | Option, name: str) -> str:
    flag = names_of(declaration)[0]
    known = {
        p.name: p for p in (declaration.parameters() if isinstance(declaration, Option) else declaration.modifiers())
    }
    if name not in known:
        hint = f"it has {', '.join(known) or 'none'}"
        raise ParameterError(f"{flag} has no modifier '{name}'{nearest(name, known)}", hint=hint)
    one = known[name]
    example = f"\n\nExample: {flag}:{name}={one.sample}" if one.sample else ""
    return f"{flag}:{name}=\n\n{textwrap.fill(described(one, declaration), columns())}{example}"


def described(modifier: Parameter, declaration: type[Op] | Option | Refused) -> str:
    """The help of a modifier with its values and its default."""
    return modifier.described(on_a_line(modifier.help, declaration) if isinstance(declaration, type) else modifier.help)


def _op_page(op: type[Op]) -> str:
    from ...host.kinds import HostOp  # the overview needs no op

    images = " ".join(i.name for i in op.images())
    further = op.further_images()
    images += f" {further.name}" if further else ""
    paragraphs = on_a_line(description(op), op).split("\n\n")
    lines = [f"{call(op)}  ({images} -> {op.main().name})", "", "\n\n".join(map(_filled, paragraphs))]
    if op.arguments():
        lines += ["", "Arguments:", *(_entry(p.name.upper(), described(p, op)) for p in op.arguments())]
    lines += ["", *(_modifier_rows(op.modifiers(), op) or ["Modifiers: none"])]
    if len(op.outputs) > 1 or op.prefix == Op.prefix:
        lines += ["", "Outputs:", *(_entry(o.name, on_a_line(o.text, op)) for o in op.outputs)]
    if issubclass(op, HostOp) and (op.wraps or op.untiles):
        lines += ["", _filled(_WRAPS if op.wraps else _UNTILES)]
    return "\n".join([*lines, "", _filled(f"Works in {op.space.value}; {op.reach}.")])


def summary(op: type[Op]) -> str:
    """The first line of an op's docstring."""
    return on_a_line(description(op).splitlines()[0].rstrip("."), op)


_NAMED = re.compile(r"`(\w+)`(?: with `(\w+)`)?")


def on_a_line(text: str, op: type[Op], quote: str = "") -> str:
    """Text of an op's declaration, with other filters as on a line: `label` with `photo` becomes --texlabel:photo=1."""
    flags = {name.removeprefix("--tex"): name for shelf in filters.SHELVES for name in shelf.names}
    own = {p.name for p in op.modifiers()}

    def flag(named: re.Match[str]) -> str:
        name, modifier = named.groups()
        if name not in flags or (name in own and not modifier):
            return named.group()
        return f"{quote}{flags[name]}{f':{modifier}=1' if modifier else ''}{quote}"

    return _NAMED.sub(flag, text)


def description(op: type[Op]) -> str:
    """An op's docstring."""
    head, _, rest = (op.__doc__ or "").partition("\n")
    return f"{head}\n{textwrap.dedent(rest)}".strip()


def _modifier_rows(modifiers: Sequence[Parameter], declaration: type[Op] | Option) -> list[str]:
    """Their help, the advanced ones last."""
    common = [_entry(f":{p.name}", described(p, declaration)) for p in modifiers if not p.advanced]
    advanced = [_entry(f":{p.name}", described(p, declaration)) for p in modifiers if p.advanced]
    return [*(["Modifiers:", *common] if common else []), *(["Advanced modifiers:", *advanced] if advanced else [])]


def _entry(name: str, text: str) -> str:
    return textwrap.fill(text, columns(), initial_indent=f"  {name:12s} ", subsequent_indent=" " * 15)


def _filled(text: str) -> str:
    return textwrap.fill(text, columns())


def columns() -> int:
    """Columns of the terminal, at most 110; 110 where the output is not a terminal."""
    return min(shutil.get_terminal_size((_WIDEST, 0)).columns, _WIDEST)


def time_table(stats: Stats, wall: float) -> str:
    """The text of --runstats."""
    rows = [f"  {name:28s} {seconds:8.3f} s {stats.calls[name]:6d} x" for name, seconds in stats.seconds.items()]
    return "\n".join([f"time: {wall:.3f} s", *rows])
