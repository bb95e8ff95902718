# SPDX-License-Identifier: Apache-2.0
"""--texstationarize: MJH17."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

from ..color.lab import lens_of
from ..core.image import Image, Part
from ..core.op import Output
from ..core.parameters import image, param
from ..deferred import np
from ..drift.flattening import DRIFT, DRIFT_HELP, Flattening, correction_part
from ..errors import ParameterError
from ..exemplar.constraint_images import SIGMAMAP, sigmas_of
from ..exemplar.exemplar_op import ExemplarPixels
from ..exemplar.patch_synthesis import PATCH, PatchSynthesis
from ..exemplar.photo_lattice import STRUCTURE
from ..exemplar.presets import CONTRAST, KEEP_SIGMA_SHARE, LARGE_PATCH, PRESET_HELP, PRESETS, filled
from ..exemplar.sigma_scale import DEFAULT_COUNT, SigmaTiles, perceived_scale
from ..io.disk_cache import hash_of
from ..patchmatch.recipe import Recipe
from ..session import Session
from ..session.progress import Progress
from ..session.resources import Resources
from ..stationarity.measures import MEASURE, MEASURES, ORDER, order_of, scale_folder

SIGMA_SHARE = 8  # of the longer side is sigma: structures up to there are kept
PAPER_SIGMA_SHARE, PAPER_PATCH = 32, 11


@dataclass(frozen=True, kw_only=True)
class Stationarize(PatchSynthesis):
    """Turn a photo into a texture that tiles without visible repetition.

    Gradients of light and stains repeat visibly when a photo is tiled. They are removed first (`flatten`), as by
    `flatten`. Then the photo is resynthesized from its own patches, while local histograms, or another measure, are
    kept uniform above a scale sigma (MJH17: Moritz, James, Haines, Ritschel, Weyrich, Texture Stationarization,
    Eurographics 2017). Every pixel of the result is a copy of one pixel of the photo, all its channels together; where
    drift is removed, the copy is corrected by a gain and an offset in Lab that vary slowly, but for the rims of stains.
    With `relevel`, heights are copies plus a constant for each copied piece.
    """

    name: ClassVar[str] = "stationarize"
    outputs: ClassVar[tuple[Output, ...]] = (*PatchSynthesis.outputs, DRIFT)

    sigmamap: Image | None = image(None, help=SIGMAMAP)
    flatten: float | None = param(
        None,
        ge=0,
        le=1,
        help="Share of the photo's gradients and stains that is removed before synthesis, as by `flatten`. 0: every"
        " pixel is a verbatim copy. Default: 1; 0 with inpaint and for data.",
    )
    drift: bool | Path = param(False, help=DRIFT_HELP)
    sigma: float | None = param(
        None,
        ge=0.5,
        le=1e6,
        unit="px",
        help=f"Scale in pixels above which the result is statistically uniform; structures below it are kept. Default:"
        f" longer side / {SIGMA_SHARE}, with inpaint / {PAPER_SIGMA_SHARE}, at least patch / 4.",
    )
    amount: float | None = param(
        None,
        ge=0,
        le=1,
        help="instead of sigma: how stationary it shall look, in even steps that hang on the photo (see `sigmas`)",
    )
    contrast: float | None = param(
        None,
        ge=0,
        le=1,
        help="How strongly the overall histogram is held to that of target. 0: colors of rare objects, such as windows"
        f" in a wall, may vanish. Default: {CONTRAST}; 0 with inpaint.",
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
    paper: bool = param(
        False,
        help="MJH17 by the letter: flatten=0:target=exemplar:contrast=1:structure=0, sigma longer side / 32, patch=11,"
        " a pyramid that starts at a quarter of the tile, 3 iterations on each finer level, no reuse penalties, no"
        " overshoot. Where the paper gives no number (alpha, uniformity) it is ours. Default: 0.",
    )
    PAPER: ClassVar[dict[str, Any]] = {
        "flatten": 0.0, "target": "exemplar", "contrast": 1.0, "structure": 0.0, "preset": None,
    }  # fmt: skip

    @property
    def side(self) -> int:
        """Of a patch, px."""
        return self.patch or (PAPER_PATCH if self.paper else PATCH)

    def compute(self, session: Session) -> dict[str, Any] | tuple[dict[str, Any], ...]:
        """As all of its kind; a preset first becomes what it stands for."""
        if self.preset is None:
            return super().compute(session)
        stages = session.stages()
        sigma = self.amount is None and self.sigmamap is None
        first = next(stages)
        op = filled(self, self.preset, first.resources, first.progress, sigma=sigma)
        return op.compute(next(stages))

    def _strength(self, resources: Resources) -> float:
        """Share of the drift that is removed."""
        if self.flatten is not None:
            return self.flatten
        color = self.map_kinds[0] == "color"
        if not color or self.inpaint is not None:
            return 0.0
        return 0.0 if lens_of(self.exemplar, resources, self.working_space).space is None else 1.0

    def flattened(self, resources: Resources, progress: Progress) -> tuple[Stationarize, dict[str, Part]]:
        """The same with a photo whose drift is removed, and the correction."""
        part, strength = self.exemplar.first, self._strength(resources)
        if strength == 0:
            return self, {"drift": correction_part(None, part)}
        allowed = self._allowed()
        flattening = Flattening(amount=strength)
        flat, drift = resources.remembered(
            ("flattened", id(part), strength, None if allowed is None else hash_of(allowed)),
            lambda: flattening.of(self.flag(), self.exemplar, self.working_space, resources, progress, allowed),
            part,
        )
        exemplar = Image((flat, *self.exemplar.parts[1:]), self.exemplar.source)
        return replace(self, exemplar=exemplar, flatten=0.0), {"drift": drift}

    @property
    def kept_structure(self) -> float:
        """As the user says."""
        return self.structure

    @property
    def sized(self) -> bool:
        """With within or sigmamap."""
        return self.inpaint is not None or self.sigmamap is not None

    def recipe(self, width: int, height: int) -> Recipe:
        """MJH17 by the measure that was asked for."""
        order = order_of(self.measure, self.order)
        # far below the size of a patch a projection takes from small tiles what no patch can give back
        # what is resynthesized within a photo must go with its surroundings, drift and all
        share = PAPER_SIGMA_SHARE if self.paper or self.inpaint is not None else SIGMA_SHARE
        sigma = self.sigma or max(max(width, height) / share, self.side / 4)
        contrast = self.contrast if self.contrast is not None else CONTRAST if self.inpaint is None else 0.0
        plain = self._recipe(width, height, sigma, contrast, self.target == "flat")
        # what is made anew within a photo goes with its surroundings, be they flat
        complete = self.inpaint is None and not self.paper
        return replace(plain, measure=self.measure, order=order, complete=complete, literal=self.paper)

    @property
    def finds_losses(self) -> bool:
        """Of one whole tile."""
        return self.inpaint is None and self.variants == 1 and not self.paper

    def controlled(self, recipe: Recipe, seen: ExemplarPixels, resources: Resources, progress: Progress) -> Recipe:
        """With the sigma of `amount` (MJH17 section 4.4)."""
        if self.amount is None:
            return recipe
        if self.sigma is not None:
            raise ParameterError(f"amount={self.amount:g}: sigma={self.sigma:g} says it already")
        tiles = SigmaTiles(resources.device, seen.values, seen.usable, recipe, resources.budget, seen.why)
        scale = perceived_scale(tiles, DEFAULT_COUNT, progress.advance, scale_folder())
        sigma = scale.sigma_at(self.amount)
        self.inform("amount %g is sigma %.2f px", self.amount, sigma)
        return replace(recipe, sigma=sigma)

    @property
    def judges_itself(self) -> bool:
        """Where neither sigma nor patch is given, by whatever modifier."""
        given = self.sigma, self.amount, self.sigmamap, self.patch
        return not self.paper and all(one is None for one in given)

    def second_choice(self, recipe: Recipe) -> Recipe | None:
        """Larger structures are kept whole, as by preset=keep."""
        if not self.judges_itself:
            return None
        sigma = max(recipe.size) / KEEP_SIGMA_SHARE
        return replace(recipe, sigma=sigma, patch=LARGE_PATCH)

    def sigmas(self, width: int, height: int) -> np.ndarray | None:
        """From sigmamap."""
        if self.sigmamap is None:
            return None
        for name, value in (("sigma", self.sigma), ("amount", self.amount)):
            if value is not None:
                raise ParameterError(f"{name}={value:g}: sigmamap says it already")
        return sigmas_of(self.sigmamap, width, height)
