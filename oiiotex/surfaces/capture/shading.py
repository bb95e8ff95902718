# SPDX-License-Identifier: Apache-2.0
"""Relief from the shading of one photo, for a matte surface of uniform color.

Under directional light, shading is the slope along the light (Pentland, Linear shape from shading, IJCV 4, 1990). Under
an overcast sky recesses are dark (Langer and Zucker, Shape-from-shading on a cloudy day, JOSA A 11, 1994). Heights are
the integrable surface closest to these slopes, in Fourier space (Frankot and Chellappa, A method for enforcing
integrability in shape from shading algorithms, PAMI 10(4), 1988).
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

from ...engine.deferred import np

BYTES = 80  # peak per pixel, with padding: 52 measured, and the photo in Lab
_ACROSS = 0.1  # weight of slopes across the light, which shading does not show, relative to slopes along it
_DEEP = 0.5  # exponent of |w| that divides overcast shading: between heights (0) and slopes (1)
_SLOPES = 12.0  # times overcast shading: s; root mean square slope is s / (1 + s): .32 to .59, rendered .39 to .67
_DARKEST = 1e-4  # luminance below which a pixel is black
_BRIGHTEST = 3.0  # shading above which a pixel is a highlight
_LIGHTEST = 1e6  # limit of |L|: 6e11 times white, whose sums are finite
_FINE = math.pi / 4  # radians per px: finer detail is not used to find the light
_LEVEL = 10.0  # degrees
_CONTRAST = 10.0  # L; smaller differences are not two materials
_VALLEY = 0.6  # times the lower of two modes, below which they are two materials
_JOINTS = 1 / 3  # greatest proportion of dark pixels that are taken for recesses between stones
_DIRECTED = 1.4  # ratio of power along and across, above which light has a direction; 3 for isotropic relief


@dataclass(frozen=True)
class Relief:
    """Heights from a photo's shading.

    `light`: direction of the light, degrees counterclockwise from the right; None: overcast.
    """

    heights: np.ndarray  # (height, width) float32: px, of mean 0; larger is nearer
    light: float | None


def padded_size(size: tuple[int, int], sigma: float, wraps: tuple[bool, bool]) -> tuple[int, int]:
    """Padded size of (rows, columns) for the transform; `wraps`: periodic along y, along x."""
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
    wraps: tuple[bool, bool],
) -> Relief:
    """Heights from shading.

    Parameters
    ----------
    luminance : (height, width) float32
        Linear, of any scale.
    opaque : (height, width) bool or None
        Valid pixels, at least one; None: all.
    sigma : float
        px; variation above this scale is color or uneven light.
    light : float or None
        Degrees counterclockwise from the right; None: estimated, from above rather than below.
    overcast : bool
        The light has no direction. A light with one is taken to be 45 degrees above the surface.
    wraps : (bool, bool)
        The photo is periodic along y, along x.
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
        # p cos t + q sin t = -shading, whose slant is 45 degrees: y is down, angles are counterclockwise
        toward = math.radians(light)
        along = 1j * (wx * math.cos(toward) - wy * math.sin(toward))
        heights = np.fft.irfft2(integrated(-spectrum, along, square), shape)
    heights = heights[: luminance.shape[0], : luminance.shape[1]].astype(np.float32)
    seen = heights if opaque is None else heights[opaque]
    return Relief(heights - seen.mean(dtype=np.float64).astype(np.float32), light)


def has_two_albedos(lightness: np.ndarray, opaque: np.ndarray | None, sigma: float) -> bool:
    """Whether lightness (height, width) has two modes, of which the darker one is not only joints.

    Dark joints are as shading shows recesses. Bright ones, and large dark parts, are another material or paint, whose
    depth is not seen.
    """
    from scipy.ndimage import gaussian_filter

    fine = gaussian_filter(lightness, 1.5) - gaussian_filter(lightness, sigma)
    seen = fine if opaque is None else fine[opaque]
    low, high = np.quantile(seen, (0.005, 0.995))
    if high - low < _CONTRAST:
        return False
    density = gaussian_filter(np.histogram(seen, 64, (low, high))[0].astype(float), 2.5)
    peaks = np.flatnonzero((density[1:-1] >= density[:-2]) & (density[1:-1] > density[2:])) + 1
    valleys = []  # depths and places
    for first, second in itertools.pairwise(peaks):
        valley = first + int(density[first : second + 1].argmin())
        valleys.append((float(density[valley] / min(density[first], density[second])), valley))
    depth, darker = min(valleys, default=(1.0, 0))
    return depth < _VALLEY and bool(density[:darker].sum() > _JOINTS * density.sum())


