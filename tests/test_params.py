# SPDX-License-Identifier: Apache-2.0
"""A parameter is declared once: what it takes from a command line and from Python, and what it refuses."""

from __future__ import annotations

import math
from dataclasses import MISSING, dataclass
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oiiotex.errors import ParameterError
from oiiotex.filters import FILTERS
from oiiotex.images import Image
from oiiotex.op import Op, Output, Reach, Space
from oiiotex.params import Parameter, Size, declared, image, nearest, param, parse_modifiers

FUZZ = settings(max_examples=100, deadline=None, derandomize=True, database=None)


@dataclass(frozen=True, kw_only=True)
class Everything(Op):
    """An op with one parameter of every kind."""

    name: ClassVar[str] = "everything"
    reach: ClassVar[Reach] = Reach.POINT
    space: ClassVar[Space] = Space.ANY
    outputs: ClassVar[tuple[Output, ...]] = (Output("out", "nothing"),)

    source: Image = image(help="what to look at")
    mask: Image | None = image(None, help="where to look")
    count: int = param(help="how many", ge=0, le=10, unit="px")
    strength: float = param(1.0, help="how strong", ge=-1, le=2.5)
    sigma: float | None = param(None, help="how far", ge=0.5, unit="px")
    anything: float = param(0.0, help="any number")
    size: Size | None = param(None, help="how large", ge=5, le=65536, unit="px")
    flag: bool = param(False, help="whether")
    stmap: bool | Path = param(False, help="whether, or where")
    mode: str = param("xy", help="how", choices=("xy", "x", "none"))
    patch: int = param(0, help="of what side", choices=(0, 1, 5, 7))


KNOWN = {p.name: p for p in declared(Everything)[1]}


def refusal(call, *arguments) -> str:
    with pytest.raises(ParameterError) as caught:
        call(*arguments)
    return str(caught.value)


def is_allowed(parameter: Parameter, value: Any) -> bool:
    """What the declarations above say, once more and without the code under test."""
    if value is None:
        return parameter.name in ("sigma", "size")
    return {
        "count": lambda: type(value) is int and 0 <= value <= 10,
        "strength": lambda: type(value) is float and -1 <= value <= 2.5,
        "sigma": lambda: type(value) is float and 0.5 <= value < math.inf,
        "anything": lambda: type(value) is float and math.isfinite(value),
        "size": lambda: type(value) is Size and all(type(n) is int and 5 <= n <= 65536 for n in value),
        "flag": lambda: type(value) is bool,
        "stmap": lambda: type(value) is bool or isinstance(value, Path),
        "mode": lambda: type(value) is str and value in ("xy", "x", "none"),
        "patch": lambda: type(value) is int and value in (0, 1, 5, 7),
    }[parameter.name]()


# --- declarations ---


def test_a_declaration_gives_images_and_parameters_in_their_order():
    images, parameters = declared(Everything)
    assert [(i.name, i.kind, i.required, i.help) for i in images] == [
        ("source", None, True, "what to look at"),
        ("mask", None, False, "where to look"),
    ]
    order = ["count", "strength", "sigma", "anything", "size", "flag", "stmap", "mode", "patch"]
    assert [p.name for p in parameters] == order
    assert (Everything.images(), Everything.parameters()) == (images, parameters)


def test_a_declaration_keeps_its_facts():
    count, sigma, stmap = KNOWN["count"], KNOWN["sigma"], KNOWN["stmap"]
    assert (count.kind, count.default, count.required, count.unit) == ((int,), MISSING, True, "px")
    assert (count.ge, count.le, count.help, count.choices) == (0, 10, "how many", ())
    assert (sigma.kind, sigma.default, sigma.required) == ((float,), None, False)
    assert (stmap.kind, stmap.default, KNOWN["mode"].choices) == ((bool, Path), False, ("xy", "x", "none"))


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("count", "a whole number >= 0 and <= 10 px"),
        ("strength", "a number >= -1 and <= 2.5"),
        ("sigma", "a number >= 0.5 px"),
        ("anything", "a number"),
        ("size", "WIDTHxHEIGHT >= 5 and <= 65536 px"),
        ("flag", "0 or 1"),
        ("stmap", "0 or 1 or a file name"),
        ("mode", "xy | x | none"),
        ("patch", "0 | 1 | 5 | 7"),
    ],
)
def test_allowed_says_type_range_and_unit(name, words):
    assert KNOWN[name].allowed() == words


