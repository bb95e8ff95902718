# SPDX-License-Identifier: Apache-2.0
"""Label codes, painted plans and levels of zoom, for the live page."""

from ..exemplar.presets import AUTOMATIC, PRESETS
from ..labels.legend import code_of, codes_of, color_of
from ..multiscale.graph import read_graph
from ..multiscale.synthesizer import MOST_LEVEL
from ..quilting.guide_map import Meaning, Strays
from ..quilting.painted_plans import changed_box, regridded
from ..stationarity.measures import MEASURES
