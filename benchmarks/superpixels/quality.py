# SPDX-License-Identifier: Apache-2.0
"""Superpixels and their hierarchy: time compared with peers, under-segmentation on the maps of ground truth.

python -m benchmarks.superpixels.quality [speed] [quality]
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from scipy import ndimage

from benchmarks.shared.measures import data_folder
from benchmarks.superpixels.segmenters import by_boundary, by_color, scikit_slic
from oiiotex.analysis.superpixels.hierarchy import hierarchy
from oiiotex.analysis.superpixels.slic import SeedGrid, Slic
from oiiotex.analysis.superpixels.superpixels import Superpixels, superpixels
from oiiotex.engine.color.lab import lens_of
from oiiotex.engine.color.lab_on_device import LabGrid
from oiiotex.engine.core.image import Image, from_buffer
from oiiotex.engine.session import Session

PEERS = (
    "our SLIC",
    "our SLIC on a blurred image",
    "scikit-image's SLIC",
    "basins merged by color (Ward)",
    "basins merged by boundary",
)
COUNTS = (400, 200, 100, 60, 33, 20)
ELSEWHERE = {
    "facade_tiles": "photos/facade_tiles.jpg",
    "rusty_metal_albedo": "pbr/rusty_metal/rusty_metal_albedo.jpg",
}


def load(path: Path, width: int = 0, height: int = 0) -> Image:
    """An 8-bit photo, resized where a size is given."""
    read = oiio.ImageBuf(str(path))
    if width:
        read = oiio.ImageBufAlgo.resize(read, roi=oiio.ROI(0, width, 0, height, 0, 1, 0, 3))
    made = oiio.ImageBuf()
    made.copy(read, "uint8")
    made.specmod().attribute("oiio:ColorSpace", "srgb_rec709_scene")
    return from_buffer(made)


def best(work: Callable[[], object], repeats: int = 5) -> float:
    """Seconds, the least of several."""
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        work()
        times.append(time.perf_counter() - begin)
    return min(times)


def speed() -> None:
    """Ten iterations at 2560 x 1920 with about 2500 seeds, and by OpenCV and scikit-image; then all stages."""
    import cv2
    from skimage.color import rgb2lab

    image = load(data_folder() / "large" / "large_drone_scrub_road_12mp.jpg", 2560, 1920)
    resources = Session().resources
    lens = lens_of(image, resources)
    pixels = image.first.pixels()
    lab = rgb2lab(pixels).astype(np.float32)
    grid = SeedGrid.of(2560, 1920, 44.0, 20.0)

    def ten() -> None:
        with LabGrid(image, lens, resources) as held, Slic(held, grid, resources) as run:
            for _ in run.slots(run.iterate(10)):
                resources.device.finish()

    def iterations_alone() -> float:
        with LabGrid(image, lens, resources) as held, Slic(held, grid, resources) as run:
            return best(lambda: [resources.device.finish() for _ in run.slots(run.iterate(10))])

    def opencv() -> None:
        peer = cv2.ximgproc.createSuperpixelSLIC(lab, cv2.ximgproc.SLIC, 44, 20.0)
        peer.iterate(10)

    def scikit() -> None:
        scikit_slic(lab, grid.count, connected=False)

    ten()
    rows = {
        "ours, ten iterations": iterations_alone(),
        "ours, with sRGB to Lab": best(ten),
        "OpenCV SLIC, from Lab": best(opencv, 3),
        "scikit-image SLIC, from Lab": best(scikit, 2),
    }
    mine = rows["ours, ten iterations"]
    print(f"2560x1920, {grid.count} seeds, ten iterations")
    for name, seconds in rows.items():
        print(f"  {name:30s} {seconds:6.3f} s   {seconds / mine:5.1f} x ours")
    found = superpixels(image, lens, resources)
    print(f"the whole computation, {found.count} superpixels")
    whole = best(lambda: superpixels(image, lens, resources), 3)
    print(f"  superpixels until converged     {whole:6.3f} s")
    ten = best(lambda: superpixels(image, lens, resources, iterations=10), 3)
    print(f"  ten iterations only             {ten:6.3f} s")
    levels = hierarchy(found, resources)
    print(f"  hierarchy, {len(levels.sigmas)} levels          {best(lambda: hierarchy(found, resources)):6.3f} s")


# --- quality ---


def truths() -> list[tuple[str, Path, np.ndarray]]:
    """(name, photo, regions) of the ground truth; regions are connected and numbered from 0, -1 is unknown."""
    found = []
    for path in sorted((data_folder() / "gt").glob("*_gt.png")):
        name = path.stem.removesuffix("_gt")
        photo = data_folder() / ELSEWHERE.get(name, f"gt/{name}.png")
        photo = photo if photo.exists() else photo.with_suffix(".jpg")
        buffer = oiio.ImageBuf(str(path))
        labels = buffer.get_pixels(buffer.spec().format)[..., 0].astype(np.int64)
        labels = 1 + (labels > 0) if name.startswith("gravel") else labels
        regions, count = np.full(labels.shape, -1), 0
        for label in np.unique(labels[labels > 0]):
            part, n = ndimage.label(labels == label)
            regions[part > 0] = part[part > 0] - 1 + count
            count += n
        found.append((name, photo, regions))
    return found


def under_segmentation(labels: np.ndarray, regions: np.ndarray) -> float:
    """Share of pixels that leak: sum over superpixels and regions of min(inside, outside); Neubert and Protzel 2012."""
    seen = regions >= 0
    _, label = np.unique(labels[seen], return_inverse=True)
    table = np.zeros((label.max() + 1, regions.max() + 1))
    np.add.at(table, (label, regions[seen]), 1)
    return float(np.minimum(table, table.sum(1, keepdims=True) - table).sum() / seen.sum())


def at_counts(found: Superpixels, session: Session) -> dict[int, np.ndarray]:
    """The hierarchy's label maps of these numbers of superpixels."""
    area = found.sizes.sum()
    last = max(found.sigma + 6, float(np.sqrt(area / (min(COUNTS) - 1))))
    levels = hierarchy(found, session.resources, np.arange(found.sigma, last + 3, 3.0))
    height, width = found.runs.height, found.runs.width
    made = {}
    for count in COUNTS:
        if levels.counts[-1] <= count <= found.count:
            made[count] = found.runs.relabeled(levels.partition_of(count)).pixels(0, height, 0, width)
    return made


