# SPDX-License-Identifier: Apache-2.0
"""The cast shadow that explains a photo best: its border, its penumbra, and the light inside.

Guo, Dai and Hoiem 2011, equation 1: a texture R is seen as (k D + E) R in the light of a lamp D and the sky E, for the
visible share k of the lamp. So both sides of a border have one texture, and in logarithms of linear RGB they differ by
one vector, which is bluish. It and the covariance of the texture weight the channels (Fisher's discriminant): blue
against red finds a border that lightness hides. k depends on the distance from the border's curves.

The curves are moved to the least squares of all cells by Gauss and Newton. Between stones and a shadow, they would
follow the stones: how evenly they bend is decided by the evidence (MacKay 1992, Bayesian interpolation, section 4).
"""

from __future__ import annotations

from dataclasses import dataclass

from threadpoolctl import threadpool_limits

from ...engine.core.elementary import exponential, logarithm
from ...engine.deferred import np
from .border_curves import BorderCurve, distances, traced

CELLS = 96  # along the longer side of a photo
SURE = 150.0  # gain in log likelihood
_BLUISH = 1.05, 2.5  # least and largest share of the sky in blue over that in red
_BETWEEN = 1.02  # by which the share in green may be outside of those in red and blue
_LARGEST_SKY = 0.97  # a fainter shadow is none
_STARTS = (1.0, 1.0, 1.0), (1.0, 0.0, -1.0)  # directions in R, G, B of the first borders: lightness, and blueness
_LEVEL = 4.0  # cells; sigma of the level that the first border is decided on
_CURVE = 3.0  # cells; sigma of the first curves
_TEXTURE = 3.0  # cells; sigma at which the texture's own variation counts as noise
_ISLAND = 0.1  # least diameter of a region, relative to the longer side
_SHORTEST = 12  # points of a curve
_MOST_POINTS = 8 * CELLS  # of all curves: longer ones follow the texture
_STEPS, _MOST_MOVED, _STILL = 14, 2.0, 0.1  # of Gauss and Newton: number, cells a step, and cells that end them
_STRAIGHTNESS = 10.0 ** np.arange(10)  # weights of uneven bending that are tried
_FIRST_WIDTH, _LEAST_WIDTH = 2.5, 0.25  # cells; sigma of a penumbra
_WIDTHS = np.array([0.7, 0.84, 1.0, 1.19, 1.42])  # relative to the last one
_FULL = 2.5  # widths: farther ones are in full light or full shade
_INDEPENDENT = 30.0  # cells that count as one observation
_EDGE_COST = 3.0  # cells of border that cost one unit of log likelihood
_SPLINE = 3.0**-0.5  # sigma of a cubic B-spline


@dataclass(frozen=True)
class CastShadow:
    """A shadow in cells of a photo.

    Attributes
    ----------
    distance : (rows, columns) float
        From the border, in cells, positive in light.
    width : float
        Sigma of the penumbra, in cells.
    sky : (3,) float
        Light inside over light outside, in linear R, G, B.
    gain : float
        Of log likelihood, over a photo without shadow.
    """

    distance: np.ndarray
    width: float
    sky: np.ndarray
    gain: float

    @property
    def is_sure(self) -> bool:
        """Whether it is a shadow rather than dark material: skylight gets stronger from red to blue."""
        red, green, blue = self.sky.tolist()
        is_bluish = _BLUISH[0] * red <= blue <= _BLUISH[1] * red
        return self.gain >= SURE and is_bluish and red / _BETWEEN <= green <= blue * _BETWEEN


def visible(distance: np.ndarray) -> np.ndarray:
    """Visible share of the lamp at a distance in widths of the penumbra: the integral of a cubic B-spline.

    Close to the normal distribution, but it ends: what is more than 3.5 widths away is in full light.
    """
    at = np.minimum(np.abs(distance) * _SPLINE, 2)
    inner, outer = at * (2 / 3 - at**2 * (1 / 3 - at / 8)), 0.5 - (2 - at) ** 4 / 24
    return 0.5 + np.sign(distance) * np.where(at < 1, inner, outer)


def _slope(distance: np.ndarray) -> np.ndarray:
    """Derivative of `visible`."""
    at = np.minimum(np.abs(distance) * _SPLINE, 2)
    return _SPLINE * np.where(at < 1, 2 / 3 - at**2 * (1 - at / 2), (2 - at) ** 3 / 6)


