# SPDX-License-Identifier: Apache-2.0
"""Exemplars for synthesis: squares of 2^L pixels in Lab, and their Gaussian stacks (HRRG08 section 3.2).

Departure from HRRG08, which does not define the radius of the filter: here level k of L has sigma = sqrt(h^2 - 1) / 2
px for its spacing h = 2^(L-k), so that the finest level is the exemplar itself.

An exemplar that tiles is a torus. Others are mirrored where a filter or a neighborhood crosses their borders. HRRG08
and Lefebvre & Hoppe 2005 do not specify how the two are distinguished (here: by `tiles`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from ...engine.color.config import as_float
from ...engine.color.lab import lens_of
from ...engine.color.lab_grid import FINE_STEPS
from ...engine.color.lens import Lens, in_type
from ...engine.core.demand import bands, resized
from ...engine.core.image import Image, dtype_of
from ...engine.core.op import Space
from ...engine.core.source_map import SourceMap
from ...engine.core.window import Window
from ...engine.deferred import np
from ...engine.errors import BrokenValues, ImageError
from ...engine.session.facts import Facts
from ...engine.session.resources import Resources
from ..quality.seam_measures import seam_ratio, wrap_percentile
from .graph import Graph

LEAST, MOST = 16, 1024  # px; sides of exemplars
_CLOSED = 1.5  # maximum jump across the wrap that is invisible, relative to the mean between lines
_RARE = 99.0  # percentile of the lines' jumps up to which a wrap is invisible as well
_TEXEL_BYTES = 96  # of links, records, offsets and a stack's plane
_REACH = 2400  # steps: differences from the mean are clamped to this in decisions


@dataclass(frozen=True)
class Exemplar:
    """One exemplar, cropped to a square whose side is a power of two."""

    name: str
    pixels: np.ndarray  # (side, side, channels), in the root's color space and pixel type
    values: np.ndarray  # (side, side, 4) float32: Lab, or data scaled to 0 .. 100, as from `Lens.values`
    opaque: np.ndarray | None  # (side, side) bool: where alpha is not 0; None: everywhere
    place: Window  # in the image's data window, from its corner, in pixels of the resampled image; what is less than
    # the square is at its top left, and mirrored to fill it
    factor: float  # resampling factor of the image
    periodic: bool = True  # a torus; otherwise it is mirrored at its borders

    @property
    def side(self) -> int:
        """Pixels along x and along y."""
        return self.pixels.shape[0]

    @property
    def photo(self) -> tuple[slice, slice]:
        """Rows and columns of the square that are its image's own."""
        return slice(self.place.height), slice(self.place.width)

    def without(self, excluded: np.ndarray) -> Exemplar:
        """The exemplar without pixels of its image, (height, width) bool, unless nothing would be left."""
        place = self.place
        left = ~filled(excluded[place.top : place.bottom, place.left : place.right], self.side)
        opaque = left if self.opaque is None else left & self.opaque
        return replace(self, opaque=opaque) if opaque.any() and not opaque.all() else self


def filled(pixels: np.ndarray, side: int) -> np.ndarray:
    """Pixels (height, width, ...) mirrored to the right and below, to fill a square."""
    more = [(0, side - n) for n in pixels.shape[:2]]
    return np.pad(pixels, [*more, *[(0, 0)] * (pixels.ndim - 2)], "symmetric") if any(map(any, more)) else pixels


def load_exemplars(
    images: Sequence[Image], graph: Graph, resources: Resources, space: Space, most: int, whole: bool = False
) -> tuple[tuple[Exemplar, ...], Lens]:
    """All exemplars, of the same size, in the root's color space, and the root's `Lens`. Others: `common_side`.

    They are cropped around their centers, not resampled: pixels keep their size, so scale ratios hold and
    detail stays sharp.
    """
    factors, root = graph.factors, graph.root
    side = common_side(images, graph, resources, most, whole)
    lens = lens_of(images[root], resources, space)
    exemplars = []
    for image, factor, wrap in zip(images, factors, graph.wraps, strict=True):
        own = lens if image is images[root] else _fitting(image, images[root], lens, resources, space)
        exemplars.append(_cut(image, factor, side, wrap, own, lens, np.dtype(dtype_of(images[root].first.spec))))
    return tuple(exemplars), lens


