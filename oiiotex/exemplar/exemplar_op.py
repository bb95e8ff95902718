# SPDX-License-Identifier: Apache-2.0
"""The exemplar of an op that synthesizes: declared once, read once, into values and the pixels that may be taken."""

from __future__ import annotations

import functools
import logging
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, TypeVar

from ..color.lab import working_values
from ..core.demand import SomeRows, first_channels
from ..core.image import Image
from ..core.label_map import label_maps
from ..core.op import Op, Space
from ..core.parameters import image, param
from ..core.source_map import STMAP
from ..deferred import np
from ..errors import ImageError, ParameterError
from ..io.disk_cache import hash_of
from ..session.resources import Resources
from .exemplar_masks import both, label_map, labelled_pixels, masked_pixels

Found = TypeVar("Found")

log = logging.getLogger("oiiotex")

EXEMPLAR = "the photo; where labels are spoken of, with label maps as --texlabel:keep=1 makes them"
MASK = "where pixels may come from: above one half of the first channel's range; of ids: all but 0"
LABELS = "label maps of the exemplar, where they are not parts of it"
LABEL = "take only pixels of that label, by its id"
LEVEL = "which label map: label.N of the exemplar or of labels; the coarsest when left out"


@dataclass(frozen=True, eq=False)
class ExemplarPixels:
    """What is seen of an exemplar.

    Attributes
    ----------
    values : (height, width, channels) float32
        Lab, or data scaled to 0 .. 100; further channels are those of further maps. Rows of a `PatchSynthesis` may lie
        in a file, all others are an array.
    opaque : (height, width) bool or None
        Where it shows something; None: everywhere.
    usable : (height, width) bool or None
        Where pixels may be taken from; None: everywhere.
    why : str
        What the pixels are that may not be taken, for messages.
    """

    values: SomeRows
    opaque: np.ndarray | None
    usable: np.ndarray | None
    why: str

    def remembered(self, resources: Resources, find: Callable[..., Found], flag: str, *more: object) -> Found:
        """What `find(flag, lab, usable, *more)` finds in the photo, or found when these pixels were last looked at."""
        usable = None if self.usable is None else hash_of(self.usable)
        return resources.remembered(
            (find, id(self.values), usable),
            lambda: find(flag, first_channels(self.values, 3), self.usable, *more),
            self.values,
        )


@dataclass(frozen=True, kw_only=True)
class LabelledExemplar(Op):
    """What is copied together from one photo, of which label maps may be known."""

    copies: ClassVar[bool] = True
    space: ClassVar[Space] = Space.LAB

    exemplar: Image = image(help=EXEMPLAR)
    mask: ClassVar[Image | None] = None  # as an `ExemplarOp` takes it
    labels: Image | None = image(None, help=LABELS)
    label: ClassVar[int | None] = None
    level: int | None = param(None, ge=1, help=LEVEL)
    data: bool = param(False, help="the channels are no colours: compare them as they are")
    seed: int = param(0, ge=0, le=2**32 - 1, help="same seed, same pixels")
    stmap: bool | Path = param(False, help=STMAP)

    def read(self, resources: Resources, *also: np.ndarray | None) -> ExemplarPixels:
        """Values, usable pixels, and why the others are not; `also` are further (height, width) bool of usable ones.

        Raises
        ------
        ImageError
            The mask or the label map is of another size than the exemplar, or nothing is left; NaN or Inf.
        ColorError
            As by `lens_of`.
        ParameterError
            There is no such level or label.
        """
        with resources.stats.time("read and colour"):
            values, opaque = self.seen(resources)
            allowed = functools.reduce(both, also, self._allowed())
        why = ["transparent pixels"] if opaque is not None or allowed is None else []
        why += [] if allowed is None else ["pixels outside the mask or label"]
        return ExemplarPixels(values, opaque, both(opaque, allowed), " and of ".join(why))

    def seen(self, resources: Resources) -> tuple[SomeRows, np.ndarray | None]:
        """Values of the exemplar, and where it is opaque."""
        return working_values(self.exemplar, resources, self.working_space)

    def _allowed(self) -> np.ndarray | None:
        """Where mask and label let pixels be taken from; None: everywhere."""
        allowed = None if self.mask is None else masked_pixels(self.mask, self.exemplar)
        if self.label is not None:
            labels = label_map(self.exemplar, self.labels, self.level)
            allowed = both(labelled_pixels(labels, self.label), allowed)
        if allowed is not None and not allowed.any():
            raise ImageError(f"the mask leaves no pixel of {self.exemplar.source}")
        return allowed

    def say_what_stays(self) -> None:
        """Warn, in one line, of parts that do not come along; labels, masks and maps of ids are no loss."""
        used = {id(part) for slot, image in self.given() if not slot.required for part in image.parts}
        used |= {id(one.part) for one in label_maps(self.exemplar).values()}
        lost = [part.name for part in self.exemplar.parts[1:] if not (part.exact or id(part) in used)]
        if lost:
            log.warning(
                "%s: of %s only the first part is used, not %s", self.flag(), self.exemplar.source, ", ".join(lost)
            )


@dataclass(frozen=True, kw_only=True)
class ExemplarOp(LabelledExemplar):
    """What is copied together from one photo, or from one label in it."""

    mask: Image | None = image(None, help=MASK)  # type: ignore[misc]  # the base class has none
    label: int | None = param(None, ge=1, help=LABEL)  # type: ignore[misc]  # the base class has none

    def _allowed(self) -> np.ndarray | None:
        if self.label is None and (self.level is not None or self.labels is not None):
            raise ParameterError("level and labels say where label is looked up: say label, too")
        return super()._allowed()
