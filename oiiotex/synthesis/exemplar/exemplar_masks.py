# SPDX-License-Identifier: Apache-2.0
"""Masks and label maps of an exemplar, aligned with its pixels."""

from __future__ import annotations

from ...engine.color.config import as_float
from ...engine.core.demand import bands
from ...engine.core.image import Image, Part, channels_of, cropped, from_pixels, spec_beside
from ...engine.core.label_map import LabelMap, holds_ids, label_maps, opened_level
from ...engine.core.window import Window
from ...engine.deferred import np, oiio
from ...engine.errors import ImageError, ParameterError, texture_filter


def masked_pixels(mask: Image, exemplar: Image, name: str = "the exemplar") -> np.ndarray:
    """The valid source pixels of a mask, (height, width) bool; raises ImageError if there are none."""
    allowed = mask_pixels(laid_over(mask.first, exemplar, "mask", name))
    if not allowed.any():
        raise ImageError(f"mask selects no pixel of {exemplar.source}: expected values above half its range")
    return allowed


def label_levels(exemplar: Image) -> dict[int, LabelMap]:
    """Label maps by level, 1 the finest: the exemplar's parts label.N, or its only part of ids."""
    levels, ids = label_maps(exemplar), [part for part in exemplar.parts if holds_ids(part)]
    if not levels and len(ids) == 1:
        levels = {1: LabelMap(ids[0], 1)}
    if not levels:
        raise ImageError(
            "has no label parts",
            subject=exemplar.source,
            hint=f"create them with {texture_filter('label', photo=True)}, or append parts label.N",
        )
    for one in levels.values():
        size, wanted = ((p.spec.width, p.spec.height) for p in (one.part, exemplar.first))
        if size != wanted:
            sizes = f"{size[0]}x{size[1]}, but the exemplar is {wanted[0]}x{wanted[1]}"
            raise ImageError(f"{one.part.name} is {sizes}: sizes must match")
    return levels


def label_map(exemplar: Image, level: int | None) -> LabelMap:
    """The label map of a level, by default `opened_level`; raises as `label_levels` does, or ParameterError."""
    levels = label_levels(exemplar)
    level = opened_level(levels) if level is None else level
    if level not in levels:
        raise ParameterError(parameter="labellevel", value=level, expected=f"one of {', '.join(map(str, levels))}")
    return levels[level]


def laid_over(part: Part, exemplar: Image, name: str, whole_name: str = "the exemplar") -> Part:
    """The part, aligned with the exemplar's data window. The names are for messages.

    A part of the exemplar's size and origin (or at 0,0, for formats without windows) is used pixel for pixel. Any other
    part must have the exemplar's display window and is black outside its data window, as in cropped mattes.
    """
    mine, whole = part.window, exemplar.first.window
    alike = (mine.width, mine.height) == (whole.width, whole.height)
    if alike and (mine.left, mine.top) in ((whole.left, whole.top), (0, 0)):
        return part
    if Window.display(part.spec) != Window.display(exemplar.first.spec):
        sizes = [str(w) if alike else f"{w.width}x{w.height}" for w in (mine, whole)]
        raise ImageError(
            f"{name} is {sizes[0]}, but {whole_name} is {sizes[1]}: expected the same size, or the same display window"
        )
    return cropped(part, whole)


def mask_pixels(part: Part) -> np.ndarray:
    """A mask as (height, width) bool."""
    channel, inside = channels_of(part.spec).first, []
    for window in bands(part):
        values = part.read(window)[..., channel]
        inside.append(values != 0 if part.exact or values.dtype == np.uint32 else as_float(values) > 0.5)
    return np.concatenate(inside)


def mask_of(allowed: np.ndarray, photo: Part) -> Image:
    """Valid source pixels of a photo, (height, width) bool, as a mask over it."""
    spec = spec_beside(photo.spec, ("Y",))
    spec.set_format(oiio.TypeDesc(oiio.UINT8))
    return Image((from_pixels("mask", np.uint8(255) * allowed[..., None], spec),), "mask")


def labeled_pixels(labels: LabelMap, label: int, parameter: str = "label") -> np.ndarray:
    """The pixels of a label, (height, width) bool; raises ParameterError if the map does not contain it."""
    inside, most = [], 0
    for window in bands(labels.part):
        ids = labels.part.read(window)[..., 0]
        most = max(most, int(ids.max()))
        inside.append(ids == label)
    if not any(one.any() for one in inside):
        raise ParameterError(f"not in {labels.part.name}, whose ids are 1 to {most}", parameter=parameter, value=label)
    return np.concatenate(inside)


def both(opaque: np.ndarray | None, allowed: np.ndarray | None) -> np.ndarray | None:
    """Intersection of two masks; None stands for all pixels."""
    return opaque if allowed is None else allowed if opaque is None else opaque & allowed
