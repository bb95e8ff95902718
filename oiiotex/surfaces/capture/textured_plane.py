# SPDX-License-Identifier: Apache-2.0
"""The perspective of a plane with a texture that has no lattice: stones, planks, shingles, grass.

Seen from the front, a texture has the same spectrum everywhere. In perspective its spectrum varies from place to place
as the derivative of x / (1 + l x) varies, where l gives the vanishing line: the homogeneity of Malik and Rosenholtz
(Computing local surface orientation and shape from texture for curved surfaces, IJCV 23(2), 1997) and of Criminisi and
Zisserman (Shape from texture: homogeneity revisited, BMVC 2000). Each place's log spectrum is measured once. For each l
it is read at the frequencies that the same texture would have from the front, and l is the one that leaves the least
variance between places. Contrast is not compared, because light changes it.

Noise and a material that varies also lower the variance for some l. So l must explain a large share of what any smooth
change over the photo, of each frequency on its own, explains.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ...engine.core.demand import at_most
from ...engine.deferred import np

_SIDE = 512  # px; longer side of the photo in the search
_WINDOW, _STEP = 96, 40  # px; side of a place, and the distance of neighbors
_SMALLEST = 48  # px; least side of a place
_RADII, _TURNS = 8, 8  # frequencies from the front
_BAND = 0.04, 0.25  # cycles per px, their range from the front
_SEEN = 3.0, 0.35  # cycles per window, and cycles per px: range of frequencies that a place can show
_OPAQUE = 0.99  # least mean alpha of a place
_PLAIN = 0.7, 0.5  # least standard deviation of a place, CIE Lab (photos: 1.8 or more), and least share of such places
_STEEPEST, _FIRST, _FINEST = 0.8, 0.2, 0.0125  # of l, times the photo's sides: range and steps
_NEAREST = 0.12  # least 1 + l x in the photo
_COMPARED = 0.35  # least share of frequencies that are seen
_PLACES = 4, 0.25  # least number and share of places that show a frequency
LEAST_RATIO = 1.3  # of scales, from which a photo is oblique
# Evidence, calibrated on 75 photos. `_WHOLE` is the explained share times its share of what is smooth: three planes
# with joints have .21 to .44, other photos at most .13. Of sizes alone, grass, cobbles in fans and lemons have .23 to
# .74, and .78 to .91 of what is smooth; a mulch out of focus has .37 and .56.
_WHOLE = 0.17
_SIZES, _SIZES_LINEAR, _SIZES_SHARE = 0.22, 0.12, 0.65


@dataclass(frozen=True)
class TexturedPlane:
    """A plane in perspective."""

    vanishing: np.ndarray  # (2,) float64: l, per px
    explained: float  # share of the variance of spectra between places that this perspective explains
    ratio: float  # largest over smallest scale in the photo


def textured_plane(values: np.ndarray, opaque: np.ndarray | None = None) -> TexturedPlane | None:
    """The perspective that makes a photo's texture the same everywhere; None if none does, or hardly any is needed.

    Parameters
    ----------
    values : (height, width, 3 or more) float32
        CIE Lab.
    opaque : (height, width) bool or None
        Valid pixels; None: all.
    """
    height, width = values.shape[:2]
    if min(height, width) < 2 * _SMALLEST:
        return None
    opaque = np.ones((height, width), bool) if opaque is None else opaque
    lab, usable = at_most(_SIDE, values[..., :3], opaque[..., None].astype(np.float32))
    spectra, size = _spectra(lab, usable[..., 0]), lab.shape[1::-1]
    if spectra is None:
        return None
    at = _whole_spectrum(spectra, size)
    if at is None:
        at = _sizes(spectra, size)
    if at is None:
        return None
    vanishing, explained = at
    corners = 1 + np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2 @ vanishing
    ratio = float(corners.max() / corners.min())
    return TexturedPlane(vanishing / (width, height), explained, ratio) if ratio >= LEAST_RATIO else None


@dataclass(frozen=True)
class _Spectra:
    """Log spectra of places of the photo."""

    values: np.ndarray  # (places, side, side) float64; frequency 0 is in the middle
    places: np.ndarray  # (places, 2) float64: px from the photo's center
    side: int  # px

    def from_front(self, vanishing: np.ndarray, sizes: bool) -> tuple[np.ndarray, np.ndarray]:
        """Spectra (places, n) at given frequencies from the front, and which of them are seen.

        `sizes`: means over all directions.
        """
        depth = 1 + self.places @ vanishing
        front = _frequencies()
        along = (self.places @ front.T / depth[:, None] ** 2)[..., None] * vanishing
        seen = front / depth[:, None, None] - along  # the transposed derivative of x / (1 + l x), times a frequency
        length = np.hypot(seen[..., 0], seen[..., 1])
        shown = (length > _SEEN[0] / self.side) & (length < _SEEN[1])
        spectra = self._read(seen * self.side + self.side // 2)
        if not sizes:
            return spectra, shown
        spectra, shown = (one.reshape(len(depth), _RADII, _TURNS) for one in (spectra, shown))
        count = shown.sum(-1)
        return (spectra * shown).sum(-1) / np.maximum(count, 1), count > _TURNS / 2

    def _read(self, at: np.ndarray) -> np.ndarray:
        """Bilinear interpolation."""
        at = np.clip(at, 0, self.side - 1.001)
        whole = at.astype(np.intp)
        (u, v), (x, y) = np.moveaxis(at - whole, -1, 0), np.moveaxis(whole, -1, 0)
        n = np.arange(len(at))[:, None]
        upper = self.values[n, y, x] * (1 - u) + self.values[n, y, x + 1] * u
        return (1 - v) * upper + v * (self.values[n, y + 1, x] * (1 - u) + self.values[n, y + 1, x + 1] * u)


def _frequencies() -> np.ndarray:
    """Frequencies from the front, (radii * turns, 2) cycles per px."""
    radii = np.geomspace(*_BAND, _RADII)[:, None]
    turns = np.arange(_TURNS) * math.pi / _TURNS
    return np.stack([radii * np.cos(turns), radii * np.sin(turns)], -1).reshape(-1, 2)


def _spectra(lab: np.ndarray, usable: np.ndarray) -> _Spectra | None:
    """Log spectra of overlapping places; None if fewer than enough are valid, or show anything.

    Plain places (a bar, a frame, the background of a logo) are omitted: any l that hides them seems to explain much.
    """
    from scipy.ndimage import gaussian_filter  # scipy is not loaded before it is needed

    values = lab.astype(np.float64) - lab.mean((0, 1))
    light = values @ np.linalg.eigh(np.einsum("ijk,ijl->kl", values, values))[1][:, -1]
    height, width = light.shape
    side = min(_WINDOW, height // 2, width // 2)
    lines, columns = (np.linspace(0, n - side, max(2, round((n - side) / _STEP) + 1)).astype(int) for n in light.shape)
    taper = np.hanning(side + 2)[1:-1]
    window = taper[:, None] * taper
    powers, places, plain = [], [], 0
    for top in lines:
        for left in columns:
            at = np.s_[top : top + side, left : left + side]
            if usable[at].mean() >= _OPAQUE:
                piece = (light[at] - (light[at] * window).sum() / window.sum()) * window
                if (piece**2).sum() < _PLAIN[0] ** 2 * (window**2).sum():
                    plain += 1
                    continue
                powers.append(np.fft.fftshift(np.abs(np.fft.fft2(piece)) ** 2))
                places.append((left + (side - width) / 2, top + (side - height) / 2))
    if len(places) < max(2 * _PLACES[0], _PLAIN[1] * (len(places) + plain)):
        return None
    power = gaussian_filter(np.array(powers), (0, 1, 1))
    return _Spectra(np.log(power + 1e-9 * power.mean() + 1e-12), np.array(places), side)


def _departures(spectra: np.ndarray, shown: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Departures from the mean spectrum up to each place's contrast, and their weights, (places, n)."""
    count = shown.sum(0)
    weight = (shown & (count >= max(_PLACES[0], _PLACES[1] * len(spectra)))).astype(float)
    contrast, mean = np.zeros((len(spectra), 1)), np.zeros(spectra.shape[1])
    for _ in range(4):
        mean = ((spectra - contrast) * weight).sum(0) / np.maximum(weight.sum(0), 1)
        contrast = ((spectra - mean) * weight).sum(1, keepdims=True) / np.maximum(weight.sum(1, keepdims=True), 1)
    return (spectra - contrast - mean) * weight, weight


