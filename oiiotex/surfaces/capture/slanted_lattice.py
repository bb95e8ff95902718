# SPDX-License-Identifier: Apache-2.0
"""The lattice of a plane seen in perspective.

Apart from a 2 x 2 matrix, a plane seen through a lens is x / (1 + l x) of the photo's point x, where l gives the
vanishing line. With the right l, the autocorrelation of a periodic texture has the largest mean square, far above that
of any other l. This estimate is coarse. After rectification by it, `regularity` finds lattices of parts of the photo,
and their variation from part to part gives the remainder of l: the phase of a periodic texture is linear in
x / (1 + l x), and frequency is its derivative. Finally the whole photo is tested for a lattice.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ...analysis.regularity.autocorrelation import autocorrelation, high_passed
from ...analysis.regularity.lattice import find_lattice
from ...engine.core.demand import at_most
from ...engine.deferred import np
from .homography import USUAL_LENS

_OPAQUE = 0.99  # least alpha of a valid pixel
_SIDE = 192  # px; longer side of the photo in the search for l
_STEEPEST, _STEP = 0.8, 0.2  # of l, times the photo's sides: at a corner 1 + l x is at least 0.2
_FINEST = 0.2 / 16
_VIEWS = (1.0,), (0.4, 0.64, 1.0)  # sequences of central crops, as proportions of the photo's sides
_SMALLEST = 48  # px; smaller images have no detectable lattice
_SAME = 6  # px; nearby offsets correlate without repetition
_LEAST = 0.5  # least visible proportion of the rectified photo
_FITS = 2  # iterations, since the lattices of strongly distorted parts are not all found at once
_PARTS, _SHARE = 4, 0.45  # parts along each side, and their side as a proportion of the photo's
_FEWEST = 4  # least number of parts with a lattice that determine perspective
_ALIKE = 0.25  # of a cell: tolerance of a part's frequencies as integer combinations of its neighbors'
_UPRIGHT = math.radians(35)  # greatest angle between a side of the cell and the photo's side
# Bricks and square tiles may have the same lattice. With this value courses that rise by up to 13 degrees in the photo,
# and tiles rotated by up to 30, get their natural sides.
_LEAN = 2
_VIEW = 512  # px; longer side of the rectified photo in which joints are looked for
_STRONGEST = 0.9  # quantile of the gradients that are taken for joints
_SHARP = 2.0  # times the mean density of directions, from which a direction is one of joints
_ASIDE = 10  # degrees between a joint and the side of the cell that it follows
_STEPS = 64  # positions along each side of the lattice at which a rectangle may begin


@dataclass(frozen=True)
class SlantedLattice:
    """A lattice in perspective."""

    vanishing: np.ndarray  # (2,) float64: l, per px
    middle: np.ndarray  # (2,) float64: center of the photo, px, where x is 0
    cell: np.ndarray  # (2, 2) float64: sides of a cell at the center, px: to the right, down

    def cells_at(self, points: np.ndarray) -> np.ndarray:
        """Points of the photo (n, 2), px, in lattice coordinates."""
        x = points - self.middle
        return x / (1 + x @ self.vanishing)[:, None] @ np.linalg.inv(self.cell)

    def points_at(self, cells: np.ndarray) -> np.ndarray:
        """The inverse of `cells_at`."""
        plane = cells @ self.cell
        return plane / (1 - plane @ self.vanishing)[:, None] + self.middle


def slanted_lattice(values: np.ndarray, opaque: np.ndarray | None = None) -> SlantedLattice | None:
    """The lattice of a photo in perspective; None if there is none, or only along one direction.

    Parameters
    ----------
    values : (height, width, 3 or more) float32
        CIE Lab.
    opaque : (height, width) bool or None
        Valid pixels; None: all.
    """
    size = np.array(values.shape[1::-1])
    if size.min() < _SMALLEST:
        return None
    usable = np.ones(values.shape[:2], np.float32) if opaque is None else opaque.astype(np.float32)
    values = values[..., :3] * usable[..., None]
    vanishing = _most_alike(values, usable) / size
    for _ in range(_FITS):
        rest, of_parts = _still_slanted(*_from_the_front(values, usable, vanishing))
        vanishing = vanishing + rest
        if np.abs(rest * size).max() < _STEP / 4:
            break
    lattice = find_lattice(*_from_the_front(values, usable, vanishing), of_part=True)
    if lattice is None or lattice.rank != 2:
        return None
    frequencies = lattice.frequencies
    if of_parts is not None:  # at large distances chance may favor a multiple of the cell, whose lattice is then found
        combination = of_parts @ np.linalg.inv(frequencies)
        whole = np.rint(combination)
        if abs(np.linalg.det(whole)) > 0.5 and np.abs(combination - whole).max() < _ALIKE:
            frequencies = whole @ frequencies
    cell = _upright(np.linalg.inv(frequencies).T, vanishing * size.max() * USUAL_LENS)
    return None if cell is None else SlantedLattice(vanishing, size / 2, cell)


def _from_the_front(values: np.ndarray, usable: np.ndarray, vanishing: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values (height, width, n) rectified by l about the center, and which of them are valid."""
    from scipy.ndimage import map_coordinates  # scipy is not loaded before it is needed

    height, width = usable.shape
    half = np.array([width, height]) / 2 - 0.5
    plane = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1) - half
    depth = np.maximum(1 - plane @ vanishing, 1e-3)
    x = plane / depth[..., None] + half
    within = (x >= 0).all(-1) & (x <= [width - 1, height - 1]).all(-1)
    at = np.where(within[..., None], x, 0)[..., ::-1].transpose(2, 0, 1)
    front = np.stack([map_coordinates(values[..., c], at, order=1) for c in range(values.shape[2])], -1)
    return front, within & (map_coordinates(usable, at, order=1) > _OPAQUE)


