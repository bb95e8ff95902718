# SPDX-License-Identifier: Apache-2.0
"""A photo that does not fit the budget is read by rows, and gives the tile that it gives in memory."""

from __future__ import annotations

from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from oiiotex.engine.core import demand, source_map
from oiiotex.engine.core.demand import MadeRows, resized
from oiiotex.engine.core.source_map import SourceMap
from oiiotex.engine.errors import MemoryBudgetError
from oiiotex.engine.io.disk_cache import hash_of
from oiiotex.engine.opencl.buffers import require_room
from oiiotex.engine.session import Session
from oiiotex.synthesis.exemplar.exemplar_op import ExemplarOp
from oiiotex.synthesis.patchmatch import memory, optimization
from oiiotex.synthesis.patchmatch.constraints import Octaves
from oiiotex.synthesis.patchmatch.field import Geometry, allowed_patches, hash_at, random_field, variance_of
from oiiotex.synthesis.patchmatch.use_prices import ranked
from tests import pictures
from tests.any_filter import buffer, pixels
from tests.synthesis.test_bands import in_file

pytestmark = pytest.mark.usefixtures("few_places")
WIDTH, HEIGHT = 120, 170
RANDOM = np.random.default_rng(7)
PHOTO = pictures.stained(pictures.pebbles(HEIGHT, WIDTH, 2)).astype(np.float32)


def marked(*rectangle: int) -> np.ndarray:
    """1 in a rectangle of (top, bottom, left, right), else 0."""
    top, bottom, left, right = rectangle
    mask = np.zeros((HEIGHT, WIDTH, 1), np.float32)
    mask[top:bottom, left:right] = 1
    return mask


HOLE = 1 - marked(30, 70, 50, 90)
WEIGHT = RANDOM.random((HEIGHT, WIDTH, 1)).astype(np.float32)
NORMALS = (0.5 + 0.4 * RANDOM.random((HEIGHT, WIDTH, 3))).astype(np.float32)
SMALL = {"size": (72, 64), "iterations": 2, "patch": 7, "seed": 3}
WITH_ALPHA = np.concatenate([PHOTO * HOLE, HOLE], -1)
OPS: dict[str, tuple[str, dict[str, Any]]] = {
    "a photo": ("stationarize", {"st": True}),
    "alpha and a mask": ("stationarize", {"exemplar": WITH_ALPHA, "mask": 1 - marked(110, 170, 80, 120)}),
    "weights": ("stationarize", {"weightmap": WEIGHT, "measure": "moments"}),
    "a part anew": ("fill", {"region": marked(60, 80, 60, 90), "size": None}),
    "a material": ("stationarize", {"maps": [NORMALS, PHOTO[..., :1]], "kinds": ("color", "normal", "height")}),
    "variants": ("stationarize", {"variants": 2, "measure": "moments", "iterations": 1}),
    "coherent": ("stationarize", {"search": "coherent", "mask": HOLE}),
    "by the letter": ("stationarize", {"paper": True, "sigma": 5}),
}


def made(case: str, session: Session) -> list[np.ndarray]:
    name, given = OPS[case]
    given = {**SMALL, "exemplar": PHOTO, **given}
    images = {key: buffer(value) for key, value in given.items() if isinstance(value, np.ndarray)}
    images |= {"maps": [buffer(one, space="data") for one in given["maps"]]} if "maps" in given else {}
    given |= images
    taken = [given.pop(key) for key in ("exemplar", "region") if key in given]
    more = {key: value for key, value in given.items() if value is not None}
    results = getattr(filters, name)(*taken, session=session, **more)
    found = []
    for one in results if isinstance(results, list) else [results]:
        found += [pixels(part) for part in (one.values() if isinstance(one, dict) else [one])]
    return found


def least_plan(device, shape, recipe, geometries, scales, constraints, budget, held) -> memory.MemoryPlan:
    """That of the smallest budget that is not refused, by steps of a twelfth."""
    budget = 1 << 20
    while True:
        plan = memory.plan_memory(device, shape, recipe, geometries, scales, constraints, budget, held)
        try:
            require_room(device, plan.layout, budget, "", plan.on_host)
        except MemoryBudgetError:
            budget = budget * 13 // 12
        else:
            return plan


