# SPDX-License-Identifier: Apache-2.0
"""Common base of --texstationarize and --texpatchmatch: inputs, checks, and the synthesis run."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from ...analysis.drift.flattening import correction_part
from ...engine.core.access import InBands
from ...engine.core.image import Image, Part
from ...engine.core.op import Kind, Output, Plan, no_pixels
from ...engine.core.parameters import Size, SizeRule, param
from ...engine.core.source_map import COPIED, ST, Sources, tile_spec
from ...engine.core.window import Window
from ...engine.deferred import oiio
from ...engine.errors import ParameterError, modifier, whole_budget
from ...engine.session.facts import Facts
from ..patchmatch.memory import ExemplarHeld
from ..patchmatch.optimization import require_memory
from ..patchmatch.patch_search import RANDOM
from ..patchmatch.recipe import Recipe
from ..quality.report import REPORT, Quality
from ..quality.reported_op import Reported
from ..wang.atlas import mark_as_atlas
from ..wang.tiles import COUNTS, TWO_COLORS_FROM, edged, edges_of
from .exemplar_op import MaterialOp, tiles
from .photo_lattice import least_size

if TYPE_CHECKING:
    from ...engine.opencl.device import DeviceMemory

TILE_COUNTS = f"{', '.join(map(str, COUNTS[:-1]))} or {COUNTS[-1]}"
PATCHES, PATCH = tuple(range(5, 23, 2)), 13
_LAB_BYTES = 12  # for each pixel of a map
_SIZE_HELP = "Size of the result. pow2: each side of the photo, rounded to the nearest power of two."
PATCH_HELP = (
    "Side of a patch, in pixels. Structures up to this size are copied whole. Increase it if bricks or stones are cut."
)


@dataclass(frozen=True, kw_only=True)
class SynthesisPlan:
    """A synthesis as decided without pixels.

    Attributes
    ----------
    op : PatchSynthesis
        The op, with values for its preset.
    size : Size
        Of a tile, px. A lattice of the photo changes it, unless it `is_size_given`.
    quality : Quality
    in_memory : bool
        Whether the photo is held in memory; otherwise it is read by rows.
    budget : int
        Bytes of the budget that remain next to the maps' pixels.
    lattice : float
        How much of the photo's lattice the result keeps, 0 to 1.
    flattening : float or None
        Share of low-frequency variation to remove from the photo; 1: also its stains. None: the op does not flatten.
    sigmamap : Image or None
        Sigma at each pixel.
    evenness : float or None
        Visible uniformity, used instead of sigma (MJH17 section 4.4).
    judged : bool
        Whether other tiles are tried if the first one is not good, and a warning is given if none is fair.
    preset : str
        The preset whose values the op has; empty: none.
    dominant : bool
        Whether the preset takes source pixels only from the dominant texture.
    layout : bool
        Whether the tile keeps the photo's layout.
    """

    op: PatchSynthesis
    size: Size
    quality: Quality
    in_memory: bool
    budget: int
    lattice: float = 0.0
    flattening: float | None = None
    sigmamap: Image | None = None
    evenness: float | None = None
    judged: bool = False
    preset: str = ""
    dominant: bool = False
    layout: bool = False

    @property
    def is_size_given(self) -> bool:
        """Whether the size was given, or follows from an input image."""
        return self.op.size is not None or self.sigmamap is not None

    @property
    def images(self) -> tuple[dict[str, Part], ...] | None:
        """The results without pixels; None if the photo's lattice decides their size."""
        op, photo = self.op, self.op.exemplar.first
        if self.lattice > 0 and op.tiles != "none" and not self.is_size_given:
            return None
        width, height = (n * (math.isqrt(op.variants) if op.pack else 1) for n in self.size)

        def tile(one: Part, _: str) -> dict[str, Part]:
            return Sources(no_pixels, tile_spec(one.spec, op.tiling, (width, height)), by_rows=True).parts("tile", one)

        material = op.of_all([image.first for image in op.all_maps()], tile)
        first, *others = op.tiles_of_set([material] * len(op.names_of_set()))
        drift = replace(correction_part(None, photo), fetch=no_pixels)
        return (beside_drift(first, {} if self.flattening is None else {"drift": drift}), *others)


