# SPDX-License-Identifier: Apache-2.0
"""The picture of docs/how-to/fills-in-moving-shots.md: `python -m tools.docs.pictures.motion`."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from benchmarks.motion.flicker import filled, pixels, prepare
from benchmarks.motion.shots import photo_named, rendered
from benchmarks.shared.measures import data_folder
from tools.docs.pictures.layout import beside, draw, halved, stacked, write_jpeg

PHOTO = "castle_brick_broken.jpg"
COUNT = 5


def eight_bit(values: np.ndarray) -> np.ndarray:
    """Values of 0 to 1 as 8 bits."""
    return np.rint(255 * np.clip(values, 0, 1)).astype(np.uint8)


def shot() -> None:
    """First and last frame of a shot, before and after, and the plate between them."""
    frames = rendered(photo_named(data_folder() / "photos" / PHOTO), "pan", COUNT, 0)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        prepare(frames, folder)
        after = filled(frames, "tracked", folder)
        plates = [halved(eight_bit(pixels(folder / f"tracked_{name}.exr"))) for name in ("open", "plate")]
    rows = [beside(*(eight_bit(one[n]) for one in ([f.pixels for f in frames], after))) for n in (0, COUNT - 1)]
    write_jpeg(stacked([rows[0], beside(*plates), rows[1]]), "motion_fill.jpg")


if __name__ == "__main__":
    draw(shot)
