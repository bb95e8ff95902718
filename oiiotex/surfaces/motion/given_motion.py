# SPDX-License-Identifier: Apache-2.0
"""Motion from files: ST maps, or motion vectors that are chained from frame to frame."""

from __future__ import annotations

from ...engine.core.image import Part, dtype_of
from ...engine.deferred import np
from ...engine.errors import ImageError
from .frame_motion import STEP, FrameMotion, fitted, nodes


def of_st_map(part: Part, flip: bool, name: str) -> FrameMotion:
    """The motion of a frame from its ST map: for each pixel, its position in the reference frame, 0 to 1."""
    st = _sampled(part, ("s", "t"), name)
    if flip:
        st[..., 1] = 1 - st[..., 1]
    return fitted(nodes(part.spec.width, part.spec.height), st * (part.spec.width, part.spec.height), name)


def after(motion: FrameMotion, part: Part, convention: str, flip: bool, name: str) -> FrameMotion:
    """The motion of a frame from its vectors, px, and the motion of the frame that they lead to."""
    vectors = _sampled(part, (f"{convention}.u", f"{convention}.v"), name)
    if flip:
        vectors[..., 1] *= -1
    at = nodes(part.spec.width, part.spec.height)
    return fitted(at, motion.onto((at + vectors).reshape(-1, 2)).reshape(at.shape), name)


def _sampled(part: Part, channels: tuple[str, str], name: str) -> np.ndarray:
    """Two channels at the nodes of a frame, (rows, columns, 2) float64: those named, or the first two."""
    names = [one.lower() for one in part.spec.channelnames]
    which = [names.index(one) for one in channels] if set(channels) <= set(names) else [0, 1]
    if len(names) < 2 or dtype_of(part.spec) not in (np.float16, np.float32, np.float64):
        raise ImageError(f"{name} has {len(names)} channels of {part.spec.format}: expected two of float or half")
    values = part.pixels()[::STEP, ::STEP, which].astype(np.float64)
    if not np.isfinite(values).all():
        raise ImageError(f"{name} has NaN or Inf values: expected motion in every pixel")
    return values
