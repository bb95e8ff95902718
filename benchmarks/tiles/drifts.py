# SPDX-License-Identifier: Apache-2.0
"""Even textures, known low-frequency variation to add to them, and measures of both in a tile.

With a known drift (a gradient or stain) the right result is known: a good tile has the energies of the clean texture,
and none of the drift. Everything is measured in CIE Lab. L is the longer side of the clean texture, in px.
"""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import OpenImageIO as oiio
from scipy.fft import dct, idct, irfft, irfft2, next_fast_len, rfft, rfft2
from scipy.ndimage import maximum_filter
from skimage import color

from benchmarks.shared.measures import data_folder

# The rule: the middle square, at 160 px, blurred with sigma L/8, has at most .26 of its standard deviation of Lab, and
# shows one material without an object in it. That leaves out stains (sail cloth), veins (onyx), two materials (flower
# meadow), objects (rebar, a ruler in field photos of gravel) and maps. photos/grass_gray is scikit-image's grass.
EVEN = (
    "photos/bark_flaky.jpg", "photos/castle_brick_broken.jpg", "photos/clover_lawn.jpg",
    "photos/drone_forest_canopy.jpg", "photos/fabric_gingham_weave.jpg", "photos/facade_tiles.jpg",
    "photos/marble_tiles_4x4.jpg", "photos/moss_grass_stones_ground.jpg", "photos/pebbles_beach_shadow.jpg",
    "photos/roof_slates.jpg", "photos/sandstone_wall_cracked.jpg", "multiscale/sand_grain_ladder/sand_0355um.jpg",
    "multiscale/sand_grain_ladder/sand_0710um.jpg", "multiscale/sand_grain_ladder/sand_1400um.jpg",
    "pbr/rusty_metal/rusty_metal_albedo.jpg", "skimage/brick.png", "skimage/grass.png", "skimage/gravel.png",
)  # fmt: skip
HALVES = ("tune", "judge")
BANDS = (96, 48, 24)  # the longer side over sigma
DRIFT = 8  # the same: what is slower is drift
KEPT = 0.8, 1.25  # band energies that a tile may have, over the clean texture's
ALIKE = 0.85  # normalized correlation of a copy
REGION = 10  # the longer side over the side of a region whose copies are counted
SAMPLES = 4  # regions along a side
_FLAT = 0.5  # Lab units: a region with less deviation is noise


def half_of(name: str) -> str:
    """`tune` or `judge`, by a hash of a texture's name: it does not depend on the other textures."""
    return HALVES[hashlib.sha256(Path(name).stem.encode()).digest()[0] & 1]


def textures(half: str | None = None) -> list[Path]:
    """The files of even textures that exist here, of one half or all; the others are named."""
    import skimage

    inside = Path(skimage.__file__).parent / "data"
    found = []
    for name in EVEN:
        path = inside / Path(name).name if name.startswith("skimage/") else data_folder() / name
        if not path.is_file():
            print(f"NOT FOUND, skipped: {path}")
        elif half in (None, half_of(name)):
            found.append(path)
    return found


def square(path: Path, side: int, enlarged: bool = False) -> np.ndarray | None:
    """The middle square of a photo at that side, (side, side, 3) uint8; None of a smaller photo, unless enlarged."""
    photo = oiio.ImageBuf(str(path))
    spec = photo.spec()
    least = min(spec.width, spec.height)
    if least < side and not enlarged:
        return None
    x, y = (spec.width - least) // 2, (spec.height - least) // 2
    photo = oiio.ImageBufAlgo.cut(photo, oiio.ROI(x, x + least, y, y + least))
    photo = oiio.ImageBufAlgo.resize(photo, "lanczos3", roi=oiio.ROI(0, side, 0, side))
    pixels = photo.get_pixels(oiio.UINT8)
    return np.ascontiguousarray(pixels[..., :3] if pixels.shape[2] >= 3 else pixels[..., :1].repeat(3, 2))


# --- drifts ---

Drift = Callable[[np.ndarray, np.ndarray, np.ndarray], None]


