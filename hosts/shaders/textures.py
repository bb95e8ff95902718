# SPDX-License-Identifier: Apache-2.0
"""Textures for `sample_indexed.glsl` from an indexed image, as KTX 2 files.

    python hosts/shaders/textures.py tile.oiiotex FOLDER

FOLDER/index.ktx2 is the index with all MIP levels, R32UI. FOLDER/MAP.ktx2 is an array of layers of the photo's size for
each map, in half or float. Layer 0 is the photo.

A texel of level L is the mean of 2^L x 2^L pixels of the tile. If all of them have one offset, it equals the mean of
as many pixels of the photo, at the place of the first one plus the offset. So layer L of a map is the photo, filtered
by that box at every pixel, not only at every 2^L-th: offsets are not multiples of 2^L. All other texels, those at
seams, are stored one after another in the layers that follow. From the level on that has fewer texels inside pieces
than the photo has pixels, all texels are stored, since a further layer would be larger. Nothing is approximated.
"""

from __future__ import annotations

import argparse
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from oiiotex.engine.core.image import Part
from oiiotex.engine.core.source_map import BITS, Copied
from oiiotex.engine.errors import Error, ImageError, reason_of
from oiiotex.engine.io.atomic import temporary_beside
from oiiotex.engine.io.copies import is_indexed
from oiiotex.engine.io.owned import checked_name
from oiiotex.engine.io.reading import read

OWN = np.uint32(1 << 31)  # an entry of the index is the number of a texel, not an offset
_ROWS = 256  # of the tile that are read at once
_KINDS = {"half": np.dtype("f2"), "float": np.dtype("f4")}


@dataclass(frozen=True)
class Textures:
    """What a shader needs of a tile.

    Attributes
    ----------
    index : list of (height, width) uint32
        The MIP levels of the index.
    maps : dict of (layers, photo height, photo width, channels) float16 or float32
        By name.
    """

    index: list[np.ndarray]
    maps: dict[str, np.ndarray]


def textures(path: str | Path) -> Textures:
    """The textures of an indexed image.

    Raises
    ------
    ImageError
        The file is not an indexed image, or a map is too large or has integers.
    ParameterError
        The name of a map cannot be the name of a file.
    """
    if not is_indexed(path):
        raise ImageError(f"{path}: expected an indexed image, as -o tile.oiiotex writes it")
    parts = read(path).parts
    for part in parts:
        checked_name(part.name, f"{path}: map")
        _require_values(part, path)
    width, height = _photo_size(parts[0])
    index = index_levels(_offsets(parts[0]))
    pixels = width * height
    inside = [np.count_nonzero(level < OWN) > pixels for level in index[1:]]
    filtered = 1 + (inside.index(False) if False in inside else len(inside))  # layers
    for level in index[filtered:]:
        level[:] = OWN
    own = [level == OWN for level in index]
    number = filtered * pixels
    for level, here in zip(index, own, strict=True):
        count = np.count_nonzero(here)
        level[here] = OWN | np.arange(number, number + count, dtype=np.uint32)
        number += count
    return Textures(index, {part.name: _layers(part, filtered, own) for part in parts})


def _require_values(part: Part, path: str | Path) -> None:
    if str(part.spec.format) not in _KINDS or part.spec.nchannels > 4:
        kind = f"{part.spec.nchannels} channels of type {part.spec.format}"
        raise ImageError(f"{path}: {part.name} has {kind}: expected 1 to 4 channels of type half or float")
    if _photo_size(part)[1] > 1 << (BITS - 1):
        raise ImageError(f"{path}: expected a photo of at most {1 << (BITS - 1)} rows")


def _photo_size(part: Part) -> tuple[int, int]:
    assert isinstance(part.fetch, Copied)
    return part.fetch.size


def _offsets(part: Part) -> np.ndarray:
    """Level 0 of the index, (height, width) uint32: rows << 16 | columns to the source of each pixel."""
    assert isinstance(part.fetch, Copied)
    (width, height), whole = part.fetch.size, part.window
    offsets = np.empty((whole.height, whole.width), np.uint32)
    for band in whole.cells(whole.width, _ROWS):
        y, x = part.fetch.sources.read(band).yx
        rows, columns = np.ogrid[band.inside(whole)]
        offsets[band.inside(whole)] = (y - rows) % height << BITS | (x - columns) % width
    return offsets


