# SPDX-License-Identifier: Apache-2.0
"""Search and votes of MJH17 section 4.2 on the device, after BSFG09."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from ...analysis.regularity.offset_prices import Prices
from ...engine.color.lab_grid import to_grid
from ...engine.core.demand import MadeRows, SomeRows
from ...engine.core.source_map import SourceMap
from ...engine.core.window import Domain
from ...engine.deferred import np
from ...engine.errors import ImageError
from ...engine.opencl.buffers import Buffers
from ...engine.opencl.device import Device
from .exemplar_rows import LEAST_ROWS, ExemplarRows, RowRange, piece_halo
from .field import Geometry, allowed_patches, variance_of
from .level_rows import JUMPS, LevelRows
from .patch_search import WINDOWS, PatchSearch, random_windows
from .use_prices import UsePrices

if TYPE_CHECKING:
    import pyopencl as cl

MATCH_PASSES = 8  # for a field that no later step refines
PICK_SIGMA = 3.0  # px; falloff of a patch's weight in the last vote from its center


class Matcher:
    """Matches on one pyramid level, with as much of exemplar, target and field on the device as fits.

    `exemplar` (exemplar_height, exemplar_width, 3) int16; `allowed` (exemplar_rows, exemplar_columns) bool; `usable`
    (exemplar_height, exemplar_width) bool or None; `search`: default, the random windows of PatchMatch.
    """

    def __init__(
        self, device: Device, buffers: Buffers, geometry: Geometry, exemplar: SomeRows, allowed: np.ndarray,
        field: SourceMap, uniformity: float, seed: int, search: PatchSearch | None = None,
        usable: np.ndarray | None = None, use_prices: UsePrices | None = None, offset_prices: Prices | None = None,
        rows: LevelRows | None = None, exemplar_rows: ExemplarRows | None = None,
    ):  # fmt: skip
        g, patches = geometry, (geometry.exemplar_rows, geometry.exemplar_columns)
        require_shape("exemplar", exemplar, (g.exemplar_height, g.exemplar_width, g.channels))
        require_shape("allowed", allowed, patches)
        require_shape("field", field.packed, (g.rows, g.columns))
        self._device, self._buffers, self.geometry = device, buffers, geometry
        self.exemplar = exemplar_rows or ExemplarRows(device, buffers, g, exemplar, allowed)
        self._run = device.program(
            "patchmatch", PATCH=g.patch, CHANNELS=g.channels, PIECES=int(not self.exemplar.whole),
            LATTICE=0 if offset_prices is None else 1 + offset_prices.warped,
        )  # fmt: skip
        tables = () if offset_prices is None else (offset_prices.phases, offset_prices.table)
        self._offset_prices = [device.upload(table) for table in tables]
        self._penalty_weight = uniformity * _penalty_unit(exemplar, geometry, usable)
        self._use_prices = use_prices
        if use_prices is not None:
            self.exemplar.plane("kinds", use_prices.kinds)
        self.rows = rows or LevelRows(device, buffers, g)
        store = self.rows.field_store
        if store is None:
            device.write(buffers["field"], np.asarray(field.packed))  # rows x columns
        elif field.packed is not store:
            store[:] = field.packed
        self._search = search or random_windows(device, g, seed)

    def field(self) -> SourceMap:
        """The current field."""
        if self.rows.field_store is not None:
            return SourceMap.of_rows(self.rows.field_store)
        shape = self.geometry.rows, self.geometry.columns
        return SourceMap(self._device.read(self._buffers["field"], shape, np.uint32))

    def texture_cost(self) -> float:
        """Mean squared Lab difference per patch pixel of the current matches to `image` (MJH17 eq. 5), a whole tile."""
        g = self.geometry
        distance = self._device.read(self._buffers["distance"], (g.rows, g.columns), np.int32)
        return int(distance.sum(dtype=np.int64)) / (distance.size * g.patch**2 * g.steps**2)

    def improve(self, iterations: int, step: int) -> None:
        """Search for better matches for `image`. `step`: index of the outer iteration, for the random numbers."""
        if iterations == 0:
            self._score(0, self.geometry.rows)
        whole = self.rows.whole and self.exemplar.whole
        for i in range(iterations):
            self._count_uses()
            for top, bottom in self.rows.field_bands():
                self._pass(top, bottom, np.uint32(16 * step + i), scored=whole and i > 0)
            if not self.rows.whole:
                field = self.rows.field
                field.settle()
                field.store, self.rows.next_field = self.rows.next_field, field.store

    def _score(self, first: int, last: int) -> None:
        """Compute distances for rows of the field, with the target in the buffers. With pieces: costs."""
        g, b = self.geometry, self._buffers
        self.rows.load("field", first, last)
        self.rows.load("image", first, last + g.patch - 1)
        rows = last - first
        self._run(
            "pad", (g.padded_width, rows + g.patch - 1), b["image"], b["target"], g.width, g.height, rows + g.patch - 1
        )
        size = g.columns, rows
        for piece in self.exemplar.pieces("exemplar", "penalty"):
            self._run(
                "score", size, b["target"], b["exemplar"], b["field"], b["distance"], *size, g.padded_width,
                g.exemplar_width, *piece,
            )  # fmt: skip
            if not self.exemplar.whole:
                self._run(
                    "cost", size, b["penalty"], b["field"], b["distance"], *size, g.exemplar_columns, *piece, first,
                    g.rows, *self._offset_prices,
                )  # fmt: skip

    def _pass(self, top: int, bottom: int, step: np.uint32, scored: bool) -> None:
        """Propagate and search rows of the field. Not `scored`: first compute distances, including their halo."""
        g, whole = self.geometry, self.rows.whole
        reach = 0 if whole else sum(JUMPS)
        first, last = top - reach, bottom + reach
        if not g.wrap_y:
            first, last = max(0, first), min(g.rows, last)
        if not scored:
            self._score(first, last)
        self.rows.field.settle()  # `field_next` still holds the last band's rows while this band is scored
        e_size = (g.exemplar_columns, g.exemplar_rows, g.exemplar_width)
        for jump in JUMPS:
            reach -= 0 if whole else jump
            begin, end = max(first, top - reach), min(last, bottom + reach)
            where = jump, g.wrap_x, g.wrap_y and whole, begin - first, end - first, first, g.rows
            for piece, begun in self._change():
                self._run(
                    "propagate", (g.columns, end - begin), *self._matches(), g.columns, last - first, g.padded_width,
                    *e_size, *piece, *where, *begun, *self._offset_prices,
                )  # fmt: skip
        search = self._search
        rounds = 1 if self.exemplar.whole else search.count  # a candidate depends on all before it
        for k in range(rounds if search.count else 0):
            candidates = (0, search.count) if self.exemplar.whole else (k, k + 1)
            second = step if search.second is None else search.second
            given = search.first, second, top - first, bottom - first, first
            for piece, begun in self._change():
                self._run(
                    search.kernel, (g.columns, bottom - top), *self._matches(), g.columns, g.padded_width, *e_size,
                    *piece, search.table, *candidates, *given, *begun, *self._offset_prices,
                )  # fmt: skip
        if not whole:
            self.rows.field.save_later(top, bottom, first, into=self.rows.next_field)
            self._buffers.swap("field", "field_next")

    def _change(self) -> Iterator[tuple[RowRange, tuple[int, ...]]]:
        """Pieces with the kernel arguments for updating the field. Finally the next field becomes the current one."""
        for n, piece in enumerate(self.exemplar.pieces("exemplar", "penalty")):
            yield piece, (() if self.exemplar.whole else (int(n > 0),))
        self._buffers.swap("field", "field_next")
        self._buffers.swap("distance", "distance_next")

    def _matches(self) -> list[cl.Buffer]:
        names = "target", "exemplar", "penalty", "field", "distance", "field_next", "distance_next"
        return [self._buffers[name] for name in names]

    def vote(self, top: int = 0, bottom: int | None = None) -> None:
        """Set rows of `image` to the mean of the matched patches' votes. Row `top` is at the buffer's start."""
        g, b = self.geometry, self._buffers
        bottom = g.height if bottom is None else bottom
        first = self.rows.load("field", top - g.patch + 1, bottom)
        pieces = self.exemplar.count
        for n, piece in enumerate(self.exemplar.pieces("exemplar")):
            sums = () if self.exemplar.whole else (b["votes"], int(n > 0), int(n + 1 == pieces))
            self._run(
                "vote", (self._spans, bottom - top), b["exemplar"], b["field"], b["image"],
                g.columns, g.rows, g.width, g.exemplar_width, *g.wraps, top, bottom, first, *piece, *sums,
            )  # fmt: skip

    @property
    def _spans(self) -> int:
        """Work-items for a row of votes."""
        return -(-self.geometry.width // (1 if self._device.lanes == 1 else 64))  # cl/patchmatch.cl, SPAN

    def hold(self, top: int = 0, bottom: int | None = None) -> None:
        """Restore the fixed pixels, from buffer `fixed`, in the loaded rows of `image`."""
        g, b = self.geometry, self._buffers
        size = g.width, (g.height if bottom is None else bottom) - top
        self.rows.load("fixed", top, top + size[1])
        self._run("hold", size, b["fixed"], b["image"], *size)

    def ease(self, changed: str, top: int = 0, bottom: int | None = None) -> None:
        """Blend rows of buffer `changed` back to `image` where `ease`, one byte per pixel, is below 255."""
        g, b = self.geometry, self._buffers
        size = g.width, (g.height if bottom is None else bottom) - top
        self.rows.load("ease", top, top + size[1])
        self._run("ease", size, b["image"], b[changed], b["ease"], *size)

    def pick(self) -> SourceMap:
        """The exemplar pixel with the most votes for every target pixel, (height, width)."""
        g, b = self.geometry, self._buffers
        offset = np.arange(g.patch) - g.patch // 2
        fall = np.exp(-(offset**2) / (2.0 * PICK_SIGMA**2))
        weight = np.rint(1024 * fall[:, None] * fall[None, :]).astype(np.int32)  # patch x patch
        weights = self._device.upload(weight)
        shape = g.height, g.width
        source = np.empty(shape, np.uint32) if self.rows.whole else self.rows.store(shape, np.uint32)
        for top, bottom in self.rows.bands():
            first = self.rows.load("field", top - g.patch + 1, bottom)
            self._run(
                "pick", (self._spans, bottom - top), b["field"], weights, b["distance_next"],
                g.columns, g.rows, g.width, *g.wraps, top, bottom, first,
            )  # fmt: skip
            source[top:bottom] = self._device.read(b["distance_next"], (bottom - top, g.width), np.uint32)
        return SourceMap.of_rows(source)

    def _count_uses(self) -> None:
        """Compute the uniformity penalty of each exemplar patch, frozen for one pass: else all matches flee at once."""
        g, b = self.geometry, self._buffers
        if self._use_prices is not None:
            self._use_prices.begin()
            for piece in self.exemplar.pieces("kinds"):
                for top, bottom in self.rows.field_bands():
                    self.rows.load("field", top, bottom)
                    self._use_prices.count(bottom - top, piece)
            self._use_prices.ascend()
        many = int(g.columns * g.rows * g.patch**2 >= 1 << 31)  # the case that all patches match the same one
        names = ("price",) if self._use_prices is None else ("price", "kinds")
        for first, last in self.exemplar.pieces(*names):
            counted = max(0, first - g.patch + 1), min(g.exemplar_rows, last + g.patch - 1)
            if self._use_prices is not None:
                around = self._use_prices.around((first, last))
                counted = min(counted[0], around[0]), max(counted[1], around[1])
            held = g.exemplar_columns, counted[1] - counted[0]
            self._device.fill(b["count"], np.int32(0), held[0] * held[1])
            if self._penalty_weight > 0 or self._use_prices is not None:
                for top, bottom in self.rows.field_bands():
                    self.rows.load("field", top, bottom)
                    field = g.columns, bottom - top
                    self._run("count", field, b["field"], b["count"], *field, g.exemplar_columns, *counted)
            self._run("uses_rows", held, b["count"], b["uses"], *held, many)
            size = g.exemplar_columns, last - first
            self._run(
                "penalty", size, b["uses"], b["price"], b["penalty"], *size, held[1], first - counted[0], many,
                float(self._penalty_weight),
            )  # fmt: skip
            if self._use_prices is not None:
                self._use_prices.add((first, last), counted)
            self.exemplar.keep_penalty((first, last))


def require_shape(name: str, array: SomeRows, shape: tuple[int, ...]) -> None:
    """Refuse an array whose shape differs from that of the geometry. The ImageError names both."""
    if array.shape != shape:
        given, wanted = (" x ".join(map(str, n)) for n in (array.shape, shape))
        raise ImageError(f"patchmatch: {name} is {given}: expected {wanted}")


def _penalty_unit(exemplar: SomeRows, geometry: Geometry, usable: np.ndarray | None = None) -> float:
    """Penalty for one excess use: 121 Var(e) / (121 omega_best) per doubly summed count (MJH17 eq. 6).

    omega_best = max(1, |T| / |S|) N with pixel counts |T|, |S| of target and exemplar and N = patch^2. The mean use of
    a patch's pixels is the doubly summed count / N, so a patch with ideal use pays N Var(e). If only some pixels are
    usable, these are the exemplar: a fair share among all pixels would punish a small label for its size.
    """
    n = geometry.patch**2
    pixels = exemplar.shape[0] * exemplar.shape[1] if usable is None else np.count_nonzero(usable)
    best = max(1.0, geometry.width * geometry.height / pixels) * n
    return n * variance_of(exemplar, usable) / (best * n)


def match_patches(
    device: Device, lab: np.ndarray, exemplar: SomeRows, field: SourceMap, patch: int, domain: Domain, seed: int,
    budget: int, passes: int = MATCH_PASSES, windows: int = WINDOWS,
) -> tuple[SourceMap, float]:  # fmt: skip
    """The nearest-neighbor field of an image without uniformity, and its texture cost (MJH17 eq. 5).

    The cost is the mean squared Lab difference per patch pixel, on the integer grid of the search. It is an upper bound
    of eq. 5, which takes the best matches.

    Parameters
    ----------
    lab, exemplar : (height, width, 3) float32
        CIE Lab. An exemplar that does not fit the budget passes through the device in pieces.
    field : SourceMap
        (rows, columns): initial guess.
    patch : int
        Side of a patch.
    domain : Domain
        Domain of the image.
    budget : int
        Memory budget in bytes, for all allocations at a time.
    passes : int
        Passes of PatchMatch. 0: the cost of the initial guess.
    windows : int
        Random candidates of a pass. 0: matches are only propagated.

    Raises
    ------
    ImageError
        Image or field does not have the shape of the domain, or the exemplar does not have three channels.
    DeviceError
        The task does not fit the budget.
    """
    e_height, e_width = exemplar.shape[:2]
    geometry = Geometry(*domain.size, *domain.wraps, exemplar_width=e_width, exemplar_height=e_height, patch=patch)
    require_shape("lab", lab, (geometry.height, geometry.width, geometry.channels))
    held = lab.nbytes + (exemplar.nbytes if isinstance(exemplar, np.ndarray) else 0)
    layout = _layout_in(device.memory_budget(budget) - device.taken - (0 if device.own_memory else held), geometry)
    with Buffers(device, layout, budget, "matching patches", held=held) as buffers:
        image = MadeRows(
            (e_height, e_width, 3), np.int16, lambda first, last: to_grid(exemplar[first:last], geometry.steps)
        )
        search = random_windows(device, geometry, seed, windows)
        matcher = Matcher(device, buffers, geometry, image, allowed_patches(None, geometry), field, 0.0, seed, search)
        device.write(buffers["image"], to_grid(lab, geometry.steps))
        matcher.improve(passes, 0x3A7C)
        return matcher.field(), matcher.texture_cost()


def _layout_in(room: int, geometry: Geometry) -> dict[str, int]:
    """Device memory for the whole exemplar, or, if it does not fit, for as many of its rows as fit."""
    whole, least = geometry.layout(), piece_halo(geometry.patch) + LEAST_ROWS
    if sum(whole.values()) <= room or least >= geometry.exemplar_height:
        return whole
    need, more = (sum(geometry.layout(None, rows).values()) for rows in (least, least + 1))
    rows = least + max(0, room - need) // (more - need)
    return geometry.layout(None, min(rows, geometry.exemplar_height))
