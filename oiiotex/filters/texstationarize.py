# SPDX-License-Identifier: Apache-2.0
"""--texstationarize: texture stationarization (MJH17)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

from ..analysis.drift.flattening import DRIFT, DRIFT_HELP, Flattening, correction_part
from ..analysis.stationarity.measures import MEASURE, MEASURES, ORDER, order_of, scale_folder
from ..engine.color.lab import lens_of
from ..engine.core.image import Image, Part
from ..engine.core.op import Output
from ..engine.core.parameters import image, param
from ..engine.deferred import np
from ..engine.errors import ParameterError, spelled, texture_filter
from ..engine.io.disk_cache import hash_of
from ..engine.session import Session
from ..engine.session.progress import Progress
from ..engine.session.resources import Resources
from ..synthesis.exemplar.constraint_images import SIGMAMAP, sigmas_of
from ..synthesis.exemplar.exemplar_masks import mask_of
from ..synthesis.exemplar.exemplar_op import ExemplarPixels
from ..synthesis.exemplar.patch_synthesis import PATCH, PatchSynthesis
from ..synthesis.exemplar.photo_lattice import STRUCTURE
from ..synthesis.exemplar.presets import (
    CLEAN,
    CONTRAST,
    LARGE_PATCH,
    LARGE_SIGMA_SHARE,
    PAPER_SIGMA_SHARE,
    PRESET_HELP,
    PRESETS,
    SIGMA_SHARE,
    filled,
)
from ..synthesis.exemplar.sigma_scale import DEFAULT_COUNT, SigmaTiles, perceived_scale
from ..synthesis.patchmatch.recipe import Recipe

PAPER_PATCH = 11
_DOMINANT_SHARE = 1  # time for the mask of preset=clean, relative to the synthesis


@dataclass(frozen=True, kw_only=True)
class Stationarize(PatchSynthesis):
    """Create a seamlessly tiling texture from a photo, without visible repetition.

    Gradients of light and stains repeat visibly when a photo is tiled, so `flattening` removes them first. The photo is
    then resynthesized from its own patches while local statistics (by default histograms) are kept uniform above a
    scale sigma (MJH17: Moritz, James, Haines, Ritschel, Weyrich, Texture Stationarization, Eurographics 2017).

    Every pixel of the result is a copy of one pixel of the photo, with all its channels. Where low-frequency variation
    was removed, a gain and an offset in Lab are applied to the copy. With `relevel`, a constant is also added to each
    copied piece of a height map.
    """

    example: ClassVar[str] = """\
