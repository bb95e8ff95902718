# SPDX-License-Identifier: Apache-2.0
"""--texlabelview: label maps as a picture for people."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import OpenImageIO as oiio

from ..color import TAG
from ..errors import ImageError
from ..images import Image, Part, channels_of, from_pixels
from ..op import Op, Output, Reach, Space
from ..params import image, param
from ..session import Session
from ..windows import Window
from .label import COUNT, PARENTS, RHO
from .superpixel import COUNT as SUPERPIXELS
from .superpixel import SCALE as SIGMA

_GAP, TEXT, _NODE = 12, 16, 14  # px of the sheet
PAPER, _INK = 0.93, 0.12
_DISTINCT = 48  # colours that are told apart; further labels begin again
# What deuteranopes, protanopes and tritanopes see of linear Rec. 709: Machado, Oliveira, Fernandes 2009, severity 1.
_BLIND = np.array([
    [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
])  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class LabelView(Op):
    """Show label maps to people: a contact sheet of all levels, with the tree of labels beside it.

    Takes the image that --texlabel or --texsuperpixel makes, best with keep=1: the photo, then for every label part
    (uint32, one channel) its labels in colours that stay apart for colour-blind viewers too, over the photo's lightness
    and with their borders. The tree has the coarsest labels at its top; a node is as wide as the label's share of the
    image. The result is an 8-bit sRGB image for screens, made from every nth pixel: do not measure it.
    """

    name: ClassVar[str] = "labelview"
    reach: ClassVar[Reach] = Reach.GLOBAL
    space: ClassVar[Space] = Space.ANY
    outputs: ClassVar[tuple[Output, ...]] = (Output("view", "an 8-bit sRGB picture"),)

    source: Image = image(help="an image with label parts, as --texlabel or --texsuperpixel:keep=1 makes it")
    side: int = param(384, ge=64, le=4096, unit="px", help="longer side of one panel")
    columns: int = param(3, ge=1, le=16, help="panels in a row")
    strength: float = param(0.65, ge=0, le=1, help="of the labels' colours over the photo")

    def compute(self, session: Session) -> Image:
        """The sheet."""
        labels = [p for p in self.source.parts if _holds_ids(p)]
        if not labels:
            raise ImageError(
                f"{self.source.source} has no label parts: it takes what --texlabel or --texsuperpixel makes"
                " (ops drop further parts, but with -a)"
            )
        photo = self.source.first if self.source.first not in labels else None
        step = max(1, -(-max(labels[0].spec.width, labels[0].spec.height) // self.side))
        maps = [sampled(part, step)[..., 0].astype(np.int64) for part in labels]
        lightness, panels = None, []
        if photo is not None:
            picture = shown_pixels(sampled(photo, step), photo, session)
            lightness = picture @ np.array([0.2126, 0.7152, 0.0722])
            panels.append(("photo", picture))
        for part, ids in zip(labels, maps, strict=True):
            panels.append((_title(part, ids), coloured(ids, lightness, self.strength)))
        # superpixels beside levels of labels have no place in their tree
        levels = [n for n, part in enumerate(labels) if part.name.startswith("label.")] or list(range(len(labels)))
        sheet = sheet_of(panels, self.columns, _tree([labels[n] for n in levels], [maps[n] for n in levels]))
        spec = oiio.ImageSpec(sheet.shape[1], sheet.shape[0], 3, oiio.UINT8)
        spec.attribute(TAG, "srgb_rec709_scene")
        spec.attribute("oiio:subimagename", "view")
        pixels = np.rint(np.clip(sheet, 0, 1) * 255).astype(np.uint8)
        return Image((from_pixels("view", pixels, spec, spec.format),), self.source.source)


def _holds_ids(part: Part) -> bool:
    """Whether it is a label map: of --texlabel, of --texsuperpixel, or one whose format carries no part names."""
    return part.spec.format == oiio.UINT32 and part.spec.nchannels == 1


def _title(part: Part, ids: np.ndarray) -> str:
    """What a panel shows: how many labels there are, of which scale."""
    of_labels = part.spec.get_int_attribute(COUNT), part.spec.get_float_attribute(RHO), "labels"
    of_superpixels = part.spec.get_int_attribute(SUPERPIXELS), part.spec.get_float_attribute(SIGMA), "superpixels"
    count, scale, what = of_superpixels if of_superpixels[0] else of_labels
    # small labels may have no pixel among those that are shown
    return f"{part.name}: {count or int(ids.max(initial=0))} {what}" + (f" at {scale:.0f} px" if scale else "")


def sampled(part: Part, step: int) -> np.ndarray:
    """Every `step`th pixel of every `step`th row, read row by row."""
    window = part.window
    rows = []
    for y in range(window.top + min(step // 2, window.height - 1), window.bottom, step):
        row = part.read(Window(window.left, y, window.right, y + 1))
        rows.append(row[0, min(step // 2, window.width - 1) :: step])
    return np.stack(rows)


def shown_pixels(pixels: np.ndarray, part: Part, session: Session) -> np.ndarray:
    """Pixels as sRGB, (h, w, 3) float: by their colour space where it is known, else as they are."""
    channels = channels_of(part.spec)
    values = pixels.astype(np.float32)
    if pixels.dtype.kind in "ui":
        values = values / np.iinfo(pixels.dtype).max
    space = part.spec.get_string_attribute(TAG)
    three = list(channels.colour) if len(channels.colour) == 3 else [channels.colour[0]] * 3
    colour = np.nan_to_num(np.ascontiguousarray(values[..., three]))
    if space and not session.color.is_data(space):
        session.color.to_lab(space)(colour)
        colour = srgb_of(colour)
    return np.clip(colour, 0, 1)


def srgb_of(lab: np.ndarray) -> np.ndarray:
    """Lab (D65) as sRGB whatever spaces the user's config has: this is only to look at."""
    f = (lab[..., :1] + 16) / 116 + np.stack([lab[..., 1] / 500, np.zeros_like(lab[..., 1]), -lab[..., 2] / 200], -1)
    xyz = np.where(f > 6 / 29, f**3, (f - 4 / 29) * 3 * (6 / 29) ** 2) * [0.95047, 1.0, 1.08883]
    linear = np.clip(xyz @ np.array([[3.2404542, -0.9692660, 0.0556434],
                                     [-1.5371385, 1.8760108, -0.2040259],
                                     [-0.4985314, 0.0415560, 1.0572252]]), 0, 1)  # fmt: skip
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def coloured(ids: np.ndarray, lightness: np.ndarray | None, strength: float) -> np.ndarray:
    """Labels (h, w) in colours over the photo's lightness (h, w), their borders dark; 0 is black. (h, w, 3)."""
    palette = np.concatenate([np.zeros((1, 3)), distinct_colours()])
    shown = palette[np.where(ids > 0, (ids - 1) % _DISTINCT + 1, 0)]
    if lightness is not None:
        shown = shown * (strength + (1 - strength) * 1.6 * lightness[..., None])
    border = np.zeros(ids.shape, bool)
    border[1:] |= ids[1:] != ids[:-1]
    border[:, 1:] |= ids[:, 1:] != ids[:, :-1]
    shown[border] *= 0.25
    shown[ids == 0] = 0
    return shown


