# SPDX-License-Identifier: Apache-2.0
"""Nearest-neighbour fields and voting on the device: MJH17 section 4.2, after BSFG09.

A target image is explained by an exemplar: for the patch at every target pixel the field names an exemplar patch.
Fields are (rows, columns) uint32 arrays of packed corners, `y << 16 | x`; images are (height, width, channels) int16
arrays on an integer grid (`grid_steps`): the three of Lab, and three more for each further map of a material.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..device import Buffers, Device

JUMPS = (4, 2, 1)
SEARCHES = 6  # windows of random search, from the whole exemplar down to about 2 px
MATCH_PASSES = 8  # for a field on its own, with nothing to refine it later
PICK_SIGMA = 3.0  # px; how fast a patch's say in the last vote falls off from its centre
_BAND = 128  # rows of a field worked on at a time


def grid_steps(patch: int, channels: int = 3) -> int:
    """Integer steps per Lab unit, 8 at most, such that a patch distance fits 32 bits.

    Lab is clamped to a cube 300 units wide (`LAB_LOW`, `LAB_HIGH`), so a distance is at most
    channels (300 steps)^2 patch^2 < 2^31, and the sum of a patch's column fits 16 bits.
    """
    return next(steps for steps in (8, 4, 2, 1) if channels * (300 * steps * patch) ** 2 < 1 << 31)


LAB_LOW = np.array([-16.0, -150.0, -150.0], np.float32)
LAB_HIGH = np.array([284.0, 150.0, 150.0], np.float32)


def to_grid(lab: np.ndarray, patch: int) -> np.ndarray:
    """Lab (..., channels) float -> int16 steps. All decisions are made on these: equal Lab decides alike everywhere."""
    channels = lab.shape[-1]
    steps, low, high = grid_steps(patch, channels), np.resize(LAB_LOW, channels), np.resize(LAB_HIGH, channels)
    return np.rint(np.clip(lab, low, high) * np.float32(steps)).astype(np.int16)


def unpack(field: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Packed corners -> (y, x), int64."""
    packed = field.astype(np.int64)
    return packed >> 16, packed & 0xFFFF


def pack(y: np.ndarray, x: np.ndarray) -> np.ndarray:
    """(y, x) -> packed corners, uint32."""
    return (np.asarray(y, np.uint32) << np.uint32(16)) | np.asarray(x, np.uint32)


@dataclass(frozen=True)
class Geometry:
    """Sizes of one pyramid level.

    `wrap_x`, `wrap_y`: the target is a torus along that axis. Where it is not, patches lie fully inside, so the field
    is `patch - 1` shorter than the target.
    """

    width: int
    height: int
    exemplar_width: int
    exemplar_height: int
    patch: int
    wrap_x: bool
    wrap_y: bool
    channels: int = 3

    @property
    def columns(self) -> int:
        """Patches of the target along x."""
        return self.width if self.wrap_x else self.width - self.patch + 1

    @property
    def rows(self) -> int:
        """Patches of the target along y."""
        return self.height if self.wrap_y else self.height - self.patch + 1

    @property
    def exemplar_columns(self) -> int:
        """Patches of the exemplar along x."""
        return self.exemplar_width - self.patch + 1

    @property
    def exemplar_rows(self) -> int:
        """Patches of the exemplar along y."""
        return self.exemplar_height - self.patch + 1

    @property
    def padded_width(self) -> int:
        """Of the target with the columns that patches at its right border see."""
        return self.width + self.patch - 1

    def layout(self) -> dict[str, int]:
        """Device memory that a `Matcher` of this geometry needs, in bytes by name."""
        pixels = self.width * self.height
        exemplar = self.exemplar_width * self.exemplar_height
        padded = self.padded_width * (self.height + self.patch - 1)
        bytes_of = 2 * self.channels
        return {
            "target": bytes_of * padded,
            "exemplar": bytes_of * exemplar,
            "image": bytes_of * pixels,
            "field": 4 * pixels,
            "field_next": 4 * pixels,
            "distance": 4 * pixels,
            "distance_next": 4 * pixels,
            "price": 4 * exemplar,
            "count": 4 * exemplar,
            "uses": 4 * exemplar,
            "penalty": 4 * exemplar,
        }


