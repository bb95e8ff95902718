# SPDX-License-Identifier: Apache-2.0
"""--texstationarity: where a photo is not the same everywhere, and by how much."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import OpenImageIO as oiio

from ..analysis.cells import Surface
from ..analysis.deviation import deviation_of
from ..color import TAG
from ..images import Image, derived_spec
from ..op import Op, Output, Reach, Space
from ..params import image, param
from ..session import Session
from ..windows import Window
from ..working import lens_of
from .measures import MEASURE, MEASURES, ORDER, cost_text, order_of

log = logging.getLogger("oiiotex")

COST = "oiiotex:stationarity"  # the attribute that holds the cost of the whole image
_FLOAT = oiio.TypeDesc(oiio.FLOAT)


@dataclass(frozen=True, kw_only=True)
class Stationarity(Op):
    """Map how far an image is from looking the same everywhere.

    The value of a pixel is the mean difference between what is seen there through a Gaussian of sigma and what is seen
    elsewhere: 0 where the image is as it is everywhere, high in stains, shadows and odd patches. The difference is the
    earth mover's distance between Lab histograms, or that between histograms of the responses of steerable filters,
    or the squared difference of local moments. Its mean is the stationarity cost of MJH17 (eq. 1), which is logged
    with -v and stored in the attribute oiiotex:stationarity of the result. It looks at the image once and streams.
    """

    name: ClassVar[str] = "stationarity"
    reach: ClassVar[Reach] = Reach.GLOBAL
    space: ClassVar[Space] = Space.LAB
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("deviation", "one channel of 32-bit floats in Lab units (moments: squared), of the image's windows"),
    )

    source: Image = image(help="the image")
    sigma: float | None = param(
        None, ge=1, le=1e6, unit="px", help="scale at which the image is looked at; longer side / 32 when left out"
    )
    measure: str = param("histogram", choices=MEASURES, help=MEASURE)
    order: int | None = param(None, ge=2, le=4, help=ORDER)
    data: bool = param(False, help="the channels are no colours: compare them as they are")

    def compute(self, session: Session) -> Image:
        """The map alone."""
        part = self.source.first
        lens = lens_of(self.source, None if self.data else session.color, session.autocc)
        sigma = self.sigma or max(1.0, max(part.spec.width, part.spec.height) / 32)
        order = order_of(self.measure, self.order)
        found = deviation_of(self.source, lens, sigma, session, self.measure, order)
        log.info("%s: %s at sigma %g px", self.flag(), cost_text(found.cost, self.measure, order), sigma)
        surface = Surface(found.local[..., None], found.cells)

        spec = derived_spec(part.spec)
        spec.set_format(_FLOAT)
        spec.channelformats = ()
        spec.nchannels, spec.channelnames, spec.alpha_channel, spec.z_channel = 1, ("Y",), -1, -1
        for stale in ("colorInteropID", "oiio:BitsPerSample", "Exif:ColorSpace", "ICCProfile"):
            spec.erase_attribute(stale)
        spec.attribute(TAG, "data")
        spec.attribute(COST, found.cost)
        spec.attribute("oiiotex:sigma", float(sigma))

        def fetch(window: Window) -> np.ndarray:
            return surface.values(window)

        return Image((replace(part, spec=spec, fetch=fetch, stored=_FLOAT, levels=(), ready=True),), self.source.source)
