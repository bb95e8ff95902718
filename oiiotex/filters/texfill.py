# SPDX-License-Identifier: Apache-2.0
"""--texfill: a region of a photo filled with texture from the same photo or from another one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

from ..analysis.drift.flattening import DRIFT
from ..engine.core.access import InBands
from ..engine.core.image import Image
from ..engine.core.op import Kind, Output, Plan, Space
from ..engine.core.parameters import Numbers, Parameter, image, param
from ..engine.core.source_map import ST
from ..engine.core.tiling import TILED
from ..engine.core.window import Window
from ..engine.errors import ImageError, ParameterError, modifier, whole_budget
from ..engine.session import Session
from ..engine.session.facts import Facts
from ..engine.session.resources import Resources
from ..synthesis.exemplar.exemplar_op import MaterialOp
from ..synthesis.exemplar.heights import RELEVEL
from ..synthesis.exemplar.patch_synthesis import PATCH_HELP, PATCHES
from ..synthesis.patchmatch.patch_search import RANDOM, SEARCH_HELP, SEARCHES
from ..synthesis.quality.report import REPORT
from ..synthesis.quality.reported_op import Reported

PATCH = 11
_LAB_BYTES = 12  # for each pixel of a map


@dataclass(frozen=True, kw_only=True)
class Fill(Reported, MaterialOp, InBands):
    """Fill a region of a photo with texture from the rest of it, or from another photo.

    PatchMatch finds patches that fit the surroundings, from coarse to fine levels (BSFG09: Barnes, Shechtman,
    Finkelstein, Goldman, PatchMatch, SIGGRAPH 2009; levels as in MJH17). Each filled pixel is a copy of one source
    pixel with all channels. Close to the border, `fade` adjusts its color, so that no step is visible. With `donor`,
    the copies take lighting and color level from the surroundings. Pixels outside the region stay bit-identical,
    except in the zone of `seamzone`.

    If some pixels of the region are already known, for example from the previous frame, paste them into the photo and
    mark only the rest: the fill continues them like all other pixels. To exclude them as a source, use `mask`.
    """

    example: ClassVar[str] = """\
