# SPDX-License-Identifier: Apache-2.0
"""Images in a colour space that the tests of colour make, and what the filters see of them."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio

from oiiotex.color import TAG, ColorConfig, working_values
from oiiotex.images import Image, from_pixels

LINEAR = "lin_rec709_scene"
SRGB = "srgb_rec709_scene"
KINDS = {"B": "uint8", "b": "int8", "H": "uint16", "h": "int16", "I": "uint", "e": "half", "f": "float", "d": "double"}


def image_of(pixels, names: str | tuple[str, ...] = "RGB", space: str = "", source: str = "photo.exr") -> Image:
    """(h, w, c) pixels with channels of these names; 'A' is alpha."""
    pixels = np.asarray(pixels)
    height, width, channels = pixels.shape
    spec = oiio.ImageSpec(width, height, channels, oiio.TypeDesc(KINDS[pixels.dtype.char]))
    spec.channelnames = tuple(names)
    spec.alpha_channel = names.index("A") if "A" in names else -1
    if space:
        spec.attribute(TAG, space)
    return Image((from_pixels("part0", pixels, spec),), source)


def lab(pixels, config: ColorConfig, names: str | tuple[str, ...] = "RGB", space: str = LINEAR) -> np.ndarray:
    return working_values(image_of(pixels, names, space), config).values
