# SPDX-License-Identifier: Apache-2.0
"""Measures of a result at each pixel, to show where it repeats."""

from oiiotex.synthesis.quality.copy_detection import region_uses
