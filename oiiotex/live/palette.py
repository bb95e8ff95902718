# SPDX-License-Identifier: Apache-2.0
"""What can be painted with: labels of a photo and, inside each, those of its next finer map (LSA16 figures 13, 14)."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..api.files import read_document, written
from ..api.images import Image, PieceCache, as_float, channels_of, read, write_indexed
from ..api.painting import Meaning, Strays, code_of
from ..api.service import BRUSH, Client
from ..deferred import np
from ..errors import Error, ImageError
from .document import LEAST_PAINTED, MOST_PAINTED
from .hub import Hub, labels_of

_SWATCH = 48  # px
_LEAST_LABELS, _MOST_LABELS, _MOST_WITHIN = 4, 24, 6

_SOFT = 0.2  # as --texpaint's
_LEGEND, _FACTS = "oiiotex:legend", "oiiotex:step"
_MOST_FACTS = 1000  # letters
COARSE, FINE = LAYERS = "coarse", "fine"

Layers = dict[str, "np.ndarray"]  # by name: (height, width) uint8, numbers of a palette's labels


class LabelPalette:
    """Numbers of labels in a painting's two layers, 8 bits each: the page's, and those of indexed PNGs.

    Coarse ones are the labels' ids. Of the finer map, which may have thousands, those are numbered that have a swatch;
    0 is none: there the coarse label stays as it is.

    `picture` (height, width, channels) float32.
    """

    def __init__(self, table: Mapping[str, Any], picture: np.ndarray):
        self.picture, self.labels = picture, table["labels"]
        shown = (entry for entry in table["finer"] if "box" in entry)
        self.finer = [entry | {"number": number} for number, entry in enumerate(shown, 1)]
        self._entries = {
            COARSE: {entry["id"]: entry for entry in self.labels},
            FINE: {entry["number"]: entry for entry in self.finer},
        }
        self._parents = np.zeros(256, np.uint8)
        for entry in self.finer:
            self._parents[entry["number"]] = entry["parent"]

    def allows(self, layer: str, numbers: np.ndarray) -> bool:
        """Whether all are labels of that layer."""
        allowed = self._entries[layer].keys() | ({0} if layer == FINE else set())
        return allowed.issuperset(np.flatnonzero(np.bincount(numbers.ravel())).tolist())

    def paint(self, layers: Layers, layer: str, place: tuple[slice, slice], mask: np.ndarray, number: int) -> None:
        """Paint with a label where a mask of a place is, inside the coarse label that a finer one is part of."""
        if layer == FINE and number:
            mask = mask & (layers[COARSE][place] == self._parents[number])
        layers[layer][place][mask] = number
        self.keep_inside(layers, place)

    def keep_inside(self, layers: Layers, place: tuple[slice, slice]) -> None:
        """Take away what lies in a place of the fine layer on another label than the one that it is part of."""
        fine = layers[FINE][place]
        fine[self._parents[fine] != layers[COARSE][place]] = 0

    def read_layers(self, files: Mapping[str, Path], cache: PieceCache) -> Layers:
        """A painting's layers, from files of which the fine one may not be there."""
        layers: Layers = {}
        for layer, path in files.items():
            if layer == FINE and (path.is_symlink() or not path.exists()):
                layers[FINE] = np.zeros_like(layers[COARSE])
                continue
            image = read(path, cache)
            size = image.first.spec.width, image.first.spec.height
            if not all(LEAST_PAINTED <= n <= MOST_PAINTED for n in size):
                allowed = f"a painting has {LEAST_PAINTED} to {MOST_PAINTED} px a side"
                raise ImageError(f"{path} is of {size[0]}x{size[1]}: {allowed}")
            layers[layer] = self.read(layer, image)
        if layers[COARSE].shape != layers[FINE].shape:
            raise ImageError(f"{files[FINE]} is of another size than {files[COARSE]}")
        self.keep_inside(layers, (slice(None), slice(None)))
        return layers

    def read(self, layer: str, image: Image) -> np.ndarray:
        """Numbers of a painting: ids of labels, or their colors; those of soft brushes are taken for the nearest."""
        part = image.first
        self._require_same_labels(layer, image)
        channels = channels_of(part.spec)
        meaning = self._meaning(layer, len(channels.color) > 1)
        pixels = part.pixels()
        codes = meaning.codes_of(pixels, channels)
        if layer == FINE and channels.alpha is not None:
            codes[as_float(pixels[..., channels.alpha]) < 0.5] = 0
        place, stray = meaning.find(codes)
        if stray.any():
            strays = Strays()
            strays.add(codes, stray, np.arange(codes.shape[1]), np.arange(codes.shape[0]))
            raise ImageError(f"{image.source} has {meaning.strays(strays, 'px')}: paint with those of the palette")
        return meaning.keys[place, 0].astype(np.uint8)

    def _meaning(self, layer: str, colors: bool) -> Meaning:
        """Of a layer's colors, or ids."""
        entries = self._entries[layer].items()
        numbers = {code_of(e["color"]) if colors else e["id"]: number for number, e in entries}
        numbers |= {0: 0} if layer == FINE else {}
        codes = sorted(numbers)
        keys = np.array([[numbers[code]] * 2 for code in codes], np.int64)
        return Meaning(np.array(codes, np.int64), keys, np.ones(len(codes), bool), colors, _SOFT)

    def _require_same_labels(self, layer: str, image: Image) -> None:
        """By the legend of `write`, where there is one."""
        text = image.first.spec.get_string_attribute(_LEGEND)
        if not text:
            return
        try:
            named = {entry["color"]: entry["name"] for entry in json.loads(text).values()}
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
            raise ImageError(f"{image.source}: its legend cannot be read") from error
        for entry in self._entries[layer].values():
            name = named.get(entry["color"], entry["name"])
            if name != entry["name"]:
                raise ImageError(f"{image.source} is painted with {name}, this palette has {entry['name']} instead")

    def write(self, layer: str, path: Path, numbers: np.ndarray, facts: Mapping[str, Any]) -> None:
        """Write a layer as an indexed PNG with its legend: colors are those of the table, so that --texpaint reads it.

        `numbers` (height, width) uint8.
        """
        entries = self._entries[layer]
        colors = {number: tuple(map(int, entry["color"].split(","))) for number, entry in entries.items()}
        legend = {str(number): {"name": e["name"], "color": e["color"]} for number, e in entries.items()}
        write_indexed(path, numbers, colors, {_LEGEND: legend, _FACTS: dict(facts)})


