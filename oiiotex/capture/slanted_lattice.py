# SPDX-License-Identifier: Apache-2.0
"""The lattice of a plane that is seen at a slant.

A plane seen through a lens is x / (1 + l x) of the photo's point x, but for a matrix of two by two: l says where it
would vanish. With the right l a photo of what repeats is most like itself at a distance, so l is where the mean square
of the autocorrelation is largest, far above what any other l gives; that is coarse. Seen that way parts of the photo
have lattices which `regularity` finds, and how these still change from part to part says the rest of l: the phase of
what repeats is linear in x / (1 + l x), and a frequency is the phase's derivative. Whether there is a lattice at all is
asked of the whole photo in the end.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..core.demand import SomeRows
from ..core.image import resized
from ..deferred import np
from ..regularity.autocorrelation import autocorrelation, high_passed
from ..regularity.lattice import find_lattice
from .homography import USUAL_LENS

_OPAQUE = 0.99  # of a pixel that counts
_LARGEST_SIDE = 1024  # px; longer side of the photo while lattices are looked for
_SIDE = 192  # px; longer side of the photo while l is looked for
_STEEPEST, _STEP = 0.8, 0.2  # of l, times the photo's sides: at a corner 1 + l x is 0.2 at least
_FINEST = 0.2 / 16
_VIEWS = (1.0,), (0.4, 0.64, 1.0)  # shares of the photo's sides that are looked at one after the other
_SMALLEST = 48  # px; less holds no lattice that can be told
_SAME = 6  # px; offsets nearer than that are alike whatever repeats
_LEAST = 0.5  # of the photo must be seen from the front
_FITS = 2  # where parts are far from the front their lattices are not all found at once
_PARTS, _SHARE = 4, 0.45  # parts along each side, and the share of the side that each has
_FEWEST = 4  # parts with a lattice: less say nothing of perspective
_ALIKE = 0.25  # of a cell, by which frequencies of parts may be off whole combinations of their neighbors'
_UPRIGHT = math.radians(35)  # a side of the cell is at most so far from the photo's own
# Bricks and square tiles may have one lattice. By this, courses that rise by up to 13 degrees in the photo, and tiles
# turned by up to 30, have their own sides
_LEAN = 2
_STEPS = 64  # places along each side of the lattice where a rectangle may begin


@dataclass(frozen=True)
class SlantedLattice:
    """A lattice in perspective."""

    vanishing: np.ndarray  # (2,) float64: l, per px
    middle: np.ndarray  # (2,) float64: the photo's middle, px, where x is 0
    cell: np.ndarray  # (2, 2) float64: its sides at the middle, px: to the right, down

    def cells_at(self, points: np.ndarray) -> np.ndarray:
        """Points of the photo (n, 2), px, in cells along its two sides."""
        x = points - self.middle
        return x / (1 + x @ self.vanishing)[:, None] @ np.linalg.inv(self.cell)

    def points_at(self, cells: np.ndarray) -> np.ndarray:
        """The inverse of `cells_at`."""
        plane = cells @ self.cell
        return plane / (1 - plane @ self.vanishing)[:, None] + self.middle


def slanted_lattice(values: SomeRows, opaque: np.ndarray | None = None) -> SlantedLattice | None:
    """The lattice of a photo in perspective; None where there is none, or one along a single direction.

    Parameters
    ----------
    values : (height, width, 3 or more) float32
        CIE Lab.
    opaque : (height, width) bool or None
        Pixels that count; None: all.
    """
    size = np.array(values.shape[1::-1])
    if size.min() < _SMALLEST:
        return None
    usable = np.ones((*values.shape[:2], 1), np.float32) if opaque is None else opaque[..., None].astype(np.float32)
    values = values[..., :3] if opaque is None else values[..., :3] * usable
    values, usable = _at_most(_LARGEST_SIDE, values, usable)
    looked = np.array(usable.shape[1::-1])
    if looked.min() <= _SAME:  # of a narrow strip nothing is left across
        return None
    usable = usable[..., 0]
    vanishing = _most_alike(values, usable) / looked
    for _ in range(_FITS):
        rest, of_parts = _still_slanted(*_from_the_front(values, usable, vanishing))
        vanishing = vanishing + rest
        if np.abs(rest * looked).max() < _STEP / 4:
            break
    lattice = find_lattice(*_from_the_front(values, usable, vanishing), of_part=True)
    if lattice is None or lattice.rank != 2:
        return None
    frequencies = lattice.frequencies
    if of_parts is not None:  # far apart chance may favor some of the cells, whose lattice is then found
        combination = of_parts @ np.linalg.inv(frequencies)
        whole = np.rint(combination)
        if abs(np.linalg.det(whole)) > 0.5 and np.abs(combination - whole).max() < _ALIKE:
            frequencies = whole @ frequencies
    cell = _upright(np.linalg.inv(frequencies).T, vanishing * looked.max() * USUAL_LENS)
    return None if cell is None else SlantedLattice(vanishing * looked / size, size / 2, cell * size / looked)


def _at_most(side: int, *images: np.ndarray) -> tuple[np.ndarray, ...]:
    """Images of one size with their longer side `side` px at most."""
    height, width = images[0].shape[:2]
    factor = min(1.0, side / max(width, height))
    return tuple(resized(one, max(1, round(factor * width)), max(1, round(factor * height))) for one in images)


def _from_the_front(values: np.ndarray, usable: np.ndarray, vanishing: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values (height, width, n) with that l straightened about the middle, and which of them count."""
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
    """l times the photo's sides, for which it is most like itself.

    The more cells there are the narrower is the peak, so it is looked for in the whole photo, where there are few, and
    from its middle outwards, where there are many; whichever makes the whole more alike is taken.
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
    """The middle of a photo, of `share` of its sides, made small."""

    def __init__(self, values: np.ndarray, usable: np.ndarray, share: float):
        height, width = usable.shape
        top, left = (round(n * (1 - share) / 2) for n in (height, width))
        middle = np.s_[top : height - top, left : width - left]
        small, counted = _at_most(_SIDE, values[middle], usable[middle][..., None].astype(np.float32))
        self.share, self._usable = share, counted[..., 0]
        # the direction of Lab in which it varies most is enough here
        texture = high_passed(small.astype(np.float64), self._usable > _OPAQUE)
        self._texture = texture @ np.linalg.eigh(np.einsum("ijk,ijl->kl", texture, texture))[1][:, -1:]
        self._known: dict[tuple[int, int], float] = {}

    def likeness(self, at: tuple[float, float]) -> float:
        """How alike it is to itself with that l, times the whole photo's sides."""
        key = round(at[0] / _FINEST * 16), round(at[1] / _FINEST * 16)
        if key not in self._known:
            vanishing = self.share * np.array(at) / self._usable.shape[::-1]
            front, within = _from_the_front(self._texture, self._usable, vanishing)
            enough = within.mean() > _LEAST * self._usable.mean()
            self._known[key] = _self_likeness(front, within) if enough else 0.0
        return self._known[key]


