# SPDX-License-Identifier: Apache-2.0
"""Options that write MIP-mapped textures with OpenImageIO's make_texture."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ....engine.core.image import Image, Part, type_named
from ....engine.core.parameters import Size, param
from ....engine.core.tiling import tiling_of
from ....engine.deferred import oiio
from ....engine.errors import ImageError, ParameterError, one_line
from ....engine.io.atomic import part_of, take, temporary_beside
from ....engine.io.cryptomatte import require_no_ids, require_unmixed
from ....engine.io.description import describe, is_ours
from ....engine.io.formats import Format
from ....engine.io.reading import checked_name, keep_readable
from ....engine.io.writing import require_arrived
from ..language.parse import Option
from ..stack.chain import Chain, require_flat
from .output import compression, is_left, may_write, software

_WRAPS = ("black", "clamp", "periodic", "mirror")


@dataclass(frozen=True)
class TextureModifiers:
    """Modifiers of -otex, -oenv and -obump."""

    wrap: str | None = param(
        None, choices=(*_WRAPS, None), unset="periodic along axes that the image's wrapmodes call periodic, else black",
        help="Wrap mode outside the image.",
    )  # fmt: skip
    swrap: str | None = param(None, choices=(*_WRAPS, None), unset="that of wrap", help="Horizontal wrap mode.")
    twrap: str | None = param(None, choices=(*_WRAPS, None), unset="that of wrap", help="Vertical wrap mode.")
    type: str | None = param(None, unset="that of -d", example="half", help="Pixel type, such as uint8, half or float.")
    tile: Size | None = param(None, ge=1, le=65536, unset="that of --tile, 64x64", help="Size of tiles.")
    fileformatname: str = param("", unset="that of the extension", example="tiff", help="Name of the file format.")
    resize: bool = param(False, help="Resize the image to powers of two.")
    keepaspect: bool = param(False, help="Keep the aspect ratio when resizing.")
    nomipmap: bool = param(False, help="Write only the largest MIP level.")
    updatemode: bool = param(False, help="Write the file only if it changes.")
    constant_color_detect: bool = param(False, help="Store images of a constant color as one tile.")
    monochrome_detect: bool = param(False, help="Store gray images as one channel.")
    opaque_detect: bool = param(False, help="Omit alpha if it is 1 everywhere.")
    compute_average: bool = param(True, help="Store the average color in the metadata.")
    unpremult: bool = param(False, help="Unpremultiply colors for the conversion.")
    incolorspace: str = param("", example="sRGB", help="Color space to convert from.")
    outcolorspace: str = param("", example="ACEScg", help="Color space to convert to.")
    highlightcomp: bool = param(False, help="Compress highlights while filtering.")
    hicomp: bool = param(False, advanced=True, help="Alias of highlightcomp.")
    sharpen: float = param(0.0, ge=0, help="Sharpening of the smaller MIP levels. 0: none.")
    filter: str = param("", example="lanczos3", advanced=True, help="Alias of filtername.")
    filtername: str = param("", unset="box", example="lanczos3", help="Filter of the smaller MIP levels.")
    prman_metadata: bool = param(False, help="Store the metadata that PRMan expects.")
    oiio: bool = param(False, help="Settings for OpenImageIO's texture system.")
    oiio_options: bool = param(False, advanced=True, help="Alias of oiio.")
    prman: bool = param(False, help="Settings for PRMan.")
    prman_options: bool = param(False, advanced=True, help="Alias of prman.")
    forcefloat: bool = param(True, help="Compute MIP levels in float.")
    handed: str = param("", choices=("", "left", "right"), help="Handedness to store in the metadata.")
    bumpformat: str = param("auto", choices=("height", "normal", "auto"), help="Content of the bump map.")
    bumpscale: float = param(1.0, help="Scale of heights.")
    bumpinverts: bool = param(False, help="Invert the slope along s.")
    bumpinvertt: bool = param(False, help="Invert the slope along t.")
    bumprange: str = param("auto", choices=("centered", "positive", "auto"), help="Range of normals.")
    slopefilter: str = param("sobel", choices=("sobel", "centraldiff"), help="Filter that computes slopes.")
    uvslopes_scale: float = param(0.0, ge=0, help="Scale of slopes, for slopes in uv space.")
    cdf: bool = param(False, help="Store the cumulative distribution of values in the metadata.")
    cdfbits: int = param(8, ge=1, le=16, help="Bits of the cumulative distribution.")
    cdfsigma: float = param(1 / 6, ge=0, unset="1/6", help="Sigma of the cumulative distribution.")


_BOTH = {"highlightcomp": "hicomp", "filtername": "filter", "oiio_options": "oiio", "prman_options": "prman"}
_ELSEWHERE = {
    "incolorspace",
    "outcolorspace",
    "unpremult",
    "wrap",
    "swrap",
    "twrap",
    "type",
    "tile",
    "handed",
    "fileformatname",
    *_BOTH.values(),
}


def write_texture(mode: str) -> Any:
    """A function that writes the top image as a texture of a kind."""

    def run(chain: Chain, path: str, given: TextureModifiers) -> None:
        require_flat([chain.top])
        part = _converted(chain, given)
        require_unmixed(part, "a MIP-mapped texture")
        require_no_ids(part, "a MIP-mapped texture")
        size = part.spec.width * part.spec.height * part.spec.nchannels * 4
        chain.session.resources.require(3 * size, "a MIP-mapped texture")
        image, how = Image((part,), chain.top.source), Format(format_name=given.fileformatname)
        if is_left(chain, path) or not may_write(chain, image, path, how):
            return
        if chain.shares is not None:
            raise ParameterError("--share cannot split a MIP-mapped texture: use -o, and convert later")
        chain.tell(f"Writing {path}")
        session = chain.session
        timed, checkpoints = session.resources.stats.time("make texture"), session.resources.checkpoints(path)
        with timed, checkpoints, temporary_beside(Path(checked_name(path))) as temporary:
            config = _config(chain, part, given)
            out = oiio.ImageOutput.create(given.fileformatname or str(temporary))
            format_name = out.format_name() if out is not None else ""
            says = is_ours(part.spec) or given.incolorspace or given.outcolorspace
            described = part.respecced(lambda spec: describe(spec, format_name)) if says else part
            made = part_of(temporary, "texture")  # make_texture replaces the file with its lock
            if not oiio.ImageBufAlgo.make_texture(
                getattr(oiio, mode), described.buffer(part.window), str(made), config
            ) or not (made.exists() and made.stat().st_size):
                text = one_line(oiio.geterror())
                raise ImageError(f"{path}: {'cannot write the texture' if made.stem in text else text}")
            take(temporary, made)
            require_arrived(temporary, Path(path), image, format_name)
            keep_readable(Path(path))

    return run


def _converted(chain: Chain, given: TextureModifiers) -> Part:
    """The top image in the color space of the texture; make_texture would tag it and average it unconverted."""
    from ...host.color import ColorConvert, IsColorSpace

    image, facts = chain.top, chain.session.resources
    if given.incolorspace:
        image = IsColorSpace(source=image, space=given.incolorspace).plan(facts).results
    if given.outcolorspace:
        convert = ColorConvert(
            source=image, from_space="current", to_space=given.outcolorspace, unpremult=given.unpremult
        )
        image = convert.plan(facts).results
    return dataclasses.replace(image.first, stored=chain.top.first.stored)


def _wrap_modes(spec: oiio.ImageSpec, given: TextureModifiers) -> str:
    """The wrap modes, x and y: those given, else that of a tile."""
    axes = tiling_of(spec)
    own = ("periodic" if axis in axes else "black" for axis in "xy")
    return ",".join(one or given.wrap or tag for one, tag in zip((given.swrap, given.twrap), own, strict=True))


def _config(chain: Chain, part: Part, given: TextureModifiers) -> oiio.ImageSpec:
    """The settings of make_texture for a part, as attributes of a spec."""
    config = oiio.ImageSpec()
    kind = type_named(given.type) if given.type else chain.settings.get("-d", (None, 0))[0]
    kind = kind or part.stored or chain.first.pixel_type
    if kind is not None:
        config.set_format(kind)
    config.tile_width, config.tile_height = given.tile or chain.settings.get("--tile") or (64, 64)
    config.tile_depth = 1
    config.attribute("wrapmodes", _wrap_modes(part.spec, given))
    values = {name: value for name, value in vars(given).items() if name not in _ELSEWHERE}
    for name, other in _BOTH.items():
        values[name] = values[name] or getattr(given, other)
    if not values["filtername"]:  # make_texture chooses one
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
