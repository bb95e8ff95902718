# SPDX-License-Identifier: Apache-2.0
"""docs/explanation/comparison.md and its pictures, after MJH17 figures 5, 7, 8, 9 and 13.

`python -m tools.docs.pictures.comparison`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from oiiotex import filters
from oiiotex.engine.errors import Error
from oiiotex.filters.texstationarity import COST
from oiiotex.surfaces.charts.tile_preview import made_seamless, repeated
from oiiotex.synthesis.wang.tiles import edges_of
from tools.docs.pictures.layout import beside, draw, image_of, shrunk, stacked, test_photo, write_jpeg
from tools.docs.pictures.wang_plane import random_plane

PHOTOS = (
    "castle_brick_broken", "moss_grass_stones_ground", "rust_barrel_side", "stained_plaster_wall",
    "chalkboard_scratched", "sail_cloth_stained", "rebar_concrete_decayed", "sandstone_wall_cracked",
)  # fmt: skip
FAILURES = ("fieldstone_wall_kodim01", "bark_flaky", "pebbles_beach_shadow")  # structure, tiny features, shapes
MEASURES = "histogram", "moments", "steerable"
SIDE = 256  # px, of a photo, cut square
TILE = (192, 192)
PANE = 200  # px; every pane is a tile 2 x 2
SIGMA = 6.0  # px, what `TILE` / 32 makes of it
WANG = (16, (96, 96), 4)  # tiles, size, rows and columns: as large as 2 x 2 of TILE
IN_A_LINE = 6
SEED = 1

Way = Callable[[oiio.ImageBuf], oiio.ImageBuf]


def square(name: str, side: int) -> oiio.ImageBuf:
    """The middle of a test photo, reduced to a square."""
    photo = test_photo(f"{name}.jpg")
    spec = photo.spec()
    least = min(spec.width, spec.height)
    x, y = (spec.width - least) // 2, (spec.height - least) // 2
    return shrunk(oiio.ImageBufAlgo.cut(photo, oiio.ROI(x, x + least, y, y + least)), side)


def seamless(photo: oiio.ImageBuf) -> oiio.ImageBuf:
    """The photo blended with itself shifted by half."""
    return image_of(made_seamless(photo.get_pixels(oiio.FLOAT)))


def dominant_mask(photo: oiio.ImageBuf) -> np.ndarray:
    """Where the photo's dominant texture is (LDR09), (height, width) bool."""
    return filters.dominant(photo, photo=True)["dominant"].get_pixels(oiio.FLOAT)[..., 0] > 0.5


def of_the_dominant(photo: oiio.ImageBuf) -> oiio.ImageBuf:
    """Toroidal PatchMatch from the dominant texture alone, as MJH17 compares with LDR09 (figure 7)."""
    return filters.patchmatch(photo, mask=image_of(dominant_mask(photo)), size=TILE, seed=SEED)


def of_the_destained(photo: oiio.ImageBuf) -> oiio.ImageBuf:
    """Toroidal PatchMatch of the photo with everything but its dominant texture resynthesized; compare figure 6."""
    clean = filters.fill(photo, image_of(~dominant_mask(photo)), seed=SEED)
    return filters.patchmatch(clean, size=TILE, seed=SEED)


def plain_wang(photo: oiio.ImageBuf) -> oiio.ImageBuf:
    """Wang tiles whose insides nothing makes even, as MJH17 figure 5 compares with."""
    count, size, _ = WANG
    return laid_at_random(filters.patchmatch(photo, variants=count, size=size, seed=SEED))


def even_wang(photo: oiio.ImageBuf) -> oiio.ImageBuf:
    """The same, stationarized."""
    count, size, _ = WANG
    return laid_at_random(filters.stationarize(photo, variants=count, size=size, sigma=SIGMA, seed=SEED))


def laid_at_random(tiles: Sequence[oiio.ImageBuf]) -> oiio.ImageBuf:
    """A random plane of Wang tiles, as large as a tile 2 x 2."""
    count, _, side = WANG
    plane = random_plane(edges_of(count), side, side, SEED)
    laid = [np.concatenate([tiles[n].get_pixels(oiio.FLOAT) for n in row], axis=1) for row in plane]
    return image_of(np.concatenate(laid))


def ways() -> dict[str, Way]:
    """Ways to tile a photo, by the name of the column."""
    ours: dict[str, Way] = {
        f"ours, {measure}": lambda photo, m=measure: filters.stationarize(photo, measure=m, size=TILE, seed=SEED)
        for measure in MEASURES
    }
    ours["by the letter"] = lambda photo: filters.stationarize(photo, paper=True, size=TILE, seed=SEED)
    return {
        "photo": lambda photo: photo,
        "make seamless": seamless,
        "PatchMatch": lambda photo: filters.patchmatch(photo, tiles="none", size=TILE, seed=SEED),
        "toroidal PatchMatch": lambda photo: filters.patchmatch(photo, size=TILE, seed=SEED),
        **ours,
        "dominant texture": of_the_dominant,
        "de-stained": of_the_destained,
        "Wang tiles": plain_wang,
        "ours, Wang tiles": even_wang,
    }


