# SPDX-License-Identifier: Apache-2.0
"""The host's own ops, through ImageBufAlgo: `OPS` has them all. In Python, ImageBufAlgo itself serves as well."""

from __future__ import annotations

import itertools
from typing import Any

from ..deferred import Shelf

SHELVES = tuple(
    Shelf(heading, f"{__name__}.{module}", tuple(f"--{name}" for name in names.split()), attribute)
    for module, attribute, heading, names in (
        (
            "arithmetic", "ARITHMETIC", "Arithmetic on pixels",
            "add sub mul div scale absdiff min max mad addc cadd subc csub mulc cmul divc absdiffc powc cpow maxc"
            " minc abs invert polar unpolar",
        ),
        (
            "ranges", "RANGES", "Ranges of values: contrast, clamping, noise, repair",
            "clamp contrast saturate rangecompress rangeexpand normalize noise fixnan",
        ),
        (
            "arithmetic", "COMPOSITING", "Compositing of flat and of deep images, and colors by alpha",
            "over zover premult unpremult repremult deepen flatten deepmerge deepholdout",
        ),
        (
            "channels", "CHANNELS", "Channels: choosing, naming, summing, mapping",
            "ch nchannels chappend chnames chsum maxchan minchan colormap",
        ),
        (
            "color", "COLOR", "Color management, by OpenColorIO inside OpenImageIO",
            "iscolorspace tocolorspace colorconvert ccmatrix ociolook ociodisplay ociofiletransform ocionamedtransform",
        ),
        ("channels", "CRYPTOMATTE", "Cryptomatte", "cryptomatte-colors"),
        (
            "metadata", "METADATA", "Metadata, and windows without pixels",
            "attrib sattrib eraseattrib caption keyword clear-keywords orientation orientcw rotcw orientccw"
            " rotccw orient180 rot180 origin originoffset fullsize fullpixels cicp iccread pastemeta",
        ),
        (
            "spatial.placing", "CROPPING", "Ops on windows: crops, cuts, pastes, mosaics",
            "crop croptofull cut trim paste mosaic",
        ),
        (
            "spatial.placing", "TURNING", "Ops that turn the image over or move its pixels round",
            "flip flop rotate180 flipflop rotate90 rotate270 transpose reorient cshift",
        ),
        ("spatial.scaling", "SCALING", "Ops that change the size", "resize resample fit pixelaspect"),
        (
            "spatial.warping", "WARPING",
            "Ops that resample at slanted or arbitrary places, and what they share with the scalings",
            "warp rotate st_warp",
        ),
        (
            "spatial.filtering", "FILTERING", "Filters that look at a neighborhood, or at all of the image",
            "blur convolve median dilate erode unsharp laplacian fillholes fft ifft decorrstretch demosaic",
        ),
        ("drawing", "DRAWING", "Ops that draw on a copy of the image", "box line point text fill"),
        ("drawing", "PATTERNS", "Images out of nothing", "create pattern kernel"),
    )
)  # fmt: skip


def __getattr__(name: str) -> Any:
    """`OPS`: all of them, in the order of help."""
    if name == "OPS":
        return tuple(itertools.chain.from_iterable(shelf.declarations for shelf in SHELVES))
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
