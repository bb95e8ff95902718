# SPDX-License-Identifier: Apache-2.0
"""--texsuperpixel: an image of any size as superpixels, at any scale."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

from ..color.lab import InLab, lens_of
from ..core.access import ScanThenMap
from ..core.attributes import SIGMA, SUPERPIXELS
from ..core.image import Image, Part
from ..core.op import Kind, Output
from ..core.parameters import image, param
from ..deferred import np, oiio
from ..errors import ParameterError, present
from ..session import Session
from ..superpixels.hierarchy import Hierarchy, hierarchy
from ..superpixels.superpixels import COMPACTNESS, ITERATIONS, LEAST_SIGMA, Superpixels, label_part, superpixels


@dataclass(frozen=True, kw_only=True)
class Superpixel(InLab, ScanThenMap):
    """Cut an image into superpixels: small connected regions of one look.

    Fine superpixels are found by SLIC in Lab and merged into coarser ones, guided by a Gaussian stack, so that coarse
    borders are a choice of fine ones (LSA16: Lockerman, Sauvage, Allegre, Dischler, Dorsey, Rushmeier, Multi-Scale
    Label-Map Extraction for Texture Synthesis, SIGGRAPH 2016, section 3). The result is a label map: ids from 1 on,
    numbered by their first pixel in reading order, 0 where alpha is 0, and the same for any tile size or memory
    budget.
    """

    example: ClassVar[str] = """\
>>> ids = filters.superpixel("photo.png", count=100)
>>> view = filters.labelview(ids)
"""
    name: ClassVar[str] = "superpixel"
    carries: ClassVar[bool] = True
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("photo", Kind.PIXELS, "the photo, before all others", asked_by="keep", of="source"),
        Output("superpixels", Kind.IDS, "one channel, of the image's windows: write it to EXR or TIFF"),
    )

    source: Image = image(help="the image")
    sigma: float | None = param(
        None, ge=1, le=1e6, unit="px", help="scale of the superpixels: the nearest level; the finest when left out"
    )
    count: int | None = param(None, ge=1, help="how many superpixels, instead of a scale")
    finest: float | None = param(
        None,
        ge=2,
        le=1e5,
        unit="px",
        help=f"scale of the finest level; shorter side / 50, at least {LEAST_SIGMA:g}, when left out",
    )
    compactness: float = param(
        COMPACTNESS, ge=0.1, le=100, help="m of SLIC: how many Lab units count as much as one sigma of distance"
    )
    iterations: int = param(ITERATIONS, ge=1, le=100000, help="of SLIC, at most: it stops when no seed moves")
    runs: int = param(1, ge=1, le=1000, help="of SLIC: the best of so many by eq. 3 is taken; the paper takes 10")
    minsize: int | None = param(
        None,
        ge=1,
        unit="px",
        help="smaller pieces join a neighbor; a quarter of finest^2 when left out, 25 in the paper",
    )
    seed: int = param(0, ge=0, le=2**32 - 1, help="of the runs after the first, whose seeds start elsewhere")
    keep: bool = param(False, help="the image stays as first part, the label map follows it")

    def compute(self, session: Session) -> dict[str, Part]:
        """The label map."""
        resources, progress = session.resources, session.progress
        if self.sigma is not None and self.count is not None:
            raise ParameterError("sigma and count both choose a level: give one of them")
        lens = lens_of(self.source, resources, self.working_space)
        finest = superpixels(
            self.source, lens, resources, sigma=self.finest, compactness=self.compactness, iterations=self.iterations,
            runs=self.runs, minsize=self.minsize, seed=self.seed, powers=False, advance=progress.advance,
        )  # fmt: skip
        sigma, partition = finest.sigma, np.arange(finest.count)
        if self.sigma is not None or self.count is not None:
            sigma, partition = self._level(finest, hierarchy(finest, resources))
        count = int(partition.max(initial=-1)) + 1
        self.inform("%d superpixels of scale %.1f px", count, sigma)
        part = label_part(self.source.first, finest.runs.relabeled(partition))

        def mark(spec: oiio.ImageSpec) -> None:
            spec.attribute(SIGMA, float(sigma))
            spec.attribute(SUPERPIXELS, count)

        # without the photo it takes its place, and name
        name = part.name if self.keep else self.source.first.name
        return {"superpixels": replace(part.respecced(mark), name=name)}

    def _level(self, finest: Superpixels, levels: Hierarchy) -> tuple[float, np.ndarray]:
        """Scale and partition that were asked for, or the nearest there are."""
        if self.count is None:
            level = levels.level_of(present(self.sigma))
            return float(levels.sigmas[level]), levels.partition(level)
        count = min(max(self.count, int(levels.counts[-1])), finest.count)
        if count != self.count:
            text = "count=%d is not to be had: levels go from %d down to %d"
            self.warn(text, self.count, finest.count, levels.counts[-1])
        return float(np.sqrt(finest.sizes.sum() / count)), levels.partition_of(count)