def _most_alike(values: np.ndarray, usable: np.ndarray) -> np.ndarray:
    """l times the photo's sides with the highest self-similarity.

    The more cells, the narrower the peak. So the search starts in the whole photo at low resolution, and also from its
    center outwards for many cells; the result with the higher self-similarity of the whole photo is used.
    """
    whole, found = _Perspective(values, usable, 1.0), []
    for shares in _VIEWS:
        views = [whole if share == 1 else _Perspective(values, usable, share) for share in shares]
        step = _STEP / shares[0]
        grid = np.arange(-math.floor(_STEEPEST / step), math.floor(_STEEPEST / step) + 1) * step
        best = max(((x, y) for x in grid.tolist() for y in grid.tolist()), key=views[0].likeness)
        for view in views:
            step = _STEP / 2 / view.share
            while step > _FINEST / view.share:
                around = [(best[0] + x, best[1] + y) for x in (0, -step, step) for y in (0, -step, step)]
                best = max((at for at in around if max(map(abs, at)) <= _STEEPEST), key=view.likeness)
                step /= 2
        found.append(best)
    return np.array(max(found, key=whole.likeness))


class _Perspective:
    """The central crop of a photo by `share` of its sides, reduced."""

    def __init__(self, values: np.ndarray, usable: np.ndarray, share: float):
        height, width = usable.shape
        top, left = (round(n * (1 - share) / 2) for n in (height, width))
        middle = np.s_[top : height - top, left : width - left]
        small, counted = at_most(_SIDE, values[middle], usable[middle][..., None].astype(np.float32))
        self.share, self._usable = share, counted[..., 0]
        # the principal component of Lab suffices here
        texture = high_passed(small.astype(np.float64), self._usable > _OPAQUE)
        self._texture = texture @ np.linalg.eigh(np.einsum("ijk,ijl->kl", texture, texture))[1][:, -1:]
        self._known: dict[tuple[int, int], float] = {}

    def likeness(self, at: tuple[float, float]) -> float:
        """Self-similarity after rectification by l, given times the whole photo's sides."""
        key = round(at[0] / _FINEST * 16), round(at[1] / _FINEST * 16)
        if key not in self._known:
            vanishing = self.share * np.array(at) / self._usable.shape[::-1]
            front, within = _from_the_front(self._texture, self._usable, vanishing)
            enough = within.mean() > _LEAST * self._usable.mean()
            self._known[key] = _self_likeness(front, within) if enough else 0.0
        return self._known[key]


def _self_likeness(values: np.ndarray, usable: np.ndarray) -> float:
    """Mean square of the autocorrelation."""
    alike = autocorrelation(values * usable[..., None], usable)
    x, y = alike.offsets()
    weight = ((x * x + y * y >= _SAME**2) & (alike.weight > 0)).astype(float)
    return float((alike.ncc**2 * weight).sum() / max(float(weight.sum()), 1e-12))


# --- the remainder of l ---


