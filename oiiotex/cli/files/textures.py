# SPDX-License-Identifier: Apache-2.0
"""Options that write MIP-mapped textures, through OpenImageIO's make_texture."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...core.image import Image, type_named
from ...core.parameters import Size, param
from ...deferred import oiio
from ...errors import ImageError, ParameterError, one_line
from ...io.atomic import part_of, take, temporary_beside
from ...io.description import describe, is_ours
from ...io.formats import Format
from ...io.reading import checked_name, keep_readable
from ...io.writing import require_arrived
from ..language.parse import Option
from ..stack.chain import Chain, require_flat
from .output import compression, is_left, may_write, software

log = logging.getLogger("oiiotex")

_WRAPS = ("black", "clamp", "periodic", "mirror")


@dataclass(frozen=True)
class TextureModifiers:
    """Of -otex, -oenv and -obump."""

    wrap: str = param("black", choices=_WRAPS, help="what lies beyond the image")
    swrap: str | None = param(None, choices=(*_WRAPS, None), help="the same, to the left and right")
    twrap: str | None = param(None, choices=(*_WRAPS, None), help="the same, above and below")
    type: str | None = param(None, help="pixel type, as of -d")
    tile: Size | None = param(None, ge=1, le=65536, help="size of tiles; 64x64 when left out")
    fileformatname: str = param("", help="the format, whatever the name's extension")
    resize: bool = param(False, help="resize to powers of two")
    keepaspect: bool = param(False, help="keep the aspect ratio when resizing")
    nomipmap: bool = param(False, help="the largest version only")
    updatemode: bool = param(False, help="write only what has changed")
    constant_color_detect: bool = param(False, help="one tile for an image of one color")
    monochrome_detect: bool = param(False, help="one channel for a gray image")
    opaque_detect: bool = param(False, help="no alpha where it is 1 everywhere")
    compute_average: bool = param(True, help="note the average color")
    unpremult: bool = param(False, help="convert colors undone of alpha")
    incolorspace: str = param("", help="convert from this color space")
    outcolorspace: str = param("", help="convert to this color space")
    highlightcomp: bool = param(False, help="compress highlights while filtering")
    hicomp: bool = param(False, help="the same")
    sharpen: float = param(0.0, ge=0, help="sharpen the smaller versions")
    filter: str = param("", help="name of the filter for the smaller versions")
    filtername: str = param("", help="the same")
    prman_metadata: bool = param(False, help="note what PRMan wants")
    oiio: bool = param(False, help="settings that suit OpenImageIO")
    oiio_options: bool = param(False, help="the same")
    prman: bool = param(False, help="settings that suit PRMan")
    prman_options: bool = param(False, help="the same")
    forcefloat: bool = param(True, help="filter as float")
    handed: str = param("", choices=("", "left", "right"), help="handedness, noted in the file")
    bumpformat: str = param("auto", choices=("height", "normal", "auto"), help="what a bump map holds")
    bumpscale: float = param(1.0, help="scale of heights")
    bumpinverts: bool = param(False, help="invert the slope along s")
    bumpinvertt: bool = param(False, help="invert the slope along t")
    bumprange: str = param("auto", choices=("centered", "positive", "auto"), help="range of normals")
    slopefilter: str = param("sobel", choices=("sobel", "centraldiff"), help="how slopes are taken")
    uvslopes_scale: float = param(0.0, ge=0, help="scale of slopes by the texture's size")
    cdf: bool = param(False, help="note the cumulative distribution")
    cdfbits: int = param(8, ge=1, le=16, help="its bits")
    cdfsigma: float = param(1 / 6, ge=0, help="its sigma")


_BOTH = {"highlightcomp": "hicomp", "filtername": "filter", "oiio_options": "oiio", "prman_options": "prman"}
_ELSEWHERE = {"wrap", "swrap", "twrap", "type", "tile", "handed", "fileformatname", *_BOTH.values()}


def write_texture(mode: str) -> Any:
    """What writes the top image as a texture of that kind."""

    def run(chain: Chain, path: str, given: TextureModifiers) -> None:
        require_flat([chain.top])
        part = chain.top.first
        size = part.spec.width * part.spec.height * part.spec.nchannels * 4
        chain.session.resources.require(3 * size, "a MIP-mapped texture")
        image, how = Image((part,), chain.top.source), Format(format_name=given.fileformatname)
        if is_left(chain, path) or not may_write(chain, image, path, how):
            return
        if chain.shares is not None:
            raise ParameterError("a MIP-mapped texture is made whole: write an image in shares, and make it of that")
        chain.tell(f"Writing {path}")
        session = chain.session
        timed, checkpoints = session.resources.stats.time("make texture"), session.resources.checkpoints(path)
        with timed, checkpoints, temporary_beside(Path(checked_name(path))) as temporary:
            config = _config(chain, part.stored, given)
            out = oiio.ImageOutput.create(given.fileformatname or str(temporary))
            format_name = out.format_name() if out is not None else ""
            described = part.respecced(lambda spec: describe(spec, format_name)) if is_ours(part.spec) else part
            made = part_of(temporary, "texture")  # make_texture replaces the file, and with it the lock
            if not oiio.ImageBufAlgo.make_texture(
                getattr(oiio, mode), described.buffer(part.window), str(made), config
            ) or not (made.exists() and made.stat().st_size):
                raise ImageError(f"{path}: {one_line(oiio.geterror()) or 'no texture could be made'}")
            take(temporary, made)
            require_arrived(temporary, Path(path), image, format_name)
            keep_readable(Path(path))

    return run


def _config(chain: Chain, stored: oiio.TypeDesc | None, given: TextureModifiers) -> oiio.ImageSpec:
    """The settings as make_texture takes them: a spec with attributes."""
    config = oiio.ImageSpec()
    kind = type_named(given.type) if given.type else chain.settings.get("-d", (None, 0))[0]
    kind = kind or stored or chain.first.pixel_type
    if kind is not None:
        config.set_format(kind)
    config.tile_width, config.tile_height = given.tile or chain.settings.get("--tile") or (64, 64)
    config.tile_depth = 1
    config.attribute("wrapmodes", f"{given.swrap or given.wrap},{given.twrap or given.wrap}")
    values = {name: value for name, value in vars(given).items() if name not in _ELSEWHERE}
    for name, other in _BOTH.items():
        values[name] = values[name] or getattr(given, other)
    if not values["filtername"]:  # by what is asked, else by what there is to do
        del values["filtername"]
    for name, value in values.items():
        config.attribute(f"maketx:{name}", int(value) if isinstance(value, bool) else value)
    for name, value in compression(chain).items():
        config.attribute(name, value)
    if given.fileformatname:
        config.attribute("maketx:fileformatname", given.fileformatname)
    if given.handed:
        config.attribute("handed", given.handed)
    for name, value in software(chain).items():
        config.attribute(name, value)
        config.attribute("maketx:full_command_line", value)
    return config


OPTIONS = tuple(
    Option(f"{name} FILE", write_texture(mode), TextureModifiers, text, writes=True)
    for name, text, mode in (
        ("-otex", "Write the top image as a MIP-mapped texture", "MakeTxTexture"),
        ("-oenv", "Write the top image as a latitude-longitude environment map", "MakeTxEnvLatl"),
        ("-obump", "Write the top image as a bump map with slopes and their moments", "MakeTxBumpWithSlopes"),
    )
)