@pytest.mark.parametrize("case", OPS)
def test_a_photo_that_does_not_fit_is_read_by_rows(case, monkeypatch):
    whole = made(case, Session())
    plans = []
    monkeypatch.setattr(optimization, "plan_memory", lambda *given: plans.append(least_plan(*given)) or plans[-1])
    monkeypatch.setattr(ExemplarOp, "holds", lambda *_: False)
    monkeypatch.setattr(memory, "_PIXEL_TEMPORARIES", 0)  # which count for more than such a photo
    by_rows = made(case, Session())
    assert plans and not any(plan.exemplar_whole for plan in plans)
    assert len(by_rows) == len(whole)
    for ours, theirs in zip(by_rows, whole, strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_what_is_gathered_from_a_file_is_what_memory_has(monkeypatch):
    photo = RANDOM.integers(0, 1 << 15, (53, 31, 3)).astype(np.int16)
    where = SourceMap.of(RANDOM.integers(0, 53, (17, 23)), RANDOM.integers(0, 31, (17, 23)))
    for limit in (1, 31 * 6 * 7, 1 << 20):  # a row at a time, seven, all
        monkeypatch.setattr(source_map, "_ROWS_AT_ONCE", limit)
        np.testing.assert_array_equal(where.gather(in_file(photo)), photo[where.yx])
    assert hash_of(in_file(photo), 3) == hash_of(photo, 3) != hash_of(photo[::-1], 3)


@pytest.mark.parametrize("size", [(23, 17), (70, 90), (53, 30), (53, 31)])
def test_rows_of_a_reduced_image_hang_on_no_others(size, monkeypatch):
    photo, mask = RANDOM.random((90, 53, 3)).astype(np.float32), RANDOM.random((90, 53)) > 0.3
    width, height = size
    buffer = oiio.ImageBuf(np.ascontiguousarray(photo))
    roi = oiio.ROI(0, width, 0, height, 0, 1, 0, 3)
    expected = oiio.ImageBufAlgo.resize(buffer, "triangle", roi=roi).get_pixels(oiio.FLOAT)
    rows = MadeRows(photo.shape, np.float32, lambda first, last: photo[first:last])
    oracle, expected = expected, resized(photo, width, height)
    np.testing.assert_allclose(expected, oracle, rtol=0, atol=2e-5)  # OpenImageIO: positions of 32 bits
    masked = Octaves(photo, mask).reduced(width, height)
    for limit in (1, 9000, 1 << 24):
        monkeypatch.setattr(demand, "_RESIZED_BYTES", limit)
        np.testing.assert_array_equal(resized(rows, width, height), expected)
        some = slice(5, 13)
        np.testing.assert_array_equal(resized(rows, width, height, some), expected[some])
        np.testing.assert_array_equal(Octaves(rows, mask).reduced(width, height, some), masked[some])


@pytest.mark.parametrize("share", [0, 0.4, 0.999])
@pytest.mark.parametrize("weighted", [False, True])
def test_places_are_drawn_as_from_a_list_of_them(share, weighted):
    g = Geometry(40, 44, True, True, exemplar_width=37, exemplar_height=300, patch=5)
    allowed = RANDOM.random((g.exemplar_rows, g.exemplar_columns)) >= share
    allowed[:140] &= share == 0  # a band without any
    allowed[200, 3] = True
    weights = RANDOM.random(allowed.shape).astype(np.float32) if weighted else None
    places = np.flatnonzero(allowed)
    y, x = np.indices((g.rows, g.columns)) // g.patch
    bits = hash_at(6, 0xB10C, y, x).astype(np.uint64)
    at = (bits * len(places) >> 32).astype(int)
    if weighted:
        below = np.cumsum(weights.ravel()[places], dtype=np.float64)
        at = np.searchsorted(below, bits * (below[-1] / 2.0**32), side="right")
    drawn = SourceMap.of(*np.divmod(places[at], g.exemplar_columns))
    corners = (np.indices((g.rows, g.columns)) % g.patch == 0).all(0)
    field = random_field(g, allowed, 6, weights)
    np.testing.assert_array_equal(field.packed[corners], drawn.packed[corners])


def test_order_statistics_are_those_of_sorting():
    shares = np.arange(1, 15) / 15
    for values in (RANDOM.integers(0, 9, (300, 40)), RANDOM.lognormal(8, 3, (300, 40)), np.zeros((3, 2))):
        active, allowed = values.astype(np.float32), RANDOM.random(values.shape) > 0.2
        allowed[0, 0] = True
        expected = np.quantile(active[allowed], shares, method="inverted_cdf")
        np.testing.assert_array_equal(ranked(in_file(active), allowed, shares), expected)


def test_a_variance_is_that_of_all_pixels():
    pixels, usable = RANDOM.integers(-1200, 1200, (290, 31, 4)).astype(np.int16), RANDOM.random((290, 31)) > 0.5
    assert variance_of(in_file(pixels), None) == pytest.approx(pixels.reshape(-1, 4).var(0).sum(), rel=1e-14)
    assert variance_of(pixels, usable) == pytest.approx(pixels[usable].var(0).sum(), rel=1e-14)


def test_whole_patches_of_a_mask():
    g = Geometry(9, 9, True, True, exemplar_width=41, exemplar_height=280, patch=7)
    mask = RANDOM.random((280, 41)) > 0.01
    patches = np.lib.stride_tricks.sliding_window_view(mask, (7, 7)).all((2, 3))
    np.testing.assert_array_equal(allowed_patches(mask, g), patches)
