# SPDX-License-Identifier: Apache-2.0
"""--texlabel: what is in a texture, at several scales, found without being told."""

from __future__ import annotations

import json
import logging
import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import OpenImageIO as oiio

from ..cryptomatte import Layer, cryptomatte_part
from ..errors import ParameterError
from ..images import Image, Part
from ..op import Op, Output, Reach, Space
from ..params import image, param
from ..session import Session
from ..temporary import temporary_beside
from ..windows import Window
from ..working import lens_of

if TYPE_CHECKING:
    from ..analysis.labelmaps import LabelLevel, LabelMaps

log = logging.getLogger("oiiotex")

RHO, COUNT, PARENTS = "oiiotex:rho", "oiiotex:labels", "oiiotex:parents"  # attributes of label parts
LARGE = 1 << 20  # bytes of a manifest that should lie beside the image and not in it


@dataclass(frozen=True, kw_only=True)
class Label(Op):
    """Find what an image consists of, and label it at several scales.

    Superpixels that look alike get one label; how many there are follows from the image (LSA16: Lockerman, Sauvage,
    Allegre, Dischler, Dorsey, Rushmeier, Multi-Scale Label-Map Extraction for Texture Synthesis, SIGGRAPH 2016). The
    result has one part per scale: label.1 is the finest, the last one the coarsest, and every label of a level lies
    in one label of the next, its parent. Ids are 1, 2, ... of type uint32; 0 stands only where alpha is 0. Write it
    to EXR or TIFF, which hold them. With keep=1 the photo stays the first part. Attributes of a part say its scale
    (oiiotex:rho, px), how many labels it has (oiiotex:labels) and their parents, in order (oiiotex:parents).
    """

    name: ClassVar[str] = "label"
    reach: ClassVar[Reach] = Reach.GLOBAL
    space: ClassVar[Space] = Space.LAB
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("label.1", "32-bit ids at the finest scale; label.2 and so on follow, then what else is asked for"),
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
    coarsest: bool = param(True, help="label the coarsest scale too; the paper does not")
    neighbours: int = param(256, ge=8, le=4096, help="of a superpixel in the graph, at most")
    tries: int = param(0, ge=0, le=100, help="random starts that are joined with the first (boosting)")
    runs: int = param(1, ge=1, le=1000, help="of SLIC, the best is taken; the paper: 10")
    minsize: int | None = param(
        None, ge=1, unit="px", help="smaller superpixels join a neighbour; sigma^2 / 4 when left out, 25 in the paper"
    )
    seed: int = param(0, ge=0, le=2**32 - 1, help="of random starts; with tries=0 and runs=1 there are none")
    keep: bool = param(False, help="the photo stays the first part, the labels follow it")
    soft: bool = param(False, help="further parts: membership.N (G) and fit.N (F / its largest) of level N")
    cryptomatte: bool | Path = param(
        False, help="1: a further part with Cryptomatte 1.2 of all levels; a file name: its manifest goes there"
    )
    json: Path | None = param(None, help="scales, counts, areas and the tree of labels go to this file")
    data: bool = param(False, help="the channels are no colours: compare them as they are")

    def compute(self, session: Session) -> Image:
        """Label parts, finest first, and what else was asked for."""
        from ..analysis.labelmaps import Settings, label_maps  # scipy is not loaded before it is needed

        for path in (self.json, self.cryptomatte):
            if isinstance(path, Path) and os.path.realpath(path) == os.path.realpath(self.source.source):
                raise ParameterError(f"{path} would overwrite the photo")
        lens = lens_of(self.source, None if self.data else session.color, session.autocc)
        settings = Settings(
            cluster=self.cluster,
            neighbours=self.neighbours,
            persistence=self.persistence,
            share=self.share,
            coarsest=self.coarsest,
            tries=self.tries,
            seed=self.seed,
        )
        maps = label_maps(self.source, lens, session, self.features, settings, runs=self.runs, minsize=self.minsize)
        for n, level in enumerate(maps.levels, 1):
            log.info("%s: label.%d: %d labels at %.1f px", self.flag(), n, level.count, level.scale)
        first, *others = self.source.parts
        labels = [label_part(first, maps, n) for n in range(1, len(maps.levels) + 1)]
        more = [part for n in range(1, len(labels) + 1) for part in soft_parts(first, maps, n)] if self.soft else []
        if self.cryptomatte:
            more.append(self._cryptomatte(labels, maps, session))
        if self.json is not None:
            _write(self.json, summary(maps), session)
        return Image((*((first,) if self.keep else ()), *labels, *more, *others), self.source.source)

    def _cryptomatte(self, labels: list[Part], maps: LabelMaps, session: Session) -> Part:
        layers = [
            Layer(f"label{n}_", part, [f"label.{n}/{i}" for i in range(1, level.count + 1)])
            for n, (part, level) in enumerate(zip(labels, maps.levels, strict=True), 1)
        ]
        beside = self.cryptomatte if isinstance(self.cryptomatte, Path) else None
        part, manifests = cryptomatte_part(layers, beside.name if beside else None)
        if beside is not None:
            _write(beside, {name: bits for found in manifests.values() for name, bits in found.items()}, session)
        elif sum(len(n) + 14 for found in manifests.values() for n in found) > LARGE:
            log.warning("%s: the manifest is large: cryptomatte=FILE.json puts it beside the image", self.flag())

        def of_no_level(spec: oiio.ImageSpec) -> None:
            for name in (RHO, COUNT, PARENTS):
                spec.erase_attribute(name)

        return part.respecced(of_no_level)


