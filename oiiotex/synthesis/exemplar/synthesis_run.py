# SPDX-License-Identifier: Apache-2.0
"""One run of a `PatchSynthesis`: from reading the photo to the tiles and their report."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ...analysis.regularity.courses import Courses, InCourses
from ...analysis.regularity.lattice import Lattice
from ...analysis.regularity.offset_prices import InStep
from ...engine.color.config import as_float
from ...engine.color.lab import working_values
from ...engine.core.demand import SomeRows, first_channels, materialized
from ...engine.core.image import Part, from_pixels
from ...engine.core.source_map import SourceMap
from ...engine.core.window import Window
from ...engine.deferred import np, oiio
from ..patchmatch.constraints import Constraints, FixedPixels
from ..patchmatch.field import hash_at
from ..patchmatch.optimization import Synthesis, synthesize
from ..patchmatch.recipe import Recipe
from ..quality.lost_structure import regularity_of, say_what_was_lost
from ..quality.report import Look, Quality
from ..wang.atlas import mark_as_atlas, packed, shared_pixels
from ..wang.tiles import COUNTS, edged, edges_of, runs_for, wang_tiles
from .coarse_looks import coarse_looks
from .constraint_images import weights_of
from .first_result import SET_OF_TILES, better_of, fidelity_of, hint_that_it_tiles, say_fidelity
from .heights import Pairing, height_tile
from .photo_lattice import fitting_size, photo_structure

if TYPE_CHECKING:
    from ...engine.core.parameters import Size
    from ...engine.session.progress import Progress
    from ...engine.session.resources import Resources
    from .patch_synthesis import PatchSynthesis


# time of a pixel of the photo: flattened, read, searched for a lattice; and of the tile: made, judged, measured
_PHOTO, _TILE = (1, 3, 8), (30, 2, 4)


class SynthesisRun:
    """The inputs of a run (photo, lattice and the resulting recipe), and its results."""

    def __init__(self, op: PatchSynthesis, resources: Resources, progress: Progress):
        size, quality = op.planned(resources, progress)
        photo = op.exemplar.first.window
        made = size.width * size.height * (runs_for(op.variants) if op.variants > 1 else 1)
        given, wanted = (1, 1, int(op.kept_structure > 0)), (1, 1, int(quality.is_asked_for))
        stages = progress.stages(
            *(photo.width * photo.height * cost * here for cost, here in zip(_PHOTO, given, strict=True)),
            *(made * cost * here for cost, here in zip(_TILE, wanted, strict=True)),
        )
        self._op, self._resources = op, resources
        flattening, reading, searching, self._progress, self._judging, self._measuring = stages
        with resources.stats.time("flatten"):
            self._flat, self._drift = op.flattened(resources, flattening)
        flattening.advance(1, 1)
        self._in_memory, self._budget = op.holds_photo(resources), op.budget_left(resources)
        with resources.stats.time("read and color"):
            self._maps = [self._in_any_order(image.first) for image in self._flat.all_maps()]
            weight = None if op.weightmap is None else weights_of(op.weightmap, op.exemplar)
        self._seen = self._flat.read(resources, None if weight is None else weight > 0)
        reading.advance(1, 1)
        if not self._in_memory:
            resources.cache.forget()  # everything has been read
        structure = None
        if op.kept_structure > 0:
            with resources.stats.time("lattice"):
                structure = self._seen.remembered(resources, photo_structure, op.flag())
        searching.advance(1, 1)
        self._lattice = structure if isinstance(structure, Lattice) else None
        self._courses = structure if isinstance(structure, Courses) else None
        self._wraps = "x" in op.tiles, "y" in op.tiles
        size = fitting_size(op.flag(), self._lattice, size, op.size is not None or op.sized, self._wraps)
        self._look = coarse_looks(self._maps[0], self._progress.look) if op.variants == 1 else None
        self._constraints = Constraints(weight=weight, sigmas=op.sigmas(*size))
        self._recipe = self._recipe_of(size)
        self._quality = self._quality_of(quality)

    def _in_any_order(self, part: Part) -> Part:
        """The decoded pixels, in memory if the photo is held there."""
        if self._in_memory:
            return from_pixels(part.name, part.pixels(), part.spec, part.stored)
        return Part(part.name, part.spec, materialized(part, 0).fetch, part.stored, ready=True)

    def _recipe_of(self, size: Size) -> Recipe:
        """The recipe of the op for this size and photo."""
        op, sigmas = self._op, self._constraints.sigmas
        recipe = op.controlled(op.recipe(*size), self._seen, self._resources, self._progress)
        if sigmas is not None:  # one sigma for the stationarized photo
            recipe = replace(recipe, sigma=float(np.exp(np.log(sigmas).mean())))
        if self._lattice is not None:
            return replace(recipe, in_step=InStep(self._lattice, self._lattice.on_torus(recipe), op.kept_structure))
        if self._courses is not None:
            return replace(recipe, in_step=InCourses.of(self._courses, recipe, op.kept_structure))
        return recipe

    def _quality_of(self, quality: Quality) -> Quality:
        """The quality measures for results of the recipe."""
        recipe = self._recipe
        if self._lattice is not None:
            wanted = self._lattice.on_torus(recipe)
            steps = tuple(map(tuple, np.linalg.pinv(wanted).T.tolist()))
            across, down = np.abs(wanted).max(0).tolist()
            quality = replace(quality, cycles=(across, down), lattice=steps)
        return replace(
            quality, progress=self._measuring, sigma=recipe.sigma, contrast=recipe.contrast, measure=recipe.measure,
            order=recipe.order,
        )  # fmt: skip

    def results(self) -> dict[str, Any] | tuple[dict[str, Any], ...]:
        """The tile with all its outputs, as one mapping for each map and variant."""
        first, *others = self._variants() if self._op.variants > 1 else self._one()
        first = _beside_drift(first, self._drift)
        self._measuring.advance(1, 1)
        return (first, *others) if others else first

    def _run(self, recipe: Recipe, constraints: Constraints, progress: Progress | None = None) -> Synthesis:
        """One synthesis from the photo, with progress reports."""
        op, resources, seen = self._op, self._resources, self._seen
        synthesis = synthesize(
            resources.device, seen.values, seen.usable, recipe, self._budget, (progress or self._progress).advance,
            seen.why, constraints, resources.keeper if op.resume else None,
            look=self._look,
        )  # fmt: skip
        if synthesis.lost is not None:
            say_what_was_lost(op.flag(), synthesis.lost)
        return synthesis

    def _lab(self) -> SomeRows:
        """Lab of the photo that provides the patches."""
        values = first_channels(self._seen.values, 3)
        return np.ascontiguousarray(values) if isinstance(values, np.ndarray) else values

    def _own_lab(self) -> SomeRows:
        """Lab of the original photo, before flattening."""
        if self._flat is self._op:
            return self._lab()
        return working_values(self._op.exemplar, self._resources, self._op.working_space, self._in_memory)[0]

    # --- one tile ---

    def _one(self) -> tuple[dict[str, Any], ...]:
        op, resources, recipe, quality = self._op, self._resources, self._recipe, self._quality
        if op.tiles == "xy" and op.size is None and self._in_memory:
            hint_that_it_tiles(op.flag(), op.exemplar.first)
        other = op.second_choice(recipe)
        synthesis, kept, recipe = better_of(
            op.flag(), self._run, self._constraints, recipe, other, self._seen, resources.stats, self._progress
        )
        self._judging.advance(1, 1)
        source, lost = synthesis.source, synthesis.lost
        quality = replace(quality, sigma=recipe.sigma)
        say_fidelity(op.flag(), kept, recipe, warn=op.judges_itself)
        resources.device.collect(resources.stats)
        op.say_what_stays()
        first, *others = self._with_heights(self._tiles(source), source)
        if kept is not None:
            facts = {"oiiotex:chosen": recipe.scales, "oiiotex:fidelity": f"{kept.value:.3f}"}
            first["tile"] = first["tile"].respecced(lambda spec: [spec.attribute(*fact) for fact in facts.items()])
        if self._progress.look is not None:
            self._progress.look(as_float(first["tile"].pixels()), True)
        more = {} if kept is None else kept.measures()
        more |= {} if lost is None else {"textured_photo": lost.own, "textured": lost.shown}
        if self._lattice is not None and quality.is_asked_for:
            more |= regularity_of(self._lab(), source, recipe)

        def looked_at() -> tuple[SomeRows, list[Look]]:
            return self._own_lab(), [quality.look_of_copies(first["tile"].name, self._lab(), source)]

        return (quality.add_to(first, looked_at, **more), *others)

    def _tiles(self, source: SourceMap) -> tuple[dict[str, Part], ...]:
        """All maps copied from the same source pixels; the first tile has the source coordinates."""
        op, by_rows = self._op, not self._in_memory
        tiling = "none" if op.variants > 1 and not op.pack else op.tiles  # variants continue in each other
        return op.of_all(self._maps, lambda one, _: source.parts("tile", one, tiling, by_rows=by_rows))

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

    def _variants(self) -> tuple[dict[str, Any], ...]:
        """Tiles with matching edges, each followed by the other maps of its material."""
        op, recipe, runs = self._op, self._recipe, runs_for(self._op.variants)
        self._resources.require(4 * recipe.width * recipe.height * (runs + 1), f"a set of {op.variants} tiles")

        def make(fixed: FixedPixels | None, number: int, tiles: bool) -> SourceMap:
            seed = int(hash_at(op.seed, 0x3A95, np.array([number]), np.array([0]))[0])
            own = replace(recipe, wrap_x=tiles, wrap_y=tiles, seed=seed)

            def tell(done: int, total: int) -> None:
                self._progress.advance(number * total + done, runs * total)

            progress = replace(self._progress, tell=tell)
            source = self._run(own, replace(self._constraints, fixed=fixed), progress).source
            return SourceMap(np.array(source.packed))  # tiles are cut from others

        values = self._seen.values
        sources = wang_tiles(
            make, op.variants, recipe.width, recipe.height, recipe.patch, lambda source: source.gather(values)
        )
        plane = packed(sources) if op.variants in COUNTS else sources[0]
        if op.judges_itself and op.variants in COUNTS:
            with self._resources.stats.time("fidelity"):
                kept = fidelity_of(self._seen, plane, replace(recipe, wrap_x=True, wrap_y=True))
            say_fidelity(op.flag(), kept, recipe, warn=True, advice=SET_OF_TILES)
        self._resources.device.collect(self._resources.stats)
        op.say_what_stays()
        shared = shared_pixels(plane, op.variants, recipe.patch) if op.relevel else None
        material = self._with_heights(self._tiles(plane), plane, shared)
        edges = edges_of(op.variants)
        names = [f"wang{number:02d}_{one}" for number, one in enumerate(edges)]
        if op.pack:
            names, sources = ["atlas"], [plane]  # measured as the plane that it is
            tiles = [tile | {"tile": mark_as_atlas(tile["tile"], op.variants)} for tile in material]
        else:
            tiles = [
                tile | {"tile": edged(tile["tile"], name, str(one))}
                for source, name, one in zip(sources, names, edges, strict=True)
                for tile in self._tiles(source)
            ]

        def looked_at() -> tuple[SomeRows, Iterator[Look]]:
            looks = map(self._quality.look_of_copies, names, itertools.repeat(self._lab()), sources)
            return self._own_lab(), looks

        return (self._quality.add_to(tiles[0], looked_at), *tiles[1:])


def _beside_drift(tile: dict[str, Any], drift: dict[str, Part]) -> dict[str, Any]:
    """A tile and the part drift with the tile's display window, which parts of one file share."""
    display = Window.display(tile["tile"].spec)
    names = ("full_x", "full_y", "full_width", "full_height")

    def describe(spec: oiio.ImageSpec) -> None:
        for name, value in zip(names, (display.left, display.top, *display.size), strict=True):
            setattr(spec, name, value)

    return tile | {name: part.respecced(describe) for name, part in drift.items()}