def common_side(images: Sequence[Image], graph: Graph, facts: Facts, most: int, whole: bool = False) -> int:
    """The side of all exemplars, px, at most `most`; refuses what exceeds the memory budget.

    `whole`: of a single image, a square that holds less than half of it is doubled, and filled.
    """
    factors = graph.factors
    shortest = min(
        min(_scaled_size(image, factor)) for image, factor in zip(images, factors, strict=True)
    )  # the side is common to all: HRRG08 section 3.1
    if shortest < LEAST:
        small = next(i for i, f in zip(images, factors, strict=True) if min(_scaled_size(i, f)) == shortest)
        raise ImageError(f"is {shortest} px wide or high", subject=small.source, expected=f"at least {LEAST} px")
    side = 1 << (min(shortest, most).bit_length() - 1)
    if whole and 2 * side**2 < math.prod(_scaled_size(images[0], factors[0])):
        side = min(2 * side, 1 << (most.bit_length() - 1))
    need = _TEXEL_BYTES * side * side * side.bit_length()  # of the root's levels; those of others are extra
    facts.require(need, "analyzing exemplars", "reduce exemplarside")
    return side


def _scaled_size(image: Image, factor: float) -> tuple[int, int]:
    spec = image.first.spec
    return round(spec.width * factor), round(spec.height * factor)


def require_channels(image: Image, root: Image) -> None:
    """Refuse an exemplar with other channels than the root."""
    mine, wanted = image.first.spec.channelnames, root.first.spec.channelnames
    if mine != wanted:
        raise ImageError(
            f"has channels {','.join(mine)}",
            subject=image.source,
            expected=f"{','.join(wanted)}, the channels of the root {root.source}",
        )


def _fitting(image: Image, root: Image, lens: Lens, resources: Resources, space: Space) -> Lens:
    """The `Lens` of an exemplar other than the root."""
    require_channels(image, root)
    own = lens_of(image, resources, space)
    if (own.space is None) != (lens.space is None):
        raise ImageError(f"{image.source} conflicts with the root {root.source}: one is color, the other is data")
    if own.space is None:  # data of all exemplars have the same meaning
        return replace(own, low=lens.low, scale=lens.scale)
    return own


