# SPDX-License-Identifier: Apache-2.0
"""Layout of the docs' pictures: reduced photos, panes side by side, small JPEGs."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from benchmarks.shared.measures import data_folder
from tools.demo import save

FOLDER = Path(__file__).parents[3] / "docs" / "pictures"


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


def stacked(rows: list[np.ndarray], gap: int = 10) -> np.ndarray:
    """Pictures one below the other on white, left aligned."""
    width = max(row.shape[1] for row in rows)
    return np.concatenate([np.pad(r, ((0, gap), (0, width - r.shape[1]), (0, 0)), constant_values=255) for r in rows])


def twice(tile: np.ndarray) -> np.ndarray:
    """Laid out 2 x 2."""
    return np.tile(tile, (2, 2, 1))


def halved(picture: np.ndarray) -> np.ndarray:
    """At half the size."""
    with tempfile.TemporaryDirectory() as folder:
        save(picture, Path(folder) / "p.png")
        return pixels(shrunk(oiio.ImageBuf(f"{folder}/p.png"), max(picture.shape) // 2))


def small(picture: np.ndarray, side: int) -> np.ndarray:
    """Every nth pixel, (h, w) or (h, w, 3): labels must not be mixed."""
    step = -(-max(picture.shape[:2]) // side)
    return picture[step // 2 :: step, step // 2 :: step]


def image_of(values: np.ndarray, kind: oiio.BASETYPE = oiio.FLOAT) -> oiio.ImageBuf:
    """An image of (height, width) or (height, width, channels): three channels are sRGB, one is data."""
    values = np.atleast_3d(values)
    made = oiio.ImageBuf(oiio.ImageSpec(values.shape[1], values.shape[0], values.shape[2], kind))
    made.set_pixels(made.roi, np.ascontiguousarray(values, np.uint32 if kind == oiio.UINT32 else np.float32))
    if values.shape[2] == 3:
        made.specmod().attribute("oiio:ColorSpace", "srgb_rec709_scene")
    return made


def opened(name: str) -> oiio.ImageBuf:
    """A file of the test data; raises FileNotFoundError."""
    path = data_folder() / name
    if not path.is_file():
        raise FileNotFoundError(path)
    return oiio.ImageBuf(str(path))


def test_photo(name: str, side: int = 1024) -> oiio.ImageBuf:
    """One of the test photos, 8 bit, with its longer side at most `side`; raises FileNotFoundError."""
    return shrunk(opened(f"photos/{name}"), side)


def draw(*pictures: Callable[[], object]) -> None:
    """Draw the pictures that the command line names, else all; one whose photos are not there stays as it is."""
    for picture in [one for one in pictures if one.__name__ in sys.argv[1:]] or pictures:
        try:
            picture()
        except FileNotFoundError as error:
            print(f"no {error}: {picture.__name__} stays as it is")