@dataclass(frozen=True, kw_only=True)
class PatchSynthesis(Reported, MaterialOp, InBands):
    """Inputs, checks and results of both ops; a subclass provides the recipe."""

    outputs: ClassVar[tuple[Output, ...]] = (
        Output("tile", Kind.PIXELS, f"{COPIED} One image for each of the maps, in order, and for each variant."),
        ST,
        REPORT,
    )

    weightmap: ClassVar[Image | None] = None
    relevel: ClassVar[bool] = False
    pack: ClassVar[str | None] = None
    equaluse: ClassVar[float] = 0.01
    resume: ClassVar[bool] = False
    search: ClassVar[str] = RANDOM

    size: SizeRule | Size | None = param(None, ge=5, le=65536, unit="px", unset="size of the photo", help=_SIZE_HELP)
    tiles: str = tiles("xy")
    variants: int = param(
        1,
        ge=1,
        le=64,
        help="Number of interchangeable tiles. 2 to 7: any tile fits next to any other. 8 or more: Wang tiles,"
        " which fit where edge colors agree; 16 or more are a complete set with two corner colors. Part names and the"
        " attribute oiiotex:edges contain the edge colors.",
    )
    patch: int | None = param(
        None, example="21", choices=(*PATCHES, None), unit="px", unset=str(PATCH), help=PATCH_HELP
    )
    iterations: int = param(
        30,
        ge=1,
        le=1000,
        advanced=True,
        help="Number of iterations on the coarsest level. Each finer level has one."
        " Increase it if a warning says that texture is lost.",
    )

    def recipe(self, width: int, height: int) -> Recipe:
        """What to synthesize at this size."""
        raise NotImplementedError

    def _recipe(self, width: int, height: int, sigma: float | None, contrast: float, flat: bool) -> Recipe:
        return Recipe.tiling(
            width,
            height,
            self.tiles,
            # beyond twice the tile the window is flat
            sigma=None if sigma is None else min(sigma, 2.0 * max(width, height)),
            patch=self.side,
            iterations=self.iterations,
            seed=self.seed,
            uniformity=self.equaluse,
            # a constant cannot level a piece that wraps around the torus
            shifted="height" not in self.map_kinds,
            contrast=contrast,
            flat=flat,
            search=self.search,
        )

    def result_count(self) -> int:
        """One image for each map of the material, times variants unless they are packed."""
        return (1 if self.pack else self.variants) * super().result_count()

    def plan(self, facts: Facts) -> Plan:
        """The synthesis."""
        self._check()
        with whole_budget(facts.budget):  # errors are told what is left of it
            return self._planned(facts)

    def _planned(self, facts: Facts, **choices: Any) -> Plan:
        """The synthesis, and its images if their size is known."""
        synthesis = self._synthesis(facts, **choices)
        return Plan(synthesis.images, synthesis)

    def _synthesis(self, facts: Facts, **choices: Any) -> SynthesisPlan:
        """The plan of this op; raises for all errors that do not depend on pixels."""
        size = self.asked_size
        tiling = self.tiles if self.pack or self.variants < TWO_COLORS_FROM else "none"  # continue in other tiles
        whole = Size(*(n * (math.isqrt(self.variants) if self.pack else 1) for n in size))
        quality = Quality.of_copies(
            self, facts, whole, tiling, patch=self.side, losses=choices.pop("finds_losses", False)
        )
        in_memory = self.holds_photo(facts)
        parts = [one.first for one in self.all_maps()] if in_memory else []
        budget = facts.budget - sum(p.spec.width * p.spec.height * p.pixel_bytes for p in parts)
        plan = SynthesisPlan(op=self, size=size, quality=quality, in_memory=in_memory, budget=budget, **choices)
        if facts.device_memory is not None:
            self._require_memory(plan, facts.device_memory)
        self.require_readable(facts)
        return plan

    def holds_photo(self, facts: Facts) -> bool:
        """Whether the photo is held in memory; otherwise it is read by rows."""
        return self.holds(facts, _LAB_BYTES * len(self.all_maps()))

    @property
    def asked_size(self) -> Size:
        """The requested size, before a lattice of the photo may change its default."""
        own = Size(self.exemplar.first.spec.width, self.exemplar.first.spec.height)
        return own.powers_of_two() if self.size == SizeRule.POW2 else self.size or own

    @property
    def side(self) -> int:
        """Side of a patch, px."""
        return self.patch or PATCH

    @property
    def tiling(self) -> str:
        """Axes along which each image tiles by itself: variants continue in each other."""
        return self.tiles if self.pack or self.variants == 1 else "none"

    def names_of_set(self) -> list[str]:
        """The names of interchangeable tiles, by number and edges, or of their atlas."""
        if self.pack or self.variants == 1:
            return ["atlas" if self.pack else "tile"]
        return [f"wang{number:02d}_{edges}" for number, edges in enumerate(edges_of(self.variants))]

    def tiles_of_set(self, materials: Iterable[tuple[dict[str, Part], ...]]) -> list[dict[str, Part]]:
        """The tiles of each material under its name and with its edges, or marked as an atlas."""
        if self.variants == 1:
            return [tile for material in materials for tile in material]
        if self.pack:
            return [t | {"tile": mark_as_atlas(t["tile"], self.variants)} for material in materials for t in material]
        named = zip(self.names_of_set(), edges_of(self.variants), materials, strict=True)
        return [tile | {"tile": edged(tile["tile"], name, str(edges))} for name, edges, each in named for tile in each]

    def _check(self) -> None:
        """Refuse conflicting modifiers."""
        if self.relevel and "height" not in self.map_kinds:
            raise ParameterError(f"{modifier(relevel=True)} requires kinds with a height")
        if self.pack and self.variants not in COUNTS:
            raise ParameterError(f"requires variants={TILE_COUNTS}", parameter="pack", value=self.pack)
        if self.variants > 1:
            one_file = isinstance(self.st, Path) and not self.pack
            wrong = "st" if one_file else "relevel without pack" if self.relevel and not self.pack else ""
            wrong = wrong or ("" if self.tiles == "xy" else f"tiles={self.tiles}")
            if wrong:
                raise ParameterError(f"conflicts with {wrong}", parameter="variants", value=self.variants)

    def _require_memory(self, plan: SynthesisPlan, device: DeviceMemory) -> None:
        """Refuse what exceeds the memory by sizes alone."""
        size, spec = plan.size, self.exemplar.first.spec
        if plan.lattice > 0 and not plan.is_size_given:
            size = Size(*(max(n, self.side) for n in least_size(size, ("x" in self.tiles, "y" in self.tiles))))
        recipe = self.recipe(*size)
        if plan.evenness is not None or plan.sigmamap is not None:
            recipe = replace(recipe, sigma=None)  # sigma depends on pixels
        masked = self.mask is not None or self.label is not None or plan.flattening == 1 or plan.dominant
        require_memory(device, recipe, (spec.height, spec.width, 3), plan.budget, ExemplarHeld(plan.in_memory, masked))


def beside_drift(tile: dict[str, Any], drift: dict[str, Part]) -> dict[str, Any]:
    """A tile and the part drift with the tile's display window, which parts of one file share."""
    display = Window.display(tile["tile"].spec)
    names = ("full_x", "full_y", "full_width", "full_height")

    def describe(spec: oiio.ImageSpec) -> None:
        for name, value in zip(names, (display.left, display.top, *display.size), strict=True):
            setattr(spec, name, value)

    return tile | {name: part.respecced(describe) for name, part in drift.items()}
