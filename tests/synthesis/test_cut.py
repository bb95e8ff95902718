# SPDX-License-Identifier: Apache-2.0
"""Graph-cut textures: seams against every labeling there is, search against the plain sum, the whole on pictures."""

from __future__ import annotations

import itertools
import tracemalloc
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import OpenImageIO as oiio
import pytest
from scipy.ndimage import distance_transform_edt, gaussian_filter

from oiiotex import filters
from oiiotex.engine import errors
from oiiotex.engine.color.lab_grid import FINE_STEPS, to_grid
from oiiotex.engine.core.scratch import RowStore
from oiiotex.engine.core.source_map import SourceMap
from oiiotex.engine.session import Session
from oiiotex.synthesis.graphcut import photo as photo_in_tiles
from oiiotex.synthesis.graphcut import placement as gc
from oiiotex.synthesis.graphcut import seams
from oiiotex.synthesis.graphcut import search as searching
from oiiotex.synthesis.graphcut.photo import Photo
from tests import pictures
from tests.any_filter import buffer, pixels
from tests.conftest import load, oiiotex, save
from tests.refusals import refused

PHOTO = pictures.pebbles(96, 112, seed=4)


def random_source(height: int = 20, width: int = 24, seed: int = 0) -> seams.SeamPhoto:
    return seams.SeamPhoto(np.random.default_rng(seed).integers(-300, 900, (height, width, 3)).astype(np.int16))


def plain_cost(lab: np.ndarray, a: tuple, b: tuple, step: tuple) -> int:
    """M(s, t, A, B) of KSE03 eq. 2 for patches that put a at s and b at t, without the code under test."""

    def at(p, dy=0, dx=0):
        y, x = min(max(p[0] + dy, 0), len(lab) - 1), min(max(p[1] + dx, 0), lab.shape[1] - 1)
        return lab[y, x].astype(float)

    if (a[0] + step[0], a[1] + step[1]) == tuple(b):
        return 0
    a_s, a_t, b_s, b_t = at(a), at(a, *step), at(b, -step[0], -step[1]), at(b)
    norm = np.linalg.norm
    gradient = norm(a_s - a_t) + norm(a_s - a_t) + norm(b_s - b_t) + norm(b_s - b_t)
    return max(1, min(seams.MOST_COST, round(64 * (norm(a_s - b_s) + norm(a_t - b_t)) / (gradient + 8))))


def test_costs_are_equation_2():
    source, random = random_source(), np.random.default_rng(1)
    a, b = (np.stack([random.integers(-2, 22, 200), random.integers(-2, 26, 200)]) for _ in range(2))
    for step in seams.NEIGHBORS:
        b[:, :20] = a[:, :20] + np.array(step)[:, None]  # the same patch
        found = source.costs(a, b, step)
        expected = [plain_cost(source.lab, a[:, n], b[:, n], tuple(step)) for n in range(200)]
        np.testing.assert_array_equal(found, expected)
        assert (found[:20] == 0).all()


def with_seam_nodes(lab, places, filled, patch, covers, taken) -> float:
    """What a labeling costs in the graph of KSE03 figure 5, seam nodes where old seams are."""
    total = 0
    height, width = filled.shape
    there = filled | taken
    for y, x, (dy, dx) in itertools.product(range(height), range(width), ((0, 1), (1, 0))):
        v, u = y + dy, x + dx
        if v >= height or u >= width or not (there[y, x] and there[v, u]):
            continue
        old = [tuple(int(n) for n in places[:, r, c]) for r, c in ((y, x), (v, u))]
        new = [tuple(int(n) for n in patch[:, r, c]) for r, c in ((y, x), (v, u))]
        s_new, t_new = taken[y, x], taken[v, u]
        both_old = plain_cost(lab, old[0], old[1], (dy, dx))
        if_t, if_s = plain_cost(lab, old[0], new[1], (dy, dx)), plain_cost(lab, new[0], old[1], (dy, dx))
        if not s_new and not t_new and covers[y, x] and covers[v, u]:
            # the seam node goes with the old: arc to the new patch; or with the new: both arcs to its pixels
            total += min(both_old, if_t + if_s)
        else:
            total += ((both_old, if_t), (if_s, 0))[int(s_new)][int(t_new)]
    return total


