# SPDX-License-Identifier: Apache-2.0
"""--texlabelview: label maps as a picture for people."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ..charts.drawing import GAP, Sheet, coloured, sampled, shown_pixels
from ..core.access import ScanThenMap
from ..core.attributes import SIGMA, SUPERPIXELS
from ..core.image import Image
from ..core.label_map import LabelMap, holds_ids, label_maps, required_ids
from ..core.op import Kind, Output, Space
from ..core.parameters import image, param
from ..deferred import np
from ..errors import ImageError
from ..labels.legend import colours_of
from ..session import Session

_NODE = 14  # px of the sheet


@dataclass(frozen=True, kw_only=True)
class LabelView(ScanThenMap):
    """Show label maps to people: a contact sheet of all levels, with the tree of labels beside it.

    Takes the image that --texlabel or --texsuperpixel makes, best with keep=1: the photo, then for every label part
    (uint32, one channel) its labels in colours that stay apart for colour-blind viewers too, over the photo's lightness
    and with their borders. The tree has the coarsest labels at its top; a node is as wide as the label's share of the
    image. The result is an 8-bit sRGB image for screens, made from every nth pixel: do not measure it.
    """

    name: ClassVar[str] = "labelview"
    space: ClassVar[Space] = Space.ANY
    outputs: ClassVar[tuple[Output, ...]] = (Output("view", Kind.PICTURE, "the sheet"),)

    source: Image = image(help="an image with label parts, as --texlabel or --texsuperpixel:keep=1 makes it")
    side: int = param(384, ge=64, le=4096, unit="px", help="longer side of one panel")
    columns: int = param(3, ge=1, le=16, help="panels in a row")
    strength: float = param(0.65, ge=0, le=1, help="of the labels' colours over the photo")

    def compute(self, session: Session) -> dict[str, np.ndarray]:
        """The sheet."""
        named = {id(one.part): one for one in label_maps(self.source).values()}
        # superpixels, and what comes in formats that carry no names, is of no level
        labels = [named.get(id(part), LabelMap(part, 0)) for part in self.source.parts if holds_ids(part)]
        if not labels:
            raise ImageError(
                f"{self.source.source} has no label parts: it takes what --texlabel or --texsuperpixel makes"
                " (ops drop further parts, but with -a)"
            )
        photo = None if holds_ids(self.source.first) else self.source.first
        spec = labels[0].part.spec
        step = max(1, -(-max(spec.width, spec.height) // self.side))
        maps = [required_ids(sampled(one.part, step)[..., 0], one.part.name).astype(np.int64) for one in labels]
        lightness, panels = None, []
        if photo is not None:
            picture = shown_pixels(sampled(photo, step), photo, session.resources)
            lightness = picture @ np.array([0.2126, 0.7152, 0.0722])
            panels.append(("photo", picture))
        for one, ids in zip(labels, maps, strict=True):
            panels.append((_title(one, ids), coloured(ids, lightness, self.strength)))
        # superpixels beside levels of labels have no place in their tree
        levels = [n for n, one in enumerate(labels) if one.level] or list(range(len(labels)))
        tree = _tree([labels[n] for n in levels], [maps[n] for n in levels])
        return {"view": Sheet.of_panels(panels, self.columns, tree).image()}


def _title(labels: LabelMap, ids: np.ndarray) -> str:
    """What a panel shows: how many labels there are, of which scale."""
    count, scale, unit = labels.count, labels.scale, "labels"
    superpixels = labels.part.spec.get_int_attribute(SUPERPIXELS)
    if superpixels:
        count, scale, unit = superpixels, labels.part.spec.get_float_attribute(SIGMA), "superpixels"
    # small labels may have no pixel among those that are shown
    return f"{labels.part.name}: {count or int(ids.max(initial=0))} {unit}" + (f" at {scale:.0f} px" if scale else "")


def _tree(labels: list[LabelMap], maps: list[np.ndarray]) -> Sheet:
    """The tree of labels, coarsest on top: a node's width is its share of the image."""
    width, row = 320, 64
    sheet = Sheet(width, row * len(labels) + _NODE)
    above: dict[int, tuple[float, float]] = {}  # left and right of each label of the level above
    for depth, (one, ids) in enumerate(zip(reversed(labels), reversed(maps), strict=True)):
        top = GAP + depth * row
        areas = np.bincount(ids.ravel())[1:]
        parents = one.parents(len(areas))
        places = _places(areas, parents, above, float(width))
        for label, (left, right) in places.items():
            if parents[label - 1] in above:
                start = round(sum(above[parents[label - 1]]) / 2)
                sheet.line(start, top - row + _NODE, round((left + right) / 2), top, (0.6,) * 3)
            colour = colours_of(np.array(label))
            sheet.box(int(left), top, max(int(left), int(right) - 2), top + _NODE, colour)
        above = places
    return sheet


def _places(
    areas: np.ndarray, parents: np.ndarray, above: dict[int, tuple[float, float]], width: float
) -> dict[int, tuple[float, float]]:
    """Left and right of every label that has pixels: side by side within their parent, by area."""
    parents = np.where(np.isin(parents, list(above)), parents, 0)
    places: dict[int, tuple[float, float]] = {}
    for parent in np.unique(parents[areas > 0]):
        members = np.flatnonzero((parents == parent) & (areas > 0))
        left, right = above.get(int(parent), (0.0, width))
        edges = left + (right - left) * np.concatenate([[0], areas[members].cumsum() / areas[members].sum()])
        places |= {int(m) + 1: (float(a), float(b)) for m, a, b in zip(members, edges, edges[1:], strict=False)}
    return places
