# SPDX-License-Identifier: Apache-2.0
"""Images in messages: facts of parts as JSON, pixels as arrays."""

from __future__ import annotations

from typing import Any

from ...engine.core.image import Image, Part, from_pixels
from ...engine.core.window import Window
from ...engine.deferred import np, oiio

_PLACE = ("x", "y", "width", "height", "full_x", "full_y", "full_width", "full_height")


def facts_of(part: Part) -> dict[str, Any]:
    """The facts of a part: everything but its pixels."""
    spec = part.spec
    return {
        "name": part.name,
        "place": [getattr(spec, name) for name in _PLACE],
        "type": str(spec.format),
        "channels": list(spec.channelnames),
        "alpha": spec.alpha_channel,
        "stored": None if part.stored is None else str(part.stored),
        "exact": part.exact,
        "attributes": [[a.name, str(a.type), a.value] for a in spec.extra_attribs if _is_plain(a.value)],
    }


def image_facts(image: Image) -> dict[str, Any]:
    """The facts of an image and all its parts."""
    return {"source": image.source, "parts": [facts_of(part) for part in image.parts]}


def image_of(facts: dict[str, Any], arrays: list[np.ndarray]) -> Image:
    """The image with these facts, and the pixels of its parts, (height, width, channels) each."""
    parts = []
    for one, pixels in zip(facts["parts"], arrays, strict=True):
        spec = spec_of(one)
        if pixels.shape != (spec.height, spec.width, spec.nchannels):
            raise ValueError(pixels.shape)
        stored = None if one["stored"] is None else oiio.TypeDesc(one["stored"])
        part = from_pixels(str(one["name"]), pixels, spec, stored)
        object.__setattr__(part, "exact", bool(one["exact"]))
        parts.append(part)
    return Image(tuple(parts), str(facts["source"]))


def window_of(numbers: list[int] | None, part: Part) -> Window:
    """The window in a message, clipped to the part's data window; None means the data window."""
    return part.window if numbers is None else Window(*map(int, numbers)) & part.window


def spec_of(facts: dict[str, Any]) -> oiio.ImageSpec:
    """The spec described by the facts of a part."""
    names = tuple(map(str, facts["channels"]))
    spec = oiio.ImageSpec(1, 1, len(names), oiio.TypeDesc(facts["type"]))
    for name, value in zip(_PLACE, facts["place"], strict=True):
        setattr(spec, name, int(value))
    spec.channelnames, spec.alpha_channel = names, int(facts["alpha"])
    for name, kind, value in facts["attributes"]:
        spec.attribute(name, oiio.TypeDesc(kind), tuple(value) if isinstance(value, list) else value)
    return spec


def _is_plain(value: Any) -> bool:
    """Whether JSON can hold an attribute; byte arrays, such as ICC profiles, are omitted."""
    return isinstance(value, (int, float, str)) or (
        isinstance(value, tuple) and all(isinstance(one, (int, float, str)) for one in value)
    )
