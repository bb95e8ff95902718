# SPDX-License-Identifier: Apache-2.0
"""Photos and measures that the benchmarks share."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from scipy.ndimage import gaussian_filter

LUMA = np.array([0.299, 0.587, 0.114])


def data_folder() -> Path:
    """Where the test photos lie: $OIIOTEX_TEST_DATA, default ../shared/data."""
    return Path(os.environ.get("OIIOTEX_TEST_DATA", "../shared/data"))


def luma(rgb: np.ndarray) -> np.ndarray:
    """Rec. 601 luma of 8-bit pixels, 0 to 255."""
    return rgb[..., :3].astype(np.float64) @ LUMA


def low_frequency(gray: np.ndarray) -> float:
    """LowF: standard deviation of the luma blurred with sigma 16; what repeats visibly when tiled."""
    return float(gaussian_filter(gray, 16, mode="wrap").std())


def sharpness(gray: np.ndarray) -> float:
    """mean |Y - G1 Y|."""
    return float(np.abs(gray - gaussian_filter(gray, 1, mode="wrap")).mean())


def wrap_percentile(gray: np.ndarray, axis: int) -> float:
    """Share of the interior lines whose jump is smaller than the wrap line's, in percent: 50 is invisible."""
    jumps = np.abs(gray - np.roll(gray, 1, axis=axis)).mean(axis=1 - axis)
    return float(100.0 * (jumps[1:] < jumps[0]).mean())


def load(path: Path, longer_side: int) -> oiio.ImageBuf:
    """A photo as 8-bit sRGB with its longer side reduced."""
    photo = oiio.ImageBuf(str(path))
    spec = photo.spec()
    if spec.nchannels > 3:
        photo = oiio.ImageBufAlgo.channels(photo, (0, 1, 2))
    scale = min(1.0, longer_side / max(spec.width, spec.height))
    roi = oiio.ROI(0, round(spec.width * scale), 0, round(spec.height * scale))
    photo = oiio.ImageBufAlgo.resize(photo, roi=roi)
    photo.specmod().attribute("oiio:ColorSpace", "srgb_rec709_scene")
    return photo
