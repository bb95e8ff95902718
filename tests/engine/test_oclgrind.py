# SPDX-License-Identifier: Apache-2.0
"""Every kernel under Oclgrind: no access out of bounds, no data race."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib import resources

import pytest

from oiiotex.engine.opencl import device_choice

BEFORE = """
import numpy as np
from oiiotex.engine.opencl.device import Device
from oiiotex.engine.opencl.device_choice import choose
Device.lanes = {lanes}
opened = Device(choose("Oclgrind"))
class Names(set):
    def append(self, item): self.add(item[0])
opened._events, opened.record = Names(), True
"""
AFTER = """
opened.finish()
print(*sorted(opened._events))
"""
# what runs all kernels of some files in cl/
USES = {
    "patchmatch histograms use_prices": """
from oiiotex.engine.core.source_map import SourceMap
from oiiotex.synthesis.patchmatch.constraints import Constraints, FixedPixels
from oiiotex.synthesis.patchmatch.optimization import synthesize
from oiiotex.synthesis.patchmatch.recipe import Recipe
exemplar = (np.random.default_rng(0).random((7, 8, 3)) * 100).astype(np.float32)
from dataclasses import replace
from oiiotex.analysis.regularity.lattice import Lattice
from oiiotex.analysis.regularity.offset_prices import InStep
def made(recipe, exemplar=exemplar, **constraints):
    synthesize(opened, exemplar, None, recipe, 1 << 30, lambda *_: None, constraints=Constraints(**constraints))
recipe = Recipe(width=6, height=5, wrap_x=True, wrap_y=True, sigma=3.0, patch=5, iterations=1, seed=1,
                uniformity=0.05, contrast=0.7, flat=True, complete=True)
made(recipe)
made(replace(recipe, search="coherent"))
recipe = replace(recipe, wrap_x=False, wrap_y=False)
exemplar = (np.random.default_rng(0).random((15, 9, 4)) * 100).astype(np.float32)
fixed = FixedPixels(np.indices((5, 6)).sum(0) < 4, SourceMap(np.zeros((5, 6), np.uint32)))
made(recipe, exemplar, fixed=fixed, sigmas=np.geomspace(2, 5, 30).astype(np.float32).reshape(5, 6))
lattice = Lattice(np.array([[0.2, 0.05], [-0.03, 0.3]]), 9.0, np.eye(64))
recipe = replace(recipe, in_step=InStep(lattice, lattice.frequencies, 0.5))
made(recipe, exemplar)
from oiiotex.synthesis.patchmatch import exemplar_rows, memory, optimization
exemplar_rows._REGION = 3
def in_pieces(device, shape, recipe, geometries, scales, constraints, budget, held):
    grids = memory.grids_of(recipe, geometries, scales, constraints)
    layout = memory.layout(recipe, geometries, grids, constraints, None, None, 3 + exemplar_rows.piece_halo(5))
    return memory.MemoryPlan(layout, 0, 0, False)
optimization.plan_memory = in_pieces
made(recipe, exemplar)
made(replace(recipe, search="coherent"), exemplar)
""",
    "atlas": """
import tempfile
from pathlib import Path
from oiiotex.surfaces.atlas.charts import Frames
from oiiotex.surfaces.atlas.mesh import read_mesh
from oiiotex.surfaces.atlas.synthesis import stack, synthesize
from tests.surfaces.test_atlas import TWO_CHARTS
from tests.analysis.test_superpixels import resources_of
with tempfile.TemporaryDirectory() as folder:
    path = Path(folder, "two.obj")
    path.write_text(TWO_CHARTS)
    mesh = read_mesh(path, 24, 24)
levels = stack((np.random.default_rng(0).random((16, 18, 3)) * 100).astype(np.float32), None)
synthesize(mesh, Frames.of(mesh, 1 / 10), (24, 24), levels, 1, "two.obj", resources_of(opened))
""",
    "moments steerable": """
from oiiotex.synthesis.patchmatch.optimization import synthesize
from oiiotex.synthesis.patchmatch.recipe import Recipe
exemplar = (np.random.default_rng(0).random((7, 8, 3)) * 100).astype(np.float32)
for wrap, measure in ((True, "moments"), (False, "steerable")):
    recipe = Recipe(width=6, height=5, wrap_x=wrap, wrap_y=wrap, sigma=3.0, patch=5, iterations=1, seed=1,
                    uniformity=0.05, contrast=0.7, flat=True, measure=measure, order=4)
    synthesize(opened, exemplar, None, recipe, 1 << 30, lambda done, total: None)
""",
    "superpixels slic_seeds": """
from oiiotex.engine.color import lab_on_device as labgrid
from oiiotex.analysis.superpixels.hierarchy import hierarchy
from oiiotex.analysis.superpixels.superpixels import superpixels
from oiiotex.engine.color.lab import lens_of
from tests.analysis.test_superpixels import image_of, resources_of
pixels = np.random.default_rng(0).random((19, 27, 4))
pixels[3:8, 5:9, 3] = 0
resources, image = resources_of(opened), image_of(pixels)
for budget in (labgrid._HOST_BYTES, 0):
    labgrid._HOST_BYTES, labgrid.BAND_BYTES = budget, 1000
    superpixels(image, lens_of(image, resources), resources, sigma=33.0, iterations=3)
    found = superpixels(image, lens_of(image, resources), resources, sigma=5.0, iterations=3)
hierarchy(found, resources, np.array([5.0, 8.0, 11.0, 14.0]))
""",
    "filter_bank": """
