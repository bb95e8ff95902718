# SPDX-License-Identifier: Apache-2.0
"""The maps of a material, seen together: what patches of all of them are compared by."""

from __future__ import annotations

import logging

from ..color.config import as_float
from ..color.lab import working_values
from ..core.demand import SomeRows, first_channels
from ..core.image import Image, channels_of
from ..core.op import Space
from ..core.parameters import Numbers, Words
from ..core.scratch import AT_ONCE, empty_rows
from ..deferred import np
from ..errors import ImageError, ParameterError
from ..session.resources import Resources
from .exemplar_masks import both

log = logging.getLogger("oiiotex")

KINDS = ("color", "data", "normal", "height")
KINDS_HELP = (
    "what the maps are, in their order: color (or color), data, normal or height; when left out the first is as"
    " without further maps, the others are data. What is no color is tagged as data"
)
MATCH_HELP = (
    "how much the maps count when patches are compared, in their order; 0: not at all; when left out 1"
    " for every map, 0.25 for a height"
)
# of a height where match is left out: more makes the steps at its seams fewer, and takes its large shapes away; colors
# fit as well as without it up to there (tests/test_heights.py)
_HEIGHT_WEIGHT = 0.25
_SHORTEST = 0.05  # length of a normal: less is the rounding of none at all
_NORMAL_BYTES = 80  # of a pixel of normals, while they are read
_MOST_CHANNELS = 32  # values of a pixel that are compared


def read_material(
    maps: tuple[Image, ...], kinds: Words | None, match: Numbers | None, data: bool, resources: Resources,
    in_memory: bool = True,
) -> tuple[SomeRows, np.ndarray | None]:  # fmt: skip
    """The maps in a synthesis' working space, (height, width, channels) float32, and where all can be a source.

    Color is seen in CIE Lab. Data, heights among them, are never color-managed: their range becomes 0 .. 100.
    Normals are vectors: decoded from 0 .. 1 where none of their values is negative, and brought to length 1 to be
    compared. They are never written: what a synthesis copies are the map's own pixels. Values are each times the root
    of their map's weight (1; 0.25 of a height among several), an array or, not `in_memory`, rows that lie in a file.
    """
    parts = tuple(image.first for image in maps)
    how = tuple(kinds_of(kinds, len(maps), data)), match
    key = ("material", *map(id, parts), *how, in_memory)
    return resources.remembered(key, lambda: _read(maps, *how, resources, in_memory), parts)


