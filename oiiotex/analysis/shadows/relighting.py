# SPDX-License-Identifier: Apache-2.0
"""An image without its cast shadow: pixels in shade get the light that pixels outside have."""

from __future__ import annotations

import logging

from ...engine.color.lab import lens_of
from ...engine.core.access import mapped
from ...engine.core.elementary import logarithm
from ...engine.core.image import Image, Part
from ...engine.core.op import Space
from ...engine.core.window import Window
from ...engine.deferred import np
from ...engine.scan import scan
from ...engine.session.progress import Progress
from ...engine.session.resources import Resources
from ..drift.correction import cie_f, f_of_lab, light_of
from ..stationarity.grid_statistics import MARGIN, Cells, SplineSurface
from .cast_shadow import CELLS, CastShadow, cast_shadow, visible

log = logging.getLogger("oiiotex")

_STEPS = float(1 << 16)  # of linear light that is summed as integers: in any order
_BRIGHTEST = float(1 << 20)  # of linear light: sums of a cell stay exact in doubles
_BLACK = 0.002  # of the photo's median light: darker cells are noise
_PARTS = 256.0  # of a cell, and of light. The fit is rounded, so that other libraries of algebra decide alike
_LEAST_CELLS = 24  # along a side: a smaller photo shows no border
_BOX = 1 / 12  # variance of a cell
_SLOPE = np.float32(841 / 108)  # of CIE 15's f in the dark
# X, Y, Z, relative to D65, of linear Rec. 709, and back (IEC 61966-2-1); only arithmetic whose order is fixed
_XYZ = ((0.4339499, 0.3762098, 0.1898403), (0.2126729, 0.7151522, 0.0721749), (0.0177566, 0.1094680, 0.8727754))
_RGB = ((3.0799556, -1.5371391, -0.5428164), (-0.9212588, 1.8760110, 0.0452478), (0.0528874, -0.2040259, 1.1511385))


def without_shadow(
    flag: str, image: Image, space: Space, resources: Resources, progress: Progress, usable: np.ndarray | None = None
) -> Part:
    """The first part of an image in full light, if it has a cast shadow that is sure; otherwise as it is.

    Parameters
    ----------
    flag : str
        Name of the op, for the log.
    space : Space
        Working space of the op.
    usable : (height, width) bool, optional
        Pixels that the shadow is measured on. Default: all with nonzero alpha.

    Raises
    ------
    ImageError
        NaN or Inf.
    """
    part, lens = image.first, lens_of(image, resources, space)
    cells = Cells(part.window, max(1, max(part.window.size) // CELLS))
    sums = np.zeros((cells.down, cells.across, 4))

    def look(values: np.ndarray, opaque: np.ndarray | None, piece: Window) -> list[np.ndarray]:
        counted = np.ones(values.shape[:2], bool) if opaque is None else opaque
        if usable is not None:
            counted = counted & usable[piece.inside(part.window)[0]]
        steps = np.rint(np.clip(_linear(values), 0, _BRIGHTEST) * _STEPS) * counted[..., None]
        steps = np.concatenate([steps, counted[..., None]], -1, dtype=np.float64)
        each = (steps[row.inside(piece)[0]].sum(0) for row in cells.rows(piece))
        return [np.add.reduceat(row, cells.starts) for row in each]

    scan(
        part, lens, resources, look, lambda piece, found: cells.add(sums, piece, found),
        cell=cells.side, advance=progress.advance,
    )  # fmt: skip
    shadow = _shadow(sums)
    if shadow is None or not shadow.is_sure:
        log.warning("%s: no cast shadow was found: shadows=1 changes nothing", flag)
        return part
    sky = np.rint(shadow.sky * _PARTS) / _PARTS
    shares = ", ".join(f"{share:.2f}" for share in sky)
    log.info("%s: a cast shadow has %s of the light outside in R, G, B", flag, shares)
    surface = SplineSurface(np.pad(np.rint(shadow.distance * _PARTS) / _PARTS, MARGIN, mode="edge")[..., None], cells)
    width = np.rint(max(shadow.width**2 - _BOX, _BOX) ** 0.5 * _PARTS) / _PARTS

    def work(rows: np.ndarray, window: Window) -> np.ndarray:
        share = visible(surface.values(window)[..., 0] / np.float32(width))
        if (share >= 1).all():
            return rows
        values, opaque = lens.values(rows)
        _relight(values, (1 / (share[..., None] * (1 - sky) + sky)).astype(np.float32))
        return np.where((share < 1)[..., None], lens.replaced(rows, values, opaque), rows)

    return mapped(part, work, resources)


def _shadow(sums: np.ndarray) -> CastShadow | None:
    """Of sums of linear light and numbers of pixels, (rows, columns, 4)."""
    valid = sums[..., 3] > 0
    if min(valid.shape) < _LEAST_CELLS or not valid.any():
        return None
    linear = sums[..., :3] / _STEPS / np.maximum(sums[..., 3:], 1)
    floor = max(_BLACK * float(np.median(linear[valid])), 1 / _STEPS)
    return cast_shadow(logarithm(linear + floor), valid)


def _linear(lab: np.ndarray) -> np.ndarray:
    """Linear Rec. 709 of Lab, (..., 3) float."""
    f_y, f_xz = f_of_lab(lab[..., 0], lab[..., 1], lab[..., 2])
    return _transformed(_RGB, [light_of(f) for f in (f_xz[0], f_y, f_xz[1])])


def _relight(values: np.ndarray, gain: np.ndarray) -> None:
    """Multiply linear R, G, B of Lab, (height, width, 4) float32, in place."""
    near = (values[..., 0] + np.float32(16)) / np.float32(116)
    xyz = _transformed(_XYZ, list(np.moveaxis(_linear(values) * gain, -1, 0)))
    f = cie_f(np.maximum(xyz, 0), near[..., None]) + _SLOPE * np.minimum(xyz, 0)  # negative values of HDR are kept
    f_x, f_y, f_z = np.moveaxis(f, -1, 0)
    values[..., 0] = f_y * np.float32(116) - np.float32(16)
    values[..., 1] = (f_x - f_y) * np.float32(500)
    values[..., 2] = (f_y - f_z) * np.float32(200)


def _transformed(matrix: tuple[tuple[float, ...], ...], channels: list[np.ndarray]) -> np.ndarray:
    """Three channels by a matrix, (..., 3)."""
    first, second, third = channels
    rows = (np.float32(a) * first + np.float32(b) * second + np.float32(c) * third for a, b, c in matrix)
    return np.stack(list(rows), -1)
