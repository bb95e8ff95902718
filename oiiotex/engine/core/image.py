# SPDX-License-Identifier: Apache-2.0
"""Lazy images that ops exchange: parts with a spec that can produce any window of their pixels.

A part hides the source of its pixels (a file, a buffer, an op not yet computed). It provides them as ImageBufs, for
OpenImageIO's algorithms and Python callers, or as numpy arrays, for our filters.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

from ..deferred import np, oiio
from ..errors import ImageError, one_line
from .attributes import ATLAS, EDGES, tag_colors
from .window import Window

IDS = ("uint", "int")  # pixel types of ids
_STALE = ("oiio:SHA-1", "oiio:ConstantColor", "oiio:AverageColor", "textureformat", "wrapmodes", ATLAS, EDGES)
_NUMPY = {
    "uint8": "uint8", "int8": "int8", "uint16": "uint16", "int16": "int16", "uint": "uint32", "int": "int32",
    "half": "float16", "float": "float32", "double": "float64",
}  # fmt: skip

Pixels: TypeAlias = "np.ndarray | oiio.ImageBuf"


class ArrayFetch:
    """A `fetch` that returns arrays, which do not depend on metadata: a part keeps it if only those change."""


@dataclass(frozen=True)
class Part:
    """One image of a file (a subimage).

    Attributes
    ----------
    name : str
    spec : oiio.ImageSpec
        Data and display window, channels, pixel type, metadata. Never changed in place.
    fetch : callable
        Window inside the data window -> its pixels: (height, width, channels) of the spec's pixel type, or an
        ImageBuf with that data window (always for a deep part).
    stored : oiio.TypeDesc or None
        The default pixel type for writing; None (computed by the host): that of the first file of the run.
    typed : bool
        Whether results of the host's ops keep `stored`: Lab, masks and measures, which other types would clip.
    native : bool
        Whether ops of the host use the part's own pixel type instead of float.
    ready : bool
        Whether random access to pixels is cheap.
    exact : bool
        Whether a file must store the values exactly: labels, source coordinates.
    copied : bool
        Whether the host computed it from unchanged pixels, in their own type: further ops of the host use float.
    levels : tuple of Part
        Its MIP levels, if the file is MIP-mapped.
    thumbnail : callable or None
        Returns the thumbnail of its file or of --thumbnail-set; None: it has none.
    depth : int
        Number of nested ops that compute a pixel.
    title : str
        The name that oiiotool gives to a computed image.
    """

    name: str
    spec: oiio.ImageSpec
    fetch: Callable[[Window], Pixels]
    stored: oiio.TypeDesc | None = None
    native: bool = False
    ready: bool = False
    exact: bool = False
    typed: bool = False
    copied: bool = False
    levels: tuple[Part, ...] = ()
    thumbnail: Callable[[], oiio.ImageBuf] | None = None
    depth: int = 0
    title: str = ""

    @property
    def window(self) -> Window:
        """The data window."""
        return Window.data(self.spec)

    @property
    def pixel_bytes(self) -> int:
        """Bytes of a pixel as returned by `read`."""
        return self.spec.nchannels * np.dtype(dtype_of(self.spec)).itemsize

    def read(self, window: Window) -> np.ndarray:
        """The pixels of a window, (height, width, channels), of the spec's type; do not modify them."""
        if self.spec.deep:
            raise ImageError(f"part '{self.name}' is deep: expected a flat image; flatten it first")
        pixels, roi = self.fetch(window), window.roi(self.spec.nchannels)
        return pixels_of(pixels, self.spec.format, roi) if isinstance(pixels, oiio.ImageBuf) else pixels

    def buffer(self, window: Window) -> oiio.ImageBuf:
        """An ImageBuf with that data window, for ops of the host; do not modify it."""
        pixels = self.fetch(window)
        if isinstance(pixels, oiio.ImageBuf) and (self.spec.deep or pixels.spec().format == self.working_type):
            return pixels
        spec = window.apply_to(self.spec)
        spec.set_format(self.working_type)
        buffer = oiio.ImageBuf(spec, False)
        if isinstance(pixels, oiio.ImageBuf):
            pixels = pixels_of(pixels, self.working_type, window.roi(self.spec.nchannels))
        buffer.set_pixels(buffer.roi, np.ascontiguousarray(pixels))
        return buffer

    def pixels(self) -> np.ndarray:
        """The whole data window, (height, width, channels)."""
        return self.read(self.window)

    @property
    def working_type(self) -> oiio.TypeDesc:
        """The pixel type for ops of the host."""
        if (self.stored is not None or self.copied) and not self.native:
            return oiio.TypeDesc(oiio.FLOAT)
        return self.spec.format

    def respecced(self, change: Callable[[oiio.ImageSpec], object]) -> Part:
        """The same pixels with a changed copy of the spec, whose data window may have moved.

        MIP levels get the same change; they are removed if a window changes.
        """
        spec = oiio.ImageSpec(self.spec)
        change(spec)
        x, y = spec.x - self.spec.x, spec.y - self.spec.y
        same = Window.data(spec) == self.window and Window.display(spec) == Window.display(self.spec)
        levels = tuple(level.respecced(change) for level in self.levels) if same else ()

        def moved(window: Window) -> Pixels:
            there = window.shifted(-x, -y)
            if not spec.deep:
                return self.read(there)
            buffer = self.buffer(there).copy()
            change(buffer.specmod())
            return buffer

        kept = isinstance(self.fetch, ArrayFetch) and same and spec.format == self.spec.format
        return dataclasses.replace(self, spec=spec, fetch=self.fetch if kept else moved, levels=levels)


