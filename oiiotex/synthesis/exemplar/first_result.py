# SPDX-License-Identifier: Apache-2.0
"""Check the first result against its photo: try other ways to make the tile, or warn."""

from __future__ import annotations

import functools
import logging
import math
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

from ...engine.color.config import as_float
from ...engine.core.demand import MadeRows, SomeRows, resized, rows_of
from ...engine.core.image import Part, channels_of
from ...engine.core.source_map import SourceMap
from ...engine.deferred import np
from ..patchmatch.constraints import coarse_mask
from ..patchmatch.optimization import LevelLook, Synthesis
from ..patchmatch.recipe import Recipe
from ..patchmatch.use_prices import SLACK
from ..quality.fidelity import FAIR, Fidelity, JudgedPhoto
from ..quality.judged_tries import Dismissed
from ..quality.seam_measures import seam_ratio

if TYPE_CHECKING:
    from ...analysis.drift.correction import Correction
    from ...engine.session.progress import Onlooker

log = logging.getLogger("oiiotex")

TILES = 1.15  # seam ratio up to which a photo already tiles
ONE_TILE = "The photo may have too few elements for a texture, or more than one texture; crop it"
SET_OF_TILES = "Tiles must be several times larger than the photo's elements"
_GLANCED = 0.45  # of the photo: a level that is as large tells whether the others are worth making
PLAINER = 0.1  # share of the photo's texture that a crop of it may lose
_DOUBT = 0.02  # by which a finished tile may be better than its coarse level
_LEAST = 48  # px; shorter sides are not tested for tiling


class FirstTile(NamedTuple):
    """A tile, the recipe of its size and scales, the correction that evens its seams, and whether it was bent."""

    synthesis: Synthesis
    recipe: Recipe
    evening: Correction | None = None
    is_bent: bool = False


def fidelity_of(
    photo: JudgedPhoto, source: SourceMap, recipe: Recipe, shown: SomeRows | None = None
) -> Fidelity | None:
    """Fidelity of a result that is copied from the photo, or from `shown`; None if it is too small to measure."""
    lab = photo.lab if shown is None else shown

    def rows(first: int, last: int) -> np.ndarray:
        return source[first:last].gather(lab)

    result = MadeRows((*source.packed.shape, 3), np.float32, rows)
    return photo.fidelity(result, (recipe.wrap_y, recipe.wrap_x), source)


def coarse_photo(photo: JudgedPhoto, width: int, height: int) -> JudgedPhoto:
    """The photo reduced to the size of a level."""
    original = None if photo.original is None else resized(photo.original, width, height)
    return JudgedPhoto(resized(photo.lab, width, height), coarse_mask(photo.usable, width, height), original)


def coarse_looks(photo: Part, look: Onlooker | None) -> LevelLook | None:
    """A callback that shows coarse levels, copied from the photo reduced to their size; None without an onlooker."""
    if look is None:
        return None
    rows = rows_of(photo)
    values = MadeRows(rows.shape, np.float32, lambda first, last: as_float(rows[first:last]))
    reduced = functools.lru_cache(1)(functools.partial(resized, values))
    return lambda pick, size: look(pick().gather(reduced(*size)), False)


def glance(coarse: Callable[[int, int], JudgedPhoto], width: int, recipe: Recipe, least: float) -> LevelLook:
    """A look at the levels of a synthesis that raises `Dismissed` if its fidelity will not exceed `least`.

    It measures the first level that is large enough. `coarse`: the photo reduced to a width and height; `width`: the
    photo's.
    """
    is_measured = False

    def look(pick: Callable[[], SourceMap], size: tuple[int, int]) -> None:
        nonlocal is_measured
        if is_measured or not _GLANCED * width <= size[0] < width:
            return
        is_measured = True
        kept = fidelity_of(coarse(*size), pick(), recipe)
        if kept is not None and kept.value + _DOUBT <= least:
            raise Dismissed(f"{kept} before it is finished")

    return look


def textured(synthesis: Synthesis, most: float = SLACK) -> Synthesis:
    """The same synthesis. Raises `Dismissed` if it loses more than this share of the photo's texture."""
    if synthesis.lost is not None and synthesis.lost.share > most:
        raise Dismissed(f"{100 * synthesis.lost.share:.0f} % of the texture is lost")
    return synthesis


def say_fidelity(flag: str, kept: Fidelity | None, spelled: str, warn: bool, advice: str = ONE_TILE) -> None:
    """Log the chosen modifiers; with `warn`, warn if the result is poor, with that advice."""
    if kept is None:
        return
    log.info("%s: scales chosen: %s", flag, spelled)
    if warn and kept.value < FAIR:
        log.warning("%s: %s. %s", flag, kept, advice)


def hint_that_it_tiles(flag: str, photo: Part) -> None:
    """Warn if a photo already tiles."""
    if min(photo.window.size) < _LEAST:
        return
    gray = as_float(photo.pixels()[..., list(channels_of(photo.spec).color)]).mean(-1)
    ratios = [seam_ratio(gray, axis) for axis in (1, 0)]
    if max(ratios) <= TILES and all(map(math.isfinite, ratios)):
        log.warning(
            "%s: the photo already tiles (seam ratio %.2f along x, %.2f along y); to keep its layout, use"
            " --texflatten:tiled=xy instead",
            flag, *ratios,
        )  # fmt: skip
