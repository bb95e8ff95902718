# SPDX-License-Identifier: Apache-2.0
"""The photo of a tile that keeps its layout, with the levels on both sides of the seams evened."""

from __future__ import annotations

from ...analysis.drift.correction import Correction
from ...analysis.drift.drift_field import drift_cells
from ...analysis.drift.flattening import change_of, corrected, correction_part, default_radius
from ...engine.color.lab import lens_of
from ...engine.core.demand import MadeRows, SomeRows
from ...engine.core.image import Image, Part
from ...engine.core.op import Space
from ...engine.core.source_map import SourceMap
from ...engine.core.window import Window
from ...engine.deferred import np
from ...engine.session.resources import Resources
from ..layout.level_steps import level_correction
from .exemplar_op import ExemplarPixels


def evening_of(
    source: SourceMap, wraps: tuple[bool, bool], seen: ExemplarPixels, window: Window, strength: float | None
) -> Correction | None:
    """The correction of a flattened photo that evens a tile's seams; None: flattening is off, or there are no seams.

    `window`: of the photo; `strength`: share of the photo's drift that is removed.
    """
    if not strength:
        return None
    cells = drift_cells(window, default_radius(window))
    return level_correction(source, wraps, seen.values, seen.usable, cells, strength)


def evened_values(values: SomeRows, evening: Correction, window: Window) -> SomeRows:
    """Lab of the evened photo, (height, width, channels) float32; further maps as they are. `window`: of the photo."""

    def rows(first: int, last: int) -> np.ndarray:
        made = np.array(values[first:last])
        evening.apply(made, Window(window.left, window.top + first, window.right, window.top + last))
        return made

    in_memory = isinstance(values, np.ndarray)
    return rows(0, len(values)) if in_memory else MadeRows(values.shape, np.float32, rows)


def evened_part(
    photo: Image, evening: Correction, drift: dict[str, Part], space: Space, resources: Resources
) -> tuple[Part, dict[str, Part]]:
    """The photo's first part, evened, and the whole correction. `drift`: the correction that was applied before."""
    part, lens = photo.first, lens_of(photo, resources, space)
    change = change_of(part, lens, evening, resources, drift["drift"])
    return corrected(part, lens, evening, resources), {"drift": correction_part(change, part)}