def cast_shadow(logs: np.ndarray, valid: np.ndarray) -> CastShadow | None:
    """The shadow that explains logarithms of linear RGB best; None if nothing looks like one.

    Parameters
    ----------
    logs : (rows, columns, 3) float
    valid : (rows, columns) bool
        Cells that count. The others have any finite value.
    """
    logs = np.where(valid[..., None], logs, np.median(logs[valid], axis=0))
    with threadpool_limits(1, "blas"):
        masks = [mask for start in _STARTS if (mask := _first_shade(logs, np.array(start))) is not None]
        found = [shadow for mask in masks if (shadow := _fitted(logs, valid, mask)) is not None]
    return max(found, key=lambda shadow: shadow.gain, default=None)


# --- the first border ---


def _first_shade(logs: np.ndarray, start: np.ndarray) -> np.ndarray | None:
    """The darker of two classes of levels (Otsu), in the direction that separates both best; (rows, columns) bool."""
    from scipy.ndimage import binary_erosion, gaussian_filter  # slow to import

    level = gaussian_filter(logs, (_LEVEL, _LEVEL, 0), mode="nearest")
    shade, reach = _below_otsu((level * start).sum(-1)), round(_LEVEL) + 1
    for _ in range(6):
        core, lit = (binary_erosion(one, iterations=reach, border_value=1) for one in (shade, ~shade))
        if min(core.sum(), lit.sum()) < CELLS / 3:
            return None
        within = sum(np.cov(level[one].T) * one.sum() for one in (core, lit)) / (core.sum() + lit.sum())
        apart = level[lit].mean(0) - level[core].mean(0)
        if apart.sum() <= 0:  # the bluish side is not the darker one
            return None
        shade = _below_otsu((level * np.linalg.solve(within + 1e-4 * np.eye(3), apart)).sum(-1))
    return _without_islands(shade)


def _without_islands(shade: np.ndarray) -> np.ndarray:
    from scipy.ndimage import label  # slow to import

    least = np.pi / 4 * (_ISLAND * max(shade.shape)) ** 2
    for one in (shade, ~shade):
        places, _ = label(one)
        shade = np.where((np.bincount(places.ravel()) < least)[places] & one, ~shade, shade)
    return shade


def _below_otsu(values: np.ndarray) -> np.ndarray:
    ordered = np.sort(values.ravel())
    below = np.arange(1, len(ordered))
    sums = np.cumsum(ordered)
    low, high = sums[:-1] / below, (sums[-1] - sums[:-1]) / (len(ordered) - below)
    best = int((below * (len(ordered) - below) * (high - low) ** 2).argmax())
    return values < ordered[best : best + 2].mean()


# --- its fit ---


@dataclass(frozen=True)
class _Light:
    """Levels outside, (3,), the sky's share inside, (3,), and the texture's precision for a cell, (3, 3)."""

    lamp: np.ndarray
    sky: np.ndarray
    precision: np.ndarray

    def seen(self, share: np.ndarray) -> np.ndarray:
        """Logarithms of RGB where that share of the lamp is visible, (..., 3)."""
        return self.lamp + logarithm(share[..., None] * (1 - self.sky) + self.sky)

    def misfit(self, rest: np.ndarray) -> float:
        """Of residuals (n, 3)."""
        return float(np.einsum("ij,jk,ik->", rest, self.precision, rest))


def _fitted(logs: np.ndarray, valid: np.ndarray, shade: np.ndarray) -> CastShadow | None:
    curves = [curve.smoothed(_CURVE).extended() for curve in traced(shade) if len(curve.points) >= _SHORTEST]
    width, still = _FIRST_WIDTH, False
    for _ in range(_STEPS):
        if not 0 < sum(len(curve.points) for curve in curves) <= _MOST_POINTS:
            return None
        distance, nearest = distances(curves, valid.shape)
        levels = _light(logs, valid, distance, max(_FULL * width, 2.0))
        if levels is None:
            return None
        light = levels
        near = valid & (np.abs(distance) < max(4 * width, 6.0))
        widths = np.maximum(width * _WIDTHS, _LEAST_WIDTH)
        seen = logs[near]
        width = float(min(widths, key=lambda one: light.misfit(seen - light.seen(visible(distance[near] / one)))))
        if still:
            break
        movement = _movement(curves, seen, distance[near], nearest[near], width, light)
        still = bool(np.abs(movement).max() < _STILL)
        ends = np.cumsum([len(curve.points) for curve in curves])[:-1]
        parts = np.split(np.clip(movement, -_MOST_MOVED, _MOST_MOVED), ends)
        curves = [curve.moved(part) for curve, part in zip(curves, parts, strict=True)]
    rest = logs - light.seen(visible(distance / width))
    border = np.count_nonzero(np.abs(distance) < 0.5) / _EDGE_COST
    gain = _log_likelihood(rest) - border - _log_likelihood(logs - logs.mean((0, 1)))
    return CastShadow(distance, width, light.sky, gain)


