# SPDX-License-Identifier: Apache-2.0
"""size=pow2: powers of two near the photo's sides, at the command line, in Python and in the library's default."""

from __future__ import annotations

import logging

import pytest

from oiiotex import filters
from oiiotex.engine.core.parameters import Size, SizeRule, parse_modifiers
from oiiotex.engine.errors import PYTHON, ParameterError, ParameterTypeError
from oiiotex.engine.session import Session
from oiiotex.filters.texpatchmatch import PatchMatch
from oiiotex.filters.texstationarize import Stationarize
from tests import pictures
from tests.any_filter import buffer
from tests.lattices import regular
from tests.refusals import refused


def test_each_side_becomes_the_nearest_power_of_two():
    assert Size(1000, 700).powers_of_two() == (1024, 512)
    assert Size(768, 767).powers_of_two() == (1024, 512)
    assert Size(1, 64).powers_of_two() == (1, 64)


@pytest.mark.parametrize("op", [Stationarize, PatchMatch])
def test_size_is_a_size_or_pow2(op):
    assert parse_modifiers(op, {"size": "pow2"}) == {"size": SizeRule.POW2}
    assert parse_modifiers(op, {"size": "64x32"}) == {"size": Size(64, 32)}
    for wrong in ("pow3", "", "64", "4x64"):
        with refused(ParameterError, parameter="size", value=wrong, expected="pow2 or WIDTHxHEIGHT from 5 to 65536 px"):
            parse_modifiers(op, {"size": wrong})
    (size,) = (p for p in op.parameters() if p.name == "size")
    assert size.check("pow2") == "pow2"
    with pytest.raises(ParameterError, match="pow2 or WIDTHxHEIGHT") as caught:
        size.check("pow3")
    assert "'pow2' or (width, height)" in caught.value.said(PYTHON)
    with pytest.raises(ParameterTypeError):
        size.check(64)


@pytest.mark.parametrize("filter", [filters.stationarize, filters.patchmatch])
def test_pow2_is_the_size_of_the_result(filter):
    photo = buffer(pictures.stained(pictures.moss(52, 90, 4)))
    tiles = [filter(photo, seed=2, iterations=2, size=size, session=Session()) for size in ("pow2", (64, 64))]
    assert (tiles[0].spec().width, tiles[0].spec().height) == (64, 64)
    assert (tiles[0].get_pixels() == tiles[1].get_pixels()).all()


def test_pow2_is_kept_on_a_lattice_with_a_warning_where_that_is_visible(caplog):
    photo, made = buffer(regular("square", 140, 140, 1)), {}
    for period, picture in (("19.3", photo), ("none", buffer(pictures.moss(140, 140, 1)))):
        caplog.clear()
        tile = filters.stationarize(picture, seed=2, iterations=2, size="pow2", session=Session())
        assert (tile.spec().width, tile.spec().height) == (128, 128)
        made[period] = [r.getMessage() for r in caplog.records if r.levelno == logging.WARNING]
    assert "128x128 px stretch" in made["19.3"][0] and not made["none"]
