# SPDX-License-Identifier: Apache-2.0
"""Flicker and drift of a fill over a shot of 24 frames, keyed from its first frame.

python -m benchmarks.motion.long_shot [--photos roof_slates] [--motion travel] [--frames 24] [--out FOLDER]

The shot pans and zooms at once; grain, light and object are those of `benchmarks.motion.flicker`. Quarters of the shot
are measured one by one, so that what grows with time is seen. Drift is the distance, px of the frame, between where the
fill lies on the surface in the first frame and where it lies later: the largest of all pixels of the region. Level is
the mean of the fill over that of the photo in its place, relative to the same in the surroundings, in percent from 100.
"""

from __future__ import annotations

import argparse
import itertools
import tempfile
from pathlib import Path

import numpy as np
from scipy.ndimage import binary_dilation

from benchmarks.motion.flicker import filled, flicker, prepare
from benchmarks.motion.shots import Frame, photo_named, rendered
from benchmarks.shared.measures import data_folder
from oiiotex.capture.homography import through
from oiiotex.motion.frame_motion import Shot, read_shot


def drift(first: Frame, frame: Frame, shot: Shot) -> float:
    """How far the fill has moved on the surface since the first frame, px of the frame."""
    y, x = np.nonzero(frame.mask)
    points = np.stack([x, y], 1) + 0.5
    home = through(frame.matrix @ np.linalg.inv(first.matrix), points)
    back = shot[frame.number].back(shot[first.number].onto(home))
    return float(np.linalg.norm(back - points, axis=1).max())


def level(frame: Frame, result: np.ndarray) -> float:
    """Mean of the fill over that of its surroundings."""
    around = binary_dilation(frame.mask, iterations=40) & ~binary_dilation(frame.mask, iterations=3)
    return float(result[frame.mask].mean() / result[around].mean())


def main() -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--photos", default="roof_slates", help="names in photos/, comma-separated")
    parser.add_argument("--motion", default="travel")
    parser.add_argument("--frames", type=int, default=24)
    parser.add_argument("--out", type=Path, help="keep the files here")
    given = parser.parse_args()
    print("| photo | frames | flicker | coarse | drift px | level % |\n|---|---|---|---|---|---|")
    for photo in given.photos.split(","):
        with tempfile.TemporaryDirectory() as temporary:
            folder = (given.out or Path(temporary)).absolute() / f"{photo}_{given.motion}"
            folder.mkdir(parents=True, exist_ok=True)
            found = next((data_folder() / "photos").glob(f"{photo}.*"))
            frames = rendered(photo_named(found), given.motion, given.frames, 0)
            prepare(frames, folder)
            results = filled(frames, "tracked", folder)
            shot = read_shot(folder / "tracked.npz", 1 << 30)
        start = level(frames[0], results[0])
        ends = [round(n * (len(frames) - 1) / 4) for n in range(5)]
        for first, last in (*itertools.pairwise(ends), (0, ends[-1])):
            part = slice(first, last + 1)
            fine, coarse = flicker(frames[part], results[part])
            moved = max(drift(frames[0], frame, shot) for frame in frames[part])
            change = max((abs(level(f, r) / start - 1) for f, r in zip(frames[part], results[part], strict=True)))
            span = f"{frames[first].number}-{frames[last].number}"
            print(f"| {photo} | {span} | {fine:.2f} | {coarse:.2f} | {moved:.2f} | {100 * change:.1f} |", flush=True)


if __name__ == "__main__":
    main()
