# SPDX-License-Identifier: Apache-2.0
"""One joint of a strip: a minimum cut where the photo's end overlaps with its start (KSE03 section 3).

Above the seam a tile shows what came before the jump, the end, and below it what comes after, the start. The cut
decides on all pixels of the overlap or, if these are many, on those around the cheapest path.
"""

from __future__ import annotations

from dataclasses import dataclass

from ...engine.core.demand import SomeRows
from ...engine.deferred import np
from ..graphcut.seams import MOST_COST, NEIGHBORS, GridEdges, SeamPhoto, chosen, edges
from .strip import PhotoStrip

_DECIDED = 1 << 14  # px that one cut decides on
_COLUMNS = 32  # that are compared at a time
_LEAST_AROUND = 6  # px around the path
_INVALID = 4 * MOST_COST  # cost of showing a pixel that is not usable


@dataclass(frozen=True)
class Joint:
    """A jump from row `first + jump` + k to row `first` + k of a strip, k < rows, with the rows in which it happens."""

    jump: int
    first: int
    rows: int


class _Colors:
    """Grid colors of a photo that is read where a seam may run, as `SeamPhoto` indexes them."""

    def __init__(self, strip: PhotoStrip, values: SomeRows):
        self._strip, self.shape = strip, values.shape

    def __getitem__(self, at: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        return self._strip.photo_colors(*at)[..., :3]


def starts(strip: PhotoStrip, joint: Joint) -> np.ndarray:
    """The pixels of the overlap that show the start: (rows, width) bool."""
    rows = np.arange(-1, joint.rows + 1) + joint.first
    start, end = rows[:, None], rows[:, None] + joint.jump
    columns = np.arange(strip.width)
    # the row above shows the end and the one below the start, so its copies there do not matter
    sources = [strip.source[np.clip(n, 0, strip.length - 1), columns] for n in (start, end)]
    places = [np.stack(one.yx).reshape(2, -1) for one in sources]
    decided, below = _decided(strip, joint)
    taken = np.pad(below, ((1, 1), (0, 0)), constant_values=((False, True), (False, False)))
    return _cut(strip, places, np.pad(decided, ((1, 1), (0, 0))), taken)[1:-1]


def _cut(strip: PhotoStrip, places: list[np.ndarray], free: np.ndarray, taken: np.ndarray) -> np.ndarray:
    """Which pixels show the start, (h, w) bool: those that are not `free` as in `taken`.

    `places`: of start and end, each (2, h * w) int.
    """
    start, end = places
    photo = SeamPhoto(_Colors(strip, strip.values))  # type: ignore[arg-type]
    lean = np.zeros(free.size, np.int64)
    if strip.usable is not None:
        valid = [strip.usable[place[0], place[1]] for place in places]
        lean += _INVALID * (valid[1].astype(np.int64) - valid[0])
    flat, costs = free.ravel(), []
    for step in NEIGHBORS:
        s, t = _edges(free.shape, step, strip.closed)
        kept = flat[s] | flat[t]
        s, t = s[kept], t[kept]
        begins = photo.costs(end[:, s], start[:, t], step)  # of a seam: s shows the end, t the start
        costs.append(GridEdges(s, t, begins, photo.costs(start[:, s], end[:, t], step)))
    return chosen(free, taken, lean, costs)


def _edges(shape: tuple[int, int], step: tuple[int, int], closed: bool) -> tuple[np.ndarray, np.ndarray]:
    """Flat indices of all edges, of a closed strip also from its last column to the first."""
    s, t = edges(shape, step)
    if not closed or step[1] == 0:
        return s, t
    first = np.arange(shape[0]) * shape[1]
    return np.concatenate([s, first + shape[1] - 1]), np.concatenate([t, first])


def _decided(strip: PhotoStrip, joint: Joint) -> tuple[np.ndarray, np.ndarray]:
    """The pixels of the overlap that the cut decides on, and which of the others show the start; (rows, width) bool."""
    shape = joint.rows, strip.width
    if joint.rows * strip.width <= _DECIDED:
        return np.ones(shape, bool), np.zeros(shape, bool)
    path = _path(strip, joint)
    around = max(_LEAST_AROUND, _DECIDED // (2 * strip.width))
    rows = np.arange(joint.rows)[:, None]
    low, high = path - around, path + around
    if strip.closed:  # also across the border
        low[[0, -1]], high[[0, -1]] = low[[0, -1]].min(), high[[0, -1]].max()
    return (rows >= low) & (rows <= high), rows > high


def _costs(strip: PhotoStrip, joint: Joint, columns: np.ndarray) -> np.ndarray:
    """Squared differences between the end and the start in columns of the overlap: (columns, rows) int64."""
    rows = np.arange(joint.rows) + joint.first
    first, second = (strip.colors(at, columns[:, None]) for at in (rows, rows + joint.jump))
    return np.asarray(((first - second).astype(np.int64) ** 2).sum(-1))


def _path(strip: PhotoStrip, joint: Joint) -> np.ndarray:
    """Row of the cheapest path in each column of the overlap, moving by at most one row: (width,) int."""
    rows = np.arange(joint.rows)
    order = np.arange(strip.width)
    if strip.closed:  # once around before, so that it ends near where it began
        order = np.concatenate([order, order])
    total = np.zeros(joint.rows + 2, np.int64)
    total[[0, -1]] = np.iinfo(np.int64).max // 2
    moves = np.empty((len(order), joint.rows), np.int8)
    for at in range(0, len(order), _COLUMNS):
        for number, cost in enumerate(_costs(strip, joint, order[at : at + _COLUMNS]), at):
            three = np.stack([total[1:-1], total[:-2], total[2:]])
            choice = three.argmin(0)
            moves[number] = np.array([0, -1, 1])[choice]
            total[1:-1] = three[choice, rows] + cost
    row = int(total[1:-1].argmin())
    path = np.empty(len(order), np.int64)
    for number in range(len(order) - 1, -1, -1):
        path[number] = row
        row += int(moves[number, row])
    return path[-strip.width :]
