# SPDX-License-Identifier: Apache-2.0
"""Words of a command line become settings and actions, or an error that says what is meant."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oiiotex.cli.parse import OPTIONS, CommandLine, parse, split_modifiers
from oiiotex.errors import ParameterError
from oiiotex.filters import FILTERS, PatchMatch, Stationarize, Warp

FUZZ = settings(max_examples=150, deadline=None, derandomize=True, database=None)
ON_THE_STACK = [o for o in OPTIONS if not o.setting]
OF_THE_RUN = [o for o in OPTIONS if o.setting and o.name != "--help"]


def refusal(call, argument) -> str:
    with pytest.raises(ParameterError) as caught:
        call(argument)
    return str(caught.value)


def steps(*words: str) -> list[tuple]:
    return [(a.op or a.option, a.modifiers or a.arguments) for a in parse(list(words)).actions]


# --- actions and settings ---


def test_a_chain_becomes_actions_in_the_order_of_the_words():
    words = "a.exr -d half --texstationarize:sigma=32:size=64x64 -o b.exr --texwarp c.exr"
    assert steps(*words.split()) == [
        ("-i", ("a.exr",)),
        ("-d", ("half",)),
        (Stationarize, {"sigma": "32", "size": "64x64"}),
        ("-o", ("b.exr",)),
        (Warp, ()),
        ("-i", ("c.exr",)),
    ]


def test_no_words_are_no_actions():
    assert parse([]) == CommandLine({}, ())


def test_an_action_keeps_the_word_as_it_was_written():
    assert [a.word for a in parse(["-texwarp", "a.exr", "--o", "b.exr"]).actions] == ["-texwarp", "a.exr", "--o"]


@pytest.mark.parametrize("option", OF_THE_RUN, ids=lambda o: o.name)
def test_a_setting_holds_wherever_it_stands(option):
    arguments = tuple(f"value{i}" for i in range(len(option.arguments)))
    for words in (
        [option.name, *arguments, "a.exr", "-o", "b.exr"],
        ["a.exr", option.name, *arguments, "-o", "b.exr"],
        ["a.exr", "-o", "b.exr", option.name, *arguments],
    ):
        line = parse(words)
        assert line.settings == {option.name: arguments}
        assert [a.option for a in line.actions] == ["-i", "-o"]


@pytest.mark.parametrize("option", ON_THE_STACK, ids=lambda o: o.name)
def test_an_action_takes_what_stands_behind_it(option):
    assert steps(option.name, "x", "a.exr") == [(option.name, ("x",)), ("-i", ("a.exr",))]


@pytest.mark.parametrize("op", FILTERS, ids=lambda op: op.name)
def test_every_filter_is_an_option(op):
    assert steps(op.flag()) == [(op, ())]
    assert op.flag() == f"--tex{op.name}"


def test_a_file_name_may_hold_colons_quotes_and_equal_signs():
    name = "C:\\a=b'\":.exr"
    assert steps(name) == [("-i", (name,))]
    assert steps("-o", name) == [("-o", (name,))]


def test_what_an_option_takes_may_begin_with_a_dash():
    assert steps("-i", "-dash.exr", "-o", "--help") == [("-i", ("-dash.exr",)), ("-o", ("--help",))]


def test_a_single_dash_is_a_file_name():
    assert steps("-") == [("-i", ("-",))]


@pytest.mark.parametrize(
    ("word", "name"),
    [
        ("-o", "-o"),
        ("--o", "-o"),
        ("--i", "-i"),
        ("--iscolorspace", "--iscolorspace"),
        ("-iscolorspace", "--iscolorspace"),
        ("-fixnan", "--fixnan"),
    ],
)
def test_one_dash_or_two_mean_the_same_on_actions(word, name):
    assert steps(word, "x") == [(name, ("x",))]


@pytest.mark.parametrize(
    ("word", "name"),
    [
        ("-v", "-v"),
        ("--v", "-v"),
        ("--verbose", "-v"),
        ("-verbose", "-v"),
        ("-version", "--version"),
        ("-autocc", "--autocc"),
        ("-runstats", "--runstats"),
        ("-h", "--help"),
        ("--h", "--help"),
        ("-help", "--help"),
    ],
)
def test_one_dash_or_two_and_aliases_mean_the_same_on_settings(word, name):
    assert parse([word]).settings == {name: ()}


def test_one_dash_or_two_mean_the_same_on_filters():
    assert steps("-texpatchmatch:seed=3") == steps("--texpatchmatch:seed=3") == [(PatchMatch, {"seed": "3"})]


@pytest.mark.parametrize("option", [o for o in OPTIONS if o.arguments], ids=lambda o: o.name)
def test_a_missing_argument_is_asked_for(option):
    assert refusal(parse, ["a.exr", option.name]) == f"{option.name} wants {option.arguments[0]} behind it"


@pytest.mark.parametrize("option", OPTIONS, ids=lambda o: o.name)
def test_an_option_that_has_no_modifiers_refuses_them(option):
    assert refusal(parse, [f"{option.name}:all=1", "x"]) == f"{option.name}:all=1: {option.name} has no modifiers"


@pytest.mark.parametrize(
    ("word", "meant"),
    [
        ("--texstationarise", "--texstationarize"),
        ("-texwrap", "--texwarp"),
        ("--iscolourspace", "--iscolorspace"),
        ("--fixnans", "--fixnan"),
        ("--thread", "--threads"),
        ("--texstationarise:sigma=3", "--texstationarize"),
    ],
)
def test_an_unknown_option_names_the_nearest(word, meant):
    assert refusal(parse, [word]) == f"unknown option '{word.split(':')[0]}', did you mean '{meant}'?"


@pytest.mark.parametrize("word", ["--zzzzzz", "--O", "--TEXWARP", "--texwarp ", "-5"])
def test_nothing_unknown_is_taken_for_something_else(word):
    assert refusal(parse, [word]).startswith(f"unknown option '{word}'")


def test_an_unknown_option_without_a_near_one_names_none():
    assert refusal(parse, ["--zzzzzz"]) == "unknown option '--zzzzzz'"


def test_two_dashes_alone_are_unknown():
    assert "unknown option '--'" in refusal(parse, ["--"])


# --- help ---


@pytest.mark.parametrize("word", ["--help", "-help", "-h"])
def test_help_takes_the_topic_behind_it_and_nothing_else_counts(word):
    assert parse([word]).settings == {"--help": ()}
    assert parse([word, "texwarp"]).settings == {"--help": ("texwarp",)}
    line = parse(["a.exr", word, "--texwarp", "--no-such", "-o"])
    assert line.settings == {"--help": ("--texwarp",)}
    assert [a.option for a in line.actions] == ["-i"]


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
    ],
)
def test_a_word_is_split_at_the_colons_outside_quotes(word, name, modifiers):
    assert split_modifiers(word) == (name, modifiers)


def test_modifiers_keep_their_order():
    assert list(split_modifiers("--op:c=1:a=2:b=3")[1]) == ["c", "a", "b"]


@pytest.mark.parametrize(
    ("word", "says"),
    [
        ("--op:a", "'a' is not NAME=VALUE"),
        ("--op:", "'' is not NAME=VALUE"),
        ("--op:a=1:", "'' is not NAME=VALUE"),
        ("--op::a=1", "'' is not NAME=VALUE"),
        ("--op:=1", "'=1' is not NAME=VALUE"),
        ("--op:a=1:b", "'b' is not NAME=VALUE"),
        ("--op:a=1:a=2", "'a' is given twice"),
        ("--op:a=1:b=2:a=1", "'a' is given twice"),
        ('--op:a="x:b=1', 'the quote " is not closed'),
        ("--op:a='", "the quote ' is not closed"),
    ],
)
def test_a_malformed_modifier_is_refused_with_the_word(word, says):
    assert refusal(split_modifiers, word) == f"{word}: {says}"
    assert refusal(parse, [word.replace("--op", "--texwarp")]).endswith(says)


names = st.text(st.characters(exclude_characters=":='\"", codec="utf-8"), min_size=1, max_size=6)


@FUZZ
@given(values=st.dictionaries(names, st.text(max_size=12), max_size=4), quote=st.sampled_from("\"'"))
def test_whatever_stands_in_quotes_comes_back(values, quote):
    values = {name: value.replace(quote, "") for name, value in values.items()}
    word = "--op" + "".join(f":{name}={quote}{value}{quote}" for name, value in values.items())
    assert split_modifiers(word) == ("--op", values)


@FUZZ
@given(word=st.text(st.sampled_from("-:='\"ab "), max_size=12) | st.text())
def test_any_word_is_split_or_refused(word):
    try:
        name, modifiers = split_modifiers(word)
    except ParameterError as error:
        assert str(error).startswith(f"{word}: ")
    else:
        assert word.startswith(name) or "=" in name  # a quote can only stand behind an equal sign
        assert all(modifiers)


known_words = [o.name for o in OPTIONS] + [op.flag() for op in FILTERS]
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
        line = parse(words)
    except ParameterError as error:
        assert str(error)
        return
    arguments = {o.name: len(o.arguments) for o in OPTIONS}
    assert set(line.settings) <= {o.name for o in OPTIONS if o.setting}
    for name, values in line.settings.items():
        assert len(values) == arguments[name] or (name == "--help" and len(values) <= 1)
    for action in line.actions:
        if action.op is not None:
            assert action.op in FILTERS
            assert not action.arguments
        else:
            assert action.option in {o.name for o in ON_THE_STACK}
            assert len(action.arguments) == arguments[action.option]
            assert not action.modifiers
    if not line.settings:  # no word is lost, none is made up
        flat = [(a.word, *(a.arguments if a.word.startswith("-") and a.word != "-" else ())) for a in line.actions]
        assert [word for group in flat for word in group] == words
