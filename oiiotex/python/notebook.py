# SPDX-License-Identifier: Apache-2.0
"""Results as pictures in Jupyter: an ImageBuf, or a dict or list of them, that a cell ends with."""

from __future__ import annotations

import base64
import html
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio

from ..analysis.labels.legend import colors_of
from ..engine.core.attributes import TAG
from ..engine.core.demand import resized
from ..engine.core.image import from_buffer
from ..engine.session import Session
from ..surfaces.charts.drawing import eight_bits, shown_pixels

SIDE = 512  # px, at most, of a picture


def register(shell: Any) -> None:
    """Have an IPython shell show results; what else it shows stays as it is."""
    formatters = shell.display_formatter.formatters
    formatters["image/png"].for_type(oiio.ImageBuf, png)
    for kind in (dict, list):
        formatters["text/html"].for_type(kind, figures)


def png(image: oiio.ImageBuf) -> bytes:
    """An image as an 8-bit sRGB PNG of at most `SIDE` px.

    Color is converted from the space that the image names. Labels get distinct colors. Data beyond
    0 to 1 is scaled to its range.
    """
    part, resources = from_buffer(image).first, Session().resources
    pixels = part.pixels()
    side = max(pixels.shape[:2])
    if pixels.dtype == np.uint32:
        step = -(-side // SIDE)
        shown = colors_of(pixels[::step, ::step, 0])
    else:
        step = max(1, side // (4 * SIDE))  # very large images are sampled before they are filtered
        pixels = pixels[::step, ::step]
        tag = part.spec.get_string_attribute(TAG)
        if pixels.dtype.kind == "f" and (not tag or resources.color.is_data(tag)):
            pixels = np.nan_to_num(pixels.astype(np.float32), posinf=0, neginf=0)
            least, most = min(0.0, pixels.min()), max(1.0, pixels.max())
            pixels = (pixels - least) / (most - least)
        share = min(1, SIDE / max(pixels.shape[:2]))
        height, width = (max(1, round(n * share)) for n in pixels.shape[:2])
        shown = resized(shown_pixels(pixels, part, resources).astype(np.float32), width, height)
    made = oiio.ImageBuf(oiio.ImageSpec(shown.shape[1], shown.shape[0], 3, oiio.UINT8))
    made.set_pixels(made.roi, np.ascontiguousarray(eight_bits(shown)))
    with tempfile.TemporaryDirectory() as folder:
        made.write(f"{folder}/shown.png")
        return Path(folder, "shown.png").read_bytes()


def figures(result: Any) -> str | None:
    """Parts by name, or several images, as HTML; None for anything else."""
    if not result or not all(isinstance(image, oiio.ImageBuf) for _, image in _named(result)):
        return None
    return "".join(
        '<figure style="display: inline-block; margin: 4px">'
        f'<img src="data:image/png;base64,{base64.b64encode(png(image)).decode()}">'
        f"<figcaption>{html.escape(name)}</figcaption></figure>"
        for name, image in _named(result)
    )


def _named(result: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    pairs = result.items() if isinstance(result, dict) else enumerate(result)
    for name, one in pairs:
        yield from _named(one, f"{prefix}{name} ") if isinstance(one, dict) else [(f"{prefix}{name}", one)]
