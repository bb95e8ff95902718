# SPDX-License-Identifier: Apache-2.0
"""Every number, size, place and kernel is held to 32 bits and to the memory budget before the work."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from oiiotex import filters
from oiiotex.engine.core.op import Op
from oiiotex.oiiotool import host
from tests.conftest import save
from tests.extremes import lines, try_all

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="forks, and limits of POSIX")


def by_flag(short: bool) -> pytest.MarkDecorator:
    ops = [op for op in (*host.OPS, *filters.OURS) if lines(op, short)]
    return pytest.mark.parametrize("op", ops, ids=[op.flag() for op in ops])


@pytest.fixture
def images(tmp_path: Path) -> Path:
    pixels = np.random.default_rng(0).random((40, 40, 3))
    save(pixels[:16, :16], tmp_path / "a.exr", "float", "lin_rec709_scene")
    save(pixels, tmp_path / "photo.exr", "float", "lin_rec709_scene")
    return tmp_path


@by_flag(short=True)
def test_what_has_done_harm_is_done_or_refused(images: Path, op: type[Op]) -> None:
    try_all(op, images, short=True, seconds=20)


@pytest.mark.slow
@by_flag(short=False)
def test_any_extreme_is_done_or_refused(images: Path, op: type[Op]) -> None:
    try_all(op, images, short=False, seconds=60)
