# SPDX-License-Identifier: Apache-2.0
"""Photos and measures that the benchmarks share."""

from __future__ import annotations

import datetime
import os
import platform
import subprocess
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
import OpenImageIO as oiio
from scipy.ndimage import gaussian_filter

from oiiotex.synthesis.quality.seam_measures import sharpness, wrap_percentile

__all__ = [
    "Spent", "data_folder", "load", "low_frequency", "luma", "machine", "measured", "sharpness", "tile_figures",
    "wrap_percentile",
]  # fmt: skip

LUMA = np.array([0.299, 0.587, 0.114])
_SLOW = 16.0  # px


def data_folder() -> Path:
    """Where the test photos lie: $OIIOTEX_TEST_DATA, default ../shared/data."""
    return Path(os.environ.get("OIIOTEX_TEST_DATA", "../shared/data"))


def machine() -> str:
    """CPU model, number of cores that the process may use, date."""
    model = platform.processor() or platform.machine()
    if Path("/proc/cpuinfo").exists():
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        model = next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), model)
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return f"{model}, {cores} cores, {datetime.date.today()}"


class Spent(NamedTuple):
    """Cost of a process: wall-clock and CPU seconds (user and system, all threads), peak resident megabytes."""

    wall: float
    cpu: float
    megabytes: int


def measured(words: list[str], folder: Path) -> Spent:
    """Run a command in a folder; a failure ends the benchmark."""
    start = time.perf_counter()
    process = subprocess.Popen(words, cwd=folder, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    wall = time.perf_counter() - start
    if status:
        raise SystemExit(f"failed: {' '.join(words)}")
    return Spent(wall, usage.ru_utime + usage.ru_stime, usage.ru_maxrss >> 10)


def luma(rgb: np.ndarray) -> np.ndarray:
    """Rec. 601 luma of 8-bit pixels, 0 to 255."""
    return rgb[..., :3].astype(np.float64) @ LUMA


def tile_figures(rgb: np.ndarray, clean: np.ndarray) -> tuple[float, ...]:
    """(wrap percentile x, y, LowF, sharpness and contrast relative to the clean photo) of 8-bit pixels.

    The clean photo is luma. LowF measures how much low-frequency variation repeats in similar textures. It is not a
    goal: lost structure also lowers it.
    """
    gray = luma(rgb)
    return (
        wrap_percentile(gray, 1),
        wrap_percentile(gray, 0),
        low_frequency(gray),
        sharpness(gray) / sharpness(clean),
        float(gray.std() / clean.std()),
    )


def low_frequency(gray: np.ndarray) -> float:
    """LowF: standard deviation of a plane blurred with sigma 16 px on the torus."""
    return float(gaussian_filter(gray, _SLOW, mode="wrap").std())


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
