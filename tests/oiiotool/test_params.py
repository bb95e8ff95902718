# SPDX-License-Identifier: Apache-2.0
"""A parameter is declared once: what it takes from a command line, and what it refuses."""

from __future__ import annotations

from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oiiotex.engine.core.access import Pointwise
from oiiotex.engine.core.image import Image
from oiiotex.engine.core.op import Kind, Output, Space
from oiiotex.engine.core.parameters import (
    Numbers,
    Parameter,
    Size,
    Words,
    argument,
    image,
    nearest,
    param,
    parse_modifiers,
)
from oiiotex.engine.errors import ParameterError
from oiiotex.filters import FILTERS
from tests.everything import KNOWN, Everything, is_allowed, refusal

FUZZ = settings(max_examples=100, deadline=None, derandomize=True, database=None)


@dataclass(frozen=True, kw_only=True)
class Merge(Pointwise):
    """An op of the host's kind: words behind it, and as many images as there are."""

    prefix: ClassVar[str] = "--"
    name: ClassVar[str] = "merge"
    space: ClassVar[Space] = Space.ANY
    outputs: ClassVar[tuple[Output, ...]] = (Output("out", Kind.PIXELS, "nothing"),)

    sources: tuple[Image, ...] = image(help="what to merge")
    mask: Image | None = image(None, help="where")
    mode: str = argument(help="how", choices=("over", "max"))
    weights: Numbers = argument(help="how much of each")
    shift: int = argument(help="how far", ge=-5, le=5, unit="px")
    gamma: float = param(1.0, help="how bright", ge=0)
    from_: str = param("here", help="from where")


# --- declarations ---


def test_a_declaration_gives_images_and_parameters_in_their_order():
    images, parameters = (*Everything.images(), *Everything.optional_images()), Everything.parameters()
    assert [(i.name, i.kind, i.required, i.help) for i in images] == [
        ("source", None, True, "what to look at"),
        ("mask", None, False, "where to look"),
    ]
    order = ["count", "strength", "sigma", "anything", "size", "either", "stmap", "mode", "patch", "color", "words"]
    assert [p.name for p in parameters] == order
    assert not any(given.many for given in images)


def test_a_declaration_keeps_its_facts():
    count, sigma, stmap = KNOWN["count"], KNOWN["sigma"], KNOWN["stmap"]
    assert (count.kind, count.default, count.required, count.unit) == ((int,), MISSING, True, "px")
    assert (count.ge, count.le, count.help, count.choices) == (0, 10, "how many", ())
    assert (sigma.kind, sigma.default, sigma.required) == ((float,), None, False)
    assert (stmap.kind, stmap.default, KNOWN["mode"].choices) == ((bool, Path), False, ("xy", "x", "none"))


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("count", "an integer from 0 to 10 px"),
        ("strength", "a number from -1 to 2.5"),
        ("sigma", "a number >= 0.5 px"),
        ("anything", "a number"),
        ("size", "WIDTHxHEIGHT from 5 to 65536 px"),
        ("either", "0 or 1"),
        ("stmap", "0, 1, or a file name"),
        ("mode", "one of xy, x, none"),
        ("patch", "one of 0, 1, 5, 7"),
        ("color", "a comma-separated list of numbers"),
        ("words", "a comma-separated list"),
    ],
)
def test_allowed_says_type_range_and_unit(name, words):
    assert KNOWN[name].allowed() == words


def test_allowed_says_an_upper_bound_alone_and_a_large_one_in_full():
    assert Parameter("n", (int,), 0, "", le=4).allowed() == "an integer <= 4"
    assert Parameter("n", (int,), 0, "", ge=0, le=2**32 - 1).allowed() == "an integer from 0 to 4294967295"


# --- texts of the command line ---


TAKEN = {
    "count": [("0", 0), ("10", 10)],
    "strength": [("1", 1.0), ("-.5", -0.5), ("25e-1", 2.5)],
    "sigma": [("0.5", 0.5)],
    "anything": [("-1e30", -1e30)],
    "size": [("5x65536", Size(5, 65536)), ("640X480", Size(640, 480))],
    "either": [
        ("1", True), ("ON", True), ("True", True), ("yes", True), ("0", False), ("off", False), ("FALSE", False),
        ("no", False),
    ],
    "stmap": [("1", True), ("0", False), ("st.exr", Path("st.exr")), ("2", Path("2"))],
    "mode": [("none", "none")],
    "patch": [("7", 7), ("0", 0)],
    "color": [
        ("1", Numbers((1.0,))), ("1,-.5,2e3", Numbers((1.0, -0.5, 2000.0))), ("1, 2 ,3", Numbers((1.0, 2.0, 3.0))),
    ],
}  # fmt: skip


@pytest.mark.parametrize(("name", "text", "value"), [(name, *row) for name, rows in TAKEN.items() for row in rows])
def test_a_text_becomes_a_value_of_the_declared_type(name, text, value):
    parsed = KNOWN[name].parse(text)
    assert (parsed, type(parsed)) == (value, type(value))


