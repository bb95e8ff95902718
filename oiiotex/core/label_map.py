# SPDX-License-Identifier: Apache-2.0
"""Labels at one scale, as a part of an image: its level, how many there are, what they are called and lie in."""

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

MOST_LABELS = 1 << 24  # tables by id stay small


@dataclass(frozen=True)
class LabelMap:
    """A part that is called label.N, with one channel of ids: 1 and up, 0 is no label."""

    part: Part
    level: int  # N; 1 is the finest

    @classmethod
    def of(cls, part: Part, level: int, parents: Sequence[int], scale: float = 0.0) -> LabelMap:
        """The label map that a part becomes.

        Parameters
        ----------
        part : Part
            One channel of ids, uint32; 0 is no label.
        level : int
            1 is the finest.
        parents : sequence of int
            Of label i + 1 the label of the next coarser level that holds it; 0 for none.
        scale : float
            rho, px; 0 where there is none.
        """

        def mark(spec: oiio.ImageSpec) -> None:
            if scale:
                spec.attribute(RHO, float(scale))
            spec.attribute(COUNT, len(parents))
            spec.attribute(PARENTS, ",".join(map(str, parents)))

        return cls(replace(part.respecced(mark), name=f"label.{level}"), level)

    @property
    def ids(self) -> np.ndarray:
        """All of them, (height, width); raises ImageError where one is above `MOST_LABELS`."""
        return required_ids(self.part.pixels()[..., 0], self.part.name)

    @property
    def scale(self) -> float:
        """rho, px; 0 where nothing says it."""
        return self.part.spec.get_float_attribute(RHO)

    @property
    def count(self) -> int:
        """How many labels there are; 0 where nothing says it."""
        count = self.part.spec.get_int_attribute(COUNT)
        return count if 0 <= count <= MOST_LABELS else 0  # files come from strangers

    def parents(self, count: int) -> np.ndarray:
        """The label of the next coarser level that holds label i + 1, (count,) int64; 0 where nothing says it."""
        text = self.part.spec.get_string_attribute(PARENTS)
        known = [int(word) if re.fullmatch("[0-9]{1,8}", word) else 0 for word in text.split(",")]
        return np.array((known + [0] * count)[:count], np.int64)

    def name(self, label: int) -> str:
        """What a label is called: by whoever named it, else by its level and id."""
        names = self._names
        return names[label - 1] if 0 < label <= len(names) and names[label - 1] else f"label.{self.level}/{label}"

    def named(self, names: Mapping[int, str]) -> LabelMap:
        """The map with its labels called so, by id; the others as before."""
        texts = [names.get(label, "") for label in range(1, self.count + 1)]
        part = self.part.respecced(lambda spec: spec.attribute(NAMES, json.dumps(texts)))
        return LabelMap(part, self.level)

    @functools.cached_property
    def _names(self) -> list[str]:
        """What its part says, in the order of ids; '' where it says nothing. Files come from strangers."""
        try:
            names = json.loads(self.part.spec.get_string_attribute(NAMES) or "[]")
        except (ValueError, RecursionError):
            return []
        return [one_line(name) if isinstance(name, str) else "" for name in names] if isinstance(names, list) else []


def required_ids(ids: np.ndarray, name: str) -> np.ndarray:
    """The ids of part `name`, (height, width); an ImageError where one is above `MOST_LABELS`."""
    most = int(ids.max(initial=0))
    if most > MOST_LABELS:
        raise ImageError(f"{name} has label {most}: expected ids from 0 to {MOST_LABELS}; number the labels from 1")
    return ids


def holds_ids(part: Part) -> bool:
    """Whether it is a label map, of superpixels, too, or one whose format carries no part names."""
    return part.spec.format == oiio.UINT32 and part.spec.nchannels == 1


def label_maps(image: Image) -> dict[int, LabelMap]:
    """The parts label.N of an image by level, finest first."""
    named = ((re.fullmatch(r"label\.([0-9]+)", part.name), part) for part in image.parts)
    maps = (LabelMap(part, int(match[1])) for match, part in named if match)
    return {one.level: one for one in sorted(maps, key=lambda one: one.level)}
