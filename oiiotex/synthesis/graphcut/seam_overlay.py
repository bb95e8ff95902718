# SPDX-License-Identifier: Apache-2.0
"""A texture composited over another by a mask, cut in a band around the mask's border (KSE03 §3).

The cut is made tile by tile: on the borders of tiles the mask itself decides, so neighboring tiles always agree.
A pixel depends on the mask and both textures within its tile and a band around it only.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ...engine.core.demand import assembled
from ...engine.core.piece_cache import PieceCache
from ...engine.core.source_map import SourceMap
from ...engine.core.window import Window
from ...engine.deferred import np
from .seams import SeamPhoto, crossing_costs, cut

if TYPE_CHECKING:
    from ...engine.core.scratch import TileStore

TILE = 128  # px


@dataclass(frozen=True, eq=False)  # cached pieces are compared by identity
class SeamOverlay:
    """Two textures from one exemplar.

    Attributes
    ----------
    lab : (h, w, 3) int16 or TileStore
        The exemplar in grid steps.
    below : callable
        Window -> sources of its pixels.
    above : callable
        Window -> (mask of where it is visible, sources).
    band : int
        Maximum distance of the cut from the mask's border, px.
    """

    lab: np.ndarray | TileStore
    below: Callable[[Window], SourceMap]
    above: Callable[[Window], tuple[np.ndarray, SourceMap]]
    whole: Window
    band: int

    def sources(self, window: Window, cache: PieceCache) -> SourceMap:
        """Sources of the pixels of a window."""

        def tile(place: Window) -> np.ndarray:
            return cache.get((self, place), lambda: self._tile(place).packed[..., None])

        return SourceMap(assembled(window, (TILE, TILE), self.whole, tile)[..., 0])

    def _tile(self, place: Window) -> SourceMap:
        from scipy.ndimage import distance_transform_cdt  # slow to import

        around = place.grown(self.band) & self.whole
        mask = self.above(around)[0]
        inside = place.inside(around)
        below, (seen, above) = self.below(place), self.above(place)
        if not seen.any() and not mask.any():
            return below
        # distances to the other side of the mask; inf if there is none
        far = self.band + 1
        near = np.minimum(
            distance_transform_cdt(mask) if not mask.all() else np.full(mask.shape, far),
            self.band + 1,
        ) + np.minimum(distance_transform_cdt(~mask) if mask.any() else np.full(mask.shape, far), self.band + 1)
        free = near[inside] <= self.band
        free[[0, -1]] = free[:, [0, -1]] = False
        if not free.any():
            return SourceMap(np.where(seen, above.packed, below.packed))
        old, new = (np.stack(source.yx) for source in (below, above))
        filled, covers = ~seen | free, seen | free
        taken = cut(crossing_costs(SeamPhoto(self.lab), old, filled, new, covers), filled, covers)
        return SourceMap(np.where(taken, above.packed, below.packed))
