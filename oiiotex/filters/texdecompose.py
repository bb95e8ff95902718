# SPDX-License-Identifier: Apache-2.0
"""--texdecompose: the subtextures of a texture, whose number is found."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from ..analysis.labels.legend import LabelNames
from ..analysis.labels.single_part import SINGLE, OnePart
from ..engine.color.lab import InLab, color_to_convert, lens_of
from ..engine.core.access import ScanThenMap
from ..engine.core.image import Image
from ..engine.core.op import Kind, Output, Plan
from ..engine.core.parameters import image, param
from ..engine.session import Session
from ..engine.session.facts import Facts

if TYPE_CHECKING:
    from ..analysis.segmentation.subtextures import DecompositionSettings

WORKING_PIXELS = 1 << 20
CLIQUES_THRESHOLD = 0.76  # of filter bank textons in discs of 48 px
_HAAR_SAMPLES = 1000  # CZF02 section III C: "similar to the typical texture segmentation problems"


@dataclass(frozen=True, kw_only=True)
class Decompose(OnePart, InLab, ScanThenMap):
    """Segment a texture into the simpler textures that it consists of.

    Use it for mixed photos, such as grass and gravel: it gives few large regions, where `label` gives labels at
    several scales. Regions compete for pixels by their textons (clusters of local features). Pairs of regions that
    are probably one texture are merged until no such pair is left; with `maxlabels`, until that number of regions is
    left. The remaining subtextures then compete once more. The result is a label map with ids from 1, and 0 where
    alpha is 0. Images above a megapixel are analyzed at an integer fraction of their resolution.

    For comparison, group=cliques compares the texton histograms of sampled places, searches near each place for the
    best match, and groups the places by clique partitioning (CZF02: Caenen, Zalesny, Ferrari, Van Gool,
    Unsupervised Texture Segmentation by Clique Partitioning).
    """

    example: ClassVar[str] = """\
