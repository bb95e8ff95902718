# SPDX-License-Identifier: Apache-2.0
"""--texlabelview on what is no result of --texlabel: superpixels, behind their photo or alone."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from oiiotex.engine.core.image import from_buffer
from oiiotex.engine.core.label_map import LabelMap, label_maps
from oiiotex.engine.errors import ImageError
from oiiotex.engine.run import run
from oiiotex.engine.session import Session
from oiiotex.filters.texlabelview import _title
from tests.analysis.test_labels import buffer, quarters
from tests.conftest import load, oiiotex, save

NOTHING = np.zeros((1, 1), np.int64)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("view")
    save(quarters(128)[0], made / "photo.png")
    return made


def view(folder, *words: str) -> np.ndarray:
    done = oiiotex(*words, "--texlabelview", "-o", "view.png", cwd=folder)
    assert done.returncode == 0, done.stderr
    return load(folder / "view.png").astype(int)


@pytest.mark.slow
def test_superpixels_behind_their_photo_are_shown(folder):
    shown = view(folder, "photo.png", "--texsuperpixel:count=40:photo=1")
    alone = view(folder, "photo.png", "--texsuperpixel:count=40")
    assert shown.shape[1] > alone.shape[1] + 128  # a panel more: the photo
    done = oiiotex("photo.png", "--texsuperpixel:count=40:photo=1", "-o", "cells.exr", cwd=folder)
    assert done.returncode == 0, done.stderr
    # from a file, too; drawn text may end one step apart, and the photo has become half
    assert np.abs(view(folder, "cells.exr") - shown).max() <= 1


@pytest.mark.slow
def test_superpixels_beside_labels_have_a_panel_and_no_place_in_the_tree(folder):
    labels = view(folder, "photo.png", "--texlabel:photo=1")
    both = view(folder, "photo.png", "--texsuperpixel:count=40:photo=1", "--texlabel:photo=1")
    count = len(filters.label(buffer(quarters(128)[0])))
    panels = 1 + count  # photo and levels, three in a row; then superpixels
    assert both.shape[1] - labels.shape[1] in ((0,) if panels >= 3 else (220 + 12,))
    tree = np.s_[12 : 12 + 64 * count + 14, -12 - 320 : -12]
    assert np.abs(both[tree] - labels[tree]).max() <= 1


def test_titles_say_what_is_shown():
    photo = from_buffer(buffer(quarters(96)[0]))
    cells = run(filters.op_named("superpixel")(source=photo, count=40, photo=True), Session())[0].image.parts[1]
    assert _title(LabelMap(cells, 0), NOTHING) == "superpixels: 40 superpixels at 15 px"
    level = label_maps(run(filters.op_named("label")(source=photo), Session())[0].image)[1]
    assert level.count and level.scale
    assert _title(level, NOTHING) == f"label.1: {level.count} labels at {level.scale:.0f} px"


def test_ids_of_three_channels_are_a_picture():
    """A photo that is stored as 32-bit whole numbers is no label map."""
    spec = oiio.ImageSpec(8, 8, 3, oiio.UINT32)
    picture = oiio.ImageBuf(spec)
    with pytest.raises(ImageError, match="no label parts"):
        filters.labelview(picture)
