# SPDX-License-Identifier: Apache-2.0
"""Visible repetition of a tile: slow waves of light, color and texture, and salient spots."""

from __future__ import annotations

from ...analysis.regularity.autocorrelation import blurred
from ...engine.deferred import np

_CYCLES = 3.2  # per side of the tile: slower waves are seen as a grid of tiles, faster ones as texture
_DETAIL = 128, 48, 24  # the longer side over sigmas: fine detail is finer than the first, coarse is between the others
_AREA = 12  # the longer side over the sigma of an area whose detail is compared
_LEAST_DETAIL = 0.2  # Lab: less is noise
_LEAST_DEVIATION = 1.0  # Lab, as of a weed on gray stone: smaller ones do not count


def slow_waves(tile: np.ndarray) -> float:
    """Standard deviation, in Lab, of the waves of a tile that have at most `_CYCLES` periods per side.

    `tile` (height, width, 3) float, a torus. Rounded to two digits, so that last bits decide nothing.
    """
    height, width = tile.shape[:2]
    across = min(int(_CYCLES), width // 2) + 1  # waves along x; those of negative frequency are their conjugates
    spectrum = np.fft.fft(np.fft.rfft(tile - tile.mean((0, 1)), axis=1)[:, :across], axis=0) / (height * width)
    power = (np.abs(spectrum) ** 2).sum(-1)
    power[:, 1 : (width + 1) // 2] *= 2.0
    cycles = np.hypot(*np.meshgrid(np.fft.fftfreq(height, 1 / height), np.arange(across), indexing="ij"))
    return round(float(np.sqrt(power[cycles < _CYCLES].sum())), 2)


def texture_waves(light: np.ndarray) -> float:
    """The same of the texture: of the logarithms of fine and of coarse detail.

    A tile whose one half is rough and whose other is plain, or whose stones become smaller, shows a grid even if it is
    as light everywhere. `light` (height, width) float, L of a torus.
    """
    torus, longer = (True, True), max(light.shape)
    levels = [light[..., None], *(blurred(light[..., None], longer / share, torus) for share in _DETAIL)]
    detail = np.concatenate([np.abs(levels[0] - levels[1]), np.abs(levels[2] - levels[3])], -1)
    return slow_waves(np.log(np.maximum(blurred(detail, longer / _AREA, torus), 0.0) + _LEAST_DETAIL))


def salience(around: np.ndarray, shown: np.ndarray | float = 1.0) -> float:
    """How far the most salient area of a blurred texture is from its typical color, in typical deviations.

    A measure of statistics hardly changes by one small area that differs; but where a tile repeats, it is the first
    thing that is seen. The more so if it is there several times. `around` (height, width, 3) float; `shown` (height,
    width): how often each place is shown (`times_shown`), at least 1.
    """
    away = np.abs(around - np.median(around, (0, 1)))
    deviations = (away / np.maximum(_LEAST_DEVIATION, 1.4826 * np.median(away, (0, 1)))).max(-1)
    return round(float((deviations * np.sqrt(shown)).max()), 2)
