# SPDX-License-Identifier: Apache-2.0
"""Whether a photo shows a regular surface obliquely, and --texrectify would straighten it."""

from __future__ import annotations

from ...engine.core.demand import SomeRows, resized
from ...engine.deferred import np
from .slanted_lattice import is_sheared, largest_rectangle, slanted_lattice

OBLIQUE = 1.15  # ratio of scales from which a photo is oblique: photos from the front have at most 1.06
SEARCH_BYTES = 64 << 20  # at most, of `scale_ratio`
_SIDE = 256  # px; longer side of the photo in the search
_FEWEST = 2  # cells across and down


def scale_ratio(values: SomeRows, opaque: np.ndarray | None = None) -> float | None:
    """Largest over smallest scale within the rectangle that --texrectify finds in a photo; None if it finds none.

    The search is that of --texrectify, in the reduced photo. Without a lattice a gradient of sizes proves nothing:
    stones, drops and waves also get smaller without perspective.

    Parameters
    ----------
    values : (height, width, 3) float32
        CIE Lab.
    opaque : (height, width) bool or None
        Valid pixels; None: all.

    Returns
    -------
    float or None
        1 or more. The image of an element at x has the scale 1 + l x, where l gives the vanishing line.
    """
    height, width = values.shape[:2]
    factor = min(1.0, _SIDE / max(height, width))
    size = max(1, round(factor * width)), max(1, round(factor * height))
    seen = resized(values, *size)
    usable = None if opaque is None else resized(opaque[..., None].astype(np.float32), *size)[..., 0] > 0.5
    lattice = slanted_lattice(seen, usable)
    if lattice is None:
        return None
    corners, cells = largest_rectangle(lattice, size)
    if min(cells) < _FEWEST or is_sheared(seen, lattice, corners, cells):
        return None
    scales = 1.0 + (corners - lattice.middle) @ lattice.vanishing
    return float(scales.max() / scales.min())
