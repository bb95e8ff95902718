# SPDX-License-Identifier: Apache-2.0
"""Writing of image files: streamed into a temporary file next to the target, which is checked and renamed."""

from __future__ import annotations

import contextlib
import errno
import logging
import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

from ..core.demand import BAND_BYTES, rows_for, stream
from ..core.image import Image, Part, dtype_of
from ..core.window import Window
from ..deferred import np, oiio
from ..errors import ImageError, either, present, reason_of
from ..machine import program, start
from .atomic import held_beside, release, require_room, temporary_beside
from .copies import SUFFIX, format_of, packed
from .cryptomatte import matte_channels
from .description import warn_of_loss
from .formats import Format, fitted, keeps_type, specs_of, tile_of, wanted_type
from .reading import FilePixels, checked_name, error_text, keep_readable, read

log = logging.getLogger("oiiotex")

_BLOCK_ROWS = 64  # bands are multiples of it: no format compresses more scanlines together, except DWAB with 256
_PIPED = ("jpeg", "webp")  # on a full disk libjpeg ends the process, and libwebp's writer never returns
_AT_CLOSE = ("gif", "jpegxl", "webp")  # encoded as a whole on close
_AT_ONCE = ("openexr", "dpx")  # several parts require all specs up front
_MOST_HALF = 65504.0
_NOT_WHOLE = "the file is incomplete: is the disk full?"
_COPY = "cat && exit; code=$?; cat >/dev/null; exit $code"  # the writer must not wait forever


def write(
    image: Image,
    path: str | os.PathLike[str],
    how: Format | oiio.TypeDesc | None = None,
    advance: Callable[[int, int], object] | None = None,
) -> None:
    """Write to a temporary file next to `path` and rename it: a run that fails keeps the old file.

    Parameters
    ----------
    image : Image
        All its parts are written, each in its own type or by `how`.
    path : path
    how : Format or oiio.TypeDesc, optional
        A type alone is the pixel type.
    advance : callable, optional
        Called with (rows done, total rows).

    Raises
    ------
    ImageError
        The format is unknown or cannot hold a part, or writing fails.
    """
    path = Path(checked_name(path))
    with temporary_beside(path) as temporary:
        out, image, specs = _prepared(image, temporary, path, how)
        with _way_to(temporary, path, out) as way:
            if out.format_name() in _AT_CLOSE and len(image.parts) == 1:
                _write_whole(out.format_name(), way, path, image.first, specs[0][0], advance)
            else:
                try:
                    _write_parts(out, way, path, image, specs, advance)
                finally:
                    closed = out.close()
                if not closed:
                    raise ImageError(f"{path}: {_error_text(out, way, path)}")
        format_name = out.format_name()
        del out  # a MIP-mapped EXR is finished only now
        if not temporary.stat().st_size:
            raise ImageError(f"{path}: the {format_name} writer produced no file")
        require_arrived(temporary, path, image, format_name)
        keep_readable(path)


def require_writable(
    image: Image, path: str | os.PathLike[str], how: Format | oiio.TypeDesc | None = None, place: str = ""
) -> None:
    """Refuse a name or pixel types that `write` would refuse; no pixel is read.

    `place`: a name in an existing folder, if that of `path` will be made.
    """
    path = Path(checked_name(path))
    temporary = held_beside(Path(place or path))
    try:
        _prepared(image, temporary, path, how)
    finally:
        release(temporary)


