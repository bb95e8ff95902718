# SPDX-License-Identifier: Apache-2.0
"""How images leave: streamed into a temporary file beside the name, which is looked at and renamed."""

from __future__ import annotations

import contextlib
import dataclasses
import logging
import os
import re
import shutil
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio

from .errors import ImageError
from .files import checked_name, keep_readable, read, said
from .images import Image, Part, cropped
from .temporary import temporary_beside
from .tiles import BAND_BYTES, rows_for, stream
from .windows import Window

log = logging.getLogger("oiiotex")

_IDS = (oiio.TypeDesc(oiio.UINT32), oiio.TypeDesc(oiio.INT32))
_BLOCK_ROWS = 64  # bands are multiples of it: no format compresses more rows of scanlines together, but DWAB with 256


@dataclass(frozen=True, kw_only=True)
class Format:
    """How to write.

    Attributes
    ----------
    pixel_type : oiio.TypeDesc or None
        Asked for by the user; an error where the format cannot hold it.
    computed_type : oiio.TypeDesc or None
        Of parts that ops of the host have computed, as far as the format has it; None: as they are.
    computed_channels : dict of str to oiio.TypeDesc
        Of single channels of computed parts, by name.
    computed_tile : (int, int) or None
        Width and height of tiles of computed parts; None: scanlines.
    bits : int
        Significant bits, where they are fewer than the type has; 0: as in the source.
    channel_types : dict of str to oiio.TypeDesc
        Of single channels by name, or by 'part.name'.
    tile : (int, int) or None
        Width and height of tiles; None: as in a file that is only copied, else scanlines.
    scanline : bool
        Never tiles.
    attributes : dict
        Set on all parts: compression, Software and so on. None erases one.
    autocrop : bool
        Formats without a display window get exactly its pixels.
    format_name : str
        Which format to write; by the file's extension when left out.
    """

    pixel_type: oiio.TypeDesc | None = None
    computed_type: oiio.TypeDesc | None = None
    computed_channels: dict[str, oiio.TypeDesc] = field(default_factory=dict)
    computed_tile: tuple[int, int] | None = None
    bits: int = 0
    channel_types: dict[str, oiio.TypeDesc] = field(default_factory=dict)
    tile: tuple[int, int] | None = None
    scanline: bool = False
    attributes: dict[str, Any] = field(default_factory=dict)
    autocrop: bool = True
    format_name: str = ""


def write(
    image: Image,
    path: str | os.PathLike,
    how: Format | oiio.TypeDesc | None = None,
    advance: Callable[[int, int], object] | None = None,
) -> None:
    """Write to a temporary file beside `path` and rename it: a run that fails leaves what was there.

    Parameters
    ----------
    image : Image
        All its parts are written; each in its own type, or as `how` says.
    path : path
    how : Format or oiio.TypeDesc, optional
        A type alone asks for it for the first part.
    advance : callable, optional
        Called with (rows done, rows in all).

    Raises
    ------
    ImageError
        The format is unknown or cannot hold a part, or the disk says no.
    """
    path = Path(checked_name(path))
    how = how if isinstance(how, Format) else Format(pixel_type=how)
    if os.path.exists(path) and not path.is_file():
        raise ImageError(f"{path}: not a regular file")  # renaming over a device would replace it
    with temporary_beside(path) as temporary:
        out = oiio.ImageOutput.create(how.format_name or str(temporary))
        if out is None:
            oiio.geterror()  # it names the temporary file
            raise ImageError(f"{path}: no format writes '{how.format_name or path.suffix}'")
        image = _fitted(image, out, path, how)
        specs = _specs(image, out, how)
        _require_types(out, temporary, path, image, specs, how)
        with _way_to(temporary, path, out) as way:
            try:
                _write_parts(out, way, path, image, specs, advance)
            finally:
                closed = out.close()
            if not closed:
                raise ImageError(f"{path}: {_said(out, way, path)}")
        format_name = out.format_name()
        del out  # a MIP-mapped EXR is finished only now
        if not temporary.exists():
            raise ImageError(f"{path}: {format_name} writes no file")
        _check_arrived(temporary, path)
        keep_readable(path)


