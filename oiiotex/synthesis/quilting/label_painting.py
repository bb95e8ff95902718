# SPDX-License-Identifier: Apache-2.0
"""Label paintings: the fine painting at any size, and the data kept for the next edit."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ...engine.color.config import as_float
from ...engine.core.image import Part, channels_of
from ...engine.core.parameters import Size
from ...engine.core.source_map import NONE
from ...engine.core.window import Window
from ...engine.deferred import np
from ...engine.errors import ImageError, present, texture_filter
from ...engine.io.documents import read_arrays
from .guide_map import Meaning, Strays
from .quilt_plan import Grid, QuiltPlan
from .quilter import Demand, Quilt

log = logging.getLogger("oiiotex")


def painted_labels(
    fine: Part, meaning: Meaning, size: Size, strict: bool = True
) -> Callable[[Window], np.ndarray]:  # fmt: skip
    """The labels of a fine painting in any window of the result: (height, width) int64, 0 where it is empty.

    Colors without a label count as empty if not `strict`, else the error names them.
    """
    whole, channels = fine.window, channels_of(fine.spec)

    def read(window: Window) -> np.ndarray:
        y = whole.top + np.arange(window.top, window.bottom) * whole.height // size.height
        x = np.arange(window.left, window.right) * whole.width // size.width
        rows = fine.read(Window(whole.left, int(y[0]), whole.right, int(y[-1]) + 1))[y - y[0]][:, x]
        met = meaning.codes_of(rows, channels)
        if channels.alpha is not None:
            met[as_float(rows[..., channels.alpha]) < 0.5] = 0
        place, stray = meaning.find(met)
        stray &= met != 0
        if stray.any() and strict:
            strays = Strays()
            strays.add(met, stray, whole.left + x, y)
            raise ImageError(f"the fine painting has {meaning.strays(strays, 'px')}")
        return np.where((met == 0) | stray, 0, meaning.keys[place, 0])

    return read


def painting_arrays(layers: dict[str, Quilt], exemplar: tuple[int, int]) -> dict[str, np.ndarray]:
    """Finished plans and what was painted, by prefix. The first is also what --texquilt:fromplan reads."""
    combined: dict[str, np.ndarray] = {}
    for prefix, layer in layers.items():
        arrays = layer.finished().arrays(exemplar)
        combined |= {f"{prefix}{name}": array for name, array in arrays.items()}
        combined[f"{prefix}keys"], combined[f"{prefix}guide"] = layer.demand.keys, present(layer.demand.guide)
    return combined


@dataclass(frozen=True)
class Begun:
    """A painting's layer from an earlier run."""

    plan: QuiltPlan
    demand: Demand  # what was painted
    path: Path  # its file, for messages
    fine: bool  # the painting has a fine layer

    def kept(self, grid: Grid, demand: Demand, flag: str) -> QuiltPlan:
        """The plan without the patches whose demand has changed. The grid must be the same."""
        g = self.plan.grid
        if g != grid:
            raise ImageError(
                f"{g.width}x{g.height} px with patches of {g.patch} px",
                parameter="fromplan",
                value=str(self.path),
                expected=f"{grid.width}x{grid.height} px with patches of {grid.patch} px, and the same tiles",
            )
        changed = self.demand.keys != demand.keys
        if demand.guide is not None:
            earlier = self.demand.guide
            if earlier is None or earlier.shape != demand.guide.shape:
                expected = f"a plan of {texture_filter('paint')}"
                raise ImageError(parameter="fromplan", value=str(self.path), expected=expected)
            changed |= (earlier != demand.guide).any((2, 3))
        log.info("%s: %d of %d patches change", flag, np.count_nonzero(changed), changed.size)
        offsets = np.where(changed, NONE, self.plan.offsets)
        return QuiltPlan(grid, offsets, self.plan.vertical.copy(), self.plan.horizontal.copy())


def read_begun(path: Path, budget: int, prefix: str = "") -> Begun | None:
    """Read a painting's layer. None: it has no such layer. A plan of --texquilt is refused."""
    arrays = read_arrays(path, budget)
    if "keys" not in arrays:
        expected = f"a plan of {texture_filter('paint')}"
        raise ImageError(parameter="fromplan", value=str(path), expected=expected)
    if f"{prefix}keys" not in arrays:
        return None
    plan, _ = QuiltPlan.of(arrays, path, prefix)
    if f"{prefix}guide" not in arrays:
        raise ImageError(f"{path} is not a complete plan")
    keys, guide = (arrays[f"{prefix}{name}"] for name in ("keys", "guide"))
    fine = "fine_keys" in arrays
    if keys.shape != plan.grid.shape or guide.shape[:2] != plan.grid.shape:
        raise ImageError(f"{path} is not a complete plan")
    return Begun(plan, Demand(keys, guide), path, fine)