>>> tile = filters.stationarize("photo.png", preset="large", seed=7)
>>> tile.write("tile.png")
True
"""
    name: ClassVar[str] = "stationarize"
    outputs: ClassVar[tuple[Output, ...]] = (*PatchSynthesis.outputs, DRIFT)

    sigmamap: Image | None = image(None, help=SIGMAMAP)
    flattening: float | None = param(
        None,
        example="0.5",
        ge=0,
        le=1,
        unset="1; for data, 0",
        help="Fraction of the photo's gradients and stains to remove before synthesis. 0: every pixel is a verbatim"
        " copy.",
    )
    drift: bool | Path = param(False, help=DRIFT_HELP, advanced=True)
    sigma: float | None = param(
        None,
        example="32",
        ge=0.5,
        le=1e6,
        unit="px",
        unset=f"longer side / {SIGMA_SHARE}, at least patch / 4",
        help="Scale, in pixels, above which the result is statistically uniform. Smaller structures are kept. Reduce it"
        " if features still repeat visibly.",
    )
    evenness: float | None = param(
        None,
        example="0.5",
        ge=0,
        le=1,
        advanced=True,
        help="Visible uniformity of the result, from 0 (least) to 1 (most), used instead of sigma. Equal steps make"
        " equally visible differences; `sigmas` shows them for a photo.",
    )
    histogram: float | None = param(
        None,
        example="0.3",
        ge=0,
        le=1,
        unset=f"{CONTRAST}",
        advanced=True,
        help="Strength with which the overall colors of the result are matched to the histogram of `target`."
        " Increase it if rare colors are missing. At 0, the colors of rare objects, such as windows in a wall,"
        " may vanish.",
    )
    target: str = param(
        "flat",
        choices=("flat", "exemplar"),
        advanced=True,
        help="Histogram that `histogram` matches. flat: that of the photo after evening out. exemplar: that of the"
        " photo as it is, matched only on the coarsest level, as in the paper.",
    )

    measure: str = param("histogram", choices=MEASURES, help=MEASURE, advanced=True)
    order: int | None = param(None, example="3", ge=2, le=4, unset="2", help=ORDER, advanced=True)
    lattice: float = param(0.5, ge=0, le=1, help=STRUCTURE)
    preset: str | None = param(None, choices=(*PRESETS, None), help=PRESET_HELP)
    paper: bool = param(
        False,
        advanced=True,
        help="Settings of the paper (MJH17), for comparison: flattening=0:target=exemplar:histogram=1:lattice=0,"
        " sigma = longer side / 32, patch=11, no reuse penalties, and the paper's pyramid and iterations.",
    )
    PAPER: ClassVar[dict[str, Any]] = {
        "flattening": 0.0, "target": "exemplar", "histogram": 1.0, "lattice": 0.0, "preset": None,
    }  # fmt: skip

    @property
    def side(self) -> int:
        """Side of a patch, px."""
        return self.patch or (PAPER_PATCH if self.paper else PATCH)

    def compute(self, session: Session) -> dict[str, Any] | tuple[dict[str, Any], ...]:
        """Expand the preset, if any, then synthesize."""
        if self.preset is None:
            return super().compute(session)
        stages = session.stages(_DOMINANT_SHARE if self.preset == CLEAN else 0, 1)
        sigma = self.evenness is None and self.sigmamap is None
        first = next(stages)
        op = filled(self, self.preset, first.resources, first.progress, sigma=sigma)
        return op.compute(next(stages))

    def _strength(self, resources: Resources) -> float:
        """Share of the low-frequency variation to remove."""
        if self.flattening is not None:
            return self.flattening
        color = self.map_kinds[0] == "color"
        if not color:
            return 0.0
        return 0.0 if lens_of(self.exemplar, resources, self.working_space).space is None else 1.0

    def flattened(self, resources: Resources, progress: Progress) -> tuple[Stationarize, dict[str, Part]]:
        """The op on the flattened photo without its stains, and the correction."""
        part, strength = self.exemplar.first, self._strength(resources)
        if strength == 0:
            return self, {"drift": correction_part(None, part)}
        allowed = self._allowed()
        flattening = Flattening(amount=strength)
        flat, drift, stained = resources.remembered(
            ("flattened", id(part), strength, None if allowed is None else hash_of(allowed)),
            lambda: flattening.of(self.flag(), self.exemplar, self.working_space, resources, progress, allowed),
            part,
        )
        mask = self.mask
        if stained is not None and self.leaves_out_stains(resources):
            mask = mask_of(~stained if allowed is None else allowed & ~stained, part)
            keep = spelled(f"to keep it, use {texture_filter('flatten')} first, then flattening=0")
            self.inform("a stain covers %.0f %% of the photo and is not copied; %s", 100 * stained.mean(), keep)
        exemplar = Image((flat, *self.exemplar.parts[1:]), self.exemplar.source)
        return replace(self, exemplar=exemplar, mask=mask, flattening=0.0), {"drift": drift}

    def leaves_out_stains(self, resources: Resources) -> bool:
        """Whether stains of the photo are excluded from the source pixels."""
        return self._strength(resources) == 1

    @property
    def kept_structure(self) -> float:
        """Value of `lattice`."""
        return self.lattice

    @property
    def sized(self) -> bool:
        """True with sigmamap."""
        return self.sigmamap is not None

    def recipe(self, width: int, height: int) -> Recipe:
        """MJH17 with the selected measure."""
        order = order_of(self.measure, self.order)
        # patches cannot restore what a projection removes from small tiles at scales far below a patch
        share = PAPER_SIGMA_SHARE if self.paper else SIGMA_SHARE
        sigma = self.sigma or max(max(width, height) / share, self.side / 4)
        contrast = self.histogram if self.histogram is not None else CONTRAST
        plain = self._recipe(width, height, sigma, contrast, self.target == "flat")
        return replace(plain, measure=self.measure, order=order, complete=not self.paper, literal=self.paper)

    @property
    def finds_losses(self) -> bool:
        """True for a single tile that is synthesized as a whole."""
        return self.variants == 1 and not self.paper

    def controlled(self, recipe: Recipe, seen: ExemplarPixels, resources: Resources, progress: Progress) -> Recipe:
        """The recipe with the sigma that `evenness` stands for (MJH17 section 4.4)."""
        if self.evenness is None:
            return recipe
        if self.sigma is not None:
            raise ParameterError(f"conflicts with sigma={self.sigma:g}", parameter="evenness", value=self.evenness)
        tiles = SigmaTiles(resources.device, seen.values, seen.usable, recipe, resources.budget, seen.why)
        scale = perceived_scale(tiles, DEFAULT_COUNT, progress.advance, scale_folder())
        sigma = scale.sigma_at(self.evenness)
        self.inform("evenness=%g corresponds to sigma=%.2f px", self.evenness, sigma)
        return replace(recipe, sigma=sigma)

    @property
    def judges_itself(self) -> bool:
        """True where no modifier sets sigma or patch."""
        given = self.sigma, self.evenness, self.sigmamap, self.patch
        return not self.paper and all(one is None for one in given)

    def second_choice(self, recipe: Recipe) -> Recipe | None:
        """The recipe of preset=large, which preserves larger structures."""
        if not self.judges_itself:
            return None
        sigma = max(recipe.size) / LARGE_SIGMA_SHARE
        return replace(recipe, sigma=sigma, patch=LARGE_PATCH)

    def sigmas(self, width: int, height: int) -> np.ndarray | None:
        """Values of sigmamap."""
        if self.sigmamap is None:
            return None
        for name, value in (("sigma", self.sigma), ("evenness", self.evenness)):
            if value is not None:
                raise ParameterError("conflicts with sigmamap", parameter=name, value=value)
        return sigmas_of(self.sigmamap, width, height)
