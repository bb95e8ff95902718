# SPDX-License-Identifier: Apache-2.0
"""Paintings of labels: what their colours mean, the fine one read at any size, and what is kept for the next edit."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..color import as_float
from ..errors import ImageError, ParameterError
from ..images import Image, channels_of
from ..params import Size
from ..synthesis.plans import NONE, Grid, Plan
from ..synthesis.quilting import Demand, Quilt
from ..temporary import temporary_beside
from ..windows import Window

log = logging.getLogger("oiiotex")


@dataclass(frozen=True)
class Brushes:
    """What colours (red << 16 | green << 8 | blue) mean: labels of a level, and of the next finer one."""

    level: int | None
    coarse: dict[int, int]
    fine: dict[int, int]


def brushes_of(table: Path | None) -> Brushes | None:
    """A palette's JSON, or a plain table {"255,0,0": 3}, which speaks of the coarse painting alone.

    Raises
    ------
    ImageError
        It cannot be read.
    """
    if table is None:
        return None
    try:
        held = json.loads(table.read_text())
        if "labels" not in held:
            return Brushes(None, {_code(colour): int(label) for colour, label in held.items()}, {})
        coarse, fine = ({_code(e["colour"]): int(e["id"]) for e in held[k]} for k in ("labels", "finer"))
        return Brushes(int(held["level"]), coarse, fine)
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise ImageError(f"table={table}: no palette of --texpalette can be read: {error}") from error


def _code(colour: str) -> int:
    red, green, blue = (int(n) for n in colour.split(","))
    if not all(0 <= n <= 255 for n in (red, green, blue)):
        raise ValueError(f"'{colour}'")
    return red << 16 | green << 8 | blue


def painted_labels(
    fine: Image, brushes: dict[int, int] | None, ids: np.ndarray, size: Size
) -> Callable[[Window], np.ndarray]:
    """The labels that a fine painting asks for in any window of the result: (height, width) int64, 0 where none.

    Raises
    ------
    ParameterError
        It holds colours, and no table gives them a meaning.
    ImageError
        (of what is returned) Colours or ids that mean no label, with their counts.
    """
    part, channels = fine.first, channels_of(fine.first.spec)
    colours = len(channels.colour) == 3
    if colours and not brushes:
        raise ParameterError("fine holds colours: table=FILE, which --texpalette:json=FILE wrote, says what they mean")
    if colours:
        codes, labels = (np.array(a, np.int64) for a in zip(*sorted(brushes.items()), strict=True))
    else:
        codes = labels = np.unique(ids[ids > 0]).astype(np.int64)
    there = set(np.unique(ids).tolist())
    missing = [int(label) for label in labels if int(label) not in there]
    if missing:
        raise ImageError(f"the table names label {missing[0]}, which the finer label map has not")
    whole = part.window

    def read(window: Window) -> np.ndarray:
        y = whole.top + np.arange(window.top, window.bottom) * whole.height // size.height
        x = np.arange(window.left, window.right) * whole.width // size.width
        rows = part.read(Window(whole.left, int(y[0]), whole.right, int(y[-1]) + 1))[y - y[0]][:, x]
        if colours:
            eight = np.rint(255 * np.clip(np.nan_to_num(as_float(rows)), 0, 1)).astype(np.int64)
            red, green, blue = (eight[..., c] for c in channels.colour)
            met = red << 16 | green << 8 | blue
        else:
            met = np.rint(rows[..., channels.colour[0]]).astype(np.int64)
        if channels.alpha is not None:
            met[rows[..., channels.alpha] == 0] = 0
        at = np.minimum(np.searchsorted(codes, met), len(codes) - 1)
        stray = (codes[at] != met) & (met != 0)
        if stray.any():
            found, counts = np.unique(met[stray], return_counts=True)
            named = ", ".join(
                f"{code >> 16},{code >> 8 & 255},{code & 255} ({n} px)" if colours else f"{code} ({n} px)"
                for code, n in list(zip(found.tolist(), counts.tolist(), strict=True))[:5]
            )
            raise ImageError(f"the fine painting has {'colours' if colours else 'ids'} that mean no label: {named}")
        return np.where(met == 0, 0, labels[at])

    return read


def save_painting(path: Path, exemplar: Image, layers: dict[str, Quilt]) -> None:
    """Plans and what was asked for, by prefix; the first is a plan as --texquilt:render=1 reads it."""
    spec = exemplar.first.spec
    held: dict[str, np.ndarray] = {}
    for prefix, layer in layers.items():
        arrays = layer.finished().arrays((spec.width, spec.height))
        held |= {f"{prefix}{name}": array for name, array in arrays.items()}
        held[f"{prefix}keys"], held[f"{prefix}guide"] = layer.demand.keys, layer.demand.guide
    with temporary_beside(path) as temporary, open(temporary, "wb") as file:
        np.savez_compressed(file, **held)


@dataclass(frozen=True)
class Begun:
    """A layer of a painting to begin with.

    Attributes
    ----------
    plan : Plan
    demand : Demand
        What it was asked for.
    path : Path
        Where it was read, for messages.
    fine : bool
        The painting has a fine layer.
    """

    plan: Plan
    demand: Demand
    path: Path
    fine: bool

    def kept(self, grid: Grid, demand: Demand, flag: str) -> Plan:
        """The plan without the patches of which something else is asked now.

        Raises
        ------
        ImageError
            The grid is another one.
        """
        g = self.plan.grid
        if g != grid:
            raise ImageError(
                f"before={self.path} is of {g.width}x{g.height} in patches of {g.patch} px, this is"
                f" {grid.width}x{grid.height} in patches of {grid.patch} px: size, tile and patch must be the same"
            )
        changed = self.demand.keys != demand.keys
        if demand.guide is not None:
            changed |= (self.demand.guide != demand.guide).any((2, 3))
        log.info("%s: %d of %d patches change", flag, np.count_nonzero(changed), changed.size)
        offsets = np.where(changed, NONE, self.plan.offsets)
        return Plan(grid, offsets, self.plan.vertical.copy(), self.plan.horizontal.copy())


def read_begun(path: Path, prefix: str = "") -> Begun | None:
    """A painting's layer; None where there is no such one.

    Raises
    ------
    ImageError
        It cannot be read, or is a plan of --texquilt, which does not say what was painted.
    """
    plan, _ = Plan.load(path)
    with np.load(path, allow_pickle=False) as held:
        if "keys" not in held:
            raise ImageError(f"before={path} is no plan of --texpaint: it does not say what was painted")
        if f"{prefix}keys" not in held:
            return None
        if prefix:
            plan, _ = Plan.of({name: held[f"{prefix}{name}"] for name in Plan.ARRAYS}, path)
        demand = Demand(held[f"{prefix}keys"], held[f"{prefix}guide"])
        fine = "fine_keys" in held
    if demand.keys.shape != plan.grid.shape or demand.guide.shape[:2] != plan.grid.shape:
        raise ImageError(f"{path} is no whole plan")
    return Begun(plan, demand, path, fine)
