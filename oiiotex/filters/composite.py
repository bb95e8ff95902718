# SPDX-License-Identifier: Apache-2.0
"""--texcomposite: a non-stationary texture of any size from one photo, LSA16 section 7."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import OpenImageIO as oiio

from ..images import Image, Part, from_pixels
from ..op import Op, Output, Reach, Space
from ..params import Size, image, param
from ..session import Session
from ..synthesis.labelgrowth import cell_side, grow_labels
from ..synthesis.plans import MOST_PATCH
from ..windows import Window
from .label import RHO
from .sewing import Sewing, sewn_whole
from .sources import LABELS, label_part
from .stationarize import refuse_overwriting

log = logging.getLogger("oiiotex")

_HELD = 400  # bytes for every cell of the grown map and every pixel of the found one, about
_FOUND = 24


@dataclass(frozen=True, kw_only=True)
class Composite(Op):
    """Grow what a photo consists of to any size, and fill it with the photo's texture.

    Grows a new label map from the one that --texlabel has found, with its shares and neighbourhoods, and quilts it
    (--texquilt with the grown map as its guide): the automatic synthesis of non-stationary textures that LSA16
    (Lockerman, Sauvage, Allegre, Dischler, Dorsey, Rushmeier, Multi-Scale Label-Map Extraction for Texture Synthesis,
    SIGGRAPH 2016) leaves for the future in section 7. Every pixel of the result is a copy of one pixel of the photo.
    """

    name: ClassVar[str] = "composite"
    copies: ClassVar[bool] = True
    reach: ClassVar[Reach] = Reach.CAUSAL
    space: ClassVar[Space] = Space.LAB
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("composite", "pixels copied from the photo, all channels together, in its own colour space and type"),
        Output(
            "st", "where every pixel comes from: 32-bit float source coordinates, as --texwarp and --st_warp read them"
        ),
        Output("grown", "the label map that was grown: a guide for --texquilt and --texpaint"),
    )

    exemplar: Image = image(help="the photo, with label maps as --texlabel:keep=1 makes them")
    mask: Image | None = image(None, help="where pixels may come from, as of --texquilt")
    labels: Image | None = image(None, help=LABELS)
    level: int | None = param(None, ge=1, help="which label map is grown: label.N; the coarsest when left out")
    size: Size | None = param(
        None, ge=8, le=1 << 22, unit="px", help="of the result; twice the exemplar's when left out"
    )
    tile: str = param("none", choices=("none", "x", "y", "xy"), help="along which axes the result tiles")
    tries: int = param(4, ge=1, le=64, help="label maps that are grown; the nearest to the found one is taken")
    patch: int | None = param(None, ge=8, le=MOST_PATCH, unit="px", help="side of a patch, as of --texquilt")
    candidates: int = param(256, ge=1, le=65536, help="patches that are tried in a place, at most")
    reuse: float = param(2.0, ge=1, le=1e9, help="no region is used more often than this times its fair share")
    finer: float = param(0.5, ge=0, le=100, help="weight of finer levels' labels in the overlaps, beside colour")
    guidance: float = param(1.0, ge=0, le=100, help="weight of the grown labels inside a patch, beside colour")
    plan: Path | None = param(None, help="the plan goes to this file (.npz): --texquilt:render=1 renders it")
    grown: bool = param(False, help="the grown label map follows as part 'grown'")
    keep: bool = param(False, help="label parts of the exemplar follow, made from the same sources")
    stmap: bool | Path = param(False, help="1: source coordinates as part 'st' of the result; a file name: there")
    seed: int = param(0, ge=0, le=2**32 - 1, help="same seed, same pixels")
    data: bool = param(False, help="the channels are no colours: compare them as they are")

    def compute(self, session: Session) -> Image:
        """The composite, followed by what else is asked for."""
        refuse_overwriting(self.exemplar, self.stmap, self.plan)
        spec = self.exemplar.first.spec
        size = self.size or Size(2 * spec.width, 2 * spec.height)
        found = label_part(self.exemplar, self.labels, self.level)
        stages = session.stages()
        grown = self._grown(found, size, next(stages))
        sewing = Sewing.of(self, guide=Image((grown,), "the grown label map"), size=size)
        made = sewn_whole(self, sewing, next(stages))
        return Image((*made.parts, _enlarged(grown, made.first)), made.source) if self.grown else made

    def _grown(self, found: Part, size: Size, session: Session) -> Part:
        """The grown map as a part of ids."""
        side = cell_side(found.spec.get_float_attribute(RHO), found.spec.width, found.spec.height)
        cells = -(-size.width // side) * -(-size.height // side)
        need = _HELD * cells + _FOUND * found.spec.width * found.spec.height
        session.require(need, f"growing a label map for {size.width}x{size.height} in cells of {side} px")
        with session.stats.time("grow"):
            made = grow_labels(
                session.device, found.pixels()[..., 0], side, size, ("x" in self.tile, "y" in self.tile), self.seed,
                session.budget, session.advance, self.tries,
            )  # fmt: skip
        height, width = made.ids.shape
        log.info(
            "%s: %s grown to %d x %d cells of %d px; shares are off by %.1f %%, neighbourhoods by %.1f %%",
            self.flag(), found.name, width, height, side, 100 * made.shares, 100 * made.neighbours,
        )  # fmt: skip
        spec = oiio.ImageSpec(width, height, 1, oiio.UINT32)
        spec.channelnames = ("id",)
        spec.attribute("oiio:ColorSpace", "data")
        spec.attribute("oiio:subimagename", "grown")
        part = from_pixels("grown", np.ascontiguousarray(made.ids[..., None]), spec, spec.format)
        return replace(part, exact=True)


def _enlarged(cells: Part, like: Part) -> Part:
    """A map of cells in the windows of an image: parts of one file have one display window."""
    ids, whole = cells.pixels(), like.window
    spec = whole.apply_to(cells.spec)
    display = Window.display(like.spec)
    spec.full_x, spec.full_y, spec.full_width, spec.full_height = (
        display.left,
        display.top,
        display.width,
        display.height,
    )

    def fetch(window: Window) -> np.ndarray:
        rows, columns = window.inside(whole)
        y = np.arange(rows.start, rows.stop) * len(ids) // whole.height
        x = np.arange(columns.start, columns.stop) * ids.shape[1] // whole.width
        return ids[np.ix_(y, x)]

    return replace(cells, spec=spec, fetch=fetch)
