# SPDX-License-Identifier: Apache-2.0
"""The pictures of the pages of --texstationarize and --texpreview: `python -m tools.docs.pictures.stationarize`."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from oiiotex import filters
from oiiotex.synthesis.wang.tiles import edges_of
from tools.demo import gravel, save, stained
from tools.docs.pictures.layout import (
    beside,
    draw,
    halved,
    image_of,
    opened,
    pixels,
    shrunk,
    stacked,
    test_photo,
    write_jpeg,
)
from tools.docs.pictures.wang_plane import random_plane

SEED = 7


def ellipse(photo: oiio.ImageBuf, x: float, y: float, across: float, down: float) -> np.ndarray:
    """A mask, (height, width) bool; center and half axes as shares of the photo."""
    v, u = np.mgrid[0 : photo.spec().height, 0 : photo.spec().width]
    v, u = v / photo.spec().height, u / photo.spec().width
    return ((u - x) / across) ** 2 + ((v - y) / down) ** 2 < 1


def stained_gravel() -> oiio.ImageBuf:
    """The demo's photo."""
    with tempfile.TemporaryDirectory() as folder:
        save(stained(gravel()), Path(folder) / "photo.png")
        photo = oiio.ImageBuf(f"{folder}/photo.png")
        photo.read(force=True)
    return photo


def filled(photo: oiio.ImageBuf, marked: np.ndarray, **values: object) -> np.ndarray:
    """A photo, the region, and the photo filled, at half the size."""
    made = filters.fill(photo, image_of(marked), seed=SEED, **values)
    shown = np.where(marked[..., None], pixels(photo) // 2, pixels(photo))
    return halved(beside(pixels(photo), shown, pixels(made)))


def stains_removed() -> None:
    """Regions that are filled: gravel and a wall from themselves, soil from a lawn."""
    rows = []
    wall = test_photo("stained_plaster_wall.jpg", 512)
    for photo, place in ((stained_gravel(), (0.66, 0.36, 0.2, 0.17)), (wall, (0.53, 0.45, 0.12, 0.18))):
        rows.append(filled(photo, ellipse(photo, *place)))
    source, photo = (test_photo(f"{name}.jpg", 512) for name in ("clover_lawn", "moss_grass_stones_ground"))
    lit = pixels(photo) * np.linspace(1, 0.6, 512)[None, :, None]
    photo.set_pixels(photo.roi, np.ascontiguousarray(lit / 255, np.float32))
    rows.append(filled(photo, ellipse(photo, 0.55, 0.5, 0.38, 0.2), donor=source))
    write_jpeg(stacked(rows), "fill_repair.jpg")


def gradient_of_sigmas() -> None:
    """MJH17 figures 10 and 11, first row: sigma grows from left to right, linearly, over a photo of rust."""
    photo = test_photo("rust_barrel_side.jpg", 768)
    ramp = np.linspace(4, 128, 768)[None, :].repeat(256, 0)
    made = filters.stationarize(photo, size=(768, 256), sigmamap=image_of(ramp), tiles="y", seed=SEED)
    write_jpeg(stacked([pixels(photo)[:256], pixels(made)]), "stationarize_sigmamap.jpg")


def maps_of_rock(side: int, *names: str) -> list[oiio.ImageBuf]:
    """Maps of a rock; all but colors and normals have one channel."""
    maps = [shrunk(opened(f"pbr/mossy_rock/mossy_rock_{name}.jpg"), side) for name in names]
    gray = (name not in ("albedo", "normal") for name in names)
    return [oiio.ImageBufAlgo.channels(m, (0,)) if one else m for m, one in zip(maps, gray, strict=True)]


def material_set() -> None:
    """Albedo, normals, roughness and height of a rock, and their tiles, made together."""
    maps = maps_of_rock(384, "albedo", "normal", "roughness", "height")
    made = filters.stationarize(maps[0], maps=maps[1:], kinds=("color", "normal", "data", "data"), seed=SEED)
    rows = [beside(*(np.broadcast_to(pixels(m), (384, 384, 3)) for m in row)) for row in (maps, made)]
    write_jpeg(halved(stacked(rows)), "stationarize_material.jpg")


def levelled_heights() -> None:
    """The relief of a rock, lit from the upper left: the photo's, led by colors alone, matched, and levelled."""
    albedo, height = maps_of_rock(256, "albedo", "height")
    height = oiio.ImageBufAlgo.copy(height, "float")
    ways = ({"mapweights": (1, 0)}, {}, {"relevel": True})
    made = [filters.stationarize(albedo, maps=[height], kinds=("color", "height"), seed=SEED, **way)[1] for way in ways]
    write_jpeg(beside(*map(lit, (height, *made))), "stationarize_heights.jpg")


def lit(height: oiio.ImageBuf, steepness: float = 25) -> np.ndarray:
    """A height map shaded by its slopes, 8-bit gray in three channels."""
    values = height.get_pixels(oiio.FLOAT, height.roi)[..., 0]
    down, right = (steepness * np.gradient(values, axis=axis) for axis in (0, 1))
    shade = (0.8 - 0.5 * (right + down)) / np.sqrt(1 + right**2 + down**2)
    return np.repeat(np.rint(255 * np.clip(shade, 0, 1)).astype(np.uint8)[..., None], 3, -1)


def wang_plane() -> None:
    """One tile of moss again and again, and 16 Wang tiles of the same photo laid out at random."""
    photo, size = test_photo("moss_grass_stones_ground.jpg", 384), (128, 128)
    one = pixels(filters.stationarize(photo, size=size, seed=SEED))
    tiles = [pixels(tile) for tile in filters.stationarize(photo, size=size, variants=16, seed=SEED)]
    plane = random_plane(edges_of(16), 4, 6, SEED)
    laid = np.concatenate([np.concatenate([tiles[n] for n in row], axis=1) for row in plane])
    write_jpeg(stacked([np.tile(one, (2, 6, 1)), laid]), "stationarize_wang.jpg", quality=50)


def previewed() -> None:
    """What --texpreview shows of the demo's tile."""
    photo = stained_gravel()
    tile = filters.stationarize(photo, seed=SEED)
    write_jpeg(pixels(filters.preview(tile, exemplar=photo, panel=224)), "preview.jpg")


if __name__ == "__main__":
    draw(stains_removed, gradient_of_sigmas, material_set, levelled_heights, wang_plane, previewed)