@contextlib.contextmanager
def _way_to(temporary: Path, path: Path, out: oiio.ImageOutput) -> Iterator[Path]:
    """Where OpenImageIO writes: for JPEG a pipe to the file, because libjpeg ends the process where a disk is full."""
    if out.format_name() != "jpeg" or not os.path.isdir("/dev/fd"):
        yield temporary
        return
    source, sink = os.pipe()
    with ThreadPoolExecutor(1, "oiiotex-write") as worker:
        copied = worker.submit(_copy, source, temporary)
        try:
            yield Path(f"/dev/fd/{sink}")
        finally:
            os.close(sink)
    if isinstance(error := copied.exception(), OSError):
        raise ImageError(f"{path}: cannot be written: {error.strerror}") from error


def _copy(source: int, temporary: Path) -> None:
    with os.fdopen(source, "rb", buffering=0) as pipe:
        try:
            with open(temporary, "wb") as file:
                shutil.copyfileobj(pipe, file)
        finally:
            while pipe.read(1 << 20):  # whoever writes must not wait for ever
                pass


def _said(out: oiio.ImageOutput, temporary: Path, path: Path) -> str:
    """The format's error, of the name that the user knows."""
    return said(out.geterror).replace(str(temporary), str(path))


# --- what the format cannot hold ---


def _fitted(image: Image, out: oiio.ImageOutput, path: Path, how: Format) -> Image:
    """The image as far as the format has channels, windows and origins for it, as oiiotool fits it."""
    if len(image.parts) > 1 and not out.supports("multiimage"):
        names = ", ".join(p.name for p in image.parts)
        raise ImageError(f"{path}: {out.format_name()} holds one image, here are {names}; use EXR or TIFF")
    parts = [_with_fitting_channels(part, out, path) for part in image.parts]
    if how.autocrop and not out.supports("displaywindow"):
        parts = [_in_window(part, Window.display(part.spec)) for part in parts]
    if how.autocrop and not out.supports("negativeorigin"):
        parts = [_without_negative_origin(part) for part in parts]
    if any(part.window.empty for part in parts):
        raise ImageError(f"{path}: there is no pixel to write")
    return Image(tuple(parts), image.source)


def _with_fitting_channels(part: Part, out: oiio.ImageOutput, path: Path) -> Part:
    count, fit = part.spec.nchannels, part.spec.nchannels
    alpha_fourth = count > 3 and (part.spec.alpha_channel == 3 or part.spec.channelnames[3].lower() in ("a", "alpha"))
    if count > 4 and not out.supports("nchannels"):
        fit = 4
    if count > 3 and not out.supports("alpha" if alpha_fourth else "nchannels"):
        fit = 3
    if fit == count:
        return part
    kept = part.spec.channelnames[:fit]
    log.warning("%s: %s cannot hold %d channels; only %s are written", path, out.format_name(), count, ", ".join(kept))

    def fewer(spec: oiio.ImageSpec) -> None:
        spec.nchannels = fit
        spec.channelnames = tuple(kept)
        spec.alpha_channel = 3 if alpha_fourth and fit == 4 else -1

    narrow = part.respecced(fewer)
    return dataclasses.replace(narrow, fetch=lambda window: part.read(window)[..., :fit], levels=())


def _in_window(part: Part, window: Window) -> Part:
    """Cropped, but in tiles as it was."""
    fitted = cropped(part, window)
    spec = fitted.spec
    spec.tile_width, spec.tile_height, spec.tile_depth = _tile_of(part.spec)
    return fitted


def _tile_of(spec: oiio.ImageSpec) -> tuple[int, int, int]:
    return spec.tile_width, spec.tile_height, spec.tile_depth


def _without_negative_origin(part: Part) -> Part:
    window = part.window
    if window.left >= 0 and window.top >= 0:
        return part
    left, top = max(0, window.left), max(0, window.top)
    return _in_window(part, Window(left, top, max(left + 1, window.right), max(top + 1, window.bottom)))


# --- specs ---


