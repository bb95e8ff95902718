# SPDX-License-Identifier: Apache-2.0
"""The measures of benchmarks.tiles.first_tile, on textures whose figures are known."""

from __future__ import annotations

import numpy as np
import pytest
from skimage import color

from benchmarks.tiles import drifts, first_tile

SIDE = 160


@pytest.fixture(scope="module")
def clean() -> np.ndarray:
    """Soft blobs that wrap, in all bands, of one even density: (h, w, 3) uint8."""
    random = np.random.default_rng(0)
    noise = sum(drifts.blurred(random.normal(size=(SIDE, SIDE, 3)), s, True) * s for s in (1, 2, 4, 8))
    noise -= drifts.blurred(noise, SIDE / 12, True)
    return np.clip(128 + 60 * noise / noise.std() * (0.5, 0.4, 0.3), 0, 255).astype(np.uint8)


def figures(tile: np.ndarray, clean: np.ndarray, photo: np.ndarray) -> dict:
    return first_tile.measured(tile, drifts.Clean.of(clean), color.rgb2lab(photo))


def test_a_texture_has_its_own_energies_and_width(clean):
    lab = color.rgb2lab(clean)
    known = drifts.Clean.of(clean)
    found = figures(clean, clean, clean)
    # the clean texture is measured as a photo, whose borders are reflected: a few percent
    np.testing.assert_allclose(found["bands"], 1, atol=0.08)
    assert found["width"] == pytest.approx(1, abs=0.03) and found["spread"] == 1
    assert found["gone"] is None and found["seam"] < 1.1
    np.testing.assert_array_equal(drifts.band_energies(lab, SIDE, False), known.bands)


def test_a_blurred_texture_has_less_energy_and_a_wider_correlation(clean):
    soft = drifts.blurred(clean.astype(float), SIDE / 40, True).round().astype(np.uint8)
    found = figures(soft, clean, clean)
    assert found["bands"][0] < 0.75 and found["bands"][0] < found["bands"][2] < 1
    assert found["width"] > 1.3 and found["spread"] < 0.8


def test_the_half_width_of_blurred_noise_is_known():
    noise = np.random.default_rng(2).normal(size=(2 * SIDE, 2 * SIDE, 3))
    for sigma in (2, 4):  # its autocorrelation is exp(-r^2 / 4 sigma^2)
        width = drifts.half_width(drifts.blurred(noise, sigma, True), 2 * SIDE, True)
        assert width == pytest.approx(2 * sigma * np.log(2) ** 0.5, rel=0.05)


@pytest.mark.parametrize("name", [name for name, added in drifts.DRIFTS.items() if added])
def test_a_drift_that_stays_is_not_gone(clean, name):
    photo = drifts.drifted(clean, name)
    assert figures(photo, clean, photo)["gone"] == 0
    assert figures(clean, clean, photo)["gone"] == 1
    between = (photo.astype(int) + clean) // 2
    assert (
        0.6 < figures(between.astype(np.uint8), clean, photo)["gone"] < 0.85
    )  # half of it has a quarter of its energy


def test_no_drift_leaves_the_texture_as_it_is(clean):
    np.testing.assert_array_equal(drifts.drifted(clean, "none"), clean)


def test_a_region_that_is_pasted_is_seen_again():
    random = np.random.default_rng(1)
    lab = drifts.blurred(random.normal(size=(SIDE, SIDE, 3)), 1, True) * 40
    assert drifts.copies_seen(lab, SIDE, True) == drifts.copies_seen(lab, SIDE, False) == 0
    twice, often = lab.copy(), np.tile(lab[: SIDE // 2, : SIDE // 2], (2, 2, 1))
    twice[:, SIDE // 2 :] = lab[:, : SIDE // 2]
    assert drifts.copies_seen(twice, SIDE, True) == 1
    assert drifts.copies_seen(often, SIDE, True) == 3  # of four quarters the others
    assert 0 < drifts.copies_seen(twice, SIDE, False) <= 1


def test_halves_do_not_depend_on_folders_and_share_the_textures():
    halves = [drifts.half_of(name) for name in drifts.EVEN]
    assert halves == [drifts.half_of(f"/elsewhere/{name}") for name in drifts.EVEN]
    assert all(halves.count(half) >= len(halves) // 3 for half in drifts.HALVES)


def test_a_table_counts_refused_tiles_as_not_kept():
    known = {"gone": None, "width": 1.0, "seam": 1.0, "spread": 1.0, "shown": None, "copies": 0.5, "copies_clean": 0.0}
    rows = [{**known, "bands": b, "seconds": 1.0} for b in ([1.0, 1.0, 1.0], [1.0, 0.79, 1.0])]
    cases = [first_tile.Case(first_tile.Path(name), 320, "none", "default") for name in "abc"]
    text = first_tile.table(dict(zip(cases, [*rows, {"refused": "why"}], strict=True)))
    assert "| 1 of 3 |" in text and "| 0.90 (0.79 to 1.00) |" in text