def test_a_falsy_word_is_a_choice_too():
    assert Parameter("suffix", (str,), "", "", choices=("", "a")).parse("") == ""
    paper = Parameter("paper", (bool, str), False, "", choices=(False, True, "authors"))
    assert [paper.parse(text) for text in ("1", "off", "authors")] == [True, False, "authors"]
    assert (paper.allowed(), paper.default_text, paper.sample) == ("one of 0, 1, authors", "0", "1")


REFUSED = {
    "count": ["-1", "11", "5.0", "5.5", "1e0", "0x5", "five", "", "9" * 5000],
    "strength": ["-1.01", "2.51", "1,5", ""],
    "sigma": ["0.49", "none"],
    "anything": ["nan", "inf", "-Infinity", "1e400"],
    "size": ["64", "64x", "x64", "64x64x64", "64x4", "4x64", "64x65537", "64.0x64", ""],
    "either": ["2", "maybe", ""],
    "mode": ["XY", "y", ""],
    "patch": ["6", "05", "5.0"],
    "words": ["", "a,,b"],
    "color": ["", "1,", ",1", "1,,2", "1 2", "1,nan", "red"],
}  # fmt: skip


@pytest.mark.parametrize(("name", "text"), [(name, value) for name, values in REFUSED.items() for value in values])
def test_a_text_out_of_type_or_range_is_refused_with_the_text_and_what_is_allowed(name, text):
    said = refusal(KNOWN[name].parse, text)
    assert said.startswith(f"{name}={text}"[:900]) and said.endswith(f"{text[-50:]}: expected {KNOWN[name].allowed()}")


@pytest.mark.parametrize("text", ["1_0", "٣", "３", " 5", "5 ", "5\n", "\t5"])
def test_what_only_python_calls_a_number_is_refused(text):
    for name in ("count", "anything"):
        refusal(KNOWN[name].parse, text)
    for size in (f"{text}x9", f"9x{text}"):
        refusal(Parameter("size", (Size,), None, "").parse, size)


def test_an_empty_file_name_is_refused():
    refusal(KNOWN["stmap"].parse, "")  # Path('') is the working folder


@pytest.mark.parametrize("text", ["1e31", "007e30", "1e400"])
def test_a_refused_text_is_quoted_as_it_was_written(text):
    assert f"={text}:" in refusal(Parameter("limit", (float,), 0.0, "", le=1e30).parse, text)


def test_a_refusal_is_one_line_whatever_was_written():
    assert "\n" not in refusal(KNOWN["count"].parse, "1\n2")
    assert "\n" not in refusal(KNOWN["mode"].parse, "x\r\ny")
    assert "\n" not in refusal(KNOWN["size"].check, np.zeros((3, 3)))


@FUZZ
@given(name=st.sampled_from(list(KNOWN)), text=st.text() | st.from_regex(r"\A[-+ _.xXeE0-9]{0,12}\Z"))
def test_any_text_becomes_an_allowed_value_or_is_refused(name, text):
    parameter = KNOWN[name]
    try:
        value = parameter.parse(text)
    except ParameterError as error:
        assert parameter.allowed() in str(error)
    else:
        assert value is not None
        assert is_allowed(parameter, value)
        assert parameter.check(value) == value


@FUZZ
@given(number=st.integers(-3, 13), part=st.floats(-2, 4), width=st.integers(1, 70000), height=st.integers(1, 70000))
def test_every_value_in_the_range_is_taken_and_none_beside_it(number, part, width, height):
    for name, text, value in (
        ("count", str(number), number),
        ("strength", repr(part), part),
        ("size", f"{width}x{height}", Size(width, height)),
    ):
        if is_allowed(KNOWN[name], value):
            assert KNOWN[name].parse(text) == KNOWN[name].check(value) == value
        else:
            refusal(KNOWN[name].parse, text)
            refusal(KNOWN[name].check, value)


# --- an op's values together ---


def test_modifiers_become_values_by_name():
    values = parse_modifiers(Everything, {"count": "3", "size": "6x7", "stmap": "1", "mode": "x"})
    assert values == {"count": 3, "size": Size(6, 7), "stmap": True, "mode": "x"}
    assert parse_modifiers(Everything, {}) == {}


def test_an_unknown_modifier_names_the_nearest_and_all_there_are():
    text = refusal(parse_modifiers, Everything, {"sigm": "3"})
    assert text.startswith("unknown modifier 'sigm', did you mean 'sigma'?")
    assert all(name in text for name in KNOWN)


def test_an_unknown_modifier_without_a_near_one_names_none():
    text = refusal(parse_modifiers, Everything, {"qqqq": "3"})
    assert "did you mean" not in text
    assert "unknown modifier 'qqqq'; modifiers: mask, count, strength" in text


def test_an_image_is_no_modifier():
    assert "'source'" in refusal(parse_modifiers, Everything, {"source": "a.exr"})


def test_nearest_asks_or_is_silent():
    assert nearest("iteration", ["iterations", "sigma"]) == ", did you mean 'iterations'?"
    assert nearest("zzz", ["iterations", "sigma"]) == ""


