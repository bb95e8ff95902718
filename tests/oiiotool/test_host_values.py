# SPDX-License-Identifier: Apache-2.0
"""Arithmetic, ranges, compositing, channels, metadata: as oiiotool does them."""

from __future__ import annotations

import logging
import shlex
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex.engine.errors import ParameterError
from oiiotex.oiiotool.cli.running.line_run import run
from oiiotex.oiiotool.host.channels import chosen_channels
from tests.conftest import load, save
from tests.inputs import write_inputs
from tests.peer import chains, refused, same


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = write_inputs(tmp_path_factory.mktemp("values"))
    (folder / "patterns.txt").write_text("Art.*\n\nOrient[a-z]*\n")
    (folder / "profile.icc").write_bytes(bytes(range(200)) * 3)
    return folder


ARITHMETIC = """
rgba.exr b.exr | --add | --sub | --mul | --div | --absdiff | --min | --max | --over
rgba.exr rgb.exr | --add | --sub | --mul | --div | --absdiff | --min
rgb.exr rgba.exr | --add | --mul | --absdiff | --min
rgb8.png rgb.exr | --add
- | --native rgb.exr rgb8.png --mul -o OUT.tif | --native rgb8.png rgb8.png --add -o OUT.png
- | --native rgb8.png --dup --flip --sub -o OUT.png
rgba.exr | --add b.exr -d half | --addc 0.3 | --subc 0.3 | --mulc 0.3 | --divc 0.3 | --absdiffc 0.3 | --powc 0.3
rgba.exr | --maxc 0.3 | --minc 0.3 | --addc 0.3,0.2 | --subc 0.3,0.2 | --mulc 0.3,0.2 | --divc 0.3,0.2
rgba.exr | --absdiffc 0.3,0.2 | --powc 0.3,0.2 | --maxc 0.3,0.2 | --minc 0.3,0.2 | --abs | --invert
rgba.exr | --invert:chbegin=3:chend=4 | --clamp | --clamp:min=0:max=0.5 | --clamp:min=0,0.1,0.2
rgba.exr | --mulc 3 --clamp:max=0.4,0.5,0.6,0.7,0.8:clampalpha=1 | --contrast:black=0.4:white=0.4
rgba.exr | --rangecompress:luma=1 | --rangeexpand:luma=1 | --normalize
rgba.exr | --noise:type=gaussian:mean=0.1:stddev=0.3:seed=7 | --noise:type=uniform:min=-0.1:max=0.2:mono=1
rgba.exr | --noise:type=white:nchannels=2:seed=-3
rgba.exr gray.exr | --scale
gray.exr rgba.exr | --scale
rgba.exr b.exr five.exr | --ch R,G,B,A --mad
rgb.exr rgb8.png rgb.exr | --mad
parts.exr rgb8.png | --add:allsubimages=1 | --mul:subimages=1 | --mul
rgb.exr | --divc 0,2,-4 | --cadd 0.1 --csub 0.2,0.1,0 --cmul 2 --cpow 2 | --invert | --contrast:black=0.1:white=0.8
rgb.exr | --contrast:black=0.1,0.2:white=0.9:min=0.2:max=0.7,0.8,0.9:clamp=1 | --saturate 0 | --rangecompress
rgb.exr | --rangeexpand | --noise | --fixnan error | --premult | --unpremult | --repremult
rgb8.png | --mulc 1,2,3,4,5 | --contrast:scontrast=5:sthresh=0.4
rgb8.png | --normalize:incenter=0.5:outcenter=0.5:scale=0.5 -o OUT.exr | --noise:type=salt:value=1:portion=0.2
rgb8.png | --fixnan box3
parts.exr | -a --addc 0.1
gray.exr | --invert
five.exr | --invert:chbegin=1:chend=9 | --saturate 1.7 | --rangecompress | --rangeexpand | --premult | --unpremult
five.exr | --repremult | --origin +7-2 far.exr --zover:zeroisinf=1
two.exr | --polar | --unpolar | --polar --unpolar -d half | --rangecompress:luma=1
nan.exr | --fixnan black | --fixnan box3
nanhalf.exr | --fixnan black | --fixnan box3
- | --native nanhalf.exr --fixnan box3
rgba.exr | --unpremult --repremult
rgba8.png | --unpremult
rgba8.png rgba.exr | --over -o OUT.exr
five.exr far.exr | --over | --zover
"""
CHANNELS = """
rgb.exr | --ch B,G,R | --ch R,G,B | --ch R,G,B,A=1.0 | --ch 2,1,0 | --ch =0.25,R=G,X=-1.5e-1,g | --ch R,G,B,
rgb.exr | --ch R,7 | --ch R,Q | --nchannels 3 | --nchannels 6
parts.exr | --ch RGB | -a --ch B,R | --ch:allsubimages=1 R=B,G=0.5,B=R
rgba.exr | --ch RGB | --nchannels 3 | --chnames d.R,,d.B,d.A | --chnames R,G,B,A,Z,more
rgb8.png | --ch 0,0,0,=0.5 | --nchannels 1
five.exr | --ch Z | --ch A,Z,R | --ch 'R, G,,B'
- | --native rgb8.png --ch B,=1,R -o OUT.png | --native rgb8.png gray.exr --chappend
two.exr | --ch 0,1,1 -d half
rgb.exr gray.exr | --chappend
rgba.exr b.exr | --chappend
gray.exr rgb8.png | --chappend
rgb.exr rgb8.png gray.exr | --chappend:n=3
rgb.exr rgb8.png rgb.exr rgb.exr | --chappend:n=3
rgb.exr five.exr | --ch A --chappend -d half
rgb.exr | --chappend gray.exr | --chnames X,Y,Z
gray.exr | --chnames depth | --colormap blue-red | --colormap redblue | --colormap spectrum
parts.exr | -a --chnames a,b,c
rgba.exr | --chnames ,,,alpha --premult | --chsum | --chsum:weight=0.2126,0.7152,0.0722,0 | --maxchan
rgba.exr | --colormap inferno | --colormap viridis | --colormap magma | --colormap turbo | --colormap plasma
rgba.exr | --colormap heat
five.exr | --chsum:weight=0.5 | --chsum:weight=0.5,0.25 | --minchan
rgb8.png | --chsum:weight=.2,.7,.1 | --maxchan | --colormap turbo
two.exr | --colormap 0,0,0,1,0.5,0,.1,.2,1
"""
METADATA = """
rgb.exr | --attrib num 3 | --attrib num 3.5 --attrib text 'a b'
rgb.exr | --attrib:type=float num 3 --attrib:type=string name 12
rgb.exr | --attrib:type=float[3] vec 1,2,3 --attrib:type=color col 1,.5,.25
rgb.exr | --attrib:type=int[2] pair 4,5 --attrib:type=int one 7
rgb.exr | --attrib:type=matrix m 1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1 | --attrib:type=rational r 24/1 | --caption 'A wall'
rgb.exr | --caption 'A wall' --caption '' | --orientation 6 | --orientcw --orientcw
rgb.exr | --attrib Orientation 9 --orientcw | --iccread profile.icc -o OUT.tif
five.exr | --attrib Artist '' | --attrib:type=string Artist you | --sattrib num 3 --sattrib Artist ''
five.exr | --eraseattrib Artist | --eraseattrib 'art.*' | --eraseattrib '.*' | --eraseattrib rtis
five.exr | --eraseattrib:fromfile=1 patterns.txt | --orientcw | --orientccw | --orient180 | --rotcw | --rotccw
five.exr | --rot180 | --attrib Arty 1 rgba.exr --pastemeta:merge=1:pattern=Art
parts.exr | --attrib num 3 | -a --attrib num 3 | --attrib:subimages=1 num 3
rgb8.png | --keyword stone --keyword brick --keyword stone -o OUT.tif
rgb8.png | --sattrib Keywords 'a;b ; c' --keyword d -o OUT.exr | --keyword stone --clear-keywords -o OUT.exr
rgb8.png | --cicp 12,16,0,1 | --cicp 12,16,0,1 --cicp 9,,1 | --cicp 12,16 | --cicp 12,16,0,1 --cicp ''
rgba.exr | --origin +7-9 | --origin 7,9 | --originoffset -3+4 | --originoffset +0+0 | --fullsize 100x50
rgba.exr | --fullsize 100x50-10+3 | --fullsize +3+4 | --fullsize 2,3,30,40 | --fullsize 0x64 | --fullpixels
rgba.exr | --origin +7-9 --addc 0.1 --fullpixels
five.exr rgb8.png | --pastemeta
five.exr rgba.exr | --pastemeta | --caption c --sattrib Artist me --pastemeta:merge=0
five.exr rgba.exr | --caption c --sattrib Artist me --pastemeta:merge=1
five.exr rgba.exr | --caption c --sattrib Artist me --pastemeta:merge=2 | --pastemeta:merge=2:pattern=full
rgba.exr five.exr | --pastemeta
five.exr parts.exr | -a --pastemeta:pattern=A:merge=1 | -a --pastemeta | --pastemeta
"""


