# SPDX-License-Identifier: Apache-2.0
"""The pictures of the pages of --texstationarize and --texpreview: `python -m tools.docs.pictures.stationarize`."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from oiiotex import filters
from oiiotex.wang.tiles import edges_of
from tools.demo import gravel, save, stained
from tools.docs.pictures.layout import beside, halved, pixels, shrunk, stacked, test_photo, write_jpeg
from tools.docs.pictures.wang_plane import random_plane

SEED = 7


def one_channel(values: np.ndarray) -> oiio.ImageBuf:
    """(height, width) floats as an image."""
    made = oiio.ImageBuf(oiio.ImageSpec(values.shape[1], values.shape[0], 1, oiio.FLOAT))
    made.set_pixels(made.roi, np.ascontiguousarray(values[..., None], np.float32))
    return made


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


def stains_removed() -> None:
    """A photo, the region, and the photo filled: gravel and a wall from themselves, soil from a lawn."""
    rows = []
    wall = test_photo("stained_plaster_wall.jpg")
    cases = [(stained_gravel(), (0.66, 0.36, 0.2, 0.17))]
    cases += [] if wall is None else [(shrunk(wall, 512), (0.53, 0.45, 0.12, 0.18))]
    for photo, place in cases:
        marked = ellipse(photo, *place)
        made = filters.fill(photo, one_channel(marked), seed=SEED)
        shown = np.where(marked[..., None], pixels(photo) // 2, pixels(photo))
        rows.append(halved(beside(pixels(photo), shown, pixels(made))))
    clover, ground = (test_photo(f"{name}.jpg") for name in ("clover_lawn", "moss_grass_stones_ground"))
    if clover is not None and ground is not None:
        photo, source = shrunk(ground, 512), shrunk(clover, 512)
        lit = pixels(photo) * np.linspace(1, 0.6, 512)[None, :, None]
        photo.set_pixels(photo.roi, np.ascontiguousarray(lit / 255, np.float32))
        marked = ellipse(photo, 0.55, 0.5, 0.38, 0.2)
        made = filters.fill(photo, one_channel(marked), source=source, seed=SEED)
        shown = np.where(marked[..., None], pixels(photo) // 2, pixels(photo))
        rows.append(halved(beside(pixels(photo), shown, pixels(made))))
    write_jpeg(stacked(rows), "fill_repair.jpg")


def gradient_of_sigmas(side: tuple[int, int] = (768, 256)) -> None:
    """MJH17 figures 10 and 11, first row: sigma grows from left to right, linearly, over a photo of rust."""
    photo = test_photo("rust_barrel_side.jpg")
    if photo is None:
        return
    photo = shrunk(photo, 768)
    ramp = np.linspace(4, 128, side[0])[None, :].repeat(side[1], 0)
    made = filters.stationarize(photo, size=side, sigmamap=one_channel(ramp), tile="y", seed=SEED)
    write_jpeg(stacked([pixels(photo)[: side[1]], pixels(made)]), "stationarize_sigmamap.jpg")


def material_set(side: int = 384) -> None:
    """Albedo, normals, roughness and height of a rock, and their tiles, made together."""
    folder = Path(os.environ.get("OIIOTEX_TEST_DATA", "../shared/data")) / "pbr" / "mossy_rock"
    names = ("albedo", "normal", "roughness", "height")
    if not folder.is_dir():
        print(f"no {folder}: its picture stays as it is")
        return
    maps = [shrunk(oiio.ImageBuf(str(folder / f"mossy_rock_{name}.jpg")), side) for name in names]
    gray = [maps[0], maps[1], *(oiio.ImageBufAlgo.channels(m, (0,)) for m in maps[2:])]
    made = filters.stationarize(gray[0], maps=gray[1:], kinds=("color", "normal", "data", "data"), seed=SEED)
    rows = [beside(*(np.broadcast_to(pixels(m), (side, side, 3)) for m in row)) for row in (maps, made)]
    write_jpeg(halved(stacked(rows)), "stationarize_material.jpg")


def levelled_heights(side: int = 256) -> None:
    """The relief of a rock, lit from the upper left: the photo's, led by colors alone, matched, and levelled."""
    folder = Path(os.environ.get("OIIOTEX_TEST_DATA", "../shared/data")) / "pbr" / "mossy_rock"
    if not folder.is_dir():
        print(f"no {folder}: its picture stays as it is")
        return
    albedo, height = (
        shrunk(oiio.ImageBuf(str(folder / f"mossy_rock_{name}.jpg")), side) for name in ("albedo", "height")
    )
    height = oiio.ImageBufAlgo.copy(oiio.ImageBufAlgo.channels(height, (0,)), "float")
    ways = ({"match": (1, 0)}, {}, {"relevel": True})
    made = [filters.stationarize(albedo, maps=[height], kinds=("color", "height"), seed=SEED, **way)[1] for way in ways]
    write_jpeg(beside(*map(lit, (height, *made))), "stationarize_heights.jpg")


def lit(height: oiio.ImageBuf, steepness: float = 25) -> np.ndarray:
    """A height map shaded by its slopes, 8-bit gray in three channels."""
    values = height.get_pixels(oiio.FLOAT, height.roi)[..., 0]
    down, right = (steepness * np.gradient(values, axis=axis) for axis in (0, 1))
    shade = (0.8 - 0.5 * (right + down)) / np.sqrt(1 + right**2 + down**2)
    return np.repeat(np.rint(255 * np.clip(shade, 0, 1)).astype(np.uint8)[..., None], 3, -1)


def wang_plane(side: int = 128, rows: int = 4, columns: int = 6) -> None:
    """One tile of moss again and again, and 16 Wang tiles of the same photo laid out at random."""
    photo = test_photo("moss_grass_stones_ground.jpg")
    if photo is None:
        return
    photo = shrunk(photo, 384)
    one = pixels(filters.stationarize(photo, size=(side, side), seed=SEED))
    tiles = [pixels(tile) for tile in filters.stationarize(photo, size=(side, side), variants=16, seed=SEED)]
    plane = random_plane(edges_of(16), rows, columns, SEED)
    laid = np.concatenate([np.concatenate([tiles[n] for n in row], axis=1) for row in plane])
    write_jpeg(stacked([np.tile(one, (rows // 2, columns, 1)), laid]), "stationarize_wang.jpg", quality=50)


def previewed() -> None:
    """What --texpreview shows of the demo's tile."""
    photo = stained_gravel()
    tile = filters.stationarize(photo, seed=SEED)
    write_jpeg(pixels(filters.preview(tile, exemplar=photo, height=224)), "preview.jpg")


if __name__ == "__main__":
    stains_removed()
    gradient_of_sigmas()
    material_set()
    levelled_heights()
    wang_plane()
    previewed()
