# SPDX-License-Identifier: Apache-2.0
"""Label maps as Cryptomatte 1.2: compositors pick labels by clicking.

The specification is Psyop's (github.com/Psyop/Cryptomatte, specification/cryptomatte_specification.pdf). A label map
has one label per pixel, so one layer of two ranks is enough: the first is the label, its coverage 1, the second empty.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mmh3
import numpy as np
import OpenImageIO as oiio

from .images import Part
from .windows import Window


def hashed(name: str) -> int:
    """The 32 bits that stand for a name: MurmurHash3_x86_32, never the pattern of a float that is no number."""
    bits = mmh3.hash(name.encode(), 0, signed=False)
    exponent = bits >> 23 & 255
    return bits ^ 1 << 23 if exponent in (0, 255) else bits


@dataclass(frozen=True)
class Layer:
    """One matte of several objects.

    Attributes
    ----------
    name : str
        Of the layer; it must not end in a digit, which Blender strips.
    labels : Part
        One channel of ids.
    names : sequence of str
        Of the ids from 1 on.
    """

    name: str
    labels: Part
    names: Sequence[str]

    def bits(self) -> tuple[list[str], np.ndarray]:
        """Names and their hashes, (count,) uint32: a name whose hash is taken gets a mark until it is not."""
        names, taken = [], {0}
        bits = []
        for name in self.names:
            while (found := hashed(name)) in taken:
                name += "'"
            taken.add(found)
            names.append(name)
            bits.append(found)
        return names, np.array(bits, np.uint32)


def cryptomatte_part(
    layers: Sequence[Layer], manifest_file: str | None = None
) -> tuple[Part, dict[str, dict[str, str]]]:
    """One part of 32-bit floats with four channels per layer, and the manifests by layer.

    Parameters
    ----------
    layers : sequence of Layer
        Label maps of one image.
    manifest_file : str, optional
        Where the manifest will lie, as seen from the image; in the metadata when left out.
    """
    like = layers[0].labels
    spec = oiio.ImageSpec(like.spec)
    spec.nchannels = 4 * len(layers)
    spec.channelnames = tuple(f"{layer.name}00.{c}" for layer in layers for c in "RGBA")
    spec.set_format(oiio.FLOAT)
    spec.channelformats = ()
    spec.alpha_channel = -1
    spec.attribute("oiio:subimagename", "cryptomatte")
    tables, manifests = [], {}
    for layer in layers:
        names, bits = layer.bits()
        manifest = {name: f"{value:08x}" for name, value in zip(names, bits.tolist(), strict=True)}
        manifests[layer.name] = manifest
        tables.append(np.concatenate([np.zeros(1, np.uint32), bits]).view(np.float32))
        for name, value in _metadata(layer.name, manifest, manifest_file).items():
            spec.attribute(name, value)

    def fetch(window: Window) -> np.ndarray:
        out = np.zeros((window.height, window.width, 4 * len(layers)), np.float32)
        for n, (layer, table) in enumerate(zip(layers, tables, strict=True)):
            ids = layer.labels.read(window)[..., 0]
            out[..., 4 * n] = table[ids]
            out[..., 4 * n + 1] = ids > 0
        return out

    return Part("cryptomatte", spec, fetch, oiio.TypeDesc(oiio.FLOAT), ready=like.ready), manifests


def _metadata(name: str, manifest: Mapping[str, str], manifest_file: str | None) -> dict[str, str]:
    key = f"{mmh3.hash(name.encode(), 0, signed=False):08x}"[:7]
    found = {"name": name, "hash": "MurmurHash3_32", "conversion": "uint32_to_float32"}
    if manifest_file is None:
        found["manifest"] = json.dumps(manifest, separators=(",", ":"))
    else:
        found["manif_file"] = manifest_file
    return {f"cryptomatte/{key}/{k}": v for k, v in found.items()}
