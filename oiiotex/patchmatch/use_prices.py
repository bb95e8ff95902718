# SPDX-License-Identifier: Apache-2.0
"""What the use of exemplar patches costs so that no region is shown again and again and no texture is lost.

MJH17 evens out the use of single patches (eq. 6), in proportion to their use. Two things stay as they are then:

- One stone is shown ten times: a proportional price that ends this punishes all uses, also those that are few. Here
  (departure) a region of `REGION` px pays nothing up to a number of uses, and the square of what is above it.
- Where a part of the photo is flat, the mean of votes, being smoother than any texture, is nearest to flat patches;
  they win everywhere. Here (departure) the tile may not be flatter than the photo: for every bound on the activity of a
  patch, no more patches of the tile may lie below it than of the photo. These are linear constraints on the field; each
  has a price that rises while it is broken (dual ascent), as in semi-discrete optimal transport.
"""

from __future__ import annotations

from typing import NamedTuple

from ..core.source_map import SourceMap
from ..deferred import np
from ..opencl.buffers import Buffers
from ..opencl.device import Device
from .field import Geometry, box_sums

REGION = 32  # px at full size, a side of what is seen again
KINDS = 16  # of patches, by their activity
FLAT = 1 / 8  # of the mean activity of what is not flat: up to this patches are flat
STEPS = 0.05, 1.5  # how fast a price of flatness moves, in patch variances for a share of all patches: least, greatest
SLACK = 0.02  # share of patches by which the tile may be flatter
REPEATS = 2.5  # uses of a region that are free
FAIR = 1.25  # the same, times its share of the target
GROWTH = 1.0  # what one use more costs, in patch variances
_BAND = 128  # rows worked on at a time
_HANDED_ON = "kind_duals", "kind_steps"


class Lost(NamedTuple):
    """Texture of an exemplar that its tile does not show.

    Attributes
    ----------
    own, shown : float
        Share of blocks that are not flat, of the exemplar and of the tile.
    """

    own: float
    shown: float

    @property
    def share(self) -> float:
        """Of the tile, that should not be flat."""
        return max(0.0, self.own - self.shown)


def layout(geometry: Geometry) -> dict[str, int]:
    """Device memory that it needs, in bytes by name."""
    exemplar = geometry.exemplar_width * geometry.exemplar_height
    small = dict.fromkeys(("kind_counts", "kind_most", "kind_duals", "kind_steps", "kind_prices"), 4 * KINDS)
    return {"kinds": exemplar, "region_sums": 4 * exemplar, **small}


def handed_on(device: Device, buffers: Buffers) -> np.ndarray:
    """What one level hands the next: the prices of constraints and how fast they move, (2, KINDS) int32."""
    return np.stack([device.read(buffers[name], (KINDS,), np.int32) for name in _HANDED_ON])


def hand_on(device: Device, buffers: Buffers, prices: np.ndarray) -> None:
    """Put there what `handed_on` gave, before the next level begins."""
    for name, values in zip(_HANDED_ON, prices, strict=True):
        device.write(buffers[name], values)


def activity(image: np.ndarray, patch: int) -> np.ndarray:
    """How active the least active quarter of every patch is: a patch on the edge of something flat is flat.

    By the whole patch that edge would be the most active of all, and tiles would fill with it.

    (height, width, channels) int16 -> (rows, columns) float32.
    """
    quarter = (patch + 1) // 2
    of, beyond = deviation(image, quarter), patch - quarter
    rows, columns = of.shape[0] - beyond, of.shape[1] - beyond
    return np.minimum.reduce([of[y : y + rows, x : x + columns] for y in (0, beyond) for x in (0, beyond)])


def deviation(image: np.ndarray, side: int) -> np.ndarray:
    """Squared deviation of every block from its own mean, summed over pixels and channels, times the number of pixels.

    (height, width, channels) int16 -> (rows, columns) float32: whole numbers, rounded once.
    """
    rows, columns, n = image.shape[0] - side + 1, image.shape[1] - side + 1, side * side
    deviations = np.empty((rows, columns), np.float32)
    for top in range(0, rows, _BAND):  # bands keep the temporaries small
        band = image[top : min(top + _BAND, rows) + side - 1].astype(np.int64)
        planes = (band[..., c] for c in range(image.shape[2]))
        squared = (n * box_sums(plane * plane, side) - box_sums(plane, side) ** 2 for plane in planes)
        deviations[top : top + _BAND] = sum(squared)
    return deviations


def flat_bound(own: np.ndarray) -> np.float32:
    """Up to which activity a patch is flat, among such: flat ones have no say in it."""
    bound, before = np.float32(0), None
    while bound != before:  # it only rises
        before = bound
        rest = own[own > bound]
        bound = np.float32(FLAT * rest.mean(dtype=np.float64)) if len(rest) else before
    return bound


