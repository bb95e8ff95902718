# SPDX-License-Identifier: Apache-2.0
"""The filters: one thin file per op. `FILTERS` lists them; each is also a function that takes and returns ImageBufs.

>>> from oiiotex import filters
>>> tile = filters.stationarize(buf, sigma=32, size=(1024, 1024), seed=7)  # doctest: +SKIP
"""

from ..op import Op
from .functions import function_of
from .stationarize import PatchMatch, Stationarize
from .warp import Warp

FILTERS: tuple[type[Op], ...] = (Stationarize, PatchMatch, Warp)

stationarize = function_of(Stationarize)
patchmatch = function_of(PatchMatch)
warp = function_of(Warp)
