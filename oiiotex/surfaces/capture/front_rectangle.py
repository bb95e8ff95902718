# SPDX-License-Identifier: Apache-2.0
"""The rectangle that --texrectify straightens without corners: by the photo's lattice, otherwise by its texture."""

from __future__ import annotations

from dataclasses import dataclass

from ...engine.core.demand import SomeRows
from ...engine.deferred import np


@dataclass(frozen=True)
class FrontRectangle:
    """A rectangle of the surface."""

    corners: np.ndarray  # (4, 2) float64: top left, top right, bottom right, bottom left, px of the photo
    cells: tuple[int, int] | None = None  # of the lattice, across and down
    size: tuple[int, int] | None = None  # width, height, px; None with a lattice: the longer sides in the photo


def front_rectangle(values: SomeRows, opaque: np.ndarray | None = None) -> FrontRectangle | None:
    """The rectangle of a photo in perspective; None if neither a lattice nor the texture shows any.

    A lattice is exact, and complete cells tile. One whose joints would not meet at right angles is not used.

    Parameters
    ----------
    values : (height, width, 3 or more) float32
        CIE Lab.
    opaque : (height, width) bool or None
        Valid pixels; None: all.
    """
    from .plane_rectangle import plane_rectangle
    from .slanted_lattice import is_sheared, largest_rectangle, slanted_lattice
    from .textured_plane import textured_plane

    height, width = values.shape[:2]
    lattice = slanted_lattice(values, opaque)
    if lattice is not None:
        corners, cells = largest_rectangle(lattice, (width, height))
        if not is_sheared(values, lattice, corners, cells):
            return FrontRectangle(corners, cells)
    plane = textured_plane(values, opaque)
    if plane is None:
        return None
    corners, size = plane_rectangle(values, plane.vanishing, opaque)
    return FrontRectangle(corners, size=size)
