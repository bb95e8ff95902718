# SPDX-License-Identifier: Apache-2.0
"""--texsynth through the installed program and as a function: sizes, windows, levels, graphs, maps, faults."""

from __future__ import annotations

import dataclasses
import json
import re
import subprocess
import sys

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from oiiotex.engine import errors
from oiiotex.engine.color.lab import lens_of
from oiiotex.engine.core import demand
from oiiotex.engine.core.image import Image, from_buffer
from oiiotex.engine.core.op import Space
from oiiotex.engine.core.window import Window
from oiiotex.engine.session import Session
from oiiotex.oiiotool.cli.running.line_run import run
from oiiotex.synthesis.multiscale import stacks
from tests import pictures
from tests.any_filter import buffer
from tests.conftest import data_folder, load, run_in, save
from tests.engine.test_sizes import peak_of
from tests.refusals import refused

SRGB = "srgb_rec709_scene"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A photo, and a graph of two exemplars that do not agree: striped in colors, and gray pebbles (figure 5)."""
    made = tmp_path_factory.mktemp("synth")
    save(pictures.pebbles(70, 90, 1), made / "photo.png", space=SRGB)
    stripes = 0.5 + 0.45 * np.sin(np.arange(64)[:, None, None] / 64 * 2 * np.pi + np.array([0.0, 2.1, 4.2]))
    save(np.broadcast_to(stripes, (64, 64, 3)), made / "stripes.png", space=SRGB)
    gray = pictures.pebbles(64, 64, 2).mean(-1, keepdims=True)
    save(np.broadcast_to(gray, (64, 64, 3)), made / "gray.png", space=SRGB)
    # as a torus: mirrored, 64 px of pebbles are .01 to .03 farther from their stripes (four pictures)
    nodes = [{"id": n, "file": f"{n}.png", "wrap": "periodic"} for n in ("stripes", "gray")]
    drawn = {"exemplars": nodes, "edges": [{"from": "stripes", "to": "gray", "r": 3}]}
    (made / "map.json").write_text(json.dumps(drawn))
    nodes = [{"id": "photo", "file": "photo.png"}]
    (made / "loop.json").write_text(
        json.dumps({"nodes": nodes, "edges": [{"from": "photo", "to": "photo", "r": 1}], "root": "photo"})
    )
    return made


def refusal(folder, *words):
    with pytest.raises(errors.Error) as caught:
        run([*map(str, words), "-o", "never.exr"], folder)
    assert "\n" not in str(caught.value) and not (folder / "never.exr").exists()
    return str(caught.value)


def test_a_texture_of_any_size_grows_from_a_photo(folder):
    run_in(folder, "photo.png", "--texsynth:size=200x150:flattening=0", "-o", "big.png")
    big, photo = load(folder / "big.png"), load(folder / "photo.png")
    assert big.shape == (150, 200, 3)
    # copies of pixels of the 64 x 64 in the middle, without long runs of the photo itself
    square = photo[3:67, 13:77]
    assert {p.tobytes() for p in big.reshape(-1, 3)} <= {p.tobytes() for p in square.reshape(-1, 3)}
    assert abs(big.std() / square.std() - 1) < 0.15
    assert (big[:, 64:128] != big[:, :64]).any(-1).mean() > 0.5


@pytest.mark.slow
def test_what_a_pixel_is_does_not_hang_on_the_window_it_is_asked_with(folder):
    """Promise 2 through the program: windows of a larger size, and of none."""
    run_in(folder, "photo.png", "--texsynth:size=300x280", "-o", "whole.exr")
    whole = load(folder / "whole.exr")
    for n, window in enumerate(("100x80+20+30", "37x1+0+279", "1x1+150+150")):
        width, height, x, y = map(int, re.findall(r"\d+", window))
        run_in(folder, "photo.png", f"--texsynth:size=300x280:window={window}", "-o", f"w{n}.exr")
        spec = oiio.ImageBuf(str(folder / f"w{n}.exr")).spec()
        assert (spec.x, spec.y, spec.full_width, spec.full_height) == (x, y, 300, 280)
        np.testing.assert_array_equal(load(folder / f"w{n}.exr"), whole[y : y + height, x : x + width])
    run_in(folder, "photo.png", "--texsynth:window=60x50-30-20", "-o", "free.exr")
    np.testing.assert_array_equal(load(folder / "free.exr")[20:, 30:], whole[:30, :30])


def test_windows_are_pasted_into_the_whole(folder):
    """The line of the docs, with windows in any order."""
    run_in(folder, "photo.png", "--texsynth:size=70x48", "-o", "one.exr")
    for n in range(3):
        run_in(folder, "photo.png", f"--texsynth:size=70x48:window=70x16+0+{16 * n}", "-o", f"{n}.exr")
    run_in(folder, "2.exr", "0.exr", "1.exr", "--paste:mergeroi=1:all=1", "+0+0", "-o", "pasted.exr")
    np.testing.assert_array_equal(load(folder / "pasted.exr"), load(folder / "one.exr"))


def test_windows_far_away_and_far_down(folder):
    far = 1 << 40
    run_in(folder, f"--texsynth:graph=loop.json:lod=60:window=40x30+{far}-{far}", "-o", "a.exr")
    run_in(folder, f"--texsynth:graph=loop.json:lod=60:window=20x20+{far + 10}-{far - 5}", "-o", "b.exr")
    a, b = load(folder / "a.exr"), load(folder / "b.exr")
    np.testing.assert_array_equal(a[5:25, 10:30], b)
    spec = oiio.ImageBuf(str(folder / "b.exr")).spec()
    assert (spec.x, spec.y) == (0, 0)  # 2^40 is no pixel coordinate of a file
    assert spec.get_string_attribute("oiiotex:window") == f"20x20+{far + 10}-{far - 5}"
    assert spec.get_int_attribute("oiiotex:level") == 60
    assert len(np.unique(b.reshape(-1, 3), axis=0)) > 20


@pytest.mark.slow
def test_a_toroidal_texture_tiles(folder):
    random, place = np.random.default_rng(0), np.arange(64) / 64 * 2 * np.pi
    waves = [np.cos(k * place[:, None] + n * place + random.random() * 7) for k in range(-6, 7) for n in range(1, 7)]
    save(0.5 + 0.05 * np.sum(waves, 0)[..., None] * [1, 1, 1], folder / "waves.png", space=SRGB)  # tiles itself
    at_border = {}
    for tile in ("xy", "none"):
        run_in(folder, "waves.png", f"--texsynth:size=128x64:tiles={tile}", "-o", "tile.exr")
        made = load(folder / "tile.exr").astype(np.float64).mean(-1)
        steps = [np.abs(made - np.roll(made, 1, axis)) for axis in (0, 1)]
        at_border[tile] = [np.take(s, 0, axis).mean() / s.mean() for axis, s in enumerate(steps)]
    assert max(at_border["xy"]) < 1.5  # no steeper than the rest
    assert min(at_border["none"]) > 1.5


def low_passed(pixels, k):
    h, w = pixels.shape[0] // k * k, pixels.shape[1] // k * k
    return pixels[:h, :w].astype(np.float64).reshape(h // k, k, w // k, k, -1).mean((1, 3))


def test_colors_of_a_coarse_exemplar_are_kept_by_a_gray_one(folder):
    """HRRG08 figure 5, also by the letter: with the correction the stripes' colors hold, without it they are lost."""
    stripes = load(folder / "stripes.png")[..., :3] / 255
    away = {}
    for way in ("matchcolor=1", "paper=1", "matchcolor=0"):
        run_in(folder, f"--texsynth:graph=map.json:keeplayout=1:size=512x512:{way}", "-d", "float", "-o", "c.exr")
        away[way] = np.sqrt(np.square(low_passed(load(folder / "c.exr"), 8) - stripes).mean())
    assert away["matchcolor=1"] < 0.5 * away["matchcolor=0"], away
    assert away["paper=1"] < 0.65 * away["matchcolor=0"], away  # its six dimensions hold less of the colors