def integrated(slope: np.ndarray, along: np.ndarray, square: np.ndarray) -> np.ndarray:
    """Spectrum of the surface closest to slopes along one direction (Frankot and Chellappa 1988).

    Weighted least squares: slopes along the direction have weight 1, slopes across it, assumed 0, `_ACROSS`.

    `slope` (height, columns) complex128; `square` (height, columns) float64.
    """
    weight = np.abs(along) ** 2 + _ACROSS * square
    weight[0, 0] = 1.0
    return np.conj(along) * slope / weight


def light_of(shading: np.ndarray) -> float | None:
    """Direction of the light: that in which shading has most power; None if no direction stands out.

    Isotropic relief lit from one side has three times the power along the light as across (Knill, Estimating illuminant
    direction and degree of surface relief, JOSA A 7, 1990). Opposite directions cannot be distinguished: the upper one
    is assumed, as by human vision, and of two at about the same height the left one.

    `shading` (height, width) float64.
    """
    tapers = [np.sin(np.pi * (np.arange(n) + 0.5) / n) for n in shading.shape]
    spectrum = np.fft.rfft2(shading * tapers[0][:, None] * tapers[1][None])
    wy, wx = (
        2 * np.pi * np.fft.fftfreq(shading.shape[0])[:, None],
        2 * np.pi * np.fft.rfftfreq(shading.shape[1])[None],
    )
    square = wx * wx + wy * wy
    # near the Nyquist limit slopes along the axes are underestimated
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
    """Luminance over its Gaussian mean of valid pixels, less 1; 0 in the padding. (rows, columns) float64."""
    passes = np.exp(-0.5 * sigma**2 * wy**2) * np.exp(-0.5 * sigma**2 * wx**2)

    def seen(values: np.ndarray) -> np.ndarray:
        return np.fft.irfft2(np.fft.rfft2(values, shape) * passes, shape)[: values.shape[0], : values.shape[1]]

    weight = np.ones(luminance.shape) if opaque is None else opaque.astype(np.float64)
    values = np.where(weight > 0, np.maximum(luminance, 0), 0).astype(np.float64)
    mean = seen(values) / np.maximum(seen(weight), 1e-6)
    light = np.maximum(mean, _DARKEST)
    # where all is black there is no shading, and less than 1 is subtracted
    shading = np.where(weight > 0, np.clip(values / light - np.minimum(mean / light, 1), -1, _BRIGHTEST), 0)
    for axis, (n, wide) in enumerate(zip(luminance.shape, shape, strict=True)):
        if wide > n:  # mirrored beyond both ends, with a fade at the seam of the periodic transform
            behind = np.arange(wide - n)
            fade = 0.5 + 0.5 * np.cos(2 * np.pi * (behind + 0.5) / (wide - n))
            near_end = behind < (wide - n) // 2
            at = np.where(near_end, n - 1 - behind, wide - n - 1 - behind) % n
            fade = np.expand_dims(fade, 1 - axis)
            shading = np.concatenate([shading, np.take(shading, at, axis) * fade], axis)
    return shading


def luminance(lightness: np.ndarray) -> np.ndarray:
    """Linear luminance, 1 for white, of CIE L; float32, and finite for any L."""
    lightness = np.clip(lightness, np.float32(-_LIGHTEST), np.float32(_LIGHTEST))
    root = (lightness + np.float32(16)) / np.float32(116)
    return np.where(lightness > 8, root * root * root, lightness * np.float32(27 / 24389))


def normals_of(heights: np.ndarray, wraps: tuple[bool, bool]) -> np.ndarray:
    """Unit normals of heights in px: (height, width, 3) float32; x right, y up (OpenGL), z towards the viewer.

    Parameters
    ----------
    heights : (height, width) float32
    wraps : (bool, bool)
        The surface is periodic along y, along x; otherwise slopes at the border are one-sided.
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