def _prepared(
    image: Image, temporary: Path, path: Path, how: Format | oiio.TypeDesc | None
) -> tuple[oiio.ImageOutput, Image, list[list[oiio.ImageSpec]]]:
    """The writer, the image fitted to its format, and the specs of its parts."""
    how = how if isinstance(how, Format) else Format(pixel_type=how)
    if path.suffix == SUFFIX and not how.format_name:
        image, how = packed(image, path), format_of(how)
    out = oiio.ImageOutput.create(how.format_name or str(temporary))
    if out is None:
        oiio.geterror()  # discarded: it names the temporary file
        raise ImageError(f"{path}: no writer for '{how.format_name or path.suffix}'")
    image = fitted(image, out, path, how)
    specs = specs_of(image, out, how)
    for part, levels in zip(image.parts, specs, strict=True):
        _keep_mattes(out, path, part, levels[0])
    for spec in (spec for levels in specs for spec in levels):
        _require_limits(spec, path)
    _require_types(out, temporary, path, image, specs, how)
    return out, image, specs


@contextlib.contextmanager
def _way_to(temporary: Path, path: Path, out: oiio.ImageOutput) -> Iterator[Path]:
    """The path that OpenImageIO writes to: for some formats a pipe that accepts all data even if the disk is full."""
    if out.format_name() not in _PIPED or not os.path.isdir("/dev/fd"):
        yield temporary
        return
    from subprocess import DEVNULL  # rarely needed

    shell = program("sh")
    if shell is None:
        yield temporary
        return
    source, sink = os.pipe()
    with open(temporary, "wb") as file:  # a thread could not copy: OpenImageIO holds the GIL while it closes
        copier = start([shell, "-c", _COPY], stdin=source, stdout=file, stderr=DEVNULL, start_new_session=True)
    os.close(source)
    try:
        with _uninterrupted():
            yield Path(f"/dev/fd/{sink}")
    finally:
        os.close(sink)
        code = copier.wait()
    if code:
        raise ImageError(f"{path}: {_NOT_WHOLE}")


@contextlib.contextmanager
def _uninterrupted() -> Iterator[None]:
    """Leave signals to other threads: one that arrives while a pipe is full would cut the write short."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM, signal.SIGHUP))
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _error_text(out: oiio.ImageOutput | oiio.ImageBuf, temporary: Path, path: Path) -> str:
    """The writer's error, with the final file name, and without a reason that `temporary_beside` adds."""
    return _of_target(error_text(out.geterror), temporary, path).removesuffix(f" ({os.strerror(errno.ENOSPC)})")


def _of_target(text: str, temporary: Path, path: Path) -> str:
    """The text with the name of the file that it is about to have."""
    return text.replace(str(temporary), str(path))


# --- writing ---


def _write_whole(
    format_name: str,
    temporary: Path,
    path: Path,
    part: Part,
    spec: oiio.ImageSpec,
    advance: Callable[[int, int], object] | None,
) -> None:
    """Write through an image in memory, which the format's encoder holds anyway.

    OpenImageIO holds the GIL while it closes a file, and these formats encode then: signals would not be handled.
    """
    whole = None
    for window, pixels in stream(part, part.window.cells(part.window.width, rows_for(part, BAND_BYTES, _BLOCK_ROWS))):
        if whole is None:
            held = oiio.ImageSpec(spec)
            held.set_format(spec.format if pixels.dtype == dtype_of(spec) else oiio.TypeDesc(oiio.FLOAT))
            whole = oiio.ImageBuf(held)
        roi = oiio.ROI(window.left, window.right, window.top, window.bottom, 0, 1, 0, spec.nchannels)
        whole.set_pixels(roi, np.ascontiguousarray(pixels))
        if advance is not None:
            advance(window.bottom - part.window.top, spec.height)
    if not present(whole).write(str(temporary), spec.format, format_name):
        raise ImageError(f"{path}: cannot be written: {_error_text(present(whole), temporary, path)}")


