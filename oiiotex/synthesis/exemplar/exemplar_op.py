# SPDX-License-Identifier: Apache-2.0
"""The exemplar of a synthesis op: declared once, then read into values and valid source pixels."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, TypeVar

from ...engine.color.lab import DATA, color_to_convert, working_values
from ...engine.core.attributes import mark_as_data
from ...engine.core.demand import SomeRows, first_channels, materialized
from ...engine.core.image import Image, Part
from ...engine.core.label_map import label_maps
from ...engine.core.op import Op, Space
from ...engine.core.parameters import Numbers, Words, image, param
from ...engine.core.source_map import STMAP
from ...engine.deferred import np
from ...engine.errors import ImageError, ParameterError
from ...engine.io.disk_cache import hash_of
from ...engine.session.facts import Facts
from ...engine.session.resources import Resources
from .exemplar_masks import both, label_map, labeled_pixels, laid_over, masked_pixels
from .materials import KINDS_HELP, MATCH_HELP, kinds_of, read_material, require_readable

Found = TypeVar("Found")

EXEMPLAR = "Photo. Where labels are used, with the label maps that `label` with `photo` creates."
MASK = "Image that marks the valid source pixels (first channel above half its range, or a nonzero label id)."
LABEL = "Id of a label in the exemplar's label maps. Only pixels of that label are used as a source."
LEVEL = "Level of the label maps: N selects the part label.N. 1 is the finest."
COARSEST = "the coarsest with several labels"
TILES = "none", "x", "y", "xy"
SEED = "Seed of the random numbers. The same seed gives the same pixels."


def tiles(default: str) -> Any:
    """Declare `tiles`."""
    return param(default, choices=TILES, help="Axes along which the result tiles.")


@dataclass(frozen=True, eq=False)
class ExemplarPixels:
    """Pixel values of an exemplar, and which of them are valid sources."""

    values: SomeRows  # (height, width, channels) float32: Lab, or data scaled to 0 .. 100, then the other maps
    opaque: np.ndarray | None  # (height, width) bool; None: opaque everywhere
    usable: np.ndarray | None  # (height, width) bool: valid source pixels; None: all
    why: str  # why the other pixels are not valid, for messages

    def remembered(self, resources: Resources, find: Callable[..., Found], flag: str, *more: object) -> Found:
        """The result of `find(flag, lab, usable, *more)`, remembered for these pixels."""
        usable = None if self.usable is None else hash_of(self.usable)
        return resources.remembered(
            (find, id(self.values), usable),
            lambda: find(flag, first_channels(self.values, 3), self.usable, *more),
            self.values,
        )


@dataclass(frozen=True, kw_only=True)
class LabeledExemplar(Op):
    """An op that copies pixels of one photo, which may have label maps."""

    copies: ClassVar[bool] = True
    space: ClassVar[Space] = Space.LAB

    exemplar: Image = image(help=EXEMPLAR)
    mask: ClassVar[Image | None] = None  # as an `ExemplarOp` takes it
    label: ClassVar[int | None] = None
    labellevel: int | None = param(None, example="2", ge=1, unset=COARSEST, help=LEVEL, advanced=True)
    data: bool = param(False, help=DATA, advanced=True)
    seed: int = param(0, ge=0, le=2**32 - 1, help=SEED)
    st: bool | Path = param(False, help=STMAP, example="st.exr", advanced=True)

    def require_readable(self, facts: Facts) -> None:
        """Refuse inputs that `read` would refuse whatever their pixels are."""
        if self.label is not None:
            label_map(self.exemplar, self.labellevel)
        if self.mask is not None:
            laid_over(self.mask.first, self.exemplar, "mask")
        self.require_seen(facts)

    def require_seen(self, facts: Facts) -> None:
        """Refuse an exemplar whose color space is not known."""
        color_to_convert(self.exemplar, facts, self.working_space)

    def read(self, resources: Resources, *also: np.ndarray | None) -> ExemplarPixels:
        """Values and usable pixels; each of `also` is a further mask of usable pixels, (height, width) bool."""
        with resources.stats.time("read and color"):
            values, opaque = self.seen(resources)
            allowed = functools.reduce(both, also, self._allowed())
        why = ["transparent pixels"] if opaque is not None or allowed is None else []
        why += [] if allowed is None else ["pixels outside the mask or label"]
        return ExemplarPixels(values, opaque, both(opaque, allowed), " and of ".join(why))

    def seen(self, resources: Resources) -> tuple[SomeRows, np.ndarray | None]:
        """Values of the exemplar, and its opaque pixels."""
        return working_values(self.exemplar, resources, self.working_space, self.holds_photo(resources))

    def holds_photo(self, facts: Facts) -> bool:
        """Whether the photo's values are held in memory instead of a file."""
        return True

    def holds(self, facts: Facts, size: int) -> bool:
        """Whether `size` bytes per pixel of the photo fit into a quarter of the budget."""
        spec = self.exemplar.first.spec
        return size * spec.width * spec.height <= facts.budget // 4

    def in_any_order(self, part: Part, held: bool) -> Part:
        """The part with random access to its pixels: decoded to a file if they are not held in memory."""
        return part if held or part.ready else materialized(part, 0)

    def _allowed(self) -> np.ndarray | None:
        """Source pixels that mask and label allow; None: all."""
        allowed = None if self.mask is None else masked_pixels(self.mask, self.exemplar)
        if self.label is not None:
            labels = label_map(self.exemplar, self.labellevel)
            allowed = both(labeled_pixels(labels, self.label), allowed)
        if allowed is not None and not allowed.any():
            raise ImageError(f"mask and label have no pixel of {self.exemplar.source} in common")
        return allowed

    def used_parts(self) -> tuple[Part, ...]:
        """Also labels, and maps of ids."""
        ids = (part for part in self.exemplar.parts if part.exact)
        return (*super().used_parts(), *ids, *(one.part for one in label_maps(self.exemplar).values()))