def _gradient(lab: np.ndarray, x: np.ndarray, y: np.ndarray) -> None:
    lab[..., 0] += (x + 0.6 * y - 0.8) * 18


def _stain(lab: np.ndarray, x: np.ndarray, y: np.ndarray) -> None:
    stain = 1 / (1 + np.exp((np.hypot((x - 0.35) / 0.26, (y - 0.62) / 0.2) - 1) * 9))
    lab += stain[..., None] * (-11, 2, 8)


def _vignette(lab: np.ndarray, x: np.ndarray, y: np.ndarray) -> None:
    lab[..., 0] -= 48 * ((x - 0.5) ** 2 + (y - 0.5) ** 2)  # 24 in the corners


DRIFTS: dict[str, tuple[Drift, ...]] = {
    "none": (),
    "gradient": (_gradient,),
    "stain": (_stain,),
    "vignette": (_vignette,),
    "gradient+stain": (_gradient, _stain),
}


def drifted(clean: np.ndarray, name: str) -> np.ndarray:
    """A texture, (h, w, 3) uint8 sRGB, with one of `DRIFTS` added in Lab."""
    if not DRIFTS[name]:
        return clean.copy()
    lab = color.rgb2lab(clean)
    y, x = np.mgrid[0 : lab.shape[0], 0 : lab.shape[1]].astype(float)
    for add in DRIFTS[name]:
        add(lab, x / lab.shape[1], y / lab.shape[0])
    lab[..., 0] = np.clip(lab[..., 0], 1, 99)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # colors outside of sRGB are clipped, as by a camera
        rgb = color.lab2rgb(lab)
    return np.rint(255 * np.clip(rgb, 0, 1)).astype(np.uint8)


# --- measures ---


