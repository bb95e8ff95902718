# SPDX-License-Identifier: Apache-2.0
"""Endless textures as hosts read them: tiles of levels, each level half as large as the one before.

A level is one of --texsynth, a tile a window of it, to the bit; the one level of a plan is what --texquilt makes of it,
that of tiles is them beside each other.
They are made in blocks of several tiles, which are kept for a while, because what comes before a window on coarser
levels costs more than a small window itself.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from ..core.attributes import EDGES, TAG, WINDOW
from ..core.demand import assembled
from ..core.image import Image, Part, dtype_of, tagged
from ..core.window import Window
from ..deferred import np, oiio
from ..errors import ImageError
from ..filters import op_named
from ..io.reading import read
from ..session import Session
from ..session.progress import Progress
from .texture_file import TextureFile, tile_side
from .tile_plane import TilePlane

_BLOCK = 256  # px, the side of what is made at once, at least
_MOST = 1 << 24  # px of a window that is asked for
_PLANE = Window(-(1 << 40), -(1 << 40), 1 << 40, 1 << 40)


class OpenTexture:
    """A texture file that has been opened.

    `spec`: of the finest level; `levels`: how many there are.
    """

    def __init__(self, text: str, session: Session):
        self._text, file = text, TextureFile.of_text(text)
        file.require_unchanged()
        kind = _QuiltTexture if file.plan else _TilesTexture if file.tiles else _EndlessTexture
        self._made = kind(file, session)
        self.spec, self.levels = self._made.spec, self._made.levels
        tile = tile_side(self.spec.width, self.spec.height)
        self.spec.tile_width = self.spec.tile_height = tile
        self.spec.tile_depth = 1
        self._side = max(_BLOCK, tile)

    def tile(self, level: int, window: Window, session: Session) -> np.ndarray:
        """(height, width, channels) of the spec's pixel type: pixels of a level, 0 the finest.

        Beyond the border an endless texture goes on, a quilt is black.
        """
        size = f"{window.width}x{window.height}"
        if window.empty or window.width * window.height > _MOST or (window & _PLANE) != window:
            raise ImageError(f"window {size}{window.left:+d}{window.top:+d}: expected up to {_MOST} px, near")
        if not 0 <= level < self.levels:
            raise ImageError(f"level {level}: there are {self.levels}")

        def block(place: Window) -> np.ndarray:
            made = self._made
            return session.resources.cache.get((self._text, level, place), lambda: made.pixels(level, place, session))

        return assembled(window, (self._side, self._side), _PLANE, block)


class _EndlessTexture:
    """A plane of --texsynth. Beyond its level 0, where a pixel is as large as the exemplar, there is one color."""

    def __init__(self, file: TextureFile, session: Session):
        photo = None if file.photo is None else _opened(file.photo, file, session)
        graph = Path(file.graph) if file.graph else None
        self._op = _use("synth", exemplar=photo, graph=graph, seed=file.seed, level=file.level)
        first = self._part(Window(0, 0, 1, 1), session, file.level)
        self._finest = first.spec.get_int_attribute("oiiotex:level")
        self.spec = _spec_of(first, file)
        self.levels = max(file.width, file.height).bit_length()  # down to one pixel

    def pixels(self, level: int, place: Window, session: Session) -> np.ndarray:
        """Those of a window of a level."""
        if level > self._finest:
            pixel = self.pixels(self._finest, Window(0, 0, 1, 1), session)
            return np.broadcast_to(pixel, (place.height, place.width, pixel.shape[2]))
        part = self._part(place, session, self._finest - level)
        return part.read(part.window)

    def _part(self, place: Window, session: Session, level: int | None) -> Part:
        window = f"{place.width}x{place.height}{place.left:+d}{place.top:+d}"
        part: Part = replace(self._op, window=window, level=level).compute(session)["texture"]
        return part


class _QuiltTexture:
    """What --texquilt:render=1 makes of a plan. It has one level: hosts that want more make them."""

    levels = 1

    def __init__(self, file: TextureFile, session: Session):
        quiet = session.telling(Progress())  # outlives the job that opens it
        exemplar = _opened(file.photo or "", file, session)
        op = _use("quilt", exemplar=exemplar, plan=Path(file.plan or ""), render=True)
        self._part: Part = op.compute(quiet)["quilt"]
        self.spec = oiio.ImageSpec(self._part.spec)
        if not tile_side(self.spec.width, self.spec.height):
            raise ImageError(f"{file.plan}: expected 2^48 px in all")

    def pixels(self, level: int, place: Window, session: Session) -> np.ndarray:
        """Those of a window, black beyond the border."""
        inside = place & self._part.window
        out = np.zeros((place.height, place.width, self.spec.nchannels), dtype_of(self.spec))
        if not inside.empty:
            out[inside.inside(place)] = self._part.read(inside)
        return out


class _TilesTexture:
    """Tiles beside each other. They have one level, as a quilt has."""

    levels = 1

    def __init__(self, file: TextureFile, session: Session):
        tiles = _opened(file.tiles or "", file, session)
        self._plane = TilePlane(tiles, file.seed or 0)
        self.spec = _spec_of(tiles.first, file)

    def pixels(self, level: int, place: Window, session: Session) -> np.ndarray:
        """Those of a window."""
        return self._plane.pixels(place)


def _use(name: str, **values: Any) -> Any:
    return op_named(name)(**values)


def _spec_of(part: Part, file: TextureFile) -> oiio.ImageSpec:
    """Of an image as large as the file says, of pixels like a part's."""
    spec = oiio.ImageSpec(part.spec)
    for name in (WINDOW, EDGES, "oiio:subimagename"):
        spec.erase_attribute(name)
    spec.x = spec.y = spec.full_x = spec.full_y = 0
    spec.width = spec.full_width = file.width
    spec.height = spec.full_height = file.height
    spec.attribute("textureformat", "Plain Texture")
    return spec


def opened(text: str, session: Session) -> OpenTexture:
    """The texture of that text, which is remembered."""
    return session.resources.remembered(("texture", text), lambda: OpenTexture(text, session))


def _opened(path: str, file: TextureFile, session: Session) -> Image:
    """An image of the file's, one for all textures of it, so that it is analyzed once."""

    def read_and_tagged() -> Image:
        image = read(path, session.resources.cache)
        if not file.colorspace:
            return image
        session.resources.color.resolve(file.colorspace)
        return tagged(image, TAG, session.resources.color.known_name(file.colorspace))

    return session.resources.remembered(("photo", path, file.stamp, file.colorspace), read_and_tagged)
