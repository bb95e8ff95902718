# SPDX-License-Identifier: Apache-2.0
"""`lattice=` of ops that lay patches: regular results of regular photos, and nothing else changed."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np
import pytest

from oiiotex.analysis.regularity.lattice import BINS, Lattice, find_lattice
from oiiotex.analysis.regularity.offset_prices import BITS, InStep, Prices
from oiiotex.engine.color.lab import working_values
from oiiotex.engine.core.image import from_buffer
from oiiotex.engine.core.parameters import Size
from oiiotex.engine.core.window import Domain
from oiiotex.engine.session import Session
from oiiotex.filters.texcut import Cut
from oiiotex.filters.texquilt import Quilting
from oiiotex.filters.texsynth import Synth
from oiiotex.synthesis.quality.lost_structure import peaks_over_floor
from tests import pictures
from tests.any_filter import buffer
from tests.conftest import made_by
from tests.lattices import regular

OPS = [Quilting, Cut]
TILING = {Quilting: {"tiles": "xy", "patch": 24}, Cut: {"tiles": "xy", "patch": 32}}
WITHOUT_END = {"size": Size(256, 256), "exemplarside": 128, "tiles": "xy"}


@pytest.mark.parametrize(("op", "name"), [(Quilting, "oblique"), (Cut, "bricks")])
def test_a_result_is_as_regular_as_its_photo(op, name):
    session, image = Session(), from_buffer(buffer(regular(name, 192, 192, 3)))
    lab, _ = working_values(image, session.resources)
    lattice = find_lattice(lab)
    own, least = peaks_over_floor(lab, lattice, False), {}
    for structure in (0.0, 0.5):
        tile = made_by(op(exemplar=image, seed=1, lattice=structure, **TILING[op]), session)[op.main().name]
        seen, _ = working_values(from_buffer(buffer(tile.pixels())), session.resources)
        closed = replace(lattice, frequencies=lattice.on_torus(Domain(seen.shape[1], seen.shape[0], True, True)))
        least[structure] = (peaks_over_floor(seen, closed, True) / own).min()
    assert least[0.5] >= 0.8 and least[0.5] > least[0.0] + 0.15


def test_a_single_object_has_no_lattice():
    """A white disc: the high-pass has no stripes that rise over their mean."""
    y, x = np.indices((240, 300))
    disc = 100.0 * (np.hypot(y - 120, x - 150) < 40)
    assert find_lattice(np.stack([disc, 0 * disc, 0 * disc], -1).astype(np.float32)) is None


@pytest.mark.parametrize(
    ("name", "share", "gain"), [pytest.param("oblique", 0.6, 0.2, marks=pytest.mark.slow), ("bricks", 0.7, 0.3)]
)
def test_a_texture_without_end_is_nearly_as_regular_as_its_photo(name, share, gain):
    session, image = Session(), from_buffer(buffer(regular(name, 128, 128, 3)))
    lab, _ = working_values(image, session.resources)
    lattice, least = find_lattice(lab), {}
    own = peaks_over_floor(lab, lattice, False)
    for structure in (0.0, 0.5):
        tile = made_by(Synth(exemplar=image, seed=1, lattice=structure, **WITHOUT_END), session)["texture"]
        seen, _ = working_values(from_buffer(buffer(tile.pixels())), session.resources)
        closed = replace(lattice, frequencies=lattice.on_torus(Domain(256, 256, True, True)))
        least[structure] = (peaks_over_floor(seen, closed, True) / own).min()
    assert least[0.5] >= share and least[0.5] > least[0.0] + gain


@pytest.mark.parametrize("op", [*OPS, Synth])
def test_structure_changes_nothing_where_there_is_no_lattice(op):
    image = from_buffer(buffer(pictures.stained(pictures.moss(64, 72, 4))))
    without, most = (made_by(op(exemplar=image, seed=2, lattice=s))["st"].pixels() for s in (0.0, 1.0))
    np.testing.assert_array_equal(without, most)


@pytest.mark.parametrize("op", OPS)
def test_the_size_follows_the_lattice_or_is_warned_of(op, caplog):
    image = from_buffer(buffer(regular("square", 128, 128, 1)))
    with caplog.at_level(logging.INFO, "oiiotex"):
        tile = made_by(op(exemplar=image, **TILING[op]))[op.main().name]
    assert (tile.spec.width, tile.spec.height) == (135, 135)  # 7 periods of 19.3 px
    assert "a lattice of" in caplog.text and not any(r.levelno == logging.WARNING for r in caplog.records)
    given = made_by(op(exemplar=image, size=Size(125, 135), **TILING[op]))[op.main().name]
    assert given.spec.width == 125
    assert "116x135" in next(r for r in caplog.records if r.levelno == logging.WARNING).getMessage()
    one_sided = made_by(op(exemplar=image, **TILING[op] | {"tiles": "none"}))[op.main().name]
    assert (one_sided.spec.width, one_sided.spec.height) == (128, 128)


def test_prices_are_those_of_the_phase():
    frequencies = np.array([[0.11, 0.02], [-0.03, 0.09]])
    u = np.cos(2 * np.pi * np.arange(BINS) / BINS)
    lattice = Lattice(frequencies, 9.0, u[:, None] + 0.5 * u)
    kept = InStep(lattice, lattice.on_torus(Domain(90, 80, True, True)), 0.5)
    prices, (x, y) = Prices(kept.phases(), kept.table(1000.0), lattice.vectors()), (31, 17)
    own_x, own_y = np.arange(-5, 90), np.arange(-7, 70)
    cycles = np.stack(np.meshgrid(own_x, own_y), -1) @ frequencies.T - kept.wanted @ [x, y]
    at = np.floor(cycles % 1.0 * (1 << BITS) + 0.5).astype(int) % (1 << BITS)
    expected = np.rint(1000.0 * lattice.losses()[at[..., 0], at[..., 1]])
    assert (prices.at(x, y, own_x, own_y) == expected).mean() > 0.999  # ties of rounding aside