@dataclass(frozen=True, kw_only=True)
class ExemplarOp(LabeledExemplar):
    """An op that copies pixels of one photo, optionally of one label or of a mask."""

    mask: Image | None = image(None, help=MASK)  # type: ignore[misc]  # the base class has none
    label: int | None = param(None, example="3", ge=1, help=LABEL)  # type: ignore[misc]  # the base class has none

    def require_readable(self, facts: Facts) -> None:
        """Also refuses a level without a label."""
        if self.label is None and self.labellevel is not None:
            raise ParameterError("requires label", parameter="labellevel", value=self.labellevel)
        super().require_readable(facts)


@dataclass(frozen=True, kw_only=True)
class MaterialOp(ExemplarOp):
    """An op that copies pixels of one photo, or of the maps of one material."""

    exemplar: Image = image(help="Photo; of the maps of a material, the first.")
    maps: tuple[Image, ...] = image((), help="Further maps, resynthesized from the same source pixels.", count="kinds")
    kinds: Words | None = param(
        None, unset="one map: color; with data=1, data", help=KINDS_HELP, example="color,normal"
    )
    mapweights: Numbers | None = param(
        None, ge=0, unset="1 for each map, 0.25 for a height", help=MATCH_HELP, example="1,0.5,0", advanced=True
    )

    def require_seen(self, facts: Facts) -> None:
        """Refuse maps that do not belong together."""
        require_readable(self.all_maps(), self.kinds, self.mapweights, self.data, facts)

    def seen(self, resources: Resources) -> tuple[SomeRows, np.ndarray | None]:
        """Values of all maps of the material together."""
        held = self.holds_photo(resources)
        return read_material(self.all_maps(), self.kinds, self.mapweights, self.data, resources, held)

    def all_maps(self) -> tuple[Image, ...]:
        """The exemplar and the other maps."""
        return (self.exemplar, *self.maps)

    def result_count(self) -> int:
        """One image for each map of the material."""
        return 1 + len(self.maps)

    @property
    def map_kinds(self) -> list[str]:
        """The kind of each map; raises ParameterError if `kinds` does not match them."""
        return kinds_of(self.kinds, 1 + len(self.maps), self.data)

    def of_all(self, maps: Sequence[Part], make: Callable[[Part, str], dict[str, Any]]) -> tuple[dict[str, Any], ...]:
        """Results of `make(map, its kind)` for all maps; after the first map, only the op's image."""
        name, results = self.main().name, list[dict[str, Any]]()
        for one, kind in zip(maps, self.map_kinds, strict=True):
            parts = make(one, kind)
            image = parts[name] if kind == "color" else parts[name].respecced(mark_as_data)
            results.append({name: image} if results else parts | {name: image})
        return tuple(results)
