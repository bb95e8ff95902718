# SPDX-License-Identifier: Apache-2.0
"""Labels at one scale, as a part of an image: level, number, names and parents of the labels."""

from __future__ import annotations

import functools
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from ..deferred import np, oiio
from ..errors import ImageError, one_line
from .attributes import COUNT, NAMES, PARENTS, RHO
from .image import Image, Part

MOST_LABELS = 1 << 24  # limits the size of tables by id


@dataclass(frozen=True)
class LabelMap:
    """A part named label.N, with one channel of ids from 1; 0 means no label."""

    part: Part
    level: int  # N; 1 is the finest

    @classmethod
    def of(cls, part: Part, level: int, parents: Sequence[Sequence[int]], scale: float = 0.0) -> LabelMap:
        """A label map from a part.

        Parameters
        ----------
        part : Part
            One channel of ids, uint32; 0 means no label.
        level : int
            1 is the finest.
        parents : sequence of sequences of int
            For label i + 1, its parents on the next coarser level, most of it in the first; none at the coarsest.
        scale : float
            rho, px; 0 if unknown.
        """

        def mark(spec: oiio.ImageSpec) -> None:
            if scale:
                spec.attribute(RHO, float(scale))
            spec.attribute(COUNT, len(parents))
            spec.attribute(PARENTS, ",".join(" ".join(map(str, some or (0,))) for some in parents))

        return cls(replace(part.respecced(mark), name=f"label.{level}"), level)

    @property
    def ids(self) -> np.ndarray:
        """The ids, (height, width); raises ImageError if one exceeds `MOST_LABELS`."""
        return required_ids(self.part.pixels()[..., 0], self.part.name)

    @property
    def scale(self) -> float:
        """rho, px; 0 if unknown."""
        return self.part.spec.get_float_attribute(RHO)

    @property
    def count(self) -> int:
        """Number of labels; 0 if unknown."""
        count = self.part.spec.get_int_attribute(COUNT)
        return count if 0 <= count <= MOST_LABELS else 0  # files are untrusted

    def parents(self, count: int) -> list[list[int]]:
        """For each of `count` labels its parents on the next coarser level, the main one first; none if unknown."""
        text = self.part.spec.get_string_attribute(PARENTS)
        known = [[int(n) for n in re.findall(r"(?<!\S)0*[1-9][0-9]{0,7}(?!\S)", words)] for words in text.split(",")]
        return (known + [[]] * count)[:count]

    def name(self, label: int) -> str:
        """The name of a label; by default its level and id."""
        names = self._names
        return names[label - 1] if 0 < label <= len(names) and names[label - 1] else f"label.{self.level}/{label}"

    def named(self, names: Mapping[int, str]) -> LabelMap:
        """The map with names for some labels, by id."""
        listed = [names.get(label, "") for label in range(1, self.count + 1)]
        part = self.part.respecced(lambda spec: spec.attribute(NAMES, json.dumps(listed)))
        return LabelMap(part, self.level)

    @functools.cached_property
    def _names(self) -> list[str]:
        """The names in the part's metadata, in the order of ids; empty if absent or invalid."""
        try:
            names = json.loads(self.part.spec.get_string_attribute(NAMES) or "[]")
        except (ValueError, RecursionError):
            return []
        return [one_line(name) if isinstance(name, str) else "" for name in names] if isinstance(names, list) else []


def required_ids(ids: np.ndarray, name: str) -> np.ndarray:
    """The ids of part `name`, (height, width); raises ImageError if one exceeds `MOST_LABELS`."""
    most = int(ids.max(initial=0))
    if most > MOST_LABELS:
        raise ImageError(f"{name} has label {most}: expected ids from 0 to {MOST_LABELS}; number the labels from 1")
    return ids


def holds_ids(part: Part) -> bool:
    """Whether a part can be a label map, such as superpixels or one from a format without part names."""
    return part.spec.format == oiio.UINT32 and part.spec.nchannels == 1


def label_maps(image: Image) -> dict[int, LabelMap]:
    """The parts label.N of an image by level, finest first."""
    named = ((re.fullmatch(r"label\.([0-9]+)", part.name), part) for part in image.parts)
    maps = (LabelMap(part, int(match[1])) for match, part in named if match)
    return {one.level: one for one in sorted(maps, key=lambda one: one.level)}


def opened_level(levels: dict[int, LabelMap]) -> int:
    """The coarsest level that is not known to have a single label; the coarsest if there is none."""
    return max((level for level, one in levels.items() if one.count != 1), default=max(levels))