@pytest.mark.parametrize("chain", chains(ARITHMETIC + CHANNELS + METADATA))
def test_as_oiiotool(folder, chain):
    """The same pixels, types, windows and metadata."""
    same(folder, *shlex.split(chain))


REFUSED = (
    ("rgb.exr --addc 0.1,x", "value=0.1,x: expected a comma-separated list of numbers"),
    ("rgb.exr --clamp:min=low", "min=low"),
    ("rgb.exr --clamp:minimum=0", "did you mean 'min'"),
    ("rgb.exr --saturate much", "scale=much"),
    ("gray.exr --saturate 2", "3 channels"),
    ("gray.exr --normalize", "has 1 channels: expected 3 or 4"),
    ("rgb.exr --noise:type=blue", "type=blue: expected one of gaussian"),
    ("rgb.exr --noise:portion=2", "portion=2"),
    ("rgb.exr --polar", "2-channel"),
    ("rgb.exr rgba.exr --scale", "single channel"),
    ("rgb.exr rgb.exr --over", "alpha"),
    ("rgba.exr rgba.exr --zover", "depth"),
    ("rgb.exr rgb.exr rgba.exr --mad", "same number of channels, not 3, 3, 4"),
    ("rgba.exr --invert:chbegin=3", "chbegin=3: expected a channel below 3"),
    ("nan.exr --fixnan error", "5 pixel(s) have NaN or Inf values"),
    ("nan.exr --fixnan box5", "none, black, box3, error"),
    ("rgb.exr --add", "expected 2 image"),
    ("rgb.exr --ch ''", "'': expected a comma-separated list of channels"),
    ("rgb.exr --ch ,", "',': expected a comma-separated list of channels"),
    ("rgb.exr --nchannels 0", "count=0"),
    ("rgb.exr --nchannels three", "count=three"),
    ("rgb.exr gray.exr --chappend:n=1", "n=1"),
    ("rgb.exr gray.exr --chappend:n=3", "expected 3 image"),
    ("rgb.exr --chsum:weight=a", "weight=a"),
    ("rgb.exr --colormap rainbow", "inferno"),
    ("rgb.exr --colormap 0,0,0,1,1", "at least two R,G,B triples"),
    ("rgb.exr --colormap 0,0,0", "at least two R,G,B triples"),
    ("rgb.exr --attrib:type=quux a 1", "unknown type 'quux'"),
    ("rgb.exr --attrib:type=int a one", "is not of type int"),
    ("rgb.exr --eraseattrib:fromfile=1 none.txt", "none.txt"),
    ("rgb.exr --orientation 9", "orientation=9"),
    ("rgb.exr --orientation up", "orientation=up"),
    ("rgb.exr --origin 20x20", "expected an offset +X+Y"),
    ("rgb.exr --origin 20x20+3+3", "expected an offset +X+Y"),
    ("rgb.exr --originoffset 50%", "expected an offset +X+Y"),
    ("rgb.exr --fullsize 50%", "'50%': expected +X+Y, WxH"),
    ("rgb.exr --fullsize 9,9,3,3", "at least one pixel"),
    ("rgb8.png --cicp 1,2,3,4,5", "up to four"),
    ("rgb8.png --cicp a", "codes=a"),
    ("rgb.exr --iccread none.icc", "none.icc"),
    ("rgb.exr rgba.exr --pastemeta:merge=3", "merge=3"),
    ("rgb.exr rgba.exr '--pastemeta:pattern=['", "expected a basic regular expression"),
)


