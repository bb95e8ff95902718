# SPDX-License-Identifier: Apache-2.0
"""What help and docs name is there: options, modifiers, measures, files and file types."""

from __future__ import annotations

import argparse
import functools
import re
import shlex
from collections.abc import Callable, Iterable
from pathlib import Path

import OpenImageIO as oiio
from oiiotex_studio.library import commands as library

from oiiotex.engine.core.parameters import declared
from oiiotex.engine.errors import Error
from oiiotex.engine.session import Session
from oiiotex.filters import FILTERS
from oiiotex.oiiotool import host
from oiiotex.oiiotool.cli.language.parse import Refused, parse, split_modifiers
from oiiotex.oiiotool.cli.printing import help, report
from oiiotex.oiiotool.cli.vocabulary import LANGUAGE

ROOT = Path(__file__).parents[2]
# docs/how-to/your_own_filter.md writes ops of its own, which tests/oiiotool/test_plugins.py runs
PAGES = sorted([ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", *(ROOT / "docs").rglob("*.md"),
                *ROOT.glob("oiiotex/**/README.md"), *ROOT.glob("studio/**/README.md")])  # fmt: skip
# where figures come from, which is not shown, and lines of benchmarks
OTHER_TEXT = re.compile("<!--.*?-->|`python -m (?:benchmarks|tools)[^`]*`", re.DOTALL)
# words that are named because they are wrong, or stand for others
WRONG = {"--resize:fliter=box", "--OP", "--tex", "--texNAME", "--op:key=value", "--op", "--op:name=value",
         "--op:modifier"}  # fmt: skip
OTHERS = {  # of other programs
    "--step", "--path", "--run-dependencies", "--force-reinstall", "--upgrade", "--leak-check", "--user",
    "--no-build-isolation", "--extra-index-url", "--protocol", "--no-dashboard", "--no-deps",
    "--no-index", "--find-links",
    "--array", "--parsable", "--dependency", "--wrap", "--headers", "--into", "--library", "--work",
}  # fmt: skip
OURS = {
    ".json", ".yaml", ".npz", ".gif", ".mp4", ".gpl", ".aco", ".icc", ".md", ".py", ".cl", ".ocio", ".pyi", ".toml",
    ".obj", ".zip",
}  # fmt: skip
SPACES = r"--iscolorspace (?:\"([^\"]+)\"|([A-Za-z]\w+))"
PLACEHOLDERS = {"NAME", "SPACE"}  # for a color space
NO_MODIFIERS = {"colorspace", "lines", "as_array", "kind"}  # of Python alone, and of a function for Gaffer
OTHER_FILES = {".shape", ".venv", ".gitignore", ".typed", ".hlsl", ".wgsl", ".lp"}


@functools.cache
def texts() -> dict[str, str]:
    """Pages, and what help prints, by their names."""
    found = {
        str(path.relative_to(ROOT)): OTHER_TEXT.sub("", path.read_text())
        for path in PAGES
        if path.name != "your_own_filter.md"
    }
    found |= {"--help": help.topic(), "--help all": report.overview()}
    return found | {f"--help {op.name}": report.page(op.name) for op in (*FILTERS, *host.OPS)}


def library_options() -> set[str]:
    """Those of the second program, of all its commands."""
    (commands,) = (a for a in library._parser()._actions if isinstance(a, argparse._SubParsersAction))
    return {word for own in commands.choices.values() for action in own._actions for word in action.option_strings}


def modifiers_of(name: str) -> set[str] | None:
    """What may stand behind an option's or op's name; None where it is refused."""
    found = LANGUAGE.find(name)
    if isinstance(found, Refused):
        return None
    if isinstance(found, type):
        return {p.name for p in found.modifiers()}
    return {p.name for p in declared(found.modifiers)[1]} if found.modifiers else set()


def words_in(text: str) -> set[str]:
    """Options with their modifiers, in code and in prose."""
    return set(re.findall(r"(?<![\w-])--[A-Za-z][\w-]*(?::[A-Za-z_]+=?[^\s`'\"|;,)]*)*", text))


