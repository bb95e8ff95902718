# SPDX-License-Identifier: Apache-2.0
"""Parts, specs and files of noise that the tests of images make, and what they ask of a refusal."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex.engine.core.image import Image, Part, from_pixels
from oiiotex.engine.core.window import Window
from oiiotex.engine.errors import ImageError

NUMPY = {
    "uint8": np.uint8, "int8": np.int8, "uint16": np.uint16, "int16": np.int16, "uint": np.uint32, "int": np.int32,
    "half": np.float16, "float": np.float32, "double": np.float64,
}  # fmt: skip
WINDOWS = {"x": 3, "y": -5, "full_x": -1, "full_y": 2, "full_width": 50, "full_height": 40}


def noise(kind: str, height: int, width: int, channels: int) -> np.ndarray:
    """Values over the type's whole range, negative and large ones among them."""
    random = np.random.default_rng([height, width, channels])
    dtype = np.dtype(NUMPY[kind])
    if dtype.kind in "ui":
        info = np.iinfo(dtype)
        return random.integers(info.min, info.max, (height, width, channels), dtype, endpoint=True)
    return (random.standard_normal((height, width, channels)) * 100).astype(dtype)


def spec_of(kind: str, height: int, width: int, channels: int | tuple[str, ...], **facts: object) -> oiio.ImageSpec:
    """`facts` are fields of the spec, or else attributes."""
    spec = oiio.ImageSpec(width, height, channels if isinstance(channels, int) else len(channels), oiio.TypeDesc(kind))
    if not isinstance(channels, int):
        spec.channelnames = channels
    for name, value in facts.items():
        if hasattr(spec, name):
            setattr(spec, name, value)
        else:
            spec.attribute(name, value)
    return spec


def part_of(name: str, kind: str, height: int, width: int, channels: int | tuple[str, ...], **facts: object) -> Part:
    """A part of noise, to be written as it is."""
    spec = spec_of(kind, height, width, channels, **facts)
    return from_pixels(name, noise(kind, height, width, spec.nchannels), spec, spec.format)


def small(kind: str = "uint8", channels: int = 3) -> Image:
    return Image((part_of("part0", kind, 5, 6, channels),))


def counted(part: Part, asked: list[Window]) -> Part:
    """The part as an op that is not yet computed: windows that it is asked for are added to the list."""

    def fetch(window: Window) -> np.ndarray:
        asked.append(window)
        return part.read(window)

    return Part(part.name, part.spec, fetch, part.stored)


def coordinates(width: int, height: int, left: int = 0, top: int = 0) -> Part:
    """A part of any size whose pixels are their places."""

    def fetch(window: Window) -> np.ndarray:
        y, x = np.mgrid[window.top : window.bottom, window.left : window.right]
        return np.stack([x, y], -1).astype(np.float32)

    return Part("places", spec_of("float", height, width, 2, x=left, y=top), fetch)


def put(path: Path, pixels: np.ndarray, spec: oiio.ImageSpec) -> Path:
    """A file written by OpenImageIO alone."""
    out = oiio.ImageOutput.create(str(path))
    assert out.open(str(path), spec), out.geterror()
    if spec.tile_width:
        window = spec.x, spec.x + spec.width, spec.y, spec.y + spec.height, 0, 1
        assert out.write_tiles(*window, pixels), out.geterror()
    else:
        assert out.write_image(pixels), out.geterror()
    assert out.close()
    return path


def deep_file(path: Path) -> Path:
    spec = spec_of("float", 2, 2, ("R", "Z"), deep=True)
    samples = oiio.DeepData()
    samples.init(4, 2, (oiio.TypeDesc("float"),) * 2, ("R", "Z"))
    for pixel in range(4):
        samples.set_samples(pixel, 1)
    out = oiio.ImageOutput.create(str(path))
    assert out.open(str(path), spec)
    assert out.write_deep_image(samples)
    out.close()
    return path


def refusal(call: Callable, *arguments: object, **named: object) -> str:
    """The one line that an `ImageError` says."""
    with pytest.raises(ImageError) as caught:
        call(*arguments, **named)
    text = str(caught.value)
    assert text == " ".join(text.split())
    return text


def assert_same(part: Part, pixels: np.ndarray) -> None:
    assert part.pixels().dtype == pixels.dtype
    np.testing.assert_array_equal(part.pixels(), pixels)
