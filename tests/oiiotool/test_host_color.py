# SPDX-License-Identifier: Apache-2.0
"""Color conversions: as oiiotool does them, and where it spoils channels or guesses, as they should be."""

from __future__ import annotations

import shlex
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex.engine.color.config import DEFAULT_CONFIG
from oiiotex.oiiotool.cli.running.line_run import run
from tests.conftest import load, save
from tests.inputs import write_inputs
from tests.peer import chains, refused, same

CONFIG = """ocio_profile_version: 2
search_path: .
roles: {default: raw, scene_linear: lin, aces_interchange: lin}
environment: {SHOT: normal}
displays:
  mon:
    - !<View> {name: film, colorspace: srgb8}
    - !<View> {name: shot, colorspace: srgb8, looks: warm}
looks:
  - !<Look> {name: warm, process_space: lin, transform: !<CDLTransform> {slope: [1.2, 1, 0.8]}}
  - !<Look> {name: perShot, process_space: lin, transform: !<FileTransform> {src: $SHOT.cc}}
colorspaces:
  - !<ColorSpace> {name: lin, encoding: scene-linear}
  - !<ColorSpace> {name: raw, isdata: true}
  - !<ColorSpace>
    name: srgb8
    aliases: [gamma]
    from_scene_reference: !<ExponentWithLinearTransform> {gamma: 2.4, offset: 0.055, direction: inverse}
  - !<ColorSpace>
    name: shotspace
    from_scene_reference: !<FileTransform> {src: $SHOT.cc}
named_transforms:
  - !<NamedTransform> {name: double, transform: !<MatrixTransform> {offset: [0.1, 0.2, 0.3, 0]}}
"""
CC = """<ColorCorrection id="c"><SOPNode><Slope>{}</Slope><Offset>0.1 0 0</Offset><Power>1 1 1</Power></SOPNode>
</ColorCorrection>"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = write_inputs(tmp_path_factory.mktemp("color"))
    (folder / "own.ocio").write_text(CONFIG)
    (folder / "normal.cc").write_text(CC.format("1 1 1"))
    (folder / "night.cc").write_text(CC.format("0.5 0.6 0.9"))
    _write_cryptomatte(folder / "crypto.exr")
    return folder


def _write_cryptomatte(path: Path) -> None:
    """Two ranks of ids with coverage, beside color."""
    random = np.random.default_rng(1)
    codes = random.integers(1 << 24, 1 << 30, (2, 6), np.uint32).view(np.float32)
    place = random.integers(0, 6, (16, 20))
    share = random.random((16, 20)).astype(np.float32)
    share[0] = 0
    layers = [codes[0][place], share, codes[1][place[::-1]], 1 - share]
    layers[2][3] = 0
    spec = oiio.ImageSpec(20, 16, 7, oiio.FLOAT)
    spec.channelnames = ("R", "G", "B", "id00.R", "id00.G", "id00.B", "id00.A")
    spec.attribute("Artist", "who")
    buffer = oiio.ImageBuf(spec)
    pixels = np.dstack([random.random((16, 20, 3)).astype(np.float32), *layers])
    buffer.set_pixels(buffer.roi, np.ascontiguousarray(pixels))
    assert buffer.write(str(path))


BUILT_IN = f"--colorconfig {DEFAULT_CONFIG} "
OWN = "--colorconfig own.ocio "
CHAINS = """
rgb.exr | --iscolorspace lin_rec709_scene | --iscolorspace lin_rec709_scene --tocolorspace srgb_rec709_scene
rgb.exr | --colorconvert scene_linear ACEScct | --colorconvert Raw ACEScg | --colorconvert:strict=0 nonesuch ACEScg
rgb.exr | --ccmatrix 0.5,0.2,0,0,1,0,0.1,0,0.9
rgb.exr | '--ociodisplay:from=lin_rec709_scene' 'sRGB - Display' 'ACES 2.0 - SDR 100 nits (Rec.709)'
rgb.exr | --iscolorspace ACEScg --ociolook 'ACES 1.3 Reference Gamut Compression'
rgb8.png | --iscolorspace ACEScg -o OUT.exr | --iscolorspace '' -o OUT.exr | --tocolorspace ACEScg -o OUT.exr
rgb8.png | --tocolorspace lin_rec709_scene --tocolorspace srgb_rec709_scene | --tocolorspace sRGB -o OUT.exr
rgb8.png | --colorconvert current ACEScg -o OUT.exr
rgb8.png | '--ociodisplay:from=ACEScg:inverse=1' 'sRGB - Display' Un-tone-mapped -o OUT.exr
rgb8.png | --ocionamedtransform:inverse=1 'sRGB - Curve' -o OUT.exr
parts.exr | -a --iscolorspace scene_linear | --colorconvert ACEScg ACEScg | -a --colorconvert ACEScg ACES2065-1
rgba.exr | --colorconvert lin_rec709_scene ACEScg | --colorconvert:unpremult=1 lin_rec709_scene srgb_rec709_scene
rgba.exr | --unpremult --colorconvert:unpremult=1 lin_rec709_scene ACEScct --premult | --colorconvert ACEScg ACEScg
rgba.exr | --ccmatrix:unpremult=1 0.5,0.2,0,0,0,1,0,0,0.1,0,0.9,0,0.1,0.2,0.3,1
rgba.exr | --ccmatrix:transpose=1 0.5,0.2,0,0,0,1,0,0,0.1,0,0.9,0,0,0,0,1
rgba.exr | --iscolorspace ACEScg --ociodisplay:unpremult=1 default default
rgba8.png | --colorconvert:unpremult=1 srgb_rec709_scene ACEScg -o OUT.exr
gray.exr | --colorconvert lin_rec709_scene srgb_rec709_scene
two.exr | --colorconvert lin_rec709_scene srgb_rec709_scene
- | --native rgb8.png --tocolorspace ACEScct -o OUT.png
crypto.exr | --cryptomatte-colors id | --cryptomatte-colors id -d half
"""
OWN_CHAINS = """
rgb.exr | --colorconvert lin gamma | --colorconvert:key=SHOT:value=night lin shotspace | --colorconvert lin shotspace
rgb.exr | --ociolook:from=lin:to=srgb8 warm | --ociolook:from=lin:to=lin:key=SHOT:value=night perShot
rgb.exr | --ociodisplay:from=lin mon shot | --ociodisplay:from=lin:looks=warm mon film | --ociofiletransform night.cc
rgb.exr | --ocionamedtransform double
rgba.exr | --ociolook:from=lin:to=lin:inverse=1:unpremult=1 warm | --ociofiletransform:inverse=1:unpremult=1 night.cc
"""


@pytest.mark.parametrize("chain", [*(BUILT_IN + c for c in chains(CHAINS)), *(OWN + c for c in chains(OWN_CHAINS))])
def test_as_oiiotool(folder, chain):
    same(folder, *shlex.split(chain))


@pytest.mark.parametrize("matrix", ["2,0.1,0,0,1,0.3,0,0,0.5", "2,0.1,0,0,0,1,0.3,0,0,0,0.5,0,0.1,0.2,0.3,1"])
def test_inverse_matrix(folder, matrix):
    """Not to the bit: oiiotool inverts in single precision."""
    same(folder, *shlex.split(f"rgba.exr --ccmatrix:invert=1 {matrix} -o OUT.exr"), tolerance=2e-6)


REFUSED = (
    ("rgb.exr --iscolorspace nonesuch", "'nonesuch' is not in"),
    ("rgb.exr --tocolorspace ACEScg", "the image has no color space tag; add --iscolorspace"),
    ("rgb.exr --colorconvert current ACEScg", "has no color space tag"),
    ("rgb.exr --colorconvert nonesuch ACEScg", "nonesuch"),
    ("rgb8.png --tocolorspace nonesuch", "nonesuch"),
    ("rgb.exr --ociodisplay default default", "has no color space tag"),
    ("rgb8.png --ociodisplay nonesuch default", "has sRGB - Display,"),
    ("rgb8.png --ociodisplay default nonesuch", "Un-tone-mapped"),
    ("rgb.exr --ociolook none", "has no color space tag"),
    ("rgb8.png --ociolook nonesuch", "nonesuch"),
    ("rgb.exr --ociofiletransform none.cube", "none.cube"),
    ("rgb.exr --ocionamedtransform nonesuch", "sRGB - Curve"),
    ("rgb.exr --ccmatrix 1,2,3", "9 or 16 numbers"),
    ("rgb.exr --ccmatrix:invert=1 1,0,0,0,1,0,1,0,0", "expected an invertible matrix"),
    ("crypto.exr --cryptomatte-colors none", "no channels none00"),
)


@pytest.mark.parametrize(("chain", "says"), REFUSED)
def test_refused(folder, chain, says):
    refused(folder, f"{chain} -o o.exr", says)


def test_further_channels_are_copied(folder):
    """oiiotool makes 0.5 + 10 x of what comes behind the fourth channel."""
    convert = "--colorconvert:unpremult=1 lin_rec709_scene ACEScct"
    run(shlex.split(f"five.exr {convert} -o five-out.exr"), folder)
    run(shlex.split(f"five.exr --ch R,G,B,A {convert} -o four-out.exr"), folder)
    np.testing.assert_array_equal(load(folder / "five-out.exr")[..., :4], load(folder / "four-out.exr"))
    np.testing.assert_array_equal(load(folder / "five-out.exr")[..., 4], load(folder / "five.exr")[..., 4])
    spec = oiio.ImageBuf(str(folder / "five-out.exr")).spec()
    assert "acescct" in spec["oiio:ColorSpace"] and spec["Artist"] == "who"


def test_color_is_found_by_name(folder):
    """oiiotool takes the first three."""
    convert = "--colorconvert lin_rec709_scene ACEScct"
    run(shlex.split(f"five.exr --ch X=Z,B,A,G,R {convert} --ch R,G,B,A,X -o named.exr"), folder)
    run(shlex.split(f"five.exr {convert} -o usual.exr"), folder)
    np.testing.assert_array_equal(load(folder / "named.exr"), load(folder / "usual.exr"))


def test_gray_with_alpha(tmp_path):
    """oiiotool takes alpha for green."""
    pixels = np.random.default_rng(1).random((5, 7, 2)).astype(np.float32)
    save(pixels, tmp_path / "ya.exr", "float")
    convert = "--colorconvert lin_rec709_scene srgb_rec709_scene"
    run(shlex.split(f"ya.exr --chnames Y,A {convert} -o ya-out.exr"), tmp_path)
    run(shlex.split(f"ya.exr --ch 0,0,0 {convert} --ch 0 -o y-out.exr"), tmp_path)
    out = oiio.ImageBuf(str(tmp_path / "ya-out.exr"))
    found = {name: out.get_pixels(oiio.FLOAT, out.roi)[..., n] for n, name in enumerate(out.spec().channelnames)}
    np.testing.assert_array_equal(found["A"], pixels[..., 1])
    np.testing.assert_array_equal(found["Y"], load(tmp_path / "y-out.exr")[..., 0])
