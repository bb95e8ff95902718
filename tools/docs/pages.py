# SPDX-License-Identifier: Apache-2.0
"""Docs pages and the stub from the filters' declarations: `python -m tools.docs.pages`.

A page is the declaration, followed by the hand-written text below the line `<!-- by hand -->`. Modifiers that several
filters declare alike have one page for all.
"""

from __future__ import annotations

import collections
import functools
from collections.abc import Callable, Sequence
from pathlib import Path

from oiiotex.engine.core.op import Op, Output
from oiiotex.engine.core.parameters import Parameter, declared
from oiiotex.filters import OURS
from oiiotex.oiiotool.cli.language.parse import Option
from oiiotex.oiiotool.cli.printing.report import description, on_a_line
from oiiotex.oiiotool.cli.vocabulary import LANGUAGE
from tools.docs import notebook, stubs

FOLDER = Path(__file__).parents[2] / "docs" / "reference"
MARK = "<!-- by hand -->"
SHARED = "shared_modifiers.md"  # next to the filters' pages
_IMAGE = "1 (the next image"  # values of an image, as on the page of shared modifiers
_LONG = 200  # characters of modifiers in a row
_ALIKE = 2  # filters that declare a modifier alike, from which on it is described once


def page_text(op: type[Op], path: Path) -> str:
    """The page's whole text; `path` is where its hand-written part is taken from."""

    def say(text: str) -> str:
        return on_a_line(text, op, "`")

    lines = [f"# {op.flag()}", "", say(description(op)), ""]
    images = " ".join(f"{i.name.upper()}" for i in op.images())
    lines += ["```", f"oiiotex {images} {op.flag()}[:MODIFIER=VALUE...] -o OUT", "```", ""]
    lines += ["| input | |", "|---|---|", *(f"| {i.name} | {say(i.help)} |" for i in op.images())]
    further = op.further_images()
    if further is not None:
        lines.append(f"| {further.name} | {further.help} One for each further value of {further.count}. |")
    lines.append("")
    own = [p for p in op.modifiers() if not _is_shared(p)]
    lines += _table([p for p in own if not p.advanced], say)
    if alike := [f"[`{p.name}`]({SHARED})" for p in op.modifiers() if _is_shared(p)]:
        lines += [f"Also: {', '.join(alike)}.", ""]
    advanced = _table([p for p in own if p.advanced], say)
    if advanced:
        heading = ['<details markdown="1">', "<summary>Advanced modifiers</summary>", ""]
        lines += [*heading, *advanced, "</details>", ""]
    lines += _outputs([o for o in op.outputs if o.text not in _shared_outputs()], say)
    lines += [
        f"Works in {op.space.value}; {op.reach}. Python: `oiiotex.filters.{op.name}`.",
        "",
    ]
    return "\n".join(lines) + f"\n{MARK}{_by_hand(path)}"


def shared_text() -> str:
    """The page of the modifiers that several filters declare alike."""
    shared = {_looks(p): p for op in OURS for p in op.modifiers() if _is_shared(p)}
    modifiers = sorted(shared.values(), key=lambda p: p.name)
    lines = [
        "# Shared modifiers",
        "",
        "Modifiers that several filters have. `oiiotex --help :NAME` lists the filters of one.",
        "",
    ]
    image = next(p.allowed() for p in modifiers if p.allowed().startswith(_IMAGE))
    outputs = _outputs(list(_shared_outputs().values()), str)
    return "\n".join([*lines, *_table(modifiers, str), f"*image*: {image}.", "", *outputs])


def _outputs(outputs: Sequence[Output], say: Callable[[str], str]) -> list[str]:
    """A table of outputs."""
    rows = [f"| {o.name} | {say(o.text)} |" for o in outputs]
    return ["| output | |", "|---|---|", *rows, ""] if rows else []


def _looks(parameter: Parameter) -> tuple[str, ...]:
    """What a page says of a modifier."""
    p = parameter
    return p.name, p.help, p.allowed(), p.default_text


