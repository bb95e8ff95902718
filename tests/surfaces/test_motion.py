# SPDX-License-Identifier: Apache-2.0
"""--texplate and --texproject: a fill that moves with a shot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex.engine.core.image import channels_of, from_array
from oiiotex.engine.core.window import Window
from oiiotex.engine.errors import ImageError
from oiiotex.surfaces.capture.homography import homography_of, through
from oiiotex.surfaces.motion.clean_plate import MARGIN, assembled, laid_out
from oiiotex.surfaces.motion.frame_files import covered, numbered, region_of
from oiiotex.surfaces.motion.frame_grain import Side, grain_between, of_shot
from oiiotex.surfaces.motion.frame_motion import STEP, FrameMotion, fitted, nodes, read_shot
from oiiotex.surfaces.motion.light import gains, grain
from oiiotex.surfaces.motion.sampling import at_points, centers, grown
from oiiotex.surfaces.motion.tracking import gray_view
from tests import pictures
from tests.conftest import load, oiiotex, save

HEIGHT, WIDTH, COUNT = 96, 128, 4
PHOTO = pictures.stained(pictures.pebbles(200, 260, 3)).astype(np.float32)
TURN = np.array([[0.96, 0.05, 4e-5], [-0.04, 1.02, -6e-5], [5.3, -3.7, 1.0]])


def matrix(n: int) -> np.ndarray:
    """Frame n to photo: a pan with a little perspective."""
    return np.array([[1, 0, 1e-5 * n], [0, 1 + 0.01 * n, 0], [40 + 7.3 * n, 50 - 2.6 * n, 1]])


def places(to: np.ndarray) -> np.ndarray:
    y, x = np.indices((HEIGHT, WIDTH)) + 0.5
    return through(to, np.stack([x.ravel(), y.ravel()], 1)).reshape(HEIGHT, WIDTH, 2)


def spot(points: np.ndarray) -> np.ndarray:
    """What must go: fixed on the surface, from within the first frame to beyond it."""
    return (np.abs(points[..., 1] - 95) < 7) & (points[..., 0] > 90)


@pytest.fixture(scope="module")
def shot(tmp_path_factory):
    """Frames, masks, ST maps and vectors; the light changes, and there is grain."""
    folder, random = tmp_path_factory.mktemp("shot"), np.random.default_rng(0)
    for n in range(COUNT):
        points = places(matrix(n))
        frame = at_points(PHOTO, points) * (1 + 0.1 * n) + random.normal(0, 0.01, (HEIGHT, WIDTH, 3))
        frame[spot(points)] = (1, 0, 0)
        save(frame, folder / f"plate.{1001 + n}.exr", "float")
        save(grown(spot(points), 2)[..., None] * 1.0, folder / f"mask.{1001 + n}.exr", "float", "data")
        here = places(matrix(n) @ np.linalg.inv(matrix(0)))
        save(here / (WIDTH, HEIGHT), folder / f"st.{1001 + n}.exr", "float", "data")
        back = places(matrix(n) @ np.linalg.inv(matrix(max(0, n - 1)))) - places(np.eye(3))
        save(back * (1, -1), folder / f"mv.{1001 + n}.exr", "float", "data")
    return folder


def plate(folder, *more: str, modifiers: str = ":motion=st.1001.exr"):
    words = f"--texplate:region=1:frames=1001-{1000 + COUNT}:motionfile=shot.npz{modifiers}"
    first = "plate.1001.exr", "--iscolorspace", "lin_rec709_scene", "mask.1001.exr"
    return oiiotex(*first, words, "-o", "open.exr", *more, cwd=folder)


@pytest.fixture(scope="module")
def filled(shot):
    """The shot with its motion, a plate that is filled with the truth, and the frames rendered from it."""
    done = plate(shot)
    assert done.returncode == 0, done.stderr
    motion, opened = read_shot(shot / "shot.npz", 1 << 20), oiio.ImageBuf(str(shot / "open.exr"))
    full = oiio.ImageBuf(opened.spec())
    full.set_pixels(full.roi, np.dstack([truth(opened, motion), np.ones(truth(opened, motion).shape[:2])]))
    assert full.write(str(shot / "full.exr"))
    made = oiiotex(
        *("--frames", f"1001-{1000 + COUNT}", "plate.#.exr", "full.exr", "mask.#.exr"),
        *("--texproject:region=1:motion=shot.npz", "-o", "out.#.exr"),
        cwd=shot,
    )
    assert made.returncode == 0, made.stderr
    return shot, motion


def truth(opened: oiio.ImageBuf, motion: dict[int, FrameMotion]) -> np.ndarray:
    """The photo where the plate has its pixels."""
    points = centers(Window.data(opened.spec()))
    return at_points(PHOTO, through(matrix(0), motion[1001].back(points.reshape(-1, 2))).reshape(points.shape))


def test_a_homography_is_found_from_points():
    points = np.random.default_rng(1).random((9, 2)) * 300
    np.testing.assert_allclose(homography_of(points, through(TURN, points)), TURN, atol=1e-9)


def test_a_bend_is_inverted_and_continues_beyond_the_frame():
    at = nodes(WIDTH, HEIGHT)
    bent = fitted(at, through(TURN, at.reshape(-1, 2)).reshape(at.shape) + 2 * np.sin(at[..., ::-1] / 40))
    points = np.random.default_rng(2).random((50, 2)) * (WIDTH + 60, HEIGHT + 60) - 30
    np.testing.assert_allclose(bent.back(bent.onto(points)), points, atol=1e-3)
    inside = points[(points > STEP).all(1) & (points < (WIDTH - STEP, HEIGHT - STEP)).all(1)]
    true = through(TURN, inside) + 2 * np.sin(inside[:, ::-1] / 40)
    assert np.abs(bent.onto(inside) - true).max() < 0.03


def test_the_plate_is_the_surface_without_the_object(filled):
    folder, motion = filled
    opened, made = oiio.ImageBuf(str(folder / "open.exr")), load(folder / "open.exr")
    known = made[..., 3] > 0
    assert set(motion) == set(range(1001, 1001 + COUNT))
    assert np.median(np.abs(made[..., :3] - truth(opened, motion))[known]) < 0.006  # a frame's grain: 0.01
    assert known.sum() > WIDTH * HEIGHT  # more than one frame shows
    hole = oiio.ImageBuf(str(folder / "open.exr"), 1, 0).get_pixels(oiio.FLOAT)[..., 0] > 0
    assert hole.sum() > 15 * WIDTH and not (hole & known).any()


def test_frames_change_in_the_region_alone_and_show_the_surface_in_their_light(filled):
    folder, _ = filled
    for n in range(COUNT):
        before, after = load(folder / f"plate.{1001 + n}.exr"), load(folder / f"out.{1001 + n}.exr")
        region = load(folder / f"mask.{1001 + n}.exr")[..., 0] > 0
        away = ~grown(region, MARGIN)
        np.testing.assert_array_equal(after[away], before[away])
        error = after - at_points(PHOTO, places(matrix(n))) * (1 + 0.1 * n)
        assert np.abs(error[region].mean(0)).max() < 0.005
        assert abs(error[region].std() / 0.01 - 1) < 0.35  # grain like the frame's


def test_a_frame_is_the_same_alone_and_in_the_sequence(filled):
    folder, _ = filled
    line = ["plate.1003.exr", "full.exr", "mask.1003.exr", "--texproject:region=1:motion=shot.npz:frame=1003"]
    assert oiiotex(*line, "-o", "again.exr", cwd=folder).returncode == 0
    np.testing.assert_array_equal(load(folder / "again.exr"), load(folder / "out.1003.exr"))


def test_the_line_of_the_page_fills_the_hole_of_the_plate(filled):
    """That of docs/how-to/fills-in-moving-shots.md."""
    folder, _ = filled
    done = plate(folder, "--sisplit", "--texfill:iterations=2:patch=7", "-o", "clean.exr")
    assert done.returncode == 0, done.stderr
    clean, hole = (oiio.ImageBuf(str(folder / name), part, 0) for name, part in (("clean.exr", 0), ("open.exr", 1)))
    pixels = clean.get_pixels(oiio.FLOAT)[hole.get_pixels(oiio.FLOAT)[..., 0] > 0]
    assert (pixels[:, 3] == 1).all() and not (pixels[:, 0] > pixels[:, 1] + 0.5).any()  # nothing of the red object
    assert (clean.spec().x, clean.spec().y) == (hole.spec().x, hole.spec().y)


def test_grain_is_saved_with_the_motion(filled):
    """The frames have grain of .01; bends and matrices without it can also be read."""
    _, motion = filled
    assert all(np.allclose(one.grain, 0.01, rtol=0.25) for one in motion.values()), motion[1001].grain


def test_vectors_are_chained_to_the_motion_of_st_maps(filled):
    folder, motion = filled
    done = plate(folder, modifiers=":motion=mv.1001.exr:vectors=backward:flip=1")
    assert done.returncode == 0, done.stderr
    chained = read_shot(folder / "shot.npz", 1 << 20)
    points = np.array([(3.0, 5.0), (120, 8), (64, 48), (100, 90)])
    for n in motion:
        seen, true = (shot[1001].back(shot[n].onto(points)) for shot in (chained, motion))
        np.testing.assert_allclose(seen, true, atol=0.05)


def test_tracking_finds_the_motion(shot):
    pytest.importorskip("cv2", reason="no OpenCV")
    done = plate(shot, modifiers="")
    assert done.returncode == 0, done.stderr
    found = read_shot(shot / "shot.npz", 1 << 20)
    corners = np.array([(10.0, 10), (118, 10), (118, 86), (10, 86)])
    for n in range(COUNT):
        true = through(matrix(n) @ np.linalg.inv(matrix(0)), corners)
        seen = found[1001].back(found[1001 + n].onto(corners))
        assert np.abs(seen - true).max() < 0.4


def test_light_and_grain_are_continued_inside():
    random = np.random.default_rng(3)
    plate = 0.3 + 0.2 * random.random((96, 112, 3), np.float32)
    y, x = np.indices((96, 112))
    light = (1.2 + 0.004 * (x - 56))[..., None]
    known = (np.abs(y - 48) > 20) | (np.abs(x - 56) > 24)
    noise = np.repeat(random.normal(0, 0.02, (96, 112, 1)), 3, 2)  # gray grain
    found = gains(plate * light + noise, plate, known)
    assert np.abs(found - light)[24:72, 30:80].max() < 0.04
    made = grain(noise * known[..., None], plate, known, 7)
    np.testing.assert_array_equal(made, grain(noise * known[..., None], plate, known, 7))
    assert abs(made[~known].std() / 0.02 - 1) < 0.15
    assert np.corrcoef(made[..., 0].ravel(), made[..., 2].ravel())[0, 1] > 0.95


def test_grain_is_measured_between_frames_and_not_against_the_plate():
    """Two frames with grain of .02, half a pixel apart, in another light. The amount rules grain that was misjudged."""
    random, texture = np.random.default_rng(4), pictures.pebbles(96, 112, 3).astype(np.float32)
    moved = np.eye(3)
    moved[2, 0] = 0.5
    y, x = np.indices((96, 112)) + 0.5
    shifted = at_points(texture, np.stack([x + 0.5, y], -1))
    region = (np.abs(y - 48) < 12) & (np.abs(x - 56) < 12)
    first, second = (
        image + random.normal(0, 0.02, image.shape).astype(np.float32) for image in (texture, 1.3 * shifted)
    )
    second[region], first[:4] = 9, np.nan
    found = grain_between(Side(first, region, FrameMotion(np.eye(3))), Side(second, region, FrameMotion(moved)))
    assert found is not None and np.allclose(found, 0.02, rtol=0.2), found
    everything = np.ones_like(region)
    assert grain_between(Side(first, everything, FrameMotion(moved)), Side(second, region, FrameMotion(moved))) is None
    assert of_shot([np.zeros(3)]) is None
    np.testing.assert_allclose(of_shot([np.zeros(3), *(np.full(3, n) for n in (0.01, 0.011, 0.03, 0.05))]), 0.01075)
    misfit = random.normal(0, 0.1, texture.shape).astype(np.float32)
    assert abs(grain(misfit, texture, ~region, 7, np.full(3, 0.02))[~region].std() / 0.02 - 1) < 0.15


def test_the_plate_has_the_pixels_of_the_closest_frame():
    closer = FrameMotion(np.diag([0.5, 0.5, 1.0]))
    points = {1: np.full((4, 2), 30.0), 2: np.full((4, 2), 60.0)}
    assert laid_out({1: FrameMotion(np.eye(3)), 2: closer}, points, (100, 80), 1).scale == pytest.approx(2)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (":frames=1001-1009:motion=st.1001.exr", "frame: frame 1005 is missing: no file"),
        (":frames=1002-1004", "frames=1002-1004: expected a range that includes the image, which is frame 1001"),
        (":frames=all", "frames=all: expected FIRST-LAST"),
        (":frames=1001-1002:motion=small.1001.exr", "motion small.1001.exr is 64x48, but the frame is 128x96"),
        (":frames=1001-1002:motion=full.npz", "full.npz: cannot read arrays"),
        (":frames=1001-1002:motion=mv.1001.exr", "motion mv.1001.exr maps pixels to a line or a point"),
        (":frames=1001-1002:motion=mv.1001.exr:vectors=forward", "forward vectors lead to it"),
    ],
)
def test_bad_input_is_one_line(shot, words, message):
    for n in (1001, 1002):
        save(np.zeros((48, 64, 2)), shot / f"small.{n}.exr", "float", "data")
    (shot / "full.npz").write_bytes(b"no arrays")
    done = oiiotex("plate.1001.exr", "mask.1001.exr", f"--texplate:region=1{words}", "-o", "x.exr", cwd=shot)
    assert done.returncode == 1
    assert message in done.stderr and len(done.stderr.splitlines()) == 1


def test_motion_that_cannot_be_inverted_is_refused(tmp_path):
    path, matrices = tmp_path / "shot.npz", np.stack([np.eye(3), np.diag([1e9, 1, 1e-9])])
    np.savez(path, frames=np.array([1, 2]), matrices=matrices)
    with pytest.raises(ImageError, match="frame 2"):
        read_shot(path, 1 << 20)
    np.savez(path, frames=np.array([1]), matrices=matrices[:1].astype(np.float16))
    assert read_shot(path, 1 << 20)[1].matrix.dtype == np.float64
    bent = {1: FrameMotion(np.eye(3), np.full((2, 2, 2), 1e30, np.float32))}
    with pytest.raises(ImageError, match=r"motion .*frame 1"):
        laid_out(bent, {1: np.array([[3.0, 3], [5, 5]])}, (16, 12), 1)


def test_pixels_that_are_nan_come_from_other_frames():
    frames = [np.full((12, 16, 3), 0.5, np.float32) for _ in range(2)]
    frames[0][5, 5, 1] = np.nan
    layout = laid_out({n: FrameMotion(np.eye(3)) for n in range(2)}, {}, (16, 12), 0)
    seen = ((n, frame, np.zeros((12, 16), bool)) for n, frame in enumerate(frames))
    values, known, *_ = assembled(layout, seen, 3, lambda _: None)
    assert known.all()
    np.testing.assert_allclose(values, 0.5, rtol=1e-5)
    assert np.ptp(gray_view(frames[0] + np.linspace(0, 0.3, 16, dtype=np.float32)[:, None])) > 200  # still tracked


def test_a_date_is_no_frame_number_and_a_mask_may_be_an_alpha_channel():
    assert numbered("plate.0000001001.exr") == 1001 and numbered("scan_20260101120000.exr") is None
    spec = oiio.ImageSpec(4, 3, 1, "float")
    spec.channelnames = ("A",)
    assert channels_of(spec).first == 0
    flat = np.ones((32, 32, 1), np.float32)
    assert not grain(0 * flat, flat, flat[..., 0] > 0, -3).any()  # a frame before 0


def test_a_changed_frame_is_refused(shot):
    words = "--texplate:frames=1001-1002:motion=st.1001.exr", "-o", "x.exr"
    done = oiiotex("plate.1001.exr", "--mulc", "2", *words, cwd=shot)
    assert done.returncode == 1 and "differs from its file" in done.stderr


def test_a_region_without_surroundings_is_refused(shot):
    save(np.ones((HEIGHT, WIDTH, 1)), shot / "white.exr", "float", "data")
    line = "plate.1001.exr", "white.exr", "--texplate:region=1:frames=1001-1002:motion=st.1001.exr", "-o", "x.exr"
    done = oiiotex(*line, cwd=shot)
    assert done.returncode == 1 and "region covers every pixel" in done.stderr


def test_a_cut_and_a_blank_wall_are_refused(shot):
    pytest.importorskip("cv2", reason="no OpenCV")
    for n, frame in ((1, PHOTO[:96, :128]), (2, pictures.bricks(96, 128, 5)), (3, np.full((96, 128, 3), 0.5))):
        save(frame, shot / f"cut.{n}.exr", "float")
    done = oiiotex("cut.1.exr", "--texplate:frames=1-2", "-o", "x.exr", cwd=shot)
    assert done.returncode == 1 and "frame 2 does not show the surface of frame 1" in done.stderr
    done = oiiotex("cut.3.exr", "--texplate:frames=2-3", "-o", "x.exr", cwd=shot)
    assert done.returncode == 1 and "frame 3 has 0 features to track" in done.stderr


def test_the_region_of_a_large_frame_is_read_in_bands(monkeypatch):
    mask = from_array(np.indices((150, 9)).sum(0).astype(np.uint8)[..., None]).first
    rows = []

    def fetched(window: Window) -> np.ndarray:
        rows.append(window.height)
        return mask.read(window)

    region = covered(replace(mask, fetch=fetched), mask.window, "region")
    np.testing.assert_array_equal(region, region_of(mask, mask.window, "region") > 0)
    assert region.dtype == bool and sum(rows) == 150 and max(rows) <= 64


def test_a_plate_that_does_not_fit_is_refused_before_the_work(tmp_path):
    done = oiiotex("--cache", "64", "--create", "3000x3000", "3", "--texplate", "-o", "o.exr", cwd=tmp_path)
    assert done.returncode == 1 and "reading the frames needs 112 MB" in done.stderr
