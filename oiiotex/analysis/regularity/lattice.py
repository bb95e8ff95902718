# SPDX-License-Identifier: Apache-2.0
"""A photo's lattice: the one or two frequencies at which it repeats, found by autocorrelation.

Candidates are peaks of the normalized autocorrelation: pairs of them span lattices of rank 2, peaks of its spectrum are
stripes (rank 1). The one with the highest mean autocorrelation is refined to a fraction of a pixel by
least squares over its peaks, at increasing distances. Its significance is tested on the photo itself
(order_significance): rows of cells are shifted against each other at random, and the lattice must be far stronger in
the photo than in such shifted photos, in the whole photo and in each half.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

from ...engine.core.demand import MadeRows, SomeRows, resized
from ...engine.core.window import Domain
from ...engine.deferred import np
from .autocorrelation import Autocorrelation, autocorrelation, high_passed
from .order_significance import least_of_halves, order_of

SIDE, LARGEST_SIDE = 256, 1024  # px; range of the longer side for the analysis: half of the photo's, between these
_BYTES = 260  # per pixel at that size, measured with a mask
SMALLEST = 4.0  # px at that size: a finer lattice is inside every patch
CELLS, CELLS_OF_PART = 3.0, 2.5  # minimum number of periods in a photo, along each vector
SURE = {1: 7.0, 2: 4.5}  # deviations above photos with shifted rows, by rank; rank 2: along every direction
OF_HALF = 0.5  # the same in each half of the photo, relative: deviations grow with the number of cells
BINS = 64  # of a phase
_BLUR = 0.5  # px, of a folded autocorrelation
_AS_GOOD = 0.85  # relative to the best correlation: from there a lattice with a smaller cell is preferred
STRETCHED = 0.02  # of a period: a larger strain is visible
STRAIN, RANGE = 4.0, 0.3  # weight of the strain, and relative range of tried sizes
_PEAKS, _TRIED = 24, 4


@dataclass(frozen=True)
class Lattice:
    """The lattice of a photo.

    Attributes
    ----------
    frequencies : (rank, 2) float64
        Cycles per pixel along x and y. Rank 1: stripes. Rank 2: a reduced pair.
    order : float
        Significance above chance, in deviations.
    likeness : (BINS,) * rank float64
        The photo's normalized autocorrelation: mean over all offsets of equal phase.
    """

    frequencies: np.ndarray
    order: float
    likeness: np.ndarray

    @property
    def rank(self) -> int:
        """1: periodic along one direction. 2: along two."""
        return len(self.frequencies)

    def vectors(self) -> np.ndarray:
        """The shortest periods, px: (rank, 2) float64, x and y."""
        return np.linalg.pinv(self.frequencies).T

    def first_vectors(self) -> np.ndarray:
        """The three shortest vectors without opposites. Stripes: one, two and three periods. (3, 2) float64."""
        vectors = self.vectors()
        if self.rank == 1:
            return vectors * np.arange(1, 4)[:, None]
        third = vectors[0] - np.sign(vectors[0] @ vectors[1] or 1.0) * vectors[1]
        return np.concatenate([vectors, third[None]])

    def on_torus(self, domain: Domain) -> np.ndarray:
        """The nearest frequencies that close on a tile: (rank, 2) float64."""
        return np.where(domain.wraps, np.rint(self.frequencies * domain.size) / domain.size, self.frequencies)

    def strain(self, domain: Domain) -> float:
        """Stretch or shear required for that, as a share of the period."""
        moved = self.on_torus(domain) - self.frequencies
        return float((np.linalg.norm(moved, axis=1) / np.linalg.norm(self.frequencies, axis=1)).max())

    def fitting(self, domain: Domain, multiple: int = 1) -> tuple[int, int]:
        """The size nearest to the domain's, in multiples of `multiple`, on which it closes with hardly any strain.

        A side without visible strain is kept. Otherwise the relative change of the size plus `STRAIN` times the
        strain is minimized: a slightly nearer multiple of the periods does not justify a stretch.
        """

        def along(axis: int, size: int) -> int:
            sizes = np.arange(math.ceil(size * (1 - RANGE)), math.floor(size * (1 + RANGE)) + 1)
            sizes = np.append(size, sizes[sizes % multiple == 0])
            cycles = self.frequencies[:, axis] * sizes[:, None]
            rest = np.abs(cycles - np.rint(cycles)) / sizes[:, None] / np.linalg.norm(self.frequencies, axis=1)
            if rest[0].max() <= STRETCHED:
                return size
            return int(sizes[np.argmin(np.abs(sizes - size) / size + STRAIN * rest.max(1))])

        width, height = (along(n, size) if domain.wraps[n] else size for n, size in enumerate(domain.size))
        return width, height

    def losses(self) -> np.ndarray:
        """Loss of autocorrelation of each phase compared with phase 0, 0 to 1: (BINS,) * rank float64."""
        loss = np.maximum(0.0, self.likeness.flat[0] - self.likeness)
        return loss / max(float(loss.max()), 1e-12)

    def scaled(self, x: float, y: float) -> Lattice:
        """The lattice of the photo scaled by x and y."""
        return Lattice(self.frequencies / [x, y], self.order, self.likeness)

    def __str__(self) -> str:
        steps = " and ".join(f"({x:.2f}, {y:.2f})" for x, y in self.vectors())
        return f"{'stripes of' if self.rank == 1 else 'a lattice of'} {steps} px"


def bytes_needed(height: int, width: int) -> int:
    """Memory that `find_lattice` takes to analyze a photo."""
    small = _looked_at(height, width)
    return _BYTES * small[0] * small[1]


def _looked_at(height: int, width: int) -> tuple[int, int]:
    """Width and height at which a photo is analyzed."""
    longer = max(height, width)
    factor = min(1.0, min(LARGEST_SIDE, max(SIDE, longer / 2)) / longer)
    return round(width * factor), round(height * factor)


HighPass = tuple["np.ndarray", "np.ndarray"]
"""The high-passed photo at the size of the analysis, and its usable pixels."""


def high_pass_of(values: SomeRows, usable: np.ndarray | None) -> HighPass | None:
    """The high-passed photo at the size of the analysis, and its usable pixels. None: too few are left."""
    height, width = values.shape[:2]
    small = _looked_at(height, width)
    if min(small) < 4 * SMALLEST:
        return None
    counted = np.ones(small[::-1], bool)
    if usable is not None:
        ones = MadeRows((height, width, 1), np.float32, lambda first, last: usable[first:last, :, None])
        counted = resized(ones, *small)[..., 0] > 0.99
        whole = values

        def seen(first: int, last: int) -> np.ndarray:
            return np.where(usable[first:last, :, None], whole[first:last], np.float32(0))

        values = MadeRows(whole.shape, np.float32, seen)
    if np.count_nonzero(counted) < min(small) ** 2 // 4:
        return None
    texture = high_passed(resized(values, *small).astype(np.float64), counted)
    if not (texture**2).mean() > 1e-4:
        return None
    return texture, counted


def find_lattice(
    values: SomeRows, usable: np.ndarray | None = None, of_part: bool = False, seen: HighPass | None = None
) -> Lattice | None:
    """The lattice of a photo. None: it has none.

    Parameters
    ----------
    values : (height, width, channels) float32
        CIE Lab.
    usable : (height, width) bool or None
        Pixels that count. None: all.
    of_part : bool
        The image is a part of a photo that has a lattice: fewer periods suffice, and halves are not tested.
    seen : HighPass, optional
        `high_pass_of` these arguments, if it is known.
    """
    seen = seen or high_pass_of(values, usable)
    if seen is None:
        return None
    (texture, counted), small, (height, width) = seen, _looked_at(*values.shape[:2]), values.shape[:2]
    alike = autocorrelation(texture, counted)
    for candidate in (_plane_lattice, _stripes):
        frequencies = candidate(alike, min(small) / (CELLS_OF_PART if of_part else CELLS))
        if frequencies is not None:
            enough = SURE[len(frequencies)]
            order = order_of(texture, counted, frequencies, enough)
            half = OF_HALF * enough
            if order >= enough and (of_part or least_of_halves(texture, counted, frequencies, half) >= half):
                lattice = Lattice(frequencies, order, alike.folded(frequencies, BINS, _BLUR))
                return lattice.scaled(width / small[0], height / small[1])
    return None


def _near_maxima(values: np.ndarray, radius: int) -> np.ndarray:
    """The largest value within a square around each pixel."""
    for axis in (0, 1):
        count = values.shape[axis]
        padded = np.pad(values, [(radius, radius) if a == axis else (0, 0) for a in (0, 1)], constant_values=-np.inf)
        shifted = (padded[k : k + count] if axis == 0 else padded[:, k : k + count] for k in range(2 * radius + 1))
        values = functools.reduce(np.maximum, shifted)
    return values


def _smoothed(ncc: np.ndarray) -> np.ndarray:
    """Smooth by a binomial filter: peaks between pixels become as high as those on pixels."""
    for axis in (0, 1):
        ncc = 0.5 * ncc + 0.25 * (np.roll(ncc, 1, axis) + np.roll(ncc, -1, axis))
    return ncc


def _reduced(vectors: np.ndarray) -> np.ndarray:
    """The shortest pair that spans the same lattice (Lagrange), the shorter first."""
    while True:
        if vectors[0] @ vectors[0] > vectors[1] @ vectors[1]:
            vectors = vectors[::-1]
        steps = np.rint(vectors[0] @ vectors[1] / (vectors[0] @ vectors[0]))
        if steps == 0:
            return vectors
        vectors = np.array([vectors[0], vectors[1] - steps * vectors[0]])


def _points(vectors: np.ndarray, reach: tuple[int, int], most: int) -> np.ndarray:
    """Indices (n, 2) of the lattice points within reach, one of each pair of opposites."""
    corners = np.array([[reach[0], reach[1]], [reach[0], -reach[1]]])
    most = min(most, int(np.ceil(np.abs(corners @ np.linalg.inv(vectors)).max())))
    steps = np.stack(np.meshgrid(np.arange(-most, most + 1), np.arange(0, most + 1)), -1).reshape(-1, 2)
    steps = steps[(steps[:, 1] > 0) | (steps[:, 0] > 0)]
    at = steps @ vectors
    return steps[(np.abs(at) <= reach).all(1)]


def _height(vectors: np.ndarray, maxima: np.ndarray, weight: np.ndarray) -> float:
    """The mean of `maxima` on a lattice's points."""
    reach = maxima.shape[1] // 2, maxima.shape[0] // 2
    at = np.rint(_points(vectors, reach, 99) @ vectors).astype(np.int64)
    at = at[weight[at[:, 1] + reach[1], at[:, 0] + reach[0]] > 0]
    return float(maxima[at[:, 1] + reach[1], at[:, 0] + reach[0]].mean()) if len(at) > 2 else -1.0


