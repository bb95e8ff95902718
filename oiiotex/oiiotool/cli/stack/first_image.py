# SPDX-License-Identifier: Apache-2.0
"""Types of computed images, as the first image read sets them."""

from __future__ import annotations

from dataclasses import dataclass, field

from ....engine.core.image import Image, type_named
from ....engine.deferred import oiio


@dataclass
class First:
    """Spec, types and tiles of the first image read: defaults for writing computed images."""

    spec: oiio.ImageSpec | None = None
    pixel_type: oiio.TypeDesc | None = None
    channel_types: dict[str, oiio.TypeDesc] = field(default_factory=dict)
    bits: int = 0
    tile: tuple[int, int] | None = None

    def learn(self, image: Image) -> None:
        """Update from an image that has been read: a wider type replaces the former one."""
        for part in image.parts:
            self.spec = self.spec or part.spec
            own = part.stored or part.spec.format
            merged = own if self.pixel_type is None else merged_type(self.pixel_type, own)
            self.pixel_type = merged
            self.bits = self.bits or part.spec.get_int_attribute("oiio:BitsPerSample")
            if part.spec.tile_width:
                self.tile = self.tile or (part.spec.tile_width, part.spec.tile_height)
            prefix = part.spec.get_string_attribute("oiio:subimagename")
            if prefix:
                self.channel_types.setdefault(f"{prefix}.*", own)
            kinds = part.spec.channelformats or [own] * part.spec.nchannels
            for name, kind in zip(part.spec.channelnames, kinds, strict=True):
                self.channel_types.setdefault(f"{prefix}.{name}" if prefix else name, kind)


def merged_type(a: oiio.TypeDesc, b: oiio.TypeDesc) -> oiio.TypeDesc:
    """The type that holds the values of both, by oiiotool's rules."""
    order = ("uint8", "int8", "uint16", "int16", "half", "uint", "int", "float", "double")
    low, high = sorted((str(a), str(b)), key=order.index)
    if low in ("int8", "int16") and high in ("uint16", "half") and low != high:
        return oiio.TypeDesc("float") if high == "half" else oiio.TypeDesc("int")
    if low in ("uint16", "int16") and high == "half":
        return oiio.TypeDesc("float")
    return type_named(high)