def index_levels(offsets: np.ndarray) -> list[np.ndarray]:
    """All levels of the index: offsets of the texels whose pixels all have the same one, and `OWN` elsewhere."""
    levels = [offsets]
    while max(levels[-1].shape) > 1:
        finer = levels[-1]
        height, width = (max(1, side // 2) for side in finer.shape)
        coarser = np.full((height, width), OWN, np.uint32)
        if finer.shape == (2 * height, 2 * width):
            blocks = finer.reshape(height, 2, width, 2)
            first = blocks[:, :1, :, :1]
            np.copyto(coarser, first[:, 0, :, 0], where=(blocks == first).all((1, 3)))
        levels.append(coarser)
    return levels


def halved(values: np.ndarray) -> np.ndarray:
    """The next MIP level of (height, width, channels): means of two, or of a fractional number of rows and columns."""
    for axis in (0, 1):
        values = np.moveaxis(_halved_rows(np.moveaxis(values, axis, 0)), 0, axis)
    return values


def _halved_rows(values: np.ndarray) -> np.ndarray:
    count = len(values)
    if count == 1:
        return values
    if count % 2 == 0:
        return (values[::2] + values[1::2]) * np.float32(0.5)
    first = np.arange(count // 2, dtype=np.float32).reshape(-1, *[1] * (values.ndim - 1))
    parts = (len(first) - first) * values[:-1:2] + len(first) * values[1::2] + (first + 1) * values[2::2]
    return parts / np.float32(count)


def _layers(part: Part, filtered: int, own: list[np.ndarray]) -> np.ndarray:
    """The layers of a map: filtered photos, and the texels of each level that are stored."""
    assert isinstance(part.fetch, Copied)
    width, height = part.fetch.size
    photo = np.asarray(part.fetch.pixels()[:], np.float32)
    layers = [photo]
    for level in range(1, filtered):
        step, layer = 1 << (level - 1), layers[-1]
        pairs = layer + np.roll(layer, -step, 0)
        layers.append((pairs + np.roll(pairs, -step, 1)) * np.float32(0.25))
    texels, values = [np.empty((0, photo.shape[-1]), np.float32)], first_level(part)
    for here in own[1:]:
        texels.append(values[here])
        values = halved(values)
    stored = np.concatenate(texels)
    rest = -len(stored) % (width * height)
    stored = np.pad(stored, ((0, rest), (0, 0))).reshape(-1, *photo.shape)
    return np.concatenate([np.stack(layers), stored]).astype(_KINDS[str(part.spec.format)])


def first_level(part: Part) -> np.ndarray:
    """Level 1 of a tile."""
    whole = part.window
    rows = _ROWS if whole.height % 2 == 0 else whole.height
    bands = whole.cells(whole.width, rows)
    return np.concatenate([halved(part.read(band).astype(np.float32)) for band in bands])


# --- files ---

_MAGIC = b"\xabKTX 20\xbb\r\n\x1a\n"
_FORMATS = {  # VkFormat by type and channels
    "<u4": {1: 98}, "<f2": {1: 76, 2: 83, 4: 97}, "<f4": {1: 100, 2: 103, 4: 109},
}  # fmt: skip
_ZLIB = 3
_SIGNED_FLOAT, _ALPHA = 0xC0, 15
_MINUS_ONE, _ONE = 0xBF800000, 0x3F800000  # as float


def write_ktx(levels: list[np.ndarray], path: Path, layers: int = 0) -> None:
    """Write a KTX 2 file with zlib compression.

    Parameters
    ----------
    levels : list of (height, width, channels) or (layers, height, width, channels)
        MIP levels, the finest one first: uint32, float16 or float32; 1, 2 or 4 channels.
    path : path
    layers : int
        0: not an array.
    """
    kind, (height, width, channels) = levels[0].dtype, levels[0].shape[-3:]
    data = [zlib.compress(np.ascontiguousarray(level, kind.newbyteorder("<")), 6) for level in levels]
    described = _description(kind, channels)
    start = len(_MAGIC) + 17 * 4 + 24 * len(levels)
    head = struct.pack(
        "<13I2Q", _FORMATS[kind.newbyteorder("<").str][channels], kind.itemsize, width, height, 0, layers, 1,
        len(levels), _ZLIB, start, len(described), 0, 0, 0, 0,
    )  # fmt: skip
    entries, place = [], start + len(described)
    for level, packed in zip(reversed(levels), reversed(data), strict=True):  # the coarsest one first
        entries.append(struct.pack("<3Q", place, len(packed), level.nbytes))
        place += len(packed)
    with temporary_beside(path) as temporary:
        temporary.write_bytes(b"".join([_MAGIC, head, *reversed(entries), described, *reversed(data)]))


def _description(kind: np.dtype, channels: int) -> bytes:
    """The data format descriptor: linear values, Rec. 709 primaries."""
    is_float, bits = kind.kind == "f", 8 * kind.itemsize
    low, high, sign = (_MINUS_ONE, _ONE, _SIGNED_FLOAT) if is_float else (0, 1, 0)
    size = 24 + 16 * channels
    block = struct.pack("<2I8B8B", 0, size << 16 | 2, 1, 1, 1, 0, *[0] * 4, kind.itemsize * channels, *[0] * 7)
    for channel in range(channels):
        name = _ALPHA if channel == 3 else channel
        block += struct.pack("<H6B2I", channel * bits, bits - 1, name | sign, *[0] * 4, low, high)
    return struct.pack("<I", 4 + size) + block


def write_textures(made: Textures, folder: Path) -> None:
    """Write index.ktx2 and a file for each map; three channels become four, with alpha 1."""
    folder.mkdir(parents=True, exist_ok=True)
    write_ktx([level[..., None] for level in made.index], folder / "index.ktx2")
    for name, layers in made.maps.items():
        if layers.shape[-1] == 3:
            layers = np.pad(layers, (*[(0, 0)] * 3, (0, 1)), constant_values=1)
        write_ktx([layers], folder / f"{name}.ktx2", len(layers))


def main() -> None:
    """Run the program."""
    parser = argparse.ArgumentParser(description="Write the textures of sample_indexed.glsl as KTX 2 files.")
    parser.add_argument("tile", help="an indexed image, such as tile.oiiotex")
    parser.add_argument("folder", type=Path, help="receives index.ktx2 and a file for each map")
    given = parser.parse_args()
    try:
        write_textures(textures(given.tile), given.folder)
    except (Error, OSError) as error:
        parser.exit(1, f"{parser.prog}: {reason_of(error)}\n")


if __name__ == "__main__":
    main()
