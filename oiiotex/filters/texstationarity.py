# SPDX-License-Identifier: Apache-2.0
"""--texstationarity: where a photo is not the same everywhere, and by how much."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ..color.lab import InLab, lens_of
from ..core.access import ScanThenMap
from ..core.image import Image, Part, measure_spec
from ..core.op import Kind, Output
from ..core.parameters import image, param
from ..session import Session
from ..stationarity.grid_statistics import SplineSurface
from ..stationarity.measures import MEASURE, MEASURES, ORDER, cost_text, order_of
from ..stationarity.stationarity_map import deviation_of

COST = "oiiotex:stationarity"  # the attribute that holds the cost of the whole image


@dataclass(frozen=True, kw_only=True)
class Stationarity(InLab, ScanThenMap):
    """Map how far an image is from looking the same everywhere.

    The value of a pixel is the mean difference between what is seen there through a Gaussian of sigma and what is seen
    elsewhere: 0 where the image is as it is everywhere, high in stains, shadows and odd patches. The difference is the
    earth mover's distance between Lab histograms, or that between histograms of the responses of steerable filters,
    or the squared difference of local moments. Its mean is the stationarity cost of MJH17 (eq. 1), which is logged
    with -v and stored in the attribute oiiotex:stationarity of the result.
    """

    example: ClassVar[str] = """\
>>> deviation = filters.stationarity("photo.png")
>>> worst = deviation.get_pixels().max()  # Lab units
"""
    name: ClassVar[str] = "stationarity"
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("deviation", Kind.MEASURE, "one channel in Lab units (moments: squared), of the image's windows"),
    )

    source: Image = image(help="the image")
    sigma: float | None = param(
        None, ge=1, le=1e6, unit="px", help="scale at which the image is looked at; longer side / 32 when left out"
    )
    measure: str = param("histogram", choices=MEASURES, help=MEASURE)
    order: int | None = param(None, ge=2, le=4, help=ORDER)

    def compute(self, session: Session) -> dict[str, Part]:
        """The map."""
        part = self.source.first
        lens = lens_of(self.source, session.resources, self.working_space)
        sigma = self.sigma or max(1.0, max(part.spec.width, part.spec.height) / 32)
        order = order_of(self.measure, self.order)
        deviation = deviation_of(self.source, lens, sigma, session.resources, session.progress, self.measure, order)
        self.inform("%s at sigma %g px", cost_text(deviation.cost, self.measure, order), sigma)
        spec = measure_spec(part.spec)
        spec.attribute(COST, deviation.cost)
        spec.attribute("oiiotex:sigma", float(sigma))
        surface = SplineSurface(deviation.local[..., None], deviation.cells)
        return {"deviation": Part(part.name, spec, surface.values, ready=True)}
