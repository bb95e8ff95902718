# SPDX-License-Identifier: Apache-2.0
"""The photo's lattice in a synthesis: find it, log it, and choose a size on which it closes."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass

from ...analysis.regularity.courses import Courses, InCourses, find_courses
from ...analysis.regularity.lattice import RANGE, STRETCHED, HighPass, Lattice, find_lattice, high_pass_of
from ...analysis.regularity.lattice import bytes_needed as lattice_bytes
from ...analysis.regularity.offset_prices import InStep
from ...engine.core.demand import SomeRows, first_channels
from ...engine.core.op import Op
from ...engine.core.parameters import Size, param
from ...engine.core.window import Domain
from ...engine.deferred import np
from ...engine.session.facts import Facts
from ...engine.session.resources import Resources
from ..patchmatch.field import hash_at
from .exemplar_op import ExemplarPixels

log = logging.getLogger("oiiotex")

STRUCTURE = (
    "Strength with which regular repeats (tiles, courses, weaves) are preserved. If the photo's size does not hold"
    " complete repeats, the result gets the nearest size that does, unless size is set. 0: repeats are not preserved."
    " No effect on photos without regular repeats."
)


def photo_lattice(flag: str, lab: SomeRows, usable: np.ndarray | None, seen: HighPass | None = None) -> Lattice | None:
    """The lattice of the photo's usable pixels, logged for op `flag`; None if there is none."""
    lattice = find_lattice(lab, usable, seen=seen)
    if lattice is None:
        log.info("%s: the photo has no regular repeats", flag)
    else:
        log.info("%s: the photo has %s (%.1f standard deviations above chance)", flag, lattice, lattice.order)
    return lattice


def photo_structure(flag: str, lab: SomeRows, usable: np.ndarray | None) -> Lattice | Courses | None:
    """The photo's lattice, else its courses of unequal height, logged for op `flag`; None if there are none."""
    seen = high_pass_of(lab, usable)
    lattice = photo_lattice(flag, lab, usable, seen)
    if lattice is not None or seen is None:
        return lattice
    courses = find_courses(lab, usable, seen)
    if courses is not None:
        log.info("%s: the photo has courses: %s", flag, courses)
    return courses


def least_size(size: Size, wraps: tuple[bool, bool]) -> Size:
    """The smallest size that `fitting_size` can return for a photo of this size."""
    return Size(*(math.ceil(n * (1 - RANGE)) if along else n for n, along in zip(size, wraps, strict=True)))


def fitting_size(
    flag: str, lattice: Lattice | Courses | None, size: Size, given: bool, wraps: tuple[bool, bool], multiple: int = 1
) -> Size:
    """The size of a tile on which the photo's lattice closes; a given size is kept, with a warning.

    `wraps` says whether the tile wraps along x and along y; sides are multiples of `multiple`.
    """
    if not isinstance(lattice, Lattice):
        return size
    fits = Size(*lattice.fitting(Domain(*size, *wraps), multiple))
    if not given:
        if fits != size:
            log.info("%s: size %s px, on which the lattice closes (photo: %s)", flag, fits, size)
        return fits
    strain, least = (lattice.strain(Domain(*s, *wraps)) for s in (size, fits))
    if strain > max(STRETCHED, 2 * least):
        log.warning(
            "%s: size %s px stretches %s by %.1f %%; the nearest size that fits is %s px (%.1f %%)",
            flag, size, lattice, 100 * strain, fits, 100 * least,
        )  # fmt: skip
    return size


@dataclass(frozen=True, kw_only=True)
class Structured(Op):
    """An op that preserves the lattice of its photo."""

    lattice: float = param(0.5, ge=0, le=1, help=STRUCTURE)

    def lattice_of(self, lab: SomeRows, usable: np.ndarray | None, resources: Resources) -> Lattice | None:
        """The photo's lattice; None if it has none, or with lattice=0."""
        if self.lattice == 0:
            return None
        self.require_lattice(lab.shape[0], lab.shape[1], resources)
        with resources.stats.time("lattice"):
            return photo_lattice(self.flag(), first_channels(lab, 3), usable)

    def structure_of(self, pixels: ExemplarPixels, resources: Resources) -> Lattice | Courses | None:
        """The photo's lattice or courses; None if it has none, or with lattice=0."""
        if self.lattice == 0:
            return None
        self.require_lattice(pixels.values.shape[0], pixels.values.shape[1], resources)
        with resources.stats.time("lattice"):
            return pixels.remembered(resources, photo_structure, self.flag())

    def require_lattice(self, height: int, width: int, facts: Facts, held: int = 0) -> None:
        """Refuse a photo whose lattice cannot be found within the budget; `held`: bytes in use at the same time."""
        if self.lattice > 0:
            need = lattice_bytes(height, width) + held
            facts.require(need, f"finding the lattice of {width}x{height}", "set lattice=0")

    def kept_structure(
        self, structure: Lattice | Courses | None, domain: Domain, seed: int | None = None
    ) -> InStep | InCourses | None:
        """As `in_step`, also for courses, which begin as in the photo because they are in order."""
        if isinstance(structure, Courses):
            return InCourses.of(structure, domain, self.lattice)
        return self.in_step(structure, domain, seed)

    def in_step(self, lattice: Lattice | None, domain: Domain, seed: int | None = None) -> InStep | None:
        """How a result on that domain follows the lattice; a seed determines where its cells begin.

        Without a seed, the photo in its own place is in step, and always the best match in comparisons of patches.
        """
        if lattice is None:
            return None
        kept = InStep(lattice, lattice.on_torus(domain), self.lattice)
        if seed is None:
            return kept
        x, y = (hash_at(seed, 0x1A77, np.array([0, 1]), np.array([0, 0])) >> 18).tolist()
        return kept.moved(x, y)
