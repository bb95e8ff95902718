# SPDX-License-Identifier: Apache-2.0
"""The language against oiiotool's own: every option of its help is here, or refused by name with the reason."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest

from oiiotex.engine.core.op import Op
from oiiotex.engine.errors import ParameterError
from oiiotex.oiiotool.cli.language.parse import Refused, names_of, parse
from oiiotex.oiiotool.cli.printing import help, report, shells
from oiiotex.oiiotool.cli.vocabulary import LANGUAGE, REFUSED
from tests.conftest import oiiotex
from tests.peer import OIIOTOOL

ROOT = Path(__file__).parents[2]


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
    ours = [op.flag().lstrip("-") for ops in LANGUAGE.ops.values() for op in ops if op.prefix == Op.prefix]
    assert all(name.startswith("tex") for name in ours) and not known & set(ours)
    assert not any(name.startswith("o") for name in ours)  # sequences take -o... for an output


def test_help_shows_our_filters_first_and_every_option_once():
    text = oiiotex("--help", "all").stdout
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
        ("--texstationarize:sigma=3:see", ["seed="]),
        ("--help scal", ["scaling", "scale"]),
        ("--help texq", ["texquilt"]),
        ("--help --resi", ["--resize"]),
        ("-h al", ["all"]),
        ("--help :see", ["seed"]),
        ("--help quilt:see", ["seed"]),
        ("--help --texquilt:see", ["seed"]),
        ("--help resize:fil", ["filter"]),
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
    assert "--completion tcsh: expected bash, zsh or fish" in oiiotex("--completion", "tcsh").stderr


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
    cases = {"--texsta": "--texstationarize", "--texstationarize:sigma=3:se": "seed="}
    for typed, wanted in (cases | {"--help scal": "scaling", "--help :se": ":seed", "--help texq": "texquilt"}).items():
        probe = f"{shells.completion('fish')}\ncomplete -C 'oiiotex a.exr {typed}'"
        assert wanted in subprocess.run(["fish", "-c", probe], capture_output=True, text=True).stdout


def test_the_program_alone_and_help_print_one_screen_of_lines_to_copy():
    done = oiiotex()
    lines = done.stdout.splitlines()
    assert done.returncode == 0 and done.stdout == oiiotex("--help").stdout == help.topic() + "\n"
    assert len(lines) <= 24 and max(map(len, lines)) <= 80
    shown = re.findall(r"^  oiiotex (.*)", done.stdout.replace("\\\n", ""), re.MULTILINE)
    assert len(shown) == 10
    for line in shown:
        words = shlex.split(re.sub(r"   .*", "", re.sub(r"(?<=normal) {3,}", " ", line)))
        assert any(parse(words, LANGUAGE).steps)
    for word in re.findall(r"--help ([\w:]+)", done.stdout):
        assert word == "stains" or help.topic(word)


def test_every_group_has_a_word_that_names_no_op():
    groups = {word: overview for word in help.words() if (overview := help.topic(word))}
    assert len(set(groups.values())) == len(groups) == len(set(LANGUAGE.words.values())) + 1
    assert set(LANGUAGE.words) >= {*LANGUAGE.ops, *LANGUAGE.groups}
    for word in groups:
        with pytest.raises(ParameterError):
            report.find(word)
    for heading, word in LANGUAGE.words.items():
        declared = {**LANGUAGE.ops, **LANGUAGE.groups}.get(heading, ())
        for one in declared:
            assert f"\n  {names_of(one)[0]}" in groups[word] and f"\n  {names_of(one)[0]}" in groups["all"]
    assert "--texstationarize" in groups["texture"] and "--resize" not in groups["texture"]
    assert "--resize" in groups["scaling"] and "--texstationarize" not in groups["scaling"]


def test_a_modifier_alone_names_all_that_have_it():
    text = help.topic(":seed")
    assert text.startswith(":seed=\n\n") and text == help.topic(":seed=")
    listed = {flag for head in re.findall(r"^(-[^:]*):$", text, re.MULTILINE) for flag in re.split(r",\s+", head)}
    assert listed == {flag for flag, _, _, known in shells.declarations() if "seed" in {p.name for p in known}}
    assert "An integer from 0 to 4294967295. Default: 0." in " ".join(text.split())
    assert "-o" in help.topic(":udim") and "--texwarp" not in help.topic(":udim")


@pytest.mark.parametrize(
    ("word", "hint"),
    [
        ("stationarise", "did you mean --help --texstationarize?"),
        ("--texwrap", "did you mean --help --texwarp?"),
        ("resise:filter", "did you mean --help --resize?"),
        ("sigmaa", "did you mean --help :sigma?"),
        (":sgima", "did you mean --help :sigma?"),
        ("chanels", "did you mean --help channels?"),
        ("qqqq", "oiiotex --help all lists everything"),
        (":", "oiiotex --help all lists everything"),
    ],
)
def test_an_unknown_word_names_the_nearest(word, hint):
    done = oiiotex("--help", word)
    expected = f"oiiotex ERROR: --help {word}: expected a group, an op, OP:MODIFIER or :MODIFIER; {hint}"
    assert (done.returncode, done.stdout) == (1, "") and done.stderr.startswith(expected), done.stderr


@pytest.mark.parametrize(
    ("word", "places"),
    [
        ("bricks", ["docs/how-to/bricks-and-tiles.md"]),
        ("Nuke", ["docs/how-to/nuke.md"]),
        ("stains", ["docs/how-to/stains-and-gradients.md", "--texflatten"]),
        ("moss", ["docs/how-to/blobs-and-repetition.md"]),
        ("wall", ["docs/how-to/bricks-and-tiles.md"]),
        ("seams", ["docs/how-to/quality-gates.md", "--texcut"]),
        ("grain", ["--texproject", ":grain"]),
        ("mirror", ["--flip", "--flop"]),
        ("upscale", ["--resize"]),
        ("normal", ["docs/how-to/whole-materials.md", "--texstationarize:kinds"]),
        ("PBR", ["docs/how-to/whole-materials.md"]),
        ("16-bit", ["-d"]),
        ("alpha", ["--premult"]),
        ("hdr", ["docs/how-to/color-spaces.md", ":hdr"]),
        ("aces", ["docs/how-to/color-spaces.md"]),
        ("slurm", ["docs/how-to/farm.md"]),
        ("exit", ["docs/how-to/quality-gates.md", "--texcheckmaterial:fail"]),
        ("batch", ["docs/how-to/a-folder.md"]),
        ("memory", ["docs/how-to/large-images.md", "--cache"]),
        ("sigma", [":sigma", "--texsigmas"]),
    ],
)
def test_a_word_that_names_nothing_is_searched_for(word, places):
    done = oiiotex("--help", word)
    assert done.returncode == 0 and done.stdout.startswith(f"'{word}' occurs in:\n"), done.stderr
    assert set(places) <= set(done.stdout.split())


@pytest.mark.parametrize(
    ("word", "page"),
    [("tile", "bricks-and-tiles"), ("gpu", "gpus"), ("frames", "two-hundred-frames"), ("cryptomatte", "nuke")],
)
def test_the_help_of_an_op_names_the_pages_about_its_word(word, page):
    assert f"docs/how-to/{page}.md" in oiiotex("--help", word).stdout.partition("\nSee also:\n")[2].split()


def test_every_title_of_the_how_to_pages_is_searched():
    titles = re.findall(r"\| \[([^\]]+)\]\(([\w-]+\.md)\)", help._how_to())
    assert {file for _, file in titles} >= {page.name for page in (ROOT / "docs/how-to").glob("*.md")} - {
        "index.md",
        "library.md",
    }


def test_the_page_of_a_modifier():
    assert report.page("stationarize:sigma").startswith("--texstationarize:sigma=\n\nScale, in pixels, above which")
    assert "A number from 0.5 to 1000000 px." in report.page("--texstationarize:sigma").replace("\n", " ")
    assert "Example: --texstationarize:sigma=" in report.page("--texstationarize:sigma")
    assert all("Allowed" not in report.page(flag) for flag, *_ in shells.declarations())
    assert report.page("-o:tile").startswith("-o:tile=")
    with pytest.raises(ParameterError, match=r"modifier 'sigm'.* 'sigma'"):
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


def test_pages_of_help_fit_the_terminal(monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    pages = [report.page(flag) for flag, *_ in report.declarations()] + [
        help.topic(":seed"),
        help.topic("label:persistence"),
    ]
    assert [line for page in pages for line in page.splitlines() if len(line) > 80] == []
