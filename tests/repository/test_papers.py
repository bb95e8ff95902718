# SPDX-License-Identifier: Apache-2.0
"""docs/explanation/papers.md leaves no figure of a paper out, and its lines are some that the program takes."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from benchmarks import figures
from oiiotex.oiiotool.cli.language.parse import parse, split_modifiers
from oiiotex.oiiotool.cli.vocabulary import LANGUAGE

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "explanation" / "papers.md").read_text()
CONTENTS = {  # counted in the papers: figures, tables, algorithms
    "LSA16": (15, 2, 2),
    "MJH17": (13, 0, 1),
    "LDR09": (8, 1, 0),
    "CZF02": (8, 2, 0),
    "HRRG08": (10, 0, 0),
}


def rows_of(paper: str) -> dict[str, list[str]]:
    """What stands in the first cell of a paper's rows, and the further cells."""
    section = re.split(r"^## ", PAGE, flags=re.MULTILINE)
    (text,) = (part for part in section if part.startswith(paper))
    lines = [line for line in text.splitlines() if line.startswith("| ")]
    cells = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines]
    names = [row[0] for row in cells[1:]]
    assert len(set(names)) == len(names)
    return {row[0]: row[1:] for row in cells[1:]}


def commands() -> list[str]:
    """All that is to be run, as it stands in the cells."""
    return re.findall(
        r"`((?:oiiotex|python -m) [^`]+)`", PAGE.replace("`python -m tools...` and `python -m benchmarks...`", "")
    )


@pytest.mark.parametrize("paper", CONTENTS)
def test_no_figure_is_left_out(paper):
    figures, tables, algorithms = CONTENTS[paper]
    wanted = {str(n) for n in range(1, figures + 1)}
    wanted |= {f"table {n}" for n in range(1, tables + 1)} | {f"algorithm {n}" for n in range(1, algorithms + 1)}
    rows = rows_of(paper)
    assert set(rows) == wanted
    for name, (command, seen) in rows.items():
        assert seen, name
        assert re.search(r"`(oiiotex|python -m) ", command) or command.startswith("none: "), name


@pytest.mark.parametrize("command", [c for c in commands() if c.startswith("oiiotex ")])
def test_every_line_is_one_that_the_program_takes(command):
    words = shlex.split(command)[1:]
    for step in parse(words, LANGUAGE).steps:
        if step.op is not None:
            _, given = split_modifiers(step.word)
            assert set(given) <= {p.name for p in step.op.modifiers()}, step.word


# --- figures ---


def test_figures_are_those_of_the_benchmarks():
    """If this fails: `python -m benchmarks.figures`."""
    assert figures.renewed(PAGE) == PAGE


def test_no_figure_is_stale():
    """If this fails: `python -m benchmarks TOPIC WORD` for the commands that it lists."""
    assert not [entry.command for entry in figures.entries(PAGE).values() if entry.is_stale]


def test_a_changed_benchmark_makes_its_results_stale(tmp_path, monkeypatch):
    (tmp_path / "benchmarks").mkdir()
    for name, text in (("one", "from benchmarks.two import N\n"), ("two", "N = 1  # few\n")):
        (tmp_path / "benchmarks" / f"{name}.py").write_text(text)
    monkeypatch.setattr(figures, "ROOT", tmp_path)
    command = "-m benchmarks.one --all"
    entry = figures.Entry(command, f"CPU, 2026-01-01, inputs {figures.inputs(command)}", "| a | 0.25 | 12 % |")
    assert (figures.value_of(entry, "a", 1), figures.shown(0.25, ".1"), figures.shown(9.6, "7")) == (12, ".2", "10")
    (tmp_path / "benchmarks" / "two.py").write_text('"""Now with a docstring."""\n\nN = 1\n')
    assert not entry.is_stale
    (tmp_path / "benchmarks" / "two.py").write_text("N = 2\n")
    assert entry.is_stale


@pytest.mark.parametrize("paper", CONTENTS)
def test_every_measured_figure_says_where_it_is_from(paper):
    """Decimals and times; those of the paper itself stand in clauses that name it."""
    for name, (_, *cells) in rows_of(paper).items():
        text = re.sub(r"`[^`]*`|\([^()]*\)", "", figures.FIGURE.sub("", " ".join(cells)))
        for clause in re.split(r"; |\. |: ", text):
            assert "paper" in clause or not re.search(r"\d*\.\d|\d (?:s|ms|MB|%)(?!\w)", clause), (name, clause)
