# SPDX-License-Identifier: Apache-2.0
"""Finite in, finite out: half files clamp with one warning, and every filter keeps odd images finite."""

import logging
import shlex

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from oiiotex.engine.core.op import Op
from oiiotex.engine.errors import Error
from oiiotex.oiiotool.cli.running.line_run import run
from tests.any_filter import apply, buffer, of


def written(path, pixels):
    buffer = oiio.ImageBuf(oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], oiio.FLOAT))
    buffer.set_pixels(buffer.roi, pixels)
    assert buffer.write(str(path))


@pytest.mark.parametrize("op", ["", "--addc 1", "--iscolorspace ACEScg --texlab --texlab:inverse=1"])
def test_half_clamps_with_one_warning(tmp_path, caplog, op):
    pixels = np.linspace(-2e5, 2e5, 300 * 20 * 3, dtype=np.float32).reshape(300, 20, 3)
    written(tmp_path / "a.exr", pixels)
    with caplog.at_level(logging.WARNING, "oiiotex"):
        assert run(shlex.split(f"--noprogress a.exr {op} -d half -o o.exr"), tmp_path) == 0
    stored = oiio.ImageBuf(str(tmp_path / "o.exr"))
    assert stored.spec().format == oiio.HALF
    assert np.isfinite(stored.get_pixels(oiio.FLOAT)).all()
    assert stored.get_pixels(oiio.FLOAT).max() == 65504
    assert sum("beyond the range of half" in record.getMessage() for record in caplog.records) == 1


def test_an_infinite_value_stays_infinite_and_float_is_not_clamped(tmp_path):
    written(tmp_path / "a.exr", np.array([[[np.inf, 1e6, -1e6]]], np.float32))
    assert run(shlex.split("a.exr -o f.exr -d half -o h.exr"), tmp_path) == 0
    for name, expected in (("h", (np.inf, 65504, -65504)), ("f", (np.inf, 1e6, -1e6))):
        assert tuple(oiio.ImageBuf(str(tmp_path / f"{name}.exr")).get_pixels(oiio.FLOAT).ravel()) == expected


# --- filters ---


def odd_images() -> dict[str, np.ndarray]:
    """Finite pictures of 72 x 64 that have broken arithmetic elsewhere."""
    y, x = np.indices((64, 72), np.float32)
    random = np.random.default_rng(4).random((64, 72, 3), np.float32)
    rings = (np.sin(np.hypot(x - 30, y - 40) / 2)[..., None] > 0.7) * np.float32(60000) + random
    glow = np.concatenate([random * 1e-4, np.full((64, 72, 1), 1e-4, np.float32)], -1)
    alphas = np.concatenate([random, (x > 30)[..., None] * (y / 64)[..., None]], -1).astype(np.float32)
    return {
        "rings": rings,
        "glow": glow,
        "alphas": alphas,
        "negative": random - 0.5,
        "tiny": random * 1e-30,
        "huge": random * 1e30,
        "saturated": random * np.array([1, 0, 0], np.float32),
        "black": np.zeros((64, 72, 3), np.float32),
        "constant": np.full((64, 72, 3), 0.25, np.float32),
        "one light": (random > 0.9997) * np.float32(1e6),
    }


ODD = odd_images()
SHORT = ("rings", "glow")
TRIED = [pytest.param(name, marks=() if name in SHORT else pytest.mark.slow) for name in ODD]


@pytest.mark.parametrize("odd", TRIED)
@of(list(filters.FILTERS))
def test_a_filter_keeps_finite_values_finite(op: type[Op], odd: str):
    pixels = ODD[odd]
    names = ("R", "G", "B", "A")[: pixels.shape[2]]
    photo = buffer(pixels, space="lin_rec709_scene", names=names)
    try:
        made = apply(op, photo)
    except Error as error:
        assert "internal" not in str(error)
        return
    for result in made if isinstance(made, list) else [made]:
        assert np.isfinite(np.asarray(result, np.float64)).all()
