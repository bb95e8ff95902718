# SPDX-License-Identifier: Apache-2.0
"""The pictures of measures and sigmas: `python -m tools.docs.pictures.measures [FUNCTION ...]`."""

from __future__ import annotations

import sys

import numpy as np
import OpenImageIO as oiio

from oiiotex import filters
from oiiotex.color.lab import working_values
from oiiotex.core.image import from_buffer
from oiiotex.exemplar.sigma_scale import DEFAULT_COUNT, SigmaTiles, perceived_scale
from oiiotex.filters.texstationarize import Stationarize
from oiiotex.session import Session
from oiiotex.stationarity.measures import scale_folder
from tools.docs.pictures.layout import beside, pixels, shrunk, test_photo, twice, write_jpeg

RUST = "rust_barrel_side.jpg"


def measures() -> None:
    """A photo's maps and its tiles by the three measures, and toroidal PatchMatch; 2 x 2."""
    photo = test_photo(RUST)
    if photo is None:
        return
    photo = shrunk(photo, 192)
    kinds = [{}, {"measure": "moments"}, {"measure": "steerable"}]
    maps = [filters.stationarity(photo, **kind).get_pixels(oiio.FLOAT)[..., 0] for kind in kinds]
    shown = [np.repeat((255 * m / m.max()).astype(np.uint8)[..., None], 3, 2) for m in maps]
    tiles = [filters.patchmatch(photo, seed=1), *(filters.stationarize(photo, seed=1, **kind) for kind in kinds)]
    above = beside(pixels(photo), *shown, gap=8)
    below = beside(*(twice(pixels(tile)) for tile in tiles))
    height, width = above.shape[0] + below.shape[0] + 8, max(above.shape[1], below.shape[1])
    sheet = np.full((height, width, 3), 255, np.uint8)
    sheet[: above.shape[0], : above.shape[1]] = above
    sheet[above.shape[0] + 8 :, : below.shape[1]] = below
    write_jpeg(sheet, "measures.jpg", quality=60)


def sigmas() -> None:
    """The contact sheet of --texsigmas."""
    photo = test_photo(RUST)
    if photo is not None:
        write_jpeg(pixels(filters.sigmas(shrunk(photo, 256), n=6)), "sigmas.jpg", quality=60)


def gradients(size: tuple[int, int] = (768, 128)) -> None:
    """MJH17 figure 11: a strip whose sigma rises evenly from left to right, and below one that looks as if it did."""
    strips = []
    session = Session()
    for name in (RUST, "stained_plaster_wall.jpg"):
        photo = test_photo(name)
        if photo is None:
            return
        photo = shrunk(photo, 256)
        image = from_buffer(photo)
        lab, _ = working_values(image, session.resources)
        recipe = Stationarize(exemplar=image).recipe(256, 256)
        tiles = SigmaTiles(session.resources.device, lab, None, recipe, session.resources.budget, "nothing")
        scale = perceived_scale(tiles, DEFAULT_COUNT, session.progress.advance, scale_folder())
        low, high = tiles.limits()
        even = np.linspace(0, 1, size[0])
        for row in (low + (high - low) * even, np.array([scale.sigma_at(1 - a) for a in even])):
            held = oiio.ImageBuf(oiio.ImageSpec(*size, 1, oiio.FLOAT))
            held.set_pixels(held.roi, np.tile(row.astype(np.float32), (size[1], 1))[..., None])
            strips.append(pixels(filters.stationarize(photo, size=size, sigmamap=held, seed=1)))
            strips.append(np.full((6, size[0], 3), 255, np.uint8))
    write_jpeg(np.concatenate(strips[:-1]), "sigma_gradients.jpg", quality=65)


if __name__ == "__main__":
    for name in sys.argv[1:] or ("measures", "sigmas", "gradients"):
        {"measures": measures, "sigmas": sigmas, "gradients": gradients}[name]()
