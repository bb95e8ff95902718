# SPDX-License-Identifier: Apache-2.0
"""Colors in which labels are shown and painted, and the table of labels."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...engine.color.config import as_float
from ...engine.color.srgb import LUMA, decoded
from ...engine.core.label_map import LabelMap
from ...engine.deferred import np
from ...engine.errors import ImageError, texture_filter
from ...engine.io.documents import read_document

_DISTINCT = 48  # distinct colors; further labels reuse them, shifted
_MOVES = 13  # of 255: maximum shift of a channel of a reused color, less than half a step of the color grid
_HUE_STEPS = (250, 1000, 1000)  # per unit of Oklab, where hue counts more than lightness
# linear Rec. 709 as seen by deuteranopes, protanopes and tritanopes: Machado, Oliveira, Fernandes 2009, severity 1
_BLIND = (
    [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
)  # fmt: skip


@dataclass(frozen=True)
class Legend:
    """The table of a map's labels."""

    labels: LabelMap
    areas: np.ndarray  # px by id

    @classmethod
    def of(cls, labels: LabelMap, opaque: np.ndarray | None) -> Legend:
        """Count areas where `opaque`, (height, width) bool; None: everywhere."""
        ids = labels.ids
        return cls(labels, np.bincount((ids if opaque is None else ids[opaque]).ravel()))

    def entries(self) -> list[dict[str, Any]]:
        """A table row for each label, the largest first."""
        parents = self.labels.parents(len(self.areas) - 1)
        ids = [int(label) for label in np.argsort(-self.areas, kind="stable") if label and self.areas[label]]
        return [
            {
                "id": label,
                "name": self.labels.name(label),
                "color": color_of(code),
                "area": int(self.areas[label]),
                "parents": parents[label - 1],
            }
            for label, code in zip(ids, codes_of(np.array(ids, np.int64)).tolist(), strict=True)
        ]


class LabelNames:
    """Names of labels by level and id, from an edited table of --texpalette.

    Raises
    ------
    ImageError
        The file is not such a table.
    """

    HELP = "Table from `palette`, whose names are written to label parts and Cryptomatte."

    def __init__(self, path: Path):
        document, self._path = read_document(path), path
        try:
            level = document["level"]
            rows = {level: document["labels"]} | ({level - 1: document["finer"]} if document.get("finer") else {})
            self._names = {at: {entry["id"]: entry["name"] for entry in entries} for at, entries in rows.items()}
        except (KeyError, TypeError, AttributeError) as error:
            expected = f"a table from {texture_filter('palette')}"
            raise ImageError(parameter="palette", value=str(path), expected=expected) from error
        numbers = [number for at, one in self._names.items() for number in (at, *one)]
        called = [name for one in self._names.values() for name in one.values()]
        if not all(type(n) is int and n >= 1 for n in numbers) or not all(type(c) is str and c.strip() for c in called):
            raise ImageError(
                parameter="palette", value=str(path), expected="integer ids >= 1 and names that are strings"
            )

    def of(self, maps: Sequence[LabelMap]) -> list[LabelMap]:
        """Label maps with these names; raises ImageError if a label does not exist."""
        counts = {one.level: one.count for one in maps}
        for level, names in self._names.items():
            if max(names, default=0) > counts.get(level, 0):
                problem = f"has label.{level}/{max(names)}, which does not exist"
                raise ImageError(problem, parameter="palette", value=str(self._path))
        return [one.named(self._names[one.level]) if one.level in self._names else one for one in maps]


# --- colors as numbers ---


def code_of(color: str) -> int:
    """'255,128,0' -> red << 16 | green << 8 | blue; ValueError for anything else."""
    red, green, blue = (int(n) for n in color.split(","))
    if not all(0 <= n <= 255 for n in (red, green, blue)):
        raise ValueError(f"'{color}'")
    return red << 16 | green << 8 | blue


def color_of(code: int) -> str:
    """The inverse of `code_of`."""
    return f"{code >> 16},{code >> 8 & 255},{code & 255}"


