# SPDX-License-Identifier: Apache-2.0
"""What describes a superpixel of any level: moments, Gabor responses, a local quadtree, textons (LSA16 4.1, 4.7).

All are sums over finest superpixels, so that any level's features follow from one look at the image. Moments come
from the power sums that `superpixels` has taken at full resolution; the others look at means of squares, at most
`WORKING_PIXELS` of them by whole factors, so their cost does not grow with the image.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import scipy.fft
import scipy.sparse as sparse
from scipy.cluster.vq import kmeans2
from scipy.ndimage import gaussian_filter
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from ..color.lab_grid import mean_lab
from ..core.window import Window
from ..session import Session
from ..superpixels.superpixels import Superpixels

KINDS = ("textons", "moments", "gabor", "quadtree")
WORKING_PIXELS = 3 << 18
TEXTONS = 60
_UNIT = 100.0  # histograms add up to it, squared: their distances are of the order of those of Lab
_PAD = 24  # px of mirror image around what is filtered
_WAVES = (4.0, 8.0, 16.0)  # px, of the reduced image
_SAMPLES = 8000  # pixels that the textons are learned from
_BLOCK = 1 << 15
_POOLED = 0.5  # scales of a superpixel: how far its neighbours' textons count

Features = Callable[[np.ndarray], np.ndarray]
"""(n,) int: the group of every finest superpixel, 0 .. m - 1 -> (m, d) float64: the groups' features."""


def features_of(kind: str, superpixels: Superpixels, small: SmallLab, session: Session) -> Features:
    """The features of that kind, of any level of a hierarchy.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    superpixels : Superpixels
    small : SmallLab
        As `small_lab` makes it of them.
    session : Session
    """
    if kind == "moments":
        return lambda groups: moments(superpixels.power_sums, superpixels.sizes, groups)
    if kind == "quadtree":
        return _quadtree(small, superpixels)
    if kind == "gabor":
        return _gabor(small)
    return _texton_histograms(small, superpixels, session)


def grouped(values: np.ndarray, groups: np.ndarray) -> np.ndarray:
    """Sums over groups: (n, ...) and (n,) -> (m, ...), in one fixed order."""
    m = int(groups.max()) + 1
    columns = values.reshape(len(values), -1).T
    return np.stack([np.bincount(groups, column, m) for column in columns], axis=1).reshape(m, *values.shape[1:])


def moments(power_sums: np.ndarray, sizes: np.ndarray, groups: np.ndarray) -> np.ndarray:
    """Mean, standard deviation and three higher moments per channel, (m, 15), in units of Lab.

    The kth is sign(mu_k) |mu_k|^(1/k) / k!: LSA16 section 4.1 with the root that its text omits.
    """
    raw = grouped(power_sums, groups) / grouped(sizes.astype(np.float64), groups)[:, None, None]  # (m, 3, 5)
    mean = raw[..., 0]
    raw = np.concatenate([np.ones_like(raw[..., :1]), raw], axis=-1)
    columns = [mean]
    for k in range(2, 6):
        central = sum(math.comb(k, j) * raw[..., j] * (-mean) ** (k - j) for j in range(k + 1))
        columns.append(np.sign(central) * np.abs(central) ** (1.0 / k) / math.factorial(k))
    return np.concatenate(columns, axis=1)


# --- the reduced image ---


