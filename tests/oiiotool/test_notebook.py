# SPDX-License-Identifier: Apache-2.0
"""Notebooks show results as pictures, and the notebook of the docs runs from top to bottom."""

from __future__ import annotations

import base64
import re
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex.python.notebook import SIDE, figures, png
from tests.any_filter import buffer, ids
from tools.docs import notebook


def shown(made: bytes, folder: Path) -> np.ndarray:
    (folder / "shown.png").write_bytes(made)
    return oiio.ImageBuf(str(folder / "shown.png")).get_pixels(oiio.UINT8)


def test_color_is_shown_as_srgb_of_its_space(tmp_path):
    gray = np.full((8, 8, 3), 0.18, np.float32)
    assert np.abs(shown(png(buffer(gray, space="lin_rec709_scene")), tmp_path).astype(int) - 118).max() <= 1
    np.testing.assert_array_equal(shown(png(buffer(gray)), tmp_path), 46)
    gold = np.float32([[[1.0, 0.5, 0.0, 1.0]]])  # alpha is not shown
    assert shown(png(buffer(gold)), tmp_path).shape == (1, 1, 3)


def test_a_large_image_is_shown_small(tmp_path):
    assert shown(png(buffer(np.zeros((300, 3000, 3)))), tmp_path).shape == (51, SIDE, 3)
    assert shown(png(ids(np.ones((600, 700)))), tmp_path).shape[1] <= SIDE


def test_data_and_labels_are_made_visible(tmp_path):
    ramp = np.linspace(-1, 3, 64).reshape(8, 8, 1)
    ramp[0, 0] = np.nan
    seen = shown(png(buffer(ramp, space="data")), tmp_path)
    assert seen[0, 1].max() < 10 and seen[-1, -1].min() == 255
    labels = shown(png(ids(np.arange(4).reshape(2, 2))), tmp_path).reshape(4, 3)
    assert len(np.unique(labels, axis=0)) == 4 and not labels[0].any()


def test_dicts_and_lists_of_images_have_captions():
    image = buffer(np.zeros((4, 4, 3)))
    page = figures({"tile": image, "<st>": image})
    assert re.findall("<figcaption>(.*?)</figcaption>", page) == ["tile", "&lt;st&gt;"]
    assert base64.b64decode(re.search(r"base64,(.*?)\"", page)[1]) == png(image)
    assert re.findall("<figcaption>(.*?)</figcaption>", figures([image, {"st": image}])) == ["0", "1 st"]
    assert [figures(other) for other in ({}, [], [1, image], {"a": image, "b": 1}, [[image]])] == [None] * 5


def test_the_notebook_is_made_by_its_program():
    assert notebook.NOTEBOOK.read_text() == notebook.text(), "run python -m tools.docs.notebook"


def test_the_notebook_runs_and_shows_its_results(tmp_path):
    nbclient, nbformat = pytest.importorskip("nbclient"), pytest.importorskip("nbformat")
    pytest.importorskip("ipykernel")
    made = nbformat.read(notebook.NOTEBOOK, 4)
    nbformat.validate(made)
    nbclient.NotebookClient(made, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    kinds = [set(cell.outputs[-1]["data"]) for cell in made.cells if cell.cell_type == "code"]
    assert [kind - {"text/plain"} for kind in kinds] == [{"image/png"}] * 2 + [{"text/html"}] * 2 + [set()]
    assert (tmp_path / "tile.png").exists()
