# SPDX-License-Identifier: Apache-2.0
"""Search of a library by name, measures, color, size and labels."""

from __future__ import annotations

import fnmatch
import math
import operator
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from oiiotex.engine.errors import ParameterError

from ..api.files import Limit
from .catalog import Asset, AssetLabel, Catalog

_HEX = re.compile(r"#?([0-9a-fA-F]{6})")
_SIZE = re.compile(r"([<>]?)(\d+(?:\.\d+)?)x(\d+(?:\.\d+)?)(m?)", re.ASCII)
_LABEL = re.compile(r"(.+?)(?:>(\d*\.?\d+))?", re.ASCII)


@dataclass(frozen=True)
class AssetSearch:
    """Search criteria; '' and () match everything.

    `size`: WIDTHxHEIGHT in pixels, or in meters with a trailing m; with a leading > or <, at least or at most that
    size along both sides. `label`: NAME (with * and ?) or #RRGGBB of labels; with >SHARE (0 to 1), labels that
    together cover more than that share.
    """

    name: str = ""  # Wildcards * and ?
    status: str = ""
    tag: str = ""
    measures: tuple[str, ...] = ()  # NAME>NUMBER or NAME<NUMBER: all must hold
    color: str = ""  # RRGGBB in sRGB
    distance: float = 15.0  # Maximum CIE Lab distance from the color
    size: str = ""
    label: str = ""

    def assets(self, catalog: Catalog) -> list[tuple[Asset, dict[str, float]]]:
        """Matching assets with their measures, sorted by color distance, by label share or by name."""
        limits = [Limit.read(text, "--measure") for text in self.measures]
        if not self.distance >= 0:
            raise ParameterError(f"--distance {self.distance:g}: expected a number >= 0")
        lab, fits, share_of = _lab("--color", self.color), _size(self.size), _share(self.label, self.distance)
        measures = catalog.measures()
        _require_known(limits, measures)
        tags = catalog.tags() if self.tag else {}
        labels = catalog.labels() if self.label else {}
        chosen = []
        for asset in catalog.assets().values():
            own = measures.get(asset.name, {})
            if (
                (not self.name or fnmatch.fnmatchcase(asset.name, self.name))
                and self.status in ("", asset.status)
                and (not self.tag or self.tag in tags.get(asset.name, {}))
                and all(limit.measure in own and limit.passed_by(own[limit.measure]) for limit in limits)
                and fits(asset)
                and (not self.label or share_of(labels.get(asset.name, ())) > 0)
                and (not lab or (asset.lab and math.dist(lab, asset.lab) <= self.distance))
            ):
                chosen.append((asset, own))
        if lab:
            chosen.sort(key=lambda pair: math.dist(lab, pair[0].lab))
        elif self.label:
            chosen.sort(key=lambda pair: -share_of(labels[pair[0].name]))
        return chosen


def _require_known(limits: Sequence[Limit], measures: dict[str, dict[str, float]]) -> None:
    """Raise ParameterError for measures that no asset has, unless the library has no measures at all."""
    known = {name for own in measures.values() for name in own}
    for limit in limits:
        if known and limit.measure not in known:
            raise ParameterError(f"--measure {limit.measure}: expected one of {', '.join(sorted(known))}")


def _lab(option: str, text: str) -> tuple[float, ...]:
    if not text:
        return ()
    match = _HEX.fullmatch(text)
    if not match:
        raise ParameterError(f"{option} {text}: expected RRGGBB")
    from ..materials.preview import lab_of_srgb

    return tuple(lab_of_srgb([int(match[1][n : n + 2], 16) / 255 for n in (0, 2, 4)]))


def _share(text: str, distance: float) -> Callable[[Sequence[AssetLabel]], float]:
    """A function: the share of an asset covered by matching labels, 0 if not above the minimum share."""
    match = _LABEL.fullmatch(text)
    wanted, least = (match[1], float(match[2] or 0)) if match else ("", 0.0)
    if least >= 1 or ">" in wanted:
        raise ParameterError(f"--label {text}: expected NAME or #RRGGBB, optionally followed by >SHARE (0 to 1)")
    lab = _lab("--label", wanted) if wanted.startswith("#") else ()

    def share_of(labels: Sequence[AssetLabel]) -> float:
        share = sum(
            one.share
            for one in labels
            if (math.dist(lab, one.lab) <= distance if lab else fnmatch.fnmatchcase(one.name, wanted))
        )
        return share if share > least else 0.0

    return share_of


def _size(text: str) -> Callable[[Asset], bool]:
    if not text:
        return lambda asset: True
    match = _SIZE.fullmatch(text)
    if not match:
        raise ParameterError(
            f"--size {text}: expected WIDTHxHEIGHT, optionally with a leading > or < and a trailing m (meters)"
        )
    wanted = float(match[2]), float(match[3])
    compare = {">": operator.ge, "<": operator.le, "": operator.eq}[match[1]]

    def fits(asset: Asset) -> bool:
        size = asset.size_m if match[4] else (asset.width, asset.height)
        return len(size) == 2 and min(size) > 0 and all(map(compare, size, wanted))

    return fits
