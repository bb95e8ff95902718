# SPDX-License-Identifier: Apache-2.0
"""--texstationarity: map of deviations from stationarity (MJH17 eq. 1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ..analysis.stationarity.grid_statistics import SplineSurface
from ..analysis.stationarity.measures import MEASURE, MEASURES, cost_text, statistics_of
from ..analysis.stationarity.stationarity_map import deviation_of
from ..engine.color.lab import InLab, color_to_convert, lens_of
from ..engine.core.access import ScanThenMap
from ..engine.core.image import Image, Part, measure_spec
from ..engine.core.op import Kind, Output, Plan
from ..engine.core.parameters import image, param
from ..engine.session import Session
from ..engine.session.facts import Facts

COST = "oiiotex:stationarity"  # the attribute that holds the cost of the whole image


@dataclass(frozen=True, kw_only=True)
class Stationarity(InLab, ScanThenMap):
    """Map the stationarity of an image: how much each place differs statistically from the rest.

    The value of a pixel is the mean difference between local statistics there, in a Gaussian window of scale sigma, and
    those elsewhere: near 0 in typical areas, high in stains, shadows and unusual patches. Depending on `measure`, the
    difference is the earth mover's distance between Lab histograms or between histograms of steerable filter responses,
    or the squared difference of local moments.

    The mean of the map is the stationarity cost of MJH17, eq. 1 (Moritz, James, Haines, Ritschel, Weyrich, Texture
    Stationarization, Eurographics 2017). It is logged with -v and stored in the attribute oiiotex:stationarity of
    the result.
    """

    example: ClassVar[str] = """\
>>> deviation = filters.stationarity("photo.png")
>>> worst = deviation.get_pixels().max()  # Lab units
"""
    name: ClassVar[str] = "stationarity"
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("deviation", Kind.MEASURE, "One channel in Lab units (for moments, squared), in the image's windows."),
    )

    source: Image = image(help="Image to measure.")
    sigma: float | None = param(
        None, example="32", ge=1, le=1e6, unit="px", unset="longer side / 32", help="Scale of the local statistics."
    )
    measure: str = param("histogram", choices=MEASURES, help=MEASURE)

    def plan(self, facts: Facts) -> Plan:
        """Nothing but the declared output."""
        color_to_convert(self.source, facts, self.working_space)
        return Plan()

    def make(self, plan: Plan, session: Session) -> dict[str, Part]:
        """The deviation map."""
        part = self.source.first
        lens = lens_of(self.source, session.resources, self.working_space)
        sigma = self.sigma or max(1.0, max(part.spec.width, part.spec.height) / 32)
        measure, order = statistics_of(self.measure)
        deviation = deviation_of(self.source, lens, sigma, session.resources, session.progress, measure, order)
        self.inform("%s at sigma %g px", cost_text(deviation.cost, measure, order), sigma)
        spec = measure_spec(part.spec)
        spec.attribute(COST, deviation.cost)
        spec.attribute("oiiotex:sigma", float(sigma))
        surface = SplineSurface(deviation.local[..., None], deviation.cells)
        return {"deviation": Part(part.name, spec, surface.values, ready=True)}
