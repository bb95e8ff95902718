# SPDX-License-Identifier: Apache-2.0
"""Reading of image files: through ImageInput, in pieces, decoded ahead. `writing` writes them."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import os
import threading
import weakref
from collections.abc import Callable, Iterator
from pathlib import Path

from ..core.attributes import TAG, as_utf8
from ..core.demand import assembled
from ..core.image import IDS, Image, Part, dtype_of, in_memory, unrounded
from ..core.piece_cache import PieceCache
from ..core.upright import upright
from ..core.window import Window
from ..deferred import np, oiio
from ..errors import ImageError, either, one_line
from .atomic import held_beside, part_of, release
from .copies import is_indexed, unpacked
from .description import NAME, restore
from .documents import require_regular

_PIECE_BYTES = 4 << 20
_BLOCK = 16  # rows of a piece are a multiple of the rows compressed together, or of this if that is unknown
_CACHE_BYTES = 256 << 20
_CINEON = 0x802A5FD7
_sources: weakref.WeakSet[_OpenFile] = weakref.WeakSet()


def read(
    path: str | os.PathLike[str],
    cache: PieceCache | None = None,
    *,
    native: bool = False,
    turned: bool = True,
    config: oiio.ImageSpec | None = None,
) -> Image:
    """Open an image file; pixels are read on demand.

    Parameters
    ----------
    path : path
    cache : PieceCache, optional
        Cache of decoded pieces. Default: a new one.
    native : bool
        oiiotool's ops work in the file's pixel type.
    turned : bool
        Whether pixels are turned upright, as the file's Orientation says.
    config : oiio.ImageSpec, optional
        Hints for the file's reader, as attributes.

    Raises
    ------
    ImageError
        The file does not exist, is not an image, or of an unsupported kind (volume).
    """
    path = checked_name(path)
    if not os.path.exists(path):
        raise ImageError(f"{path}: no such file")
    require_regular(path)
    _require_user_data(path)
    source = _OpenFile(path, config)
    cache = cache or PieceCache(_CACHE_BYTES)
    parts: list[Part] = []
    for specs in source.specs():
        levels = [_part(source, cache, spec, (len(parts), level), native) for level, spec in enumerate(specs)]
        parts.append(dataclasses.replace(levels[0], levels=tuple(levels[1:])))
    if is_indexed(path):
        parts = unpacked(parts, path, cache)
    image = Image(tuple(parts), path)
    return upright(image) if turned else image


def checked_name(path: str | os.PathLike[str]) -> str:
    """A file name as OpenImageIO expects it.

    Raises
    ------
    ImageError
        The name is not UTF-8.
    """
    path = os.fspath(path)
    try:
        path.encode()
    except UnicodeEncodeError:
        raise ImageError(f"{as_utf8(path)}: the file name is not UTF-8, as OpenImageIO requires") from None
    return path


def keep_readable(path: Path) -> None:
    """Keep the contents of a file that is about to be replaced, for images that still read from it."""
    for source in list(_sources):
        if os.path.exists(path) and os.path.exists(source.place) and os.path.samefile(path, source.place):
            source.keep()


def error_text(geterror: Callable[[], str]) -> str:
    """An error of OpenImageIO in one line: it may quote names from broken files, with any bytes."""
    try:
        return one_line(geterror())
    except UnicodeDecodeError as error:
        return one_line(error.object.decode(errors="backslashreplace"))


def _require_user_data(path: str) -> None:
    """Refuse a Cineon file whose header names more user data than the file holds: its reader allocates all of it.

    The header begins with magic number, offset of the pixels, and the lengths of its generic, its industry and its user
    part, in the byte order of the magic number. Readers of other formats compare such lengths with the file's size.
    """
    try:
        with open(path, "rb") as file:
            head = file.read(20)
    except OSError:
        return  # opening it reports the error
    for order in ("big", "little"):
        magic, length = (int.from_bytes(head[at : at + 4], order) for at in (0, 16))
        if magic == _CINEON and length > os.path.getsize(path):
            raise ImageError(f"{path}: the file is damaged: it says that it has {length} bytes of user data")


class _OpenFile:
    """An open file, read by one thread at a time."""

    def __init__(self, path: str, config: oiio.ImageSpec | None):
        self.path = path
        self.place = os.path.abspath(path)  # the caller may change the current folder
        self._config = config or oiio.ImageSpec()  # without hints the PFM reader would not flip its rows upright
        self._lock = threading.Lock()
        self._state = _state_of(path)
        self._input = self._open()
        self.format = self._input.format_name()
        _sources.add(self)

    def _open(self) -> oiio.ImageInput:
        with _without_plugin(self.place) as self._opened_as:
            opened = oiio.ImageInput.open(self._opened_as, self._config)
        if opened is None:
            message = self._error(oiio.geterror) or "unknown format"
            raise ImageError(f"{self.path}: cannot read the image: {message}")
        return opened

    def _error(self, geterror: Callable[[], str]) -> str:
        """An error of OpenImageIO, with the file's own name."""
        return error_text(geterror).replace(self._opened_as, self.place)

    def keep(self) -> None:
        """Continue reading under another name: most readers reopen the file to go back to earlier rows."""
        held = held_beside(Path(self.place))
        kept = part_of(held, "kept")
        with self._lock:
            try:
                os.link(self.place, kept)
            except OSError:  # a file system without links
                import shutil

                shutil.copyfile(self.place, kept)
            weakref.finalize(self, release, held)
            self.place = str(kept)
            self._state = _state_of(self.place)
            self._input = self._open()

    def specs(self) -> Iterator[list[oiio.ImageSpec]]:
        """For each subimage the specs of its MIP levels."""
        subimage = 0
        while self._input.seek_subimage(subimage, 0):
            levels: list[oiio.ImageSpec] = []
            while self._input.seek_subimage(subimage, len(levels)):
                spec = _checked(oiio.ImageSpec(self._input.spec()), self.path)
                if self.format == "ico":  # its reader counts the bits of a palette index
                    spec.erase_attribute("oiio:BitsPerSample")
                if spec.depth > 1:
                    raise ImageError(f"{self.path}: volume images are not supported")
                if self.format == "tiff" and spec.format == oiio.DOUBLE:
                    raise ImageError(f"{self.path}: TIFF files of type double are not supported")
                restore(spec, self.format, self.place)
                levels.append(spec)
            yield levels
            subimage += 1
        error_text(self._input.geterror)  # discard the error about a subimage after the last
        if self.format == "webp":  # its reader does not recover from that error
            self._input = self._open()

    def read(self, place: Window, spec: oiio.ImageSpec, where: tuple[int, int], channels: range) -> np.ndarray:
        """Pixels of whole rows, or whole tiles, of (subimage, level), in the spec's type; some consecutive channels."""
        runs = list(_runs(spec, channels))
        with self._lock:
            planes = [self._planes(place, spec, where, run) for run in runs]
        if len(runs) == 1:
            return planes[0]
        try:
            return np.concatenate(list(map(unrounded, planes)), axis=-1)
        except ImageError as error:
            names = ", ".join(spec.channelnames[c] for c in channels if str(spec.channelformat(c)) in IDS)
            hint = either(f"write them to a separate file: --ch {names}", "write them to a separate file")
            raise ImageError(f"{self.path}: {names}: {error}", hint=hint) from None

    def _planes(self, place: Window, spec: oiio.ImageSpec, where: tuple[int, int], run: range) -> np.ndarray:
        """Consecutive channels of one type."""
        kind = _kind(spec, run.start)
        if spec.tile_width == 0:
            rows = place.top, place.bottom
            pixels = self._input.read_scanlines(*where, *rows, 0, run.start, run.stop, kind)
        else:
            square = place.left, place.right, place.top, place.bottom
            pixels = self._input.read_tiles(*where, *square, 0, 1, run.start, run.stop, kind)
        message = self._error(self._input.geterror)
        if _state_of(self.place) != self._state:  # the rows may come from two files
            raise ImageError(f"{self.path}: the file was changed by another program while it was read")
        if pixels is None or message:  # libjpeg fills missing pixels, and only reports it
            rows_text = f"rows {place.top - spec.y} to {place.bottom - spec.y - 1}"
            raise ImageError(f"{self.path}: cannot read {rows_text}: {message or 'the file is damaged'}")
        return pixels.reshape(place.height, place.width, len(run))

    def deep(self, where: tuple[int, int]) -> oiio.ImageBuf:
        """All pixels of a deep (subimage, level)."""
        with self._lock:
            buffer = oiio.ImageBuf(self.place, *where, self._config)
            if not buffer.read(*where, True) or buffer.has_error:
                raise ImageError(f"{self.path}: cannot read the pixels: {error_text(buffer.geterror)}")
            return buffer

    def thumbnail(self, subimage: int) -> oiio.ImageBuf:
        """The thumbnail of a subimage."""
        with self._lock:
            small = self._input.get_thumbnail(subimage)
            message = error_text(self._input.geterror)
        if small is None or not small.initialized:
            raise ImageError(f"{self.path}: cannot read the thumbnail: {message or 'the file is damaged'}")
        return small


