# SPDX-License-Identifier: Apache-2.0
"""Textures for hosts: tiles of MIP levels, each half the size of the previous one.

Levels are those of --texsynth, and tiles are windows of them, bit for bit. A plan has one level, the result of
--texquilt. A set of tiles has one level, the tiles arranged side by side. An indexed image has one, and a part for each
map. Pixels are computed and cached in blocks of
several tiles, because the coarser levels of a window cost more than a small window itself.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from ...engine.core.attributes import EDGES, WINDOW
from ...engine.core.demand import assembled
from ...engine.core.image import Image, Part, cropped, tagged
from ...engine.core.window import Window
from ...engine.deferred import np, oiio
from ...engine.errors import ImageError
from ...engine.io.reading import read
from ...engine.session import Session
from ...engine.session.progress import Progress
from ...filters import op_named
from ...synthesis.wang.plane import TilePlane
from .texture_file import TextureFile, tile_side

_BLOCK = 256  # px; smallest block size
_MOST = 1 << 24  # px; largest window of a request
_PLANE = Window(-(1 << 40), -(1 << 40), 1 << 40, 1 << 40)


class OpenTexture:
    """An open texture file.

    `specs`: specs of the finest level of each part; `levels`: number of levels.
    """

    def __init__(self, text: str, session: Session):
        self._text, file = text, TextureFile.of_text(text)
        file.require_unchanged()
        self._made = _made(file, session)
        self.specs, self.levels = self._made.specs, self._made.levels
        tile = tile_side(self.spec.width, self.spec.height)
        for spec in self.specs:
            spec.tile_width = spec.tile_height = tile
            spec.tile_depth = 1
        self._side = max(_BLOCK, tile)

    @property
    def spec(self) -> oiio.ImageSpec:
        """The spec of the first part."""
        return self.specs[0]

    def tile(self, level: int, window: Window, session: Session, part: int = 0) -> np.ndarray:
        """Pixels of a level (0: the finest) of a part, (height, width, channels) of the spec's pixel type.

        Outside the image, an unbounded texture continues; a quilt and an indexed image are black.
        """
        size = f"{window.width}x{window.height}"
        if window.empty or window.width * window.height > _MOST or (window & _PLANE) != window:
            raise ImageError(f"window {size}{window.left:+d}{window.top:+d}: expected 1 to {_MOST} px, near the origin")
        if not 0 <= level < self.levels:
            raise ImageError(f"level {level}: expected 0 to {self.levels - 1}")
        if not 0 <= part < len(self.specs):
            raise ImageError(f"part {part}: expected 0 to {len(self.specs) - 1}")

        def block(place: Window) -> np.ndarray:
            key = self._text, part, level, place
            return session.resources.cache.get(key, lambda: self._made.pixels(part, level, place, session))

        return assembled(window, (self._side, self._side), _PLANE, block)


class _Made(NamedTuple):
    """The specs of a file's parts, its number of levels, and its pixels.

    `pixels`: (part, level, window, session) -> (height, width, channels).
    """

    specs: list[oiio.ImageSpec]
    levels: int
    pixels: Callable[[int, int, Window, Session], np.ndarray]


def _made(file: TextureFile, session: Session) -> _Made:
    if file.indexed:
        return _of_parts(file.indexed, _opened(file.indexed, file, session).parts)
    if file.tiles:
        tiles = _opened(file.tiles, file, session)
        plane = TilePlane(tiles, file.seed or 0)
        return _Made([_spec_of(tiles.first, file)], 1, lambda _part, _level, place, _session: plane.pixels(place))
    if file.plan:  # rendered as by --texquilt:fromplan
        quiet = session.telling(Progress())  # the part outlives the job that opens it
        op = _use("quilt", exemplar=_opened(file.photo or "", file, session), fromplan=Path(file.plan))
        return _of_parts(file.plan, (op.make(op.plan(quiet.resources), quiet)["quilt"],))
    return _endless(file, session)


def _endless(file: TextureFile, session: Session) -> _Made:
    """A plane of --texsynth. Levels coarser than its level 0, whose pixels cover an exemplar, have a single color."""
    photo = None if file.photo is None else _opened(file.photo, file, session)
    whole = _use("synth", exemplar=photo, graph=Path(file.graph) if file.graph else None, seed=file.seed, lod=file.lod)

    def rendered(place: Window, session: Session, lod: int | None) -> Part:
        op = replace(whole, window=f"{place.width}x{place.height}{place.left:+d}{place.top:+d}", lod=lod)
        part: Part = op.make(op.plan(session.resources), session)["texture"]
        return part

    first = rendered(Window(0, 0, 1, 1), session, file.lod)
    finest = first.spec.get_int_attribute("oiiotex:level")

    def pixels(part: int, level: int, place: Window, session: Session) -> np.ndarray:
        if level > finest:
            pixel = pixels(part, finest, Window(0, 0, 1, 1), session)
            return np.broadcast_to(pixel, (place.height, place.width, pixel.shape[2]))
        plane = rendered(place, session, finest - level)
        return plane.read(plane.window)

    return _Made([_spec_of(first, file)], max(file.width, file.height).bit_length(), pixels)  # down to one pixel


def _of_parts(name: str, parts: Sequence[Part]) -> _Made:
    """Parts, black outside. They have one level; hosts can make further ones."""
    if not tile_side(parts[0].spec.width, parts[0].spec.height):  # a cache of OpenImageIO cannot count the tiles
        raise ImageError(f"{name}: too large: expected at most 2^48 px in total")
    specs = [oiio.ImageSpec(part.spec) for part in parts]
    for spec in specs:
        spec.channelformats = ()
    return _Made(specs, 1, lambda part, _level, place, _session: cropped(parts[part], place).read(place))


def _use(name: str, **values: Any) -> Any:
    return op_named(name)(**values)


def _spec_of(part: Part, file: TextureFile) -> oiio.ImageSpec:
    """The spec of an image of the file's size, with pixels like the part's."""
    spec = oiio.ImageSpec(part.spec)
    for name in (WINDOW, EDGES, "oiio:subimagename"):
        spec.erase_attribute(name)
    spec.x = spec.y = spec.full_x = spec.full_y = 0
    spec.width = spec.full_width = file.width
    spec.height = spec.full_height = file.height
    spec.attribute("textureformat", "Plain Texture")
    return spec


def opened(text: str, session: Session) -> OpenTexture:
    """The texture with that key, cached."""
    return session.resources.remembered(("texture", text), lambda: OpenTexture(text, session))


def _opened(path: str, file: TextureFile, session: Session) -> Image:
    """An image of the file, shared by all its textures, so that it is analyzed only once."""

    def read_and_tagged() -> Image:
        image = read(path, session.resources.cache)
        if not file.colorspace:
            return image
        session.resources.color.resolve(file.colorspace)
        return tagged(image, session.resources.color.known_name(file.colorspace))

    return session.resources.remembered(("photo", path, file.stamp, file.colorspace), read_and_tagged)
