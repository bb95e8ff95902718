# SPDX-License-Identifier: Apache-2.0
"""What --texstationarize and --texpatchmatch share: inputs, how a recipe becomes an image, the report."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

from ..core.access import InBands
from ..core.image import Image, Part
from ..core.op import Kind, Output
from ..core.parameters import Size, SizeRule, image, param
from ..core.source_map import COPIED, ST
from ..deferred import np
from ..errors import ParameterError, modifier
from ..patchmatch.memory import ExemplarHeld
from ..patchmatch.optimization import require_memory
from ..patchmatch.recipe import Recipe
from ..patchmatch.wang_tiles import TWO_COLORS_FROM
from ..quality.report import REPORT, Quality
from ..quality.reported_op import Reported
from ..session import Session
from ..session.progress import Progress
from ..session.resources import Resources
from .constraint_images import INPAINT, WEIGHT
from .exemplar_op import ExemplarPixels, MaterialOp
from .heights import RELEVEL
from .photo_lattice import least_size

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

    inpaint: Image | None = image(None, help=INPAINT)
    weight: Image | None = image(None, help=WEIGHT)
    relevel: bool = param(False, help=RELEVEL)
    size: SizeRule | Size | None = param(None, ge=5, le=65536, unit="px", help=_SIZE_HELP)
    tile: str | None = param(
        None,
        choices=("xy", "x", "y", "none", None),
        help="along which axes the result tiles; when left out xy, with inpaint none",
    )
    variants: int = param(
        1,
        ge=1,
        le=64,
        help="so many different tiles that go beside each other: up to 7 any beside any; from 8 on edges have two"
        " colors (16 is the whole set of Wang tiles), which part names and the attribute oiiotex:edges say",
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

    def compute(self, session: Session) -> dict[str, Any] | tuple[dict[str, Any], ...]:
        """The tile, and where its pixels come from; of several maps and variants one such mapping each."""
        from .synthesis_run import SynthesisRun  # help needs none of it

        return SynthesisRun(self, session.resources, session.progress).results()

    def second_choice(self, recipe: Recipe) -> Recipe | None:
        """What is tried where the first result is not faithful; None: nothing."""
        return None

    @property
    def judges_itself(self) -> bool:
        """Whether scales were left to the op."""
        return False

    def flattened(self, resources: Resources, progress: Progress) -> tuple[PatchSynthesis, dict[str, Part]]:
        """The op whose exemplar is what patches are taken from, and what else is made of it."""
        return self, {}

    def holds_photo(self, resources: Resources) -> bool:
        """Whether the photo lies in memory: what needs more than the budget with it is read by rows."""
        return self.holds(resources, _LAB_BYTES * self.n)

    def budget_left(self, resources: Resources) -> int:
        """Bytes that are left beside the maps' own pixels."""
        parts = [one.first for one in (self.exemplar, *self.maps)] if self.holds_photo(resources) else []
        return resources.budget - sum(p.spec.width * p.spec.height * p.pixel_bytes for p in parts)

    def planned(self, resources: Resources, progress: Progress) -> tuple[Size, Quality]:
        """The size that is asked for, and what is measured: refuses what the line alone shows to be wrong."""
        self.all_maps()  # as many as n says
        self._check()
        size = self.asked_size
        tiling = self.tiling if self.variants < TWO_COLORS_FROM else "none"  # from there on a tile goes on in others
        quality = Quality.of_copies(self, resources, progress, size, tiling, patch=self.side, losses=self.finds_losses)
        if self.inpaint is None:
            self._require_memory(size, resources)
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

    @property
    def finds_losses(self) -> bool:
        """Whether it is found out how much of the photo's texture a result lacks."""
        return False

    @property
    def side(self) -> int:
        """Of a patch, px."""
        return self.patch or PATCH

    @property
    def sized(self) -> bool:
        """Whether an image on the stack prescribes the size of the result."""
        return self.inpaint is not None

    def sigmas(self, width: int, height: int) -> np.ndarray | None:
        """The sigma at each pixel of a result of this size, where they differ."""
        return None

    def controlled(self, recipe: Recipe, seen: ExemplarPixels, resources: Resources, progress: Progress) -> Recipe:
        """The recipe with what follows from the photo."""
        return recipe

    def _check(self) -> None:
        """Refuse modifiers that do not go together."""
        if self.relevel and "height" not in self.map_kinds:
            raise ParameterError(f"{modifier(relevel=True)}: none of the maps is a height: kinds= says which is")
        own = Size(self.exemplar.first.spec.width, self.exemplar.first.spec.height)
        if self.inpaint is not None and self.asked_size != own:
            raise ParameterError(f"size={self.size}: with inpaint the result is as large as the photo, {own}")
        if self.variants > 1:
            wrong = "inpaint" if self.inpaint is not None else "stmap" if isinstance(self.stmap, Path) else ""
            wrong = wrong or ("relevel" if self.relevel else "")
            wrong = wrong or ("" if self.tiling == "xy" else f"tile={self.tile}")
            if wrong:
                raise ParameterError(f"variants={self.variants} does not go with {wrong}")

    def _require_memory(self, size: Size, resources: Resources) -> None:
        """Refuse what sizes alone show not to fit; of what `inpaint` makes anew nothing is known."""
        if self.size is None and self.kept_structure > 0 and not self.sized:
            least = least_size(size, ("x" in self.tiling, "y" in self.tiling))
            size = Size(*(max(n, self.side) for n in least))
        recipe, spec = self.recipe(*size), self.exemplar.first.spec
        if self.values().get("amount") is not None or getattr(self, "sigmamap", None) is not None:
            recipe = replace(recipe, sigma=None)  # it hangs on pixels
        held = ExemplarHeld(self.holds_photo(resources), self.mask is not None or self.label is not None)
        require_memory(resources.device, recipe, (spec.height, spec.width, 3), self.budget_left(resources), held)

    @property
    def tiling(self) -> str:
        """Along which axes the result tiles."""
        return self.tile or ("xy" if self.inpaint is None else "none")
