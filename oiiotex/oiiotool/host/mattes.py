# SPDX-License-Identifier: Apache-2.0
"""Cryptomatte: visualize its ids, and unfold mattes by name."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from ...engine.core.access import Pointwise
from ...engine.core.attributes import mark_as_data
from ...engine.core.image import Image, Part, cropped, pixels_of, spec_beside
from ...engine.core.op import Kind, Output, Plan
from ...engine.core.parameters import argument, image, param
from ...engine.core.window import Window
from ...engine.deferred import np, oiio
from ...engine.errors import ParameterError
from ...engine.io.cryptomatte import MatteLayer, coverages, layers_of, mattes_named, require_float_ids
from ...engine.io.owned import checked_name
from ...engine.session import Session
from ...engine.session.facts import Facts
from .kinds import Hosted, OneImage, filled, like

_MOST = 1024  # channels of a file that programs read


@dataclass(frozen=True, kw_only=True)
class CryptomatteColors(OneImage):
    """Visualize the ids of a Cryptomatte layer as colors."""

    name: ClassVar[str] = "cryptomatte-colors"
    spares: ClassVar[bool] = True

    layer: str = argument(help="Name of the layer, whose channels are NAME00.R and so on.", example="CryptoObject")

    def apply(self, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """One color per id, weighted by its coverage."""
        return _id_colors(buffers[0], self.layer)

    def result(self, parts: Sequence[Part], facts: Facts) -> Part:
        """The colors, not yet computed; ids in half are refused."""
        names, spec = re.compile(re.escape(self.layer) + r"\d\d\..*", re.ASCII), parts[0].spec
        own = [n for n, name in enumerate(spec.channelnames) if names.fullmatch(name)]
        require_float_ids(spec, own, self.source.source)
        return super().result(parts, facts)


def _id_colors(source: oiio.ImageBuf, layer: str) -> oiio.ImageBuf:
    """One color per id, weighted by its coverage."""
    pattern = re.compile(re.escape(layer) + r"\d\d\..*", re.ASCII)
    names = source.spec().channelnames
    ranks = [n for n, name in enumerate(names) if pattern.fullmatch(name)]
    if not ranks:
        hint = f"the image has {', '.join(names)}"
        raise ParameterError(f"no channels {layer}00.R ...", parameter="layer", value=layer, hint=hint)
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
    """uint32 -> uint32: the final mix of MurmurHash3, in which every bit depends on every other."""
    code = (code ^ (code >> np.uint32(16))) * np.uint32(0x85EBCA6B)
    code = (code ^ (code >> np.uint32(13))) * np.uint32(0xC2B2AE35)
    return code ^ (code >> np.uint32(16))


@dataclass(frozen=True, kw_only=True)
class CryptomatteUnfold(Hosted, Pointwise):
    """Unfold mattes of a Cryptomatte by name: one channel of coverage for each, or one file."""

    name: ClassVar[str] = "cryptomatte-unfold"
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("image", Kind.PIXELS, "Mattes, one per channel."),
        Output("matte.N", Kind.MASK, "One matte, in a separate file.", asked_by="folder"),
    )

    source: Image = image(help="Image with Cryptomatte channels in any part.")
    names: str = argument(
        help="Comma-separated names of objects with the wildcards * ? [], or ids of eight hexadecimal digits.",
        example="chair*,table",
    )
    layer: str = param("", unset="all layers", example="CryptoObject", help="Name of the Cryptomatte layer.")
    folder: str = param("", help="Folder for one EXR file per matte, called by its name.", example="mattes")

    def mattes(self) -> dict[str, list[tuple[MatteLayer, int]]]:
        """The mattes by name: the layers that have each, and its id."""
        layers = layers_of(self.source)
        chosen = [one for one in layers if one.name in ("", self.layer)] if self.layer else layers
        if not chosen:
            expected = f"one of {', '.join(one.name for one in layers)}"
            raise ParameterError("no such layer", parameter="layer", value=self.layer, expected=expected)
        return mattes_named(chosen, self.names)

    def asked(self, output: Output) -> bool | Path:
        """Whether the output is requested; the folder of its files."""
        return Path(self.folder) if self.folder and output.asked_by else not output.asked_by

    def files(self) -> dict[str, Path]:
        """A file for each matte; names of a hierarchy are joined, and others that could be a path are refused."""
        if not self.folder:
            return {}
        files: dict[str, str] = {}
        for name in self.mattes():
            file = "_".join(checked_name(each, "matte") for each in name.strip("/").split("/"))
            other = files.setdefault(file, name)
            if other != name:
                raise ParameterError(f"{other} and {name} would be the same file", hint="unfold one at a time")
        return {f"matte.{n}": Path(self.folder, f"{file}.exr") for n, file in enumerate(files, 1)}

    def plan(self, facts: Facts) -> Plan:
        """All mattes as channels, and each as a part."""
        mattes = self.mattes()
        if len(mattes) > _MOST and not self.folder:
            raise ParameterError(f"{len(mattes)} mattes", expected=f"at most {_MOST} channels", hint="add folder=NAME")
        results = {"image": _unfolded("mattes", dict(list(mattes.items())[:_MOST]))}
        if self.folder:
            results |= {f"matte.{n}": _unfolded(f"matte.{n}", {name: held})
                        for n, (name, held) in enumerate(mattes.items(), 1)}  # fmt: skip
        return Plan(results)

    def make(self, plan: Plan, session: Session) -> Any:
        """The mattes, not yet computed."""
        return plan.results


def _unfolded(name: str, mattes: Mapping[str, list[tuple[MatteLayer, int]]]) -> Part:
    """A part with the coverage of each matte as a channel; layers are in one display window."""
    first = next(iter(mattes.values()))[0][0].part
    places: dict[int, tuple[MatteLayer, list[int], list[int]]] = {}  # by layer: it, ids, channels
    for channel, held in enumerate(mattes.values()):
        for layer, bits in held:
            _, ids, channels = places.setdefault(id(layer), (layer, [], []))
            ids.append(bits)
            channels.append(channel)
    spec = spec_beside(first.spec, tuple(mattes) if len(mattes) > 1 else ("Y",))
    mark_as_data(spec)

    def fetch(window: Window) -> np.ndarray:
        out = np.zeros((window.height, window.width, len(mattes)), np.float32)
        for layer, ids, channels in places.values():
            there = dataclasses.replace(layer, part=cropped(layer.part, window))
            out[..., channels] += coverages(there, ids, window)
        return out

    return Part(name, spec, fetch, oiio.TypeDesc(oiio.FLOAT), typed=True)


CRYPTOMATTE = (CryptomatteColors, CryptomatteUnfold)
