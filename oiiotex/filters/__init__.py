# SPDX-License-Identifier: Apache-2.0
"""The filters: one thin file per op. `FILTERS` lists them; each is also a function that takes and returns ImageBufs.

>>> from oiiotex import filters
>>> tile = filters.stationarize(buf, sigma=32, size=(1024, 1024), seed=7)  # doctest: +SKIP
"""

from collections.abc import Callable
from typing import Any

from ..op import Op
from .composite import Composite
from .content import Content
from .cut import Cut
from .decompose import Decompose
from .dominant import Dominant
from .flatten import Flatten
from .functions import function_of, result
from .graph import ExemplarGraph
from .join import Join
from .lab import Lab
from .label import Label
from .labelview import LabelView
from .paint import Paint
from .palette import Palette
from .plugins import installed
from .preview import Preview
from .quilt import Quilting
from .sigmas import Sigmas
from .stationarity import Stationarity
from .stationarize import PatchMatch, Stationarize
from .superpixel import Superpixel
from .synth import Synth
from .warp import Warp
from .zoom import Zoom

_OURS: tuple[type[Op], ...] = (
    Stationarize, PatchMatch, Quilting, Synth, Zoom, ExemplarGraph, Join, Cut, Composite, Palette, Paint,
    Flatten, Sigmas, Stationarity, Superpixel, Label, Decompose, Dominant, LabelView, Content, Lab, Warp,
    Preview,
)  # fmt: skip
FILTERS = (*_OURS, *installed(_OURS))

stationarize = function_of(Stationarize)
patchmatch = function_of(PatchMatch)
quilt = function_of(Quilting)
cut = function_of(Cut)
composite = function_of(Composite)
palette = function_of(Palette)
paint = function_of(Paint)
flatten = function_of(Flatten)
synth = function_of(Synth)
zoom = function_of(Zoom)
graph = function_of(ExemplarGraph)
join = function_of(Join)
stationarity = function_of(Stationarity)
sigmas = function_of(Sigmas)
superpixel = function_of(Superpixel)
label = function_of(Label)
decompose = function_of(Decompose)
dominant = function_of(Dominant)
labelview = function_of(LabelView)
content = function_of(Content)
lab = function_of(Lab)
warp = function_of(Warp)
preview = function_of(Preview)


__all__ = ["FILTERS", "result"]


def __getattr__(name: str) -> Callable[..., Any]:
    """The functions of other packages' filters."""
    for op in FILTERS:
        if op.name == name:
            return function_of(op)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
