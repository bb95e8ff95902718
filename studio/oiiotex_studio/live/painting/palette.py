# SPDX-License-Identifier: Apache-2.0
"""The palette: labels of a photo and, inside each, labels of the next finer map (LSA16 figures 13, 14)."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from oiiotex.engine.deferred import np
from oiiotex.engine.errors import Error, ImageError

from ...api.files import read_document, written
from ...api.images import Image, PieceCache, as_float, channels_of, read, write_indexed
from ...api.painting import Meaning, Strays, code_of
from ...api.service import BRUSH
from ..document import LEAST_PAINTED, MOST_PAINTED
from ..hub import Hub

_SWATCH = 48  # px
_MOST_LABELS = 24

_LEGEND, _FACTS = "oiiotex:legend", "oiiotex:step"
_MOST_FACTS = 1000  # characters
COARSE, FINE = LAYERS = "coarse", "fine"

Layers = dict[str, "np.ndarray"]  # (height, width) uint8 label numbers, by layer name


class LabelPalette:
    """8-bit label numbers of a painting's two layers, as used on the page and in indexed PNGs.

    Coarse numbers are label ids. The finer map can have thousands of labels: only those with a swatch get a number. In
    the fine layer, 0 means none: the coarse label is used.

    `picture` (height, width, channels) float32. `own` (height, width): the label ids of the photo.
    """

    def __init__(self, table: Mapping[str, Any], picture: np.ndarray, own: np.ndarray):
        self.picture, self.labels, self._own = picture, table["labels"], own
        shown = (entry for entry in table["finer"] if "box" in entry)
        self.finer = [entry | {"number": number} for number, entry in enumerate(shown, 1)]
        self._entries = {
            COARSE: {entry["id"]: entry for entry in self.labels},
            FINE: {entry["number"]: entry for entry in self.finer},
        }
        self._within = np.zeros((256, 256), bool)  # finer numbers x coarse ids
        for entry in self.finer:
            self._within[entry["number"], entry["parents"]] = True

    def photo(self, width: int, height: int) -> np.ndarray:
        """The photo's labels, cropped or mirrored to a size; pixels without a swatch get the largest label."""
        rows, columns = (
            np.pad(np.arange(own), (0, max(0, n - own)), mode="symmetric")[:n]
            for own, n in zip(self._own.shape, (height, width), strict=True)
        )
        ids = self._own[rows][:, columns]
        return np.where(np.isin(ids, list(self._entries[COARSE])), ids, self.labels[0]["id"]).astype(np.uint8)

    def allows(self, layer: str, numbers: np.ndarray) -> bool:
        """Whether all numbers are labels of that layer."""
        allowed = self._entries[layer].keys() | ({0} if layer == FINE else set())
        return allowed.issuperset(np.flatnonzero(np.bincount(numbers.ravel())).tolist())

    def paint(self, layers: Layers, layer: str, place: tuple[slice, slice], mask: np.ndarray, number: int) -> None:
        """Paint a label where the mask is set; a finer label only inside its coarse labels."""
        if layer == FINE and number:
            mask = mask & self._within[number, layers[COARSE][place]]
        layers[layer][place][mask] = number
        self.keep_inside(layers, place)

    def keep_inside(self, layers: Layers, place: tuple[slice, slice]) -> None:
        """Remove finer labels that lie outside their coarse labels."""
        fine = layers[FINE][place]
        fine[~self._within[fine, layers[COARSE][place]]] = 0

    def read_layers(self, files: Mapping[str, Path], cache: PieceCache) -> Layers:
        """Read a painting's layers; the file of the fine layer can be missing."""
        layers: Layers = {}
        for layer, path in files.items():
            if layer == FINE and (path.is_symlink() or not path.exists()):
                layers[FINE] = np.zeros_like(layers[COARSE])
                continue
            image = read(path, cache)
            size = image.first.spec.width, image.first.spec.height
            if not all(LEAST_PAINTED <= n <= MOST_PAINTED for n in size):
                expected = f"expected {LEAST_PAINTED} to {MOST_PAINTED} px per side"
                raise ImageError(f"{path} has {size[0]}x{size[1]} px: {expected}")
            layers[layer] = self.read(layer, image)
        if layers[COARSE].shape != layers[FINE].shape:
            raise ImageError(f"{files[FINE]} must have the same size as {files[COARSE]}")
        self.keep_inside(layers, (slice(None), slice(None)))
        return layers

    def read(self, layer: str, image: Image) -> np.ndarray:
        """Label numbers of a painting of ids or colors. Blended colors of soft brushes become the nearest label."""
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
            raise ImageError(f"{image.source} has {meaning.strays(strays, 'px')}; use those of the palette")
        return meaning.keys[place, 0].astype(np.uint8)

    def _meaning(self, layer: str, colors: bool) -> Meaning:
        """The mapping from a layer's colors or ids to label numbers."""
        entries = self._entries[layer].items()
        numbers = {code_of(e["color"]) if colors else e["id"]: number for number, e in entries}
        numbers |= {0: 0} if layer == FINE else {}
        codes = sorted(numbers)
        keys = np.array([[numbers[code]] * 2 for code in codes], np.int64)
        return Meaning(np.array(codes, np.int64), keys, np.ones(len(codes), bool), colors)

    def _require_same_labels(self, layer: str, image: Image) -> None:
        """Raise ImageError if the file's legend, as written by `write`, differs from the palette."""
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
                raise ImageError(f"{image.source} is painted with {name}: expected {entry['name']}, as in this palette")

    def write_layers(self, files: Mapping[str, Path], layers: Layers, facts: Mapping[str, Any]) -> None:
        """Write a painting's layers, without the fine one if it is empty."""
        for layer, path in files.items():
            if layer == COARSE or layers[layer].any():
                self._write(layer, path, layers[layer], facts)
            else:
                path.unlink(missing_ok=True)

    def _write(self, layer: str, path: Path, numbers: np.ndarray, facts: Mapping[str, Any]) -> None:
        """Write a layer as an indexed PNG with its legend, in the table's colors, so that --texpaint can read it.

        `numbers` (height, width) uint8.
        """
        entries = self._entries[layer]
        colors = {number: tuple(map(int, entry["color"].split(","))) for number, entry in entries.items()}
        legend = {str(number): {"name": e["name"], "color": e["color"]} for number, e in entries.items()}
        write_indexed(path, numbers, colors, {_LEGEND: legend, _FACTS: dict(facts)})