def _specs(image: Image, out: oiio.ImageOutput, how: Format) -> list[list[oiio.ImageSpec]]:
    """For each part the specs of its levels, as they are to be opened."""
    tiled = out.supports("tiles") and not how.scanline
    several = len(image.parts) > 1
    shared = image.first.spec.getattribute("PixelAspectRatio")  # EXR wants one for all parts
    found = []
    for n, part in enumerate(image.parts):
        levels = []
        for level in (part, *_levels(part, out, how, several)):
            spec = oiio.ImageSpec(level.spec)
            _set_types(spec, part, how)
            _set_tiles(spec, part, how, out, tiled)
            if several and not re.fullmatch(r"part\d+", part.name):  # OpenImageIO numbers the nameless
                spec.attribute("oiio:subimagename", part.name)
            if several and n > 0 and shared is not None:
                spec.attribute("PixelAspectRatio", shared)
            if not spec.tile_width or not part.levels:
                spec.erase_attribute("textureformat")
            for name, value in how.attributes.items():
                if value is None:
                    spec.erase_attribute(name)
                else:
                    spec.attribute(name, value)
            levels.append(spec)
        found.append(levels)
    return found


def _levels(part: Part, out: oiio.ImageOutput, how: Format, several: bool) -> tuple[Part, ...]:
    """The smaller versions that are written: TIFF has them as further images, which must be tiled to be known."""
    if several or how.scanline:
        return ()
    if out.supports("mipmap"):
        return part.levels
    return part.levels if part.spec.tile_width and out.format_name() == "tiff" else ()


def _kept(part: Part) -> bool:
    """Whether a file must hold the part's own type: rounded ids would be other ids."""
    return part.exact or part.stored in _IDS


def _wanted(part: Part, how: Format) -> oiio.TypeDesc | None:
    """The type that a file must have for the part, or be refused: what the user asks for, or what may not change."""
    return part.stored if _kept(part) else how.pixel_type


def _set_types(spec: oiio.ImageSpec, part: Part, how: Format) -> None:
    by_channel = dict(how.channel_types)
    if how.pixel_type is not None and not _kept(part):
        spec.set_format(how.pixel_type)
    elif part.stored is not None:
        if part.stored != spec.format:
            spec.set_format(part.stored)
    else:
        spec.set_format(how.computed_type or spec.format)
        by_channel = {**how.computed_channels, **by_channel}
    types = [spec.channelformat(c) for c in range(spec.nchannels)]
    for c, name in enumerate(spec.channelnames):
        keys = (f"{part.name}.{name}", f"{part.name}.*", name)
        types[c] = next((by_channel[key] for key in keys if key in by_channel), types[c])
    if any(kind != types[0] for kind in types):
        spec.channelformats = tuple(types)
    else:
        spec.set_format(types[0])
    if how.bits:
        spec.attribute("oiio:BitsPerSample", how.bits)
    elif how.pixel_type is not None or part.stored is None:
        spec.erase_attribute("oiio:BitsPerSample")


def _set_tiles(spec: oiio.ImageSpec, part: Part, how: Format, out: oiio.ImageOutput, tiled: bool) -> None:
    tile = how.tile or (how.computed_tile if part.stored is None else None)
    if tiled and tile is not None:
        spec.tile_width, spec.tile_height, spec.tile_depth = *tile, 1
    elif not tiled or (out.format_name() == "tiff" and (spec.tile_width % 16 or spec.tile_height % 16)):
        spec.tile_width = spec.tile_height = spec.tile_depth = 0


# --- writing ---


def _write_parts(
    out: oiio.ImageOutput,
    temporary: Path,
    path: Path,
    image: Image,
    specs: list[list[oiio.ImageSpec]],
    advance: Callable[[int, int], object] | None,
) -> None:
    total = sum(spec.height for levels in specs for spec in levels)
    done = 0
    for n, (part, levels) in enumerate(zip(image.parts, specs, strict=True)):
        for m, spec in enumerate(levels):
            _open(out, temporary, path, [s[0] for s in specs], n, m, spec)
            opened = out.spec()  # some formats have only tiles, or begin at 0
            spec.tile_width, spec.tile_height, spec.tile_depth = _tile_of(opened)
            x, y = opened.x - spec.x, opened.y - spec.y
            for window, pixels in stream(part.levels[m - 1] if m else part, _bands(part, spec)):
                if not _put(out, spec, window.shifted(x, y), np.ascontiguousarray(pixels)):
                    row = window.top - spec.y
                    raise ImageError(f"{path}: writing failed at row {row}: {_said(out, temporary, path)}")
                done += window.height if window.right == spec.x + spec.width else 0
                if advance is not None:
                    advance(done, total)


