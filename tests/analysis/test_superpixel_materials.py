# SPDX-License-Identifier: Apache-2.0
"""Materials: split where there are two modes, and not where there is one."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from oiiotex.analysis.segmentation.superpixel_materials import divided
from tests.analysis.test_labels import buffer


@pytest.mark.parametrize("seed", range(2))
def test_one_mode_is_left_whole_whatever_its_shape(seed):
    random = np.random.default_rng(seed)
    shapes = random.normal(0, 9, (2500, 4)), random.random((2500, 4)) * 40, random.gamma(3, 5, (2500, 4))
    assert all(divided(points, 50) is None for points in shapes)
    assert divided(np.full((300, 4), 7.0), 5) is None


def test_two_modes_are_split_between_them_on_any_axis():
    random = np.random.default_rng(0)
    points, second = random.normal(0, 5, (2000, 4)), np.arange(2000) % 5 == 0
    points[second, 1] += 25
    upper = divided(points, 50)
    assert upper is not None and (upper == second).mean() > 0.98
    assert divided(points, 500) is None  # the smaller one is too small
    alike = random.normal(0, 30, (2000, 1)) + random.normal(0, 3, (2000, 2))
    alike[second] += 10, -10
    upper = divided(alike, 50)  # only the difference of the two has two modes
    assert upper is not None and max((upper == second).mean(), (upper != second).mean()) > 0.95


def test_materials_of_one_color_are_told_apart_by_texture():
    rough = np.indices((144, 144)).sum(0) // 48 % 2 == 0
    noise = np.random.default_rng(0).normal(0, 1, (144, 144, 1))
    made = filters.label(
        buffer(np.clip(0.5 + noise * np.where(rough, 0.15, 0.01)[..., None], 0, 1)), coarsest="materials"
    )
    labels = list(made.values())[-1].get_pixels(oiio.UINT32)[..., 0].astype(np.int64)
    table = np.histogram2d(rough.ravel(), labels.ravel(), [2, labels.max()])[0]
    assert labels.max() >= 2 and table.max(0).sum() > 0.85 * labels.size


def test_interspersed_materials_are_a_level_and_one_material_is_none():
    y, x = np.mgrid[0:144, 0:144]
    stones = (y % 32 < 22) & (x % 48 < 36)
    noise = np.random.default_rng(0).normal(0, 0.03, (144, 144, 1))
    picture = np.where(stones[..., None], [0.45, 0.35, 0.3], [0.75, 0.72, 0.65]) + noise
    made = filters.label(buffer(np.clip(picture, 0, 1)), coarsest="materials")
    labels = list(made.values())[-1].get_pixels(oiio.UINT32)[..., 0].astype(np.int64)
    table = np.histogram2d(stones.ravel(), labels.ravel(), [2, labels.max()])[0]
    assert labels.max() >= 2 and table.max(0).sum() > 0.85 * labels.size > table.sum(1).max() * 1.2
    plain = buffer(np.full((144, 144, 3), 0.5) + noise)
    assert list(filters.label(plain, coarsest="materials")) == list(filters.label(plain))
