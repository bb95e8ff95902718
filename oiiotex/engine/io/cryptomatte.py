# SPDX-License-Identifier: Apache-2.0
"""Cryptomatte 1.2: label maps are written as one, and the matte of an object is read.

The specification is Psyop's (github.com/Psyop/Cryptomatte, specification/cryptomatte_specification.pdf). A label map
has one label per pixel; its borders are softened (`covered`), and one layer of two ranks holds the two labels with the
largest coverage of each pixel.
"""

from __future__ import annotations

import difflib
import json
import re
from collections.abc import Iterable, Mapping, Sequence

import mmh3

from ..core.image import Image, Part
from ..core.label_map import LabelMap
from ..core.window import Window
from ..deferred import np, oiio
from ..errors import ImageError, ParameterError


def hashed(name: str) -> int:
    """The 32-bit hash of a name: MurmurHash3_x86_32, adjusted so that it is never a NaN, Inf or denormal float."""
    bits = mmh3.hash(name.encode(), 0, signed=False)
    exponent = bits >> 23 & 255
    return bits ^ 1 << 23 if exponent in (0, 255) else bits


def hashes(names: Iterable[str]) -> dict[str, int]:
    """Hashes by name: a name whose hash is taken gets apostrophes until its hash is unique."""
    taken: dict[int, str] = {0: ""}
    for name in names:
        while (bits := hashed(name)) in taken:
            name += "'"
        taken[bits] = name
    return {name: bits for bits, name in taken.items() if bits}


_AROUND = [(dy, dx) for dy in range(3) for dx in range(3)]
_WEIGHTS = (1, 2, 1, 2, 4, 2, 1, 2, 1)  # of `_AROUND`: a binomial filter one pixel wide


