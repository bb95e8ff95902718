# SPDX-License-Identifier: Apache-2.0
"""The exemplar of an op that synthesizes: declared once, read once, into values and the pixels that may be taken."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, TypeVar

from ..color.lab import DATA, working_values
from ..core.attributes import mark_as_data
from ..core.demand import SomeRows, first_channels, materialized
from ..core.image import Image, Part
from ..core.label_map import label_maps
from ..core.op import Op, Space
from ..core.parameters import Numbers, Words, image, param
from ..core.source_map import STMAP
from ..deferred import np
from ..errors import ImageError, ParameterError
from ..io.disk_cache import hash_of
from ..session.resources import Resources
from .exemplar_masks import both, label_map, labeled_pixels, masked_pixels
from .materials import KINDS_HELP, MATCH_HELP, kinds_of, read_material

Found = TypeVar("Found")

EXEMPLAR = "the photo; where labels are spoken of, with label maps as `label` with `keep` makes them"
MASK = "where pixels may come from: above one half of the first channel's range; of ids: all but 0"
LABELS = "label maps of the exemplar, where they are not parts of it"
LABEL = "take only pixels of that label, by its id"
LEVEL = "which label map: label.N of the exemplar or of labels; the coarsest when left out"


@dataclass(frozen=True, eq=False)
class ExemplarPixels:
    """What is seen of an exemplar."""

    values: SomeRows  # (height, width, channels) float32: Lab, or data scaled to 0 .. 100; those of further maps follow
    opaque: np.ndarray | None  # (height, width) bool: where it shows something; None: everywhere
    usable: np.ndarray | None  # (height, width) bool: where pixels may be taken from; None: everywhere
    why: str  # what the pixels are that may not be taken, for messages

    def remembered(self, resources: Resources, find: Callable[..., Found], flag: str, *more: object) -> Found:
        """What `find(flag, lab, usable, *more)` finds in the photo, or found when these pixels were last looked at."""
        usable = None if self.usable is None else hash_of(self.usable)
        return resources.remembered(
            (find, id(self.values), usable),
            lambda: find(flag, first_channels(self.values, 3), self.usable, *more),
            self.values,
        )


@dataclass(frozen=True, kw_only=True)
class LabeledExemplar(Op):
    """What is copied together from one photo, of which label maps may be known."""

    copies: ClassVar[bool] = True
    space: ClassVar[Space] = Space.LAB

    exemplar: Image = image(help=EXEMPLAR)
    mask: ClassVar[Image | None] = None  # as an `ExemplarOp` takes it
    labels: Image | None = image(None, help=LABELS)
    label: ClassVar[int | None] = None
    level: int | None = param(None, ge=1, help=LEVEL)
    data: bool = param(False, help=DATA)
    seed: int = param(0, ge=0, le=2**32 - 1, help="same seed, same pixels")
    stmap: bool | Path = param(False, help=STMAP)

    def read(self, resources: Resources, *also: np.ndarray | None) -> ExemplarPixels:
        """Values, usable pixels, and why the others are not; `also` are further (height, width) bool of usable ones."""
        with resources.stats.time("read and color"):
            values, opaque = self.seen(resources)
            allowed = functools.reduce(both, also, self._allowed())
        why = ["transparent pixels"] if opaque is not None or allowed is None else []
        why += [] if allowed is None else ["pixels outside the mask or label"]
        return ExemplarPixels(values, opaque, both(opaque, allowed), " and of ".join(why))

    def seen(self, resources: Resources) -> tuple[SomeRows, np.ndarray | None]:
        """Values of the exemplar, and where it is opaque."""
        return working_values(self.exemplar, resources, self.working_space, self.holds_photo(resources))

    def holds_photo(self, resources: Resources) -> bool:
        """Whether the values of the photo lie in memory, and not in a file."""
        return True

    def holds(self, resources: Resources, size: int) -> bool:
        """Whether so many bytes a pixel of the photo are a quarter of the budget at most."""
        spec = self.exemplar.first.spec
        return size * spec.width * spec.height <= resources.budget // 4

    def in_any_order(self, part: Part, held: bool) -> Part:
        """The same pixels, of which any may be asked for: decoded to a file where they are not held."""
        return part if held or part.ready else materialized(part, 0)

    def _allowed(self) -> np.ndarray | None:
        """Where mask and label let pixels be taken from; None: everywhere."""
        allowed = None if self.mask is None else masked_pixels(self.mask, self.exemplar)
        if self.label is not None:
            labels = label_map(self.exemplar, self.labels, self.level)
            allowed = both(labeled_pixels(labels, self.label), allowed)
        if allowed is not None and not allowed.any():
            raise ImageError(f"the mask leaves no pixel of {self.exemplar.source}")
        return allowed

    def say_what_stays(self) -> None:
        """Warn, in one line, of parts that do not come along; labels, masks and maps of ids are no loss."""
        used = {id(part) for slot, image in self.given() if not slot.required for part in image.parts}
        used |= {id(one.part) for one in label_maps(self.exemplar).values()}
        lost = [part.name for part in self.exemplar.parts[1:] if not (part.exact or id(part) in used)]
        if lost:
            self.warn("of %s only the first part is used, not %s", self.exemplar.source, ", ".join(lost))


@dataclass(frozen=True, kw_only=True)
class ExemplarOp(LabeledExemplar):
    """What is copied together from one photo, or from one label in it."""

    mask: Image | None = image(None, help=MASK)  # type: ignore[misc]  # the base class has none
    label: int | None = param(None, ge=1, help=LABEL)  # type: ignore[misc]  # the base class has none

    def _allowed(self) -> np.ndarray | None:
        if self.label is None and (self.level is not None or self.labels is not None):
            raise ParameterError("level and labels say where label is looked up: say label, too")
        return super()._allowed()


@dataclass(frozen=True, kw_only=True)
class MaterialOp(ExemplarOp):
    """What is copied together from one photo, or from the n maps of one material."""

    exemplar: Image = image(help="the photo; of n maps of a material, the first")
    maps: tuple[Image, ...] = image((), help="the other maps of the material, made anew with it", count="n")
    n: int = param(1, ge=1, le=16, help="how many maps of one material are made together, the last images of the stack")
    kinds: Words | None = param(None, help=KINDS_HELP)
    match: Numbers | None = param(None, ge=0, help=MATCH_HELP)

    def seen(self, resources: Resources) -> tuple[SomeRows, np.ndarray | None]:
        """All maps of the material together."""
        held = self.holds_photo(resources)
        return read_material(self.all_maps(), self.kinds, self.match, self.data, resources, held)

    def all_maps(self) -> tuple[Image, ...]:
        """The exemplar and the others; raises ParameterError where they are not as many as n says."""
        maps = (self.exemplar, *self.maps)
        if self.n != len(maps):
            raise ParameterError(f"n={self.n}: there are {len(maps)} maps")
        return maps

    def result_count(self) -> int:
        """Each map of the material is an image of its own."""
        return 1 + len(self.maps)

    @property
    def map_kinds(self) -> list[str]:
        """What each of the maps is; raises ParameterError where `kinds` does not fit them."""
        return kinds_of(self.kinds, 1 + len(self.maps), self.data)

    def of_all(self, maps: Sequence[Part], make: Callable[[Part, str], dict[str, Any]]) -> tuple[dict[str, Any], ...]:
        """What `make(map, its kind)` gives of all maps; of others than the first the op's image alone."""
        name, results = self.main().name, list[dict[str, Any]]()
        for one, kind in zip(maps, self.map_kinds, strict=True):
            parts = make(one, kind)
            image = parts[name] if kind == "color" else parts[name].respecced(mark_as_data)
            results.append({name: image} if results else parts | {name: image})
        return tuple(results)
