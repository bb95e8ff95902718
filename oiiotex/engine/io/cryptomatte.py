# SPDX-License-Identifier: Apache-2.0
"""Cryptomatte 1.2: label maps are written as one, and the matte of an object is read.

The specification is Psyop's (github.com/Psyop/Cryptomatte, specification/cryptomatte_specification.pdf). A label map
has one label per pixel; its borders are softened (`covered`), and one layer of two ranks holds the two labels with the
largest coverage of each pixel.
"""

from __future__ import annotations

import difflib
import fnmatch
import json
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..core.image import IDS, Image, Part
from ..core.label_map import LabelMap
from ..core.window import Window
from ..deferred import np, oiio
from ..errors import ImageError, ParameterError, either, reason_of
from .documents import require_regular
from .owned import checked_name


def hashed(name: str) -> int:
    """The 32-bit hash of a name: MurmurHash3_x86_32, adjusted so that it is never a NaN, Inf or denormal float."""
    bits = _murmur(name)
    exponent = bits >> 23 & 255
    return bits ^ 1 << 23 if exponent in (0, 255) else bits


def _murmur(name: str) -> int:
    """MurmurHash3_x86_32 of a name."""
    import mmh3  # not needed by lines without mattes

    return mmh3.hash(name.encode(), 0, signed=False)


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
    key = f"{_murmur(name):08x}"[:7]
    facts = {"name": name, "hash": "MurmurHash3_32", "conversion": "uint32_to_float32"}
    if manifest_file is None:
        facts["manifest"] = json.dumps(manifest, separators=(",", ":"))
    else:
        facts["manif_file"] = manifest_file
    return {f"cryptomatte/{key}/{k}": v for k, v in facts.items()}


# --- reading ---

_RANK = re.compile(r"(.+?)(\d\d)\.(r|g|b|a|red|green|blue|alpha)", re.IGNORECASE)
_USUAL = re.compile(r"crypto\w*\d\d\.\w+", re.IGNORECASE)  # where a part has no metadata
_FEW = 8  # names in a message
_MOST_MANIFEST = 256 << 20  # bytes of a file


@dataclass(frozen=True)
class MatteLayer:
    """A Cryptomatte layer of an image: the channels of its ranks, as (id, coverage), and its manifest, ids by name."""

    name: str
    part: Part
    ranks: tuple[tuple[int, int], ...]
    manifest: dict[str, int]


def matte_channels(spec: oiio.ImageSpec) -> tuple[int, ...]:
    """The channels with ids and coverage of Cryptomatte, by the metadata or by the usual names."""
    names = _layer_names(spec)
    matches = [(n, name, _RANK.fullmatch(name)) for n, name in enumerate(spec.channelnames)]
    return tuple(
        n for n, name, match in matches
        if match and (_USUAL.fullmatch(name) or any(match[1].endswith(layer) for layer in names))
    )  # fmt: skip


def require_unmixed(part: Part, op: str) -> None:
    """Refuse an op that would compute new values from ids of Cryptomatte.

    Raises
    ------
    ImageError
        The part has Cryptomatte channels.
    """
    if mattes := matte_channels(part.spec):
        names = part.spec.channelnames
        others = ",".join(name for n, name in enumerate(names) if n not in mattes) or "none"
        raise ImageError(
            f"{names[mattes[0]]} and others are Cryptomatte, whose ids {op} would change",
            hint=either(
                f"unfold them first: --cryptomatte-unfold '*', or keep the other channels only: --ch {others}",
                f"keep the other channels only: {others}",
            ),
        )


def require_no_ids(part: Part, op: str) -> None:
    """Refuse an op that would average 32-bit integers, which are ids: the average of two names a third object.

    Raises
    ------
    ImageError
        The part has channels of that type.
    """
    spec = part.spec
    if ids := [name for c, name in enumerate(spec.channelnames) if str(spec.channelformat(c)) in IDS]:
        raise ImageError(
            f"{', '.join(ids)}: 32-bit integers are ids, which {op} would average",
            hint=either(
                "--resample:interp=0 takes the nearest pixel; -i:type=float reads other numbers",
                "convert other numbers to float",
            ),
        )


def layers_of(image: Image) -> list[MatteLayer]:
    """The Cryptomatte layers of an image.

    Raises
    ------
    ImageError
        The image has none, its ids are half, or a manifest is damaged.
    """
    layers = []
    for part in image.parts:
        keys = _layer_names(part.spec)
        ranks: dict[str, list[tuple[int, int]]] = {}
        for name, pair in _pairs(part):
            ranks.setdefault(max((one for one in keys if name.endswith(one)), key=len, default=name), []).append(pair)
        for name, pairs in ranks.items():
            require_float_ids(part.spec, [identity for identity, _ in pairs], image.source)
            layers.append(MatteLayer(name, part, tuple(pairs), _manifest(image, part.spec, keys.get(name, ""))))
    if not layers:
        raise ImageError("has no Cryptomatte channels", subject=image.source, hint="expected channels NAME00.R ...")
    return layers


def require_float_ids(spec: oiio.ImageSpec, channels: Iterable[int], subject: str) -> None:
    """Refuse ids that are half: they name no object. `channels`: those of ids; `subject`: the image.

    Raises
    ------
    ImageError
    """
    if any(spec.channelformat(n) == oiio.HALF for n in channels):
        hint = "render or write them again as 32-bit floats"
        raise ImageError("ids are half; Cryptomatte needs float", subject=subject, hint=hint)


