# SPDX-License-Identifier: Apache-2.0
"""What only moves pixels moves bytes: equal bits for every pixel type, and for files with several types."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex.engine.errors import Error
from oiiotex.oiiotool.cli.running.line_run import run

WIDTH, HEIGHT = 13, 9
TYPES = {"uint8": "tif", "uint16": "tif", "uint32": "tif", "int32": "tif", "float16": "exr", "float32": "exr"}


def moved(pixels: np.ndarray, step: str) -> np.ndarray:
    """The result of each line of `STEPS`, by numpy."""
    return {
        "": lambda p: p,
        "--flip": lambda p: p[::-1],
        "--flop": lambda p: p[:, ::-1],
        "--rotate90": lambda p: np.rot90(p, -1),
        "--rotate180": lambda p: np.rot90(p, 2),
        "--rotate270": lambda p: np.rot90(p, 1),
        "--transpose": lambda p: p.swapaxes(0, 1),
        "--orientation 6 --reorient": lambda p: np.rot90(p, -1),
        "--cshift +5-2": lambda p: np.roll(p, (-2, 5), (0, 1)),
        "--cut 7x5+3+2": lambda p: p[2:7, 3:10],
        "--crop 7x5+3+2 --origin +0+0 --fullpixels": lambda p: p[2:7, 3:10],
        "--fit 13x9": lambda p: p,
        "--ch 0,0,0 --ch 1": lambda p: p,
        "--dup --chappend --ch 1": lambda p: p,
        "--dup --paste +0+0": lambda p: p,
        "--dup --mosaic 2x1 --cut 13x9+13+0": lambda p: p,
        "--dup --pastemeta": lambda p: p,
        "--nchannels 2 --nchannels 1": lambda p: p,
    }[step](pixels)


STEPS = [
    "", "--flip", "--flop", "--rotate90", "--rotate180", "--rotate270", "--transpose", "--orientation 6 --reorient",
    "--cshift +5-2", "--cut 7x5+3+2", "--crop 7x5+3+2 --origin +0+0 --fullpixels", "--fit 13x9", "--ch 0,0,0 --ch 1",
    "--dup --chappend --ch 1", "--dup --paste +0+0", "--dup --mosaic 2x1 --cut 13x9+13+0", "--dup --pastemeta",
    "--nchannels 2 --nchannels 1",
]  # fmt: skip


def any_bits(dtype: str) -> np.ndarray:
    """Random bits: large ids, NaN with payloads, denormal numbers."""
    kind = np.dtype(dtype)
    bits = np.random.default_rng(5).integers(0, 256, (HEIGHT, WIDTH, kind.itemsize), np.uint8)
    return np.ascontiguousarray(bits).view(kind).reshape(HEIGHT, WIDTH, 1)


def written(path: Path, pixels: np.ndarray, kinds: tuple[str, ...] = (), names: tuple[str, ...] = ("id",)) -> None:
    """A file with these pixels, by OpenImageIO alone."""
    kind = {"float16": "half", "float32": "float", "uint32": "uint", "int32": "int"}
    spec = oiio.ImageSpec(WIDTH, HEIGHT, len(names), oiio.TypeDesc(kind.get(str(pixels.dtype), str(pixels.dtype))))
    spec.channelnames = names
    spec.channelformats = tuple(map(oiio.TypeDesc, kinds))
    out = oiio.ImageOutput.create(str(path))
    assert out.open(str(path), spec) and out.write_image(np.ascontiguousarray(pixels)) and out.close()


def bits_of(path: Path, channel: int = 0) -> np.ndarray:
    """The bits of a channel, in the type of the file."""
    file = oiio.ImageInput.open(str(path))
    kind = file.spec().channelformat(channel)
    pixels = file.read_image(0, 0, channel, channel + 1, kind)
    return pixels.reshape(file.spec().height, file.spec().width).view(f"u{pixels.dtype.itemsize}")


@pytest.mark.parametrize("dtype", TYPES)
@pytest.mark.parametrize("step", STEPS)
def test_bits_are_equal(tmp_path, dtype, step):
    pixels, end = any_bits(dtype), TYPES[dtype]
    written(tmp_path / f"in.{end}", pixels)
    assert run([f"in.{end}", *step.split(), "-o", f"out.{end}"], tmp_path) == 0
    source = bits_of(tmp_path / f"in.{end}")
    np.testing.assert_array_equal(bits_of(tmp_path / f"out.{end}"), moved(source, step))


@pytest.mark.parametrize("step", ["", "--flip", "--rotate90", "--cut 7x5+3+2", "--cshift +5-2"])
def test_a_file_of_several_types_keeps_small_ids_and_refuses_to_round_large_ones(tmp_path, step):
    pixels = np.zeros((HEIGHT, WIDTH, 3), np.uint32)
    pixels[..., 2] = np.random.default_rng(1).integers(0, 1 << 24, (HEIGHT, WIDTH))
    pixels[..., :2] = 1 << 31
    written(tmp_path / "small.exr", pixels, ("half", "float", "uint"), ("A", "Z", "id"))
    pixels[0, 0, 2] = (1 << 31) + 1
    written(tmp_path / "large.exr", pixels, ("half", "float", "uint"), ("A", "Z", "id"))
    assert run(["small.exr", *step.split(), "-o", "out.exr"], tmp_path) == 0
    for channel in range(3):
        source = bits_of(tmp_path / "small.exr", channel)
        np.testing.assert_array_equal(bits_of(tmp_path / "out.exr", channel), moved(source, step))
    with pytest.raises(Error, match=r"id: integers above 2\^24 .* --ch id"):
        run(["large.exr", *step.split(), "-o", "no.exr"], tmp_path)
    assert not (tmp_path / "no.exr").exists()
    assert run(["large.exr", "--ch", "id", *step.split(), "-o", "ids.exr"], tmp_path) == 0  # as the error says
    np.testing.assert_array_equal(bits_of(tmp_path / "ids.exr"), moved(bits_of(tmp_path / "large.exr", 2), step))
    assert run(["large.exr", "--ch", "A,Z", *step.split(), "-o", "others.exr"], tmp_path) == 0


def test_iff_keeps_float_depth_beside_16_bit_color(tmp_path):
    words = "--pattern constant:color=0.25,0.5,0.75,1,7.5 16x16 5 --chnames R,G,B,A,Z -d uint16 -d Z=float -o m.iff"
    assert run(words.split(), tmp_path) == 0
    for step in ([], ["--flop"]):
        assert run(["m.iff", *step, "-o", "m.exr"], tmp_path) == 0
        assert oiio.ImageBuf(str(tmp_path / "m.exr")).getpixel(3, 3)[4] == 7.5


def test_ids_are_not_pasted_over_pixels_of_another_type(tmp_path):
    written(tmp_path / "ids.tif", any_bits("uint32"))
    written(tmp_path / "gray.tif", any_bits("uint8"))
    with pytest.raises(Error, match="ids cannot be combined with pixels of another type"):
        run(["ids.tif", "gray.tif", "--paste", "+1+1", "-o", "no.tif"], tmp_path)


AVERAGING = """--resize 50%|--resample 50%|--fit 5x5|--rotate 30|--warp 0.5,0,0,0,0.5,0,0,0,1|--blur 3x3|--median 3x3
--dilate 3x3|--unsharp|--laplacian|--pixelaspect 2|--fillholes|--mosaic:fit=8x8 1x1|-otex
--texrectify:corners=1,1,9,2,9,8,1,7|--texzoom:data=1:frame=2""".replace("\n", "|")


@pytest.mark.parametrize("step", AVERAGING.split("|"))
@pytest.mark.parametrize("dtype", ["uint32", "int32"])
def test_ids_are_not_averaged(tmp_path, dtype, step):
    written(tmp_path / "in.tif", any_bits(dtype))
    with pytest.raises(Error, match=r"32-bit integers are ids.*--resample:interp=0.*-i:type=float"):
        run(["in.tif", *step.split(), *(() if step == "-otex" else ("-o",)), "no.tif"], tmp_path)
    assert not (tmp_path / "no.tif").exists()


@pytest.mark.parametrize("dtype", TYPES)
def test_the_nearest_pixel_is_a_copy(tmp_path, dtype):
    end = TYPES[dtype]
    written(tmp_path / f"in.{end}", any_bits(dtype))
    assert run([f"in.{end}", "--resample:interp=0", "26x3", "-o", f"out.{end}"], tmp_path) == 0
    source = bits_of(tmp_path / f"in.{end}")
    np.testing.assert_array_equal(bits_of(tmp_path / f"out.{end}"), source[1::3, np.arange(26) // 2])


def test_numbers_that_are_no_ids_are_resized_on_request(tmp_path):
    written(tmp_path / "in.tif", np.full((HEIGHT, WIDTH, 1), 1 << 31, np.uint32))
    words = "-i:type=float in.tif --resize 5x5 -d float -o out.tif"
    assert run(words.split(), tmp_path) == 0
    np.testing.assert_allclose(oiio.ImageBuf(str(tmp_path / "out.tif")).get_pixels(oiio.FLOAT), 0.5, rtol=1e-6)
