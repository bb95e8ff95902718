# SPDX-License-Identifier: Apache-2.0
"""MJH17 algorithm 1: a stationary texture from a photo that is not stationary.

Departures from the paper, all measured in benchmarks/results/tiles.md:

- Global histogram matching may aim at the projected exemplar ('flat') with a constant weight instead of the exemplar
  with a weight that fades: this keeps the contrast of detail where low-frequency variation is removed.
- The projection is over-relaxed by `OVERSHOOT`: PatchMatch restores part of the variation in each iteration.
- The last vote picks one exemplar pixel for each pixel instead of a mean, which would blur.
- A tile starts as the shifted exemplar instead of as random blocks: long lines and large shapes stay whole.
- Penalties keep regions from repeating, and texture from being lost to flat parts of the photo: use_prices.py.
- Pixels of the exemplar may be excluded (alpha, a mask, a label: LSA16 §5.2). Histograms, the fair share of uniformity
  and the means of coarse levels then use the remaining pixels only.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ...analysis.stationarity.grid_statistics import CellGrid
from ...engine.color.lab_grid import to_grid
from ...engine.core.demand import MadeRows, SomeRows
from ...engine.core.scratch import AT_ONCE, RowStore, empty_rows
from ...engine.core.source_map import SourceMap
from ...engine.core.window import Domain
from ...engine.deferred import np
from ...engine.errors import present
from ...engine.io.checkpoint import Checkpoint
from ...engine.opencl.buffers import Buffers, require_room
from ...engine.opencl.device import Device, DeviceMemory
from ...engine.opencl.rows import Rows
from ..projections.histograms import OUTSIDE, ValueCounts
from ..projections.projection import Projecting, projected, projection
from . import use_prices
from .constraints import (
    ENOUGH,
    ENOUGH_AMONG,
    UNCONSTRAINED,
    Constraints,
    Octaves,
    VaryingProjection,
    coarse_mask,
    ease_from,
    first_level,
    sigma_octaves,
)
from .exemplar_rows import ExemplarRows
from .field import (
    Geometry,
    allowed_patches,
    bands_of,
    only_allowed,
    planes_of,
    random_field,
    shifted_field,
    upsample_field,
    variance_of,
)
from .level_checkpoint import LevelCheckpoint
from .level_rows import LevelRows, halo
from .matcher import Matcher
from .memory import ExemplarHeld, level_sigmas, plan_memory
from .patch_search import SEARCHES
from .recipe import Recipe, geometry_at, level_scales
from .use_prices import Lost, UsePrices, lost_texture

PAPER_FINE_ITERATIONS = 3  # section 4.2: 2 or 3
COARSE_PASSES, FINE_PASSES, LAST_PASSES = 2, 1, 3  # of PatchMatch: coarsest level, finer levels, last iteration
OVERSHOOT = 1.2
LOOKS = 3  # iterations of the coarsest level between two previews
_LEVEL = 40_000  # pixels of an iteration that take as long as the preparation of a level
_WHOLE = 0.85  # share of usable pixels of an exemplar that has small holes only
LevelLook = Callable[[Callable[[], SourceMap], tuple[int, int]], object]
EASE = 2.0  # patches from fixed pixels to where the projection has full strength


@dataclass(frozen=True)
class Synthesis:
    """The exemplar pixel that each pixel copies, and the field that led there.

    `lost`: the texture it lacks, if the recipe asked for all of it.
    """

    source: SourceMap
    field: SourceMap
    lost: Lost | None = None


def synthesize(
    device: Device,
    exemplar: SomeRows,
    allowed: np.ndarray | None,
    recipe: Recipe,
    budget: int,
    progress: Callable[[int, int], None],
    ruled_out: str = "transparent pixels",
    constraints: Constraints = UNCONSTRAINED,
    keeper: Checkpoint | None = None,
    look: LevelLook | None = None,
    octaves: Octaves | None = None,
) -> Synthesis:
    """Run MJH17 algorithm 1.

    Parameters
    ----------
    exemplar : (height, width, channels) float32
        CIE Lab, and three more channels on its scale for each further map of the material. If it is not an array,
        derived data of the same size is kept out of memory as well.
    allowed : (height, width) bool or None
        Usable pixels. None: all.
    budget : int
        Memory budget in bytes, for all allocations at a time.
    progress : callable
        Called with (pixels done, total pixels) of all iterations, weighted by time. May raise an exception to stop.
    ruled_out : str
        What the excluded pixels are, for error messages.
    constraints : Constraints
        Constraints from the user.
    keeper : Checkpoint or None
        Where checkpoints of finished levels are written, and read from if present.
    look : callable, optional
        Called with (pick, (width, height)): a function that returns a level's source, and the exemplar's size there.
        May raise an exception to stop.
    octaves : Octaves, optional
        Of these arguments, from another synthesis.

    Raises
    ------
    ImageError
        The exemplar is too small, or has no usable patch.
    DeviceError
        The task does not fit the budget.
    """
    scales = level_scales(recipe, exemplar.shape)
    geometries = [geometry_at(recipe, exemplar.shape, scale) for scale in scales]
    start = first_level(allowed, geometries, ruled_out, ENOUGH if constraints.fixed is None else ENOUGH_AMONG)
    scales, geometries = scales[start:], geometries[start:]
    fine_iterations = PAPER_FINE_ITERATIONS if recipe.literal else recipe.fine
    schedule = [[COARSE_PASSES] * recipe.iterations, *([FINE_PASSES] * fine_iterations for _ in scales[1:])]
    schedule[-1][-1] = LAST_PASSES
    sizes = [g.width * g.height for g in geometries]
    steps = [size + _LEVEL * (n == 0) for size, level in zip(sizes, schedule, strict=True) for n in range(len(level))]
    whole = sum(steps) + 2 * sizes[-1]  # picking the pixels, and measuring what is lost
    field, iteration, fixed = None, 0, constraints.fixed
    levels = None if keeper is None else LevelCheckpoint(keeper, exemplar, allowed, recipe, constraints)
    there = -1 if levels is None else levels.latest(geometries)
    held = ExemplarHeld(isinstance(exemplar, np.ndarray), allowed is not None)
    plan = plan_memory(device, exemplar.shape, recipe, geometries, scales, constraints, budget, held)
    first = geometries[max(there, 0)]
    octaves = octaves or Octaves(exemplar, allowed)
    octaves.halve(first.exemplar_width, first.exemplar_height, plan.exemplar_whole)
    with Buffers(device, plan.layout, budget, _task(recipe, exemplar.shape), held=plan.on_host) as buffers:
        for level, (geometry, scale, passes_of_level) in enumerate(zip(geometries, scales, schedule, strict=True)):
            if level <= there:
                iteration += len(passes_of_level)
                progress(sum(steps[:iteration]), whole)
                passes_of_level = []
            if level < there:
                continue
            e_size = geometry.exemplar_width, geometry.exemplar_height
            usable = coarse_mask(allowed, *e_size)
            image = grid_image(octaves, geometry, plan.exemplar_whole)
            patches = allowed_patches(usable, geometry)
            weights = constraints.patch_weights(patches, geometry)
            variance = variance_of(image, usable)
            in_step = None
            if recipe.in_step is not None:
                own_scale = e_size[0] / exemplar.shape[1], e_size[1] / exemplar.shape[0]
                target_scale = geometry.width / recipe.width, geometry.height / recipe.height
                in_step = recipe.in_step.prices(own_scale, target_scale, geometry.patch, variance)
            rows = LevelRows(device, buffers, geometry, plan.stores)
            place = rows.field_store
            if level == there:
                out = np.empty((geometry.rows, geometry.columns), np.uint32) if place is None else place
                field = present(levels).field(level, geometry, out)
                if recipe.complete:
                    use_prices.hand_on(device, buffers, present(levels).prices(level, geometry))
            elif field is None:
                if _starts_shifted(recipe, weights, allowed) and fixed is None:
                    field = shifted_field(geometry, patches, recipe.seed, place)
                else:
                    field = random_field(geometry, patches, recipe.seed, weights, place)
                if fixed is not None:
                    field = only_allowed(fixed.first_guess(field, exemplar.shape, geometry), patches, recipe.seed)
                    if fixed.start is not None:
                        field = fixed.start(field, fixed.image(exemplar, geometry), image, patches, geometry)
            else:
                field = upsample_field(field, geometries[level - 1], geometry, patches, recipe.seed, place, in_step)
            fine = iteration > 0 and not recipe.literal  # the coarsest level has found the regions
            search = SEARCHES[recipe.search](device, geometry, image, patches, recipe.seed, fine)
            prices = None
            if recipe.complete:
                prices = UsePrices(device, buffers, geometry, image, patches, scale, variance, iteration == 0)
            e_rows = ExemplarRows(device, buffers, geometry, image, patches, None if weights is None else 1 / weights)
            matcher = Matcher(
                device, buffers, geometry, image, patches, field, recipe.uniformity, recipe.seed, search, usable,
                prices, in_step, rows, e_rows,
            )  # fmt: skip
            stays = None if fixed is None else fixed.image(exemplar, geometry)
            work = _Level(device, buffers, matcher, image, usable, recipe, scale, constraints, stays)
            for number, passes in enumerate(passes_of_level, 1):
                work.iterate(iteration, passes)
                iteration += 1
                if look is not None and rows.whole and (number % LOOKS == 0 or number == len(passes_of_level)):
                    look(matcher.pick, e_size)
                progress(sum(steps[:iteration]), whole)
            field = matcher.field()
            if levels is not None and level > there:
                prices_of_flatness = use_prices.handed_on(device, buffers) if recipe.complete else np.zeros(0)
                levels.keep(level, geometry, field, prices_of_flatness)
        source = matcher.pick()
        if fixed is not None and fixed.places is not None and fixed.values is None:
            source = SourceMap(np.where(fixed.where, fixed.places.packed, source.packed))
        lost = None if prices is None else lost_texture(source, image, patches, geometry)
        return Synthesis(source, present(field), lost)


def _starts_shifted(recipe: Recipe, weights: np.ndarray | None, allowed: np.ndarray | None) -> bool:
    """Start from the shifted exemplar, unless large parts are masked or the target has borders: it would stay as it is.

    Without the whole exemplar's layout, a small hole would cost the shapes everywhere: coarse patches are large.
    """
    whole = allowed is None or bool(allowed.mean() >= _WHOLE)
    return recipe.complete and recipe.shifted and all(recipe.wraps) and weights is None and whole


def require_memory(
    device: DeviceMemory, recipe: Recipe, shape: tuple[int, ...], budget: int, held: ExemplarHeld
) -> None:
    """Raise the memory errors of `synthesize` that follow from sizes, before pixels are read or a device is opened.

    Parameters
    ----------
    recipe : Recipe
        With sigma=None if it is not known yet.
    shape : (height, width, channels)
        Shape of the exemplar.
    budget : int
        As in `synthesize`.

    Raises
    ------
    ImageError, DeviceError
        As in `synthesize`.
    """
    # masks may rule out all coarser levels
    plan = plan_memory(device, shape, recipe, [geometry_at(recipe, shape, 1.0)], [1.0], UNCONSTRAINED, budget, held)
    require_room(device, plan.layout, budget, _task(recipe, shape), plan.on_host)


class _Level:
    """One pyramid level: the body of algorithm 1's inner loop."""

    def __init__(
        self, device: Device, buffers: Buffers, matcher: Matcher, exemplar: SomeRows, usable: np.ndarray | None,
        recipe: Recipe, scale: float, constraints: Constraints = UNCONSTRAINED, fixed: np.ndarray | None = None,
    ):  # fmt: skip
        self._device, self._buffers, self._matcher, self._recipe = device, buffers, matcher, recipe
        self._free: np.ndarray | None = None  # not given
        g = self._geometry = matcher.geometry
        self._usable = usable
        self._low, self._high = _range_of(exemplar, usable)
        self._first = int(self._low.min())
        self._entries = int(self._high.max()) - self._first + 1
        if fixed is not None:  # fixed pixels that no patch can show would distort the others
            free = self._free = fixed[..., 0] == OUTSIDE
            fixed = np.where(free[..., None], OUTSIDE, np.clip(fixed, self._low, self._high)).astype(np.int16)
            matcher.rows.plane("fixed", fixed.shape, np.int16, fixed)
            ease = ease_from(free, EASE * recipe.patch)
            matcher.rows.plane("ease", ease.shape, np.uint8, ease)
        sigma = None if recipe.sigma is None else recipe.sigma * scale
        if recipe.contrast > 0:
            self._counts = ValueCounts(device, buffers, self._first, self._entries, g.channels)
            self._count_goal(exemplar, sigma)
        self._projection: Projecting | None = None
        sigmas = level_sigmas(constraints, g, scale)
        if sigmas is not None:
            stack = [self._projected(g, one, number) for number, one in enumerate(sigma_octaves(sigmas))]
            places = VaryingProjection.places_of(sigmas, len(stack))
            mixed = matcher.rows.plane("place", places.shape, np.float32, places)
            self._projection = VaryingProjection(device, buffers, stack, g.width, mixed)
        elif sigma is not None:
            self._projection = self._projected(g, sigma)
        self._next_image: np.ndarray | RowStore | None = None
        if not matcher.rows.whole and self._projection is not None and self._projection.looks_beyond:
            self._next_image = matcher.rows.store((g.height, g.width, g.channels), np.int16)

    def _projected(self, domain: Domain, sigma: float, number: int = 0) -> Projecting:
        grid, recipe = CellGrid.of(domain, sigma), self._recipe
        return projection(
            recipe.measure, recipe.order, self._device, self._buffers, grid, self._low, self._high, number,
            recipe.literal,
        )  # fmt: skip

    def _count_goal(self, exemplar: SomeRows, sigma: float | None) -> None:
        """The target histogram: that of the exemplar, projected if the recipe says so."""
        g, b, seen, usable, whole = self._geometry, self._buffers, None, self._usable, exemplar
        if usable is not None:

            def counted(first: int, last: int) -> np.ndarray:
                return np.where(usable[first:last, :, None], whole[first:last], OUTSIDE)

            exemplar, seen = MadeRows(whole.shape, np.int16, counted), "image"
        projection = None
        held = min(b["image"].size, b["target"].size) // (2 * g.channels * g.exemplar_width)
        if self._recipe.flat and sigma is not None:
            projection = self._projected(Domain(g.exemplar_width, g.exemplar_height), sigma)
            held = min(held, projection.held or held)
        store = None if held >= g.exemplar_height else exemplar
        if store is None:
            self._device.write(b["image"], exemplar[:])  # unused until the first vote
        image = Rows(self._device, b, "image", g.exemplar_width, g.exemplar_height, False, store, held)
        width = g.exemplar_width
        if projection is None:
            for top, bottom in image.bands():
                image.load(top, bottom)
                self._counts.add("goal_counts", "image", (width, bottom - top), more=top > 0, seen=seen)
            return
        for top, bottom, first in projected(projection, image, "target", most=held - halo(g.patch)):
            self._counts.add(
                "goal_counts", "target", (width, bottom - top), more=top > 0, at=top - first, seen=seen
            )  # fmt: skip

    def iterate(self, iteration: int, passes: int) -> None:
        """vote, matchHistogram, project, patchMatch: the last step only copies source pixels (section 4.2)."""
        rows, alpha = self._matcher.rows, self._recipe.alpha(iteration)
        for top, bottom in rows.bands():
            self._matcher.vote(top, bottom)
            self._hold(top, bottom)
            if alpha > 0:
                self._count_free(top, bottom)
            rows.image.save(top, bottom)
        if alpha > 0:
            self._match_histogram(alpha)
        if self._projection is not None:
            self._project(self._projection)
        self._matcher.improve(passes, iteration)

    def _project(self, projection: Projecting) -> None:
        rows, strength = self._matcher.rows, 1.0 if self._recipe.literal else OVERSHOOT
        for top, bottom, first in projected(projection, rows.image, "target", strength, rows.most):
            self._take_target(first, bottom)
            self._hold(first, bottom)
            rows.image.save(top, bottom, first, into=self._next_image)
        if self._next_image is not None:
            rows.image.store, self._next_image = self._next_image, rows.image.store

    def _take_target(self, top: int, bottom: int) -> None:
        """Copy rows of `target` to the image, with less weight near fixed pixels."""
        if self._free is not None:
            self._matcher.ease("target", top, bottom)
        self._buffers.swap("image", "target")

    def _hold(self, top: int, bottom: int) -> None:
        if self._free is not None:
            self._matcher.hold(top, bottom)

    def _count_free(self, top: int, bottom: int) -> None:
        """Count the values in the loaded rows of `image`, without fixed pixels."""
        free = None if self._free is None else "fixed"
        self._counts.add("counts", "image", (self._geometry.width, bottom - top), more=top > 0, free=free)

    def _match_histogram(self, alpha: float) -> None:
        rows, width = self._matcher.rows, self._geometry.width
        self._counts.match(alpha)
        for top, bottom in rows.bands():
            rows.load("image", top, bottom)
            self._counts.apply("image", "target", (width, bottom - top))
            self._take_target(top, bottom)
            rows.image.save(top, bottom)


def grid_image(exemplar: Octaves, geometry: Geometry, in_memory: bool) -> SomeRows:
    """The exemplar on a level's grid: (exemplar_height, exemplar_width, channels) int16, an array if `in_memory`."""
    g, shape = geometry, (geometry.exemplar_height, geometry.exemplar_width, geometry.channels)
    image = empty_rows(shape, np.int16, in_memory)
    for band in bands_of(g.exemplar_height, max(1, AT_ONCE // (4 * g.channels * g.exemplar_width))):
        coarse = exemplar.reduced(g.exemplar_width, g.exemplar_height, band)
        image[band] = to_grid(coarse, g.steps)
    return image


def _range_of(image: SomeRows, usable: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """Minimum and maximum of each channel, over usable pixels."""
    limits = []
    for band in bands_of(len(image)):
        planes = planes_of(image[band], None if usable is None else usable[band])
        if planes.size:
            limits.append((planes.min(axis=1), planes.max(axis=1)))
    return np.min([low for low, _ in limits], axis=0), np.max([high for _, high in limits], axis=0)


def _task(recipe: Recipe, shape: tuple[int, ...]) -> str:
    return f"a tile of {recipe.width}x{recipe.height} px from an exemplar of {shape[1]}x{shape[0]} px"
