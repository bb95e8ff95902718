# SPDX-License-Identifier: Apache-2.0
"""--texproject: a clean plate rendered into a region of a frame, with the motion of the shot."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from ..engine.color.config import as_float
from ..engine.color.lens import in_type
from ..engine.core.access import Whole
from ..engine.core.image import Image, Part, channels_of, derived_spec, dtype_of
from ..engine.core.op import Kind, Output, Plan, Space
from ..engine.core.parameters import image, param
from ..engine.core.window import Window
from ..engine.deferred import np
from ..engine.errors import ImageError, ParameterError
from ..engine.session import Session
from ..engine.session.facts import Facts

if TYPE_CHECKING:
    from ..surfaces.motion.frame_motion import FrameMotion

_COPIES = 6  # of frame and plate in memory


@dataclass(frozen=True, kw_only=True)
class Project(Whole):
    """Render a clean plate into a region of a frame, with the motion, the light and the grain of the shot.

    Each frame is sampled once from the plate (`plate`), so the fill moves with the surface and stays sharp. Its light
    level is matched to the frame around the region, and new grain like the frame's is added. The plate fades out over
    4 px around the region, as the hole of `plate` is larger than the region. Other pixels, and channels that the plate
    lacks, are unchanged. Frames are independent, so they can be distributed, skipped and repeated.
    """

    example: ClassVar[str] = '>>> frame = filters.project("photo.png", "photo.png")'
    name: ClassVar[str] = "project"
    blends: ClassVar[bool] = True
    space: ClassVar[Space] = Space.ANY
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("frame", Kind.PIXELS, "The frame with the plate in its region, in its own color space and type."),
    )

    source: Image = image(help="Frame of the shot.")
    plate: Image = image(help="Clean plate, filled.")
    region: Image | None = image(
        None, help="Mask: white is replaced, gray is mixed. Without it, the whole frame is replaced."
    )
    motion: Path | None = param(
        None, unset="none: the plate is aligned with the frame", example="shot.npz", help="Motion that `plate` saved."
    )
    frame: int | None = param(
        None, example="1001", frame=True, unset="that of --frames, otherwise the only one", help="Number of the frame."
    )
    grain: float = param(1.0, ge=0, le=4, help="Amount of grain, as a multiple of the frame's. 0: none.")

    def plan(self, facts: Facts) -> Plan:
        """The motion of the frame."""
        part, plate = self.source.first, self.plate.first
        motion = self._motion(facts)
        self._require_size(facts)
        names, colors = part.spec.channelnames, channels_of(part.spec)
        lacking = [names[c] for c in colors.color if names[c] not in plate.spec.channelnames]
        if lacking:
            raise ImageError(
                f"plate {self.plate.source} has no channel {lacking[0]}: expected the frame's color channels"
            )
        pixels = part.spec.width * part.spec.height + plate.spec.width * plate.spec.height
        facts.require(_COPIES * 4 * len(names) * pixels, self.flag())
        return Plan(work=motion)

    def make(self, plan: Plan, session: Session) -> dict[str, Part]:
        """The frame with the plate in its region."""
        from ..surfaces.motion.frame_files import region_of, values_of
        from ..surfaces.motion.rendering import rendered

        part, plate = self.source.first, self.plate.first
        names, colors = part.spec.channelnames, channels_of(part.spec)
        display = Window.display(part.spec)
        if self.region is None:
            region = np.ones(display.size[::-1], np.float32)
        else:
            region = region_of(self.region.first, display, f"region {self.region.source}")
        if not region.any():
            return {"frame": part}
        values = values_of(part, display, "frame")
        surface = as_float(plate.pixels())
        alpha = channels_of(plate.spec).alpha
        known = np.ones(surface.shape[:2], bool) if alpha is None else surface[..., alpha] > 0
        shared = [c for c, name in enumerate(names) if name in plate.spec.channelnames]
        surface = surface[..., [plate.spec.channelnames.index(names[c]) for c in shared]]
        corner = plate.window.left - plate.spec.full_x, plate.window.top - plate.spec.full_y
        with session.resources.stats.time("project"):
            scale = _scale(values, surface)
            window, made, changed, missing = rendered(
                values[..., shared] * scale, region, surface * scale, known, corner, plan.work,
                tuple(shared.index(c) for c in colors.color), self.grain, self.frame or 0,
            )  # fmt: skip
        if missing:
            which = "" if self.frame is None else f"frame {self.frame}: "
            self.warn("%sthe plate does not cover %d pixels of the region: they are unchanged", which, missing)
        place, dtype = window.shifted(display.left, display.top), np.dtype(dtype_of(part.spec))
        at = window.inside(Window(0, 0, *display.size))
        stored = values[at].copy()
        stored[..., shared] = made / scale
        stored = in_type(stored, dtype)

        def fetch(wanted: Window) -> np.ndarray:
            rows = part.read(wanted).copy()
            near = wanted & place
            if not near.empty:
                here, there = near.inside(place), near.inside(wanted)
                rows[there] = np.where(changed[here][..., None], stored[here], rows[there])
            return rows

        return {"frame": replace(part, spec=derived_spec(part.spec), fetch=fetch, levels=(), thumbnail=None)}

    def _require_size(self, facts: Facts) -> None:
        """Refuse a plate whose pixels are not those that the motion leads to."""
        from ..surfaces.motion.frame_motion import plate_size

        expected: tuple[int, int] | None
        if self.motion is None:
            expected, belongs = Window.display(self.source.first.spec).size, "as the frame"
            hint = "set motion, if the plate extends beyond the frame"
        else:
            expected, belongs = plate_size(self.motion, facts.budget), f"the plate of {self.motion}"
            hint = "fill the plate without cropping or resizing it"
        width, height = Window.display(self.plate.first.spec).size
        if expected is not None and expected != (width, height):
            text = f"plate {self.plate.source} is {width}x{height}: expected {expected[0]}x{expected[1]}, {belongs}"
            raise ImageError(text, hint=hint)

    def _motion(self, facts: Facts) -> FrameMotion:
        from ..surfaces.motion.frame_motion import FrameMotion, read_shot

        if self.motion is None:
            return FrameMotion(np.eye(3))
        shot = read_shot(self.motion, facts.budget)
        number = self.frame if self.frame is not None else next(iter(shot)) if len(shot) == 1 else None
        if number is None or number not in shot:
            expected = f"a frame of {self.motion}, {min(shot)} to {max(shot)}"
            raise ParameterError(parameter="frame", value=... if number is None else number, expected=expected)
        return shot[number]


def _scale(*images: np.ndarray) -> np.float32:
    """A power of two that keeps squares of values within 32-bit floats: 1, but for values beyond 2^50."""
    peaks = (np.abs(values[np.isfinite(values)]).max(initial=0.0) for values in images)
    return np.float32(2.0 ** min(0, 50 - math.frexp(float(max(peaks)))[1]))