def test_lock_keeps_the_root_as_it_is(folder):
    run_in(folder, "photo.png", "--texsynth:size=64x64:keeplayout=1", "-o", "locked.png")
    np.testing.assert_array_equal(load(folder / "locked.png"), load(folder / "photo.png")[3:67, 13:77])
    run_in(folder, "photo.png", "--texsynth:size=64x64", "-o", "loose.png")
    assert (load(folder / "loose.png") != load(folder / "locked.png")).any(-1).mean() > 0.3


def test_lock_takes_a_level(folder):
    """Up to it a texture is as it is without jitter, and then jittered; 1 stands for the root's own."""

    def made(lock, level):
        photo = oiio.ImageBuf(str(folder / "photo.png"))
        return filters.synth(photo, size=(48, 48), keeplayout=lock, lod=level).get_pixels(oiio.UINT8)

    np.testing.assert_array_equal(made(3, 3), made(True, 3))
    assert (made(3, 3) != made(False, 3)).any() and (made(3, 6) != made(True, 6)).any()
    np.testing.assert_array_equal(made(1, 6), made(True, 6))
    np.testing.assert_array_equal(made(60, 6), made(True, 6))


def test_a_locked_texture_downsampled_is_its_root(folder):
    """Super-resolution, HRRG08 figure 7: finer detail for the root as it is."""
    stripes = load(folder / "stripes.png")[..., :3] / 255
    away = {}
    for lock in (1, 0):
        run_in(folder, f"--texsynth:graph=map.json:keeplayout={lock}:size=512x512", "-d", "float", "-o", "locked.exr")
        found = load(folder / "locked.exr")
        assert np.abs(found - np.kron(stripes, np.ones((8, 8, 1)))).mean() > 0.02  # detail was added
        away[lock] = np.sqrt(np.square(low_passed(found, 8) - stripes).mean())
    assert away[1] < 0.12 and away[1] < 0.75 * away[0], away  # stripes stand 0.32 away from their mean


