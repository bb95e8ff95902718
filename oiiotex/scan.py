# SPDX-License-Identifier: Apache-2.0
"""One look at an image of any size, on all threads.

As libvips' `vips_sink` has a start, a scan and a stop: who asks makes the sums, `look` sees a piece on any thread, and
`keep` adds what it found, piece after piece from the top down on one thread. So neither threads nor bands show in a
result that adds whole numbers, or that hangs on their order.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

from .core.demand import BAND_BYTES, PIECE_PIXELS, bands, cached, stream
from .core.image import Part
from .core.window import Window
from .deferred import np
from .errors import BrokenValues
from .session.resources import Resources

if TYPE_CHECKING:
    from .color.lab import Lens

Finding = TypeVar("Finding")


def scan(
    part: Part, lens: Lens, resources: Resources,
    look: Callable[[np.ndarray, np.ndarray | None, Window], Finding],
    keep: Callable[[Window, Finding], object],
    *, cell: int = 0, halo: int = 0, larger: int = 1, advance: Callable[[int, int], object] | None = None,
) -> None:  # fmt: skip
    """Look at a part once, in full-width pieces.

    Parameters
    ----------
    part : Part
    lens : Lens
        How pixels are seen.
    look : callable
        (values, opaque, piece) -> what is found there. `values` and `opaque` are `Lens.values` of the piece, which
        `look` may use up. Runs on several threads.
    keep : callable
        (piece, what was found), in order, on one thread.
    cell : int
        No piece crosses a border between rows of cells of so many px, counted from the data window's top; 0: anywhere.
    halo : int
        Rows above and below a piece that `look` gets as well, as far as there are any.
    larger : int
        Pieces are so many times `PIECE_PIXELS`, where a piece has its price: a halo that is looked at twice, a table.
    advance : callable or None
        Told after each piece how many rows are done, and how many there are; may raise to stop.

    Raises
    ------
    BrokenValues
        NaN or Inf: all are counted.
    """
    whole, broken = part.window, np.zeros(2, np.int64)
    if halo:
        part = cached(part, resources.cache)

    def seen(given: tuple[Window, Window, np.ndarray]) -> Finding | BrokenValues:
        piece, around, rows = given
        try:
            with np.errstate(over="ignore"):  # values are cut to a range in the end
                return look(*lens.values(rows), piece)
        except BrokenValues:  # rows of the halo are counted where they are a piece's own
            return BrokenValues(lens.name, lens.broken(rows[piece.inside(around)]))

    wanted = list(bands(part, BAND_BYTES))
    for band, (window, rows) in zip(wanted, stream(part, (b.grown(0, halo) & whole for b in wanted)), strict=True):
        high = max(1, larger * PIECE_PIXELS // band.width)
        cells = band.cells(band.width, cell, (whole.left, whole.top)) if cell else (band,)
        pieces = [piece for row in cells for piece in row.cells(row.width, high)]
        around = [piece.grown(0, halo) & whole for piece in pieces]
        given = [(piece, a, rows[a.inside(window)]) for piece, a in zip(pieces, around, strict=True)]
        for piece, finding in zip(pieces, resources.spread(seen, given), strict=True):
            if isinstance(finding, BrokenValues):
                broken += finding.counts
            else:
                keep(piece, finding)
            if advance is not None:
                advance(piece.bottom - whole.top, whole.height)
    if broken.any():
        raise BrokenValues(lens.name, broken)
