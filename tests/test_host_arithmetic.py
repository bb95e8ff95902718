# SPDX-License-Identifier: Apache-2.0
"""Arithmetic, ranges of values and compositing: the pixels of oiiotool."""

from __future__ import annotations

import shlex
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex.cli.running.line_run import run
from tests.conftest import load, save
from tests.inputs import write_inputs
from tests.peer import refused, same


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_inputs(tmp_path_factory.mktemp("arithmetic"))


WITH_VALUES = ("addc", "subc", "mulc", "divc", "absdiffc", "powc", "maxc", "minc")
ALPHA = ("premult", "unpremult", "repremult")
CHAINS = (
    # two images: other windows, channel counts, types
    *(f"rgba.exr b.exr --{op} -o OUT.exr" for op in ("add", "sub", "mul", "div", "absdiff", "min", "max", "over")),
    *(f"rgba.exr rgb.exr --{op} -o OUT.exr" for op in ("add", "sub", "mul", "div", "absdiff", "min")),
    *(f"rgb.exr rgba.exr --{op} -o OUT.exr" for op in ("add", "mul", "absdiff", "min")),
    "rgb8.png rgb.exr --add -o OUT.png",
    "--native rgb.exr rgb8.png --mul -o OUT.tif",
    "--native rgb8.png rgb8.png --add -o OUT.png",
    "--native rgb8.png --dup --flip --sub -o OUT.png",
    "rgba.exr --add b.exr -d half -o OUT.exr",
    "rgba.exr gray.exr --scale -o OUT.exr",
    "gray.exr rgba.exr --scale -o OUT.exr",
    "rgba.exr b.exr five.exr --ch R,G,B,A --mad -o OUT.exr",
    "rgb.exr rgb8.png rgb.exr --mad -o OUT.exr",
    "parts.exr rgb8.png --add:allsubimages=1 -o OUT.exr",
    "parts.exr rgb8.png --mul:subimages=1 -o OUT.exr",
    "parts.exr rgb8.png --mul -o OUT.exr",
    # values
    *(f"rgba.exr --{op} 0.3 -o OUT.exr" for op in WITH_VALUES),
    *(f"rgba.exr --{op} 0.3,0.2 -o OUT.exr" for op in WITH_VALUES),
    "rgb.exr --divc 0,2,-4 -o OUT.exr",
    "rgb8.png --mulc 1,2,3,4,5 -o OUT.png",
    "rgb.exr --cadd 0.1 --csub 0.2,0.1,0 --cmul 2 --cpow 2 -o OUT.exr",
    "parts.exr -a --addc 0.1 -o OUT.exr",
    # one image
    "rgba.exr --abs -o OUT.exr",
    "rgb.exr --invert -o OUT.exr",
    "rgba.exr --invert -o OUT.exr",
    "gray.exr --invert -o OUT.exr",
    "rgba.exr --invert:chbegin=3:chend=4 -o OUT.exr",
    "five.exr --invert:chbegin=1:chend=9 -o OUT.exr",
    "two.exr --polar -o OUT.exr",
    "two.exr --unpolar -o OUT.exr",
    "two.exr --polar --unpolar -d half -o OUT.exr",
    # ranges
    "rgba.exr --clamp -o OUT.exr",
    "rgba.exr --clamp:min=0:max=0.5 -o OUT.exr",
    "rgba.exr --clamp:min=0,0.1,0.2 -o OUT.exr",
    "rgba.exr --mulc 3 --clamp:max=0.4,0.5,0.6,0.7,0.8:clampalpha=1 -o OUT.exr",
    "rgb.exr --contrast:black=0.1:white=0.8 -o OUT.exr",
    "rgb.exr --contrast:black=0.1,0.2:white=0.9:min=0.2:max=0.7,0.8,0.9:clamp=1 -o OUT.exr",
    "rgba.exr --contrast:black=0.4:white=0.4 -o OUT.exr",
    "rgb8.png --contrast:scontrast=5:sthresh=0.4 -o OUT.png",
    "rgb.exr --saturate 0 -o OUT.exr",
    "five.exr --saturate 1.7 -o OUT.exr",
    *(f"{image} --{op} -o OUT.exr" for image in ("rgb.exr", "five.exr") for op in ("rangecompress", "rangeexpand")),
    *(f"rgba.exr --{op}:luma=1 -o OUT.exr" for op in ("rangecompress", "rangeexpand")),
    "two.exr --rangecompress:luma=1 -o OUT.exr",
    "rgb8.png --normalize:incenter=0.5:outcenter=0.5:scale=0.5 -o OUT.exr",
    "rgba.exr --normalize -o OUT.exr",
    "rgb.exr --noise -o OUT.exr",
    "rgba.exr --noise:type=gaussian:mean=0.1:stddev=0.3:seed=7 -o OUT.exr",
    "rgba.exr --noise:type=uniform:min=-0.1:max=0.2:mono=1 -o OUT.exr",
    "rgba.exr --noise:type=white:nchannels=2:seed=-3 -o OUT.exr",
    "rgb8.png --noise:type=salt:value=1:portion=0.2 -o OUT.png",
    *(f"{image} --fixnan {how} -o OUT.exr" for image in ("nan.exr", "nanhalf.exr") for how in ("black", "box3")),
    "--native nanhalf.exr --fixnan box3 -o OUT.exr",
    "rgb.exr --fixnan error -o OUT.exr",
    "rgb8.png --fixnan box3 -o OUT.png",
    # alpha
    *(f"{image} --{op} -o OUT.exr" for image in ("rgb.exr", "five.exr") for op in ALPHA),
    "rgba.exr --unpremult --repremult -o OUT.exr",
    "rgba8.png --unpremult -o OUT.png",
    "rgba8.png rgba.exr --over -o OUT.exr",
    "five.exr far.exr --over -o OUT.exr",
    "five.exr far.exr --zover -o OUT.exr",
    "five.exr --origin +7-2 far.exr --zover:zeroisinf=1 -o OUT.exr",
)  # fmt: skip


