# SPDX-License-Identifier: Apache-2.0
"""Channels: choosing, naming, summing, mapping; the ids of Cryptomatte."""

from __future__ import annotations

import dataclasses
import functools
import logging
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from ..core.image import Image, Part, pixels_of
from ..core.parameters import Numbers, argument, image, param
from ..core.window import Window
from ..deferred import np, oiio
from ..errors import ParameterError
from ..session import Session
from .arithmetic import per_channel
from .kinds import OneImage, PointOp, Respec, filled, like, op, pointwise

log = logging.getLogger("oiiotex")

_DEFAULT_NAMES = ("R", "G", "B", "A", "Z")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_MAPS = (
    "inferno", "viridis", "magma", "turbo", "plasma", "blue-red", "red-blue", "bluered", "redblue", "spectrum", "heat",
)  # fmt: skip


class Chosen(NamedTuple):
    """A channel of a result: which one of the image it is, or a constant; and its name."""

    source: int | float
    name: str


def chosen_channels(text: str, names: Sequence[str]) -> list[Chosen]:
    """What a list of channels means for an image with channels of those names; raises ParameterError for an empty one.

    With commas: NAME or NUMBER (that channel), NEW=NAME (under another name), NEW=VALUE and =VALUE (a constant). A
    name or number that is not there gives zeros. RGB and RGBA stand for R,G,B and R,G,B,A.
    """
    words = {"RGB": "R,G,B", "RGBA": "R,G,B,A"}.get(text, text).split(",")
    if len(words) > 1 and not words[-1].strip():
        words.pop()
    if not any(word.strip() for word in words):
        raise ParameterError(f"'{text}' names no channel")
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
    same += [n for n, name in enumerate(names) if name.lower() == old.lower()]  # in other letters
    if not same:
        log.warning("there is no channel '%s', it is filled with 0; there is %s", old, ", ".join(names))
        return Chosen(0.0, new or default)
    return Chosen(same[0], new or names[same[0]])


@dataclass(frozen=True, kw_only=True)
class ChosenChannels(OneImage):
    """Some channels, in some order."""

    deep: ClassVar[bool] = True

    def chosen(self, spec: oiio.ImageSpec) -> list[Chosen]:
        """The channels of the result."""
        raise NotImplementedError

    def idle(self, parts: Sequence[Part]) -> bool:
        """Whether all channels stay as they are."""
        return all(
            self.chosen(part.spec) == [Chosen(n, name) for n, name in enumerate(part.spec.channelnames)]
            for part in parts
        )

    def result(self, parts: Sequence[Part], session: Session) -> Part:
        """The result, not yet computed."""
        chosen = self.chosen(parts[0].spec)
        order, names = tuple(c.source for c in chosen), tuple(c.name for c in chosen)
        return pointwise(parts, parts[0].window, lambda source: oiio.ImageBufAlgo.channels(source, order, names))


@dataclass(frozen=True, kw_only=True)
class Channels(ChosenChannels):
    """Choose, reorder, rename or add channels."""

    name: ClassVar[str] = "ch"

    channels: str = argument(help="with commas: NAME, NUMBER, NEW=NAME, NEW=VALUE, =VALUE; what is not there is 0")

    def chosen(self, spec: oiio.ImageSpec) -> list[Chosen]:
        """As the list says."""
        return chosen_channels(self.channels, spec.channelnames)


def _append(*buffers: oiio.ImageBuf) -> oiio.ImageBuf:
    """All channels; appended from the top of the stack down, on which the names of equal ones depend."""
    *images, _ = buffers
    return functools.reduce(lambda appended, below: oiio.ImageBufAlgo.channel_append(below, appended), images[::-1])


@dataclass(frozen=True, kw_only=True)
class ChannelNames(Respec):
    """Rename the channels."""

    name: ClassVar[str] = "chnames"

    names: str = argument(help="the names, with commas; where one is empty or left out the channel keeps its own")

    def called(self, spec: oiio.ImageSpec) -> None:
        """Under their new names, which say what is alpha and what is depth."""
        given = self.names.split(",")[: spec.nchannels]
        names = [new or old for new, old in zip(given, spec.channelnames, strict=False)]
        spec.channelnames = (*names, *spec.channelnames[len(names) :])
        kinds = [name.lower().rpartition(".")[2] for name in spec.channelnames]
        spec.alpha_channel = max((n for n, kind in enumerate(kinds) if kind in ("a", "alpha")), default=-1)
        spec.z_channel = max((n for n, kind in enumerate(kinds) if kind in ("z", "depth")), default=-1)

    def renamed(self) -> dict[str, str]:
        """The names that are given, by which the first file may have a channel of another type."""
        given = zip(self.names.split(","), self.source.first.spec.channelnames, strict=False)
        return {new: old for new, old in given if new}