def _layer_names(spec: oiio.ImageSpec) -> dict[str, str]:
    """Names of layers in the metadata, with the key of each."""
    named = ((re.fullmatch(r"cryptomatte/(.+)/name", one.name), one) for one in spec.extra_attribs)
    return {str(one.value): match[1] for match, one in named if match}


def _pairs(part: Part) -> Iterator[tuple[str, tuple[int, int]]]:
    """For each rank, in order, the name of its layer, and the channels of id and coverage."""
    mattes, found = matte_channels(part.spec), dict[tuple[str, str], dict[str, int]]()
    for n in mattes:
        match = _RANK.fullmatch(part.spec.channelnames[n])
        if match:
            found.setdefault((match[1], match[2]), {})[match[3][0].lower()] = n
    for (name, _), channels in sorted(found.items()):
        for identity, coverage in ("rg", "ba"):
            if identity in channels and coverage in channels:
                yield name, (channels[identity], channels[coverage])


def _manifest(image: Image, spec: oiio.ImageSpec, key: str) -> dict[str, int]:
    """Ids by name, from the metadata or from a file next to the image; empty without a manifest."""
    text = spec.get_string_attribute(f"cryptomatte/{key}/manifest")
    file = spec.get_string_attribute(f"cryptomatte/{key}/manif_file")
    if file and not text:
        path = os.path.join(os.path.dirname(image.source), checked_name(file, "manifest file"))
        require_regular(path)
        try:
            if os.path.getsize(path) > _MOST_MANIFEST:
                raise ImageError(f"{path}: the manifest is too large")
            text = Path(path).read_text("utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise ImageError(f"{path}: cannot read the manifest: {reason_of(error)}", subject=image.source) from None
    try:
        return {str(name): int(str(bits), 16) for name, bits in json.loads(text or "{}").items()}
    except (ValueError, AttributeError, RecursionError):
        raise ImageError("has a damaged Cryptomatte manifest", subject=image.source) from None


def mattes_named(layers: Sequence[MatteLayer], patterns: str) -> dict[str, list[tuple[MatteLayer, int]]]:
    """Mattes by name: the layers that have the object, and its id in each.

    Parameters
    ----------
    layers : sequence of MatteLayer
    patterns : str
        Comma-separated names with the wildcards * ? [], or ids of eight hexadecimal digits.

    Raises
    ------
    ParameterError
        A pattern matches no name; the message lists names of the manifest.
    """
    known = list(dict.fromkeys(name for layer in layers for name in layer.manifest))
    found: dict[str, list[tuple[MatteLayer, int]]] = {}
    for pattern in [patterns] if patterns in known else filter(None, map(str.strip, patterns.split(","))):
        names = [name for name in known if name == pattern or fnmatch.fnmatchcase(name, pattern)]
        for name in names:
            found[name] = [(layer, layer.manifest[name]) for layer in layers if name in layer.manifest]
        if names:
            continue
        hexadecimal = re.fullmatch(r"[0-9a-fA-F]{8}", pattern)
        if not hexadecimal and (known or not re.fullmatch(r"[^*?[]+", pattern)):
            near = difflib.get_close_matches(pattern, known, _FEW, 0) or sorted(known)[:_FEW]
            listed = f"a name such as {', '.join(near)}" if near else "an id in hexadecimal, as there is no manifest"
            raise ParameterError(f"no matte '{pattern}'", expected=listed)
        bits = int(pattern, 16) if hexadecimal else hashed(pattern)
        found[pattern] = [(layer, bits) for layer in layers]
    if not found:
        raise ParameterError(f"'{patterns}'", expected="names of mattes")
    return found


def coverages(layer: MatteLayer, ids: Sequence[int], window: Window) -> np.ndarray:
    """Coverage of objects in a window of the layer's part, (height, width, ids) float32."""
    pixels = layer.part.read(window)
    out = np.zeros((window.height, window.width, len(ids)), np.float32)
    order = np.argsort(np.array(ids, np.uint32))
    table = np.array(ids, np.uint32)[order]
    for identity, coverage in layer.ranks:
        codes = np.ascontiguousarray(pixels[..., identity], np.float32).view(np.uint32)
        place = np.minimum(np.searchsorted(table, codes), len(table) - 1)
        rows, columns = np.nonzero((table[place] == codes) & (codes != 0))
        out[rows, columns, order[place[rows, columns]]] += pixels[rows, columns, coverage]
    return out


def coverage_of(image: Image, name: str) -> tuple[Window, np.ndarray]:
    """The matte of an object: the data window of its Cryptomatte, and its coverage there, (height, width) float32.

    Raises
    ------
    ImageError
        As by `layers_of`.
    ParameterError
        As by `mattes_named`, or no pixel has the object.
    """
    try:
        matte = next(iter(mattes_named(layers_of(image), name).values()))
    except ParameterError as error:
        raise ParameterError(parameter="matte", value=name, expected=error.expected) from None
    for layer, bits in matte:
        total = coverages(layer, [bits], layer.part.window)[..., 0]
        if total.any():
            return layer.part.window, total
    raise ParameterError("covers no pixel", parameter="matte", value=name)
