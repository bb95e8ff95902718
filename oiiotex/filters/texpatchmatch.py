# SPDX-License-Identifier: Apache-2.0
"""--texpatchmatch: the baseline of --texstationarize, MJH17."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ..core.parameters import param
from ..exemplar.patch_synthesis import PatchSynthesis
from ..patchmatch.recipe import Recipe


@dataclass(frozen=True, kw_only=True)
class PatchMatch(PatchSynthesis):
    """The photo synthesized anew by PatchMatch alone: the paper's baselines (MJH17 section 5.2).

    The same as `stationarize` without its projection. `tile=xy` is toroidal PatchMatch, `tile=none` the plain one.
    """

    example: ClassVar[str] = '>>> tile = filters.patchmatch("photo.png", seed=7)'
    name: ClassVar[str] = "patchmatch"

    contrast: float = param(
        1.0, ge=0, le=1, help="how strongly the histogram is held to the photo's at first; it fades out"
    )

    def recipe(self, width: int, height: int) -> Recipe:
        """MJH17 without stationarity."""
        return self._recipe(width, height, None, self.contrast, False)