def test_a_map_re_makes_the_texture(folder):
    run_in(folder, "photo.png", "--texsynth:size=90x100:flattening=0:st=st.exr", "-o", "a.png")
    run_in(folder, "photo.png", "st.exr", "--texwarp", "-o", "b.png")
    np.testing.assert_array_equal(load(folder / "a.png"), load(folder / "b.png"))


def test_a_graphs_map_says_exemplar_place_and_offset(folder):
    run_in(folder, "--texsynth:graph=map.json:window=50x40+9+8:st=1", "-d", "float", "-o", "m.exr")
    found = [load(folder / "m.exr", n) for n in range(3)]
    names = [oiio.ImageBuf(str(folder / "m.exr"), n, 0).spec().channelnames for n in range(3)]
    assert names == [("R", "G", "B"), ("R", "G", "id"), ("R", "G", "B")]
    assert set(np.unique(found[1][..., 2])) == {1.0}  # the finest level is the gray one's
    x, y = (np.floor(found[1][..., n] * 64).astype(int) for n in range(2))
    gray = load(folder / "gray.png")[y, x].astype(np.float64) / 255
    still = (found[2] == 0).all(-1)
    np.testing.assert_allclose(found[0][still], gray[still], atol=1e-6)
    assert not still.all() and np.abs(found[0] - gray)[~still].max() > 0.05


@pytest.mark.parametrize("name", ["mars", pytest.param("drone_caliterra", marks=pytest.mark.slow), "sand_grain_ladder"])
def test_the_test_graphs_are_synthesized(folder, name):
    path = data_folder() / "multiscale" / name / "graph.json"
    run_in(folder, "--autocc", f"--texsynth:graph={path}:exemplarside=64:window=64x64+100+100", "-o", f"{name}.png")
    assert load(folder / f"{name}.png").std() > 3


def test_the_budget_bounds_a_texture_of_any_size(folder):
    """Only the exemplars and a cell are held: what is asked for may be as large as it likes."""
    photo = oiio.ImageBuf(str(folder / "photo.png"))
    photo.specmod().attribute("oiio:ColorSpace", SRGB)
    roi = oiio.ROI(1 << 20, (1 << 20) + 30, 1 << 19, (1 << 19) + 20, 0, 1, 0, 3)
    made = filters.synth(photo, size=(1 << 25, 1 << 25), roi=roi, session=Session(budget=256 << 20))
    assert (made.spec().width, made.spec().height) == (30, 20)


