# SPDX-License-Identifier: Apache-2.0
"""The figures on the page of the papers, from benchmarks/results: `python -m benchmarks.figures` renews the page.

A figure on docs/explanation/papers.md is followed by a comment that says where it is from:

    .95<!--dominant: composites; mean diffusion repaired; 1-->

The topic's page, the end or a part of the command, the beginning of a line of its output (without the bars of a table),
and which of the line's further numbers, the first being 0. The figure keeps its number of decimals. The page ends with
a table of these commands and their dates.

A command's line in the results ends with a hash of its inputs: the command, and the benchmark's modules without
imports, comments and docstrings. If these change, the result is stale, and tests/repository/test_papers.py fails until
`python -m benchmarks TOPIC WORD` has renewed it.
"""

from __future__ import annotations

import ast
import hashlib
import re
import shlex
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "explanation" / "papers.md"
RESULTS = ROOT / "benchmarks" / "results"
FIGURE = re.compile(r"(\d*\.?\d+)<!--(\w+): ([^;\n]+); ([^\n]+?); (\d+)-->")
ENTRY = re.compile(r"^`python (-m [^`]+)` \((.*)\)\n((?:(?!## |`python -m ).*\n?)*)", re.MULTILINE)
HEAD = "## Where the figures are from\n"
_NUMBER = re.compile(r"(?<![\w.])-?(?:\d+\.?\d*|\.\d+)")
_IMPORT = re.compile(r"^from (benchmarks\.[\w.]+) import", re.MULTILINE)


class Entry(NamedTuple):
    """A command of a results page."""

    command: str
    facts: str  # machine, date, inputs
    output: str

    @property
    def is_stale(self) -> bool:
        """Whether its inputs have changed since it was run."""
        return not self.facts.endswith(f"inputs {inputs(self.command)}")


def inputs(command: str) -> str:
    """A hash of a command and of the benchmark's modules, without imports, comments and docstrings."""
    waiting, seen = [word for word in shlex.split(command) if word.startswith("benchmarks.")], dict[str, str]()
    while waiting:
        name = waiting.pop()
        path = ROOT.joinpath(*name.split(".")).with_suffix(".py")
        if name in seen or not path.is_file():
            continue
        text = path.read_text()
        seen[name] = _code(text)
        waiting += _IMPORT.findall(text)
    return hashlib.sha256("\0".join([command, *(seen[name] for name in sorted(seen))]).encode()).hexdigest()[:8]


def _code(text: str) -> str:
    """Without imports, which only say where things are, comments and docstrings."""
    tree = ast.parse(text)
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            body[:] = [
                line for line in body if not isinstance(line, ast.Import | ast.ImportFrom) and not _is_text(line)
            ]
    return ast.unparse(tree)


def _is_text(line: ast.AST) -> bool:
    return isinstance(line, ast.Expr) and isinstance(line.value, ast.Constant) and isinstance(line.value.value, str)


def entry_of(topic: str, word: str) -> Entry:
    """The one command of a topic that ends with a word, or else contains it."""
    entries = [Entry(*match) for match in ENTRY.findall((RESULTS / f"{topic}.md").read_text())]
    found = [entry for entry in entries if entry.command.endswith(word)]
    (entry,) = found or [entry for entry in entries if word in entry.command]
    return entry


def value_of(entry: Entry, begin: str, number: int) -> float:
    """A number in the line of its output that begins with a text."""
    lines = (" ".join(line.replace("|", " ").split()) for line in entry.output.splitlines())
    found = [line for line in lines if line.startswith(begin)]
    if len(found) != 1:
        raise ValueError(f"{len(found)} lines begin with '{begin}' in the output of python {entry.command}: expected 1")
    return float(_NUMBER.findall(found[0].removeprefix(begin))[number])


def shown(value: float, like: str) -> str:
    """A value with the decimals of another, and no zero before the point."""
    decimals = len(like.partition(".")[2])
    text = f"{value:.{decimals}f}"
    return text.removeprefix("0") if decimals else text


def entries(page: str) -> dict[str, Entry]:
    """The commands that a page has figures of."""
    found = (entry_of(topic, word) for _, topic, word, _, _ in FIGURE.findall(page))
    return {entry.command: entry for entry in found}


def renewed(page: str) -> str:
    """The page with all figures and the table of commands up to date."""

    def figure(match: re.Match[str]) -> str:
        old, topic, word, begin, number = match.groups()
        value = value_of(entry_of(topic, word), begin, int(number))
        return f"{shown(value, old)}{match[0][len(old) :]}"

    text = FIGURE.sub(figure, page.partition(HEAD)[0]).rstrip()
    rows = [f"| `python {entry.command}` | {entry.facts} |" for _, entry in sorted(entries(page).items())]
    return "\n".join([text, "", HEAD, "| command | machine, date, hash of its inputs |", "|---|---|", *rows, ""])


if __name__ == "__main__":
    PAGE.write_text(renewed(PAGE.read_text()))
