# SPDX-License-Identifier: Apache-2.0
"""Both ways to search for patches, on the same photos: verdicts of tiles and fills, and CPU time.

    python -m benchmarks.judge.searches PHOTO...

A fill replaces the middle ninth of a photo. Photos are reduced to `SIDE` px on the longer side.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from oiiotex import filters
from oiiotex.synthesis.patchmatch.patch_search import SEARCHES
from oiiotex.synthesis.quality.verdicts import verdicts

SIDE, SEED = 384, 7


def opened(path: Path) -> oiio.ImageBuf:
    """The photo, reduced; sRGB."""
    photo = oiio.ImageBuf(str(path))
    size = photo.spec().width, photo.spec().height
    width, height = (max(1, round(n * min(1.0, SIDE / max(size)))) for n in size)
    small = oiio.ImageBufAlgo.resize(photo, roi=oiio.ROI(0, width, 0, height, 0, 1, 0, photo.nchannels))
    small.specmod().attribute("oiio:ColorSpace", "srgb_rec709_scene")
    return small


def middle(photo: oiio.ImageBuf) -> np.ndarray:
    """A mask of the middle ninth."""
    mask = np.zeros((photo.spec().height, photo.spec().width), bool)
    rows, columns = (slice(n // 3, 2 * n // 3) for n in mask.shape)
    mask[rows, columns] = True
    return mask


def graded(op: str, photo: oiio.ImageBuf, search: str) -> tuple[tuple[str, ...], float]:
    """The grades of an op's report, the judge's first, and CPU seconds."""
    with tempfile.TemporaryDirectory() as folder:
        report, begun = Path(folder, "report.json"), time.process_time()
        images = (photo, middle(photo)) if op == "fill" else (photo,)
        getattr(filters, op)(*images, search=search, seed=SEED, report=str(report))
        spent = time.process_time() - begun
        (entry,) = json.loads(report.read_text())["results"]
    return tuple(line.partition(":")[0] for line in verdicts(entry["measures"])), spent


def main() -> None:
    """Print a row for each op: grades and seconds of each search, and on how many photos all grades are equal."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("photos", type=Path, nargs="+")
    photos = [opened(path) for path in parser.parse_args().photos]
    names = tuple(SEARCHES)
    print(f"| op | {' | '.join(f'{name}: grades, CPU s' for name in names)} | equal |")
    print("|---|" + "---|" * (len(names) + 1))
    for op in ("stationarize", "fill"):
        found = [[graded(op, photo, name) for photo in photos] for name in names]
        cells = []
        for results in found:
            grades = Counter(grade for own, _ in results for grade in own)
            said = ", ".join(f"{count} {grade}" for grade, count in grades.most_common())
            cells.append(f"{said}; {sum(spent for _, spent in results):.1f}")
        equal = sum(len({own for own, _ in pair}) == 1 for pair in zip(*found, strict=True))
        print(f"| {op} | {' | '.join(cells)} | {equal} of {len(photos)} |")


if __name__ == "__main__":
    main()
