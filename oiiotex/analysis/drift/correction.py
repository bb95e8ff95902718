# SPDX-License-Identifier: Apache-2.0
"""The correction that removes low-frequency variation, within what light does and what the photo's values allow.

Light that is k times as strong multiplies X, Y and Z by k. In Lab, f(Y) = (L + 16) / 116, f(X) = f(Y) + a / 500 and
f(Z) = f(Y) - b / 200 are cube roots of X, Y and Z above a linear toe (CIE 15:2018, 8.2.1), so light multiplies the
three by one factor. Only lightness gets a gain and an offset. Color follows it by that factor: channel ratios are kept.
A tint is a smooth offset of f(X) and f(Z) that is proportional to lightness, so black stays black.
"""

from __future__ import annotations

from dataclasses import dataclass

from ...engine.core.window import Window
from ...engine.deferred import np
from ..stationarity.grid_statistics import MARGIN, Cells, SplineSurface
from .compact_regions import LARGEST_LIGHT, LARGEST_TINT, NOISE, tint_of
from .drift_field import MOST_GAIN, Drift

_LEAST_IN_STAINS = 1 / 16  # minimum gain of contrast there: a stain adds its color to every element
_SURE_TINT = 12.0  # a, b: up to it a tint is removed in full, from `LARGEST_TINT` on not at all
_MOST_MIXED = 2.0  # in the photo's contrast of color: a photo of one color has nothing to mix
_BLACK = 16.0  # L + 16 is proportional to the cube root of Y
_TOE = np.float32(6.0 / 29.0)  # f below it is linear in X, Y, Z
_SLOPE, _FOOT = np.float32(841.0 / 108.0), np.float32(4.0 / 29.0)  # of f there
_STEPS = 7  # of Newton's method for a cube root, which is exact to a rounding after 6
_MOST_RATIO = 4.0  # of local levels


@dataclass(frozen=True)
class Correction:
    """The correction of each pixel of an image.

    Attributes
    ----------
    field : SplineSurface
        In Lab: gain and offset of L, ratio of the new to the old local level, gains of f(X) - f(Y) and f(Z) - f(Y),
        and their offsets for white. Of data: a gain for each channel, then an offset for each.
    limits : (float, float)
        Lowest and highest value of a result, but no pixel's own value is beyond them. In Lab: of L.
    in_lab : bool
    """

    field: SplineSurface
    limits: tuple[float, float]
    in_lab: bool

    def apply(self, values: np.ndarray, window: Window) -> None:
        """Correct (height, width, 4) float32 in place. `window`: the position of these pixels."""
        self._corrected(values, self.field.values(window))

    def change(self, values: np.ndarray, window: Window) -> np.ndarray:
        """Gains, then offsets, by which `apply` changes the first three values of each pixel: (height, width, 6)."""
        field, after = self.field.values(window), values.copy()
        self._corrected(after, field)
        gains = np.ones((*values.shape[:2], 3), np.float32)
        if self.in_lab:
            own, light = (np.maximum(v[..., 0], 0) + np.float32(_BLACK) for v in (values, after))
            gains[..., 0], gains[..., 1:] = field[..., 0], (light / own)[..., None] * field[..., 3:5]
        else:
            count = field.shape[-1] // 2
            gains[..., :count] = field[..., :count]
        return np.concatenate([gains, after[..., :3] - gains * values[..., :3]], -1)

    def _corrected(self, values: np.ndarray, field: np.ndarray) -> None:
        if self.in_lab:
            self._relit(values, field)
        else:
            count = field.shape[-1] // 2
            values[..., :count] = self._within(values[..., :count], field[..., :count], field[..., count:])

    def _within(self, own: np.ndarray, gain: np.ndarray, offset: np.ndarray) -> np.ndarray:
        low, high = map(np.float32, self.limits)
        return np.clip(own * gain + offset, np.minimum(own, low), np.maximum(own, high))

    def _relit(self, values: np.ndarray, field: np.ndarray) -> None:
        """Correct Lab in place."""
        gain, offset, ratio, *chroma = np.ascontiguousarray(np.moveaxis(field, -1, 0))
        lightness, a, b = np.ascontiguousarray(np.moveaxis(values[..., :3], -1, 0))
        own = np.maximum(lightness, np.float32(0))  # negative values of HDR images are kept
        f_y, f_xz = f_of_lab(own, a, b)
        least = own * np.minimum(ratio, 1) * np.float32(1 / MOST_GAIN)
        most = own * np.maximum(ratio, 1) * np.float32(MOST_GAIN)  # black stays black
        brightest = np.float32((self.limits[1] + _BLACK) / 116)
        room = np.maximum(brightest / np.maximum(np.maximum(f_xz.max(0), f_y), _FOOT), 1)
        most = np.minimum(most, f_y * room * np.float32(116) - np.float32(_BLACK))
        light = np.clip(own * gain + offset, least, np.maximum(most, own))
        new_y = (light + np.float32(_BLACK)) / np.float32(116)
        new_xz = _scaled(f_xz, f_y, new_y)
        tinted = new_y + np.stack(chroma[:2]) * (new_xz - new_y) + np.stack(chroma[2:]) * (new_y - _FOOT)
        new_xz = np.maximum(tinted, np.minimum(new_xz, (new_xz + _FOOT) / 2))  # no light becomes negative
        values[..., 0] += light - own
        values[..., 1] = (new_xz[0] - new_y) * np.float32(500)
        values[..., 2] = (new_y - new_xz[1]) * np.float32(200)


