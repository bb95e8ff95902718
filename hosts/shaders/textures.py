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

Rows are processed in bands. Temporary files hold the levels, so that memory does not grow with the tile.
"""

from __future__ import annotations

import argparse
import itertools
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from oiiotex.engine.core.demand import MadeRows, SomeRows, rows_of
from oiiotex.engine.core.image import Part
from oiiotex.engine.core.scratch import RowStore, TileStore, empty_rows
from oiiotex.engine.core.source_map import BITS, Copied
from oiiotex.engine.core.window import Window
from oiiotex.engine.errors import Error, ImageError, reason_of
from oiiotex.engine.io.atomic import temporary_beside
from oiiotex.engine.io.copies import is_indexed
from oiiotex.engine.io.owned import checked_name
from oiiotex.engine.io.reading import read

OWN = np.uint32(1 << 31)  # an entry of the index is the number of a texel, not an offset
_BAND_BYTES = 8 << 20  # of rows that are processed at once
_HELD_BYTES = 16 << 20  # of rows that are kept in memory, not in a file
_KINDS: dict[str, np.dtype] = {"half": np.dtype("f2"), "float": np.dtype("f4")}


@dataclass(frozen=True)
class Texels:
    """An array that is made from top to bottom.

    Attributes
    ----------
    shape : tuple of int
        (height, width), or (layers, height, width, channels).
    kind : dtype
    bands : callable
        Returns an iterator of consecutive parts of the array; their shapes may differ.
    """

    shape: tuple[int, ...]
    kind: np.dtype
    bands: Callable[[], Iterator[np.ndarray]]

    def __array__(self, dtype: object = None, copy: bool | None = None) -> np.ndarray:
        return np.concatenate([band.ravel() for band in self.bands()]).reshape(self.shape)


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

    index: list[Texels]
    maps: dict[str, Texels]


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
    levels = index_levels(parts[0])
    pixels, sizes = width * height, [int(np.prod(level.shape)) for level in levels]
    own = [sum(int((rows >= OWN).sum()) for rows in _bands(level)) for level in levels]
    few = (number for number in range(1, len(levels)) if sizes[number] - own[number] <= pixels)
    filtered = next(few, len(levels))  # layers
    own[filtered:] = sizes[filtered:]
    before = itertools.accumulate(own, initial=filtered * pixels)
    index = [_numbered(level, at, n >= filtered) for n, (level, at) in enumerate(zip(levels, before, strict=False))]
    stored = _Stored(levels, filtered, sum(own))
    return Textures(index, {part.name: _layers(part, stored) for part in parts})


def _require_values(part: Part, path: str | Path) -> None:
    if str(part.spec.format) not in _KINDS or part.spec.nchannels > 4:
        kind = f"{part.spec.nchannels} channels of type {part.spec.format}"
        raise ImageError(f"{path}: {part.name} has {kind}: expected 1 to 4 channels of type half or float")
    if _photo_size(part)[1] > 1 << (BITS - 1):
        raise ImageError(f"{path}: expected a photo of at most {1 << (BITS - 1)} rows")


def _photo_size(part: Part) -> tuple[int, int]:
    assert isinstance(part.fetch, Copied)
    return part.fetch.size


def _rows(shape: tuple[int, ...], kind: type) -> np.ndarray | RowStore:
    """Rows to fill, in memory if they are few."""
    return empty_rows(shape, kind, int(np.prod(shape)) * np.dtype(kind).itemsize <= _HELD_BYTES)


def _slices(shape: tuple[int, ...]) -> Iterator[slice]:
    """Slices of rows of a few megabytes, of four bytes a value."""
    step = max(1, _BAND_BYTES // (4 * int(np.prod(shape[1:]))))
    return (slice(top, min(top + step, shape[0])) for top in range(0, shape[0], step))


def _bands(rows: SomeRows) -> Iterator[np.ndarray]:
    return (rows[at] for at in _slices(rows.shape))


# --- index ---


def index_levels(part: Part) -> list[np.ndarray | RowStore]:
    """All levels of the index: offsets of the texels whose pixels all have the same one, and `OWN` elsewhere."""
    assert isinstance(part.fetch, Copied)
    (width, height), whole = part.fetch.size, part.window
    levels = [_rows((whole.height, whole.width), np.uint32)]
    for at in _slices((whole.height, 4 * whole.width)):  # places take more than offsets
        band = Window(whole.left, whole.top + at.start, whole.right, whole.top + at.stop)
        y, x = part.fetch.sources.read(band).yx
        rows, columns = np.ogrid[band.inside(whole)]
        levels[0][at] = ((y - rows) % height << BITS | (x - columns) % width).astype(np.uint32)
    while max(levels[-1].shape) > 1:
        finer = levels[-1]
        shape = tuple(max(1, side // 2) for side in finer.shape)
        levels.append(_rows(shape, np.uint32))
        for at in _slices(shape):
            coarser = np.full((at.stop - at.start, shape[1]), OWN, np.uint32)
            if finer.shape == (2 * shape[0], 2 * shape[1]):
                blocks = finer[2 * at.start : 2 * at.stop].reshape(-1, 2, shape[1], 2)
                first = blocks[:, :1, :, :1]
                np.copyto(coarser, first[:, 0, :, 0], where=(blocks == first).all((1, 3)))
            levels[-1][at] = coarser
    return levels


def _numbered(level: SomeRows, number: int, stored: bool) -> Texels:
    """A level of the index whose texels that are stored, or all, have numbers from `number` on."""

    def bands() -> Iterator[np.ndarray]:
        following = number
        for rows in _bands(level):
            here = np.full(rows.shape, stored) | (rows >= OWN)
            count = int(here.sum())
            rows = rows.copy()
            rows[here] = OWN | np.arange(following, following + count, dtype=np.uint32)
            following += count
            yield rows

    return Texels(level.shape, OWN.dtype, bands)


# --- maps ---


@dataclass(frozen=True)
class _Stored:
    """Which texels of a tile are stored: those of `levels` that are `OWN`, and all from level `filtered` on."""

    levels: list[np.ndarray | RowStore]
    filtered: int
    count: int

    def among(self, number: int, values: SomeRows) -> Iterator[np.ndarray]:
        """Of a level (height, width, channels): (texels, channels)."""
        for at in _slices(values.shape):
            rows = values[at]
            yield rows.reshape(-1, rows.shape[2]) if number >= self.filtered else rows[self.levels[number][at] >= OWN]


def _layers(part: Part, stored: _Stored) -> Texels:
    """The layers of a map: filtered photos, and the texels of each level that are stored."""
    assert isinstance(part.fetch, Copied)
    (width, height), channels, photo = part.fetch.size, part.spec.nchannels, part.fetch.pixels()
    assert not isinstance(photo, TileStore)  # of a file
    kind = _KINDS[str(part.spec.format)]
    further = -(-stored.count // (width * height))

    def values() -> Iterator[np.ndarray]:
        layer: SomeRows = MadeRows((height, width, channels), np.float32, lambda *at: photo[slice(*at)])
        for level in range(stored.filtered):
            layer = layer if level == 0 else _filtered(layer, 1 << (level - 1))
            yield from _bands(layer)
        finer: SomeRows = rows_of(part)
        for number in range(1, len(stored.levels)):
            finer = halved(finer)
            yield from stored.among(number, finer)
        for at in _slices((-stored.count % (width * height), channels)):
            yield np.zeros((at.stop - at.start, channels), np.float32)

    shape = stored.filtered + further, height, width, channels
    return Texels(shape, kind, lambda: (each.astype(kind) for each in values()))


def _filtered(layer: SomeRows, step: int) -> np.ndarray | RowStore:
    """The next layer: means of four pixels, `step` apart, on a torus."""
    high = layer.shape[0]
    made = _rows(layer.shape, np.float32)
    for at in _slices(layer.shape):
        below = [layer[n : n + 1] for n in (np.arange(at.start, at.stop) + step) % high]
        pairs = layer[at] + np.concatenate(below)
        made[at] = (pairs + np.roll(pairs, -step, 1)) * np.float32(0.25)
    return made


def halved(finer: SomeRows) -> np.ndarray | RowStore:
    """The next MIP level of (height, width, channels): means of two, or of a fractional number of rows and columns."""
    high, wide, channels = finer.shape
    coarser = _rows((max(1, high // 2), max(1, wide // 2), channels), np.float32)
    for at in _slices((len(coarser), 4 * wide, channels)):  # twice the rows and columns
        rows = finer[2 * at.start : min(2 * at.stop + high % 2, high)].astype(np.float32)
        rows = _means_of_two(rows, high, at.start)
        coarser[at] = np.moveaxis(_means_of_two(np.moveaxis(rows, 1, 0), wide), 0, 1)
    return coarser


def _means_of_two(values: np.ndarray, count: int, first: int = 0) -> np.ndarray:
    """Rows of the next level, the first one of which is `first`, from those of `count` rows that they cover."""
    if count == 1:
        return values
    if count % 2 == 0:
        return (values[::2] + values[1::2]) * np.float32(0.5)
    whole, number = count // 2, len(values) // 2
    at = np.arange(first, first + number, dtype=np.float32).reshape(-1, *[1] * (values.ndim - 1))
    parts = (whole - at) * values[:-1:2] + whole * values[1::2] + (at + 1) * values[2::2]
    return parts / np.float32(count)


# --- files ---

_MAGIC = b"\xabKTX 20\xbb\r\n\x1a\n"
_FORMATS = {  # VkFormat by type and channels
    "<u4": {1: 98}, "<f2": {1: 76, 2: 83, 4: 97}, "<f4": {1: 100, 2: 103, 4: 109},
}  # fmt: skip
_ZLIB = 3
_SIGNED_FLOAT, _ALPHA = 0xC0, 15
_MINUS_ONE, _ONE = 0xBF800000, 0x3F800000  # as float


def write_ktx(levels: list[Texels], path: Path, layers: int = 0) -> None:
    """Write a KTX 2 file with zlib compression.

    Parameters
    ----------
    levels : list of Texels
        MIP levels, the finest one first: uint32 with one channel, or float16 or float32 with 1, 2 or 4 channels.
    path : path
    layers : int
        0: not an array.
    """
    kind = levels[0].kind
    height, width, channels = levels[0].shape[-3:] if layers else (*levels[0].shape, 1)
    described = _description(kind, channels)
    start = len(_MAGIC) + 17 * 4 + 24 * len(levels)
    head = struct.pack(
        "<13I2Q", _FORMATS[kind.newbyteorder("<").str][channels], kind.itemsize, width, height, 0, layers, 1,
        len(levels), _ZLIB, start, len(described), 0, 0, 0, 0,
    )  # fmt: skip
    entries, place = [], start + len(described)
    with temporary_beside(path) as temporary, temporary.open("wb") as file:
        file.seek(place)
        for level in reversed(levels):  # the coarsest one first
            packer = zlib.compressobj(6)
            for band in level.bands():
                file.write(packer.compress(np.ascontiguousarray(band, kind.newbyteorder("<")).data))
            file.write(packer.flush())
            size = int(np.prod(level.shape)) * kind.itemsize
            entries.append(struct.pack("<3Q", place, file.tell() - place, size))
            place = file.tell()
        file.seek(0)
        file.write(b"".join([_MAGIC, head, *reversed(entries), described]))


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
    write_ktx(made.index, folder / "index.ktx2")
    for name, layers in made.maps.items():
        write_ktx([_with_alpha(layers) if layers.shape[-1] == 3 else layers], folder / f"{name}.ktx2", layers.shape[0])


def _with_alpha(layers: Texels) -> Texels:
    def bands() -> Iterator[np.ndarray]:
        for band in layers.bands():
            yield np.concatenate([band, np.ones((*band.shape[:-1], 1), band.dtype)], -1)

    return Texels((*layers.shape[:-1], 4), layers.kind, bands)


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
