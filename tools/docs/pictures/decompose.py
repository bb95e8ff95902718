# SPDX-License-Identifier: Apache-2.0
"""The pictures of the page of --texdecompose: `python -m tools.docs.pictures.decompose`, with the test photos."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio

from benchmarks.labels.levels import Case, cases
from benchmarks.shared.mosaics import suite
from benchmarks.subtextures.decompose import CLIQUES, SETTINGS, grouped_by, subtextures_of
from oiiotex import filters
from oiiotex.analysis.labels.legend import colors_of
from oiiotex.analysis.segmentation.subtextures import usual
from oiiotex.engine.core.image import from_buffer, to_buffer
from tools.docs.pictures.layout import (
    beside,
    draw,
    halved,
    opened,
    pixels,
    shrunk,
    small,
    stacked,
    test_photo,
    write_jpeg,
)

SIDE = 128  # px, of a pane
LANDSCAPES = (
    "gt/drone_scrub_tree_soil_road.jpg", "gt/drone_forest_road_lawn.jpg", "photos/drone_forest_canopy.jpg",
    "photos/drone_track_grass_soil.jpg", "photos/fieldstone_wall_kodim01.jpg",
    "photos/naip_prairie_potholes_2014_rgbn.tif",
)  # fmt: skip
UNSHIFTED = ("drone_track_grass_soil.jpg", "moss_grass_stones_ground.jpg", "castle_brick_broken.jpg")
COMPOSED = (
    ("photos/moss_grass_stones_ground.jpg", {"radius": 24}, None), ("photos/castle_brick_broken.jpg", {}, None),
    ("photos/onyx_veins.jpg", {"threshold": 0.6}, 64),
)  # fmt: skip


def painted(ids: np.ndarray, side: int = SIDE) -> np.ndarray:
    """Labels in distinct colors."""
    return np.rint(255 * colors_of(small(ids, side).astype(int))).astype(np.uint8)


def labels_of(case: Case, setting: str) -> np.ndarray:
    """Subtextures of a case by a setting of `benchmarks.subtextures.decompose`."""
    settings, changes = SETTINGS[setting]
    with grouped_by(setting, len(np.unique(case.truth[case.truth > 0]))):
        return subtextures_of(case.image, settings, **changes)


def mosaics() -> None:
    """Each mosaic at hand: picture, truth, default, without the search, normalized cuts told the count, the paper's."""
    rows = []
    for case in cases("mosaic"):
        ways = "default", "cliques, shift=0", "normalized cuts, count told", "paper, grid"
        maps = [case.truth, *(labels_of(case, way) for way in ways)]
        rows.append(beside(small(pixels(to_buffer(case.image.first)), SIDE), *map(painted, maps)))
    write_jpeg(stacked(rows, 6), "decompose_mosaics.jpg", 70)


def judged() -> None:
    """The first mosaics of the half that no parameter was set on: picture, truth, default."""
    panes = []
    for case in suite("judge", 12):
        picture = small(pixels(to_buffer(case.image.first)), SIDE)
        panes.append(beside(picture, painted(case.truth), painted(labels_of(case, "default")), gap=2))
    write_jpeg(stacked([beside(*panes[n : n + 3]) for n in range(0, len(panes), 3)], 6), "decompose_judged.jpg", 70)


def landscapes() -> None:
    """CZF02 figure 8: outdoor photos and their subtextures."""
    panes = []
    for name in LANDSCAPES:
        photo = shrunk(opened(name), 512)
        ids = filters.decompose(photo).get_pixels(oiio.UINT32)[..., 0]
        panes.append(beside(small(pixels(photo), 192), painted(ids, 192), gap=2))
    write_jpeg(stacked([beside(*panes[n : n + 2]) for n in range(0, len(panes), 2)], 6), "decompose_landscapes.jpg")


def composites() -> None:
    """CZF02 figure 7: photos, their subtextures, and what is composed of these at one and a half times the width."""
    rows = []
    for name, values, patch in COMPOSED:
        photo = shrunk(opened(name), 512)
        parts = filters.decompose(photo, photo=True, **values)
        made = filters.composite(parts, size=(768, 512), patch=patch)
        ids = parts["label.1"].get_pixels(oiio.UINT32)[..., 0]
        rows.append(beside(halved(pixels(photo)), painted(ids, 256), halved(pixels(made))))
    write_jpeg(stacked(rows, 6), "decompose_composite.jpg", 65)


def unshifted() -> None:
    """Photos, their subtextures, and those that plain comparison finds."""
    rows = []
    for name in UNSHIFTED:
        photo = test_photo(name, 512)
        row = [small(pixels(photo), 192)]
        for changes in (CLIQUES, {**CLIQUES, "shift": 0}):
            ids = subtextures_of(from_buffer(photo), usual, **changes)
            print(f"{name} {changes}: {ids.max()} subtextures")
            row.append(painted(ids, 192))
        rows.append(beside(*row))
    write_jpeg(stacked(rows), "decompose.jpg")


if __name__ == "__main__":
    draw(mosaics, judged, landscapes, composites, unshifted)
