# SPDX-License-Identifier: Apache-2.0
"""Photos of one surface in linear light: whole, reduced to look for lights, or a piece of all of them at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from ...engine.color.lens import Lens
from ...engine.core.image import Image
from ...engine.core.window import Window
from ...engine.deferred import np
from ...engine.errors import ImageError
from ...engine.io.icc import lab_of_xyz
from ...engine.scan import scan
from ...engine.session.progress import Progress
from ...engine.session.resources import Resources

_REDUCED = 256  # px; longer side at which lights are looked for
_SAMPLES = 1 << 13  # pixels that decide intensities
_CLIPPED = 0.995  # of the largest value of an integer type: such a pixel is at least as bright as it says
_BOUND = 5000.0  # |Lab|, 80000 times white, beyond which values are clamped
_KNEE, _SLOPE = 6 / 29, 3 * (6 / 29) ** 2  # CIE 15:2018, 8.2.1


@dataclass(frozen=True)
class Piece:
    """A window of all n photos.

    Attributes
    ----------
    color : (n, 3, pixels) float32
        XYZ relative to white, or data.
    luminance : (n, pixels) float32
    valid : (n, pixels) bool
        False where a photo is clipped.
    opaque : (height, width) bool
        Where no photo is transparent.
    values : (height, width, 4) float32
        Those of the first photo, as its lens gives them.
    """

    color: np.ndarray
    luminance: np.ndarray
    valid: np.ndarray
    opaque: np.ndarray
    values: np.ndarray


@dataclass(frozen=True)
class ReducedPhotos:
    """ReducedPhotos luminance of n photos, (n, rows, columns) float32, NaN where a photo is transparent.

    `x`, `y`: (rows, columns) float64, the places of its pixels, px.
    """

    luminance: np.ndarray
    x: np.ndarray
    y: np.ndarray

    def without(self, box: Window | None) -> ReducedPhotos:
        """The same, with a window of the photos that is not seen."""
        if box is None:
            return self
        side = self.x[0, -1] - self.x[0, 0] if self.x.shape[1] < 2 else self.x[0, 1] - self.x[0, 0]
        across = (self.x > box.left - side) & (self.x < box.right + side)
        inside = across & (self.y > box.top - side) & (self.y < box.bottom + side)
        return replace(self, luminance=np.where(inside, np.float32(np.nan), self.luminance))

    def samples(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Luminance (n, pixels) and places of at most `_SAMPLES` pixels, evenly spread over those that are seen."""
        seen = np.flatnonzero(np.isfinite(self.luminance).all(0))
        chosen = seen[:: -(-len(seen) // _SAMPLES)]
        return self.luminance.reshape(len(self.luminance), -1)[:, chosen], self.x.flat[chosen], self.y.flat[chosen]


def piece_of(rows: Sequence[np.ndarray], lenses: Sequence[Lens]) -> Piece:
    """A piece from the rows of all photos, (height, width, channels) in the photos' types."""
    high, wide = rows[0].shape[:2]
    color, valid = np.empty((len(rows), 3, high * wide), np.float32), np.ones((len(rows), high * wide), bool)
    first, opaque = None, np.ones((high, wide), bool)
    for planes, unclipped, pixels, lens in zip(color, valid, rows, lenses, strict=True):
        values, seen = lens.values(pixels)
        first = values if first is None else first
        opaque = opaque if seen is None else opaque & seen
        planes[:] = linear(values, lens).reshape(3, -1)
        if pixels.dtype.kind in "ui":
            brightest = pixels[..., list(lens.channels.color)].max(-1)
            unclipped[:] = (brightest < _CLIPPED * np.iinfo(pixels.dtype).max).ravel()
    assert first is not None
    return Piece(color, np.stack([_luminance(planes, lenses[0]) for planes in color]), valid, opaque, first)


def linear(values: np.ndarray, lens: Lens) -> np.ndarray:
    """XYZ relative to white of Lab, or data as they are: (3, height, width) float32."""
    planes = np.moveaxis(values[..., :3], -1, 0).copy()
    if lens.space is None:
        return planes
    lightness, green, blue = np.clip(planes, np.float32(-_BOUND), np.float32(_BOUND), out=planes)
    y = _root(lightness)
    return np.stack([_cubed(y + green / np.float32(500)), _cubed(y), _cubed(y - blue / np.float32(200))])


def _root(lightness: np.ndarray) -> np.ndarray:
    """The root of Y of Lab's L."""
    return (lightness + np.float32(16)) / np.float32(116)


def _cubed(roots: np.ndarray) -> np.ndarray:
    """The inverse of Lab's root."""
    cubes = roots * roots
    cubes *= roots
    dark = roots <= np.float32(_KNEE)
    if dark.any():
        cubes[dark] = (roots[dark] - np.float32(4 / 29)) * np.float32(_SLOPE)
    return cubes


def nonlinear(color: np.ndarray, lens: Lens) -> np.ndarray:
    """The inverse of `linear`."""
    return color if lens.space is None else lab_of_xyz(color).astype(np.float32)


def luminance(values: np.ndarray, lens: Lens) -> np.ndarray:
    """Y, or the mean of data, not below 0, of values as a lens gives them: (height, width) float32."""
    if lens.space is not None:
        bounded = np.clip(values[..., 0], np.float32(-_BOUND), np.float32(_BOUND))
        return np.maximum(_cubed(_root(bounded)), 0)
    return _luminance(np.moveaxis(values[..., :3], -1, 0), lens)


def _luminance(planes: np.ndarray, lens: Lens) -> np.ndarray:
    """Y of XYZ (3, ...), or the mean of data, not below 0."""
    if lens.space is not None:
        return np.maximum(planes[1], 0)
    total = sum(planes[n] for n in range(lens.count))
    return np.maximum(total / np.float32(lens.count), 0)


def luminance_of(image: Image, lens: Lens, window: Window) -> np.ndarray:
    """Linear luminance of a window of one photo, (height, width) float32."""
    values, _ = lens.values(image.first.read(window))
    return luminance(values, lens)


def reduced(photos: Sequence[Image], lenses: Sequence[Lens], resources: Resources, progress: Progress) -> ReducedPhotos:
    """Block means of the luminance of all photos.

    Raises
    ------
    BrokenValues
        There are NaN or Inf values.
    ImageError
        A photo is black, or transparent everywhere.
    """
    whole = photos[0].first.window
    side = -(-max(whole.size) // _REDUCED)
    sums = np.zeros((len(photos), 2, -(-whole.height // side), -(-whole.width // side)))
    for number, (photo, lens) in enumerate(zip(photos, lenses, strict=True)):

        def look(values: np.ndarray, opaque: np.ndarray | None, _: Window, lens: Lens = lens) -> np.ndarray:
            light = luminance(values, lens).astype(np.float64)
            seen = np.ones(light.shape) if opaque is None else opaque.astype(np.float64)
            return np.stack([_block_sums(light * seen, side), _block_sums(seen, side)])

        def keep(piece: Window, found: np.ndarray, total: np.ndarray = sums[number]) -> None:
            total[:, (piece.top - whole.top) // side] += found

        scan(photo.first, lens, resources, look, keep, cell=side)
        if not sums[number, 0].sum() > 0:
            reason = "is black" if sums[number, 1].any() else "has alpha 0 everywhere"
            raise ImageError(f"{reason}: expected a photo under a light", subject=photo.source)
        progress.advance(number + 1, len(photos))
    full = sums[:, 1] == sums[:, 1].max()  # without blocks that are cut by a border
    means = np.where(full, sums[:, 0] / np.maximum(sums[:, 1], 1), np.nan).astype(np.float32)
    down, right = side * (np.indices(means.shape[1:]) + 0.5)
    return ReducedPhotos(means, np.add(right, whole.left), np.add(down, whole.top))


def _block_sums(values: np.ndarray, side: int) -> np.ndarray:
    """Sums over all rows and over `side` columns, added in a fixed order; the last block may be narrower."""
    total = np.zeros(values.shape[1])
    for row in values:
        total += row
    blocks = np.zeros(-(-len(total) // side))
    for n in range(side):
        own = total[n::side]
        blocks[: len(own)] += own
    return blocks