def extended(layers: Layers, width: int, height: int) -> Layers:
    """Layers of another size: cut off or extended on the right and at the bottom, by the label that most of it has."""
    old = layers[COARSE].shape
    rows, columns = (slice(0, min(pair)) for pair in zip(old, (height, width), strict=True))
    ground = {COARSE: int(np.bincount(layers[COARSE].ravel()).argmax()), FINE: 0}
    out = {layer: np.full((height, width), ground[layer], np.uint8) for layer in layers}
    for layer, plane in layers.items():
        out[layer][rows, columns] = plane[rows, columns]
    return out


def step_facts(path: Path, cache: PieceCache) -> dict[str, Any]:
    """What `LabelPalette.write` was told of a step: its seed, and what has changed in it."""
    text = read(path, cache).first.spec.get_string_attribute(_FACTS) or "{}"
    facts = None
    if len(text) <= _MOST_FACTS:
        with contextlib.suppress(ValueError, RecursionError):
            facts = json.loads(text)
    seed, change = (facts.get("seed", 0), facts.get("change", "")) if isinstance(facts, dict) else (None, None)
    if type(seed) is not int or not 0 <= seed < 1 << 32 or not isinstance(change, str):
        raise ImageError(f"{path}: its {_FACTS} is broken: expected seed, an integer from 0 to 4294967295, and change")
    return {"seed": seed, "change": change}


def require_replaceable(table: Path) -> None:
    """Refuse to write a palette's table over what is none."""
    if not os.path.lexists(table):
        return
    with contextlib.suppress(ImageError):
        document = read_document(table)
        if not table.is_symlink() and isinstance(document, dict) and "labels" in document:
            return
    raise ImageError(f"{table}: is no palette's table, and would be replaced by one: give it another name")


async def palette_of(hub: Hub, table: Path) -> tuple[LabelPalette, Path]:
    """Of the hub's photo, by --texlabel and --texpalette, and where its table is: in memory if `table` is unwritable.

    Raises
    ------
    ImageError
        By `require_replaceable`.
    """
    require_replaceable(table)
    made_table = hub.spare / "palette.json"
    made, client = await hub.made("label"), await hub.client()
    values = {
        "level": await _level(client, made),
        "side": _SWATCH,
        "rows": _MOST_LABELS,
        "children": _MOST_WITHIN,
        "json": os.path.abspath(made_table),
    }
    advance = hub.advancing("Making swatches of the labels")
    request = client.make("palette", [made["number"]], values, priority=BRUSH, read="", keep=False, on_progress=advance)
    _, (picture,) = await asyncio.wrap_future(request)
    palette = LabelPalette(read_document(made_table), as_float(picture))
    with contextlib.suppress(Error), written(table) as file:
        file.write(made_table.read_bytes())
        made_table = table
    return palette, made_table


async def _level(client: Client, made: dict[str, Any]) -> int:
    """The coarsest level that has some labels to paint with."""
    counts = {}
    for name in reversed(labels_of(made)):
        _, (ids,) = await asyncio.wrap_future(client.read(made["number"], part=name, priority=BRUSH))
        level = int(name.removeprefix("label."))
        counts[level] = np.count_nonzero(np.bincount(ids.ravel())[1:])
        if counts[level] >= _LEAST_LABELS:
            return level
    return max(counts, key=lambda level: counts[level])
