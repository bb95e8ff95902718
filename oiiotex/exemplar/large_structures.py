# SPDX-License-Identifier: Apache-2.0
"""What a photo has in few places only: structures that a histogram held everywhere would spread over the tile.

Ledges, bars, windows and water are larger than sigma and have colours that the texture beside them has not. Global
histogram matching (MJH17 section 4.2) asks for these colours in their old share, stationarity asks for them everywhere:
together they chop structures into dozens of pieces. Left out of the histogram they are left out of the tile.
"""

from __future__ import annotations

import copy
import logging
from dataclasses import dataclass
from statistics import fmean
from typing import TYPE_CHECKING

from ..color.lab_grid import FINE_STEPS
from ..color.lab_reduced import LabPixels
from ..core.demand import SomeRows
from ..deferred import np
from ..patchmatch.constraints import coarse_image, coarse_mask
from ..patchmatch.use_prices import deviation, flat_bound
from ..session import Session

if TYPE_CHECKING:
    from ..dominant.diffusion import Dominant

log = logging.getLogger("oiiotex")

CONTRAST = 0.7  # where there is nothing to spread
SIDE = 128  # px; longer side that a photo is looked at with: sigma is 4 px there where it is left out
PATCHES = 7, 9, 11, 13  # px of it
AGREEING = 3  # of them must find a texture
MUCH = 0.78  # of the photo's deviation: with less in its main texture, structures have the rest
HALF = 0.5  # the same where other groups of patches are denser: structures of one colour, or stones of many kinds
FLAT = 0.1  # share of its texels that are not flat below which it is no texture, and what lies beside it is
_TEXELS = 2000
_BLOCK = 5  # px; what is flat is looked at in
_CLEAR = 0.745  # share of texels up to which it was found by a valley of heat, and not by its bound


@dataclass(frozen=True)
class MainTexture:
    """The part of a photo that is one texture, beside structures.

    Attributes
    ----------
    share : float
        Of the photo's patches, 0 to 1.
    deviation : float
        Of its colours, as a share of the photo's.
    """

    share: float
    deviation: float


def main_texture(lab: SomeRows, usable: np.ndarray | None, session: Session) -> MainTexture | None:
    """The texture that structures lie beside; None where the photo is all texture.

    It is the dominant texture of LDR09, but only where heat has a valley around it, for a gradient of light or a stain
    has none, where it is not flat, as a sky beside stones is, and where its colours deviate less than the photo's: else
    there is nothing to spread. One size of patches may see that by chance: most of several must.

    Parameters
    ----------
    lab : (height, width, 3) float32
    usable : (height, width) bool or None
        Pixels that count; None: all.
    session : Session
    """
    from ..dominant.diffusion import dominant_texture  # scipy is not loaded before it is needed

    quiet = copy.copy(session)
    quiet.progress = None  # a moment before the work
    pixels = _reduced(lab, usable)
    looks = []
    for number, patch in enumerate(PATCHES):
        if min(pixels.seen.shape) < 2 * patch:
            return None
        dominant = dominant_texture(pixels, quiet, patch=patch, most=_TEXELS)
        if dominant.kernel is None:
            return None
        if not dominant.rejected and dominant.share < _CLEAR and _textured(pixels, dominant) > FLAT:
            look = MainTexture(dominant.share, _deviation(pixels, dominant))
            if look.deviation <= (MUCH if len(dominant.rounds) == 1 else HALF):
                looks.append(look)
        if len(looks) + len(PATCHES) - 1 - number < AGREEING:
            return None
    return MainTexture(fmean(look.share for look in looks), fmean(look.deviation for look in looks))


def fitting_contrast(flag: str, lab: SomeRows, usable: np.ndarray | None, session: Session) -> float:
    """How strongly to hold the histogram of a photo, 0 to 1, logged for op `flag`.

    Parameters
    ----------
    flag : str
    lab, usable, session
        As `main_texture` takes them.
    """
    with session.stats.time("large structures"):
        texture = main_texture(lab, usable, session)
    if texture is None:
        log.info("%s: contrast=%g: no structures stand out of the photo's texture", flag, CONTRAST)
        return CONTRAST
    log.info(
        "%s: contrast=0: %.0f %% of the photo is one texture, with %.0f %% of the deviation of its colours; the"
        " histogram would spread the structures beside it",
        flag, 100 * texture.share, 100 * texture.deviation,
    )  # fmt: skip
    return 0.0


def _reduced(lab: SomeRows, usable: np.ndarray | None) -> LabPixels:
    """The photo at `SIDE` px, on the grid of Lab; smaller ones as they are."""
    scale = min(1.0, SIDE / max(lab.shape[:2]))
    height, width = (max(1, round(n * scale)) for n in lab.shape[:2])
    mask = coarse_mask(usable, width, height)
    seen = np.ones((height, width), bool) if mask is None else mask
    small = np.rint(coarse_image(lab, usable, width, height) * FINE_STEPS) / np.float32(FINE_STEPS)
    if not seen.all():
        small[~seen] = small[seen].mean(0, dtype=np.float64) if seen.any() else 0
    return LabPixels(small.astype(np.float32), seen, 1, None, width, height)


def _textured(pixels: LabPixels, dominant: Dominant) -> float:
    """Share of the dominant texels around which the photo is not flat, as the prices of use see it."""
    from ..dominant.diffusion import DOMINANT

    activities = deviation(np.rint(pixels.lab * FINE_STEPS).astype(np.int16), _BLOCK)
    chosen = dominant.types == DOMINANT
    last = activities.shape[0] - 1, activities.shape[1] - 1
    rows = np.clip(dominant.texels.rows[chosen] - _BLOCK // 2, 0, last[0])
    columns = np.clip(dominant.texels.columns[chosen] - _BLOCK // 2, 0, last[1])
    return float((activities[rows, columns] > flat_bound(activities)).mean())


def _deviation(pixels: LabPixels, dominant: Dominant) -> float:
    """Of colours at the centres of dominant texels, over that of all; channels added up."""
    from ..dominant.diffusion import DOMINANT

    colours = pixels.lab[dominant.texels.rows, dominant.texels.columns].astype(np.float64)
    own = colours[dominant.types == DOMINANT].std(0).sum()
    return float(own / max(colours.std(0).sum(), 1e-9))