def extended(layers: Layers, width: int, height: int) -> Layers:
    """Layers cropped or extended on the right and at the bottom; the extension has the most frequent label."""
    old = layers[COARSE].shape
    rows, columns = (slice(0, min(pair)) for pair in zip(old, (height, width), strict=True))
    ground = {COARSE: int(np.bincount(layers[COARSE].ravel()).argmax()), FINE: 0}
    out = {layer: np.full((height, width), ground[layer], np.uint8) for layer in layers}
    for layer, plane in layers.items():
        out[layer][rows, columns] = plane[rows, columns]
    return out


def step_facts(path: Path, cache: PieceCache) -> dict[str, Any]:
    """The seed and the change of a step, as written by `LabelPalette.write`."""
    text = read(path, cache).first.spec.get_string_attribute(_FACTS) or "{}"
    facts = None
    if len(text) <= _MOST_FACTS:
        with contextlib.suppress(ValueError, RecursionError):
            facts = json.loads(text)
    seed, change = (facts.get("seed", 0), facts.get("change", "")) if isinstance(facts, dict) else (None, None)
    if type(seed) is not int or not 0 <= seed < 1 << 32 or not isinstance(change, str):
        raise ImageError(f"{path}: invalid {_FACTS}: expected seed, an integer from 0 to 4294967295, and change")
    return {"seed": seed, "change": change}


def require_replaceable(table: Path) -> None:
    """Raise ImageError if a file exists that is not a palette's table, and would be overwritten."""
    if not os.path.lexists(table):
        return
    with contextlib.suppress(ImageError):
        document = read_document(table)
        if not table.is_symlink() and isinstance(document, dict) and "labels" in document:
            return
    raise ImageError(f"{table} is not a palette's table and would be overwritten; rename it")


async def palette_of(hub: Hub, table: Path) -> tuple[LabelPalette, Path]:
    """The photo's palette, by --texlabel and --texpalette, and the path of its table: `table` if it is writable.

    Raises
    ------
    ImageError
        A file exists that is not a palette's table.
    """
    require_replaceable(table)
    made_table = hub.spare / "palette.json"
    made, client = await hub.made("label"), await hub.client()
    values = {
        "panel": _SWATCH,
        "maxlabels": _MOST_LABELS,
        "facts": os.path.abspath(made_table),
    }
    advance = hub.advancing("Rendering swatches")
    request = client.make("palette", [made["number"]], values, priority=BRUSH, read="", keep=False, on_progress=advance)
    _, (picture,) = await asyncio.wrap_future(request)
    table_of_photo = read_document(made_table)
    name = f"label.{table_of_photo['level']}"
    _, (own,) = await asyncio.wrap_future(client.read(made["number"], part=name, priority=BRUSH))
    palette = LabelPalette(table_of_photo, as_float(picture), own[..., 0])
    with contextlib.suppress(Error), written(table) as file:
        file.write(made_table.read_bytes())
        made_table = table
    return palette, made_table
