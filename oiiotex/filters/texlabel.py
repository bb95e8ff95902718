# SPDX-License-Identifier: Apache-2.0
"""--texlabel: what is in a texture, at several scales, found without being told."""

from __future__ import annotations

import functools
import itertools
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from ..color.lab import InLab, lens_of
from ..core.access import ScanThenMap
from ..core.image import Image, Part
from ..core.label_map import LabelMap
from ..core.op import Kind, Output
from ..core.parameters import image, param
from ..core.window import Window
from ..deferred import np, oiio
from ..labels.legend import LabelNames
from ..labels.single_part import SINGLE, OnePart
from ..session import Session

if TYPE_CHECKING:
    from ..labels.scales import LabelLevel, LabelMaps


@dataclass(frozen=True, kw_only=True)
class Label(OnePart, InLab, ScanThenMap):
    """Find what an image consists of, and label it at several scales.

    Superpixels that look alike get one label; how many there are follows from the image (LSA16: Lockerman, Sauvage,
    Allegre, Dischler, Dorsey, Rushmeier, Multi-Scale Label-Map Extraction for Texture Synthesis, SIGGRAPH 2016). The
    result has one part per scale: label.1 is the finest, the last one the coarsest, and every label of a level lies
    in one label of the next, its parent. Ids are 1, 2, ... of type uint32; 0 stands only where alpha is 0. Write it
    to EXR or TIFF, which hold them. With `keep` the photo stays the first part. Attributes of a part say its scale
    (oiiotex:rho, px), how many labels it has (oiiotex:labels) and their parents, in order (oiiotex:parents).
    """

    example: ClassVar[str] = """\
>>> levels = filters.label("photo.png")
>>> list(levels)[0]
'label.1'
"""
    name: ClassVar[str] = "label"
    carries: ClassVar[bool] = True
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("photo", Kind.PIXELS, "the photo, before all others", asked_by="keep", of="source"),
        Output("label.N", Kind.IDS, "at scale N; 1 is the finest"),
        Output("membership.N", Kind.MEASURE, "of level N: G, a channel for every label", asked_by="soft"),
        Output("fit.N", Kind.MEASURE, "of level N: F / its largest, a channel for every label", asked_by="soft"),
        Output("cryptomatte", Kind.CRYPTOMATTE, "all levels", asked_by="cryptomatte"),
        Output("facts", Kind.TABLE, "scales, counts, areas and the tree of labels", asked_by="json"),
    )

    source: Image = image(help="the image")
    features: str = param(
        "textons",
        choices=("textons", "moments", "gabor", "quadtree"),
        help="what superpixels are compared by; moments: the paper's",
    )
    cluster: str = param(
        "nmf",
        choices=("nmf", "kmeans", "spectral"),
        help="how alike ones are gathered; the last two need scikit-learn, and get the count from the first",
    )
    persistence: float = param(
        0.95,
        ge=0.01,
        le=0.999,
        help="how short the random walk is: less gives fewer labels; level n takes its nth power",
    )
    share: float = param(
        0.5, ge=0.01, le=1, help="of the superpixels of the next scale that must hold two labels; the paper: 1"
    )
    coarsest: bool = param(True, help="a coarsest level of subtextures, as `decompose` finds them; not in the paper")
    labels: int | None = param(
        None, ge=1, le=50, help="how many subtextures that level has, at most; found when left out"
    )
    neighbors: int = param(256, ge=8, le=4096, help="of a superpixel in the graph, at most")
    tries: int = param(0, ge=0, le=100, help="random starts that are joined with the first (boosting)")
    runs: int = param(1, ge=1, le=1000, help="of SLIC, the best is taken; the paper: 10")
    minsize: int | None = param(
        None, ge=1, unit="px", help="smaller superpixels join a neighbor; sigma^2 / 4 when left out, 25 in the paper"
    )
    seed: int = param(0, ge=0, le=2**32 - 1, help="of random starts; with tries=0 and runs=1 there are none")
    paper: bool = param(
        False,
        help="LSA16 by the letter: features=moments:persistence=0.95:share=1:coarsest off:neighbors=256:runs=10"
        ":minsize=25, one persistence at all levels, and labels cut wherever a coarser border crosses them",
    )
    keep: bool = param(False, help="the photo stays the first part, the labels follow it")
    soft: bool = param(False, help="further parts: membership.N (G) and fit.N (F / its largest) of level N")
    cryptomatte: bool | Path = param(
        False, help="1: a further part with Cryptomatte 1.2 of all levels; a file name: its manifest goes there"
    )
    names: Path | None = param(None, help=LabelNames.HELP)
    single: bool = param(False, help=SINGLE)
    json: Path | None = param(None, help="scales, counts, areas and the tree of labels go to this file")

    PAPER: ClassVar[dict[str, Any]] = {
        "features": "moments",
        "cluster": "nmf",
        "persistence": 0.95,
        "share": 1.0,
        "coarsest": False,
        "neighbors": 256,
        "runs": 10,
        "minsize": 25,
    }

    def compute(self, session: Session) -> dict[str, Any]:
        """Label parts, finest first, and what else can be asked for."""
        self.require_single()
        names = None if self.names is None else LabelNames(self.names)
        from ..labels.scales import LabelSettings, label_maps  # scipy is not loaded before it is needed
        from ..segmentation.superpixel_subtextures import superpixel_subtextures

        lens = lens_of(self.source, session.resources, self.working_space)
        settings = LabelSettings(
            cluster=self.cluster,
            neighbors=self.neighbors,
            persistence=self.persistence,
            share=self.share,
            literal=self.paper,
            tries=self.tries,
            seed=self.seed,
        )
        subtextures = functools.partial(superpixel_subtextures, count=self.labels)
        maps = label_maps(
            self.source, lens, session.resources, session.progress, self.features, settings,
            runs=self.runs, minsize=self.minsize, coarsest=subtextures if self.coarsest else None,
        )  # fmt: skip
        for n, level in enumerate(maps.levels, 1):
            self.inform("label.%d: %d labels at %.1f px", n, level.count, level.scale)
        first, levels = self.source.first, range(1, len(maps.levels) + 1)
        labels = [label_map(first, maps, n) for n in levels]
        if names is not None:
            labels = names.of(labels)
        parts: dict[str, Any] = {}
        if not self.single:
            soft = itertools.product(levels, ("membership", "fit"))
            parts = {one.part.name: one.part for one in labels}
            parts |= {f"{name}.{n}": functools.partial(_soft_part, first, maps, n, name) for n, name in soft}
        return parts | {"cryptomatte": labels, "facts": lambda: _facts(maps)}


