# SPDX-License-Identifier: Apache-2.0
"""Our kernels compared with numba loops that do the same work and give the same result; the ratio is in brackets.

python -m pytest benchmarks/kernels/test_kernels.py

The exemplar is the demo's photo at 512x512, with the defaults of --texstationarize. The device is the CPU, because
the bound runs there; $OIIOTEX_DEVICE names another.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from benchmarks.kernels.numba_histograms import BoundProjection
from benchmarks.kernels.numba_multiscale import BoundCorrection
from benchmarks.kernels.numba_patchmatch import BoundMatcher
from oiiotex.analysis.stationarity.grid_statistics import CellGrid
from oiiotex.engine.color.lab import working_values
from oiiotex.engine.color.lab_grid import to_grid
from oiiotex.engine.core.image import from_buffer
from oiiotex.engine.core.source_map import SourceMap
from oiiotex.engine.core.window import Window
from oiiotex.engine.io.reading import read as read_image
from oiiotex.engine.opencl.buffers import Buffers
from oiiotex.engine.opencl.device import Device
from oiiotex.engine.opencl.device_choice import open_device
from oiiotex.engine.opencl.rows import Rows
from oiiotex.engine.session import Session
from oiiotex.filters.texstationarize import Stationarize
from oiiotex.synthesis.multiscale.graph import Graph
from oiiotex.synthesis.multiscale.infinite_plane import opened
from oiiotex.synthesis.multiscale.synthesizer import PASSES, LevelPlan, Synthesizer, parents, plan, schedule
from oiiotex.synthesis.patchmatch.field import Geometry, allowed_patches, random_field
from oiiotex.synthesis.patchmatch.matcher import Matcher, _penalty_unit
from oiiotex.synthesis.patchmatch.optimization import OVERSHOOT, synthesize
from oiiotex.synthesis.patchmatch.recipe import Recipe
from oiiotex.synthesis.projections.histograms import Projection, layout
from oiiotex.synthesis.projections.projection import projected
from tools.demo import gravel, save, stained

ROUNDS, WARMUPS = 15, 2
STEP = 1000  # numbers the iteration; any that has not been
SHAPE = (512, 512, 3)


@dataclass(frozen=True)
class Scene:
    """What both sides work on."""

    device: Device
    recipe: Recipe
    geometry: Geometry
    grid: CellGrid
    exemplar: np.ndarray
    allowed: np.ndarray
    fields: dict[str, SourceMap]
    budget: int

    def buffers(self) -> Buffers:
        matched = {"matched": self.geometry.layout()["image"]}
        return Buffers(self.device, self.geometry.layout() | layout(self.grid) | matched, self.budget, "the benchmark")

    def matcher(self, buffers: Buffers, field: SourceMap) -> Matcher:
        arguments = (self.exemplar, self.allowed, field, self.recipe.uniformity, self.recipe.seed)
        return Matcher(self.device, buffers, self.geometry, *arguments)

    def value_range(self) -> tuple[np.ndarray, np.ndarray]:
        return self.exemplar.min(axis=(0, 1)), self.exemplar.max(axis=(0, 1))

    def project(self, buffers: Buffers) -> None:
        projection = Projection(self.device, buffers, self.grid, *self.value_range())
        rows = Rows(self.device, buffers, "image", *self.geometry.size, True, None, 0)
        for _ in projected(projection, rows, "matched", OVERSHOOT):
            pass


@pytest.fixture(scope="module")
def scene() -> Scene:
    with tempfile.TemporaryDirectory() as folder:
        save(stained(gravel()), Path(folder) / "photo.png")
        photo = oiio.ImageBuf(f"{folder}/photo.png")
        photo.read(force=True)
    session = Session(device_name=os.environ.get("OIIOTEX_DEVICE") or "cpu")
    device = open_device(session.settings.device_name)
    image = from_buffer(photo)
    lab = working_values(image, session.resources)[0]
    recipe = Stationarize(exemplar=image).recipe(512, 512)
    geometry = Geometry(512, 512, True, True, exemplar_width=512, exemplar_height=512, patch=recipe.patch)
    allowed = allowed_patches(None, geometry)
    fields = {
        "scrambled": random_field(geometry, allowed, recipe.seed),
        "settled": synthesize(device, lab, None, recipe, session.resources.budget, lambda done, total: None).field,
    }
    grid = CellGrid.of(geometry, recipe.sigma)
    return Scene(
        device, recipe, geometry, grid, to_grid(lab, geometry.steps), allowed, fields, session.resources.budget
    )


@dataclass(frozen=True)
class Match:
    """An outer iteration up to the search for patches: field, voted image, projected image."""

    scene: Scene
    buffers: Buffers
    matcher: Matcher
    bound: BoundMatcher
    field: SourceMap

    def reset(self) -> None:
        """The field as it was before."""
        self.scene.device.write(self.buffers["field"], self.field.packed)
        self.scene.device.finish()
        self.bound.field[:] = self.field.packed

    def improve(self) -> None:
        self.matcher.improve(1, STEP)
        self.scene.device.finish()

    def improve_bound(self) -> None:
        self.bound.improve(1, STEP)


@pytest.fixture(scope="module", params=["scrambled", "settled"])
def match(request: pytest.FixtureRequest, scene: Scene) -> Iterator[Match]:
    field = scene.fields[request.param]
    with scene.buffers() as buffers:
        matcher = scene.matcher(buffers, field)
        matcher.vote()
        scene.project(buffers)
        buffers.swap("image", "matched")
        target = scene.device.read(buffers["image"], SHAPE, np.int16)
        weight = scene.recipe.uniformity * _penalty_unit(scene.exemplar, scene.geometry)
        what = scene.exemplar, scene.allowed, target, field.packed, weight, scene.recipe.seed
        bound = BoundMatcher(scene.geometry, *what)
        both = Match(scene, buffers, matcher, bound, field)
        both.improve()
        both.improve_bound()
        assert (matcher.field().packed != field.packed).mean() > 0.01, "there was nothing to do"
        np.testing.assert_array_equal(bound.field, matcher.field().packed)
        distance = scene.device.read(buffers["distance"], bound.distance.shape, np.int32)
        np.testing.assert_array_equal(bound.distance, distance)
        yield both


@pytest.mark.parametrize("by", ["opencl", "numba"])
def test_patchmatch(benchmark, match: Match, request: pytest.FixtureRequest, by: str) -> None:
    """pad, score, uniformity, propagate with jumps 4, 2, 1, search: `Matcher.improve(1, step)`."""
    benchmark.group = f"PatchMatch, {request.node.callspec.params['match']} field"
    run = match.improve if by == "opencl" else match.improve_bound
    benchmark.pedantic(run, setup=match.reset, rounds=ROUNDS, warmup_rounds=WARMUPS)


@dataclass(frozen=True)
class Project:
    """The projection of a voted image by both."""

    scene: Scene
    buffers: Buffers
    bound: BoundProjection
    image: np.ndarray
    matched: np.ndarray

    def project(self) -> None:
        self.scene.project(self.buffers)
        self.scene.device.finish()

    def project_bound(self) -> None:
        self.bound.project(self.image, self.matched, OVERSHOOT)


@pytest.fixture(scope="module")
def project(scene: Scene) -> Iterator[Project]:
    with scene.buffers() as buffers:
        scene.matcher(buffers, scene.fields["settled"]).vote()
        image = scene.device.read(buffers["image"], SHAPE, np.int16)
        bound = BoundProjection(scene.grid, *scene.value_range())
        both = Project(scene, buffers, bound, image, np.empty_like(image))
        both.project()
        both.project_bound()
        theirs = scene.device.read(buffers["matched"], SHAPE, np.int16)
        assert (theirs != image).mean() > 0.05, "there was nothing to do"
        apart = np.abs(both.matched.astype(np.int32) - theirs)
        assert (apart <= 1).mean() >= 0.999
        yield both


@pytest.mark.parametrize("by", ["opencl", "numba"])
def test_projection(benchmark, project: Project, by: str) -> None:
    """gather, row sums, blur, cumulate, match: `Projection.project`."""
    benchmark.group = "projection"
    run = project.project if by == "opencl" else project.project_bound
    benchmark.pedantic(run, rounds=ROUNDS, warmup_rounds=WARMUPS)


@dataclass(frozen=True)
class Correct:
    """The finest level of a window of 1024 x 1024 pixels, upsampled, to be corrected by both."""

    device: Device
    maker: Synthesizer
    entry: LevelPlan
    buffers: Buffers
    bound: BoundCorrection
    before: dict[str, np.ndarray]
    now: dict[str, np.ndarray]

    def reset(self) -> None:
        """What was there before the first subpass."""
        for name, array in self.before.items():
            self.device.write(self.buffers[name], array)
            self.now[name][:] = array
        self.device.finish()

    def correct(self) -> None:
        for parity, after in zip(schedule(PASSES), self.entry.windows[1:], strict=True):
            self.maker._correct(self.buffers, self.entry.windows[0], after, parity)
        self.device.finish()

    def correct_bound(self) -> None:
        self.bound.correct(**self.now, windows=self.entry.windows, parities=schedule(PASSES))


@pytest.fixture(scope="module")
def correct() -> Iterator[Correct]:
    session, finest = Session(device_name=os.environ.get("OIIOTEX_DEVICE") or "cpu"), 8
    device = open_device(session.settings.device_name)
    with tempfile.TemporaryDirectory() as folder:
        save(stained(gravel()), Path(folder) / "photo.png")
        image = read_image(Path(folder) / "photo.png")
        plane = opened(
            session.resources,
            session.progress,
            Graph.single("gravel"),
            [image],
            "gravel",
            side=256,
            dims=16,
            correct=True,
            data=False,
        )
    settings = plane.settings(seed=1, lock=False)
    maker = Synthesizer(device, plane.analysis, settings, session.resources.budget)
    window = Window(0, 0, 1024, 1024)
    entry = plan(window, finest, PASSES)[-1]
    shape = entry.windows[0].height, entry.windows[0].width
    before = parents(entry.windows[0])
    state = maker.window(finest - 1, before)
    layout = {name: shape[0] * shape[1] * size for name, size in (("texel", 4), ("r", 8), ("color", 8))}
    with Buffers(
        device, layout | {"parent": layout["texel"], "parent_r": layout["r"]}, session.resources.budget, "it"
    ) as buffers:
        device.write(buffers["parent"], state.texel)
        device.write(buffers["parent_r"], state.offset)
        maker._upsample(buffers, entry, before)
        made = {
            "texel": device.read(buffers["texel"], shape, np.uint32),
            "r": device.read(buffers["r"], (*shape, 4), np.int16),
            "color": device.read(buffers["color"], (*shape, 4), np.int16),
        }
        bound = BoundCorrection(plane.analysis, round(16 * (settings.penalty - 1)))
        both = Correct(device, maker, entry, buffers, bound, made, {k: v.copy() for k, v in made.items()})
        both.reset()
        both.correct()
        both.correct_bound()
        assert (both.now["texel"] != made["texel"]).mean() > 0.05, "there was nothing to do"
        for name, mine in both.now.items():
            np.testing.assert_array_equal(mine[..., :3], device.read(buffers[name], mine.shape, mine.dtype)[..., :3])
        np.testing.assert_array_equal(
            both.now["texel"][window.inside(entry.windows[0])], maker.window(finest, window).texel
        )
        yield both


@pytest.mark.parametrize("by", ["opencl", "numba"])
def test_correction(benchmark, correct: Correct, by: str) -> None:
    """correct, color, eight subpasses of a level, D = 16."""
    benchmark.group = "multiscale correction"
    run = correct.correct if by == "opencl" else correct.correct_bound
    benchmark.pedantic(run, setup=correct.reset, rounds=ROUNDS, warmup_rounds=WARMUPS)
