# SPDX-License-Identifier: Apache-2.0
"""The picture of docs/how-to/openfx.md: nodes of the OpenFX bundle in the host of the tests.

`python -m tools.docs.pictures.openfx FILE`: the built oiiotex.ofx (hosts/openfx/README.md).
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from tests.conftest import data_folder
from tests.hosts.openfx.host import OK, Host, Image
from tools.docs.pictures.layout import beside, pixels, shrunk, write_jpeg

SIDE = 288  # px of the photo
SPACE = "srgb_rec709_scene"


def shown(host: Host, name: str, photo: np.ndarray, **values: object) -> np.ndarray:
    """The result of a node on the photo, (height, width, 3)."""
    node = host.instance(name)
    node.parameters["colorspace"].set(SPACE)
    for key, value in values.items():
        node.parameters[key].set(value)
    node.clips["Source"].connect(Image(host, photo))
    out = Image(host, np.zeros_like(photo))
    if host.render(node, (0, 0, photo.shape[1], photo.shape[0]), out) != OK:
        raise SystemExit(node.messages)
    return out.rows()


def main(file: str) -> None:
    """Write the picture."""
    host = Host(Path(file))
    photo = pixels(shrunk(oiio.ImageBuf(str(data_folder() / "photos" / "pebbles_beach_shadow.jpg")), SIDE))
    flat, mask = shown(host, "Flatten", photo), shown(host, "DominantMask", photo)
    tile = shown(host, "Tile", photo, seed=3)
    write_jpeg(beside(photo, flat, mask, np.tile(tile, (2, 2, 1))[::2, ::2]), "openfx.jpg")


if __name__ == "__main__":
    main(*sys.argv[1:])
