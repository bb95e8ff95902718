# SPDX-License-Identifier: Apache-2.0
"""The pictures of docs/reference/filters/texdominant.md: `python -m tools.docs.pictures.dominant`."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio
from scipy import ndimage

from benchmarks.dominant.composites import TWELVE, composite, mask_by, seen_as
from benchmarks.shared.measures import data_folder
from oiiotex import filters
from oiiotex.analysis.dominant.diffusion import dominant_texture
from oiiotex.analysis.dominant.refinement import pixel_colors, refined_mask
from oiiotex.engine.core.image import from_buffer
from oiiotex.engine.session import Session
from tools.docs.pictures.dominant_chart import COLORS, Plot, diagnostics
from tools.docs.pictures.layout import (
    beside,
    draw,
    halved,
    image_of,
    pixels,
    shrunk,
    small,
    stacked,
    test_photo,
    write_jpeg,
)

MODES = ("diffusion", "euclidean", "spectral")
COLUMNS = (
    "stained_plaster_wall.jpg", "castle_brick_broken.jpg", "chalkboard_scratched.jpg", "rust_barrel_side.jpg",
    "sail_cloth_stained.jpg", "rebar_concrete_decayed.jpg",
)  # fmt: skip


def kept_alone(photo: oiio.ImageBuf, mode: str = "diffusion") -> np.ndarray:
    """The photo inside a mask, on white; all white if it is rejected."""
    mask = mask_by(from_buffer(photo), mode)
    return np.where(mask[..., None], pixels(photo), 255).astype(np.uint8)


def dominant_columns() -> None:
    """LDR09 figure 6: photos, what is dominant in them, the same by eq. 7, the larger half of a normalized cut."""
    panes = []
    for name in COLUMNS:
        photo = test_photo(name, 160)
        panes.append(beside(pixels(photo), *(kept_alone(photo, m) for m in MODES)))
    pairs = [beside(*panes[n : n + 2], gap=24) for n in range(0, len(panes), 2)]
    write_jpeg(stacked(pairs), "dominant_columns.jpg")


def every_photo() -> None:
    """All test photos, each next to its dominant texture."""
    panes = []
    for path in sorted((data_folder() / "photos").iterdir()):
        photo = test_photo(path.name, 256)
        panes.append(small(beside(pixels(photo), kept_alone(photo), gap=4), 224))
    rows = [beside(*panes[n : n + 4], gap=16) for n in range(0, len(panes), 4)]
    write_jpeg(stacked(rows), "dominant_photos.jpg")


def every_composite() -> None:
    """The composites of benchmarks/dominant/composites.py: picture, what is kept of it, what should be."""
    session, panes = Session(), []
    for n in range(len(TWELVE)):
        _, picture, truth = composite(n)
        seen = seen_as(picture, session)
        mask = refined_mask(dominant_texture(seen, session.resources, session.progress), seen, pixel_colors(seen))
        shown = [picture, *(np.where(kept[..., None], picture, 1) for kept in (mask, truth))]
        panes.append(beside(*(np.rint(255 * p).astype(np.uint8) for p in shown), gap=4))
    rows = [beside(*panes[n : n + 2], gap=24) for n in range(0, len(panes), 2)]
    write_jpeg(stacked(rows), "dominant_composites.jpg")


def painted_wall() -> np.ndarray:
    """LDR09 figure 8: paint that is plain at the left and ever more spotted to the right."""
    y, x = np.mgrid[0:160, 0:240]
    spots = ndimage.gaussian_filter(np.random.default_rng(3).normal(0, 1, y.shape), 2.5, mode="wrap")
    spots = (spots / spots.std() > 2.6 - 2.2 * x / x.max())[..., None] * 1.0
    spots = ndimage.gaussian_filter(spots, (0.6, 0.6, 0))
    return np.rint(255 * (np.array([0.75, 0.7, 0.6]) * (1 - spots) + np.array([0.35, 0.2, 0.12]) * spots)).astype(
        np.uint8
    )


def dominant_failures() -> None:
    """LDR09 figure 8: a smooth transition, and cracks of all directions and widths."""
    photos = shrunk(image_of(painted_wall() / 255), 240), test_photo("sandstone_wall_cracked.jpg", 240)
    panes = [beside(pixels(photo), kept_alone(photo)) for photo in photos]
    write_jpeg(beside(*panes, gap=24), "dominant_failures.jpg")


def clean_quilt() -> None:
    """A photo, its dominant texture, a quilt of that alone, a quilt of the whole."""
    photo = test_photo("stained_plaster_wall.jpg", 384)
    mask = filters.dominant(photo, photo=True)["dominant"]
    quilts = [filters.quilt(photo, size=(384, 384), patch=48, seed=1, **m) for m in ({"mask": mask}, {})]
    left = np.where(mask.get_pixels(oiio.FLOAT) > 0.5, pixels(photo), 255).astype(np.uint8)
    write_jpeg(halved(beside(pixels(photo), left, *(pixels(q) for q in quilts))), "dominant_quilt.jpg")


def texel_points() -> None:
    """LDR09 figures 3 and 4: plots of how a texture was found; texels on their components, by density and by type."""
    session, photo = Session(), pixels(test_photo("stained_plaster_wall.jpg", 384))
    found = dominant_texture(seen_as(photo / 255.0, session), session.resources, session.progress)
    write_jpeg(np.rint(255 * diagnostics(found)).astype(np.uint8), "dominant_chart.jpg")
    density = np.log(np.maximum(found.density, 1e-9))
    order = np.argsort(density)  # the dense ones above
    share = np.linspace(0, 1, len(order))[:, None]
    colors = np.empty((len(order), 3))
    colors[order] = np.clip(1.5 - np.abs(4 * share - [3.0, 2.0, 1.0]), 0, 1)  # blue, green, red
    of_type = np.array(COLORS)[found.types]
    panels = []
    for across, up, shown in ((0, 1, colors), (2, 1, colors), (0, 1, of_type)):
        panel = Plot(found.texels.values[:, across], found.texels.values[:, up])
        panel.texts.append((f"component {up + 1} over {across + 1}", 44, 16))
        row, column = panel.place(found.texels.values[:, across], found.texels.values[:, up])
        panel.pixels[row[order], column[order]] = shown[order]
        panels.append(np.rint(255 * panel.drawn()).astype(np.uint8))
    write_jpeg(beside(*panels), "dominant_texels.jpg")


if __name__ == "__main__":
    draw(texel_points, dominant_columns, dominant_failures, clean_quilt, every_photo, every_composite)
