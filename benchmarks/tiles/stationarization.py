# SPDX-License-Identifier: Apache-2.0
"""MJH17 figures 3 and 4 on a folder of photos, for every measure of stationarity, compared with toroidal PatchMatch.

python -m benchmarks.tiles.stationarization OUT [--photos FOLDER] [--side 256] [--seeds 10] [--moments N]
                                                [--steerable N]

It appends to OUT/costs.csv and OUT/traces.csv, and resumes where it was stopped. Then it makes figure3.png, figure4.png
and table.md from them (matplotlib is in the extra 'benchmark'). Tiles are made with paper=1.

The protocol is that of MJH17 section 5.2: the same seeds for all variants, and in addition the seed of ten with which
toroidal PatchMatch is most stationary by the variant's own measure, used for both. Costs: stationarity by eq. 1 at
sigma = longer side / 32, the photo's own units for moments; texture by eq. 5, an upper bound by eight passes of
PatchMatch. The combined cost of figure 3a is c_stat / s + c_text / s^2 with s the photo's deviation in Lab, because
the paper adds different units.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from unittest import mock

import numpy as np

from benchmarks.shared.measures import data_folder, load
from benchmarks.shared.stationarization_results import (
    BASELINE,
    DEFAULT,
    FIELDS,
    FLAT_TEXTURE,
    MEASURES,
    TEXTURE,
    TRACE_FIELDS,
    append,
    best_seed,
    rows,
)
from oiiotex.analysis.stationarity.costs import stationarity_cost
from oiiotex.engine import errors
from oiiotex.engine.color.lab import working_values
from oiiotex.engine.color.lab_grid import steps_for
from oiiotex.engine.core.image import Image, from_buffer
from oiiotex.engine.core.source_map import SourceMap
from oiiotex.engine.core.window import Domain
from oiiotex.engine.session import Session
from oiiotex.filters.texstationarize import Stationarize
from oiiotex.synthesis.exemplar.flattened import flat_photo
from oiiotex.synthesis.patchmatch import optimization as module
from oiiotex.synthesis.patchmatch.matcher import match_patches
from oiiotex.synthesis.patchmatch.recipe import PAPER_PATCH, Recipe


class Photo:
    """A photo, and what is made of it."""

    def __init__(self, path: Path, side: int, session: Session):
        self.name, self.session = path.stem, session
        self.buffer = load(path, side)
        self.image = from_buffer(self.buffer)
        self.lab, self.opaque = working_values(self.image, session.resources)
        self.height, self.width = self.lab.shape[:2]
        self.sigma = max(self.width, self.height) / 32

    def recipe(self, variant: str) -> Recipe:
        """The paper's recipe; the baseline's is the same without a projection."""
        measure = "histogram" if variant == BASELINE else variant
        op = Stationarize(exemplar=self.image, measure=measure, paper=True)
        recipe = op.recipe(self.width, self.height)
        return replace(recipe, sigma=None) if variant == BASELINE else recipe

    def made(self, variant: str, seed: int) -> tuple[SourceMap, np.ndarray]:
        """One variant's tile: where its pixels are from, and its Lab."""
        resources = self.session.resources
        if variant == DEFAULT:
            op = Stationarize(exemplar=self.image, st=True, seed=seed)
            parts = op.make(op.plan(self.session.resources), self.session)
            tile, _ = working_values(Image((parts["tile"],), self.image.source), resources)
            return SourceMap.of_coordinates(parts["st"].pixels(), self.buffer.spec(), "st"), tile
        recipe = replace(self.recipe(variant), seed=seed)
        made = module.synthesize(
            resources.device, self.lab, self.opaque, recipe, resources.budget, lambda done, total: None
        )
        return made.source, made.source.gather(self.lab)

    def costs(self, variant: str, seed: int, measures: Iterable[str]) -> dict[str, float]:
        """Stationarity by some measures, and texture."""
        source, tile = self.made(variant, seed)
        found = {m: stationarity_cost(tile, self.sigma, measure=m, like=self.lab) for m in measures}
        found[TEXTURE] = self.texture(source, tile, self.lab)
        if variant == DEFAULT:
            found[FLAT_TEXTURE] = self.texture(source, tile, self.flat)
        return found

    @cached_property
    def flat(self) -> np.ndarray:
        """Lab of the photo as the default flattens it."""
        resources, progress = self.session.resources, self.session.progress
        flat, _, _ = flat_photo(Stationarize(exemplar=self.image), self.image, 1.0, resources, progress, None)
        return working_values(flat, resources)[0]

    def texture(self, source: SourceMap, tile: np.ndarray, exemplar: np.ndarray) -> float:
        """Eq. 5, from the patches that the pixels were copied from, improved by eight passes."""
        resources, (height, width), half = self.session.resources, tile.shape[:2], PAPER_PATCH // 2
        last = (self.height - PAPER_PATCH, self.width - PAPER_PATCH)
        corners = (
            np.clip(np.roll(n, (-half, -half), (0, 1)) - half, 0, m) for n, m in zip(source.yx, last, strict=True)
        )
        _, texture = match_patches(
            resources.device, tile, exemplar, SourceMap.of(*corners), PAPER_PATCH, Domain(width, height, True, True), 1,
            resources.budget,
        )  # fmt: skip
        return texture

    def traced(self, variant: str, seed: int) -> list[tuple[float, float, float]]:
        """(stationarity, texture, deviation) after every iteration, at the size of its level."""
        found: list[tuple[float, float, float]] = []

        class Traced(module._Level):
            """Looks at what the result would be, were this the last iteration."""

            def __init__(self, device, buffers, matcher, exemplar, usable, recipe, scale, *more):
                super().__init__(device, buffers, matcher, exemplar, usable, recipe, scale, *more)
                self.lab, self.scale = exemplar.astype(np.float32) / steps_for(recipe.patch), scale

            def iterate(self, iteration: int, passes: int) -> None:
                super().iterate(iteration, passes)
                tile = self._matcher.pick().gather(self.lab)
                cost = stationarity_cost(tile, sigma * self.scale)
                field, torus = self._matcher.field(), Domain(*tile.shape[1::-1], True, True)
                given = resources.device, tile, self.lab, field, 11, torus, 1, resources.budget
                found.append((cost, match_patches(*given, passes=0)[1], _deviation(self.lab)))

        sigma, resources = self.sigma, self.session.resources
        with mock.patch.object(module, "_Level", Traced):
            self.made(variant, seed)
        return found


