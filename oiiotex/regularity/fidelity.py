# SPDX-License-Identifier: Apache-2.0
"""Whether a result still looks like its photo: what it keeps of the photo's scales, shapes and colors.

Crushed structure has less energy in its coarse bands, broken shapes have another autocorrelation, and objects that
were lost take their colors with them. Each part is 1 for a result that cannot be told from another piece of the same
texture, and the fidelity is the root of their product.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..core.demand import MadeRows, SomeRows
from ..core.image import resized
from ..deferred import np
from .autocorrelation import Autocorrelation, autocorrelation, blurred, high_passed, wrapped_autocorrelation

SIDE = 256  # px; longer side that a photo is looked at with; its result at the same scale
LEAST = 48  # px; shorter sides say nothing
SCALES = 96, 48, 24  # sigmas of the bands are the longer side over these
ENOUGH = 0.8  # of a band's energy, or its inverse: another piece of one texture has as little
ALIKE = 0.7  # the same of two autocorrelations
GOOD = 0.8  # a result below is tried again, warned about, or sent to review
_SHAPES = 6  # the longer side over this is how far shapes are compared
_MOST = 2 * SIDE  # px of a result that is looked at, in its middle
_COLORS = 8  # quantiles of a channel


@dataclass(frozen=True)
class Fidelity:
    """What a result keeps of its photo.

    Attributes
    ----------
    bands : tuple of float
        Energy over the photo's, of what a Gaussian of the longer side / 96, 48 and 24 leaves. Below 1 structure is
        crushed, above 1 there are blotches.
    shapes : float
        1 less the difference of the autocorrelations, as a share of the photo's.
    missing : float
        Share of the photo's colors that the result lacks, 0 to 1.
    """

    bands: tuple[float, ...]
    shapes: float
    missing: float

    @property
    def texture(self) -> float:
        """The bands as one number, 0 to 1."""
        return sum(min(1.0, min(band, 1.0 / max(band, 1e-9)) / ENOUGH) for band in self.bands) / len(self.bands)

    @property
    def value(self) -> float:
        """The fidelity, 0 to 1, to three digits: last bits decide nothing."""
        shapes = min(1.0, max(0.0, self.shapes) / ALIKE)
        return round(float(np.sqrt(self.texture * shapes * (1.0 - self.missing))), 3)

    def __str__(self) -> str:
        """One sentence for people."""
        coarse = sum(self.bands) / len(self.bands)
        said = "texture kept"
        if self.texture < 0.9:
            said = f"{100 * (1 - coarse):.0f} % of the coarse structure is lost" if coarse < 1 else "blotches were added"
        if self.shapes < GOOD * ALIKE:
            said += ", shapes are broken"
        return f"fidelity {self.value:.2f}: {said}; {100 * self.missing:.0f} % of the colors are missing"


def fidelity(
    photo: SomeRows, usable: np.ndarray | None, result: SomeRows, wraps: tuple[bool, bool]
) -> Fidelity | None:
    """How much a result keeps of its photo; None where either is too small to say.

    Parameters
    ----------
    photo : (height, width, 3) float32
        CIE Lab, without drift where that was to be removed.
    usable : (height, width) bool or None
        Pixels that count; None: all.
    result : (height, width, 3) float32
        CIE Lab.
    wraps : (bool, bool)
        The result is a torus along y, along x.
    """
    factor = min(1.0, SIDE / max(photo.shape[:2]))
    own, seen = _reduced(photo, usable, factor)
    lab, everywhere = _reduced(result, None, factor)
    if min(*own.shape[:2], *lab.shape[:2]) < LEAST or np.count_nonzero(seen) < LEAST**2:
        return None
    if max(lab.shape[:2]) > _MOST:
        middle = tuple(slice(max(0, (n - _MOST) // 2), max(0, (n - _MOST) // 2) + _MOST) for n in lab.shape[:2])
        lab, everywhere, wraps = lab[middle], everywhere[middle], (False, False)
    longer = max(own.shape[:2])
    before, after = high_passed(own, seen), high_passed(lab, everywhere, wraps)
    bands = tuple(
        _energy(after, everywhere, longer / k, wraps) / max(_energy(before, seen, longer / k), 1e-6) for k in SCALES
    )
    of_photo = _near(autocorrelation(before, seen), longer)
    torus = all(wraps)
    of_result = _near(wrapped_autocorrelation(lab) if torus else autocorrelation(after, everywhere), longer)
    count = min(len(of_photo), len(of_result)) // 2
    a, b = (ncc[len(ncc) // 2 - count : len(ncc) // 2 + count + 1] for ncc in (of_photo, of_result))
    shapes = 1.0 - float(np.sqrt(((a - b) ** 2).sum() / max(float((a**2).sum()), 1e-12)))
    return Fidelity(bands, shapes, _missing(own[seen], lab[everywhere]))


def _reduced(values: SomeRows, usable: np.ndarray | None, factor: float) -> tuple[np.ndarray, np.ndarray]:
    """Pixels at a scale, (h, w, 3) float64, and which of them count."""
    height, width = values.shape[:2]
    size = max(1, round(width * factor)), max(1, round(height * factor))
    counted = np.ones(size[::-1], bool)
    if usable is not None:
        mask = MadeRows((height, width, 1), np.float32, lambda first, last: usable[first:last, :, None])
        counted = resized(mask, *size)[..., 0] > 0.99
    return resized(values, *size).astype(np.float64), counted


def _energy(texture: np.ndarray, seen: np.ndarray, sigma: float, wraps: tuple[bool, bool] = (False, False)) -> float:
    """Standard deviation of what a Gaussian leaves of a high-passed texture, channels added up."""
    return float(np.sqrt((blurred(texture, sigma, wraps)[seen] ** 2).sum(-1).mean()))


def _near(alike: Autocorrelation, longer: int) -> np.ndarray:
    """The autocorrelation up to that distance, without offset 0, in a fixed order whatever the image's size."""
    x, y = alike.offsets()
    reach = longer / _SHAPES
    inside = (x * x + y * y <= reach * reach) & ((x != 0) | (y != 0))
    return alike.ncc[inside]


def _missing(photo: np.ndarray, result: np.ndarray) -> float:
    """Share of the photo's pixels (n, 3) whose color, among joint quantiles of its channels, the result has not."""
    cuts = [np.quantile(photo[:, c], np.arange(1, _COLORS) / _COLORS) for c in range(3)]
    shares = []
    for pixels in (photo, result):
        place = sum(np.searchsorted(cuts[c], pixels[:, c]) * _COLORS**c for c in range(3))
        shares.append(np.bincount(place, minlength=_COLORS**3) / len(pixels))
    return float(np.maximum(0.0, shares[0] - shares[1]).sum())
