# SPDX-License-Identifier: Apache-2.0
"""Label codes, painted plans and levels of zoom, for the live page."""

from oiiotex.analysis.labels.legend import code_of, codes_of, color_of
from oiiotex.analysis.stationarity.measures import MEASURES
from oiiotex.engine.io.documents import read_arrays
from oiiotex.synthesis.exemplar.presets import AUTOMATIC, PRESETS
from oiiotex.synthesis.graphcut.seam_overlay import TILE
from oiiotex.synthesis.multiscale.graph import read_graph
from oiiotex.synthesis.multiscale.synthesizer import MOST_LEVEL
from oiiotex.synthesis.quilting.guide_map import Meaning, Strays
from oiiotex.synthesis.quilting.quilt_plan import Grid, QuiltPlan
