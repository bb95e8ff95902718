# SPDX-License-Identifier: Apache-2.0
"""`tile.oiiotex`: an image as the maps that it is copied from, and one index that all of them share.

The file is an EXR file with a part for each map and the part `index`. A map has the size of the photo, and the display
window and metadata of the result. The index has the size of the result. Pixel (x, y) of the result is pixel
(x + right, y + down) of each map, modulo its size, where offset = down << 16 | right. Maps hold what was copied: with
flattening, the flattened photo. So the result is exact, without a field of residual gains.

In each cell of 256 x 256 px, channel `index` numbers the offsets in the order in which they appear, row by row. Channel
`offset` has the offset where its number appears first, and 0 elsewhere. Both are constant almost everywhere, so ZIP
stores a pixel of a tile or quilt in 0.18 to 0.25 bits (four photos), and a cell can be read without others.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

from ..core.attributes import PROVISIONAL, mark_as_data
from ..core.demand import assembled, rows_of
from ..core.image import Image, Part, spec_beside
from ..core.piece_cache import PieceCache
from ..core.scratch import TileStore
from ..core.source_map import BITS, Copied, SourceMap, Sources
from ..core.window import Window
from ..deferred import np, oiio
from ..errors import ImageError
from .description import NAME
from .formats import Format

SUFFIX = ".oiiotex"
_CELL = 256  # px; side of the cells and of the file's tiles
_INDEX, _CHANNELS, _VERSION = "index", ("index", "offset"), "oiiotex:index"
_EXR = b"\x76\x2f\x31\x01"
_HELD = 4  # a map is held decoded if it fits into the cache that many times


def is_indexed(path: str | Path) -> bool:
    """Whether a file is an indexed image. Other files with this suffix are documents of endless textures."""
    if not str(path).endswith(SUFFIX):
        return False
    try:
        if not Path(path).is_file():  # a fifo would be waited for
            return False
        with open(path, "rb") as file:
            return file.read(len(_EXR)) == _EXR
    except OSError:
        return False


# --- writing ---


def packed(image: Image, path: Path) -> Image:
    """The parts of an indexed image: maps and index.

    Raises
    ------
    ImageError
        A part is not copied from a photo, or the parts are not copied alike.
    """
    copies = [part.fetch for part in image.parts if isinstance(part.fetch, Copied)]
    others = [part.name for part in image.parts if not isinstance(part.fetch, Copied)]
    if others:
        raise ImageError(
            f"{path}: {', '.join(others)}: not copied from a photo, or changed since",
            expected="the result of an op that copies, such as stationarize, quilt or warp",
            hint="write it directly after the op, or write EXR",
        )
    if any(part.spec.get_int_attribute(PROVISIONAL) for part in image.parts):
        return Image((*image.parts, _index_of(image, copies, path)), image.source)
    sizes = {(part.window, *fetch.size) for part, fetch in zip(image.parts, copies, strict=True)}
    if len(sizes) > 1:
        raise ImageError(f"{path}: {', '.join(p.name for p in image.parts)}: expected maps of one size")
    if max(copies[0].size) > 1 << BITS:
        raise ImageError(f"{path}: expected a photo with sides of at most {1 << BITS} px")
    maps = [_map_of(part, fetch) for part, fetch in zip(image.parts, copies, strict=True)]
    return Image((*maps, _index_of(image, copies, path)), image.source)


def format_of(how: Format) -> Format:
    """The settings for the file of an indexed image."""
    return dataclasses.replace(how, format_name="openexr", tile=how.tile or (_CELL, _CELL))


def _map_of(part: Part, fetch: Copied) -> Part:
    """The pixels that a part is copied from, with the part's metadata and the origin of its window."""
    width, height = fetch.size
    spec = oiio.ImageSpec(part.spec)
    spec.width, spec.height = width, height
    whole = Window.data(spec)

    def read(window: Window) -> np.ndarray:
        rows, columns = window.inside(whole)
        pixels = fetch.pixels()
        return pixels.window(rows, columns) if isinstance(pixels, TileStore) else pixels[rows][:, columns]

    return dataclasses.replace(part, spec=spec, fetch=read, levels=(), thumbnail=None)


def _index_of(image: Image, copies: list[Copied], path: Path) -> Part:
    spec = spec_beside(image.first.spec, _CHANNELS)
    spec.set_format(oiio.TypeDesc(oiio.UINT))
    mark_as_data(spec)
    spec.attribute(_VERSION, 1)
    spec.attribute("compression", "zip:9")
    whole, (width, height) = Window.data(spec), copies[0].size
    reads = list(dict.fromkeys(fetch.sources.read for fetch in copies))

    def cell(place: Window) -> np.ndarray:
        y, x = reads[0](place).yx
        for read in reads[1:]:
            if not np.array_equal(read(place).yx, (y, x)):
                names = ", ".join(part.name for part in image.parts)
                raise ImageError(f"{path}: {names}: expected maps that are copied from the same places")
        rows, columns = np.ogrid[
            place.top - whole.top : place.bottom - whole.top, place.left - whole.left : place.right - whole.left
        ]
        return _numbered((y - rows) % height << BITS | (x - columns) % width)

    def read_index(window: Window) -> np.ndarray:
        return assembled(window, (_CELL, _CELL), whole, cell)

    return Part(_INDEX, spec, read_index, spec.format, exact=True)


