# SPDX-License-Identifier: Apache-2.0
"""The pixels to replace: from a mask, a label map or a Cryptomatte."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...engine.core.window import Window
from ...engine.deferred import np
from ...engine.errors import ImageError, ParameterError, present
from ...engine.io.cryptomatte import coverage_of, matte_channels
from ..exemplar.exemplar_masks import label_map, labeled_pixels, laid_over, mask_pixels

if TYPE_CHECKING:
    from ...engine.core.image import Image


def require_region(photo: Image, region: Image | None, label: int | None, level: int | None, matte: str | None) -> None:
    """Refuse what `marked_pixels` would refuse whatever the pixels are."""
    if label is not None:
        label_map(photo, level)
    elif matte is not None:
        return  # pixels tell whether the photo has it
    elif region is None:
        raise ImageError("requires a region: an image that marks the pixels to replace, replace= or matte=")
    else:
        laid_over(region.first, photo, "region")


def marked_pixels(
    photo: Image, region: Image | None, replaced: int | None, level: int | None, matte: str | None
) -> np.ndarray:
    """The pixels to replace, (height, width) bool, from exactly one of `region`, `replaced` (a label) and `matte`.

    Raises
    ------
    ImageError
        Sizes differ, or there is no label map or Cryptomatte.
    ParameterError
        No pixel has the label, or the matte covers none.
    """
    if replaced is not None:
        return labeled_pixels(label_map(photo, level), replaced, "replace")
    if matte is not None:
        if not any(matte_channels(part.spec) for part in photo.parts):
            hint = "append the parts of the file that has them (--siappend)"
            raise ImageError("has no Cryptomatte channels", subject=photo.source, hint=hint)
        window = photo.first.window
        covered = np.zeros((window.height, window.width), bool)
        own, coverage = coverage_of(photo, matte)
        own = own if Window(0, 0, *own.size) != own or own.size != window.size else window
        shared = own & window
        covered[shared.inside(window)] = coverage[shared.inside(own)] > 0
        if not covered.any():
            raise ParameterError("covers no pixel of the photo", parameter="matte", value=matte)
        return covered
    return mask_pixels(laid_over(present(region).first, photo, "region"))


def surroundings(marked: np.ndarray, reach: int, wraps: tuple[bool, bool] = (False, False)) -> Window:
    """The marked pixels and `reach` px around them, at (0, 0) of the array; all of an axis that wraps (x, y)."""
    ends = []
    for axis, wrapped in enumerate(wraps):
        hit, n = np.flatnonzero(marked.any(axis)), marked.shape[1 - axis]
        ends.append((0, n) if wrapped else (max(0, int(hit[0]) - reach), min(n, int(hit[-1]) + 1 + reach)))
    (left, right), (top, bottom) = ends
    return Window(left, top, right, bottom)
