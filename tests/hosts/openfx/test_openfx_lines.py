# SPDX-License-Identifier: Apache-2.0
"""The pixels of every node are those of the command line that it shows, to the bit, on three photos."""

from __future__ import annotations

import shlex
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from tests.conftest import data_folder, load, run_in, save
from tests.hosts.openfx.conftest import edited, rendered, with_source
from tests.hosts.openfx.host import OK, Host, Node

WIDTH, HEIGHT = 96, 64
PHOTOS = ("pebbles_beach_shadow.jpg", "castle_brick_broken.jpg", "moss_grass_stones_ground.jpg")
NODES = {  # node: parameters, the output's label, and whether one channel of the line is alpha in the node
    "Tile": ({"sigma": 8.0, "iterations": 3}, "", False),
    "Tile st": ({"sigma": 8.0, "iterations": 3}, "St", False),
    "Fill": ({"iterations": 3}, "", False),
    "Flatten": ({"radius": 12.0}, "", False),
    "Synthesize": ({"size": (WIDTH, HEIGHT), "origin": (-70, 31), "exemplarside": 3}, "", False),
    "Quilt": ({"patch": 16}, "", False),
    "Labels": ({"coarsest": 2}, "Label", False),  # none: a photo of one texture has one coarsest label
    "Labels cryptomatte": ({}, "Cryptomatte", False),
    "Labels matte": ({"matte": "label.2/1"}, "Matte", True),
    "DominantMask": ({}, "", True),
    "Height": ({"sigma": 9.5, "light": 30.0}, "", False),
    "Rectify": ({"corners": "8,6,80,4,84,58,6,60", "size": (64, 48)}, "", False),
    "Preview": ({"panels": "2x2,3x3", "panel": 48}, "", False),
}


def photo(name: str) -> np.ndarray:
    """The middle of a reduced photo, (height, width, 4) float32; alpha is 1."""
    whole = oiio.ImageBufAlgo.resize(oiio.ImageBuf(str(data_folder() / "photos" / name)), roi=oiio.ROI(0, 240, 0, 160))
    pixels = whole.get_pixels(oiio.FLOAT)[48 : 48 + HEIGHT, 72 : 72 + WIDTH, :3]
    return np.concatenate([pixels, np.ones_like(pixels[..., :1])], -1)


def cut(pixels: np.ndarray) -> np.ndarray:
    """The photo with a transparent hole that has a soft border, premultiplied."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    return pixels * np.clip(np.hypot(x - 40, y - 30) - 10, 0, 1).astype(np.float32)[..., np.newaxis]


def choose(host: Host, node: Node, name: str, label: str) -> None:
    """Choose an output by its label."""
    if label:
        options = host.described(name, "General").parameters["output"]["OfxParamPropChoiceOption"]
        node.parameters["output"].set(options.index(label))


def of_line(node: Node, folder: Path, alpha: bool) -> np.ndarray:
    """The pixels of the node's line, (height, width, 4) float32: those of the last part that it writes."""
    line = node.parameters["line"].values[0].decode()
    words = shlex.split(line)
    assert words[0] == "oiiotex" and words[-2] == "-o", line
    run_in(folder, *words[1:])
    file = folder / words[-1]
    pixels = load(file, oiio.ImageInput.open(str(file)).spec().get_int_attribute("oiio:subimages", 1) - 1)
    pixels = pixels.astype(np.float32)[..., -4:]
    if pixels.shape[2] == 1:
        return np.concatenate([*[pixels] * 3, pixels if alpha else np.ones_like(pixels)], -1)
    fill = np.zeros((*pixels.shape[:2], 4), np.float32)
    fill[..., 3] = 1
    fill[..., : pixels.shape[2]] = pixels
    return fill


@pytest.mark.parametrize("name", [pytest.param(p, marks=pytest.mark.slow) if n else p for n, p in enumerate(PHOTOS)])
@pytest.mark.parametrize("case", NODES)
def test_a_node_gives_the_pixels_of_its_line(host: Host, tmp_path: Path, case: str, name: str):
    values, label, alpha = NODES[case]
    kind = case.split()[0]
    pixels = photo(name) if kind != "Fill" else cut(photo(name))
    save(pixels, tmp_path / "Source.exr", "float")
    node = with_source(host, kind, pixels, "Generator" if kind == "Synthesize" else "General", **values)
    choose(host, node, kind, label)
    assert edited(node, "output" if label else "seed") == OK
    rendered(host, node)  # of some nodes only the pixels tell the size: the host asks again
    found, wanted = rendered(host, node), of_line(node, tmp_path, alpha)
    assert np.ptp(wanted) > 0
    np.testing.assert_array_equal(found, wanted)
