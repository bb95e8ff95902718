# SPDX-License-Identifier: Apache-2.0
"""--texzoom: frames follow from their numbers, are windows of the texture on whole octaves; nothing pops between."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from oiiotex.engine import errors
from oiiotex.synthesis.multiscale.zoom import filtered, taps, views
from tests import pictures
from tests.any_filter import buffer
from tests.conftest import load, run_in, save

SRGB = "srgb_rec709_scene"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("zoom")
    save(pictures.pebbles(64, 64, 1), made / "photo.png", space=SRGB)
    nodes = '[{"id": "photo", "file": "photo.png"}]'
    (made / "loop.json").write_text(f'{{"exemplars": {nodes}, "edges": [{{"from": "photo", "to": "photo", "r": 1}}]}}')
    (made / "plain.json").write_text(f'{{"exemplars": {nodes}}}')
    return made


def photo(folder):
    return oiio.ImageBuf(str(folder / "photo.png"))


def zoomed(folder, **values):
    return filters.zoom(photo(folder), **{"size": (80, 60), **values}).get_pixels(oiio.FLOAT)


# --- resampling ---


def test_taps_are_lanczos_as_wide_as_the_reduction():
    """Against the definition, pixel by pixel."""

    def lanczos(x):
        return 1.0 if x == 0 else 3 * np.sin(np.pi * x) * np.sin(np.pi * x / 3) / (np.pi * x) ** 2 if abs(x) < 3 else 0

    signal = np.random.default_rng(0).random((40, 1, 1)).astype(np.float32)
    for step, corner in ((1.7, Fraction(19, 3)), (0.6, Fraction(29, 4)), (1.0, Fraction(9))):
        found = taps(3, 9, corner, step)
        begin, end = (n + int(corner) for n in found.span)
        flat = taps(0, 1, Fraction(0), 1.0)
        made = filtered(np.repeat(signal[begin:end], flat.span[1] - flat.span[0], 1), found, flat)[:, 0, 0]
        wide = max(1.0, step)
        for n, value in zip(range(3, 9), made, strict=True):
            at = float(corner) + (n + 0.5) * step
            weights = np.array([lanczos((j + 0.5 - at) / wide) for j in range(40)])
            assert value == pytest.approx(weights @ signal[:, 0, 0] / weights.sum(), abs=1e-6)


def test_views_are_exact_at_any_depth():
    at = Fraction(101, 640), Fraction(1, 3)
    (deep,) = views(59.0, at, 1920, 1080)
    assert (deep.level, deep.share, deep.step) == (59, 1.0, 1.0)
    assert deep.left == at[0] * 2**59 - 960 and deep.top == at[1] * 2**59 - 540
    coarse, fine = views(7.3, at, 100, 100)
    assert 0.5 < fine.share < 1
    assert (coarse.level, fine.level) == (7, 8) and coarse.share + fine.share == 1
    assert (coarse.step, fine.step) == pytest.approx((2**-0.3, 2**0.7))
    assert views(0.1 * 3 + 0.2 * 3, at, 9, 9) == views(0.9, at, 9, 9)  # which are not the same floats


# --- frames ---


def test_whole_octaves_are_windows_of_the_texture(folder):
    for frame, level in ((1, 6), (3, 7)):
        run_in(
            folder, "--frames", frame, "--texzoom:graph=loop.json:speed=0.5:center=20,30:size=80x60", "-o", "z.#.exr"
        )
        x, y = 20 * 2 ** (level - 6) - 40, 30 * 2 ** (level - 6) - 30
        run_in(folder, f"--texsynth:graph=loop.json:lod={level}:window=80x60{x:+d}{y:+d}", "-o", "w.exr")
        np.testing.assert_array_equal(load(folder / f"z.{frame:04d}.exr"), load(folder / "w.exr"))


@pytest.mark.parametrize("kind", ["pebbles", "moss", "bricks"])
def test_the_first_frame_is_the_photo(kind):
    """Every pixel of the default; the photo's middle, if it is no square of a power of two."""
    image = getattr(pictures, kind)(75, 70, 1)
    pixels = buffer(image).get_pixels(oiio.FLOAT)
    first = filters.zoom(buffer(image)).get_pixels(oiio.FLOAT)
    np.testing.assert_array_equal(first, pixels[5:69, 3:67])
    around = filters.zoom(buffer(image), size=(96, 80)).get_pixels(oiio.FLOAT)
    np.testing.assert_array_equal(around[8:72, 16:80], first)
    second = filters.zoom(buffer(image), frame=2).get_pixels(oiio.FLOAT)
    assert 0 < np.abs(second - first).mean() < 0.6 * first.std()