@pytest.mark.parametrize(("chain", "says"), REFUSED)
def test_refused(folder, chain, says):
    refused(folder, f"{chain} -o o.exr", says)


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


@pytest.mark.parametrize("op", ("premult", "unpremult", "repremult"))
def test_without_alpha_pixels_stay(folder, op):
    """oiiotool moves them where the data window does not begin at 0."""
    run(shlex.split(f"rgb.exr --origin +5+3 --{op} -o moved.exr"), folder)
    np.testing.assert_array_equal(load(folder / "moved.exr"), load(folder / "rgb.exr"))


def test_fixnan_none_leaves_all(folder):
    """oiiotool warns that it knows no 'none', and does box3."""
    run(shlex.split("nan.exr --fixnan none -o kept.exr"), folder)
    np.testing.assert_array_equal(load(folder / "kept.exr"), load(folder / "nan.exr"))


def test_fixnan_of_neighbors(tmp_path):
    """Each is the mean of what was finite, not of what happened to be repaired before it."""
    pixels = np.arange(36, dtype=np.float32).reshape(6, 6, 1)
    pixels[2, 2:4] = np.nan
    save(pixels, tmp_path / "in.exr", "float")
    run(shlex.split("in.exr --fixnan box3 -o out.exr"), tmp_path)
    out = load(tmp_path / "out.exr").reshape(6, 6)
    for row, column in ((2, 2), (2, 3)):
        assert out[row, column] == np.nanmean(pixels[row - 1 : row + 2, column - 1 : column + 2])


