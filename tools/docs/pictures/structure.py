# SPDX-License-Identifier: Apache-2.0
"""The sheet of structures in the page of --texstationarize: `python -m tools.docs.pictures.structure`.

Photos next to their tiles by default and by the presets large, even and clean.
"""

from __future__ import annotations

import numpy as np

from oiiotex import filters
from tools.docs.pictures.layout import beside, draw, pixels, stacked, test_photo, write_jpeg

SEED = 1
PHOTOS = (
    "stained_plaster_wall.jpg", "rebar_concrete_decayed.jpg", "fieldstone_wall_kodim01.jpg",
    "naip_prairie_potholes_2014_rgbn.tif", "drone_track_grass_soil.jpg", "sandstone_wall_cracked.jpg",
    "chalkboard_scratched.jpg", "sail_cloth_stained.jpg", "rust_barrel_side.jpg", "stone_breccia.jpg",
    "onyx_veins.jpg", "moss_grass_stones_ground.jpg",
)  # fmt: skip


def row(name: str, side: int = 256) -> np.ndarray:
    """A photo and its four tiles."""
    photo = test_photo(name, side)
    ways = ({}, {"preset": "large"}, {"preset": "even"}, {"preset": "clean"})
    tiles = (filters.stationarize(photo, seed=SEED, **way) for way in ways)
    height = round(0.75 * side)  # so that rows are of one height
    return beside(pixels(photo)[:height], *(pixels(tile)[:height] for tile in tiles))


def structures() -> None:
    """One row for each photo."""
    write_jpeg(stacked([row(name) for name in PHOTOS]), "stationarize_structures.jpg", quality=60)


if __name__ == "__main__":
    draw(structures)