@pytest.mark.parametrize("seed", range(12))
def test_the_cut_is_the_cheapest_of_all(seed):
    source, random = random_source(seed=seed), np.random.default_rng(seed)
    shape = (3, 4)
    offset_a, offset_b = random.integers(0, 16, 2), random.integers(0, 16, 2)
    index = np.indices(shape)
    places = index + offset_a[:, None, None]
    places[:, :, 2:] += 3  # an old seam
    patch = index + offset_b[:, None, None]
    filled = random.random(shape) < 0.8
    covers = random.random(shape) < 0.85
    costs = list(seams.crossing_costs(source, places, filled, patch, covers))
    taken = seams.cut(costs, filled, covers)
    free = np.argwhere(filled & covers)
    best, found = np.inf, []
    for choice in itertools.product((False, True), repeat=len(free)):
        tried = covers & ~filled
        tried[tuple(free.T)] = choice
        cost = with_seam_nodes(source.lab, places, filled, patch, covers, tried)
        found += [(cost, tried)]
        best = min(best, cost)
    assert with_seam_nodes(source.lab, places, filled, patch, covers, taken) == best
    assert seams.PatchCut.of(costs, filled, covers).estimate() == best
    # of several, the one with the most new pixels, so that libraries cannot differ
    assert taken.sum() == max(tried.sum() for cost, tried in found if cost == best)
    assert (taken[covers & ~filled]).all() and not taken[~covers].any()


def test_of_two_placements_the_one_whose_seams_cost_less_is_taken():
    lab = np.random.default_rng(2).random((90, 90, 3), np.float32) * 60
    lab[:, 45:] = lab[:, :45]
    photo = Photo.of(lab, None, 1 << 30)
    canvas = gc._Canvas(photo, layout(height=64, width=64, patch=40), 1 << 30, None)
    canvas.lay(0, 0, 40, 0, (0, 0))
    seen = canvas._seen(0, 20, 40)
    for offsets in ([(7, 31), (0, 20)], [(0, 20), (7, 31)]):  # the second continues the first patch
        patch, taken = canvas._joined(seen, offsets)
        assert tuple(patch[:, 1, 1]) == (0, 20) and taken[1:-1, 25:-1].all()


def test_seam_costs_are_those_of_the_edges():
    source = random_source()
    places = np.indices((6, 7))
    places[:, 3:, 2:] += 4
    right, below = seams.seam_costs(source, places, np.ones((6, 7), bool))
    assert right.shape == (6, 6) and below.shape == (5, 7)
    assert np.count_nonzero(right) == 3 and np.count_nonzero(below) == 5
    for y, x in np.argwhere(right):
        assert right[y, x] == plain_cost(source.lab, places[:, y, x], places[:, y, x + 1], (0, 1))


def test_the_search_is_the_plain_sum_of_squares():
    source, random = random_source(18, 23), np.random.default_rng(2)
    allowed = random.random((18, 23)) < 0.8
    found = searching.OffsetSearch(Photo(source.lab, allowed), 5)
    seen, new = random.random((5, 5)) < 0.6, random.random((5, 5)) < 0.5
    lab = random.integers(-70, 220, (5, 5, 3))
    cost, gain = found._sums(lab, seen, new)
    exemplar = source.lab.astype(int) // searching._UNIT
    assert cost.shape == gain.shape == (22, 27)
    apart, count = np.zeros(cost.shape), np.zeros(cost.shape)
    expected = np.zeros(cost.shape)
    for y, x in np.ndindex(cost.shape):
        for v, u in np.ndindex(5, 5):
            p, q = y - 4 + v, x - 4 + u
            if 0 <= p < 18 and 0 <= q < 23 and allowed[p, q]:
                expected[y, x] += new[v, u]
                apart[y, x] += seen[v, u] * ((exemplar[p, q] - lab[v, u]) ** 2).sum()
                count[y, x] += seen[v, u]
    np.testing.assert_array_equal(gain, expected)
    many = count > 0.5 * seen.sum()
    usual = np.rint(np.median(apart[many] / count[many]))
    np.testing.assert_allclose(cost, (apart + usual * (seen.sum() - count)) / seen.sum(), rtol=1e-12)


def layout(**more: object) -> gc.Layout:
    given = {"width": 90, "height": 70, "wrap_x": True, "wrap_y": True, "patch": 32, "passes": 0, "seed": 0}
    return gc.Layout(**{**given, **more})


