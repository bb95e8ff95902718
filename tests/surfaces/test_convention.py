# SPDX-License-Identifier: Apache-2.0
"""The convention of normals is measured: never wrong, and open where a map does not tell."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import uniform_filter

from oiiotex.engine.core.image import from_buffer
from oiiotex.surfaces.capture.convention import Convention, convention_of
from tests.any_filter import buffer
from tests.pictures import noise
from tests.reference import reliefs

SIDE = 96
RELIEFS = {
    "hills": reliefs.hills(SIDE, 5), "stones": reliefs.stones(SIDE, 1), "courses": reliefs.courses(SIDE),
    "rough": reliefs.hills(SIDE, 2, slope=1.5), "flat": reliefs.hills(SIDE, 3, slope=0.03),
}  # fmt: skip
OTHER = {"opengl": "directx", "directx": "opengl"}


def encoded(vectors: np.ndarray) -> np.ndarray:
    return np.rint(255 * (0.5 + 0.5 * vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))) / 255


def flipped(normals: np.ndarray) -> np.ndarray:
    return np.dstack([normals[..., 0], 1 - normals[..., 1], normals[..., 2]])


def compressed(normals: np.ndarray) -> np.ndarray:
    """As by a JPEG: red and green share their finest detail, colors have half the resolution."""
    light = normals @ [0.299, 0.587, 0.114]
    return np.clip(uniform_filter(normals - light[..., None], (2, 2, 1)) + light[..., None], 0, 1)


def measured(normals: np.ndarray, height: np.ndarray | None = None) -> Convention:
    return convention_of(*(from_buffer(buffer(each, space="data", names=None)) for each in (
        [normals] if height is None else [normals, height[..., None]])
    ))  # fmt: skip


@pytest.mark.parametrize("name", RELIEFS)
def test_the_slopes_tell_the_convention(name):
    normals = encoded(reliefs.normals(RELIEFS[name]))
    cases = [normals, encoded(reliefs.normals(np.rot90(RELIEFS[name]))), compressed(normals), normals[:40, :37]]
    for case in cases:
        assert (measured(case).hand, measured(flipped(case)).hand) == ("opengl", "directx")
        assert np.isclose(measured(case).no_curl, -measured(flipped(case)).no_curl, atol=0.02)


@pytest.mark.parametrize("name", ["hills", "stones"])
def test_heights_tell_it_even_if_they_are_inverted(name):
    normals, height = encoded(reliefs.normals(RELIEFS[name])), RELIEFS[name]
    for sign in (1, -1):
        found = measured(normals, sign * height)
        assert (found.hand, found.by, found.inverted) == ("opengl", "heights", sign < 0)
        assert measured(flipped(normals), sign * height).hand == "directx"
        assert found.ratio > 0.3


def silent() -> dict[str, np.ndarray]:
    """Maps that do not tell."""
    hills = RELIEFS["hills"]
    turned = np.rot90(encoded(reliefs.normals(hills)))  # the pixels, but not their vectors
    grain = encoded(np.dstack([noise(SIDE, SIDE, n) - 0.5 for n in (1, 2)] + [np.ones((SIDE, SIDE))]))
    alike = encoded(np.dstack([hills, hills, 20 * np.ones_like(hills)]))  # red and green are the same
    half = encoded(reliefs.normals(hills))
    mixed = np.concatenate([half[: SIDE // 2], flipped(half)[SIDE // 2 :]])
    level = np.full((SIDE, SIDE, 3), [0.5, 0.5, 1.0])
    waves = encoded(reliefs.normals(np.sin(np.arange(SIDE) / 3)[:, None] * np.ones(SIDE)))
    names = ("turned", "flipped", "grain", "alike", "mixed", "level", "waves", "tiny", "one")
    return dict(zip(
        names, (turned, flipped(turned), grain, alike, mixed, level, waves, half[:2, :2], half[..., :1]), strict=True
    ))  # fmt: skip


@pytest.mark.parametrize("name", silent())
def test_maps_that_do_not_tell_leave_it_open(name):
    assert (measured(silent()[name]).hand, measured(silent()[name]).by) == ("", "")


def test_heights_of_another_surface_or_size_say_nothing():
    normals = encoded(reliefs.normals(RELIEFS["hills"]))
    assert measured(normals, RELIEFS["stones"]).by == "slopes"
    assert measured(normals, np.zeros((8, 8))).by == "slopes"
    assert measured(normals, flipped(np.dstack([RELIEFS["hills"]] * 3))[::-1, :, 0]).hand in ("", "opengl")
