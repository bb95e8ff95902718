# SPDX-License-Identifier: Apache-2.0
"""--texsigmas: contact sheet and perceptual scale of the sigmas of --texstationarize (MJH17 section 4.4)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from ..analysis.stationarity.measures import MEASURE, MEASURES, scale_folder
from ..engine.color.lab import InLab, color_to_convert, working_values
from ..engine.color.srgb import srgb_of_lab
from ..engine.core.access import Whole
from ..engine.core.image import Image
from ..engine.core.op import Kind, Output, Plan
from ..engine.core.parameters import image, param
from ..engine.deferred import np
from ..engine.session import Session
from ..engine.session.facts import Facts
from ..surfaces.charts.drawing import Sheet
from ..synthesis.exemplar.exemplar_op import ExemplarPixels
from ..synthesis.exemplar.sigma_scale import Scale, SigmaTiles, perceived_scale, require_tiles, variation
from . import op_named

_COLUMNS = 3  # tiles in a row
_BYTES = 30  # for each pixel of the photo, while it is reduced


def _lines(facts: dict[str, Any]) -> Iterator[str]:
    """The table as printed lines."""
    for name in ("before", "after"):
        yield f"{name}: sigma (px), evenness, step to the next sigma (Lab)"
        for row in facts[name]["table"]:
            step = "" if row["step"] is None else f"{row['step']:9.3f}"
            yield f"{row['sigma']:10.2f}{row['evenness']:8.3f}{step}"
        yield f"{name}: coefficient of variation of the steps {facts[name]['variation']:.3f}"


@dataclass(frozen=True, kw_only=True)
class Sigmas(InLab, Whole):
    """Compare the effect of sigma in `stationarize` on a photo, as a contact sheet with equal visible steps.

    The sheet shows small tiles, each repeated 2 x 2, from the largest sigma (evenness 0) to the smallest (evenness 1).
    The visible effect of sigma depends on the photo: it is measured as the earth mover's distance between the
    histograms of neighboring tiles, and sigmas are spaced to make these steps equal (MJH17: Moritz, James, Haines,
    Ritschel, Weyrich, Texture Stationarization, Eurographics 2017, section 4.4).

    `evenness` of `stationarize` uses the same scale, which is stored in the user's cache. The table of sigmas
    is printed, and written with `facts`. The result is an 8-bit sRGB image for display, not for measurement.
    """

    example: ClassVar[str] = '>>> sheet = filters.sigmas("photo.png", count=4)'
    name: ClassVar[str] = "sigmas"
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("view", Kind.PICTURE, "Contact sheet."),
        Output("facts", Kind.TABLE, "Table of sigmas and their evenness.", asked_by="facts", lines=_lines),
    )

    exemplar: Image = image(help="Photo.")
    count: int = param(9, ge=3, le=32, help="Number of sigmas.")
    measure: str = param("histogram", choices=MEASURES, help=MEASURE, advanced=True)
    facts: Path | None = param(None, example="sigmas.json", help="JSON file for the table.")

    def plan(self, facts: Facts) -> Plan:
        """The stationarization whose sigmas are compared, and the size of its result."""
        spec = self.exemplar.first.spec
        width, height = spec.width, spec.height
        same: dict[str, Any] = {name: getattr(self, name) for name in ("exemplar", "measure")}
        how: Any = op_named("stationarize")(**same)
        facts.require(_BYTES * spec.width * spec.height, f"reading {spec.width}x{spec.height}")
        if facts.device_memory is not None:
            shape = spec.height, spec.width
            require_tiles(facts.device_memory, how.recipe(width, height), shape, facts.budget)
        color_to_convert(self.exemplar, facts, self.working_space)
        return Plan(work=(how, width, height))

    def make(self, plan: Plan, session: Session) -> dict[str, Any]:
        """The sheet, and the table of sigmas."""
        resources, progress = session.resources, session.progress
        how, width, height = plan.work
        with resources.stats.time("read and color"):
            lab, opaque = working_values(self.exemplar, resources, self.working_space)
        pixels = ExemplarPixels(lab, opaque, opaque, "transparent pixels")
        recipe = how.recipe(width, height)
        tiles = SigmaTiles(resources.device, lab, opaque, recipe, resources.budget, pixels.why)
        scale = perceived_scale(tiles, self.count, progress.advance, scale_folder())
        amounts = np.linspace(0, 1, self.count)
        panels = []
        for amount in amounts:
            sigma = scale.sigma_at(float(amount))
            tile = np.tile(tiles.tile(sigma, 0, lambda *_: None), (2, 2, 1))
            shown = tile[..., :3] / 100 if self.data else srgb_of_lab(tile[..., :3].astype(np.float64))
            panels.append((f"evenness {amount:.3g}: sigma {sigma:.3g} px", np.clip(shown, 0, 1)))
        return {"view": Sheet.of_panels(panels, _COLUMNS).image(), "facts": _table(scale)}


def _table(scale: Scale) -> dict[str, Any]:
    """The scale before and after respacing, for `facts`; sigmas descend, amounts ascend."""

    def rows(sigmas: np.ndarray, steps: np.ndarray) -> dict[str, Any]:
        amounts = scale.amounts(sigmas)
        distances = [*map(float, steps[::-1]), None]
        table = [
            {"sigma": float(s), "evenness": float(a), "step": d}
            for s, a, d in zip(sigmas[::-1], amounts[::-1], distances, strict=True)
        ]
        return {"table": table, "variation": variation(steps)}

    return {"before": rows(scale.first_sigmas, scale.first_steps), "after": rows(scale.sigmas, scale.steps)}
