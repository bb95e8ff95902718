# SPDX-License-Identifier: Apache-2.0
"""One scan of an image of any size, on all threads, similar to `vips_sink` of libvips.

`look` processes pieces on any thread, and `keep` collects its findings on one thread, from top to bottom. So the result
does not depend on threads or bands if it adds integers, or depends on the order of pieces only.
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
    from .color.lens import Lens

Finding = TypeVar("Finding")


def scan(
    part: Part, lens: Lens, resources: Resources,
    look: Callable[[np.ndarray, np.ndarray | None, Window], Finding],
    keep: Callable[[Window, Finding], object],
    *, cell: int = 0, halo: int = 0, larger: int = 1, advance: Callable[[int, int], object] | None = None,
) -> None:  # fmt: skip
    """Scan a part once, in full-width pieces.

    Parameters
    ----------
    part : Part
    lens : Lens
        The conversion of pixels to the working space.
    look : callable
        (values, opaque, piece) -> finding. `values` and `opaque` are `Lens.values` of the piece, which `look` may
        overwrite. Runs on several threads.
    keep : callable
        Called with (piece, finding), in order, on one thread.
    cell : int
        Height of cells in px, counted from the top of the data window, whose borders no piece crosses; 0: no cells.
    halo : int
        Number of rows above and below a piece that are passed to `look` as well, clipped to the image.
    larger : int
        Size of pieces in multiples of `PIECE_PIXELS`; larger if a piece has a fixed cost, such as a halo or a table.
    advance : callable or None
        Called after each piece with the rows done and their total; may raise to stop.

    Raises
    ------
    BrokenValues
        There are NaN or Inf values; all are counted.
    """
    whole, broken = part.window, np.zeros(2, np.int64)
    if halo:
        part = cached(part, resources.cache)

    def seen(given: tuple[Window, Window, np.ndarray]) -> Finding | BrokenValues:
        piece, around, rows = given
        try:
            with np.errstate(over="ignore"):  # values are clipped later
                return look(*lens.values(rows), piece)
        except BrokenValues:  # rows of the halo are counted in their own piece
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
    resources.forget_scanned(part)
    if broken.any():
        raise BrokenValues(lens.name, broken)
