# SPDX-License-Identifier: Apache-2.0
"""Maps of normals that are about to be taken for colors, because their file does not say what it holds."""

from __future__ import annotations

import logging
import os
import re

from ..core.attributes import TAG
from ..core.image import Image, Part, channels_of
from ..core.window import Window
from ..deferred import np
from ..io.description import is_ours, is_tagged

log = logging.getLogger("oiiotex")

_ASSUMED = "srgb_rec709_scene"  # by OpenImageIO's readers where a file says nothing
_FORMATS = {".png": "png", ".jpg": "jpeg", ".jpeg": "jpeg", ".tif": "tiff", ".tiff": "tiff", ".exr": "openexr"}
_WORDS = {"normal", "normals", "normalmap", "nor", "nrm", "nml"}
_PIXELS = 1 << 16  # that are looked at: a map of normals looks like one everywhere
_FEWEST = 64  # black ones, as around UV islands, say nothing
_LENGTH = 0.1  # by how far one may be off 1, of most


def warn_of_normals(image: Image) -> bool:
    """Warn of a file without a color space of its own that looks like normals or is named so; True where it did.

    Of one that says sRGB, where it looks like them and is named so: OpenImageIO's tools say it of every PNG they write.
    """
    part = image.first
    if part.stored is None or not part.ready or is_ours(part.spec) or not os.path.isfile(image.source):
        return False
    format_name = _FORMATS.get(os.path.splitext(image.source)[1].lower(), "")
    if part.spec.get_string_attribute(TAG) != _ASSUMED:
        return False
    named, alike = named_as_normals(image.source), looks_like_normals(part)
    tagged = is_tagged(part.spec, format_name, image.source)
    if not (named and alike if tagged else named or alike):
        return False
    log.warning(
        "%s %s a normal map, says %s and is taken for sRGB colors: data=1 takes it as data, --iscolorspace sRGB behind"
        " it says that they are colors", image.source, "looks like" if alike else "is named like",
        "sRGB" if tagged else "no color space",
    )  # fmt: skip
    return True


def named_as_normals(path: str) -> bool:
    """Whether a file's name has one of the words normal, nor, nrm ..., or n behind another."""
    stem = os.path.splitext(os.path.basename(path))[0]
    words = [word.lower() for word in re.findall(r"[A-Z]?[a-z]+[0-9]*|[A-Z]+[0-9]*", stem)]
    return "n" in words[1:] or any(word.rstrip("0123456789") in _WORDS for word in words)


def looks_like_normals(part: Part) -> bool:
    """Whether colors, decoded from 0 .. 1, are vectors of length 1 that point up, in the first rows."""
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