def _variance(spectra: _Spectra, vanishing: np.ndarray, sizes: bool) -> float:
    """Variance of log spectra between places; infinite if too few frequencies are seen."""
    departures, weight = _departures(*spectra.from_front(vanishing, sizes))
    seen = float(weight.sum())
    return float((departures**2).sum()) / seen if seen >= _COMPARED * weight.size else math.inf


def _smooth(spectra: _Spectra, sizes: bool) -> tuple[float, float, float]:
    """Variance without perspective, and the shares that polynomials of degree 1 (in y if `sizes`) and 2 explain."""
    departures, weight = _departures(*spectra.from_front(np.zeros(2), sizes))
    x, y = (spectra.places / np.maximum(np.abs(spectra.places).max(0), 1)).T
    one = np.ones_like(x)
    before, n = float((departures**2).sum()), len(x)
    shares = []
    for terms in ((one, y) if sizes else (one, x, y), (one, x, y, x * x, x * y, y * y)):
        basis = np.stack(terms, 1)
        rest = departures - basis @ np.linalg.lstsq(basis, departures, rcond=None)[0]
        rest = rest - rest.mean(1, keepdims=True)
        shares.append(1 - float((rest**2).sum()) * (n - 1) / max(n - len(terms), 1) / max(before, 1e-12))
    return before / max(float(weight.sum()), 1), shares[0], shares[1]


