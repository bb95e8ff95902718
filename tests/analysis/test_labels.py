# SPDX-License-Identifier: Apache-2.0
"""Label maps: each stage against its equation, the whole on pictures whose labels are known, and on bad input."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio
import pytest
from scipy.ndimage import gaussian_filter

from benchmarks.labels.levels import Score, score
from oiiotex import filters
from oiiotex.analysis.labels import random_walk, scales
from oiiotex.analysis.labels.features import KINDS, features_of, moments
from oiiotex.analysis.labels.filter_bank import PLANES, blurred_layers, codebook, gabor_responses, nearest_centers
from oiiotex.analysis.labels.potts import settled
from oiiotex.analysis.labels.scales import LabelMaps, LabelSettings, label_maps
from oiiotex.engine import errors
from oiiotex.engine.color.lab import lens_of
from oiiotex.engine.core.image import from_buffer
from oiiotex.engine.core.op import Op
from oiiotex.engine.session import Session
from oiiotex.engine.session.progress import Progress
from tests import pictures
from tests.analysis.test_label_kernels import blobs
from tests.analysis.test_superpixels import resources_of
from tests.conftest import made_by
from tests.refusals import refused


def buffer(pixels: np.ndarray, names: tuple[str, ...] = ()) -> oiio.ImageBuf:
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], oiio.FLOAT)
    if names:
        spec.channelnames = names
    spec.attribute("oiio:ColorSpace", "srgb_rec709_scene")
    made = oiio.ImageBuf(spec)
    made.set_pixels(made.roi, np.ascontiguousarray(pixels, np.float32))
    return made


def maps_of(
    pixels: np.ndarray, features: str = "textons", names: tuple[str, ...] = (), **settings: object
) -> LabelMaps:
    image, resources = from_buffer(buffer(pixels, names)), Session().resources
    return label_maps(image, lens_of(image, resources), resources, Progress(), features, LabelSettings(**settings))


def pixel_labels(maps: LabelMaps, level: int) -> np.ndarray:
    ids = maps.superpixels.labels.read(maps.superpixels.window)[..., 0]
    return np.concatenate([[0], maps.levels[level].labels])[ids]


def best_score(op: Op) -> tuple[Score, list[float]]:
    """The score of `quarters(128)` on its best level, and the scales of all."""
    maps, truth = made_by(op)["cryptomatte"], quarters(128)[1] + 1
    scores = [score(truth, ids, ids) for ids in (one.part.pixels()[..., 0] for one in maps)]
    return max(scores, key=lambda one: one.covering), [one.scale for one in maps]


def require_a_tree(maps: LabelMaps) -> None:
    """What holds of every result: no label is empty, every label lies in its parents, factors are stochastic."""
    for n, level in enumerate(maps.levels):
        np.testing.assert_array_equal(np.unique(level.labels), np.arange(1, level.count + 1))
        np.testing.assert_allclose(level.F.sum(0), 1, atol=1e-6)
        np.testing.assert_allclose(level.G.sum(0), 1, atol=1e-6)
        assert level.F.min() >= 0 and level.G.min() >= 0
        assert level.F.shape == level.G.shape[::-1] == (len(level.features), level.count)
        if n + 1 < len(maps.levels):
            pairs = np.unique(np.stack([level.labels, maps.levels[n + 1].labels]), axis=1).T.tolist()
            assert {(own, above) for own, some in enumerate(level.parents, 1) for above in some} == set(
                map(tuple, pairs)
            )
            assert level.scale < maps.levels[n + 1].scale
        else:
            assert level.parents == ((),) * level.count


def quarters(side: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """A picture of four textures, and which is where."""
    y, x = np.mgrid[0:side, 0:side] // (side // 2)
    looks = [pictures.bricks, pictures.pebbles, pictures.moss, lambda h, w, s: pictures.bricks(h, w, s)[..., ::-1] ** 2]
    return np.stack([look(side, side, seed) for look in looks])[2 * y + x, *np.mgrid[0:side, 0:side]], 2 * y + x


# --- stages ---


def test_moments_are_those_of_the_pixels():
    random = np.random.default_rng(0)
    pixels, groups = random.normal(30, 20, (60, 3)) ** 2 / 40, random.integers(0, 4, 60)
    power_sums = np.stack([pixels**k for k in range(1, 6)], axis=-1)
    found = moments(power_sums, np.ones(60, np.int64), groups)
    for group in range(4):
        here = pixels[groups == group]
        away = here - here.mean(0)
        np.testing.assert_allclose(found[group, :3], here.mean(0))
        np.testing.assert_allclose(found[group, 3:6], here.std(0) / 2)
        third = (away**3).mean(0)
        np.testing.assert_allclose(found[group, 6:9], np.sign(third) * np.abs(third) ** (1 / 3) / 6, rtol=1e-5)


@pytest.mark.parametrize("angle", [0, 1, 2, 3])
def test_gabor_responses_answer_to_their_own_wave_and_direction(angle):
    y, x = np.mgrid[0:80, 0:90]
    turn = np.pi * angle / 4
    plane = np.cos(2 * np.pi * (x * np.cos(turn) + y * np.sin(turn)) / 8).astype(np.float32)
    found = np.array([r[20:60, 20:60].mean() for r in gabor_responses(plane, (4.0, 8.0, 16.0), 4)])
    assert found.argmax() == 4 + angle
    assert np.sort(found)[-2] < 0.5 * found.max()


@pytest.mark.parametrize("shape", [(2, 33, 47), (1, 3, 70), (3, 1, 1)])
def test_layers_are_blurred_by_a_gaussian_and_mirrored_at_borders(any_lanes, shape):
    layers = np.random.default_rng(1).normal(0, 30, shape).astype(np.float32)
    blurred = blurred_layers(layers, 2.8, 2.5, resources_of(any_lanes))
    for layer, found in zip(layers.astype(np.float64), blurred, strict=True):
        np.testing.assert_allclose(found, gaussian_filter(layer, 2.8, radius=7), atol=1e-4)


def test_textons_are_the_nearest_centers_and_ties_go_to_the_first(any_lanes):
    random = np.random.default_rng(2)
    planes = random.integers(-2047, 2048, (PLANES, 501), dtype=np.int16)
    centers = random.integers(-2047, 2048, (60, PLANES), dtype=np.int32)
    centers[40], planes[:, 7] = centers[3], centers[3]
    planes[:, 8], centers[59] = -2047, 2047  # as far apart as there is
    apart = ((planes.T[:, None].astype(np.int64) - centers) ** 2).sum(-1)
    textons = nearest_centers(planes, centers, resources_of(any_lanes))
    np.testing.assert_array_equal(textons, apart.argmin(1))
    assert textons[7] == 3


def test_the_codebook_is_k_means_of_whole_numbers_however_they_are_added():
    random = np.random.default_rng(3)
    blobs = random.integers(-1500, 1500, (5, 24))
    sample = (blobs[random.integers(0, 5, 4000)] + random.integers(-90, 91, (4000, 24))).astype(np.int16)
    centers = codebook(sample, 5)
    apart = np.sqrt(((centers[:, None] - blobs) ** 2).sum(-1))
    assert sorted(apart.argmin(1)) == [0, 1, 2, 3, 4] and apart.min(1).max() < 30
    tied = codebook(np.repeat(sample[:40] * 2, 100, axis=0), 20)  # few points, many of them halfway between centers
    order = random.permutation(24)  # numbers are added in another order
    np.testing.assert_array_equal(codebook(np.repeat(sample[:40, order] * 2, 100, axis=0), 20), tied[:, order])
    np.testing.assert_array_equal(codebook(sample[:3], 5), np.unique(sample[:3], axis=0))


@pytest.mark.parametrize("tries", [0, 3])
@pytest.mark.parametrize("counts", [(300, 200), (300, 200, 150, 100)])
def test_the_number_of_labels_is_found(counts, tries):
    points, truth = blobs(counts, apart=5.0)
    found = scales.labeled(points, LabelSettings(tries=tries), 0, Session().resources)
    pairs = np.unique(np.stack([truth, found.G.argmax(0)]), axis=1)
    assert pairs.shape[1] == len(counts)
    assert found.error < 0.05


def test_above_a_number_of_superpixels_a_sample_is_factored(monkeypatch):
    points, truth = blobs((300, 200, 100), apart=5.0)
    monkeypatch.setattr(scales, "MOST", 400)
    found = scales.labeled(points, LabelSettings(), 0, Session().resources)
    assert found.G.shape[1] == found.F.shape[0] == 600
    joint = np.histogram2d(truth, found.G.argmax(0), [3, found.G.shape[0]])[0]
    assert joint.max(0).sum() > 0.98 * 600


def test_equal_points_are_one_node_and_share_what_it_has():
    points = np.repeat([[0.0, 0], [50, 0], [50, 50]], [400, 300, 2], axis=0)
    found = scales.labeled(points, LabelSettings(), 0, Session().resources)
    labels = found.G.argmax(0)
    assert labels[0] != labels[500]
    assert len(set(labels[:400])) == len(set(labels[400:700])) == 1
    np.testing.assert_allclose(found.F.sum(0), 1)


def test_the_way_down_is_algorithm_2():
    random = np.random.default_rng(0)
    independent = [random.integers(1, 4, 60) for _ in range(3)]
    blank = np.zeros(1)
    levels = [scales.LabelLevel(n, blank, ids, 3, (), blank, blank, blank) for n, ids in enumerate(independent)]
    made = scales.top_down(levels, literal=True)
    for n in range(3):
        expected = len(np.unique(np.stack(independent[n:]), axis=1).T)
        assert made[n].count == expected == len(np.unique(made[n].labels))


def levels_of(*maps: np.ndarray) -> list[scales.LabelLevel]:
    """Levels with these labels, finest first, and full memberships."""
    blank = np.zeros(1)
    return [
        scales.LabelLevel(4.0 + n, np.arange(len(ids)), ids, ids.max(), (), blank, np.eye(ids.max())[ids - 1],
                          np.eye(ids.max())[:, ids - 1])
        for n, ids in enumerate(maps)
    ]  # fmt: skip


def test_a_pattern_that_runs_through_many_labels_is_one_label_with_many_parents():
    """Joints of 10 in each of six labels of 50, where the paper has twelve labels."""
    coarse = np.repeat(np.arange(1, 7), 50)
    fine = np.where(np.arange(300) % 5 == 0, 7, coarse)
    made, cut = (scales.top_down(levels_of(fine, coarse), literal)[0] for literal in (False, True))
    assert (made.count, cut.count) == (7, 12)
    joints = made.labels[0]
    assert len(set(made.labels[::5])) == 1 and set(made.parents[joints - 1]) == {1, 2, 3, 4, 5, 6}
    assert sorted(some for n, some in enumerate(made.parents, 1) if n != joints) == [(n,) for n in range(1, 7)]


def test_borders_that_do_not_quite_agree_leave_no_crumbs():
    """A sliver of a fine label in another coarse one joins what is there, and is no parent."""
    coarse = np.repeat([1, 2], 100)
    fine = np.repeat([1, 2, 3], [50, 52, 98])  # two of the second label lie in the other coarse one
    made, cut = (scales.top_down(levels_of(fine, coarse), literal)[0] for literal in (False, True))
    assert (cut.count, made.count) == (4, 3)
    assert len(set(made.labels[100:])) == 1 and sorted(made.parents) == [(1,), (1,), (2,)]


def test_labels_take_the_hue_of_their_main_parent():
    """The largest part of each label has its id, and so its color."""
    coarse = np.repeat([1, 2, 3], 60)
    fine = np.repeat([4, 3, 5, 1, 2], [45, 15, 60, 20, 40])
    made = scales.top_down(levels_of(fine, coarse))[0]
    assert [made.labels[at] for at in (0, 60, 150)] == [1, 2, 3]
    assert sorted(made.parents[3:]) == [(1,), (3,)] and made.parents[:3] == ((1,), (2,), (3,))
    assert made.G[made.labels - 1, np.arange(180)].all()  # memberships are numbered like labels


@pytest.mark.parametrize(
    ("counts", "expected"),
    [([4, 1, 2], [4, 2]), ([4, 2, 2, 1], [4, 2, 1]), ([3, 3, 3], [3]), ([2, 1, 1], [2, 1]), ([1, 1], [1]), ([1], [1])],
)
def test_only_the_coarsest_level_may_have_a_single_label_and_none_equals_the_next(counts, expected):
    made = scales.top_down(levels_of(*(np.arange(12) * c // 12 + 1 for c in counts)))
    assert [level.count for level in made] == expected
    assert made[0].scale == 4.0  # of equal levels the finest is kept
    for level, above in zip(made, (*made[1:], None), strict=True):
        own = np.unique(level.labels, return_index=True)[1]
        assert [some[0] if some else 0 for some in level.parents] == (
            above.labels[own].tolist() if above else [0] * len(own)
        )


def test_a_potts_step_settles_a_lone_superpixel_and_leaves_a_border():
    n = 40
    likely = np.where(np.arange(n)[:, None] < 20, [0.8, 0.2], [0.2, 0.8])
    likely[7] = [0.4, 0.6]
    edges = np.stack([np.arange(n - 1), np.arange(1, n)], axis=1)
    np.testing.assert_array_equal(settled(likely.T, edges, Session().resources), np.arange(n) >= 20)


def test_a_given_level_is_the_coarsest_and_everything_lies_in_it():
    picture, truth = quarters(128)
    image, resources = from_buffer(buffer(picture)), Session().resources
    given = image, lens_of(image, resources), resources, Progress()
    maps = label_maps(*given, coarsest=[lambda found, *_: (found.positions[:, 0] > 64).astype(np.int64)])
    require_a_tree(maps)
    assert maps.levels[-1].count == 2 and {n for some in maps.levels[-2].parents for n in some} == {1, 2}


def test_the_coarsest_level_has_as_many_labels_as_are_asked_for():
    picture, truth = quarters(128)
    made = filters.label(buffer(picture), maxlabels=3)
    last = sorted((p for p in made if p.startswith("label.")), key=lambda p: int(p[6:]))[-1]
    assert len(np.unique(made[last].get_pixels(oiio.UINT32))) == 3


def test_paper_is_lsa16_by_the_letter(monkeypatch):
    seen = []
    monkeypatch.setattr(scales, "Walk", lambda *a, **k: seen.append(k) or random_walk.Walk(*a, **k))
    op = filters.op_named("label")(source=from_buffer(buffer(quarters(128)[0])), paper=True)
    assert (op.persistence, op.coarsest) == (0.95, "none")
    kinds = []
    monkeypatch.setattr(scales, "features_of", lambda kind, *a: kinds.append(kind) or features_of(kind, *a))
    best = best_score(op)[0]
    assert kinds == ["moments"]
    assert best.covering > 0.9 and 4 <= best.count <= 6  # the four textures, and their number
    assert seen and all(k == {"persistence": 0.95, "slowest": 0.0} for k in seen)  # the same at every level, no floor
    with refused(
        errors.ParameterError,
        parameter="persistence",
        value=0.7,
        problem="conflicts with paper=1",
        expected="persistence=0.95",
    ):
        filters.op_named("label")(source=op.source, paper=True, persistence=0.7)


def test_the_authors_program_labels_at_two_scales_at_least():
    """Also where, as here, the text finds no second scale."""
    best, scales = best_score(filters.op_named("label")(source=from_buffer(buffer(quarters(128)[0])), paper="authors"))
    assert best.covering > 0.9 and len(scales) > 1
    assert scales[-1] > 0.27 * 128  # 30 % of the longer side, in steps of 3 px from the finest


# --- whole pictures ---


@pytest.mark.parametrize("features", KINDS)
def test_four_textures_are_told_apart(features):
    """Textons: in the mean of three pictures, as a codebook that another draw begins finds a label more or less."""
    agreed = []
    for seed in range(3 if features == "textons" else 1):
        picture, truth = quarters(256, seed)
        maps = maps_of(picture, features)
        require_a_tree(maps)
        best = 0.0
        for n, level in enumerate(maps.levels):
            edges = [np.arange(5) - 0.5, np.arange(level.count + 2) - 0.5]
            table = np.histogram2d(truth.ravel(), pixel_labels(maps, n).ravel(), edges)[0]
            overlap = table / (table.sum(1)[:, None] + table.sum(0) - table + 1e-9)
            best = max(best, overlap.max(1).mean())
        agreed.append(best)
    assert np.mean(agreed) > (0.85 if features == "textons" else 0.5), agreed


def test_the_same_picture_has_the_same_labels():
    picture, _ = quarters(128)
    once, again = maps_of(picture), maps_of(picture)
    for a, b in zip(once.levels, again.levels, strict=True):
        np.testing.assert_array_equal(a.labels, b.labels)


FLAT = np.full((64, 64, 3), 0.4)
TWO = np.where(np.arange(96)[:, None, None] < 48, [0.1, 0.2, 0.6], [0.8, 0.7, 0.1]) * np.ones((96, 96, 1))
NOISE = np.random.default_rng(0).random((80, 80, 3))
BAD = {
    "constant": FLAT,
    "black": FLAT * 0,
    "two colors": TWO,
    "noise": NOISE,
    "16x16": NOISE[:16, :16],
    "1xN": NOISE[:1],
    "Nx1": NOISE[:, :1],
    "one pixel": NOISE[:1, :1],
    "HDR": NOISE * 1e4 - 5,
}


@pytest.mark.parametrize(
    ("kind", "features"),  # all with one kind of features, the others with what is the least
    [(kind, features) for kind in BAD for features in KINDS
     if features == "moments" or kind in ("constant", "two colors", "1xN", "one pixel")],
)  # fmt: skip
def test_bad_input_has_defined_results(kind, features):
    maps = maps_of(BAD[kind], features)
    require_a_tree(maps)
    assert (pixel_labels(maps, 0) > 0).all()
    if kind in ("constant", "black", "one pixel"):
        assert [level.count for level in maps.levels] == [1] * len(maps.levels)
    if kind == "two colors" and features != "gabor":  # it sees no colors, only waves
        labels = pixel_labels(maps, len(maps.levels) - 1)
        assert labels[0, 0] != labels[-1, -1]
    if kind == "two colors" and features == "moments":
        assert not set(labels[:40].ravel()) & set(labels[56:].ravel())


def test_transparent_pixels_belong_to_no_label():
    alpha = np.ones((96, 96, 1))
    alpha[20:60, 30:70] = 0
    maps = maps_of(np.concatenate([pictures.bricks(96, 96, 0) * alpha, alpha], -1), names=tuple("RGBA"))
    require_a_tree(maps)
    for n in range(len(maps.levels)):
        np.testing.assert_array_equal(pixel_labels(maps, n) == 0, alpha[..., 0] == 0)


def test_nothing_but_alpha_0_is_a_clear_error():
    with pytest.raises(errors.ImageError, match="alpha is 0 everywhere"):
        maps_of(np.zeros((32, 32, 4)), names=tuple("RGBA"))
