# SPDX-License-Identifier: Apache-2.0
"""Words of a command line become settings and steps, or an error that says what is meant."""

from __future__ import annotations

import itertools
import sys
from dataclasses import dataclass
from types import ModuleType

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oiiotex.engine.core.op import Op
from oiiotex.engine.core.parameters import param
from oiiotex.engine.deferred import Shelf
from oiiotex.engine.errors import ParameterError, one_line
from oiiotex.filters import FILTERS
from oiiotex.filters.texstationarize import Stationarize
from oiiotex.filters.texwarp import Warp
from oiiotex.oiiotool.cli.language.parse import (
    CommandLine,
    Language,
    Option,
    Refused,
    parse,
    split_modifiers,
    values_of,
)
from oiiotex.oiiotool.cli.vocabulary import LANGUAGE
from tests.everything import refusal

FUZZ = settings(max_examples=150, deadline=None, derandomize=True, database=None)
OPS = tuple(itertools.chain.from_iterable(LANGUAGE.ops.values()))
STEPS = [o for o in LANGUAGE.options if o.run is not None]
OF_THE_RUN = [o for o in LANGUAGE.options if o.run is None and o.name != "--help"]
named = {"ids": lambda found: found.name}


def read(*words: str) -> CommandLine:
    return parse(list(words), LANGUAGE)


def steps(*words: str) -> list[tuple]:
    """What is to be done, each with the words behind it; a file that is named is ('', name)."""
    return [(s.op or s.option.name if s.op or s.option else "", s.word, s.arguments) for s in read(*words).steps]


def words_behind(op: type[Op]) -> list[str]:
    return [f"{p.name}?" for p in op.arguments()]


# --- steps and settings ---


def test_a_chain_becomes_steps_in_the_order_of_the_words():
    words = "a.exr | -d half | --texstationarize:sigma=32:size=64x64 | -o b.exr | --texwarp | c.exr | --resize 50%"
    found = steps(*words.replace("|", "").split())
    assert " | ".join(" ".join((word, *arguments)) for _, word, arguments in found) == words
    assert [what for what, _, _ in found][:5] == ["", "-d", Stationarize, "-o", Warp]


def test_no_words_are_no_steps():
    assert read() == CommandLine({}, ())


def test_a_step_keeps_the_word_as_it_was_written_and_has_a_name_for_messages():
    line = read("-texpatchmatch:seed=3", "C:a", "--o", "b")
    assert [step.word for step in line.steps] == ["-texpatchmatch:seed=3", "C:a", "--o"]
    assert [step.name for step in line.steps] == ["-texpatchmatch", "C:a", "--o"]


@pytest.mark.parametrize("option", OF_THE_RUN, **named)
def test_a_setting_holds_wherever_it_stands(option):
    arguments = tuple(f"value{i}" for i in range(len(option.arguments)))
    for words in (
        [option.name, *arguments, "a.exr", "-o", "b.exr"],
        ["a.exr", option.name, *arguments, "-o", "b.exr"],
        ["a.exr", "-o", "b.exr", option.name, *arguments],
    ):
        line = read(*words)
        assert line.settings == {option.name: arguments}
        assert [step.word for step in line.steps] == ["a.exr", "-o"]


@pytest.mark.parametrize("option", STEPS, **named)
def test_a_step_takes_what_stands_behind_it(option):
    behind = tuple(f"value{i}" for i in range(len(option.arguments)))
    expected = [(option.name, option.name, behind), ("", "a.exr", ())]
    assert steps(option.name, *behind, "a.exr") == expected
    assert LANGUAGE.takes(f"{option.name}:x=1") == len(behind)


@pytest.mark.parametrize("op", OPS, ids=lambda op: op.flag())
def test_every_op_is_an_option_under_all_its_names(op):
    behind = words_behind(op)
    for name in (op.flag(), *op.aliases, op.flag().replace("--", "-", 1)):
        assert steps(name, *behind, "a.exr") == [(op, name, tuple(behind)), ("", "a.exr", ())]
        assert LANGUAGE.takes(name) == len(behind)


@pytest.mark.parametrize("op", FILTERS, **named)
def test_a_filters_option_is_tex_and_its_name(op):
    assert op.flag() == f"--tex{op.name}"


