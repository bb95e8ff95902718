# SPDX-License-Identifier: Apache-2.0
"""--texdecompose: the subtextures of a texture, how many there are being found."""

from __future__ import annotations

import logging
import math
import os
from dataclasses import dataclass
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
from ..tiles import bands
from ..windows import Window
from ..working import lens_of
from .label import COUNT, LARGE, PARENTS, write_json

if TYPE_CHECKING:
    from ..analysis.labpixels import LabPixels
    from ..analysis.subtextures import Decomposition, Settings

log = logging.getLogger("oiiotex")

SAMPLES = "oiiotex:samples"  # attribute: vertices of the clique partition
WORKING_PIXELS = 1 << 20
_PAPER_SAMPLES = 1000  # CZF02 section III C: "similar to the typical texture segmentation problems"


@dataclass(frozen=True, kw_only=True)
class Decompose(Op):
    """Decompose a texture into the simpler ones that it is a patchwork of.

    Places are compared by their texton histograms, each with the best match near the other, so that borders do no
    harm; a clique partition of the comparisons groups them, and how many groups there are follows from one threshold
    (CZF02: Caenen, Zalesny, Ferrari, Van Gool, Unsupervised Texture Segmentation by Clique Partitioning). Then the
    subtextures compete for pixels. The result is a label map: ids from 1 on, 0 where alpha is 0. Images above a
    megapixel are looked at reduced by a whole factor. features=haar:assign=neighbours:refine=0:search=meanshift is
    the paper's own way.
    """

    name: ClassVar[str] = "decompose"
    reach: ClassVar[Reach] = Reach.GLOBAL
    space: ClassVar[Space] = Space.LAB
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("label.1", "one channel of 32-bit ids, of the image's windows: write it to EXR or TIFF"),
    )

    source: Image = image(help="the image")
    threshold: float | None = param(
        None, ge=0, le=1, help="similarity above which two places belong together; more gives more subtextures"
    )
    radius: float | None = param(None, ge=1, le=512, unit="px", help="of the disc whose textons describe its middle")
    shift: float | None = param(
        None, ge=0, le=512, unit="px", help="how far from a place its best match may be; 0: plain comparison"
    )
    features: str = param("bank", choices=("bank", "haar"), help="what textons are made of; haar: the paper's")
    bins: int | None = param(None, ge=2, le=64, help="textons; with haar so many of colour and so many of detail")
    step: int | None = param(None, ge=1, le=512, unit="px", help="between the places that are compared with all others")
    scales: int = param(1, ge=1, le=5, help="radii in which the second place is looked at, half an octave apart")
    search: str = param("grid", choices=("grid", "meanshift"), help="for the best match; meanshift: the paper's, slow")
    refine: bool = param(True, help="of the cliques, by moves of single places; the paper does not")
    assign: str = param(
        "competition", choices=("competition", "neighbours"), help="of pixels to subtextures; neighbours: the paper's"
    )
    keep: bool = param(False, help="the photo stays the first part, the labels follow it")
    cryptomatte: bool | Path = param(
        False, help="1: a further part with Cryptomatte 1.2; a file name: its manifest goes there"
    )
    json: Path | None = param(None, help="count, areas and settings go to this file")
    data: bool = param(False, help="the channels are no colours: compare them as they are")

    def compute(self, session: Session) -> Image:
        """The label map, behind the photo where that is kept, and what else was asked for."""
        from ..analysis.labpixels import lab_pixels, reduction  # scipy is not loaded before it is needed
        from ..analysis.subtextures import decomposed, memory_needed

        for path in (self.json, self.cryptomatte):
            if isinstance(path, Path) and os.path.realpath(path) == os.path.realpath(self.source.source):
                raise ParameterError(f"{path} would overwrite the photo")
        first, *others = self.source.parts
        width, height = first.window.width, first.window.height
        factor = reduction(width, height, WORKING_PIXELS)
        settings = self._settings(-(-width // factor) * -(-height // factor))
        need = memory_needed(-(-width // factor) * -(-height // factor), settings) + width * height // 8
        session.require(need, f"{self.flag()} of {width}x{height} px", "take a larger step")
        lens = lens_of(self.source, None if self.data else session.color, session.autocc)
        pixels = lab_pixels(self.source, lens, session, factor)
        session.advance(1, 4)
        found = decomposed(pixels, settings, session)
        log.info("%s: %d subtextures, from %d cliques of %d places", self.flag(), found.count, found.cliques,
                 found.samples)  # fmt: skip
        labels = label_part(first, pixels, found)
        more = [self._cryptomatte(labels, found.count, session)] if self.cryptomatte else []
        if self.json is not None:
            write_json(self.json, summary(labels, found, settings, factor), session)
        session.advance(4, 4)
        return Image((*((first,) if self.keep else ()), labels, *more, *others), self.source.source)

    def _settings(self, pixels: int) -> Settings:
        from ..analysis.subtextures import Settings

        paper = self.features == "haar"
        radius = self.radius or (8.0 if paper else Settings.radius)
        shift = self.shift if self.shift is not None else radius if paper else Settings.shift
        threshold = self.threshold if self.threshold is not None else 0.95 if paper else Settings.threshold
        return Settings(
            features=self.features,
            bins=self.bins or (8 if paper else Settings.bins),
            radius=radius,
            shift=shift,
            scales=self.scales,
            search=self.search,
            threshold=threshold,
            step=self.step or (math.ceil(math.sqrt(pixels / _PAPER_SAMPLES)) if paper else _step(pixels)),
            refine=self.refine,
            assign=self.assign,
        )

    def _cryptomatte(self, labels: Part, count: int, session: Session) -> Part:
        names = [f"label.1/{i}" for i in range(1, count + 1)]
        beside = self.cryptomatte if isinstance(self.cryptomatte, Path) else None
        part, manifests = cryptomatte_part([Layer("label1_", labels, names)], beside.name if beside else None)
        if beside is not None:
            write_json(beside, {name: bits for found in manifests.values() for name, bits in found.items()}, session)
        elif sum(len(name) + 14 for name in names) > LARGE:
            log.warning("%s: the manifest is large: cryptomatte=FILE.json puts it beside the image", self.flag())
        return part


def _step(pixels: int) -> int:
    """Between samples: 16 px, more where there would be many, less in small images."""
    return max(4, min(16, round(math.sqrt(pixels) / 16 / 4) * 4), math.ceil(math.sqrt(pixels / 2500)))


def label_part(like: Part, pixels: LabPixels, found: Decomposition) -> Part:
    """The label map in the image's windows."""
    from ..analysis.superpixels import label_spec

    spec = label_spec(like.spec)
    spec.attribute("oiio:subimagename", "label.1")
    spec.attribute(COUNT, found.count)
    spec.attribute(PARENTS, ",".join(["0"] * found.count))
    spec.attribute(SAMPLES, found.samples)
    ids = found.labels.astype(np.uint32)

    def fetch(window: Window) -> np.ndarray:
        rows, columns = window.inside(like.window)
        y, x = (np.arange(s.start, s.stop) // pixels.factor for s in (rows, columns))
        here = ids[np.ix_(y, x)]
        opaque = pixels.opaque_rows(rows.start, rows.stop)
        return (here if opaque is None else np.where(opaque[:, columns], here, np.uint32(0)))[..., None]

    return Part("label.1", spec, fetch, oiio.TypeDesc(oiio.UINT32), ready=True, exact=True)


def summary(labels: Part, found: Decomposition, settings: Settings, factor: int) -> dict[str, Any]:
    """What there is to say, for `json`."""
    areas = np.zeros(found.count + 1, np.int64)
    for band in bands(labels):
        areas += np.bincount(labels.read(band).ravel(), minlength=found.count + 1)
    return {
        "labels": [{"id": i, "pixels": int(area)} for i, area in enumerate(areas[1:].tolist(), 1)],
        "reduction": factor,
        "samples": found.samples,
        "cliques": found.cliques,
        "settings": dict(vars(settings)),
    }