def test_allowed_says_an_upper_bound_alone_and_a_large_one_in_full():
    assert Parameter("n", (int,), 0, "", le=4).allowed() == "a whole number <= 4"
    assert Parameter("n", (int,), 0, "", ge=0, le=2**32 - 1).allowed() == "a whole number >= 0 and <= 4294967295"


# --- texts of the command line ---


@pytest.mark.parametrize(
    ("name", "text", "value"),
    [
        ("count", "0", 0),
        ("count", "10", 10),
        ("strength", "1", 1.0),
        ("strength", "-.5", -0.5),
        ("strength", "25e-1", 2.5),
        ("sigma", "0.5", 0.5),
        ("anything", "-1e30", -1e30),
        ("size", "5x65536", Size(5, 65536)),
        ("size", "640X480", Size(640, 480)),
        ("flag", "1", True),
        ("flag", "ON", True),
        ("flag", "True", True),
        ("flag", "yes", True),
        ("flag", "0", False),
        ("flag", "off", False),
        ("flag", "FALSE", False),
        ("flag", "no", False),
        ("stmap", "1", True),
        ("stmap", "0", False),
        ("stmap", "st.exr", Path("st.exr")),
        ("stmap", "2", Path("2")),
        ("mode", "none", "none"),
        ("patch", "7", 7),
        ("patch", "0", 0),  # a choice that is falsy is a choice
    ],
)
def test_a_text_becomes_a_value_of_the_declared_type(name, text, value):
    parsed = KNOWN[name].parse(text)
    assert (parsed, type(parsed)) == (value, type(value))


def test_a_falsy_word_is_a_choice_too():
    assert Parameter("suffix", (str,), "", "", choices=("", "a")).parse("") == ""


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("count", "-1"),
        ("count", "11"),
        ("count", "5.0"),
        ("count", "5.5"),
        ("count", "1e0"),
        ("count", "0x5"),
        ("count", "five"),
        ("count", ""),
        pytest.param("count", "9" * 5000, id="count-more digits than Python converts"),
        ("strength", "-1.01"),
        ("strength", "2.51"),
        ("strength", "1,5"),
        ("strength", ""),
        ("sigma", "0.49"),
        ("sigma", "none"),
        ("anything", "nan"),
        ("anything", "inf"),
        ("anything", "-Infinity"),
        ("anything", "1e400"),
        ("size", "64"),
        ("size", "64x"),
        ("size", "x64"),
        ("size", "64x64x64"),
        ("size", "64x4"),
        ("size", "4x64"),
        ("size", "64x65537"),
        ("size", "64.0x64"),
        ("size", ""),
        ("flag", "2"),
        ("flag", "maybe"),
        ("flag", ""),
        ("mode", "XY"),
        ("mode", "y"),
        ("mode", ""),
        ("patch", "6"),
        ("patch", "05"),
        ("patch", "5.0"),
    ],
)
def test_a_text_out_of_type_or_range_is_refused_with_the_text_and_what_is_allowed(name, text):
    assert refusal(KNOWN[name].parse, text) == f"{name}={text}: allowed is {KNOWN[name].allowed()}"


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


# --- values of Python callers ---


