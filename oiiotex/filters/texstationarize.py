# SPDX-License-Identifier: Apache-2.0
"""--texstationarize: texture stationarization (MJH17)."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

from ..analysis.drift.flattening import DRIFT, DRIFT_HELP
from ..analysis.stationarity.measures import MEASURE, MEASURES, statistics_of
from ..engine.color.lab import color_to_convert, working_values
from ..engine.core.image import Image, Part
from ..engine.core.op import Output, Plan
from ..engine.core.parameters import Numbers, image, param
from ..engine.errors import ParameterError, spelled, texture_filter, whole_budget
from ..engine.session import Session
from ..engine.session.facts import Facts
from ..engine.session.resources import Resources
from ..synthesis.exemplar.constraint_images import SIGMAMAP, WEIGHT
from ..synthesis.exemplar.heights import RELEVEL
from ..synthesis.exemplar.patch_synthesis import PATCH, TILE_COUNTS, PatchSynthesis, SynthesisPlan
from ..synthesis.exemplar.photo_lattice import STRUCTURE
from ..synthesis.exemplar.presets import (
    CLEAN,
    CONTRAST,
    LAYOUT,
    PAPER_SIGMA_SHARE,
    PRESET_HELP,
    PRESETS,
    SIGMA_SHARE,
    filled,
    masked,
)
from ..synthesis.layout.limits import require_layout
from ..synthesis.patchmatch.patch_search import RANDOM, SEARCH_HELP, SEARCHES
from ..synthesis.patchmatch.recipe import PAPER_PATCH, Recipe
from ..synthesis.quality.fidelity import FAIR

log = logging.getLogger("oiiotex")

_DOMINANT_SHARE = 1  # time for the mask of preset=clean, relative to the synthesis


@dataclass(frozen=True, kw_only=True)
class Stationarize(PatchSynthesis):
    """Create a seamlessly tiling texture from a photo, without visible repetition.

    Gradients of light and stains repeat visibly when a photo is tiled, so `flattening` removes them first. A knot, a
    chip of paint or a leaf that looks like nothing else in the photo is not copied, unless a mask or label says what to
    copy. The photo is then resynthesized from its own patches while local statistics (by default histograms) are kept
    uniform above a scale sigma (MJH17: Moritz, James, Haines, Ritschel, Weyrich, Texture Stationarization, Eurographics
    2017).

    Every pixel of the result is a copy of one pixel of the photo, with all its channels. Where low-frequency variation
    was removed, or levels were evened at the seams of a kept layout, a gain and an offset in Lab are applied to the
    copy. `drift` holds both; with `flattening=0` there are none. With `relevel`, a constant is also added to each
    copied piece of a height map.
    """

    example: ClassVar[str] = """\