def _cut(image: Image, factor: float, side: int, wrap: str | None, own: Lens, root: Lens, kind: np.dtype) -> Exemplar:
    part = image.first
    width, height = _scaled_size(image, factor)
    own_width, own_height = min(side, width), min(side, height)
    place = Window.sized((width - own_width) // 2, (height - own_height) // 2, own_width, own_height)
    found = (own.broken(part.read(band)) for band in bands(part))  # also outside the square
    broken = sum(found, np.zeros(2, np.int64))
    if broken.any():
        raise BrokenValues(own.name, broken)
    if (width, height) == part.window.size:
        pixels = part.read(place.shifted(part.window.left, part.window.top))
    else:
        inside = place.inside(Window(0, 0, width, height))
        pixels = in_type(resized(as_float(part.pixels()), width, height)[inside], np.dtype(dtype_of(part.spec)))
    values, opaque = own.values(pixels)
    if place.size != (side, side):
        left = np.ones(pixels.shape[:2], bool) if opaque is None else opaque
        opaque = np.pad(left, [(0, side - n) for n in left.shape])
        pixels, values = filled(pixels, side), filled(values, side)
    if opaque is not None and opaque.all():
        opaque = None
    if opaque is not None and not opaque.any():
        raise ImageError(f"is transparent in its middle {side}x{side} px", subject=image.source)
    pixels = np.ascontiguousarray(pixels)
    if own.space != root.space and own.space is not None:
        pixels = root.replaced(pixels, values.copy(), opaque)
    if pixels.dtype != kind:
        pixels = in_type(as_float(pixels), kind)
    values = np.ascontiguousarray(values, np.float32)
    seen = values if opaque is None else np.where(opaque[..., None], values, values[opaque].mean(0))
    periodic = wrap == "periodic" if wrap else place.size == (side, side) and tiles(seen)
    return Exemplar(image.source, pixels, values, opaque, place, factor, periodic)


def sigma_of(level: int, finest: int) -> float:
    """Sigma of a stack level's blur, px."""
    return 0.5 * float(np.sqrt(4.0 ** (finest - level) - 1.0))


def tiles(values: np.ndarray) -> bool:
    """Whether opposite borders of an image meet without a visible seam: (side, side, channels) float, by channel 0.

    The jump from the last line to the first must be like those between other lines: at most 1.5 times their
    mean, or below their 99th percentile (a border may lie in a joint between bricks).
    """
    light = values[..., 0].astype(np.float64)
    return all(seam_ratio(light, axis) <= _CLOSED or wrap_percentile(light, axis) <= _RARE for axis in (0, 1))


def blurred(planes: np.ndarray, sigma: float, opaque: np.ndarray | None = None, periodic: bool = True) -> np.ndarray:
    """A Gaussian blur of a torus, or mirrored, as float64. Transparent pixels are filled from their surroundings."""
    planes = planes.astype(np.float64)
    if sigma <= 0:
        return planes
    filtered = _filtered if periodic else _filtered_mirrored
    if opaque is None:
        return filtered(planes, sigma)
    weight = np.maximum(filtered(opaque[..., None].astype(np.float64), sigma), 0)
    mean = planes[opaque].mean(0)
    shared = filtered(np.where(opaque[..., None], planes - mean, 0), sigma)
    return mean + shared / np.maximum(weight, 1e-6)


def _response(side: int, sigma: float) -> np.ndarray:
    """Frequency response of a periodic Gaussian along one axis: (side,) float64.

    Sampled in space, not in frequency, so that no weight is negative: next to HDR lights nothing becomes negative.
    """
    turns = int(np.ceil(6 * sigma / side)) + 1
    offset = np.arange(side)[None, :] + side * np.arange(-turns, turns + 1)[:, None]
    taps = np.exp(-np.square(offset) / (2 * sigma**2)).sum(0)
    return np.fft.fft(taps / taps.sum()).real


def _filtered(planes: np.ndarray, sigma: float) -> np.ndarray:
    response = _response(len(planes), sigma)
    spectrum = np.fft.fft2(planes, axes=(0, 1)) * response[:, None, None] * response[None, :, None]
    return np.fft.ifft2(spectrum, axes=(0, 1)).real


def _filtered_mirrored(planes: np.ndarray, sigma: float) -> np.ndarray:
    """The same on the torus of twice the side that consists of an image and its mirror images."""
    response = _response(2 * len(planes), sigma)[: len(planes)]
    along_rows = _along_mirrored(np.ascontiguousarray(planes.transpose(2, 0, 1)), response)
    return _along_mirrored(along_rows.transpose(0, 2, 1), response).transpose(2, 1, 0)


def _along_mirrored(lines: np.ndarray, response: np.ndarray) -> np.ndarray:
    """A cosine transform of the last axis, weighted and inverted, by a Fourier transform of the same length.

    Makhoul 1980, doi:10.1109/TASSP.1980.1163351: even samples, then the odd ones backwards. At its rotated frequency k,
    the real part is that of the cosine transform at k, the imaginary part minus that at n - k. (scipy.fft does the same
    and takes longer to import than all blurs of an exemplar.)
    """
    n = lines.shape[-1]
    spectrum = np.fft.rfft(np.concatenate([lines[..., ::2], lines[..., 1::2][..., ::-1]], -1))
    turn = np.exp(-0.5j * np.pi / n * np.arange(n // 2 + 1))
    spectrum *= turn
    spectrum.real *= response[: n // 2 + 1]
    spectrum.imag[..., 1:] *= response[::-1][: n // 2]
    folded = np.fft.irfft(spectrum * turn.conj(), n)
    out = np.empty_like(folded)
    out[..., ::2], out[..., 1::2] = folded[..., : (n + 1) // 2], folded[..., (n + 1) // 2 :][..., ::-1]
    return out


def seen_values(exemplar: Exemplar) -> np.ndarray:
    """Lab values, (side, side, 3), with transparent pixels filled from their surroundings."""
    values = exemplar.values[..., :3]
    if exemplar.opaque is None:
        return values
    near = blurred(values, 2.0, exemplar.opaque, exemplar.periodic)
    return np.where(exemplar.opaque[..., None], values, near)


def grid_stack(exemplar: Exemplar, middle: np.ndarray, levels: Sequence[int], finest: int) -> np.ndarray:
    """Levels of an exemplar's Gaussian stack on the integer grid of all decisions.

    (levels, side, side, 4) int16: steps from `middle`, Lab (3,), and 0. Level `finest`, L, is not blurred.
    """
    values = seen_values(exemplar)
    out = np.zeros((len(levels), exemplar.side, exemplar.side, 4), np.int16)
    for n, level in enumerate(levels):
        seen = blurred(values, sigma_of(level, finest), exemplar.opaque, exemplar.periodic)
        steps = (seen - middle) * FINE_STEPS
        out[n, ..., :3] = np.rint(np.clip(steps, -_REACH, _REACH))
    return out


def shown_level(exemplar: Exemplar, level: int, finest: int) -> np.ndarray:
    """A level for rendering, all channels in the exemplar's own type: (side, side, channels)."""
    if level == finest:
        return exemplar.pixels
    seen = blurred(as_float(exemplar.pixels), sigma_of(level, finest), exemplar.opaque, exemplar.periodic)
    return in_type(seen.astype(np.float32), exemplar.pixels.dtype)


def nearest_opaque(opaque: np.ndarray) -> SourceMap:
    """For every pixel the nearest opaque one, itself if it is opaque: (side, side)."""
    from scipy import ndimage

    return SourceMap.of(*ndimage.distance_transform_edt(~opaque, return_distances=False, return_indices=True))