def allowed_patches(allowed: np.ndarray | None, geometry: Geometry) -> np.ndarray:
    """Which patches lie fully inside `allowed` (height, width) bool: (exemplar_rows, exemplar_columns) bool."""
    if allowed is None:
        return np.ones((geometry.exemplar_rows, geometry.exemplar_columns), bool)
    patch = geometry.patch
    sums = np.zeros((allowed.shape[0] + 1, allowed.shape[1] + 1), np.int64)
    sums[1:, 1:] = allowed.cumsum(0).cumsum(1)
    inside = sums[patch:, patch:] - sums[:-patch, patch:] - sums[patch:, :-patch] + sums[:-patch, :-patch]
    return inside == patch * patch


def random_field(geometry: Geometry, allowed: np.ndarray, seed: int, weights: np.ndarray | None = None) -> np.ndarray:
    """A scrambled start (MJH17 algorithm 1): blocks of patch size copied from random places.

    Blocks keep the exemplar's detail where single pixels would not. With `weights` (exemplar_rows, exemplar_columns)
    places are drawn as often as they weigh.
    """
    patch = geometry.patch
    rows, columns = np.mgrid[0 : geometry.rows, 0 : geometry.columns]
    y, x = _random_places(allowed, seed, 0xB10C, rows // patch, columns // patch, weights)
    y = np.minimum(y + rows % patch, geometry.exemplar_rows - 1)
    x = np.minimum(x + columns % patch, geometry.exemplar_columns - 1)
    return only_allowed(pack(y, x), allowed, seed, 0xB10D)


def _random_places(
    allowed: np.ndarray, seed: int, step: int, y: np.ndarray, x: np.ndarray, weights: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """A random allowed exemplar patch for every (y, x)."""
    places = np.flatnonzero(allowed)
    bits = hash_at(seed, step, y, x).astype(np.uint64)
    if weights is not None:
        below = np.cumsum(weights.ravel()[places], dtype=np.float64)
        at = np.searchsorted(below, bits * (below[-1] / 2.0**32), side="right")
        return np.divmod(places[np.minimum(at, len(places) - 1)], allowed.shape[1])
    return np.divmod(places[((bits * np.uint64(len(places))) >> np.uint64(32)).astype(np.int64)], allowed.shape[1])


def only_allowed(field: np.ndarray, allowed: np.ndarray, seed: int, step: int = 0xB10E) -> np.ndarray:
    """The field with every match that is not allowed replaced by a random one that is."""
    for begin in range(0, field.shape[0], _BAND):
        bad_y, bad_x = np.nonzero(~allowed[unpack(field[begin : begin + _BAND])])
        if len(bad_y):
            bad_y += begin
            field[bad_y, bad_x] = pack(*_random_places(allowed, seed, step, bad_y, bad_x))
    return field


def hash_at(seed: int, step: int, y: np.ndarray, x: np.ndarray) -> np.ndarray:
    """cl/hash.h's `hash_at` for arrays: 32 random bits from (seed, step, coordinates), uint32."""

    def pcg(v: np.ndarray) -> np.ndarray:
        state = v * np.uint32(747796405) + np.uint32(2891336453)
        word = ((state >> ((state >> np.uint32(28)) + np.uint32(4))) ^ state) * np.uint32(277803737)
        return (word >> np.uint32(22)) ^ word

    start = pcg(np.array([seed & 0xFFFFFFFF], np.uint32))
    bits = pcg(np.uint32(step) + start)
    return pcg(x.astype(np.uint32) + pcg(y.astype(np.uint32) + bits))


def upsample_field(field: np.ndarray, coarse: Geometry, fine: Geometry, allowed: np.ndarray, seed: int) -> np.ndarray:
    """A field carried to the next finer level.

    Patch centres are scaled; the offset inside a coarse pixel is kept, so that neighbours stay coherent.
    """

    def axis(n: int, from_n: int, ratio: float) -> tuple[np.ndarray, np.ndarray]:
        centre = np.arange(n) + fine.patch // 2 + 0.5
        source = np.clip((centre / ratio).astype(np.int64) - fine.patch // 2, 0, from_n - 1)
        return source, centre - (source + fine.patch // 2 + 0.5) * ratio

    from_y, rest_y = axis(fine.rows, coarse.rows, fine.height / coarse.height)
    from_x, rest_x = axis(fine.columns, coarse.columns, fine.width / coarse.width)
    half = fine.patch // 2
    ratio_y = fine.exemplar_height / coarse.exemplar_height
    ratio_x = fine.exemplar_width / coarse.exemplar_width
    finer = np.empty((fine.rows, fine.columns), np.uint32)
    for begin in range(0, fine.rows, _BAND):  # bands keep the temporaries small
        band = slice(begin, begin + _BAND)
        y, x = unpack(field[from_y[band]][:, from_x])
        y = np.floor((y + half + 0.5) * ratio_y + rest_y[band, None]).astype(np.int64) - half
        x = np.floor((x + half + 0.5) * ratio_x + rest_x[None, :]).astype(np.int64) - half
        finer[band] = pack(np.clip(y, 0, fine.exemplar_rows - 1), np.clip(x, 0, fine.exemplar_columns - 1))
    return only_allowed(finer, allowed, seed, fine.width)


class Matcher:
    """PatchMatch at one pyramid level: holds target, exemplar and field on the device.

    Parameters
    ----------
    device : Device
    buffers : Buffers
        At least `geometry.layout()`.
    geometry : Geometry
    exemplar : (exemplar_height, exemplar_width, 3) int16
    allowed : (exemplar_rows, exemplar_columns) bool
        Exemplar patches that may be matched.
    field : (rows, columns) uint32
        Where to start.
    uniformity : float
        Weight lambda of the spatial uniformity term, in units of the exemplar's variance.
    seed : int
    searches : int
        How many of the `SEARCHES` windows are searched, the narrowest ones.
    usable : (exemplar_height, exemplar_width) bool or None
        Pixels of the exemplar among which use is evened out; None: all.
    price : (exemplar_rows, exemplar_columns) float32 or None
        What the use of a patch costs beside that of others; None: 1 for all.
    """

    def __init__(
        self,
        device: Device,
        buffers: Buffers,
        geometry: Geometry,
        exemplar: np.ndarray,
        allowed: np.ndarray,
        field: np.ndarray,
        uniformity: float,
        seed: int,
        searches: int = SEARCHES,
        usable: np.ndarray | None = None,
        price: np.ndarray | None = None,
    ):
        self._device, self._buffers, self.geometry, self._seed = device, buffers, geometry, seed
        self._run = device.program("patchmatch", PATCH=geometry.patch, CHANNELS=geometry.channels)
        self._penalty_weight = uniformity * _penalty_unit(exemplar, geometry, usable)
        device.write(buffers["exemplar"], exemplar)
        device.write(buffers["field"], field)
        device.write(buffers["price"], np.where(allowed, np.float32(1) if price is None else price, np.float32(-1)))
        reach = max(geometry.exemplar_columns, geometry.exemplar_rows)
        shrink = (2.0 / reach) ** (1.0 / (SEARCHES - 1))
        radius = [max(1, int(reach * shrink**k)) for k in range(SEARCHES)][-searches:]
        self._radius, self._searches = device.upload(np.array(radius, np.int32)), searches

    def field(self) -> np.ndarray:
        """The present field."""
        return self._device.read(self._buffers["field"], (self.geometry.rows, self.geometry.columns), np.uint32)

    def distances(self) -> np.ndarray:
        """Squared distance of every match in squared grid steps, summed over the patch: (rows, columns) int32."""
        return self._device.read(self._buffers["distance"], (self.geometry.rows, self.geometry.columns), np.int32)

    def improve(self, iterations: int, step: int) -> None:
        """Search better matches for `image`; `step` numbers the outer iteration for the random numbers."""
        g, b = self.geometry, self._buffers
        field = (g.columns, g.rows)
        self._run("pad", (g.padded_width, g.height + g.patch - 1), b["image"], b["target"], g.width, g.height)
        self._run(
            "score",
            field,
            b["target"],
            b["exemplar"],
            b["field"],
            b["distance"],
            *field,
            g.padded_width,
            g.exemplar_width,
        )
        e_size = (g.exemplar_columns, g.exemplar_rows, g.exemplar_width)
        for i in range(iterations):
            self._count_uses()
            for jump in JUMPS:
                self._run(
                    "propagate", field, b["target"], b["exemplar"], b["penalty"], b["field"], b["distance"],
                    b["field_next"], b["distance_next"], *field, g.padded_width, *e_size,
                    jump, int(g.wrap_x), int(g.wrap_y),
                )  # fmt: skip
                b.swap("field", "field_next")
                b.swap("distance", "distance_next")
            self._run(
                "search", field, b["target"], b["exemplar"], b["penalty"], b["field"], b["distance"],
                *field, g.padded_width, *e_size, self._radius, self._searches,
                np.uint32(self._seed & 0xFFFFFFFF), np.uint32(16 * step + i),
            )  # fmt: skip

    def vote(self) -> None:
        """Make `image` the mean of what the matched patches say."""
        g, b = self.geometry, self._buffers
        span = 1 if self._device.lanes == 1 else 64  # cl/patchmatch.cl, SPAN
        self._run(
            "vote", (-(-g.width // span), g.height), b["exemplar"], b["field"], b["image"],
            g.columns, g.rows, g.width, g.height, g.exemplar_width, int(g.wrap_x), int(g.wrap_y),
        )  # fmt: skip

    def hold(self) -> None:
        """Put back into `image` the pixels of buffer `held` that must stay."""
        g, b = self.geometry, self._buffers
        self._run("hold", (g.width * g.height,), b["held"], b["image"], g.width * g.height)

    def ease(self, changed: str) -> None:
        """Bring buffer `changed` back to `image` where buffer `ease`, a byte for each pixel, says less than 255."""
        g, b = self.geometry, self._buffers
        self._run("ease", (g.width * g.height,), b["image"], b[changed], b["ease"], g.width * g.height)

    def pick(self) -> np.ndarray:
        """The exemplar pixel with the most votes for every target pixel: (height, width) uint32 of packed (y, x)."""
        g, b = self.geometry, self._buffers
        offset = np.arange(g.patch) - g.patch // 2
        fall = np.exp(-(offset**2) / (2.0 * PICK_SIGMA**2))
        weight = self._device.upload(np.rint(1024 * fall[:, None] * fall[None, :]).astype(np.int32))
        self._run(
            "pick", (g.width, g.height), b["field"], weight, b["distance_next"],
            g.columns, g.rows, g.width, g.height, int(g.wrap_x), int(g.wrap_y),
        )  # fmt: skip
        return self._device.read(b["distance_next"], (g.height, g.width), np.uint32)

    def _count_uses(self) -> None:
        """The uniformity penalty of every exemplar patch, frozen for one pass: refreshed oftener, all flee at once."""
        g, b = self.geometry, self._buffers
        patches, size = g.columns * g.rows, (g.exemplar_columns, g.exemplar_rows)
        self._device.fill(b["count"], np.int32(0), size[0] * size[1])
        if self._penalty_weight > 0:
            self._run("count", (patches,), b["field"], b["count"], patches, g.exemplar_columns)
        self._run("uses_rows", size, b["count"], b["uses"], *size)
        self._run("penalty", size, b["uses"], b["price"], b["penalty"], *size, float(self._penalty_weight))


def _penalty_unit(exemplar: np.ndarray, geometry: Geometry, usable: np.ndarray | None = None) -> float:
    """What one use too many costs: 121 Var(e) / (121 omega_best) per doubly summed count (MJH17 eq. 6).

    omega_best = max(1, |T| / |S|) N with pixel counts |T|, |S| of target and exemplar and N = patch^2. The mean use of
    a patch's pixels is the doubly summed count / N, so a patch used ideally pays N Var(e). Where only some pixels may
    be used, these are the exemplar: a fair share among all would punish a small label for being small.
    """
    pixels = exemplar.reshape(-1, geometry.channels) if usable is None else exemplar[usable]
    n = geometry.patch**2
    best = max(1.0, geometry.width * geometry.height / len(pixels)) * n
    variance = float(pixels.var(axis=0, dtype=np.float64).sum())
    return n * variance / (best * n)


def match_patches(
    device: Device, lab: np.ndarray, exemplar: np.ndarray, field: np.ndarray, patch: int, wrap: tuple[bool, bool],
    seed: int, budget: int,
) -> np.ndarray:  # fmt: skip
    """The nearest-neighbour field of an image, from a first guess and `MATCH_PASSES` passes without uniformity.

    Parameters
    ----------
    device : Device
    lab, exemplar : (height, width, 3) float32
        CIE Lab.
    field : (rows, columns) uint32
        Where to start.
    patch : int
        Side of a patch.
    wrap : (bool, bool)
        The image is a torus along x, along y.
    seed, budget : int

    Returns
    -------
    (rows, columns) uint32
    """
    geometry = Geometry(lab.shape[1], lab.shape[0], exemplar.shape[1], exemplar.shape[0], patch, *wrap)
    with Buffers(device, geometry.layout(), budget, "matching patches", held=exemplar.nbytes) as buffers:
        image = to_grid(exemplar, patch)
        matcher = Matcher(device, buffers, geometry, image, allowed_patches(None, geometry), field, 0.0, seed)
        device.write(buffers["image"], to_grid(lab, patch))
        matcher.improve(MATCH_PASSES, 0x3A7C)
        return matcher.field()
