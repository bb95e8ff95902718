# SPDX-License-Identifier: Apache-2.0
"""Flicker and drift of a fill over a shot of 24 frames, keyed from its first frame.

python -m benchmarks.motion.long_shot [--photos roof_slates] [--motion travel] [--frames 24] [--out FOLDER]

The shot pans and zooms at once; grain, light and object are those of `benchmarks.motion.flicker`. Quarters of the shot
are measured one by one, so that what grows with time is seen. Drift is the distance, px of the frame, between where the
fill lies on the surface in the first frame and where it lies later: the largest of all pixels of the region. Level is
how much the mean of the fill changes from the first frame, where both show the same part of it, relative to the same in
the surroundings: the largest change, percent.
"""

from __future__ import annotations

import argparse
import itertools
import tempfile
from pathlib import Path

import numpy as np
from scipy.ndimage import binary_dilation

from benchmarks.motion.flicker import filled, flicker, prepare
from benchmarks.motion.shots import HEIGHT, WIDTH, Frame, photo_named, places, rendered
from benchmarks.shared.measures import data_folder
from oiiotex.surfaces.capture.homography import through
from oiiotex.surfaces.motion.frame_motion import Shot, read_shot
from oiiotex.surfaces.motion.sampling import at_points


def drift(first: Frame, frame: Frame, shot: Shot) -> float:
    """How far the fill has moved on the surface since the first frame, px of the frame."""
    y, x = np.nonzero(frame.mask)
    points = np.stack([x, y], 1) + 0.5
    home = through(frame.matrix @ np.linalg.inv(first.matrix), points)
    back = shot[frame.number].back(shot[first.number].onto(home))
    return float(np.linalg.norm(back - points, axis=1).max())


def level(first: Frame, frame: Frame, results: tuple[np.ndarray, np.ndarray]) -> float:
    """Change of the fill's mean from the first frame, relative to its surroundings; 1 is none."""
    across = places(frame.matrix @ np.linalg.inv(first.matrix))
    home = at_points(results[0], across)
    at_home = at_points(first.mask[..., None].astype(np.float32), across)[..., 0]
    seen = ((across > 6) & (across < (WIDTH - 6, HEIGHT - 6))).all(2)
    around = binary_dilation(frame.mask, iterations=40) & ~binary_dilation(frame.mask, iterations=3)
    inside, around = seen & frame.mask & (at_home > 0.99), seen & around & (at_home < 0.01)
    return float(results[1][inside].mean() / home[inside].mean() * home[around].mean() / results[1][around].mean())


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
        ends = [round(n * (len(frames) - 1) / 4) for n in range(5)]
        for first, last in (*itertools.pairwise(ends), (0, ends[-1])):
            part = slice(first, last + 1)
            fine, coarse = flicker(frames[part], results[part])
            moved = max(drift(frames[0], frame, shot) for frame in frames[part])
            change = max(
                abs(level(frames[0], f, (results[0], r)) - 1) for f, r in zip(frames[part], results[part], strict=True)
            )
            span = f"{frames[first].number}-{frames[last].number}"
            print(f"| {photo} | {span} | {fine:.2f} | {coarse:.2f} | {moved:.2f} | {100 * change:.1f} |", flush=True)


if __name__ == "__main__":
    main()
