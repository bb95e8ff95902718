# SPDX-License-Identifier: Apache-2.0
"""A quilt as data: a grid of patches, and a plan of offsets and cuts that gives any window.

LSA16 section 6.1: only the exemplar, patch indices and some stitching information need to be kept.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from ...engine.core.source_map import NONE, SourceMap
from ...engine.core.window import Domain, Window
from ...engine.deferred import np
from ...engine.errors import ImageError
from ...engine.io.documents import read_arrays
from ...engine.opencl.buffers import Buffers, in_smaller_pieces
from ...engine.opencl.device import Device

MOST_PATCH = 256
AT_ONCE = 1 << 20  # pixels of the largest window rendered at a time
_FACTS = 26  # cl/quilting.cl, facts
_VERSION = 1
_SIDE = (1, (1 << 31) - 1)
# minimum and maximum of each fact of a saved plan: version, size, patch, overlap, wraps, exemplar's size
_SAVED = ((_VERSION, _VERSION), _SIDE, _SIDE, (2, MOST_PATCH), (1, MOST_PATCH - 1), (0, 1), (0, 1), *[(1, 65536)] * 2)


@dataclass(frozen=True, kw_only=True)
class Grid(Domain):
    """The places of patches in the output. Along a wrapped axis they are slightly closer to fit its size."""

    patch: int  # side, px
    overlap: int  # of neighbors, at most a third of a patch

    def __post_init__(self) -> None:
        if 3 * self.overlap > self.patch:
            problem = f"patches of {self.patch} px overlap by {self.overlap} px"
            raise ImageError(problem, expected=f"at most {self.patch // 3} px, a third of a patch")
        for size, wraps, axis in ((self.width, self.wrap_x, "wide"), (self.height, self.wrap_y, "high")):
            if wraps and size < self.patch:
                raise ImageError(f"the tile is {size} px {axis}", expected=f"at least {self.patch} px, the patch size")

    @property
    def step(self) -> int:
        """Maximum distance between neighboring patches."""
        return self.patch - self.overlap

    @property
    def xs(self) -> np.ndarray:
        """First pixels of columns of cells."""
        return _places(self.width, self.step, self.overlap, self.wrap_x)

    @property
    def ys(self) -> np.ndarray:
        """First pixels of rows of cells.

        A torus starts `overlap` px above the output: its closing seam then lies in the last rows, and the first rows
        are known before the last.
        """
        places = _places(self.height, self.step, self.overlap, self.wrap_y)
        return places - self.overlap if self.wrap_y else places

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of cells."""
        return len(self.ys), len(self.xs)

    def waves(self) -> tuple[np.ndarray, np.ndarray]:
        """Cells in the order in which they are decided, and the start of each wave in it."""
        rows, columns = self.shape
        i, j = np.divmod(np.arange(rows * columns, dtype=np.uint32), np.uint32(columns))
        wave = j + np.uint32(2) * i
        order = np.argsort(wave, kind="stable").astype(np.uint32)
        return order, np.append(0, np.bincount(wave).cumsum())

    def wave_of(self, window: Window) -> int:
        """Number of waves that must be decided before a window of the output can be made."""
        rows, columns = self.shape
        last = int(np.searchsorted(self.ys, window.bottom - 1, "right")) - 1
        if self.wrap_y and window.bottom > self.height - self.overlap:  # where the torus closes
            last = rows - 1
        return 2 * last + columns


