# SPDX-License-Identifier: Apache-2.0
"""How images enter and leave: windows, channels, alpha, parts, metadata, temp-then-rename.

Between ops travels a lazy `Image`: parts that know their spec and can produce rows. Where the rows come from (a file,
a buffer, an op not yet computed) is the part's own business.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from .errors import ImageError
from .temporary import temporary_beside

_STALE = ("oiio:SHA-1", "oiio:ConstantColor", "oiio:AverageColor", "textureformat", "wrapmodes")
_BAND_BYTES = 8 << 20
_NUMPY = {
    oiio.UINT8: np.uint8, oiio.INT8: np.int8, oiio.UINT16: np.uint16, oiio.INT16: np.int16, oiio.UINT32: np.uint32,
    oiio.INT32: np.int32, oiio.HALF: np.float16, oiio.FLOAT: np.float32, oiio.DOUBLE: np.float64,
}  # fmt: skip


@dataclass(frozen=True)
class Part:
    """One image of a file.

    `spec` holds data and display window, channels, pixel type and metadata. `rows(begin, end)` gives rows counted from
    the top of the data window as an (end - begin, width, channels) array of the spec's own pixel type.
    """

    name: str
    spec: oiio.ImageSpec
    rows: Callable[[int, int], np.ndarray]

    def pixels(self) -> np.ndarray:
        """The whole data window, (height, width, channels)."""
        return self.rows(0, self.spec.height)

    def bands(self) -> Iterator[tuple[int, int]]:
        """Row ranges of a few megabytes each that cover the part from top to bottom."""
        row_bytes = self.spec.width * self.spec.nchannels * np.dtype(dtype_of(self.spec)).itemsize
        step = max(1, _BAND_BYTES // max(1, row_bytes))
        for begin in range(0, self.spec.height, step):
            yield begin, min(begin + step, self.spec.height)


@dataclass(frozen=True)
class Image:
    """What travels between ops: one part or more, the first being the picture itself."""

    parts: tuple[Part, ...]
    source: str = "image"  # a name for messages

    @property
    def first(self) -> Part:
        """The picture itself."""
        return self.parts[0]

    def part(self, name: str) -> Part | None:
        """The part of that name, or None."""
        return next((p for p in self.parts if p.name == name), None)


@dataclass(frozen=True)
class Channels:
    """Which channels are colour (R, G, B, or one gray) and which is alpha."""

    colour: tuple[int, ...]
    alpha: int | None


def channels_of(spec: oiio.ImageSpec) -> Channels:
    """Colour is R, G, B or Y by name, else the first three that are not alpha, or the one there is."""
    names = [n.upper() for n in spec.channelnames]
    alpha = spec.alpha_channel if spec.alpha_channel >= 0 else names.index("A") if "A" in names else None
    if all(c in names for c in "RGB"):
        return Channels(tuple(names.index(c) for c in "RGB"), alpha)
    if "Y" in names and "X" not in names:
        return Channels((names.index("Y"),), alpha)
    others = [i for i in range(spec.nchannels) if i != alpha]
    return Channels(tuple(others[:3]), alpha)


def dtype_of(spec: oiio.ImageSpec) -> type[np.generic]:
    """The numpy type of a spec's pixels."""
    found = _NUMPY.get(oiio.BASETYPE(spec.format.basetype))
    if found is None:
        raise ImageError(f"pixels of type {spec.format} are not supported")
    return found


def type_named(name: str) -> oiio.TypeDesc:
    """The pixel type of a `-d` name such as 'half' or 'uint16'.

    Raises
    ------
    ImageError
        There is no such type. OpenImageIO would silently fall back to another one ('uint32' is spelt 'uint').
    """
    described = oiio.TypeDesc(name)
    if (
        oiio.BASETYPE(described.basetype) not in _NUMPY
        or described != oiio.TypeDesc(oiio.BASETYPE(described.basetype))
        or str(described) != name
    ):
        raise ImageError(f"no pixel type '{name}'; there is {', '.join(str(oiio.TypeDesc(t)) for t in _NUMPY)}")
    return described


def from_pixels(name: str, pixels: np.ndarray, spec: oiio.ImageSpec) -> Part:
    """A part that lies in memory."""
    return Part(name, spec, lambda begin, end: pixels[begin:end])


def derived_spec(spec: oiio.ImageSpec, width: int | None = None, height: int | None = None) -> oiio.ImageSpec:
    """A copy of `spec` for changed pixels: stale hashes are dropped; a new size makes a new window at the origin."""
    new = oiio.ImageSpec(spec)
    new.tile_width = new.tile_height = new.tile_depth = 0
    for name in _STALE:
        new.erase_attribute(name)
    if width is not None and height is not None:
        new.x = new.y = new.full_x = new.full_y = 0
        new.width = new.full_width = width
        new.height = new.full_height = height
    return new


# --- in ---