>>> tile = filters.stationarize("photo.png", preset="large", seed=7)
>>> tile.write("tile.png")
True
"""
    name: ClassVar[str] = "stationarize"
    outputs: ClassVar[tuple[Output, ...]] = (*PatchSynthesis.outputs, DRIFT)

    weightmap: Image | None = image(None, help=WEIGHT, advanced=True)  # type: ignore[misc]  # the base class has none
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
        help="Strength with which the overall colors of the result are matched to those of the photo after evening out."
        " Increase it if rare colors are missing. At 0, the colors of rare objects, such as windows in a wall,"
        " may vanish.",
    )
    equaluse: float = param(  # type: ignore[misc]  # the base class has none
        0.01,
        ge=0,
        le=1,
        advanced=True,
        help="Strength with which all parts of the photo are used equally often (MJH17 eq. 6). Increase it to use"
        " more of the photo. Above 0.1, structures break up.",
    )
    measure: str = param("histogram", choices=MEASURES, help=MEASURE, advanced=True)
    lattice: float = param(0.5, ge=0, le=1, help=STRUCTURE)
    search: str = param(  # type: ignore[misc]  # the base class has none
        RANDOM, choices=tuple(SEARCHES), help=SEARCH_HELP, advanced=True
    )
    relevel: bool = param(False, help=RELEVEL, advanced=True)  # type: ignore[misc]  # the base class has none
    pack: str | None = param(  # type: ignore[misc]  # the base class has none
        None,
        choices=("atlas", None),
        unset="one image for each tile",
        help="Arrangement of the tiles. atlas: one image in which neighbors share an edge, also across its borders, so"
        f" that renderers can filter it without padding. Requires variants={TILE_COUNTS}.",
    )
    resume: bool = param(  # type: ignore[misc]  # the base class has none
        False,
        advanced=True,
        help="Save a checkpoint after each pyramid level next to the output, in the folder OUTPUT.parts. Run the"
        " same command again to resume.",
    )

    preset: str | None = param(None, choices=(*PRESETS, None), help=PRESET_HELP)
    paper: bool = param(
        False,
        advanced=True,
        help="Settings of the paper (MJH17), for comparison: flattening=0:histogram=1:lattice=0,"
        " sigma = longer side / 32, patch=11, the histogram of the photo as it is, no reuse penalties, and the paper's"
        " pyramid and iterations.",
    )
    PAPER: ClassVar[dict[str, Any]] = {"flattening": 0.0, "histogram": 1.0, "lattice": 0.0, "preset": None}

    @property
    def side(self) -> int:
        """Side of a patch, px."""
        return self.patch or (PAPER_PATCH if self.paper else PATCH)

    def plan(self, facts: Facts) -> Plan:
        """The synthesis, with values for a preset."""
        self._check()
        op, preset = (self, "") if self.preset is None else (filled(self, self.preset), self.preset)
        scales = self.sigma, self.evenness, self.sigmamap, self.patch
        judged = preset == "" and not self.paper and all(one is None for one in scales)
        with whole_budget(facts.budget):
            if preset == LAYOUT:
                require_layout(self.exemplar.first.spec, facts)
            return op._planned(
                facts,
                finds_losses=self.variants == 1 and not self.paper,
                lattice=self.lattice,
                flattening=self._strength(facts),
                sigmamap=self.sigmamap,
                evenness=self.evenness,
                judged=judged,
                preset=preset,
                dominant=preset == CLEAN and self.mask is None,
                layout=preset == LAYOUT,
            )

    def _check(self) -> None:
        super()._check()
        if self.sigmamap is not None:
            for name, value in (("sigma", self.sigma), ("evenness", self.evenness)):
                if value is not None:
                    raise ParameterError("conflicts with sigmamap", parameter=name, value=value)
        if self.evenness is not None and self.sigma is not None:
            raise ParameterError(f"conflicts with sigma={self.sigma:g}", parameter="evenness", value=self.evenness)
        if self.preset == LAYOUT:
            self._check_layout()

    def _check_layout(self) -> None:
        """Refuse modifiers that have no meaning for a kept layout."""
        why = f"conflicts with preset={LAYOUT}, which does not resynthesize the photo"
        for name in ("sigma", "evenness", "sigmamap", "weightmap"):
            value = getattr(self, name)
            if value is not None:
                raise ParameterError(why, parameter=name, value=value.source if isinstance(value, Image) else value)
        if self.variants > 1:
            raise ParameterError(why, parameter="variants", value=self.variants)

    def make(self, plan: Plan, session: Session) -> dict[str, Any] | tuple[dict[str, Any], ...]:
        """The tile; the mask of preset=clean is made first."""
        from ..synthesis.exemplar.synthesis_run import synthesized  # not needed for help

        how: SynthesisPlan = plan.work
        if how.preset and not how.layout:
            masking, session = session.stages(_DOMINANT_SHARE if how.dominant else 0, 1)
            op = masked(how, self, masking.resources, masking.progress)
            how = replace(how, op=op, quality=replace(how.quality, op=op))  # the report names the mask
        made = synthesized(how, session.resources, session.progress)
        if how.judged and not isinstance(made, tuple):
            self._say_if_oblique(made["tile"], how, session.resources)
        return made

    def _say_if_oblique(self, tile: Part, plan: SynthesisPlan, resources: Resources) -> None:
        """Name --texrectify if it can straighten the photo; as a warning if the tile is poor."""
        from ..surfaces.capture.front_rectangle import front_rectangle, search_bytes  # rarely needed

        fidelity = float(tile.spec.get_string_attribute("oiiotex:fidelity", "1"))
        level = logging.WARNING if fidelity < FAIR else logging.INFO
        spec = self.exemplar.first.spec
        if not log.isEnabledFor(level) or resources.budget < search_bytes(spec.width, spec.height):
            return
        with resources.stats.time("perspective"):
            photo = working_values(self.exemplar, resources, self.working_space, plan.in_memory)
            found = front_rectangle(*photo, oblique=True)
        if found is None or found.plane is None:
            return
        size = "" if found.size is None else f":size={found.size[0]}x{found.size[1]}"
        line = f"{spelled(texture_filter('rectify'))}:corners={Numbers(found.in_display(spec).ravel())}{size}"
        text = "%s: the photo is oblique: the nearest elements are %.1f times as large as the farthest, which explains"
        text += " %.0f %% of how the texture varies; straighten it first: %s"
        log.log(level, text, self.flag(), found.plane.ratio, 100 * found.plane.explained, line)

    def _strength(self, facts: Facts) -> float:
        """Share of the low-frequency variation to remove."""
        if self.flattening is not None:
            return self.flattening
        if self.map_kinds[0] != "color":
            return 0.0
        return 0.0 if color_to_convert(self.exemplar, facts, self.working_space) is None else 1.0

    def recipe(self, width: int, height: int) -> Recipe:
        """MJH17 with the selected measure."""
        measure, order = statistics_of(self.measure)
        # patches cannot restore what a projection removes from small tiles at scales far below a patch
        share = PAPER_SIGMA_SHARE if self.paper else SIGMA_SHARE
        sigma = self.sigma or max(max(width, height) / share, self.side / 4)
        contrast = self.histogram if self.histogram is not None else CONTRAST
        plain = self._recipe(width, height, sigma, contrast, not self.paper)
        return replace(plain, measure=measure, order=order, complete=not self.paper, literal=self.paper)