@functools.cache
def distinct_colours() -> np.ndarray:
    """Colours (48, 3) in sRGB, each as far as can be from those before it, for every kind of eye."""
    levels = np.linspace(0, 1, 11)
    candidates = np.stack(np.meshgrid(levels, levels, levels, indexing="ij"), -1).reshape(-1, 3)
    linear = np.where(candidates <= 0.04045, candidates / 12.92, ((candidates + 0.055) / 1.055) ** 2.4)
    luma = linear @ np.array([0.2126, 0.7152, 0.0722])
    kept = (luma > 0.08) & (luma < 0.85)  # borders are dark, paper is light
    candidates, linear = candidates[kept], linear[kept]
    seen = np.stack([_oklab(linear), *(_oklab(np.clip(linear @ eye.T, 0, 1)) for eye in _BLIND)], axis=1)
    chosen = [int(np.abs(candidates - [0.2, 0.5, 0.9]).sum(1).argmin())]
    nearest = np.full(len(candidates), np.inf)
    while len(chosen) < _DISTINCT:
        apart = ((seen - seen[chosen[-1]]) ** 2).sum(-1)
        # the eye to which it looks most like one before it
        nearest = np.minimum(nearest, apart.min(1))
        chosen.append(int(nearest.argmax()))
    return candidates[chosen]


def _oklab(linear: np.ndarray) -> np.ndarray:
    """Ottosson 2020: a space in which distances are near to what eyes see."""
    lms = np.cbrt(linear @ np.array([[0.4122214708, 0.2119034982, 0.0883024619],
                                     [0.5363325363, 0.6806995451, 0.2817188376],
                                     [0.0514459929, 0.1073969566, 0.6299787005]]))  # fmt: skip
    return lms @ np.array([[0.2104542553, 1.9779984951, 0.0259040371],
                           [0.7936177850, -2.4285922050, 0.7827717662],
                           [-0.0040720468, 0.4505937099, -0.8086757660]])  # fmt: skip