@dataclass(frozen=True)
class Image:
    """One or more parts, of which the first is the main image."""

    parts: tuple[Part, ...]
    source: str = "image"  # a name for messages

    @property
    def first(self) -> Part:
        """The main image."""
        return self.parts[0]

    @property
    def title(self) -> str:
        """Its name in comparisons and expressions."""
        return self.first.title or self.source

    def part(self, name: str) -> Part | None:
        """The part of that name, or None."""
        return next((p for p in self.parts if p.name == name), None)


@dataclass(frozen=True)
class Channels:
    """Which channels are color (R, G, B, or one gray) and which is alpha."""

    color: tuple[int, ...]
    alpha: int | None

    @property
    def first(self) -> int:
        """The channel of a mask or of ids: the first color, or the alpha of an image without color."""
        return (*self.color, 0)[0]


def channels_of(spec: oiio.ImageSpec) -> Channels:
    """Color is R, G, B or Y by name, otherwise the first up to three channels other than alpha.

    Alpha has no layer, or the color's. OpenImageIO also takes that of another one, as the coverage of a Cryptomatte.
    """
    names = [n.upper() for n in spec.channelnames]
    alpha = names.index("A") if "A" in names else spec.alpha_channel if spec.alpha_channel >= 0 else None
    layers = [name.rpartition(".")[0] for name in names]
    color = next((n for n, name in enumerate(names) if name in ("R", "Y")), int(alpha == 0 and len(names) > 1))
    if alpha is not None and layers[alpha] not in ("", layers[color]):
        alpha = None
    if all(c in names for c in "RGB"):
        return Channels(tuple(names.index(c) for c in "RGB"), alpha)
    if "Y" in names and not {"X", "R", "G", "B"} & set(names):
        return Channels((names.index("Y"),), alpha)
    others = [i for i in range(spec.nchannels) if i != alpha]
    return Channels(tuple(others[:3]), alpha)


def dtype_of(spec: oiio.ImageSpec) -> type[np.generic]:
    """The numpy type of a spec's pixels."""
    dtype = _NUMPY.get(str(oiio.TypeDesc(oiio.BASETYPE(spec.format.basetype))))
    if dtype is None:
        raise ImageError(f"pixels of type {spec.format} are not supported")
    return np.dtype(dtype).type


def type_named(name: str) -> oiio.TypeDesc:
    """The pixel type of a `-d` name such as 'half' or 'uint16'.

    Raises
    ------
    ImageError
        The type is unknown. OpenImageIO would silently use another one.
    """
    name = {"uint32": "uint", "int32": "int", "sint8": "int8", "sint16": "int16", "sint32": "int"}.get(name, name)
    if name not in _NUMPY:
        raise ImageError(f"unknown pixel type '{name}': expected one of {', '.join(_NUMPY)}")
    return oiio.TypeDesc(name)