@dataclass(frozen=True)
class SmallLab:
    """Means of `factor` x `factor` pixels: Lab (h, w, 3) float32, and the superpixel in their middle, 0: none."""

    lab: np.ndarray
    ids: np.ndarray
    factor: int
    places: np.ndarray  # (n, 2) rows and columns near the centres of superpixels
    count: int
    _texture: list[Texture] = field(default_factory=list, repr=False)

    def texture(self, session: Session) -> Texture:
        """What textons are made of, where there are superpixels; looked at once."""
        if not self._texture:
            self._texture.append(texture_of(self.lab, self.ids > 0, session))
        return self._texture[0]

    def sums(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Sums (n, k) of (h, w, k) over finest superpixels, and how many values each has (n,).

        One that is too thin to be met in the reduced image has the value at its centre.
        """
        ids = self.ids.ravel()
        counts = np.bincount(ids, minlength=self.count + 1)[1:]
        flat = values.reshape(ids.size, -1)
        sums = np.stack([np.bincount(ids, column, self.count + 1)[1:] for column in flat.T], axis=1)
        missed = counts == 0
        sums[missed] = values[self.places[missed, 0], self.places[missed, 1]].reshape(-1, flat.shape[1])
        return sums, np.maximum(counts, 1)


def small_lab(superpixels: Superpixels) -> SmallLab:
    """From the squares that the Gaussian stack begins with, so the image is not looked at again."""
    window, squares = superpixels.window, superpixels.reduced
    times = max(1, math.ceil(math.sqrt(squares.sums.shape[0] * squares.sums.shape[1] / WORKING_PIXELS)))
    factor = squares.side * times
    sums = squares.sums.astype(np.int64)
    for axis in (0, 1):
        sums = np.add.reduceat(sums, np.arange(0, sums.shape[axis], times), axis=axis)
    height, width = sums.shape[:2]
    lab = np.clip(mean_lab(sums), -1e4, 1e4)  # one firefly must not drown the scale of all the rest
    columns = np.minimum(np.arange(width) * factor + factor // 2, window.width - 1)
    ids = np.empty((height, width), np.int64)
    for row in range(height):
        y = window.top + min(row * factor + factor // 2, window.height - 1)
        ids[row] = superpixels.labels.read(Window(window.left, y, window.right, y + 1))[0, columns, 0]
    if (ids == 0).any() and (ids > 0).any():
        lab[ids == 0] = lab[ids > 0].mean(0)
    places = np.clip((superpixels.positions[:, ::-1] / factor).astype(np.int64), 0, [height - 1, width - 1])
    return SmallLab(lab, ids, factor, places, len(superpixels.sizes))


# --- filters ---


def gabor_responses(plane: np.ndarray, waves: tuple[float, ...], turns: int) -> list[np.ndarray]:
    """|response| of Gabor filters of those wavelengths in px, in `turns` directions; plane (h, w) float32.

    Each is a Gaussian in frequency around its wave (of deviation 0.45 wavelengths in space) on one half plane: its
    inverse transform is complex, its modulus the local energy whatever the phase.
    """
    padded = np.pad(plane - plane.mean(), _PAD, mode="symmetric")
    shape = [scipy.fft.next_fast_len(s) for s in padded.shape]
    spectrum = scipy.fft.fft2(padded.astype(np.float32), shape)
    v, u = (scipy.fft.fftfreq(s).astype(np.float32) for s in shape)
    responses = []
    for wave in waves:
        spread = 2.0 * (np.pi * 0.45 * wave) ** 2
        for turn in range(turns):
            angle = np.pi * turn / turns
            over_x = np.exp(-spread * (u - np.cos(angle) / wave) ** 2)
            over_y = np.exp(-spread * (v - np.sin(angle) / wave) ** 2)
            response = np.abs(scipy.fft.ifft2(spectrum * (over_y[:, None] * over_x)))
            responses.append(response[_PAD : _PAD + plane.shape[0], _PAD : _PAD + plane.shape[1]])
    return responses


def _gabor(small: SmallLab) -> Features:
    """Mean |response| of 12 Gabor filters per channel, (m, 36): LSA16 section 4.7."""
    responses = [r for c in range(3) for r in gabor_responses(small.lab[..., c], _WAVES, 4)]
    sums, counts = small.sums(np.stack(responses, axis=-1))
    return lambda groups: grouped(sums, groups) / grouped(counts.astype(np.float64), groups)[:, None]


def _quadtree(small: SmallLab, superpixels: Superpixels) -> Features:
    """Means of Lab in 1 + 4 + 16 cells of a square around the centre, (m, 63): LSA16 section 4.7.

    The square's side is twice the level's scale.
    """
    height, width = small.ids.shape
    known = np.concatenate([small.lab * (small.ids > 0)[..., None], (small.ids > 0)[..., None]], -1)
    integral = np.zeros((height + 1, width + 1, 4))
    integral[1:, 1:] = known.astype(np.float64).cumsum(0).cumsum(1)
    sizes = superpixels.sizes.astype(np.float64)

    def features(groups: np.ndarray) -> np.ndarray:
        areas = grouped(sizes, groups)
        centres = grouped(superpixels.positions * sizes[:, None], groups) / areas[:, None] / small.factor
        side = 2.0 * math.sqrt(areas.mean()) / small.factor
        means = []
        for cells in (1, 2, 4):
            edges = (np.arange(cells + 1) / cells - 0.5) * side
            x, y = (
                np.clip(np.rint(centres[:, i, None] + edges), 0, limit).astype(np.int64)
                for i, limit in ((0, width), (1, height))
            )
            for j in range(cells):
                for i in range(cells):
                    # a cell beyond the border looks at the pixels that are nearest to it
                    left, top = np.minimum(x[:, i], width - 1), np.minimum(y[:, j], height - 1)
                    right, bottom = np.maximum(x[:, i + 1], left + 1), np.maximum(y[:, j + 1], top + 1)
                    total = (
                        integral[bottom, right] - integral[top, right] - integral[bottom, left] + integral[top, left]
                    )
                    means.append(total[:, :3] / np.maximum(total[:, 3:], 1.0))
        return np.concatenate(means, axis=1) / math.sqrt(len(means))

    return features


def _texton_histograms(small: SmallLab, superpixels: Superpixels, session: Session) -> Features:
    """Square roots of texton histograms, (m, TEXTONS): Euclidean distances of them are Hellinger's.

    Textons are clusters of 18 Gabor energies (three octaves, six directions), three Laplacians of L, and colour. A
    finest superpixel counts those of its neighbours too, by a Gaussian of half its scale: alone it holds too few
    pixels to tell what it is a part of. Not in the paper; better than its features on the ground truth
    (benchmarks/README.md).
    """
    textons = texton_map(small.texture(session), session)
    count = int(textons.max()) + 1
    ids = small.ids.ravel().astype(np.int64)
    table = np.bincount(ids * count + textons.ravel(), minlength=(small.count + 1) * count)
    counts = table.reshape(small.count + 1, count)[1:].astype(np.float64)
    missed = np.flatnonzero(counts.sum(1) == 0)
    counts[missed, textons[small.places[missed, 0], small.places[missed, 1]]] = 1.0
    counts = _neighbourly(superpixels.positions, _POOLED * superpixels.sigma) @ counts

    def features(groups: np.ndarray) -> np.ndarray:
        sums = grouped(counts, groups)
        return _UNIT * np.sqrt(sums / sums.sum(1, keepdims=True))

    return features


def _neighbourly(positions: np.ndarray, sigma: float) -> sparse.csr_array:
    """Gaussian weights between places that are near each other, (n, n); 1 for each itself."""
    pairs = cKDTree(positions).sparse_distance_matrix(cKDTree(positions), 2.5 * sigma, output_type="coo_matrix")
    weights = np.exp(-(pairs.data**2) / (2.0 * sigma**2))
    apart = pairs.row != pairs.col
    n = len(positions)
    near = sparse.csr_array((weights[apart], (pairs.row[apart], pairs.col[apart])), shape=(n, n))
    near.sort_indices()  # sums in one order
    return near + sparse.eye_array(n, format="csr")


@dataclass(frozen=True)
class Texture:
    """How an image looks around every pixel: what textons are clusters of.

    Attributes
    ----------
    seen : (h, w) bool
        Where textons are learned.
    responses : list of (h w,) float32
        Energies of 18 Gabor filters and three Laplacians of L, in units of their deviations.
    colours : list of (h w,) float32
        L, a and b, a little blurred.
    """

    seen: np.ndarray
    responses: list[np.ndarray]
    colours: list[np.ndarray]


def texture_of(lab: np.ndarray, seen: np.ndarray, session: Session) -> Texture:
    """The texture of (h, w, 3) float32 Lab, (h, w) bool of which counts."""
    light, known = lab[..., 0], np.flatnonzero(seen.ravel())

    def energies(wave: float) -> list[np.ndarray]:
        return [gaussian_filter(r, 0.35 * wave, truncate=2.5) for r in gabor_responses(light, (wave,), 6)]

    def spots(sigma: float) -> np.ndarray:  # a difference of Gaussians is a Laplacian
        return gaussian_filter(light, sigma, truncate=3.0) - gaussian_filter(light, 1.6 * sigma, truncate=3.0)

    responses = [layer for octave in session.spread(energies, _WAVES) for layer in octave]
    responses += session.spread(spots, (1.4, 2.8, 5.6))
    responses = [_standard(response.ravel(), known, 1.0) for response in responses]
    return Texture(seen, responses, [gaussian_filter(lab[..., c], 1.0).ravel() for c in range(3)])


def texton_map(
    texture: Texture, session: Session, most: int = TEXTONS, colour: float = math.sqrt(3.0), samples: int = _SAMPLES
) -> np.ndarray:
    """The texton of every pixel, (h, w) int64, from 0 on.

    Parameters
    ----------
    texture : Texture
    session : Session
    most : int
        Textons.
    colour : float
        Weight of each of three colours against each of 21 responses.
    samples : int
        Pixels that textons are learned from, at most.
    """
    known = np.flatnonzero(texture.seen.ravel())
    planes = [*texture.responses, *(_standard(plane.copy(), known, colour) for plane in texture.colours)]
    if len(known) > samples:
        known = known[np.random.default_rng(0).choice(len(known), samples, replace=False)]
    centres = _centres(np.stack([plane[known] for plane in planes], axis=1), most)
    squares = (centres**2).sum(1) / 2.0

    def nearest(first: int) -> np.ndarray:
        block = np.stack([plane[first : first + _BLOCK] for plane in planes], axis=1)
        return (block @ centres.T - squares).argmax(1)

    textons = np.concatenate(list(session.spread(nearest, range(0, texture.seen.size, _BLOCK))))
    return textons.reshape(texture.seen.shape)


def _standard(plane: np.ndarray, seen: np.ndarray, weight: float) -> np.ndarray:
    """The values in units of their deviation, in place; less than half a Lab unit is noise and not blown up."""
    mean, deviation = plane[seen].mean(dtype=np.float64), plane[seen].std(dtype=np.float64)
    plane -= np.float32(mean)
    plane *= np.float32(weight / max(deviation, 0.5))
    return plane


def _spread_out(points: np.ndarray, count: int) -> np.ndarray:
    """`count` of (n, d) points, (count, d): k-means++ (Arthur and Vassilvitskii 2007).

    As kmeans2's own, to the bit; that measures the distances to all centres again for each.
    """
    random = np.random.default_rng(0)
    chosen = [int(random.integers(len(points)))]
    nearest = np.full(len(points), np.inf)
    while len(chosen) < count:
        np.minimum(nearest, cdist(points[chosen[-1:]], points, "sqeuclidean")[0], out=nearest)
        shares = nearest / nearest.sum()
        chosen.append(int(np.searchsorted(shares.cumsum(), random.uniform())))
    return points[chosen]


def _centres(sample: np.ndarray, most: int) -> np.ndarray:
    """k-means over a sample (n, d), at most (most, d) float32."""
    distinct = np.unique(np.rint(sample * 64.0) / 64.0, axis=0)
    if len(distinct) <= most:
        return distinct.astype(np.float32)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a centre that nobody is near stays where it was: no harm
        points = sample.astype(np.float64)
        centres, _ = kmeans2(points, _spread_out(points, most), 20, minit="matrix")
    return centres[np.isfinite(centres).all(1)].astype(np.float32)
