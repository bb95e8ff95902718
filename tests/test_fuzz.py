# SPDX-License-Identifier: Apache-2.0
"""Nonsense of all kinds: what comes out is a result or an `oiiotex.Error`, never another exception."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from oiiotex.cli.language.parse import Refused, parse, split_modifiers
from oiiotex.cli.vocabulary import LANGUAGE
from oiiotex.errors import Error, ParameterError, one_line
from tests import fuzz

FUZZ = settings(
    max_examples=400,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)

# --- modifiers ---


@FUZZ
@given(st.text("-:='\"{}ab 1,.\u00e9\udce9\n\t", max_size=40))
def test_any_word_splits_into_modifiers_or_is_refused(word):
    try:
        name, modifiers = split_modifiers(word)
    except ParameterError as error:
        assert one_line(word.split(":")[0]).strip() in str(error)
    else:
        assert all(modifiers) and ":" not in name.split("{")[0]


@FUZZ
@given(
    st.dictionaries(st.text("abc_1", min_size=1), st.text("ab:=., +-{}1\u00e9", max_size=12).map(str.strip), max_size=4)
)
def test_quoted_modifiers_come_back_as_they_were(modifiers):
    word = "--op" + "".join(f':{name}="{value}"' for name, value in modifiers.items())
    assert split_modifiers(word) == ("--op", modifiers)


# --- command lines ---


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("fuzz")
    fuzz.make_folder(path)
    return path


@pytest.mark.parametrize("first", range(0, 800, 100))
def test_any_command_line_is_done_or_refused(folder, first):
    for number in range(first, first + 100):
        fuzz.do(fuzz.line(number), folder)


@FUZZ
@given(st.lists(st.one_of(st.text(max_size=12), st.sampled_from([name for name, _, _ in fuzz.options()])), max_size=8))
def test_any_words_are_parsed_or_refused(words):
    try:
        command = parse(words, LANGUAGE)
    except Error as error:
        assert str(error)
    else:
        assert not any(
            isinstance(LANGUAGE.find(step.word.split(":")[0]), Refused) for step in command.steps if step.option
        )


# --- files ---

# where OpenImageIO itself ends with a signal: (name of the seed, number of the mutation): why that is tolerated
CRASHES: dict[tuple[str, int], str] = {}

BATCH = """
import contextlib, io, os, sys
from oiiotex.cli.running.line_run import run
from oiiotex.errors import Error

log, output, *names = sys.argv[1:]
for name in names:
    with open(log, "a") as file:
        file.write(f"{name}\\n")
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            run(["-q", name, "--info:verbose=1", "--stats", "-d", "float", "-o", output])
    except Error as error:
        assert "\\n" not in str(error), (name, str(error))
"""


def read_broken_ones(folder: Path, names: list[str], numbers: range) -> None:
    """In a process of its own: OpenImageIO or a library under it may crash."""
    files = []
    for name in names:
        whole = fuzz.seed(folder / name, *fuzz.SEEDS[name])
        for number in numbers if whole is not None else ():  # else this OpenImageIO does not write it
            if (name, number) not in CRASHES:
                files.append(folder / f"{number:04d}-{name}")
                files[-1].write_bytes(fuzz.broken(whole, number))
    assert files
    command = [sys.executable, "-c", BATCH, folder / "log", folder / "out.exr", *files]
    done = subprocess.run(
        [str(word) for word in command], capture_output=True, text=True, errors="replace", timeout=500
    )
    last = (folder / "log").read_text().splitlines()[-1]
    assert done.returncode == 0, (last, done.returncode, done.stderr[-2000:])
    assert not [path.name for path in folder.iterdir() if ".oiiotex-" in path.name]


@pytest.mark.parametrize("first", range(3))
def test_broken_files_are_read_or_refused(tmp_path, first):
    read_broken_ones(tmp_path, list(fuzz.SEEDS)[first::3], range(60))


@pytest.mark.parametrize("first", range(0, 240, 60))
def test_broken_documents_and_plans_are_read_or_refused(folder, first):
    kinds = len(fuzz.SEEDS) + len(fuzz.TAKES)
    for n in range(first, first + 60):
        number = n // len(fuzz.TAKES) * kinds + len(fuzz.SEEDS) + n % len(fuzz.TAKES)
        fuzz.do(fuzz.broken_file(number, folder), folder)