def _open(
    out: oiio.ImageOutput,
    temporary: Path,
    path: Path,
    firsts: list[oiio.ImageSpec],
    part: int,
    level: int,
    spec: oiio.ImageSpec,
) -> None:
    if level > 0:
        opened = out.open(str(temporary), spec, "AppendMIPLevel" if out.supports("mipmap") else "AppendSubimage")
    elif part > 0:
        opened = out.open(str(temporary), spec, "AppendSubimage")
    elif len(firsts) > 1 and out.format_name() == "openexr":  # multi-part EXR wants all specs up front
        opened = out.open(str(temporary), tuple(firsts))
    else:
        opened = out.open(str(temporary), spec)
    if not opened:
        raise ImageError(f"{path}: cannot be written: {_said(out, temporary, path)}")


def _bands(part: Part, spec: oiio.ImageSpec) -> Iterator[Window]:
    """Full rows where they fit, else runs of tiles: always in the order of the file."""
    whole = Window.data(spec)
    multiple = spec.tile_height or _BLOCK_ROWS
    rows = rows_for(part, BAND_BYTES, multiple)
    width = whole.width
    if spec.tile_width and rows == multiple:
        tile = multiple * spec.tile_width * max(part.pixel_bytes, 4 * spec.nchannels)
        width = max(1, 4 * BAND_BYTES // tile) * spec.tile_width
    elif rows == multiple:
        rows = min(multiple, rows_for(part, 4 * BAND_BYTES))
    return whole.cells(min(width, whole.width), rows)


def _put(out: oiio.ImageOutput, spec: oiio.ImageSpec, window: Window, pixels: np.ndarray) -> bool:
    if spec.tile_width:
        return out.write_tiles(window.left, window.right, window.top, window.bottom, 0, 1, pixels)
    return out.write_scanlines(window.top, window.bottom, 0, pixels)


def _require_types(
    out: oiio.ImageOutput, temporary: Path, path: Path, image: Image, specs: list[list[oiio.ImageSpec]], how: Format
) -> None:
    """Refuse a type that the format would silently exchange, before the work begins: asked of one-pixel images."""
    for part, levels in zip(image.parts, specs, strict=True):
        wanted = _wanted(part, how)
        if out.format_name() == "tiff" and levels[0].format == oiio.DOUBLE:
            raise ImageError(f"{path}: TIFF files of doubles are not supported")  # see files.read
        if wanted is None:
            continue
        trial = oiio.ImageOutput.create(how.format_name or str(temporary))
        place = os.devnull if out.format_name() == "jpeg" else str(temporary)  # see _way_to
        spec = Window(0, 0, 1, 1).apply_to(levels[0])
        spec.full_x, spec.full_y, spec.full_width, spec.full_height = 0, 0, 1, 1
        if not trial.open(place, spec):
            raise ImageError(f"{path}: cannot be written: {_said(trial, temporary, path)}")
        held = trial.spec().format
        trial.write_image(np.zeros((1, 1, spec.nchannels), np.float32))
        trial.close()
        if held != wanted and not levels[0].channelformats:
            raise ImageError(f"{path}: {trial.format_name()} cannot hold part '{part.name}' as {wanted}")


def _check_arrived(temporary: Path, path: Path) -> None:
    """Refuse a file that did not reach the disk whole: several of OpenImageIO's writers do not notice a full one."""
    disk = os.statvfs(temporary) if hasattr(os, "statvfs") else None
    try:
        if disk is not None and disk.f_bfree == 0:
            raise ImageError("no space left")
        for held in read(temporary).parts:
            last = held.window.bottom - 1
            held.read(Window(held.window.left, last, held.window.right, last + 1))
    except (ImageError, ValueError) as error:
        raise ImageError(f"{path}: the file could not be written whole: is the disk full?") from error
