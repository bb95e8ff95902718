# SPDX-License-Identifier: Apache-2.0
"""--texdecompose: the subtextures of a texture, how many there are being found."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from ..color.lab import InLab, lens_of
from ..core.access import ScanThenMap
from ..core.image import Image
from ..core.op import Kind, Output
from ..core.parameters import image, param
from ..labels.legend import LabelNames
from ..labels.single_part import SINGLE, OnePart
from ..session import Session

if TYPE_CHECKING:
    from ..segmentation.subtextures import DecompositionSettings

WORKING_PIXELS = 1 << 20
CLIQUES_THRESHOLD = 0.76  # of filter bank textons in discs of 48 px
_HAAR_SAMPLES = 1000  # CZF02 section III C: "similar to the typical texture segmentation problems"


@dataclass(frozen=True, kw_only=True)
class Decompose(OnePart, InLab, ScanThenMap):
    """Decompose a texture into the simpler ones that it is a patchwork of.

    Regions compete for pixels by their textons; those that are likelier one texture than two are merged, until none
    are, or as many are left as labels asks for; then the subtextures compete once more. The result is a label map: ids
    from 1 on, 0 where alpha is 0. Images above a megapixel are looked at reduced by a whole factor. group=cliques
    compares places by their texton histograms instead, each with the best match near the other, and groups them by a
    clique partition; `paper` is that way by the letter (CZF02: Caenen, Zalesny, Ferrari, Van Gool, Unsupervised
    Texture Segmentation by Clique Partitioning).
    """

    example: ClassVar[str] = """\
>>> ids = filters.decompose("photo.png")
>>> view = filters.labelview(ids)
"""
    name: ClassVar[str] = "decompose"
    carries: ClassVar[bool] = True
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("photo", Kind.PIXELS, "the photo, before all others", asked_by="keep", of="source"),
        Output("label.1", Kind.IDS, "one channel, of the image's windows: write it to EXR or TIFF"),
        Output("cryptomatte", Kind.CRYPTOMATTE, "the labels", asked_by="cryptomatte"),
        Output("facts", Kind.TABLE, "count, areas and settings", asked_by="json"),
    )

    source: Image = image(help="the image")
    labels: int | None = param(None, ge=1, le=50, help="how many subtextures, at most; found when left out")
    group: str | None = param(
        None, choices=("merging", "cliques"), help="of regions, or of places that are compared; with haar: cliques"
    )
    threshold: float | None = param(
        None,
        ge=0,
        le=1,
        help="probability of two regions to be one texture, or similarity of two places, above which they belong"
        " together; more gives more subtextures",
    )
    radius: float | None = param(
        None,
        ge=1,
        le=512,
        unit="px",
        help="of the disc whose textons describe a place; a quarter of it is what a pixel minds",
    )
    shift: float | None = param(
        None, ge=0, le=512, unit="px", help="cliques: how far from a place its best match may be; 0: plain comparison"
    )
    features: str = param("bank", choices=("bank", "haar"), help="what textons are made of; haar: the paper's")
    bins: int | None = param(None, ge=2, le=64, help="textons; with haar so many of color and so many of detail")
    step: int | None = param(
        None, ge=1, le=512, unit="px", help="cliques: between the places that are compared with all others"
    )
    scales: int = param(1, ge=1, le=5, help="cliques: radii of the second place, half an octave apart")
    search: str = param(
        "grid", choices=("grid", "meanshift"), help="cliques: for the best match; meanshift: the paper's, slow"
    )
    refine: bool = param(True, help="of the cliques, by moves of single places; the paper does not")
    assign: str = param(
        "competition", choices=("competition", "neighbors"), help="of pixels to subtextures; neighbors: the paper's"
    )
    paper: bool = param(
        False,
        help="CZF02 by the letter: features=haar:group=cliques:scales=3:search=meanshift:refine off:assign=neighbors",
    )
    keep: bool = param(False, help="the photo stays the first part, the labels follow it")
    cryptomatte: bool | Path = param(
        False, help="1: a further part with Cryptomatte 1.2; a file name: its manifest goes there"
    )
    names: Path | None = param(None, help=LabelNames.HELP)
    single: bool = param(False, help=SINGLE)
    json: Path | None = param(None, help="count, areas and settings go to this file")

    PAPER: ClassVar[dict[str, Any]] = {
        "features": "haar",
        "group": "cliques",
        "scales": 3,
        "search": "meanshift",
        "refine": False,
        "assign": "neighbors",
    }

    def compute(self, session: Session) -> dict[str, Any]:
        """The label map, and what else can be asked for."""
        resources, progress = session.resources, session.progress
        self.require_single()
        names = None if self.names is None else LabelNames(self.names)
        from ..color.lab_reduced import lab_pixels, reduction  # scipy is not loaded before it is needed
        from ..segmentation.subtextures import decomposed, facts_of, label_map_of, memory_needed

        first = self.source.first
        width, height = first.window.width, first.window.height
        factor = reduction(width, height, WORKING_PIXELS)
        settings = self._settings(-(-width // factor) * -(-height // factor))
        need = memory_needed(-(-width // factor) * -(-height // factor), settings) + width * height // 8
        resources.require(need, f"{self.flag()} of {width}x{height} px", "take a larger step")
        lens = lens_of(self.source, resources, self.working_space)
        pixels = lab_pixels(self.source, lens, resources, factor)
        progress.advance(1, 4)
        split = decomposed(pixels, settings, resources, progress.advance)
        self.inform("%d subtextures, from %d groups of %d", split.count, split.groups, split.samples)
        if self.labels is not None and 0 < split.count < self.labels:
            self.warn("%d subtextures, not %d: no more hold their own", split.count, self.labels)
        labels = label_map_of(first, pixels, split)
        if names is not None:
            (labels,) = names.of([labels])
        progress.advance(4, 4)
        return {
            **({} if self.single else {"label.1": labels.part}),
            "cryptomatte": [labels],
            "facts": lambda: facts_of(labels.part, split, settings, factor),
        }

    def _settings(self, pixels: int) -> DecompositionSettings:
        from ..segmentation.subtextures import DecompositionSettings

        haar = self.features == "haar"
        radius = self.radius or (8.0 if haar else DecompositionSettings.radius)
        shift = self.shift if self.shift is not None else radius if haar else DecompositionSettings.shift
        group = self.group or ("cliques" if haar else DecompositionSettings.group)
        usual = DecompositionSettings.threshold if group == "merging" else 0.95 if haar else CLIQUES_THRESHOLD
        return DecompositionSettings(
            group=group,
            count=self.labels,
            features=self.features,
            bins=self.bins or (8 if haar else DecompositionSettings.bins),
            radius=radius,
            shift=shift,
            scales=self.scales,
            search=self.search,
            threshold=usual if self.threshold is None else self.threshold,
            step=self.step or (math.ceil(math.sqrt(pixels / _HAAR_SAMPLES)) if haar else _step(pixels)),
            refine=self.refine,
            assign=self.assign,
        )


def _step(pixels: int) -> int:
    """Between samples: 16 px, more where there would be many, less in small images."""
    return max(4, min(16, round(math.sqrt(pixels) / 16 / 4) * 4), math.ceil(math.sqrt(pixels / 2500)))
