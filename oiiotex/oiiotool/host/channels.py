# SPDX-License-Identifier: Apache-2.0
"""Channels: select, rename, sum and color-map."""

from __future__ import annotations

import dataclasses
import functools
import logging
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

from ...engine.color.lens import in_type
from ...engine.core.image import IDS, Image, Part, copied, cropped, dtype_of, pixels_of, unrounded
from ...engine.core.parameters import Numbers, argument, image, param
from ...engine.core.window import Window
from ...engine.deferred import np, oiio
from ...engine.errors import ParameterError
from ...engine.io.reading import FilePixels
from ...engine.session.facts import Facts
from .arithmetic import per_channel
from .kinds import OneImage, PointOp, Respec, op, pointwise

log = logging.getLogger("oiiotex")

_DEFAULT_NAMES = ("R", "G", "B", "A", "Z")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_MAPS = (
    "inferno", "viridis", "magma", "turbo", "plasma", "blue-red", "red-blue", "bluered", "redblue", "spectrum", "heat",
)  # fmt: skip


class Chosen(NamedTuple):
    """A channel of the result: the index of the image's channel or a constant, and its name."""

    source: int | float
    name: str


def chosen_channels(text: str, names: Sequence[str]) -> list[Chosen]:
    """The channels that a list selects from an image with channels of these names; ParameterError for an empty list.

    Comma-separated: NAME or NUMBER (that channel), NEW=NAME (renamed), NEW=VALUE and =VALUE (a constant). A missing
    channel becomes 0. RGB and RGBA stand for R,G,B and R,G,B,A.
    """
    words = {"RGB": "R,G,B", "RGBA": "R,G,B,A"}.get(text, text).split(",")
    if len(words) > 1 and not words[-1].strip():
        words.pop()
    if not any(word.strip() for word in words):
        raise ParameterError(f"'{text}'", expected="a comma-separated list of channels")
    return [_chosen(word.strip(), place, names) for place, word in enumerate(words)]


def _chosen(word: str, place: int, names: Sequence[str]) -> Chosen:
    default = _DEFAULT_NAMES[place] if place < len(_DEFAULT_NAMES) else f"channel{place}"
    if re.fullmatch(r"\d+", word):
        index = int(word)
        return Chosen(index, names[index]) if index < len(names) else Chosen(0.0, default)
    new, equals, old = word.rpartition("=") if word.startswith("=") else word.partition("=")
    if not equals:
        new, old = "", word
    new, old = new.strip(), old.strip()
    if equals and _NUMBER.fullmatch(old):
        return Chosen(float(old), new or default)
    if not old:
        return Chosen(0.0, new or default)
    same = [n for n, name in enumerate(names) if name == old]
    same += [n for n, name in enumerate(names) if name.lower() == old.lower()]  # in another case
    if not same:
        log.warning("no channel '%s' among %s: it is filled with 0", old, ", ".join(names))
        return Chosen(0.0, new or default)
    return Chosen(same[0], new or names[same[0]])


@dataclass(frozen=True, kw_only=True)
class ChosenChannels(OneImage):
    """Selected channels, in any order."""

    mixes: ClassVar[bool] = False
    deep: ClassVar[bool] = True

    def chosen(self, spec: oiio.ImageSpec) -> list[Chosen]:
        """The channels of the result."""
        raise NotImplementedError

    def idle(self, parts: Sequence[Part]) -> bool:
        """Whether the channels do not change."""
        return all(
            self.chosen(part.spec) == [Chosen(n, name) for n, name in enumerate(part.spec.channelnames)]
            for part in parts
        )

    def result(self, parts: Sequence[Part], facts: Facts) -> Part:
        """The result, not yet computed."""
        part, chosen = parts[0], self.chosen(parts[0].spec)
        order, names = tuple(c.source for c in chosen), tuple(c.name for c in chosen)
        made = pointwise(parts, part.window, lambda source: oiio.ImageBufAlgo.channels(source, order, names))
        ids = part.exact or str(part.spec.format) in IDS
        if part.spec.deep or not (ids or all(isinstance(c, int) or c in (0.0, 1.0) for c in order)):
            return made
        kinds = [part.spec.channelformat(c) if isinstance(c, int) else part.spec.format for c in order]
        spec = oiio.ImageSpec(made.spec)
        spec.set_format(kinds[0] if _wide(kinds) and len(set(map(str, kinds))) == 1 else part.spec.format)
        spec.channelformats = tuple(kinds) if len(set(map(str, kinds))) > 1 else ()
        whole = copied(spec, lambda window: _gathered(part, order, spec, window), part)
        return dataclasses.replace(whole, stored=spec.format) if str(spec.format) in IDS and part.stored else whole