def label_part(like: Part, maps: LabelMaps, n: int) -> Part:
    """Level n as a part of uint32 ids."""
    from ..analysis import superpixels

    level = maps.levels[n - 1]
    part = superpixels.label_part(like, maps.superpixels.runs.relabelled(level.labels - 1), f"label.{n}")

    def mark(spec: oiio.ImageSpec) -> None:
        spec.attribute("oiio:subimagename", part.name)
        spec.attribute(RHO, float(level.scale))
        spec.attribute(COUNT, level.count)
        spec.attribute(PARENTS, ",".join(map(str, level.parents.tolist())))

    return part.respecced(mark)


def soft_parts(like: Part, maps: LabelMaps, n: int) -> tuple[Part, Part]:
    """Membership G_ci and fit F_ic / max_j F_jc of level n, one channel per label (LSA16 section 4.2).

    They speak of the labels that the level has by itself, before it is intersected with coarser ones.
    """
    from ..analysis import superpixels

    level = maps.levels[n - 1]
    runs = maps.superpixels.runs.relabelled(level.groups)
    groups = superpixels.label_part(like, runs)
    fit = (level.F / level.F.max(0)).T
    return _soft(groups, f"membership.{n}", level.G), _soft(groups, f"fit.{n}", fit)


def _soft(groups: Part, name: str, values: np.ndarray) -> Part:
    """(r, m) values as a part of r channels; 0 where there is no superpixel."""
    table = np.concatenate([np.zeros((1, len(values))), values.T]).astype(np.float32)

    def change(spec: oiio.ImageSpec) -> None:
        spec.set_format(oiio.FLOAT)
        spec.nchannels = len(values)
        spec.channelnames = tuple(f"c{c}" for c in range(1, len(values) + 1))
        spec.attribute("oiio:subimagename", name)

    def fetch(window: Window) -> np.ndarray:
        return table[groups.read(window)[..., 0]]

    return replace(groups.respecced(change), name=name, fetch=fetch, stored=oiio.TypeDesc(oiio.FLOAT))


def summary(maps: LabelMaps) -> dict[str, Any]:
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


def _write(path: Path, facts: dict[str, Any], session: Session) -> None:
    with temporary_beside(path) as temporary:
        temporary.write_text(json.dumps(facts, indent=1))
    session.written.add(os.path.realpath(path))
