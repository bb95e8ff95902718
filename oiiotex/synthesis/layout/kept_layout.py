# SPDX-License-Identifier: Apache-2.0
"""A tile that keeps the photo's layout: joined where the photo's end and its start look alike (KSE03).

First along x, then, with the result as a strip that is closed along x, along y. Every pixel is a copy.
"""

from __future__ import annotations

from dataclasses import dataclass

from ...engine.core.demand import SomeRows
from ...engine.core.source_map import SourceMap
from ...engine.deferred import np
from .bending import bent_jumps
from .periods import Jumps, leveled_jumps
from .seam import Joint, starts
from .strip import PhotoStrip


@dataclass(frozen=True)
class KeptLayout:
    """A tile as source pixels, with its seams.

    Attributes
    ----------
    source : SourceMap
        (height, width).
    periods : (Jumps or None, Jumps or None)
        Along x and along y; None: the tile does not wrap there.
    is_bent : bool
        Its courses were bent so that they meet at a seam.
    """

    source: SourceMap
    periods: tuple[Jumps | None, Jumps | None]
    is_bent: bool = False

    @property
    def cost(self) -> float:
        """Cost of the worse seam per pixel, in variances of the photo."""
        return max((jumps.cost for jumps in self.periods if jumps is not None), default=0.0)

    def __str__(self) -> str:
        """A one-line summary."""
        sides = self.source.packed.shape[::-1]
        seams = ", ".join(
            f"{jumps.cost:.2f} along {axis}" for axis, jumps in zip("xy", self.periods, strict=True) if jumps
        )
        bent = "; courses bent so that they meet" * self.is_bent
        return f"layout kept: {sides[0]}x{sides[1]} px{bent}; cost of the seams in variances of the photo: {seams}"


def kept_layout(
    values: SomeRows, usable: np.ndarray | None, size: tuple[int | None, int | None], wraps: tuple[bool, bool]
) -> KeptLayout:
    """The tile of a photo.

    Parameters
    ----------
    values : (height, width, channels) float32
        CIE Lab, and further maps on its scale.
    usable : (height, width) bool or None
        Valid source pixels. Seams avoid the others. None: all.
    size : (int or None, int or None)
        Width and height of the tile, px. None: the best period.
    wraps : (bool, bool)
        Whether the tile wraps along x, along y.
    """
    height, width = values.shape[:2]
    strip = PhotoStrip(SourceMap.of(np.arange(height)[:, None], np.arange(width)), False, values, usable)
    periods: list[Jumps | None] = [None, None]
    bends = [False, False]
    first = 0 if wraps[0] else 1  # leveling costs lines of the other axis, so what is only cropped is second
    is_along_x = False
    for axis in (first, 1 - first):
        if is_along_x != (axis == 0):
            strip, is_along_x = strip.turned(wraps[first] and axis != first), axis == 0
        strip, periods[axis], bends[axis] = _joined(strip, size[axis], wraps[axis])
    return KeptLayout((strip.turned(False) if is_along_x else strip).source, (periods[0], periods[1]), any(bends))


def _joined(strip: PhotoStrip, length: int | None, wraps: bool) -> tuple[PhotoStrip, Jumps | None, bool]:
    """The strip as long as requested, its jumps (None if it is only cropped), and whether it was bent."""
    if not wraps and (length is None or length <= strip.length):
        at = 0 if length is None else (strip.length - length) // 2
        return strip.part(slice(at, strip.length if length is None else at + length)), None, False
    strip, levels, jumps = leveled_jumps(strip, length)
    bent = bent_jumps(strip, levels, jumps)
    strip, jumps = bent or (strip, jumps)
    return _tile(strip, jumps.lengths), jumps, bent is not None


def _tile(strip: PhotoStrip, jumps: tuple[int, ...]) -> PhotoStrip:
    """The strip joined at every jump."""
    joints = _joints(strip.length, jumps)
    packed = np.empty((sum(jumps), strip.width), np.uint32)
    origin = 0
    for before, joint in zip((joints[-1], *joints), joints, strict=False):
        # a piece begins after the rows of the joint before it, and ends before the rows of this one
        first, last = before.first + before.rows, joint.first + joint.jump
        rows = np.arange(first, last)
        packed[(origin + rows) % len(packed)] = strip.source.packed[rows]
        own = np.arange(joint.first, joint.first + joint.rows)
        pieces = strip.source.packed[own], strip.source.packed[own + joint.jump]
        packed[(origin + own + joint.jump) % len(packed)] = np.where(starts(strip, joint), *pieces)
        origin += joint.jump
    return PhotoStrip(SourceMap(packed), strip.closed, strip.values, strip.usable)


def _joints(length: int, jumps: tuple[int, ...]) -> list[Joint]:
    """Where each jump happens: anywhere for a single one; several in different parts, so that pieces differ."""
    joints = []
    for number, jump in enumerate(jumps):
        room = min(length - jump, max(1, min(jumps) - 1))  # joints do not overlap
        rows = room if len(jumps) == 1 else max(1, room // 2)
        first = (length - jump - rows) // 2 if len(jumps) == 1 else (room - rows) * (number % 2)
        joints.append(Joint(jump, first, rows))
    return joints
