# SPDX-License-Identifier: Apache-2.0
"""A cast shadow removed by its fitted border: what --texflatten could reach. Not part of the package.

python -m benchmarks.tiles.shadow_border [--side 384] [--half tune|judge]

The cases are those of shadows.py. The model is that of Guo, Dai and Hoiem 2011, I = (k D + E) R, in logarithms of
linear RGB, as means of cells. Both sides of a shadow have one texture R, so its interior and its exterior differ by one
vector, the share of the sky. This and the covariance of the texture weight the channels: blue against red finds a
border that lightness hides (Fisher's discriminant). The border is the zero line of a distance phi, k = Phi(phi / w) for
the normal distribution Phi and one width w of the penumbra. Phi is moved to the least squares of all cells by Gauss and
Newton, as far as its movement stays smooth. A shadow is sure if the fit explains the photo better by SURE and the shade
is bluish.
"""

from __future__ import annotations

import argparse
from typing import NamedTuple

import numpy as np
from scipy.ndimage import binary_erosion, distance_transform_edt, gaussian_filter, label, map_coordinates, zoom
from scipy.sparse.linalg import LinearOperator, cg
from scipy.special import ndtr

from benchmarks.tiles import drifts, shadows
from benchmarks.tiles.first_tile import cell

CELLS = 96  # along the longer side
SURE = 150.0  # gain in log likelihood; up to 125 on 19 photos of stains, windows, rust and dark bricks
BLUISH = 1.05  # least share of the sky in blue over that in red
_LEVEL = 4.0  # cells; sigma of the level that the first border is decided on
_TEXTURE = 3.0  # cells; sigma at which the texture's own variation counts as noise
_SMOOTH = 30.0  # weight of the smoothness of a movement
_ISLAND = 0.1  # least diameter of a region, relative to the longer side
_STEPS = 12
_WIDTHS = (0.7, 0.84, 1.0, 1.19, 1.42)  # of the penumbra, relative to the last one
_INDEPENDENT = 30.0  # cells that count as one observation
_EDGE_COST = 3.0  # cells of border that cost one unit of log likelihood


class Shadow(NamedTuple):
    """A fitted shadow: signed distance (cells), width of the penumbra (cells), share of the sky (3,), and gain."""

    phi: np.ndarray
    width: float
    sky: np.ndarray
    gain: float

    @property
    def is_sure(self) -> bool:
        """Whether it is a shadow rather than dark material."""
        return self.gain >= SURE and bool(self.sky[2] >= BLUISH * self.sky[0])


def _first_mask(y: np.ndarray) -> np.ndarray | None:
    """The darker of two classes of levels (Otsu), in the direction that separates both best; (rows, columns) bool."""
    level = gaussian_filter(y, (_LEVEL, _LEVEL, 0), mode="nearest")
    mask, reach = _below_otsu(level.sum(-1)), round(_LEVEL) + 1
    for _ in range(6):
        core, lit = (binary_erosion(one, iterations=reach, border_value=1) for one in (mask, ~mask))
        if min(core.sum(), lit.sum()) < CELLS / 3:
            return None
        within = sum(np.cov(level[one].T) * one.sum() for one in (core, lit)) / (core.sum() + lit.sum())
        apart = level[lit].mean(0) - level[core].mean(0)
        mask = _below_otsu(level @ np.linalg.solve(within + 1e-4 * np.eye(3), apart))
    least = np.pi / 4 * (_ISLAND * max(mask.shape)) ** 2
    for one in (mask, ~mask):
        places, _ = label(one)
        mask = np.where((np.bincount(places.ravel()) < least)[places] & one, ~mask, mask)
    return mask


def _below_otsu(values: np.ndarray) -> np.ndarray:
    ordered = np.sort(values.ravel())
    below = np.arange(1, len(ordered))
    sums = np.cumsum(ordered)
    low, high = sums[:-1] / below, (sums[-1] - sums[:-1]) / (len(ordered) - below)
    best = int((below * (len(ordered) - below) * (high - low) ** 2).argmax())
    return values < ordered[best : best + 2].mean()


def _signed_distance(phi: np.ndarray) -> np.ndarray:
    """Of the zero line of phi, in cells, to a quarter of a cell."""
    fine = zoom(phi, 4, order=1, grid_mode=True, mode="nearest") > 0
    away = distance_transform_edt(fine) - distance_transform_edt(~fine)
    return ((away - np.sign(away) / 2) / 4).reshape(phi.shape[0], 4, phi.shape[1], 4).mean((1, 3))


def _laplacian(x: np.ndarray) -> np.ndarray:
    wide = np.pad(x, 1, mode="edge")
    return wide[:-2, 1:-1] + wide[2:, 1:-1] + wide[1:-1, :-2] + wide[1:-1, 2:] - 4 * x


def _log_likelihood(rest: np.ndarray) -> float:
    """Of residuals (rows, columns, 3) of a normal distribution, up to a constant."""
    smooth = gaussian_filter(rest, (1.5, 1.5, 0)).reshape(-1, 3)
    return float(-0.5 * len(smooth) / _INDEPENDENT * np.linalg.slogdet(np.cov(smooth.T) + 1e-5 * np.eye(3))[1])


