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
from tests.any_filter import buffer, of, operands, settings

pytestmark = pytest.mark.usefixtures("few_places")


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
    """Finite pictures of 72 x 64 that have broken arithmetic elsewhere: (height, width, channels), alpha is the 4th."""
    y, x = np.indices((64, 72), np.float32)
    random = np.random.default_rng(4).random((64, 72, 3), np.float32)
    far = np.hypot(x - 30, y - 40)[..., None]
    rings = (np.sin(far / 2) > 0.7) * np.float32(60000) + random
    left = (x < 36)[..., None]
    card = np.where(left, np.float32(x // 9)[..., None] / 3 * np.eye(3, dtype=np.float32)[np.int32(y // 8) % 3], random)

    def over(alpha: np.ndarray | float, colors: np.ndarray = random) -> np.ndarray:
        return np.concatenate([colors, np.broadcast_to(alpha, (64, 72, 1))], -1)

    def lit(*places: tuple[int, int]) -> np.ndarray:
        pixels = np.zeros((64, 72, 3))
        for row, column in places:
            pixels[row, column] = 1
        return pixels

    images = {
        "rings": rings,
        "glow": over(1e-4, random * 1e-4),
        "alphas": over((left == 0) * (y / 64)[..., None]),
        "negative": random - 0.5,
        "tiny": random * 1e-30,
        "huge": random * 1e30,
        "saturated": random * np.array([1, 0, 0]),
        "black": np.zeros((64, 72, 3)),
        "constant": np.full((64, 72, 3), 0.25),
        "one light": (random > 0.9997) * 1e6,
        "all negative": -1 - random,
        "one negative channel": random * [1, -1, 1],
        "near black": random * 1e-4,
        "denormal": random * 1e-40,
        "float limit": random * 3.4e38,
        "negative float limit": (2 * random - 1) * np.float32(3.4e38),
        "half limit": 65504 * (random > 0.5),
        "beyond half": 65504 + 1e5 * random,
        "white": np.ones((64, 72, 3)),
        "bright constant": np.full((64, 72, 3), 1e5),
        "negative constant": np.full((64, 72, 3), -0.1),
        "constant but a pixel": 0.5 + lit((20, 20)),
        "black but a pixel": lit((63, 71)),
        "black but two lights": 1e8 * lit((0, 0), (63, 71)),
        "line across": 0.2 + (y == 31)[..., None] * random,
        "line down": 0.2 + (x == 36)[..., None] * np.float32(1000) * random,
        "two halves": np.where(left, 0.0, 1.0) * np.ones(3),
        "two halves, high contrast": np.where(left, 1e-6, 1e6) * np.ones(3),
        "checks": ((x + y) % 2)[..., None] * np.ones(3),
        "stripes": (x % 2)[..., None] * np.array([1, 0, 1]),
        "ramp": (x / 71)[..., None] * np.ones(3),
        "steep ramp": 10.0 ** ((x - 36) / 6)[..., None] * np.ones(3),
        "test card": card,
        "primaries": np.eye(3)[np.int32(x // 24)],
        "negative primaries": 1.2 * np.eye(3)[np.int32(x // 24)] - 0.1,
        "alpha 0": over(0.0),
        "alpha 0, huge colors": over(left * 1.0, np.where(left, random, 1e30)),
        "alpha above 1": over(1 + left * 3.0),
        "negative alpha": over(random[..., :1] - 0.5),
        "glow in the dark": over(np.exp(-far / 4), random * np.exp(-far / 4)),
    }
    return {name: pixels.astype(np.float32) for name, pixels in images.items()}


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
        made = getattr(filters, op.name)(*operands(op, photo), **settings(op))
    except Error as error:
        assert "internal" not in str(error)
        return
    for name, result in made.items() if isinstance(made, dict) else [("", made)]:
        if isinstance(result, oiio.ImageBuf):
            assert np.isfinite(result.get_pixels(oiio.FLOAT)).all(), name