def blurred(lab: np.ndarray, sigma: float, tiled: bool) -> np.ndarray:
    """Every channel blurred; a tile wraps, a photo is reflected at its borders.

    By transforms: a Gaussian of sigma L/8 has as many taps as the image has pixels.
    """
    for axis in (0, 1):
        n = lab.shape[axis]
        cycles = np.arange(n // 2 + 1) / n if tiled else np.arange(n) / (2 * n)
        weights = np.exp(-2 * (np.pi * sigma * cycles) ** 2).reshape((-1, 1, 1) if axis == 0 else (1, -1, 1))
        if tiled:
            lab = irfft(rfft(lab, axis=axis) * weights, n, axis=axis)
        else:
            lab = idct(dct(lab, axis=axis) * weights, axis=axis)
    return lab


def band_energies(lab: np.ndarray, side: int, tiled: bool) -> np.ndarray:
    """Standard deviations of Lab without drift (slower than sigma L/8), blurred with sigma L/96, L/48 and L/24.

    Parameters
    ----------
    lab : (h, w, 3) float
    side : int
        L, of the clean texture: a tile may have another size.
    tiled : bool
    """
    even = lab - blurred(lab, side / DRIFT, tiled)
    return np.array([np.sqrt((blurred(even, side / n, tiled) ** 2).sum(2).mean()) for n in BANDS])


def drift_energy(lab: np.ndarray, side: int) -> float:
    """Variance of what is slower than sigma L/8, as it repeats when it is tiled."""
    return float(blurred(lab, side / DRIFT, True).reshape(-1, 3).var(0).sum())


def drift_gone(tile: np.ndarray, clean: np.ndarray, photo: np.ndarray) -> float | None:
    """Share of the drift's energy that a tile of the photo does not have; None if none was added. Lab, each."""
    side = max(clean.shape)
    before, after = drift_energy(clean, side), drift_energy(photo, side)
    if after <= before:
        return None
    return 1 - max(drift_energy(tile, side) - before, 0) / (after - before)


def half_width(lab: np.ndarray, side: int, tiled: bool) -> float:
    """Radius in px at which the autocorrelation without drift, mean over all directions, falls to one half."""
    even = lab - blurred(lab, side / DRIFT, tiled)
    power = (np.abs(rfft2(even, axes=(0, 1))) ** 2).sum(2)
    found = irfft2(power, s=lab.shape[:2])
    reach = max(2, side // 8)
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    radius, values = np.rint(np.hypot(x, y)).astype(int).ravel(), found[y, x].ravel()
    mean = np.bincount(radius, values)[:reach] / np.bincount(radius)[:reach]
    mean /= mean[0]
    below = np.flatnonzero(mean < 0.5)
    if not len(below):
        return float(reach)
    n = int(below[0])
    return n - 1 + (mean[n - 1] - 0.5) / (mean[n - 1] - mean[n])


class Correlations:
    """Normalized correlation of any region of a plane with all its other places."""

    def __init__(self, plane: np.ndarray, region: int, tiled: bool):
        self.region, self.shape = region, plane.shape
        if not tiled:  # places that wrap are cut off
            self.valid = tuple(n - region + 1 for n in plane.shape)
            plane = np.pad(plane, [(0, next_fast_len(n) - n) for n in plane.shape])
        else:
            self.valid = plane.shape
        self._plane = plane - plane.mean()
        self._spectrum = rfft2(self._plane)
        box = rfft2(self._placed(np.ones((region, region))))
        first, second = (self._correlated(rfft2(v), box) / region**2 for v in (self._plane, self._plane**2))
        self.deviation = np.sqrt(np.maximum(second - first**2, 0))

    def _placed(self, values: np.ndarray) -> np.ndarray:
        whole = np.zeros(self._plane.shape)
        whole[: self.region, : self.region] = values
        return whole

    def _correlated(self, spectrum: np.ndarray, other: np.ndarray) -> np.ndarray:
        return irfft2(spectrum * other.conj(), s=self._plane.shape)[: self.valid[0], : self.valid[1]]

    def of(self, y: int, x: int) -> np.ndarray:
        """With the region whose first pixel that is; 0 where all is flat."""
        seen = self._plane[y : y + self.region, x : x + self.region]
        flat = self._correlated(self._spectrum, rfft2(self._placed(seen - seen.mean()))) / self.region**2
        return flat / (max(seen.std(), _FLAT) * np.maximum(self.deviation, _FLAT))


def copies_seen(lab: np.ndarray, side: int, tiled: bool) -> float:
    """At how many other places one sees a region of L/10 px again, mean over regions on a grid.

    A place counts where normalized correlation of lightness is above .85 and nothing within half a region has more.
    Regular textures have such places themselves: compare with the clean texture's number.
    """
    region = max(4, round(side / REGION))
    plane = lab[..., 0]
    found = Correlations(plane, region, tiled)
    mode = "wrap" if tiled else "constant"
    numbers = []
    for v, u in np.ndindex(SAMPLES, SAMPLES):
        y, x = (round((n - region) * (0.5 + k) / SAMPLES) for n, k in zip(plane.shape, (v, u), strict=True))
        if plane[y : y + region, x : x + region].std() < _FLAT:
            continue
        values = found.of(y, x)
        peaks = (values > ALIKE) & (values == maximum_filter(values, region, mode=mode))
        apart = [np.abs(np.arange(n) - at) for n, at in zip(values.shape, (y, x), strict=True)]
        if tiled:
            apart = [np.minimum(a, n - a) for a, n in zip(apart, values.shape, strict=True)]
        own = np.maximum(apart[0][:, None], apart[1][None, :]) <= region // 2
        numbers.append(int((peaks & ~own).sum()))
    return float(np.mean(numbers)) if numbers else 0.0


def spread(lab: np.ndarray) -> float:
    """Standard deviation of Lab."""
    return float(np.sqrt(lab.reshape(-1, 3).var(0).sum()))


class Clean(NamedTuple):
    """Known facts of a clean texture: Lab, L, and its measures."""

    lab: np.ndarray
    side: int
    bands: np.ndarray
    width: float
    copies: float

    @classmethod
    def of(cls, pixels: np.ndarray) -> Clean:
        """Of (h, w, 3) uint8 sRGB."""
        lab, side = color.rgb2lab(pixels), max(pixels.shape[:2])
        return cls(
            lab, side, band_energies(lab, side, False), half_width(lab, side, False), copies_seen(lab, side, False)
        )
