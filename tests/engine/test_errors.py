# SPDX-License-Identifier: Apache-2.0
"""Errors carry fields, and each front end says them in its own words; nobody reads another's text."""

from __future__ import annotations

import ast
import pickle
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from oiiotex import filters
from oiiotex.engine.errors import (
    PYTHON,
    Error,
    MemoryBudgetError,
    ParameterError,
    failure_of,
    modifier,
    of_facts,
    reason_of,
    spelled,
    texture_filter,
)
from oiiotex.engine.session import Session
from oiiotex.oiiotool.cli.running.line_run import run
from tests import pictures
from tests.conftest import save
from tests.refusals import refused

ROOT = Path(__file__).parents[2]
PHOTO = np.rint(255 * pictures.stained(pictures.bricks(48, 56, seed=1))).astype(np.uint8)
SRGB = "srgb_rec709_scene"
# rooms that only the command lines use, and may speak of options
OF_LINES = ("oiiotex/oiiotool/", "studio/")
# who reads what foreign libraries alone say in text, and why
FOREIGN = {"studio/oiiotex_studio/library/runs.py": "SQLite has no code for a table that is missing"}


@pytest.fixture(scope="module")
def trees() -> list[tuple[str, ast.Module]]:
    paths = sorted([*(ROOT / "oiiotex").rglob("*.py"), *(ROOT / "studio" / "oiiotex_studio").rglob("*.py")])
    return [(path.relative_to(ROOT).as_posix(), ast.parse(path.read_text())) for path in paths]


# --- no prose as protocol ---

_MATCHES = {
    "startswith", "endswith", "removeprefix", "removesuffix", "partition", "rpartition", "split", "find", "index",
    "count", "replace", "search", "match", "fullmatch", "sub", "findall", "finditer",
}  # fmt: skip
_TEXTS = {"args", "error", "expected", "hint", "problem", "reason", "reasons"}


def is_text(node: ast.AST, named: set[str]) -> bool:
    """Whether it is what an error says: `str(error)`, an f-string of it, one of its fields, or a name of these."""
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "str":
        return any(isinstance(each, ast.Name) and each.id in named for each in ast.walk(node))
    if isinstance(node, ast.Call):
        return isinstance(node.func, ast.Name) and any(is_text(each, named) for each in node.args)
    if isinstance(node, ast.JoinedStr):
        return any(isinstance(each, ast.Name) and each.id in named for each in ast.walk(node))
    if isinstance(node, ast.Attribute):
        return node.attr in _TEXTS and isinstance(node.value, ast.Name)
    return isinstance(node, (ast.Subscript, ast.Starred)) and is_text(node.value, named)


def is_word(node: ast.Compare) -> bool:
    """Whether it compares with a text that is written there."""
    return any(isinstance(side, (ast.Constant, ast.JoinedStr)) for side in (node.left, *node.comparators))


def matched(tree: ast.AST) -> list[int]:
    """Lines that look for words in what an error says."""
    named = {n.name for n in ast.walk(tree) if isinstance(n, ast.ExceptHandler) and n.name}
    lines = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Compare) and (isinstance(node.ops[0], (ast.In, ast.NotIn)) or is_word(node)):
            read = [node.left, *node.comparators]
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in _MATCHES:
            read = [node.func.value, *node.args]
        else:
            continue
        if any(is_text(each, named) for each in read):
            lines.append(node.lineno)
    return lines


@pytest.mark.parametrize(
    "line",
    [
        "'x' in str(error)", "str(error).startswith('x')", "re.search('x', f'{error}')", "'x' in self.error",
        "error.args[0] == 'x'", "'x' not in error.problem", "one_line(str(error)).removeprefix('x')",
        "any('x' in text for text in found) or 'y' in outcome.reasons",
    ],
)  # fmt: skip
def test_the_scan_sees_who_reads_the_text_of_an_error(line):
    assert matched(ast.parse(f"try:\n    work()\nexcept Error as error:\n    {line}\n"))


def test_no_module_reads_the_text_of_an_error(trees):
    assert {path: lines for path, tree in trees if path not in FOREIGN and (lines := matched(tree))} == {}