def fitted(y: np.ndarray) -> Shadow | None:
    """The shadow that explains logarithms of linear RGB best, (rows, columns, 3); None if there is none."""
    mask = _first_mask(y)
    if mask is None:
        return None
    phi, width = _signed_distance(gaussian_filter((~mask).astype(float), 1) - 0.5), 2.0
    light, sky = y.mean((0, 1)), np.ones(3)

    def explained(width: float) -> tuple[np.ndarray, np.ndarray]:
        shown = ndtr(phi / width)[..., None] * (1 - sky) + sky
        return light + np.log(shown), (1 - sky) / shown

    for _ in range(_STEPS):
        far = max(2.5 * width, 2.0)
        lit, core = phi > far, phi < -far
        if min(lit.sum(), core.sum()) < CELLS / 4:
            return None
        light, dark = y[lit].mean(0), y[core].mean(0)
        sky = np.exp(dark - light)
        if sky.max() > 0.97:
            return None
        even = np.where(lit[..., None], y - light, np.where(core[..., None], y - dark, 0))
        counted = np.maximum(gaussian_filter((lit | core).astype(float), _TEXTURE), 0.1)[..., None]
        noise = (gaussian_filter(even, (_TEXTURE, _TEXTURE, 0)) / counted)[lit | core]
        weight = np.linalg.inv(4 * np.pi * _TEXTURE**2 * (np.cov(noise.T) + 1e-5 * np.eye(3)))
        near = np.abs(phi) < max(4 * width, 6)
        tried = [share * width for share in _WIDTHS if share * width >= 0.25]
        rests = [(y - explained(one)[0])[near] for one in tried]
        width = tried[int(np.argmin([np.einsum("ij,jk,ik->", rest, weight, rest) for rest in rests]))]
        model, slope = explained(width)
        slope = slope * (np.exp(-0.5 * (phi / width) ** 2) / np.sqrt(2 * np.pi) / width)[..., None]
        stiff = np.einsum("ijk,kl,ijl->ij", slope, weight, slope)
        pull = np.einsum("ijk,kl,ijl->ij", slope, weight, y - model)

        def moved(x: np.ndarray, stiff: np.ndarray = stiff) -> np.ndarray:
            x = x.reshape(stiff.shape)
            return (stiff * x + _SMOOTH * _laplacian(_laplacian(x)) + 1e-3 * x).ravel()

        system = LinearOperator((phi.size, phi.size), moved)
        movement, _ = cg(system, pull.ravel(), rtol=1e-3, maxiter=200)
        phi = _signed_distance(phi + np.clip(movement.reshape(phi.shape), -2, 2))
    border = np.count_nonzero(np.abs(phi) < 0.5) / _EDGE_COST
    gain = _log_likelihood(y - explained(width)[0]) - border - _log_likelihood(y - y.mean((0, 1)))
    return Shadow(phi, width, sky, gain)


def without_shadow(photo: np.ndarray) -> tuple[np.ndarray, bool]:
    """A photo, (h, w, 3) uint8 sRGB, in full light, if its shadow is sure; and whether it is."""
    linear, side = (photo / 255.0) ** 2.2, max(2, max(photo.shape[:2]) // CELLS)
    down, across = (n // side for n in photo.shape[:2])
    cells = linear[: down * side, : across * side].reshape(down, side, across, side, 3).mean((1, 3))
    found = fitted(np.log(cells + 2e-3))
    if found is None or not found.is_sure:
        return photo, False
    at = [(np.arange(n) + 0.5) / side - 0.5 for n in photo.shape[:2]]
    phi = map_coordinates(found.phi, np.meshgrid(*at, indexing="ij"), order=3, mode="nearest")
    lit = linear / (ndtr(phi / found.width)[..., None] * (1 - found.sky) + found.sky)
    return np.rint(255 * np.clip(lit, 0, 1) ** (1 / 2.2)).astype(np.uint8), True


def main() -> None:
    """Print a table: a row for each shape and softness, of the textures whose shadow is sure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--side", type=int, default=384, help="px")
    parser.add_argument("--half", choices=drifts.HALVES, help="of the textures, default: both")
    given = parser.parse_args()
    cleans = [drifts.square(path, given.side) for path in drifts.textures(given.half)]
    print(f"Goals: {shadows.GOALS}.\n")
    print("| shadow | sure | delta E inside | least band | largest band | changed outside | good |")
    print("| --- " * 7 + "|")
    for shape in shadows.SHAPES:
        for softness in shadows.SOFT:
            k = shadows.visible(given.side, shape, softness)
            results = [(*without_shadow(shadows.shaded(clean, k)), clean) for clean in cleans if clean is not None]
            figures = [shadows.measured(result, clean, k) for result, is_sure, clean in results if is_sure]
            columns = [cell(f[key] for f in figures) for key in ("inside", "least", "most", "changed")]
            good = f"{sum(map(shadows.is_good, figures))} of {len(results)}"
            sure = f"{len(figures)} of {len(results)}"
            print("| " + " | ".join([f"{shape}, {softness}", sure, *columns, good]) + " |", flush=True)


if __name__ == "__main__":
    main()
