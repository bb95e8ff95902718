# SPDX-License-Identifier: Apache-2.0
"""--texcontent: where in an image there is something of the same content, and which contents there are."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from ..charts.drawing import TEXT, Sheet, coloured, shown_pixels
from ..core.access import Whole
from ..core.image import Image, Part, dtype_of
from ..core.op import Kind, Output, Space
from ..core.parameters import Numbers, image, param
from ..core.source_map import SourceMap
from ..deferred import np
from ..errors import ImageError, ParameterError
from ..exemplar.exemplar_masks import label_levels, label_map
from ..exemplar.exemplar_op import LABELS
from ..labels.content_table import ContentTable, content_table, histogram, key_of, patch_side, window_keys
from ..labels.legend import colours_of
from ..session import Session

log = logging.getLogger("oiiotex")

_BYTES = 190  # held for every pixel at most, while windows are drawn on a photo
_CENTRE, _OUTLINE = (1.0, 0.25, 0.1), (0.1, 0.5, 1.0)
_CELL, _GAP, _HEAD = 72, 4, 48  # px of the table
_MOST = 24  # rows and columns of it


def _lines(facts: dict[str, Any]) -> Iterator[str]:
    """The facts for people: what the patch consists of, and how many are like it."""
    for name, counts in facts["histograms"].items():
        ordered = sorted(counts.items(), key=lambda i: (-i[1], int(i[0])))
        shares = ", ".join(f"{c}: {n / facts['patch'] ** 2:.1%}" for c, n in ordered)
        yield f"{name}: {shares or 'none'}"
    first, second = facts["key"]
    yield f"key ({first}, {second}) of label.{facts['level']}: {facts['patches']} patches"


@dataclass(frozen=True, kw_only=True)
class Content(Whole):
    """Show where an image has the same content as at a place, or draw the table of all contents.

    The content of a square patch is its key: the two most frequent labels in it at a level (LSA16: Lockerman, Sauvage,
    Allegre, Dischler, Dorsey, Rushmeier, Multi-Scale Label-Map Extraction for Texture Synthesis, SIGGRAPH 2016,
    section 6.1). The centres of all patches with the key of the patch around `at` are marked red on the photo, and
    that patch is outlined (figure 10). The histograms of that patch at every level are printed (figure 9); json keeps
    them. With table=1 every key is shown by a patch that has it, first label down, second across (figure 11).
    The result is an 8-bit sRGB image for screens: do not measure it.
    """

    name: ClassVar[str] = "content"
    space: ClassVar[Space] = Space.ANY
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("view", Kind.PICTURE, "the photo with what is alike, or the table of keys"),
        Output("facts", Kind.TABLE, "key, histograms of every level, sizes of all keys", asked_by="json", lines=_lines),
    )

    source: Image = image(help="an image with label parts, as --texlabel:keep=1 makes it")
    labels: Image | None = image(None, help=LABELS)
    at: Numbers | None = param(None, unit="px", help="x,y in the data window: the patch's middle; that of the image's")
    level: int | None = param(None, ge=1, help="which label map; the coarsest when left out")
    patch: int | None = param(None, ge=4, le=256, unit="px", help="side; the level's scale as a power of two")
    table: bool = param(False, help="draw the table of keys instead")
    json: Path | None = param(None, help="key, histograms of every level and the sizes of all keys go to this file")

    def compute(self, session: Session) -> dict[str, Any]:
        """The picture, and what it shows as facts."""
        first = self.source.first
        labels = label_map(self.source, self.labels, self.level)
        width, height = first.spec.width, first.spec.height
        session.require(_BYTES * width * height, f"the content of {width}x{height}")
        ids = labels.ids
        side = self.patch or patch_side(labels.scale or min(width, height) / 8)
        side = side if self.patch else min(side, 1 << (min(width, height).bit_length() - 1))
        if side > min(width, height):
            raise ImageError(f"patch={side} is larger than {self.source.source}, {width}x{height}")
        contents = content_table(*window_keys(ids, side), side)
        left, top = self._place(first, side)
        levels = label_levels(self.source, self.labels)
        histograms = {level: histogram(one.ids, top, left, side) for level, one in levels.items()}
        key = key_of(histograms[labels.level])
        picture = self._picture(first, ids, session)
        drawn = _key_table(picture, ids, contents) if self.table else _marked(picture, contents, key, left, top)
        return {"view": drawn, "facts": lambda: _facts(contents, key, labels.level, left, top, histograms)}

    def _place(self, part: Part, side: int) -> tuple[int, int]:
        """Left and top of the patch, in the data window."""
        width, height = part.spec.width, part.spec.height
        if self.at is None:
            return (width - side) // 2, (height - side) // 2
        if len(self.at) != 2:
            raise ParameterError(f"at={self.at}: two numbers are wanted, x,y")
        x, y = (int(np.floor(n)) for n in self.at)
        x, y = x - part.spec.x, y - part.spec.y
        if not (0 <= x < width and 0 <= y < height):
            raise ParameterError(f"at={self.at}: outside the data window {part.window}")
        return min(max(x - side // 2, 0), width - side), min(max(y - side // 2, 0), height - side)

    def _picture(self, first: Part, ids: np.ndarray, session: Session) -> np.ndarray:
        """The photo as sRGB, or the labels in colours where there is none; (h, w, 3) float32."""
        if first.exact or dtype_of(first.spec) == np.uint32:
            return coloured(ids.astype(np.int64), None, 1.0).astype(np.float32)
        return shown_pixels(first.pixels(), first, session).astype(np.float32)


def _count(table: ContentTable, key: tuple[int, int]) -> int:
    number = table.find(key)
    return 0 if number is None else int(table.count()[number])


def _facts(
    table: ContentTable, key: tuple[int, int], level: int, left: int, top: int, histograms: dict[int, dict[int, int]]
) -> dict[str, Any]:
    return {
        "level": level,
        "patch": table.side,
        "left": left,
        "top": top,
        "key": list(key),
        "patches": _count(table, key),
        "histograms": {f"label.{n}": {str(c): k for c, k in counts.items()} for n, counts in histograms.items()},
        "keys": [{"key": k, "patches": n} for k, n in zip(table.keys.tolist(), table.count().tolist(), strict=True)],
    }


def _marked(picture: np.ndarray, table: ContentTable, key: tuple[int, int], left: int, top: int) -> np.ndarray:
    """The photo, dimmed but where a patch of the key has its centre; the patch itself outlined."""
    half, side = table.side // 2, table.side
    number = table.find(key)
    centre = np.zeros(picture.shape[:2], bool)
    rows, columns = table.key_map.shape
    if number is not None:
        centre[half : half + rows, half : half + columns] = table.key_map == number
    gray = (picture @ np.array([0.2126, 0.7152, 0.0722], np.float32))[..., None]
    out = np.where(centre[..., None], 0.5 * picture + np.multiply(0.5, _CENTRE), 0.3 * picture + 0.5 * gray)
    thick = max(1, min(out.shape[:2]) // 300)
    frame = np.zeros(picture.shape[:2], bool)
    frame[top : top + side, left : left + side] = True
    frame[top + thick : top + side - thick, left + thick : left + side - thick] = False
    out[frame] = _OUTLINE
    return out


def _key_table(picture: np.ndarray, ids: np.ndarray, table: ContentTable) -> np.ndarray:
    """One patch of every key: first label down, second across, the labels' colours at the heads."""
    labels = np.unique(table.keys)
    if len(labels) > _MOST:
        area = np.bincount(ids.ravel())[labels]
        largest = np.sort(labels[np.argsort(-area, kind="stable")[:_MOST]])
        log.warning("texcontent: the table shows the %d largest of %d labels", _MOST, len(labels))
        labels = largest
    size = _HEAD + len(labels) * (_CELL + _GAP)
    sheet = Sheet(size, size)
    place = {int(label): _HEAD + n * (_CELL + _GAP) for n, label in enumerate(labels)}
    at = np.arange(_CELL) * table.side // _CELL
    for n, key in enumerate(table.keys.tolist()):
        if key[0] in place and key[1] in place:
            # the middle one: the first may be a rare case at a border
            top, left = SourceMap(table.offsets[(table.starts[n] + table.starts[n + 1]) // 2]).yx
            y, x = place[key[0]], place[key[1]]
            sheet.paste(picture[top + at][:, left + at], x, y)
    for begin, colour in zip(place.values(), colours_of(labels), strict=True):
        sheet.box(_HEAD - 12, begin, _HEAD - 5, begin + _CELL - 1, colour)
        sheet.box(begin, _HEAD - 12, begin + _CELL - 1, _HEAD - 5, colour)
    for label, begin in place.items():
        sheet.text(str(label), 2, begin + _CELL // 2)
        sheet.text(str(label), begin, TEXT)
    return sheet.image()