def test_a_frame_depends_on_its_number_alone(folder):
    words = "--texzoom:speed=0.3:size=50x40"
    run_in(folder, "photo.png", "--frames", "1-5", words, "-o", "a.#.png")
    run_in(folder, "photo.png", "--frames", "5,2", words, "-o", "b.#.png")
    for n in (2, 5):
        np.testing.assert_array_equal(load(folder / f"a.{n:04d}.png"), load(folder / f"b.{n:04d}.png"))
    said = filters.zoom(photo(folder), frame=5, speed=0.3, size=(50, 40)).get_pixels(oiio.UINT8)
    np.testing.assert_array_equal(load(folder / "a.0005.png"), said)
    run_in(folder, "photo.png", "--frames", "1-5", f"{words}:frame=2", "-o", "c.#.png")  # what is said counts
    np.testing.assert_array_equal(load(folder / "c.0005.png"), load(folder / "a.0002.png"))


def test_any_window_of_a_frame_is_the_whole_cropped(folder):
    whole = zoomed(folder, frame=4, speed=0.21, center=(11.3, 40.7))
    roi = oiio.ROI(13, 50, 21, 44, 0, 1, 0, 3)
    part = filters.zoom(photo(folder), size=(80, 60), frame=4, speed=0.21, center=(11.3, 40.7), roi=roi)
    np.testing.assert_array_equal(part.get_pixels(oiio.FLOAT), whole[21:44, 13:50])


def test_nothing_pops_where_the_octave_changes(folder):
    """Frames a thousandth of an octave apart differ as little across a whole octave as elsewhere."""

    def apart(octaves):
        a, b = (zoomed(folder, lod=octaves + d, speed=0.0) for d in (0.0, 0.001))
        return float(np.sqrt(np.square(a - b).mean()))

    across = [apart(8.0), apart(7.999), apart(9.0)]
    between = apart(8.5)
    usual = float(zoomed(folder, lod=8.0).std())
    assert max(across) < 0.02 * usual and max(across) < 3 * between, (across, between, usual)


def test_what_is_zoomed_into_stays_where_it_is(folder):
    """A frame an octave on, halved, is the middle of the frame before."""
    for level in (6.0, 8.4):
        near, far = (zoomed(folder, lod=level + n, center=(30, 25), size=(128, 128)) for n in (1, 0))
        halved = near.reshape(64, 2, 64, 2, 3).mean((1, 3))
        middle, elsewhere = far[32:96, 32:96], far[:64, :64]
        assert np.corrcoef(halved.ravel(), middle.ravel())[0, 1] > 0.7
        assert abs(np.corrcoef(halved.ravel(), elsewhere.ravel())[0, 1]) < 0.4


def test_the_deepest_frames(folder):
    deep = filters.zoom(photo(folder), lod=60, size=(40, 30), center=(50.123, 9))
    assert len(np.unique(deep.get_pixels(oiio.UINT8).reshape(-1, 3), axis=0)) > 20
    between = filters.zoom(photo(folder), lod=59.5, size=(40, 30), center=(50.123, 9))
    assert between.get_pixels(oiio.FLOAT).std() > 0.02


def test_a_graph_that_ends_is_said(folder):
    done = run_in(folder, "--frames", "1-2", "--texzoom:graph=plain.json:speed=1:size=20x20", "-o", "p.#.png")
    assert done.stderr.count("the finest exemplar ends at 6: its pixels repeat") == 1 and "frame 2" in done.stderr


WRONG = [
    ({"frame": 2000, "speed": 0.5}, r"frame 2000 is at 1005.5 octaves: expected 0 to 60; the zoom begins at 6 with"),
    ({"frame": -20, "speed": 0.5}, r"frame -20 is at -4.5 octaves"),
    ({"center": (1.0,)}, "center=.1[.]0,.: expected two numbers, X,Y"),
    ({"center": (5000, 5000), "lod": 60}, r"center=.*: more than 2\^60 px away from 0,0 at 60 octaves"),
    ({"size": (0, 4)}, "size=.* expected .width, height. from 1"),
    ({"speed": 9.0}, "speed=9.0: expected a number from -8 to 8"),
]


@pytest.mark.parametrize("values, message", WRONG, ids=[m[:25] for _, m in WRONG])
def test_what_is_wrong_is_said(folder, values, message):
    with pytest.raises(errors.ParameterError, match=message):
        filters.zoom(photo(folder), **values)