def test_a_file_name_may_hold_colons_quotes_and_equal_signs():
    name = "C:\\a=b'\":.exr"
    assert steps(name) == [("", name, ())]
    assert steps("-o", name) == [("-o", "-o", (name,))]


def test_what_an_option_takes_may_begin_with_a_dash():
    assert steps("-i", "-dash.exr", "-o", "--help") == [("-i", "-i", ("-dash.exr",)), ("-o", "-o", ("--help",))]


def test_a_single_dash_is_a_file_name():
    assert steps("-") == [("", "-", ())]


@pytest.mark.parametrize(
    ("name", "words"),
    [("-o", "-o --o"), ("-i", "-i --i"), ("--missingfile", "--missingfile -missingfile")],
)
def test_one_dash_or_two_mean_the_same_on_steps(name, words):
    for word in words.split():
        assert steps(word, "x") == [(name, word, ("x",))]


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("-v", "-v --v --verbose -verbose"),
        ("--version", "-version"),
        ("--runstats", "-runstats"),
        ("--help", "-h --h -help"),
    ],
)
def test_one_dash_or_two_and_aliases_mean_the_same_on_settings(name, words):
    for word in words.split():
        assert read(word).settings == {name: ()}


@pytest.mark.parametrize("option", [o for o in LANGUAGE.options if o.arguments], **named)
def test_a_missing_argument_is_asked_for(option):
    for n in range(len(option.arguments)):
        words = ["a.exr", option.name, *(["x"] * n)]
        assert refusal(read, *words) == f"{option.name} requires {option.arguments[n]} after it"


@pytest.mark.parametrize("op", [op for op in OPS if op.arguments()], ids=lambda op: op.flag())
def test_a_missing_word_behind_an_op_is_asked_for(op):
    assert refusal(read, "a.exr", op.flag()) == f"{op.flag()} requires {op.arguments()[0].name.upper()} after it"


@pytest.mark.parametrize("option", [o for o in LANGUAGE.options if o.name != "--help"], **named)
def test_an_unknown_modifier_is_refused_before_anything_is_done(option):
    text = refusal(read, f"{option.name}:qqqq=1", *["x"] * len(option.arguments))
    if option.run is None:
        assert text == f"{option.name}:qqqq=1: {option.name} takes no modifiers"
    else:
        assert text.startswith(f"{option.name} : unknown modifier 'qqqq'")


def test_a_modifiers_value_is_checked_before_anything_is_done_unless_it_is_an_expression():
    text = refusal(read, "a.exr", "--texstationarize:sigma=0")
    assert text == "--texstationarize : sigma=0: expected a number from 0.5 to 1000000 px"
    assert "did you mean 'sigma'" in refusal(read, "--texstationarize:sgima={TOP.width/4}")
    (step,) = read("--texstationarize:sigma={TOP.width/4}:seed=3").steps
    assert step.word == "--texstationarize:sigma={TOP.width/4}:seed=3"
    assert values_of(step, {"sigma": None, "seed": "3"}) == {"seed": 3}
    assert "sigma=0: expected" in refusal(values_of, step, {"sigma": "0"})


@pytest.mark.parametrize(
    ("word", "meant"),
    [line.split() for line in """
        --texstationarise         --texstationarize
        -texwrap                  --texwarp
        --iscolourspace           --iscolorspace
        --fixnans                 --fixnan
        --thread                  --threads
        --texstationarise:sigma=3 --texstationarize
    """.strip().splitlines()],
)  # fmt: skip
def test_an_unknown_option_names_the_nearest(word, meant):
    assert refusal(read, word) == f"unknown option '{word.split(':')[0]}', did you mean '{meant}'?"


@pytest.mark.parametrize("word", ["--zzzzzz", "--O", "--TEXWARP", "--texwarp ", "-5", "--"])
def test_nothing_unknown_is_taken_for_something_else(word):
    text = f"unknown option '{word}'"
    assert refusal(read, word).startswith(text) and LANGUAGE.takes(word) == 0
    assert word != "--zzzzzz" or refusal(read, word) == text  # without a near one it names none


