# SPDX-License-Identifier: Apache-2.0
"""How images leave: streamed into a temporary file beside the name, which is looked at and renamed."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from .errors import ImageError
from .files import checked_name, keep_readable, read, said
from .formats import Format, fitted, specs_of, tile_of, wanted_type
from .images import Image, Part
from .temporary import temporary_beside
from .tiles import BAND_BYTES, rows_for, stream
from .windows import Window

_BLOCK_ROWS = 64  # bands are multiples of it: no format compresses more rows of scanlines together, but DWAB with 256
_NOT_WHOLE = "the file could not be written whole: is the disk full?"
_COPY = "cat && exit; code=$?; cat >/dev/null; exit $code"  # whoever writes must not wait for ever


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
    with temporary_beside(path) as temporary:
        out = oiio.ImageOutput.create(how.format_name or str(temporary))
        if out is None:
            oiio.geterror()  # it names the temporary file
            raise ImageError(f"{path}: no format writes '{how.format_name or path.suffix}'")
        image = fitted(image, out, path, how)
        specs = specs_of(image, out, how)
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
    shell = shutil.which("sh") if out.format_name() == "jpeg" and os.path.isdir("/dev/fd") else None
    if shell is None:
        yield temporary
        return
    source, sink = os.pipe()
    with open(temporary, "wb") as file:  # no thread could copy: OpenImageIO holds the GIL while it closes
        copier = subprocess.Popen(
            [shell, "-c", _COPY], stdin=source, stdout=file, stderr=subprocess.DEVNULL, start_new_session=True
        )
    os.close(source)
    try:
        yield Path(f"/dev/fd/{sink}")
    finally:
        os.close(sink)
        code = copier.wait()
    if code:
        raise ImageError(f"{path}: {_NOT_WHOLE}")


def _said(out: oiio.ImageOutput, temporary: Path, path: Path) -> str:
    """The format's error, of the name that the user knows."""
    return said(out.geterror).replace(str(temporary), str(path))


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
            spec.tile_width, spec.tile_height, spec.tile_depth = tile_of(opened)
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
        wanted = wanted_type(part, how)
        if part is image.first and how.pixel_type not in (None, wanted):
            change = f"as {how.pixel_type}, part '{part.name}' of {wanted} would lose its values"
            raise ImageError(f"{path}: {change}")
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
        raise ImageError(f"{path}: {_NOT_WHOLE}") from error