from oiiotex.analysis.labels.filter_bank import texton_map, texture_of
from tests.analysis.test_superpixels import resources_of
lab = np.random.default_rng(0).random((19, 27, 3)).astype(np.float32) * 90
resources, seen = resources_of(opened), np.ones((19, 27), bool)
seen[3:8, 5:9] = False
texton_map(texture_of(lab, seen, resources), resources, most=7)
""",
    "affinity factorization features potts": """
from oiiotex.analysis.labels import features, potts
from oiiotex.analysis.labels.scales import LabelSettings, labeled
from tests.analysis.test_superpixels import resources_of
resources, random = resources_of(opened), np.random.default_rng(0)
labeled(random.random((29, 5)) * 9, LabelSettings(neighbors=9), 0, resources)
features.pooled(random.integers(0, 9, (29, 6)), random.random((29, 2)) * 40, 5.0, resources)
likely = random.random((3, 29))
potts.settled(likely, np.stack([np.arange(28), np.arange(1, 29)], 1), resources)
potts.winners(random.random((3, 4, 5)).astype(np.float32), 4, (15, 19), resources)
""",
    "quilting": """
from oiiotex.analysis.labels import content_table as regions
from oiiotex.synthesis.quilting import quilter as quilting
from oiiotex.synthesis.quilting.quilt_plan import Grid, QuiltPlan
from oiiotex.engine.core.source_map import NONE
from oiiotex.engine.core.window import Window
random = np.random.default_rng(0)
lab = random.integers(-300, 300, (19, 23, 3)).astype(np.int16)
labels = np.where(np.indices((19, 23))[1] < 12, 1, 2).astype(np.uint8)
for tile in (True, False):
    grid = Grid(27, 22, tile, tile, patch=12, overlap=4)
    table = regions.content_table(*regions.window_keys(labels, 12), 12)
    found = quilting.QuiltExemplar(lab, table, (quilting.folded(labels), quilting.folded(labels + 3)), labels)
    keys = random.integers(0, len(table.keys), grid.shape).astype(np.int32)
    guide = random.integers(0, 3, (*grid.shape, quilting.GUIDE, quilting.GUIDE)).astype(np.uint16)
    rules = quilting.Rules(candidates=5, reach=1, reuse=1.0)
    made = quilting.Quilt(opened, found, grid, quilting.Demand(keys, guide), rules, 1 << 30)
    made.sources(Window(0, 0, 27, 22))
    plan = made.finished()
    plan.offsets[1:3, 1:3] = NONE
    made = quilting.Quilt(opened, found, grid, quilting.Demand(keys, guide), rules, 1 << 30, plan=plan)
    made.sources(Window(3, 1, 20, 19))
""",
    "candidates multiscale": """
from pathlib import Path
from oiiotex.synthesis.multiscale.candidate_sets import Stacks, analyze
from oiiotex.synthesis.multiscale.graph import Edge, Graph
from oiiotex.synthesis.multiscale.synthesizer import PlaneSettings, Synthesizer
from oiiotex.synthesis.multiscale.superexemplar import unrolled
from oiiotex.engine.core.window import Window
graph = Graph(("a",), (Path("a"),), 0, (Edge(0, 0, 1),), (1.0,), (None,))
levels = unrolled(graph, 3)
planes = np.random.default_rng(0).integers(-900, 900, (len(levels.stacks), 8, 8, 4)).astype(np.int16)
planes[..., 3] = 0
usable = np.ones(planes.shape[:3], bool)
usable[:, 3:5, 2:5] = False
stacks = Stacks(levels, planes, usable, usable, (False,) * len(planes))
made = analyze(opened, stacks, 8, True, 1 << 30, lambda done, total: None, None)
maker = Synthesizer(opened, made, PlaneSettings(seed=1, jitter=(0.0, 0.6), kept=0.8), 1 << 30)
maker.window(4, Window.sized(3, -2, 6, 5))
""",
}
UNUSED = {"superpixels_clear"}  # by wide lanes


@pytest.mark.skipif(
    not any(d.platform == "Oclgrind" for d in device_choice.devices()), reason="Oclgrind is not installed"
)
@pytest.mark.slow  # an emulator, .6 minutes of a core for kernels that change rarely
@pytest.mark.parametrize("lanes", [1, 32])
@pytest.mark.parametrize("files", USES)
def test_oclgrind_finds_nothing(tmp_path, files, lanes):
    log = tmp_path / "log"
    # Its check for uninitialized values is left out: it crashes on wide vectors, and in single lanes it doubts pixels
    # that the host has just written.
    done = subprocess.run(
        [sys.executable, "-c", BEFORE.format(lanes=lanes) + USES[files] + AFTER],
        env={**os.environ, "OCLGRIND_DATA_RACES": "1", "OCLGRIND_LOG": str(log)},
        capture_output=True,
        text=True,
        timeout=400,
    )
    assert done.returncode == 0, done.stderr
    found = log.read_text() if log.exists() else ""
    assert not found, found[:3000]
    kernels = {
        line.split("(")[0].split()[-1]
        for name in files.split()
        for line in (resources.files("oiiotex") / "cl" / f"{name}.cl").read_text().splitlines()
        if line.startswith("__kernel")
    }
    assert kernels - set(done.stdout.split()) <= (UNUSED if lanes > 1 else set()), "a kernel did not run"


def test_all_kernels_are_run():
    files = {f.name for f in (resources.files("oiiotex") / "cl").iterdir() if f.name.endswith(".cl")}
    assert files == {f"{name}.cl" for names in USES for name in names.split()}
