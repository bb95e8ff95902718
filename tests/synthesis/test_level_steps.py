# SPDX-License-Identifier: Apache-2.0
"""Levels on both sides of a kept layout's seams: the steps, the field that removes them, and what it leaves alone."""

from __future__ import annotations

import numpy as np
import pytest

from oiiotex import filters
from oiiotex.analysis.drift.correction import Correction, smooth_offset, tint_between
from oiiotex.analysis.drift.drift_field import drift_cells
from oiiotex.engine.color.config import ColorConfig
from oiiotex.engine.core.source_map import SourceMap
from oiiotex.engine.core.window import Window
from oiiotex.synthesis.layout.level_steps import _spread, level_correction
from tests import pictures
from tests.any_filter import buffer, pixels

HEIGHT, WIDTH, PERIOD = 160, 200, 150
WHOLE = Window(0, 0, WIDTH, HEIGHT)
CELLS = drift_cells(WHOLE, 40)
NOISE = np.random.default_rng(5).normal(0, 2, (HEIGHT, WIDTH, 3))


def sheet(step: tuple[float, float, float]) -> np.ndarray:
    """Lab of a noisy gray sheet that is lighter on its right by `step`."""
    ramp = np.clip((np.arange(WIDTH) - 60) / 80, 0, 1)[:, None]
    return (np.array([50.0, 0, 0]) + NOISE + ramp * step).astype(np.float32)


def joined() -> SourceMap:
    """A tile whose right border lies at column 175 of the sheet, and whose left one at column 25."""
    return SourceMap.of(np.arange(HEIGHT)[:, None], 25 + np.arange(PERIOD))


def steps_of(lab: np.ndarray) -> np.ndarray:
    """The step from the left border of the tile to its right one."""
    return np.median(lab[:, 170:175], (0, 1)) - np.median(lab[:, 25:30], (0, 1))


def corrected(lab: np.ndarray, change: Correction | None) -> np.ndarray:
    assert change is not None
    made = lab.copy()
    change.apply(made, WHOLE)
    return made


@pytest.mark.parametrize("step", [(9, 0, 0), (-6, 0, 0), (0, 5, -4), (5, 4, 3)])
def test_a_step_of_light_is_removed(step):
    lab = sheet(step)
    made = corrected(lab, level_correction(joined(), (True, False), lab, None, CELLS, 1.0))
    assert np.abs(steps_of(made)).max() < 0.2 * np.abs(steps_of(lab)).max()
    # by a field without steps of its own, and no larger than half the step
    change = made - lab
    assert np.abs(np.diff(np.median(change[..., 0], 0))).max() < 0.1 * np.abs(step).max()
    assert np.abs(change).max() < 0.75 * np.abs(step).max()


@pytest.mark.parametrize("step", [(30, 0, 0), (0, 28, 0)])
def test_another_object_at_the_seam_is_no_light(step):
    lab = sheet(step)
    made = corrected(lab, level_correction(joined(), (True, False), lab, None, CELLS, 1.0))
    np.testing.assert_allclose(made, lab, atol=0.3)


