# SPDX-License-Identifier: Apache-2.0
"""oiiotool's ops through ImageBufAlgo: `OPS` has them all. In Python, call ImageBufAlgo itself."""

from __future__ import annotations

import itertools
from typing import Any

from ...engine.deferred import Shelf

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
            "arithmetic", "COMPOSITING", "Compositing of flat and deep images, and premultiplication",
            "over zover premult unpremult repremult deepen flatten deepmerge deepholdout",
        ),
        (
            "channels", "CHANNELS", "Channels: selecting, naming, summing, color maps",
            "ch nchannels chappend chnames chsum maxchan minchan colormap",
        ),
        (
            "color", "COLOR", "Color management (OpenColorIO)",
            "iscolorspace tocolorspace colorconvert ccmatrix ociolook ociodisplay ociofiletransform ocionamedtransform",
        ),
        ("mattes", "CRYPTOMATTE", "Cryptomatte", "cryptomatte-colors cryptomatte-unfold"),
        (
            "metadata", "METADATA", "Metadata, orientation, data and display windows",
            "attrib sattrib eraseattrib caption keyword clear-keywords orientation orientcw rotcw orientccw"
            " rotccw orient180 rot180 origin originoffset fullsize fullpixels cicp iccread pastemeta",
        ),
        (
            "spatial.placing", "CROPPING", "Crop, cut, paste, mosaic",
            "crop croptofull cut trim paste mosaic",
        ),
        (
            "spatial.placing", "TURNING", "Flip, rotate by quarter turns, shift",
            "flip flop rotate180 flipflop rotate90 rotate270 transpose reorient cshift",
        ),
        ("spatial.scaling", "SCALING", "Resize", "resize resample fit pixelaspect"),
        (
            "spatial.warping", "WARPING",
            "Warp and rotate by any angle",
            "warp rotate st_warp",
        ),
        (
            "spatial.filtering", "FILTERING", "Filters",
            "blur convolve median dilate erode unsharp laplacian fillholes fft ifft decorrstretch demosaic",
        ),
        ("drawing", "DRAWING", "Drawing", "box line point text fill"),
        ("drawing", "PATTERNS", "Generators", "create pattern kernel"),
    )
)  # fmt: skip


def __getattr__(name: str) -> Any:
    """`OPS`: all ops, in the order of help."""
    if name == "OPS":
        return tuple(itertools.chain.from_iterable(shelf.declarations for shelf in SHELVES))
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
