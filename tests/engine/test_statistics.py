# SPDX-License-Identifier: Apache-2.0
"""Comparisons and statistics of images against numpy."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio

from oiiotex.engine.core.image import from_pixels
from oiiotex.oiiotool.cli.printing.comparing import Thresholds, compare
from oiiotex.oiiotool.cli.printing.pixel_statistics import part_statistics


def test_comparison_equals_numpy():
    rng = np.random.default_rng(3)
    x, y = (rng.random((200, 37, 3)).astype(np.float32) for _ in range(2))
    spec = oiio.ImageSpec(37, 200, 3, oiio.FLOAT)
    found = compare(from_pixels("", x, spec), from_pixels("", y, spec), Thresholds(fail=np.float32(0.5)))
    error = np.abs(x - y).astype(np.float64)
    assert found.max_error == error.max() and (found.y, found.x, found.channel) == np.unravel_index(
        error.argmax(), x.shape
    )
    assert found.failed == (error.max(axis=2) > 0.5).sum()
    np.testing.assert_allclose((found.mean, found.rms), (error.mean(), np.sqrt(np.square(error).mean())), rtol=1e-12)


def test_statistics_are_streamed_and_equal_numpy():
    rng = np.random.default_rng(4)
    pixels = rng.normal(0, 9, (300, 41, 2)).astype(np.float32)
    asked = []

    def fetch(window):
        asked.append(window)
        return pixels[window.top : window.bottom, window.left : window.right]

    import dataclasses

    spec = oiio.ImageSpec(41, 300, 2, oiio.FLOAT)
    part = dataclasses.replace(from_pixels("", pixels, spec), fetch=fetch)
    found = part_statistics(part)
    assert all(window.height <= 64 and window.width == 41 for window in asked) and len(asked) == 5
    np.testing.assert_array_equal(found.min, pixels.min(axis=(0, 1)))
    np.testing.assert_array_equal(found.max, pixels.max(axis=(0, 1)))
    np.testing.assert_allclose(found.avg, pixels.mean(axis=(0, 1), dtype=np.float64), rtol=1e-6)
    np.testing.assert_allclose(found.stddev, pixels.std(axis=(0, 1), dtype=np.float64), rtol=1e-6)