@contextlib.contextmanager
def _without_plugin(path: str) -> Iterator[str]:
    """A name by which OpenImageIO does not take an indexed image for one of its plugin for .oiiotex files."""
    if not (is_indexed(path) and os.path.isdir("/dev/fd")):
        yield path
        return
    with open(path, "rb") as file:
        yield f"/dev/fd/{file.fileno()}"


def _checked(spec: oiio.ImageSpec, path: str) -> oiio.ImageSpec:
    """A file's spec without fields that contradict each other, as readers deliver of some files.

    Raises
    ------
    ImageError
        The image has a negative size or no channels.
    """
    if spec.width < 0 or spec.height < 0 or spec.nchannels < 1:
        size = f"{spec.width}x{spec.height} pixels of {spec.nchannels} channels"
        raise ImageError(f"{path}: the file is damaged: it says that the image has {size}")
    if len(spec.channelnames) != spec.nchannels:
        spec.default_channel_names()
    if len(spec.channelformats) not in (0, spec.nchannels):
        spec.channelformats = ()
    channels = spec.channelnames
    for attribute in (NAME, TAG):  # PSD files have names in the encodings of old computers
        name = spec.get_string_attribute(attribute)
        if as_utf8(name) != name:
            spec.attribute(attribute, as_utf8(name))
    if tuple(map(as_utf8, channels)) != channels:
        spec.channelnames = tuple(map(as_utf8, channels))
    names = [name.lower() for name in spec.channelnames]
    if spec.alpha_channel not in range(-1, spec.nchannels):  # GIF: it counts from 1
        spec.alpha_channel = next((names.index(name) for name in ("a", "alpha") if name in names), -1)
    if spec.z_channel not in range(-1, spec.nchannels):
        spec.z_channel = next((names.index(name) for name in ("z", "depth") if name in names), -1)
    if spec.tile_width < 1 or spec.tile_height < 1:
        spec.tile_width = spec.tile_height = 0
    if spec.full_width < 1 or spec.full_height < 1:
        Window.data(spec).show_in(spec)
    return spec