def _still_slanted(values: np.ndarray, usable: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
    """Remaining l of a nearly rectified photo, per px, and the frequencies at its center, (2, 2) cycles per px.

    0 and None if too few parts have a lattice.
    """
    size = np.array(usable.shape[::-1])
    places, frequencies = _local_frequencies(values, usable)
    if len(places) >= _FEWEST:
        x, frequencies = _named_alike(places - size / 2, frequencies)
        if len(x) >= _FEWEST:
            return _fitted(x, frequencies, size)
    return np.zeros(2), None


def _local_frequencies(values: np.ndarray, usable: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centers of parts that have a lattice of rank 2, (n, 2) px, and its frequencies, (n, 2, 2) cycles per px."""
    height, width = usable.shape
    high, wide = round(_SHARE * height), round(_SHARE * width)
    places, frequencies = [], []
    for top in np.linspace(0, height - high, _PARTS).astype(int):
        for left in np.linspace(0, width - wide, _PARTS).astype(int):
            at = np.s_[top : top + high, left : left + wide]
            lattice = find_lattice(values[at], usable[at], of_part=True) if usable[at].mean() > 0.5 else None
            if lattice is not None and lattice.rank == 2:
                y, x = np.nonzero(usable[at])
                places.append((left + x.mean() + 0.5, top + y.mean() + 0.5))
                frequencies.append(lattice.frequencies)
    return np.array(places).reshape(-1, 2), np.array(frequencies).reshape(-1, 2, 2)


def _named_alike(x: np.ndarray, frequencies: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Parts that share a lattice, each with the corresponding pair of frequencies, as reduced pairs may differ.

    From the part nearest to the center outwards, each pair becomes the integer combination nearest to the pair of its
    nearest neighbor.
    """
    order = np.argsort((x**2).sum(1), kind="stable")
    kept, named = [order[0]], [frequencies[order[0]]]
    for n in order[1:]:
        near = int(np.argmin(((x[kept] - x[n]) ** 2).sum(1)))
        combination = named[near] @ np.linalg.inv(frequencies[n])
        whole = np.rint(combination)
        if round(abs(np.linalg.det(whole))) == 1 and np.abs(combination - whole).max() < _ALIKE:
            kept.append(n)
            named.append(whole @ frequencies[n])
    return x[kept], np.array(named)


def _fitted(x: np.ndarray, frequencies: np.ndarray, size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """l and the frequencies at the center, fitted to the frequencies at x; robust to outliers."""
    from scipy.optimize import least_squares

    scale = np.abs(frequencies).max()

    def away(unknown: np.ndarray) -> np.ndarray:
        vanishing, middles = unknown[:2] / size, unknown[2:].reshape(2, 2)
        depth = (1 + x @ vanishing)[:, None, None]
        seen = middles / depth - (x @ middles.T)[:, :, None] * vanishing / depth**2  # phase derivatives
        return (seen - frequencies / scale).ravel()

    start = np.concatenate([[0, 0], np.median(frequencies, 0).ravel() / scale])
    bounds = np.array([_STEEPEST, _STEEPEST, *[np.inf] * 4])
    found = least_squares(away, start, bounds=(-bounds, bounds), loss="soft_l1", f_scale=0.01).x
    return found[:2] / size, found[2:].reshape(2, 2) * scale


# --- its cells ---


def _upright(vectors: np.ndarray, slant: np.ndarray) -> np.ndarray | None:
    """Sides of a cell to the right and down: the shortest lattice vectors near those directions.

    The smallest cell of bricks in a running bond has an oblique side; a cell over two courses is a rectangle. `slant`,
    (2,), is the tangent of the surface's slant, in its direction: the photo shortens vectors along it by the cosine, so
    that oblique ones on a steep wall would be taken for upright.
    """
    steps = np.array([[i, j] for i in range(-4, 5) for j in range(-4, 5) if i or j]) @ vectors
    tangent = max(float(np.linalg.norm(slant)), 1e-12)
    along = slant / tangent
    front = steps + (math.hypot(1, tangent) - 1) * (steps @ along)[:, None] * along
    length = np.linalg.norm(front, axis=1)
    sides = []
    for axis in (0, 1):
        lean = np.arccos(np.clip(front[:, axis] / length, -1, 1))
        near = lean < _UPRIGHT
        if not near.any():
            return None
        sides.append(steps[near][np.argmin((length * (1 + _LEAN * lean**2))[near])])
    return np.array(sides)


def largest_rectangle(lattice: SlantedLattice, size: tuple[int, int]) -> tuple[np.ndarray, tuple[int, int]]:
    """The rectangle inside the photo with the most complete cells.

    Parameters
    ----------
    size : (width, height)
        Of the photo, px.

    Returns
    -------
    corners : (4, 2) float64
        Top left, top right, bottom right, bottom left, px.
    cells : (int, int)
        Across and down; at least 1, and then possibly partly outside the photo.
    """
    frame = np.array([[0, 0], [size[0], 0], size, [0, size[1]]], float)
    seen = lattice.cells_at(frame)
    low, high = seen.min(0), seen.max(0)
    # positions along each side are spaced by an integer fraction or an integer multiple of a cell
    spans = [max(1, math.floor(_STEPS / (high[a] - low[a]))) for a in (0, 1)]
    steps = [1 / n if n > 1 else max(1, math.ceil((high[a] - low[a]) / _STEPS)) for a, n in enumerate(spans)]
    across, down = (np.arange(low[a], high[a], steps[a]) for a in (0, 1))
    grid = np.stack(np.meshgrid(across, down), -1)
    points = lattice.points_at(grid.reshape(-1, 2)).reshape(grid.shape)
    inside = np.logical_and.reduce((points >= 0) & (points <= size), -1)
    best, corners = 0.0, None
    for west in range(len(across)):
        for east in range(west + spans[0], len(across), spans[0]):
            rows = np.flatnonzero(inside[:, west] & inside[:, east])  # the photo is convex: all between is inside
            if len(rows) and (high_rows := (rows[-1] - rows[0]) // spans[1] * spans[1]) > 0:
                area = (across[east] - across[west]) * high_rows * steps[1]
                if area > best + 1e-9:
                    best, corners = area, (across[west], down[rows[0]], across[east], down[rows[0] + high_rows])
    if corners is None:  # no complete cell
        corners = (-0.5, -0.5, 0.5, 0.5)
    left, top, right, bottom = corners
    sides = np.array([[left, top], [right, top], [right, bottom], [left, bottom]])
    return lattice.points_at(sides), (round(right - left), round(bottom - top))


def is_sheared(values: np.ndarray, lattice: SlantedLattice, corners: np.ndarray, cells: tuple[int, int]) -> bool:
    """Whether joints of the rectified photo cross the sides of the lattice's cells obliquely.

    In a bond that shifts each course by a third, the cell is oblique; as a rectangle, it shears the stones. Irregular
    bricks and slates can correlate along a diagonal by chance. Oblique lines that are mirrored, as in honeycombs and
    herringbones, or that cross joints along both sides, are a pattern of the surface.

    Parameters
    ----------
    values : (height, width, 3 or more) float32
        CIE Lab.
    corners, cells
        As `largest_rectangle` returns them.
    """
    from scipy.ndimage import gaussian_filter, map_coordinates

    sides = np.linalg.norm(lattice.cell, axis=1) * cells
    width, height = np.maximum(8, sides * min(1.0, _VIEW / sides.max())).astype(int)
    first, last = lattice.cells_at(corners[[0, 2]])
    across, down = (first[a] + (last[a] - first[a]) * (np.arange(n) + 0.5) / n for a, n in ((0, width), (1, height)))
    points = lattice.points_at(np.stack(np.meshgrid(across, down), -1).reshape(-1, 2)) - 0.5
    light = map_coordinates(values[..., 0], points.T[::-1], order=1, mode="nearest")
    light = gaussian_filter(light.reshape(height, width), max(1.0, min(width / cells[0], height / cells[1]) / 24))
    rise, run = np.gradient(light)
    power = rise**2 + run**2
    strong = power > np.quantile(power, _STRONGEST)
    turns = np.degrees(np.arctan2(rise[strong], run[strong])) % 180
    density = np.bincount(np.rint(turns).astype(int) % 180, power[strong], 180)
    density = gaussian_filter(density, 3.0, mode="wrap") / max(density.mean(), 1e-12)
    peaks = np.flatnonzero((density >= np.roll(density, 1)) & (density > np.roll(density, -1)) & (density >= _SHARP))
    away = [np.abs((peaks - axis + 90) % 180 - 90) for axis in (0, 90)]
    along = [bool((one <= _ASIDE).any()) for one in away]
    oblique = peaks[np.minimum(*away) > _ASIDE]
    mirrored = np.abs((oblique[:, None] + peaks + 90) % 180 - 90).min(1, initial=90) <= _ASIDE
    return not mirrored.all() and not all(along)