def _places(size: int, step: int, overlap: int, wraps: bool) -> np.ndarray:
    if not wraps:
        return np.arange(max(1, -(-(size - overlap) // step)), dtype=np.int32) * np.int32(step)
    count = max(2, -(-size // step))
    return (np.arange(count, dtype=np.int64) * size // count).astype(np.int32)


@dataclass
class QuiltPlan:
    """The plan of the output: together with the exemplar it gives every pixel.

    Pixel (x, y) of a patch is visible where x >= vertical[y] and y >= horizontal[x].
    """

    ARRAYS: ClassVar[tuple[str, ...]] = ("facts", "offsets", "vertical", "horizontal")

    grid: Grid
    offsets: np.ndarray  # (rows, columns) uint32: top left of a cell's patch, as `SourceMap.packed`; NONE: undecided
    vertical: np.ndarray  # (rows, columns, patch) uint8, as horizontal
    horizontal: np.ndarray

    @classmethod
    def empty(cls, grid: Grid) -> QuiltPlan:
        """A plan without patches."""
        cuts = (np.zeros((*grid.shape, grid.patch), np.uint8) for _ in range(2))
        return cls(grid, np.full(grid.shape, NONE, np.uint32), *cuts)

    def arrays(self, exemplar: tuple[int, int]) -> dict[str, np.ndarray]:
        """The contents of its file, by name."""
        g = self.grid
        facts = np.array([_VERSION, g.width, g.height, g.patch, g.overlap, *g.wraps, *exemplar], np.int64)
        return {"facts": facts, "offsets": self.offsets, "vertical": self.vertical, "horizontal": self.horizontal}

    @classmethod
    def load(cls, path: Path, budget: int) -> tuple[QuiltPlan, tuple[int, int]]:
        """Read a plan, and its exemplar's size. Files that are inconsistent or would read out of bounds are refused."""
        return cls.of(read_arrays(path, budget), path)

    @classmethod
    def of(cls, arrays: Mapping[str, np.ndarray], path: Path, prefix: str = "") -> tuple[QuiltPlan, tuple[int, int]]:
        """As `load`, from a file's arrays whose names begin with `prefix`."""
        try:
            facts, offsets, vertical, horizontal = (arrays[f"{prefix}{name}"] for name in cls.ARRAYS)
        except KeyError as error:
            raise ImageError(f"cannot read a plan from {path}: it has no {error}") from error
        if facts.shape != (len(_SAVED),) or facts.dtype != np.int64 or facts[0] != _VERSION:
            raise ImageError(f"{path} is a plan of another version", hint="write the plan again")
        _, width, height, patch, overlap, wrap_x, wrap_y, *exemplar = values = tuple(map(int, facts))
        sound = all(low <= fact <= high for fact, (low, high) in zip(values, _SAVED, strict=True)) and overlap < patch
        sound &= (offsets.dtype, vertical.dtype, horizontal.dtype) == tuple(map(np.dtype, ("u4", "u1", "u1")))
        # check before building a grid: a wrong size would allocate large arrays of places
        if not sound or offsets.ndim != 2 or height > offsets.shape[0] * patch or width > offsets.shape[1] * patch:
            raise ImageError(f"{path} is not a complete plan")
        grid = Grid(width, height, bool(wrap_x), bool(wrap_y), patch=patch, overlap=overlap)
        plan = cls(grid, offsets, vertical, horizontal)
        y, x = SourceMap(offsets).yx
        cuts = (*plan.grid.shape, patch)
        fits = offsets.shape == plan.grid.shape and vertical.shape == cuts == horizontal.shape
        if not fits or (y + patch > exemplar[1]).any() or (x + patch > exemplar[0]).any():
            raise ImageError(f"{path} is not a complete plan")
        before_first = (not wrap_x and vertical[:, 0].any()) or (not wrap_y and horizontal[0].any())
        if before_first or max(vertical.max(), horizontal.max()) >= overlap:
            raise ImageError(f"{path} is not a complete plan")
        return plan, (exemplar[0], exemplar[1])


def plan_bytes(grid: Grid, pixels: int) -> dict[str, int]:
    """Device memory of a plan that is rendered, at most `pixels` at a time."""
    cells = math.prod(grid.shape)
    cuts = grid.patch * cells
    return {"offset": 4 * cells, "vertical": cuts, "horizontal": cuts, "source": 4 * pixels}


class Renderer:
    """Source coordinates of any window, from a plan on the device.

    Parameters
    ----------
    buffers : mapping
        With at least `plan_bytes`.
    facts : sequence of int
        Kernel arguments in addition to the grid.
    pixels : int
        Maximum number of pixels rendered at a time.
    lock : lock, optional
        Held while the device is used.
    """

    def __init__(
        self,
        device: Device,
        buffers: Mapping[str, Any] | Buffers,
        grid: Grid,
        facts: Sequence[int],
        pixels: int,
        lock: threading.Lock | None = None,
    ):
        self._device, self._buffers, self._grid, self._pixels = device, buffers, grid, pixels
        self._run = device.program("quilting")
        self._lock = lock or threading.Lock()
        g = grid
        rows, columns = g.shape
        all_facts = [g.patch, g.overlap, g.width, g.height, columns, rows, *g.wraps, *facts]
        all_facts += [0] * (_FACTS - len(all_facts))
        tables = (np.array(all_facts, np.int64).astype(np.uint32), g.xs, g.ys)
        self.plan = (*map(device.upload, tables), buffers["offset"], buffers["vertical"], buffers["horizontal"])

    @classmethod
    def of(cls, device: Device, plan: QuiltPlan, budget: int) -> Renderer:
        """A renderer of a finished plan."""
        task = f"a plan of {plan.grid.width}x{plan.grid.height}"
        buffers = Buffers(device, plan_bytes(plan.grid, AT_ONCE), budget, task)
        for name, array in (("offset", plan.offsets), ("vertical", plan.vertical), ("horizontal", plan.horizontal)):
            device.write(buffers[name], array)
        return cls(device, buffers, plan.grid, [], AT_ONCE)

    def sources(self, window: Window) -> SourceMap:
        """The exemplar pixel at each pixel of the window."""
        return SourceMap(in_smaller_pieces(lambda pixels: self._in_pieces(window, pixels), self._pixels, window.width))

    def _in_pieces(self, window: Window, pixels: int) -> np.ndarray:
        pieces = window.cells(window.width, max(1, pixels // max(1, window.width)))
        rendered = [self._rendered(piece) for piece in pieces]
        return rendered[0] if len(rendered) == 1 else np.concatenate(rendered)

    def _rendered(self, window: Window) -> np.ndarray:
        g = self._grid
        column = np.searchsorted(g.xs, np.arange(window.left, window.right), "right") - 1
        row = np.searchsorted(g.ys, np.arange(window.top, window.bottom), "right") - 1
        if g.wrap_y:  # the first row of cells begins above the output, at its lower end
            row[np.arange(window.top, window.bottom) >= g.height + g.ys[0]] = 0
        with self._lock:
            places = [self._device.upload(p.astype(np.int32)) for p in (column, row)]
            source, size = self._buffers["source"], (window.width, window.height)
            self._run("render", size, *self.plan, *places, source, window.left, window.top, *size)
            return self._device.read(source, (window.height, window.width), np.uint32)

    def read(self) -> QuiltPlan:
        """Read the plan back from the device."""
        shape, b = self._grid.shape, self._buffers
        with self._lock:
            cuts = (self._device.read(b[n], (*shape, self._grid.patch), np.uint8) for n in ("vertical", "horizontal"))
            return QuiltPlan(self._grid, self._device.read(b["offset"], shape, np.uint32), *cuts)