>>> ids = filters.decompose("photo.png")
>>> view = filters.labelview(ids)
"""
    name: ClassVar[str] = "decompose"
    carries: ClassVar[bool] = True
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("photo", Kind.PIXELS, "Photo, as the first part.", asked_by="photo", of="source"),
        Output("label.1", Kind.IDS, "Label map: one channel in the image's windows. Write it to EXR or TIFF."),
        Output("cryptomatte", Kind.CRYPTOMATTE, "Labels as Cryptomatte.", asked_by="cryptomatte"),
        Output("facts", Kind.TABLE, "Number and areas of subtextures, and settings.", asked_by="facts"),
    )

    source: Image = image(help="Image to segment.")
    maxlabels: int | None = param(
        None, example="5", ge=1, le=50, unset="chosen by the filter", help="Maximum number of subtextures."
    )
    group: str | None = param(
        None, choices=("merging", "cliques"), unset="merging; with features=haar, cliques", advanced=True,
        help="Grouping method. merging: of regions, recommended. cliques: of places that are compared in pairs"
             " (CZF02).",
    )  # fmt: skip
    threshold: float | None = param(
        None, example="0.5", ge=0, le=1, unset="0.32; with group=cliques, 0.76; with features=haar, 0.95",
        help="Probability, or with group=cliques similarity, above which regions become one texture. Increase it"
             " for more subtextures. Not used if `maxlabels` is set.",
    )  # fmt: skip
    radius: float | None = param(
        None, example="32", ge=1, le=512, unit="px", unset="48; with features=haar, 8",
        help="Radius of the area that is compared as one sample of texture. Increase it for coarse textures.",
    )  # fmt: skip
    shift: float | None = param(
        None, example="16", ge=0, le=512, unit="px", unset="24; with features=haar, the radius", advanced=True,
        help="Search radius for the best match of a place, with group=cliques. 0: no search.",
    )  # fmt: skip
    features: str = param(
        "bank", choices=("bank", "haar"), advanced=True,
        help="Features of the textons. bank: filter bank, recommended. haar: color and Haar wavelets, as in the"
             " paper. haar changes the defaults of other modifiers.",
    )  # fmt: skip
    textons: int | None = param(
        None, example="32", ge=2, le=64, unset="64; with features=haar, 8", advanced=True,
        help="Number of textons; with features=haar, of each kind (color and detail). Increase it to separate"
             " similar textures.",
    )  # fmt: skip
    step: int | None = param(
        None, example="2", ge=1, le=512, unit="px", unset="derived from the size of the image", advanced=True,
        help="Spacing of the places that are compared, with group=cliques.",
    )  # fmt: skip
    scales: int = param(
        1, ge=1, le=5, advanced=True,
        help="Number of sizes, half an octave apart, at which each place is compared with others, with"
             " group=cliques.",
    )  # fmt: skip
    search: str = param(
        "grid", choices=("grid", "meanshift"), advanced=True,
        help="Search method for the best match, with group=cliques. meanshift: as in the paper, slow.",
    )  # fmt: skip
    refine: bool = param(
        True,
        advanced=True,
        help="Refinement of the cliques, which moves single places between them. The paper has none.",
    )
    assign: str = param(
        "competition", choices=("competition", "neighbors"), advanced=True,
        help="Assignment of pixels to subtextures. competition: by textons; neighbors: by places, as in the paper.",
    )  # fmt: skip
    invariant: bool = param(
        False,
        help="Regard rotated versions of a texture as one texture, and those of a slightly different scale. No effect"
        " with features=haar.",
    )
    paper: bool = param(
        False,
        help="Settings of the paper (CZF02):"
        " features=haar:group=cliques:scales=3:search=meanshift:refine=0:assign=neighbors.",
    )
    photo: bool = param(False, help="Keep the photo as the first part, before the labels.")
    cryptomatte: bool | Path = param(
        False, help="Append Cryptomatte 1.2 as a part. A file name: also write the manifest to that file."
    )
    palette: Path | None = param(None, example="labels.json", help=LabelNames.HELP)
    onepart: bool = param(False, advanced=True, help=SINGLE)
    facts: Path | None = param(None, example="facts.json", help="File for the number and areas of subtextures.")

    PAPER: ClassVar[dict[str, Any]] = {
        "features": "haar",
        "group": "cliques",
        "scales": 3,
        "search": "meanshift",
        "refine": False,
        "assign": "neighbors",
    }

    def plan(self, facts: Facts) -> Plan:
        """The names of labels, the reduction of the image, and the settings."""
        from ..analysis.segmentation.subtextures import memory_needed  # scipy is not loaded before it is needed
        from ..engine.color.lab_reduced import reduction

        self.require_single()
        names = None if self.palette is None else LabelNames(self.palette)
        width, height = self.source.first.window.size
        factor = reduction(width, height, WORKING_PIXELS)
        settings = self._settings(-(-width // factor) * -(-height // factor))
        need = memory_needed(-(-width // factor) * -(-height // factor), settings) + width * height // 8
        facts.require(need, f"{self.flag()} of {width}x{height} px", "increase step")
        color_to_convert(self.source, facts, self.working_space)
        return Plan(work=(names, factor, settings))

    def make(self, plan: Plan, session: Session) -> dict[str, Any]:
        """The label map, and what other outputs are requested."""
        from ..analysis.segmentation.subtextures import decomposed, facts_of, label_map_of
        from ..engine.color.lab_reduced import lab_pixels

        resources, progress, first = session.resources, session.progress, self.source.first
        names, factor, settings = plan.work
        lens = lens_of(self.source, resources, self.working_space)
        pixels = lab_pixels(self.source, lens, resources, factor)
        progress.advance(1, 4)
        split = decomposed(pixels, settings, resources, progress.advance)
        self.inform("%d subtextures, from %d groups of %d", split.count, split.groups, split.samples)
        if self.maxlabels is not None and 0 < split.count < self.maxlabels:
            self.warn("found %d subtextures, not %d: no others are distinct", split.count, self.maxlabels)
        labels = label_map_of(first, pixels, split)
        if names is not None:
            (labels,) = names.of([labels])
        progress.advance(4, 4)
        return {
            **({} if self.onepart else {"label.1": labels.part}),
            "cryptomatte": [labels],
            "facts": lambda: facts_of(labels.part, split, settings, factor),
        }

    def _settings(self, pixels: int) -> DecompositionSettings:
        from ..analysis.segmentation.subtextures import DecompositionSettings

        haar = self.features == "haar"
        radius = self.radius or (8.0 if haar else DecompositionSettings.radius)
        shift = self.shift if self.shift is not None else radius if haar else DecompositionSettings.shift
        group = self.group or ("cliques" if haar else DecompositionSettings.group)
        usual = DecompositionSettings.threshold if group == "merging" else 0.95 if haar else CLIQUES_THRESHOLD
        return DecompositionSettings(
            group=group,
            count=self.maxlabels,
            features=self.features,
            bins=self.textons or (8 if haar else DecompositionSettings.bins),
            radius=radius,
            shift=shift,
            scales=self.scales,
            search=self.search,
            threshold=usual if self.threshold is None else self.threshold,
            step=self.step or (math.ceil(math.sqrt(pixels / _HAAR_SAMPLES)) if haar else _step(pixels)),
            refine=self.refine,
            assign=self.assign,
            invariant=self.invariant,
        )


def _step(pixels: int) -> int:
    """Spacing of samples: 16 px, more in large images, less in small ones."""
    return max(4, min(16, round(math.sqrt(pixels) / 16 / 4) * 4), math.ceil(math.sqrt(pixels / 2500)))
