# SPDX-License-Identifier: Apache-2.0
"""Delivers planes of hexagons: Gaussian maps and their tables, and functions for engines."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from oiiotex.engine.deferred import np

from ..api.images import Image, Resources, from_array, lab_of_linear, write
from ..api.materials import HEX_SHADERS, shader
from ..materials.documents import SPACES
from ..materials.hexagons import BLENDABLE, HexMap, gaussianized, judged
from ..materials.naming import COLORS
from ..materials.preview import linear_of, values

FOLDER = "hex"
LEAST = BLENDABLE


def hex_measures(color: Image, resources: Resources) -> dict[str, float]:
    """The fidelity of a plane of hexagons to its tile, 0 to 1; empty if the tile is too small to measure."""
    found = judged(lab_of_linear(linear_of(color.first, resources)).astype(np.float32))
    return {} if found is None else {"hex_fidelity": found.value}


def write_hexes(
    maps: Mapping[str, Image], folder: Path, space: str, resources: Resources
) -> dict[str, tuple[str, HexMap]]:
    """Write ROLE.exr, ROLE_table.exr and functions into a folder `hex`; returns each map's file and table.

    Normals need none. `space`: color space of color maps; other ones than scene-linear become linear Rec. 709. Row n of
    a table is what component n adds to a pixel at Gaussian values from 0 to 1.
    """
    (folder / FOLDER).mkdir()
    written = {}
    for role, image in maps.items():
        if role == "normal":
            continue
        linear = role not in COLORS or SPACES.get(space) in ("lin_rec709", "acescg")
        texels = values(image) if linear else linear_of(image.first, resources)
        tile = gaussianized(texels[..., :3] if texels.shape[2] >= 3 else texels[..., :1])
        file = f"{FOLDER}/{role}.exr"
        write(from_array(tile.gaussian), folder / file)
        write(from_array(tile.shares()), folder / FOLDER / f"{role}_table.exr")
        written[role] = file, tile
    for name in HEX_SHADERS:
        (folder / FOLDER / name).write_text(shader(name))
    return written