def test_an_op_holds_checked_values_and_its_refusals_bear_its_name():
    made = Everything(source=None, count=np.int64(3), size=[6, 7], strength=1)
    assert made.values() == {
        "count": 3, "strength": 1.0, "sigma": None, "anything": 0.0, "size": Size(6, 7), "either": False,
        "stmap": False, "mode": "xy", "patch": 0, "color": None, "words": None,
    }  # fmt: skip
    assert (type(made.count), type(made.size), type(made.strength)) == (int, Size, float)
    text = refusal(lambda: Everything(source=None, count=11))
    assert text == "everything: count=11: expected an integer from 0 to 10 px"


# --- words behind an op, many images ---


def test_an_argument_is_a_word_of_its_own_and_no_modifier():
    assert [p.name for p in Merge.arguments()] == ["mode", "weights", "shift"]
    assert [p.name for p in Merge.modifiers()] == ["mask", "gamma", "from"]
    assert all(p.required for p in Merge.arguments())
    assert Everything.arguments() == ()
    text = refusal(parse_modifiers, Merge, {"mode": "max"})
    assert text == "unknown modifier 'mode'; modifiers: mask, gamma, from"


def test_an_argument_is_checked_as_a_modifier_is():
    mode, weights, shift = Merge.arguments()
    assert (mode.parse("max"), weights.parse("1,2"), shift.parse("-5")) == ("max", (1.0, 2.0), -5)
    assert refusal(mode.parse, "under") == "mode=under: expected one of over, max"
    assert refusal(shift.parse, "6") == "shift=6: expected an integer from -5 to 5 px"
    made = Merge(sources=(), mode="over", weights=[1, np.float32(0.5)], shift=np.int8(2))
    assert made.values() == {"mode": "over", "weights": (1.0, 0.5), "shift": 2, "gamma": 1.0, "from": "here"}
    assert type(made.weights) is Numbers
    assert "merge: shift=9" in refusal(lambda: Merge(sources=(), mode="over", weights=1, shift=9))


def test_a_word_that_python_keeps_for_itself_is_a_name_for_users():
    assert parse_modifiers(Merge, {"from": "there"}) == {"from_": "there"}
    assert "unknown modifier 'from_'" in refusal(parse_modifiers, Merge, {"from_": "there"})


def test_a_declaration_says_where_many_images_go():
    assert [(given.name, given.many, given.required) for given in (*Merge.images(), *Merge.optional_images())] == [
        ("sources", True, True),
        ("mask", False, False),
    ]


@dataclass(frozen=True, kw_only=True)
class Set(Pointwise):
    """Takes as many images as kinds has values."""

    name: ClassVar[str] = "set"
    space: ClassVar[Space] = Space.ANY
    outputs: ClassVar[tuple[Output, ...]] = (Output("out", Kind.PIXELS, "as many"),)

    first: Image = image(help="the first")
    others: tuple[Image, ...] = image((), help="the others", count="kinds")
    mask: Image | None = image(None, help="where")
    kinds: Words | None = param(None, help="one for each", example="a,b")


def test_a_declaration_says_which_parameter_counts_images():
    assert Set.further_images().name == "others" and Everything.further_images() is None
    assert [i.name for i in (*Set.images(), *Set.optional_images())] == ["first", "mask"]
    assert [
        Set.arity(values, 9) for values in ({}, {"kinds": "abc"}, {"kinds": "abc", "mask": True}, {"mask": "a.exr"})
    ] == [
        1,
        3,
        4,
        1,
    ]
    assert [p.name for p in Set.modifiers()] == ["mask", "kinds"]
    assert "unknown modifier 'others'" in refusal(parse_modifiers, Set, {"others": "1"})


def test_a_text_that_is_not_known_yet_is_passed_over_but_its_name_is_checked():
    assert parse_modifiers(Merge, {"gamma": None, "from": "x"}) == {"from_": "x"}
    assert "did you mean 'gamma'" in refusal(parse_modifiers, Merge, {"gama": None})


@FUZZ
@given(values=st.lists(st.floats(-(2.0**20), 2.0**20, width=32), min_size=1, max_size=5))
def test_numbers_are_written_as_they_are_read(values):
    numbers = KNOWN["color"].check(values)
    assert KNOWN["color"].parse(",".join(map(repr, values))) == numbers
    np.testing.assert_allclose(KNOWN["color"].parse(str(numbers)), numbers, rtol=1e-5, atol=1e-30)


# --- the filters ---


@pytest.mark.parametrize("op", FILTERS, ids=lambda op: op.name)
def test_every_filters_defaults_are_allowed_and_can_be_written_out(op):
    for parameter in op.parameters():
        assert not parameter.required
        default = parameter.default
        assert parameter.check(default) == default
        if default is not None:
            text = str(int(default)) if isinstance(default, bool) else str(default)
            assert (parameter.parse(text), type(parameter.parse(text))) == (default, type(default))
        assert parameter.help
        assert parameter.allowed()