>>> import numpy as np
>>> region = np.tri(96, k=-60)  # the lower left corner
>>> clean = filters.fill("photo.png", region, seed=7)
"""
    name: ClassVar[str] = "fill"
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("fill", Kind.PIXELS, "The photo with the region filled. One image for each of the maps, in order."),
        replace(ST, help="Source coordinates of every pixel; with donor, B is 1 where they refer to that photo."),
        replace(DRIFT, help="Correction of the copied pixels: Lab x gain + offset. Channels as in `flatten`."),
        REPORT,
    )

    exemplar: Image = image(help="Photo; of the maps of a material, the first.")
    region: Image = image(
        help="Image that marks the pixels to replace (first channel above half its range, or a nonzero label id). Not"
        " used with replace or matte. On the stack, it comes after the maps."
    )
    donor: Image | None = image(
        None,
        help="Another photo to fill from, of any size and color space. With kinds, its first parts are the maps.",
    )
    mask: Image | None = image(  # type: ignore[misc]  # as in `ExemplarOp`
        None,
        help="Image that marks the valid source pixels, of the photo or of donor (first channel above half its range,"
        " or a nonzero label id).",
    )
    replace: int | None = param(None, example="3", ge=1, help="Id of a label to replace, from the photo's label maps.")
    matte: str | None = param(
        None,
        example="chair",
        help="Object to replace, from the photo's Cryptomatte: its name, or its id in hexadecimal. Pixels that it"
        " covers partly are also replaced.",
    )
    matchlight: float | None = param(
        None,
        example="0.5",
        ge=0,
        le=1,
        unset="1 with donor, else 0",
        help="Fraction of the difference in lighting and color level that is corrected, including the step at the"
        " border. Set it to 1 for sky or plain walls. 0: every pixel is a verbatim copy.",
    )
    drift: bool | Path = param(
        False,
        example="drift.exr",
        advanced=True,
        help="Correction of the copied pixels. 1: append it as part 'drift'; a file name: write it to that file.",
    )
    seamzone: int = param(
        0,
        ge=0,
        le=256,
        unit="px",
        help="Width of a zone around the region in which the fill's border follows a minimum-error seam (KSE03). Pixels"
        " in the zone may be replaced. 0: only the region is replaced.",
    )
    fade: float = param(
        4.0,
        ge=0,
        le=256,
        unit="px",
        help="Width over which the step at the border fades out into the fill. 0: none; without matchlight, every"
        " pixel is then a verbatim copy.",
    )
    tiled: str | None = TILED
    patch: int | None = param(
        None, example="21", choices=(*PATCHES, None), unit="px", unset=str(PATCH), help=PATCH_HELP
    )
    lattice: float = param(
        0.5,
        ge=0,
        le=1,
        advanced=True,
        help="Strength with which the photo's regular repeats (tiles, courses, weaves) are continued. 0: not continued."
        " No effect with donor, or on photos without regular repeats.",
    )
    iterations: int = param(30, ge=1, le=1000, advanced=True, help="Number of iterations on the coarsest level.")
    search: str = param(RANDOM, choices=tuple(SEARCHES), help=SEARCH_HELP, advanced=True)
    relevel: bool = param(False, help=RELEVEL, advanced=True)

    @classmethod
    def taken(cls, values: dict[str, Any]) -> tuple[Parameter, ...]:
        """No region image if a label or a matte names the region."""
        named = values.get("replace") is not None or values.get("matte") is not None
        return tuple(one for one in cls.images() if not (named and one.name == "region"))

    def plan(self, facts: Facts) -> Plan:
        """The measures."""
        from ..synthesis.fill.region import require_region  # not needed for help
        from ..synthesis.fill.region_fill import quality_of

        self._check()
        require_region(self.exemplar, self.region, self.replace, self.labellevel, self.matte)
        return Plan(work=quality_of(self, facts))

    def make(self, plan: Plan, session: Session) -> tuple[dict[str, Any], ...]:
        """The filled photo with its source coordinates, as one mapping for each map."""
        from ..synthesis.fill.region_fill import RegionFill

        with whole_budget(session.resources.budget):  # they are told what is left of it
            return RegionFill(self, session.resources, session.progress, plan.work).results()

    def _check(self) -> None:
        """Refuse conflicting modifiers."""
        if self.replace is not None and self.matte is not None:
            raise ParameterError(f"conflicts with replace={self.replace}", parameter="matte", value=self.matte)
        if self.replace is None and self.label is None and self.labellevel is not None:
            raise ParameterError("requires replace or label", parameter="labellevel", value=self.labellevel)
        if self.relevel and "height" not in self.map_kinds:
            raise ParameterError(f"{modifier(relevel=True)} requires kinds with a height")
        if self.relevel and self.donor is not None:
            raise ParameterError("conflicts with donor", parameter="relevel", value=1)
        self.source_maps()
        self.weights()

    def source_maps(self) -> tuple[Image, ...]:
        """The maps that are filled from."""
        maps = self.all_maps()
        if self.donor is None:
            return maps
        if len(self.donor.parts) < len(maps):
            count = len(self.donor.parts)
            expected = f"at least {len(maps)}, one for each map"
            raise ImageError(f"{self.donor.source} has {count} parts: expected {expected}")
        return tuple(Image((part,), self.donor.source) for part in self.donor.parts[: len(maps)])

    def weights(self) -> Numbers | None:
        """Weights of the maps in the comparison of patches.

        The ranges of data in two photos are not comparable, so with `donor` these maps have no weight.
        """
        data = [kind in ("data", "height") for kind in self.map_kinds]
        if self.donor is None or not any(data):
            return self.mapweights
        if all(data):
            raise ParameterError("donor requires a map of kind color or normal, by which patches are compared")
        if self.mapweights is not None and any(w for w, one in zip(self.mapweights, data, strict=False) if one):
            expected = "0 for data and height maps with donor, because their ranges differ between photos"
            raise ParameterError(parameter="mapweights", value=self.mapweights, expected=expected)
        return self.mapweights or Numbers(0.0 if one else 1.0 for one in data)

    @property
    def strength(self) -> float:
        """Fraction of the difference in light that is corrected: only in color."""
        if self.map_kinds[0] != "color":
            return 0.0
        return self.matchlight if self.matchlight is not None else float(self.donor is not None)

    @property
    def fade_width(self) -> float:
        """Distance in pixels over which the step at the border fades out: only in color."""
        return self.fade if self.map_kinds[0] == "color" and self.first_weight > 0 else 0.0

    @property
    def first_weight(self) -> float:
        """Weight of the first map in the comparison of patches."""
        return 1.0 if self.mapweights is None else self.mapweights[0]

    @property
    def first_space(self) -> Space:
        """The working space of the first map."""
        return Space.LAB if self.map_kinds[0] == "color" else Space.DATA

    @property
    def side(self) -> int:
        """Side of a patch, px."""
        return self.patch or PATCH

    def holds_photo(self, facts: Facts) -> bool:
        """Whether photo and donor are held in memory; otherwise they are read by rows."""
        return self.holds(facts, _LAB_BYTES * len(self.all_maps()))

    def holds(self, facts: Facts, size: int) -> bool:
        """Whether `size` bytes per pixel of the photo and of the donor fit into a quarter of the budget."""
        specs = [one.first.spec for one in (self.exemplar, self.donor) if one is not None]
        return size * sum(spec.width * spec.height for spec in specs) <= facts.budget // 4

    def budget_left(self, resources: Resources, window: Window | None = None) -> int:
        """Bytes of the budget that remain next to what a run holds: maps, masks, and the pixels of a window."""
        both = *self.all_maps(), *(self.source_maps() if self.donor is not None else ())
        specs = [one.first.spec for one in both]
        used = 2 * specs[0].width * specs[0].height  # the region, and the photo's opaque pixels
        if self.holds_photo(resources):
            used += sum(one.first.pixel_bytes * one.first.spec.width * one.first.spec.height for one in both)
            if self.donor is not None:  # the colors of the donor are part of the synthesis
                used += _LAB_BYTES * len(self.all_maps()) * specs[0].width * specs[0].height
        if window is not None:
            used += _LAB_BYTES * len(self.all_maps()) * window.width * window.height
        return resources.budget - used
