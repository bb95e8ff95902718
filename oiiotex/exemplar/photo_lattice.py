# SPDX-License-Identifier: Apache-2.0
"""What synthesis does about a photo's lattice: finds it, says so, and chooses a size on which it closes."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass

from ..core.demand import SomeRows, first_channels
from ..core.op import Op
from ..core.parameters import Size, param
from ..core.window import Domain
from ..deferred import np
from ..patchmatch.field import hash_at
from ..regularity.courses import Courses, find_courses
from ..regularity.lattice import RANGE, STRETCHED, Lattice, find_lattice
from ..regularity.lattice import bytes_needed as lattice_bytes
from ..regularity.offset_prices import InStep
from ..session.resources import Resources

log = logging.getLogger("oiiotex")

STRUCTURE = (
    "strength with which regular repeats of the photo (tiles, courses, weaves) are kept; 0: not at all. Where the"
    " photo's size would stretch them visibly, the default size is the nearest that holds complete repeats only. No"
    " effect on a photo without regular repeats"
)


def photo_lattice(flag: str, lab: SomeRows, usable: np.ndarray | None) -> Lattice | None:
    """The photo's lattice by its usable pixels, logged for op `flag`; None where it has none."""
    lattice = find_lattice(lab, usable)
    if lattice is None:
        log.info("%s: nothing repeats in the photo at equal distances", flag)
    else:
        log.info("%s: the photo has %s (%.1f deviations above chance)", flag, lattice, lattice.order)
    return lattice


def photo_courses(flag: str, lab: SomeRows, usable: np.ndarray | None) -> Courses | None:
    """The same of courses of unequal height, of a photo that has no lattice."""
    courses = find_courses(lab, usable)
    if courses is not None:
        log.info("%s: the photo has courses: %s", flag, courses)
    return courses


def least_size(size: Size, wraps: tuple[bool, bool]) -> Size:
    """The smallest that `fitting_size` may make of a photo's size, whatever its lattice."""
    return Size(*(math.ceil(n * (1 - RANGE)) if along else n for n, along in zip(size, wraps, strict=True)))


def fitting_size(
    flag: str, lattice: Lattice | None, size: Size, given: bool, wraps: tuple[bool, bool], multiple: int = 1
) -> Size:
    """The size of a tile on which the photo's lattice closes; where a size is given, that, with a warning.

    The tile is a torus along x, along y as `wraps` says; sides are multiples of `multiple`.
    """
    if lattice is None:
        return size
    fits = Size(*lattice.fitting(Domain(*size, *wraps), multiple))
    if not given:
        if fits != size:
            log.info("%s: the tile is %s px, on which the lattice closes; the photo is %s", flag, fits, size)
        return fits
    strain, least = (lattice.strain(Domain(*s, *wraps)) for s in (size, fits))
    if strain > max(STRETCHED, 2 * least):
        log.warning(
            "%s: %s px stretch %s by %.1f %% to close; the nearest that fit are %s px (%.1f %%)",
            flag, size, lattice, 100 * strain, fits, 100 * least,
        )  # fmt: skip
    return size


@dataclass(frozen=True, kw_only=True)
class Structured(Op):
    """What keeps the lattice of its photo."""

    structure: float = param(0.5, ge=0, le=1, help=STRUCTURE)

    def lattice_of(self, lab: SomeRows, usable: np.ndarray | None, resources: Resources) -> Lattice | None:
        """The photo's lattice; None where it has none, or shall not be kept."""
        if self.structure == 0:
            return None
        self.require_lattice(lab.shape[0], lab.shape[1], resources)
        with resources.stats.time("lattice"):
            return photo_lattice(self.flag(), first_channels(lab, 3), usable)

    def require_lattice(self, height: int, width: int, resources: Resources, held: int = 0) -> None:
        """Refuse a photo whose lattice cannot be looked for within the budget; `held`: bytes that lie beside it."""
        if self.structure > 0:
            need = lattice_bytes(height, width) + held
            resources.require(need, f"finding the lattice of {width}x{height}", "say structure=0")

    def in_step(self, lattice: Lattice | None, domain: Domain, seed: int | None = None) -> InStep | None:
        """What a result on that domain keeps of it; where cells begin follows from the seed, where there is one.

        Else the photo itself, laid as it is, is in step, and where patches are compared the best of all results.
        """
        if lattice is None:
            return None
        kept = InStep(lattice, lattice.on_torus(domain), self.structure)
        if seed is None:
            return kept
        x, y = (hash_at(seed, 0x1A77, np.array([0, 1]), np.array([0, 0])) >> 18).tolist()
        return kept.moved(x, y)
