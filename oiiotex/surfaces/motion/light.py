# SPDX-License-Identifier: Apache-2.0
"""Light and grain of a frame, measured around a region and continued inside it."""

from __future__ import annotations

from ...engine.core.demand import resized
from ...engine.deferred import np

CELL = 16  # px
MOST_GAIN = 4.0
_BLOCK = 32  # px; side of the blocks in which the spectrum of grain is measured
_MOST_BLOCKS = 16
_FEWEST = 4
MEDIAN = 0.455  # of squares of normal numbers
_OUTLIER = 3.0  # deviations: more is an edge that does not match, not grain
_CLIPPED = 0.9915  # mean of squares of normal numbers, none above 3 squared
_MOST_SAMPLES = 1 << 16
_ROUNDS = 6


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


def grain(
    difference: np.ndarray, plate: np.ndarray, known: np.ndarray, number: int, amount: np.ndarray | None = None
) -> np.ndarray:
    """New grain like that of the frame.

    The variance of the difference is a constant, plus photon noise in proportion to the value, plus what does not match
    in proportion to the plate's detail. The first two are grain. Its relation between channels and between pixels is
    that of the known pixels: noise with their power spectrum (Galerne, Gousseau and Morel 2011).

    Parameters
    ----------
    difference : (h, w, c) float32
        The frame minus the matched plate.
    plate : (h, w, c) float32
        The matched plate.
    known : (h, w) bool
    number : int
        The frame's: the same number, the same grain.
    amount : (c,) float64, optional
        Standard deviation of the grain, measured between frames. Default: by the difference, which also has detail that
        frame and plate resolve differently.

    Returns
    -------
    (h, w, c) float32
    """
    height, width, count = difference.shape
    if np.count_nonzero(known) < CELL**2:
        return np.zeros_like(difference)
    detail = _detail(plate)
    deviation, plain = np.empty_like(difference), np.empty_like(difference)
    for c in range(count):
        terms = np.stack([np.ones(known.shape, np.float32), np.maximum(plate[..., c], 0), detail[..., c]], -1)
        factors = _variance(difference[..., c][known] ** 2, terms[known])
        deviation[..., c] = np.sqrt(terms[..., :2] @ factors[:2])
        plain[..., c] = difference[..., c] / np.sqrt(np.maximum(terms @ factors, 1e-12))
    plain = np.clip(plain, -_OUTLIER, _OUTLIER)
    if amount is not None:
        usual = np.sqrt(np.mean(deviation[known].astype(np.float64) ** 2, 0))
        deviation *= (amount / np.maximum(usual, 1e-12)).astype(np.float32)
    random = np.random.Generator(np.random.Philox(key=number % (1 << 64)))  # frames before 0 also have a key
    noise = random.standard_normal((height, width, count), np.float32)
    noise = _colored(noise, plain, known, detail.mean(2))
    relation = np.cov(plain[known].T).reshape(count, count)
    spread = np.sqrt(np.maximum(np.diag(relation), 1e-12))
    mix = np.linalg.cholesky(relation / np.outer(spread, spread) + 1e-6 * np.eye(count))
    return (noise @ mix.T.astype(np.float32)) * deviation


def _detail(plate: np.ndarray) -> np.ndarray:
    """Squared detail of the plate's pixels and their neighbors: where it is strong, a small misfit shows."""
    steps = [np.abs(np.diff(plate, axis=axis, prepend=np.take(plate, [0], axis))) for axis in (0, 1)]
    total = steps[0] ** 2 + steps[1] ** 2
    for axis in (0, 1):
        total = sum(np.roll(total, shift, axis) for shift in (-1, 0, 1)) / 3
    return total


def _variance(squares: np.ndarray, terms: np.ndarray) -> np.ndarray:
    """Factors >= 0 by which terms, (n, 3), add up to the variance of differences with these squares, (n,)."""
    from scipy.optimize import nnls

    step = max(1, len(squares) // _MOST_SAMPLES)
    squares, terms = squares[::step].astype(np.float64), terms[::step].astype(np.float64)
    expected = np.full(len(squares), np.median(squares) / MEDIAN)
    scale = np.maximum(terms.mean(0), 1e-12)
    factors = np.zeros(terms.shape[1])
    for _ in range(_ROUNDS):  # the deviation of a square is in proportion to the variance
        weight = 1 / np.maximum(expected, 1e-12)
        kept = np.minimum(squares, _OUTLIER**2 * expected) / _CLIPPED
        factors = nnls(terms / scale * weight[:, None], kept * weight)[0] / scale
        expected = terms @ factors
    return factors


def _colored(noise: np.ndarray, plain: np.ndarray, known: np.ndarray, detail: np.ndarray) -> np.ndarray:
    """Noise with the mean power spectrum of the known blocks with the least detail, of deviation 1."""
    from scipy.signal import fftconvolve

    corners = [
        (y, x)
        for y in range(0, known.shape[0] - _BLOCK + 1, _BLOCK // 2)
        for x in range(0, known.shape[1] - _BLOCK + 1, _BLOCK // 2)
        if known[y : y + _BLOCK, x : x + _BLOCK].all()
    ]
    if len(corners) < _FEWEST:
        return noise
    corners.sort(key=lambda at: float(detail[at[0] : at[0] + _BLOCK, at[1] : at[1] + _BLOCK].mean()))
    corners = corners[:_MOST_BLOCKS]
    blocks = np.stack([plain[y : y + _BLOCK, x : x + _BLOCK] for y, x in corners])
    blocks = blocks - blocks.mean((1, 2), keepdims=True)
    amplitude = np.sqrt(np.mean(np.abs(np.fft.rfft2(blocks, axes=(1, 2))) ** 2, (0, 3)))
    kernel = np.fft.fftshift(np.fft.irfft2(amplitude, (_BLOCK, _BLOCK)))
    kernel = (kernel / np.sqrt(np.sum(kernel**2))).astype(np.float32)
    return fftconvolve(noise, kernel[..., None], "same", axes=(0, 1)).astype(np.float32)


def _sums(values: np.ndarray) -> np.ndarray:
    """Sums in cells: (down, across, c)."""
    height, width, count = values.shape
    down, across = -(-height // CELL), -(-width // CELL)
    padded = np.zeros((down * CELL, across * CELL, count), np.float32)
    padded[:height, :width] = values
    return padded.reshape(down, CELL, across, CELL, count).sum((1, 3))


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
