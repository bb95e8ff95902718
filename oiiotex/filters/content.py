# SPDX-License-Identifier: Apache-2.0
"""--texcontent: where in an image there is something of the same content, and which contents there are."""

from __future__ import annotations

import functools
import logging
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from ..charts.drawing import TEXT, Sheet, coloured, eight_bits, shown_pixels
from ..core.access import ScanThenMap
from ..core.demand import cached
from ..core.image import Image, Part, dtype_of
from ..core.op import Kind, Output, Space
from ..core.parameters import Numbers, image, param
from ..core.window import Window
from ..deferred import np, oiio
from ..errors import ImageError, ParameterError
from ..exemplar.exemplar_masks import label_levels, label_map
from ..exemplar.exemplar_op import LABELS
from ..io.row_store import RowStore
from ..labels.content_scan import (
    Strip,
    add_areas,
    key_code,
    key_pair,
    key_strips,
    scan_bytes,
    strip_count,
)
from ..labels.content_table import histogram, key_of, patch_side
from ..labels.legend import colours_of
from ..session import Session

log = logging.getLogger("oiiotex")

_ROWS, _ROW_BYTES = 16, 120  # of the picture that are drawn at once, and bytes of a pixel meanwhile
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
class Content(ScanThenMap):
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
        side = self.patch or patch_side(labels.scale or min(width, height) / 8)
        side = side if self.patch else min(side, 1 << (min(width, height).bit_length() - 1))
        if side > min(width, height):
            raise ImageError(f"patch={side} is larger than {self.source.source}, {width}x{height}")
        needed = scan_bytes(width, height, side, session.resources) + _ROW_BYTES * width * _ROWS
        session.resources.require(needed, f"the content of rows of {width} px in patches of {side} px")
        left, top = self._place(first, side)
        levels = label_levels(self.source, self.labels)
        histograms = {level: _histogram(one.part, left, top, side) for level, one in levels.items()}
        key = key_of(histograms[labels.level])
        contents = Contents(labels.part, side, session, key, passes=2 if self.table else 1)
        photo, labelled = (cached(part, session.resources.cache) for part in (first, labels.part))
        picture = functools.partial(_shown, photo, labelled, session)
        drawn = _key_table(picture, contents) if self.table else _marked(first, picture, contents, left, top)
        return {"view": drawn, "facts": lambda: _facts(contents, labels.level, left, top, histograms)}

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