WRONG = [
    (("--texsynth:graph=none.json",), "none.json: No such file"),
    (("--texsynth:graph=bad.json",), "bad.json: not JSON"),
    (("--texsynth:graph=deep.json",), "edge photo -> photo: r=4 is more than r_max = L - 3 = 3 of exemplars"),
    (("--texsynth:graph=away.json",), "gone.png: no such file"),
    (("--texsynth:graph=loop.json:window=3x4",), "window=3x4: expected WxH+X+Y"),
    (("--texsynth:graph=loop.json:window=0x4+1+1",), "expected WxH+X+Y"),
    (("--texsynth:graph=loop.json:window=4x4+9999999999999999999999+1",), "offsets up to 2^60"),
    (("--texsynth:graph=loop.json:size=20x20:window=9x9+15+0",), "9x9+15+0: expected a window inside size=20x20"),
    (("--texsynth:graph=loop.json:lod=61",), "lod=61: expected an integer from 0 to 60"),
    (("--texsynth:graph=loop.json:st=loop.json",), "loop.json would overwrite graph, an input file"),
    (("photo.png", "--texsynth:size=100x64:tiles=xy"), "size=100x64: expected multiples of 8 px, for tiles=xy"),
    (("photo.png", "--texsynth:size=96x64:tiles=xy:jitter=0"), "size=96x64: expected multiples of 64 px, for tiles=xy"),
    (("photo.png", "--texsynth:tiles=xy"), "tiles=xy requires size, the period of the texture"),
    (("photo.png", "--texsynth:keeplayout=61"), "keeplayout=61: expected 0, 1, or an integer from 0 to 60"),
    (("tiny.png", "--texsynth"), "tiny.png is 9 px wide or high: expected at least 16 px"),
    (("clear.png", "--texsynth"), "clear.png is transparent in its middle 16x16 px"),
    (("--texsynth:size=9x9",), "expected 1 image"),
    (("--texsynth:graph=other.json",), "y.png has channels Y: expected R,G,B, the channels of the root photo.png"),
]  # fmt: skip


@pytest.fixture(scope="module")
def spoiled(folder):
    (folder / "bad.json").write_text("{")
    photo = {"id": "photo", "file": "photo.png"}
    deep = {"exemplars": [photo], "edges": [{"from": "photo", "to": "photo", "r": 4}], "root": "photo"}
    (folder / "deep.json").write_text(json.dumps(deep))
    (folder / "away.json").write_text(json.dumps({"exemplars": [{"id": "a", "file": "gone.png"}]}))
    save(pictures.moss(64, 64, 1)[..., :1], folder / "y.png", space=SRGB)
    other = [photo, {"id": "y", "file": "y.png"}]
    (folder / "other.json").write_text(
        json.dumps({"exemplars": other, "edges": [{"from": "photo", "to": "y", "r": 1}]})
    )
    save(pictures.moss(9, 40, 1), folder / "tiny.png", space=SRGB)
    save(np.dstack([pictures.moss(16, 16, 1), np.zeros((16, 16))]), folder / "clear.png", space=SRGB)
    return folder


@pytest.mark.parametrize("words, message", WRONG, ids=[m[:40] for _, m in WRONG])
def test_what_is_wrong_is_said_in_one_line(spoiled, words, message):
    assert message in refusal(spoiled, "--autocc", *words)


@pytest.mark.slow
def test_memory_does_not_grow_with_the_image(folder):
    """A gigapixel of tiles takes what some rows of it take: benchmarks/README.md has the run."""
    words = "--tile", "64", "64", "-d", "half", "-o", "big.exr"

    def megabytes(size):
        return peak_of(folder, "--cache", "256", "photo.png", f"--texsynth:size={size}:jitter=0.6", *words)

    some = megabytes("8192x2048")  # enough to fill what is kept: 4 bytes a pixel
    assert megabytes("8192x3072") < some + 32 < 500