def _state_of(path: str) -> tuple[int, ...] | None:
    """The identity and state of a file; None if it does not exist."""
    try:
        status = os.stat(path)
    except OSError:
        return None
    return status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns


def _kind(spec: oiio.ImageSpec, channel: int) -> oiio.TypeDesc:
    """The type in which a channel is read: the spec's, which holds all values but those of wide types."""
    own = spec.channelformat(channel)
    return own if str(own) in (*IDS, "double") else spec.format


def _runs(spec: oiio.ImageSpec, channels: range) -> Iterator[range]:
    """Ranges of consecutive channels that are read in one type."""
    begin = channels.start
    for channel in channels:
        if channel + 1 == channels.stop or _kind(spec, channel + 1) != _kind(spec, begin):
            yield range(begin, channel + 1)
            begin = channel + 1


def _part(source: _OpenFile, cache: PieceCache, spec: oiio.ImageSpec, where: tuple[int, int], native: bool) -> Part:
    name = spec.get_string_attribute("oiio:subimagename") or f"part{where[0]}"
    stored = spec.format
    if spec.channelformats:
        spec = _with_common_type(spec)
    dtype_of(spec)  # refuses pixel types that numpy lacks

    if spec.deep:  # all samples are read at once, on first use
        whole_buffer = functools.cache(lambda: source.deep(where))
        return Part(name, spec, lambda window: in_memory(name, whole_buffer()).fetch(window), stored, native)
    small = functools.partial(source.thumbnail, where[0]) if spec.get_int_attribute("thumbnail_width") else None
    pixels = FilePixels(source, cache, spec, where, range(spec.nchannels))
    return Part(name, spec, pixels, stored, native, ready=True, thumbnail=small)