def test_list_of_channels():
    names = ("R", "G", "0", "d.X")
    assert chosen_channels("d.x,new=G,2,5,=2,A=.5,0", names) == [
        (3, "d.X"), (1, "new"), (2, "0"), (0.0, "A"), (2.0, "Z"), (0.5, "A"), (0, "R"),
    ]  # fmt: skip
    with pytest.raises(ParameterError):
        chosen_channels(" ", names)


def test_unknown_channel_is_told(folder, caplog):
    with caplog.at_level(logging.WARNING, "oiiotex"):
        run(shlex.split("rgb.exr --ch R,Q -o q.exr"), folder)
    assert "no channel 'Q'" in caplog.text
    assert not load(folder / "q.exr")[..., 1].any()


def test_kept_names_keep_their_meaning(folder):
    """oiiotool forgets that A is alpha where it is not among the new names, and then refuses --over."""
    run(shlex.split("rgba.exr --chnames X rgba.exr --over -o kept.exr"), folder)
    run(shlex.split("rgba.exr --dup --over --chnames X -o expected.exr"), folder)
    np.testing.assert_array_equal(load(folder / "kept.exr"), load(folder / "expected.exr"))


def test_parts_keep_their_names(folder):
    """oiiotool loses them with the other metadata."""
    run(shlex.split("parts.exr -a --minchan -o named.exr"), folder)
    names = [oiio.ImageBuf(str(folder / "named.exr"), n, 0).spec()["oiio:subimagename"] for n in (0, 1)]
    assert names == ["layer0", "layer1"]
    for n in (0, 1):
        np.testing.assert_array_equal(
            load(folder / "named.exr", n)[..., 0], load(folder / "parts.exr", n).min(axis=2), f"part {n}"
        )


def test_many_appended(folder):
    run(shlex.split("rgb.exr --dup --dup --chappend:n=3 -d float -o nine.exr"), folder)
    pixels = load(folder / "nine.exr")
    assert pixels.shape[2] == 9
    for n in (3, 6):
        np.testing.assert_array_equal(np.sort(pixels[..., n : n + 3], axis=2), np.sort(pixels[..., :3], axis=2))


def test_one_cicp_code(folder):
    """oiiotool sets all four to it."""
    run(shlex.split("rgb8.png --cicp 12,16,0,1 --cicp 9 -o cicp.png"), folder)
    codes = oiio.ImageBuf(str(folder / "cicp.png")).spec().getattribute("CICP")
    assert list(np.asarray(codes)) == [9, 16, 0, 1]


def test_origin_of_all_parts(folder):
    """oiiotool puts the first part's pixels into all."""
    run(shlex.split("parts.exr -a --origin +1+2 -o moved.exr"), folder)
    for n in (0, 1):
        np.testing.assert_array_equal(load(folder / "moved.exr", n), load(folder / "parts.exr", n))
        spec = oiio.ImageBuf(str(folder / "moved.exr"), n, 0).spec()
        assert (spec.x, spec.y) == (1, 2)
