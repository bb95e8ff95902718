# SPDX-License-Identifier: Apache-2.0
"""The pictures of measures and sigmas: `python -m tools.docs.pictures.measures [FUNCTION ...]`."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio

from oiiotex import filters
from oiiotex.analysis.stationarity.measures import scale_folder
from oiiotex.engine.color.lab import working_values
from oiiotex.engine.core.image import from_buffer
from oiiotex.engine.session import Session
from oiiotex.filters.texstationarize import Stationarize
from oiiotex.synthesis.exemplar.sigma_scale import DEFAULT_COUNT, SigmaTiles, perceived_scale
from tools.docs.pictures.layout import beside, draw, image_of, pixels, stacked, test_photo, twice, write_jpeg

RUST = "rust_barrel_side.jpg"


def measures() -> None:
    """A photo's maps and its tiles by the three measures, and toroidal PatchMatch; 2 x 2."""
    photo = test_photo(RUST, 192)
    kinds = [{}, {"measure": "moments"}, {"measure": "steerable"}]
    maps = [filters.stationarity(photo, **kind).get_pixels(oiio.FLOAT)[..., 0] for kind in kinds]
    shown = [np.repeat((255 * m / m.max()).astype(np.uint8)[..., None], 3, 2) for m in maps]
    tiles = [filters.patchmatch(photo, seed=1), *(filters.stationarize(photo, seed=1, **kind) for kind in kinds)]
    above, below = beside(pixels(photo), *shown), beside(*(twice(pixels(tile)) for tile in tiles))
    write_jpeg(stacked([above, below]), "measures.jpg", quality=60)


def sigmas() -> None:
    """The contact sheet of --texsigmas."""
    write_jpeg(pixels(filters.sigmas(test_photo(RUST, 256), count=6)), "sigmas.jpg", quality=60)


def gradients(size: tuple[int, int] = (768, 128)) -> None:
    """MJH17 figure 11: a strip whose sigma rises evenly from left to right, and below one that looks as if it did."""
    strips = []
    session = Session()
    for name in (RUST, "stained_plaster_wall.jpg"):
        photo = test_photo(name, 256)
        image = from_buffer(photo)
        lab, _ = working_values(image, session.resources)
        recipe = Stationarize(exemplar=image).recipe(256, 256)
        tiles = SigmaTiles(session.resources.device, lab, None, recipe, session.resources.budget, "nothing")
        scale = perceived_scale(tiles, DEFAULT_COUNT, session.progress.advance, scale_folder())
        low, high = tiles.limits()
        even = np.linspace(0, 1, size[0])
        for row in (low + (high - low) * even, np.array([scale.sigma_at(1 - a) for a in even])):
            sigmas_along = image_of(np.tile(row, (size[1], 1)))
            strips.append(pixels(filters.stationarize(photo, size=size, sigmamap=sigmas_along, seed=1)))
            strips.append(np.full((6, size[0], 3), 255, np.uint8))
    write_jpeg(np.concatenate(strips[:-1]), "sigma_gradients.jpg", quality=65)


if __name__ == "__main__":
    draw(measures, sigmas, gradients)
