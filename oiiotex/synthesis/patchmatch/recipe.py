# SPDX-License-Identifier: Apache-2.0
"""The settings of a stationary texture synthesis, and the sizes of its pyramid levels."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ...analysis.regularity.courses import InCourses
from ...analysis.regularity.offset_prices import InStep
from ...engine.core.source_map import require_addressable
from ...engine.core.window import Domain
from ...engine.errors import ImageError
from .field import Geometry
from .patch_search import RANDOM

SCALE = 1.3  # ratio between pyramid levels (MJH17 section 4.2)
COARSEST = 40  # px: longer side of the exemplar on the coarsest level, where a patch spans a third of it
COARSEST_AMONG = 64  # px: the same if pixels around the result are fixed: a hole has fewer pixels than its photo
ROOM = 2  # minimum number of patches along the shorter side of exemplar and tile there
PAPER_PATCH = 11  # px: section 4
PAPER_COARSEST, PAPER_SHARE = 64, 0.25  # the paper: a quarter of the tile, its shorter side at least 64 px (4.2)


@dataclass(frozen=True, kw_only=True)
class Recipe(Domain):
    """The texture to synthesize, and its domain. Sizes are in px.

    Attributes
    ----------
    sigma : float or None
        Scale above which the result is stationary. None: plain PatchMatch, no projection.
    patch : int
        Side of a patch. Odd.
    iterations : int
        Number of iterations on the coarsest level.
    uniformity : float
        Weight of the spatial uniformity term, in units of the exemplar's variance.
    contrast : float
        Weight alpha of global histogram matching, 0 to 1.
    flat : bool
        Match to the projected exemplar with constant weight. Otherwise to the exemplar with a weight that fades to 0
        over the coarsest level, as in the paper.
    measure : str
        Statistics that define stationarity: histogram, moments or steerable (MJH17 section 3).
    order : int
        Highest order of moments, 2 to 4.
    complete : bool
        Limit the reuse of regions of the exemplar, and keep the result from being flatter than the exemplar.
    shifted : bool
        Start as the shifted exemplar if there are no constraints. Otherwise from small random blocks.
    in_step : InStep or InCourses or None
        The lattice, or the courses, of the exemplar that the result keeps.
    fine : int
        Number of iterations on each finer level: the coarsest decides the layout.
    literal : bool
        Use levels, iterations, projections and searches of the paper: start at a quarter of the tile, no overshoot,
        all search windows on all levels, and keep the residual of steerable filters.
    search : str
        How better matches are found: a name in `patch_search.SEARCHES`.
    """

    sigma: float | None
    patch: int
    iterations: int
    seed: int
    uniformity: float
    contrast: float
    flat: bool
    measure: str = "histogram"
    order: int = 2
    complete: bool = False
    shifted: bool = True
    in_step: InStep | InCourses | None = None
    literal: bool = False
    fine: int = 1
    search: str = RANDOM

    @property
    def scales(self) -> str:
        """Sigma, patch and histogram, formatted as modifiers."""
        sigma = "" if self.sigma is None else f"sigma={self.sigma:g}:"
        return f"{sigma}patch={self.patch}:histogram={self.contrast:g}"

    def alpha(self, iteration: int) -> float:
        """Weight of global histogram matching in an iteration, counted over all levels."""
        return self.contrast if self.flat else self.contrast * max(0.0, 1.0 - iteration / self.iterations)


def level_scales(recipe: Recipe, shape: tuple[int, ...]) -> list[float]:
    """Scales of the pyramid's levels, coarse to fine, about SCALE apart. The last is 1.

    The layout is decided where a patch spans a third of the photo, whatever its resolution, so a photo gives tiles of
    the same look at any size. At the paper's quarter of the tile (section 4.2), patches are smaller than the stones or
    boards of a photo of 1024 px, and these break.

    `shape` (height, width, ...).
    """
    if recipe.literal:
        coarsest = max(PAPER_SHARE, PAPER_COARSEST / min(recipe.size))
    else:
        side = COARSEST if recipe.complete else COARSEST_AMONG
        coarsest = max(side / max(shape[:2]), ROOM * recipe.patch / min(*recipe.size, *shape[:2]))
    coarsest = min(1.0, coarsest)
    steps = math.ceil(math.log(1.0 / coarsest) / math.log(SCALE) - 0.5)
    return [coarsest ** (1.0 - level / steps) for level in range(steps)] + [1.0]


def geometry_at(recipe: Recipe, shape: tuple[int, ...], scale: float) -> Geometry:
    """Sizes on one level for an exemplar of `shape` (height, width, channels)."""
    width, height, e_width, e_height = (
        max(1, round(n * scale)) for n in (recipe.width, recipe.height, shape[1], shape[0])
    )
    patch = recipe.patch
    require_addressable(shape)
    for role, size, full in (
        ("exemplar", (e_width, e_height), (shape[1], shape[0])),
        ("tile", (width, height), (recipe.width, recipe.height)),
    ):
        if min(size) < patch:
            coarse = "" if size == full else f", reduced to {size[0]}x{size[1]} on the coarsest level,"
            raise ImageError(f"the {role} of {full[0]}x{full[1]} px{coarse} is smaller than a patch of {patch}x{patch}")
    return Geometry(
        width, height, *recipe.wraps, exemplar_width=e_width, exemplar_height=e_height, patch=patch, channels=shape[2]
    )
