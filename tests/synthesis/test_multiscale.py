# SPDX-License-Identifier: Apache-2.0
"""Multiscale synthesis: the kernels against the oracle, any window against the whole, what a zoom keeps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex.engine.core.window import Window
from oiiotex.engine.errors import MemoryBudgetError, ParameterError
from oiiotex.engine.opencl.device import Device
from oiiotex.engine.opencl.device_choice import choose
from oiiotex.synthesis.multiscale.candidate_sets import analyze
from oiiotex.synthesis.multiscale.contrast import kept_in, with_contrast
from oiiotex.synthesis.multiscale.graph import Graph
from oiiotex.synthesis.multiscale.synthesizer import (
    KEPT_IN_LOOPS,
    PlaneSettings,
    Synthesizer,
    default_jitter,
    plan,
    schedule,
)
from oiiotex.synthesis.multiscale.targets import stacks_of
from tests import pictures
from tests.conftest import data_folder
from tests.reference.multiscale import Oracle
from tests.refusals import refused
from tests.synthesis.test_candidates import exemplar_of, graph_of

BUDGET = 1 << 30
FAR = 1 << 40


def analyzed(device, graph, *pictures_of, periodic=False):
    stacks = stacks_of(graph, [exemplar_of(picture, periodic=periodic) for picture in pictures_of])
    return analyze(device, stacks, 16, True, BUDGET, lambda done, total: None, None)


@pytest.fixture(scope="module")
def loop(device):
    """A loop and a chain of two exemplars that do not agree in color, 16 px."""
    graph = graph_of("ab", ("a", "b", 1), ("b", "b", 1))
    return analyzed(device, graph, pictures.pebbles(16, 16, 2), pictures.noise(16, 16, 1)[..., None] * [0.5, 0.6, 0.4])


@pytest.fixture(scope="module")
def plain(device):
    return analyzed(device, Graph.single("a"), pictures.pebbles(32, 32, 1), periodic=True)


@pytest.fixture(scope="module")
def mirrored(device):
    return analyzed(device, Graph.single("a"), pictures.pebbles(32, 32, 1))


def settings(**more):
    return PlaneSettings(**{"seed": 3, "jitter": (0.0, 0.6, 0.6, 0.6, 0.3), "kept": 0.8, **more})


@pytest.fixture(scope="module")
def in_lanes():
    """Devices of 1, 16 and 32 lanes."""
    return [type("Lanes", (Device,), {"lanes": lanes})(choose()) for lanes in (1, 16, 32)]


@pytest.mark.parametrize("place", [(-3, 2), (FAR + 5, -FAR)], ids=["origin", "far"])
def test_a_window_is_the_oracles(loop, in_lanes, place):
    window = Window.sized(*place, 7, 6)
    texel, offset = Oracle(loop, settings()).window(6, *window)
    for device in in_lanes:
        made = Synthesizer(device, loop, settings(), BUDGET).window(6, window)
        np.testing.assert_array_equal(made.texel, texel)
        np.testing.assert_array_equal(made.offset[..., :3], offset)
    assert offset.any()  # it has come to the other exemplar, and taken colors along
    assert {loop.stacks.levels.stacks[n][0] for n in np.unique(texel >> 8)} == {1}


def test_a_plane_of_exemplars_that_do_not_tile_has_no_combs(device):
    """Children of a texel at the border do not alternate between opposite borders (stripes of 32 L)."""
    ramp = np.linspace(0.1, 0.9, 64)[None, :, None]
    shaded = [0.3 * pictures.pebbles(64, 64, n) + 0.7 * ramp for n in (1, 2, 3)]
    analysis = analyzed(device, graph_of("abc", ("a", "b", 1), ("b", "c", 1)), *shaded)
    plane = Synthesizer(device, analysis, settings(jitter=default_jitter(6), kept=1.0), BUDGET)
    texel, offset = plane.window(8, Window(0, 0, 256, 256))
    light = (analysis.stacks.planes.reshape(-1, 4)[texel][..., 0] + offset[..., 0]) / 8
    alternating = np.where(np.arange(256) % 2, 1, -1)
    stripes = [np.abs((seen * alternating).reshape(64, 4, 64, 4).mean((1, 3))).max() for seen in (light, light.T)]
    assert max(stripes) < 12


@pytest.mark.parametrize("level", [0, 1, 2, 3])
def test_coarse_levels_are_the_oracles(device, loop, level):
    window = Window(-2, -1, 5, 4)
    made = Synthesizer(device, loop, settings(), BUDGET).window(level, window)
    texel, offset = Oracle(loop, settings()).window(level, *window)
    np.testing.assert_array_equal(made.texel, texel)
    np.testing.assert_array_equal(made.offset[..., :3], offset)


@pytest.mark.parametrize(("passes", "level", "far"), [(1, 9, FAR), (2, 7, 0), (2, 60, (1 << 59) + 12345), (3, 60, FAR)])
def test_any_window_is_the_whole_cropped(device, loop, passes, level, far):
    """Promise 2, at the origin, far from it, and 60 levels down."""
    maker = Synthesizer(device, loop, settings(passes=passes), BUDGET)
    whole = Window.sized(far - 21, -far + 13, 70, 61)
    texel, offset = maker.window(level, whole)
    random = np.random.default_rng(level + passes)
    for _ in range(6):
        left, right = np.sort(random.choice(71, 2, replace=False)) + whole.left
        top, bottom = np.sort(random.choice(62, 2, replace=False)) + whole.top
        window = Window(int(left), int(top), int(right), int(bottom))
        found = maker.window(level, window)
        np.testing.assert_array_equal(found.texel, texel[window.inside(whole)])
        np.testing.assert_array_equal(found.offset, offset[window.inside(whole)])
    assert len(np.unique(texel)) > 100


@pytest.mark.parametrize("window", [Window(-3, 2, 2, 5), Window(4, 7, 6, 10)], ids=str)
def test_the_halo_is_what_the_oracle_asks_for(loop, window):
    """Neither less, which would show, nor more, which would cost: on every level, before every subpass."""
    oracle = Oracle(loop, settings())
    oracle.window(5, *window)
    for level, windows in plan(window, 5, 2):
        for sub, needed in enumerate(windows):
            asked = np.array([(x, y) for t, s, x, y in oracle.known if (t, s) == (level, sub)])
            assert needed == Window(*asked.min(0), *(asked.max(0) + 1))


def test_what_a_window_needs():
    """Halo of the finest level: 8 or 9 px along x, 10 or 11 along y; deep levels cost a constant window each."""
    for left in range(2):
        for size in (64, 65):
            entry = plan(Window.sized(left, left, size, size), 20, 2)
            first = entry[-1].windows[0]
            assert {left - first.left, first.right - left - size} <= {8, 9}
            assert {left - first.top, first.bottom - left - size} <= {10, 11}
            assert len(entry) == 21 and len(entry[-1].windows) == 9 and len(entry[1].windows) == 1
    deep = [e.windows[0] for e in plan(Window.sized(FAR, FAR, 64, 64), 40, 2)]
    assert max(w.width for w in deep[2:30]) <= 38 and max(w.height for w in deep[2:30]) <= 46
    assert all(a != b for a, b in zip(schedule(3), schedule(3)[1:], strict=False))


def test_a_torus_repeats(device, plain):
    around = settings(around=(64, 96), around_level=5)
    maker = Synthesizer(device, plain, around, BUDGET)
    one = maker.window(5, Window.sized(0, 0, 64, 96))
    for x, y in ((64, 0), (0, -96), (128, 96)):
        np.testing.assert_array_equal(maker.window(5, Window.sized(x, y, 64, 96)).texel, one.texel)
    free = Synthesizer(device, plain, settings(), BUDGET).window(5, Window.sized(64, 0, 64, 96))
    assert (free.texel != one.texel).mean() > 0.3


def test_without_jitter_the_root_itself_comes_out(device, plain):
    maker = Synthesizer(device, plain, settings(jitter=(0.0,)), BUDGET)
    found = maker.window(5, Window(0, 0, 32, 32)).texel
    finest = plain.stacks.levels.stacks.index((0, 5))
    np.testing.assert_array_equal(found, finest * 1024 + np.arange(1024).reshape(32, 32))


@pytest.fixture(scope="module")
def rooted(device):
    """A loop whose plane contains the root itself."""
    stacks = stacks_of(graph_of("a", ("a", "a", 1)), [exemplar_of(pictures.pebbles(32, 32, 1))], rooted=True)
    return analyze(device, stacks, 16, True, BUDGET, lambda done, total: None, None)


SLOW = pytest.param(6, (20, 20), marks=pytest.mark.slow)


@pytest.mark.parametrize("level, place", [(4, (-2, 13)), (5, (-3, 28)), (6, (60, -2)), SLOW])
def test_a_window_around_the_root_is_the_oracles(rooted, in_lanes, level, place):
    whole = settings(jitter=(0.0, 0.6), root_level=5)
    window = Window.sized(*place, 6, 6)
    texel, offset = Oracle(rooted, whole).window(level, *window)
    for device in in_lanes:
        made = Synthesizer(device, rooted, whole, BUDGET).window(level, window)
        np.testing.assert_array_equal(made.texel, texel)
        np.testing.assert_array_equal(made.offset[..., :3], offset)


def test_the_root_itself_is_in_its_plane(device, rooted):
    """To the pixel at its resolution; from the next level on, it is refined by other texels."""
    maker = Synthesizer(device, rooted, settings(jitter=(0.0, 0.6), root_level=5), BUDGET)
    wide = maker.window(5, Window(-8, -8, 40, 40))
    np.testing.assert_array_equal(wide.texel[8:40, 8:40] & 1023, np.arange(1024).reshape(32, 32))
    levels = rooted.stacks.levels.stacks
    assert {levels[n] for n in np.unique(wide.texel >> 10)} == {(0, 5)}  # around it are pixels of the root, too
    assert not wide.offset.any() and len(np.unique(wide.texel[:8])) > 100
    assert all(levels[n][1] < 5 for n in np.unique(maker.window(6, Window(0, 0, 64, 64)).texel >> 10))


def test_jitter_by_level():
    assert default_jitter(7) == (0.0, 1.0, 1.0, 1.0, 0.6, 0.6, 0.0)
    assert default_jitter(4) == (0.0, 1.0, 1.0, 0.0) and not any(default_jitter(2))
    assert default_jitter(6, everywhere=True) == (0.0, 0.6)  # the last holds for all further ones
    assert settings().rho(9) == round(256 * 0.3)


def test_seeds_differ(device, plain):
    a, b = (Synthesizer(device, plain, settings(seed=s), BUDGET).window(5, Window(0, 0, 40, 40)) for s in (1, 2))
    assert (a.texel != b.texel).mean() > 0.3


def test_what_does_not_fit_is_refused_with_a_figure(device, plain):
    with refused(MemoryBudgetError, task="analyzing exemplars", budget=1024):
        Synthesizer(device, plain, settings(), 1 << 10)
    with refused(MemoryBudgetError, task="a window of 4096x4096 pixels", budget=4 << 20):
        Synthesizer(device, plain, settings(), 4 << 20).window(5, Window(0, 0, 4096, 4096))
    with pytest.raises(ParameterError, match="lod=61"):
        Synthesizer(device, plain, settings(), BUDGET).window(61, Window(0, 0, 4, 4))


@pytest.mark.parametrize(
    "name, r", [("gravel", 1), *(pytest.param(*one, marks=pytest.mark.slow) for one in
                [("bark_flaky", 2), ("grass", 2), ("gravel", 3), ("flower_meadow_stones", 1),
                 ("castle_brick_broken", 3)])],
)  # fmt: skip
def test_a_zoom_without_end_keeps_its_contrast(device, name, r):
    """One exemplar that is alike 2^r times of itself: octaves down it is neither flat nor out of its gamut."""
    if name in ("gravel", "grass"):
        photo = getattr(pytest.importorskip("skimage.data"), name)()[:128, :128, None] / 255.0 * np.ones(3)
    else:
        whole = oiio.ImageBuf(str(data_folder() / "photos" / f"{name}.jpg")).get_pixels(oiio.FLOAT)
        top, left = (n // 2 - 64 for n in whole.shape[:2])
        photo = whole[top : top + 128, left : left + 128, :3].mean(-1, keepdims=True) * np.ones(3)
    made = analyzed(device, graph_of("a", ("a", "a", r)), photo)
    plain = made.stacks
    maker = Synthesizer(device, made, PlaneSettings(seed=1, jitter=default_jitter(7, True), kept=KEPT_IN_LOOPS), BUDGET)
    exemplar = 800 * (photo[..., 0] - photo[..., 0].mean())  # on the grid of the planes
    for level in (12, 40):
        found = []
        for x, y in ((0, 0), (5000, 7000), (-3000, 99), (777, -1 << 20)):
            state = maker.window(level, Window.sized(x, y, 128, 128))
            color = plain.planes.reshape(-1, 4)[state.texel, 0].astype(np.float64) + state.offset[..., 0]
            assert exemplar.min() < color.mean() < exemplar.max()
            found.append(color.std())
            assert len(np.unique(state.texel)) > 1000  # no texel is everywhere
        assert np.mean(found) == pytest.approx(exemplar.std(), rel=0.25)


def test_a_zoom_into_coarse_structures_keeps_more_of_them(device, tmp_path):
    """Transfer functions fade less where an exemplar has its contrast in coarse octaves; fine ones need nothing."""
    fine = pictures.moss(128, 128, 1).mean(-1, keepdims=True) * np.ones(3)
    coarse = pictures.bricks(128, 128, 1).mean(-1, keepdims=True) * np.ones(3)
    light = {}
    for name, photo in (("fine", fine), ("coarse", coarse)):
        made = analyzed(device, graph_of("a", ("a", "a", 1)), photo)
        how = PlaneSettings(seed=1, jitter=default_jitter(7, True), kept=KEPT_IN_LOOPS)
        plain = Synthesizer(device, made, how, BUDGET)
        held = with_contrast(plain, made, tmp_path, name)
        light[name] = held._settings.kept
        assert len(list(tmp_path.iterdir())) == len(light)
        assert with_contrast(plain, made, tmp_path, name)._settings == held._settings  # read, not tried again
        assert replace(held._settings, kept=how.kept) == how  # nothing else has changed
        own = 800 * (photo[..., 0] - photo[..., 0].mean())
        spread = {}
        for maker in (plain, held):
            state = maker.window(19, Window.sized(900, 70, 160, 160))
            seen = made.stacks.planes.reshape(-1, 4)[state.texel, 0].astype(float) + state.offset[..., 0]
            spread[maker is held] = seen.std() / own.std()
        if name == "coarse":
            assert spread[True] > 1.05 * spread[False] and 0.75 < spread[True] < 1.25, spread
    assert light["fine"] == KEPT_IN_LOOPS < light["coarse"], light


def test_a_zoom_through_several_exemplars_fades_as_ever(device):
    edges = ("a", "b", 1), ("b", "a", 1)
    made = analyzed(device, graph_of("ab", *edges), *(np.random.default_rng(n).random((64, 64, 3)) for n in range(2)))
    maker = Synthesizer(device, made, PlaneSettings(kept=KEPT_IN_LOOPS), BUDGET)
    assert kept_in(maker, made) == KEPT_IN_LOOPS


def test_windows_may_be_asked_for_before_others_have_come(device, loop):
    maker = Synthesizer(device, loop, settings(), BUDGET)
    places = [Window.sized(40 * n, -7, 41 - n, 30) for n in range(4)]
    begun = [maker.begin(7, place) for place in places]
    for place, made in zip(places, begun, strict=True):
        alone, found = Synthesizer(device, loop, settings(), BUDGET).window(7, place), made()
        np.testing.assert_array_equal(found.texel, alone.texel)
        np.testing.assert_array_equal(found.offset, alone.offset)
