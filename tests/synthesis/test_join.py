# SPDX-License-Identifier: Apache-2.0
"""--texjoin: shares of an image are the whole when they are put together, and what does not fit is refused by name."""

from __future__ import annotations

import subprocess

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from oiiotex.engine import errors
from oiiotex.engine.core.window import Window
from oiiotex.filters.texjoin import first_gap
from tests import pictures
from tests.conftest import load, oiiotex, run_in, save
from tests.peer import OIIOTOOL

WHOLE = np.random.default_rng(0).random((50, 70, 3)).astype(np.float32)


def share(left, top, right, bottom, pixels=WHOLE, **attributes):
    """A crop in the display window of the whole."""
    spec = oiio.ImageSpec(right - left, bottom - top, pixels.shape[2], oiio.FLOAT)
    spec.x, spec.y, spec.full_width, spec.full_height = left, top, 70, 50
    for name, value in attributes.items():
        spec.attribute(name.replace("_", ":", 1), value)
    made = oiio.ImageBuf(spec)
    made.set_pixels(made.roi, np.ascontiguousarray(pixels[top:bottom, left:right]))
    return made


def joined(*shares):
    return filters.join(*shares).get_pixels(oiio.FLOAT)


def test_shares_are_the_whole_in_any_order():
    bands = [share(0, 0, 70, 20), share(0, 20, 70, 33), share(0, 33, 70, 50)]
    for shares in (bands, bands[::-1]):
        np.testing.assert_array_equal(joined(*shares), WHOLE)
    tiles = [share(x, y, min(x + 30, 70), min(y + 26, 50)) for x in (0, 30, 60) for y in (0, 26)]
    np.testing.assert_array_equal(joined(*tiles), WHOLE)
    np.testing.assert_array_equal(joined(share(0, 0, 70, 30), share(0, 20, 70, 50), share(0, 20, 70, 50)), WHOLE)


@pytest.mark.parametrize("suffix", ["tif", "exr"])
def test_tiled_shares_are_a_tiled_file(tmp_path, suffix):
    for name, cut in (("a", "70x20+0+0"), ("b", "70x30+0+20")):
        line = f"--create 70x50 3 --crop {cut} -d {'half' if suffix == 'exr' else 'uint8'} --tile 16 16"
        run_in(tmp_path, *line.split(), "-o", f"{name}.{suffix}")
    run_in(tmp_path, f"a.{suffix}", f"b.{suffix}", "--texjoin", "-o", f"whole.{suffix}")
    spec = oiio.ImageBuf(str(tmp_path / f"whole.{suffix}")).nativespec()
    assert (spec.tile_width, spec.tile_height, spec.height) == (16, 16, 50)


def test_overscan_and_parts_come_along():
    wide = np.random.default_rng(1).random((50, 70, 3)).astype(np.float32)
    spec = share(0, 0, 70, 50).spec()
    spec.x = -5
    over = oiio.ImageBuf(spec)
    over.set_pixels(over.roi, wide)
    rest = share(65, 0, 70, 50)
    made = filters.join({"beauty": over, "st": over}, {"beauty": rest, "st": rest})
    assert list(made) == ["joined", "st"]
    assert Window.data(made["st"].spec()) == Window(-5, 0, 70, 50)
    np.testing.assert_array_equal(made["st"].get_pixels(oiio.FLOAT)[:, :70], wide)
    with pytest.raises(errors.ImageError, match=r"parts beauty: .*beauty,st"):
        filters.join({"beauty": over, "st": over}, {"beauty": rest})


def test_gaps_are_found():
    whole = Window(0, 0, 10, 8)
    assert first_gap(whole, [whole]) is None
    assert first_gap(whole, [Window(-3, -3, 20, 20)]) is None
    assert first_gap(whole, [Window(0, 0, 10, 3), Window(0, 5, 10, 8)]) == Window(0, 3, 10, 5)
    assert first_gap(whole, [Window(0, 0, 4, 8), Window(6, 2, 10, 8)]) == Window(4, 0, 10, 2)
    random = np.random.default_rng(3)
    for _ in range(50):  # against pixels
        windows = [Window(*np.sort(random.integers(0, 11, 2)), 0, 0) for _ in range(4)]
        tops = [np.sort(random.integers(0, 9, 2)) for _ in windows]
        windows = [Window(int(w[0]), int(t[0]), int(w[1]), int(t[1])) for w, t in zip(windows, tops, strict=True)]
        seen = np.zeros((8, 10), bool)
        for w in windows:
            seen[w.inside(whole)] = True
        gap = first_gap(whole, [w for w in windows if not w.empty])
        assert (gap is None) == seen.all()
        assert gap is None or not seen[gap.inside(whole)].any()