def from_pixels(name: str, pixels: np.ndarray, spec: oiio.ImageSpec, stored: oiio.TypeDesc | None = None) -> Part:
    """A part from an array in memory, (height, width, channels), with the data window and type of `spec`.

    The array must not be changed afterwards.
    """
    whole = Window.data(spec)
    return Part(name, spec, lambda window: pixels[window.inside(whole)], stored, ready=True)


def pixels_of(buffer: oiio.ImageBuf, kind: oiio.TypeDesc | oiio.BASETYPE, roi: oiio.ROI | None = None) -> np.ndarray:
    """The pixels of a buffer, or of a region, (height, width, channels); raises ImageError if unreadable."""
    roi = roi or buffer.roi
    pixels = buffer.get_pixels(kind, roi)
    if pixels is None:
        raise ImageError(f"{buffer.name or 'ImageBuf'}: {one_line(buffer.geterror()) or 'cannot be read'}")
    return pixels.reshape(roi.height, roi.width, roi.nchannels)


def unrounded(pixels: np.ndarray) -> np.ndarray:
    """Ids as OpenImageIO's floats, a fraction of the largest integer; pixels of other types as they are.

    Raises
    ------
    ImageError
        An id would be rounded, and name another object.
    """
    if pixels.dtype.kind not in "iu" or pixels.dtype.itemsize < 4:
        return pixels
    rounded = pixels.astype(np.float32)
    if not np.array_equal(rounded.astype(np.float64), pixels):
        raise ImageError("integers above 2^24 cannot be stored exactly with channels of another type")
    return rounded * np.float32(2.0 ** (-31 if pixels.dtype.kind == "i" else -32))


def in_memory(name: str, buffer: oiio.ImageBuf) -> Part:
    """A part from an ImageBuf in memory, which must not be changed afterwards."""
    spec = oiio.ImageSpec(buffer.spec())
    whole = Window.data(spec)

    def fetch(window: Window) -> Pixels:
        if window == whole:
            return buffer
        roi = window.roi(spec.nchannels)
        return oiio.ImageBufAlgo.crop(buffer, roi=roi) if spec.deep else pixels_of(buffer, spec.format, roi)

    return Part(name, spec, fetch, ready=True)


def cropped(part: Part, window: Window) -> Part:
    """The part with another data window, black outside its own."""
    if window == part.window:
        return part
    dtype, channels = dtype_of(part.spec), part.spec.nchannels

    def fetch(wanted: Window) -> np.ndarray:
        shared = wanted & part.window
        if shared == wanted:
            return part.read(wanted)
        out = np.zeros((wanted.height, wanted.width, channels), dtype)
        if not shared.empty:
            out[shared.inside(wanted)] = part.read(shared)
        return out

    spec = window.apply_to(derived_spec(part.spec))
    return dataclasses.replace(part, spec=spec, fetch=fetch, levels=(), thumbnail=None)


def copied(spec: oiio.ImageSpec, fetch: Callable[[Window], Pixels], *parts: Part) -> Part:
    """A part computed by the host from unchanged pixels of others, which have the type of `spec`.

    Integers of 32 bits, which are ids, keep their type in files.
    """
    first = parts[0]
    alike = all(part.stored == first.stored for part in parts)
    kept = first.stored if alike and (first.exact or str(first.stored) in IDS) else None
    as_float = any(part.working_type != spec.format for part in parts)
    return Part(first.name, spec, fetch, kept, first.native, exact=first.exact, copied=as_float)


def derived_spec(spec: oiio.ImageSpec, width: int | None = None, height: int | None = None) -> oiio.ImageSpec:
    """A copy of `spec` for changed pixels, without stale hashes; a new size sets the windows to the origin."""
    new = oiio.ImageSpec(spec)
    new.tile_width = new.tile_height = new.tile_depth = 0
    for name in _STALE:
        new.erase_attribute(name)
    if width is not None and height is not None:
        new.x = new.y = new.full_x = new.full_y = 0
        new.width = new.full_width = width
        new.height = new.full_height = height
    return new


def spec_beside(spec: oiio.ImageSpec, channels: tuple[str, ...]) -> oiio.ImageSpec:
    """A float spec with only the windows of another one, as parts of a file share their display window."""
    new = oiio.ImageSpec(spec.width, spec.height, len(channels), oiio.FLOAT)
    new.x, new.y, new.full_x, new.full_y = spec.x, spec.y, spec.full_x, spec.full_y
    new.full_width, new.full_height = spec.full_width, spec.full_height
    new.channelnames = channels
    return new


