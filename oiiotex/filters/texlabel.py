# SPDX-License-Identifier: Apache-2.0
"""--texlabel: unsupervised label maps of a texture at several scales."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from ..analysis.labels.legend import LabelNames
from ..analysis.labels.single_part import SINGLE, OnePart
from ..analysis.superpixels.superpixels import compactness_param
from ..engine.color.lab import InLab, color_to_convert, lens_of
from ..engine.core.access import ScanThenMap
from ..engine.core.image import Image, Part
from ..engine.core.label_map import LabelMap
from ..engine.core.op import Kind, Output, Plan
from ..engine.core.parameters import image, param
from ..engine.core.window import Window
from ..engine.deferred import np, oiio
from ..engine.session import Session
from ..engine.session.facts import Facts

if TYPE_CHECKING:
    from ..analysis.labels.scales import LabelLevel, LabelMaps


@dataclass(frozen=True, kw_only=True)
class Label(OnePart, InLab, ScanThenMap):
    """Segment an image into labels at several scales, without training.

    Similar superpixels get the same label, and the image determines the number of labels (LSA16: Lockerman, Sauvage,
    Allegre, Dischler, Dorsey, Rushmeier, Multi-Scale Label-Map Extraction for Texture Synthesis, SIGGRAPH 2016). The
    result has a part for each scale, from label.1, the finest, to the coarsest. Each label of a level lies within
    labels of the next level, its parents: a pattern such as joints can run through several. Ids are 1, 2, ... of type
    uint32, and 0 only where alpha is 0: write them to EXR or TIFF. With `photo` the photo is the first part. Attributes
    of a part record its scale in px (oiiotex:rho), its number of labels (oiiotex:labels) and their parents in order
    (oiiotex:parents: a comma between labels, a space between the parents of one, the main parent first).
    """

    example: ClassVar[str] = """\
