# SPDX-License-Identifier: Apache-2.0
"""The pictures of README and docs, made by the repository's own programs: `python -m docs.pictures`."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from scipy import ndimage
from scipy.cluster.vq import kmeans2

from benchmarks.peers import CROPS, SYNTHESIZERS
from docs.demo import gravel, save, stained
from oiiotex import filters
from oiiotex.filters.labelview import distinct_colours

FOLDER = Path(__file__).parent / "pictures"
SIDE = 192  # px, longer side of a photo on a contact sheet
PER_SHEET = 6
MODES = ("diffusion", "euclidean", "spectral")
COLUMNS = (
    "stained_plaster_wall.jpg", "castle_brick_broken.jpg", "chalkboard_scratched.jpg", "rust_barrel_side.jpg",
    "sail_cloth_stained.jpg", "rebar_concrete_decayed.jpg",
)  # fmt: skip
LAYERED = (("rust_barrel_side.jpg", 3), ("moss_grass_stones_ground.jpg", 4), ("sandstone_wall_cracked.jpg", 3))


def write_jpeg(pixels: np.ndarray, name: str, quality: int = 75) -> None:
    """Save a picture small enough for a repository."""
    buffer = oiio.ImageBuf(oiio.ImageSpec(pixels.shape[1], pixels.shape[0], 3, oiio.UINT8))
    buffer.set_pixels(buffer.roi, np.ascontiguousarray(pixels))
    buffer.specmod().attribute("Compression", f"jpeg:{quality}")
    FOLDER.mkdir(exist_ok=True)
    if not buffer.write(str(FOLDER / name)):
        raise SystemExit(buffer.geterror())
    print(FOLDER / name, (FOLDER / name).stat().st_size // 1024, "KB")


def shrunk(photo: oiio.ImageBuf, side: int) -> oiio.ImageBuf:
    """8-bit sRGB RGB with its longer side at most `side`."""
    spec = photo.spec()
    if spec.nchannels > 3:
        photo = oiio.ImageBufAlgo.channels(photo, (0, 1, 2))
    elif spec.nchannels == 1:
        photo = oiio.ImageBufAlgo.channels(photo, (0, 0, 0), ("R", "G", "B"))
    scale = min(1.0, side / max(spec.width, spec.height))
    small = oiio.ImageBufAlgo.resize(photo, roi=oiio.ROI(0, round(spec.width * scale), 0, round(spec.height * scale)))
    small.specmod().attribute("oiio:ColorSpace", "srgb_rec709_scene")
    return small


def pixels(buffer: oiio.ImageBuf) -> np.ndarray:
    """(h, w, 3) uint8."""
    return buffer.get_pixels(oiio.UINT8)[..., :3]


def beside(*panes: np.ndarray, gap: int = 8) -> np.ndarray:
    """Pictures side by side on white, top aligned."""
    height = max(p.shape[0] for p in panes)
    width = sum(p.shape[1] for p in panes) + gap * (len(panes) - 1)
    sheet = np.full((height, width, 3), 255, np.uint8)
    left = 0
    for pane in panes:
        sheet[: pane.shape[0], left : left + pane.shape[1]] = pane
        left += pane.shape[1] + gap
    return sheet


def twice(tile: np.ndarray) -> np.ndarray:
    """Laid out 2 x 2."""
    return np.tile(tile, (2, 2, 1))


def halved(picture: np.ndarray) -> np.ndarray:
    """At half the size."""
    with tempfile.TemporaryDirectory() as folder:
        save(picture, Path(folder) / "p.png")
        return pixels(shrunk(oiio.ImageBuf(f"{folder}/p.png"), max(picture.shape) // 2))


def demo_pictures() -> None:
    """The demo's photo tiled as it is, by toroidal PatchMatch, and stationarized."""
    with tempfile.TemporaryDirectory() as folder:
        save(stained(gravel()), Path(folder) / "photo.png")
        photo = oiio.ImageBuf(f"{folder}/photo.png")
        photo.read(force=True)
    baseline, tile = filters.patchmatch(photo, seed=7), filters.stationarize(photo, seed=7)
    write_jpeg(beside(*(halved(twice(pixels(b))) for b in (photo, baseline, tile))), "gravel_2x2.jpg")