def _read(
    maps: tuple[Image, ...], named: tuple[str, ...], match: Numbers | None, resources: Resources, in_memory: bool
) -> tuple[SomeRows, np.ndarray | None]:
    weights = _weights(match, named)
    _require_alike(maps)
    values: SomeRows
    layers, opaque = [], None
    for image, kind, weight in zip(maps, named, weights, strict=True):
        if weight == 0:
            continue
        if kind == "normal":
            if not in_memory:
                spec = image.first.spec
                resources.require(_NORMAL_BYTES * spec.width * spec.height, f"the normals of {image.source}")
            values, seen = _normals(image)
        else:
            values, seen = _values(image, kind == "color", resources, in_memory)
        layers.append((values, np.float32(np.sqrt(weight))))
        opaque = both(opaque, seen)
    count = sum(layer.shape[2] for layer, _ in layers)
    if count > _MOST_CHANNELS:
        raise ParameterError(
            f"the maps have {count} channels to compare, at most {_MOST_CHANNELS} are allowed:"
            " match= with 0 leaves a map out"
        )
    if len(layers) == 1 and count >= 3 and layers[0][1] == 1:
        return layers[0][0], opaque
    height, width = layers[0][0].shape[:2]
    joined = empty_rows((height, width, max(3, count)), np.float32, in_memory)  # reports look at three
    step = max(1, AT_ONCE // (4 * joined.shape[2] * width))
    for top in range(0, height, step):
        rows = slice(top, min(top + step, height))
        pieces = [layer[rows] if weight == 1 else layer[rows] * weight for layer, weight in layers]
        if count < 3:
            pieces.append(np.zeros((*pieces[0].shape[:2], 3 - count), np.float32))
        joined[rows] = np.concatenate(pieces, axis=-1)
    return joined, opaque


def kinds_of(kinds: Words | None, count: int, data: bool) -> list[str]:
    """What each of the maps is; raises ParameterError where `kinds` does not fit them."""
    if kinds is None:
        return ["data" if data else "color", *["data"] * (count - 1)]
    if len(kinds) != count or any(word not in KINDS for word in kinds):
        expected = f"one of {', '.join(KINDS)} for each of the {count} maps"
        raise ParameterError(parameter="kinds", value=kinds, expected=expected)
    return list(kinds)


def _weights(match: Numbers | None, kinds: tuple[str, ...]) -> list[float]:
    if match is None:
        return [_HEIGHT_WEIGHT if kind == "height" and len(kinds) > 1 else 1.0 for kind in kinds]
    if len(match) != len(kinds) or max(match) == 0:
        count = len(kinds)
        expected = f"one number for each of the {count} maps, not all of them 0"
        raise ParameterError(parameter="match", value=match, expected=expected)
    return list(match)


def _require_alike(maps: tuple[Image, ...]) -> None:
    """Refuse a set whose maps do not lie over each other, pixel for pixel."""
    texts = [_windows(image) for image in maps]
    for image, text in zip(maps[1:], texts[1:], strict=True):
        if text != texts[0]:
            raise ImageError(
                f"the maps of a material must have the same size and windows: {maps[0].source} is {texts[0]},"
                f" {image.source} is {text}"
            )


def _windows(image: Image) -> str:
    spec = image.first.spec
    text = f"{spec.width}x{spec.height}{spec.x:+d}{spec.y:+d}"
    if (spec.full_x, spec.full_y, spec.full_width, spec.full_height) != (spec.x, spec.y, spec.width, spec.height):
        text += f" in {spec.full_width}x{spec.full_height}{spec.full_x:+d}{spec.full_y:+d}"
    return text


def _values(
    image: Image, color: bool, resources: Resources, in_memory: bool
) -> tuple[SomeRows, np.ndarray | None]:  # fmt: skip
    """Lab or scaled data, without the copies that gray data come in."""
    values, opaque = working_values(image, resources, Space.LAB if color else Space.DATA, in_memory)
    count = 3 if color else len(channels_of(image.first.spec).color)
    return first_channels(values, count), opaque


def _normals(image: Image) -> tuple[np.ndarray, np.ndarray | None]:
    """Unit vectors on the scale of data, -1 .. 1 as 0 .. 100, and where there are any."""
    part = image.first
    channels = channels_of(part.spec)
    if len(channels.color) not in (2, 3):
        raise ImageError(f"{image.source} has {len(channels.color)} channels beside alpha: normals have two or three")
    vectors = as_float(part.pixels()[..., list(channels.color)])
    if not np.isfinite(vectors).all():
        raise ImageError(f"{image.source} has {np.count_nonzero(~np.isfinite(vectors))} NaN or Inf values")
    if vectors.min() >= 0:  # encoded; black, as it lies around UV islands, is none
        vectors = np.where(vectors.any(-1, keepdims=True), 2 * vectors - 1, np.float32(0))
    if vectors.shape[2] == 2:
        rest = np.sqrt(np.maximum(0, 1 - (vectors**2).sum(-1, keepdims=True)))
        vectors = np.concatenate([vectors, rest.astype(np.float32)], axis=-1)
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    known = length[..., 0] >= _SHORTEST
    if not known.any():
        raise ImageError(f"{image.source} has no normal of any length: say data in kinds= where it holds none")
    if not known.all():
        count = np.count_nonzero(~known)
        log.warning("%s: %d normals of length 0: these pixels are never a source", image.source, count)
    unit = np.where(known[..., None], vectors / np.maximum(length, np.float32(_SHORTEST)), np.float32(0))
    return 50 * (unit + 1), None if known.all() else known
