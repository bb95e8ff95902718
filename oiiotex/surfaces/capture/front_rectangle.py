# SPDX-License-Identifier: Apache-2.0
"""The rectangle that --texrectify straightens without corners: by the photo's lattice, otherwise by its texture."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ...engine.core.demand import SomeRows, at_most
from ...engine.deferred import np
from .plane_rectangle import plane_rectangle
from .slanted_lattice import is_sheared, largest_rectangle, slanted_lattice
from .textured_plane import TexturedPlane, textured_plane

if TYPE_CHECKING:
    import OpenImageIO as oiio

SIDE = 1024  # px; longer side of the photo in the search
_BYTES = 120  # for each pixel in the search
_OPAQUE = 0.99  # least alpha of a valid pixel


@dataclass(frozen=True)
class FrontRectangle:
    """A rectangle of the surface."""

    corners: np.ndarray  # (4, 2) float64: top left, top right, bottom right, bottom left, px of the photo
    cells: tuple[int, int] | None = None  # of the lattice, across and down
    size: tuple[int, int] | None = None  # width, height, px; None with a lattice: the longer sides in the photo
    plane: TexturedPlane | None = None  # by the texture, in px of the photo in the search; None if it shows none

    def in_display(self, spec: oiio.ImageSpec) -> np.ndarray:
        """Corners as `corners=` has them: relative to the display window, with two decimals."""
        return np.round(self.corners + np.array([spec.x - spec.full_x, spec.y - spec.full_y]), 2) + 0.0


def search_bytes(width: int, height: int) -> int:
    """Memory that the search in a photo of that size requires."""
    return width * height + _BYTES * min(width * height, SIDE * SIDE)


def front_rectangle(
    values: SomeRows, opaque: np.ndarray | None = None, *, oblique: bool = False
) -> FrontRectangle | None:
    """The rectangle of a photo in perspective; None if neither a lattice nor the texture shows any.

    A lattice is exact, and complete cells tile. One whose joints would not meet at right angles is not used.

    Parameters
    ----------
    values : (height, width, 3) float32
        CIE Lab.
    opaque : (height, width) bool or None
        Valid pixels; None: all.
    oblique : bool
        None as well if the texture shows no perspective, which takes a tenth of a second; a lattice takes four.
    """
    photo, seen = np.array(values.shape[1::-1]), None
    (small,) = at_most(SIDE, values)
    size = small.shape[1], small.shape[0]
    if opaque is not None:
        seen = at_most(SIDE, opaque[..., None].astype(np.float32))[0][..., 0] > _OPAQUE
    plane = textured_plane(small, seen)
    if oblique and plane is None:
        return None
    lattice = slanted_lattice(small, seen)
    if lattice is not None:
        corners, cells = largest_rectangle(lattice, size)
        if not is_sheared(small, lattice, corners, cells):
            return FrontRectangle(corners * photo / size, cells, plane=plane)
    if plane is None:
        return None
    corners, found = plane_rectangle(small, plane.vanishing, seen)
    width, height = (round(n * float(p) / s) for n, p, s in zip(found, photo, size, strict=True))
    return FrontRectangle(corners * photo / size, size=(width, height), plane=plane)
