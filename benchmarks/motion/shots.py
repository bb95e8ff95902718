# SPDX-License-Identifier: Apache-2.0
"""Synthetic shots of a photographed surface with an object to remove; all of their motion is known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from scipy.ndimage import binary_dilation, gaussian_filter

from oiiotex.surfaces.motion.sampling import at_points, reduced

WIDTH, HEIGHT, FIRST = 480, 270, 1001
GRAIN = 0.02  # deviation, before a blur of half a pixel
LIGHT = 0.06  # how much the light goes up and down
SIDE = 1024  # px of the photo


@dataclass(frozen=True)
class Frame:
    """A frame with the mask of its object."""

    number: int
    matrix: np.ndarray  # frame to photo, row vectors
    pixels: np.ndarray
    mask: np.ndarray  # bool


def pan(t: float) -> np.ndarray:
    """A pan that ends half a frame away, with a little sway."""
    return np.array([[1, 0, 0], [0, 1, 0], [190 + 250 * t, 330 + 14 * np.sin(5 * t), 1.0]])


def zoom(t: float) -> np.ndarray:
    """A zoom in by 1.6, toward a point off center."""
    s = 1.6 ** (0.5 - t)
    return np.array([[s, 0, 0], [0, s, 0], [500 - 225 * s, 500 - 130 * s, 1.0]])


def plane(t: float) -> np.ndarray:
    """A tilted plane seen by a camera that moves sideways, closer, and rolls: near parts move more than far ones."""
    focal, roll, tilt = 420.0, 0.10 * (t - 0.5), 0.62
    turn = np.array([[np.cos(roll), -np.sin(roll), 0], [np.sin(roll), np.cos(roll), 0], [0, 0, 1]])
    lean = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    eye = np.array([90.0 * (t - 0.5), 25 * t, 470 - 60 * t])
    columns = np.stack([lean @ (1, 0, 0), lean @ (0, 1, 0), -lean @ np.zeros(3) + (0, 0, 0)], 1)
    columns[:, 2] = (-eye[0], -eye[1], eye[2])
    seen = np.array([[focal, 0, WIDTH / 2], [0, focal, HEIGHT / 2], [0, 0, 1]]) @ turn @ columns
    back = np.linalg.inv(seen).T  # plane coordinates by row vectors
    return back @ np.array([[1, 0, 0], [0, 1, 0], [SIDE / 2, SIDE / 2, 1.0]])


def travel(t: float) -> np.ndarray:
    """A pan and a zoom in by 1.4 at once, with a little sway."""
    s = 1.4 ** (0.5 - t)
    return np.array([[s, 0, 0], [0, s, 0], [430 + 140 * t - 240 * s, 490 + 14 * np.sin(5 * t) - 135 * s, 1.0]])


MOTIONS: dict[str, Callable[[float], np.ndarray]] = {"pan": pan, "zoom": zoom, "plane": plane, "travel": travel}


def places(matrix: np.ndarray, height: int = HEIGHT, width: int = WIDTH) -> np.ndarray:
    """Where each pixel center of a frame lies through a matrix, (height, width, 2)."""
    x, y = np.arange(width) + 0.5, np.arange(height) + 0.5
    seen = x[None, :, None] * matrix[0] + y[:, None, None] * matrix[1] + matrix[2]
    return seen[..., :2] / seen[..., 2:]


def object_at(points: np.ndarray) -> np.ndarray:
    """The object on the surface: a disc, and a cable that runs out of the first frames' view. Points in the photo."""
    x, y = points[..., 0], points[..., 1]
    disc = np.hypot(x - 500, y - 480) < 48
    return disc | (np.abs(y - 500 - 12 * np.sin(x / 90)) < 9)


def photo_named(path: Path) -> np.ndarray:
    """A photo, (SIDE, SIDE, 3) float32, sRGB values 0 to 1."""
    buffer = oiio.ImageBuf(str(path))
    pixels = buffer.get_pixels(oiio.FLOAT)[..., :3]
    side = min(pixels.shape[:2])
    pixels = np.ascontiguousarray(pixels[:side, :side])
    return pixels if side == SIDE else reduced(pixels, SIDE, SIDE)


def rendered(photo: np.ndarray, motion: str, count: int, seed: int) -> list[Frame]:
    """The frames of a shot: 2 x 2 samples a pixel, light that changes, and grain."""
    random, frames = np.random.default_rng(seed), []
    for n in range(count):
        matrix = MOTIONS[motion](n / (count - 1))
        fine = np.diag([0.5, 0.5, 1]) @ matrix
        points = places(fine, 2 * HEIGHT, 2 * WIDTH)
        samples = at_points(photo, points)
        samples[object_at(points)] = (0.85, 0.1, 0.12)
        pixels = samples.reshape(HEIGHT, 2, WIDTH, 2, 3).mean((1, 3)) * (1 + LIGHT * np.sin(1.1 * n))
        noise = gaussian_filter(random.normal(0, GRAIN, pixels.shape), (0.5, 0.5, 0)).astype(np.float32)
        mask = binary_dilation(object_at(places(matrix)), iterations=4)
        frames.append(Frame(FIRST + n, matrix, (0.9 * pixels + 0.03 + noise).astype(np.float32), mask))
    return frames


def save(path: Path, pixels: np.ndarray, space: str = "srgb_rec709_scene") -> None:
    """Write pixels, (h, w, c) float32."""
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], oiio.FLOAT)
    spec.attribute("oiio:ColorSpace", space)
    buffer = oiio.ImageBuf(spec)
    buffer.set_pixels(buffer.roi, np.ascontiguousarray(pixels, np.float32))
    if not buffer.write(str(path)):
        raise OSError(buffer.geterror())
