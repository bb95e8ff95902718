# SPDX-License-Identifier: Apache-2.0
"""Coarse-to-fine texture synthesis on the pixels of a surface: each becomes a copy of one pixel of the photo.

Follows the anisometric synthesis of Lefebvre and Hoppe (Appearance-space texture synthesis, SIGGRAPH 2006, section 5).
Neighbors are looked up along the surface, rotated and scaled, so borders of charts need no special treatment.
Candidates are the sources of neighbors, shifted by the step between them, and random ones as in PatchMatch.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ...engine.color.lab_grid import FINE_STEPS, to_grid
from ...engine.core.source_map import SourceMap
from ...engine.deferred import np
from ...engine.errors import ImageError
from ...engine.opencl.buffers import Buffers
from ...engine.session.resources import Resources
from ...synthesis.patchmatch.field import hash_at
from .charts import Frames
from .mesh import Mesh
from .surface import FRACTION, ONE, Neighbors, Surface

REACH = 2  # px: radius of a neighborhood
_DIMENSIONS = 16  # of projected neighborhoods
_BASIS_BITS = 12
_LEVELS = 6
_LEAST_SIDE = 12  # px of the coarsest photo
_PASSES = (10, 2)  # on the coarsest level, and on the others
_RANDOM = 4  # candidates on the coarsest level, each within a quarter of the last one's distance
_FINER = (8, 2)  # px: distance of random candidates on finer levels
_AT_ONCE = 1 << 12  # pixels: a batch fits the cache of a core
GUTTER = 8  # px around charts that show the texture beyond the border


def offsets() -> np.ndarray:
    """Offsets x, y of a neighborhood, row by row: (25, 2) int64."""
    side = np.arange(-REACH, REACH + 1)
    y, x = np.meshgrid(side, side, indexing="ij")
    return np.stack([x, y], -1).reshape(-1, 2)


@dataclass(frozen=True, eq=False)
class PhotoLevel:
    """The photo at one level."""

    color: np.ndarray  # (height * width, channels) int16: Lab on the fine grid
    looks: np.ndarray  # (height * width, dimensions) int32: projected neighborhoods
    basis: np.ndarray  # (25 * channels, dimensions) float64: integers, so products are exact in any order
    snap: np.ndarray  # (height, width) int32: the nearest pixel with a complete neighborhood of usable pixels

    @classmethod
    def of(cls, lab: np.ndarray, usable: np.ndarray) -> PhotoLevel | None:
        """None if no neighborhood is complete."""
        from scipy.ndimage import binary_erosion, distance_transform_edt
        from threadpoolctl import threadpool_limits

        whole = binary_erosion(usable, np.ones((2 * REACH + 1,) * 2, bool), border_value=0)
        if not whole.any():
            return None
        height, width = usable.shape
        y, x = distance_transform_edt(~whole, return_distances=False, return_indices=True)
        snap = (y * width + x).astype(np.int32)
        color = to_grid(lab, FINE_STEPS)
        places = np.flatnonzero(whole)
        rows = offsets() @ (1, width)
        flat = color.reshape(-1, color.shape[-1])

        def seen(at: np.ndarray) -> np.ndarray:
            return flat[at[:, None] + rows].reshape(len(at), -1).astype(np.float64)

        sampled = seen(places[:: -(-len(places) // 16384)])
        centered = sampled - np.rint(sampled.mean(0))
        with threadpool_limits(1, "blas"):  # the basis must not depend on the number of threads
            _, vectors = np.linalg.eigh(centered.T @ centered)
        basis = np.rint(vectors[:, ::-1][:, :_DIMENSIONS] * (1 << _BASIS_BITS))
        looks = np.zeros((height * width, basis.shape[1]), np.int32)
        for start in range(0, len(places), _AT_ONCE):
            at = places[start : start + _AT_ONCE]
            looks[at] = projected(seen(at), basis)
        return cls(flat, looks, basis, snap)

    def at(self, places: np.ndarray) -> np.ndarray:
        """Pixels that contain places (..., 2), x and y in `ONE`ths, clamped to the border of the photo."""
        height, width = self.snap.shape
        pixels = places >> FRACTION
        return np.clip(pixels[..., 1], 0, height - 1) * width + np.clip(pixels[..., 0], 0, width - 1)

    def taken(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pixels for places, and these places; where a pixel is not valid, the nearest valid one and its center."""
        at = self.at(places)
        pixels = self.snap.reshape(-1)[at]
        other = pixels != at  # includes all beyond the border, since neighborhoods at the border are incomplete
        y, x = np.divmod(pixels[other], np.int32(self.snap.shape[1]))
        places = places.copy()
        places[other] = np.stack([x, y], -1) * ONE + ONE // 2
        return pixels, places