# --- the sheet ---


def sheet_of(panels: list[tuple[str, np.ndarray]], columns: int, beside: np.ndarray | None = None) -> np.ndarray:
    """Panels with their titles in rows, a picture beside them to the right."""
    height, width = panels[0][1].shape[:2]
    columns = min(columns, len(panels))
    wide = max(width, 220)  # a title must fit
    rows = -(-len(panels) // columns)
    down = _GAP + rows * (height + TEXT + 2 * _GAP)
    across = _GAP + columns * (wide + _GAP)
    if beside is not None:
        down, across = max(down, beside.shape[0] + 2 * _GAP), across + beside.shape[1] + _GAP
    sheet = np.full((down, across, 3), PAPER)
    titles = []
    for n, (title, picture) in enumerate(panels):
        top = _GAP + n // columns * (height + TEXT + 2 * _GAP) + TEXT + _GAP
        left = _GAP + n % columns * (wide + _GAP)
        sheet[top : top + height, left : left + width] = picture
        titles.append((title, left, top - _GAP // 2))
    if beside is not None:
        sheet[_GAP : _GAP + beside.shape[0], across - _GAP - beside.shape[1] : across - _GAP] = beside
    return with_text(sheet, titles)


def with_text(picture: np.ndarray, texts: list[tuple[str, int, int]]) -> np.ndarray:
    """Text at (left, baseline); without a font there is none."""
    buffer = oiio.ImageBuf(oiio.ImageSpec(picture.shape[1], picture.shape[0], 3, oiio.FLOAT))
    buffer.set_pixels(buffer.roi, np.ascontiguousarray(picture, np.float32))
    for text, left, baseline in texts:
        if not oiio.ImageBufAlgo.render_text(buffer, left, baseline, text, TEXT - 2, "", (_INK,) * 3):
            buffer.geterror()
            break
    return buffer.get_pixels(oiio.FLOAT)


def _tree(labels: list[Part], maps: list[np.ndarray]) -> np.ndarray:
    """The tree of labels, coarsest on top: a node's width is its share of the image. (h, w, 3)."""
    width, row = 320, 64
    height = row * len(labels) + _NODE
    buffer = oiio.ImageBuf(oiio.ImageSpec(width, height, 3, oiio.FLOAT))
    buffer.set_pixels(buffer.roi, np.full((height, width, 3), PAPER, np.float32))
    colours = distinct_colours()
    above: dict[int, tuple[float, float]] = {}  # left and right of each label of the level above
    for n in range(len(labels) - 1, -1, -1):
        top = _GAP + (len(labels) - 1 - n) * row
        places = _places(labels[n], maps[n], above, float(width))
        parents = _parents(labels[n], len(places))
        for label, (left, right) in places.items():
            middle = round((left + right) / 2)
            if above and parents[label - 1] in above:
                over = above[parents[label - 1]]
                start = (round(sum(over) / 2), top - row + _NODE)
                oiio.ImageBufAlgo.render_line(buffer, *start, middle, top, (0.6,) * 3, True)
            box = (int(left), top, max(int(left), int(right) - 2), top + _NODE)
            colour = tuple(colours[(label - 1) % _DISTINCT].tolist())
            oiio.ImageBufAlgo.render_box(buffer, *box, colour, True)
        above = places
    return buffer.get_pixels(oiio.FLOAT)


def _parents(part: Part, count: int) -> list[int]:
    """Parents as the part's metadata say; 0 where they say nothing."""
    text = part.spec.get_string_attribute(PARENTS)
    found = [int(word) for word in text.split(",")] if text else []
    return found + [0] * (count - len(found))


def _places(
    part: Part, ids: np.ndarray, above: dict[int, tuple[float, float]], width: float
) -> dict[int, tuple[float, float]]:
    """Left and right of every label: side by side within their parent, by area."""
    counts = np.bincount(ids.ravel(), minlength=int(part.spec.get_int_attribute(COUNT)) + 1)[1:] + 1e-9
    parents = np.array(_parents(part, len(counts))[: len(counts)])
    known = np.isin(parents, list(above))
    found = {}
    for parent in np.unique(np.where(known, parents, 0)):
        members = np.flatnonzero(np.where(known, parents, 0) == parent)
        left, right = above.get(int(parent), (0.0, width))
        edges = left + (right - left) * np.concatenate([[0], counts[members].cumsum() / counts[members].sum()])
        found |= {int(m) + 1: (float(a), float(b)) for m, a, b in zip(members, edges, edges[1:], strict=False)}
    return found
