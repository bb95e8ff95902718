# SPDX-License-Identifier: Apache-2.0
"""Responses of steerable filters to an image of any size, as it streams by."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..color import BrokenValues
from ..images import Image
from ..session import Session
from ..tiles import BAND_BYTES, remembered
from ..windows import Window
from ..working import Lens
from .cells import Cells
from .steerable import RADIUS, responses

_PIECE_PIXELS = 1 << 18  # whose responses are held at once, on every thread


def survey_responses(
    image: Image,
    lens: Lens,
    cells: Cells,
    session: Session,
    look: Callable[[np.ndarray, np.ndarray | None], np.ndarray],
    keep: Callable[[int, np.ndarray], None],
) -> None:
    """As `cells.survey`, but what is looked at are responses, four after the other of every channel.

    Beyond the border the image is mirrored. A response that sees a pixel of alpha 0 is none.

    Raises
    ------
    BrokenValues
        NaN or Inf: all are counted.
    """
    part = remembered(image.first, session.cache)
    whole = part.window
    broken: np.ndarray | None = None

    def seen(given: tuple[Window, Window, np.ndarray]) -> list[tuple[int, np.ndarray]] | BrokenValues | None:
        piece, around, rows = given
        try:
            lens.values(rows[piece.inside(around)])
        except BrokenValues as error:
            return error
        try:
            values, opaque = lens.values(rows)
        except BrokenValues:  # in rows of another piece, which counts them
            return None
        found, clear = _responses_in(values[..., : lens.count], opaque, piece, around)
        return [
            (cells.row_of(r.top), look(found[r.inside(piece)], None if clear is None else clear[r.inside(piece)]))
            for r in piece.cells(whole.width, cells.side, origin=(whole.left, whole.top))
        ]

    pieces = list(whole.cells(whole.width, max(1, _PIECE_PIXELS // whole.width)))
    at_once = max(1, BAND_BYTES // (16 * _PIECE_PIXELS))
    for begin in range(0, len(pieces), at_once):
        some = pieces[begin : begin + at_once]
        given = [(piece, piece.grown(0, RADIUS) & whole) for piece in some]
        made = session.spread(seen, [(piece, around, part.read(around)) for piece, around in given])
        for number, found in enumerate(made, begin + 1):
            if isinstance(found, BrokenValues):
                broken = found.counts if broken is None else broken + found.counts
            else:
                for row, sums in found or ():
                    keep(row, sums)
            session.advance(number, len(pieces))
    if broken is not None:
        raise BrokenValues(lens.name, broken)


def _responses_in(
    values: np.ndarray, opaque: np.ndarray | None, piece: Window, around: Window
) -> tuple[np.ndarray, np.ndarray | None]:
    """Responses of a piece's pixels, (height, width, 4 channels) float32, and which of them see no pixel of alpha 0."""
    from scipy.ndimage import minimum_filter  # when it is needed: it is slow to import

    rows = slice(piece.top - around.top, piece.bottom - around.top)
    # rows that are not there lie beyond the border, where the filters mirror; others end where no filter looks
    planes = [responses(values[..., c])[:, rows] for c in range(values.shape[-1])]
    found = np.concatenate(planes).transpose(1, 2, 0).astype(np.float32)
    if opaque is None:
        return found, None
    return found, minimum_filter(opaque.astype(np.uint8), 2 * RADIUS + 1, mode="mirror")[rows].astype(bool)
