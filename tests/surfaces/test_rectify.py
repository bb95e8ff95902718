# SPDX-License-Identifier: Apache-2.0
"""--texrectify: against a camera that the test makes, by corners and by the lattice alone."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from oiiotex.engine import errors
from oiiotex.engine.core.image import Image, Part, from_buffer
from oiiotex.engine.core.window import Window
from oiiotex.engine.run import run
from oiiotex.engine.session import Session
from oiiotex.filters.texrectify import Rectify
from oiiotex.surfaces.capture.homography import aspect_of, homography, require_quadrangle, through
from oiiotex.surfaces.capture.slanted_lattice import SlantedLattice, is_sheared, largest_rectangle, slanted_lattice
from tests import pictures
from tests.any_filter import buffer, pixels
from tests.conftest import made_by, oiiotex, save

SHOT = (320, 240)


def seen_corners(
    plane: tuple[float, float], turn: float, nod: float, focal: float = 1.1, fill: float = 0.8
) -> np.ndarray:
    """Where a camera of SHOT px sees the corners of a plane that is turned and nods, radians. (4, 2)."""
    across, down = plane
    c, s = math.cos(turn), math.sin(turn)
    about_y = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    c, s = math.cos(nod), math.sin(nod)
    about_x = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    lens = focal * max(SHOT)
    away = lens / min(fill * SHOT[0] / across, fill * SHOT[1] / down)
    corners = np.array([[-across, -down, 0], [across, -down, 0], [across, down, 0], [-across, down, 0]]) / 2
    there = corners @ (about_x @ about_y).T + [0, 0, away]
    return lens * there[:, :2] / there[:, 2:] + np.array(SHOT) / 2


def shot(picture: np.ndarray, turn: float, nod: float, fill: float = 1.6) -> tuple[np.ndarray, np.ndarray]:
    """The camera's picture of a plane, and the matrix from the plane's px to it."""
    height, width = picture.shape[:2]
    matrix = np.linalg.inv(homography(seen_corners((width, height), turn, nod, fill=fill), width, height))
    given, made = buffer(picture), oiio.ImageBuf(oiio.ImageSpec(*SHOT, 3, oiio.FLOAT))
    roi = oiio.ROI(0, SHOT[0], 0, SHOT[1], 0, 1, 0, 3)
    oiio.ImageBufAlgo.warp(made, given, tuple(map(float, matrix.ravel())), "lanczos3", 0.0, False, "black", roi)
    return made.get_pixels(oiio.FLOAT), matrix


def wall(scale: int = 3, side: int = 160) -> np.ndarray:
    return np.kron(pictures.bricks(side, side, 1), np.ones((scale, scale, 1)))


@pytest.mark.parametrize(("turn", "nod"), [(0.5, 0.3), (-0.4, 0.6), (0.9, 0.2), (0.0, 0.0)])
def test_width_over_height_follows_from_the_perspective(turn, nod):
    corners = seen_corners((3.0, 2.0), turn, nod)
    assert aspect_of(corners, SHOT) == pytest.approx(1.5, rel=1e-6)


@pytest.mark.parametrize(("turn", "nod"), [(0.5, 0.0), (0.0, 0.4)])
def test_where_one_pair_of_sides_is_parallel_a_usual_lens_is_taken(turn, nod):
    assert aspect_of(seen_corners((3.0, 2.0), turn, nod), SHOT) == pytest.approx(1.5, rel=0.04)


def test_a_surface_comes_back_as_it_was_before_the_camera():
    plane = pictures.smooth_noise(160, 240, 12, 4)[..., None] * [1.0, 0.8, 0.6]
    seen, matrix = shot(plane, 0.4, 0.3, fill=0.9)
    corners = through(matrix, np.array([[0, 0], [240, 0], [240, 160], [0, 160]], float))
    made = pixels(filters.rectify(buffer(seen), corners=corners.ravel(), size=(240, 160)))
    inside = np.s_[8:-8, 8:-8]
    assert np.abs(made - plane)[inside].mean() < 0.005
    own = filters.rectify(buffer(seen), corners=corners.ravel())
    assert own.spec().width / own.spec().height == pytest.approx(1.5, rel=0.01)


def test_what_a_photo_says_of_the_size_of_its_pixels_is_not_true_of_the_result():
    photo = buffer(pictures.moss(32, 32, 1))
    photo.specmod().attribute("XResolution", 72.0)
    made = filters.rectify(photo, corners=(2, 2, 30, 3, 29, 30, 1, 28))
    assert made.spec().getattribute("XResolution") is None


def test_a_surface_seen_through_an_anamorphic_lens_has_square_pixels_and_its_own_shape():
    corners = seen_corners((3.0, 2.0), 0.5, 0.3)
    photo = buffer(np.ones((SHOT[1], SHOT[0] // 2, 3)))
    photo.specmod().attribute("PixelAspectRatio", 2.0)
    made = filters.rectify(photo, corners=(corners / (2, 1)).ravel()).spec()
    assert made.width / made.height == pytest.approx(1.5, rel=0.01)
    assert made.get_float_attribute("PixelAspectRatio", 1.0) == 1


def test_fine_detail_is_filtered_where_it_becomes_smaller():
    fine = np.indices((240, 320)).sum(0)[..., None] % 2 * np.ones(3)
    made = pixels(filters.rectify(buffer(fine), corners=(0, 0, 320, 0, 320, 240, 0, 240), size=(80, 60)))
    assert np.abs(made[4:-4, 4:-4] - 0.5).max() < 0.02


def test_coordinates_lead_st_warp_to_the_same_pixels(tmp_path):
    photo = pictures.smooth_noise(96, 128, 16, 1)[..., None] * np.ones(3)
    save(photo, tmp_path / "photo.exr", "float", "lin_rec709_scene")
    words = "--texrectify:corners=10,6,120,14,108,90,4,80:size=128x96:st=st.exr"
    done = oiiotex("photo.exr", words, "-o", "front.exr", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    done = oiiotex("photo.exr", "st.exr", "--st_warp", "-o", "warped.exr", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    front, warped = (oiio.ImageBuf(str(tmp_path / f"{n}.exr")).get_pixels(oiio.FLOAT) for n in ("front", "warped"))
    assert np.abs(front - warped)[3:-3, 3:-3].max() < 0.01


@pytest.mark.parametrize(("turn", "nod"), [pytest.param(0.87, 0.1, marks=pytest.mark.slow), (0.1, 0.87)])
def test_a_wall_is_straightened_by_its_bricks_alone(turn, nod):
    """Whole cells of 48 x 48 px (a brick across, two courses down), to a third of a pixel for each cell."""
    seen, matrix = shot(wall(), turn, nod)
    lattice = slanted_lattice(100 * seen)
    corners, (across, down) = largest_rectangle(lattice, SHOT)
    left_top, right_top, right_bottom, left_bottom = through(np.linalg.inv(matrix), corners)
    for begin, end, sides in (
        (left_top, right_top, (48 * across, 0)), (left_bottom, right_bottom, (48 * across, 0)),
        (left_top, left_bottom, (0, 48 * down)), (right_top, right_bottom, (0, 48 * down)),
    ):  # fmt: skip
        assert np.abs(end - begin - sides).max() < 1.5
    assert across * down >= 9


@pytest.mark.parametrize(("kind", "turned"), [("bricks", -11), ("tiles", 28)])
def test_the_photo_may_be_turned(kind, turned):
    """Twice as wide as high, bricks in a running bond lie as square tiles do that are turned by 45 degrees."""
    y, x = np.mgrid[:240, :320] + 0.5
    c, s = math.cos(math.radians(turned)), math.sin(math.radians(turned))
    across, down = c * x + s * y, c * y - s * x
    row = np.floor(down / 16) if kind == "bricks" else 0 * down
    joint = (down % 16 < 2) | ((across + 16 * (row % 2)) % (32 if kind == "bricks" else 16) < 2)
    photo = (80 - 60 * joint)[..., None] * np.ones(3)
    cell = slanted_lattice(photo.astype(np.float32)).cell
    side = 32 if kind == "bricks" else 16
    np.testing.assert_allclose(cell, side * np.array([[c, s], [-s, c]]), atol=0.5)


def test_the_lattice_gives_corners_that_can_be_said_for_the_next_map(tmp_path):
    seen, _ = shot(wall(), 0.3, 0.2)
    save(seen, tmp_path / "photo.exr", "half", "lin_rec709_scene")
    words = "--texrectify:meters=0.25,0.15:facts=found.json"
    done = oiiotex("photo.exr", words, "-o", "front.exr", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    found = json.loads((tmp_path / "found.json").read_text())
    assert found["meters"] == pytest.approx([0.25 * found["cells"][0], 0.15 * found["cells"][1]])
    said = done.stdout.splitlines()[0]
    assert said.startswith("corners=") and said.endswith(f"size={found['width']}x{found['height']}")
    again = oiiotex("photo.exr", f"--texrectify:{said}", "-o", "again.exr", cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    front, again = (oiio.ImageBuf(str(tmp_path / f"{n}.exr")) for n in ("front", "again"))
    np.testing.assert_array_equal(pixels(front), pixels(again))
    spec = front.spec()
    meters = spec.width / spec.getattribute("XResolution") * 0.0254
    assert spec.getattribute("ResolutionUnit") == "in" and meters == pytest.approx(found["meters"][0], rel=1e-4)
    tile = filters.quilt(
        front, size=(40, 40), lattice=0, flattening=0, colorspace="lin_rec709_scene"
    )  # the size of a pixel goes on
    assert tile.spec().getattribute("XResolution") == spec.getattribute("XResolution")


def test_a_bond_that_would_be_sheared_asks_for_corners():
    """A floor of slabs, each course shifted by a third of a slab; a half, as bricks have, is straightened above."""
    y, x = np.mgrid[:192, :224]
    along = x + 32 / 3 * (y // 16)
    shade = 0.35 + 0.25 * ((37 * (y // 16) + 59 * (along // 32)) % 17) / 17
    gray = np.where((y % 16 < 2) | (along % 32 < 2), 0.12, shade) + np.random.default_rng(1).normal(0, 0.02, y.shape)
    slabs = np.repeat(gray[..., None], 3, -1).astype(np.float32)
    with pytest.raises(errors.ImageError, match="no lattice at right angles, and its texture shows no perspective"):
        filters.rectify(slabs, colorspace="srgb_rec709_scene")


def lines(*degrees: float) -> np.ndarray:
    """Thin lines in these directions, as CIE Lab."""
    y, x = np.mgrid[:256, :256]
    light = np.full(x.shape, 80.0)
    for turn in map(math.radians, degrees):
        light[(x * math.sin(turn) + y * math.cos(turn)) % 32 < 3] = 20
    return np.repeat(light[..., None], 3, -1).astype(np.float32)


@pytest.mark.parametrize(
    ("degrees", "sheared"),
    [((27,), True), ((0, 60), True), ((27, 90), True), ((0, 90), False), ((45, -45), False), ((0, 60, -60), False),
     ((0, 90, 30), False)],
)  # fmt: skip
def test_lines_that_cross_the_cells_obliquely_are_of_the_surface_only_if_mirrored(degrees, sheared):
    lattice = SlantedLattice(np.zeros(2), np.full(2, 128.0), 32 * np.eye(2))
    corners = np.array([[0, 0], [256, 0], [256, 256], [0, 256]], float)
    assert is_sheared(lines(*degrees), lattice, corners, (8, 8)) is sheared


def test_a_photo_without_a_lattice_asks_for_corners():
    with pytest.raises(errors.ImageError, match="corners=x,y"):
        filters.rectify(buffer(pictures.moss(96, 96, 1)))


@pytest.mark.parametrize(
    ("corners", "text"),
    [
        ((1, 2, 3), "eight numbers"),
        ((0, 0, 9, 9, 9, 0, 0, 9), "top left, top right, bottom right, bottom left"),
        ((0, 0, 0, 9, 9, 9, 9, 0), "top left, top right"),  # counterclockwise
        ((0, 0, 5, 0, 9, 0, 0, 9), "top left, top right"),  # three on a line
        ((0, 0, 1e-9, 0, 1e-9, 1e-9, 0, 1e-9), "top left, top right"),  # without a shape
        ((20, 0, 40, 0, 40, 9, 20, 9), "shows: x from 0 to 16, y from 0 to 16"),
        ((1e30, 0, 2e30, 0, 2e30, 1e30, 1e30, 1e30), "at most 65536 px a side"),
    ],
)
def test_what_is_no_rectangle_in_perspective_is_refused(corners, text):
    with pytest.raises(errors.ParameterError, match=text):
        filters.rectify(buffer(pictures.moss(16, 16, 1)), corners=corners)


def test_corners_in_order_are_taken_however_they_are_turned():
    corners = seen_corners((3.0, 2.0), 0.3, 0.2)
    for n in range(4):
        require_quadrangle(np.roll(corners, n, 0))


def test_ids_are_not_resampled():
    image = from_buffer(buffer(pictures.moss(16, 16, 1)))
    ids = replace(image, parts=(replace(image.first, exact=True),))
    with pytest.raises(errors.ImageError, match="cannot be resampled"):
        run(Rectify(source=ids, corners=(0, 0, 9, 0, 9, 9, 0, 9)), Session())


def test_a_window_reads_what_it_shows():
    """Of a photo of 16384 x 16384 a small window needs a small part, in a small budget."""
    asked: list[Window] = []

    def fetch(window: Window) -> np.ndarray:
        asked.append(window)
        return np.full((window.height, window.width, 3), 128, np.uint8)

    photo = Image((Part("photo", oiio.ImageSpec(16384, 16384, 3, oiio.UINT8), fetch, ready=True),))
    op = Rectify(source=photo, corners=(100, 50, 16000, 90, 15000, 16000, 300, 15000))
    part = made_by(op, Session(budget=64 << 20))["rectified"]
    assert asked == []
    assert (part.read(Window(8000, 8000, 8100, 8060)) == 128).all()
    assert sum(w.width * w.height for w in asked) < 200 * 200


def test_a_small_result_of_a_large_photo_fits_the_budget():
    """With the same bits: it is computed in smaller pieces."""
    gray = np.kron(pictures.smooth_noise(75, 100, 9, 1), np.ones((4, 4)))[..., None] * np.ones(3)
    corners = (50, 25, 390, 5, 395, 295, 5, 275)
    whole, pieces = (
        filters.rectify(buffer(gray), corners=corners, size=(61, 40), session=Session(budget=b << 20)) for b in (256, 1)
    )
    np.testing.assert_array_equal(pixels(whole), pixels(pieces))


def test_a_narrow_strip_has_no_lattice_and_nothing_else_is_said(capfd):
    strip = np.random.default_rng(1).random((48, 20000, 3), np.float32)
    assert slanted_lattice(strip) is None
    assert capfd.readouterr() == ("", "")
