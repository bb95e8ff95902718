# SPDX-License-Identifier: Apache-2.0
"""Measures of a result: at each pixel, to show where it repeats, and the names of those that reports hold."""

from oiiotex.synthesis.quality.copy_detection import region_uses
from oiiotex.synthesis.quality.report_measures import REPORT_MEASURES
