# SPDX-License-Identifier: Apache-2.0
"""The picture of the page of transition tiles: `python -m tools.docs.pictures.transition`. Needs Tiled."""

from __future__ import annotations

import os
import subprocess
import tempfile
from pathlib import Path

import OpenImageIO as oiio
from oiiotex_studio.library.commands import run

from oiiotex import filters
from tools.docs.pictures.layout import beside, draw, pixels, test_photo, write_jpeg

SIDE = 192  # of a tile, px
SCALE = 0.5  # of the drawn maps
CROP = 8  # tiles of a map along its side that the picture shows


def transition() -> None:
    """Clover and pebbles: 16 corner tiles, and 47 blob tiles, as Tiled draws their example maps."""
    photos = test_photo("clover_lawn.jpg", 2 * SIDE), test_photo("pebbles_beach_shadow.jpg", 2 * SIDE)
    tiles = [filters.stationarize(photo, size=(SIDE, SIDE)) for photo in photos]
    shown = []
    with tempfile.TemporaryDirectory() as text:
        folder = Path(text)
        for count in (16, 47):
            atlas, name = folder / f"{count}.png", f"map{count}"
            filters.transition(*tiles, count=count).write(str(atlas))
            run(["tileset", str(folder / name), f"color={atlas}"])
            drawn, area = folder / f"drawn{count}.png", int(CROP * SIDE * SCALE)
            line = ["tmxrasterizer", "--scale", str(SCALE), str(folder / name / f"{name}.tmx"), str(drawn)]
            subprocess.run(line, check=True, env={**os.environ, "QT_QPA_PLATFORM": "offscreen"})
            shown.append(pixels(oiio.ImageBuf(str(drawn)))[:area, :area, :3])
    write_jpeg(beside(*shown), "transition.jpg")


if __name__ == "__main__":
    draw(transition)