@dataclass(frozen=True, kw_only=True)
class FromChannels(OneImage):
    """New channels made of all: of the image's metadata OpenImageIO keeps none, and the display window is lost."""

    def result(self, parts: Sequence[Part], session: Session) -> Part:
        """The result, not yet computed."""
        part = super().result(parts, session)
        spec = oiio.ImageSpec(part.spec)
        Window.data(spec).show_in(spec)
        return dataclasses.replace(part, spec=spec)


def _sum(source: oiio.ImageBuf, weight: Numbers) -> oiio.ImageBuf:
    """The weighted sum."""
    return oiio.ImageBufAlgo.channel_sum(source, per_channel(weight, source.nchannels, 1.0))


@dataclass(frozen=True, kw_only=True)
class ColorMap(FromChannels):
    """Show values in color: the luma of three channels or more, else the first channel."""

    name: ClassVar[str] = "colormap"

    map: str = argument(help=f"{', '.join(_MAPS)}, or colors at equal distances: R,G,B,R,G,B,...")

    def __post_init__(self) -> None:
        super().__post_init__()
        words = [word.strip() for word in self.map.split(",")]
        if self.map not in _MAPS and (not all(map(_NUMBER.fullmatch, words)) or len(words) < 6 or len(words) % 3):
            raise ParameterError(f"map={self.map}: allowed is {', '.join(_MAPS)}, or two colors R,G,B or more")

    def apply(self, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """The colors of the map."""
        if self.map in _MAPS:
            return oiio.ImageBufAlgo.color_map(buffers[0], -1, self.map)
        knots = tuple(map(float, self.map.split(",")))
        return oiio.ImageBufAlgo.color_map(buffers[0], -1, len(knots) // 3, 3, knots)


CHANNELS = (
    Channels,
    op("nchannels", "Keep the first channels, or add channels of 0.", ChosenChannels,
       chosen=lambda use, spec: [_chosen(str(n), n, spec.channelnames) for n in range(use.count)],
       count=(int, argument(ge=1, le=1 << 16, help="how many channels the result has"))),
    op("chappend", "Append the channels of the last images to each other.", PointOp, _append,
       arity=classmethod(lambda cls, values, depth: values.get("n", 2)),
       sources=(tuple[Image, ...], image(help="the images, in the order of the result's channels")),
       n=param(2, ge=2, le=1 << 16, help="how many images")),
    ChannelNames,
    op("chsum", "Sum the channels into one.", FromChannels, _sum,
       weight=param(Numbers((1.0,)), help="a weight for all channels, or for each; 1 for further ones")),
    op("maxchan", "Take the largest of the channels.", FromChannels),
    op("minchan", "Take the smallest of the channels.", FromChannels),
    ColorMap,
)  # fmt: skip


# --- Cryptomatte ---


def _id_colors(source: oiio.ImageBuf, layer: str) -> oiio.ImageBuf:
    """A color for each id, by its coverage."""
    pattern = re.compile(re.escape(layer) + r"\d\d\..*", re.ASCII)
    names = source.spec().channelnames
    ranks = [n for n, name in enumerate(names) if pattern.fullmatch(name)]
    if not ranks:
        raise ParameterError(f"layer={layer}: the image has no channels {layer}00.R ...; it has {', '.join(names)}")
    values = pixels_of(source, oiio.FLOAT)
    color = np.zeros((*values.shape[:-1], 3), np.float32)
    for identity, coverage in zip(ranks[::2], ranks[1::2], strict=False):
        code, alpha = np.ascontiguousarray(values[..., identity]), values[..., coverage]
        seen = ~(alpha < 1.0e-5) & (code != 0)
        scrambled = _scrambled(code.view(np.uint32))
        for channel, salt in enumerate((0, 0x0101, 0x020000)):
            scrambled = _scrambled(scrambled + np.uint32(salt)) if channel else scrambled
            shade = scrambled.astype(np.float32) * np.float32(1.0 / 0xFFFFFFFF)
            color[..., channel] += np.where(seen, alpha * shade, np.float32(0))
    spec = like(source.spec(), nchannels=3, channelnames=("R", "G", "B"), alpha_channel=-1, z_channel=-1)
    return filled(spec, color)


def _scrambled(code: np.ndarray) -> np.ndarray:
    """uint32 -> uint32: the finishing step of MurmurHash3, in which every bit depends on every other."""
    code = (code ^ (code >> np.uint32(16))) * np.uint32(0x85EBCA6B)
    code = (code ^ (code >> np.uint32(13))) * np.uint32(0xC2B2AE35)
    return code ^ (code >> np.uint32(16))


CRYPTOMATTE = op(
    "cryptomatte-colors", "Show the ids of a Cryptomatte layer as colors.", OneImage, _id_colors,
    layer=(str, argument(help="name of the layer: its channels are NAME00.R and so on")),
)  # fmt: skip
