# SPDX-License-Identifier: Apache-2.0
"""Options that read images, and settings of inputs."""

from __future__ import annotations

import dataclasses
import functools
import logging
from dataclasses import dataclass

from ....engine.core.attributes import TAG, set_attribute
from ....engine.core.demand import materialized
from ....engine.core.image import Image, Part, in_memory, pixels_of, type_named
from ....engine.core.parameters import param
from ....engine.core.window import Window
from ....engine.deferred import np, oiio
from ....engine.errors import ImageError, ParameterError
from ..language.control import SetModifiers
from ..language.parse import Option
from ..stack.chain import Chain
from ..stack.first_image import merged_type
from ..stack.output_settings import state

log = logging.getLogger("oiiotex")


_OF_SEQUENCES = (TAG, "Orientation", "PixelAspectRatio", "oiio:subimagename")  # metadata that all frames share
_PRINTING = ("--info", "--stats", "--hash", "--dumpdata")  # for each image as it is read


@dataclass(frozen=True)
class ReadModifiers:
    """Modifiers of -i."""

    autocc: bool | None = param(
        None, unset="1 after --autocc, else 0", help="Convert to scene linear, as --autocc does."
    )
    unpremult: bool = param(False, help="Unpremultiply colors for the conversion.")
    native: bool | None = param(None, unset="1 after --native, else 0", help="Let ops work on the file's pixel type.")
    type: str | None = param(None, unset="float", example="half", help="Pixel type that ops work on.")
    ch: str | None = param(None, unset="all", example="R,G,B", help="Channels to read, in the syntax of --ch.")
    info: int | None = param(
        None,
        ge=0,
        le=2,
        unset="1 after --info, else 0",
        example="2",
        help="Print information as --info does. 2: with all metadata.",
    )
    infoformat: str = param("", choices=("", "text", "xml"), unset="text", help="Format of the output of info.")
    now: bool = param(False, advanced=True, help="Read the whole file now instead of parts of it on demand.")
    get_thumbnail: bool = param(False, advanced=True, help="Read the file's thumbnail instead of its pixels.")
    fail: bool = param(True, advanced=True, help="Error for files without a thumbnail. 0: the image is scaled down.")
    index: int = param(0, ge=0, le=0, advanced=True, help="Number of the thumbnail. OpenImageIO reads only the first.")


_PLAIN = ReadModifiers()


def read_input(chain: Chain, path: str, given: ReadModifiers = _PLAIN) -> None:
    """Push the image of a file, as FILE alone does."""
    if path in chain.labeled:
        chain.push(chain.labeled[path])
        return
    try:
        image = _opened(chain, path, given)
    except ImageError as error:
        image = _substitute(chain, path, given, error)
    chain.push(image)
    _prepare(chain, path, given)


def _opened(chain: Chain, path: str, given: ReadModifiers) -> Image:
    settings = chain.settings
    native = bool(settings.get("--native")) if given.native is None else given.native
    config = settings.pop("--iconfig", None)
    if settings.get("--no-autopremult"):
        config = config or oiio.ImageSpec()
        config.attribute("oiio:UnassociatedAlpha", 1)
    image = chain.opened(path, native, config)
    chain.tell(f"Reading {path}")
    chain.inputs.add(path)
    if given.info or any(name in settings for name in _PRINTING):
        from ..printing.texts import print_input

        print_input(chain, image, given.info, given.infoformat)
    image = _as_asked(chain, image, given)
    if given.now:
        size = sum(part.spec.width * part.spec.height * part.spec.nchannels * 4 for part in image.parts)
        chain.session.resources.require(size, "now=1", "read it piece by piece, without now=1")
    if given.now and not chain.dry:
        parts = (part if part.spec.deep else materialized(part, 4 * size + 4) for part in image.parts)
        image = Image(tuple(parts), image.source)
    return image


def _as_asked(chain: Chain, image: Image, given: ReadModifiers) -> Image:
    """The image as if its file had the channels and the type of -i."""
    if given.ch is not None:
        image = _of_channels(chain, image, given.ch)
    chain.first.learn(image)
    return image if given.type is None else _retyped(image, type_named(given.type))


def _of_channels(chain: Chain, image: Image, channels: str) -> Image:
    """The image as if its file had these channels, of the file's types; added channels are float."""
    from ...host.channels import Channels

    op = Channels(source=image, channels=channels)

    def chosen(part: Part) -> Part:
        if op.idle([part]):
            return part
        own, result = part.spec, op.result([part], chain.session.resources)
        order = [channel.source for channel in op.chosen(own)]
        types = [own.channelformat(c) if isinstance(c, int) else oiio.TypeDesc("float") for c in order]
        spec = oiio.ImageSpec(result.spec)
        spec.channelformats = tuple(types) if any(kind != types[0] for kind in types) else ()
        spec.tile_width, spec.tile_height, spec.tile_depth = own.tile_width, own.tile_height, own.tile_depth
        stored = functools.reduce(merged_type, types)
        return Part(part.name, spec, result.fetch, stored, part.native, levels=tuple(map(chosen, part.levels)))

    return Image(tuple(map(chosen, image.parts)), image.source)


def _retyped(image: Image, kind: oiio.TypeDesc) -> Image:
    """The image as if its file had another pixel type."""

    def retyped(part: Part) -> Part:
        spec = oiio.ImageSpec(part.spec)
        spec.set_format(kind)

        def fetch(window: Window) -> np.ndarray:
            return pixels_of(part.buffer(window), kind, window.roi(spec.nchannels))

        return Part(part.name, spec, fetch, part.stored, native=True)

    return Image(tuple(map(retyped, image.parts)), image.source)


