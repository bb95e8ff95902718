# SPDX-License-Identifier: Apache-2.0
"""--texpaint: a painting of labels becomes a texture, LSA16 section 6.2, figure 15."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import OpenImageIO as oiio

from ..color import working_values
from ..errors import ImageError, ParameterError
from ..images import Image, Part
from ..op import Op, Output, Reach, Space
from ..params import Size, image, param
from ..session import Session
from ..synthesis.layers import TILE, Layers
from ..synthesis.patchmatch import to_grid
from ..synthesis.plans import MOST_PATCH
from ..synthesis.quilting import Quilt
from ..windows import Window
from .guides import Meaning, meaning_of
from .paintings import brushes_of, painted_labels, read_begun, save_painting
from .sewing import Sewing, Sources, sewn_image
from .sources import LABELS, label_parts
from .stationarize import refuse_overwriting

log = logging.getLogger("oiiotex")


@dataclass(frozen=True, kw_only=True)
class Paint(Op):
    """Turn a painting of labels into a texture, at one scale or at two.

    What the painting calls label 3 becomes texture of label 3 of the photo, by guided quilting (--texquilt). A second
    painting, fine, lays labels of the next finer level over it; where it is empty (black, id 0 or alpha 0), the first
    stays (LSA16: Lockerman, Sauvage, Allegre, Dischler, Dorsey, Rushmeier, Multi-Scale Label-Map Extraction for
    Texture Synthesis, SIGGRAPH 2016, section 6.2). table=FILE is what --texpalette wrote: which colour is which
    label; paintings of ids need none. With plan=FILE the next edit begins there: before=FILE keeps every patch whose
    labels did not change, so that pixels elsewhere are the same to the bit.
    """

    name: ClassVar[str] = "paint"
    copies: ClassVar[bool] = True
    reach: ClassVar[Reach] = Reach.CAUSAL
    space: ClassVar[Space] = Space.LAB
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("paint", "pixels copied from the photo, all channels together, in its own colour space and type"),
        Output(
            "st", "where every pixel comes from: 32-bit float source coordinates, as --texwarp and --st_warp read them"
        ),
    )

    exemplar: Image = image(help="the photo, with label maps as --texlabel:keep=1 makes them")
    painting: Image = image(help="ids of labels, or colours that table gives a meaning; of any size")
    fine: Image | None = image(None, help="a painting of labels of the next finer level that is laid over it")
    labels: Image | None = image(None, help=LABELS)
    level: int | None = param(
        None, ge=1, help="which label map is painted: label.N; the table's, else the coarsest, when left out"
    )
    table: Path | None = param(None, help="JSON of --texpalette: which label each colour of the paintings means")
    size: Size | None = param(None, ge=8, le=1 << 22, unit="px", help="of the result; the painting's when left out")
    tile: str = param("none", choices=("none", "x", "y", "xy"), help="along which axes the result tiles")
    patch: int | None = param(None, ge=8, le=MOST_PATCH, unit="px", help="side of a patch, as of --texquilt")
    candidates: int = param(256, ge=1, le=65536, help="patches that are tried in a place, at most")
    reuse: float = param(2.0, ge=1, le=1e9, help="no region is used more often than this times its fair share")
    finer: float = param(0.5, ge=0, le=100, help="weight of finer levels' labels in the overlaps, beside colour")
    guidance: float = param(1.0, ge=0, le=100, help="weight of the painted labels inside a patch, beside colour")
    plan: Path | None = param(None, help="what was painted, and with which patches, goes to this file (.npz)")
    before: Path | None = param(None, help="such a file: what is painted as it was keeps its patches")
    keep: bool = param(False, help="label parts of the exemplar follow, made from the same sources")
    stmap: bool | Path = param(False, help="1: source coordinates as part 'st' of the result; a file name: there")
    seed: int = param(0, ge=0, le=2**32 - 1, help="same seed, same pixels")
    data: bool = param(False, help="the channels are no colours: compare them as they are")

    def compute(self, session: Session) -> Image:
        """The texture, followed by what else is asked for."""
        refuse_overwriting(self.exemplar, stmap=self.stmap, plan=self.plan)
        if self.before is not None and self.fine is None and read_begun(self.before).fine:
            log.info("%s: %s has a fine painting, which is not laid over this one", self.flag(), self.before)
        brushes = brushes_of(self.table)
        parts = label_parts(self.exemplar, self.labels)
        level = self.level or (brushes.level if brushes else None) or max(parts)
        stages = session.stages()
        base = self._sewing(level, self.painting, self.size, brushes.coarse if brushes else None, "").quilt(
            next(stages)
        )
        layers, sources = {"": base}, base.sources
        if self.fine is not None:
            if level - 1 not in parts:
                raise ParameterError(f"fine paints labels of the level below level={level}, which the exemplar has not")
            ids = parts[level - 1].pixels()[..., 0]
            size = Size(base.grid.width, base.grid.height)
            painted = painted_labels(self.fine, brushes.fine if brushes else None, ids, size)
            guide = Image((_overpainted(base, ids, painted),), self.fine.source)
            over = self._sewing(level - 1, guide, size, None, "fine_").quilt(next(stages))
            layers["fine_"], sources = over, self._laid(base, over, painted, session)
        if self.plan is not None:
            save_painting(self.plan, self.exemplar, layers)
            session.written.add(os.path.realpath(self.plan))
        return sewn_image(self, sources, base.grid, session)

    def _sewing(
        self, level: int, guide: Image, size: Size | None, brushes: dict[int, int] | None, prefix: str
    ) -> Sewing:
        """Of one layer: what its colours mean, and what it begins with."""
        begun = None if self.before is None else read_begun(self.before, prefix)
        said: dict[str, Any] = {"guide": guide, "level": level, "size": size, "begun": begun}
        if begun is not None and self.patch is None:  # an edit changes no patch's size
            said |= {"patch": begun.plan.grid.patch, "overlap": begun.plan.grid.overlap}
        return Sewing.of(self, meaning=lambda there: _meaning(guide.first, brushes, there), **said)

    def _laid(self, base: Quilt, over: Quilt, painted: Callable[[Window], np.ndarray], session: Session) -> Sources:
        """The fine layer over the coarse one."""
        working = working_values(self.exemplar, None if self.data else session.color, session.autocc)
        layers = Layers(
            to_grid(working.values, 11), base.sources, lambda w: (painted(w) > 0, over.sources(w)),
            Window(0, 0, base.grid.width, base.grid.height), min(TILE // 4, over.grid.patch // 4),
        )  # fmt: skip
        return lambda window: layers.sources(window, session.cache)


def _meaning(guide: Part, brushes: dict[int, int] | None, there: np.ndarray) -> Meaning:
    """What a painting means of a label map that has the ids `there`: colours by the brushes, ids by themselves."""
    if not (there > 0).any():
        raise ImageError("the label map has no label to paint with")
    if brushes is None or guide.spec.nchannels == 1:
        return meaning_of(guide, None, there)
    codes = np.array(sorted(brushes), np.int64)
    labels = np.array([brushes[int(code)] for code in codes], np.int64)
    missing = sorted(set(labels.tolist()) - set(there.tolist()))
    if missing:
        raise ImageError(f"the table names label {missing[0]}, which the exemplar's label map has not")
    return Meaning(codes, np.stack([labels, labels], 1), np.ones(len(codes), bool), True)


def _overpainted(base: Quilt, ids: np.ndarray, painted: Callable[[Window], np.ndarray]) -> Part:
    """Labels of the finer level: those painted, else those that the coarse layer has brought."""
    spec = oiio.ImageSpec(base.grid.width, base.grid.height, 1, oiio.UINT32)
    spec.channelnames = ("id",)
    flat = ids.ravel()

    def fetch(window: Window) -> np.ndarray:
        chosen = painted(window)
        return np.where(chosen > 0, chosen, flat[base.sources(window)]).astype(np.uint32)[..., None]

    return Part("fine", spec, fetch, spec.format, exact=True)
