# SPDX-License-Identifier: Apache-2.0
"""Images in a color space that the tests of color make, and what the filters see of them."""

from __future__ import annotations

import warnings
from functools import cache
from types import ModuleType

import numpy as np
import OpenImageIO as oiio

from oiiotex.engine.color.config import TAG, ColorConfig
from oiiotex.engine.color.lab import working_values
from oiiotex.engine.core.image import Image, from_pixels
from oiiotex.engine.core.op import Space
from oiiotex.engine.session import Session

LINEAR = "lin_rec709_scene"
SRGB = "srgb_rec709_scene"
KINDS = {"B": "uint8", "b": "int8", "H": "uint16", "h": "int16", "I": "uint", "e": "half", "f": "float", "d": "double"}


@cache
def science() -> ModuleType:
    """colour-science, which takes a second to import: not for every process that collects tests."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it misses matplotlib
        import colour
    return colour


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
    return seen(image_of(pixels, names, space), config)[0]


def seen(image: Image, config: ColorConfig | None, autocc: bool = False) -> tuple[np.ndarray, np.ndarray | None]:
    """(values, opaque) as an op in Lab gets them; without a config, as one that was told that they are data."""
    resources = Session(autocc=autocc).resources
    if config is None:
        return working_values(image, resources, Space.DATA)
    resources.color = config
    return working_values(image, resources)
