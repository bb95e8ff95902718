# SPDX-License-Identifier: Apache-2.0
"""What a user may prescribe: pixels that stay, how often parts of the exemplar are used, a map of sigmas."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..device import Buffers, Device
from ..images import resized
from .histograms import OUTSIDE
from .patchmatch import Geometry, pack, to_grid, unpack
from .projections import Projecting

_SHARES = 256  # whole-number weights of a blend, so that it has the same bits everywhere


@dataclass(frozen=True)
class Held:
    """Pixels of the target that are given and stay.

    Attributes
    ----------
    where : (height, width) bool
        Of the target.
    places : (height, width) uint32
        The exemplar pixels that they show, packed (y << 16 | x); what it says of free pixels means nothing.
    is_goal : bool
        The free pixels get the overall histogram of the held ones, not of the exemplar.
    """

    where: np.ndarray
    places: np.ndarray
    is_goal: bool = False

    def image(self, exemplar: np.ndarray, geometry: Geometry) -> np.ndarray:
        """What the target must show on a level: its grid image, `OUTSIDE` where it is free.

        Parameters
        ----------
        exemplar : (height, width, channels) float32
            At full size.
        geometry : Geometry
            Of the level.
        """
        shown = coarse_image(exemplar[unpack(self.places)], self.where, geometry.width, geometry.height)
        kept = coarse_mask(self.where, geometry.width, geometry.height)
        return np.where(kept[..., None], to_grid(shown, geometry.patch), OUTSIDE)

    def first_guess(self, field: np.ndarray, shape: tuple[int, ...], geometry: Geometry) -> np.ndarray:
        """The field, in which patches that begin at a held pixel lie where that came from: the best guess there is."""
        g = geometry
        y = (np.arange(g.rows) * 2 + 1) * self.where.shape[0] // (2 * g.height)
        x = (np.arange(g.columns) * 2 + 1) * self.where.shape[1] // (2 * g.width)
        from_y, from_x = unpack(self.places[np.ix_(y, x)])
        guess_y = np.minimum(from_y * g.exemplar_height // shape[0], g.exemplar_rows - 1)
        guess_x = np.minimum(from_x * g.exemplar_width // shape[1], g.exemplar_columns - 1)
        return np.where(self.where[np.ix_(y, x)], pack(guess_y, guess_x), field)


@dataclass(frozen=True, kw_only=True)
class Guidance:
    """All of it; None where nothing is prescribed.

    Attributes
    ----------
    held : Held or None
    weight : (height, width) float32 or None
        Of the exemplar: how often a pixel is to be used beside others, 0 never.
    sigmas : (height, width) float32 or None
        Of the target: its sigma at each pixel, px.
    """

    held: Held | None = None
    weight: np.ndarray | None = None
    sigmas: np.ndarray | None = None

    def patch_weights(self, patches: np.ndarray, geometry: Geometry) -> np.ndarray | None:
        """The mean weight of each exemplar patch on a level, relative to that of all that may be used."""
        if self.weight is None:
            return None
        small = resized(self.weight[..., None], geometry.exemplar_width, geometry.exemplar_height)[..., 0]
        sums = np.zeros((small.shape[0] + 1, small.shape[1] + 1))
        sums[1:, 1:] = small.cumsum(0, dtype=np.float64).cumsum(1)
        p = geometry.patch
        mean = (sums[p:, p:] - sums[:-p, p:] - sums[p:, :-p] + sums[:-p, :-p]) / p**2
        return np.maximum(mean / max(1e-30, mean[patches].mean()), 1e-6).astype(np.float32)


NOTHING = Guidance()


def ease_from(free: np.ndarray, distance: float) -> np.ndarray:
    """How strongly free pixels are changed: 0 beside pixels that stay, 255 at a distance; (height, width) uint8."""
    from scipy import ndimage  # when it is needed: it is slow to import

    away = ndimage.distance_transform_edt(free) if not free.all() else np.full(free.shape, np.inf)
    return np.rint(255 * np.clip(away / distance, 0.0, 1.0)).astype(np.uint8)


def octaves(sigmas: np.ndarray) -> list[float]:
    """The sigmas of the projections that a map of sigmas is blended from: its range in steps of an octave at most."""
    low, high = float(sigmas.min()), float(sigmas.max())
    steps = math.ceil(math.log2(high / low) - 1e-6)
    return [low * (high / low) ** (k / max(1, steps)) for k in range(steps + 1)]


class VaryingProjection:
    """MJH17 section 4.3 with a sigma for each pixel (figure 10).

    The paper does not say how. Departure: a pixel's projection is blended, linearly in log sigma, from the projections
    at the two nearest of a few sigmas an octave apart; all of them are made of the whole image.

    Parameters
    ----------
    device : Device
    buffers : Buffers
        With the memory of all projections.
    projections : list of Projecting
        With sigmas as by `octaves`.
    sigmas : (height, width) float32
    """

    def __init__(self, device: Device, buffers: Buffers, projections: list[Projecting], sigmas: np.ndarray):
        self._device, self._buffers, self._projections, self._shape = device, buffers, projections, sigmas.shape
        self.channels = projections[0].channels
        span = math.log(float(sigmas.max()) / float(sigmas.min()))
        place = np.log(sigmas / sigmas.min()) * ((len(projections) - 1) / max(span, 1e-9))
        self._shares = [
            np.rint(_SHARES * np.clip(1.0 - np.abs(place - k), 0.0, 1.0)).astype(np.int32)
            for k in range(len(projections))
        ]

    def project(self, image: str, matched: str, strength: float = 1.0) -> None:
        """As `Projection.project`."""
        total, weight = np.int32(0), np.int32(0)
        for projection, share in zip(self._projections, self._shares, strict=True):
            projection.project(image, matched, strength)
            found = self._device.read(self._buffers[matched], (*self._shape, self.channels), np.int16)
            total, weight = total + share[..., None] * found.astype(np.int32), weight + share
        weight = weight[..., None]
        blended = (2 * total + weight) // (2 * weight)  # halves go up
        self._device.write(self._buffers[matched], blended.astype(np.int16))


def coarse_mask(mask: np.ndarray | None, width: int, height: int) -> np.ndarray | None:
    """A mask on a level: a coarse pixel is in where all the pixels under it are."""
    if mask is None:
        return None

    def shrink(mask: np.ndarray, n: int, axis: int) -> np.ndarray:
        first = np.arange(n) * mask.shape[axis] // n
        return np.logical_and.reduceat(mask, first, axis=axis)

    return shrink(shrink(mask, height, 0), width, 1)


def coarse_image(image: np.ndarray, mask: np.ndarray | None, width: int, height: int) -> np.ndarray:
    """An image on a level: means of the pixels in the mask, so that the others do not bleed in."""
    if mask is None:
        return resized(image, width, height)
    weight = resized(mask[..., None].astype(np.float32), width, height)
    sums = resized(np.where(mask[..., None], image, np.float32(0)), width, height)
    return np.where(weight > 0, sums / np.maximum(weight, np.float32(1e-6)), np.float32(0))
