# SPDX-License-Identifier: Apache-2.0
"""Fit of an image to a file format: channels, windows, types and tiles."""

from __future__ import annotations

import dataclasses
import logging
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..core.attributes import WINDOW
from ..core.image import IDS, Image, Part, cropped
from ..core.window import Window
from ..deferred import oiio
from ..errors import ImageError
from .cryptomatte import matte_channels
from .description import describe, is_ours, keep_true

log = logging.getLogger("oiiotex")


@dataclass(frozen=True, kw_only=True)
class Format:
    """Settings for writing a file.

    Attributes
    ----------
    pixel_type : oiio.TypeDesc or None
        Type requested by the user; an error if the format cannot hold it.
    computed_type : oiio.TypeDesc or None
        Type of parts computed by oiiotool's ops, if the format has it; None: the part's own.
    computed_channels : dict of str to oiio.TypeDesc
        Types of channels of computed parts, by name.
    computed_tile : (int, int) or None
        Width and height of the tiles of computed parts; None: scanlines.
    bits, computed_bits : int
        Significant bits, if fewer than the type has, of all parts and of computed parts; 0: as in the source.
    channel_types : dict of str to oiio.TypeDesc or None
        Types of channels by name, or by 'part.name'; 'part.*' stands for all channels of a part. None: the part's type.
    tile : (int, int) or None
        Width and height of tiles; None: as in the source if it is only copied, else scanlines.
    scanline : bool
        Write no tiles.
    attributes : dict
        Attributes of all parts: compression, Software and so on. None erases one.
    autocrop : bool
        Crop or pad to the display window for formats without one.
    format_name : str
        Format to write. Default: by the file's extension.
    """

    pixel_type: oiio.TypeDesc | None = None
    computed_type: oiio.TypeDesc | None = None
    computed_channels: dict[str, oiio.TypeDesc] = field(default_factory=dict)
    computed_tile: tuple[int, int] | None = None
    bits: int = 0
    computed_bits: int = 0
    channel_types: dict[str, oiio.TypeDesc | None] = field(default_factory=dict)
    tile: tuple[int, int] | None = None
    scanline: bool = False
    attributes: dict[str, Any] = field(default_factory=dict)
    autocrop: bool = True
    format_name: str = ""


# --- limits of the format ---


def fitted(image: Image, out: oiio.ImageOutput, path: Path, how: Format) -> Image:
    """The image with the channels, windows and origins that the format supports, as oiiotool fits it.

    The first part decides whether windows are fitted: layers of a PSD file are not cut where they extend beyond it.
    """
    if len(image.parts) > 1 and not out.supports("multiimage"):
        image = _first_alone(image, out, path)
    if any(part.spec.deep for part in image.parts) and not out.supports("deepdata"):
        raise ImageError(f"{path}: {out.format_name()} cannot hold deep images", expected="EXR, or a flat image")
    parts = [_with_fitting_channels(part, out, path) for part in image.parts]
    if how.autocrop and not out.supports("displaywindow") and parts[0].window != Window.display(parts[0].spec):
        parts = [_in_window(part, Window.display(part.spec)) for part in parts]
    if how.autocrop and not out.supports("negativeorigin"):
        parts = _without_negative_origin(parts)
    if any(part.window.empty for part in parts):
        raise ImageError(f"{path}: the image has no pixels")
    return Image(tuple(parts), image.source)


def _first_alone(image: Image, out: oiio.ImageOutput, path: Path) -> Image:
    """The first part of an image of the host, with a warning; parts that filters made are refused."""
    names, holds = ", ".join(part.name for part in image.parts), f"{path}: {out.format_name()} holds one image"
    if any(part.exact or is_ours(part.spec) for part in image.parts):
        raise ImageError(f"{holds}, not {names}", hint="use EXR or TIFF")
    log.warning("%s; of %s only the first is written", holds, names)
    return Image(image.parts[:1], image.source)


def _with_fitting_channels(part: Part, out: oiio.ImageOutput, path: Path) -> Part:
    count, fit = part.spec.nchannels, part.spec.nchannels
    alpha_fourth = count > 3 and (part.spec.alpha_channel == 3 or part.spec.channelnames[3].lower() in ("a", "alpha"))
    if count > 4 and not out.supports("nchannels"):
        fit = 4
    if count > 3 and not out.supports("alpha" if alpha_fourth else "nchannels"):
        fit = 3
    if fit == count:
        return part
    names = part.spec.channelnames[:fit]
    log.warning("%s: %s cannot hold %d channels; only %s are written", path, out.format_name(), count, ", ".join(names))

    def fewer(spec: oiio.ImageSpec) -> None:
        spec.nchannels = fit
        spec.channelnames = tuple(names)
        spec.alpha_channel = 3 if alpha_fourth and fit == 4 else -1

    narrow = part.respecced(fewer)
    return dataclasses.replace(narrow, fetch=lambda window: part.read(window)[..., :fit], levels=())


def _in_window(part: Part, window: Window) -> Part:
    """Cropped, with its tile size kept."""
    fitted = cropped(part, window)
    spec = fitted.spec
    spec.tile_width, spec.tile_height, spec.tile_depth = tile_of(part.spec)
    return fitted


def tile_of(spec: oiio.ImageSpec) -> tuple[int, int, int]:
    """Width, height and depth of tiles; 0 for scanlines."""
    return spec.tile_width, spec.tile_height, spec.tile_depth


