# SPDX-License-Identifier: Apache-2.0
"""One joint of a strip: a minimum cut where the photo's end overlaps with its start (KSE03 section 3).

Above the seam a tile shows what came before the jump, the end, and below it what comes after, the start. The cut
is made from coarse to fine: on the coarsest level it decides on the whole overlap, so that it can go around objects,
and on finer ones on what lies around the coarser cut.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ...engine.core.demand import SomeRows
from ...engine.deferred import np
from ..graphcut.seams import BAND, MOST_COST, NEIGHBORS, GridEdges, SeamPhoto, chosen, edges, near_border, seam_cost
from .strip import PhotoStrip

_DECIDED = 1 << 13  # px of the overlap on the coarsest level
_AT_ONCE = 1 << 20  # px of the photo that are read at once
_GRADIENTS, _FLOOR = 2.0, 24.0  # of `seam_cost` on coarse levels: shapes count there, and noise is averaged out
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
    guess = None
    for level in _coarse_levels(strip, joint):
        guess = level.cut(*_decided(guess, level.lean.shape, strip.closed))
    return _fine_cut(strip, joint, *_decided(guess, (joint.rows, strip.width), strip.closed))


@dataclass(frozen=True)
class _CoarseOverlap:
    """Both sides of an overlap at a smaller size.

    `end`, `start` (rows, width, 3): grid colors; `lean` (rows, width) int64: cost of showing the start rather than the
    end, as one of them is not usable.
    """

    end: np.ndarray
    start: np.ndarray
    lean: np.ndarray
    closed: bool

    def halved(self) -> _CoarseOverlap:
        """Means of 2 x 2 pixels."""
        return _CoarseOverlap(_halved(self.end), _halved(self.start), _halved(self.lean), self.closed)

    def cut(self, free: np.ndarray, guess: np.ndarray) -> np.ndarray:
        """As `_cut`, without the lines around."""
        ends, starts = (np.pad(one, ((1, 1), (0, 0), (0, 0)), mode="edge").reshape(-1, 3).astype(np.int32)
                        for one in (self.end, self.start))  # fmt: skip

        def between(s: np.ndarray, t: np.ndarray, _: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
            both = seam_cost(ends[s], ends[t], starts[s], starts[t], gradients=_GRADIENTS, floor=_FLOOR)
            return both, both

        return _cut(free, guess, self.lean, self.closed, between)


def _halved(plane: np.ndarray) -> np.ndarray:
    """Means of 2 x 2 pixels; the last row and column of an odd plane count twice."""
    rows, columns = (np.minimum(np.arange(n + n % 2), n - 1) for n in plane.shape[:2])
    whole = plane[rows[:, None], columns].astype(np.int64)
    return ((whole[::2, ::2] + whole[1::2, ::2] + whole[::2, 1::2] + whole[1::2, 1::2]) // 4).astype(plane.dtype)


def _coarse_levels(strip: PhotoStrip, joint: Joint) -> list[_CoarseOverlap]:
    """The overlap at sizes a factor of 2 apart, coarse to fine, without the photo's own."""
    if joint.rows * strip.width <= _DECIDED:
        return []
    step = 2 * max(1, _AT_ONCE // (2 * strip.width))
    pieces = [
        _overlap(strip, joint, np.arange(at, min(at + step, joint.rows))).halved()
        for at in range(0, joint.rows, step)
    ]  # fmt: skip
    end, start, lean = (np.concatenate([getattr(piece, name) for piece in pieces]) for name in ("end", "start", "lean"))
    levels = [_CoarseOverlap(end, start, lean, strip.closed)]
    while levels[0].lean.size > _DECIDED:
        levels.insert(0, levels[0].halved())
    return levels


def _overlap(strip: PhotoStrip, joint: Joint, rows: np.ndarray) -> _CoarseOverlap:
    """Rows of the overlap at the photo's own size."""
    columns = np.arange(strip.width)
    start, end = (strip.source[(joint.first + by + rows)[:, None], columns].yx for by in (0, joint.jump))
    end_colors, start_colors = (strip.photo_colors(*at)[..., :3].astype(np.int16) for at in (end, start))
    return _CoarseOverlap(end_colors, start_colors, _lean(strip, start, end), strip.closed)


def _decided(guess: np.ndarray | None, shape: tuple[int, ...], closed: bool) -> tuple[np.ndarray, np.ndarray]:
    """The pixels that are decided, and the choice at half the size, enlarged; (rows, width) bool.

    They lie around the border of that choice. `guess` None: they are all.
    """
    if guess is None:
        return np.ones(shape, bool), np.zeros(shape, bool)
    guess = guess.repeat(2, 0).repeat(2, 1)[: shape[0], : shape[1]]
    more = BAND + 1
    wide = np.pad(guess, ((more, more), (0, 0)), constant_values=((False, True), (False, False)))
    wide = np.pad(wide, ((0, 0), (more, more)), mode="wrap" if closed else "edge")
    return near_border(wide, BAND)[more:-more, more:-more], guess


def _fine_cut(strip: PhotoStrip, joint: Joint, free: np.ndarray, guess: np.ndarray) -> np.ndarray:
    """As `_cut`, of the photo's own pixels, with the costs of what continues each of them in the photo."""
    rows = np.arange(-1, joint.rows + 1) + joint.first
    columns = np.arange(strip.width)
    # the row above shows the end and the one below the start, so its copies there do not matter
    places = [
        strip.source[np.clip(n, 0, strip.length - 1)[:, None], columns].yx for n in (rows, rows + joint.jump)
    ]  # fmt: skip
    start, end = (np.stack(place).reshape(2, -1) for place in places)
    lean = _lean(strip, *(tuple(line[1:-1] for line in place) for place in places))
    photo = SeamPhoto(_Colors(strip, strip.values))  # type: ignore[arg-type]

    def between(s: np.ndarray, t: np.ndarray, step: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
        return photo.costs(end[:, s], start[:, t], step), photo.costs(start[:, s], end[:, t], step)

    return _cut(free, guess, lean, strip.closed, between)


def _lean(strip: PhotoStrip, start: tuple[np.ndarray, ...], end: tuple[np.ndarray, ...]) -> np.ndarray:
    """Cost of showing pixels of the start rather than those of the end, each rows and columns, (rows, width) int."""
    if strip.usable is None:
        return np.zeros(start[0].shape, np.int64)
    valid = [strip.usable[place].astype(np.int64) for place in (start, end)]
    return np.asarray(_INVALID * (valid[1] - valid[0]))


def _cut(
    free: np.ndarray,
    guess: np.ndarray,
    lean: np.ndarray,
    closed: bool,
    between: Callable[[np.ndarray, np.ndarray, tuple[int, int]], tuple[np.ndarray, np.ndarray]],
) -> np.ndarray:
    """The pixels that show the start, (rows, width) bool.

    Those that are not `free` are as in `guess`. The row above shows the end, and the one below the start. `between`:
    costs of edges from flat indices to others, including these rows, if only the second, or only the first pixel
    shows the start.
    """
    free, lean = (np.pad(one, ((1, 1), (0, 0))) for one in (free, lean))
    taken = np.pad(guess, ((1, 1), (0, 0)), constant_values=((False, True), (False, False)))
    flat, costs = free.ravel(), []
    for step in NEIGHBORS:
        s, t = _edges(free.shape, step, closed)
        kept = flat[s] | flat[t]
        s, t = s[kept], t[kept]
        costs.append(GridEdges(s, t, *between(s, t, step)))
    return chosen(free, taken, lean.ravel(), costs)[1:-1]


def _edges(shape: tuple[int, int], step: tuple[int, int], closed: bool) -> tuple[np.ndarray, np.ndarray]:
    """Flat indices of all edges, of a closed strip also from its last column to the first."""
    s, t = edges(shape, step)
    if not closed or step[1] == 0:
        return s, t
    first = np.arange(shape[0]) * shape[1]
    return np.concatenate([s, first + shape[1] - 1]), np.concatenate([t, first])
