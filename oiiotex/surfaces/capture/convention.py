# SPDX-License-Identifier: Apache-2.0
"""The convention of a normal map: whether green points up (OpenGL) or down (DirectX), measured.

The slopes of a surface have no curl: with the right sign of green, the slope to the right changes downwards as the
slope down changes to the right. A wrong sign makes the two opposite. Heights, where there are any, tell more: their
differences are the slopes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from ...engine.color.config import as_float
from ...engine.core.demand import bands
from ...engine.core.image import Image, channels_of
from ...engine.deferred import np

_SCALES = (1, 3, 9)  # px, odd: compression hides the finest slopes, and little else is left in the coarsest
_STEEPEST = 8.0  # slopes are clipped to this
_SLOPE_STEPS, _HEIGHT_STEPS = 1 << 10, 1 << 14  # of a slope of 1, of the range: sums of integers, in any order
_LEAST = 0.25  # correlation that decides
_TURNED = 1.2  # least ratio to the correlations of the pure derivatives; they are larger in a map that was turned
_AGREE = 0.1  # least correlation of slopes with heights
_AGAINST = 0.1  # correlation of the other sign, at any scale, that leaves the convention open
_NOISE = 1e-3  # of a derivative's own variance: makes the matrix of correlations invertible


class Convention(NamedTuple):
    """The measured convention of a normal map.

    Attributes
    ----------
    hand : str
        'opengl' or 'directx'; '' if the map does not tell.
    by : str
        What tells: 'slopes', 'heights' or ''.
    no_curl : float
        Correlation of the mixed derivatives of the slopes, -1 to 1, where it is largest among three scales. Positive:
        OpenGL.
    agrees : (float, float) or None
        Correlation of the slopes along x, and up, with the heights, if there are any.
    """

    hand: str
    by: str
    no_curl: float
    agrees: tuple[float, float] | None = None

    @property
    def inverted(self) -> bool:
        """Whether the slopes along x are opposite to the heights."""
        return self.agrees is not None and self.agrees[0] < -_AGAINST

    @property
    def ratio(self) -> float:
        """The correlation that decides, positive for OpenGL."""
        if self.by != "heights" or self.agrees is None:
            return self.no_curl
        x, y = self.agrees
        return float(np.copysign(min(abs(x), abs(y)), x * y))


def convention_of(normal: Image, height: Image | None = None) -> Convention:
    """Measure the convention of a normal map, in bands.

    Parameters
    ----------
    normal : Image
        Two or three channels apart from alpha, from 0 to 1 or, if any is negative, from -1 to 1. Another number of
        channels tells nothing.
    height : Image, optional
        Heights; ignored if they have another size.
    """
    part = normal.first
    if len(channels_of(part.spec).color) not in (2, 3):
        return Convention("", "", 0.0)
    vectors = decoder(normal)
    if height is not None and height.first.window != part.window:
        height = None
    low, high = (0.0, 1.0) if height is None else limits(height)
    sums = {scale: np.zeros((8, 8)) for scale in _SCALES}
    for band in bands(part):
        around = band.grown(0, _reach(max(_SCALES))) & part.window
        layers = _slopes(np.nan_to_num(vectors(part.read(around))))
        if height is not None:
            raised = height.first.read(around)[..., channels_of(height.first.spec).first]
            layers.append(_steps((as_float(raised) - low) / max(high - low, 1e-12), _HEIGHT_STEPS))
        for scale, own in sums.items():
            inner = part.window.grown(0, -_reach(scale)) & band
            first = inner.top + (part.window.top - inner.top) % scale
            if first < inner.bottom and part.window.width >= 3 * scale:
                reach, start = _reach(scale), around.top
                rows = slice(first - reach - start, inner.bottom + reach - start)
                derived = _derivatives([layer[rows] for layer in layers], scale)
                own[: len(derived), : len(derived)] += derived @ derived.T
    return _decision(list(sums.values()), height is not None)


def decoder(normal: Image) -> Callable[[np.ndarray], np.ndarray]:
    """Function from pixels to vectors (height, width, 2 or 3), decoded from 0 to 1 unless a value is negative."""
    part = normal.first
    channels = list(channels_of(part.spec).color)

    def plain(rows: np.ndarray) -> np.ndarray:
        return as_float(rows[..., channels])

    encoded = all(float(plain(part.read(band)).min()) >= 0 for band in bands(part))
    return (lambda rows: 2 * plain(rows) - 1) if encoded else plain


def limits(image: Image) -> tuple[float, float]:
    """The smallest and the largest value of an image."""
    part, channels = image.first, list(channels_of(image.first.spec).color)
    found = [
        (float(seen.min()), float(seen.max()))
        for seen in (as_float(part.read(band)[..., channels]) for band in bands(part))
    ]
    return min(low for low, _ in found), max(high for _, high in found)


def _reach(scale: int) -> int:
    """Pixels around one that its derivatives at a scale take into account."""
    return (3 * scale - 1) // 2


def _steps(values: np.ndarray, count: int) -> np.ndarray:
    return np.asarray(np.rint(values * count).astype(np.int64))


def _slopes(vectors: np.ndarray) -> list[np.ndarray]:
    """Slopes to the right and down, in height per px, of OpenGL normals: int64 steps."""
    z = vectors[..., 2] if vectors.shape[2] == 3 else np.sqrt(np.maximum(0, 1 - (vectors**2).sum(-1)))
    over = np.maximum(z, np.float32(0.05))
    right, down = -vectors[..., 0] / over, vectors[..., 1] / over
    return [_steps(np.clip(each, -_STEEPEST, _STEEPEST), _SLOPE_STEPS) for each in (right, down)]


def _derivatives(layers: list[np.ndarray], scale: int) -> np.ndarray:
    """Derivatives of both slopes along x and y, the slopes and, if there are any, derivatives of heights: (4 to 8, n).

    Of means over squares of `scale` px, every `scale` px, times a constant. The values are integers below 2**19, so
    that their products add up without rounding.
    """
    means = [_box(layer, scale) for layer in layers]
    inside, steps = slice(scale, -scale), slice(None, None, scale)

    def along(values: np.ndarray, axis: int) -> np.ndarray:
        fore, back = slice(2 * scale, None), slice(None, -2 * scale)
        return values[inside, fore] - values[inside, back] if axis else values[fore, inside] - values[back, inside]

    derived = [along(one, axis) for one in means[:2] for axis in (1, 0)]
    if len(means) == 3:
        derived += [one[inside, inside] for one in means[:2]] + [along(means[2], axis) for axis in (1, 0)]
    return np.stack([each[steps, steps].ravel() for each in derived]).astype(float)


def _box(values: np.ndarray, scale: int) -> np.ndarray:
    """Sums over squares that lie within the array, divided by `scale`."""
    for axis in (0, 1):
        sums = np.insert(np.cumsum(values, axis), 0, 0, axis)
        fore, back = (
            np.take(sums, range(*ends), axis) for ends in ((scale, sums.shape[axis]), (0, sums.shape[axis] - scale))
        )
        values = fore - back
    return values // scale


def _decision(sums: list[np.ndarray], has_heights: bool) -> Convention:
    mixed, pure = np.transpose([_curl(each) for each in sums])
    no_curl = float(max(mixed, key=abs))
    consistent = (mixed * np.sign(no_curl)).min() > -_AGAINST and abs(mixed).sum() > _TURNED * abs(pure).sum()
    told = consistent and abs(no_curl) > _LEAST
    found, by, agrees = (_hand(no_curl), "slopes", None) if told else ("", "", None)
    if has_heights:
        x, y, crossed = max((_agreement(each) for each in sums), key=lambda one: min(abs(one[0]), abs(one[1])))
        agrees = x, y
        if min(abs(x), abs(y)) > max(_AGREE, _TURNED * crossed):  # inverted heights change both signs
            found, by = (_hand(x * y), "heights") if found in ("", _hand(x * y)) else ("", "")
    return Convention(found, by, no_curl, agrees)


def _hand(sign: float) -> str:
    return "opengl" if sign > 0 else "directx"


def _correlations(sums: np.ndarray) -> np.ndarray:
    sizes = np.sqrt(np.maximum(np.diag(sums), 1e-9))
    return np.asarray(sums / np.outer(sizes, sizes))


def _curl(sums: np.ndarray) -> tuple[float, float]:
    """Partial correlations of the mixed derivatives of the slopes, and of the pure ones.

    Partial: without what the other two derivatives explain. Compression and few bits mix red and green, so that
    slopes resemble each other in any direction, which says nothing about a surface.
    """
    inverse = np.linalg.inv(_correlations(sums[:4, :4]) + _NOISE * np.eye(4))
    own = np.sqrt(np.diag(inverse))
    partial = -inverse / np.outer(own, own)
    return float(partial[1, 2]), float(partial[0, 3])


def _agreement(sums: np.ndarray) -> tuple[float, float, float]:
    """Correlations of slopes and heights along x and y, and the largest one across."""
    alike = _correlations(sums)
    return float(alike[4, 6]), float(alike[5, 7]), float(max(abs(alike[4, 7]), abs(alike[5, 6])))
