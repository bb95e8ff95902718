# SPDX-License-Identifier: Apache-2.0
"""The language against oiiotool's own: every option of its help is here, or refused by name with the reason."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess

import pytest

from oiiotex.cli.language.parse import Refused, parse
from oiiotex.cli.printing import report, shells
from oiiotex.cli.vocabulary import LANGUAGE, REFUSED
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


def test_every_op_and_option_has_a_page_with_a_row_for_each_modifier():
    for flag, _, _, modifiers in shells.declarations():
        page = report.page(flag)
        assert page.startswith(flag), flag
        for modifier in modifiers:
            assert f"\n  :{modifier.name} " in page, (flag, modifier.name)
            assert report.page(f"{flag}:{modifier.name}").startswith(f"{flag}:{modifier.name}=")


def test_versions_of_everything_are_said():
    said = oiiotex("--version").stdout
    for what in ("oiiotex 0", "OpenImageIO 3", "OpenColorIO 2", "--devices"):
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
    assert "allowed is bash, zsh or fish" in oiiotex("--completion", "tcsh").stderr


def test_completion_in_fish_knows_every_option_and_modifier():
    script = shells.completion("fish")
    known = {}
    for line in script.splitlines():
        if line.startswith("complete -c oiiotex -") and " -d " in line:
            words = shlex.split(line.replace("\\'", "`"))
            known[("--" if words[3] == "-l" else "-") + words[4]] = words[-1]
    assert set(known) == {flag for flag, *_ in shells.declarations()} and all(known.values())
    for flag, _, _, modifiers in shells.declarations():
        if modifiers:
            offered = script.partition(f"case {flag}\n")[2].partition("\n")[0]
            assert all(f'"$begun"{modifier.name}=' in offered for modifier in modifiers)


@pytest.mark.skipif(not shutil.which("fish"), reason="no fish")
def test_completion_in_fish():
    for typed, wanted in (("--texsta", "--texstationarize"), ("--texstationarize:sigma=3:se", "seed=")):
        probe = f"{shells.completion('fish')}\ncomplete -C 'oiiotex a.exr {typed}'"
        assert wanted in subprocess.run(["fish", "-c", probe], capture_output=True, text=True).stdout


def test_the_manual_names_every_op_and_option():
    text = shells.manual()
    for flag, *_ in shells.declarations():
        assert f".B {flag}".replace("-", "\\-") in text
    assert all(not line.startswith("'") for line in text.splitlines())


@pytest.mark.skipif(not shutil.which("groff"), reason="no groff")
def test_groff_takes_the_manual():
    done = subprocess.run(["groff", "-man", "-Tutf8", "-ww"], input=shells.manual(), capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert "texture filters in an oiiotool-style chain" in done.stdout


def test_the_program_alone_says_ten_lines():
    done = oiiotex()
    assert done.returncode == 0 and len(done.stdout.splitlines()) == 10
    assert "usage: " in done.stdout and "--help" in done.stdout


def test_the_page_of_a_modifier():
    assert report.page("stationarize:sigma").startswith("--texstationarize:sigma=\n\nScale in pixels above which")
    assert "A number from 0.5 to 1000000 px." in report.page("--texstationarize:sigma").replace("\n", " ")
    assert "Example: --texstationarize:sigma=" in report.page("--texstationarize:sigma")
    assert report.page("-o:tile").startswith("-o:tile=")
    with pytest.raises(ParameterError, match="has no modifier 'sigm', did you mean 'sigma'"):
        report.page("stationarize:sigm")


def test_the_cache_folder_is_shown_and_emptied(tmp_path):
    folder = tmp_path / "oiiotex"
    (folder / "candidates").mkdir(parents=True)
    (folder / "candidates" / "x.arrays").write_bytes(bytes(2_000_000))
    (folder / "probe-1.json").write_text("{}")
    (folder / "mine.txt").write_text("of the user")
    (tmp_path / "kept.arrays").write_text("elsewhere")
    (folder / "sigmas").symlink_to(tmp_path)
    there = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}
    said = oiiotex("--cache-info", env=there).stdout
    assert str(folder) in said and "2.0 MB  analyzed exemplars" in said
    assert oiiotex("--cache-clear", env=there).stdout == f"2 files, 2.0 MB removed from {folder}\n"
    assert sorted(path.name for path in folder.iterdir()) == ["mine.txt"]
    assert (tmp_path / "kept.arrays").exists()
    assert "0 files" in oiiotex("--cache-clear", env=there).stdout
