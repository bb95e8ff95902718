# SPDX-License-Identifier: Apache-2.0
"""The host's own ops, through ImageBufAlgo: `OPS` lists them. In Python, ImageBufAlgo itself serves as well."""

from ..op import Op
from . import (
    arithmetic,
    channels,
    color,
    compositing,
    cropping,
    cryptomatte,
    drawing,
    filtering,
    metadata,
    patterns,
    ranges,
    scaling,
    turning,
    warping,
)

OPS: tuple[type[Op], ...] = (
    *arithmetic.OPS,
    *ranges.OPS,
    *compositing.OPS,
    *channels.OPS,
    *color.OPS,
    *cryptomatte.OPS,
    *metadata.OPS,
    *cropping.OPS,
    *turning.OPS,
    *scaling.OPS,
    *warping.OPS,
    *filtering.OPS,
    *drawing.OPS,
    *patterns.OPS,
)