def _deviation(lab: np.ndarray) -> float:
    """Root of the variance summed over channels."""
    return float(np.sqrt(lab.reshape(-1, 3).var(0).sum()))


def run(folder: Path, out: Path, side: int, seeds: dict[str, int]) -> None:
    """Measure what is not yet in the files: seed after seed over all photos, first of what figures 3 and 4 compare."""
    session = Session()
    out.mkdir(parents=True, exist_ok=True)
    photos = []
    for path in sorted(folder.iterdir()):
        try:
            photos.append(Photo(path, side, session))
        except (errors.Error, OSError) as error:
            print(f"{path.name}: {error}", file=sys.stderr)
    for variants in ((BASELINE, "histogram", DEFAULT), MEASURES[1:]):
        for seed in range(max(seeds[v] for v in variants)):
            for photo in photos:
                for variant in (v for v in variants if seed < seeds[v]):
                    others = (
                        [m for m in MEASURES[1:] if seed < seeds[m]] if variant in (BASELINE, DEFAULT) else [variant]
                    )
                    measure(photo, variant, seed, dict.fromkeys(["histogram", *others]), out)
            print(f"{', '.join(variants)}: seed {seed}", flush=True)
        trace(photos, out)
    for photo in photos:
        for variant in (v for v in MEASURES if seeds[v]):
            best = best_seed(rows(out / "costs.csv"), photo.name, variant)
            measure(photo, variant, best, dict.fromkeys(["histogram", variant]), out)


def trace(photos: list[Photo], out: Path) -> None:
    """Costs after every iteration, where they are not known."""
    followed = {(r["photo"], r["variant"]) for r in rows(out / "traces.csv")}
    for photo in photos:
        for variant in (BASELINE, "histogram"):
            if (photo.name, variant) not in followed:
                found = photo.traced(variant, 0)
                append(out / "traces.csv", TRACE_FIELDS, [(photo.name, variant, n, *f) for n, f in enumerate(found, 1)])


def measure(photo: Photo, variant: str, seed: int, measures: Iterable[str], out: Path) -> None:
    """One variant's costs, where they are not known."""
    known = {(r["photo"], r["seed"], r["variant"]) for r in rows(out / "costs.csv")}
    if (photo.name, str(seed), variant) not in known:
        found = photo.costs(variant, seed, measures)
        append(out / "costs.csv", FIELDS, [(photo.name, seed, variant, m, c) for m, c in found.items()])


def main() -> None:
    """Run what has not been run; draw and write all that there is."""
    from benchmarks.tiles.stationarization_plots import plot

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--photos", type=Path, default=data_folder() / "photos")
    parser.add_argument("--side", type=int, default=256)
    parser.add_argument("--seeds", type=int, default=10)
    for measure in MEASURES[1:]:
        parser.add_argument(f"--{measure}", type=int, help="number of seeds for that measure, if fewer")
    given = parser.parse_args()
    fewer = {m: given.seeds if getattr(given, m) is None else getattr(given, m) for m in MEASURES[1:]}
    seeds = dict.fromkeys((BASELINE, DEFAULT, "histogram"), given.seeds) | fewer
    run(given.photos, given.out, given.side, seeds)
    plot(given.out)


if __name__ == "__main__":
    main()
