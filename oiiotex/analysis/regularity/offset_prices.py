# SPDX-License-Identifier: Apache-2.0
"""The offset penalty: the cost of copying from a place of the photo that is out of phase with the target.

Not in MJH17. A target patch at x and its match at e are in phase if e - x is a vector of the lattice. Otherwise the
penalty depends on the phase of e - x: it is the loss of the photo's normalized autocorrelation, folded onto one cell
of the lattice, compared with phase 0, relative to the maximum loss. All vectors of the lattice have no penalty,
including 0, so near and far places of the photo are equal: neither uniformity nor leaving a stain costs more than
before. On a torus the lattice of the result is the nearest that closes.

Phases are unsigned 32-bit integers that wrap at a whole cycle, and penalties are integers from a table: all devices
decide the same.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from ...engine.deferred import np
from .lattice import Lattice

BITS = 6  # cl/lattice.h, PHASE_BITS
MOST = 100_000_000  # maximum penalty
RESOLVED = 3.0  # px per period: finer lattices are not resolved
STRENGTH = 2.0  # maximum penalty in patch variances at structure 1


@dataclass(frozen=True)
class Prices:
    """Offset penalties on one level, in the format of cl/lattice.h.

    Attributes
    ----------
    phases : (10,) uint32
        Of u and v, in cycles / 2^32: per pixel of the exemplar along x, y, per pixel of the target, at the corner.
    table : (2^BITS, 2^BITS) int32
        Over v and u. Stripes: all rows are equal.
    vectors : (rank, 2) float64
        Vectors of the exemplar's lattice on the level, px, x and y. Courses: the median one.
    warped : bool
        Phases and table are those of courses, in the format of cl/lattice.h, price_of_courses.
    """

    phases: np.ndarray
    table: np.ndarray
    vectors: np.ndarray
    warped: bool = False

    @property
    def resolved(self) -> bool:
        """Whether the level's resolution is sufficient for the lattice."""
        return float(np.linalg.norm(self.vectors, axis=1).min()) >= RESOLVED

    def nearest_in_step(
        self, x: np.ndarray, y: np.ndarray, own_x: np.ndarray, own_y: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """The columns and rows of the exemplar nearest to (own_x, own_y) that are in phase with (x, y), to a pixel.

        Parameters
        ----------
        x, y : array of int64
            Places in the result.
        own_x, own_y : array of int64
            Places in the exemplar, all of one shape, which broadcasts with that of x and y.
        """
        move_x, move_y = np.zeros(own_x.shape), np.zeros(own_x.shape)
        for n, (step_x, step_y) in enumerate(self.vectors):
            cycles = self._cycles(n, x, y, own_x, own_y) - (1 << (31 - BITS))  # half a bin
            away = ((cycles + (1 << 31)) % (1 << 32) - (1 << 31)) / 2.0**32
            move_x, move_y = move_x - away * step_x, move_y - away * step_y
        return own_x + np.rint(move_x).astype(np.int64), own_y + np.rint(move_y).astype(np.int64)

    def _cycles(self, n: int, x: np.ndarray, y: np.ndarray, own_x: np.ndarray, own_y: np.ndarray) -> np.ndarray:
        """Phase n of the offset plus half a bin, in cycles / 2^32, as computed by the kernels."""
        p = self.phases.astype(np.int64)
        if self.warped:
            own, at = (own_y, y) if p[0] else (own_x, x)
            table = self.table.view(np.uint32).astype(np.int64)
            own = np.clip(own, 0, p[2] - p[1] - 1)
            return table[p[1] + own] - table[p[2] + at]
        along_x, along_y, wanted_x, wanted_y = p[[2 * n, 2 * n + 1, 2 * n + 4, 2 * n + 5]]
        return along_x * own_x + along_y * own_y - wanted_x * x - wanted_y * y + p[8 + n]

    def at(self, x: int, y: int, own_x: np.ndarray, own_y: np.ndarray) -> np.ndarray:
        """Penalties of copying to (x, y) from columns and rows of the exemplar: (rows, columns) int32, cl/lattice.h."""
        p = self.phases.astype(np.int64)
        u, v = (
            (p[n] * own_x + p[n + 1] * own_y[:, None] - p[n + 4] * x - p[n + 5] * y + p[8 + n // 2]) % (1 << 32)
            for n in (0, 2)
        )
        return self.table[v >> (32 - BITS), u >> (32 - BITS)]


@dataclass(frozen=True)
class InStep:
    """The exemplar's lattice, as kept by a result.

    Attributes
    ----------
    lattice : Lattice
        Lattice of the exemplar.
    wanted : (rank, 2) float64
        Its frequencies on the result, as from `Lattice.on_torus`.
    structure : float
        Weight of the offset penalty, 0 to 1.
    origin : (int, int)
        Position of the result's first pixel in the exemplar's plane, px.
    """

    lattice: Lattice
    wanted: np.ndarray
    structure: float
    origin: tuple[int, int] = (0, 0)

    def facts(self) -> list[object]:
        """Everything that a result depends on."""
        return [self.wanted, *vars(self.lattice).values()]

    def moved(self, x: int, y: int) -> InStep:
        """The same for a part of the result that begins at (x, y)."""
        return replace(self, origin=(self.origin[0] + x, self.origin[1] + y))

    def prices(self, own_scale: tuple[float, float], scale: tuple[float, float], patch: int, variance: float) -> Prices:
        """Offset penalties on a level.

        Parameters
        ----------
        own_scale, scale : (float, float)
            Scales of the level along x, y: of the exemplar, of the result.
        patch : int
            Side of a patch, px: phases are compared at its middle.
        variance : float
            Variance of the exemplar's pixels on the level, summed over channels.
        """
        table = self.table(self.most(patch**2 * variance))
        return Prices(self.phases(own_scale, scale, patch), table, self.lattice.vectors() * own_scale)

    def most(self, variance: float) -> float:
        """Maximum penalty, compared with sums of squares of that variance."""
        return STRENGTH * self.structure * variance

    def table(self, most: float) -> np.ndarray:
        """As `Prices.table`, with `most` as the maximum penalty."""
        price = np.rint(np.minimum(most * self.lattice.losses(), MOST)).astype(np.int32)
        return np.ascontiguousarray(np.broadcast_to(price.T, (1 << BITS, 1 << BITS)))

    def of_patches(self, patch: int, most: float) -> tuple[np.ndarray, np.ndarray]:
        """Phases and penalties up to `most` for patches of that side, in pixels of the photo (cl/lattice.h)."""
        return self.phases(patch=patch), self.table(most)

    def steps(self) -> np.ndarray:
        """The step, in 1/256 px, x and y, for a whole cycle of phase u and v: (2, 2) int32."""
        steps = np.zeros((2, 2), np.int32)
        steps[: self.lattice.rank] = np.rint(256 * self.lattice.vectors())
        return steps

    def phases(
        self, own_scale: tuple[float, float] = (1, 1), scale: tuple[float, float] = (1, 1), patch: int = 0
    ) -> np.ndarray:
        """As `Prices.phases`. The arguments are those of `prices`."""
        rank = self.lattice.rank
        own, wanted = (np.zeros((2, 2)) for _ in range(2))
        own[:rank], wanted[:rank] = self.lattice.frequencies / own_scale, self.wanted / scale
        corner = (own - wanted).sum(1) * (patch / 2) + 0.5 / (1 << BITS)  # half a bin: floor rounds then
        corner[:rank] -= self.wanted @ np.array(self.origin)
        cycles = np.concatenate([own.ravel(), wanted.ravel(), corner]) % 1.0
        return (np.rint(cycles * 2.0**32).astype(np.uint64) & np.uint64(0xFFFFFFFF)).astype(np.uint32)
