# SPDX-License-Identifier: Apache-2.0
"""Mean field of a Potts model: memberships smoothed over neighbors."""

from __future__ import annotations

import numpy as np

from ...engine.core.elementary import logarithm
from ...engine.opencl.buffers import Buffers
from ...engine.session.resources import Resources
from .products import TASK

_COUPLING, _UPDATES = 4.0, 6  # of a superpixel to its neighbors, nats; number of updates
_BLOCK = 16  # places per item on CPUs (cl/potts.cl)
UNLIKELY = 1e-3  # least likelihood of a label


def settled(likely: np.ndarray, edges: np.ndarray, resources: Resources) -> np.ndarray:
    """Labels of superpixels after smoothing over their neighbors.

    `likely` (r, n) float; `edges` (m, 2) int; returns (n,) int64.
    """
    labels, places = likely.shape
    ends = np.concatenate([edges, edges[:, ::-1]])
    ends = ends[np.argsort(ends[:, 0], kind="stable")]
    starts = np.searchsorted(ends[:, 0], np.arange(places + 1)).astype(np.int32)
    tables: dict[str, np.ndarray] = {
        "starts": starts, "neighbors": np.append(ends[:, 1], 0).astype(np.int32),
        "alone": logarithm(likely + UNLIKELY).astype(np.float32), "seen": np.ones(places, np.uint8),
    }  # fmt: skip
    layout = {"member": 4 * likely.size, "around": 4 * likely.size}
    run, items = resources.device.program("potts"), _blocks(places, resources)
    with Buffers(resources.device, layout, resources.budget, TASK, tables=tables) as buffers:
        resources.device.write(buffers["member"], likely.astype(np.float32))
        among = [buffers[name] for name in ("starts", "neighbors", "member", "around")]
        become = [buffers[name] for name in ("alone", "around", "seen", "member")]
        for _ in range(_UPDATES):
            run("around", (places, labels), *among, places, labels)
            run("members", items, *become, places, labels, _COUPLING)
        return resources.device.read(buffers["member"], likely.shape, np.float32).argmax(0)


def _blocks(places: int, resources: Resources) -> tuple[int]:
    """Work items of the kernel "members"."""
    return (-(-places // (_BLOCK if resources.device.lanes > 1 else 1)),)


def members(
    alone: np.ndarray, around: np.ndarray, seen: np.ndarray, coupling: float, resources: Resources
) -> np.ndarray:
    """Memberships proportional to e^(alone + coupling around), which sum to 1 where `seen`.

    Parameters
    ----------
    alone, around : (r, n) float32
    seen : (n,) bool
    coupling : float
        Nats.

    Returns
    -------
    (r, n) float32
    """
    tables = {"alone": alone, "around": around, "seen": seen.astype(np.uint8)}
    with Buffers(resources.device, {"member": alone.nbytes}, resources.budget, TASK, tables=tables) as buffers:
        arguments = [buffers[name] for name in (*tables, "member")]
        items, places = _blocks(alone.shape[1], resources), alone.shape[::-1]
        resources.device.program("potts")("members", items, *arguments, *places, coupling)
        return resources.device.read(buffers["member"], alone.shape, np.float32)


def winners(votes: np.ndarray, side: int, shape: tuple[int, int], resources: Resources) -> np.ndarray:
    """Label with most votes at each pixel, ties to the first, (h, w) uint8.

    Parameters
    ----------
    votes : (r, down, across) float32
        Nonnegative votes of cells, interpolated linearly between their centers; r is at most 256.
    side : int
        Side of a cell, px.
    shape : (int, int)
        h and w.
    """
    labels, down, across = votes.shape
    tables = {"votes": np.ascontiguousarray(votes)}
    lows, shares = [], []
    for size, cells in zip(shape, (down, across), strict=True):
        at = np.clip((np.arange(size) + 0.5) / side - 0.5, 0, cells - 1)
        lows.append(np.minimum(at.astype(np.int32), max(cells - 2, 0)))
        shares.append((at - lows[-1]).astype(np.float32))
    tables |= {"rows": lows[0], "columns": lows[1], "below": shares[0], "right": shares[1]}
    height, width = shape
    with Buffers(resources.device, {"winners": height * width}, resources.budget, TASK, tables=tables) as buffers:
        arguments = [buffers[name] for name in (*tables, "winners")]
        run = resources.device.program("potts")
        run("winners", (width, height), *arguments, width, height, across, down, labels)
        return resources.device.read(buffers["winners"], shape, np.uint8)