def _numbered(offsets: np.ndarray) -> np.ndarray:
    """The index of a cell, (h, w, 2) uint32, from its offsets."""
    _, first, inverse = np.unique(offsets.ravel(), return_index=True, return_inverse=True)
    numbers = np.empty(len(first), np.uint32)
    numbers[np.argsort(first)] = np.arange(len(first), dtype=np.uint32)
    index = np.zeros((offsets.size, 2), np.uint32)
    index[:, 0] = numbers[inverse.ravel()]
    index[first, 1] = offsets.ravel()[first]
    return index.reshape(*offsets.shape, 2)


# --- reading ---


def unpacked(parts: list[Part], path: str, cache: PieceCache) -> list[Part]:
    """The image of a file's parts; each window reads only its cells.

    Raises
    ------
    ImageError
        The parts are not those of an indexed image.
    """
    *maps, index = parts
    _require_index(maps, index, path)
    size = maps[0].spec.width, maps[0].spec.height

    def cell(place: Window) -> np.ndarray:
        key = path, index.fetch, "offsets", place
        return cache.get(key, lambda: _offsets(index.read(place), size, path))

    def read(window: Window) -> SourceMap:
        offsets = assembled(window, (_CELL, _CELL), index.window, cell)[..., 0]
        rows, columns = np.ogrid[window.inside(index.window)]
        return SourceMap.of(((offsets >> BITS) + rows) % size[1], ((offsets & 0xFFFF) + columns) % size[0])

    sources = Sources(read, index.spec, ready=True)
    return [_result_of(part, sources, cache, len(maps)) for part in maps]


def _require_index(maps: list[Part], index: Part, path: str) -> None:
    """Refuse parts whose last one is not the index of the others."""
    spec, windows = index.spec, {part.window for part in maps}
    is_index = index.name == _INDEX and tuple(spec.channelnames) == _CHANNELS and spec.format == oiio.UINT
    if not is_index or len(windows) != 1 or max(window.size for window in windows) > (1 << BITS, 1 << BITS):
        raise ImageError(f"{path}: expected maps of one size, and their index as the last part")
    if spec.get_int_attribute(_VERSION) != 1:
        raise ImageError(f"{path}: version {spec.get_int_attribute(_VERSION)} of the index: expected 1; update oiiotex")


def _offsets(index: np.ndarray, size: tuple[int, int], path: str) -> np.ndarray:
    """The offsets of a cell, (h, w, 1) int64; the inverse of `_numbered`."""
    numbers, offsets = index.reshape(-1, 2).astype(np.int64).T
    first = np.diff(np.maximum.accumulate(numbers), prepend=-1) > 0
    found = offsets[first]
    if not np.array_equal(numbers[first], np.arange(len(found))):
        raise ImageError(f"{path}: the index is damaged: it has numbers without an offset")
    if (found >> BITS >= size[1]).any() or (found & 0xFFFF >= size[0]).any():
        raise ImageError(
            f"{path}: the index is damaged: it has offsets outside the {size[0]}x{size[1]} pixels of the maps"
        )
    return found[numbers].reshape(*index.shape[:2], 1)


def _result_of(part: Part, sources: Sources, cache: PieceCache, count: int) -> Part:
    """The part that is copied from a map, one of `count`, with the metadata of an EXR file of the result."""
    spec = Window.data(sources.spec).apply_to(part.spec)
    spec.tile_width = spec.tile_height = spec.tile_depth = 0
    spec.attribute("oiio:subimages", count)
    alone = ("name", NAME) if count == 1 and spec.get_string_attribute(NAME) == "subimage00" else ()
    for name in ("openexr:chunkCount", *alone):
        spec.erase_attribute(name)
    rows, size = rows_of(part), (part.spec.width, part.spec.height)

    def held() -> np.ndarray:
        return cache.get((part.fetch, "map"), part.pixels)

    fits = _HELD * size[0] * size[1] * part.pixel_bytes <= cache.limit
    fetch = Copied(sources, held if fits else lambda: rows, size)
    name = spec.get_string_attribute(NAME) or "part0"
    return dataclasses.replace(part, name=name, spec=spec, fetch=fetch, levels=(), thumbnail=None)