def _write_parts(
    out: oiio.ImageOutput,
    temporary: Path,
    path: Path,
    image: Image,
    specs: list[list[oiio.ImageSpec]],
    advance: Callable[[int, int], object] | None,
) -> None:
    total = sum(spec.height for levels in specs for spec in levels)
    written = 0  # rows
    clamped = 0  # values
    for n, (part, levels) in enumerate(zip(image.parts, specs, strict=True)):
        for m, spec in enumerate(levels):
            _open(out, temporary, path, [s[0] for s in specs], n, m, spec)
            if part.thumbnail is not None and not m and out.supports("thumbnail"):
                out.set_thumbnail(part.thumbnail())
            opened = out.spec()  # some formats require tiles, or an origin of 0
            spec.tile_width, spec.tile_height, spec.tile_depth = tile_of(opened)
            x, y = opened.x - spec.x, opened.y - spec.y
            bands = _bands(part, spec)
            if out.format_name() == "openexr" and spec.get_string_attribute("openexr:lineOrder") == "decreasingY":
                bands = reversed(list(bands))  # OpenEXR ends the process if rows come in another order
            if spec.deep:
                if not out.write_deep_image(part.buffer(part.window).deepdata()):
                    raise ImageError(f"{path}: writing failed: {_error_text(out, temporary, path)}")
                written += spec.height
                continue
            for window, pixels in stream(part.levels[m - 1] if m else part, bands):
                pixels, count = _in_half(pixels, spec)
                clamped += count
                if not _put(out, spec, window.shifted(x, y), np.ascontiguousarray(pixels)):
                    row = window.top - spec.y
                    raise ImageError(f"{path}: writing failed at row {row}: {_error_text(out, temporary, path)}")
                written += window.height if window.right == spec.x + spec.width else 0
                if advance is not None:
                    advance(written, total)
    if clamped:
        log.warning("%s: %d values beyond the range of half are clamped to +-65504: add -d float", path, clamped)


def _in_half(pixels: np.ndarray, spec: oiio.ImageSpec) -> tuple[np.ndarray, int]:
    """Pixels whose finite values stay finite in the channels that are stored as half, and the number of clamped values.

    OpenImageIO stores larger values as Inf.
    """
    halves = [spec.channelformat(channel) == oiio.HALF for channel in range(spec.nchannels)]
    if not any(halves) or pixels.dtype.kind != "f" or pixels.dtype.itemsize == 2:
        return pixels, 0
    large = np.isfinite(pixels) & (np.abs(pixels) > _MOST_HALF) & np.array(halves)
    count = int(np.count_nonzero(large))
    return (
        (np.where(large, np.copysign(pixels.dtype.type(_MOST_HALF), pixels), pixels), count) if count else (pixels, 0)
    )


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
    elif len(firsts) > 1 and out.format_name() in _AT_ONCE:
        opened = out.open(str(temporary), tuple(firsts))
    else:
        opened = out.open(str(temporary), spec)
    if not opened:
        raise ImageError(f"{path}: cannot be written: {_error_text(out, temporary, path)}")


def _bands(part: Part, spec: oiio.ImageSpec) -> Iterator[Window]:
    """Full rows if they fit, else runs of tiles, in the order of the file."""
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
    # PFM: its writer flips only rows of the file's own type
    if out.format_name() == "pnm" and spec.format in (oiio.FLOAT, oiio.HALF):
        band = oiio.ImageBuf(oiio.ImageSpec(window.width, window.height, spec.nchannels, oiio.FLOAT))
        band.set_pixels(band.roi, pixels)
        pixels = present(band.get_pixels(oiio.FLOAT))
    return out.write_scanlines(window.top, window.bottom, 0, pixels)


def _require_limits(spec: oiio.ImageSpec, path: Path) -> None:
    """Refuse an image beyond the limits of OpenImageIO's readers: its file could be written, and not read again."""
    for limit, value, unit in (
        ("channels", spec.nchannels, "channels"),
        ("resolution", max(spec.width, spec.height), "px along a side"),
        ("imagesize_MB", spec.image_bytes() >> 20, "MB"),
    ):
        most = oiio.get_int_attribute(f"limits:{limit}")
        if most and value > most:
            raise ImageError(
                f"{path}: has {value} {unit}, and could not be read again",
                expected=f"at most {most}, the limit of OpenImageIO",
                hint=f"raise its attribute limits:{limit}",
            )


