# SPDX-License-Identifier: Apache-2.0
"""Options that move images on the stack, and parts between images."""

from __future__ import annotations

import dataclasses
import re
from dataclasses import dataclass

from ..core.demand import cached
from ..core.image import Image, Part, from_buffer
from ..core.parameters import param
from ..deferred import oiio
from ..errors import ImageError, ParameterError
from .chain import Chain
from .parse import Option, whole_number


def label(chain: Chain, name: str) -> None:
    """Name the top image: it can be put on the stack again by that name."""
    if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name):
        raise ParameterError(f"'{name}' is no label: allowed are letters, digits and _")
    chain.labelled[name] = chain.stack[-1] = _cached(chain, chain.top)


def duplicate(chain: Chain) -> None:
    """Put the top image on the stack once more."""
    chain.stack[-1] = _cached(chain, chain.top)
    chain.push(chain.top)


def _cached(chain: Chain, image: Image) -> Image:
    """The image, whose computed pixels are kept for a while: they will be asked for more than once."""
    return Image(tuple(cached(part, chain.session.cache) for part in image.parts), image.source)


def swap(chain: Chain) -> None:
    """Exchange the two top images."""
    chain.stack[-2:] = chain.stack[:-3:-1]


def drop(chain: Chain) -> None:
    """Forget the top image."""
    chain.pop()


def drop_bottom(chain: Chain) -> None:
    """Forget the bottom image."""
    chain.stack.pop(0)


def reverse(chain: Chain) -> None:
    """Turn the stack over."""
    chain.stack.reverse()


def extract(chain: Chain, text: str) -> None:
    """Bring the image of that depth to the top."""
    index = whole_number(text)
    chain.image(index)
    chain.push(chain.stack.pop(len(chain.stack) - 1 - index))


def clear(chain: Chain) -> None:
    """Forget all images."""
    chain.stack.clear()


# --- parts and levels ---


@dataclass(frozen=True)
class SubimageModifiers:
    """Of --subimage."""

    delete: bool = param(False, help="drop that part and keep the others")


def subimage(chain: Chain, which: str, delete: bool = False) -> None:
    """Keep one part, by number or name."""
    image = chain.top
    names = [part.spec.get_string_attribute("oiio:subimagename") for part in image.parts]
    if re.fullmatch(r"\d+", which) and int(which) < len(names):
        index = int(which)
    elif which in names:
        index = names.index(which)
    else:
        has = ", ".join(f"{n} {name}".strip() for n, name in enumerate(names))
        raise ParameterError(f"{image.source} has no part '{which}'; it has {has}")
    if len(names) == 1:
        if delete:
            raise ParameterError(f"{image.source} has only one part")
        return
    kept = image.parts[:index] + image.parts[index + 1 :] if delete else (image.parts[index],)
    chain.stack[-1] = Image(kept, image.source)


def split_parts(chain: Chain) -> None:
    """Replace an image by one image for each part."""
    image = chain.pop()
    for part in image.parts:
        chain.push(Image((part,), image.source))


@dataclass(frozen=True)
class AppendModifiers:
    """Of --siappend."""

    n: int = param(2, ge=2, le=1 << 20, help="how many images")


def append_parts(chain: Chain, n: int = 2) -> None:
    """Make the last n images the parts of one."""
    if n > len(chain.stack):
        raise ParameterError(f"n={n}: there are {len(chain.stack)} images")
    images = chain.stack[-n:]
    parts = [part for image in images for part in image.parts]
    del chain.stack[-n:]
    chain.push(Image(_distinct(parts), images[0].source))


def _distinct(parts: list[Part]) -> tuple[Part, ...]:
    """The parts under names that differ."""
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
    """Make all images the parts of one."""
    if len(chain.stack) > 1:
        append_parts(chain, len(chain.stack))


