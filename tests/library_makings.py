# SPDX-License-Identifier: Apache-2.0
"""What tests of libraries begin with: photos, recipes, runs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from oiiotex_studio.library import asset as making
from oiiotex_studio.library import ingest
from oiiotex_studio.materials import preview as pictures
from oiiotex_studio.recipes.found import materials
from oiiotex_studio.recipes.recipe import LibraryRecipe, recipe_of

from oiiotex.oiiotool.cli.running.progress import Display
from tests import pictures as drawn
from tests.conftest import save

LINE = '[[product]]\nname = "tile"\nline = "$maps $outputs"\n'
OPENGL = 'schema = 1\n[find]\nnormals = "opengl"\n'


def recipe(text: str = LINE, before: str = "schema = 1\n") -> LibraryRecipe:
    import tomllib

    return recipe_of(tomllib.loads(before + text), "recipe")


def bumps(side: int = 24, seed: int = 1) -> np.ndarray:
    """A map of normals: OpenGL's, 0 to 1."""
    heights = drawn.smooth_noise(side, side, 6, seed)
    dy, dx = np.gradient(heights)
    vectors = np.dstack([-4 * dx, 4 * dy, np.ones_like(dx)])
    return 0.5 + 0.5 * vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


@pytest.fixture
def photos(tmp_path: Path) -> Path:
    """Two materials, one of them of three maps."""
    folder = tmp_path / "photos"
    (folder / "scans").mkdir(parents=True)
    save(drawn.pebbles(24, 24, 1), folder / "gravel.png")
    save(drawn.bricks(24, 24, 2), folder / "scans" / "wall_diff_1k.png")
    save(bumps(), folder / "scans" / "wall_nor_gl_1k.png")
    save(drawn.noise(24, 24, 3)[..., None], folder / "scans" / "wall_rough_1k.png")
    return folder


@pytest.fixture
def here(monkeypatch):
    """Jobs are done in this process: starting others takes a second."""
    monkeypatch.setattr(ingest, "_in_processes", lambda jobs, workers: ((making.make(job), job) for job in jobs))
    for name in ("_THUMBNAIL", "_REPEATED", "LIT", "_RIVALS", "CARD"):
        monkeypatch.setattr(pictures, name, 48)


def brought_in(photos: Path, library: Path, how: LibraryRecipe, **settings: object) -> tuple[ingest.Tally, list[str]]:
    said: list[str] = []
    tally = ingest.ingest(photos, library, how, ingest.IngestSettings(**settings), said.append, Display(terminal=False))
    return tally, said


def names_of(folder: Path, how: LibraryRecipe) -> dict[str, tuple[dict[str, str], tuple[str, ...]]]:
    return {m.name: ({role: str(file) for role, file in m.maps.items()}, m.questions) for m in materials(folder, how)}


def touched(folder: Path, *names: str) -> Path:
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    return folder