def _light(logs: np.ndarray, valid: np.ndarray, distance: np.ndarray, full: float) -> _Light | None:
    """The levels farther than `full` from the border; None: too few cells are."""
    from scipy.ndimage import gaussian_filter  # slow to import

    lit, core = valid & (distance > full), valid & (distance < -full)
    if min(lit.sum(), core.sum()) < CELLS / 4:
        return None
    lamp, dark = logs[lit].mean(0), logs[core].mean(0)
    sky = exponential(dark - lamp)
    if sky.max() > _LARGEST_SKY:
        return None
    even = np.where(lit[..., None], logs - lamp, np.where(core[..., None], logs - dark, 0))
    counted = np.maximum(gaussian_filter((lit | core).astype(float), _TEXTURE), 0.1)[..., None]
    noise = (gaussian_filter(even, (_TEXTURE, _TEXTURE, 0)) / counted)[lit | core]
    # a Gaussian averages 4 pi sigma^2 cells
    return _Light(lamp, sky, np.linalg.inv(4 * np.pi * _TEXTURE**2 * (np.cov(noise.T) + 1e-5 * np.eye(3))))


def _movement(
    curves: list[BorderCurve], seen: np.ndarray, distance: np.ndarray, nearest: np.ndarray, width: float, light: _Light
) -> np.ndarray:
    """How far each point of the curves moves toward the light, in cells, (points,).

    `seen` (n, 3), `distance` (n,), `nearest` (n,): the cells near the border.
    """
    share = visible(distance / width)
    darker = -(1 - light.sky) / (share[..., None] * (1 - light.sky) + light.sky)
    darker = darker * (_slope(distance / width) / width)[:, None]
    weighted = darker @ light.precision
    points = sum(len(curve.points) for curve in curves)
    stiff = np.bincount(nearest, (weighted * darker).sum(-1), points)
    pull = np.bincount(nearest, (weighted * (seen - light.seen(share))).sum(-1), points)
    uneven, reduction = _bending(curves)
    square, toward = reduction.T @ reduction, reduction.T @ uneven

    def tried(weight: float) -> tuple[float, np.ndarray]:
        """-2 log evidence of a weight of uneven bending, up to a constant, and its movement."""
        system = np.diag(stiff + 1e-6) + weight * square
        movement = np.linalg.solve(system, pull + weight * toward)
        misfit = (stiff * movement**2).sum() - 2 * (pull * movement).sum()
        misfit += weight * ((uneven - reduction @ movement) ** 2).sum()
        occam = np.linalg.slogdet(system)[1] - len(uneven) * np.log(weight)
        return float(misfit + occam), movement

    return min(map(tried, _STRAIGHTNESS), key=lambda result: result[0])[1]


def _bending(curves: list[BorderCurve]) -> tuple[np.ndarray, np.ndarray]:
    """`BorderCurve.bending` of all curves together."""
    each = [curve.bending() for curve in curves]
    uneven = np.concatenate([one for one, _ in each])
    whole = np.zeros((len(uneven), sum(len(curve.points) for curve in curves)))
    row = column = 0
    for _, reduction in each:
        rows, columns = reduction.shape
        whole[row : row + rows, column : column + columns] = reduction
        row, column = row + rows, column + columns
    return uneven, whole


def _log_likelihood(rest: np.ndarray) -> float:
    """Of residuals (rows, columns, 3) of a normal distribution, up to a constant."""
    from scipy.ndimage import gaussian_filter  # slow to import

    smooth = gaussian_filter(rest, (1.5, 1.5, 0)).reshape(-1, 3)
    return float(-0.5 * len(smooth) / _INDEPENDENT * np.linalg.slogdet(np.cov(smooth.T) + 1e-5 * np.eye(3))[1])