def _require_types(
    out: oiio.ImageOutput, temporary: Path, path: Path, image: Image, specs: list[list[oiio.ImageSpec]], how: Format
) -> None:
    """Refuse a type that the format would silently replace; tested before the work begins, with one-pixel images."""
    for part, levels in zip(image.parts, specs, strict=True):
        wanted = wanted_type(part, how, levels[0])
        if part is image.first and keeps_type(part) and how.pixel_type not in (None, wanted):
            change = f"converting part '{part.name}' from {wanted} to {how.pixel_type} would change its values"
            raise ImageError(f"{path}: {change}")
        if out.format_name() == "tiff" and levels[0].format == oiio.DOUBLE:
            raise ImageError(f"{path}: TIFF files of type double are not supported")  # see reading
        if wanted is None:
            continue
        trial = present(oiio.ImageOutput.create(how.format_name or str(temporary)))
        place = os.devnull if out.format_name() == "jpeg" else str(temporary)  # see _way_to
        spec = Window(0, 0, 1, 1).apply_to(levels[0])
        spec.full_x, spec.full_y, spec.full_width, spec.full_height = 0, 0, 1, 1
        spec.deep = False
        if not trial.open(place, spec):
            raise ImageError(f"{path}: cannot be written: {_error_text(trial, temporary, path)}")
        stored = trial.spec().format
        trial.write_image(np.zeros((1, 1, spec.nchannels), np.float32))
        trial.close()
        if stored != wanted and not levels[0].channelformats:
            raise ImageError(f"{path}: {trial.format_name()} cannot hold part '{part.name}' as {wanted}")


def _keep_mattes(out: oiio.ImageOutput, path: Path, part: Part, spec: oiio.ImageSpec) -> None:
    """Refuse formats and types that would round ids of Cryptomatte; warn if they stay float among others."""
    mattes = [c for c in matte_channels(spec) if part.spec.channelformat(c) == oiio.FLOAT]
    if not mattes:
        return
    names = f"{spec.channelnames[mattes[0]]} to {spec.channelnames[mattes[-1]]}"
    holds = out.format_name() == "openexr" or (not spec.channelformats and out.format_name() in ("tiff", "sgi"))
    if not holds:
        problem = f"{path}: {out.format_name()} cannot hold Cryptomatte channels {names} as 32-bit floats"
        raise ImageError(
            problem, hint=f"use EXR, or {either('select other channels with --ch', 'write other channels')}"
        )
    if any(spec.channelformat(c) == oiio.HALF != part.spec.channelformat(c) for c in range(spec.nchannels)):
        log.warning("%s: %s stay float: half would change the ids of Cryptomatte", path, names)


def require_arrived(temporary: Path, path: Path, image: Image, format_name: str) -> None:
    """Refuse an incomplete file: several of OpenImageIO's writers do not notice a full disk.

    The last rows are read back, and one more block must fit on the disk, since a writer that seeks leaves holes if it
    was full. The number of free blocks is not reliable on all file systems. Also warns of lost metadata.

    Raises
    ------
    ImageError
        The file cannot be read, or its end is missing.
    """
    try:
        require_room(temporary)
        arrived = read(temporary, turned=False).parts
        for level in (level for part in arrived for level in (part, *part.levels)):
            last = Window(level.window.left, level.window.bottom - 1, level.window.right, level.window.bottom)
            level.fetch.planes(last) if isinstance(level.fetch, FilePixels) else level.buffer(last)
    except (ImageError, OSError, ValueError) as error:
        said = f" ({_of_target(reason_of(error), temporary, path)})" if isinstance(error, ImageError) else ""
        raise ImageError(f"{path}: {_NOT_WHOLE}{said}") from error
    warn_of_loss(path, format_name, [part.spec for part in image.parts], [part.spec for part in arrived])
