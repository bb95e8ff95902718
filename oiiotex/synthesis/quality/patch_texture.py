# SPDX-License-Identifier: Apache-2.0
"""The texture cost of an image of copies (MJH17 eq. 5), with the copies as initial matches."""

from __future__ import annotations

from ...analysis.stationarity.row_bands import row_bands
from ...engine.core.demand import SomeRows
from ...engine.core.source_map import SourceMap
from ...engine.core.window import Domain, Window
from ...engine.deferred import np
from ...engine.session.progress import Progress
from ...engine.session.resources import Resources
from ..patchmatch.exemplar_rows import LEAST_ROWS, piece_halo
from ..patchmatch.field import Geometry
from ..patchmatch.matcher import match_patches

WHOLE = 1 << 22  # pixels of an image that is matched as a whole; of a larger one, windows with that many in total
PASSES = 2  # of propagation, from matches that are nearly right; more lower the cost by a few percent
_ACROSS = 4  # windows along each axis


def texture_of(
    resources: Resources,
    progress: Progress,
    lab: SomeRows,
    source: SourceMap,
    exemplar: SomeRows,
    patch: int,
    wraps: tuple[bool, bool],
) -> float | None:
    """The texture cost. None: the image or the exemplar is smaller than a patch.

    `lab` (height, width, 3) float32; `exemplar` (h, w, 3) float32; `patch`: side, px.
    """
    height, width = lab.shape[:2]
    if min(height, width, *exemplar.shape[:2]) < patch:
        return None
    windows = [Window(0, 0, width, height)]
    if width * height > WHOLE:
        windows, wraps = _windows(width, height), (False, False)
    costs = []
    for window in windows:
        domain = Domain(*window.size, *wraps)
        rows, columns = window.inside(Window(0, 0, width, height))
        start = _patches(source[rows], columns, domain, exemplar.shape, patch)
        here = lab[rows][:, columns]
        given = resources.device, here, exemplar, start, patch, domain, 0, resources.budget
        _, cost = match_patches(*given, PASSES, windows=0)
        costs.append(cost)
        progress.advance(2, 3)  # a chance to cancel
    return float(np.mean(costs))


def texture_bytes(size: tuple[int, int], exemplar: tuple[int, int], patch: int) -> int:
    """Minimum memory, for an image and an exemplar of these (width, height)."""
    pixels, (width, height) = min(size[0] * size[1], WHOLE), exemplar
    side = max(1, pixels // size[0])
    geometry = Geometry(size[0], side, True, True, exemplar_width=width, exemplar_height=height, patch=patch)
    rows = min(height, piece_halo(patch) + LEAST_ROWS)
    return sum(geometry.layout(None, rows).values()) + 28 * pixels + width * height  # Lab and initial matches


def _windows(width: int, height: int) -> list[Window]:
    side = round((WHOLE / _ACROSS**2) ** 0.5)
    high, wide = min(height, side), min(width, side)
    tops, lefts = (
        [round(k * (n - own) / (_ACROSS - 1)) for k in range(_ACROSS)] for n, own in ((height, high), (width, wide))
    )
    return [Window.sized(left, top, wide, high) for top in tops for left in lefts]


def _patches(source: SourceMap, columns: slice, domain: Domain, shape: tuple[int, ...], patch: int) -> SourceMap:
    """The exemplar patches that the copies in the middle of each patch belong to."""
    half, (width, height) = patch // 2, domain.size
    reach = [n if wraps else n - patch + 1 for n, wraps in zip(domain.size, domain.wraps, strict=True)]
    packed = np.empty((reach[1], reach[0]), np.uint32)
    right = (np.arange(reach[0]) + half) % width + columns.start
    for band in row_bands(packed):
        y, x = source[(np.arange(band.start, band.stop) + half) % height][:, right].yx
        places = (np.clip(at - half, 0, n - patch) for at, n in zip((y, x), shape, strict=False))
        packed[band] = SourceMap.of(*places).packed
    return SourceMap(packed)
