# SPDX-License-Identifier: Apache-2.0
"""Paint chips: every label's color with its id and name."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ...engine.core.window import Window
from ...engine.deferred import np, oiio
from .drawing import Sheet

_MARGIN = 4  # px
_LARGEST, _LEAST = 14, 8  # px; smaller text is unreadable


def paint_chips(chips: Sequence[tuple[dict[str, Any], Window]], width: int, height: int) -> np.ndarray:
    """A palette's colors in their places, with ids and names if there is room: (height, width, 3) float32 sRGB."""
    sheet = Sheet(width, height)
    for entry, place in chips:
        color = np.array([int(n) for n in entry["color"].split(",")]) / 255
        sheet.box(place.left, place.top, place.right - 1, place.bottom - 1, color)
        ink = (0.0, 0.0, 0.0) if color @ (0.299, 0.587, 0.114) > 0.5 else (1.0, 1.0, 1.0)
        size = min(_LARGEST, (place.height - 3 * _MARGIN) // 2)
        if size < _LEAST:
            continue
        for line, text in enumerate((str(entry["id"]), entry["name"])):
            baseline = place.top + (line + 1) * (_MARGIN + size)
            shown = _shortened(text, size, place.width - 2 * _MARGIN)
            sheet.text(shown, place.left + _MARGIN, baseline, size, ink)
    return sheet.image()


def _shortened(text: str, size: int, width: int) -> str:
    """A text, shortened with an ellipsis to fit the width."""
    shown = text
    while shown and oiio.ImageBufAlgo.text_size(shown, size).width > width:
        text = text[:-1]
        shown = f"{text}\u2026" if text else ""
    return shown
