# SPDX-License-Identifier: Apache-2.0
"""Options for the stack, and for parts (subimages) and MIP levels of images."""

from __future__ import annotations

import dataclasses
import re
from dataclasses import dataclass

from ....engine.core.demand import cached
from ....engine.core.image import Image, Part, copied, derived_spec, in_memory
from ....engine.core.parameters import param
from ....engine.core.window import Window
from ....engine.deferred import oiio
from ....engine.errors import ImageError, ParameterError
from ..language.parse import Option, whole_number
from .chain import Chain


def label(chain: Chain, name: str) -> None:
    """Name the top image; NAME as an input pushes it again."""
    if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name):
        raise ParameterError(f"'{name}': expected a label of letters, digits and _")
    chain.labeled[name] = chain.stack[-1] = _cached(chain, chain.top)


def duplicate(chain: Chain) -> None:
    """Push a copy of the top image."""
    chain.stack[-1] = _cached(chain, chain.top)
    chain.push(chain.top)


def _cached(chain: Chain, image: Image) -> Image:
    """The image with cached pixels, for repeated use."""
    return Image(tuple(cached(part, chain.session.resources.cache) for part in image.parts), image.source)


def extract(chain: Chain, text: str) -> None:
    """Move the image at depth INDEX to the top; 0 is the top."""
    index = whole_number(text)
    chain.image(index)
    chain.push(chain.stack.pop(len(chain.stack) - 1 - index))


@dataclass(frozen=True)
class SubimageModifiers:
    """Modifiers of --subimage."""

    delete: bool = param(False, help="Remove that part and keep the others.")


def subimage(chain: Chain, which: str, given: SubimageModifiers) -> None:
    """Keep one part (subimage), by number or name."""
    image = chain.top
    names = [part.spec.get_string_attribute("oiio:subimagename") for part in image.parts]
    if re.fullmatch(r"\d+", which) and int(which) < len(names):
        index = int(which)
    elif which in names:
        index = names.index(which)
    else:
        has = ", ".join(f"{n} {name}".strip() for n, name in enumerate(names))
        raise ParameterError(f"{image.source} has no part '{which}': expected one of {has}")
    if len(names) == 1:
        if given.delete:
            raise ParameterError(f"cannot delete the only part of {image.source}")
        return
    kept = image.parts[:index] + image.parts[index + 1 :] if given.delete else (image.parts[index],)
    chain.stack[-1] = Image(kept, image.source)


def split_parts(chain: Chain) -> None:
    """Split the top image into one image per part."""
    image = chain.pop()
    for part in image.parts:
        chain.push(Image((part,), image.source))


@dataclass(frozen=True)
class AppendModifiers:
    """Modifiers of --siappend."""

    n: int = param(2, ge=2, le=1 << 20, help="Number of images.")


def append_parts(chain: Chain, given: AppendModifiers) -> None:
    """Join the top two images, or the top n, as parts of one image."""
    if given.n > len(chain.stack):
        raise ParameterError(f"n={given.n}: the stack has {len(chain.stack)} images")
    images = chain.stack[-given.n :]
    parts = [part for image in images for part in image.parts]
    del chain.stack[-given.n :]
    chain.push(Image(_distinct(parts), images[0].source))


def _distinct(parts: list[Part]) -> tuple[Part, ...]:
    """The parts with unique names."""
    taken: set[str] = set()
    named = []
    for n, part in enumerate(parts):
        name = part.spec.get_string_attribute("oiio:subimagename") or part.name
        if name in taken or (re.fullmatch(r"part\d+", name) and name != f"part{n}"):
            name = f"part{n}"
        taken.add(name)
        named.append(dataclasses.replace(part, name=name))
    return tuple(named)


def append_all(chain: Chain) -> None:
    """Join all images as parts of one image."""
    if len(chain.stack) > 1:
        append_parts(chain, AppendModifiers(len(chain.stack)))


def split_layers(chain: Chain) -> None:
    """Split the top image into one image per layer: channels that share the name before the dot."""
    image = chain.pop()
    names = list(image.first.spec.channelnames)
    layers = [
        name.rpartition(".")[0] if name.count(".") == 1 else name.partition(".")[0] * ("." in name) for name in names
    ]
    begin = 0
    for end in range(1, len(names) + 1):
        if end == len(names) or layers[end] != layers[begin]:
            chain.push(Image((_layer(image.first, begin, end, layers[begin]),), image.source))
            begin = end


def _layer(part: Part, begin: int, end: int, name: str) -> Part:
    """Channels of a part, without the layer's name in theirs."""
    bare = [channel.removeprefix(f"{name}.") if name else channel for channel in part.spec.channelnames[begin:end]]

    def narrow(spec: oiio.ImageSpec) -> None:
        spec.nchannels = end - begin
        spec.channelnames = tuple(bare)
        spec.alpha_channel = next((n for n, c in enumerate(bare) if c.lower() in ("a", "alpha")), -1)
        spec.z_channel = next((n for n, c in enumerate(bare) if c.lower() in ("z", "depth")), -1)
        spec.attribute("oiio:subimagename", name)

    own = part.spec.channelformats[begin:end]
    changed = part.respecced(narrow).spec
    changed.channelformats = own
    layer = copied(changed, lambda window: part.read(window)[..., begin:end], part)
    return dataclasses.replace(layer, name=name or part.name)