def _wide(kinds: Sequence[oiio.TypeDesc]) -> bool:
    """Whether one of the types has values that floats cannot hold."""
    return any(str(kind) in (*IDS, "double") for kind in kinds)


def _gathered(part: Part, order: Sequence[int | float], spec: oiio.ImageSpec, window: Window) -> np.ndarray:
    """Channels of a part and constants, in the type of `spec`; only these are read of a file with ids."""
    file = part.fetch if isinstance(part.fetch, FilePixels) and _wide(part.spec.channelformats) else None
    pixels = np.empty(0) if file else part.read(window)
    out = np.empty((window.height, window.width, len(order)), dtype_of(spec))
    for place, source in enumerate(order):
        if not isinstance(source, int):
            out[..., place] = in_type(np.array(source, np.float32), out.dtype)
            continue
        plane = file.alone(source)(window)[..., 0] if file else pixels[..., source]
        out[..., place] = plane if plane.dtype == out.dtype else unrounded(plane)
    return out


@dataclass(frozen=True, kw_only=True)
class Channels(ChosenChannels):
    """Select, reorder, rename or add channels."""

    name: ClassVar[str] = "ch"

    channels: str = argument(
        help="Comma-separated channels: NAME, NUMBER, NEW=NAME (renamed), NEW=VALUE or =VALUE (a constant). Missing"
        " channels are filled with 0.",
        example="R,G,B,A=1",
    )

    def chosen(self, spec: oiio.ImageSpec) -> list[Chosen]:
        """The channels in the list."""
        return chosen_channels(self.channels, spec.channelnames)