def f_of_lab(light: np.ndarray, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """CIE 15's f(Y) of L, a and b, (...), and f(X), f(Z), (2, ...)."""
    f_y = (light + np.float32(_BLACK)) / np.float32(116)
    return f_y, np.stack([f_y + a / np.float32(500), f_y - b / np.float32(200)])


def _scaled(f_xz: np.ndarray, f_y: np.ndarray, new_y: np.ndarray) -> np.ndarray:
    """f(X), f(Z), (2, ...), of the light that changes f(Y) to `new_y`: a common factor of X, Y and Z."""
    new_xz = f_xz * (new_y / f_y)
    dark = np.minimum(np.minimum(f_y, new_y), np.minimum(f_xz, new_xz).min(0)) < _TOE
    if dark.any():
        strength = light_of(new_y[dark]) / np.maximum(light_of(f_y[dark]), np.float32(1e-9))
        new_xz[:, dark] = cie_f(light_of(f_xz[:, dark]) * strength, new_xz[:, dark])
    return new_xz


def light_of(f: np.ndarray) -> np.ndarray:
    """X, Y or Z relative to white, of CIE 15's f."""
    return np.where(f > _TOE, f * f * f, (f - _FOOT) / _SLOPE)


def cie_f(light: np.ndarray, near: np.ndarray) -> np.ndarray:
    """CIE 15's f of X, Y or Z. Its cube root is Newton's, from a value near: that of a math library differs by CPU."""
    root = np.maximum(near, _TOE)
    for _ in range(_STEPS):
        root = (2 * root + light / (root * root)) / 3
    return np.where(light > _TOE**3, root, _SLOPE * light + _FOOT)


def correction(drift: Drift, amount: float, contrast: float, target: np.ndarray) -> Correction:
    """Correct local levels to `target` and local contrast to that of the whole image.

    The gain is ((G + 1) / (g + 1)) ^ contrast for an overall contrast G and a local contrast g in Lab units, between
    1/2 and 2: noise in areas without detail must not be amplified. A stain may add its color to every element, so
    contrast is reduced to as little as 1/16 there. Pixels outside a mask are corrected by their surroundings.

    `target` (channels,) float: the overall level of the result.
    """
    gain = ((drift.overall_contrast + NOISE) / (drift.contrast + NOISE)) ** contrast
    least = 1.0 / MOST_GAIN + drift.stains[..., None] * (_LEAST_IN_STAINS - 1.0 / MOST_GAIN)
    share = _light_share(drift) if drift.scale.in_lab else np.ones(1)
    gain = 1.0 + amount * share * (np.clip(gain, least, MOST_GAIN) - 1.0)
    low, high = drift.scale.limits
    if not drift.scale.in_lab:
        goal = drift.level + amount * (target - drift.level)
        field = np.concatenate([gain, goal - drift.level * gain], -1)
    else:
        field = _light_field(drift, share, gain, amount, target)
        low, high = 0.0, high * max(1.0, target[0] / max(drift.overall_level[0], 1.0))
    return Correction(SplineSurface(field, drift.cells), (low, high), drift.scale.in_lab)


def smooth_offset(field: np.ndarray, cells: Cells, brightest: float) -> Correction:
    """The correction that adds to lightness, which color follows, and to tints.

    Parameters
    ----------
    field : (down, across, 3) float
        At the cells' centers: offset of L, and those of f(X) - f(Y) and f(Z) - f(Y) for white.
    cells : Cells
    brightest : float
        Highest L of the image.
    """
    wide = np.pad(field, ((MARGIN, MARGIN), (MARGIN, MARGIN), (0, 0)), mode="edge")
    one = np.ones(wide.shape[:2])
    fields = np.stack([one, wide[..., 0], one, one, one, wide[..., 1], wide[..., 2]], -1)
    return Correction(SplineSurface(fields, cells), (0.0, brightest), True)


def tint_between(lab: np.ndarray, other: np.ndarray) -> np.ndarray:
    """The values of `smooth_offset` that turn `other` into `lab`, two similar colors (3,); each may be (..., 3)."""
    light, a, b = np.moveaxis((lab + other) / 2, -1, 0)
    by = np.moveaxis(lab - other, -1, 0)
    f_y = (np.maximum(light, 0.0) + _BLACK) / 116.0
    white = np.maximum(f_y - _FOOT, _FOOT)
    follows = by[0] / (116.0 * f_y)
    return np.stack([by[0], (by[1] - a * follows) / 500.0 / white, (b * follows - by[2]) / 200.0 / white], -1)


def _light_share(drift: Drift) -> np.ndarray:
    """Share of the local variation of L, a and b that light explains, (down + 4, across + 4, 3), 0 to 1; 1 in stains.

    Light moves the colors of all materials alike. Where one material covers more than elsewhere, as paint on rust or
    veins in marble, the level moves towards its color and the contrast of color changes, as one end of the colors,
    a contrast above or below the level, stays. What moves both ends is light. L has the share of a and b together.
    """
    scale = (max(drift.overall_level[0], 0.0) + _BLACK) / (np.maximum(drift.level[..., :1], 0.0) + _BLACK)
    tint = np.abs(scale * drift.level[..., 1:] - drift.overall_level[1:])
    ends = np.abs(scale * drift.contrast[..., 1:] - drift.overall_contrast[1:]) - NOISE
    mixed = np.minimum(np.clip(ends, 0.0, _MOST_MIXED * drift.overall_contrast[1:]), tint)
    of_mixture, whole = (np.concatenate([np.sqrt((ab**2).sum(-1, keepdims=True)), ab], -1) for ab in (mixed, tint))
    share = 1.0 - of_mixture / (whole + NOISE)
    return share + drift.stains[..., None] * (1.0 - share)


def _light_field(drift: Drift, share: np.ndarray, gain: np.ndarray, amount: float, target: np.ndarray) -> np.ndarray:
    """`Correction.field` in Lab: local light is moved to the overall one, then the overall one to `target`."""
    level, overall = drift.level, drift.overall_level
    own = level[..., 0]
    light = share[..., 0] * np.clip(overall[0] - own, -LARGEST_LIGHT, LARGEST_LIGHT) + target[0] - overall[0]
    goal = own + amount * light
    offset = goal - own * gain[..., 0]
    ratio = np.clip(np.maximum(goal, 1.0) / np.maximum(own, 1.0), 1.0 / _MOST_RATIO, _MOST_RATIO)
    sure = np.moveaxis(share[..., 1:], -1, 0) * np.maximum(_sure_tint(drift), drift.stains)
    new_y = (np.maximum(goal, 0.0) + _BLACK) / 116.0
    local, common, wanted = (_chroma(np.broadcast_to(lab, level.shape), new_y) for lab in (level, overall, target))
    less = np.minimum(np.moveaxis(gain[..., 1:], -1, 0), 1.0) - 1.0
    gains = 1.0 + drift.stains * less  # of chroma: only a stain changes it
    chroma = local + amount * (sure * (common - local) + wanted - common) - new_y - gains * (local - new_y)
    return np.stack([gain[..., 0], offset, ratio, *gains, *chroma / np.maximum(new_y - _FOOT, _FOOT)], -1)


def _chroma(lab: np.ndarray, new_y: np.ndarray) -> np.ndarray:
    """f(X), f(Z), (2, ...), of Lab (..., 3) in the light that gives it `new_y`."""
    f_y, f_xz = f_of_lab(np.maximum(lab[..., 0], 0.0), lab[..., 1], lab[..., 2])
    return _scaled(f_xz, f_y, new_y)


def _sure_tint(drift: Drift) -> float:
    """Share of local tints that is removed, 0 to 1: large ones are another material, anywhere in the photo."""
    within = slice(MARGIN, -MARGIN), slice(MARGIN, -MARGIN)
    tint = tint_of(drift.level[within], drift.overall_level)
    most = float(tint[drift.stains[within] == 0].max(initial=0.0))
    return min(1.0, max(0.0, (LARGEST_TINT - most) / (LARGEST_TINT - _SURE_TINT)))
