# SPDX-License-Identifier: Apache-2.0
"""Warning about untagged normal maps that are about to be used as color."""

from __future__ import annotations

import logging
import os
import re

from ..core.attributes import TAG
from ..core.image import Image, Part, channels_of
from ..core.parameters import param
from ..core.window import Window
from ..deferred import np
from ..io.description import is_ours, is_tagged

log = logging.getLogger("oiiotex")

_ASSUMED = "srgb_rec709_scene"  # OpenImageIO's readers assume it for untagged files
FORMATS = {".png": "png", ".jpg": "jpeg", ".jpeg": "jpeg", ".tif": "tiff", ".tiff": "tiff", ".exr": "openexr"}
NORMALS = param(
    "opengl", choices=("opengl", "directx"), help="Green channel of the normals. opengl: up; directx: down."
)
_WORDS = {"normal", "normals", "normalmap", "nor", "nrm", "nml"}
_PIXELS = 1 << 16  # sample size: a normal map looks like one everywhere
_FEWEST = 64  # nonblack pixels; black ones, as around UV islands, do not count
_LENGTH = 0.1  # largest deviation of a normal's length from 1


def warn_of_normals(image: Image) -> bool:
    """Warn of an untagged file that looks like a normal map or is named like one; True if it did.

    A file tagged sRGB must both look like one and be named like one: OpenImageIO's tools tag every PNG as sRGB.
    """
    part = image.first
    if part.stored is None or not part.ready or is_ours(part.spec) or not os.path.isfile(image.source):
        return False
    format_name = FORMATS.get(os.path.splitext(image.source)[1].lower(), "")
    if part.spec.get_string_attribute(TAG) != _ASSUMED:
        return False
    named, alike = named_as_normals(image.source), looks_like_normals(part)
    tagged = is_tagged(part.spec, format_name, image.source)
    if not (named and alike if tagged else named or alike):
        return False
    log.warning(
        "%s %s a normal map, but %s and is used as sRGB color: add data=1 to use it as data, or --iscolorspace sRGB"
        " after it to confirm", image.source, "looks like" if alike else "is named like",
        "is tagged sRGB" if tagged else "has no color space tag",
    )  # fmt: skip
    return True


def named_as_normals(path: str) -> bool:
    """Whether a file name contains one of the words normal, nor, nrm and so on, or n after another word."""
    stem = os.path.splitext(os.path.basename(path))[0]
    words = [word.lower() for word in re.findall(r"[A-Z]?[a-z]+[0-9]*|[A-Z]+[0-9]*", stem)]
    return "n" in words[1:] or any(word.rstrip("0123456789") in _WORDS for word in words)


def looks_like_normals(part: Part) -> bool:
    """Whether the colors of the first rows, decoded from 0 to 1, are vectors of length 1 that point up."""
    color, whole = channels_of(part.spec).color, part.window
    if len(color) != 3:
        return False
    rows = max(1, _PIXELS // whole.width)
    pixels = part.read(Window(whole.left, whole.top, whole.right, min(whole.bottom, whole.top + rows)))
    largest = np.iinfo(pixels.dtype).max if pixels.dtype.kind in "ui" else 1
    values = pixels[..., list(color)].reshape(-1, 3).astype(np.float32) / np.float32(largest)
    values = values[values.any(axis=-1)]
    if len(values) < _FEWEST:
        return False
    vectors = 2 * values - 1
    near = np.abs(np.linalg.norm(vectors, axis=-1) - 1) < _LENGTH
    return bool(near.mean() > 0.95 and vectors[:, 2].mean() > 0.5)
