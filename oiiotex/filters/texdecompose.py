# SPDX-License-Identifier: Apache-2.0
"""--texdecompose: the subtextures of a texture, whose number is found."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from ..analysis.labels.legend import LabelNames
from ..analysis.labels.single_part import SINGLE, OnePart
from ..engine.color.lab import InLab, color_to_convert, lens_of
from ..engine.core.access import ScanThenMap
from ..engine.core.image import Image
from ..engine.core.op import Kind, Output, Plan
from ..engine.core.parameters import image, param
from ..engine.core.tiling import tiling_of
from ..engine.session import Session
from ..engine.session.facts import Facts

if TYPE_CHECKING:
    from ..analysis.segmentation.subtextures import DecompositionSettings

WORKING_PIXELS = 1 << 20


@dataclass(frozen=True, kw_only=True)
class Decompose(OnePart, InLab, ScanThenMap):
    """Segment a texture into the simpler textures that it consists of.

    Use it for mixed photos, such as grass and gravel: it gives few large regions, where `label` gives labels at
    several scales. Regions compete for pixels by their textons (clusters of local features). Pairs of regions that
    are probably one texture are merged until no such pair is left; with `maxlabels`, until that number of regions is
    left. The remaining subtextures then compete once more. The result is a label map with ids from 1, and 0 where
    alpha is 0. Images above a megapixel are analyzed at an integer fraction of their resolution. Labels of a tile wrap.

    For comparison, paper=1 compares the texton histograms of sampled places, searches near each place for the best
    match, and groups the places by clique partitioning (CZF02: Caenen, Zalesny, Ferrari, Van Gool, Unsupervised
    Texture Segmentation by Clique Partitioning).
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
    threshold: float | None = param(
        None, example="0.5", ge=0, le=1, unset="0.32; with paper=1, 0.95",
        help="Probability, or with paper=1 similarity, above which regions become one texture. Increase it"
             " for more subtextures. Not used if `maxlabels` is set.",
    )  # fmt: skip
    radius: float | None = param(
        None, example="32", ge=1, le=512, unit="px", unset="48, up to 72 above 0.4 megapixels; with paper=1, 8",
        help="Radius of the area that is compared as one sample of texture. Increase it for coarse textures.",
    )  # fmt: skip
    invariant: bool = param(
        False,
        help="Regard rotated versions of a texture as one texture, and those of a slightly different scale. No effect"
        " with paper=1.",
    )
    paper: bool = param(
        False,
        help="Method of the paper (CZF02): clique partitioning of places that are compared by color and Haar wavelets."
        " It is slower and less accurate.",
    )
    photo: bool = param(False, help="Keep the photo as the first part, before the labels.")
    cryptomatte: bool | Path = param(
        False, help="Append Cryptomatte 1.2 as a part. A file name: also write the manifest to that file."
    )
    palette: Path | None = param(None, example="labels.json", help=LabelNames.HELP)
    onepart: bool = param(False, advanced=True, help=SINGLE)
    facts: Path | None = param(None, example="facts.json", help="File for the number and areas of subtextures.")

    def plan(self, facts: Facts) -> Plan:
        """The names of labels, the reduction of the image, and the settings."""
        from ..analysis.segmentation.subtextures import memory_needed, surroundings  # scipy is not loaded before needed
        from ..engine.color.lab_reduced import reduction

        self.require_single()
        names = None if self.palette is None else LabelNames(self.palette)
        width, height = self.source.first.window.size
        factor = reduction(width, height, WORKING_PIXELS)
        rows, columns = -(-height // factor), -(-width // factor)
        settings = self._settings(rows * columns)
        tiled = "none" if self.paper else tiling_of(self.source.first.spec)
        above, left = surroundings(tiled, settings)
        need = memory_needed((rows + 2 * above) * (columns + 2 * left), settings) + width * height // 8
        facts.require(need, f"{self.flag()} of {width}x{height} px", "use a smaller image")
        color_to_convert(self.source, facts, self.working_space)
        return Plan(work=(names, factor, settings, tiled))

    def make(self, plan: Plan, session: Session) -> dict[str, Any]:
        """The label map, and what other outputs are requested."""
        from ..analysis.segmentation.subtextures import decomposed_tile, facts_of, label_map_of
        from ..engine.color.lab_reduced import lab_pixels

        resources, progress, first = session.resources, session.progress, self.source.first
        names, factor, settings, tiled = plan.work
        lens = lens_of(self.source, resources, self.working_space)
        pixels = lab_pixels(self.source, lens, resources, factor)
        progress.advance(1, 4)
        split = decomposed_tile(pixels, tiled, settings, resources, progress.advance)
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
        from ..analysis.segmentation.subtextures import czf02, usual

        settings = czf02(pixels, self.radius) if self.paper else usual(pixels)
        chosen: dict[str, Any] = {"count": self.maxlabels, "threshold": self.threshold, "radius": self.radius}
        chosen = {name: value for name, value in chosen.items() if value is not None}
        return replace(settings, invariant=self.invariant, **chosen)
