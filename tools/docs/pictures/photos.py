# SPDX-License-Identifier: Apache-2.0
"""The pictures of README and docs, made by the repository's own programs: `python -m tools.docs.pictures.photos`."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import sklearn.datasets
from scipy import ndimage
from scipy.cluster.vq import kmeans2

from benchmarks.shared.peers import CROPS, SYNTHESIZERS
from oiiotex import filters
from oiiotex.analysis.labels.legend import colors_of
from tools.demo import gravel, save, stained
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
    twice,
    write_jpeg,
)

SIDE = 192  # px, longer side of a photo on a sheet
LAYERED = (("rust_barrel_side.jpg", 3), ("moss_grass_stones_ground.jpg", 4), ("sandstone_wall_cracked.jpg", 3))


def demo_pictures() -> None:
    """The demo's photo tiled as it is, by toroidal PatchMatch, and stationarized."""
    with tempfile.TemporaryDirectory() as folder:
        save(stained(gravel()), Path(folder) / "photo.png")
        photo = oiio.ImageBuf(f"{folder}/photo.png")
        photo.read(force=True)
    baseline, tile = filters.patchmatch(photo, seed=7), filters.stationarize(photo, seed=7)
    write_jpeg(beside(*(halved(twice(pixels(b))) for b in (photo, baseline, tile))), "gravel_2x2.jpg")


def dahlia() -> None:
    """README's picture: a photo, and its tile on a plane and on a sphere."""
    photo = oiio.ImageBufAlgo.channels(
        oiio.ImageBuf(str(Path(sklearn.datasets.__path__[0]) / "images" / "flower.jpg")), (0, 1, 2)
    )
    photo.specmod().attribute("oiio:ColorSpace", "srgb_rec709_scene")
    petals = oiio.ImageBufAlgo.cut(photo, oiio.ROI(235, 365, 150, 280))
    tile = filters.stationarize(petals, size=(512, 512), preset="even", seed=7)
    opaque = oiio.ImageBufAlgo.channels(tile, (0, 1, 2, 1.0), ("R", "G", "B", "A"))
    shown = filters.preview(opaque, panels=["plane", "sphere"], panel=320).get_pixels(oiio.UINT8)
    flower = oiio.ImageBufAlgo.cut(photo, oiio.ROI(130, 450, 60, 380))
    write_jpeg(beside(pixels(flower), 255 - shown[..., 3:] + shown[..., :3]), "readme.jpg", quality=85)


def flattened_wall() -> None:
    """A stained wall, flattened, and its map of stationarity."""
    photo = test_photo("stained_plaster_wall.jpg", 320)
    deviation = filters.stationarity(photo).get_pixels(oiio.FLOAT) / 30.0  # white is 30 Lab units
    gray = np.repeat((255 * np.clip(deviation, 0, 1)).astype(np.uint8), 3, axis=2)
    write_jpeg(beside(pixels(photo), pixels(filters.flatten(photo)), gray), "flatten_wall.jpg")


def labeled_photo(name: str, side: int = 512) -> dict[str, oiio.ImageBuf]:
    """A test photo made small, with its label maps."""
    return filters.label(test_photo(f"{name}.jpg", side), photo=True)


