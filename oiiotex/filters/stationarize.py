# SPDX-License-Identifier: Apache-2.0
"""--texstationarize, and what it shares with --texpatchmatch: MJH17."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

from ..color.config import as_float
from ..core.access import Whole
from ..core.attributes import mark_as_data
from ..core.image import Image, Part, from_pixels
from ..core.op import Kind, Output
from ..core.parameters import Numbers, Size, Words, image, param
from ..core.source_map import COPIED, ST, SourceMap
from ..deferred import np
from ..errors import ParameterError
from ..exemplar.coarse_looks import coarse_looks
from ..exemplar.constraint_images import SIGMAMAP, WEIGHT, WITHIN, marked_pixels, remade_source, sigmas_of, weights_of
from ..exemplar.exemplar_op import ExemplarOp, ExemplarPixels
from ..exemplar.heights import RELEVEL, height_tile
from ..exemplar.large_structures import CONTRAST, fitting_contrast
from ..exemplar.materials import KINDS_HELP, MATCH_HELP, kinds_of, read_material
from ..exemplar.photo_lattice import STRUCTURE, fitting_size, least_size, photo_lattice
from ..patchmatch.constraints import Constraints, FixedPixels
from ..patchmatch.field import hash_at
from ..patchmatch.optimization import Recipe, Synthesis, require_memory, synthesize
from ..patchmatch.sigma_scale import DEFAULT_COUNT, SigmaTiles, perceived_scale
from ..patchmatch.wang_tiles import TWO_COLOURS_FROM, edged, edges_of, runs_for, wang_tiles
from ..regularity.lattice import Lattice
from ..regularity.offset_prices import InStep
from ..session import Session
from .measures import MEASURE, MEASURES, ORDER, order_of, scale_folder
from .presets import PRESET_HELP, PRESETS, filled
from .tilereport import FAIL_HELP, REPORT, REPORT_HELP, Look, Quality, regularity_of, say_what_was_lost

log = logging.getLogger("oiiotex")

_PATCHES, _PATCH = tuple(range(5, 23, 2)), 11
_PATCH_HELP = f"side of a patch: the scale up to which detail is copied whole; {_PATCH} when left out"


@dataclass(frozen=True, kw_only=True)
class PatchSynthesis(ExemplarOp, Whole):
    """What both ops share: inputs, how a recipe becomes an image, the report."""

    outputs: ClassVar[tuple[Output, ...]] = (
        Output("tile", Kind.PIXELS, f"{COPIED}; of n maps n images, in their order; of variants that many"),
        ST,
        REPORT,
    )

    exemplar: Image = image(help="the photo; of n maps of a material, the first")
    maps: tuple[Image, ...] = image((), help="the other maps of the material, made anew with it", count="n")
    within: Image | None = image(None, help=WITHIN)
    weight: Image | None = image(None, help=WEIGHT)
    n: int = param(1, ge=1, le=16, help="how many maps of one material are made together, the last images of the stack")
    kinds: Words | None = param(None, help=KINDS_HELP)
    match: Numbers | None = param(None, ge=0, help=MATCH_HELP)
    relevel: bool = param(False, help=RELEVEL)
    size: Size | None = param(None, ge=5, le=65536, unit="px", help="of the result; the exemplar's own when left out")
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
    iterations: int = param(30, ge=1, le=1000, help="on the coarsest level; each finer one has 3")
    uniformity: float = param(
        0.01,
        ge=0,
        le=1,
        help="how strongly the use of all parts of the exemplar is evened out; above 0.1 it costs coherence",
    )
    report: Path | None = param(None, help=REPORT_HELP)
    fail: Words | None = param(None, help=FAIL_HELP)

    def seen(self, session: Session) -> tuple[np.ndarray, np.ndarray | None]:
        """All maps of the material together."""
        return read_material((self.exemplar, *self.maps), self.kinds, self.match, self.data, session)

    def recipe(self, width: int, height: int) -> Recipe:
        """What to synthesize at this size."""
        raise NotImplementedError

    def _recipe(self, width: int, height: int, sigma: float | None, contrast: float, flat: bool) -> Recipe:
        flat_window = 2.0 * max(width, height)
        return Recipe.tiling(
            width, height, self.tiling, sigma=None if sigma is None else min(sigma, flat_window),
            patch=self.patch or _PATCH, iterations=self.iterations, seed=self.seed, uniformity=self.uniformity,
            contrast=contrast, flat=flat,
        )  # fmt: skip

    def result_count(self) -> int:
        """Each variant and each map of the material is an image of its own."""
        return self.variants * (1 + len(self.maps))

    def compute(self, session: Session) -> dict[str, Part] | tuple[dict[str, Part], ...]:
        """The tile, and where its pixels come from; of several maps and variants one such mapping each."""
        maps, size, quality = self.planned(session)
        with session.stats.time("read and colour"):
            parts = [from_pixels(p.name, p.pixels(), p.spec, p.stored) for p in (image.first for image in maps)]
            marked = None if self.within is None else marked_pixels(self.within, self.exemplar)
            weight = None if self.weight is None else weights_of(self.weight, self.exemplar)
        seen = self.read(session, None if marked is None else ~marked, None if weight is None else weight > 0)
        lattice = None
        if self.kept_structure > 0:
            with session.stats.time("lattice"):
                lattice = seen.remembered(session, photo_lattice, self.flag())
        wraps = "x" in self.tiling, "y" in self.tiling
        width, height = fitting_size(self.flag(), lattice, size, self.size is not None or self.sized, wraps)
        sigmas = self.sigmas(width, height)
        recipe = self.controlled(self.recipe(width, height), seen, lattice, session)
        if sigmas is not None:  # of what has one sigma for all, the photo made stationary
            recipe = replace(recipe, sigma=float(np.exp(np.log(sigmas).mean())))
        if lattice is not None:
            wanted = lattice.on_torus(recipe)
            recipe = replace(recipe, in_step=InStep(lattice, wanted, self.kept_structure))
        budget = session.budget - sum(p.spec.width * p.spec.height * p.pixel_bytes for p in parts)

        look = coarse_looks(parts[0], session) if marked is None and self.variants == 1 else None

        def run(
            recipe: Recipe, constraints: Constraints, advance: Callable[[int, int], None] = session.advance
        ) -> Synthesis:
            given = seen.values, seen.usable, recipe, budget, advance, seen.why, constraints
            synthesis = synthesize(session.device, *given, look=look)
            if synthesis.lost is not None:
                say_what_was_lost(self.flag(), synthesis.lost, self.contrast is None and recipe.contrast == 0)
            return synthesis

        constraints = Constraints(weight=weight, sigmas=sigmas)
        quality = replace(
            quality, sigma=recipe.sigma, contrast=recipe.contrast, measure=recipe.measure, order=recipe.order
        )
        lab = np.ascontiguousarray(seen.values[..., :3])
        if self.variants > 1:
            return self._variants(parts, recipe, constraints, run, session, quality, lab)
        if marked is not None:
            if not marked.any():
                log.warning("%s: within marks no pixel: the photo stays as it is", self.flag())
            source, lost = remade_source(marked, seen.opaque, recipe, constraints, run), None
        else:
            synthesis = run(recipe, constraints)
            source, lost = synthesis.source, synthesis.lost
        session.device.collect(session.stats)
        self.say_what_stays()
        tiles = self._tiles(parts, source, in_place=marked is not None)
        first, *others = self._with_heights(tiles, source, None if marked is None else ~marked, session)
        if session.look is not None:
            session.look(as_float(first["tile"].pixels()), True)
        more = {} if lost is None else {"textured_photo": lost.own, "textured": lost.shown}
        if recipe.in_step is not None and quality.is_asked_for:
            more |= regularity_of(lab, source, recipe)

        def looked_at() -> tuple[np.ndarray, list[Look]]:
            return lab, [Look.of_copies(first["tile"].name, lab, source)]

        first = quality.add_to(first, looked_at, **more)
        return (first, *others) if others else first

    def planned(self, session: Session) -> tuple[tuple[Image, ...], Size, Quality]:
        """All maps, the size that is asked for, and what is measured: refuses what the line alone shows to be wrong."""
        maps = (self.exemplar, *self.maps)
        self._check(maps)
        size = self.size or Size(self.exemplar.first.spec.width, self.exemplar.first.spec.height)
        tiling = self.tiling if self.variants < TWO_COLOURS_FROM else "none"  # from there on a tile goes on in others
        patch = self.patch or _PATCH
        quality = Quality.of_copies(self, session, size, tiling, patch=patch, losses=self.finds_losses)
        if self.within is None:
            self._require_memory(size, session)
        return maps, size, quality

    @property
    def kept_structure(self) -> float:
        """How much of the photo's lattice the result keeps, 0 to 1."""
        return 0.0

    def _tiles(self, maps: list[Part], source: SourceMap, in_place: bool = False) -> tuple[dict[str, Part], ...]:
        """All maps from the same pixels; the source coordinates follow the first. What is no colour is data."""
        tiling = "none" if self.variants > 1 else self.tiling  # variants go on in each other
        tiles = []
        for one, kind in zip(maps, kinds_of(self.kinds, len(maps), self.data), strict=True):
            parts = source.parts("tile", one, tiling, in_place)
            tiles.append(parts if kind == "colour" else parts | {"tile": parts["tile"].respecced(mark_as_data)})
        return (tiles[0], *({"tile": tile["tile"]} for tile in tiles[1:]))

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
        for tile, one, kind in zip(tiles, maps, kinds_of(self.kinds, len(maps), self.data), strict=True):
            if kind == "height":
                part = height_tile(self.flag(), tile["tile"], one, source, wrap, self.relevel, still, session)
                tile = tile | {"tile": part}
            results.append(tile)
        return tuple(results)

    @property
    def sized(self) -> bool:
        """Whether an image on the stack prescribes the size of the result."""
        return self.within is not None

    def sigmas(self, width: int, height: int) -> np.ndarray | None:
        """The sigma at each pixel of a result of this size, where they differ."""
        return None

    def controlled(self, recipe: Recipe, seen: ExemplarPixels, lattice: Lattice | None, session: Session) -> Recipe:
        """The recipe with what follows from the photo."""
        return recipe

    def _check(self, maps: tuple[Image, ...]) -> None:
        """Refuse modifiers that do not go together."""
        if self.n != len(maps):
            raise ParameterError(f"n={self.n}: there are {len(maps)} maps")
        if self.relevel and "height" not in kinds_of(self.kinds, len(maps), self.data):
            raise ParameterError("relevel=1: none of the maps is a height: kinds= says which is")
        own = Size(self.exemplar.first.spec.width, self.exemplar.first.spec.height)
        if self.within is not None and self.size not in (None, own):
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
            size = Size(*(max(n, self.patch or _PATCH) for n in least))
        recipe, spec = self.recipe(*size), self.exemplar.first.spec
        if self.values().get("amount") is not None or getattr(self, "sigmamap", None) is not None:
            recipe = replace(recipe, sigma=None)  # it hangs on pixels
        parts = [one.first for one in (self.exemplar, *self.maps)]
        budget = session.budget - sum(p.spec.width * p.spec.height * p.pixel_bytes for p in parts)
        require_memory(session.device, recipe, (spec.height, spec.width, 3), budget)

    @property
    def tiling(self) -> str:
        """Along which axes the result tiles."""
        return self.tile or ("xy" if self.within is None else "none")

    def _variants(
        self, maps: list[Part], recipe: Recipe, constraints: Constraints, run: Callable[..., Synthesis],
        session: Session, quality: Quality, lab: np.ndarray,
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
            material = self._tiles(maps, source)
            if number == 0:  # as the others are
                self._with_heights(material, source, None, session)
            for tile in material:
                tiles.append(tile | {"tile": edged(tile["tile"], f"wang{number:02d}_{edges}", str(edges))})
        names = (tile["tile"].name for tile in tiles[:: len(maps)])
        looks = (Look.of_copies(name, lab, source) for name, source in zip(names, sources, strict=True))
        return (quality.add_to(tiles[0], lambda: (lab, looks)), *tiles[1:])


@dataclass(frozen=True, kw_only=True)
class Stationarize(PatchSynthesis):
    """Turn a photo into a texture that tiles without visible repetition.

    Gradients of light, stains and other slow drift repeat visibly when a photo is tiled. This filter synthesizes the
    photo anew from its own patches while it makes local histograms, or another measure, the same everywhere above a
    scale sigma (MJH17: Moritz, James, Haines, Ritschel, Weyrich, Texture Stationarization, Eurographics 2017). Every
    pixel of the result is a copy of one pixel of the photo; with relevel=1 heights are copies plus a constant for each
    copied piece.
    """

    name: ClassVar[str] = "stationarize"

    sigmamap: Image | None = image(None, help=SIGMAMAP)
    sigma: float | None = param(
        None,
        ge=0.5,
        le=1e6,
        unit="px",
        help="scale above which the texture must look the same everywhere; longer side / 32 when left out",
    )
    amount: float | None = param(
        None,
        ge=0,
        le=1,
        help="instead of sigma: how stationary it shall look, in even steps that hang on the photo (see --texsigmas)",
    )
    contrast: float | None = param(
        None,
        ge=0,
        le=1,
        help="how strongly the overall histogram is held to the target's; 0: not at all, with within the default;"
        " when left out 0.7, but 0 where it would spread structures that stand out of the photo's texture",
    )
    target: str = param(
        "flat",
        choices=("flat", "exemplar"),
        help="the histogram that contrast holds to: that of the photo made stationary, or (as in the paper, fading out"
        " over the coarsest level) of the photo",
    )

    measure: str = param("histogram", choices=MEASURES, help=MEASURE)
    order: int | None = param(None, ge=2, le=4, help=ORDER)
    structure: float = param(0.5, ge=0, le=1, help=STRUCTURE)
    preset: str | None = param(None, choices=(*PRESETS, None), help=PRESET_HELP)

    def compute(self, session: Session) -> dict[str, Part] | tuple[dict[str, Part], ...]:
        """As all of its kind; a preset first becomes what it stands for."""
        if self.preset is None:
            return super().compute(session)
        stages = session.stages()
        return filled(self, next(stages)).compute(next(stages))

    @property
    def kept_structure(self) -> float:
        """As the user says."""
        return self.structure

    @property
    def sized(self) -> bool:
        """With within or sigmamap."""
        return self.within is not None or self.sigmamap is not None

    def recipe(self, width: int, height: int) -> Recipe:
        """MJH17 by the measure that was asked for."""
        order = order_of(self.measure, self.order)
        sigma = self.sigma or max(width, height) / 32
        contrast = self.contrast if self.contrast is not None else CONTRAST if self.within is None else 0.0
        plain = self._recipe(width, height, sigma, contrast, self.target == "flat")
        # what is made anew within a photo goes with its surroundings, be they flat
        return replace(plain, measure=self.measure, order=order, complete=self.within is None)

    @property
    def finds_losses(self) -> bool:
        """Of one whole tile."""
        return self.within is None and self.variants == 1

    def controlled(self, recipe: Recipe, seen: ExemplarPixels, lattice: Lattice | None, session: Session) -> Recipe:
        """With the contrast that fits the photo, and the sigma of `amount` (MJH17 section 4.4)."""
        if self.contrast is None and self.within is None:
            recipe = replace(recipe, contrast=self.fitting_contrast(seen, lattice, session))
        if self.amount is None:
            return recipe
        if self.sigma is not None:
            raise ParameterError(f"amount={self.amount:g}: sigma={self.sigma:g} says it already")
        tiles = SigmaTiles(session.device, seen.values, seen.usable, recipe, session.budget, seen.why)
        scale = perceived_scale(tiles, DEFAULT_COUNT, session.advance, scale_folder())
        sigma = scale.sigma_at(self.amount)
        log.info("%s: amount %g is sigma %.2f px", self.flag(), self.amount, sigma)
        return replace(recipe, sigma=sigma)

    def fitting_contrast(self, seen: ExemplarPixels, lattice: Lattice | None, session: Session) -> float:
        """The contrast where it is left out; a lattice that is kept is no structure that is spread."""
        if lattice is not None:
            return CONTRAST
        return seen.remembered(session, fitting_contrast, self.flag(), session)

    def sigmas(self, width: int, height: int) -> np.ndarray | None:
        """From sigmamap."""
        if self.sigmamap is None:
            return None
        for name, value in (("sigma", self.sigma), ("amount", self.amount)):
            if value is not None:
                raise ParameterError(f"{name}={value:g}: sigmamap says it already")
        return sigmas_of(self.sigmamap, width, height)
