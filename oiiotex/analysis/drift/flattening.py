# SPDX-License-Identifier: Apache-2.0
"""An image without its low-frequency variation, and the correction that was applied, as parts."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ...engine.color.lab import lens_of
from ...engine.core.access import mapped
from ...engine.core.image import Image, Part, spec_beside
from ...engine.core.op import Kind, Output, Space
from ...engine.core.window import Window
from ...engine.deferred import np
from ...engine.session.progress import Progress
from ...engine.session.resources import Resources

if TYPE_CHECKING:
    from ...engine.color.lens import Lens
    from .correction import Correction

log = logging.getLogger("oiiotex")

DRIFT = Output(
    "drift",
    Kind.MEASURE,
    "Correction of each pixel: Lab x gain + offset. Channels: gain.L, gain.a, gain.b, offset.L, offset.a, offset.b.",
    asked_by="drift",
)
DRIFT_HELP = (
    "Correction that removes gradients and stains. 1: append it as part 'drift'; a file name: write it to that file."
)
DEFAULT_RADIUS = 0.2  # of the longer side: a smaller one removes the texture's own variation at 1/24 of it
_CENTER = (50.0, 0.0, 0.0)  # of Lab; data are scaled to 0 .. 100
_CHANNELS = tuple(f"{kind}.{channel}" for kind in ("gain", "offset") for channel in "Lab")
_UNCHANGED = (1.0,) * 3 + (0.0,) * 3


def default_radius(window: Window) -> float:
    """Radius of the disc for an image, px."""
    return max(1.0, DEFAULT_RADIUS * max(window.size))


@dataclass(frozen=True, kw_only=True)
class Flattening:
    """How low-frequency variation is removed.

    Attributes
    ----------
    radius : float or None
        Radius of the disc, px. None: `DEFAULT_RADIUS` of the longer side.
    amount : float
        Share of the variation that is removed, 0 to 1.
    contrast : float
        Share of the variation in local contrast that is removed, 0 to 1.
    centered : bool
        Move the overall level to middle gray. Otherwise it is kept.
    wraps : (bool, bool)
        The image is a torus along y, along x.
    """

    radius: float | None = None
    amount: float = 1.0
    contrast: float = 1.0
    centered: bool = False
    wraps: tuple[bool, bool] = (False, False)

    def of(
        self, flag: str, source: Image, space: Space, resources: Resources, progress: Progress,
        usable: np.ndarray | None = None,
    ) -> tuple[Part, Part, np.ndarray | None]:  # fmt: skip
        """The flattened first part of an image, in its own color space and type, the correction, and `Drift.stained`.

        Parameters
        ----------
        flag : str
            Name of the op, for the log.
        space : Space
            Working space of the op.
        usable : (height, width) bool, optional
            Pixels that the field is measured on. Default: all with nonzero alpha.

        Raises
        ------
        ImageError
            NaN or Inf, or the field does not fit the budget.
        """
        from ..stationarity.grid_statistics import MARGIN
        from .correction import correction
        from .drift_field import drift_of  # not needed for help

        part = source.first
        lens = lens_of(source, resources, space)
        radius = self.radius or default_radius(part.window)
        drift = None if self.amount == 0 else drift_of(source, lens, radius, resources, progress, self.wraps, usable)
        if drift is None:  # no usable pixels, or nothing to do: copy without rounding
            return part, correction_part(None, part), None
        center = np.array(_CENTER if lens.space is not None else _CENTER[:1] * 3)[: lens.count]
        target = center if self.centered else drift.overall_level
        change = correction(drift, self.amount, self.contrast, target)
        away = np.abs(drift.level[MARGIN:-MARGIN, MARGIN:-MARGIN] - drift.overall_level).max((0, 1))
        shown = ", ".join(f"{v:.1f}" for v in away) + (" in L, a, b" if lens.space is not None else "")
        log.info("%s: local levels differ from the overall level by up to %s (radius %g px)", flag, shown, radius)

        field = correction_part(change_of(part, lens, change, resources), part)
        return corrected(part, lens, change, resources), field, drift.stained()


def corrected(part: Part, lens: Lens, change: Correction, resources: Resources) -> Part:
    """A part after a correction, in its own color space and type."""

    def work(rows: np.ndarray, window: Window) -> np.ndarray:
        values, opaque = lens.values(rows)
        change.apply(values, window)
        made = lens.replaced(rows, values, opaque)
        # a tint may leave the gamut: what was not negative does not become so
        return np.maximum(made, np.minimum(rows, 0)) if lens.space and made.dtype.kind == "f" else made

    return mapped(part, work, resources)


def change_of(part: Part, lens: Lens, change: Correction, resources: Resources, before: Part | None = None) -> Part:
    """Gains, then offsets, of each pixel of a part; with those of an earlier correction that led to it."""

    def changed(rows: np.ndarray, window: Window) -> np.ndarray:
        values, opaque = lens.values(rows)
        done = change.change(values, window)
        if opaque is not None:
            done = np.where(opaque[..., None], done, np.array(_UNCHANGED, np.float32))
        if before is None:
            return done
        gains, offsets = done[..., :3], done[..., 3:]
        first = before.read(window)
        return np.concatenate([gains * first[..., :3], gains * first[..., 3:] + offsets], -1)

    return mapped(part, changed, resources, spec_beside(part.spec, _CHANNELS))


def correction_part(changed: Part | None, part: Part) -> Part:
    """The part `drift` over `part`: gains, then offsets, of each pixel. None: gain 1 and offset 0."""

    def fetch(window: Window) -> np.ndarray:
        return np.broadcast_to(np.array(_UNCHANGED, np.float32), (window.height, window.width, 6)).copy()

    if changed is None:
        return Part("drift", spec_beside(part.spec, _CHANNELS), fetch, ready=True)
    return replace(changed, name="drift")