def cut_labels() -> None:
    """One label of a photo, and what --texcut makes of it, 2 x 2."""
    rows = []
    for name, level, label in (("flower_meadow_stones", -2, 1), ("fieldstone_wall_kodim01", -2, 1)):
        photo = labeled_photo(name)
        first, *maps = photo.values()
        ids = maps[level].get_pixels(oiio.UINT32)
        label = int(np.bincount(ids.ravel())[1:].argsort()[-label] + 1)
        tile = filters.cut(photo, label=label, labellevel=len(maps) + 1 + level, size=(320, 320), seed=1)
        shown = np.where(ids == label, pixels(first), pixels(first) // 4)
        rows.append(beside(shown, halved(twice(pixels(tile)))))
    write_jpeg(stacked(rows), "cut_labels.jpg")


def painted_meadow() -> None:
    """A palette, a painting at one scale and at two, of a meadow."""
    photo = labeled_photo("flower_meadow_stones", 640)
    first, *maps = photo.values()
    level = len(maps) - 1
    write_jpeg(beside(halved(pixels(first)), pixels(filters.palette(photo, labellevel=level, panel=64))), "palette.jpg")
    y, x = np.mgrid[0:500, 0:700]
    coarse, fine = (
        1 + np.bincount(maps[n - 1].get_pixels(oiio.UINT32).ravel())[1:].argsort()[::-1] for n in (level, level - 1)
    )
    painting = np.where(((x - 350) / 220) ** 2 + ((y - 250) / 170) ** 2 < 1, coarse[1], coarse[0])
    details = np.zeros(painting.shape, int)
    details[60:170, 60:260] = fine[0]
    details[(x - 350) ** 2 + (y - 250) ** 2 < 70**2] = fine[1]
    once = filters.paint(photo, image_of(painting, oiio.UINT32), labellevel=level)
    over = filters.paint(photo, image_of(painting, oiio.UINT32), fine=image_of(details, oiio.UINT32), labellevel=level)
    looks = np.array([[81, 94, 53], [93, 94, 77], [150, 150, 140], [60, 110, 40]], np.uint8)
    plain = looks[np.where(painting == coarse[1], 1, 0)]
    shown = looks[np.select([details == fine[0], details == fine[1], painting == coarse[1]], [2, 3, 1], 0)]
    rows = [beside(halved(a), halved(pixels(b))) for a, b in ((plain, once), (shown, over))]
    write_jpeg(stacked(rows), "paint.jpg")


def composites() -> None:
    """Photos, and larger textures made of them without a guide."""
    rows = []
    for name, below in (("flower_meadow_stones", 1), ("moss_grass_stones_ground", 2)):
        photo = labeled_photo(name, 640)
        made = filters.composite(photo, labellevel=max(1, len(photo) - 1 - below), size=(1280, 800), seed=1)
        rows.append(beside(halved(pixels(next(iter(photo.values())))), halved(pixels(made))))
    write_jpeg(stacked(rows), "composite.jpg")


def layered_textures() -> None:
    """LSA16 figure 7: a photo, its colors in as many clusters as one says, levels of labels from coarse to fine."""
    rows = []
    for name, count in LAYERED:
        photo = test_photo(name)
        lab = filters.lab(photo).get_pixels(oiio.FLOAT)[..., :3]
        _, clusters = kmeans2(lab.reshape(-1, 3).astype(np.float64), count, minit="++", rng=np.random.default_rng(0))
        maps = [clusters.reshape(lab.shape[:2]) + 1]
        found = filters.label(photo)
        levels = list(found.values()) if isinstance(found, dict) else [found]
        maps += [level.get_pixels(oiio.UINT32)[..., 0].astype(int) for level in levels[:-4:-1]]
        panes = [small(pixels(photo), SIDE)]
        for ids in maps:
            pieces = sum(ndimage.label(ids == label)[1] for label in np.unique(ids))
            print(f"{name}: {len(np.unique(ids))} labels in {pieces} pieces")
            panes.append(np.rint(255 * colors_of(small(ids, SIDE))).astype(np.uint8))
        rows.append(beside(*panes))
    write_jpeg(stacked(rows), "label_layers.jpg")


def moved_borders() -> None:
    """LSA16 section 3.2: borders of superpixels at two scales 3 px apart, and of two hierarchies of one scale.

    From the hierarchy; by SLIC alone, where its grid of seeds loses a column; from hierarchies whose seeds differ.
    """
    photo, sigma, side = test_photo("stone_breccia.jpg"), 94.0, 340
    pairs = (
        ({"sigma": sigma}, {"sigma": sigma + 3}),
        ({"sigmamin": sigma}, {"sigmamin": sigma + 3}),
        ({"sigma": sigma}, {"sigma": sigma, "sigmamin": 15.0}),
    )
    panes = []
    for pair in pairs:
        cuts = [filters.superpixel(photo, **choice).get_pixels(oiio.UINT32)[..., 0] for choice in pair]
        edges = [borders(small(cut, side)) for cut in cuts]
        near = [ndimage.binary_dilation(edge, iterations=2) for edge in edges]  # what moved by a pixel has not moved
        shown = small(pixels(photo), side) // 2 + 110
        both = (edges[0] & near[1]) | (edges[1] & near[0])
        for edge, color in ((edges[0], (220, 90, 0)), (edges[1], (0, 70, 220)), (both, (0, 0, 0))):
            shown[edge] = color
        panes.append(shown)
    write_jpeg(beside(*panes), "superpixel_moves.jpg")


def mean_colors() -> None:
    """LSA16 figure 2: superpixels in their mean colors, of the hierarchy, of SLIC, of SLIC of a blurred photo."""
    photo, side = test_photo("stone_breccia.jpg", 512), 240
    spec, seen = photo.spec(), pixels(photo)
    ways: list[list[np.ndarray]] = [[], [], []]
    for count in (400, 100, 40):
        sigma = (spec.width * spec.height / count) ** 0.5
        blurred = photo.copy()
        blurred.set_pixels(blurred.roi, ndimage.gaussian_filter(seen, (sigma / 4, sigma / 4, 0)))
        made = (
            filters.superpixel(photo, count=count),
            *(filters.superpixel(p, sigmamin=sigma) for p in (photo, blurred)),
        )
        for row, ids in zip(ways, made, strict=True):
            row.append(small(averaged(seen, ids.get_pixels(oiio.UINT32)[..., 0]), side))
    write_jpeg(stacked([beside(small(seen, side), *row) for row in ways]), "superpixel_means.jpg")


def averaged(picture: np.ndarray, ids: np.ndarray) -> np.ndarray:
    """Each region's mean color; (h, w, 3) uint8."""
    areas = np.maximum(np.bincount(ids.ravel()), 1)
    means = [np.bincount(ids.ravel(), picture[..., c].ravel()) / areas for c in range(3)]
    return np.rint(np.stack(means, -1)[ids]).astype(np.uint8)


def borders(ids: np.ndarray) -> np.ndarray:
    """Pixels whose left or upper neighbor has another id."""
    edge = np.zeros(ids.shape, bool)
    edge[1:] |= ids[1:] != ids[:-1]
    edge[:, 1:] |= ids[:, 1:] != ids[:, :-1]
    return edge


def quilts() -> None:
    """Test photos and what is quilted from them; a guide and its quilt; the content of a photo."""
    panes = []
    for name in ("castle_brick_broken", "clover_lawn", "onyx_veins"):
        photo = test_photo(f"{name}.jpg", 512)
        quilt = pixels(filters.quilt(photo, size=(768, 512), seed=1))
        panes.append(halved(beside(pixels(photo)[:512], quilt)))
    write_jpeg(np.concatenate(panes), "quilts.jpg")
    parts = labeled_photo("stone_breccia", 768)
    areas = {n: np.bincount(parts[f"label.{n}"].get_pixels(oiio.UINT32).ravel())[1:] for n in range(1, len(parts))}
    level = max(n for n, counts in areas.items() if len(counts) >= 3)
    wanted = 1 + np.argsort(-areas[level], kind="stable")[:3]
    y, x = np.mgrid[:60, :90]
    guide = wanted[np.where(np.hypot(y - 30, x - 30) < 20, 1, np.where(x + 12 * np.sin(y / 8) > 60, 2, 0))]
    quilt = filters.quilt(parts, guide=image_of(guide, oiio.UINT32), labellevel=level, size=(1080, 720), seed=1)
    gray = np.searchsorted(np.sort(wanted), guide) * 100 + 40
    drawn = np.repeat(np.repeat(np.repeat(gray[..., None].astype(np.uint8), 3, 2), 6, 0), 6, 1)
    write_jpeg(beside(drawn, halved(pixels(quilt))), "quilt_guide.jpg")
    marked = pixels(filters.content(parts, center=(300, 300), labellevel=level))
    table = pixels(filters.content(parts, labellevel=level, keys=True))
    height = max(marked.shape[0], table.shape[0])
    panes = [np.pad(p, ((0, height - len(p)), (0, 0), (0, 0)), constant_values=255) for p in (marked, table)]
    write_jpeg(beside(*panes), "content.jpg")


def quilts_beside_peers() -> None:
    """Crops of photos, what the peers that are installed synthesize, --texquilt and its patch=96; at half the size."""
    tools = [tool for tool in SYNTHESIZERS if tool.available()]
    print("compared with quilts:", ", ".join(tool.name for tool in tools) or "no peer, the picture stays as it is")
    if not tools:
        return
    rows, size = [], (400, 300)
    for name, (x, y) in CROPS.items():
        photo = test_photo(f"{name}.jpg")
        crop = np.ascontiguousarray(pixels(photo)[y : y + 256, x : x + 256])
        panes = [halved(crop)]
        with tempfile.TemporaryDirectory() as folder:
            save(crop, Path(folder) / "crop.png")
            for tool in tools:
                tool.run(Path(folder) / "crop.png", Path(folder) / "peer.png", size)
                panes.append(halved(pixels(oiio.ImageBuf(f"{folder}/peer.png"))))
            exemplar = shrunk(oiio.ImageBuf(f"{folder}/crop.png"), 256)
            exemplar.read(force=True)
            panes += [halved(pixels(filters.quilt(exemplar, size=size, patch=p, seed=1))) for p in (None, 96)]
        rows.append(beside(*panes))
    write_jpeg(stacked(rows, 8), "quilt_peers.jpg", quality=60)


if __name__ == "__main__":
    draw(
        quilts, quilts_beside_peers, demo_pictures, dahlia, flattened_wall, cut_labels, painted_meadow, composites,
        layered_textures, moved_borders, mean_colors,
    )  # fmt: skip
