# SPDX-License-Identifier: Apache-2.0
"""What can be painted with: labels of a photo and, inside each, those of its next finer map (LSA16 figures 13, 14)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..core.image import Image
from ..deferred import np
from ..labels.legend import code_of, codes_in
from .painting import write_indexed

COARSE, FINE = LAYERS = "coarse", "fine"

Layers = dict[str, np.ndarray]  # by name: (height, width) uint8, numbers of a palette's labels


class Palette:
    """Numbers of labels in a painting's two layers, 8 bits each: the page's, and those of indexed PNGs.

    Coarse ones are the labels' ids. Of the finer map, which may have thousands, those are numbered that have a swatch;
    0 is none: there the coarse label stays as it is.

    Parameters
    ----------
    table : dict
        As --texpalette writes it.
    picture : (height, width, channels) float32
        Its swatches.
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

    def keep_inside(self, layers: Layers, place: tuple[slice, slice]) -> None:
        """Take away what lies in a place of the fine layer on another label than the one that it is part of."""
        fine = layers[FINE][place]
        fine[self._parents[fine] != layers[COARSE][place]] = 0

    def read(self, layer: str, image: Image) -> np.ndarray:
        """Numbers of a painting that `write` has written."""
        codes = codes_in(image.first.pixels(), (0, 1, 2))
        numbers = np.zeros(codes.shape, np.uint8)
        for number, entry in self._entries[layer].items():
            numbers[codes == code_of(entry["colour"])] = number
        return numbers

    def write(self, layer: str, path: Path, numbers: np.ndarray) -> None:
        """Write a layer as an indexed PNG with its legend: colours are those of the table, so that --texpaint reads it.

        Raises
        ------
        ImageError
            The file cannot be written.
        """
        entries = self._entries[layer]
        colours = {number: tuple(map(int, entry["colour"].split(","))) for number, entry in entries.items()}
        legend = {str(number): {"name": e["name"], "colour": e["colour"]} for number, e in entries.items()}
        write_indexed(path, numbers, colours, legend)