def measure_spec(spec: oiio.ImageSpec, channels: tuple[str, ...] = ("Y",)) -> oiio.ImageSpec:
    """A float spec for measures of an image: its windows and metadata, with other channels."""
    new = derived_spec(spec)
    new.set_format(oiio.TypeDesc(oiio.FLOAT))
    new.channelformats = ()
    new.nchannels, new.channelnames, new.alpha_channel, new.z_channel = len(channels), channels, -1, -1
    return new


# --- conversion for the Python API ---


def from_array(pixels: np.ndarray) -> Image:
    """An image from an array, (height, width) or (height, width, channels), top row first.

    One channel is gray, three are R, G, B, and four have alpha (premultiplied). Booleans become 0 and 1; 64-bit
    integers, such as labels, become 32-bit ids.

    Raises
    ------
    ImageError
        The shape or the type is not supported, or there are no pixels.
    """
    pixels = pixels[..., None] if pixels.ndim == 2 else pixels
    if pixels.ndim != 3 or not pixels.size:
        expected = "at least one pixel" if pixels.ndim == 3 else "(height, width) or (height, width, channels)"
        raise ImageError(f"array: shape {pixels.shape}: expected {expected}")
    if pixels.dtype.kind == "b":
        pixels = pixels.astype(np.float32)
    if pixels.dtype.kind in "iu" and pixels.dtype.itemsize == 8:
        if pixels.min() < 0 or pixels.max() >= 1 << 32:
            raise ImageError(f"array: 64-bit values from {pixels.min()} to {pixels.max()}: expected 32-bit ids")
        pixels = pixels.astype(np.uint32)
    kinds = {np.dtype(dtype): name for name, dtype in _NUMPY.items()}
    native = pixels.dtype.newbyteorder("=")
    if native not in kinds:
        raise ImageError(f"array: pixels of type {pixels.dtype} are not supported")
    pixels = np.ascontiguousarray(pixels, native)
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], kinds[native])
    return Image((from_pixels("part0", pixels, spec, spec.format),), "array")


def from_buffer(buffer: oiio.ImageBuf) -> Image:
    """An image from a snapshot of an ImageBuf.

    Raises
    ------
    ImageError
        It is empty, or its kind is not supported (deep, volume).
    """
    if not isinstance(buffer, oiio.ImageBuf):
        raise ImageError(f"expected an OpenImageIO.ImageBuf, not {type(buffer).__name__}")
    if buffer.has_error or not buffer.initialized:
        raise ImageError(f"{buffer.name or 'ImageBuf'}: {one_line(buffer.geterror()) or 'contains no image'}")
    spec = oiio.ImageSpec(buffer.spec())
    if spec.deep or spec.depth > 1:
        raise ImageError(f"{buffer.name or 'ImageBuf'}: deep and volume images are not supported")
    pixels = pixels_of(buffer, spec.format)
    if buffer.has_error:  # its file is damaged; unreadable pixels are black
        raise ImageError(f"{buffer.name or 'ImageBuf'}: {one_line(buffer.geterror())}")
    name = spec.get_string_attribute("oiio:subimagename") or "part0"
    return Image((from_pixels(name, pixels, spec, spec.format),), buffer.name or "ImageBuf")


def to_buffer(part: Part, kind: type[oiio.ImageBuf] | None = None) -> oiio.ImageBuf:
    """A new ImageBuf of the part, or of a subclass, in its own pixel type, which the caller may change."""
    buffer = (kind or oiio.ImageBuf)(part.spec)
    rows = max(1, (8 << 20) // max(1, part.spec.width * part.pixel_bytes))
    for window in part.window.cells(part.spec.width, rows):
        buffer.set_pixels(window.roi(part.spec.nchannels), np.ascontiguousarray(part.read(window)))
    return buffer


def tagged(image: Image, space: str) -> Image:
    """The image with its first part tagged with a color space."""
    first = image.first.respecced(lambda spec: tag_colors(spec, space))
    return Image((first, *image.parts[1:]), image.source)
