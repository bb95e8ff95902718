# SPDX-License-Identifier: Apache-2.0
"""Masks and label maps of an exemplar, laid over it."""

from __future__ import annotations

from ..color.config import as_float
from ..core.demand import bands
from ..core.image import Image, Part, channels_of, cropped, dtype_of
from ..core.label_map import LabelMap, holds_ids, label_maps
from ..core.window import Window
from ..deferred import np
from ..errors import ImageError, ParameterError, texture_filter


def masked_pixels(mask: Image, exemplar: Image) -> np.ndarray:
    """Where a mask lets pixels be taken from: (height, width) bool, not nowhere."""
    allowed = mask_pixels(laid_over(mask.first, exemplar, "mask"))
    if not allowed.any():
        raise ImageError(f"the mask leaves no pixel of {exemplar.source}")
    return allowed


def label_levels(exemplar: Image, labels: Image | None = None) -> dict[int, LabelMap]:
    """The label maps by level, 1 the finest: parts label.N of `labels` or of the exemplar, or the only part of ids."""
    holder = labels or exemplar
    levels = label_maps(holder)
    whole_numbers = np.issubdtype(dtype_of(holder.first.spec), np.integer)
    if not levels and (holds_ids(holder.first) or (labels is not None and whole_numbers)):
        levels = {1: LabelMap(holder.first, 1)}
    if not levels:
        raise ImageError(
            f"has no label parts: {texture_filter('label', keep=True)} makes them, labels= takes them from elsewhere",
            subject=holder.source,
        )
    for one in levels.values():
        size, wanted = ((p.spec.width, p.spec.height) for p in (one.part, exemplar.first))
        if size != wanted:
            raise ImageError(f"labels is {size[0]}x{size[1]}, the exemplar {wanted[0]}x{wanted[1]}: they must be alike")
    return levels


def label_map(exemplar: Image, labels: Image | None, level: int | None) -> LabelMap:
    """The label map of a level, the coarsest where it is None; raises as `label_levels` does, or ParameterError."""
    levels = label_levels(exemplar, labels)
    level = max(levels) if level is None else level
    if level not in levels:
        raise ParameterError(f"level={level}: there is {', '.join(map(str, levels))}")
    return levels[level]


def laid_over(part: Part, exemplar: Image, name: str) -> Part:
    """The part where the exemplar's pixels are.

    One of the exemplar's size that begins at the same place, or at 0 as formats without windows have it, lies over it
    pixel for pixel. Another must be in the exemplar's display window, and is black beyond its own data window: so do
    compositors crop mattes.
    """
    mine, whole = part.window, exemplar.first.window
    alike = (mine.width, mine.height) == (whole.width, whole.height)
    if alike and (mine.left, mine.top) in ((whole.left, whole.top), (0, 0)):
        return part
    if Window.display(part.spec) != Window.display(exemplar.first.spec):
        sizes = [str(w) if alike else f"{w.width}x{w.height}" for w in (mine, whole)]
        raise ImageError(
            f"{name} is {sizes[0]}, the exemplar {sizes[1]}: they must be alike, or in the same display window"
        )
    return cropped(part, whole)


def mask_pixels(part: Part) -> np.ndarray:
    """A mask as (height, width) bool."""
    channel, inside = channels_of(part.spec).color[0], []
    for window in bands(part):
        values = part.read(window)[..., channel]
        inside.append(values != 0 if part.exact or values.dtype == np.uint32 else as_float(values) > 0.5)
    return np.concatenate(inside)


def labeled_pixels(labels: LabelMap, label: int) -> np.ndarray:
    """Where a map has that label: (height, width) bool, not nowhere."""
    inside, most = [], 0
    for window in bands(labels.part):
        ids = labels.part.read(window)[..., 0]
        most = max(most, int(ids.max()))
        inside.append(ids == label)
    if not any(one.any() for one in inside):
        raise ParameterError(f"label={label}: {labels.part.name} has no such label; its ids go from 1 to {most}")
    return np.concatenate(inside)


def both(opaque: np.ndarray | None, allowed: np.ndarray | None) -> np.ndarray | None:
    """Where both say yes; None: everywhere."""
    return opaque if allowed is None else allowed if opaque is None else opaque & allowed
