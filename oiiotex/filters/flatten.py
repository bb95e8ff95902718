# SPDX-License-Identifier: Apache-2.0
"""--texflatten: slow drift of light and contrast taken out of a photo of any size."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from typing import ClassVar

from ..color.lab import lens_of
from ..core.access import ScanThenMap
from ..core.image import Image, Part, derived_spec
from ..core.op import Kind, Output, Space
from ..core.parameters import image, param
from ..core.window import Window
from ..deferred import np
from ..session import Session
from ..stationarity.grid_statistics import MARGIN
from ..drift.drift_field import correction, drift_of

log = logging.getLogger("oiiotex")

_CENTRE = (50.0, 0.0, 0.0)  # of Lab; data are scaled to 0 .. 100


@dataclass(frozen=True, kw_only=True)
class Flatten(ScanThenMap):
    """Take slow drift of light, colour and contrast out of an image.

    Local mean and local standard deviation of Lab, seen through a Gaussian of sigma, are brought to those of the whole
    image: what is larger than sigma goes, detail stays. A 16384 x 16384 image needs no more memory than a small one.
    Contrast is at most doubled and at least halved.
    """

    name: ClassVar[str] = "flatten"
    carries: ClassVar[bool] = True
    space: ClassVar[Space] = Space.LAB
    outputs: ClassVar[tuple[Output, ...]] = (
        Output(
            "flat",
            Kind.PIXELS,
            "the image without its drift, in its own colour space and type; the other channels as they were",
        ),
    )

    source: Image = image(help="the image")
    sigma: float | None = param(
        None, ge=1, le=1e6, unit="px", help="scale above which drift is taken out; longer side / 16 when left out"
    )
    amount: float = param(1.0, ge=0, le=1, help="how much of the drift is taken out")
    contrast: float = param(1.0, ge=0, le=1, help="how far local contrast is evened out too; 0: it stays")
    tile: str = param(
        "none", choices=("none", "x", "y", "xy"), help="along which axes the image tiles, so that the result does, too"
    )
    keep: str = param(
        "mean",
        choices=("mean", "none"),
        help="mean: the overall colour stays; none: it becomes middle gray (L 50, a 0, b 0), so that photos compare",
    )
    data: bool = param(False, help="the channels are no colours: flatten them as they are")

    def compute(self, session: Session) -> dict[str, Part]:
        """The first part flattened."""
        part = self.source.first
        lens = lens_of(self.source, session, self.working_space)
        sigma = self.sigma or max(1.0, max(part.spec.width, part.spec.height) / 16)
        drift = drift_of(self.source, lens, sigma, session, wraps=("y" in self.tile, "x" in self.tile))
        spec = derived_spec(part.spec)
        if self.tile != "none":
            spec.attribute("wrapmodes", ",".join("periodic" if axis in self.tile else "black" for axis in "xy"))
        if drift is None or self.amount == 0:  # nothing to see, or nothing to do: not even rounding
            return {"flat": replace(part, spec=spec, levels=())}
        middle = np.array(_CENTRE if lens.space is not None else _CENTRE[:1] * 3)[: lens.count]
        target = drift.overall_mean if self.keep == "mean" else middle
        change = correction(drift, self.amount, self.contrast, target)
        away = np.abs(drift.mean[MARGIN:-MARGIN, MARGIN:-MARGIN] - drift.overall_mean).max((0, 1))
        log.info("%s: local means lay up to %s from the overall one", self.flag(), ", ".join(f"{v:.1f}" for v in away))

        def work(rows: np.ndarray, window: Window) -> np.ndarray:
            values, opaque = lens.values(rows)
            change.apply(values, window)
            return lens.replaced(rows, values, opaque)

        return {"flat": self.mapped(part, work, session, spec)}
