# SPDX-License-Identifier: Apache-2.0
"""In which colors labels are shown and painted, and what there is to say of them."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..color.config import as_float
from ..core.label_map import LabelMap
from ..deferred import np
from ..errors import ImageError, texture_filter
from ..io.documents import read_document

_DISTINCT = 48  # colors that are told apart; further labels begin again
_MOVES = 13  # of 255: how far a channel of such a label is moved, less than half a step of the colors' grid
# What deuteranopes, protanopes and tritanopes see of linear Rec. 709: Machado, Oliveira, Fernandes 2009, severity 1.
_BLIND = (
    [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
)  # fmt: skip


@dataclass(frozen=True)
class Legend:
    """What there is to say of a map's labels."""

    labels: LabelMap
    areas: np.ndarray  # px by id

    @classmethod
    def of(cls, labels: LabelMap, opaque: np.ndarray | None) -> Legend:
        """Where `opaque`, (height, width) bool or None for everywhere."""
        ids = labels.ids
        return cls(labels, np.bincount((ids if opaque is None else ids[opaque]).ravel()))

    def entries(self) -> list[dict[str, Any]]:
        """What a table says of each label, the largest first."""
        parents = self.labels.parents(len(self.areas) - 1)
        ids = [int(label) for label in np.argsort(-self.areas, kind="stable") if label and self.areas[label]]
        return [
            {
                "id": label,
                "name": self.labels.name(label),
                "color": color_of(code),
                "area": int(self.areas[label]),
                "parent": int(parents[label - 1]),
            }
            for label, code in zip(ids, codes_of(np.array(ids)).tolist(), strict=True)
        ]


class LabelNames:
    """What labels are called, by level and id: a table of --texpalette with the names that somebody has written.

    Raises
    ------
    ImageError
        It is no such table.
    """

    HELP = "table of `palette`: what labels are called, in parts and in Cryptomatte"

    def __init__(self, path: Path):
        document, self._path = read_document(path), path
        try:
            level = document["level"]
            rows = {level: document["labels"]} | ({level - 1: document["finer"]} if document.get("finer") else {})
            self._names = {at: {entry["id"]: entry["name"] for entry in entries} for at, entries in rows.items()}
        except (KeyError, TypeError, AttributeError) as error:
            expected = f"a table of {texture_filter('palette')}"
            raise ImageError(parameter="names", value=str(path), expected=expected) from error
        numbers = [number for at, one in self._names.items() for number in (at, *one)]
        texts = [text for one in self._names.values() for text in one.values()]
        if not all(type(n) is int and n >= 1 for n in numbers) or not all(type(t) is str and t.strip() for t in texts):
            raise ImageError(f"names={path}: expected ids of 1 and up, and texts as names")

    def of(self, maps: Sequence[LabelMap]) -> list[LabelMap]:
        """All maps of an image with their labels called so; raises ImageError where they have no such label."""
        counts = {one.level: one.count for one in maps}
        for level, names in self._names.items():
            if max(names, default=0) > counts.get(level, 0):
                raise ImageError(f"names={self._path}: there is no label.{level}/{max(names)}")
        return [one.named(self._names[one.level]) if one.level in self._names else one for one in maps]


# --- colors as numbers ---


def code_of(color: str) -> int:
    """'255,128,0' -> red << 16 | green << 8 | blue; ValueError where it is no such color."""
    red, green, blue = (int(n) for n in color.split(","))
    if not all(0 <= n <= 255 for n in (red, green, blue)):
        raise ValueError(f"'{color}'")
    return red << 16 | green << 8 | blue


def color_of(code: int) -> str:
    """The inverse of `code_of`."""
    return f"{code >> 16},{code >> 8 & 255},{code & 255}"


