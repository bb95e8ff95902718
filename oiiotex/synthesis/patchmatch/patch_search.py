# SPDX-License-Identifier: Apache-2.0
"""Where a pass looks for better matches after propagation: at random (PatchMatch), or by exact nearest neighbors.

The second is a way around the patents on randomized search (docs/explanation/patents.md). With propagation it is the
k-coherence search of Tong, Zhang, Liu, Wang, Guo and Shum, Synthesis of Bidirectional Texture Functions on Arbitrary
Surfaces, SIGGRAPH 2002, section 4. Departures:

- A match has the links of its cell of a few pixels, so that a table costs the same for any photo.
- Links are followed one after the other, from the best match so far.
- Finer levels follow one link. More find plainer patches, which are nearer to a mean of votes: fills lose sharpness.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from ...engine.core.demand import SomeRows
from ...engine.deferred import np
from ...engine.opencl.device import Device
from .field import Geometry

if TYPE_CHECKING:
    import pyopencl as cl

RANDOM, COHERENT = "random", "coherent"
SEARCH_HELP = (
    "How better matches of patches are found. random: in random windows, as in PatchMatch (BSFG09). coherent: among"
    " exact nearest neighbors (k-coherence), without random candidates; use it if patents on PatchMatch concern you."
)
WINDOWS, FINE_WINDOWS = 6, 3  # of random search, from the exemplar down to about 2 px; finer levels: the narrowest
LINKS, FINE_LINKS = 8, 1  # of a cell, and of these on finer levels: more links there find plainer patches, and blur
_CELLS = 2048  # of an exemplar, about; each is named by its first patch
_NEAREST = 12  # neighbors that links are chosen from
_APART = 4  # links are at least a patch / 4 away from each other, and from their cell
_SCALE = 64  # of the integer weights of a cosine wave


@dataclass(frozen=True)
class PatchSearch:
    """Candidates of each match, tried one after the other; each depends on the best match so far."""

    kernel: str  # of cl/patchmatch.cl
    table: cl.Buffer
    count: int  # candidates of a pass
    first: np.uint32  # of the two numbers that the kernel takes
    second: np.uint32 | None = None  # None: the number of the pass


def random_windows(device: Device, geometry: Geometry, seed: int, count: int = WINDOWS) -> PatchSearch:
    """One random candidate in each of the `count` narrowest windows around the best match (BSFG09 section 3.2)."""
    reach = max(geometry.exemplar_columns, geometry.exemplar_rows)
    shrink = (2.0 / reach) ** (1.0 / (WINDOWS - 1))
    radius = [max(1, int(reach * shrink**k)) for k in range(WINDOWS)][-max(1, count) :]
    return PatchSearch("search", device.upload(np.array(radius, np.int32)), count, np.uint32(seed & 0xFFFFFFFF))


def coherent_links(device: Device, links: Links, count: int = LINKS) -> PatchSearch:
    """The patches most similar to the best match, by the links of its cell."""
    side, across = np.uint32(links.side), np.uint32(links.places.shape[1])
    return PatchSearch("follow", device.upload(links.places), count, side, across)


class Links(NamedTuple):
    """Similar patches of an exemplar.

    Attributes
    ----------
    side : int
        Side of a cell, px.
    places : (rows, columns, LINKS) uint32
        For the first patch of each cell, the corners of others, y << 16 | x, most similar first. Its own: no further.
    """

    side: int
    places: np.ndarray

    @classmethod
    def of(cls, exemplar: SomeRows, allowed: np.ndarray, geometry: Geometry) -> Links:
        """Exact nearest neighbors of the reduced patches, which are integers: any processor finds the same.

        `exemplar` (exemplar_height, exemplar_width, channels) int16; `allowed` (exemplar_rows, exemplar_columns) bool.
        """
        from scipy.spatial import cKDTree  # slow to import

        side = max(1, math.ceil(math.sqrt(int(np.count_nonzero(allowed)) / _CELLS)))
        y, x = np.arange(0, allowed.shape[0], side), np.arange(0, allowed.shape[1], side)
        used = np.logical_or.reduceat(np.logical_or.reduceat(allowed, y), x, 1)
        row, column = np.nonzero(used)
        corner = np.stack([y[row], x[column]], 1)  # cells x 2
        reduced = _reduced(exemplar, y, x, geometry.patch)[used]
        own = np.arange(len(corner))
        near, usable = own[:, None], np.flatnonzero(allowed[corner[:, 0], corner[:, 1]])
        if len(usable):
            distance, index = cKDTree(reduced[usable]).query(reduced, np.arange(1, min(_NEAREST, len(usable)) + 1))
            order = np.lexsort((index, distance))  # ties by place
            near = usable[np.take_along_axis(index, order, 1)]
        chosen = _apart(corner, near, -(-geometry.patch // _APART))
        places = np.zeros((*used.shape, LINKS), np.uint32)
        places[used] = corner[chosen] @ np.array([1 << 16, 1])
        return cls(side, places)


SEARCHES: dict[str, Callable[[Device, Geometry, SomeRows, np.ndarray, int, bool], PatchSearch]] = {
    RANDOM: lambda device, geometry, exemplar, allowed, seed, fine: random_windows(
        device, geometry, seed, FINE_WINDOWS if fine else WINDOWS
    ),
    COHERENT: lambda device, geometry, exemplar, allowed, seed, fine: coherent_links(
        device, Links.of(exemplar, allowed, geometry), FINE_LINKS if fine else LINKS
    ),
}
"""By their names: the search of a level, `fine` or the coarsest. Arguments as of `Links.of`, and a seed."""


def _apart(corner: np.ndarray, near: np.ndarray, least: int) -> np.ndarray:
    """The first neighbors that are at least `least` px apart along an axis, (n, LINKS); the rest is the patch itself.

    `corner` (n, 2): places of the patches, px; `near` (n, k): indices of their neighbors, nearest first.
    """
    chosen, count = np.repeat(np.arange(len(corner))[:, None], LINKS + 1, 1), np.ones(len(corner), np.int64)
    for one in near.T:
        away = np.abs(corner[one][:, None] - corner[chosen]).max(2).min(1)  # of the patch and all chosen
        at = np.flatnonzero((away >= least) & (count <= LINKS))
        chosen[at, count[at]] = one[at]
        count[at] += 1
    return chosen[:, 1:]


def _reduced(exemplar: SomeRows, y: np.ndarray, x: np.ndarray, patch: int) -> np.ndarray:
    """Patches with corners at the rows `y` and columns `x`, as their slowest cosine waves: (rows, columns, n) integers.

    Principal components of patches of photos resemble these, and would depend on a linear algebra library.
    """
    waves = _waves(patch, exemplar.shape[2])
    reduced = np.empty((len(y), len(x), waves.shape[1]))
    for n, top in enumerate(y):
        rows = np.asarray(exemplar[top : top + patch])
        windows = np.lib.stride_tricks.sliding_window_view(rows, patch, 1)[:, x]  # patch x columns x channels x patch
        patches = windows.transpose(1, 0, 3, 2).reshape(len(x), -1)
        reduced[n] = patches.astype(np.float64) @ waves  # sums of integers below 2^53: exact in any order
    return np.rint(reduced / _SCALE)


def _waves(patch: int, channels: int) -> np.ndarray:
    """Integer weights of cosine waves: (patch * patch * channels, n) float64.

    The waves of each Lab image: of L up to two half waves, along x and y together, of a and b up to one.
    """
    phase = np.pi * (np.arange(patch) + 0.5) / patch
    along = [np.full(patch, 0.5**0.5), np.cos(phase), np.cos(2 * phase)]
    waves = []
    for channel in range(channels):
        most = 2 if channel % 3 == 0 else 1
        for down, across in ((v, u) for v in range(most + 1) for u in range(most + 1 - v)):
            wave = np.zeros((patch, patch, channels))
            wave[..., channel] = along[down][:, None] * along[across]
            waves.append(wave.ravel())
    return np.rint(_SCALE * np.stack(waves, 1))
