# SPDX-License-Identifier: Apache-2.0
"""The picture of planes of hexagons: `python -m tools.docs.pictures.hexagons`."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio
from oiiotex_studio.materials.hexagons import blended, gaussianized

from oiiotex.engine.color.srgb import decoded, encoded
from oiiotex.surfaces.charts.tile_preview import repeated
from tools.docs.pictures.layout import beside, draw, opened, stacked, write_jpeg

PHOTOS = "clover_lawn", "sandstone_wall_cracked", "castle_brick_broken"
TILE, ACROSS = 128, 2  # px of a tile in the picture, and tiles along a side


def tile_of(name: str) -> np.ndarray:
    """The middle of a photo, crossfaded at its borders so that it tiles: linear, (TILE, TILE, 3)."""
    photo = opened(f"photos/{name}.jpg")
    side = min(photo.spec().width, photo.spec().height)
    left, top = (photo.spec().width - side) // 2, (photo.spec().height - side) // 2
    middle = oiio.ImageBufAlgo.cut(photo, oiio.ROI(left, left + side, top, top + side))
    width = TILE + TILE // 8
    texels = decoded(oiio.ImageBufAlgo.resize(middle, roi=oiio.ROI(0, width, 0, width)).get_pixels(oiio.FLOAT)[..., :3])
    for axis in (0, 1):
        lines = np.moveaxis(texels, axis, 0)
        share = (np.arange(TILE // 8) + 0.5) / (TILE // 8)
        begin = lines[:TILE].copy()
        begin[: TILE // 8] = lines[TILE:] + (lines[: TILE // 8] - lines[TILE:]) * share[:, None, None]
        texels = np.moveaxis(begin, 0, axis)
    return texels


def hexagons() -> None:
    """A tile repeated above its plane of hexagons, for three photos."""
    side = TILE * ACROSS
    u, v = np.meshgrid(*[(np.arange(side) + 0.5) / TILE] * 2)
    tiles = [tile_of(name) for name in PHOTOS]
    planes = [np.clip(blended(gaussianized(tile), u, v), 0, 1) for tile in tiles]
    rows = [[repeated(tile, ACROSS, side) for tile in tiles], planes]
    shown = [beside(*(np.rint(255 * encoded(one)).astype(np.uint8) for one in row)) for row in rows]
    write_jpeg(stacked(shown), "hexagons.jpg")


if __name__ == "__main__":
    draw(hexagons)
