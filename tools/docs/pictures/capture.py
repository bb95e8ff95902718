# SPDX-License-Identifier: Apache-2.0
"""Pictures of the pages about photos as materials: `python -m tools.docs.pictures.capture`, with the test photos."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio

from benchmarks.captures.rendered import materials
from oiiotex import filters
from oiiotex.surfaces.capture.homography import homography
from tests.reference import captures
from tools.docs.pictures.layout import beside, draw, opened, pixels, shrunk, stacked, test_photo, write_jpeg

SLANTS = {
    "facade_tiles.jpg": ((38, 30), (470, 84), (452, 330), (8, 372)),
    "fabric_gingham_weave.jpg": ((120, 20), (400, 30), (500, 360), (-10, 350)),
}


def slanted(photo: oiio.ImageBuf, corners: tuple[tuple[float, float], ...]) -> oiio.ImageBuf:
    """What a camera of 480 x 360 px sees of a photo that lies flat: its corners there are beyond the picture's."""
    spec = photo.spec()
    middle = np.array([240, 180])
    wide = middle + 1.35 * (np.array(corners, float) - middle)
    matrix = np.linalg.inv(homography(wide, spec.width, spec.height))
    roi = oiio.ROI(0, 480, 0, 360, 0, 1, 0, 3)
    seen = oiio.ImageBufAlgo.warp(photo, tuple(map(float, matrix.ravel())), "lanczos3", 0.0, False, "black", roi)
    seen.specmod().set_format(oiio.UINT8)
    seen.specmod().full_width, seen.specmod().full_height = 480, 360
    seen.specmod().attribute("oiio:ColorSpace", "srgb_rec709_scene")
    return seen


def shown(map_: oiio.ImageBuf) -> np.ndarray:
    """A map of floats from 0 to 1 as 8-bit RGB."""
    values = np.rint(255 * np.clip(map_.get_pixels(oiio.FLOAT), 0, 1)).astype(np.uint8)
    return np.repeat(values, 3, axis=2) if values.shape[2] == 1 else values


def rectified() -> None:
    """Two oblique photos, and the results of --texrectify by their lattices."""
    panes = []
    for name, corners in SLANTS.items():
        photo = slanted(opened(f"photos/{name}"), corners)
        panes += [pixels(photo), pixels(shrunk(filters.rectify(photo), 360))]
    write_jpeg(beside(*panes), "rectify_lattices.jpg")


def estimated() -> None:
    """A photo, and the heights, normals, ambient occlusion and roughness that it is taken for."""
    photo = test_photo("pebbles_beach_shadow.jpg", 320)
    made = filters.estimateheight(photo, normal=True)
    occlusion = filters.estimateao(made["height"])
    roughness = filters.estimateroughness(photo)
    maps = (made["height"], made["normal"], occlusion, roughness)
    write_jpeg(beside(pixels(photo), *map(shown, maps)), "estimate_pebbles.jpg")


def captured() -> None:
    """Four of eight photos of wet stone under several lights, and its maps."""
    stone = materials()["wet rock"]
    lights = captures.lights(8, turn=90)
    photos = [
        captures.photo(stone.heights, stone.albedo, light, stone.roughness, 0.04, 0.01, n)
        for n, light in enumerate(lights)
    ]
    albedo, normal, height, roughness = filters.capture(
        *(photo.astype(np.float32) for photo in photos),
        lights=lights.ravel(), roughness=True, colorspace="lin_rec709_scene",
    )  # fmt: skip
    maps = (_srgb(albedo.get_pixels(oiio.FLOAT)), *(shown(each) for each in (normal, height, roughness)))
    write_jpeg(stacked([beside(*map(_srgb, photos[::2])), beside(*maps)]), "capture_stone.jpg")


def _srgb(linear: np.ndarray) -> np.ndarray:
    """8-bit values of linear ones."""
    return np.rint(255 * np.clip(linear, 0, 1) ** (1 / 2.2)).astype(np.uint8)


if __name__ == "__main__":
    draw(rectified, estimated, captured)
