# SPDX-License-Identifier: Apache-2.0
"""The picture of docs/how-to/hosts.md: a plain of pebbles to the horizon, looked up by OpenImageIO's TextureSystem.

`python -m tools.docs.pictures.hosts`; the plugin is built first, with `python hosts/openimageio/build.py`.
"""

from __future__ import annotations

import json
import os
import shutil
import tempfile
import time
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from oiiotex.oiiotool.cli.printing.plugin_path import plugin_path
from tests.conftest import data_folder
from tools.docs.pictures.layout import write_jpeg

SIZE = 1 << 20  # px of the texture
WIDTH, HEIGHT = 960, 360  # px of the picture
HORIZON = 40  # px from its top
EYE = 300.0  # px of the texture above the plain
FOCAL = 700.0  # px


def plain(name: str) -> np.ndarray:
    """(height, width, 3): every pixel one lookup with the derivatives of its ray."""
    textures, options = oiio.TextureSystem(), oiio.TextureOpt()
    picture = np.full((HEIGHT, WIDTH, 3), (0.72, 0.8, 0.88))
    for row in range(HORIZON + 1, HEIGHT):
        below = row + 0.5 - HORIZON
        away = EYE * FOCAL / below  # px of the texture
        across, along = away / FOCAL / SIZE, away / below / SIZE
        haze = np.exp(-away / 60000)
        for column in range(WIDTH):
            s = 0.5 + (column - WIDTH / 2) * across
            # a pixel to the right moves s; one below moves nearer, and s towards the middle
            color = textures.texture(
                name, options, s, 0.75 - away / SIZE, across, 0.0, -(s - 0.5) / below, along, 3
            )  # fmt: skip
            picture[row, column] = haze * np.array(color) + (1 - haze) * picture[0, 0]
    error = textures.geterror()
    if error:
        raise SystemExit(error)
    return picture


def main() -> None:
    """Write the document, look at it."""
    os.environ["OPENIMAGEIO_PLUGIN_PATH"] = plugin_path()
    with tempfile.TemporaryDirectory() as scratch:
        shutil.copy(data_folder() / "photos" / "pebbles_beach_shadow.jpg", Path(scratch, "pebbles.jpg"))
        document = {"oiiotex": 1, "photo": "pebbles.jpg", "size": f"{SIZE}x{SIZE}", "seed": 7}
        path = Path(scratch, "plain.oiiotex")
        path.write_text(json.dumps(document))
        begun = time.monotonic()
        picture = plain(str(path))
        print(f"{WIDTH * HEIGHT} lookups in {time.monotonic() - begun:.1f} s")
    write_jpeg(picture.astype(np.float32), "hosts_plain.jpg")


if __name__ == "__main__":
    main()