def _whole_spectrum(spectra: _Spectra, size: tuple[int, int]) -> tuple[np.ndarray, float] | None:
    """l times the photo's sides, and its share, by directions and sizes: of planks, joints, weaves."""
    known: dict[tuple[float, float], float] = {}

    def left(at: tuple[float, float]) -> float:
        key = round(at[0], 5), round(at[1], 5)
        if key not in known:
            near = 1 - (abs(at[0]) + abs(at[1])) / 2
            known[key] = _variance(spectra, np.array(at) / size, False) if near >= _NEAREST else math.inf
        return known[key]

    step, n = _FIRST, round(_STEEPEST / _FIRST)
    best = min(((x * step, y * step) for x in range(-n, n + 1) for y in range(-n, n + 1)), key=left)
    while step > _FINEST:
        step /= 2
        best = min(((best[0] + x, best[1] + y) for x in (0, -step, step) for y in (0, -step, step)), key=left)
    before, _, most = _smooth(spectra, False)
    explained = 1 - left(best) / max(before, 1e-12)
    share = min(1.0, explained / max(most, 1e-12))
    return (np.array(best), explained) if explained * share >= _WHOLE else None


def _sizes(spectra: _Spectra, size: tuple[int, int]) -> tuple[np.ndarray, float] | None:
    """The same by sizes alone, of what has no directions or stands upright: grass, stones, fruit.

    Sizes alone also vary in a front view (cracks, rust, leaves). So only what a camera sees that is tilted down counts.
    """
    slopes = np.arange(1, 18) / 20  # up to .85
    left = [_variance(spectra, np.array([0, slope / size[1]]), True) for slope in slopes]
    before, linear, most = _smooth(spectra, True)
    explained = 1 - min(left) / max(before, 1e-12)
    if linear < _SIZES_LINEAR or explained < max(_SIZES, _SIZES_SHARE * most):
        return None
    return np.array([0, slopes[int(np.argmin(left))]]), explained