>>> levels = filters.label("photo.png")
>>> list(levels)[0]
'label.1'
"""
    name: ClassVar[str] = "label"
    carries: ClassVar[bool] = True
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("photo", Kind.PIXELS, "Photo, as the first part.", asked_by="photo", of="source"),
        Output("label.N", Kind.IDS, "Label map at level N; 1 is the finest."),
        Output(
            "membership.N", Kind.MEASURE, "Membership G at level N, a channel for each label.", asked_by="membership"
        ),
        Output("fit.N", Kind.MEASURE, "Fit F / max F at level N, a channel for each label.", asked_by="membership"),
        Output("cryptomatte", Kind.CRYPTOMATTE, "All levels as Cryptomatte.", asked_by="cryptomatte"),
        Output("facts", Kind.TABLE, "Scales, number and areas of labels, and their parents.", asked_by="facts"),
    )

    source: Image = image(help="Image to segment.")
    persistence: float = param(
        0.95,
        ge=0.01,
        le=0.999,
        help="Persistence of the random walk over superpixels (LSA16 section 4.4). Reduce it for fewer labels."
        " Level n uses its nth power.",
    )
    coarsest: str = param(
        "subtextures",
        choices=("subtextures", "materials", "none"),
        help="Coarsest level. subtextures: as `decompose` finds them. materials: above these, up to four materials,"
        " such as stone and mortar: superpixels are split by color and texture where these have two separate modes; if"
        " they do not, no level is added. none: no further level, as in the paper.",
    )
    maxlabels: int | None = param(
        None,
        example="5",
        ge=1,
        le=50,
        unset="chosen by the filter",
        help="Maximum number of subtextures in the coarsest level.",
    )
    compactness: float | None = compactness_param(advanced=True)
    paper: bool | str = param(
        False,
        choices=(False, True, "authors"),
        help="Settings of the paper (LSA16): persistence=0.95:coarsest=none:compactness=20, moments as features,"
        " the best of ten SLIC runs, superpixels of at least 25 px, five additional random starts, a level only where"
        " it splits all superpixels of the coarser one, the same persistence at all levels, and labels split wherever a"
        " coarser border crosses them."
        " authors: the program that the authors published, which has at least two levels, and scales up to 30 % of the"
        " longer side instead of 20 % of the shorter one.",
    )
    photo: bool = param(False, help="Keep the photo as the first part, before the labels.")
    membership: bool = param(
        False,
        advanced=True,
        help="Append soft label maps for each level N: membership.N is how much a pixel belongs to each label,"
        " fit.N how typical it is of the label (G and F / max F in LSA16).",
    )
    cryptomatte: bool | Path = param(
        False,
        help="Append Cryptomatte 1.2 of all levels as a part. A file name: also write the manifest to that file.",
    )
    palette: Path | None = param(None, example="labels.json", help=LabelNames.HELP)
    onepart: bool = param(False, advanced=True, help=SINGLE)
    facts: Path | None = param(
        None, example="facts.json", help="File for scales, number and areas of labels, and their parents."
    )

    PAPER: ClassVar[dict[str, Any]] = {"persistence": 0.95, "coarsest": "none", "compactness": 20.0}

    def plan(self, facts: Facts) -> Plan:
        """The names of labels, and the settings."""
        from ..analysis.labels.scales import LabelSettings, require_memory  # scipy is not loaded before it is needed

        self.require_single()
        names = None if self.palette is None else LabelNames(self.palette)
        color_to_convert(self.source, facts, self.working_space)
        settings = LabelSettings(
            persistence=self.persistence,
            share=1.0 if self.paper else LabelSettings.share,
            literal=bool(self.paper),
            authors=self.paper == "authors",
            tries=5 if self.paper else LabelSettings.tries,
        )
        require_memory(self.source, facts, settings)
        return Plan(work=(names, settings))

    def make(self, plan: Plan, session: Session) -> dict[str, Any]:
        """Label parts, finest first, and what other outputs are requested."""
        from ..analysis.labels.scales import label_maps
        from ..analysis.segmentation.subtextures import superpixel_subtextures

        names, settings = plan.work
        lens = lens_of(self.source, session.resources, self.working_space)
        coarsest: list[Callable[..., np.ndarray]] = []
        if self.coarsest != "none":
            coarsest.append(functools.partial(superpixel_subtextures, count=self.maxlabels))
        if self.coarsest == "materials":
            from ..analysis.segmentation.superpixel_materials import superpixel_materials

            coarsest.append(superpixel_materials)
        maps = label_maps(
            self.source, lens, session.resources, session.progress, "moments" if self.paper else "both", settings,
            runs=10 if self.paper else 1, minsize=25 if self.paper else None,
            compactness=self.compactness, coarsest=coarsest,
        )  # fmt: skip
        self.inform("compactness=%g", maps.superpixels.compactness)
        for n, level in enumerate(maps.levels, 1):
            self.inform("label.%d: %d labels at %.1f px", n, level.count, level.scale)
        first, levels = self.source.first, range(1, len(maps.levels) + 1)
        labels = [label_map(first, maps, n) for n in levels]
        if names is not None:
            labels = names.of(labels)
        parts: dict[str, Any] = {}
        if not self.onepart:
            soft = itertools.product(levels, ("membership", "fit"))
            parts = {one.part.name: one.part for one in labels}
            parts |= {f"{name}.{n}": functools.partial(_soft_part, first, maps, n, name) for n, name in soft}
        return parts | {"cryptomatte": labels, "facts": lambda: _facts(maps)}


def label_map(like: Part, maps: LabelMaps, n: int) -> LabelMap:
    """Label map of level n in the image's windows."""
    from ..analysis.superpixels import superpixels

    level = maps.levels[n - 1]
    part = superpixels.label_part(like, maps.superpixels.runs.relabeled(level.labels - 1))
    return LabelMap.of(part, n, level.parents, level.scale)


def _soft_part(like: Part, maps: LabelMaps, n: int, quantity: str) -> Part:
    """Membership G_ci or fit F_ic / max_j F_jc of level n, one channel per label (LSA16 section 4.2).

    With `paper` they apply to the level's labels before these are intersected with coarser labels.
    """
    from ..analysis.superpixels import superpixels

    level = maps.levels[n - 1]
    groups = superpixels.label_part(like, maps.superpixels.runs.relabeled(level.groups))
    values = level.G if quantity == "membership" else (level.F / level.F.max(0)).T
    # (r + 1) x m; 0 where there is no superpixel
    table = np.concatenate([np.zeros((1, len(values))), values.T]).astype(np.float32)

    def change(spec: oiio.ImageSpec) -> None:
        spec.nchannels = len(values)
        spec.channelnames = tuple(f"c{c}" for c in range(1, len(values) + 1))

    def fetch(window: Window) -> np.ndarray:
        return table[groups.read(window)[..., 0]]

    return replace(groups.respecced(change), name=f"{quantity}.{n}", fetch=fetch)


def _facts(maps: LabelMaps) -> dict[str, Any]:
    """Facts about the labels, for `facts`."""
    sizes = maps.superpixels.sizes

    def facts(n: int, level: LabelLevel) -> dict[str, Any]:
        areas = np.bincount(level.labels, sizes, level.count + 1)[1:]
        return {
            "name": f"label.{n}",
            "rho": level.scale,
            "superpixels": len(level.features),
            "labels": [
                {"id": i, "parents": list(parents), "pixels": int(area)}
                for i, (parents, area) in enumerate(zip(level.parents, areas, strict=True), 1)
            ],
        }

    return {"levels": [facts(n, level) for n, level in enumerate(maps.levels, 1)]}
