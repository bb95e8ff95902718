# SPDX-License-Identifier: Apache-2.0
"""The maps of a material as one array of values, by which patches are compared."""

from __future__ import annotations

import logging

from ...engine.color.config import as_float
from ...engine.color.lab import color_to_convert, working_values
from ...engine.core.demand import SomeRows, first_channels
from ...engine.core.image import Image, channels_of
from ...engine.core.op import Space
from ...engine.core.parameters import Numbers, Words
from ...engine.core.scratch import AT_ONCE, empty_rows
from ...engine.deferred import np
from ...engine.errors import ImageError, ParameterError
from ...engine.session.facts import Facts
from ...engine.session.resources import Resources
from .exemplar_masks import both

log = logging.getLogger("oiiotex")

KINDS = ("color", "data", "normal", "height")
KINDS_HELP = (
    "Kind of each map of a material: color, data, normal or height. The last images on the stack are used, one for"
    " each kind, in order. Maps other than color are tagged as data in the result."
)
_MOST_MAPS = 16
MATCH_HELP = (
    "Weight of each map in the comparison of patches, in order. 0: the map is not compared, but follows the others."
)
# the default weight of a height: a larger one reduces the steps at seams but removes large shapes and makes the colors
# fit less well (tests/synthesis/test_heights.py)
_HEIGHT_WEIGHT = 0.25
_SHORTEST = 0.05  # length of a normal; shorter ones are rounding errors of zero
_NORMAL_BYTES = 80  # for each pixel of normals, while they are read
_MOST_CHANNELS = 32  # values compared for each pixel


def read_material(
    maps: tuple[Image, ...], kinds: Words | None, match: Numbers | None, data: bool, resources: Resources,
    in_memory: bool = True,
) -> tuple[SomeRows, np.ndarray | None]:  # fmt: skip
    """The maps in the working space of a synthesis, (height, width, channels) float32, and their usable pixels.

    Color is converted to CIE Lab. Data, including heights, are never color-managed; their range becomes 0 .. 100.
    Normals are decoded from 0 .. 1 if none of their values is negative, and normalized. These values serve comparison
    only: a synthesis copies the map's own pixels. Values are multiplied by the root of their map's weight (1; 0.25 for
    a height among several). They are an array or, unless `in_memory`, rows of a file.
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
            f"the maps have {count} channels to compare: expected at most {_MOST_CHANNELS}; set mapweights of"
            " a map to 0 to ignore it"
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


def require_readable(
    maps: tuple[Image, ...], kinds: Words | None, match: Numbers | None, data: bool, facts: Facts
) -> None:
    """Refuse maps that `read_material` would refuse whatever their pixels are."""
    named = tuple(kinds_of(kinds, len(maps), data))
    weights = _weights(match, named)
    _require_alike(maps)
    for image, kind, weight in zip(maps, named, weights, strict=True):
        if weight > 0 and kind == "color":
            color_to_convert(image, facts, Space.LAB)


def kinds_of(kinds: Words | None, count: int, data: bool) -> list[str]:
    """The kind of each map; raises ParameterError if `kinds` does not match them."""
    if kinds is None:
        return ["data" if data else "color", *["data"] * (count - 1)]
    if not len(kinds) == count <= _MOST_MAPS or any(word not in KINDS for word in kinds):
        expected = f"one of {', '.join(KINDS)} for each of the {count} maps"
        raise ParameterError(parameter="kinds", value=kinds, expected=expected)
    return list(kinds)


def _weights(match: Numbers | None, kinds: tuple[str, ...]) -> list[float]:
    if match is None:
        return [_HEIGHT_WEIGHT if kind == "height" and len(kinds) > 1 else 1.0 for kind in kinds]
    if len(match) != len(kinds) or max(match) == 0:
        count = len(kinds)
        expected = f"one number for each of the {count} maps, not all of them 0"
        raise ParameterError(parameter="mapweights", value=match, expected=expected)
    return list(match)


def _require_alike(maps: tuple[Image, ...]) -> None:
    """Refuse a set whose maps are not aligned pixel for pixel."""
    texts = [_windows(image) for image in maps]
    for image, text in zip(maps[1:], texts[1:], strict=True):
        if text != texts[0]:
            raise ImageError(
                f"maps of a material must have the same size and windows: {maps[0].source} is {texts[0]},"
                f" but {image.source} is {text}"
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
    """Lab or scaled data, without the duplicate channels of gray data."""
    values, opaque = working_values(image, resources, Space.LAB if color else Space.DATA, in_memory)
    count = 3 if color else len(channels_of(image.first.spec).color)
    return first_channels(values, count), opaque


def _normals(image: Image) -> tuple[np.ndarray, np.ndarray | None]:
    """Unit vectors, with -1 .. 1 scaled to 0 .. 100, and a mask of the pixels that have one."""
    part = image.first
    channels = channels_of(part.spec)
    if len(channels.color) not in (2, 3):
        raise ImageError(f"{image.source} has {len(channels.color)} channels: normals must have two or three")
    vectors = as_float(part.pixels()[..., list(channels.color)])
    if not np.isfinite(vectors).all():
        raise ImageError(f"{image.source} has {np.count_nonzero(~np.isfinite(vectors))} NaN or Inf values")
    if vectors.min() >= 0:  # encoded; black, as around UV islands, is not a normal
        vectors = np.where(vectors.any(-1, keepdims=True), 2 * vectors - 1, np.float32(0))
    if vectors.shape[2] == 2:
        rest = np.sqrt(np.maximum(0, 1 - (vectors**2).sum(-1, keepdims=True)))
        vectors = np.concatenate([vectors, rest.astype(np.float32)], axis=-1)
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    known = length[..., 0] >= _SHORTEST
    if not known.any():
        raise ImageError(f"{image.source} contains only normals of length 0: expected a normal map")
    if not known.all():
        count = np.count_nonzero(~known)
        log.warning("%s: %d normals have length 0; these pixels are not used as a source", image.source, count)
    unit = np.where(known[..., None], vectors / np.maximum(length, np.float32(_SHORTEST)), np.float32(0))
    return 50 * (unit + 1), None if known.all() else known