def projected(neighborhoods: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """(n, 25 * channels) integers -> (n, dimensions) int32."""
    return np.rint((neighborhoods @ basis) / (1 << _BASIS_BITS)).astype(np.int32)


def stack(values: np.ndarray, usable: np.ndarray | None) -> list[PhotoLevel]:
    """Levels of the photo, finest first, as long as they have enough valid pixels.

    Raises
    ------
    ImageError
        No neighborhood is complete.
    """
    usable = np.ones(values.shape[:2], bool) if usable is None else usable
    levels: list[PhotoLevel] = []
    while len(levels) < _LEVELS and (not levels or min(values.shape[:2]) >= _LEAST_SIDE):
        found = PhotoLevel.of(values, usable)
        if found is None or (levels and len(np.unique(found.snap)) < 64):
            break
        levels.append(found)
        height, width = (n // 2 * 2 for n in values.shape[:2])
        quads = values[:height, :width].reshape(height // 2, 2, width // 2, 2, -1)
        values = quads.mean((1, 3), dtype=np.float32)
        usable = np.logical_and.reduce(usable[:height, :width].reshape(height // 2, 2, width // 2, 2), (1, 3))
    if not levels:
        raise ImageError(f"no {2 * REACH + 1}x{2 * REACH + 1} px neighborhood of the photo is usable")
    return levels


def synthesize(
    mesh: Mesh,
    frames: Frames,
    size: tuple[int, int],
    levels: list[PhotoLevel],
    seed: int,
    name: str,
    resources: Resources,
    advance: Callable[[int, int], None] = lambda done, total: None,
) -> tuple[SourceMap, np.ndarray]:
    """Source of each pixel of an atlas.

    Parameters
    ----------
    frames : Frames
        Of the photo at full resolution.
    size : (width, height)
        Of the atlas.
    levels : list of PhotoLevel
        From `stack`.
    name : str
        Name of the mesh, for errors.
    advance : callable
        Called with (done, total).

    Returns
    -------
    source : SourceMap
        Source of each pixel, also outside of charts.
    face : (height, width) int32
        Index of the face of the mesh in which, or next to which, each pixel lies.

    Raises
    ------
    ImageError
        Charts overlap, or do not cover any pixel.
    """
    width, height = size
    finest = Surface.of(mesh, frames, width, height, 0, name)
    if not len(finest.place):
        raise ImageError(f"{name}: its charts cover no pixel of {width}x{height}; increase the size of the atlas")
    coarser: tuple[Surface, np.ndarray] | None = None
    for level in range(len(levels) - 1, -1, -1):
        surface = finest if level == 0 else Surface.of(mesh, frames, width, height, level)
        if not len(surface.place):
            continue
        exemplar = levels[level]
        if coarser is None:
            y, x = np.divmod(surface.place, surface.shape[1])
            chance = hash_at(seed, level, y, x)
            y, x = np.divmod((chance % np.uint32(exemplar.snap.size)).astype(np.int32), exemplar.snap.shape[1])
            source = exemplar.taken(np.stack([x, y], -1) * ONE + ONE // 2)[1]
        else:
            source = _inherited(surface, *coarser, exemplar)
        first = coarser is None
        source = _corrected(surface, exemplar, source, seed, level, first, resources)
        coarser = surface, source
        advance(len(levels) - level, len(levels))
    return _with_gutters(finest, levels[0].at(source), levels[0]), finest.face[finest.nearest()]


def _inherited(surface: Surface, coarse: Surface, source: np.ndarray, exemplar: PhotoLevel) -> np.ndarray:
    """Initial source of each pixel: that of the coarse pixel, plus the step from its center."""
    pixels = np.arange(len(surface.place))
    centers = surface.centers(pixels)
    x, y = np.floor(centers / 2).astype(np.int64).T
    height, width = coarse.shape
    parent = coarse.nearest()[np.minimum(y, height - 1), np.minimum(x, width - 1)]
    away = centers - 2 * coarse.centers(parent)
    # a step is not valid where the nearest coarse pixel is in another chart or far away
    away[(np.abs(away) > 4).any(1)] = 0
    steps = np.rint(surface.in_photo(pixels, away) * ONE).astype(np.int32)
    return exemplar.taken(2 * source[parent] + steps)[1]


def _corrected(
    surface: Surface, exemplar: PhotoLevel, source: np.ndarray, seed: int, level: int, first: bool,
    resources: Resources,
) -> np.ndarray:  # fmt: skip
    """Sources that match their neighbors better: passes over four interleaved sets of pixels, each updated at once."""
    passes = _PASSES[0 if first else 1]
    device = resources.device
    run = device.program("atlas", CHANNELS=exemplar.color.shape[1])
    neighbors = Neighbors(surface, offsets(), run, resources)
    parity = (surface.spots >> 15 & 2) + (surface.spots & 1)
    turns = [np.flatnonzero(parity == turn).astype(np.int32) for turn in range(4)]
    height, width = exemplar.snap.shape
    reaches = [(max(height, width), 2 * n) for n in range(_RANDOM)] if first else [(reach, 0) for reach in _FINER]
    layout = {"source": source.nbytes, "better": 8 * max(map(len, turns))}
    photo = {
        "snap": exemplar.snap, "color": exemplar.color, "looks": exemplar.looks,
        "basis": exemplar.basis.astype(np.int32), "reaches": np.array(reaches, np.int32),
    }  # fmt: skip
    beside = neighbors.tables()
    with Buffers(device, layout, resources.budget, "an atlas", tables=beside | photo) as buffers:
        device.write(buffers["source"], source)
        sets = [(len(turn), device.lend(turn)) for turn in turns if len(turn)]
        given = [buffers[name] for name in (*beside, "source", *photo, "better")]
        numbers = surface.shape[1], width, height, int(first), len(reaches)
        for number in range(passes):
            step = (level * 64 + number) * 8 + 16
            for count, chosen in sets:
                run("choose", (count,), chosen, *given, count, *numbers, np.uint32(seed & 0xFFFFFFFF), np.uint32(step))
                run("adopt", (count,), chosen, buffers["better"], buffers["source"], count)
        return device.read(buffers["source"], source.shape, np.int32)


def _with_gutters(surface: Surface, source: np.ndarray, exemplar: PhotoLevel) -> SourceMap:
    """Sources of all pixels of the atlas: gutters continue the surface across borders, others copy the nearest."""
    nearest = surface.nearest()
    outside = np.flatnonzero(surface.index.reshape(-1) < 0)
    owner = nearest.reshape(-1)[outside]
    y, x = np.divmod(outside, surface.shape[1])
    moves = np.stack([x, y], -1) + 0.5 - surface.centers(owner)
    close = np.flatnonzero((moves**2).sum(1) <= GUTTER**2)
    for start in range(0, len(close), _AT_ONCE * 4):
        some = close[start : start + _AT_ONCE * 4]
        owner[some] = surface.around(owner[some], surface.gutter_steps(owner[some], moves[some]), nearest)[0]
    whole = np.empty(surface.index.size, np.int64)
    whole[surface.place] = source
    whole[outside] = source[owner]
    y, x = np.divmod(whole.reshape(surface.shape), exemplar.snap.shape[1])
    return SourceMap.of(y, x)
