# SPDX-License-Identifier: Apache-2.0
"""--texquilt: a texture of any size from patches of an exemplar, chosen by what they contain."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from ..errors import ImageError, ParameterError
from ..images import Image
from ..op import Op, Output, Reach, Space
from ..params import Size, image, param
from ..session import Session
from ..synthesis.plans import MOST_PATCH, Plan, Renderer
from .guides import meaning_of
from .sewing import LEAST_PATCH, Sewing, sewn_image, sewn_whole
from .sources import LABEL, LABELS, LEVEL, MASK
from .stationarize import refuse_overwriting


@dataclass(frozen=True, kw_only=True)
class Quilting(Op):
    """Sew a texture of any size together from patches of a photo, as a stream.

    Image quilting (Efros & Freeman, SIGGRAPH 2001): square patches on a regular grid, each the one that fits what is
    there best, cut along the line where both look most alike. With label maps (--texlabel:keep=1) a guide says what is
    to be where: patches are looked up by their content, the two most frequent labels in them (LSA16: Lockerman,
    Sauvage, Allegre, Dischler, Dorsey, Rushmeier, Multi-Scale Label-Map Extraction for Texture Synthesis, SIGGRAPH
    2016, section 6.1). Every pixel of the result is a copy of one pixel of the photo, and the result does not depend
    on memory or threads. A plan of offsets and cuts is all that is kept, so memory does not grow with the pixels.
    """

    name: ClassVar[str] = "quilt"
    copies: ClassVar[bool] = True
    reach: ClassVar[Reach] = Reach.CAUSAL
    space: ClassVar[Space] = Space.LAB
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("quilt", "pixels copied from the photo, all channels together, in its own colour space and type"),
        Output(
            "st", "where every pixel comes from: 32-bit float source coordinates, as --texwarp and --st_warp read them"
        ),
    )

    exemplar: Image = image(help="the photo")
    mask: Image | None = image(None, help=MASK)
    labels: Image | None = image(None, help=LABELS)
    guide: Image | None = image(
        None, help="what is to be where: ids of labels, or ids or colours that table gives a meaning; of any size"
    )
    label: int | None = param(None, ge=1, help=LABEL)
    level: int | None = param(None, ge=1, help=f"{LEVEL}; of guides, too")
    table: Path | None = param(
        None, help='JSON: {"255,0,0": 3, "0,0,255": [1, 2]}: which label or key ids or 8-bit colours of the guide mean'
    )
    size: Size | None = param(
        None, ge=1, le=1 << 22, unit="px", help="of the result; the guide's or else the exemplar's when left out"
    )
    tile: str = param("none", choices=("none", "x", "y", "xy"), help="along which axes the result tiles")
    patch: int | None = param(
        None,
        ge=LEAST_PATCH,
        le=MOST_PATCH,
        unit="px",
        help="side of a patch; the label level's scale, or shorter side / 8, as a power of two when left out (less"
        " where a guide's labels are found in too few places)",
    )
    overlap: int | None = param(
        None, ge=4, le=MOST_PATCH // 3, unit="px", help="of neighbours, at most patch / 3; patch / 4 when left out"
    )
    candidates: int = param(256, ge=1, le=65536, help="patches that are tried in a place, at most")
    reuse: float = param(
        2.0, ge=1, le=1e9, help="no region of the exemplar is used more often than this times its fair share"
    )
    finer: float = param(0.5, ge=0, le=100, help="weight of finer levels' labels in the overlaps, beside colour")
    guidance: float = param(1.0, ge=0, le=100, help="weight of the guide's labels inside a patch, beside colour")
    plan: Path | None = param(None, help="the plan goes to this file (.npz): offsets and cuts")
    render: bool = param(
        False, help="make the result from the plan in that file, of the photo or of any map of its size"
    )
    stmap: bool | Path = param(False, help="1: source coordinates as part 'st' of the result; a file name: there")
    keep: bool = param(False, help="label parts of the exemplar follow, made from the same sources")
    seed: int = param(0, ge=0, le=2**32 - 1, help="same seed, same pixels")
    data: bool = param(False, help="the channels are no colours: compare them as they are")

    def compute(self, session: Session) -> Image:
        """The quilt, followed by what else is asked for."""
        refuse_overwriting(self.exemplar, self.stmap, self.plan)
        return self._rendered(session) if self.render else sewn_whole(self, self._sewing(), session)

    def _sewing(self) -> Sewing:
        if self.guide is not None and self.label is not None:
            raise ParameterError("guide and label both say what patches contain: give one of them")
        if self.table is not None and self.guide is None:
            raise ParameterError("table says what a guide means: say guide, too")
        return Sewing.of(self, meaning=lambda there: meaning_of(self.guide.first, self.table, there))

    def _rendered(self, session: Session) -> Image:
        """From a plan."""
        if self.plan is None:
            raise ParameterError("render=1 makes the result from a plan: plan=FILE says which")
        said = self.size, self.mask, self.labels, self.guide, self.label, self.patch, self.overlap
        if any(value is not None for value in said):
            raise ParameterError("render=1 takes everything from the plan; say none of size, patch, mask, label, guide")
        plan, size = Plan.load(self.plan)
        spec = self.exemplar.first.spec
        if size != (spec.width, spec.height):
            raise ImageError(
                f"{self.plan} is of an exemplar of {size[0]}x{size[1]}, {self.exemplar.source} is"
                f" {spec.width}x{spec.height}"
            )
        made = Renderer.of(session.device, plan, size[0], session.budget)
        return sewn_image(self, made.sources, plan.grid, session)