def label_map(like: Part, maps: LabelMaps, n: int) -> LabelMap:
    """Level n in the image's windows."""
    from ..superpixels import superpixels

    level = maps.levels[n - 1]
    part = superpixels.label_part(like, maps.superpixels.runs.relabeled(level.labels - 1))
    return LabelMap.of(part, n, level.parents.tolist(), level.scale)


def _soft_part(like: Part, maps: LabelMaps, n: int, quantity: str) -> Part:
    """Membership G_ci or fit F_ic / max_j F_jc of level n, one channel per label (LSA16 section 4.2).

    They speak of the labels that the level has by itself, before it is intersected with coarser ones.
    """
    from ..superpixels import superpixels

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
    """What there is to say of the labels, for `json`."""
    sizes = maps.superpixels.sizes

    def facts(n: int, level: LabelLevel) -> dict[str, Any]:
        areas = np.bincount(level.labels, sizes, level.count + 1)[1:]
        return {
            "name": f"label.{n}",
            "rho": level.scale,
            "superpixels": len(level.features),
            "labels": [
                {"id": i, "parent": int(parent), "pixels": int(area)}
                for i, (parent, area) in enumerate(zip(level.parents, areas, strict=True), 1)
            ],
        }

    return {"levels": [facts(n, level) for n, level in enumerate(maps.levels, 1)]}