def shown(text: str, program: str) -> list[str]:
    """Lines of a program in blocks of code, in lists, too."""
    blocks = re.findall(r"^( *)```\w*\n(.*?)^\1```", text, re.DOTALL | re.MULTILINE)
    lines = [line.strip() for _, block in blocks for line in block.replace("\\\n", " ").splitlines()]
    return [line for line in lines if line.startswith(program)]


def missing_words(text: str) -> list[str]:
    """Options and modifiers in a text that are not there."""
    missing = []
    others = OTHERS | (library_options() if "oiiotex-library" in text else set())
    for word in words_in(text) - WRONG - others:
        name, _, rest = word.rstrip(".:").partition(":")
        if name in WRONG | OTHERS or name.endswith(("-", "_")):
            continue
        try:
            known = modifiers_of(name)
        except Error:
            missing.append(word)
            continue
        named = re.findall(r"(?:^|:)([A-Za-z_]+)=", rest)
        missing += [f"{name}:{one}" for one in named if known is not None and one not in known]
    return missing


def missing_in_texts(missing: Callable[[str], Iterable[str]]) -> dict[str, list[str]]:
    """What is missing of each text, where anything is."""
    return {source: found for source, text in texts().items() if (found := sorted(missing(text)))}


def test_every_option_and_its_modifiers_are_there():
    assert missing_in_texts(missing_words) == {}


def test_every_line_that_is_shown_is_one_that_the_program_takes():
    lines = [line for text in texts().values() for line in shown(text, "oiiotex ")]
    assert len(lines) > 200
    for line in lines:
        if "..." in line or "[" in line:  # a synopsis
            continue
        line = re.sub(r"\s+# .*", "", line)  # a hash within a word stands for digits of a frame
        words = shlex.split(re.split(r" && | \|\|? ", line)[0])[1:]
        parse(words, LANGUAGE)
        for word in words:
            if word.startswith("--"):
                name, given = split_modifiers(word)
                known = modifiers_of(name)
                assert known is None or set(given) <= known, line


def test_every_color_space_that_is_named_is_in_the_config_that_is_built_in():
    config, named = Session().resources.color, set()
    for text in texts().values():
        named |= {"".join(found) for found in re.findall(SPACES, text)}
    assert "sRGB" in named
    for name in named - PLACEHOLDERS:
        config.resolve(name)


def test_every_line_of_the_library_that_is_shown_is_one_that_it_takes():
    lines = [line for text in texts().values() for line in shown(text, "oiiotex-library ")]
    assert lines
    for line in lines:
        words = shlex.split(re.split(r" \|\| | > ", line)[0], comments=True)[1:]
        library._parser().parse_args(words)


def test_modifiers_that_are_named_alone_are_some_ops():
    known = set().union(*({p.name for p in op.modifiers()} for op in (*FILTERS, *host.OPS)))
    known |= {p.name for o in LANGUAGE.options if o.modifiers for p in declared(o.modifiers)[1]}
    known |= NO_MODIFIERS
    assert missing_in_texts(lambda text: set(re.findall(r"`:?([a-z_]+)=[^`\s]*`", text)) - known) == {}


def test_every_file_type_is_one_that_is_read_or_written():
    listed = oiio.get_string_attribute("extension_list")
    known = {f".{suffix}" for one in listed.split(";") for suffix in one.partition(":")[2].split(",")}
    known |= OURS | OTHER_FILES
    named = re.compile(r"(?<![\w/)\]*}#>%-])(\.[a-z][a-z0-9]{1,4})(?![\w.(/-])")
    assert missing_in_texts(lambda text: set(named.findall(text)) - known) == {}


def test_every_file_of_ours_that_is_named_is_there():
    ours = re.compile(
        r"(?<![\w/(])((?:docs|tests|benchmarks|golden|hosts|oiiotex|studio|tools)/[\w./*-]+\.(?:md|py|cl))"
    )
    there = functools.cache(lambda name: "NAME" in name or any(ROOT.glob(name)))
    assert missing_in_texts(lambda text: {name for name in ours.findall(text) if not there(name)}) == {}
