# SPDX-License-Identifier: Apache-2.0
"""The language against oiiotool's own: every option of its help is here, or refused by name with the reason."""

from __future__ import annotations

import re
import subprocess

import pytest

from oiiotex.cli.language import LANGUAGE, REFUSED
from oiiotex.cli.parse import Refused, parse
from oiiotex.errors import ParameterError
from tests.conftest import oiiotex
from tests.peer import OIIOTOOL

OURS_BEGIN = "--tex"


def help_of_oiiotool() -> list[tuple[str, int, str]]:
    """(option, words that follow it, help) of all options that oiiotool's help lists."""
    text = subprocess.run([OIIOTOOL, "--help"], capture_output=True, text=True, check=True).stdout
    found = []
    for line in text.splitlines():
        match = re.match(r"    (-{1,2}[A-Za-z][\w-]*)((?: [A-Z%][A-Za-z0-9,.+%]*)*)(?:\s{2,}|$)(.*)", line)
        if match:
            found.append((match[1], len(match[2].split()), match[3]))
    return found


@pytest.fixture(scope="module")
def theirs() -> list[tuple[str, int, str]]:
    if not OIIOTOOL.exists():
        pytest.skip("no oiiotool")
    return help_of_oiiotool()


def test_the_list_of_oiiotools_options_is_read(theirs):
    assert len(theirs) > 190
    assert ("--resize", 1) in {(name, count) for name, count, _ in theirs}


def test_every_option_of_oiiotool_is_here_or_refused_and_takes_as_many_words(theirs):
    missing, different = [], []
    for name, count, _ in theirs:
        try:
            LANGUAGE.find(name)
        except ParameterError:
            missing.append(name)
            continue
        if name != "--help" and LANGUAGE.takes(name) != count:
            different.append((name, count, LANGUAGE.takes(name)))
    assert (missing, different) == ([], [])


def test_every_modifier_in_oiiotools_help_is_here(theirs):
    missing = []
    for name, _, text in theirs:
        text = text.replace("gamma=1, ", "") if name == "--contrast" else text  # listed, and read by nothing
        listed = re.search(r"options: (.*?)\)?$", text)
        found = LANGUAGE.find(name)
        if not listed or isinstance(found, Refused):
            continue
        for modifier in re.findall(r"(?:^|[\s,:(])([a-z_]+)=", " " + listed[1]):
            word = f"{name}:{modifier}={{0}}"
            try:
                parse([word, *["x"] * LANGUAGE.takes(name)], LANGUAGE)
            except ParameterError:
                missing.append(f"{name}:{modifier}")
    assert missing == []


@pytest.mark.parametrize("refused", REFUSED, ids=lambda r: r.name)
def test_what_is_refused_says_why(refused):
    with pytest.raises(ParameterError, match=re.escape(refused.reason)):
        parse([refused.name, *["x"] * refused.arguments], LANGUAGE)
    assert len(refused.reason) > 15


def test_no_op_of_ours_hides_one_of_oiiotools(theirs):
    known = {name.lstrip("-") for name, _, _ in theirs}
    ours = [op.flag().lstrip("-") for op in LANGUAGE.ops["Texture filters"]]
    assert all(name.startswith("tex") for name in ours) and not known & set(ours)
    assert not any(name.startswith("o") for name in ours)  # sequences take -o... for an output


def test_help_shows_our_filters_first_and_every_option_once():
    text = oiiotex("--help").stdout
    assert text.index("--texstationarize") < text.index("--resize")
    for option in LANGUAGE.options:
        assert text.count(f"\n  {option.name} ") == 1, option.name
    for ops in LANGUAGE.ops.values():
        for op in ops:
            assert len(re.findall(rf"\n  {op.flag()}[ \n]", text)) == 1, op.flag()


@pytest.mark.parametrize("name", ["texstationarize", "stationarize", "--texstationarize"])
def test_a_filters_page_is_found_under_all_its_names(name):
    page = oiiotex("--help", name).stdout
    assert page.startswith("--texstationarize") and ":sigma" in page


def test_every_op_and_option_has_a_page():
    from oiiotex.cli.report import page

    for names in (*((op.flag() for op in ops) for ops in LANGUAGE.ops.values()), (o.name for o in LANGUAGE.options)):
        for name in names:
            assert page(name).startswith(name), name


def test_versions_of_everything_are_said():
    said = oiiotex("--version").stdout
    for what in ("oiiotex 0", "OpenImageIO 3", "OpenColorIO 2", "device: "):
        assert what in said


@pytest.mark.parametrize(
    ("typed", "wanted"),
    [
        ("--texsta", ["--texstationarize", "--texstationarity"]),
        ("--resi", ["--resize"]),
        ("--resize:fil", ["filter="]),
        ("--texstationarize:sigma=3:se", ["seed="]),
    ],
)
def test_completion_in_bash(typed, wanted):
    script = oiiotex("--completion", "bash").stdout
    probe = (
        f'{script}\nCOMP_LINE="oiiotex a.exr {typed}"; COMP_POINT=${{#COMP_LINE}}; _oiiotex; echo "${{COMPREPLY[@]}}"'
    )
    done = subprocess.run(["bash", "-c", probe], capture_output=True, text=True)
    assert sorted(done.stdout.split()) == sorted(wanted), done.stderr


def test_completion_for_another_shell_is_refused():
    assert "allowed is bash or zsh" in oiiotex("--completion", "fish").stderr
