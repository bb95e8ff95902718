# SPDX-License-Identifier: Apache-2.0
"""Check the first result against its photo: try other ways to make the tile, or warn."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ...engine.color.config import as_float
from ...engine.core.demand import MadeRows, resized
from ...engine.core.image import Part, channels_of
from ...engine.core.source_map import SourceMap
from ...engine.deferred import np
from ...engine.errors import ImageError, present
from ...engine.stats import Stats
from ..patchmatch.constraints import coarse_mask
from ..patchmatch.optimization import LevelLook, Synthesis
from ..patchmatch.recipe import Recipe
from ..patchmatch.use_prices import SLACK
from ..quality.fidelity import FAIR, GOOD, Fidelity, JudgedPhoto
from ..quality.seam_measures import seam_ratio

if TYPE_CHECKING:
    from ...engine.session.progress import Progress

log = logging.getLogger("oiiotex")

TILES = 1.15  # seam ratio up to which a photo already tiles
ONE_TILE = "The photo may have too few elements for a texture, or more than one texture; crop it"
SET_OF_TILES = "Tiles must be several times larger than the photo's elements"
_GLANCED = 0.45  # of the photo: a level that is as large tells whether the others are worth making
_DOUBT = 0.02  # by which a finished tile may be better than its coarse level, or with its holes
_LEAST = 48  # px; shorter sides are not tested for tiling


def fidelity_of(photo: JudgedPhoto, source: SourceMap, recipe: Recipe) -> Fidelity | None:
    """Fidelity of a result that is copied from the photo; None if it is too small to measure."""

    def rows(first: int, last: int) -> np.ndarray:
        return source[first:last].gather(photo.lab)

    result = MadeRows((*source.packed.shape, 3), np.float32, rows)
    return photo.fidelity(result, (recipe.wrap_y, recipe.wrap_x), source)


class Dismissed(Exception):
    """A tile is not finished, since what there is of it is worse than the best tile so far."""


def dismiss_below(least: float, photo: JudgedPhoto, source: SourceMap, recipe: Recipe) -> None:
    """Raise `Dismissed` if the fidelity of a tile that is not finished will not exceed `least`."""
    kept = fidelity_of(photo, source, recipe)
    if kept is not None and kept.value + _DOUBT <= least:
        raise Dismissed(f"{kept} before it is finished")


def glance(photo: JudgedPhoto, recipe: Recipe, least: float) -> LevelLook:
    """A look at the levels of a synthesis: `dismiss_below` on the first one that is large enough."""
    is_measured = False

    def look(pick: Callable[[], SourceMap], size: tuple[int, int]) -> None:
        nonlocal is_measured
        width = photo.lab.shape[1]
        if is_measured or not _GLANCED * width <= size[0] < width:
            return
        is_measured = True
        original = None if photo.original is None else resized(photo.original, *size)
        coarse = JudgedPhoto(resized(photo.lab, *size), coarse_mask(photo.usable, *size), original)
        dismiss_below(least, coarse, pick(), recipe)

    return look


@dataclass(frozen=True)
class Try:
    """One way to make the tile.

    Attributes
    ----------
    spelled : str
        The modifiers that request it.
    make : callable
        Makes the tile, and returns it with the recipe of its size and scales. It is called with the fidelity of the
        best tile so far, and may raise `Dismissed`.
    time : float
        Its time, relative to that of the first try.
    improves : collection of str
        It is only tried if the worst part of the first tile's fidelity is one of these. Empty: any.
    """

    spelled: str
    make: Callable[[float], tuple[Synthesis, Recipe]]
    time: float = 1.0
    improves: Collection[str] = ()


@dataclass(frozen=True)
class JudgedTile:
    """A tile, its recipe, the modifiers that request it, and its fidelity; None if it is too small to measure."""

    synthesis: Synthesis
    recipe: Recipe
    spelled: str
    kept: Fidelity | None


def best_of(
    flag: str, tries: Sequence[Try], photo: JudgedPhoto, stats: Stats, progress: Progress
) -> JudgedTile:  # fmt: skip
    """The first tile that is good; if none is, the one with the highest fidelity.

    `progress` is that of the first.
    """
    best: JudgedTile | None = None
    worst = ""
    for number, one in enumerate(tries):
        if one.improves and worst not in one.improves:
            continue
        if best is not None:
            log.info("%s: %s with %s; trying %s", flag, best.kept, best.spelled, one.spelled)
            progress.lengthen(one.time)
        try:
            synthesis, recipe = one.make(0.0 if best is None or best.kept is None else best.kept.value)
        except (Dismissed, ImageError) as error:
            if number == 0:
                raise
            progress.advance(1, 1)
            log.info("%s: %s: %s", flag, one.spelled, error)
            continue
        if number > 0 and synthesis.lost is not None and synthesis.lost.share > SLACK:
            log.info("%s: %s loses %.0f %% of the texture", flag, one.spelled, 100 * synthesis.lost.share)
            continue
        with stats.time("fidelity"):
            kept = fidelity_of(photo, synthesis.source, recipe)
        if best is None or best.kept is None or (kept is not None and kept.value > best.kept.value):
            best = JudgedTile(synthesis, recipe, one.spelled, kept)
        if number == 0 and kept is not None:
            worst = kept.worst
        if best.kept is None or best.kept.value >= GOOD:
            break
    return present(best)


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