def read(path: str | os.PathLike) -> Image:
    """Open an image file; pixels are read when they are asked for.

    Raises
    ------
    ImageError
        It is not there, or not an image, or of a kind that cannot be used (deep, volume).
    """
    path = os.fspath(path)
    if not os.path.exists(path):
        raise ImageError(f"{path}: no such file")
    file = oiio.ImageInput.open(path)
    if file is None:
        raise ImageError(f"{path}: not an image that can be read: {_one_line(oiio.geterror())}")
    parts: list[Part] = []
    while file.seek_subimage(len(parts), 0):
        spec = oiio.ImageSpec(file.spec())
        if spec.deep or spec.depth > 1:
            raise ImageError(f"{path}: deep and volume images are not supported")
        name = spec.get_string_attribute("oiio:subimagename") or f"part{len(parts)}"
        if file.format_name() == "tiff" and spec.format == oiio.DOUBLE:
            raise ImageError(f"{path}: TIFF files of doubles are not supported")
        parts.append(Part(name, spec, _file_rows(path, file, len(parts), spec)))
    file.geterror()  # there is no part after the last
    return Image(tuple(parts), path)


def from_buffer(buffer: oiio.ImageBuf) -> Image:
    """An ImageBuf as it stands now."""
    if not isinstance(buffer, oiio.ImageBuf):
        raise ImageError(f"an OpenImageIO.ImageBuf is wanted, not {type(buffer).__name__}")
    if buffer.has_error or not buffer.initialized:
        raise ImageError(f"{buffer.name or 'ImageBuf'}: {_one_line(buffer.geterror()) or 'holds no image'}")
    spec = oiio.ImageSpec(buffer.spec())
    if spec.deep or spec.depth > 1:
        raise ImageError(f"{buffer.name or 'ImageBuf'}: deep and volume images are not supported")
    pixels = buffer.get_pixels(spec.format, buffer.roi)
    name = spec.get_string_attribute("oiio:subimagename") or "part0"
    return Image(
        (from_pixels(name, pixels.reshape(spec.height, spec.width, spec.nchannels), spec),), buffer.name or "ImageBuf"
    )


