# SPDX-License-Identifier: Apache-2.0
"""Light and grain of a frame, measured around a region and continued inside it."""

from __future__ import annotations

from ..core.image import resized
from ..deferred import np

CELL = 16  # px
MOST_GAIN = 4.0
_BLOCK = 32  # px; side of the blocks in which the spectrum of grain is measured
_MOST_BLOCKS = 64
_FEWEST = 4
_MAD = 0.6745  # of a normal distribution's deviation
_OUTLIER = 3.0  # deviations: more is an edge that does not match, not grain


def gains(frame: np.ndarray, plate: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Factor by which the plate has the frame's light level, continued smoothly from where the frame is known.

    Parameters
    ----------
    frame, plate : (h, w, c) float32
    known : (h, w) bool

    Returns
    -------
    (h, w, c) float32
    """
    if not known.any():
        return np.ones_like(plate)
    ease = np.mean(plate[known] ** 2, 0) + 1e-12
    share = known[..., None] / (plate**2 + ease)
    both, own = _sums(frame * plate * share), _sums(plate**2 * share)
    gain = np.clip(both / np.maximum(own, 1e-12), 1 / MOST_GAIN, MOST_GAIN)
    weight = _sums(known[..., None].astype(np.float32)) / CELL**2
    return _enlarged(_continued(np.where(own > 1e-12, gain, 1.0), weight), known.shape)


def grain(difference: np.ndarray, known: np.ndarray, number: int) -> np.ndarray:
    """New grain like that of the frame.

    Its deviation and its correlation between channels and pixels are those of the known pixels: noise with their power
    spectrum (Galerne, Gousseau and Morel 2011).

    Parameters
    ----------
    difference : (h, w, c) float32
        The frame minus the matched plate.
    known : (h, w) bool
    number : int
        The frame's: the same number, the same grain.

    Returns
    -------
    (h, w, c) float32
    """
    height, width, count = difference.shape
    if not known.any():
        return np.zeros_like(difference)
    absolute = _cells(np.where(known[..., None], np.abs(difference), np.nan))
    with np.errstate(all="ignore"):
        full = np.isfinite(absolute).sum(2)
        middle = np.nan_to_num(_medians(absolute)) / _MAD
    deviation = _enlarged(_continued(middle, full / CELL**2), known.shape)
    overall = np.maximum(np.median(np.abs(difference[known]), 0) / _MAD, 1e-12)
    plain = np.clip(difference / np.maximum(deviation, 0.1 * overall), -_OUTLIER, _OUTLIER)
    noise = np.random.Generator(np.random.Philox(key=number)).standard_normal((height, width, count), np.float32)
    noise = _colored(noise, plain, known)
    values = plain[known]
    relation = np.cov(values.T).reshape(count, count)
    spread = np.sqrt(np.maximum(np.diag(relation), 1e-12))
    mix = np.linalg.cholesky(relation / np.outer(spread, spread) + 1e-6 * np.eye(count))
    return (noise @ mix.T.astype(np.float32)) * deviation


def _colored(noise: np.ndarray, plain: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Noise with the mean power spectrum of the channels of known blocks, of deviation 1."""
    from scipy.signal import fftconvolve

    corners = [
        (y, x)
        for y in range(0, known.shape[0] - _BLOCK + 1, _BLOCK // 2)
        for x in range(0, known.shape[1] - _BLOCK + 1, _BLOCK // 2)
        if known[y : y + _BLOCK, x : x + _BLOCK].all()
    ]
    if len(corners) < _FEWEST:
        return noise
    corners = corners[:: -(-len(corners) // _MOST_BLOCKS)]
    blocks = np.stack([plain[y : y + _BLOCK, x : x + _BLOCK] for y, x in corners])
    blocks = blocks - blocks.mean((1, 2), keepdims=True)
    amplitude = np.sqrt(np.mean(np.abs(np.fft.rfft2(blocks, axes=(1, 2))) ** 2, (0, 3)))
    kernel = np.fft.fftshift(np.fft.irfft2(amplitude, (_BLOCK, _BLOCK)))
    kernel = (kernel / np.sqrt(np.sum(kernel**2))).astype(np.float32)
    return fftconvolve(noise, kernel[..., None], "same", axes=(0, 1)).astype(np.float32)


def _cells(values: np.ndarray) -> np.ndarray:
    """Values in cells: (down, across, pixels, c), NaN beyond the border."""
    height, width, count = values.shape
    down, across = -(-height // CELL), -(-width // CELL)
    padded = np.full((down * CELL, across * CELL, count), np.nan, np.float32)
    padded[:height, :width] = values
    return padded.reshape(down, CELL, across, CELL, count).swapaxes(1, 2).reshape(down, across, CELL**2, count)


def _sums(values: np.ndarray) -> np.ndarray:
    return np.nansum(_cells(values), 2)


def _medians(cells: np.ndarray) -> np.ndarray:
    """Medians of cells, NaN where they are empty."""
    ordered, number = np.sort(cells, 2), np.isfinite(cells).sum(2, keepdims=True)  # NaN is last
    return np.take_along_axis(ordered, np.maximum((number - 1) // 2, 0), 2)[:, :, 0]


def _continued(values: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Cells, (down, across, c), continued to where their weight, 0 to 1, is low, from coarser and coarser means."""
    down, across = values.shape[:2]
    weight = np.broadcast_to(np.clip(weight, 0, 1), values.shape)
    if max(down, across) == 1:
        return values
    even = [(0, down % 2), (0, across % 2), (0, 0)]

    def fours(of: np.ndarray) -> np.ndarray:
        wide = np.pad(of, even)
        return wide.reshape(wide.shape[0] // 2, 2, wide.shape[1] // 2, 2, -1).sum((1, 3))

    total = fours(weight)
    coarse = _continued(fours(values * weight) / np.maximum(total, 1e-9), total)
    ease = resized(coarse.astype(np.float32), across + across % 2, down + down % 2)[:down, :across]
    return weight * values + (1 - weight) * ease


def _enlarged(cells: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Cells as pixels, bilinear."""
    down, across = cells.shape[:2]
    return resized(cells.astype(np.float32), across * CELL, down * CELL)[: shape[0], : shape[1]]