@pytest.mark.parametrize("shape", [(90, 70), (31, 200), (20, 20), (5, 6)])
@pytest.mark.parametrize("wrap", [(True, True), (False, True), (False, False)])
def test_sites_cover_everything(shape, wrap):
    found = layout(width=shape[0], height=shape[1], wrap_x=wrap[0], wrap_y=wrap[1])
    covered = np.zeros((shape[1], shape[0]), bool)
    for y, x in found.sites():
        rows, columns = np.arange(y, y + 32), np.arange(x, x + 32)
        rows = rows % shape[1] if wrap[1] else rows[(rows >= 0) & (rows < shape[1])]
        columns = columns % shape[0] if wrap[0] else columns[(columns >= 0) & (columns < shape[0])]
        covered[np.ix_(rows, columns)] = True
    assert covered.all()


def total_cost(places: SourceMap, lab: np.ndarray, wrap: bool = True) -> int:
    source, at = seams.SeamPhoto(to_grid(lab, FINE_STEPS)), np.stack(places.yx)
    if wrap:
        at = np.pad(at, ((0, 0), (0, 1), (0, 1)), mode="wrap")
    return sum(int(c.sum()) for c in seams.seam_costs(source, at, np.ones(at.shape[1:], bool)))


@pytest.mark.slow
def test_refinement_never_makes_seams_worse_and_mostly_better():
    lab = (PHOTO * 90 - 10).astype(np.float32)
    gains = []
    for seed in range(3):
        costs = [
            total_cost(gc.graph_cut(lab, None, layout(passes=n, seed=seed), 1 << 30, lambda *_: None), lab)
            for n in range(4)
        ]
        assert costs == sorted(costs, reverse=True)
        gains.append(costs[0] - costs[-1])
    assert sum(gain > 0 for gain in gains) >= 2


