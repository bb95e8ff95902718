# SPDX-License-Identifier: Apache-2.0
"""What --texstationarize and --texpatchmatch share: inputs, how a recipe becomes an image, the report."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

from ..color.config import as_float
from ..color.lab import working_values
from ..core.access import InBands
from ..core.demand import SomeRows, first_channels, materialized
from ..core.image import Image, Part, from_pixels
from ..core.op import Kind, Output
from ..core.parameters import Size, SizeRule, image, param
from ..core.source_map import COPIED, ST, SourceMap
from ..core.window import Window
from ..deferred import np, oiio
from ..errors import ParameterError, modifier
from ..patchmatch.constraints import Constraints, FixedPixels
from ..patchmatch.field import hash_at
from ..patchmatch.memory import ExemplarHeld
from ..patchmatch.optimization import Synthesis, require_memory, synthesize
from ..patchmatch.recipe import Recipe
from ..patchmatch.wang_tiles import TWO_COLOURS_FROM, edged, edges_of, runs_for, wang_tiles
from ..quality.report import REPORT, Look, Quality
from ..quality.reported_op import Reported
from ..regularity.courses import InCourses
from ..regularity.offset_prices import InStep
from ..session import Session
from .coarse_looks import coarse_looks
from .constraint_images import WEIGHT, WITHIN, marked_pixels, remade_source, weights_of
from .exemplar_op import ExemplarPixels, MaterialOp
from .heights import RELEVEL, height_tile
from .photo_lattice import fitting_size, least_size, photo_courses, photo_lattice

_PATCHES, PATCH = tuple(range(5, 23, 2)), 13
_LAB_BYTES = 12  # a pixel of a map
_SIZE_HELP = "size of the result. pow2: the nearest power of two of each side of the photo. Default: the photo's size"
_PATCH_HELP = f"Side of a patch: the scale up to which detail is copied whole. Default: {PATCH}."


@dataclass(frozen=True, kw_only=True)
class PatchSynthesis(Reported, MaterialOp, InBands):
    """What both ops share: inputs, how a recipe becomes an image, the report."""

    outputs: ClassVar[tuple[Output, ...]] = (
        Output("tile", Kind.PIXELS, f"{COPIED}; of n maps n images, in their order; of variants that many"),
        ST,
        REPORT,
    )

    within: Image | None = image(None, help=WITHIN)
    weight: Image | None = image(None, help=WEIGHT)
    relevel: bool = param(False, help=RELEVEL)
    size: SizeRule | Size | None = param(None, ge=5, le=65536, unit="px", help=_SIZE_HELP)
    tile: str | None = param(
        None,
        choices=("xy", "x", "y", "none", None),
        help="along which axes the result tiles; when left out xy, with within none",
    )
    variants: int = param(
        1,
        ge=1,
        le=64,
        help="so many different tiles that go beside each other: up to 7 any beside any; from 8 on edges have two"
        " colours (16 is the whole set of Wang tiles), which part names and the attribute oiiotex:edges say",
    )
    patch: int | None = param(None, choices=(*_PATCHES, None), unit="px", help=_PATCH_HELP)
    iterations: int = param(
        30, ge=1, le=1000, help="Iterations on the coarsest level; each finer level has one. Default: 30."
    )
    uniformity: float = param(
        0.01,
        ge=0,
        le=1,
        help="how strongly the use of all parts of the exemplar is evened out; above 0.1 it costs coherence",
    )
    reuse: float = param(
        1.0,
        ge=0,
        le=1,
        help="Weight of the penalty on regions of the photo that are shown more than 2 times. 0: none; the result is"
        " closer to the photo and repeats more. Default: 1.",
    )
    resume: bool = param(
        False, help="keep finished levels in OUT.parts until OUT is whole: a run that was killed goes on from there"
    )

    def recipe(self, width: int, height: int) -> Recipe:
        """What to synthesize at this size."""
        raise NotImplementedError

    def _recipe(self, width: int, height: int, sigma: float | None, contrast: float, flat: bool) -> Recipe:
        return Recipe.tiling(
            width,
            height,
            self.tiling,
            # twice the tile is a flat window already
            sigma=None if sigma is None else min(sigma, 2.0 * max(width, height)),
            patch=self.side,
            iterations=self.iterations,
            seed=self.seed,
            uniformity=self.uniformity,
            reuse=self.reuse,
            # one piece all around the torus cannot be leveled by a constant
            shifted="height" not in self.map_kinds,
            contrast=contrast,
            flat=flat,
        )

    def result_count(self) -> int:
        """Each variant and each map of the material is an image of its own."""
        return self.variants * super().result_count()

    def compute(self, session: Session) -> dict[str, Part] | tuple[dict[str, Part], ...]:
        """The tile, and where its pixels come from; of several maps and variants one such mapping each."""
        from .first_result import better_of, hint_that_it_tiles, say_fidelity  # help needs none of it

        size, quality = self.planned(session)
        stages = session.stages()
        with session.stats.time("flatten"):
            flat, drift = self.flattened(next(stages))
        session = next(stages)
        with session.stats.time("read and colour"):
            parts = [self._in_any_order(image.first, session) for image in flat.all_maps()]
            marked = None if self.within is None else marked_pixels(self.within, self.exemplar)
            weight = None if self.weight is None else weights_of(self.weight, self.exemplar)
        seen = flat.read(session, None if marked is None else ~marked, None if weight is None else weight > 0)
        if not self.holds_photo(session):
            session.cache.forget()  # all of it has been read
        lattice = None
        if self.kept_structure > 0:
            with session.stats.time("lattice"):
                lattice = seen.remembered(session, photo_lattice, self.flag())
        wraps = "x" in self.tiling, "y" in self.tiling
        width, height = fitting_size(self.flag(), lattice, size, self.size is not None or self.sized, wraps)
        sigmas = self.sigmas(width, height)
        recipe = self.controlled(self.recipe(width, height), seen, session)
        if sigmas is not None:  # of what has one sigma for all, the photo made stationary
            recipe = replace(recipe, sigma=float(np.exp(np.log(sigmas).mean())))
        if lattice is not None:
            wanted = lattice.on_torus(recipe)
            recipe = replace(recipe, in_step=InStep(lattice, wanted, self.kept_structure))
            steps = tuple(map(tuple, np.linalg.pinv(wanted).T.tolist()))
            across, down = np.abs(wanted).max(0).tolist()
            quality = replace(quality, cycles=(across, down), lattice=steps)
        elif self.kept_structure > 0:
            courses = seen.remembered(session, photo_courses, self.flag())
            if courses is not None:
                recipe = replace(recipe, in_step=InCourses.of(courses, recipe, self.kept_structure))
        budget = self._budget(session)
        look = coarse_looks(parts[0], session) if marked is None and self.variants == 1 else None

        def run(
            recipe: Recipe, constraints: Constraints, advance: Callable[[int, int], None] = session.advance
        ) -> Synthesis:
            keeper = session.resources.keeper if self.resume else None
            given = seen.values, seen.usable, recipe, budget, advance, seen.why, constraints, keeper
            synthesis = synthesize(session.device, *given, look=look)
            if synthesis.lost is not None:
                from ..quality.lost_structure import say_what_was_lost

                say_what_was_lost(self.flag(), synthesis.lost)
            return synthesis

        constraints = Constraints(weight=weight, sigmas=sigmas)
        quality = replace(
            quality, sigma=recipe.sigma, contrast=recipe.contrast, measure=recipe.measure, order=recipe.order
        )

        def lab() -> SomeRows:
            values = first_channels(seen.values, 3)
            return np.ascontiguousarray(values) if isinstance(values, np.ndarray) else values

        def own() -> SomeRows:
            if flat is self:
                return lab()
            return working_values(self.exemplar, session, self.working_space, self.holds_photo(session))[0]

        if self.variants > 1:
            first, *others = self._variants(parts, recipe, constraints, run, session, quality, lab, own)
            return _beside_drift(first, drift), *others
        kept = None
        if marked is not None:
            if not marked.any():
                self.warn("within marks no pixel: the photo stays as it is")
            source, lost = remade_source(marked, seen.opaque, recipe, constraints, run), None
        else:
            if self.tiling == "xy" and self.size is None and self.holds_photo(session):
                hint_that_it_tiles(self.flag(), self.exemplar.first)
            other = self.second_choice(recipe)
            synthesis, kept, recipe = better_of(self.flag(), run, constraints, recipe, other, seen, stages)
            source, lost = synthesis.source, synthesis.lost
            quality = replace(quality, sigma=recipe.sigma)
            say_fidelity(self.flag(), kept, recipe, warn=self.judges_itself)
        session.device.collect(session.stats)
        self.say_what_stays()
        tiles = self._tiles(parts, source, session, in_place=marked is not None)
        first, *others = self._with_heights(tiles, source, None if marked is None else ~marked, session)
        if kept is not None:
            facts = {"oiiotex:chosen": recipe.scales, "oiiotex:fidelity": f"{kept.value:.3f}"}
            first["tile"] = first["tile"].respecced(lambda spec: [spec.attribute(*fact) for fact in facts.items()])
        if session.look is not None:
            session.look(as_float(first["tile"].pixels()), True)
        more = {} if kept is None else kept.measures()
        more |= {} if lost is None else {"textured_photo": lost.own, "textured": lost.shown}
        if lattice is not None and quality.is_asked_for:
            from ..quality.lost_structure import regularity_of

            more |= regularity_of(lab(), source, recipe)

        def looked_at() -> tuple[SomeRows, list[Look]]:
            return own(), [quality.look_of_copies(first["tile"].name, lab(), source)]

        first = _beside_drift(quality.add_to(first, looked_at, **more), drift)
        return (first, *others) if others else first

    def second_choice(self, recipe: Recipe) -> Recipe | None:
        """What is tried where the first result is not faithful; None: nothing."""
        return None

    @property
    def judges_itself(self) -> bool:
        """Whether scales were left to the op."""
        return False

    def flattened(self, session: Session) -> tuple[PatchSynthesis, dict[str, Part]]:
        """The op whose exemplar is what patches are taken from, and what else is made of it."""
        return self, {}

    def holds_photo(self, session: Session) -> bool:
        """Whether the photo lies in memory: what needs more than the budget with it is read by rows."""
        return self.holds(session, _LAB_BYTES * self.n)

    def _in_any_order(self, part: Part, session: Session) -> Part:
        """The same pixels, decoded: in memory where the photo lies there."""
        if self.holds_photo(session):
            return from_pixels(part.name, part.pixels(), part.spec, part.stored)
        return Part(part.name, part.spec, materialized(part, 0).fetch, part.stored, ready=True)

    def _budget(self, session: Session) -> int:
        """What is left beside the maps' own pixels."""
        parts = [one.first for one in (self.exemplar, *self.maps)] if self.holds_photo(session) else []
        return session.budget - sum(p.spec.width * p.spec.height * p.pixel_bytes for p in parts)

    def planned(self, session: Session) -> tuple[Size, Quality]:
        """The size that is asked for, and what is measured: refuses what the line alone shows to be wrong."""
        self.all_maps()  # as many as n says
        self._check()
        size = self.asked_size
        tiling = self.tiling if self.variants < TWO_COLOURS_FROM else "none"  # from there on a tile goes on in others
        quality = Quality.of_copies(self, session, size, tiling, patch=self.side, losses=self.finds_losses)
        if self.within is None:
            self._require_memory(size, session)
        return size, quality

    @property
    def asked_size(self) -> Size:
        """The size that `size` says, before a lattice of the photo may change its default."""
        own = Size(self.exemplar.first.spec.width, self.exemplar.first.spec.height)
        return own.powers_of_two() if self.size == SizeRule.POW2 else self.size or own

    @property
    def kept_structure(self) -> float:
        """How much of the photo's lattice the result keeps, 0 to 1."""
        return 0.0

    def _tiles(
        self, maps: list[Part], source: SourceMap, session: Session, in_place: bool = False
    ) -> tuple[dict[str, Part], ...]:
        """All maps from the same pixels; the source coordinates follow the first."""
        tiling = "none" if self.variants > 1 else self.tiling  # variants go on in each other
        by_rows = not self.holds_photo(session)
        return self.of_all(maps, lambda one, _: source.parts("tile", one, tiling, in_place, by_rows=by_rows))

    @property
    def finds_losses(self) -> bool:
        """Whether it is found out how much of the photo's texture a result lacks."""
        return False

    def _with_heights(
        self, tiles: tuple[dict[str, Part], ...], source: SourceMap, still: np.ndarray | None, session: Session
    ) -> tuple[dict[str, Part], ...]:
        """The tiles, the steps in heights among them measured, and closed where that was asked for."""
        wrap = "x" in self.tiling, "y" in self.tiling
        maps, results = (self.exemplar, *self.maps), []
        for tile, one, kind in zip(tiles, maps, self.map_kinds, strict=True):
            if kind == "height":
                part = height_tile(self.flag(), tile["tile"], one, source, wrap, self.relevel, still, session)
                tile = tile | {"tile": part}
            results.append(tile)
        return tuple(results)

    @property
    def side(self) -> int:
        """Of a patch, px."""
        return self.patch or PATCH

    @property
    def sized(self) -> bool:
        """Whether an image on the stack prescribes the size of the result."""
        return self.within is not None

    def sigmas(self, width: int, height: int) -> np.ndarray | None:
        """The sigma at each pixel of a result of this size, where they differ."""
        return None

    def controlled(self, recipe: Recipe, seen: ExemplarPixels, session: Session) -> Recipe:
        """The recipe with what follows from the photo."""
        return recipe

    def _check(self) -> None:
        """Refuse modifiers that do not go together."""
        if self.relevel and "height" not in self.map_kinds:
            raise ParameterError(f"{modifier(relevel=True)}: none of the maps is a height: kinds= says which is")
        own = Size(self.exemplar.first.spec.width, self.exemplar.first.spec.height)
        if self.within is not None and self.asked_size != own:
            raise ParameterError(f"size={self.size}: with within the result is as large as the photo, {own}")
        if self.variants > 1:
            wrong = "within" if self.within is not None else "stmap" if isinstance(self.stmap, Path) else ""
            wrong = wrong or ("relevel" if self.relevel else "")
            wrong = wrong or ("" if self.tiling == "xy" else f"tile={self.tile}")
            if wrong:
                raise ParameterError(f"variants={self.variants} does not go with {wrong}")

    def _require_memory(self, size: Size, session: Session) -> None:
        """Refuse what sizes alone show not to fit; of what `within` makes anew nothing is known."""
        if self.size is None and self.kept_structure > 0 and not self.sized:
            least = least_size(size, ("x" in self.tiling, "y" in self.tiling))
            size = Size(*(max(n, self.side) for n in least))
        recipe, spec = self.recipe(*size), self.exemplar.first.spec
        if self.values().get("amount") is not None or getattr(self, "sigmamap", None) is not None:
            recipe = replace(recipe, sigma=None)  # it hangs on pixels
        held = ExemplarHeld(self.holds_photo(session), self.mask is not None or self.label is not None)
        require_memory(session.device, recipe, (spec.height, spec.width, 3), self._budget(session), held)

    @property
    def tiling(self) -> str:
        """Along which axes the result tiles."""
        return self.tile or ("xy" if self.within is None else "none")

    def _variants(
        self, maps: list[Part], recipe: Recipe, constraints: Constraints, run: Callable[..., Synthesis],
        session: Session, quality: Quality, lab: Callable[[], SomeRows], own: Callable[[], SomeRows],
    ) -> tuple[dict[str, Part], ...]:  # fmt: skip
        """Tiles with matching edges, each followed by the other maps of its material."""
        runs = runs_for(self.variants)
        session.require(4 * recipe.width * recipe.height * (runs + 1), f"a set of {self.variants} tiles")

        def make(fixed: FixedPixels | None, number: int, tiles: bool) -> SourceMap:
            seed = int(hash_at(self.seed, 0x3A95, np.array([number]), np.array([0]))[0])
            own = replace(recipe, wrap_x=tiles, wrap_y=tiles, seed=seed)

            def advance(done: int, total: int) -> None:
                session.advance(number * total + done, runs * total)

            source = run(own, replace(constraints, fixed=fixed), advance).source
            return SourceMap(np.asarray(source.packed))  # tiles are cut out of others

        sources = wang_tiles(make, self.variants, recipe.width, recipe.height, recipe.patch)
        session.device.collect(session.stats)
        self.say_what_stays()
        tiles = []
        for number, (source, edges) in enumerate(zip(sources, edges_of(self.variants), strict=True)):
            material = self._tiles(maps, source, session)
            if number == 0:  # as the others are
                self._with_heights(material, source, None, session)
            for tile in material:
                tiles.append(tile | {"tile": edged(tile["tile"], f"wang{number:02d}_{edges}", str(edges))})
        names = (tile["tile"].name for tile in tiles[:: len(maps)])

        def looked_at() -> tuple[SomeRows, Iterator[Look]]:
            looks = map(quality.look_of_copies, names, itertools.repeat(lab()), sources)
            return own(), looks

        return (quality.add_to(tiles[0], looked_at), *tiles[1:])


def _beside_drift(tile: dict[str, Any], drift: dict[str, Part]) -> dict[str, Any]:
    """A tile and the photo's drift, with the tile's display window: parts of one file have the same."""
    display = Window.display(tile["tile"].spec)
    names = ("full_x", "full_y", "full_width", "full_height")

    def describe(spec: oiio.ImageSpec) -> None:
        for name, value in zip(names, (display.left, display.top, *display.size), strict=True):
            setattr(spec, name, value)

    return tile | {name: part.respecced(describe) for name, part in drift.items()}