def split_layers(chain: Chain) -> None:
    """Replace an image by one image for each layer: channels whose names begin alike, up to a dot."""
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
    """Some channels of a part, without the layer's name before theirs."""
    bare = [channel.removeprefix(f"{name}.") if name else channel for channel in part.spec.channelnames[begin:end]]

    def narrow(spec: oiio.ImageSpec) -> None:
        spec.nchannels = end - begin
        spec.channelnames = tuple(bare)
        spec.alpha_channel = next((n for n, c in enumerate(bare) if c.lower() in ("a", "alpha")), -1)
        spec.z_channel = next((n for n, c in enumerate(bare) if c.lower() in ("z", "depth")), -1)
        spec.attribute("oiio:subimagename", name)

    changed = part.respecced(narrow)
    return dataclasses.replace(
        changed, name=name or part.name, fetch=lambda window: part.read(window)[..., begin:end], stored=None
    )


def without_levels(chain: Chain) -> None:
    """Keep the largest version of a MIP-mapped image."""
    image = chain.top
    if any(part.levels for part in image.parts):
        parts = tuple(_copied(dataclasses.replace(part, levels=())) for part in image.parts)
        chain.stack[-1] = Image(parts, image.source)


def _copied(part: Part) -> Part:
    """The part as if an op had made it: as floats, and of no file any more."""
    spec = oiio.ImageSpec(part.spec)
    spec.set_format(part.working_type)
    for name in ("oiio:miplevels", "oiio:subimages"):
        spec.erase_attribute(name)
    return Part(part.name, spec, part.buffer, ready=part.ready, depth=part.depth, title=part.title)


def select_level(chain: Chain, text: str) -> None:
    """Keep one version of a MIP-mapped image, 0 the largest."""
    image, level = chain.top, whole_number(text)
    if not any(part.levels for part in image.parts):
        return
    parts = []
    for part in image.parts:
        levels = (part, *part.levels)
        if level >= len(levels):
            raise ParameterError(f"{image.source} has no MIP level {level}; it has {len(levels)}")
        parts.append(dataclasses.replace(levels[level], levels=()))
    chain.stack[-1] = Image(tuple(parts), image.source)


# --- thumbnails ---


@dataclass(frozen=True)
class ThumbnailModifiers:
    """Of --thumbnail-get."""

    fail: bool = param(True, help="an error where there is none; else a small version is made")
    index: int = param(0, ge=0, le=0, help="which thumbnail")


def thumbnail(chain: Chain, fail: bool = True, index: int = 0) -> None:
    """Replace an image by the thumbnail in its file."""
    image = chain.top
    file = oiio.ImageInput.open(image.source)
    small = file.get_thumbnail(0) if file is not None else None
    if small is not None and small.initialized:
        chain.stack[-1] = Image(from_buffer(small).parts, image.source)
    elif fail:
        raise ImageError(f"{image.source} has no thumbnail")
    else:
        from ..host.scaling import Resize

        longer = max(image.first.spec.full_width, image.first.spec.full_height)
        percent = min(100.0, 25600 / longer)
        chain.apply(Resize, size=f"{percent}%")


OPTIONS = (
    Option("--label", ("NAME",), "name the top image: naming it puts it on the stack again", label, needs=1),
    Option("--dup", (), "put the top image on the stack once more", duplicate, needs=1),
    Option("--swap", (), "exchange the two top images", swap, needs=2),
    Option("--pop", (), "forget the top image", drop, needs=1),
    Option("--popbottom", (), "forget the bottom image", drop_bottom, needs=1),
    Option("--stackreverse", (), "turn the stack over", reverse, needs=1),
    Option("--stackextract", ("INDEX",), "bring the image of that depth to the top, 0 the top", extract, needs=1),
    Option("--stackclear", (), "forget all images", clear),
    Option("--subimage", ("PART",), "keep one part, by number or name", subimage, SubimageModifiers, needs=1),
    Option("--sisplit", (), "replace an image by one for each of its parts", split_parts, needs=1),
    Option("--siappend", (), "make the last two images the parts of one", append_parts, AppendModifiers, needs=2),
    Option("--siappendall", (), "make all images the parts of one", append_all, needs=1),
    Option("--layersplit", (), "replace an image by one for each layer of channels", split_layers, needs=1),
    Option("--unmip", (), "keep the largest version of a MIP-mapped image", without_levels, needs=1),
    Option("--selectmip", ("LEVEL",), "keep one version of a MIP-mapped image, 0 the largest", select_level, needs=1),
    Option(
        "--thumbnail-get", (), "replace an image by the thumbnail in its file", thumbnail, ThumbnailModifiers, needs=1
    ),
)