def codes_of(ids: np.ndarray) -> np.ndarray:
    """Paint colors of labels: their display colors, shifted slightly where those are reused.

    The first hundred thousand are distinct, and none is black.
    """
    eight, again = np.rint(255 * colors_of(ids)).astype(np.int64), (ids - 1) // _DISTINCT
    # half the distance to the next color of the grid, in each of three channels
    step = np.stack([again // _MOVES**n % _MOVES for n in range(3)], -1)
    red, green, blue = np.moveaxis(eight + np.where(eight < 128, step, -step), -1, 0)
    return red << 16 | green << 8 | blue


def codes_in(pixels: np.ndarray, channels: Sequence[int], alpha: int | None = None) -> np.ndarray:
    """Color codes of pixels, int64.

    Parameters
    ----------
    pixels : (..., channels)
        0 to 1, or integers.
    channels : 3 ints
        Indices of red, green and blue.
    alpha : int, optional
        Index of alpha, by which the pixels are unpremultiplied where it is not 0.
    """
    values = np.nan_to_num(as_float(pixels))
    color = values[..., list(channels)]
    if alpha is not None:
        weight = values[..., alpha, None]
        color = np.divide(color, weight, out=color.copy(), where=weight > 0)
    red, green, blue = np.moveaxis(np.rint(np.clip(color, 0, 1) * 255).astype(np.int64), -1, 0)
    return red << 16 | green << 8 | blue


def oklab_of(codes: np.ndarray) -> np.ndarray:
    """Color codes (n,) in Oklab, (n, 3), where black and white are 1 apart."""
    eight = np.stack([codes >> 16, codes >> 8 & 255, codes & 255], -1)
    return _oklab(decoded(eight / 255))


# --- display colors ---


def colors_of(ids: np.ndarray) -> np.ndarray:
    """Display colors of labels: sRGB 0 to 1, (..., 3); label 0 is black."""
    palette = np.concatenate([np.zeros((1, 3)), distinct_colors()])
    return palette[np.where(ids > 0, (ids - 1) % _DISTINCT + 1, 0)]


def numbers_by_color(sizes: np.ndarray, parents: np.ndarray) -> np.ndarray:
    """Ids 1 to n for n labels, (n,), so that a label's color has the hue of its parent's as far as colors allow.

    The largest label chooses first, so a parent's main child has its id. `sizes` (n,): any unit; `parents` (n,): ids.
    """
    ids = np.arange(1, len(sizes) + 1)
    own, above = (np.rint(oklab_of(codes_of(labels)) * _HUE_STEPS).astype(np.int64) for labels in (ids, parents))
    numbers, free = np.zeros_like(ids), np.ones(len(ids), bool)
    for label in np.argsort(-sizes, kind="stable"):
        away = ((own - above[label]) ** 2).sum(1)
        numbers[label] = ids[free][away[free].argmin()]
        free[numbers[label] - 1] = False
    return numbers


@functools.cache
def distinct_colors() -> np.ndarray:
    """Colors (48, 3) in sRGB, each as distinct as possible from those before it, also for color-blind viewers."""
    levels = np.linspace(0, 1, 11)
    candidates = np.stack(np.meshgrid(levels, levels, levels, indexing="ij"), -1).reshape(-1, 3)
    linear = decoded(candidates)
    luma = linear @ np.array(LUMA)
    kept = (luma > 0.08) & (luma < 0.85)  # distinct from dark borders and light paper
    candidates, linear = candidates[kept], linear[kept]
    seen = np.stack([_oklab(linear), *(_oklab(np.clip(linear @ eye.T, 0, 1)) for eye in np.array(_BLIND))], axis=1)
    chosen = [int(np.abs(candidates - [0.2, 0.5, 0.9]).sum(1).argmin())]
    nearest = np.full(len(candidates), np.inf)
    while len(chosen) < _DISTINCT:
        apart = ((seen - seen[chosen[-1]]) ** 2).sum(-1)
        # the type of vision to which it is least distinct from one before it
        nearest = np.minimum(nearest, apart.min(1))
        chosen.append(int(nearest.argmax()))
    return candidates[chosen]


def _oklab(linear: np.ndarray) -> np.ndarray:
    """Oklab (Ottosson 2020), in which distances are approximately perceptual."""
    lms = np.cbrt(linear @ np.array([[0.4122214708, 0.2119034982, 0.0883024619],
                                     [0.5363325363, 0.6806995451, 0.2817188376],
                                     [0.0514459929, 0.1073969566, 0.6299787005]]))  # fmt: skip
    return lms @ np.array([[0.2104542553, 1.9779984951, 0.0259040371],
                           [0.7936177850, -2.4285922050, 0.7827717662],
                           [-0.0040720468, 0.4505937099, -0.8086757660]])  # fmt: skip
