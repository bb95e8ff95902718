# SPDX-License-Identifier: Apache-2.0
"""The places where a label map has the same content, and the table of all contents: LSA16 figures 10 and 11."""

from __future__ import annotations

import logging
from collections.abc import Callable

from ...analysis.labels.content_scan import Contents
from ...analysis.labels.legend import colors_of
from ...engine.color.srgb import LUMA
from ...engine.core.image import Part
from ...engine.core.window import Window
from ...engine.deferred import np, oiio
from .drawing import TEXT, Sheet, eight_bits

log = logging.getLogger("oiiotex")

_ROWS, _ROW_BYTES = 16, 120  # drawn at a time, and bytes per pixel meanwhile
_CENTER, _OUTLINE = (1.0, 0.25, 0.1), (0.1, 0.5, 1.0)
_CELL, _GAP, _HEAD = 72, 4, 48  # px, of the table
_MOST = 24  # maximum number of rows and columns


def drawing_bytes(width: int) -> int:
    """Memory of `marked` for rows of that width, px."""
    return _ROW_BYTES * width * _ROWS


def marked(photo: Part, picture: Callable[[Window], np.ndarray], contents: Contents, place: tuple[int, int]) -> Part:
    """The photo, dimmed except at centers of the key's patches, with the patch at (left, top) outlined.

    `picture` gives a window of the data window, (height, width, 3) float32 sRGB.
    """
    left, top = place
    width, height, side = photo.spec.width, photo.spec.height, contents.side
    thick = max(1, min(width, height) // 300)

    def rows(window: Window) -> np.ndarray:  # full rows: matrix products may round depending on their width
        seen, center = picture(window), contents.centers(range(window.top, window.bottom))
        gray = (seen @ np.array(LUMA, np.float32))[..., None]
        out = np.where(center[..., None], 0.5 * seen + np.multiply(0.5, _CENTER), 0.3 * seen + 0.5 * gray)
        y, x = np.arange(window.top, window.bottom)[:, None] - top, np.arange(width) - left
        inside, within = ((y >= n) & (y < side - n) & (x >= n) & (x < side - n) for n in (0, thick))
        out[inside & ~within] = _OUTLINE
        return eight_bits(out)

    def fetch(window: Window) -> np.ndarray:
        bands = Window(0, window.top, width, window.bottom).cells(width, _ROWS)
        return np.concatenate([rows(band)[:, window.left : window.right] for band in bands])

    return Part("view", oiio.ImageSpec(width, height, 3, oiio.UINT8), fetch)


def key_table(picture: Callable[[Window], np.ndarray], contents: Contents) -> np.ndarray:
    """One patch of every key: first label down, second across, with the labels' colors as headings. sRGB float32."""
    labels = np.unique(list(contents.counts))
    if len(labels) > _MOST:
        area = np.array([contents.areas[label] for label in labels.tolist()])
        largest = np.sort(labels[np.argsort(-area, kind="stable")[:_MOST]])
        log.warning("texcontent: the table shows the %d largest of %d labels", _MOST, len(labels))
        labels = largest
    size, side = _HEAD + len(labels) * (_CELL + _GAP), contents.side
    sheet = Sheet(size, size)
    place = {int(label): _HEAD + n * (_CELL + _GAP) for n, label in enumerate(labels)}
    at = np.arange(_CELL) * side // _CELL
    shown = contents.middles(key for key in contents.counts if key[0] in place and key[1] in place)
    for key, (top, left) in sorted(shown.items(), key=lambda item: item[1]):  # in the order of the photo's file
        patch = picture(Window.sized(left, top, side, side))
        sheet.paste(patch[at][:, at], place[key[1]], place[key[0]])
    for begin, color in zip(place.values(), colors_of(labels), strict=True):
        sheet.box(_HEAD - 12, begin, _HEAD - 5, begin + _CELL - 1, color)
        sheet.box(begin, _HEAD - 12, begin + _CELL - 1, _HEAD - 5, color)
    for label, begin in place.items():
        sheet.text(str(label), 2, begin + _CELL // 2)
        sheet.text(str(label), begin, TEXT)
    return sheet.image()