@pytest.mark.parametrize(
    ("op", "flattening"),
    [("--texsynth:size=96x64", ""), ("--texsynth:size=96x64", ":flattening=0"),
     ("--texquilt:size=96x64:patch=16", ":flattening=0")],
)  # fmt: skip
def test_nothing_slow_is_imported(folder, op, flattening):
    """scipy takes longer to import than its part of the work would; so does numpy.ma, which np.unique brings.

    Flattening takes medians, which bring numpy.ma.
    """
    words = ["-q", "--autocc", "photo.png", op + flattening, "-o", "out.png"]
    code = f"import sys; from oiiotex.oiiotool.cli.running.line_run import run; run({words!r}); print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    slow = {"scipy", "pandas", "networkx", *(["numpy.ma"] if flattening else [])}
    assert not slow & set(done.stdout.split())


def test_paper_is_hrrg08_by_the_letter(folder):
    photo = oiio.ImageBuf(str(folder / "photo.png"))
    six = filters.synth(photo, size=(40, 30), seed=2, paper=True).get_pixels(oiio.FLOAT)
    assert not np.array_equal(six, filters.synth(photo, size=(40, 30), seed=2).get_pixels(oiio.FLOAT))
    for jitter, is_the_same in ((0.6, True), ((0, 0.6, 0.1), False)):  # the letter jitters all levels
        other = filters.synth(photo, size=(40, 30), seed=2, paper=True, jitter=jitter).get_pixels(oiio.FLOAT)
        assert np.array_equal(six, other) == is_the_same
    with refused(errors.ParameterError, parameter="matchcolor", value=False, problem="conflicts with paper=True"):
        filters.synth(photo, matchcolor=False, paper=True)


def test_a_large_photo_is_read_in_bands_and_only_its_square_is_held(monkeypatch):
    monkeypatch.setattr(demand, "BAND_BYTES", 32 << 10)
    pixels, asked = np.random.default_rng(0).random((900, 100, 3), np.float32), []
    part = from_buffer(buffer(pixels)).first

    def fetch(window: Window) -> np.ndarray:
        asked.append(window.height)
        return pixels[window.inside(part.window)]

    image = Image((dataclasses.replace(part, fetch=fetch, ready=False),), "photo")
    lens = lens_of(image, Session().resources, Space.LAB)
    exemplar = stacks._cut(image, 1.0, 64, None, lens, lens, np.dtype(np.float32))
    np.testing.assert_array_equal(exemplar.pixels, pixels[418:482, 18:82])
    assert max(asked) <= 64 and sum(asked) == 900 + 64


def test_a_plane_of_one_photo_shows_all_of_it(folder):
    """A square of 64 px would hold less than half of the photo; what fills the one of 128 px is never copied."""
    save(pictures.pebbles(80, 120, 3), folder / "oblong.png", space=SRGB)
    run_in(folder, "oblong.png", "--texsynth:size=240x160:flattening=0:st=st.exr", "-o", "a.png")
    run_in(folder, "oblong.png", "st.exr", "--texwarp", "-o", "b.png")
    np.testing.assert_array_equal(load(folder / "a.png"), load(folder / "b.png"))
    x, y = np.moveaxis(np.floor(load(folder / "st.exr")[..., :2] * (120, 80)), -1, 0)
    assert x.min() < 28 and x.max() >= 92 and y.min() < 8 and y.max() >= 72  # outside the square of 64 px


def test_a_plane_of_one_photo_repeats_with_its_start():
    """After four times the exemplar's side, here 64 px, as far away as coordinates reach; coarser levels, too."""
    photo = buffer(pictures.pebbles(64, 64, 3))
    for lod, period in ((6, 256), (4, 64)):
        near, far = (
            filters.synth(photo, window=f"40x30+{place}+{place}", lod=lod, seed=2).get_pixels(oiio.FLOAT)
            for place in (5, 5 + (period << 40))
        )
        np.testing.assert_array_equal(near, far)
