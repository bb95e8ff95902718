# SPDX-License-Identifier: Apache-2.0
"""Relief from one photo's shading: heights whose slopes would shade a matt surface of one color as the photo is.

Of light from one direction, shading is the slope along it (Pentland, Linear shape from shading, IJCV 4, 1990); under an
overcast sky what is deep is dark (Langer and Zucker, Shape-from-shading on a cloudy day, JOSA A 11, 1994). Heights are
the integrable surface nearest to such slopes, in Fourier space (Frankot and Chellappa, A method for enforcing
integrability in shape from shading algorithms, PAMI 10(4), 1988).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..deferred import np

BYTES = 80  # of a pixel, padding included, while heights are made: 52 measured, and the photo in Lab
_ACROSS = 0.1  # weight of slopes across the light, which shading does not say, to those along it
_DEEP = 0.5  # of |w|, by which overcast shading is divided: between heights themselves (0) and slopes (1)
_SLOPES = 12.0  # times overcast shading: s; root mean square slope is s / (1 + s): .32 to .59, rendered .39 to .67
_DARKEST = 1e-4  # luminance that is not black
_BRIGHTEST = 3.0  # of shading: more is a highlight
_LIGHTEST = 1e6  # L, either way: 6e11 times white, whose sums are finite
_FINE = math.pi / 4  # radians a px, beyond which light is not asked for
_LEVEL = 10.0  # degrees
_DIRECTED = 1.4  # power along over across, from where light has a direction; 3 where relief has none


@dataclass(frozen=True)
class Relief:
    """Heights that a photo's shading says.

    `light`: where light was taken to come from, degrees counterclockwise from the right; None: an overcast sky.
    """

    heights: np.ndarray  # (height, width) float32: px, 0 on the average; larger is nearer
    light: float | None


def padded_size(size: tuple[int, int], sigma: float, wraps: tuple[bool, bool]) -> tuple[int, int]:
    """Rows and columns that are transformed, of (rows, columns) that wrap along y, along x."""
    from scipy.fft import next_fast_len  # scipy is not loaded before it is needed

    rows, columns = (
        n if wrap else next_fast_len(n + 2 * math.ceil(2 * min(sigma, n)), real=True)
        for n, wrap in zip(size, wraps, strict=True)
    )
    return rows, columns


def relief(
    luminance: np.ndarray,
    opaque: np.ndarray | None,
    sigma: float,
    light: float | None,
    overcast: bool,
    elevation: float,
    wraps: tuple[bool, bool],
) -> Relief:
    """Heights from shading.

    Parameters
    ----------
    luminance : (height, width) float32
        Linear; only ratios count.
    opaque : (height, width) bool or None
        Pixels that count, one at least; None: all.
    sigma : float
        px; what is larger is color or uneven light, and no relief.
    light : float or None
        Degrees counterclockwise from the right; None: as the shading itself says, from above rather than below.
    overcast : bool
        Light has no direction.
    elevation : float
        Of the light over the surface, degrees.
    wraps : (bool, bool)
        The photo is a torus along y, along x.
    """
    shape = padded_size(luminance.shape, sigma, wraps)
    wy, wx = 2 * np.pi * np.fft.fftfreq(shape[0])[:, None], 2 * np.pi * np.fft.rfftfreq(shape[1])[None]
    shading = _shading(luminance, opaque, sigma, shape, wy, wx)
    square = wx * wx + wy * wy
    if light is None and not overcast:
        light = light_of(shading[: luminance.shape[0], : luminance.shape[1]])
    spectrum = np.fft.rfft2(shading)
    if light is None:
        square[0, 0] = 1.0
        heights = np.fft.irfft2(spectrum / square ** (_DEEP / 2), shape)
        slopes = np.fft.irfft2(spectrum * square ** (0.5 - _DEEP / 2), shape)
        steep = _SLOPES * float(np.sqrt((shading**2).mean()))
        steep = steep / (1 + steep)
        heights *= steep / max(float(np.sqrt((slopes**2).mean())), 1e-12)
    else:
        # p cos t + q sin t = -shading / tan(slant): y is down, angles go up
        toward = math.radians(light)
        along = 1j * (wx * math.cos(toward) - wy * math.sin(toward))
        slope = -spectrum * math.tan(math.radians(elevation))
        heights = np.fft.irfft2(integrated(slope, along, square), shape)
    heights = heights[: luminance.shape[0], : luminance.shape[1]].astype(np.float32)
    seen = heights if opaque is None else heights[opaque]
    return Relief(heights - seen.mean(dtype=np.float64).astype(np.float32), light)


def integrated(slope: np.ndarray, along: np.ndarray, square: np.ndarray) -> np.ndarray:
    """The spectrum of the surface nearest to slopes along one direction (Frankot and Chellappa 1988).

    The nearest by their weighted norm: slopes along the direction count once, all others, which would be 0, `_ACROSS`.

    `slope` (height, columns) complex128; `square` (height, columns) float64.
    """
    weight = np.abs(along) ** 2 + _ACROSS * square
    weight[0, 0] = 1.0
    return np.conj(along) * slope / weight


def light_of(shading: np.ndarray) -> float | None:
    """Where light comes from, by the direction along which shading has most power; None where none stands out.

    Relief without a direction of its own, lit from one side, has three times the power along the light as across
    (Knill, Estimating illuminant direction and degree of surface relief, JOSA A 7, 1990). The two ends cannot be told
    apart: the upper one is taken, of two at about the same height the left one, as people do.

    `shading` (height, width) float64.
    """
    tapers = [np.sin(np.pi * (np.arange(n) + 0.5) / n) for n in shading.shape]
    spectrum = np.fft.rfft2(shading * tapers[0][:, None] * tapers[1][None])
    wy, wx = (
        2 * np.pi * np.fft.fftfreq(shading.shape[0])[:, None],
        2 * np.pi * np.fft.rfftfreq(shading.shape[1])[None],
    )
    square = wx * wx + wy * wy
    # near the limit of the grid slopes are seen less along its axes
    power = np.where(square < _FINE**2, np.abs(spectrum) ** 2 / np.where(square > 0, square, 1.0), 0.0)
    xx, yy, xy = (float((power * term).sum()) for term in (wx * wx, wy * wy, wx * wy))
    middle, away = (xx + yy) / 2, math.hypot((xx - yy) / 2, xy)
    if middle + away < _DIRECTED * (middle - away) or away == 0:
        return None
    angle = math.degrees(math.atan2(-xy, (xx - yy) / 2)) / 2 % 180  # y is down
    return angle if angle >= _LEVEL else angle + 180


def _shading(
    luminance: np.ndarray,
    opaque: np.ndarray | None,
    sigma: float,
    shape: tuple[int, int],
    wy: np.ndarray,
    wx: np.ndarray,
) -> np.ndarray:
    """Luminance over what is seen of it through a Gaussian, less 1; 0 in what is padded. (rows, columns) float64."""
    passes = np.exp(-0.5 * sigma**2 * wy**2) * np.exp(-0.5 * sigma**2 * wx**2)

    def seen(values: np.ndarray) -> np.ndarray:
        return np.fft.irfft2(np.fft.rfft2(values, shape) * passes, shape)[: values.shape[0], : values.shape[1]]

    weight = np.ones(luminance.shape) if opaque is None else opaque.astype(np.float64)
    values = np.where(weight > 0, np.maximum(luminance, 0), 0).astype(np.float64)
    mean = seen(values) / np.maximum(seen(weight), 1e-6)
    light = np.maximum(mean, _DARKEST)
    # less than 1 is taken off where all is black, which has no shading
    shading = np.where(weight > 0, np.clip(values / light - np.minimum(mean / light, 1), -1, _BRIGHTEST), 0)
    for axis, (n, wide) in enumerate(zip(luminance.shape, shape, strict=True)):
        if wide > n:  # mirrored beyond both ends, fading, where a transform that wraps has its seam
            behind = np.arange(wide - n)
            fade = 0.5 + 0.5 * np.cos(2 * np.pi * (behind + 0.5) / (wide - n))
            near_end = behind < (wide - n) // 2
            at = np.where(near_end, n - 1 - behind, wide - n - 1 - behind) % n
            fade = np.expand_dims(fade, 1 - axis)
            shading = np.concatenate([shading, np.take(shading, at, axis) * fade], axis)
    return shading


def luminance(lightness: np.ndarray) -> np.ndarray:
    """Linear luminance, 1 of white, of CIE L; float32. It is finite also where L is not."""
    lightness = np.clip(lightness, np.float32(-_LIGHTEST), np.float32(_LIGHTEST))
    root = (lightness + np.float32(16)) / np.float32(116)
    return np.where(lightness > 8, root * root * root, lightness * np.float32(27 / 24389))


def normals_of(heights: np.ndarray, wraps: tuple[bool, bool]) -> np.ndarray:
    """Unit normals of heights in px: (height, width, 3) float32; x right, y up (OpenGL), z towards who looks.

    Parameters
    ----------
    heights : (height, width) float32
    wraps : (bool, bool)
        It is a torus along y, along x; else slopes at the border are those of one side.
    """
    slopes = []
    for axis, wrap in enumerate(wraps):
        if wrap:
            slopes.append((np.roll(heights, -1, axis) - np.roll(heights, 1, axis)) / 2)
        else:
            slopes.append(np.gradient(heights, axis=axis) if heights.shape[axis] > 1 else np.zeros_like(heights))
    down, right = slopes
    normals = np.stack([-right, down, np.ones_like(heights)], -1)
    return (normals / np.linalg.norm(normals, axis=-1, keepdims=True)).astype(np.float32)
