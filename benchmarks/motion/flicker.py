# SPDX-License-Identifier: Apache-2.0
"""Flicker of fills in moving shots: filled frame by frame, and once for all frames.

python -m benchmarks.motion.flicker [--photos castle_brick_broken,clover_lawn] [--frames 9] [--out FOLDER]

Shots of 480 x 270 px are rendered from photos, with known motion, grain, changing light, and an object on the surface.
Flicker is the root mean square of the difference of successive frames after compensation of the true motion, inside
the region (3 px from its border) divided by that in the surroundings (40 px). 'coarse' is the same after a blur of
3 px, by which grain hardly counts.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from scipy.ndimage import binary_dilation, binary_erosion, gaussian_filter

from benchmarks.motion.shots import HEIGHT, MOTIONS, WIDTH, Frame, photo_named, places, rendered, save
from benchmarks.shared.measures import data_folder
from oiiotex.surfaces.motion.sampling import at_points


def run(*words: str, folder: Path) -> None:
    """Run the program; a failure ends the benchmark."""
    done = subprocess.run([sys.executable, "-m", "oiiotex", *words], cwd=folder, capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"{' '.join(words)}: {done.stderr}")


def flicker(frames: list[Frame], filled: list[np.ndarray]) -> tuple[float, float]:
    """Flicker inside over flicker around: of all detail, and of what is larger than 3 px."""
    sums = np.zeros((2, 2))
    for n in range(len(frames) - 1):
        now, then = frames[n], frames[n + 1]
        across = places(now.matrix @ np.linalg.inv(then.matrix))
        both = now.mask | (at_points(then.mask[..., None].astype(np.float32), across)[..., 0] > 0.01)
        inner = binary_erosion(now.mask, iterations=3)
        outer = binary_dilation(both, iterations=40) & ~binary_dilation(both, iterations=6)
        seen = ((across > 6) & (across < (WIDTH - 6, HEIGHT - 6))).all(2)
        seen[:6], seen[-6:], seen[:, :6], seen[:, -6:] = False, False, False, False
        light = np.array([np.median(f.pixels[~f.mask], 0) for f in (now, then)])
        difference = at_points(filled[n + 1] * (light[0] / light[1]), across) - filled[n]
        for row, values in enumerate((difference, gaussian_filter(difference, (3, 3, 0)))):
            sums[row] += [np.mean(values[area & seen] ** 2) for area in (inner, outer)]
    ratios = np.sqrt(sums[:, 0] / sums[:, 1])
    return float(ratios[0]), float(ratios[1])


def pixels(path: Path) -> np.ndarray:
    """The pixels of a file, (h, w, 3) float32."""
    return oiio.ImageBuf(str(path)).get_pixels(oiio.FLOAT)[..., :3]


def filled(frames: list[Frame], method: str, folder: Path) -> list[np.ndarray]:
    """The frames of a shot, filled by a method: alone, known or tracked."""
    files = [f"{method}.{frame.number}.exr" for frame in frames]
    if method == "alone":
        for frame, file in zip(frames, files, strict=True):
            run(f"plate.{frame.number}.exr", f"mask.{frame.number}.exr", "--texfill", "-o", file, folder=folder)
    else:
        span, middle = f"{frames[0].number}-{frames[-1].number}", frames[0].number
        motion = f":motion=st.{middle}.exr" if method == "known" else ""
        plate = f"--texplate:region=1:frames={span}:motionfile={method}.npz{motion}"
        run(f"plate.{middle}.exr", f"mask.{middle}.exr", plate, "-o", f"{method}_open.exr", "--sisplit",
            "--texfill", "-o", f"{method}_plate.exr", folder=folder)  # fmt: skip
        run("--frames", span, "plate.#.exr", f"{method}_plate.exr", "mask.#.exr",
            f"--texproject:region=1:motion={method}.npz", "-o", f"{method}.#.exr", folder=folder)  # fmt: skip
    return [pixels(folder / file) for file in files]


def prepare(frames: list[Frame], folder: Path) -> None:
    """Write the frames of a shot, their masks, and ST maps to the first frame."""
    for frame in frames:
        save(folder / f"plate.{frame.number}.exr", frame.pixels)
        save(folder / f"mask.{frame.number}.exr", frame.mask[..., None].astype(np.float32), "data")
        st = places(frame.matrix @ np.linalg.inv(frames[0].matrix)) / (WIDTH, HEIGHT)
        save(folder / f"st.{frame.number}.exr", st, "data")


def main() -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--photos", default="castle_brick_broken", help="names in photos/, comma-separated")
    parser.add_argument("--motions", default="pan,zoom,plane", help=", ".join(MOTIONS))
    parser.add_argument("--methods", default="alone,known,tracked")
    parser.add_argument("--frames", type=int, default=9)
    parser.add_argument("--out", type=Path, help="keep the files here")
    arguments = parser.parse_args()
    methods = arguments.methods.split(",")
    print("| photo | shot |", *(f"{method} | coarse |" for method in methods))
    print("|---|---|" + "---|---|" * len(methods))
    for photo in arguments.photos.split(","):
        for seed, motion in enumerate(arguments.motions.split(",")):
            with tempfile.TemporaryDirectory() as temporary:
                folder = (arguments.out or Path(temporary)).absolute() / f"{photo}_{motion}"
                folder.mkdir(parents=True, exist_ok=True)
                found = next((data_folder() / "photos").glob(f"{photo}.*"))
                frames = rendered(photo_named(found), motion, arguments.frames, seed)
                prepare(frames, folder)
                cells = (flicker(frames, filled(frames, method, folder)) for method in methods)
                shown = " ".join(f"{fine:.2f} | {coarse:.2f} |" for fine, coarse in cells)
                print(f"| {photo} | {motion} | {shown}", flush=True)


if __name__ == "__main__":
    main()