def _substitute(chain: Chain, path: str, given: ReadModifiers, error: ImageError) -> Image:
    """The image that --missingfile substitutes for a file that cannot be read."""
    policy = chain.settings.get("--missingfile", "error")
    if policy == "error":
        raise error
    log.warning("%s; using %s instead", error, policy)
    like = dict(chain.frame.likes).get(path) if chain.frame else None
    if like is not None:
        parts = _as_asked(chain, chain.opened(like), given).parts
        return Image(tuple(_drawn(part.spec, policy) for part in parts), policy)
    return Image((_drawn(chain.first.spec or oiio.ImageSpec(1920, 1080, 4, oiio.FLOAT), policy),), policy)


def _drawn(like: oiio.ImageSpec, policy: str) -> Part:
    """A part of the windows, channels and color space of another, black or checkered; written in the type of others."""
    spec = oiio.ImageSpec(1, 1, 1, oiio.FLOAT)
    spec.copy_dimensions(like)
    spec.set_format(oiio.FLOAT)
    spec.tile_width = spec.tile_height = 0
    spec.channelnames = like.channelnames
    spec.alpha_channel, spec.z_channel, spec.deep = like.alpha_channel, like.z_channel, False
    for name in _OF_SEQUENCES:
        if (value := like.getattribute(name)) is not None:
            spec.attribute(name, value)
    buffer = oiio.ImageBuf(spec)
    if policy == "checker":
        dark, light = (0.0, 0.0, 0.0, 1.0), (1.0, 1.0, 1.0, 1.0)
        oiio.ImageBufAlgo.checker(buffer, 64, 64, 1, dark, light)
    return dataclasses.replace(in_memory(like.get_string_attribute("oiio:subimagename"), buffer), stored=None)


def _prepare(chain: Chain, path: str, given: ReadModifiers) -> None:
    """Apply --autoorient, --autocc and the like to an image that has been read."""
    if given.get_thumbnail:
        from ..stack.moves import ThumbnailModifiers, thumbnail

        thumbnail(chain, ThumbnailModifiers(given.fail, given.index))
    if chain.settings.get("--autoorient"):
        from ...host.spatial.placing import Reorient

        chain.apply(Reorient)
    automatic = chain.session.settings.autocc if given.autocc is None else given.autocc
    if automatic:
        _to_linear(chain, path, given.unpremult)


def _to_linear(chain: Chain, path: str, unpremult: bool) -> None:
    """Convert to scene linear from the color space in the file's name, else in its metadata (--autocc)."""
    from ...host.color import ColorConvert

    colors = chain.session.resources.color
    spec = chain.top.first.spec
    space = colors.space_in_name(path) or spec.get_string_attribute("oiio:ColorSpace") or colors.described(spec)
    linear = colors.linear
    if space and linear and not colors.same(space, linear):
        chain.apply(ColorConvert, from_space=space, to_space=linear, strict=False, unpremult=unpremult)


def missing_file(chain: Chain, policy: str) -> None:
    """Set the substitute for files that cannot be read: error (none), black or checker."""
    if policy not in ("error", "black", "checker"):
        raise ParameterError(f"'{policy}': expected error, black or checker")
    chain.settings["--missingfile"] = policy


def input_attribute(chain: Chain, name: str, text: str, given: SetModifiers) -> None:
    """Set a hint for the reader of the next file; an empty VALUE removes it."""
    config = chain.settings.setdefault("--iconfig", oiio.ImageSpec())
    if text:
        set_attribute(config, name, text, given.type)
    else:
        config.erase_attribute(name)


def test_read(chain: Chain, path: str) -> None:
    """Read a file and discard it, to test that it is readable."""
    image = chain.opened(path)
    if not chain.acts(*image.parts):
        return
    for part in image.parts:
        for window in part.window.cells(part.spec.width, 64):
            part.read(window)
    print(f"OK {path}")


def native_types(chain: Chain) -> None:
    """Let ops work on the pixel type of the file instead of float."""
    chain.settings["--native"] = True
    for n, image in enumerate(chain.stack):
        waits = [part.depth == 0 and part.stored is not None for part in image.parts]
        parts = [dataclasses.replace(p, native=True) if w else p for p, w in zip(image.parts, waits, strict=True)]
        chain.stack[n] = Image(tuple(parts), image.source)


@dataclass(frozen=True)
class AutoccModifiers:
    """Modifiers of --autocc."""

    unpremult: bool = param(False, help="Unpremultiply colors for the conversion.")


def autocc_on(chain: Chain, given: AutoccModifiers) -> None:
    """Convert from and to the color spaces that the config's file rules assign to file names."""
    chain.session.change(autocc=True)
    chain.settings["--autocc unpremult"] = given.unpremult


_ALL_PARTS = "Let ops work on all parts (subimages) instead of the first only"
OPTIONS = (
    Option("-i FILE", read_input, ReadModifiers),
    Option("--iconfig NAME VALUE", input_attribute, SetModifiers, state=True),
    Option("--missingfile POLICY", missing_file, state=True),
    Option("--testread FILE", test_read, state=True),
    Option("-a", lambda chain: chain.session.change(all_parts=True), text=_ALL_PARTS, state=True),
    Option("--native", native_types, state=True),
    state("--no-autopremult", "Keep unassociated alpha: do not premultiply colors by it"),
    state(
        "--autopremult",
        "Premultiply colors by unassociated alpha (default)",
        sets=("--no-autopremult", False),
    ),
    state("--autoorient", "Rotate images upright as they are read", "--auto-orient"),
    Option("--autocc", autocc_on, AutoccModifiers, state=True),
    Option("--noautocc", lambda chain: chain.session.change(autocc=False), text="End --autocc", state=True),
)
