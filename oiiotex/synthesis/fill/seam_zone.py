# SPDX-License-Identifier: Apache-2.0
"""A zone around the region in which a minimum-error cut decides between kept and filled pixels (KSE03 section 3)."""

from __future__ import annotations

from ...engine.color.lab_grid import FINE_STEPS, to_grid
from ...engine.core.demand import SomeRows
from ...engine.core.source_map import SourceMap
from ...engine.core.window import Window
from ...engine.deferred import np
from .region import surroundings

_BYTES = 130  # for each pixel of the window
_FREE_BYTES = 450  # for each pixel that the cut decides on
_SOURCE_BYTES = 6  # for each pixel of the source


def grown(marked: np.ndarray, distance: int) -> np.ndarray:
    """The pixels within a distance of marked ones, (height, width) bool."""
    from scipy.ndimage import distance_transform_edt  # slow to import

    if distance == 0:
        return marked
    near = surroundings(marked, distance).inside(Window(0, 0, *marked.shape[::-1]))
    zone = marked.copy()
    zone[near] = distance_transform_edt(~marked[near]) <= distance
    return zone


def replaced_pixels(
    marked: np.ndarray, zone: np.ndarray, kept: np.ndarray, exemplar: SomeRows, source: SourceMap
) -> np.ndarray:
    """The pixels that show the fill: all marked ones, and those of the zone inside the minimum-error cut.

    Parameters
    ----------
    marked, zone : (height, width) bool
        Pixels to replace, and these with the zone around them.
    kept : (height, width, channels) float32
        The photo.
    exemplar : (rows, columns, channels) float32
        The photo that the fill is copied from, in the light of `kept`.
    source : SourceMap
        (height, width): its pixel at each place of the zone.

    Returns
    -------
    (height, width) bool
    """
    from ..graphcut.seams import SeamPhoto, crossing_costs, cut

    height, width = marked.shape
    rows, columns = height + exemplar.shape[0], max(width, exemplar.shape[1])
    both = np.zeros((rows, columns, 3), np.int16)  # one photo for seams: the kept one above the source
    both[:height, :width] = to_grid(kept[..., :3], FINE_STEPS)
    both[height:, : exemplar.shape[1]] = to_grid(exemplar[0 : exemplar.shape[0]][..., :3], FINE_STEPS)
    old = np.array(np.indices(marked.shape))
    new = np.stack(source.yx)
    new[0] += height
    return cut(crossing_costs(SeamPhoto(both), old, ~marked, new, zone), ~marked, zone)


def cut_bytes(area: int, free: int, source: int) -> int:
    """Memory of `replaced_pixels`, by pixels of the window, of its zone without marked ones, and of the source."""
    return _BYTES * area + _FREE_BYTES * free + _SOURCE_BYTES * source
