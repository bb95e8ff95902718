# SPDX-License-Identifier: Apache-2.0
"""The finest detail of a photo in linear light, which is large and skewed where a surface glitters."""

from __future__ import annotations

from dataclasses import replace

from ...engine.color.lens import Lens
from ...engine.core.demand import bands, rows_for, stream
from ...engine.core.image import Part, spec_beside
from ...engine.core.tiling import repeated
from ...engine.core.window import Window
from ...engine.deferred import np
from .shading import luminance

STEPS = 2000.0  # of detail per white: sums are of integer 64ths of a step
_TAPS = (1, 4, 6, 4, 1)  # a Gaussian of sigma 1
_REACH = 2
_MOST_STEPS = 20000  # ten times white: brighter highlights count as that


def fine_detail(part: Part, lens: Lens, tiling: str) -> Part:
    """Signed difference between the luminance of each pixel and its surroundings, in `STEPS` per white; alpha 0 or 1.

    Parameters
    ----------
    part : Part
        The photo, read in bands of full rows.
    lens : Lens
        Its color conversion.
    tiling : str
        Axes along which it tiles.
    """
    plane = repeated(part, tiling)

    def fetch(window: Window) -> np.ndarray:
        around = window.grown(_REACH) & plane.window
        seen = [lens.values(plane.read(band)) for band in around.cells(around.width, rows_for(part))]
        values = np.concatenate([v[..., 0] for v, _ in seen])
        opaque = np.concatenate([np.ones(v.shape[:2], bool) if there is None else there for v, there in seen])
        light = values / np.float32(100) if lens.space is None else luminance(values)
        weight = opaque.astype(np.float32)
        mean = _blurred(light * weight) / np.maximum(_blurred(weight), np.float32(1e-6))
        detail = (light - mean) * weight * np.float32(STEPS)
        return np.stack([detail, weight], -1)[window.inside(around)]

    spec = spec_beside(part.spec, ("Y", "A"))
    spec.alpha_channel = 1
    return replace(part, spec=spec, fetch=fetch, stored=None, ready=False, levels=())


def without_sign(detail: Part) -> Part:
    """The size of `fine_detail`, which is large where a surface glitters."""
    return replace(detail, fetch=lambda window: np.abs(detail.read(window)))


def skewness(detail: Part) -> float:
    """The skewness of `fine_detail`: highlights are few and bright, so it is positive on glossy surfaces.

    Motoyoshi, Nishida, Sharan and Adelson, Image statistics and the perception of surface qualities, Nature 447 (2007).
    Sums are of integers, so bands do not matter. 0 if there is no detail.
    """
    count, sums = 0, [0, 0, 0]
    for _, rows in stream(detail, bands(detail)):
        steps = np.rint(np.clip(rows[..., 0], -_MOST_STEPS, _MOST_STEPS)).astype(np.int64)
        count += int(np.count_nonzero(rows[..., 1]))
        sums = [total + int((steps**n).sum()) for n, total in enumerate(sums, 1)]
    mean, square, cube = (total / max(count, 1) for total in sums)
    variance = square - mean**2
    return 0.0 if variance <= 0 else (cube - 3 * mean * square + 2 * mean**3) / variance**1.5


def _blurred(values: np.ndarray) -> np.ndarray:
    """(height, width) filtered by the taps along both axes; 0 beyond the border."""
    for axis in (0, 1):
        wide = np.pad(values, [(_REACH, _REACH) if a == axis else (0, 0) for a in (0, 1)])
        size = values.shape[axis]
        taken = (np.take(wide, range(n, n + size), axis) * np.float32(tap / 16) for n, tap in enumerate(_TAPS))
        values = sum(taken, np.zeros_like(values))
    return values