def test_a_language_says_what_is_refused_and_why(monkeypatch):
    @dataclass(frozen=True)
    class Modifiers:
        depth: int = param(0, help="how deep", ge=0)

    dig = Option("--dig WHERE", lambda *_: None, Modifiers, "a hole", aliases=("-D",))
    work = ModuleType("work")
    work.OPTIONS = (dig,)
    monkeypatch.setitem(sys.modules, "work", work)
    language = Language(
        (Shelf("Work", "work", ("--dig", "-D"), "OPTIONS"),), (Refused("--fly", 2, "people cannot fly"),)
    )
    assert language.options == (dig,)
    assert (language.takes("--fly"), language.takes("-D:depth=3"), language.takes("--swim")) == (2, 1, 0)
    (step,) = parse(["-D:depth=3", "here"], language).steps
    assert (step.option, step.op, step.arguments) == (dig, None, ("here",))
    assert values_of(step, {"depth": "3"}) == {"depth": 3}
    assert refusal(parse, ["-fly", "up", "high"], language) == "-fly of oiiotool is not supported: people cannot fly"
    assert refusal(parse, ["--dig:depth=-1", "here"], language).startswith("--dig : depth=-1: expected")
    assert refusal(parse, ["--texwarp"], language).startswith("unknown option '--texwarp'")


def test_options_of_other_distributions_are_looked_up_by_name_only():
    asked = []
    far = Option("--far PLACE", lambda *_: None, text="elsewhere", heading="Viewing")

    def added(name):
        asked.append(name)
        return (far,) if name in ("", "far") else ()

    shelf = Shelf("Viewing", "oiiotex.oiiotool.cli.files.viewing", ("--tev",), "OPTIONS")
    language = Language((shelf,), added=added, studio=("--far", "--page"), words={"Viewing": "viewing"})
    parse(["a.png", "--tev"], language)
    assert not asked
    assert parse(["-far", "away"], language).steps[0].option == far
    assert language.group("viewing") == {"Viewing": (*shelf.declarations, far)} and not language.group("reading")
    assert refusal(parse, ["--page:port=1"], language) == (
        "--page requires oiiotex-studio; pip install ./studio in a checkout"
    )
    assert refusal(parse, ["--pagee"], language) == "unknown option '--pagee', did you mean '--page'?"


def test_a_setting_of_another_distribution_runs_the_frames():
    def spread(*_):
        return 0

    language = Language((), added=lambda name: (Option("--far PLACE", text="elsewhere", spread=spread),))
    line = parse(["--far", "away", "a.png"], language)
    assert (line.settings, line.spread) == ({"--far": ("away",)}, spread)
    assert parse(["a.png"], language).spread is None


# --- help ---


@pytest.mark.parametrize("word", ["--help", "-help", "-h"])
def test_help_takes_the_topic_behind_it_and_nothing_else_counts(word):
    assert read(word).settings == {"--help": ()}
    assert read(word, "texwarp").settings == {"--help": ("texwarp",)}
    line = read("a.exr", word, "--texwarp", "--no-such", "-o")
    assert line.settings == {"--help": ("--texwarp",)}
    assert [step.word for step in line.steps] == ["a.exr"]


# --- modifiers ---


@pytest.mark.parametrize(
    ("word", "name", "modifiers"),
    [
        ("--op", "--op", {}),
        ("--op:a=1", "--op", {"a": "1"}),
        ("--op:a=1:b=two", "--op", {"a": "1", "b": "two"}),
        ('--op:a="x:y":b=1', "--op", {"a": "x:y", "b": "1"}),
        ("--op:a='C:/x y.exr'", "--op", {"a": "C:/x y.exr"}),
        ('--op:a="it\'s":b=\'say "x"\'', "--op", {"a": "it's", "b": 'say "x"'}),
        ('--op:a="":b=1', "--op", {"a": "", "b": "1"}),
        ("--op:a=", "--op", {"a": ""}),
        ("--op:a=b=c", "--op", {"a": "b=c"}),
        ("--op:a=don't", "--op", {"a": "don't"}),
        ('--op:a="x=y:z=1"', "--op", {"a": "x=y:z=1"}),
        ("--op:a= 1 ", "--op", {"a": " 1 "}),
        ("--op:größe=5", "--op", {"größe": "5"}),
        ("--op:a={x:y}:b=1", "--op", {"a": "{x:y}", "b": "1"}),
        ("--op:a={TOP.'a:b'}:b=1", "--op", {"a": "{TOP.'a:b'}", "b": "1"}),
        ("--op:a={{x:y}:z}:b=1", "--op", {"a": "{{x:y}:z}", "b": "1"}),
        ("--op:a=x{i:j}y:b=}:c=1", "--op", {"a": "x{i:j}y", "b": "}", "c": "1"}),
        ('--op:a="{":b=1', "--op", {"a": "{", "b": "1"}),
    ],
)
def test_a_word_is_split_at_the_colons_outside_quotes(word, name, modifiers):
    assert split_modifiers(word) == (name, modifiers)