def _with_common_type(spec: oiio.ImageSpec) -> oiio.ImageSpec:
    """A spec whose pixel type holds the values of all channels: IFF's float depth would be clamped as 16-bit integers.

    Its channels' own types are kept.
    """
    new, kinds = oiio.ImageSpec(spec), spec.channelformats
    if spec.format not in (oiio.FLOAT, oiio.DOUBLE) and any(kind != spec.format for kind in kinds):
        new.set_format(oiio.TypeDesc(oiio.FLOAT))
        new.channelformats = kinds
    return new


@dataclasses.dataclass(frozen=True)
class FilePixels:
    """The `fetch` of a part of a file: consecutive channels of (subimage, level), in the type of `spec`."""

    source: _OpenFile
    cache: PieceCache
    spec: oiio.ImageSpec
    where: tuple[int, int]
    channels: range

    def __call__(self, window: Window) -> np.ndarray:
        """The pixels of a window, assembled from pieces that are decoded at once."""
        return assembled(window, _piece_size(self.spec), Window.data(self.spec), self._piece)

    def alone(self, channel: int) -> FilePixels:
        """One channel, in its own type."""
        spec = oiio.ImageSpec(self.spec)
        spec.set_format(spec.channelformat(channel))
        return dataclasses.replace(self, spec=spec, channels=range(channel, channel + 1))

    def planes(self, window: Window) -> list[np.ndarray]:
        """The pixels of a window, consecutive channels of one type together."""
        return [dataclasses.replace(self, channels=run)(window) for run in _runs(self.spec, self.channels)]

    def _piece(self, place: Window) -> np.ndarray:
        whole, cell = Window.data(self.spec), _piece_size(self.spec)
        below = Window.sized(whole.left, place.bottom, *cell) & whole
        right = Window.sized(place.right, place.top, *cell) & whole
        pixels = self.cache.get(self._key(place), self._make(place))
        following = right if not right.empty else below
        if not following.empty:
            self.cache.ahead(self._key(following), self._make(following))
        return pixels

    def _key(self, place: Window) -> tuple[object, ...]:
        return self.source, self.where, self.channels, place

    def _make(self, place: Window) -> Callable[[], np.ndarray]:
        return lambda: self.source.read(place, self.spec, self.where, self.channels)


def _piece_size(spec: oiio.ImageSpec) -> tuple[int, int]:
    """(width, height) of a piece that is decoded at once: rows of tiles, or full rows."""
    pixel = spec.nchannels * np.dtype(dtype_of(spec)).itemsize
    if spec.tile_width:
        across = -(-spec.width // spec.tile_width)
        fit = max(1, _PIECE_BYTES // (pixel * spec.tile_width * spec.tile_height))
        return min(across, fit) * spec.tile_width, spec.tile_height * max(1, fit // across)
    row = max(1, spec.width * pixel)
    together = spec.get_int_attribute("oiio:RowsPerChunk") or spec.get_int_attribute("tiff:RowsPerStrip") or _BLOCK
    if together * row > 8 * _PIECE_BYTES:  # decoded again for each piece, but in bounded memory
        together = 1
    return spec.width, max(1, _PIECE_BYTES // row // together) * together