OTHER = WHOLE.copy()
OTHER[25, 7, 1] += 1e-6
WRONG = [
    (
        lambda: (share(0, 0, 70, 20), share(0, 30, 70, 50)),
        r"^join: 70x10\+0\+20 of 70x50\+0\+0 is not covered by the 2 images",
    ),
    (
        lambda: (share(0, 0, 70, 30), share(0, 20, 70, 50, OTHER)),
        r"differ where they overlap \(70x10\+0\+20\), first at 7,25$",
    ),
    (
        lambda: (share(0, 0, 70, 30), share(0, 30, 70, 50, WHOLE[..., :1])),
        "has channels Y: expected R,G,B, .*; all must be crops",
    ),
    (
        lambda: (
            share(0, 0, 70, 30, oiiotex_parameters="seed=1:x=2"),
            share(0, 30, 70, 50, oiiotex_parameters="seed=2"),
        ),
        "has parameter seed=2: expected seed=1, .*; all must be crops",
    ),
    (
        lambda: (share(0, 0, 70, 30, oiiotex_plane="a"), share(0, 30, 70, 50, oiiotex_plane="b")),
        "are crops of different textures: the graph, the seed or another",
    ),
]  # fmt: skip


@pytest.mark.parametrize("shares, message", WRONG, ids=["gap", "unlike", "channels", "seed", "plane"])
def test_what_does_not_fit_is_refused_by_name(shares, message):
    with pytest.raises(errors.ImageError, match=message):
        filters.join(*shares())


@pytest.fixture(scope="module")
def farm(tmp_path_factory):
    """A texture in one run, and in three shares."""
    made = tmp_path_factory.mktemp("farm")
    save(pictures.pebbles(32, 40, 1), made / "photo.png", space="srgb_rec709_scene")
    for name, more in (("whole", ""), *((f"share{n}", f":window=70x16+0+{16 * n - 16}") for n in (1, 2, 3))):
        words = ("photo.png", f"--texsynth:size=70x48:st=1{more}", "-d", "float", "-o", f"{name}.exr")
        run_in(made, *words)
    return made


def test_a_farms_shares_are_one_run_by_texjoin_mosaic_and_paste(farm):
    shares = [f"share{n}.exr" for n in (3, 1, 2)]
    run_in(farm, *shares, "--texjoin", "-o", "joined.exr")
    for part in (0, 1):
        np.testing.assert_array_equal(load(farm / "joined.exr", part), load(farm / "whole.exr", part))
        a, b = (oiio.ImageBuf(str(farm / f"{n}.exr"), part, 0).spec() for n in ("joined", "whole"))
        assert Window.data(a) == Window.data(b) and Window.display(a) == Window.display(b)
    if not OIIOTOOL.exists():
        pytest.skip("OpenImageIO's wheel has no oiiotool here")
    ordered = sorted(shares)
    for name, words in (
        ("paste", [*ordered, "--paste:mergeroi=1:all=1", "+0+0"]),
        ("mosaic", [w for s in ordered for w in (s, "--origin", "+0+0", "--fullpixels")] + ["--mosaic", "1x3"]),
    ):
        subprocess.run([OIIOTOOL, *words, "-o", f"{name}.exr"], cwd=farm, check=True, capture_output=True)
        np.testing.assert_array_equal(load(farm / f"{name}.exr"), load(farm / "whole.exr"))


def test_faults_on_the_command_line_name_files(farm):
    done = oiiotex("share1.exr", "share3.exr", "--texjoin", "-o", "never.exr", cwd=farm)
    line = "oiiotex ERROR: --texjoin : 70x16+0+16 of 70x48+0+0 is not covered by the 2 images\n"
    assert (done.returncode, done.stderr) == (1, line) and not (farm / "never.exr").exists()
    run_in(farm, "share1.exr", "-d", "half", "-o", "half.exr")
    done = oiiotex("half.exr", "share2.exr", "share3.exr", "--texjoin", "-o", "never.exr", cwd=farm)
    assert "share2.exr has pixel type float: expected half, as half.exr" in done.stderr
    save(np.zeros((5, 5, 3)), farm / "small.exr", "float")
    done = oiiotex("share1.exr", "share2.exr", "share3.exr", "small.exr", "--texjoin", "-o", "never.exr", cwd=farm)
    assert "small.exr has parts" in done.stderr