def test_spots_at_the_seam_do_not_count():
    lab, plain = sheet((4, 0, 0)), sheet((4, 0, 0))
    spots = np.random.default_rng(1).random((HEIGHT // 4, WIDTH // 4)) < 0.15
    lab[spots.repeat(4, 0).repeat(4, 1)] = (20, 30, 30)
    ours, other = (level_correction(joined(), (True, False), one, None, CELLS, 1.0) for one in (lab, plain))
    np.testing.assert_allclose(corrected(plain, ours), corrected(plain, other), atol=1)


def test_pixels_that_are_not_usable_do_not_count():
    lab, plain, usable = sheet((8, 0, 0)), sheet((8, 0, 0)), np.ones((HEIGHT, WIDTH), bool)
    usable[40:80], lab[40:80, 100:] = False, lab[40:80, 100:] - 8
    left = [
        steps_of(corrected(plain, level_correction(joined(), (True, False), lab, mask, CELLS, 1.0))[50:70])[0]
        for mask in (usable, None)
    ]
    assert left[0] < 4 < 6 < left[1]  # of 8: the field continues from the rows around, or the step seems to be 0


def test_half_an_amount_removes_half():
    lab = sheet((8, 0, 0))
    whole, half = (
        corrected(lab, level_correction(joined(), (True, False), lab, None, CELLS, amount)) for amount in (1.0, 0.5)
    )
    np.testing.assert_allclose(half - lab, (whole - lab) / 2, atol=0.01)


def test_a_tile_without_seams_has_no_steps():
    lab = sheet((8, 0, 0))
    assert level_correction(joined(), (False, False), lab, None, CELLS, 1.0) is None


def test_rows_of_a_file_give_the_same():
    from oiiotex.engine.core.demand import MadeRows

    lab = sheet((8, 2, 0))
    rows = MadeRows(lab.shape, np.float32, lambda first, last: lab[first:last])
    one, other = (level_correction(joined(), (True, True), values, None, CELLS, 1.0) for values in (lab, rows))
    np.testing.assert_array_equal(corrected(lab, one), corrected(lab, other))


def test_the_field_solves_its_equations():
    """Against a dense solution of the same least squares."""
    rng, cells = np.random.default_rng(2), drift_cells(Window(0, 0, 130, 90), 40)
    shape = cells.down, cells.across
    near, far = rng.integers(0, shape[0] * shape[1], (2, 12))
    weights, steps = rng.random(12) + 0.5, rng.normal(size=(12, 3))
    index = np.arange(shape[0] * shape[1]).reshape(shape)
    pairs = [*zip(index[1:].ravel(), index[:-1].ravel(), strict=True)]
    pairs += [*zip(index[:, 1:].ravel(), index[:, :-1].ravel(), strict=True), *zip(near, far, strict=True)]
    system, goal = np.zeros((len(pairs), index.size)), np.zeros((len(pairs), 3))
    root = np.concatenate([np.ones(len(pairs) - 12), np.sqrt(weights)])
    for n, (a, b) in enumerate(pairs):
        system[n, a] += root[n]
        system[n, b] -= root[n]
    goal[-12:] = -np.sqrt(weights)[:, None] * steps
    best = np.linalg.lstsq(system, goal, rcond=None)[0]
    made = _spread(near, far, weights, steps, cells).reshape(-1, 3)
    np.testing.assert_allclose(made - made.mean(0), best - best.mean(0), atol=0.01)


def test_a_correction_turns_one_color_into_the_other():
    own, other = np.array([60.0, 12, -9]), np.array([54.0, 9, -5])
    field = np.broadcast_to(tint_between(own, other), (CELLS.down, CELLS.across, 3))
    made = np.broadcast_to(other.astype(np.float32), (HEIGHT, WIDTH, 3)).copy()
    smooth_offset(field, CELLS, 100).apply(made, WHOLE)
    np.testing.assert_allclose(made[20, 20], own, atol=0.4)


# --- the whole op ---


def photo() -> np.ndarray:
    return pictures.pebbles(112, 128, 3) * (0.7 + 0.4 * np.sin(np.arange(128) / 18)[:, None])


def test_the_field_that_is_written_out_has_the_evening_too():
    given = buffer(photo(), space="lin_rec709_scene")
    made = filters.stationarize(given, preset="layout", st=True, drift=True)
    st, field = pixels(made["st"]), pixels(made["drift"])
    x, y = (np.floor(st[..., k] * n).astype(int) for k, n in ((0, 128), (1, 112)))
    tile, lab = (np.ascontiguousarray(pixels(one)[..., :3]) for one in (made["tile"], given))
    for one in (tile, lab):
        ColorConfig().to_lab("lin_rec709_scene")(one)
    np.testing.assert_allclose(tile, (lab * field[..., :3] + field[..., 3:])[y, x], atol=1e-2)
    assert np.abs(field - pixels(filters.flatten(given, drift=True)["drift"])).max() > 0.5  # the seams were evened


def test_verbatim_copies_are_not_evened():
    given = buffer(photo(), space="lin_rec709_scene")
    made = filters.stationarize(given, preset="layout", flattening=0)
    known = {p.tobytes() for p in pixels(given).reshape(-1, 3)}
    assert all(p.tobytes() in known for p in pixels(made).reshape(-1, 3))
