# SPDX-License-Identifier: Apache-2.0
"""Compact regions that low-frequency variation is not measured in: stains, and objects of another material."""

from __future__ import annotations

from ...engine.deferred import np

NOISE = 1.0  # Lab; contrast below it is treated as noise and hardly amplified
LARGEST_TINT = 20.0  # a, b at the photo's lightness: more is another material, not light
LARGEST_LIGHT = 40.0  # the same of L
_NEAR, _FAR = 3.0, 8.0  # in deviations of the texture's own variation: end of a stain, and minimum peak of one
_MOST_STAINS, _LARGEST_STAINS = 2, 0.15  # maximum number of stains, and share of the photo they may cover
_END = 0.5  # end of an object, relative to the limits above
_MOST_OBJECTS, _LARGEST_OBJECTS = 4, 0.15  # more or larger ones are the texture itself
_MOST_CELLS = 1 << 14  # that are searched: sufficient for a photo 16 radii wide


def stains(rest: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Mask of stains smaller than the disc, 0 to 1: one or two compact areas far from the texture's own variation.

    More of them are objects, such as windows in a wall, or the texture itself.

    Parameters
    ----------
    rest : (down, across, channels) float
        Medians over a small disc, minus the local level.
    inside : (down, across) bool
        Cells with pixels.
    """
    typical = np.maximum(NOISE, 1.4826 * np.median(np.abs(rest[inside]), axis=0))  # deviation
    away = np.where(inside, (np.abs(rest) / typical).max(-1), 0.0)
    found = _compact(away > _NEAR, away > _FAR, inside, _MOST_STAINS, _LARGEST_STAINS)
    return found * np.clip((away - _NEAR) / _NEAR, 0.0, 1.0)


def objects(near: np.ndarray, overall: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Cells of compact regions that differ from the photo by more than light does, (down, across) bool.

    Parameters
    ----------
    near : (down, across, 3) float
        Lab medians over a small disc.
    overall : (3,) float
        Lab level of the photo.
    inside : (down, across) bool
        Cells with pixels.
    """
    light = np.abs(near[..., 0] - overall[0]) / LARGEST_LIGHT
    away = np.where(inside, np.maximum(light, tint_of(near, overall) / LARGEST_TINT), 0.0)
    return _compact(away > _END, away > 1.0, inside, _MOST_OBJECTS, _LARGEST_OBJECTS)


def tint_of(level: np.ndarray, overall: np.ndarray) -> np.ndarray:
    """Difference in color, a and b, that neither the strength of light nor a constant offset explains.

    Light scales L + 16, a and b alike, so a / (L + 16) and b / (L + 16) do not depend on its strength (CIE 15). Haze
    and thin stains add nearly the same a and b to every color. The smaller of both distances counts.
    """
    black = 16.0
    common = overall[1:] / (max(overall[0], 0.0) + black)
    own = level[..., 1:] / (np.maximum(level[..., :1], 0.0) + black)
    relit = (own - common) * (max(overall[0], 0.0) + black)
    return np.sqrt(np.minimum((relit**2).sum(-1), ((level[..., 1:] - overall[1:]) ** 2).sum(-1)))


def _compact(wide: np.ndarray, peak: np.ndarray, inside: np.ndarray, most: int, share: float) -> np.ndarray:
    """Connected regions of `wide` that contain a `peak`, (down, across) bool; none if too many or too large."""
    nothing = np.zeros(inside.shape, bool)
    if inside.size > _MOST_CELLS or not peak.any():
        return nothing
    places = connected(wide)
    found = np.unique(places[peak])
    regions = np.isin(places, found)
    if len(found) > most or np.count_nonzero(regions) > share * np.count_nonzero(inside):
        return nothing
    return regions


def connected(marked: np.ndarray) -> np.ndarray:
    """Labels of connected components, 0 elsewhere, on a few thousand cells. scipy.ndimage is slow to import."""
    places = np.where(marked, np.arange(1, marked.size + 1).reshape(marked.shape), 0)
    while True:
        wide = np.pad(places, 1)
        around = np.maximum.reduce([wide[1:-1, :-2], wide[1:-1, 2:], wide[:-2, 1:-1], wide[2:, 1:-1], places])
        around[~marked] = 0
        if (around == places).all():
            return places
        places = around
