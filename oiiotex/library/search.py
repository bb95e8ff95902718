# SPDX-License-Identifier: Apache-2.0
"""What of a library is looked for: names, measures, colours, sizes."""

from __future__ import annotations

import fnmatch
import math
import re
from collections.abc import Callable
from dataclasses import dataclass

from ..errors import ParameterError
from ..recipes.recipe import Limit
from .catalogue import Asset, Catalogue

_HEX = re.compile(r"#?([0-9a-fA-F]{6})")
_SIZE = re.compile(r"([<>]?)(\d+)x(\d+)")


@dataclass(frozen=True)
class Search:
    """What is looked for; '' and () ask for nothing.

    Attributes
    ----------
    name : str
        With * and ?.
    status, tag : str
    measures : tuple of str
        NAME>NUMBER or NAME<NUMBER: all must hold.
    color : str
        RRGGBB in sRGB.
    distance : float
        From it to the mean colour, Lab, at most.
    size : str
        WIDTHxHEIGHT; behind > or <: larger or smaller along both sides, or equal.
    """

    name: str = ""
    status: str = ""
    tag: str = ""
    measures: tuple[str, ...] = ()
    color: str = ""
    distance: float = 15.0
    size: str = ""

    def assets(self, catalogue: Catalogue) -> list[tuple[Asset, dict[str, float]]]:
        """What fits, with its measures; by colour the nearest first, else by name.

        Raises
        ------
        ParameterError
            A term is none.
        """
        limits = [Limit.read(text) for text in self.measures]
        lab, fits = _lab(self.color), _size(self.size)
        measures = catalogue.measures()
        tags = catalogue.tags() if self.tag else {}
        chosen = []
        for asset in catalogue.assets().values():
            own = measures.get(asset.name, {})
            if (
                (not self.name or fnmatch.fnmatchcase(asset.name, self.name))
                and self.status in ("", asset.status)
                and (not self.tag or self.tag in tags.get(asset.name, {}))
                and all(limit.measure in own and limit.passed_by(own[limit.measure]) for limit in limits)
                and fits(asset)
                and (not lab or (asset.lab and math.dist(lab, asset.lab) <= self.distance))
            ):
                chosen.append((asset, own))
        if lab:
            chosen.sort(key=lambda pair: math.dist(lab, pair[0].lab))
        return chosen


def _lab(text: str) -> tuple[float, ...]:
    if not text:
        return ()
    match = _HEX.fullmatch(text)
    if not match:
        raise ParameterError(f"--color {text}: allowed is RRGGBB")
    from ..materials.preview import lab_of_srgb

    return tuple(lab_of_srgb([int(match[1][n : n + 2], 16) / 255 for n in (0, 2, 4)]))


def _size(text: str) -> Callable[[Asset], bool]:
    if not text:
        return lambda asset: True
    match = _SIZE.fullmatch(text)
    if not match:
        raise ParameterError(f"--size {text}: allowed is WIDTHxHEIGHT, and > or < before it")
    width, height = int(match[2]), int(match[3])
    if match[1] == ">":
        return lambda asset: asset.width >= width and asset.height >= height
    if match[1] == "<":
        return lambda asset: 0 < asset.width <= width and 0 < asset.height <= height
    return lambda asset: (asset.width, asset.height) == (width, height)
