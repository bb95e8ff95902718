# SPDX-License-Identifier: Apache-2.0
"""Endless textures as hosts read them: tiles of levels, each level half as large as the one before.

A level is one of --texsynth, a tile a window of it, to the bit. They are made in blocks of several tiles, which are
kept for a while, because what comes before a window on coarser levels costs more than a small window itself.
"""

from __future__ import annotations

from dataclasses import replace

from ..core.attributes import TAG, WINDOW
from ..core.demand import assembled
from ..core.image import Image, Part, tagged
from ..core.window import Window
from ..deferred import np, oiio
from ..errors import ImageError
from ..filters.synth import Synth
from ..io.reading import read
from ..session import Session
from .texture_file import TextureFile

_BLOCK = 256  # px, the side of what is made at once, at least
_MOST = 1 << 24  # px of a window that is asked for
_PLANE = Window(-(1 << 40), -(1 << 40), 1 << 40, 1 << 40)


class Texture:
    """A texture file that has been opened.

    Parameters
    ----------
    text : str
        As by `TextureFile.text`.
    session : Session

    Attributes
    ----------
    spec : ImageSpec
        Of the finest level.
    levels : int
        How many there are, down to one pixel.
    """

    def __init__(self, text: str, session: Session):
        self._text, file = text, TextureFile.of_text(text)
        self._side = max(_BLOCK, file.tile)
        file.require_unchanged()
        photo = None if file.photo is None else _photo(file, session)
        self._op = Synth(exemplar=photo, graph=file.graph, seed=file.seed, level=file.level)
        first = self._part(0, Window(0, 0, 1, 1), session, file.level)
        self._level = first.spec.get_int_attribute("oiiotex:level")
        self.spec = oiio.ImageSpec(first.spec)
        self.spec.erase_attribute(WINDOW)
        self.spec.width = self.spec.full_width = file.width
        self.spec.height = self.spec.full_height = file.height
        self.spec.tile_width = self.spec.tile_height = file.tile
        self.spec.tile_depth = 1
        self.spec.attribute("textureformat", "Plain Texture")
        self.levels = max(file.width, file.height).bit_length()

    def tile(self, level: int, window: Window, session: Session) -> np.ndarray:
        """(height, width, channels) of the spec's pixel type: pixels of a level, 0 the finest; also beyond its border.

        Beyond level 0 of --texsynth, where a pixel is as large as the exemplar, there is one colour.

        Raises
        ------
        ImageError
            There is no such level, or the window is empty, too large or too far away.
        """
        size = f"{window.width}x{window.height}"
        if window.empty or window.width * window.height > _MOST or (window & _PLANE) != window:
            raise ImageError(f"window {size}{window.left:+d}{window.top:+d}: allowed are up to {_MOST} px, near")
        if not 0 <= level < self.levels:
            raise ImageError(f"level {level}: there are {self.levels}")
        if level > self._level:
            pixel = self._block(self._level, Window(0, 0, 1, 1), session)
            return np.broadcast_to(pixel, (window.height, window.width, pixel.shape[2]))
        return assembled(window, (self._side, self._side), _PLANE, lambda at: self._block(level, at, session))

    def _block(self, level: int, place: Window, session: Session) -> np.ndarray:
        def made() -> np.ndarray:
            part = self._part(level, place, session, self._level - level)
            return part.read(part.window)

        return session.cache.get((self._text, level, place), made)

    def _part(self, level: int, place: Window, session: Session, synth_level: int | None) -> Part:
        window = f"{place.width}x{place.height}{place.left:+d}{place.top:+d}"
        op = replace(self._op, window=window, level=synth_level)
        part: Part = op.compute(session)["texture"]
        return part


def opened(text: str, session: Session) -> Texture:
    """The texture of that text, which is remembered."""
    return session.resources.remembered(("texture", text), lambda: Texture(text, session))


def _photo(file: TextureFile, session: Session) -> Image:
    """The exemplar, one for all textures of it, so that it is analysed once."""

    def opened_photo() -> Image:
        image = read(file.exemplar, session.cache)
        if not file.colorspace:
            return image
        session.color.resolve(file.colorspace)
        return tagged(image, TAG, session.color.known_name(file.colorspace))

    return session.resources.remembered(("photo", file.photo, file.stamp, file.colorspace), opened_photo)
