# SPDX-License-Identifier: Apache-2.0
"""Converts Blender images to pixels and back."""

from __future__ import annotations

import bpy
import numpy as np

SPACES = {"sRGB": "srgb_rec709_scene", "Linear Rec.709": "lin_rec709_scene", "Non-Color": None}
LINE = "oiiotex"  # custom property of a result: its command
SOURCE = "oiiotex_source"  # and the name of its first input


def name_of_space(image) -> str:
    """The color space of `image.pixels`; Blender keeps float images scene-linear."""
    name = image.colorspace_settings.name
    return "Linear Rec.709" if image.is_float and name != "Non-Color" else name


def pixels_of(image) -> np.ndarray:
    """Pixels of an image, (height, width, channels), top row first: float32, or uint8 for an 8-bit image."""
    pixels = np.empty(image.size[0] * image.size[1] * image.channels, np.float32)
    image.pixels.foreach_get(pixels)
    pixels = np.ascontiguousarray(pixels.reshape(image.size[1], image.size[0], image.channels)[::-1])
    # 8-bit values give the same decisions as the file itself
    return pixels if image.is_float else np.rint(pixels * 255).astype(np.uint8)


def new_image(name: str, pixels: np.ndarray, line: str, like=None):
    """Create an image packed into the .blend file.

    Parameters
    ----------
    name : str
    pixels : (height, width, 1, 3 or 4) float or uint8
        Pixels, top row first.
    line : str
        The command that reproduces it.
    like : bpy.types.Image, optional
        Image to copy color space and depth from. Default: float data.
    """
    height, width, channels = pixels.shape
    full = np.ones((height, width, 4), np.float32)
    full[..., : max(3, channels)] = pixels / np.float32(255) if pixels.dtype == np.uint8 else pixels
    image = bpy.data.images.new(name, width, height, alpha=True, float_buffer=like is None or like.is_float)
    image.colorspace_settings.name = "Non-Color" if like is None else like.colorspace_settings.name
    image.pixels.foreach_set(full[::-1].ravel())  # Blender stores the bottom row first
    image.update()
    image.pack()
    image[LINE] = line
    if like is not None:
        image[SOURCE] = like.name
    return image
