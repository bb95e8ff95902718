# SPDX-License-Identifier: Apache-2.0
"""What a parameter takes from a Python caller, and what it refuses."""

from __future__ import annotations

import math
from decimal import Decimal
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oiiotex.engine.core.parameters import Numbers, Size, Words
from oiiotex.engine.errors import PYTHON, ParameterError, spelled
from tests.everything import KNOWN, is_allowed

FUZZ = settings(max_examples=100, deadline=None, derandomize=True, database=None)


def refused(name: str, value: object) -> ParameterError:
    with pytest.raises(ParameterError) as caught:
        KNOWN[name].check(value)
    return caught.value


TAKEN = {
    "count": [(5, 5), (5.0, 5), (np.int64(5), 5), (np.uint8(5), 5), (np.array(5), 5), (np.float32(5), 5)],
    "strength": [(2, 2.0), (np.int16(-1), -1.0), (np.float32(0.1), float(np.float32(0.1))), (np.float64(0.1), 0.1)],
    "sigma": [(None, None)],
    "size": [
        (None, None), ((5, 6), Size(5, 6)), ([5, 6], Size(5, 6)), (Size(5, 6), Size(5, 6)),
        (np.array([5, 6]), Size(5, 6)), ((5.0, np.int32(6)), Size(5, 6)),
    ],
    "either": [(True, True), (False, False)],
    "stmap": [
        (True, True), ("st.exr", Path("st.exr")), (Path("st.exr"), Path("st.exr")),
        ("1", Path("1")),  # no command line: a text is a name
    ],
    "mode": [("x", "x")],
    "patch": [(0, 0), (5, 5), (np.int64(5), 5), (5.0, 5)],
    "color": [
        (None, None), ((1, 0.5), Numbers((1.0, 0.5))), ([np.float32(2), np.int8(-3)], Numbers((2.0, -3.0))),
        (np.array([1, 2, 3]), Numbers((1.0, 2.0, 3.0))), (7, Numbers((7.0,))),
    ],
    "words": [(None, None), (["a", "b"], Words(("a", "b"))), (("a",), Words(("a",)))],
}  # fmt: skip


@pytest.mark.parametrize(
    ("name", "given_value", "value"), [(name, *row) for name, rows in TAKEN.items() for row in rows]
)
def test_a_python_value_becomes_the_declared_type(name, given_value, value):
    checked = KNOWN[name].check(given_value)
    assert (checked, type(checked)) == (value, type(value))
    if isinstance(value, Size):
        assert [type(side) for side in checked] == [int, int]


REFUSED = {
    "count": [None, -1, 11, 5.5, "5", b"5", True, np.True_, math.nan, math.inf, 5 + 0j, [5], np.array([5, 6])],
    "strength": [None, "1", True, np.True_, np.float32(2.6)],
    "anything": [math.nan, -math.inf, np.float32("nan"), 10**400],
    "size": [
        64, "64x64", "56", (64,), (64, 64, 64), (64.5, 64), (True, 64), (64, None), (4, 64), (64, 65537),
        (math.inf, 64),
    ],
    "either": [1, 0, "1", None],
    "stmap": [1, None, b"st.exr"],
    "mode": [None, 1, ["x"], np.array(["x", "xy"])],
    "patch": [6, "5", math.nan, True, np.array([5, 7])],
    "color": ["1,2", (), [1, "2"], [1, math.nan], [1, None], [True], [[1, 2], [3, 4]]],
}  # fmt: skip


@pytest.mark.parametrize(("name", "value"), [(name, value) for name, values in REFUSED.items() for value in values])
def test_a_python_value_out_of_type_or_range_is_refused_with_what_is_allowed(name, value):
    assert f": expected {spelled(KNOWN[name].expected, PYTHON)}" in refused(name, value).said(PYTHON)


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("sigma", "20", "sigma='20': expected a number >= 0.5 px, not str"),
        ("count", True, "count=True: expected an integer from 0 to 10 px, not bool"),
        ("count", None, "count=None: expected an integer from 0 to 10 px, not NoneType"),
        ("size", "64x64", "size='64x64': expected (width, height) from 5 to 65536 px, not str"),
        ("size", 64, "size=64: expected (width, height) from 5 to 65536 px, not int"),
        ("either", 1, "either=1: expected True or False, not int"),
        ("stmap", 1, "stmap=1: expected True, False, or a file name, not int"),
        ("mode", 1, "mode=1: expected one of 'xy', 'x', 'none', not int"),
        ("color", [1, "2"], "color=[1, '2']: expected a number or a sequence of numbers"),
        ("words", "a,b", "words='a,b': expected a sequence of strings, not str"),
        ("words", [1], "words=[1]: expected a sequence of strings"),
    ],
)
def test_a_wrong_type_is_a_type_error_in_words_of_python(name, value, said):
    error = refused(name, value)
    assert isinstance(error, TypeError) and error.said(PYTHON) == said


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("count", -7, "count=-7: expected an integer from 0 to 10 px"),
        ("size", (4, 64), "size=(4, 64): expected (width, height) from 5 to 65536 px"),
        ("mode", "z", "mode='z': expected one of 'xy', 'x', 'none'"),
        ("words", [], "words=[]: expected a sequence of strings"),
    ],
)
def test_a_value_out_of_range_is_no_type_error(name, value, said):
    error = refused(name, value)
    assert not isinstance(error, TypeError) and error.said(PYTHON) == said


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
        assert spelled(KNOWN[name].expected, PYTHON) in error.said(PYTHON)
    else:
        assert is_allowed(KNOWN[name], checked)