def test_modifiers_keep_their_order():
    assert list(split_modifiers("--op:c=1:a=2:b=3")[1]) == ["c", "a", "b"]


@pytest.mark.parametrize(("word", "modifiers"), [("--op:", {}), ("--op:a=1:", {"a": "1"}), ("--op::a=1", {"a": "1"})])
def test_an_empty_modifier_is_none_as_in_oiiotool(word, modifiers):
    assert split_modifiers(word) == ("--op", modifiers)


@pytest.mark.parametrize(
    ("word", "says"),
    [
        ("--op:a", "'a': expected NAME=VALUE"),
        ("--op:=1", "'=1': expected NAME=VALUE"),
        ("--op:a=1:b", "'b': expected NAME=VALUE"),
        ("--op:a=1:a=2", "modifier 'a' is given twice"),
        ("--op:a=1:b=2:a=1", "modifier 'a' is given twice"),
        ('--op:a="x:b=1', 'expected a closing "'),
        ("--op:a='", "expected a closing '"),
    ],
)
def test_a_malformed_modifier_is_refused_with_the_word(word, says):
    assert refusal(split_modifiers, word) == f"{word}: {says}"
    assert refusal(read, word.replace("--op", "--texwarp")).endswith(says)


names = st.text(st.characters(exclude_characters=":='\"{}", codec="utf-8"), min_size=1, max_size=6)


@FUZZ
@given(values=st.dictionaries(names, st.text(max_size=12), max_size=4), quote=st.sampled_from("\"'"))
def test_whatever_stands_in_quotes_comes_back(values, quote):
    values = {name: value.replace(quote, "") for name, value in values.items()}
    word = "--op" + "".join(f":{name}={quote}{value}{quote}" for name, value in values.items())
    assert split_modifiers(word) == ("--op", values)


@FUZZ
@given(word=st.text(st.sampled_from("-:='\"ab {}"), max_size=12) | st.text())
def test_any_word_is_split_or_refused(word):
    try:
        name, modifiers = split_modifiers(word)
    except ParameterError as error:
        assert str(error).startswith(one_line(f"{word}:"))
    else:
        assert word.startswith(name) or "=" in name  # a quote can only stand behind an equal sign
        assert all(modifiers)


known_words = [o.name for o in LANGUAGE.options] + [op.flag() for op in OPS]
any_word = (
    st.sampled_from(known_words)
    | st.text(max_size=8)
    | st.from_regex(r"\A-{0,3}[a-z]{0,3}(:[a-z]?=?[\"']?[0-9]?){0,3}\Z")
    | st.builds("{}:{}".format, st.sampled_from(known_words), st.text(max_size=6))
)  # fmt: skip


@FUZZ
@given(words=st.lists(any_word, max_size=6))
def test_any_words_become_a_command_line_or_are_refused(words):
    try:
        line = read(*words)
    except ParameterError as error:
        assert str(error)
        return
    arguments = {o.name: len(o.arguments) for o in LANGUAGE.options}
    assert set(line.settings) <= {o.name for o in LANGUAGE.options if o.run is None}
    for name, values in line.settings.items():
        assert len(values) == arguments[name] or (name == "--help" and len(values) <= 1)
    for step in line.steps:
        if step.op is not None:
            assert step.op in OPS and step.option is None
            assert len(step.arguments) == len(step.op.arguments())
        elif step.option is not None:
            assert step.option in STEPS
            assert len(step.arguments) == arguments[step.option.name]
        else:
            assert not step.word.startswith("-") or step.word == "-"
    if not line.settings:  # no word is lost, none is made up
        assert [word for step in line.steps for word in (step.word, *step.arguments)] == words
