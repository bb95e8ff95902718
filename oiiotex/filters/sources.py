# SPDX-License-Identifier: Apache-2.0
"""Which pixels of an exemplar a filter may take: by a mask, by a label at a level. Common to all that synthesize."""

from __future__ import annotations

import logging

import numpy as np

from ..color import as_float
from ..errors import ImageError, ParameterError
from ..images import Image, Part, channels_of, cropped, dtype_of
from ..op import Op
from ..tiles import bands
from ..windows import Window

log = logging.getLogger("oiiotex")

MASK = "where pixels may come from: above one half of the first channel's range; of ids: all but 0"
LABELS = "label maps of the exemplar, where they are not parts of it"
LABEL = "take only pixels of that label, by its id"
LEVEL = "which label map: label.N of the exemplar or of labels; the coarsest when left out"


def source_pixels(
    exemplar: Image, mask: Image | None, labels: Image | None, level: int | None, label: int | None
) -> np.ndarray | None:
    """Where pixels may come from: (height, width) bool, or None where nothing says it.

    Raises
    ------
    ImageError
        The mask or the map is of another size than the exemplar, or nothing is left.
    ParameterError
        There is no such level or label.
    """
    allowed = None
    if mask is not None:
        allowed = mask_pixels(laid_over(mask.first, exemplar, "mask"))
    if label is not None:
        part = label_part(exemplar, labels, level)
        ids = part.pixels()[..., 0]
        chosen = ids == label
        if not chosen.any():
            raise ParameterError(f"label={label}: {part.name} has no such label; its ids go from 1 to {ids.max()}")
        allowed = chosen if allowed is None else allowed & chosen
    elif level is not None or labels is not None:
        raise ParameterError("level and labels say where label is looked up: say label, too")
    if allowed is not None and not allowed.any():
        raise ImageError(f"the mask leaves no pixel of {exemplar.source}")
    return allowed


def label_parts(exemplar: Image, labels: Image | None = None) -> dict[int, Part]:
    """The label maps by level, 1 the finest: parts label.N of `labels` or of the exemplar, or the only part of ids.

    Raises
    ------
    ImageError
        There is none, or one is of another size than the exemplar.
    """
    holder = labels or exemplar
    found = {int(p.name[6:]): p for p in holder.parts if p.name.startswith("label.") and p.name[6:].isdecimal()}
    if not found and labels is not None and np.issubdtype(dtype_of(labels.first.spec), np.integer):
        found = {1: labels.first}
    if not found:
        raise ImageError(
            f"{holder.source} has no label parts: --texlabel:keep=1 makes them, labels= takes them from elsewhere"
        )
    return {level: fitting(found[level], exemplar, "labels") for level in sorted(found)}


def label_part(exemplar: Image, labels: Image | None, level: int | None) -> Part:
    """The label map of a level, the coarsest where it is None; raises as `label_parts` does, or ParameterError."""
    parts = label_parts(exemplar, labels)
    if level is None:
        return parts[max(parts)]
    if level not in parts:
        raise ParameterError(f"level={level}: there is {', '.join(map(str, parts))}")
    return parts[level]


def fitting(part: Part, exemplar: Image, name: str) -> Part:
    """The part, which must have as many pixels as the exemplar in both directions."""
    size, wanted = ((p.spec.width, p.spec.height) for p in (part, exemplar.first))
    if size != wanted:
        raise ImageError(f"{name} is {size[0]}x{size[1]}, the exemplar {wanted[0]}x{wanted[1]}: they must be alike")
    return part


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
        said = [str(w) if alike else f"{w.width}x{w.height}" for w in (mine, whole)]
        raise ImageError(
            f"{name} is {said[0]}, the exemplar {said[1]}: they must be alike, or in the same display window"
        )
    return cropped(part, whole)


def mask_pixels(part: Part) -> np.ndarray:
    """A mask as (height, width) bool."""
    channel = channels_of(part.spec).colour[0]
    found = np.concatenate([part.read(window)[..., channel] for window in bands(part)])
    ids = part.exact or found.dtype == np.uint32
    return found != 0 if ids else as_float(found) > 0.5


def both(opaque: np.ndarray | None, allowed: np.ndarray | None) -> np.ndarray | None:
    """Where both say yes; None: everywhere."""
    return opaque if allowed is None else allowed if opaque is None else opaque & allowed


def ruled_out(opaque: np.ndarray | None, allowed: np.ndarray | None) -> str:
    """What the pixels are that may not be used, for messages."""
    why = ["transparent pixels"] if opaque is not None or allowed is None else []
    return " and of ".join([*why, *(["pixels outside the mask or label"] if allowed is not None else [])])


def say_what_stays(op: Op) -> None:
    """Warn, in one line, of the exemplar's parts that do not come along; labels, masks and maps of ids are no loss."""
    exemplar: Image = getattr(op, op.images()[0].name)
    given = (getattr(op, i.attribute) for i in op.optional_images())
    used = {id(part) for image in given if image is not None for part in image.parts}
    lost = [p.name for p in exemplar.parts[1:] if not (p.exact or p.name.startswith("label.") or id(p) in used)]
    if lost:
        log.warning("%s: of %s only the first part is used, not %s", op.flag(), exemplar.source, ", ".join(lost))