def _file_rows(
    path: str, file: oiio.ImageInput, subimage: int, spec: oiio.ImageSpec
) -> Callable[[int, int], np.ndarray]:
    def rows(begin: int, end: int) -> np.ndarray:
        top, right, channels = spec.y, spec.x + spec.width, spec.nchannels
        if spec.tile_height == 0:
            pixels = file.read_scanlines(subimage, 0, top + begin, top + end, 0, 0, channels, spec.format)
            skip = 0
        else:  # tiles are read whole
            skip = begin % spec.tile_height
            below = min(spec.height, -(-end // spec.tile_height) * spec.tile_height)
            pixels = file.read_tiles(
                subimage, 0, spec.x, right, top + begin - skip, top + below, 0, 1, 0, channels, spec.format
            )
        message = _one_line(file.geterror())
        if pixels is None or message:  # libjpeg fills up what is missing, and only says so
            raise ImageError(f"{path}: rows {begin} to {end - 1} cannot be read: {message}")
        return pixels.reshape(-1, spec.width, channels)[skip : skip + end - begin]

    return rows


# --- out ---


def to_buffer(part: Part) -> oiio.ImageBuf:
    """The part as an ImageBuf."""
    buffer = oiio.ImageBuf(part.spec)
    for begin, end in part.bands():
        top = part.spec.y
        roi = oiio.ROI(part.spec.x, part.spec.x + part.spec.width, top + begin, top + end, 0, 1, 0, part.spec.nchannels)
        buffer.set_pixels(roi, np.ascontiguousarray(part.rows(begin, end)))
    return buffer


def write(image: Image, path: str | os.PathLike, pixel_type: oiio.TypeDesc | None = None) -> None:
    """Write to a temporary file beside `path` and rename it: a run that fails leaves what was there.

    Parameters
    ----------
    image : Image
        Its first part goes in `pixel_type` or its own type, as far as the file format has it; the others must be held
        exactly as they are.
    path : path
    pixel_type : oiio.TypeDesc, optional
        An error where the format cannot hold it.

    Raises
    ------
    ImageError
        The format is unknown or cannot hold a part, or the disk says no.
    """
    path = Path(path)
    if path.exists() and not path.is_file():
        raise ImageError(f"{path}: not a regular file")  # renaming over a device would replace it
    with temporary_beside(path) as temporary:
        out = oiio.ImageOutput.create(str(temporary))
        if out is None:
            oiio.geterror()  # it names the temporary file
            raise ImageError(f"{path}: no format writes '{path.suffix}'")
        if len(image.parts) > 1 and not out.supports("multiimage"):
            names = ", ".join(p.name for p in image.parts)
            raise ImageError(f"{path}: {out.format_name()} holds one image, here are {names}; use EXR or TIFF")
        shared = image.first.spec.getattribute("PixelAspectRatio")
        specs = [
            _output_spec(part, pixel_type if i == 0 else None, len(image.parts) > 1)
            for i, part in enumerate(image.parts)
        ]
        for spec in specs[1:]:
            if shared is not None:
                spec.attribute("PixelAspectRatio", shared)
        wanted = [pixel_type, *(part.spec.format for part in image.parts[1:])]
        try:
            for i, part in enumerate(image.parts):
                _open_part(out, temporary, specs, i, path)
                held = out.spec().format
                _write_rows(out, part, path)  # even in vain: libpng talks on stderr about files left without rows
                if wanted[i] is not None and held != wanted[i]:
                    raise ImageError(f"{path}: {out.format_name()} cannot hold part '{part.name}' as {wanted[i]}")
        finally:
            closed = out.close()
        if not closed:
            raise ImageError(f"{path}: {_one_line(out.geterror())}")
        if not temporary.exists():
            raise ImageError(f"{path}: {out.format_name()} writes no file")
        _check_arrived(temporary, image, path)


def _output_spec(part: Part, pixel_type: oiio.TypeDesc | None, named: bool) -> oiio.ImageSpec:
    spec = oiio.ImageSpec(part.spec)
    spec.tile_width = spec.tile_height = spec.tile_depth = 0
    if pixel_type is not None:
        spec.set_format(pixel_type)
    if named:
        spec.attribute("oiio:subimagename", part.name)
    return spec


def _open_part(out: oiio.ImageOutput, temporary: Path, specs: list[oiio.ImageSpec], i: int, path: Path) -> None:
    if i > 0:
        opened = out.open(str(temporary), specs[i], "AppendSubimage")
    elif len(specs) > 1 and out.format_name() == "openexr":  # multi-part EXR wants all specs up front
        opened = out.open(str(temporary), tuple(specs))
    else:
        opened = out.open(str(temporary), specs[0])
    if not opened:
        raise ImageError(f"{path}: cannot be written: {_one_line(out.geterror())}")


def _write_rows(out: oiio.ImageOutput, part: Part, path: Path) -> None:
    top = part.spec.y
    for begin, end in part.bands():
        if not out.write_scanlines(top + begin, top + end, 0, np.ascontiguousarray(part.rows(begin, end))):
            raise ImageError(f"{path}: writing failed at row {begin}: {_one_line(out.geterror())}")


def _check_arrived(temporary: Path, image: Image, path: Path) -> None:
    """Refuse a file that did not reach the disk whole: several of OpenImageIO's writers do not notice a full one."""
    disk = os.statvfs(temporary) if hasattr(os, "statvfs") else None
    try:
        if disk is not None and disk.f_bfree == 0:
            raise ImageError("no space left")
        for written, part in zip(read(temporary).parts, image.parts, strict=True):
            written.rows(part.spec.height - 1, part.spec.height)
    except (ImageError, ValueError) as error:
        raise ImageError(f"{path}: the file could not be written whole: is the disk full?") from error


def _one_line(text: str) -> str:
    return " ".join(text.split())


# --- pixels ---


def without_nonfinite(image: Image, mode: str) -> Image:
    """NaN and Inf repaired as oiiotool's --fixnan does.

    Parameters
    ----------
    image : Image
    mode : str
        'black', or 'box3': the mean of the finite neighbours.

    Raises
    ------
    ImageError
        Another mode.
    """
    modes = {"black": oiio.NONFINITE_BLACK, "box3": oiio.NONFINITE_BOX3}
    if mode not in modes:
        raise ImageError(f"no mode '{mode}'; allowed is {', '.join(modes)}")

    def fixed(part: Part) -> Part:
        buffer = to_buffer(part)
        if not oiio.ImageBufAlgo.fixNonFinite(buffer, buffer, modes[mode]):
            raise ImageError(f"{image.source}: {_one_line(buffer.geterror())}")
        return dataclasses.replace(from_buffer(buffer).first, name=part.name)

    return Image((fixed(image.first), *image.parts[1:]), image.source)


def tagged(image: Image, name: str, value: str) -> Image:
    """The image with an attribute of its first part set."""
    spec = oiio.ImageSpec(image.first.spec)
    spec.attribute(name, value)
    return Image((dataclasses.replace(image.first, spec=spec), *image.parts[1:]), image.source)


def resized(pixels: np.ndarray, width: int, height: int) -> np.ndarray:
    """(h, w, c) float32 -> (height, width, c) float32 through a triangle filter as wide as the reduction asks for."""
    if pixels.shape[:2] == (height, width):
        return pixels
    buffer = oiio.ImageBuf(oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], oiio.FLOAT))
    buffer.set_pixels(buffer.roi, np.ascontiguousarray(pixels, np.float32))
    roi = oiio.ROI(0, width, 0, height, 0, 1, 0, pixels.shape[2])
    small = oiio.ImageBufAlgo.resize(buffer, "triangle", roi=roi)
    return small.get_pixels(oiio.FLOAT, small.roi)