def test_no_error_outside_of_the_command_lines_spells_out_an_option(trees):
    """There, options and flags are marked: `modifier`, `texture_filter`, `either`."""
    bare = re.compile(rf"--\w|\b({'|'.join(FLAGS)})=[01]\b")
    for path, tree in trees:
        if path.startswith(OF_LINES) or path == "oiiotex/engine/errors.py":
            continue
        for raised in (n for n in ast.walk(tree) if isinstance(n, ast.Raise) and n.exc is not None):
            marked = {id(c) for call in ast.walk(raised) if is_either(call) for c in ast.walk(call)}
            for text in (n for n in ast.walk(raised) if isinstance(n, ast.Constant) and id(n) not in marked):
                assert not (isinstance(text.value, str) and bare.search(text.value)), f"{path}:{text.lineno}"


FLAGS = sorted({p.name for op in filters.FILTERS for p in op.parameters() if bool in (p.kind or ())})


def is_either(node: ast.AST) -> bool:
    return isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "either"


# --- each in its own words ---

# what is wrong: words of a line behind the photo, values of a call, what the line says, what Python says
WRONG: dict[str, tuple[str, dict[str, object], str, str]] = {
    "range": ("stationarize:sigma=0", {"sigma": 0}, "sigma=0: expected a number from 0.5 to 1000000 px", ""),
    "word": (
        "stationarize:tiles=z", {"tiles": "z"}, "tiles=z: expected one of none, x, y, xy",
        "tiles='z': expected one of 'none', 'x', 'y', 'xy'",
    ),
    "size": (
        "stationarize:size=0x64", {"size": (0, 64)}, "size=0x64: expected pow2 or WIDTHxHEIGHT from 5 to 65536 px",
        "size=(0, 64): expected 'pow2' or (width, height) from 5 to 65536 px",
    ),
    "requires": ("synth:tiles=xy", {"tiles": "xy"}, "tiles=xy requires size", "tiles=xy requires size"),
    "conflict": (
        "estimateheight:light=3:overcast=1", {"light": 3, "overcast": True}, "light=3: conflicts with overcast=1",
        "light='3': conflicts with overcast=True",
    ),
    "paper": (
        "stationarize:paper=1:histogram=0.5", {"paper": True, "histogram": 0.5},
        "histogram=0.5: conflicts with paper=1: expected histogram=1",
        "histogram=0.5: conflicts with paper=True: expected histogram=1",
    ),
    "switch": ("label:onepart=1", {"onepart": True}, "requires cryptomatte=1", "requires cryptomatte=True"),
    "labels": (
        "quilt:label=1", {"label": 1}, "has no label parts; create them with --texlabel:photo=1",
        "has no label parts; create them with filters.label(photo=True)",
    ),
    "panels": ("preview:panels=no", {"panels": ["no"]}, "panels=no: expected ", "panels=('no',): expected "),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_a_line_and_a_call_say_the_same_in_their_own_words(name, tmp_path, monkeypatch):
    word, values, line, python = WRONG[name]
    op = word.partition(":")[0]
    monkeypatch.chdir(tmp_path)
    save(PHOTO, tmp_path / "photo.png")
    with pytest.raises(Error) as of_line:
        run(["photo.png", "--iscolorspace", SRGB, f"--tex{word}", "-o", "out.exr"])
    with pytest.raises(Error) as of_call:
        getattr(filters, op)(PHOTO, colorspace=SRGB, **values)
    assert str(of_line.value).startswith(f"--tex{op} : ") and line in str(of_line.value)
    assert str(of_call.value).startswith(f"{op}: ") and (python or line) in str(of_call.value)
    assert type(of_line.value) is type(of_call.value)
    for field in ("parameter", "problem", "expected", "hint"):
        said = [re.sub(r"\S+\.png|array", "IMAGE", getattr(e.value, field)) for e in (of_line, of_call)]
        assert said[0] == said[1], field


def test_words_are_spelled_by_who_says_them():
    for text, line, python in (
        (modifier(mask=True), "mask=1", "mask=True"),
        (modifier(render=False, seed=3), "render=0:seed=3", "render=False, seed=3"),
        (texture_filter("label", photo=True), "--texlabel:photo=1", "filters.label(photo=True)"),
        (texture_filter("warp"), "--texwarp", "filters.warp"),
    ):
        assert (spelled(f"<{text}>"), spelled(f"<{text}>", PYTHON)) == (f"<{line}>", f"<{python}>")


# --- fields ---


def test_an_error_crosses_processes_with_its_fields():
    with pytest.raises(MemoryBudgetError) as caught:
        Session(budget=1 << 20).resources.require(5 << 20, "the work", "wait")
    error = pickle.loads(pickle.dumps(caught.value))
    assert (error.need, error.budget, error.task, error.advice) == (5 << 20, 1 << 20, "the work", "wait")
    assert str(error) == "the work needs 5 MB of memory; the budget is 1 MB: raise --cache, or wait"
    wrong = ParameterError("odd", parameter="size", value=(3, 4), expected="even sides", hint=modifier(paper=True))
    wrong.op, wrong.step = "synth", "--texsynth"
    assert str(pickle.loads(pickle.dumps(wrong))) == str(wrong)


def test_the_facts_of_an_error_say_it_again():
    wrong = ParameterError("odd", parameter="size", value=3, expected="an even one", hint=modifier(paper=True))
    wrong.op = "synth"
    facts = wrong.facts()
    assert facts == {
        "kind": "ParameterError", "op": "synth", "parameter": "size", "value": "3", "problem": "odd",
        "expected": "an even one", "hint": "paper=1", "text": "synth: size=3: odd: expected an even one; paper=1",
    }  # fmt: skip
    assert str(of_facts(facts)) == facts["text"]


@pytest.mark.parametrize(
    "fields",
    [{"parameter": "sides"}, {"value": 4}, {"expected": "an odd one"}, {"parameter": "size", "hint": "paper=True"}],
)
def test_a_refusal_of_other_fields_is_another(fields):
    with pytest.raises(AssertionError), refused(ParameterError, **fields):
        raise ParameterError(parameter="size", value=3, expected="an even one", hint=modifier(paper=True))
    with refused(ParameterError, parameter="size", value=3, expected="an even one", hint="paper=1"):
        raise ParameterError(parameter="size", value=3, expected="an even one", hint=modifier(paper=True))


SYSTEM = "[Errno 30] Read-only file system: 'a.png'"


def test_an_error_of_the_system_is_told_by_file_and_reason():
    assert str(OSError(30, "Read-only file system", "a.png")) == SYSTEM
    assert reason_of(OSError(30, "Read-only file system", "a.png")) == "a.png: Read-only file system"
    assert reason_of(OSError(28, "No space left on device")) == "No space left on device"
    assert reason_of(OSError(9, "Bad file descriptor", 5)) == "Bad file descriptor"
    assert reason_of(ValueError("two\nlines")) == "two lines"
    assert str(failure_of(KeyError("x"))) == "internal error: KeyError: 'x'"


def raw_texts(handler: ast.ExceptHandler) -> Iterator[int]:
    """Lines of a handler that tell an error by its `str`."""
    for node in ast.walk(handler):
        texts = (
            [node.value] if isinstance(node, ast.FormattedValue) else node.args if isinstance(node, ast.Call) else []
        )
        plain = isinstance(node, ast.FormattedValue) or ast.unparse(getattr(node, "func", node)) in (
            "str",
            "log.warning",
        )
        if plain and any(isinstance(text, ast.Name) and text.id == handler.name for text in texts):
            yield node.lineno


@pytest.mark.parametrize("folder", ["oiiotex", "studio/oiiotex_studio"])
def test_no_message_has_the_number_of_an_error_of_the_system(folder):
    """The `str` of an OSError is no text for users; `reason_of` is."""
    raw = []
    for path in sorted((ROOT / folder).rglob("*.py")):
        for handler in ast.walk(ast.parse(path.read_text())):
            if isinstance(handler, ast.ExceptHandler) and handler.name and handler.type is not None:
                kinds = {node.id for node in ast.walk(handler.type) if isinstance(node, ast.Name)}
                if kinds & {"OSError", "Exception", "BaseException"}:
                    raw += [f"{path}:{line}" for line in raw_texts(handler)]
    assert raw == []
