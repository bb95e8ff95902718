# SPDX-License-Identifier: Apache-2.0
"""The lights of several photos of one surface: read from a file, or seen on a ball.

Directions: x right, y up, z towards the camera. Positions have the same axes; their origin is the middle of the photo.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ...engine.core.window import Window
from ...engine.deferred import np
from ...engine.errors import ImageError, ParameterError
from ...engine.io.documents import read_document, read_text

_INDEPENDENT = 0.15  # least third singular value of unit directions, relative to the root of their number
_SPARKLE = 0.9  # of the brightest pixel of a chrome ball: its highlight
_LIT = 0.2  # of the brightest pixel of a matte ball: its lit side
_MATTE = 0.15  # least share of a matte ball that is half as bright as its brightest pixel


@dataclass(frozen=True)
class Lights:
    """Lights of n photos.

    `vectors`: (n, 3) float64, unit directions; positions if `unit` is not None.
    `unit`: length of a pixel in the unit of the positions.
    `middle`: (x, y) of the origin of positions, px.
    `known`: given or seen on a ball, not found from the photos.
    `intensities`: (n,) float64; the matte white that faces a light of 1 at the middle is 1.
    """

    vectors: np.ndarray
    unit: float | None = None
    middle: tuple[float, float] = (0.0, 0.0)
    intensities: np.ndarray | None = None
    known: bool = True

    @property
    def directions(self) -> np.ndarray:
        """Unit vectors from the middle of the photo, (n, 3) float64."""
        found: np.ndarray = self.vectors / np.linalg.norm(self.vectors, axis=1, keepdims=True)
        return found

    def at(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Unit vectors towards the lights (n, 3, pixels or 1), and their light (n, pixels or 1), at places in px."""
        power = (np.ones(len(self.vectors)) if self.intensities is None else self.intensities)[:, None]
        if self.unit is None:
            return self.directions[..., None].astype(np.float32), power.astype(np.float32)
        right, up = (x - self.middle[0]) * self.unit, (self.middle[1] - y) * self.unit
        away = self.vectors[..., None] - np.stack([right, up, np.zeros_like(right)])
        square = away[:, 0] ** 2 + away[:, 1] ** 2 + away[:, 2] ** 2
        falloff = (self.vectors**2).sum(1)[:, None] / square
        return (away / np.sqrt(square)[:, None]).astype(np.float32), (power * falloff).astype(np.float32)


def read_lights(given: Path | Sequence[float], names: Sequence[str]) -> np.ndarray:
    """Vectors of lights in the order of the photos, (n, 3) float64.

    Parameters
    ----------
    given : Path or numbers
        Three numbers for each photo, or a file: JSON, a list of three numbers for each photo or an object of them by
        the photo's name; or a list of lines `NAME X Y Z` (.lp, as for RTI), which a line with their number may precede.
    names : sequence of str
        The photos' file names. If the file names all of them, its order does not matter.

    Raises
    ------
    ImageError, ParameterError
        The file is damaged or has another number of lights; vectors of length 0, below the surface, or in one plane.
    """
    if not isinstance(given, Path):
        labels, vectors = [""] * (len(given) // 3), np.array(given[: len(given) // 3 * 3], np.float64).reshape(-1, 3)
        subject = "lights"
        whole = len(given) % 3 == 0
    else:
        labels, rows = _document(given) if given.suffix.lower() == ".json" else _lines(given)
        subject, whole = str(given), all(len(row) == 3 for row in rows)
        vectors = np.array(rows if whole else [], np.float64).reshape(-1, 3)
    stems = [Path(name).stem for name in names]
    found = {Path(label).stem: vector for label, vector in zip(labels, vectors, strict=False)}
    if set(stems) <= set(found):
        vectors = np.array([found[stem] for stem in stems])
    if not whole or len(vectors) != len(names):
        raise ImageError(f"{subject}: {len(vectors)} lights: expected x, y and z for each of {len(names)} photos")
    require_lights(vectors, subject)
    return vectors


def require_lights(vectors: np.ndarray, subject: str) -> None:
    """Raise an error unless the lights (n, 3) are above the surface and not in one plane with each other."""
    if not (np.isfinite(vectors).all() and (vectors[:, 2] > 0).all() and (np.abs(vectors) < 1e9).all()):
        raise ImageError(f"{subject}: a light is not in front of the surface: expected z > 0")
    unit = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    if np.linalg.svd(unit, compute_uv=False)[-1] < _INDEPENDENT * np.sqrt(len(unit)):
        hint = "light the surface from at least three sides"
        raise ImageError(f"{subject}: the lights are nearly in one plane", hint=hint)


def _document(path: Path) -> tuple[list[str], list[Sequence[float]]]:
    """Names and vectors of a JSON file; names are empty in a list."""
    document = read_document(path)
    named = document if isinstance(document, dict) else dict(enumerate(document if isinstance(document, list) else []))
    for vector in named.values():
        if not isinstance(vector, list) or not all(isinstance(n, (int, float)) for n in vector):
            raise ImageError(f"{path}: expected lists of three numbers")
    return [key if isinstance(key, str) else "" for key in named], list(named.values())


def _lines(path: Path) -> tuple[list[str], list[Sequence[float]]]:
    """Names and vectors of lines `NAME X Y Z`."""
    lines = [line.split() for line in read_text(path).splitlines() if line.strip()]
    if lines and len(lines[0]) == 1:  # their number
        lines = lines[1:]
    try:
        return [" ".join(line[:-3]) for line in lines], [[float(word) for word in line[-3:]] for line in lines]
    except ValueError as error:
        raise ImageError(f"{path}: expected lines of a name and three numbers") from error


def ball_box(text: str, whole: Window) -> Window:
    """The box of a ball, WxH+X+Y, which must lie in the photo and be nearly square."""
    match = re.fullmatch(r"(\d{1,6})x(\d{1,6})([+-]\d{1,7})([+-]\d{1,7})", text)
    box = match and Window.sized(int(match[3]), int(match[4]), int(match[1]), int(match[2]))
    if not box or box & whole != box or min(box.size) < 16 or max(box.size) > 1.2 * min(box.size):
        expected = f"WxH+X+Y, the box around a ball, at least 16x16 and inside {whole}"
        raise ParameterError(parameter="ball", value=text, expected=expected)
    return box


def _sphere(size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Normals (height, width, 3) of a ball that fills a box of (width, height), and where it is."""
    width, height = size
    y, x = np.indices((height, width))
    right, up = (x + 0.5) * 2 / width - 1, 1 - (y + 0.5) * 2 / height
    square = right**2 + up**2
    return np.stack([right, up, np.sqrt(np.maximum(1 - square, 0))], -1), square < 1


def on_ball(luminance: np.ndarray) -> np.ndarray:
    """The direction of the light on a ball, (height, width) linear, that fills its box; (3,) float64.

    A ball is chrome if only few of its pixels are bright.
    """
    normals, inside = _sphere(luminance.shape[::-1])
    brightest = luminance[inside].max()
    if (luminance[inside] > brightest / 2).mean() < _MATTE:
        normal = normals[inside & (luminance >= _SPARKLE * brightest)].mean(0)
        normal /= np.linalg.norm(normal)
        light = 2 * normal[2] * normal - [0, 0, 1]  # the camera sees it by reflection
    else:
        lit = inside & (normals[..., 2] > 0.2) & (luminance > _LIT * brightest)
        light = np.linalg.lstsq(normals[lit], luminance[lit], rcond=None)[0]
    unit: np.ndarray = light / np.linalg.norm(light)
    return unit