def _self_likeness(values: np.ndarray, usable: np.ndarray) -> float:
    """The mean square of the autocorrelation."""
    alike = autocorrelation(values * usable[..., None], usable)
    x, y = alike.offsets()
    weight = ((x * x + y * y >= _SAME**2) & (alike.weight > 0)).astype(float)
    return float((alike.ncc**2 * weight).sum() / max(float(weight.sum()), 1e-12))


# --- the rest of l ---


def _still_slanted(values: np.ndarray, usable: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
    """l of what is nearly seen from the front, per px, and the frequencies at its middle, (2, 2) cycles per px.

    0 and None where too few parts have a lattice.
    """
    size = np.array(usable.shape[::-1])
    places, frequencies = _local_frequencies(values, usable)
    if len(places) >= _FEWEST:
        x, frequencies = _named_alike(places - size / 2, frequencies)
        if len(x) >= _FEWEST:
            return _fitted(x, frequencies, size)
    return np.zeros(2), None


def _local_frequencies(values: np.ndarray, usable: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Middles of parts that have a lattice of rank 2, (n, 2) px, and its frequencies, (n, 2, 2) cycles per px."""
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
    """Those parts that have the same lattice, each with the same pair of frequencies: reduced pairs are not the same.

    From the part nearest to the middle outwards, each in the whole combinations that are nearest to those of its
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
    """l and the middle's frequencies for those that are seen at x; parts that say something else hardly count."""
    from scipy.optimize import least_squares

    scale = np.abs(frequencies).max()

    def away(unknown: np.ndarray) -> np.ndarray:
        vanishing, middles = unknown[:2] / size, unknown[2:].reshape(2, 2)
        depth = (1 + x @ vanishing)[:, None, None]
        seen = middles / depth - (x @ middles.T)[:, :, None] * vanishing / depth**2  # derivatives of the phases
        return (seen - frequencies / scale).ravel()

    start = np.concatenate([[0, 0], np.median(frequencies, 0).ravel() / scale])
    bounds = np.array([_STEEPEST, _STEEPEST, *[np.inf] * 4])
    found = least_squares(away, start, bounds=(-bounds, bounds), loss="soft_l1", f_scale=0.01).x
    return found[:2] / size, found[2:].reshape(2, 2) * scale


# --- its cells ---


def _upright(vectors: np.ndarray, slant: np.ndarray) -> np.ndarray | None:
    """The sides of a cell that go to the right and down: the shortest of all steps of the lattice that nearly do.

    The least cell of bricks in a running bond has a slanted side; the one over two courses is a rectangle. `slant`,
    (2,), is the tangent of the surface's slant, in its direction: along that the photo shows steps shorter by the
    cosine, so that slanted ones of a steep wall would pass for upright.
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
    """The most whole cells in a rectangle that lies in the photo.

    Parameters
    ----------
    size : (width, height)
        Of the photo, px.

    Returns
    -------
    corners : (4, 2) float64
        Top left, top right, bottom right, bottom left, px.
    cells : (int, int)
        Across and down; 1 at least, which may lie partly outside the photo.
    """
    frame = np.array([[0, 0], [size[0], 0], size, [0, size[1]]], float)
    seen = lattice.cells_at(frame)
    low, high = seen.min(0), seen.max(0)
    # along each side places a whole part of a cell apart, or whole cells
    spans = [max(1, math.floor(_STEPS / (high[a] - low[a]))) for a in (0, 1)]
    steps = [1 / n if n > 1 else max(1, math.ceil((high[a] - low[a]) / _STEPS)) for a, n in enumerate(spans)]
    across, down = (np.arange(low[a], high[a], steps[a]) for a in (0, 1))
    grid = np.stack(np.meshgrid(across, down), -1)
    points = lattice.points_at(grid.reshape(-1, 2)).reshape(grid.shape)
    inside = np.logical_and.reduce((points >= 0) & (points <= size), -1)
    best, corners = 0.0, None
    for west in range(len(across)):
        for east in range(west + spans[0], len(across), spans[0]):
            rows = np.flatnonzero(inside[:, west] & inside[:, east])  # the photo is convex, so all between lie inside
            if len(rows) and (high_rows := (rows[-1] - rows[0]) // spans[1] * spans[1]) > 0:
                area = (across[east] - across[west]) * high_rows * steps[1]
                if area > best + 1e-9:
                    best, corners = area, (across[west], down[rows[0]], across[east], down[rows[0] + high_rows])
    if corners is None:  # less than a cell
        corners = (-0.5, -0.5, 0.5, 0.5)
    left, top, right, bottom = corners
    sides = np.array([[left, top], [right, top], [right, bottom], [left, bottom]])
    return lattice.points_at(sides), (round(right - left), round(bottom - top))