class Contents:
    """How many windows of a label map have each key, and where those of one key have their centres.

    Parameters
    ----------
    labels : Part
    side : int
        Of windows, px.
    key : (int, int)
        Whose windows are marked.
    passes : int
        How often the map will be looked through, for progress.
    """

    def __init__(self, labels: Part, side: int, session: Session, key: tuple[int, int], passes: int):
        self.side, self.key, self.areas = side, key, dict[int, int]()
        self._labels, self._session, self._half = labels, session, side // 2
        self._done, self._total = 0, passes * strip_count(labels, side)
        width, height = labels.spec.width, labels.spec.height
        size = height, -(-width // 8)  # a bit for each pixel
        self._marks = RowStore(size, np.uint8, in_memory=size[0] * size[1] <= session.resources.budget // 4)
        self._rows = range(self._half, self._half + height - side + 1)
        found: Counter[int] = Counter()
        for strip in self._strips():
            found.update(strip.counts)
            if passes > 1:
                add_areas(self.areas, strip.ids)
            marked = np.zeros((len(strip.keys), width), bool)
            marked[:, self._half : self._half + strip.keys.shape[1]] = (strip.keys == key_code(key)) & any(key)
            at = strip.top + self._half
            self._marks[at : at + len(marked)] = np.packbits(marked, 1)
        if not found:
            raise ImageError(f"no {side}x{side} patch of the exemplar has a label throughout")
        self.counts = {key_pair(code): found[code] for code in sorted(found)}

    def _strips(self) -> Iterator[Strip]:
        return key_strips(self._labels, self.side, self._session.resources, self._advance)

    def _advance(self) -> None:
        self._done += 1
        self._session.progress.advance(self._done, self._total)

    def centres(self, rows: range) -> np.ndarray:
        """Where in rows of the data window a window of the key has its centre: (rows, width) bool."""
        width = self._labels.spec.width
        out = np.zeros((len(rows), width), bool)
        begin, end = max(rows.start, self._rows.start), min(rows.stop, self._rows.stop)
        if begin < end:
            bits = np.unpackbits(self._marks[begin:end], 1, count=width)
            out[begin - rows.start : end - rows.start] = bits.view(bool)
        return out

    def middles(self, keys: Iterable[tuple[int, int]]) -> dict[tuple[int, int], tuple[int, int]]:
        """Top and left of the middle one of each key's windows: the first may be a rare case at a border."""
        left = {key_code(key): self.counts[key] // 2 for key in keys}  # windows before it
        places = {}
        for strip in self._strips():
            for code, count in strip.counts.items():
                if code in left and left[code] < count:
                    at = np.flatnonzero(strip.keys == code)[left.pop(code)]
                    row, column = divmod(int(at), strip.keys.shape[1])
                    places[key_pair(code)] = strip.top + row, column
                elif code in left:
                    left[code] -= count
        return places


def _histogram(labels: Part, left: int, top: int, side: int) -> dict[int, int]:
    """Of the labels in a window."""
    whole = labels.window
    return histogram(labels.read(Window.sized(whole.left + left, whole.top + top, side, side))[..., 0], 0, 0, side)


def _shown(photo: Part, labels: Part, session: Session, window: Window) -> np.ndarray:
    """A window (in the data window) as sRGB, or its labels in colours where there is no photo; (h, w, 3) float32."""
    if not (photo.exact or dtype_of(photo.spec) == np.uint32):
        pixels = photo.read(window.shifted(photo.spec.x, photo.spec.y))
        return shown_pixels(pixels, photo, session.resources).astype(np.float32)
    around = Window(max(0, window.left - 1), max(0, window.top - 1), window.right, window.bottom)  # for borders
    ids = labels.read(around.shifted(labels.spec.x, labels.spec.y))[..., 0]
    return coloured(ids.astype(np.int64), None, 1.0).astype(np.float32)[window.inside(around)]


def _facts(
    contents: Contents, level: int, left: int, top: int, histograms: dict[int, dict[int, int]]
) -> dict[str, Any]:
    return {
        "level": level,
        "patch": contents.side,
        "left": left,
        "top": top,
        "key": list(contents.key),
        "patches": contents.counts.get(contents.key, 0),
        "histograms": {f"label.{n}": {str(c): k for c, k in counts.items()} for n, counts in histograms.items()},
        "keys": [{"key": list(key), "patches": n} for key, n in contents.counts.items()],
    }


def _marked(photo: Part, picture: Callable[[Window], np.ndarray], contents: Contents, left: int, top: int) -> Part:
    """The photo, dimmed but where a patch of the key has its centre; the patch itself outlined."""
    width, height, side = photo.spec.width, photo.spec.height, contents.side
    thick = max(1, min(width, height) // 300)

    def rows(window: Window) -> np.ndarray:  # full ones: products of matrices may round by how wide they are
        seen, centre = picture(window), contents.centres(range(window.top, window.bottom))
        gray = (seen @ np.array([0.2126, 0.7152, 0.0722], np.float32))[..., None]
        out = np.where(centre[..., None], 0.5 * seen + np.multiply(0.5, _CENTRE), 0.3 * seen + 0.5 * gray)
        y, x = np.arange(window.top, window.bottom)[:, None] - top, np.arange(width) - left
        inside, within = ((y >= n) & (y < side - n) & (x >= n) & (x < side - n) for n in (0, thick))
        out[inside & ~within] = _OUTLINE
        return eight_bits(out)

    def fetch(window: Window) -> np.ndarray:
        bands = Window(0, window.top, width, window.bottom).cells(width, _ROWS)
        return np.concatenate([rows(band)[:, window.left : window.right] for band in bands])

    return Part("view", oiio.ImageSpec(width, height, 3, oiio.UINT8), fetch)


def _key_table(picture: Callable[[Window], np.ndarray], contents: Contents) -> np.ndarray:
    """One patch of every key: first label down, second across, the labels' colours at the heads."""
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
    for key, (top, left) in sorted(shown.items(), key=lambda item: item[1]):  # as the photo lies in its file
        patch = picture(Window.sized(left, top, side, side))
        sheet.paste(patch[at][:, at], place[key[1]], place[key[0]])
    for begin, colour in zip(place.values(), colours_of(labels), strict=True):
        sheet.box(_HEAD - 12, begin, _HEAD - 5, begin + _CELL - 1, colour)
        sheet.box(begin, _HEAD - 12, begin + _CELL - 1, _HEAD - 5, colour)
    for label, begin in place.items():
        sheet.text(str(label), 2, begin + _CELL // 2)
        sheet.text(str(label), begin, TEXT)
    return sheet.image()