@dataclass(frozen=True, kw_only=True)
class ChannelAppend(PointOp):
    """Append the channels of the last two or more images."""

    name: ClassVar[str] = "chappend"
    spares: ClassVar[bool] = True

    sources: tuple[Image, ...] = image(help="Images, in the order of the channels in the result.")
    n: int = param(2, ge=2, le=1 << 16, help="Number of images.")

    @classmethod
    def arity(cls, values: dict[str, Any], depth: int) -> int:
        """The given number."""
        return int(values.get("n", 2))

    def apply(self, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """Appended from the top of the stack down: the names given to duplicates depend on that order."""
        return functools.reduce(lambda top, below: oiio.ImageBufAlgo.channel_append(below, top), buffers[::-1])

    def result(self, parts: Sequence[Part], facts: Facts) -> Part:
        """The result, not yet computed; channels of one type, and ids, are copied."""
        made = super().result(parts, facts)
        kinds = {str(part.spec.format) for part in parts}
        if len(kinds) > 1 and not kinds & set(IDS):
            return made
        spec = oiio.ImageSpec(made.spec)
        spec.set_format(parts[0].spec.format if len(kinds) == 1 else oiio.TypeDesc(oiio.FLOAT))
        own = [part.spec.channelformat(c) for part in parts for c in range(part.spec.nchannels)]
        spec.channelformats = tuple(own) if len(set(map(str, own))) > 1 else ()
        return copied(spec, lambda window: _side_by_side(parts, spec, window), *parts)


def _side_by_side(parts: Sequence[Part], spec: oiio.ImageSpec, window: Window) -> np.ndarray:
    """All channels of the parts in a window, in the type of `spec`."""
    planes = []
    for part in (cropped(part, window) for part in parts):
        ids = str(part.spec.format) in IDS
        planes.append(part.read(window) if ids or part.spec.format == spec.format
                      else pixels_of(part.buffer(window), spec.format))  # fmt: skip
    return np.concatenate(planes if len({p.dtype for p in planes}) == 1 else list(map(unrounded, planes)), axis=-1)


@dataclass(frozen=True, kw_only=True)
class ChannelNames(Respec):
    """Rename the channels."""

    name: ClassVar[str] = "chnames"

    names: str = argument(
        help="Comma-separated channel names. A channel whose entry is empty or missing keeps its name.",
        example="R,G,B,A",
    )

    def called(self, spec: oiio.ImageSpec) -> None:
        """Rename, and find alpha and depth by the new names."""
        given = self.names.split(",")[: spec.nchannels]
        names = [new or old for new, old in zip(given, spec.channelnames, strict=False)]
        spec.channelnames = (*names, *spec.channelnames[len(names) :])
        kinds = [name.lower().rpartition(".")[2] for name in spec.channelnames]
        spec.alpha_channel = max((n for n, kind in enumerate(kinds) if kind in ("a", "alpha")), default=-1)
        spec.z_channel = max((n for n, kind in enumerate(kinds) if kind in ("z", "depth")), default=-1)

    def renamed(self) -> dict[str, str]:
        """New names and the old ones, by which the first input file may hold a channel of another type."""
        given = zip(self.names.split(","), self.source.first.spec.channelnames, strict=False)
        return {new: old for new, old in given if new}


@dataclass(frozen=True, kw_only=True)
class FromChannels(OneImage):
    """New channels computed from all channels; OpenImageIO drops the metadata and the display window."""

    def result(self, parts: Sequence[Part], facts: Facts) -> Part:
        """The result, not yet computed."""
        part = super().result(parts, facts)
        spec = oiio.ImageSpec(part.spec)
        Window.data(spec).show_in(spec)
        return dataclasses.replace(part, spec=spec)


def _sum(source: oiio.ImageBuf, weight: Numbers) -> oiio.ImageBuf:
    """The weighted sum."""
    return oiio.ImageBufAlgo.channel_sum(source, per_channel(weight, source.nchannels, 1.0))


@dataclass(frozen=True, kw_only=True)
class ColorMap(FromChannels):
    """Visualize values with a color map: the luma of three or more channels, else the first channel."""

    name: ClassVar[str] = "colormap"

    map: str = argument(
        help=f"Color map: {', '.join(_MAPS)}, or a comma-separated list of RGB triples.", example="viridis"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        words = [word.strip() for word in self.map.split(",")]
        if self.map not in _MAPS and (not all(map(_NUMBER.fullmatch, words)) or len(words) < 6 or len(words) % 3):
            expected = f"one of {', '.join(_MAPS)}, or at least two R,G,B triples"
            raise ParameterError(parameter="map", value=self.map, expected=expected)

    def apply(self, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """The colors of the map."""
        if self.map in _MAPS:
            return oiio.ImageBufAlgo.color_map(buffers[0], -1, self.map)
        knots = tuple(map(float, self.map.split(",")))
        return oiio.ImageBufAlgo.color_map(buffers[0], -1, len(knots) // 3, 3, knots)


CHANNELS = (
    Channels,
    op("nchannels", "Set the number of channels: drop the last ones, or append channels of 0.", ChosenChannels,
       chosen=lambda use, spec: [_chosen(str(n), n, spec.channelnames) for n in range(use.count)],
       count=(int, argument(ge=1, le=1 << 16, help="Number of channels of the result."))),
    ChannelAppend,
    ChannelNames,
    op("chsum", "Sum all channels into one.", FromChannels, _sum,
       weight=param(Numbers((1.0,)), example="0.2126,0.7152,0.0722",
                    help="Weight of all channels, or one per channel. Channels without a weight get 1.")),
    op("maxchan", "Take the maximum of all channels.", FromChannels),
    op("minchan", "Take the minimum of all channels.", FromChannels),
    ColorMap,
)  # fmt: skip