def test_seams_cost_less_than_straight_ones():
    lab = (PHOTO * 90 - 10).astype(np.float32)
    cut = gc.graph_cut(lab, None, layout(), 1 << 30, lambda *_: None)
    y, x = np.indices((70, 90))
    corners = np.random.default_rng(0).integers(0, 60, (2, 4, 5))
    butted = SourceMap.of(corners[0][y // 21, x // 21] + y % 21, corners[1][y // 21, x // 21] + x % 21)
    assert total_cost(cut, lab) < 0.5 * total_cost(butted, lab)


def test_a_torus_has_no_border():
    """Rolled by half, what was the border is a seam like any other."""
    lab = (PHOTO * 90 - 10).astype(np.float32)
    source = seams.SeamPhoto(to_grid(lab, FINE_STEPS))

    def across(tiling: bool) -> float:
        places = gc.graph_cut(lab, None, layout(wrap_x=tiling, wrap_y=tiling, seed=3), 1 << 30, lambda *_: None)
        pair = np.stack(places[:, [-1, 0]].yx)
        return float(seams.seam_costs(source, pair, np.ones(pair.shape[1:], bool))[0].mean())

    assert across(True) < 0.5 * across(False)


@pytest.mark.parametrize(("size", "tile"), [((40, 36), "xy"), ((110, 84), "none"), ((84, 110), "x")])
def test_only_allowed_pixels_are_used_and_what_the_others_look_like_is_not_looked_at(size, tile):
    mask = (np.indices((96, 112)).sum(0) % 37 < 14)[..., None] * 1.0  # thin: no patch lies inside
    other = np.random.default_rng(0).random(PHOTO.shape)
    made = []
    for photo in (PHOTO, np.where(mask > 0, PHOTO, other)):
        photo = buffer(np.concatenate([photo, mask], -1), names=("R", "G", "B", "id"))
        made.append(pixels(filters.cut(photo, mask=buffer(mask), size=size, tiles=tile, passes=1, patch=24)))
    assert made[0].shape == (size[1], size[0], 4) and (made[0][..., 3] == 1).all()
    np.testing.assert_array_equal(made[0], made[1])


def test_one_label_of_a_photo(tmp_path):
    """End to end: labels found, one taken, source coordinates beside it; each pixel has that label."""
    left, right = pictures.bricks(96, 64, 1), pictures.moss(96, 64, 2)
    save(np.concatenate([left, right], 1), tmp_path / "photo.png")
    words = ("photo.png", "--iscolorspace", "sRGB", "--texlabel:photo=1", "-o", "labeled.exr")
    assert oiiotex(*words, cwd=tmp_path).returncode == 0
    done = oiiotex("labeled.exr", "--texcut:label=2:size=100x80:st=1:patch=32", "-o", "cut.exr", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    last = oiio.ImageBuf(str(tmp_path / "labeled.exr")).nsubimages - 1
    labels = load(tmp_path / "labeled.exr", last)[..., 0]
    st = load(tmp_path / "cut.exr", 1)
    at = (st * (128, 96)).astype(int)
    assert st.shape == (80, 100, 2) and (labels[at[..., 1], at[..., 0]] == 2).all()
    np.testing.assert_array_equal(load(tmp_path / "cut.exr"), load(tmp_path / "labeled.exr")[at[..., 1], at[..., 0]])


def test_exemplars_that_are_searched_reduced(tmp_path):
    wide = np.tile(PHOTO, (1, 6, 1))[:, :600]
    made = pixels(filters.cut(buffer(wide), size=(90, 80), patch=32, passes=1))
    assert searching.search_factor(wide.shape) == 4 and made.shape == (80, 90, 3)
    mask = np.zeros((96, 600, 1))
    mask[41, 301] = 1  # a single pixel, which the reduced exemplar misses
    made = pixels(filters.cut(buffer(wide), mask=buffer(mask), size=(20, 20), patch=8, passes=1))
    assert (made == wide[41, 301].astype(np.float32)).all()


def blobs(height: int, width: int, share: float, seed: int) -> np.ndarray:
    """A mask of that share of the pixels."""
    smooth = gaussian_filter(np.random.default_rng(seed).random((height, width)), 1.5)
    return smooth > np.quantile(smooth, 1 - share)


@pytest.mark.parametrize("wraps", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_memory_does_not_show(wraps, monkeypatch):
    """Photo and result in memory, and in files through a cache that holds no tile; with a mask and holes to close."""
    monkeypatch.setattr(photo_in_tiles, "SIDE", 32)  # tiles that the photo's size is no multiple of
    lab = (pictures.pebbles(150, 310, seed=5) * 90 - 10).astype(np.float32)  # it is searched reduced
    usable, small = blobs(150, 310, 0.3, 1), layout(width=50, height=41, patch=20, passes=1, wrap_x=wraps)
    rows = RowStore(lab.shape, np.float32)
    rows[:] = lab
    made = [
        gc.graph_cut(given, usable, small, budget, lambda *_: None) for given, budget in ((lab, 1 << 30), (rows, 64))
    ]
    assert isinstance(made[1].packed, RowStore) and usable[made[0].yx].all()
    np.testing.assert_array_equal(np.asarray(made[0].packed), np.asarray(made[1].packed))


def test_what_is_held_does_not_grow_with_photo_and_result(monkeypatch):
    """Beyond a quarter of the budget both lie in files."""
    monkeypatch.setattr(photo_in_tiles, "SIDE", 32)
    tile = (pictures.pebbles(96, 112, seed=4) * 90 - 10).astype(np.float32)

    class Repeated:
        def __init__(self, times: int):
            self.shape = (96 * times, 112, 3)

        def __getitem__(self, rows: slice) -> np.ndarray:
            return tile[np.arange(rows.start, rows.stop) % 96]

    def peak(times: int) -> int:
        """Of a canvas and some patches on it."""
        whole = layout(width=80, height=2000 * times, patch=48, wrap_x=False, wrap_y=False)
        tracemalloc.start()
        try:
            canvas = gc._Canvas(Photo.of(Repeated(4 * times), None, 64 << 10), whole, 64 << 10, None)
            for number in range(5):
                canvas.lay(number * 400 * times, 8, 48, number, (times * 60 * number, 40))
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    peak(2)  # what is loaded once is loaded
    low, high = peak(2), peak(8)
    assert high - low < 300 << 10, f"{low >> 10} and {high >> 10} kB"  # photo and result are 5564 kB more


def test_stand_ins_are_the_nearest_usable_pixels():
    """Next to usable pixels; farther away nothing is looked at."""
    for seed, share in enumerate((0.03, 0.2, 0.5, 0.8)):
        usable, lab = blobs(40, 47, share, seed), random_source(40, 47, seed).lab
        y, x = distance_transform_edt(~usable, return_distances=False, return_indices=True)
        near = distance_transform_edt(~usable) <= 1
        np.testing.assert_array_equal(photo_in_tiles._with_neighbors(lab, usable)[near], lab[y, x][near])


def test_energy_is_that_of_all_seams_whatever_the_pieces(monkeypatch):
    """Also where the last cell is a column wide, and nothing wraps."""
    lab = (PHOTO * 90 - 10).astype(np.float32)
    photo = Photo.of(lab, None, 1 << 30)
    for wrap in (False, True):
        whole = layout(width=49, height=40, patch=24, wrap_x=wrap, wrap_y=wrap)
        canvas = gc._Canvas(photo, whole, 1 << 30, None)
        for number, (y, x) in enumerate(whole.sites()):
            canvas.lay(y, x, 24, number)
        canvas.close_holes()
        energies = []
        for looked_at in (1, 1 << 20):
            monkeypatch.setattr(gc, "_LOOKED_AT", looked_at)
            energies.append(canvas._energy())
        np.testing.assert_array_equal(*energies)
        assert (
            energies[0].shape == (7, 9) and energies[0].sum() >= total_cost(SourceMap(canvas.laid.rows), lab, wrap) > 0
        )


def test_an_exemplar_smaller_than_a_patch_and_a_tile_smaller_than_one():
    small = buffer(PHOTO[:9, :7])
    assert pixels(filters.cut(small, size=(30, 20), patch=16)).shape == (20, 30, 3)
    assert pixels(filters.cut(buffer(PHOTO), size=(5, 6), patch=64)).shape == (6, 5, 3)


def test_what_is_wrong_is_said(tmp_path):
    save(PHOTO, tmp_path / "photo.png")
    with refused(errors.ImageError, task="cutting 16000x16000 from 112x96", budget=1 << 20):
        filters.cut(buffer(PHOTO), size=(16000, 16000), session=Session(budget=1 << 20))
    with pytest.raises(errors.ImageError, match="is free of transparent pixels"):
        filters.cut(buffer(np.zeros((20, 20, 4)), names=tuple("RGBA")))
    with pytest.raises(errors.ParameterError, match="patch=3"):
        filters.cut(buffer(PHOTO), patch=3)
    photo = tmp_path / "photo.png"
    done = oiiotex(photo, "--iscolorspace", "sRGB", f"--texcut:st={photo}", "-o", tmp_path / "a.exr")
    assert done.returncode == 1 and "would overwrite exemplar, an input image" in done.stderr


@pytest.mark.parametrize("wraps", [(False, False), (True, False)])
def test_waves_do_not_touch_and_are_what_one_after_the_other_makes(wraps):
    whole = gc.Layout(130, 110, *wraps, patch=24, passes=1, seed=4)
    squares = [(y, x, 24) for y, x in whole.sites()]
    waves = gc.waves(whole, squares)
    assert sorted(n for wave in waves for n in wave) == list(range(len(squares)))
    assert len(waves) < len(squares) / 2
    number = {n: k for k, wave in enumerate(waves) for n in wave}
    for n, (y, x, side) in enumerate(squares):
        for m, (other_y, other_x, _) in enumerate(squares[:n]):
            away = [abs(y - other_y), abs(x - other_x)]
            away = [
                min(d, size - d) if wrap else d for d, size, wrap in zip(away, (110, 130), wraps[::-1], strict=True)
            ]
            assert max(away) > side or number[m] < number[n]
    lab = (PHOTO * 90 - 10).astype(np.float32)
    with ThreadPoolExecutor(4) as threads:
        together = gc.graph_cut(lab, None, whole, 1 << 30, lambda *_: None, spread=threads.map)
    alone = _in_order(lab, whole)
    np.testing.assert_array_equal(together.packed, alone.packed)


def _in_order(lab: np.ndarray, layout: gc.Layout) -> SourceMap:
    """Patches one after the other."""
    canvas = gc._Canvas(Photo.of(lab, None, 1 << 30), layout, 1 << 30, None)
    sites = layout.sites()
    for number, (y, x) in enumerate(sites):
        canvas.lay(y, x, layout.patch, number)
    canvas.close_holes()
    for number, (y, x, side) in enumerate(canvas.worst(len(sites)), len(sites)):
        canvas.improve(y, x, side, number)
    return SourceMap(canvas.laid.rows)
