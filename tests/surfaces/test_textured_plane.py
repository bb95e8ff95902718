# SPDX-License-Identifier: Apache-2.0
"""Perspective by the texture alone, against a camera that the tests make; and the line that straightens the photo."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from oiiotex.engine.core.demand import MadeRows, resized
from oiiotex.engine.core.image import from_buffer, from_pixels
from oiiotex.engine.errors import ParameterError
from oiiotex.filters.texstationarize import Stationarize
from oiiotex.surfaces.capture import front_rectangle as found
from oiiotex.surfaces.capture.front_rectangle import SIDE, FrontRectangle, front_rectangle
from oiiotex.surfaces.capture.homography import through
from oiiotex.surfaces.capture.plane_rectangle import plane_rectangle
from oiiotex.surfaces.capture.slanted_lattice import SlantedLattice, slanted_lattice
from oiiotex.surfaces.capture.textured_plane import textured_plane
from oiiotex.synthesis.exemplar import synthesis_run
from oiiotex.synthesis.quality.fidelity import FAIR, GOOD
from tests import pictures
from tests.any_filter import buffer
from tests.conftest import made_by, oiiotex, save
from tests.surfaces.test_rectify import SHOT, shot, wall

VIEWS = (0.5, 0.1), (0.5, 0.4), (-0.4, -0.6), (0.0, -0.7)  # radians


def ashlar(side: int = 480) -> np.ndarray:
    """Stones of random widths in courses of random heights: no lattice."""
    random, gray, top = np.random.default_rng(1), np.full((side, side), 0.1), 0
    while top < side:
        height, left = int(random.integers(10, 22)), -int(random.integers(0, 20))
        while left < side:
            width = int(random.integers(14, 44))
            stone = np.s_[top : top + height - 2, max(0, left) : max(0, left + width - 2)]
            gray[stone] = random.uniform(0.35, 0.75)
            left += width
        top += height
    return np.repeat((gray + random.normal(0, 0.02, gray.shape))[..., None], 3, -1).astype(np.float32)


def vanishing_of(matrix: np.ndarray) -> np.ndarray:
    """l of the camera, times the photo's sides."""
    inverse = np.linalg.inv(matrix)
    return inverse[:2, 2] / (np.array([SHOT[0] / 2, SHOT[1] / 2, 1]) @ inverse)[2] * SHOT


@pytest.mark.parametrize("picture", [wall, ashlar])
@pytest.mark.parametrize(("turn", "nod"), VIEWS)
def test_the_vanishing_line_is_that_of_the_camera(picture, turn, nod):
    seen, matrix = shot(picture(), turn, nod)
    plane = textured_plane(100 * seen)
    np.testing.assert_allclose(plane.vanishing * SHOT, vanishing_of(matrix), atol=0.12)
    assert plane.explained > 0.3 and plane.ratio > 1.5


@pytest.mark.parametrize("picture", [wall, ashlar])
def test_seen_from_the_front_there_is_none(picture):
    assert textured_plane(100 * shot(picture(), 0.0, 0.0)[0]) is None


def test_seen_a_little_obliquely_there_is_hardly_any():
    """It is found, with a ratio of scales of 1.1, and is not worth straightening."""
    assert textured_plane(100 * shot(wall(), 0.0, -0.15)[0]) is None


def test_sizes_that_change_otherwise_prove_nothing():
    """Blobs that become larger to one side, as drops and waves do, or from place to place, as cracks do."""
    fine, coarse = (pictures.smooth_noise(240, 320, cells, 1) for cells in (40, 12))
    down, right = np.linspace(0, 1, 240)[:, None], np.linspace(0, 1, 320)[None]
    places = (np.random.default_rng(seed).random((3, 4)) for seed in (2, 5))  # a plane explains some of them
    for share in (down, 1 - down, right, *(np.kron(one, np.ones((80, 80))) for one in places)):
        assert textured_plane(np.float32(100) * ((1 - share) * fine + share * coarse)[..., None].repeat(3, 2)) is None


