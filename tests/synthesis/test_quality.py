# SPDX-License-Identifier: Apache-2.0
"""What the filter is for, on real photographs: slow sweeps behind a marker."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio
import pytest
from skimage import color

from benchmarks.shared import measures
from benchmarks.tiles import drifts
from oiiotex import filters
from oiiotex.analysis.stationarity.costs import stationarity_cost
from oiiotex.engine.color.lab import working_values
from oiiotex.engine.core.image import from_buffer
from oiiotex.engine.session import Session
from oiiotex.synthesis.quality.fidelity import FAIR
from tests.conftest import data_folder
from tools.demo import gravel, save, stained

pytestmark = pytest.mark.slow


def test_the_demos_gravel_loses_gradient_and_stain_and_keeps_its_detail(tmp_path):
    clean = gravel().astype(np.float64)
    save(stained(gravel()), tmp_path / "photo.png")
    photo = oiio.ImageBuf(str(tmp_path / "photo.png"))
    tiles = [filters.stationarize(photo, seed=seed).get_pixels(oiio.UINT8) for seed in range(12)]
    wrap_x, wrap_y, _, sharp, contrast = np.mean([measures.tile_figures(tile, clean) for tile in tiles], axis=0)
    # 50 is the middle, thirty seeds have 65 and 60; one spreads by 27, the mean of 24 by 6. A seam in x alone has 80.
    assert (wrap_x + wrap_y) / 2 < 75
    labs = [color.rgb2lab(picture) for picture in (gravel()[..., None].repeat(3, 2), photo.get_pixels(oiio.UINT8))]
    gone = [drifts.drift_gone(color.rgb2lab(tile), *labs) for tile in tiles]
    assert min(share for share in gone if share is not None) > 0.9
    assert 0.95 <= sharp <= 1.05
    assert contrast >= 0.95


def cost(tile: oiio.ImageBuf, session: Session) -> float:
    """MJH17 eq. 1, at the paper's sigma."""
    lab = working_values(from_buffer(tile), session.resources)[0]
    return stationarity_cost(lab, max(lab.shape[:2]) / 32)


def test_photos_become_more_stationary_than_toroidal_patchmatch_makes_them():
    """By the letter of the paper; by default structures up to an eighth of the photo are kept."""
    session, ways = Session(), {"stationarize": {"paper": True}, "patchmatch": {}}
    won, ratios = [], []
    for path in sorted((data_folder() / "photos").iterdir()):
        photo = measures.load(path, 160)
        ours, baseline = (
            cost(getattr(filters, op)(photo, seed=1, session=session, **more), session) for op, more in ways.items()
        )
        won.append(ours < baseline)
        ratios.append(ours / baseline)
    assert np.mean(won) >= 0.95
    assert np.median(ratios) < 0.55


def test_the_papers_baseline_has_its_patches_and_its_pyramid():
    photo = from_buffer(measures.load(sorted((data_folder() / "photos").iterdir())[0], 64))
    ours, papers, small = (
        filters.op_named("patchmatch")(exemplar=photo, **given).recipe(64, 64)
        for given in ({}, {"paper": True}, {"paper": True, "patch": 5})
    )
    assert (papers.patch, papers.literal, small.patch) == (11, True, 5) and not ours.literal
    assert papers.sigma is ours.sigma is None


def test_the_default_keeps_what_photos_are_made_of():
    """Of the photos in the data all but a barrel's side are textures; a brick wall in perspective is not in them."""
    session, found = Session(), {}
    for path in sorted((data_folder() / "photos").iterdir()):
        made = filters.stationarize(measures.load(path, 256), seed=1, session=session)
        found[path.stem] = float(made.spec().get_string_attribute("oiiotex:fidelity"))
    assert np.mean([value >= FAIR for value in found.values()]) >= 0.9, found