def without_levels(chain: Chain) -> None:
    """Keep the largest level of a MIP-mapped image."""
    image = chain.top
    if any(part.levels for part in image.parts):
        parts = tuple(_copied(dataclasses.replace(part, levels=())) for part in image.parts)
        chain.stack[-1] = Image(parts, image.source)


def _copied(part: Part) -> Part:
    """The part as a computed one, without a file."""
    spec = oiio.ImageSpec(part.spec)
    for name in ("oiio:miplevels", "oiio:subimages"):
        spec.erase_attribute(name)
    same = copied(spec, part.fetch, part)
    return dataclasses.replace(same, ready=part.ready, depth=part.depth, title=part.title)


def select_level(chain: Chain, text: str) -> None:
    """Keep one level of a MIP-mapped image; 0 is the largest."""
    image, level = chain.top, whole_number(text)
    if not any(part.levels for part in image.parts):
        return
    parts = []
    for part in image.parts:
        levels = (part, *part.levels)
        if level >= len(levels):
            raise ParameterError(f"{image.source} has no MIP level {level}: expected 0 to {len(levels) - 1}")
        parts.append(dataclasses.replace(levels[level], levels=()))
    chain.stack[-1] = Image(tuple(parts), image.source)


@dataclass(frozen=True)
class ThumbnailModifiers:
    """Modifiers of --thumbnail-get."""

    fail: bool = param(True, help="Error for images without a thumbnail. 0: the image itself is scaled down.")
    index: int = param(0, ge=0, le=0, help="Number of the thumbnail. OpenImageIO reads only the first.")


def thumbnail(chain: Chain, given: ThumbnailModifiers) -> None:
    """Replace the top image by the thumbnail in its file."""
    image = chain.top
    part = image.first
    if part.thumbnail is not None:
        chain.stack[-1] = Image((in_memory("part0", part.thumbnail()),), image.source)
    elif given.fail:
        raise ImageError(f"{image.source}: expected an image with a thumbnail; add fail=0 to make one")
    else:
        chain.stack[-1] = Image((_thumbnail_of(chain, part),), image.source)


def _thumbnail_of(chain: Chain, part: Part) -> Part:
    """The display window, scaled to fit 256x256 pixels."""
    from ...host.kinds import checked, once

    spec = oiio.ImageSpec(part.spec)
    chain.session.resources.require(4 * spec.width * spec.height * spec.nchannels, "--thumbnail-get:fail=0")
    scale = min(1.0, 256 / max(spec.full_width, spec.full_height))
    spec.full_width, spec.full_height = (max(1, int(s * scale + 0.5)) for s in (spec.full_width, spec.full_height))
    whole = Window.sized(0, 0, spec.full_width, spec.full_height)
    spec.full_x = spec.full_y = 0

    def resized(_: Part) -> Part:
        buffer = oiio.ImageBufAlgo.resize(part.buffer(part.window), roi=whole.roi(spec.nchannels))
        return in_memory(part.name, checked(buffer))

    small = derived_spec(whole.apply_to(spec))
    small.set_format(part.working_type)
    return once(Part(part.name, small, part.fetch), resized)


def attach_thumbnail(chain: Chain) -> None:
    """Make the top image the thumbnail of the image below it."""
    small, image = chain.pop(), chain.pop()

    def describe(spec: oiio.ImageSpec) -> None:
        for name in ("width", "height", "nchannels"):
            spec.attribute(f"thumbnail_{name}", getattr(small.first.spec, name))

    part = small.first
    first = dataclasses.replace(image.first.respecced(describe), thumbnail=lambda: part.buffer(part.window))
    chain.push(Image((first, *image.parts[1:]), image.source))
    chain.unwritten = True


OPTIONS = (
    Option("--label NAME", label, needs=1),
    Option("--dup", duplicate, needs=1),
    Option("--swap", lambda chain: chain.stack.insert(-1, chain.pop()), text="Swap the two top images", needs=2),
    Option("--pop", lambda chain: chain.pop(), text="Pop the top image", needs=1),
    Option("--popbottom", lambda chain: chain.stack.pop(0), text="Remove the bottom image", needs=1),
    Option("--stackreverse", lambda chain: chain.stack.reverse(), text="Reverse the stack", needs=1),
    Option("--stackextract INDEX", extract, needs=1),
    Option("--stackclear", lambda chain: chain.stack.clear(), text="Remove all images"),
    Option("--subimage PART", subimage, SubimageModifiers, needs=1),
    Option("--sisplit", split_parts, needs=1),
    Option("--siappend", append_parts, AppendModifiers, needs=2),
    Option("--siappendall", append_all, needs=1),
    Option("--layersplit", split_layers, needs=1, flat=True),
    Option("--unmip", without_levels, needs=1),
    Option("--selectmip LEVEL", select_level, needs=1),
    Option("--thumbnail-get", thumbnail, ThumbnailModifiers, needs=1),
    Option("--thumbnail-set", attach_thumbnail, needs=2),
)
