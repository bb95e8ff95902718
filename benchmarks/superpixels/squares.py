# SPDX-License-Identifier: Apache-2.0
"""Superpixels refined on means of squares, compared with those on pixels, on large mosaics with exact truth.

python -m benchmarks.superpixels.squares [--half tune|judge] [--mosaics 8] [--labels]

Mosaics of benchmarks.shared.mosaics, drawn at 512 px and enlarged 8 times, and drawn at 3300 px with the textures' own
pixels. The half "judge" was not used for tuning. Columns, squares / pixels: eq. 3 of LSA16 (a ratio); the share of the
truth's borders that lie within 2 and within 8 px of a superpixel's; under-segmentation, per cent; runs of rows; CPU s;
with --labels the covering of the truth by the best level of labels.
"""

from __future__ import annotations

import argparse
import time
from unittest.mock import patch

import numpy as np
import OpenImageIO as oiio
from scipy.ndimage import distance_transform_cdt

from benchmarks.labels.levels import Case, score
from benchmarks.shared import mosaics
from benchmarks.superpixels.quality import under_segmentation
from oiiotex.color.lab import lens_of
from oiiotex.core.image import from_buffer, to_buffer
from oiiotex.labels import scales
from oiiotex.session import Session
from oiiotex.superpixels.superpixels import Superpixels, superpixels

TIMES, SIDE = 8, 3300


def enlarged(case: Case) -> Case:
    """The same, `TIMES` larger: the picture interpolated, the truth repeated."""
    side = TIMES * case.truth.shape[0]
    picture = oiio.ImageBufAlgo.resize(to_buffer(case.image.first), roi=oiio.ROI(0, side, 0, side, 0, 1, 0, 3))
    return Case(f"{case.name} x{TIMES}", from_buffer(picture), case.truth.repeat(TIMES, 0).repeat(TIMES, 1))


def native(half: str, seed: int) -> Case:
    """A mosaic drawn at `SIDE` px."""
    with patch.object(mosaics, "SIDE", SIDE):
        case = mosaics.mosaic(half, seed)
    return Case(f"{case.name} {SIDE}", case.image, case.truth)


def borders(labels: np.ndarray) -> np.ndarray:
    """Where a pixel differs from the next to the right or below."""
    edge = np.zeros(labels.shape, bool)
    edge[:, :-1] |= labels[:, 1:] != labels[:, :-1]
    edge[:-1] |= labels[1:] != labels[:-1]
    return edge


def figures(case: Case, found: Superpixels) -> list[float]:
    """Eq. 3, recall of borders within 2 and 8 px, under-segmentation in per cent, runs."""
    labels = found.labels.pixels()[..., 0].astype(np.int64)
    away = distance_transform_cdt(~borders(labels), "chessboard")[borders(case.truth)]
    recalls = [float((away <= reach).mean()) for reach in (2, 8)]
    return [found.error(), *recalls, 100 * under_segmentation(labels, case.truth - 1), len(found.runs.left)]


def covering(case: Case, found: Superpixels, session: Session) -> float:
    """Of the truth by the best level of labels on these superpixels."""
    with patch.object(scales, "superpixels", lambda *_, **__: found):
        maps = scales.label_maps(
            case.image, lens_of(case.image, session.resources), session.resources, session.progress
        )
    ids = found.labels.pixels()[..., 0].astype(np.int64) - 1
    return max(score(case.truth, level.labels[ids], ids).covering for level in maps.levels)


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--half", default="tune", choices=("tune", "judge"))
    parser.add_argument("--mosaics", type=int, default=8)
    parser.add_argument("--labels", action="store_true")
    arguments = parser.parse_args()
    session = Session()
    rows: dict[str, list[np.ndarray]] = {"enlarged": [], "native": []}
    for seed in range(arguments.mosaics):
        for kind, case in (
            ("enlarged", enlarged(mosaics.mosaic(arguments.half, seed))),
            ("native", native(arguments.half, seed)),
        ):
            pair = []
            for literal in (False, True):
                begin = time.process_time()
                found = superpixels(
                    case.image, lens_of(case.image, session.resources), session.resources, literal=literal
                )
                took = time.process_time() - begin
                covers = [covering(case, found, session)] if arguments.labels else []
                pair.append([*figures(case, found), took, *covers])
            rows[kind].append(np.array(pair))
            print(f"{case.name:32s} {text(rows[kind][-1])}", flush=True)
    for kind, pairs in rows.items():
        print(f"mean of {kind:24s} {text(np.mean(pairs, 0))}")
        ratios = [pair[0, 0] / pair[1, 0] for pair in pairs]
        print(f"ratios of eq. 3: mean {np.mean(ratios):.4f}, largest {max(ratios):.4f}")


def text(pair: np.ndarray) -> str:
    """Squares / pixels."""
    ours, theirs = pair
    cells = [f"{ours[0] / theirs[0]:.4f}"]
    cells += [f"{a:.3f}/{b:.3f}" for a, b in zip(ours[1:3], theirs[1:3], strict=True)]
    cells += [f"{ours[3]:.2f}/{theirs[3]:.2f} %", f"{ours[4]:.0f}/{theirs[4]:.0f}", f"{ours[5]:.1f}/{theirs[5]:.1f} s"]
    return "  ".join(cells + [f"{a:.3f}/{b:.3f}" for a, b in zip(ours[6:], theirs[6:], strict=True)])


if __name__ == "__main__":
    main()
