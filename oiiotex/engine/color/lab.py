# SPDX-License-Identifier: Apache-2.0
"""The lens of an op for an image, by the working space that the op declares: CIE Lab D65 or data.

`working_values` converts a whole image.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

from ..core.image import Image, Part, channels_of
from ..core.op import Op, Space
from ..core.parameters import param
from ..core.scratch import RowStore, empty_rows
from ..core.window import Window
from ..deferred import np
from ..scan import scan
from ..session.facts import Facts
from ..session.resources import Resources
from .config import color_space
from .lens import Lens

DATA = "Use the channels as data, without conversion to CIE Lab."


def lens_of(image: Image, resources: Resources, space: Space = Space.LAB) -> Lens:
    """The lens of the image's first part for an op that works in `space`.

    Parameters
    ----------
    image : Image
        Gray, gray + alpha, RGB, RGBA, with any further channels.
    space : Space
        From `Op.working_space`. For an image in a data space, LAB is the same as DATA: the common range of its
        channels is mapped to 0 to 100, so that distances have the scale of Lab. Finding that range takes one pass
        over the image.

    Raises
    ------
    ImageError
        NaN or Inf in data or their alpha, or a wrong number of color channels.
    ColorError
        As by `config.space_of`.
    """
    named = color_to_convert(image, resources, space)
    if named is not None:
        return lens_for(image, resources, named)
    plain = Lens(image.source, channels_of(image.first.spec))
    return plain if space is Space.ANY else _scaled(plain, image.first, resources)


def color_to_convert(image: Image, facts: Facts, space: Space) -> str | None:
    """The image's color space if an op that works in `space` converts it to Lab, else None; reads no pixel.

    Raises
    ------
    ImageError, ColorError
        As by `config.color_space`.
    """
    return color_space(image, facts.color, facts.settings.autocc) if space is Space.LAB else None


def lens_for(image: Image, facts: Facts, space: str) -> Lens:
    """The lens from an image of this color space to Lab."""
    config = facts.color
    return Lens(image.source, channels_of(image.first.spec), space, config.to_lab(space), config.from_lab(space))


def _scaled(plain: Lens, part: Part, resources: Resources) -> Lens:
    """The lens for data, scaled by the range of the opaque pixels."""
    limits: list[tuple[float, float]] = []

    def look(values: np.ndarray, opaque: np.ndarray | None, _: Window) -> tuple[float, float] | None:
        seen = values[..., : plain.count]
        seen = seen if opaque is None else seen[opaque]
        return (float(seen.min()), float(seen.max())) if seen.size else None

    def keep(_: Window, limit: tuple[float, float] | None) -> None:
        limits.extend([] if limit is None else [limit])

    scan(part, plain, resources, look, keep)
    if not limits:
        return plain
    low, high = min(low for low, _ in limits), max(high for _, high in limits)
    return replace(plain, low=low, scale=100.0 / max(high - low, 1e-12))


def working_values(
    image: Image, resources: Resources, space: Space = Space.LAB, in_memory: bool = True
) -> tuple[np.ndarray | RowStore, np.ndarray | None]:
    """The image's whole first part in the working space of an op.

    Returns
    -------
    values : (height, width, 3) float32
        Lab (L 0 to 100 for diffuse white, a, b), or data scaled to 0 to 100; with `in_memory` an array.
    opaque : (height, width) bool or None
        Where alpha is not 0; None: everywhere.

    Raises
    ------
    ImageError, ColorError
        As by `lens_of`; NaN or Inf in color or alpha.
    """
    part, lens = image.first, lens_of(image, resources, space)
    values = empty_rows((part.spec.height, part.spec.width, 3), np.float32, in_memory)
    opaque = np.ones(values.shape[:2], bool)

    def keep(piece: Window, seen: tuple[np.ndarray, np.ndarray | None]) -> None:
        at = piece.inside(part.window)
        values[at[0]] = seen[0][..., :3]
        if seen[1] is not None:
            opaque[at] = seen[1]

    scan(part, lens, resources, lambda seen, opaque, _: (seen, opaque), keep)
    return values, None if opaque.all() else opaque


@dataclass(frozen=True, kw_only=True)
class InLab(Op):
    """An op that works in CIE Lab, or with `data` on the channels without conversion."""

    space: ClassVar[Space] = Space.LAB

    data: bool = param(False, help=DATA)
