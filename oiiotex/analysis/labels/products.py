# SPDX-License-Identifier: Apache-2.0
"""Products of thin matrices on the device, with float sums in one fixed order, independent of BLAS and threads."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...engine.opencl.buffers import Buffers
from ...engine.session.resources import Resources

LANES = 8  # to which rows are padded: columns that a kernel adds at once
SPREAD = 48  # columns to which a CPU's work item applies an entry of a sparse matrix (cl/factorization.cl)
TASK = "labels"  # task name in memory errors


@dataclass(frozen=True)
class Sparse:
    """A square sparse matrix in CSR form: entries starts[i] to starts[i + 1] - 1 belong to row i."""

    starts: np.ndarray
    columns: np.ndarray
    weights: np.ndarray

    @property
    def rows(self) -> int:
        """Number of rows, and of columns."""
        return len(self.starts) - 1


def padded(matrix: np.ndarray) -> np.ndarray:
    """A float32 matrix with rows padded to `LANES` by zeros."""
    rows, columns = matrix.shape
    wide = np.zeros((rows, columns + -columns % LANES), np.float32)
    wide[:, :columns] = matrix
    return wide


def product(a: np.ndarray, b: np.ndarray, resources: Resources) -> np.ndarray:
    """a b, (n, k) by (k, m) float32."""
    right = padded(b)
    (rows, inner), width = a.shape, right.shape[1]
    return _made("product", a, right, (width, rows), (rows, width), (rows, inner, inner, width), resources)[
        :, : b.shape[1]
    ]


def gram(a: np.ndarray, b: np.ndarray, resources: Resources) -> np.ndarray:
    """a^T b, (n, k) and (n, m) float32."""
    left, right = padded(a), padded(b)
    tall, width = left.shape[1], right.shape[1]
    made = _made("gram", left, right, (width, -tall), (tall, width), (len(a), tall, width), resources)
    return made[: a.shape[1], : b.shape[1]]


def _made(
    kernel: str, a: np.ndarray, b: np.ndarray, items: tuple[int, int], shape: tuple[int, int],
    numbers: tuple[int, ...], resources: Resources,
) -> np.ndarray:  # fmt: skip
    device = resources.device
    wide = wide_of(resources)
    across, down = -(-items[0] // wide), items[1] if items[1] > 0 else -(items[1] // wide)
    tables = {"a": np.ascontiguousarray(a, np.float32), "b": b}
    with Buffers(device, {"out": 4 * math.prod(shape)}, resources.budget, TASK, tables=tables) as buffers:
        device.program("factorization")(kernel, (across, down), buffers["a"], buffers["b"], buffers["out"], *numbers)
        return device.read(buffers["out"], shape, np.float32)


def wide_of(resources: Resources) -> int:
    """Columns computed by a work item (cl/factorization.cl)."""
    return LANES if resources.device.lanes > 1 else 1


class Spread:
    """Products of one sparse matrix, which is kept on the device, with matrices of `width` columns.

    `width` is a multiple of `SPREAD`.
    """

    def __init__(self, matrix: Sparse, width: int, resources: Resources):
        self._resources, self._shape = resources, (matrix.rows, width)
        size = 4 * matrix.rows * width
        tables = {"starts": matrix.starts, "columns": matrix.columns, "weights": matrix.weights}
        self._buffers = Buffers(
            resources.device, {"x": size, "before": size, "out": size}, resources.budget, TASK, tables=tables
        )
        resources.device.fill(self._buffers["before"], np.float32(0), matrix.rows * width)  # 0 times NaN would be NaN

    def __enter__(self) -> Spread:
        return self

    def __exit__(self, *_: object) -> None:
        self._buffers.__exit__()

    def start(self, x: np.ndarray) -> None:
        """Set x, the matrix to multiply, (n, width) float32."""
        self._resources.device.write(self._buffers["x"], x)

    def step(self, alpha: float, beta: float, gamma: float) -> None:
        """Replace x and the previous x by alpha S x + beta x + gamma previous, and x."""
        rows, width = self._shape
        names = ("starts", "columns", "weights", "x", "before", "out")
        blocks = width // (SPREAD if self._resources.device.lanes > 1 else 1)
        run = self._resources.device.program("factorization")
        run("spread", (rows * blocks,), *(self._buffers[name] for name in names), rows, width, alpha, beta, gamma)
        self._buffers.swap("before", "out")
        self._buffers.swap("x", "before")

    def once(self, vector: np.ndarray) -> np.ndarray:
        """S times a vector, (n,) float32; overwrites the state of `step`."""
        device, rows = self._resources.device, self._shape[0]
        device.write(self._buffers["x"], vector)
        tables = [self._buffers[name] for name in ("starts", "columns", "weights", "x", "out")]
        device.program("factorization")("step", (rows,), *tables, rows)
        return device.read(self._buffers["out"], (rows,), np.float32)

    def now(self) -> np.ndarray:
        """X."""
        return self._resources.device.read(self._buffers["x"], self._shape, np.float32)