def pane(made: oiio.ImageBuf, times: int) -> np.ndarray:
    """A tile laid out, as a square of `PANE` px."""
    laid = repeated(made.get_pixels(oiio.FLOAT)[..., :3], times, PANE)
    return np.rint(255 * np.clip(laid, 0, 1)).astype(np.uint8)


def cost(made: oiio.ImageBuf) -> float:
    """Stationarity cost of a tile, MJH17 eq. 1 with histograms."""
    return filters.stationarity(made, sigma=SIGMA).spec().get_float_attribute(COST)


def compared(name: str) -> list[str]:
    """Write the picture of a photo; the cells of its row in the table."""
    photo = square(name, SIDE)
    panes, cells = [], []
    for column, way in ways().items():
        try:
            made = way(photo)
        except Error as error:  # no dominant texture, or none wide enough
            print(f"{name}, {column}: {error}")
            panes.append(np.full((PANE, PANE, 3), 230, np.uint8))
            cells.append("none")
            continue
        panes.append(pane(made, 1 if "Wang" in column else 2))
        cells.append(f"{cost(made):.1f}")
    lines = [beside(*panes[n : n + IN_A_LINE]) for n in range(0, len(panes), IN_A_LINE)]
    write_jpeg(stacked(lines), f"comparison_{name}.jpg", quality=65)
    return cells


def failures() -> None:
    """MJH17 figure 8: photos above, tiles below."""
    columns = []
    for name in FAILURES:
        photo = square(name, 320)
        made = filters.stationarize(photo, seed=SEED)
        columns.append(np.concatenate([pane(photo, 1), np.full((8, PANE, 3), 255, np.uint8), pane(made, 2)]))
    write_jpeg(beside(*columns), "comparison_failures.jpg")


HEADING = "## Eleven ways, on eight photos"  # what stands above it is by hand
TEXT = """

Ways that this program has, at {side} x {side} px.

Each pane shows the result 2 x 2. Wang tiles (16) are laid out at random over the same area.
The panes, from left to right and top to bottom:

| pane | method |
|---|---|
| photo | the photo, tiled |
| make seamless | the photo blended with itself shifted by half, as in paint programs |
| PatchMatch | `--texpatchmatch:tiles=none` |
| toroidal PatchMatch | `--texpatchmatch` |
| ours, histogram; moments; steerable | `--texstationarize` with each `measure` (MJH17 section 3) |
| by the letter | the same with `paper=1`, which follows the paper exactly |
| dominant texture | toroidal PatchMatch from the mask of `--texdominant` (LDR09). Gray: no dominant texture |
| de-stained | fill outside that mask (`--texfill`), then toroidal PatchMatch (MJH17 figure 6) |
| Wang tiles | `--texpatchmatch:variants=16` (MJH17 figure 5) |
| ours, Wang tiles | `--texstationarize:variants=16` |

`python -m tools.docs.pictures.comparison` makes this page's pictures.

### Stationarity cost

The table shows MJH17 eq. 1 (histograms, sigma {sigma:g} px, Lab units, one seed). Lower is more uniform, not more
faithful: *by the letter* destroys structure and scores best. So look at the pictures as well. Fidelity, hex tiling
and an independent judge are in the [benchmarks](../../benchmarks/results/tiles.md#judged-from-outside).

{table}

### Pictures

{pictures}

## What fails

![large structure, tiny features, salient shapes](../pictures/comparison_failures.jpg)

*Top: three photos. Bottom: their tiles, 2 x 2 (compare MJH17 figure 8).*

- Long ledges become dashes.
- Features much smaller than sigma repeat: they are too small to be evened out, and too rare to vanish.
- Salient shapes repeat, because a histogram does not see them.

More is in the [gallery](../gallery.md).
"""


def page() -> None:
    """Write the page and its pictures."""
    rows = {name: compared(name) for name in PHOTOS}
    failures()
    names = list(ways())
    table = ["| | " + " | ".join(names) + " |", "|---" * (len(names) + 1) + "|"]
    table += [f"| {name} | " + " | ".join(cells) + " |" for name, cells in rows.items()]
    pictures = "\n\n".join(f"{name}\n\n![{name}](../pictures/comparison_{name}.jpg)" for name in PHOTOS)
    text = TEXT.format(side=SIDE, sigma=SIGMA, table="\n".join(table), pictures=pictures)
    path = Path(__file__).parents[3] / "docs" / "explanation" / "comparison.md"
    path.write_text(path.read_text().partition(HEADING)[0] + HEADING + text)


if __name__ == "__main__":
    draw(page)