def kinds_of(active: np.ndarray, allowed: np.ndarray) -> np.ndarray:
    """Patches by activity, the flattest first, in `KINDS` kinds: uint8.

    They are as equal in number as ties allow, but that one of their bounds is that of flat ones.
    """
    own = active[allowed]
    bounds = np.quantile(own, np.arange(1, KINDS - 1) / (KINDS - 1), method="inverted_cdf")
    return np.searchsorted(np.sort(np.append(bounds, flat_bound(own))), active, side="left").astype(np.uint8)


def lost_texture(source: SourceMap, exemplar: np.ndarray, allowed: np.ndarray, geometry: Geometry) -> Lost:
    """What a tile lacks.

    Parameters
    ----------
    source : SourceMap
        (height, width): where the tile's pixels come from.
    exemplar : (exemplar_height, exemplar_width, channels) int16
    allowed : (exemplar_rows, exemplar_columns) bool
    geometry : Geometry
    """
    side = geometry.patch
    own = deviation(exemplar, side)[allowed]
    flat = flat_bound(own)
    down, right = (0 if wraps else side - 1 for wraps in (geometry.wrap_y, geometry.wrap_x))
    height, width = source.packed.shape
    textured = 0
    for top in range(0, height - down, _BAND):
        bottom = min(top + _BAND, height - down) + side - 1
        rows = source[top : min(bottom, height)].packed
        if bottom > height:
            rows = np.concatenate([rows, source[: bottom - height].packed])
        if not right:
            rows = np.pad(rows, ((0, 0), (0, side - 1)), mode="wrap")
        textured += int(np.count_nonzero(deviation(SourceMap(rows).gather(exemplar), side) > flat))
    return Lost(float((own > flat).mean()), textured / ((height - down) * (width - right)))


class UsePrices:
    """Both prices on one level, added to the penalties of a `Matcher`.

    Parameters
    ----------
    device : Device
    buffers : Buffers
        At least `layout()`; the prices of constraints go from one level to the next in them.
    geometry : Geometry
    exemplar : (exemplar_height, exemplar_width, channels) int16
    allowed : (exemplar_rows, exemplar_columns) bool
    scale : float
        Of the level.
    variance : float
        Of the exemplar's pixels, summed over channels, in squared grid steps.
    first : bool
        There is no coarser level.
    """

    def __init__(
        self, device: Device, buffers: Buffers, geometry: Geometry, exemplar: np.ndarray, allowed: np.ndarray,
        scale: float, variance: float, first: bool,
    ):  # fmt: skip
        self._device, self._buffers, self._geometry = device, buffers, g = device, buffers, geometry
        self._run = device.program("use_prices")
        kinds = kinds_of(activity(exemplar, g.patch), allowed)
        patches = g.columns * g.rows
        share = np.bincount(kinds[allowed], minlength=KINDS).cumsum() / np.count_nonzero(allowed)
        device.write(buffers["kinds"], kinds)
        device.write(buffers["kind_most"], np.floor(patches * np.minimum(1.0, share + SLACK)).astype(np.int32))
        unit = g.patch**2 * variance
        *self._steps, self._growth = (min(int(unit * k), 100_000_000) for k in (*STEPS, GROWTH))
        if first:
            device.fill(buffers["kind_duals"], np.int32(0), KINDS)
            device.fill(buffers["kind_steps"], np.int32(self._steps[1]), KINDS)
        self._side = max(1, min(round(REGION * scale), g.exemplar_columns, g.exemplar_rows))
        fair = patches / np.count_nonzero(allowed)
        self._most = int(max(REPEATS, FAIR * fair) * self._side**2)

    def begin(self) -> None:
        """Nothing of the present field is counted."""
        self._device.fill(self._buffers["kind_counts"], np.int32(0), KINDS)

    def count(self, rows: int) -> None:
        """Count the first rows of buffer `field`."""
        g, b, field = self._geometry, self._buffers, (self._geometry.columns, rows)
        self._run("count", field, b["field"], b["kinds"], b["kind_counts"], *field, g.exemplar_columns)

    def add(self) -> None:
        """Add to buffer `penalty` what the present field, of which `count` has seen all, makes dear."""
        g, b = self._geometry, self._buffers
        patches, size = g.columns * g.rows, (g.exemplar_columns, g.exemplar_rows)
        self._run(
            "ascend", (1,), b["kind_counts"], b["kind_most"], b["kind_duals"], b["kind_steps"], b["kind_prices"], KINDS,
            patches, *self._steps,
        )  # fmt: skip
        self._run("rows", size, b["count"], b["region_sums"], *size, self._side)
        self._run(
            "add", size, b["region_sums"], b["kinds"], b["kind_prices"], b["penalty"], *size,
            self._side, self._most, self._growth,
        )  # fmt: skip