@functools.cache
def _shared() -> set[tuple[str, ...]]:
    """What the page of shared modifiers says: one meaning for each name."""
    counts = collections.Counter(_looks(p) for op in OURS for p in op.modifiers())
    alike = [looks for looks, count in counts.items() if count >= _ALIKE]
    names = collections.Counter(looks[0] for looks in alike)
    return {looks for looks in alike if names[looks[0]] == 1}


@functools.cache
def _shared_outputs() -> dict[str, Output]:
    """Outputs that shared modifiers request, by their text."""
    counts = collections.Counter(o.text for op in OURS for o in op.outputs)
    names = {looks[0] for looks in _shared()}
    return {o.text: o for op in OURS for o in op.outputs if o.asked_by in names and counts[o.text] >= _ALIKE}


def _is_shared(parameter: Parameter) -> bool:
    return _looks(parameter) in _shared()


def _table(modifiers: Sequence[Parameter], say: Callable[[str], str]) -> list[str]:
    """A table of modifiers with values and defaults."""
    rows = []
    for p in modifiers:
        values = f"[image]({SHARED})" if p.allowed().startswith(_IMAGE) else p.allowed()
        text = say(p.help).replace("docs/reference/report.md", "[reports](../report.md)")
        cells = (f"`{p.name}`", text, values, p.default_text)
        rows.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    heading = ["| modifier | description | values | default |", "|---|---|---|---|"]
    return [*heading, *rows, ""] if rows else []


def _by_hand(path: Path) -> str:
    return path.read_text().partition(MARK)[2] if path.exists() else "\n"


def language_text() -> str:
    """The page of all ops of the host, and of all options."""
    lines = ["# Ops and options", ""]
    lines += ["All ops and options other than the texture filters. `oiiotex --help NAME` prints the page of one.", ""]
    for heading, ops in LANGUAGE.ops.items():
        if ops and ops[0].prefix != Op.prefix:
            lines += [f"## {heading}", "", "| op | modifiers | |", "|---|---|---|", *map(_op_row, ops), ""]
    for heading, options in LANGUAGE.groups.items():
        lines += [f"## {heading}", "", "| option | modifiers | |", "|---|---|---|", *_option_rows(options), ""]
    lines += ["## Options of oiiotool that are not available", "", "| option | why |", "|---|---|"]
    lines += [f"| `{refused.name}` | {refused.reason} |" for refused in LANGUAGE.refused]
    return "\n".join(lines) + "\n"


def _op_row(op: type[Op]) -> str:
    call = " ".join((op.flag(), *(p.name.upper() for p in op.arguments())))
    own = [p.name for p in op.modifiers() if p.name not in ("subimages", "allsubimages")]
    return f"| `{call}` | {', '.join(own)} | {description(op).splitlines()[0]} |"


def _option_rows(options: Sequence[Option]) -> list[str]:
    """A row for each option; many modifiers that two options share are listed once."""
    rows, listed = list[str](), dict[str, str]()
    for option in options:
        modifiers = ", ".join(p.name for p in declared(option.modifiers)[1]) if option.modifiers else ""
        first = listed.setdefault(modifiers, option.name)
        own = f"as `{first}`" if first != option.name and len(modifiers) > _LONG else modifiers
        text = option.help.replace("|", "\\|")
        rows.append(f"| `{' '.join((option.name, *option.arguments))}` | {own} | {text} |")
    return rows


def main() -> None:
    """Write all pages."""
    (FOLDER / "chain.md").write_text(language_text())
    (FOLDER / "filters" / SHARED).write_text(shared_text())
    for op in OURS:  # not of packages that happen to be installed
        path = FOLDER / "filters" / f"tex{op.name}.md"
        path.write_text(page_text(op, path))
        print(path)
    stubs.main()
    notebook.main()


if __name__ == "__main__":
    main()