def flattened_wall() -> None:
    """A stained wall, flattened, and its map of stationarity."""
    wall = Path(os.environ.get("OIIOTEX_TEST_DATA", "../shared/data")) / "photos" / "stained_plaster_wall.jpg"
    if not wall.is_file():
        print(f"no {wall}: its picture stays as it is")
        return
    photo = shrunk(oiio.ImageBuf(str(wall)), 320)
    deviation = filters.stationarity(photo).get_pixels(oiio.FLOAT) / 30.0  # white is 30 Lab units
    gray = np.repeat((255 * np.clip(deviation, 0, 1)).astype(np.uint8), 3, axis=2)
    write_jpeg(beside(pixels(photo), pixels(filters.flatten(photo)), gray), "flatten_wall.jpg")


def labelled_photo(name: str, side: int = 512) -> dict[str, oiio.ImageBuf] | None:
    """A test photo made small, with its label maps; None where there are no photos."""
    path = Path(os.environ.get("OIIOTEX_TEST_DATA", "../shared/data")) / "photos" / name
    if not path.is_file():
        print(f"no {path}: its picture stays as it is")
        return None
    return filters.label(shrunk(oiio.ImageBuf(str(path)), side), keep=True)


def cut_labels() -> None:
    """One label of a photo, and what --texcut makes of it, 2 x 2."""
    rows = []
    for name, level, label in (("flower_meadow_stones.jpg", -2, 1), ("fieldstone_wall_kodim01.jpg", -2, 1)):
        photo = labelled_photo(name)
        if photo is None:
            return
        first, *maps = photo.values()
        ids = maps[level].get_pixels(oiio.UINT32)
        label = int(np.bincount(ids.ravel())[1:].argsort()[-label] + 1)
        tile = filters.cut(photo, label=label, level=len(maps) + 1 + level, size=(320, 320), seed=1)
        shown = np.where(ids == label, pixels(first), pixels(first) // 4)
        rows.append(beside(shown, halved(twice(pixels(tile)))))
    write_jpeg(_below(*rows), "cut_labels.jpg")


def _id_picture(ids: np.ndarray) -> oiio.ImageBuf:
    made = oiio.ImageBuf(oiio.ImageSpec(ids.shape[1], ids.shape[0], 1, oiio.UINT32))
    made.set_pixels(made.roi, np.ascontiguousarray(ids.astype(np.uint32))[..., None])
    return made


def _below(*panes: np.ndarray, gap: int = 8) -> np.ndarray:
    """Pictures one below the other on white, left aligned."""
    wide = max(pane.shape[1] for pane in panes)
    fill = [((0, gap), (0, wide - pane.shape[1]), (0, 0)) for pane in panes]
    return np.concatenate([np.pad(p, f, constant_values=255) for p, f in zip(panes, fill, strict=True)])


def painted_meadow() -> None:
    """A palette, a painting at one scale and at two, of a meadow."""
    photo = labelled_photo("flower_meadow_stones.jpg", 640)
    if photo is None:
        return
    first, *maps = photo.values()
    level = len(maps) - 1
    write_jpeg(beside(halved(pixels(first)), pixels(filters.palette(photo, level=level, side=64))), "palette.jpg")
    y, x = np.mgrid[0:500, 0:700]
    coarse, fine = (
        1 + np.bincount(maps[n - 1].get_pixels(oiio.UINT32).ravel())[1:].argsort()[::-1] for n in (level, level - 1)
    )
    painting = np.where(((x - 350) / 220) ** 2 + ((y - 250) / 170) ** 2 < 1, coarse[1], coarse[0])
    details = np.zeros(painting.shape, int)
    details[60:170, 60:260] = fine[0]
    details[(x - 350) ** 2 + (y - 250) ** 2 < 70**2] = fine[1]
    once = filters.paint(photo, _id_picture(painting), level=level)
    over = filters.paint(photo, _id_picture(painting), fine=_id_picture(details), level=level)
    looks = np.array([[81, 94, 53], [93, 94, 77], [150, 150, 140], [60, 110, 40]], np.uint8)
    plain = looks[np.where(painting == coarse[1], 1, 0)]
    shown = looks[np.select([details == fine[0], details == fine[1], painting == coarse[1]], [2, 3, 1], 0)]
    rows = [beside(halved(a), halved(pixels(b))) for a, b in ((plain, once), (shown, over))]
    write_jpeg(_below(*rows), "paint.jpg")


def composites() -> None:
    """Photos, and larger textures made of them without a guide."""
    rows = []
    for name, below in (("flower_meadow_stones.jpg", 1), ("moss_grass_stones_ground.jpg", 2)):
        photo = labelled_photo(name, 640)
        if photo is None:
            return
        made = filters.composite(photo, level=max(1, len(photo) - 1 - below), size=(1280, 800), seed=1)
        rows.append(beside(halved(pixels(next(iter(photo.values())))), halved(pixels(made))))
    write_jpeg(_below(*rows), "composite.jpg")


def test_photo(name: str) -> oiio.ImageBuf | None:
    """One of the test photos, 8 bit; None with a word where they are not."""
    path = Path(os.environ.get("OIIOTEX_TEST_DATA", "../shared/data")) / "photos" / name
    if not path.is_file():
        print(f"no {path}: its picture stays as it is")
        return None
    return shrunk(oiio.ImageBuf(str(path)), 1024)


def small(picture: np.ndarray, side: int) -> np.ndarray:
    """Every nth pixel, (h, w) or (h, w, 3): labels must not be mixed."""
    step = -(-max(picture.shape[:2]) // side)
    return picture[step // 2 :: step, step // 2 :: step]


def layered_textures() -> None:
    """LSA16 figure 7: a photo, its colours in as many clusters as one says, levels of labels from coarse to fine."""
    rows = []
    for name, count in LAYERED:
        photo = test_photo(name)
        if photo is None:
            return
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
            colours = distinct_colours()
            panes.append(np.rint(255 * colours[(small(ids, SIDE) - 1) % len(colours)]).astype(np.uint8))
        rows.append(np.pad(beside(*panes), ((0, 10), (0, 0), (0, 0)), constant_values=255))
    width = max(row.shape[1] for row in rows)
    rows = [np.pad(r, ((0, 0), (0, width - r.shape[1]), (0, 0)), constant_values=255) for r in rows]
    write_jpeg(np.concatenate(rows), "label_layers.jpg")


def moved_borders(sigma: float = 94.0, side: int = 340) -> None:
    """LSA16 section 3.2: borders of superpixels at two scales 3 px apart, and of two hierarchies of one scale.

    From the hierarchy; by SLIC alone, where its grid of seeds loses a column; from hierarchies whose seeds differ.
    """
    photo = test_photo("stone_breccia.jpg")
    if photo is None:
        return
    pairs = (
        ({"sigma": sigma}, {"sigma": sigma + 3}),
        ({"finest": sigma}, {"finest": sigma + 3}),
        ({"sigma": sigma}, {"sigma": sigma, "finest": 15.0}),
    )
    panes = []
    for pair in pairs:
        cuts = [filters.superpixel(photo, **choice).get_pixels(oiio.UINT32)[..., 0] for choice in pair]
        edges = [borders(small(cut, side)) for cut in cuts]
        near = [ndimage.binary_dilation(edge, iterations=2) for edge in edges]  # what moved by a pixel has not moved
        shown = small(pixels(photo), side) // 2 + 110
        both = (edges[0] & near[1]) | (edges[1] & near[0])
        for edge, colour in ((edges[0], (220, 90, 0)), (edges[1], (0, 70, 220)), (both, (0, 0, 0))):
            shown[edge] = colour
        panes.append(shown)
    write_jpeg(beside(*panes), "superpixel_moves.jpg")


def borders(ids: np.ndarray) -> np.ndarray:
    """Pixels whose left or upper neighbour has another id."""
    edge = np.zeros(ids.shape, bool)
    edge[1:] |= ids[1:] != ids[:-1]
    edge[:, 1:] |= ids[:, 1:] != ids[:, :-1]
    return edge


def contact_sheets() -> None:
    """Every test photo beside its 2 x 2 preview."""
    folder = Path(os.environ.get("OIIOTEX_TEST_DATA", "../shared/data")) / "photos"
    if not folder.is_dir():
        print(f"no photos in {folder}: the contact sheets stay as they are")
        return
    rows = []
    for path in sorted(folder.iterdir()):
        photo = shrunk(oiio.ImageBuf(str(path)), SIDE)
        tile = filters.stationarize(photo, seed=1)
        rows.append(beside(pixels(photo), twice(pixels(tile))))
    for n in range(0, len(rows), PER_SHEET):
        group = rows[n : n + PER_SHEET]
        pairs = [beside(*group[i : i + 2], gap=24) for i in range(0, len(group), 2)]
        width = max(p.shape[1] for p in pairs)
        sheet = [np.pad(p, ((0, 12), (0, width - p.shape[1]), (0, 0)), constant_values=255) for p in pairs]
        write_jpeg(np.concatenate(sheet), f"photos_{n // PER_SHEET + 1}.jpg")


def labelled(name: str, side: int) -> dict[str, oiio.ImageBuf] | None:
    """A test photo with its label parts, or None where there are no photos."""
    path = Path(os.environ.get("OIIOTEX_TEST_DATA", "../shared/data")) / "photos" / f"{name}.jpg"
    if not path.is_file():
        print(f"no {path}: its pictures stay as they are")
        return None
    return filters.label(shrunk(oiio.ImageBuf(str(path)), side), keep=True)


def kept_alone(photo: oiio.ImageBuf, **values: object) -> np.ndarray:
    """What a mask leaves of a photo, on white; all white where it is rejected."""
    mask = filters.dominant(photo, **values).get_pixels(oiio.FLOAT)
    return np.where(mask > 0.5, pixels(photo), 255).astype(np.uint8)


def dominant_columns() -> None:
    """LDR09 figure 6: photos, what is dominant in them, the same by eq. 7, the larger half of a normalised cut."""
    panes = []
    for name in COLUMNS:
        photo = test_photo(name)
        if photo is None:
            return
        photo = shrunk(photo, 160)
        panes.append(beside(pixels(photo), *(kept_alone(photo, mode=m) for m in MODES)))
    pairs = [beside(*panes[n : n + 2], gap=24) for n in range(0, len(panes), 2)]
    write_jpeg(stacked(pairs), "dominant_columns.jpg")


def stacked(rows: list[np.ndarray], gap: int = 10) -> np.ndarray:
    """Pictures one below the other on white, left aligned."""
    width = max(row.shape[1] for row in rows)
    return np.concatenate([np.pad(r, ((0, gap), (0, width - r.shape[1]), (0, 0)), constant_values=255) for r in rows])


def painted_wall(side: int = 160) -> np.ndarray:
    """LDR09 figure 8: paint that is plain at the left and ever more spotted to the right."""
    y, x = np.mgrid[0:side, 0 : side * 3 // 2]
    spots = ndimage.gaussian_filter(np.random.default_rng(3).normal(0, 1, y.shape), 2.5, mode="wrap")
    spots = (spots / spots.std() > 2.6 - 2.2 * x / x.max())[..., None] * 1.0
    spots = ndimage.gaussian_filter(spots, (0.6, 0.6, 0))
    return np.rint(255 * (np.array([0.75, 0.7, 0.6]) * (1 - spots) + np.array([0.35, 0.2, 0.12]) * spots)).astype(
        np.uint8
    )


def dominant_failures() -> None:
    """LDR09 figure 8: a smooth transition, and cracks of all directions and widths."""
    with tempfile.TemporaryDirectory() as folder:
        save(painted_wall(), Path(folder) / "paint.png")
        photos = [oiio.ImageBuf(f"{folder}/paint.png"), test_photo("sandstone_wall_cracked.jpg")]
        if photos[1] is None:
            return
        panes = [beside(pixels(p), kept_alone(p)) for p in (shrunk(photo, 240) for photo in photos)]
    write_jpeg(beside(*panes, gap=24), "dominant_failures.jpg")


def clean_quilt(name: str = "stained_plaster_wall.jpg", side: int = 384) -> None:
    """A photo, its dominant texture, a quilt of that alone, a quilt of the whole; how the texture was found."""
    photo = test_photo(name)
    if photo is None:
        return
    photo = shrunk(photo, side)
    with tempfile.TemporaryDirectory() as folder:
        parts = filters.dominant(photo, keep=True, chart=Path(folder) / "chart.png")
        write_jpeg(pixels(oiio.ImageBuf(f"{folder}/chart.png")), "dominant_chart.jpg")
    mask = parts["dominant"]
    quilts = [filters.quilt(photo, size=(side, side), patch=48, seed=1, **m) for m in ({"mask": mask}, {})]
    left = np.where(mask.get_pixels(oiio.FLOAT) > 0.5, pixels(photo), 255).astype(np.uint8)
    write_jpeg(halved(beside(pixels(photo), left, *(pixels(q) for q in quilts))), "dominant_quilt.jpg")


def quilts() -> None:
    """Test photos and what is quilted from them; a guide and its quilt; the content of a photo."""
    panes = []
    for name in ("castle_brick_broken", "clover_lawn", "onyx_veins"):
        path = Path(os.environ.get("OIIOTEX_TEST_DATA", "../shared/data")) / "photos" / f"{name}.jpg"
        if not path.is_file():
            print(f"no {path}: the quilts stay as they are")
            return
        photo = shrunk(oiio.ImageBuf(str(path)), 512)
        quilt = pixels(filters.quilt(photo, size=(768, 512), seed=1))
        panes.append(halved(beside(pixels(photo)[:512], quilt)))
    write_jpeg(np.concatenate(panes), "quilts.jpg")
    parts = labelled("stone_breccia", 768)
    if parts is None:
        return
    level = len(parts) - 1
    ids = parts[f"label.{level}"].get_pixels(oiio.UINT32)[..., 0]
    wanted = np.argsort(-np.bincount(ids.ravel()), kind="stable")[:3]
    y, x = np.mgrid[:60, :90]
    guide = wanted[np.where(np.hypot(y - 30, x - 30) < 20, 1, np.where(x + 12 * np.sin(y / 8) > 60, 2, 0))]
    held = oiio.ImageBuf(oiio.ImageSpec(90, 60, 1, oiio.UINT32))
    held.set_pixels(held.roi, guide.astype(np.uint32)[..., None])
    quilt = filters.quilt(parts, guide=held, level=level, size=(1080, 720), seed=1)
    gray = np.searchsorted(np.sort(wanted), guide) * 100 + 40
    drawn = np.repeat(np.repeat(np.repeat(gray[..., None].astype(np.uint8), 3, 2), 6, 0), 6, 1)
    write_jpeg(beside(drawn, halved(pixels(quilt))), "quilt_guide.jpg")
    marked = pixels(filters.content(parts, at=(300, 300), level=level))
    table = pixels(filters.content(parts, level=level, table=True))
    height = max(marked.shape[0], table.shape[0])
    panes = [np.pad(p, ((0, height - len(p)), (0, 0), (0, 0)), constant_values=255) for p in (marked, table)]
    write_jpeg(beside(*panes), "content.jpg")


def quilts_beside_peers(size: tuple[int, int] = (400, 300)) -> None:
    """Crops of photos, what the peers that are installed synthesize, --texquilt and its patch=96; at half the size."""
    tools = [tool for tool in SYNTHESIZERS if tool.available()]
    print("beside quilts:", ", ".join(tool.name for tool in tools) or "no peer, the picture stays as it is")
    rows = []
    for name, (x, y) in CROPS.items():
        photo = test_photo(f"{name}.jpg")
        if photo is None or not tools:
            return
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
        rows.append(np.pad(beside(*panes), ((0, 8), (0, 0), (0, 0)), constant_values=255))
    write_jpeg(np.concatenate(rows), "quilt_peers.jpg", quality=60)


if __name__ == "__main__":
    dominant_columns()
    dominant_failures()
    clean_quilt()
    quilts()
    quilts_beside_peers()
    demo_pictures()
    flattened_wall()
    cut_labels()
    painted_meadow()
    composites()
    layered_textures()
    moved_borders()
    contact_sheets()