@pytest.mark.parametrize("chain", CHAINS)
def test_as_oiiotool(folder, chain):
    same(folder, *shlex.split(chain))


REFUSED = (
    ("rgb.exr --addc 0.1,x -o o.exr", "value=0.1,x: allowed is comma-separated list of numbers"),
    ("rgb.exr --clamp:min=low -o o.exr", "min=low"),
    ("rgb.exr --clamp:minimum=0 -o o.exr", "did you mean 'min'"),
    ("rgb.exr --saturate much -o o.exr", "scale=much"),
    ("gray.exr --saturate 2 -o o.exr", "3 channels"),
    ("gray.exr --normalize -o o.exr", "this one has 1"),
    ("rgb.exr --noise:type=blue -o o.exr", "type=blue: allowed is gaussian"),
    ("rgb.exr --noise:portion=2 -o o.exr", "portion=2"),
    ("rgb.exr --polar -o o.exr", "2-channel"),
    ("rgb.exr rgba.exr --scale -o o.exr", "single channel"),
    ("rgb.exr rgb.exr --over -o o.exr", "alpha"),
    ("rgba.exr rgba.exr --zover -o o.exr", "depth"),
    ("rgb.exr rgb.exr rgba.exr --mad -o o.exr", "they have 3, 3 and 4"),
    ("rgba.exr --invert:chbegin=3 -o o.exr", "no channel from there to 3"),
    ("nan.exr --fixnan error -o o.exr", "5 pixel(s) have NaN or Inf values"),
    ("nan.exr --fixnan box5 -o o.exr", "none | black | box3 | error"),
    ("rgb.exr --add -o o.exr", "takes 2"),
)


@pytest.mark.parametrize(("chain", "says"), REFUSED)
def test_refused(folder, chain, says):
    refused(folder, chain, says)


def test_max_of_images_with_other_channels(folder):
    """oiiotool reads past the pixels of the image with fewer channels."""
    run(shlex.split("rgba.exr --fullpixels --origin +0+0 --fullpixels rgb.exr --max -d float -o a.exr"), folder)
    run(shlex.split("rgb.exr rgba.exr --fullpixels --origin +0+0 --fullpixels --max -d float -o b.exr"), folder)
    rgba, rgb = load(folder / "rgba.exr"), load(folder / "rgb.exr").astype(np.float32)
    expected = np.dstack([np.maximum(rgba[..., :3], rgb), rgba[..., 3]])
    for name in ("a.exr", "b.exr"):
        np.testing.assert_array_equal(load(folder / name), expected)
        spec = oiio.ImageBuf(str(folder / name)).spec()
        assert (spec.channelnames, spec.alpha_channel) == (("R", "G", "B", "A"), 3)


@pytest.mark.parametrize("op", ALPHA)
def test_without_alpha_pixels_stay(folder, op):
    """oiiotool moves them where the data window does not begin at 0."""
    run(shlex.split(f"rgb.exr --origin +5+3 --{op} -o moved.exr"), folder)
    np.testing.assert_array_equal(load(folder / "moved.exr"), load(folder / "rgb.exr"))


def test_fixnan_none_leaves_all(folder):
    """oiiotool warns that it knows no 'none', and does box3."""
    run(shlex.split("nan.exr --fixnan none -o kept.exr"), folder)
    np.testing.assert_array_equal(load(folder / "kept.exr"), load(folder / "nan.exr"))


def test_fixnan_of_neighbours(tmp_path):
    """Each is the mean of what was finite, not of what happened to be repaired before it."""
    pixels = np.arange(36, dtype=np.float32).reshape(6, 6, 1)
    pixels[2, 2:4] = np.nan
    save(pixels, tmp_path / "in.exr", "float")
    run(shlex.split("in.exr --fixnan box3 -o out.exr"), tmp_path)
    out = load(tmp_path / "out.exr").reshape(6, 6)
    for row, column in ((2, 2), (2, 3)):
        assert out[row, column] == np.nanmean(pixels[row - 1 : row + 2, column - 1 : column + 2])