@pytest.mark.parametrize(
    ("name", "given_value", "value"),
    [
        ("count", 5, 5),
        ("count", 5.0, 5),
        ("count", np.int64(5), 5),
        ("count", np.uint8(5), 5),
        ("count", np.array(5), 5),
        ("count", np.float32(5), 5),
        ("strength", 2, 2.0),
        ("strength", np.int16(-1), -1.0),
        ("strength", np.float32(0.1), float(np.float32(0.1))),
        ("strength", np.float64(0.1), 0.1),
        ("sigma", None, None),
        ("size", None, None),
        ("size", (5, 6), Size(5, 6)),
        ("size", [5, 6], Size(5, 6)),
        ("size", Size(5, 6), Size(5, 6)),
        ("size", np.array([5, 6]), Size(5, 6)),
        ("size", (5.0, np.int32(6)), Size(5, 6)),
        ("flag", True, True),
        ("flag", False, False),
        ("stmap", True, True),
        ("stmap", "st.exr", Path("st.exr")),
        ("stmap", Path("st.exr"), Path("st.exr")),
        ("stmap", "1", Path("1")),  # no command line: a text is a name
        ("mode", "x", "x"),
        ("patch", 0, 0),
        ("patch", 5, 5),
        ("patch", np.int64(5), 5),
        ("patch", 5.0, 5),
    ],
)
def test_a_python_value_becomes_the_declared_type(name, given_value, value):
    checked = KNOWN[name].check(given_value)
    assert (checked, type(checked)) == (value, type(value))
    if isinstance(value, Size):
        assert [type(side) for side in checked] == [int, int]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("count", None),
        ("count", -1),
        ("count", 11),
        ("count", 5.5),
        ("count", "5"),
        ("count", b"5"),
        ("count", True),
        ("count", np.True_),
        ("count", math.nan),
        ("count", math.inf),
        ("count", 5 + 0j),
        ("count", [5]),
        ("count", np.array([5, 6])),
        ("strength", None),
        ("strength", "1"),
        ("strength", True),
        ("strength", np.True_),
        ("strength", np.float32(2.6)),
        ("anything", math.nan),
        ("anything", -math.inf),
        ("anything", np.float32("nan")),
        ("anything", 10**400),
        ("size", 64),
        ("size", "64x64"),
        ("size", "56"),
        ("size", (64,)),
        ("size", (64, 64, 64)),
        ("size", (64.5, 64)),
        ("size", (True, 64)),
        ("size", (64, None)),
        ("size", (4, 64)),
        ("size", (64, 65537)),
        ("size", (math.inf, 64)),
        ("flag", 1),
        ("flag", 0),
        ("flag", "1"),
        ("flag", None),
        ("stmap", 1),
        ("stmap", None),
        ("stmap", b"st.exr"),
        ("mode", None),
        ("mode", 1),
        ("mode", ["x"]),
        ("mode", np.array(["x", "xy"])),
        ("patch", 6),
        ("patch", "5"),
        ("patch", math.nan),
        ("patch", True),
        ("patch", np.array([5, 7])),
    ],
)
def test_a_python_value_out_of_type_or_range_is_refused_with_what_is_allowed(name, value):
    assert refusal(KNOWN[name].check, value).endswith(f": allowed is {KNOWN[name].allowed()}")


def test_a_refused_value_is_named():
    assert refusal(KNOWN["count"].check, -7).startswith("count=-7: ")
    assert refusal(KNOWN["size"].check, (4, 64)).startswith("size=(4, 64): ")


scalars = (
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=6) | st.binary(max_size=3)
    | st.complex_numbers() | st.fractions() | st.decimals() | st.just(np.True_) | st.just(10**400) | st.just(object())
    | st.sampled_from([np.int8(5), np.float16(1.5), np.array(7), np.array([5, 6]), Fraction(1, 2), Decimal("sNaN")])
)  # fmt: skip


@FUZZ
@given(name=st.sampled_from(list(KNOWN)), value=scalars | st.lists(scalars, max_size=3) | st.tuples(scalars, scalars))
def test_any_python_value_becomes_an_allowed_one_or_is_refused(name, value):
    try:
        checked = KNOWN[name].check(value)
    except ParameterError as error:
        assert KNOWN[name].allowed() in str(error)
    else:
        assert is_allowed(KNOWN[name], checked)


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
    assert "unknown modifier 'qqqq'; there is count, strength" in text


def test_an_image_is_no_modifier():
    assert "'source'" in refusal(parse_modifiers, Everything, {"source": "a.exr"})


def test_nearest_asks_or_is_silent():
    assert nearest("iteration", ["iterations", "sigma"]) == ", did you mean 'iterations'?"
    assert nearest("zzz", ["iterations", "sigma"]) == ""


def test_an_op_holds_checked_values_and_its_refusals_bear_its_name():
    made = Everything(source=None, count=np.int64(3), size=[6, 7], strength=1)
    assert made.values() == {
        "count": 3, "strength": 1.0, "sigma": None, "anything": 0.0, "size": Size(6, 7), "flag": False, "stmap": False,
        "mode": "xy", "patch": 0,
    }  # fmt: skip
    assert (type(made.count), type(made.size), type(made.strength)) == (int, Size, float)
    text = refusal(lambda: Everything(source=None, count=11))
    assert text == "everything: count=11: allowed is a whole number >= 0 and <= 10 px"


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
