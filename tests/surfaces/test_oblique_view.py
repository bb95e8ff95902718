# SPDX-License-Identifier: Apache-2.0
"""The hint that a photo is oblique: against a camera that the tests make, and only where it was tried."""

from __future__ import annotations

import logging

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex.engine.core.image import from_buffer, from_pixels
from oiiotex.filters.texstationarize import Stationarize
from oiiotex.surfaces.capture import oblique_view
from oiiotex.surfaces.capture.oblique_view import OBLIQUE, scale_ratio
from oiiotex.synthesis.exemplar import synthesis_run
from oiiotex.synthesis.quality.fidelity import FAIR, GOOD
from tests import pictures
from tests.any_filter import buffer
from tests.conftest import made_by
from tests.surfaces.test_rectify import SHOT, shot, wall


def test_the_ratio_is_that_of_the_camera():
    seen, matrix = shot(wall(), 0.5, 0.1)
    width, height = SHOT
    corners = np.array([[0, 0, 1], [width, 0, 1], [width, height, 1], [0, height, 1]])
    scales = (corners @ np.linalg.inv(matrix))[:, 2]
    whole = scales.max() / scales.min()
    ratio = scale_ratio(100 * seen)
    assert 0.6 * (whole - 1) < ratio - 1 < 1.05 * (whole - 1)  # of complete cells
    assert ratio > OBLIQUE


def test_seen_from_the_front_it_is_one():
    assert scale_ratio(100 * shot(wall(), 0.0, 0.0)[0]) == pytest.approx(1, abs=0.06)


def test_sizes_without_a_lattice_prove_nothing():
    """Blobs that become larger downwards, as drops and waves do."""
    fine, coarse = (pictures.smooth_noise(240, 320, cells, 1) for cells in (40, 12))
    share = np.linspace(0, 1, 240)[:, None]
    assert scale_ratio(np.float32(100) * ((1 - share) * fine + share * coarse)[..., None].repeat(3, 2)) is None


def said(photo: np.ndarray, fidelity: float, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch) -> list:
    """Levels of the hints for a tile of that fidelity."""
    spec = oiio.ImageSpec(8, 8, 3, oiio.FLOAT)
    spec.attribute("oiiotex:fidelity", f"{fidelity:.3f}")
    tile = {"tile": from_pixels("tile", np.zeros((8, 8, 3), np.float32), spec)}
    monkeypatch.setattr(synthesis_run, "synthesized", lambda *_: tile)
    op = Stationarize(exemplar=from_buffer(buffer(photo, space="lin_rec709_scene")))
    with caplog.at_level(logging.INFO, "oiiotex"):
        caplog.clear()
        made_by(op)
    return [record.levelno for record in caplog.records if "--texrectify" in record.getMessage()]


def test_it_is_said_of_oblique_photos_whose_tile_is_not_good(caplog, monkeypatch):
    ratios: dict[bytes, float | None] = {}  # measuring one takes seconds

    def once(values: np.ndarray, opaque: np.ndarray | None) -> float | None:
        key = values.tobytes()
        if key not in ratios:
            ratios[key] = scale_ratio(values, opaque)
        return ratios[key]

    monkeypatch.setattr(oblique_view, "scale_ratio", once)
    oblique, front = (shot(wall(), turn, 0.1 * (turn > 0))[0] for turn in (0.5, 0.0))
    assert said(oblique, FAIR - 0.1, caplog, monkeypatch) == [logging.WARNING]
    assert said(oblique, FAIR + 0.05, caplog, monkeypatch) == [logging.INFO]
    assert said(oblique, GOOD + 0.05, caplog, monkeypatch) == []
    assert said(front, FAIR - 0.1, caplog, monkeypatch) == []
    assert len(ratios) == 2