def _near_heights(pairs: np.ndarray, maxima: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """The same for many pairs (n, 2, 2) and the points up to two steps away."""
    steps = np.array([[i, j] for j in range(3) for i in range(-2, 3) if j > 0 or i > 0])
    reach = np.array([maxima.shape[1] // 2, maxima.shape[0] // 2])
    at = np.rint(steps @ pairs).astype(np.int64)
    within = (np.abs(at) <= reach).all(-1)
    x, y = np.moveaxis(np.where(within[..., None], at, 0) + reach, -1, 0)
    says = within & (weight[y, x] > 0)
    return np.where(says, maxima[y, x], 0.0).sum(1) / np.maximum(says.sum(1), 1)


def _fits(vectors: np.ndarray, longest: float) -> bool:
    """Whether both periods, perpendicular to the other vector, are neither too small nor too large."""
    area = abs(np.linalg.det(vectors))
    lengths = np.linalg.norm(vectors, axis=1)
    return bool(area / lengths.max() >= SMALLEST and lengths.max() <= longest)


def _plane_lattice(likeness: Autocorrelation, longest: float) -> np.ndarray | None:
    """Frequencies of the best lattice of rank 2. None: there is none."""
    ncc, weight = _smoothed(likeness.ncc), likeness.weight
    reach_x, reach_y = likeness.reach
    x, y = likeness.offsets()
    peaks = (_near_maxima(ncc, 2) == ncc) & (weight > 0) & ((y > 0) | ((y == 0) & (x > 0)))
    peaks &= (x * x + y * y >= SMALLEST**2) & (np.maximum(np.abs(x), np.abs(y)) <= min(likeness.reach) / 1.5)
    at = np.stack([x[peaks], y[peaks]], 1).astype(np.float64)
    height = ncc[peaks]
    if len(at) < 2:
        return None
    strong = np.flatnonzero(height >= 0.5 * height.max())
    nearest = strong[np.argsort((at[strong] ** 2).sum(1), kind="stable")[:_PEAKS]]
    highest = np.argsort(-height, kind="stable")[: _PEAKS // 2]
    chosen = np.flatnonzero(np.bincount(np.concatenate([nearest, highest])))
    maxima, pairs = _near_maxima(ncc, 1), {}
    for i in chosen:
        for j in chosen[chosen < i]:
            if abs(np.linalg.det(at[[i, j]])) >= SMALLEST**2:
                vectors = _reduced(at[[i, j]])
                if _fits(vectors, longest):
                    pairs[vectors.tobytes()] = vectors
    if not pairs:
        return None
    floor = float(np.average(maxima, weights=weight))
    tried = np.stack(list(pairs.values()))
    heights = _near_heights(tried, maxima, weight) - floor
    tried, heights = (a[np.argsort(-heights, kind="stable")] for a in (tried, heights))
    good = tried[heights >= _AS_GOOD * heights[0]]
    good = good[np.argsort(np.abs(np.linalg.det(good)), kind="stable")]
    refined = [_refined(vectors, ncc, weight) for vectors in [*good[:_TRIED], *tried[:_TRIED]]]
    fitting = [(_height(v, maxima, weight), v) for v in refined if v is not None and _fits(v, longest)]
    if not fitting or max(h for h, _ in fitting) <= floor:
        return None
    least = floor + _AS_GOOD * (max(h for h, _ in fitting) - floor)
    vectors = min((v for h, v in fitting if h >= least), key=lambda v: abs(np.linalg.det(v)))
    while denser := [v for v in _splits(vectors, longest) if _height(v, maxima, weight) >= least]:
        vectors = denser[0]
    return np.linalg.inv(vectors).T


def _splits(vectors: np.ndarray, longest: float) -> list[np.ndarray]:
    """Lattices with a half or a third of the cell that contain all points of this one."""
    matrices = [[[1 / n, 0], [0, 1]] for n in (2, 3)] + [[[k / n, 1 / n], [1, 0]] for n in (2, 3) for k in range(n)]
    return [v for matrix in matrices if _fits(v := _reduced(np.array(matrix) @ vectors), longest)]


def _refined(vectors: np.ndarray, ncc: np.ndarray, weight: np.ndarray) -> np.ndarray | None:
    """Refine by least squares over the peaks near the lattice points, from the nearest to the farthest."""
    reach = np.array([ncc.shape[1] // 2, ncc.shape[0] // 2])
    for most in (1, 2, 4, 8, 16):
        near = int(np.clip(np.linalg.norm(vectors, axis=1).min() / 5, 1, 4))
        steps = _points(vectors, tuple(reach - near - 1), most)
        at = np.rint(steps @ vectors).astype(np.int64) + reach
        around = np.arange(-near, near + 1)
        windows = ncc[at[:, 1, None, None] + around[:, None], at[:, 0, None, None] + around]
        down, across = np.divmod(windows.reshape(len(at), -1).argmax(1), len(around))
        x, y = at[:, 0] + across - near, at[:, 1] + down - near
        says = (weight[y, x] > 0) & (ncc[y, x] > 0)
        x, y, steps = x[says], y[says], steps[says]
        between = [
            _parabola(ncc[y, x - 1], ncc[y, x], ncc[y, x + 1]),
            _parabola(ncc[y - 1, x], ncc[y, x], ncc[y + 1, x]),
        ]
        places, w = np.stack([x, y], 1) + np.stack(between, 1) - reach, ncc[y, x][:, None]
        if len(steps) < 2 or np.linalg.matrix_rank(steps) < 2:
            return None
        vectors = np.linalg.lstsq(steps * w, places * w, rcond=None)[0]
        if abs(np.linalg.det(vectors)) < SMALLEST**2:
            return None
    return _reduced(vectors)


def _parabola(before: np.ndarray, peak: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Subpixel position of a peak between its neighbors, -0.5 to 0.5."""
    bend = np.minimum(before - 2 * peak + after, -1e-12)
    return np.clip(0.5 * (before - after) / bend, -0.5, 0.5)


def _stripes(likeness: Autocorrelation, longest: float) -> np.ndarray | None:
    """The frequency of the best lattice of rank 1. None: there is none."""
    weighted = (likeness.ncc - likeness.mean) * likeness.weight
    x, y = likeness.offsets()
    weighted[x * x + y * y < 9] = 0.0
    length = 4 * (max(weighted.shape) // 2)
    power = np.abs(np.fft.rfft2(weighted, (length, length)))
    fy, fx = np.fft.fftfreq(length)[:, None], np.fft.rfftfreq(length)[None]
    size = np.hypot(fx, fy)
    power[(size < 1 / longest) | (size > 1 / SMALLEST)] = 0.0
    rows, columns = np.nonzero((_near_maxima(power, 2) == power) & (power > 0))
    order = np.argsort(-power[rows, columns], kind="stable")[:5]
    peaks = np.stack([fx[0, columns[order]], fy[rows[order], 0]], 1)
    candidates = [peak / k for peak in peaks for k in (1, 2, 3) if np.hypot(*peak) / k >= 1 / longest]
    if not candidates:
        return None
    heights = [_over_floor(likeness, c) for c in candidates]
    if max(heights) <= 0:  # a single object
        return None
    good = [c for c, h in zip(candidates, heights, strict=True) if h >= 0.9 * max(heights)]
    best = max(good, key=lambda c: float(np.hypot(*c)))
    step = 0.25 / max(weighted.shape)  # a quarter of the frequency resolution
    for _ in range(3):
        ahead = step * best / np.hypot(*best)
        aside = ahead[::-1] * [1, -1]
        best = max(
            (best, best + ahead, best - ahead, best + aside, best - aside), key=lambda c: _over_floor(likeness, c)
        )
        step /= 2
    return best[None]


def _over_floor(likeness: Autocorrelation, frequency: np.ndarray) -> float:
    profile = likeness.folded(frequency[None], 24)
    return float(profile[0] - profile.mean())
