# SPDX-License-Identifier: Apache-2.0
"""--texpatchmatch: the baseline of --texstationarize (MJH17)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

from ..engine.core.image import Image
from ..engine.core.op import Plan
from ..engine.core.parameters import Numbers, Words, param
from ..engine.session import Session
from ..synthesis.exemplar.patch_synthesis import PATCH, PatchSynthesis
from ..synthesis.patchmatch.recipe import PAPER_PATCH, Recipe


@dataclass(frozen=True, kw_only=True)
class PatchMatch(PatchSynthesis):
    """Resynthesize a photo by PatchMatch alone, for comparison: the baseline of MJH17 (section 5.2).

    This is `stationarize` without flattening and without evening out local statistics: use it to see what these
    add. `tiles=xy` is the paper's toroidal PatchMatch, `tiles=none` its plain PatchMatch (MJH17: Moritz, James,
    Haines, Ritschel, Weyrich, Texture Stationarization, Eurographics 2017).
    """

    example: ClassVar[str] = '>>> tile = filters.patchmatch("photo.png", seed=7)'
    name: ClassVar[str] = "patchmatch"

    maps: ClassVar[tuple[Image, ...]] = ()  # type: ignore[misc]  # the baseline has one, of any pixels
    kinds: ClassVar[Words | None] = None  # type: ignore[misc]
    mapweights: ClassVar[Numbers | None] = None  # type: ignore[misc]
    label: ClassVar[int | None] = None  # type: ignore[misc]
    labellevel: ClassVar[int | None] = None  # type: ignore[misc]

    paper: bool = param(
        False,
        advanced=True,
        help="Settings of the paper (MJH17), for comparison: patch=11, and the paper's pyramid and iterations.",
    )

    @property
    def side(self) -> int:
        """Side of a patch, px."""
        return self.patch or (PAPER_PATCH if self.paper else PATCH)

    def make(self, plan: Plan, session: Session) -> dict[str, Any] | tuple[dict[str, Any], ...]:
        """The tile and its source coordinates, as one mapping for each map and variant."""
        from ..synthesis.exemplar.synthesis_run import synthesized  # not needed for help

        return synthesized(plan.work, session.resources, session.progress)

    def recipe(self, width: int, height: int) -> Recipe:
        """MJH17 without the stationarity projection; the photo's histogram is matched at first."""
        return replace(self._recipe(width, height, None, 1.0, False), literal=self.paper)
