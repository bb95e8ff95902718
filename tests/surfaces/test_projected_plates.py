# SPDX-License-Identifier: Apache-2.0
"""--texproject: the outline of a region does not show, and a plate lies where it was, whatever file held it."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from scipy.ndimage import distance_transform_edt, gaussian_filter

from oiiotex.engine.core.window import Window
from oiiotex.surfaces.capture.homography import through
from oiiotex.surfaces.motion.sampling import at_points, centers
from tests import pictures
from tests.conftest import load, oiiotex, save

HEIGHT, WIDTH, COUNT = 112, 144, 3
AT = centers(Window(0, 0, WIDTH, HEIGHT))


def pan(n: int) -> np.ndarray:
    return np.array([[1, 0, 0], [0, 1, 0], [60 + 9.3 * n, 40 - 3.6 * n, 1]])


def zoom(n: int) -> np.ndarray:
    return np.array([[1 - 0.08 * n, 0, 0], [0, 1 - 0.08 * n, 0], [50 + 6 * n, 45 + 4 * n, 1]])


def plane(n: int) -> np.ndarray:
    return np.array([[1, 0.02 * n, 4e-5 * n], [0.01 * n, 1.02, 8e-5 * n], [55 + 5.1 * n, 38 + 2.2 * n, 1]])


def still(points: np.ndarray, n: int) -> np.ndarray:
    """An object that lies on the surface."""
    return np.hypot(points[..., 0] - 128, points[..., 1] - 92) < 17


def moving(points: np.ndarray, n: int) -> np.ndarray:
    """An object that moves over the surface: some frames show what it hides in others."""
    return np.hypot(points[..., 0] - 118 - 9 * n, points[..., 1] - 92) < 17


SHOTS: dict[str, tuple[np.ndarray, Callable, Callable]] = {
    "pan": (pictures.moss(220, 280, 3), pan, still),
    "zoom": (pictures.moss(220, 280, 5), zoom, still),
    "plane": (pictures.pebbles(220, 280, 8), plane, moving),
}


def written(folder: Path, name: str, suffix: str, kind: str) -> None:
    """Frames with a red object, light that changes and grain; masks; and ST maps."""
    photo, matrix, covers = SHOTS[name]
    random = np.random.default_rng(1)
    for n in range(COUNT):
        points = through(matrix(n), AT.reshape(-1, 2)).reshape(AT.shape)
        frame = at_points(photo.astype(np.float32), points) * (0.9 + 0.05 * n)
        frame += gaussian_filter(random.normal(0, 0.012, frame.shape), (0.5, 0.5, 0))
        frame[covers(points, n)] = (0.8, 0.1, 0.1)
        save(np.clip(frame, 0, 1), folder / f"shot.{1001 + n}{suffix}", kind, "srgb_rec709_scene")
        mask = distance_transform_edt(~covers(points, n)) <= 2
        save(mask[..., None] * 1.0, folder / f"mask.{1001 + n}{suffix}", kind, "data")
        here = through(matrix(n) @ np.linalg.inv(matrix(0)), AT.reshape(-1, 2)).reshape(AT.shape)
        save(here / (WIDTH, HEIGHT), folder / f"st.{1001 + n}.exr", "float", "data")


def run(folder: Path, *words: str) -> None:
    done = oiiotex(*words, cwd=folder)
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="module")
def of_page(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, str], Path]:
    """The folder where a shot is cleaned by the lines of docs/how-to/fills-in-moving-shots.md; once for all tests."""

    @functools.cache
    def made(name: str, suffix: str) -> Path:
        folder = tmp_path_factory.mktemp(name)
        written(folder, name, suffix, "half" if suffix == ".exr" else "uint8")
        clean(folder, suffix)
        return folder

    return made


def clean(folder: Path, suffix: str) -> None:
    """Of each frame, with the motion given."""
    span = f"1001-{1000 + COUNT}"
    run(folder, f"shot.1001{suffix}", f"mask.1001{suffix}",
        f"--texplate:region=1:frames={span}:motion=st.1001.exr:motionfile=shot.npz",
        "--sisplit", "--texfill:iterations=3", "-o", f"clean{suffix}")  # fmt: skip
    run(folder, "--frames", span, f"shot.#{suffix}", f"clean{suffix}", f"mask.#{suffix}",
        "--texproject:region=1:motion=shot.npz", "-o", f"out.#{suffix}")  # fmt: skip


def jumps(frame: np.ndarray, mask: np.ndarray) -> tuple[float, float]:
    """Mean jumps of lightness across the outline of a mask, and 12 to 36 px around it."""
    light = frame[..., :3].mean(2)
    signed = np.where(mask, 0.5 - distance_transform_edt(mask), distance_transform_edt(~mask) - 0.5)
    across, around = [], []
    for axis in (0, 1):
        jump, first = np.abs(np.diff(light, axis=axis)), np.delete(signed, -1, axis)
        outline = first * np.delete(signed, 0, axis) < 0
        across.append(jump[outline])
        around.append(jump[(first > 12) & (first < 36)])
    return float(np.concatenate(across).mean()), float(np.concatenate(around).mean())


@pytest.mark.parametrize(("name", "suffix"), [("pan", ".exr"), ("zoom", ".exr"), ("plane", ".png")])
def test_the_outline_of_the_region_does_not_show(of_page, name: str, suffix: str):
    folder = of_page(name, suffix)
    pairs = [
        jumps(load(folder / f"out.{n}{suffix}"), load(folder / f"mask.{n}{suffix}")[..., 0] > 0.5)
        for n in range(1001, 1001 + COUNT)
    ]
    across, around = np.mean(pairs, 0)
    assert across <= 1.2 * around, across / around


def test_a_plate_lies_where_it_was_in_any_file(of_page):
    folder = of_page("pan", ".exr")
    again = "shot.1002.exr", "mask.1002.exr", "--texproject:region=1:motion=shot.npz:frame=1002:grain=0", "-o"
    for name in ("clean.exr", "clean.png", "clean.tif"):
        run(folder, "clean.exr", "-d", "uint16", "-o", name) if name != "clean.exr" else None
        run(folder, again[0], name, *again[1:], f"{name}.exr")
    for name in ("clean.png", "clean.tif"):
        np.testing.assert_allclose(load(folder / f"{name}.exr"), load(folder / "clean.exr.exr"), atol=2e-3)
    run(folder, "clean.exr", "--crop", "130x100+10+10", "-o", "part.exr")
    run(folder, again[0], "part.exr", *again[1:], "part.exr.exr")
    np.testing.assert_allclose(load(folder / "part.exr.exr"), load(folder / "clean.exr.exr"), atol=2e-3)


def test_a_plate_of_another_size_is_refused(of_page):
    folder = of_page("pan", ".exr")
    run(folder, "clean.exr", "--cut", "130x100+10+10", "-o", "cut.exr")
    frame, words = ("shot.1002.exr", "cut.exr", "mask.1002.exr"), "--texproject:region=1:motion=shot.npz:frame=1002"
    done = oiiotex(*frame, words, "-o", "x.exr", cwd=folder)
    width, height = oiio.ImageBuf(str(folder / "clean.exr")).spec().width, HEIGHT
    assert done.returncode == 1 and len(done.stderr.splitlines()) == 1
    assert f"plate cut.exr is 130x100: expected {width}x" in done.stderr and "the plate of shot.npz" in done.stderr
    done = oiiotex(*frame, "--texproject:region=1", "-o", "x.exr", cwd=folder)
    assert done.returncode == 1 and f"expected {WIDTH}x{height}, as the frame; set motion" in done.stderr