def test_stones_of_two_sizes_prove_nothing():
    small, share = ashlar(), np.kron(np.random.default_rng(4).random((3, 4)) < 0.5, np.ones((80, 80)))[..., None]
    large = resized(small[:240, :240], 480, 480)
    assert textured_plane(np.float32(100) * np.where(share > 0, large[:240, :320], small[:240, :320])) is None


@pytest.mark.parametrize("what", ["nothing", "a dot", "a corner"])
def test_objects_on_a_plain_background_show_nothing(what):
    """Of l that moves all but few places out of sight, the rest is alike."""
    y, x = np.mgrid[:240, :320]
    shown = {"nothing": x < 0, "a dot": np.hypot(x - 100, y - 60) < 9, "a corner": (x < 60) & (y < 50)}[what]
    light = 40 + 40 * shown + np.random.default_rng(1).normal(0, 0.1, x.shape) * (what == "a dot")
    assert textured_plane(np.repeat(light[..., None], 3, -1).astype(np.float32)) is None


def test_too_few_valid_pixels_show_nothing():
    seen = 100 * shot(ashlar(), 0.0, -0.7)[0]
    opaque = np.zeros(seen.shape[:2], bool)
    assert textured_plane(seen, opaque) is None
    assert textured_plane(seen[:90]) is None
    opaque[:, 20:] = True
    assert textured_plane(seen, opaque) is not None


@pytest.mark.parametrize(("turn", "nod"), VIEWS)
def test_the_rectangle_lies_along_the_joints_and_inside_the_photo(turn, nod):
    seen, matrix = shot(ashlar(), turn, nod)
    corners, (width, height) = plane_rectangle(100 * seen, vanishing_of(matrix) / SHOT)
    assert (corners >= -0.01).all() and (corners <= np.array(SHOT) + 0.01).all()
    sides = np.roll(real := through(np.linalg.inv(matrix), corners), -1, 0) - real
    assert np.abs(np.degrees(np.arctan2(sides[[0, 2], 1], sides[[0, 2], 0]))[0]) < 4  # the courses
    lengths = np.linalg.norm(sides, axis=1)
    assert lengths[0] / lengths[1] == pytest.approx(width / height, rel=0.25)  # by the usual lens
    x, y = corners.T
    assert width * height == pytest.approx(abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2, rel=0.1)


@pytest.mark.parametrize("picture", [wall, ashlar])
def test_large_photos_are_read_by_rows(picture, monkeypatch):
    """As they are when they exceed the memory budget: the rectangle is that of the reduced photo."""
    photo = 100 * shot(picture(), 0.0, -0.7)[0]
    height, width = (round(1.5 * SIDE / max(SHOT) * n) for n in photo.shape[:2])
    large, most = resized(photo, width, height), 0
    searched: list[np.ndarray] = []
    lattice = slanted_lattice(photo) if picture is wall else None  # it has none: the map further below
    if lattice is not None:  # searched in the small photo, which takes a fourth of the time, and only once
        scale = SIDE / max(SHOT)
        lattice = SlantedLattice(lattice.vanishing / scale, lattice.middle * scale, lattice.cell * scale)

    def search(values: np.ndarray, _: np.ndarray | None) -> SlantedLattice | None:
        searched.append(values)
        return lattice

    def read(first: int, last: int) -> np.ndarray:
        nonlocal most
        most = max(most, last - first)
        return large[first:last]

    monkeypatch.setattr(found, "slanted_lattice", search)
    opaque = np.ones((height, width), bool)
    seen = front_rectangle(MadeRows(large.shape, np.dtype(np.float32), read), opaque, oblique=True)
    small = front_rectangle(resized(photo, SIDE, round(SIDE * height / width)), oblique=True)
    assert 0 < most < height and (seen.cells is None) is (picture is ashlar)
    assert searched[0].shape == searched[1].shape and np.abs(searched[0] - searched[1]).mean() < 0.5
    np.testing.assert_allclose(seen.corners, 1.5 * small.corners, atol=2)
    assert seen.cells == small.cells and seen.plane.explained == pytest.approx(small.plane.explained, abs=0.02)
    if small.size is not None:
        np.testing.assert_allclose(seen.size, 1.5 * np.array(small.size), rtol=0.01)


