# SPDX-License-Identifier: Apache-2.0
"""General segmenters that install, on the same images as benchmarks.subtextures.decompose.

python -m benchmarks.subtextures.outside [--groups judge,mosaics] [--mosaics 16] [--only NAME] [--folder RWTD]

scikit-image: Felzenszwalb and Huttenlocher's graph (2004); SLIC superpixels with their region adjacency graph cut at a
threshold of mean color. OpenCV, if installed (`pip install opencv-python-headless`): pyramidal mean shift. They segment
by color, not by texture. The parameter of each is from a coarse search on eight mosaics of the half "tune", by covering
(.39, .33, .37); --tune prints all candidates of `GRID`. None is told the number.

--folder names a folder of your own with `images/NAME.jpg` (or png) and `labels/NAME.png`, such as the Real-World
Texture Dataset (RWTD, Khan, Mumford et al.). It is not downloaded.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from benchmarks.labels.levels import Case, cases
from benchmarks.shared.mosaics import suite
from benchmarks.subtextures.decompose import HEAD, by_label, measured, report
from oiiotex.engine.core.image import from_buffer
from oiiotex.engine.run import run
from oiiotex.engine.session import Session
from oiiotex.filters.texdecompose import Decompose

Segmenter = Callable[[np.ndarray, float], np.ndarray]
LEAST = 0.02  # of the image: smallest segment, as of --texdecompose


def felzenszwalb(rgb: np.ndarray, scale: float) -> np.ndarray:
    """Segments of the graph of pixels."""
    from skimage.segmentation import felzenszwalb

    return felzenszwalb(rgb, scale=scale, sigma=2.0, min_size=int(LEAST * rgb[..., 0].size))


def adjacency(rgb: np.ndarray, threshold: float) -> np.ndarray:
    """SLIC superpixels, joined where neighbors differ by less than a threshold in mean color."""
    from skimage.graph import cut_threshold, rag_mean_color
    from skimage.segmentation import slic

    squares = slic(rgb, n_segments=200, compactness=10, start_label=0)
    return cut_threshold(squares, rag_mean_color(255 * rgb, squares), threshold)


def mean_shift(rgb: np.ndarray, radius: float) -> np.ndarray:
    """Pyramidal mean shift; colors within half the radius of a center of k-means are a segment."""
    import cv2

    smooth = cv2.pyrMeanShiftFiltering((255 * rgb).astype(np.uint8), 20, radius).astype(np.int64)
    return np.unique((smooth // max(1, int(radius))).reshape(-1, 3), axis=0, return_inverse=True)[1].reshape(
        rgb.shape[:2]
    )


GRID: dict[str, tuple[Segmenter, tuple[float, ...], float]] = {  # function, candidates, the best of them
    "scikit-image, Felzenszwalb": (felzenszwalb, (50, 100, 200, 400), 200),
    "scikit-image, SLIC and adjacency": (adjacency, (10, 20, 30, 45), 20),
    "OpenCV, mean shift": (mean_shift, (30, 60, 90), 60),
}


def by_segmenter(case: Case, segmenter: Segmenter, value: float) -> list[np.ndarray]:
    """Labels of a segmenter."""
    pixels = case.image.first.pixels()[..., :3]
    rgb = pixels.astype(np.float64) / (np.iinfo(pixels.dtype).max if pixels.dtype.kind == "u" else 1)
    return [segmenter(np.repeat(rgb, 3, 2) if rgb.shape[2] == 1 else rgb, value) + 1]


def folder_cases(folder: Path) -> Iterator[Case]:
    """Images of a folder with their truth: every value of a label image is a texture."""
    for path in sorted((folder / "labels").glob("*.png")):
        image = next((folder / "images").glob(f"{path.stem}.[jp]*g"))
        buffer = oiio.ImageBuf(str(image))
        buffer.specmod().attribute("oiio:ColorSpace", "srgb_rec709_scene")
        values = oiio.ImageBuf(str(path)).get_pixels(oiio.UINT16)[..., 0]
        yield Case(path.stem, from_buffer(buffer), np.unique(values, return_inverse=True)[1].reshape(values.shape) + 1)


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--groups", default="judge,mosaics")
    parser.add_argument("--mosaics", type=int, default=16)
    parser.add_argument("--only", default="")
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--tune", action="store_true", help="all candidates on the half tune")
    arguments = parser.parse_args()
    ways: dict[str, Callable[[Case], list[np.ndarray]]] = {
        "--texdecompose": lambda case: [run(Decompose(source=case.image), Session())[0].image.first.pixels()[..., 0]],
        "--texlabel, best level": by_label,
    }
    for name, (segmenter, candidates, best) in GRID.items():
        for value in candidates if arguments.tune else (best,):
            shown = f"{name}, {value:g}" if arguments.tune else name
            ways[shown] = lambda case, s=segmenter, v=value: by_segmenter(case, s, v)
    groups: dict[str, list[Case]] = {}
    for group in ["tune"] if arguments.tune else arguments.groups.split(","):
        groups[group] = list(cases("mosaic") if group == "mosaics" else suite(group, arguments.mosaics))
    if arguments.folder:
        groups = {arguments.folder.name: list(folder_cases(arguments.folder))}
    print(HEAD)
    for group, found in groups.items():
        for name, way in ways.items():
            if arguments.only not in name:
                continue
            try:
                report(group, name, [measured(case, way) for case in found])
            except ImportError as error:
                print(f"| {group} | {name}: {error.name} is not installed |" + " |" * 8)


if __name__ == "__main__":
    main()
