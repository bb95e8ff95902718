# SPDX-License-Identifier: Apache-2.0
"""The public API for filters of other packages.

`docs/how-to/your_own_filter.md` uses nothing else. Other modules may change between versions.
"""

from .engine.color.config import as_float
from .engine.color.lab import color_to_convert, lens_of, working_values
from .engine.color.lens import Lens, in_type
from .engine.core.access import AnyWindow, Gather, Neighborhood, Pointwise, ScanThenMap, Whole
from .engine.core.image import Image, Part, derived_spec, from_pixels, spec_beside
from .engine.core.op import Kind, Output, Plan, Space
from .engine.core.parameters import Numbers, Size, Words, argument, image, param
from .engine.core.window import Window
from .engine.errors import ColorError, DeviceError, Error, ImageError, ParameterError
from .engine.scan import scan
from .engine.session import Session
from .engine.session.facts import Facts
from .engine.session.resources import Resources

__all__ = [
    "AnyWindow", "ColorError", "DeviceError", "Error", "Facts", "Gather", "Image", "ImageError", "Kind", "Lens",
    "Neighborhood", "Numbers", "Output", "ParameterError", "Part", "Plan", "Pointwise", "Resources", "ScanThenMap",
    "Session", "Size", "Space", "Whole", "Window", "Words", "argument", "as_float", "color_to_convert",
    "derived_spec", "from_pixels", "image", "in_type", "lens_of", "param", "scan", "spec_beside", "working_values",
]  # fmt: skip
