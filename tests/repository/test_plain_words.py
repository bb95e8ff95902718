# SPDX-License-Identifier: Apache-2.0
"""What people read is plain English: no private phrases, help in sentences, one spelling."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest

from oiiotex.filters import OURS
from oiiotex.oiiotool import host
from oiiotex.oiiotool.cli.vocabulary import LANGUAGE
from tests import plain_words

HELP = {f"{op.flag()}:{p.name}": p for op in (*OURS, *host.OPS) for p in (*op.arguments(), *op.modifiers())}
HELP |= {f"{option.name}:{p.name}": p for option in LANGUAGE.options for p in option.parameters()}


def test_no_phrase_has_to_be_decoded():
    found = [line for path in plain_words.files() for line in plain_words.found(path)]
    assert not found, "\n".join(found)


def test_no_file_has_marks_of_a_merge():
    marked = [str(path) for path in plain_words.files() if re.search(r"^(<{7}|>{7}) ", path.read_text(), re.MULTILINE)]
    assert not marked, marked


def test_phrases_are_found(tmp_path):
    (tmp_path / "a.py").write_text(
        '"""A size; when left out 5."""\nx = 1  # made anew\nsay = "behind it"\nbehind = 2\n'
    )
    (tmp_path / "b.md").write_text("It hangs on `behind` what is allowed.\n\n```\nanew\n```\nbeside\n")
    assert [line.partition(": ")[2].split("'")[1] for line in plain_words.found(tmp_path / "a.py")] == [
        "anew", "left out", "behind",
    ]  # fmt: skip
    lines = [line.split(":")[1] for line in plain_words.found(tmp_path / "b.md")]
    assert lines == ["1", "1", "6"]


def test_help_of_every_parameter_is_sentences():
    """The program adds values, range and default, which the text therefore does not have."""
    odd = {
        name: p.help
        for name, p in HELP.items()
        if not re.match(r"[A-Z0-9'`\"]", p.help)
        or not p.help.endswith(".")
        or re.search("[Dd]efault:|[Rr]ange:", p.help)
    }
    assert not odd, "\n".join(f"{name}: {text}" for name, text in odd.items())


@pytest.mark.parametrize("op", OURS, ids=lambda op: op.name)
def test_every_modifier_has_an_example_that_it_takes(op):
    for p in op.modifiers():
        assert p.sample, f"{op.flag()}:{p.name} has no example"
        assert p.parse(p.sample) is not None


def test_spelling_is_american_and_right():
    """By codespell's lists of misspellings and of British words."""
    words = "ths,fliter,gool,hda,inout,colour,ue,cancelled,parm,lod"  # names: of users' files, Houdini, Blender, errors
    places = plain_words.PLACES
    command = [sys.executable, "-m", "codespell_lib", "--builtin", "clear,rare,en-GB_to_en-US", "-L", words, *places]
    command += ["--skip", "*.jpg,*.png,*.js,*.pyc,*.ipynb,*.woff2"]
    done = subprocess.run(command, cwd=plain_words.ROOT, capture_output=True, text=True)
    assert not done.stdout, done.stdout
