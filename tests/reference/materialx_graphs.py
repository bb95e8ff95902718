# SPDX-License-Identifier: Apache-2.0
"""What nodes of a MaterialX graph give, by its specification, in numpy: an oracle for the documents."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from tests.reference.wang import bilinear

_ONE = {"floor": np.floor, "absval": np.abs, "sqrt": np.sqrt}
_TWO = {"add": np.add, "subtract": np.subtract, "multiply": np.multiply, "divide": np.divide, "power": np.power}


def evaluated(node: object, uv: np.ndarray, folder: Path) -> np.ndarray:
    """What a node gives at coordinates, with v upwards; (..., channels)."""
    known: dict[str, np.ndarray] = {}

    def image(node: object, place: np.ndarray) -> np.ndarray:
        texels = oiio.ImageBuf(str(folder / node.getInputValue("file"))).get_pixels(oiio.FLOAT)
        x, y = place[..., 0] * texels.shape[1], -place[..., 1] * texels.shape[0]  # the last row is at v = 0
        if node.getInputValue("filtertype") == "closest":
            return texels[np.floor(y).astype(int) % texels.shape[0], np.floor(x).astype(int) % texels.shape[1]]
        return bilinear(texels, x - 0.5, y - 0.5)

    def value(node: object) -> np.ndarray:
        if node.getName() not in known:
            known[node.getName()] = computed(node)
        return known[node.getName()]

    def computed(node: object) -> np.ndarray:
        def port(name: str) -> np.ndarray:
            source = node.getConnectedNode(name)
            if source is not None:
                return value(source)
            return np.array([float(n) for n in node.getInput(name).getValueString().split(",")], float)

        kind = node.getCategory()
        if kind in _ONE:
            return _ONE[kind](port("in"))
        if kind in _TWO:
            return _TWO[kind](port("in1"), port("in2"))
        others = {
            "texcoord": lambda: uv,
            "image": lambda: image(node, port("texcoord")),
            "cellnoise2d": lambda: _noise(port("texcoord")),
            "extract": lambda: port("in")[..., int(port("index")[0]), None],
            "combine2": lambda: np.concatenate([port("in1"), port("in2")], axis=-1),
            "combine3": lambda: np.concatenate([port("in1"), port("in2"), port("in3")], axis=-1),
            "convert": lambda: np.broadcast_to(port("in"), (*port("in").shape[:-1], 3)),
            "dotproduct": lambda: (port("in1") * port("in2")).sum(-1, keepdims=True),
            "ifgreater": lambda: np.where(port("value1") > port("value2"), port("in1"), port("in2")),
            "clamp": lambda: np.clip(port("in"), port("low"), port("high")),
            "invert": lambda: 1 - port("in"),
        }
        return others[kind]()

    return value(node)


def _noise(place: np.ndarray) -> np.ndarray:
    return np.vectorize(cell_noise)(*np.moveaxis(np.floor(place).astype(int), -1, 0))[..., None]


def cell_noise(x: int, y: int) -> float:
    """`cellnoise2d`, line by line as in MaterialX's mx_bjfinal."""
    most = 0xFFFFFFFF
    a = b = c = (0xDEADBEEF + 8 + 13) & most
    a, b = (a + x) & most, (b + y) & most

    def turned(bits: int, count: int) -> int:
        return ((bits << count) | (bits >> (32 - count))) & most

    c ^= b
    c = (c - turned(b, 14)) & most
    a ^= c
    a = (a - turned(c, 11)) & most
    b ^= a
    b = (b - turned(a, 25)) & most
    c ^= b
    c = (c - turned(b, 16)) & most
    a ^= c
    a = (a - turned(c, 4)) & most
    b ^= a
    b = (b - turned(a, 14)) & most
    c ^= b
    return ((c - turned(b, 24)) & most) / most
