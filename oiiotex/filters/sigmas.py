# SPDX-License-Identifier: Apache-2.0
"""--texsigmas: what each sigma of --texstationarize looks like, and how much of it is seen (MJH17 section 4.4)."""

from __future__ import annotations

import logging
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import OpenImageIO as oiio

from ..color import TAG, working_values
from ..errors import ParameterError
from ..images import Image, from_pixels
from ..op import Op, Output, Reach, Space
from ..params import Size, image, param
from ..session import Session
from ..synthesis.perception import Palette, Scale, perceived_scale, variation
from .label import write_json
from .labelview import sheet_of, srgb_of
from .measures import MEASURE, MEASURES, ORDER, order_of, scale_folder
from .sources import ruled_out
from .stationarize import Stationarize

log = logging.getLogger("oiiotex")


@dataclass(frozen=True, kw_only=True)
class Sigmas(Op):
    """Show what each sigma of --texstationarize makes of a photo, and find sigmas whose steps look even.

    A contact sheet of n small tiles, from the largest sigma (amount 0) to the smallest (amount 1), laid out 2 x 2. How
    much a tile changes with sigma hangs on the photo: neighbours are compared by the earth mover's distance between
    their histograms, and sigmas are spread anew so that the steps are even (MJH17: Moritz, James, Haines, Ritschel,
    Weyrich, Texture Stationarization, Eurographics 2017, section 4.4). --texstationarize:amount= finds its sigma on the
    same scale, which is kept in the user's cache. The table is printed; json keeps it. The result is an 8-bit sRGB
    image for screens: do not measure it.
    """

    name: ClassVar[str] = "sigmas"
    reach: ClassVar[Reach] = Reach.GLOBAL
    space: ClassVar[Space] = Space.LAB
    outputs: ClassVar[tuple[Output, ...]] = (Output("view", "an 8-bit sRGB picture"),)

    exemplar: Image = image(help="the photo")
    n: int = param(9, ge=3, le=32, help="how many sigmas")
    size: Size | None = param(
        None, ge=5, le=65536, unit="px", help="of the tile they are for; the photo's own when left out"
    )
    measure: str = param("histogram", choices=MEASURES, help=MEASURE)
    order: int | None = param(None, ge=2, le=4, help=ORDER)
    seed: int = param(0, ge=0, le=2**32 - 1, help="same seed, same pixels")
    columns: int = param(3, ge=1, le=32, help="tiles in a row")
    json: Path | None = param(None, help="the table goes to this file")
    data: bool = param(False, help="the channels are no colours: compare them as they are")

    def compute(self, session: Session) -> Image:
        """The sheet."""
        if self.json is not None and os.path.realpath(self.json) == os.path.realpath(self.exemplar.source):
            raise ParameterError(f"json={self.json} would overwrite the photo")
        spec = self.exemplar.first.spec
        width, height = self.size or Size(spec.width, spec.height)
        order_of(self.measure, self.order)
        with session.stats.time("read and colour"):
            working = working_values(self.exemplar, None if self.data else session.color, session.autocc)
        how = Stationarize(exemplar=self.exemplar, measure=self.measure, order=self.order, seed=self.seed)
        palette = Palette(
            session.device, working.values, working.opaque, how.recipe(width, height), session.budget,
            ruled_out(working.opaque, None),
        )  # fmt: skip
        scale = perceived_scale(palette, self.n, session.advance, scale_folder())
        facts = table_of(scale)
        self._say(facts, session)
        if self.json is not None:
            write_json(self.json, facts, session)
        amounts = np.linspace(0, 1, self.n)
        panels = []
        for amount in amounts:
            sigma = scale.sigma_at(float(amount))
            tile = np.tile(palette.tile(sigma, 0, lambda *_: None), (2, 2, 1))
            shown = tile[..., :3] / 100 if self.data else srgb_of(tile[..., :3].astype(np.float64))
            panels.append((f"amount {amount:.3g}: sigma {sigma:.3g} px", np.clip(shown, 0, 1)))
        sheet = sheet_of(panels, self.columns)
        made = oiio.ImageSpec(sheet.shape[1], sheet.shape[0], 3, oiio.UINT8)
        made.attribute(TAG, "srgb_rec709_scene")
        made.attribute("oiio:subimagename", "view")
        pixels = np.rint(np.clip(sheet, 0, 1) * 255).astype(np.uint8)
        return Image((from_pixels("view", pixels, made, made.format),), self.exemplar.source)

    def _say(self, facts: dict[str, Any], session: Session) -> None:
        """Print the table."""
        if session.say is None:
            return
        for name in ("before", "after"):
            found = facts[name]
            session.say(f"{name}: sigma px, amount, step to the next in Lab")
            for row in found["table"]:
                step = "" if row["step"] is None else f"{row['step']:9.3f}"
                session.say(f"{row['sigma']:10.2f}{row['amount']:8.3f}{step}")
            session.say(f"{name}: coefficient of variation of the steps {found['variation']:.3f}")


def table_of(scale: Scale) -> dict[str, Any]:
    """The scale before and after its sigmas were spread, for `json`; sigmas fall, amounts rise."""

    def rows(sigmas: np.ndarray, steps: np.ndarray) -> dict[str, Any]:
        amounts = scale.amounts(sigmas)
        found = [*map(float, steps[::-1]), None]
        table = [
            {"sigma": float(s), "amount": float(a), "step": d}
            for s, a, d in zip(sigmas[::-1], amounts[::-1], found, strict=True)
        ]
        return {"table": table, "variation": variation(steps)}

    return {
        "before": rows(scale.first_sigmas, scale.first_steps),
        "after": rows(scale.sigmas, scale.steps),
    }
