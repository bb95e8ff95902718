# SPDX-License-Identifier: Apache-2.0
"""Constraints from the user: fixed pixels, weights of the exemplar's pixels, and a map of sigmas."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from ...engine.color.lab_grid import to_grid
from ...engine.core.demand import MadeRows, SomeRows, resized
from ...engine.core.scratch import empty_rows
from ...engine.core.source_map import SourceMap
from ...engine.deferred import np
from ...engine.errors import ImageError, present
from ...engine.opencl.buffers import Buffers
from ...engine.opencl.device import Device
from ..projections.histograms import BINS, INVERSE, OUTSIDE, RowSource
from ..projections.projection import Projecting
from .field import Geometry, allowed_patches, bands_of, box_sums

FINER = 2  # minimum size of an octave, relative to a level that is reduced from it
_KEPT_BYTES = 4 << 20  # maximum size of a level that is kept
ENOUGH = 0.25  # minimum share of whole patches on a usable coarse level, relative to the finest level's
ENOUGH_AMONG = 0.5  # the same if pixels around the result are fixed: the patches that fit these must be among them


@dataclass(frozen=True)
class FixedPixels:
    """Given pixels of the target, which synthesis keeps.

    Attributes
    ----------
    where : (height, width) bool
        Which pixels of the target are fixed.
    places : SourceMap or None
        (height, width): the exemplar pixels that they show. Undefined at free pixels. None: they show no pixels of the
        exemplar.
    values : (height, width, channels) float32, optional
        Their values, on the scale of the exemplar. Default: those of the exemplar at `places`, which are then also
        restored in the result; otherwise it has the patches that fit best there.
    start : callable, optional
        Returns the first field from (field, fixed image, exemplar's grid image, allowed patches, geometry). Default:
        random where pixels are free.
    """

    where: np.ndarray
    places: SourceMap | None
    values: np.ndarray | None = None
    start: Callable[[SourceMap, np.ndarray, SomeRows, np.ndarray, Geometry], SourceMap] | None = None

    def image(self, exemplar: SomeRows, geometry: Geometry) -> np.ndarray:
        """The fixed pixels on a level as a grid image, `OUTSIDE` where the target is free.

        Parameters
        ----------
        exemplar : (height, width, channels) float32
            Full size.
        geometry : Geometry
            Geometry of the level.
        """
        values = present(self.places).gather(exemplar) if self.values is None else self.values
        shown = Octaves(values, self.where).reduced(geometry.width, geometry.height)
        kept = coarse_mask(self.where, geometry.width, geometry.height)
        return np.where(present(kept)[..., None], to_grid(shown, geometry.steps), OUTSIDE)

    def first_guess(self, field: SourceMap, shape: tuple[int, ...], geometry: Geometry) -> SourceMap:
        """The field with patches that begin at a fixed pixel matched to that pixel's source, as the initial guess."""
        if self.places is None:
            return field
        g = geometry
        y = (np.arange(g.rows) * 2 + 1) * self.where.shape[0] // (2 * g.height)
        x = (np.arange(g.columns) * 2 + 1) * self.where.shape[1] // (2 * g.width)
        from_y, from_x = self.places[np.ix_(y, x)].yx
        guess_y = np.minimum(from_y * g.exemplar_height // shape[0], g.exemplar_rows - 1)
        guess_x = np.minimum(from_x * g.exemplar_width // shape[1], g.exemplar_columns - 1)
        guess = SourceMap.of(guess_y, guess_x)
        return SourceMap(np.where(self.where[np.ix_(y, x)], guess.packed, field.packed))


@dataclass(frozen=True, kw_only=True)
class Constraints:
    """All constraints. None: unconstrained.

    Attributes
    ----------
    weight : (height, width) float32 or None
        Relative frequency of use of each exemplar pixel. 0: never.
    sigmas : (height, width) float32 or None
        Sigma at each pixel of the target, px.
    """

    fixed: FixedPixels | None = None
    weight: np.ndarray | None = None
    sigmas: np.ndarray | None = None

    def patch_weights(self, patches: np.ndarray, geometry: Geometry) -> np.ndarray | None:
        """Mean weight of each exemplar patch on a level, relative to the mean over all usable patches."""
        if self.weight is None:
            return None
        small = resized(self.weight[..., None], geometry.exemplar_width, geometry.exemplar_height)[..., 0]
        weights, total = np.empty(patches.shape, np.float32), 0.0
        for band in bands_of(len(patches)):
            mean = box_sums(small[band.start : band.stop + geometry.patch - 1], geometry.patch, np.float64)
            weights[band] = mean / geometry.patch**2
            total += float(weights[band][patches[band]].sum(dtype=np.float64))
        weights /= np.float32(max(1e-30, total / np.count_nonzero(patches)))
        return np.maximum(weights, np.float32(1e-6), out=weights)


UNCONSTRAINED = Constraints()


def ease_from(free: np.ndarray, distance: float) -> np.ndarray:
    """Strength of changes to free pixels: 0 next to fixed pixels, 255 at a distance. (height, width) uint8."""
    from scipy import ndimage  # slow to import

    away = ndimage.distance_transform_edt(free) if not free.all() else np.full(free.shape, np.inf)
    return np.rint(255 * np.clip(away / distance, 0.0, 1.0)).astype(np.uint8)


def sigma_octaves(sigmas: np.ndarray) -> list[float]:
    """Sigmas of the projections that a map of sigmas is blended from: its range in steps of at most one octave."""
    low, high = float(sigmas.min()), float(sigmas.max())
    steps = math.ceil(math.log2(high / low) - 1e-6)
    return [low * (high / low) ** (k / max(1, steps)) for k in range(steps + 1)]


class VaryingProjection:
    """MJH17 section 4.3 with a sigma for each pixel (figure 10).

    The paper gives no method. Departure: a pixel's projection is blended, linearly in log sigma, from the projections
    at the two nearest of a few sigmas an octave apart. Each of these uses the whole image.

    `width`: px.
    """

    def __init__(
        self, device: Device, buffers: Buffers, projections: list[Projecting], width: int, places: RowSource
    ):  # fmt: skip
        self._buffers, self._projections, self._width, self._places = buffers, projections, width, places
        self.channels, self.held = projections[0].channels, projections[0].held
        self.looks_beyond = any(projection.looks_beyond for projection in projections)
        self._run = device.program("histograms", BINS=BINS, INVERSE=INVERSE, CHANNELS=self.channels)

    @staticmethod
    def layout(width: int, rows: int, channels: int = 3) -> dict[str, int]:
        """Device memory for a number of rows, excluding that of the projections, in bytes by name."""
        return {"place": 4 * width * rows, "blended": 4 * channels * width * rows}

    @staticmethod
    def places_of(sigmas: np.ndarray, count: int) -> np.ndarray:
        """Fractional index of sigmas (height, width) among those of `count` projections: float32."""
        span = math.log(float(sigmas.max()) / float(sigmas.min()))
        return (np.log(sigmas / sigmas.min()) * ((count - 1) / max(span, 1e-9))).astype(np.float32)

    def learning(self, image: RowSource) -> Iterator[None]:
        """As `histograms.Projection.learning`."""
        for projection in self._projections:
            yield from projection.learning(image)

    def last_row(self, top: int) -> int:
        """As `histograms.Projection.last_row`."""
        return min(projection.last_row(top) for projection in self._projections)

    def match(self, image: RowSource, top: int, bottom: int, matched: str, strength: float) -> int:
        """As `histograms.Projection.match`."""
        b, count, size, first = self._buffers, len(self._projections), (self._width, bottom - top), top
        place_at = top - self._places.load(top, bottom)
        for k, projection in enumerate(self._projections):
            first = projection.match(image, top, bottom, matched, strength)
            where = k, count, top - first, place_at
            self._run("blend", size, b[matched], b[self._places.name], b["blended"], *where, *size)
        return first


def coarse_mask(mask: np.ndarray | None, width: int, height: int) -> np.ndarray | None:
    """A mask on a level: a coarse pixel is inside if all the pixels it covers are."""
    if mask is None:
        return None

    def shrink(mask: np.ndarray, n: int, axis: int) -> np.ndarray:
        first = np.arange(n) * mask.shape[axis] // n
        return np.logical_and.reduceat(mask, first, axis=axis)

    return shrink(shrink(mask, height, 0), width, 1)


class Octaves:
    """An image at its own size, and on request at 1/2, 1/4 ... of it: coarse levels need not read all pixels.

    Small levels are kept for the next synthesis from it.

    `image` (height, width, channels) float32; `mask` (height, width) bool, pixels that count, or None: all.
    """

    def __init__(self, image: SomeRows, mask: np.ndarray | None):
        self._sums: list[SomeRows] = [image]
        self._kept: dict[tuple[int, int], np.ndarray] = {}
        self._weights: list[SomeRows] = []  # with a mask: shares of pixels that count, and the sums are of these
        if mask is not None:

            def counted(first: int, last: int) -> np.ndarray:
                return np.where(mask[first:last, :, None], image[first:last], np.float32(0))

            self._sums = [MadeRows(image.shape, np.float32, counted)]
            self._weights = [MadeRows((*mask.shape, 1), np.float32, lambda first, last: mask[first:last, :, None])]

    def halve(self, width: int, height: int, in_memory: bool) -> Octaves:
        """The same with all octaves that levels from `width` x `height` on are reduced from."""
        for planes in (self._sums, self._weights):
            while planes and min(planes[-1].shape[0] / height, planes[-1].shape[1] / width) >= 2 * FINER:
                planes.append(_halved(planes[-1], in_memory))
        return self

    def reduced(self, width: int, height: int, rows: slice | None = None) -> np.ndarray:
        """The image on a level: means over the pixels in the mask only, so that others do not bleed in.

        They are taken from the smallest octave that is `FINER` than the level.

        Parameters
        ----------
        width, height : int
            Size of the level.
        rows : slice, optional
            Rows of the level to compute.

        Returns
        -------
        (height or rows, width, channels) float32
            0 where no pixel counts.
        """
        if 4 * width * height * self._sums[0].shape[2] > _KEPT_BYTES:
            return self._reduced(width, height, rows)
        if (width, height) not in self._kept:
            self._kept[width, height] = self._reduced(width, height)
        return self._kept[width, height][rows or slice(None)]

    def _reduced(self, width: int, height: int, rows: slice | None = None) -> np.ndarray:
        at = max(k for k, one in enumerate(self._sums) if k == 0 or _finer(one, width, height))
        sums = resized(self._sums[at], width, height, rows)
        if not self._weights:
            return sums
        weight = resized(self._weights[at], width, height, rows)
        return np.where(weight > 0, sums / np.maximum(weight, np.float32(1e-6)), np.float32(0))


def _finer(image: SomeRows, width: int, height: int) -> bool:
    return min(image.shape[0] / height, image.shape[1] / width) >= FINER


def _halved(image: SomeRows, in_memory: bool) -> SomeRows:
    """Means over squares of two pixels a side, or, along an odd side, of slightly more than two."""
    (high, wide, channels), (down, right) = image.shape, (_pairs(n) for n in image.shape[:2])
    out = empty_rows((high // 2, wide // 2, channels), np.float32, in_memory)
    for band in bands_of(len(out)):
        begin = int(down[0][band.start])
        rows = image[begin : int(down[0][band.stop - 1]) + len(down)]
        tall = _weighed(rows, 0, down[0][band] - begin, [w[band] for w in down[1:]])
        out[band] = _weighed(tall, 1, right[0], right[1:])
    return out


def _pairs(size: int) -> list[np.ndarray]:
    """For each pixel of half an axis: the first pixel that it covers, and the shares of two or three."""
    count = size // 2
    begins = np.arange(count) * (size / count)
    first = begins.astype(np.int64)
    shares = [np.full(count, 0.5)] * 2
    if size % 2:
        least = 1.0 - (begins - first)
        shares = [share * (count / size) for share in (least, np.ones(count), size / count - 1.0 - least)]
    return [first, *(share.astype(np.float32) for share in shares)]


def _weighed(values: np.ndarray, axis: int, first: np.ndarray, shares: list[np.ndarray]) -> np.ndarray:
    """Sums of neighbors along an axis, from `first` on, with these shares."""
    shape = (-1, 1, 1) if axis == 0 else (-1, 1)
    last = values.shape[axis] - 1
    return sum(values.take(np.minimum(first + k, last), axis) * share.reshape(shape) for k, share in enumerate(shares))


def first_level(allowed: np.ndarray | None, geometries: list[Geometry], ruled_out: str, enough: float = ENOUGH) -> int:
    """The level to start on: the coarsest with about as many whole patches, for its size, as the finest.

    A mask shrinks with every level while patches keep their size. A level that is too coarse has no whole patch, or a
    few from the mask's thickest spots only: the texture would start as copies of these, and finer levels, which search
    nearby, would not leave them.
    """
    if allowed is None:
        return 0
    finest = geometries[-1]
    share = allowed_patches(allowed, finest).mean()
    if share == 0:
        size = f"{finest.exemplar_width}x{finest.exemplar_height}"
        raise ImageError(
            f"no {finest.patch}x{finest.patch} patch of the exemplar of {size} px is free of {ruled_out}",
            hint="reduce patch",
        )

    def serves(geometry: Geometry) -> bool:
        mask = coarse_mask(allowed, geometry.exemplar_width, geometry.exemplar_height)
        return bool(allowed_patches(mask, geometry).mean() >= enough * share)

    return next(n for n, geometry in enumerate(geometries) if geometry is finest or serves(geometry))
