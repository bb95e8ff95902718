# SPDX-License-Identifier: Apache-2.0
"""What a stationary texture is asked to be, and the sizes of its pyramid's levels."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..core.source_map import require_addressable
from ..core.window import Domain
from ..errors import ImageError
from ..regularity.offset_prices import InStep
from .field import Geometry

SCALE = 1.3  # between pyramid levels (MJH17 section 4.2)
COARSEST = 64  # px: the top level is a quarter of the tile, but its shorter side not less than this (section 4.2)


@dataclass(frozen=True, kw_only=True)
class Recipe(Domain):
    """What to synthesize, on which domain; sizes in px.

    Attributes
    ----------
    sigma : float or None
        Scale above which it must look the same everywhere; None: plain PatchMatch, no projection.
    patch : int
        Side of a patch, odd.
    iterations : int
        On the coarsest level.
    seed : int
    uniformity : float
        Weight of the spatial uniformity term, in units of the exemplar's variance.
    contrast : float
        Weight alpha of global histogram matching, 0 to 1.
    flat : bool
        Match to the projected exemplar with constant weight; else to the exemplar with a weight that fades to 0 over
        the coarsest level, as in the paper.
    coarsest : float
        Scale of the coarsest level at least; the paper's 1/4.
    measure : str
        What must look the same everywhere: histogram, moments or steerable (MJH17 section 3).
    order : int
        Moments up to this one, 2 to 4.
    complete : bool
        No region of the exemplar is shown too often, and the result is no flatter than the exemplar.
    in_step : InStep or None
        The lattice of the exemplar that the result keeps.
    literal : bool
        Projections and searches are the paper's: no overshoot, all windows on all levels, and of steerable responses
        what no filter sees stays as it is.
    """

    sigma: float | None
    patch: int
    iterations: int
    seed: int
    uniformity: float
    contrast: float
    flat: bool
    coarsest: float = 0.25
    measure: str = "histogram"
    order: int = 2
    complete: bool = False
    in_step: InStep | None = None
    literal: bool = False

    def alpha(self, iteration: int) -> float:
        """Weight of global histogram matching in an iteration, counted over all levels."""
        return self.contrast if self.flat else self.contrast * max(0.0, 1.0 - iteration / self.iterations)


def level_scales(width: int, height: int, least: float = 0.25) -> list[float]:
    """Scales of the pyramid levels relative to the tile, coarse to fine, about SCALE apart; the last is 1."""
    coarsest = min(1.0, max(least, COARSEST / min(width, height)))
    steps = math.ceil(math.log(1.0 / coarsest) / math.log(SCALE) - 0.5)
    return [coarsest ** (1.0 - level / steps) for level in range(steps)] + [1.0]


def geometry_at(recipe: Recipe, shape: tuple[int, ...], scale: float) -> Geometry:
    """Sizes at one level for an exemplar of `shape` (height, width, channels).

    Raises
    ------
    ImageError
        Exemplar or tile are smaller than a patch there.
    """
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
            coarse = "" if size == full else f" is {size[0]}x{size[1]} on the coarsest level, which"
            raise ImageError(f"the {role} of {full[0]}x{full[1]} px{coarse} is smaller than a patch of {patch}x{patch}")
    return Geometry(
        width, height, *recipe.wraps, exemplar_width=e_width, exemplar_height=e_height, patch=patch, channels=shape[2]
    )