def _without_negative_origin(parts: list[Part]) -> list[Part]:
    """All parts without what is left of and above 0 in the first; a window of an unbounded texture is moved instead."""
    display = Window.display(parts[0].spec)
    unbounded = bool(parts[0].spec.get_string_attribute(WINDOW))  # cropping might leave no pixel
    right, down = (max(0, -n) if unbounded else 0 for n in (display.left, display.top))

    def move(spec: oiio.ImageSpec) -> None:
        spec.x, spec.full_x = spec.x + right, spec.full_x + right
        spec.y, spec.full_y = spec.y + down, spec.full_y + down

    parts = [part.respecced(move) for part in parts] if right or down else parts
    window = parts[0].window
    if window.left >= 0 and window.top >= 0:
        return parts
    left, top = max(0, window.left), max(0, window.top)
    inside = Window(left, top, max(left + 1, window.right), max(top + 1, window.bottom))
    return [_in_window(part, inside) for part in parts]


# --- specs ---


def specs_of(image: Image, out: oiio.ImageOutput, how: Format) -> list[list[oiio.ImageSpec]]:
    """For each part the specs of its levels, ready for opening the file."""
    tiled = bool(out.supports("tiles")) and not how.scanline
    several = len(image.parts) > 1
    shared = image.first.spec.getattribute("PixelAspectRatio")  # EXR requires one for all parts
    ours = any(part.exact or is_ours(part.spec) for part in image.parts)  # otherwise written as by oiiotool
    specs: list[list[oiio.ImageSpec]] = []
    for n, part in enumerate(image.parts):
        levels = []
        for level in (part, *_levels(part, out, how, several)):
            spec = oiio.ImageSpec(level.spec)
            name = f"subimage{n:02}" if several and nameless(part) else part.name
            _set_types(spec, part, how, name)
            _set_tiles(spec, part, how, out, tiled)
            if n > 0 and out.format_name() == "openexr":  # OpenImageIO opens all parts as the first
                spec.tile_width, spec.tile_height, spec.tile_depth = tile_of(specs[0][0])
            if several and not nameless(part):
                spec.attribute("oiio:subimagename", part.name)
            if several and n > 0 and shared is not None:
                spec.attribute("PixelAspectRatio", shared)
            if not spec.tile_width or not part.levels:
                spec.erase_attribute("textureformat")
            if out.format_name() == "pnm":  # PFM stores rows from the bottom, other kinds do not
                spec.attribute("pnm:pfmflip", int(spec.format in (oiio.FLOAT, oiio.HALF)))
            for name, value in how.attributes.items():
                if value is None:
                    spec.erase_attribute(name)
                else:
                    spec.attribute(name, value)
            keep_true(spec, out.format_name())
            if ours:
                describe(spec, out.format_name())
            levels.append(spec)
        specs.append(levels)
    return specs


def nameless(part: Part) -> bool:
    """Whether the part has only a number: OpenImageIO writes such parts as subimage00, subimage01 and so on."""
    return re.fullmatch(r"part\d+", part.name) is not None


def _levels(part: Part, out: oiio.ImageOutput, how: Format, several: bool) -> tuple[Part, ...]:
    """The MIP levels to write: TIFF stores them as further images, which must be tiled to be recognized."""
    if several or how.scanline:
        return ()
    if out.supports("mipmap"):
        return part.levels
    return part.levels if part.spec.tile_width and out.format_name() == "tiff" else ()


def keeps_type(part: Part) -> bool:
    """Whether a file must keep the part's type: rounded ids would be wrong."""
    return part.exact or str(part.stored) in IDS


def wanted_type(part: Part, how: Format, spec: oiio.ImageSpec) -> oiio.TypeDesc | None:
    """The type that the file must have: requested by the user, or the part's own if that must be kept; else None.

    `spec` is the part's spec from `specs_of`, in which -d PART.*=TYPE overrides -d TYPE.
    """
    if keeps_type(part):
        return part.stored
    return spec.format if how.pixel_type is not None else None


def _set_types(spec: oiio.ImageSpec, part: Part, how: Format, part_name: str) -> None:
    by_channel = dict(how.channel_types)
    unchanged = [spec.channelformat(c) for c in range(spec.nchannels)]
    if how.pixel_type is not None and not keeps_type(part):
        spec.set_format(how.pixel_type)
    elif part.stored is not None:
        if part.stored != spec.format:
            own = spec.channelformats
            spec.set_format(part.stored)
            spec.channelformats = own
    else:
        spec.set_format(how.computed_type or spec.format)
        by_channel = {**how.computed_channels, **by_channel}
    types = [spec.channelformat(c) for c in range(spec.nchannels)]
    if part.copied:
        types = [own if str(own) in IDS else kind for own, kind in zip(unchanged, types, strict=True)]
    for c, name in enumerate(spec.channelnames):
        keys = (f"{part_name}.{name}", f"{part_name}.*", name)
        types[c] = next((by_channel[key] for key in keys if key in by_channel), None) or types[c]
    for c in matte_channels(spec):
        types[c] = oiio.TypeDesc(oiio.FLOAT) if unchanged[c] == oiio.FLOAT else types[c]
    if any(kind != types[0] for kind in types):
        spec.channelformats = tuple(types)
    else:
        spec.set_format(types[0])
    bits = how.bits or (how.computed_bits if part.stored is None else 0)
    if bits:
        spec.attribute("oiio:BitsPerSample", bits)
    elif how.pixel_type is not None or part.stored is None:
        spec.erase_attribute("oiio:BitsPerSample")


def _set_tiles(spec: oiio.ImageSpec, part: Part, how: Format, out: oiio.ImageOutput, tiled: bool) -> None:
    tile = how.tile or (how.computed_tile if part.stored is None else None)
    if tiled and tile is not None:
        spec.tile_width, spec.tile_height, spec.tile_depth = *tile, 1
    elif not tiled or (out.format_name() == "tiff" and (spec.tile_width % 16 or spec.tile_height % 16)):
        spec.tile_width = spec.tile_height = spec.tile_depth = 0