def test_without_a_lattice_the_found_corners_can_be_said_for_the_next_map(tmp_path):
    save(shot(ashlar(), -0.4, -0.6)[0], tmp_path / "photo.exr", "half", "lin_rec709_scene")
    done = oiiotex("photo.exr", "--texrectify", "-o", "front.exr", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    line = next(one for one in done.stdout.splitlines() if one.startswith("corners="))
    again = oiiotex("photo.exr", f"--texrectify:{line}", "-o", "again.exr", cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    front, again = (oiio.ImageBuf(str(tmp_path / f"{n}.exr")) for n in ("front", "again"))
    np.testing.assert_array_equal(front.get_pixels(), again.get_pixels())


def test_cells_that_are_not_there_have_no_meters(monkeypatch):
    corners = np.array([[1, 2], [30, 2], [31, 40], [0, 41.0]])
    monkeypatch.setattr(found, "front_rectangle", lambda *_: FrontRectangle(corners, size=(30, 39)))
    photo = buffer(pictures.moss(48, 48, 1), space="lin_rec709_scene")
    front = filters.rectify(photo)
    assert (front.spec().width, front.spec().height) == (30, 39)
    assert filters.rectify(photo, size=(20, 10)).spec().width == 20
    with pytest.raises(ParameterError, match="corners as well, because the photo has no lattice"):
        filters.rectify(photo, meters=(1, 1))


def said(photo: np.ndarray, fidelity: float, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch) -> list:
    """Levels and texts of the hints for a tile of that fidelity."""
    spec = oiio.ImageSpec(8, 8, 3, oiio.FLOAT)
    spec.attribute("oiiotex:fidelity", f"{fidelity:.3f}")
    tile = {"tile": from_pixels("tile", np.zeros((8, 8, 3), np.float32), spec)}
    monkeypatch.setattr(synthesis_run, "synthesized", lambda *_: tile)
    op = Stationarize(exemplar=from_buffer(buffer(photo, space="lin_rec709_scene")))
    with caplog.at_level(logging.INFO, "oiiotex"):
        caplog.clear()
        made_by(op)
    return [(one.levelno, one.getMessage()) for one in caplog.records if "--texrectify" in one.getMessage()]


def test_it_is_said_of_oblique_photos_with_the_line_that_straightens_them(caplog, monkeypatch):
    corners, search = np.array([[1, 2], [30, 2], [31.25, 40], [0, 41]]), front_rectangle

    known: dict[bytes, FrontRectangle | None] = {}

    def placed(values: np.ndarray, *opaque: np.ndarray, oblique: bool) -> FrontRectangle | None:
        key = np.asarray(values).tobytes()
        if key not in known:
            known[key] = search(values, *opaque, oblique=oblique)
        return known[key] and replace(known[key], corners=corners, size=(30, 39))

    monkeypatch.setattr(found, "front_rectangle", placed)
    monkeypatch.setattr(found, "slanted_lattice", lambda *_: None)  # these stones have none, which takes seconds to see
    oblique, front = (shot(ashlar(), 0.0, nod)[0] for nod in (-0.7, 0.0))
    for fidelity, level in ((FAIR - 0.1, logging.WARNING), (FAIR + 0.05, logging.INFO), (GOOD + 0.05, logging.INFO)):
        ((told, text),) = said(oblique, fidelity, caplog, monkeypatch)
        assert told == level
        assert text.endswith("straighten it first: --texrectify:corners=1,2,30,2,31.25,40,0,41:size=30x39")
    assert said(front, FAIR - 0.1, caplog, monkeypatch) == []
