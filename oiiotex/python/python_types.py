# SPDX-License-Identifier: Apache-2.0
"""The types of arguments and results of the filters' functions."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
import OpenImageIO as oiio
from OpenImageIO import ROI, ImageBuf

from ..engine.errors import present
from ..engine.session import Session

FileName = str | os.PathLike[str]
Array = np.ndarray[Any, np.dtype[Any]]
"""(height, width) or (height, width, channels), top row first; the maximum of an integer type is 1.0."""
Picture = oiio.ImageBuf | Array
ImageLike = Picture | FileName | Mapping[str, Picture]
"""An image of one part, a file, or a dict of parts by name, as the functions return it."""

__all__ = [
    "ROI", "Array", "FileName", "ImageBuf", "ImageLike", "Literal", "Picture", "Sequence", "Session",
]  # fmt: skip


class ResultBuf(oiio.ImageBuf):
    """An ImageBuf that numpy, scikit-image and matplotlib take as an array."""

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        """Pixels of the data window in their own type: (height, width, channels), or (height, width) of one channel."""
        if copy is False:
            raise ValueError("the pixels of an ImageBuf are always copied")
        pixels = present(self.get_pixels(self.spec().format))
        if pixels.shape[2] == 1:
            pixels = pixels[..., 0]
        return pixels if dtype is None else pixels.astype(dtype)