def quality() -> None:
    """Under-segmentation error, per cent: hierarchy, SLIC at that count, that on a blurred image, and peers'.

    Columns: ours, our SLIC, our SLIC of a blurred image, scikit-image's SLIC, and the two hierarchical segmenters that
    stand in for Arbelaez's (benchmarks.superpixels.segmenters): by color, by boundary.
    """

    session, totals = Session(), []
    print(f"{'':28s}" + "".join(f"{c:>38d}" for c in COUNTS))
    print(f"{'':28s}" + "    ours  slic  blur  skim  ward bound" * len(COUNTS))
    for name, photo, regions in truths():
        image = load(photo)
        lens = lens_of(image, session.resources)
        found = superpixels(image, lens, session.resources)
        cells = []
        values = lens.values(image.first.pixels())[0][..., :3].astype(np.float64)
        segmenters = [by_color(values), by_boundary(values)]
        for count, labels in at_counts(found, session).items():
            sigma = float(np.sqrt(regions.size / count))
            blur = np.sqrt(max(1.0, sigma - found.sigma) * 3.0)  # as the stack has it at that scale
            rgb = image.first.pixels().astype(np.float32)
            soft = np.stack([ndimage.gaussian_filter(rgb[..., c], blur) for c in range(3)], -1)
            smooth = load_pixels(soft, image)
            row = [labels]
            for one in (image, smooth):
                row.append(
                    superpixels(one, lens_of(one, session.resources), session.resources, sigma=sigma).labels.pixels()[
                        ..., 0
                    ]
                )
            row.append(scikit_slic(values, count))
            row += [peer.partition_of(count) for peer in segmenters]
            cells.append([100 * under_segmentation(r, regions) for r in row])
        totals.append(cells)
        print(f"{name:28s}" + errors_text(cells), flush=True)
    print(f"{'mean':28s}" + errors_text(np.mean(totals, 0)))
    table = np.array(totals)
    for peer, name in enumerate(PEERS, 1):
        better = table[..., 0] < table[..., peer]
        everywhere = better.all(1).sum()
        print(f"better than {name}: at every count on {everywhere} of {len(table)}, in {better.sum()} of {better.size}")


def errors_text(cells: Iterable[Iterable[float]]) -> str:
    """A row of the table: for every count the errors of ours and of the peers."""
    return "".join("   " + "".join(f"{e:5.1f} " for e in row)[:-1].rjust(35) for row in cells)


def load_pixels(pixels: np.ndarray, like: Image) -> Image:
    """8-bit values as an image in the color space of another."""
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], 3, oiio.UINT8)
    spec.attribute("oiio:ColorSpace", like.first.spec.get_string_attribute("oiio:ColorSpace"))
    made = oiio.ImageBuf(spec)
    made.set_pixels(made.roi, np.rint(pixels).astype(np.uint8))
    return from_buffer(made)


if __name__ == "__main__":
    for word in sys.argv[1:] or ("speed", "quality"):
        {"speed": speed, "quality": quality}[word]()
