# SPDX-License-Identifier: Apache-2.0
"""The host's own ops, through ImageBufAlgo: `OPS` lists them. In Python, ImageBufAlgo itself serves as well."""

from ..op import Op
from . import arithmetic, filtering, geometry

OPS: tuple[type[Op], ...] = (*arithmetic.OPS, *geometry.OPS, *filtering.OPS)
