# SPDX-License-Identifier: Apache-2.0
"""Pictures that visualize results: pixels in display colors, labels in distinct colors, sheets to draw on."""

from __future__ import annotations

from collections.abc import Sequence

from ...analysis.labels.legend import colors_of
from ...engine.color.srgb import srgb_of_lab
from ...engine.core.attributes import TAG
from ...engine.core.image import Part, channels_of, pixels_of
from ...engine.core.label_map import LabelMap
from ...engine.core.window import Window
from ...engine.deferred import np, oiio
from ...engine.session.resources import Resources

GAP, TEXT = 12, 16  # px of a sheet
PAPER, INK = 0.93, 0.12
_NODE = 14  # px, of a tree


class Sheet:
    """A picture to draw on, in sRGB. Later drawings cover earlier ones."""

    def __init__(self, width: int, height: int):
        self.width, self.height = width, height
        self._buffer = oiio.ImageBuf(oiio.ImageSpec(width, height, 3, oiio.FLOAT))
        oiio.ImageBufAlgo.fill(self._buffer, (PAPER,) * 3)

    @classmethod
    def of_panels(cls, panels: Sequence[tuple[str, np.ndarray]], columns: int, beside: Sheet | None = None) -> Sheet:
        """Pictures of one size with their titles in rows, with another sheet to their right."""
        height, width = panels[0][1].shape[:2]
        columns = min(columns, len(panels))
        wide = max(width, 220)  # room for a title
        rows = -(-len(panels) // columns)
        down, across = GAP + rows * (height + TEXT + 2 * GAP), GAP + columns * (wide + GAP)
        if beside is not None:
            down, across = max(down, beside.height + 2 * GAP), across + beside.width + GAP
        sheet = cls(across, down)
        if beside is not None:
            sheet.paste(beside.image(), across - GAP - beside.width, GAP)
        for n, (title, picture) in enumerate(panels):
            top = GAP + n // columns * (height + TEXT + 2 * GAP) + TEXT + GAP
            left = GAP + n % columns * (wide + GAP)
            sheet.paste(picture, left, top)
            sheet.text(title, left, top - GAP // 2)
        return sheet

    def paste(self, picture: np.ndarray, left: int, top: int) -> None:
        """Draw a picture (h, w, 3)."""
        window = Window.sized(left, top, picture.shape[1], picture.shape[0])
        self._buffer.set_pixels(window.roi(3), np.ascontiguousarray(picture, np.float32))

    def box(self, left: int, top: int, right: int, bottom: int, color: Sequence[float] | np.ndarray) -> None:
        """Fill a rectangle, outermost pixels included. sRGB, 0 to 1."""
        oiio.ImageBufAlgo.render_box(self._buffer, left, top, right, bottom, tuple(map(float, color)), True)

    def line(self, x: int, y: int, to_x: int, to_y: int, color: tuple[float, float, float]) -> None:
        """Draw a line between two pixels, one pixel wide. sRGB, 0 to 1."""
        oiio.ImageBufAlgo.render_line(self._buffer, x, y, to_x, to_y, color, True)

    def text(self, text: str, left: int, baseline: int) -> None:
        """Draw a line of text. Without a font, nothing is drawn."""
        text = text.encode("utf-8", "replace").decode()  # file names can be invalid UTF-8
        if not oiio.ImageBufAlgo.render_text(self._buffer, left, baseline, text, TEXT - 2, "", (INK,) * 3):
            self._buffer.geterror()

    def image(self) -> np.ndarray:
        """The picture: (height, width, 3) float32."""
        return pixels_of(self._buffer, oiio.FLOAT)


def eight_bits(picture: np.ndarray) -> np.ndarray:
    """sRGB floats in 0 .. 1 as uint8."""
    return np.rint(np.clip(picture, 0, 1) * 255).astype(np.uint8)


def sampled(part: Part, step: int) -> np.ndarray:
    """Every `step`th pixel of every `step`th row, read row by row."""
    window = part.window
    rows = []
    for y in range(window.top + min(step // 2, window.height - 1), window.bottom, step):
        row = part.read(Window(window.left, y, window.right, y + 1))
        rows.append(row[0, min(step // 2, window.width - 1) :: step].copy())  # a view would keep all decoded rows
    return np.stack(rows)


def shown_pixels(pixels: np.ndarray, part: Part, resources: Resources) -> np.ndarray:
    """Pixels as sRGB, (h, w, 3) float: converted from their color space if it is known, else unchanged."""
    channels = channels_of(part.spec)
    values: np.ndarray = pixels.astype(np.float32)
    if pixels.dtype.kind in "ui":
        values = values / np.iinfo(pixels.dtype).max
    space = part.spec.get_string_attribute(TAG)
    three = list(channels.color) if len(channels.color) == 3 else [channels.first] * 3
    color = np.nan_to_num(np.ascontiguousarray(values[..., three]))
    if space and not resources.color.is_data(space):
        resources.color.to_lab(space)(color)
        color = srgb_of_lab(color)
    return np.clip(color, 0, 1)


def colored(ids: np.ndarray, lightness: np.ndarray | None, strength: float) -> np.ndarray:
    """Labels (h, w) in colors over the photo's lightness (h, w), with dark borders. 0 is black. (h, w, 3)."""
    shown = colors_of(ids)
    if lightness is not None:
        shown = shown * (strength + (1 - strength) * 1.6 * lightness[..., None])
    border = np.zeros(ids.shape, bool)
    border[1:] |= ids[1:] != ids[:-1]
    border[:, 1:] |= ids[:, 1:] != ids[:, :-1]
    shown[border] *= 0.25
    shown[ids == 0] = 0
    return shown


def label_tree(labels: list[LabelMap], maps: list[np.ndarray]) -> Sheet:
    """The tree of labels, given finest first with (height, width) ids of each. The width of a node is its share.

    A label lies below its main parent; lines to its other parents are faint.
    """
    width, row = 320, 64
    sheet = Sheet(width, row * len(labels) + _NODE)
    above: dict[int, tuple[float, float]] = {}  # left and right of each label of the level above
    for depth, (one, ids) in enumerate(zip(reversed(labels), reversed(maps), strict=True)):
        top = GAP + depth * row
        areas = np.bincount(ids.ravel())[1:]
        parents = one.parents(len(areas))
        main = np.array([next((p for p in some if p in above), 0) for some in parents], np.int64)
        places = _places(areas, main, above, float(width))
        for label, (left, right) in places.items():
            for parent in reversed([p for p in parents[label - 1] if p in above]):
                start, ink = round(sum(above[parent]) / 2), 0.5 if parent == main[label - 1] else 0.85
                sheet.line(start, top - row + _NODE, round((left + right) / 2), top, (ink,) * 3)
            color = colors_of(np.array(label))
            sheet.box(int(left), top, max(int(left), int(right) - 2), top + _NODE, color)
        above = places
    return sheet


def _places(
    areas: np.ndarray, parents: np.ndarray, above: dict[int, tuple[float, float]], width: float
) -> dict[int, tuple[float, float]]:
    """Left and right of every label that has pixels: side by side within their main parent, by area; 0: none."""
    places: dict[int, tuple[float, float]] = {}
    for parent in np.unique(parents[areas > 0]):
        members = np.flatnonzero((parents == parent) & (areas > 0))
        left, right = above.get(int(parent), (0.0, width))
        edges = left + (right - left) * np.concatenate([[0], areas[members].cumsum() / areas[members].sum()])
        places |= {int(m) + 1: (float(a), float(b)) for m, a, b in zip(members, edges, edges[1:], strict=False)}
    return places
