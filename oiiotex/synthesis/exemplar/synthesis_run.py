# SPDX-License-Identifier: Apache-2.0
"""One run of a `SynthesisPlan`: from reading the photo to the tiles and their report."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from ...analysis.regularity.courses import Courses, InCourses, courses_turn
from ...analysis.regularity.lattice import Lattice
from ...analysis.regularity.offset_prices import InStep
from ...analysis.stationarity.measures import scale_folder
from ...engine.color.config import as_float
from ...engine.color.lab import working_values
from ...engine.core.demand import SomeRows, first_channels
from ...engine.core.image import Image, Part
from ...engine.core.source_map import SourceMap
from ...engine.deferred import np
from ...engine.errors import ImageError, present, whole_budget
from ..layout.kept_layout import kept_layout
from ..layout.limits import fits_layout
from ..layout.mending import mended
from ..patchmatch.constraints import Constraints, FixedPixels, Octaves
from ..patchmatch.field import hash_at
from ..patchmatch.optimization import LevelLook, Synthesis, synthesize
from ..patchmatch.recipe import Recipe
from ..quality.fidelity import Fidelity, JudgedPhoto
from ..quality.judged_tries import Dismissed, Try, best_tried
from ..quality.lost_structure import regularity_of, say_what_was_lost, texture_lost
from ..quality.report import Look, Quality
from ..wang.atlas import packed, shared_pixels
from ..wang.tiles import COUNTS, runs_for, wang_tiles
from .constraint_images import sigmas_of, weights_of
from .evened_photo import evened_part, evened_values, evening_of
from .first_result import (
    PLAINER,
    SET_OF_TILES,
    FirstTile,
    coarse_looks,
    coarse_photo,
    fidelity_of,
    glance,
    hint_that_it_tiles,
    say_fidelity,
    textured,
)
from .flattened import flattened_photo, in_any_order
from .heights import Pairing, height_tile
from .patch_synthesis import beside_drift
from .photo_lattice import fitting_size, photo_structure
from .presets import EVENER, IMPROVED_BY_SIZE, LARGER, LAYOUT, REPEATED
from .sigma_scale import DEFAULT_COUNT, SigmaTiles, perceived_scale

if TYPE_CHECKING:
    from ...analysis.drift.correction import Correction
    from ...engine.session.progress import Progress
    from ...engine.session.resources import Resources
    from .exemplar_op import ExemplarPixels
    from .patch_synthesis import PatchSynthesis, SynthesisPlan


# time of a pixel of the photo: flattened, read, searched for a lattice; and of the tile: made, judged, measured
_PHOTO, _TILE = (1, 3, 8), (30, 2, 4)
_LAYOUT_TIME = 0.4  # of a kept layout, relative to a synthesis
_HOLE_ITERATIONS = 4  # of each finer level: patches must fit pixels that do not change


def synthesized(
    plan: SynthesisPlan, resources: Resources, progress: Progress
) -> dict[str, Any] | tuple[dict[str, Any], ...]:
    """The tile with all its outputs, as one mapping for each map and variant."""
    with whole_budget(resources.budget):  # errors are told what is left of it
        return _synthesized(plan, resources, progress)


def _synthesized(
    plan: SynthesisPlan, resources: Resources, progress: Progress
) -> dict[str, Any] | tuple[dict[str, Any], ...]:
    op, photo = plan.op, plan.op.exemplar.first.window
    area = plan.size.width * plan.size.height * (runs_for(op.variants) if op.variants > 1 else 1)
    measured = plan.quality.during(resources, progress).is_asked_for
    on_photo, on_tile = (1, 1, int(plan.lattice > 0)), (1, 1, int(measured))
    flattening, reading, searching, making, judging, measuring = progress.stages(
        *(photo.width * photo.height * cost * here for cost, here in zip(_PHOTO, on_photo, strict=True)),
        *(area * cost * here for cost, here in zip(_TILE, on_tile, strict=True)),
    )
    with resources.stats.time("flatten"):
        flat, drift = flattened_photo(plan, resources, flattening)
    flattening.advance(1, 1)
    with resources.stats.time("read and color"):
        own = [] if flat is op else [flat.exemplar.first]  # in any order already
        maps = own + [in_any_order(image.first, plan.in_memory) for image in flat.all_maps()[len(own) :]]
        weight = None if op.weightmap is None else weights_of(op.weightmap, op.exemplar)
    pixels = flat.read(resources, None if weight is None else weight > 0)
    reading.advance(1, 1)
    if not plan.in_memory:
        resources.cache.forget()  # everything has been read
    structure = None
    if plan.lattice > 0:
        with resources.stats.time("lattice"):
            structure = pixels.remembered(resources, photo_structure, op.flag())
    searching.advance(1, 1)
    lattice = structure if isinstance(structure, Lattice) else None
    wraps = "x" in op.tiles, "y" in op.tiles
    size = fitting_size(op.flag(), lattice, plan.size, plan.is_size_given, wraps)
    look = coarse_looks(maps[0], making.look) if op.variants == 1 else None
    sigmas = None if plan.sigmamap is None else sigmas_of(plan.sigmamap, *size)
    recipe = op.recipe(*size)
    if plan.evenness is not None:
        recipe = _perceived(plan, recipe, pixels, resources, making)
    if sigmas is not None:  # one sigma for the stationarized photo
        recipe = replace(recipe, sigma=float(np.exp(np.log(sigmas).mean())))
    if lattice is not None:
        recipe = replace(recipe, in_step=InStep(lattice, lattice.on_torus(recipe), plan.lattice))
    elif isinstance(structure, Courses):
        recipe = replace(recipe, in_step=InCourses.of(structure, recipe, plan.lattice))
    quality = _measures_of(plan.quality, lattice, recipe).during(resources, measuring)
    run = SynthesisRun(
        plan, flat, maps, pixels, lattice, recipe, Constraints(weight=weight, sigmas=sigmas), quality, look, wraps,
        resources, making, judging, Octaves(pixels.values, pixels.usable), drift,
    )  # fmt: skip
    first, *others = run.variants() if op.variants > 1 else run.one()
    measuring.advance(1, 1)
    return (first, *others) if others else first


def _perceived(
    plan: SynthesisPlan, recipe: Recipe, pixels: ExemplarPixels, resources: Resources, progress: Progress
) -> Recipe:
    """The recipe with the sigma that `evenness` stands for (MJH17 section 4.4)."""
    tiles = SigmaTiles(resources.device, pixels.values, pixels.usable, recipe, resources.budget, pixels.why)
    scale = perceived_scale(tiles, DEFAULT_COUNT, progress.advance, scale_folder())
    sigma = scale.sigma_at(present(plan.evenness))
    plan.op.inform("evenness=%g corresponds to sigma=%.2f px", plan.evenness, sigma)
    return replace(recipe, sigma=sigma)


def _measures_of(quality: Quality, lattice: Lattice | None, recipe: Recipe) -> Quality:
    """The quality measures for results of the recipe."""
    if lattice is not None:
        wanted = lattice.on_torus(recipe)
        steps = tuple(map(tuple, np.linalg.pinv(wanted).T.tolist()))
        across, down = np.abs(wanted).max(0).tolist()
        quality = replace(quality, cycles=(across, down), lattice=steps)
    return replace(quality, sigma=recipe.sigma, contrast=recipe.contrast, measure=recipe.measure, order=recipe.order)


@dataclass(frozen=True)
class SynthesisRun:
    """The inputs and decisions of a run, and the results that follow."""

    _plan: SynthesisPlan
    _flat: PatchSynthesis  # the op on the flattened photo
    _maps: list[Part]
    _seen: ExemplarPixels
    _lattice: Lattice | None
    _recipe: Recipe
    _constraints: Constraints
    _quality: Quality
    _look: Any
    _wraps: tuple[bool, bool]
    _resources: Resources
    _progress: Progress
    _judging: Progress
    _octaves: Octaves  # of the photo, for all syntheses from it
    _drift: dict[str, Part]  # the correction of the photo

    @property
    def _op(self) -> PatchSynthesis:
        return self._plan.op

    @property
    def _in_memory(self) -> bool:
        return self._plan.in_memory

    def _run(
        self, recipe: Recipe, constraints: Constraints, progress: Progress | None = None,
        look: LevelLook | None = None,
    ) -> Synthesis:  # fmt: skip
        """One synthesis from the photo, with progress reports. `look`: as of `synthesize`, after that of the run."""
        op, resources, pixels = self._op, self._resources, self._seen
        looks = [one for one in (self._look, look) if one is not None]

        def all_looks(pick: Callable[[], SourceMap], size: tuple[int, int]) -> None:
            for one in looks:
                one(pick, size)

        return synthesize(
            resources.device, pixels.values, pixels.usable, recipe, self._plan.budget,
            (progress or self._progress).advance, pixels.why, constraints,
            resources.keeper if op.resume else None, look=all_looks if looks else None, octaves=self._octaves,
        )  # fmt: skip

    def _lab(self) -> SomeRows:
        """Lab of the photo that provides the patches."""
        values = first_channels(self._seen.values, 3)
        return np.ascontiguousarray(values) if isinstance(values, np.ndarray) else values

    def _own_lab(self) -> SomeRows:
        """Lab of the original photo, before flattening."""
        if self._flat is self._op:
            return self._lab()
        return working_values(self._op.exemplar, self._resources, self._op.working_space, self._in_memory)[0]

    def _judged_photo(self) -> JudgedPhoto:
        return JudgedPhoto(first_channels(self._seen.values, 3), self._seen.usable, self._own_lab())

    # --- one tile ---

    def one(self) -> tuple[dict[str, Any], ...]:
        """The tile, followed by the other maps of its material."""
        op, resources = self._op, self._resources
        if op.tiles == "xy" and op.size is None and self._in_memory:
            hint_that_it_tiles(op.flag(), op.exemplar.first)
        photo = self._judged_photo()
        result = best_tried(op.flag(), self._tries(photo), functools.partial(self._judged, photo), self._progress)
        self._judging.advance(1, 1)
        (synthesis, recipe, evening, _), kept = result.made, result.kept
        source, lost = synthesis.source, synthesis.lost
        run = self._evened(evening)
        quality = _measures_of(self._quality, self._lattice, recipe)
        say_fidelity(op.flag(), kept, result.spelled, warn=self._plan.judged)
        resources.device.collect(resources.stats)
        if evening is not None:
            run._maps[0] = in_any_order(run._maps[0], self._in_memory)
        first, *others = run._with_heights(run._tiles(source), source)
        if kept is not None:
            facts = {"oiiotex:chosen": result.spelled, "oiiotex:fidelity": f"{kept.value:.3f}"}
            first["tile"] = first["tile"].respecced(lambda spec: [spec.attribute(*fact) for fact in facts.items()])
        if self._progress.look is not None:
            self._progress.look(as_float(first["tile"].pixels()), True)
        more = {} if kept is None else kept.measures()
        more |= {} if lost is None else {"textured_photo": lost.own, "textured": lost.shown}
        if self._lattice is not None and quality.is_asked_for:
            more |= regularity_of(run._lab(), source, recipe)

        def looked_at() -> tuple[SomeRows, list[Look]]:
            return present(photo.original), [quality.look_of_copies(first["tile"].name, run._lab(), source)]

        return (beside_drift(quality.add_to(first, looked_at, **more), run._drift), *others)

    def _judged(self, photo: JudgedPhoto, made: FirstTile) -> Fidelity | None:
        with self._resources.stats.time("fidelity"):
            return fidelity_of(photo, made.synthesis.source, made.recipe, self._evened(made.evening)._lab())

    def _evened(self, evening: Correction | None) -> SynthesisRun:
        """The same run on the photo after that correction."""
        if evening is None:
            return self
        photo, seen = Image((self._maps[0],), self._op.exemplar.source), self._seen
        values = evened_values(seen.values, evening, photo.first.window)
        part, drift = evened_part(photo, evening, self._drift, self._op.working_space, self._resources)
        return replace(self, _maps=[part, *self._maps[1:]], _seen=replace(seen, values=values), _drift=drift)

    def _tries(self, photo: JudgedPhoto) -> list[Try[FirstTile]]:
        """The ways to make the tile that are worth it, the usual one first."""
        plan, recipe = self._plan, self._recipe
        layout = Try(f"preset={LAYOUT}", self._in_own_layout, _LAYOUT_TIME, IMPROVED_BY_SIZE, despite=REPEATED)
        if plan.layout:
            return [replace(layout, improves=())]

        def usual(_: float) -> FirstTile:
            made = self._run(recipe, self._constraints)
            say_what_was_lost(self._op.flag(), made.lost)
            return FirstTile(made, recipe)

        first = Try(recipe.scales, usual)
        if not plan.judged:
            return [first]
        coarse = functools.lru_cache(1)(functools.partial(coarse_photo, photo))
        others = [self._at_scale(coarse, *scale) for scale in (*EVENER, LARGER)]
        if recipe.measure == "histogram" and fits_layout(self._op.exemplar.first.spec, self._resources):
            if (made := self._layout_of_courses(photo)) is not None:
                layout = replace(layout, make=lambda _: made)
                kept = self._judged(photo, made) if made.is_bent else None
                if kept is not None and not kept.exceeds(IMPROVED_BY_SIZE):  # no other tile follows such courses
                    return [layout]
            others.insert(len(EVENER), layout)
        return [first, *others]

    def _at_scale(
        self, coarse: Callable[[int, int], JudgedPhoto], share: float, patch: int, improves: tuple[str, ...],
        evens: bool,
    ) -> Try[FirstTile]:  # fmt: skip
        """A tile with another patch, and with sigma as a divisor of the longer side. `coarse`: see `glance`."""
        recipe = replace(self._recipe, sigma=max(max(self._recipe.size) / share, patch / 4), patch=patch)

        def make(least: float) -> FirstTile:
            look = None if evens else glance(coarse, self._seen.values.shape[1], recipe, least)
            return FirstTile(textured(self._run(recipe, self._constraints, look=look)), recipe)

        return Try(recipe.scales, make, improves=improves, evens=evens)

    def _layout_of_courses(self, photo: JudgedPhoto) -> FirstTile | None:
        """The kept layout of a photo whose courses turn; None: they do not, or it failed."""
        if self._recipe.in_step is not None or not courses_turn(*photo.texture):
            return None
        try:
            made = self._in_own_layout(0.0)
        except (Dismissed, ImageError):
            return None
        self._progress.lengthen(1.0)
        return made

    def _in_own_layout(self, _: float) -> FirstTile:
        """The tile that keeps the photo's layout, and the recipe with its size."""
        seen, plan = self._seen, self._plan
        size = plan.size if plan.is_size_given else (None, None)
        with self._resources.stats.time("layout"):
            layout = kept_layout(seen.values, seen.usable, size, self._wraps)
            evening = evening_of(layout.source, self._wraps, seen, self._maps[0].window, plan.flattening)
        self._op.inform("%s", layout)
        height, width = layout.source.packed.shape
        recipe = replace(self._recipe, width=width, height=height)
        if self._lattice is not None:
            recipe = replace(recipe, in_step=InStep(self._lattice, self._lattice.on_torus(recipe), plan.lattice))
        holes = replace(
            recipe, sigma=None, contrast=0.0, flat=False, complete=False, in_step=None, fine=_HOLE_ITERATIONS
        )

        def filled(fixed: FixedPixels, wraps: tuple[bool, bool]) -> SourceMap:
            high, wide = fixed.where.shape
            piece = replace(holes, width=wide, height=high, wrap_x=wraps[0], wrap_y=wraps[1])
            return SourceMap(np.array(self._run(piece, Constraints(fixed=fixed)).source.packed))

        source = mended(layout.source, seen.usable, self._wraps, recipe.patch, filled)
        self._progress.advance(1, 1)
        made = Synthesis(source, source, texture_lost(seen.values, seen.usable, source, recipe))
        return FirstTile(made if plan.layout else textured(made, PLAINER), recipe, evening, layout.is_bent)

    def _tiles(self, source: SourceMap) -> tuple[dict[str, Part], ...]:
        """All maps copied from the same source pixels; the first tile has the source coordinates."""
        op, by_rows = self._op, not self._in_memory
        return op.of_all(self._maps, lambda one, _: source.parts("tile", one, op.tiling, by_rows=by_rows))

    def _with_heights(
        self, tiles: tuple[dict[str, Part], ...], source: SourceMap, shared: Pairing | None = None
    ) -> tuple[dict[str, Part], ...]:
        """The tiles, with the steps of heights logged, and leveled with relevel; `shared` as of `levels`."""
        op, results = self._op, []
        maps = (op.exemplar, *op.maps)
        for tile, one, kind in zip(tiles, maps, op.map_kinds, strict=True):
            if kind == "height":
                relevel = op.relevel if op.variants == 1 or op.pack else None
                given = tile["tile"], one, source, self._wraps, relevel, None, self._resources, shared
                tile = tile | {"tile": height_tile(op.flag(), *given)}
            results.append(tile)
        return tuple(results)

    # --- interchangeable tiles ---

    def variants(self) -> tuple[dict[str, Any], ...]:
        """Tiles with matching edges, each followed by the other maps of its material."""
        op, recipe, runs = self._op, self._recipe, runs_for(self._op.variants)
        self._resources.require(4 * recipe.width * recipe.height * (runs + 1), f"a set of {op.variants} tiles")

        def make(fixed: FixedPixels | None, number: int, tiles: bool) -> SourceMap:
            seed = int(hash_at(op.seed, 0x3A95, np.array([number]), np.array([0]))[0])
            own = replace(recipe, wrap_x=tiles, wrap_y=tiles, seed=seed)

            def tell(done: int, total: int) -> None:
                self._progress.advance(number * total + done, runs * total)

            progress = replace(self._progress, tell=tell)
            made = self._run(own, replace(self._constraints, fixed=fixed), progress)
            say_what_was_lost(op.flag(), made.lost)
            return SourceMap(np.array(made.source.packed))  # tiles are cut from others

        values = self._seen.values
        sources = wang_tiles(
            make, op.variants, recipe.width, recipe.height, recipe.patch, lambda source: source.gather(values)
        )
        plane = packed(sources) if op.variants in COUNTS else sources[0]
        if self._plan.judged and op.variants in COUNTS:
            with self._resources.stats.time("fidelity"):
                kept = fidelity_of(self._judged_photo(), plane, replace(recipe, wrap_x=True, wrap_y=True))
            say_fidelity(op.flag(), kept, recipe.scales, warn=True, advice=SET_OF_TILES)
        self._resources.device.collect(self._resources.stats)
        shared = shared_pixels(plane, op.variants, recipe.patch) if op.relevel else None
        material = self._with_heights(self._tiles(plane), plane, shared)
        if op.pack:
            sources = [plane]  # measured as the plane that it is
        tiles = op.tiles_of_set([material] if op.pack else map(self._tiles, sources))

        def looked_at() -> tuple[SomeRows, Iterator[Look]]:
            looks = map(self._quality.look_of_copies, op.names_of_set(), itertools.repeat(self._lab()), sources)
            return self._own_lab(), looks

        return (beside_drift(self._quality.add_to(tiles[0], looked_at), self._drift), *tiles[1:])
