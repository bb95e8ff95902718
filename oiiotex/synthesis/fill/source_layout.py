# SPDX-License-Identifier: Apache-2.0
"""The pixels of another photo in the channels, the color space and the type of the photo that they fill."""

from __future__ import annotations

import logging

from ...engine.color.config import as_float
from ...engine.color.lab import lens_of
from ...engine.color.lens import Lens, in_type
from ...engine.core.access import mapped
from ...engine.core.image import Image, Part, dtype_of
from ...engine.core.op import Space
from ...engine.core.window import Window
from ...engine.deferred import np
from ...engine.session.resources import Resources

log = logging.getLogger("oiiotex")


def in_layout_of(photo: Image, source: Image, color: bool, resources: Resources) -> Part:
    """The first part of `source` with the channels, type and, if it is `color`, the color space of `photo`.

    Color of the same space and number of channels is copied; otherwise it is converted through Lab. A missing alpha is
    1. Other channels follow by name, and are 0 where the source has none of that name.
    """
    space = Space.LAB if color else Space.ANY
    mine, other = lens_of(photo, resources, space), lens_of(source, resources, space)
    spec, given = photo.first.spec, source.first.spec
    alike = len(mine.channels.color) == len(other.channels.color)
    alike &= (mine.channels.alpha is None) == (other.channels.alpha is None)
    alike &= mine.space == other.space or (
        mine.space is not None and other.space is not None and resources.color.same(mine.space, other.space)
    )
    pairs = _channels(spec.channelnames, given.channelnames, mine, other)
    lacking = [name for n, name in enumerate(spec.channelnames) if n not in pairs and n not in _named(mine)]
    if lacking:
        log.warning("%s has no channels %s: they are 0 in filled pixels", source.source, ", ".join(lacking))
    dtype = np.dtype(dtype_of(spec))

    def work(rows: np.ndarray, _: Window) -> np.ndarray:
        out = np.zeros((*rows.shape[:2], spec.nchannels), dtype)
        for n, from_n in pairs.items():
            out[..., n] = in_type(as_float(rows[..., from_n]), dtype)
        if mine.channels.alpha is not None and other.channels.alpha is None:
            out[..., mine.channels.alpha] = in_type(np.ones(1, np.float32), dtype)[0]
        if alike:
            for n, from_n in zip(mine.channels.color, other.channels.color, strict=True):
                out[..., n] = in_type(as_float(rows[..., from_n]), dtype)
            return out
        values, _opaque = other.values(rows)
        if other.channels.alpha is None:
            values[..., 3] = 1
        return mine.replaced(out, values, None)

    like = type(spec)(spec)
    like.x, like.y, like.width, like.height = given.x, given.y, given.width, given.height
    like.full_x, like.full_y, like.full_width, like.full_height = (
        given.full_x, given.full_y, given.full_width, given.full_height,
    )  # fmt: skip
    part = mapped(source.first, work, resources, like)
    return Part(photo.first.name, like, part.fetch, photo.first.stored)


def _named(lens: Lens) -> tuple[int, ...]:
    alpha = () if lens.channels.alpha is None else (lens.channels.alpha,)
    return (*lens.channels.color, *alpha)


def _channels(mine: tuple[str, ...], given: tuple[str, ...], own: Lens, other: Lens) -> dict[int, int]:
    """Channels that are copied: alpha, and all others than color by name."""
    first, second = own.channels.alpha, other.channels.alpha
    pairs = {} if first is None or second is None else {first: second}
    for n, name in enumerate(mine):
        if n not in _named(own) and name in given:
            pairs[n] = given.index(name)
    return pairs