def covered(labels: Part, window: Window) -> tuple[np.ndarray, np.ndarray]:
    """The two labels with the largest coverage of each pixel, and the coverage: (h, w, 2) int64, (h, w, 2) float32.

    Labels are weighted over 3 x 3 pixels, so that a straight border falls off over two pixels. Pixels without a label
    (0) have no coverage and take none from their neighbors: transparency there is in the image's alpha. The two
    values are normalized to a sum of 1 where there is a label.
    """
    whole = labels.window
    around = window.grown(1, 1) & whole
    edges = [(around.top - window.top + 1, window.bottom + 1 - around.bottom),
             (around.left - window.left + 1, window.right + 1 - around.right)]  # fmt: skip
    ids = np.pad(labels.read(around)[..., 0].astype(np.int64), edges, "edge")
    height, width = window.height, window.width
    center = ids[1:-1, 1:-1]
    first = np.stack([center, np.zeros_like(center)], -1)
    shares = np.zeros((height, width, 2), np.float32)
    shares[..., 0] = center > 0
    seen = [ids[dy : dy + height, dx : dx + width] for dy, dx in _AROUND]
    border = (center > 0) & np.any([one != center for one in seen], axis=0)
    nine = np.stack([one[border] for one in seen], -1)
    weights = np.where(nine > 0, ((nine[:, :, None] == nine[:, None, :]) * np.array(_WEIGHTS, np.int64)).sum(-1), 0)
    rows = np.arange(len(nine))
    weights[:, 4] = 2 * weights[:, 4] + 1  # among equals the pixel's own label comes first
    weights[:, :4] *= 2
    weights[:, 5:] *= 2
    most = weights.argmax(1)
    best = nine[rows, most]
    rest = np.where(nine == best[:, None], 0, weights)
    next_best = rest.argmax(1)
    both = np.stack([weights[rows, most] // 2, rest[rows, next_best] // 2], -1).astype(np.float32)
    first[border] = np.stack([best, np.where(both[:, 1] > 0, nine[rows, next_best], 0)], -1)
    shares[border] = both / both.sum(-1, keepdims=True)
    return first, shares


def cryptomatte_part(
    maps: Sequence[LabelMap], manifest_file: str | None = None, image: Part | None = None
) -> tuple[Part, dict[str, str]]:
    """A part of 32-bit floats with four channels per label map, and the manifest (hashes in hex by name).

    Parameters
    ----------
    maps : sequence of LabelMap
        Label maps of one image.
    manifest_file : str, optional
        Path of a manifest file, relative to the image. Default: the manifest is in the metadata.
    image : Part, optional
        Part whose channels come first; the result then has no name. Renderers write Cryptomattes like this, and every
        compositor finds them.
    """
    like = maps[0].part
    spec = oiio.ImageSpec((image or like).spec)
    before = 0 if image is None else spec.nchannels
    layers = [f"label{labels.level}_" for labels in maps]  # Blender strips digits at the end
    names = spec.channelnames[:before] + tuple(f"{layer}00.{c}" for layer in layers for c in "RGBA")
    spec.nchannels, spec.channelnames = len(names), names
    spec.set_format(oiio.FLOAT)
    spec.channelformats = ()
    if image is None:
        spec.alpha_channel = -1
        spec.attribute("oiio:subimagename", "cryptomatte")
    else:
        spec.erase_attribute("name")
        spec.erase_attribute("oiio:subimagename")
    spec.erase_attribute("oiiotex:.*")  # describes only one of the label maps
    tables, whole = [], dict[str, str]()
    for layer, labels in zip(layers, maps, strict=True):
        bits = hashes(labels.name(label) for label in range(1, labels.count + 1))
        manifest = {name: f"{value:08x}" for name, value in bits.items()}
        whole |= manifest
        tables.append(np.array([0, *bits.values()], np.uint32).view(np.float32))
        for name, value in _metadata(layer, manifest, manifest_file).items():
            spec.attribute(name, value)

    def fetch(window: Window) -> np.ndarray:
        out = np.zeros((window.height, window.width, before + 4 * len(maps)), np.float32)
        if image is not None:
            pixels = image.read(window)
            out[..., :before] = pixels / np.float32(np.iinfo(pixels.dtype).max if pixels.dtype.kind in "ui" else 1)
        for n, (labels, table) in enumerate(zip(maps, tables, strict=True)):
            ids, shares = covered(labels.part, window)
            at = before + 4 * n
            out[..., at : at + 4 : 2] = table[ids]
            out[..., at + 1 : at + 4 : 2] = shares
        return out

    name = "cryptomatte" if image is None else image.name
    return Part(name, spec, fetch, oiio.TypeDesc(oiio.FLOAT), ready=like.ready), whole


def _metadata(name: str, manifest: Mapping[str, str], manifest_file: str | None) -> dict[str, str]:
    key = f"{mmh3.hash(name.encode(), 0, signed=False):08x}"[:7]
    facts = {"name": name, "hash": "MurmurHash3_32", "conversion": "uint32_to_float32"}
    if manifest_file is None:
        facts["manifest"] = json.dumps(manifest, separators=(",", ":"))
    else:
        facts["manif_file"] = manifest_file
    return {f"cryptomatte/{key}/{k}": v for k, v in facts.items()}


# --- reading ---

_RANK = re.compile(r"(.+?)(\d\d)\.(r|red)", re.IGNORECASE)
_FEW = 8  # names in a message


def coverage_of(image: Image, name: str) -> tuple[Window, np.ndarray]:
    """The matte of an object: the data window of its Cryptomatte, and its coverage there, (height, width) float32.

    Parameters
    ----------
    image : Image
        Image with Cryptomatte channels in any part, as float.
    name : str
        Name of the object, or its id: eight hexadecimal digits.

    Raises
    ------
    ImageError
        The image has no Cryptomatte.
    ParameterError
        No layer has the object; the message lists names of the manifest.
    """
    names, layers = list[str](), [(part, ranks) for part in image.parts if (ranks := _ranks(part))]
    if not layers:
        raise ImageError("has no Cryptomatte channels", subject=image.source, hint="name its file with mattes=")
    bits = {hashed(name)} | ({int(name, 16)} if re.fullmatch(r"[0-9a-fA-F]{8}", name) else set())
    for part, _ in layers:
        for text in _manifests(part):
            table = json.loads(text)
            names += table
            bits |= {int(table[name], 16)} if name in table else set()
    for part, ranks in layers:
        pixels = part.pixels()
        total = np.zeros(pixels.shape[:2], np.float32)
        for first in ranks:
            for channel in (first, first + 2):
                ids = np.ascontiguousarray(pixels[..., channel], np.float32).view(np.uint32)
                total += np.where(np.isin(ids, list(bits)), pixels[..., channel + 1], np.float32(0))
        if total.any():
            return part.window, total
    known = difflib.get_close_matches(name, names, _FEW, 0) or sorted(names)[:_FEW]
    listed = f"a name such as {', '.join(known)}" if known else "the name of an object, or its id in hexadecimal"
    raise ParameterError(parameter="matte", value=name, expected=listed)


def _manifests(part: Part) -> list[str]:
    return [str(one.value) for one in part.spec.extra_attribs if re.fullmatch(r"cryptomatte/.+/manifest", one.name)]


def _ranks(part: Part) -> list[int]:
    """The first channel of each rank pair: id, coverage, id, coverage."""
    names = [str(one.value) for one in part.spec.extra_attribs if re.fullmatch(r"cryptomatte/.+/name", one.name)]
    channels = part.spec.channelnames
    found = [(n, match) for n, one in enumerate(channels) if (match := _RANK.fullmatch(one))]
    return [n for n, match in found if n + 3 < len(channels) and any(match[1].endswith(one) for one in names)]