def codes_of(ids: np.ndarray) -> np.ndarray:
    """The colors with which labels are painted: those in which they are shown, moved a little where they come again.

    No two of the first hundred thousand are alike, and none is black.
    """
    eight, again = np.rint(255 * colors_of(ids)).astype(np.int64), (ids - 1) // _DISTINCT
    # half the way to the next color of the grid that they are chosen from, in each of three channels
    step = np.stack([again // _MOVES**n % _MOVES for n in range(3)], -1)
    red, green, blue = np.moveaxis(eight + np.where(eight < 128, step, -step), -1, 0)
    return red << 16 | green << 8 | blue


def codes_in(pixels: np.ndarray, channels: Sequence[int], alpha: int | None = None) -> np.ndarray:
    """The codes of pixels, int64.

    Parameters
    ----------
    pixels : (..., channels)
        0 .. 1 or integers.
    channels : 3 ints
        Those of red, green and blue.
    alpha : int, optional
        The channel with which they are multiplied: it is taken out where it is not 0.
    """
    values = np.nan_to_num(as_float(pixels))
    color = values[..., list(channels)]
    if alpha is not None:
        weight = values[..., alpha, None]
        color = np.divide(color, weight, out=color.copy(), where=weight > 0)
    red, green, blue = np.moveaxis(np.rint(np.clip(color, 0, 1) * 255).astype(np.int64), -1, 0)
    return red << 16 | green << 8 | blue


def oklab_of(codes: np.ndarray) -> np.ndarray:
    """Colors (n,) in Oklab, (n, 3): black and white are 1 apart."""
    eight = np.stack([codes >> 16, codes >> 8 & 255, codes & 255], -1)
    return _oklab(_linear(eight / 255))


# --- colors for eyes ---


def colors_of(ids: np.ndarray) -> np.ndarray:
    """The colors in which labels are shown: sRGB in 0 .. 1, (..., 3); 0 is black."""
    palette = np.concatenate([np.zeros((1, 3)), distinct_colors()])
    return palette[np.where(ids > 0, (ids - 1) % _DISTINCT + 1, 0)]


@functools.cache
def distinct_colors() -> np.ndarray:
    """Colors (48, 3) in sRGB, each as far as can be from those before it, for every kind of eye."""
    levels = np.linspace(0, 1, 11)
    candidates = np.stack(np.meshgrid(levels, levels, levels, indexing="ij"), -1).reshape(-1, 3)
    linear = _linear(candidates)
    luma = linear @ np.array([0.2126, 0.7152, 0.0722])
    kept = (luma > 0.08) & (luma < 0.85)  # borders are dark, paper is light
    candidates, linear = candidates[kept], linear[kept]
    seen = np.stack([_oklab(linear), *(_oklab(np.clip(linear @ eye.T, 0, 1)) for eye in np.array(_BLIND))], axis=1)
    chosen = [int(np.abs(candidates - [0.2, 0.5, 0.9]).sum(1).argmin())]
    nearest = np.full(len(candidates), np.inf)
    while len(chosen) < _DISTINCT:
        apart = ((seen - seen[chosen[-1]]) ** 2).sum(-1)
        # the eye to which it looks most like one before it
        nearest = np.minimum(nearest, apart.min(1))
        chosen.append(int(nearest.argmax()))
    return candidates[chosen]


def _linear(srgb: np.ndarray) -> np.ndarray:
    """Colors of sRGB, 0 .. 1, as linear Rec. 709."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def _oklab(linear: np.ndarray) -> np.ndarray:
    """Ottosson 2020: a space in which distances are near to what eyes see."""
    lms = np.cbrt(linear @ np.array([[0.4122214708, 0.2119034982, 0.0883024619],
                                     [0.5363325363, 0.6806995451, 0.2817188376],
                                     [0.0514459929, 0.1073969566, 0.6299787005]]))  # fmt: skip
    return lms @ np.array([[0.2104542553, 1.9779984951, 0.0259040371],
                           [0.7936177850, -2.4285922050, 0.7827717662],
                           [-0.0040720468, 0.4505937099, -0.8086757660]])  # fmt: skip
