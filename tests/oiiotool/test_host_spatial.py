# SPDX-License-Identifier: Apache-2.0
"""Ops that move pixels, filter, draw, and make images out of nothing, beside the wheel's own oiiotool."""

from __future__ import annotations

import shlex
from pathlib import Path

import OpenImageIO as oiio
import pytest

from oiiotex.engine.errors import ImageError
from oiiotex.oiiotool.cli.running.line_run import run

from ..peer import assert_same_file, chains, refused, same
from ..sources import sources


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the sources are."""
    return sources(tmp_path_factory.mktemp("geometry"))


# a type is given where files of several types meet: oiiotool then takes that of the file it happens to read first
MOVED = """
inset.exr | --crop 11x7+1+12 | --crop 40x40-5+1 | --crop 4,10,9,15 | --croptofull | --trim | --cut 11x7+1+12
plain.tif | --crop +5-3 | --crop 37x23 | --crop 50x0 -o OUT.exr | --mosaic 3x1
parts.exr | --crop:allsubimages=1 9x9+3+3 -d float | --crop 9x9+3+3 | --croptofull:allsubimages=1 -d float
parts.exr | --croptofull | --cut:allsubimages=1 9x9+3+3 -d float
over.exr | --croptofull | --cut 0,0,10,9 | --flip | --flop | --flipflop | --rotate90 | --rotate270
dark.exr | --trim | --mulc 0 --trim
alpha.exr over.exr | --paste +3-4
alpha.exr inset.exr | --paste - -d float
inset.exr alpha.exr | --paste:mergeroi=1 auto -d float
gray.tif plain.tif | --paste 5,6
gray.tif plain.tif alpha.exr | --paste:all=1 +2+2 -d float -o OUT.exr
plain.tif gray.tif inset.exr over.exr | --mosaic 2x2 -d float -o OUT.exr
plain.tif gray.tif alpha.exr | --mosaic:pad=3 2x2 -d float -o OUT.exr
plain.tif gray.tif | --mosaic:fit=20x15:pad=2 2x1 -o OUT.exr
inset.exr | --flip | --flop | --rotate180 | --transpose | --cshift +20-10 | --resample 50% | --resize 61x13
inset.exr | --rotate:center=4,7:filter=triangle:recompute_roi=1:highlightcomp=1 90
origin.exr | --rotate90 | --rotate270 | --fit:pad=1 45x20
plain.tif | --rotate270 | --cshift -100+7 | --resample 61x17 | --resample:interp=0 61x17 | --resize 50% | --resize 30%
plain.tif | --resize 75x0 | --resize 0x75 | --fit 20x20 | --fit:pad=1 20x20 | --fit:fillmode=width 64x20
plain.tif | --fit:fillmode=height:filter=box 30x50 | --fit:exact=1 50x45 -o OUT.exr | --fit 37x23 | --pixelaspect 2.0
plain.tif | --attrib PixelAspectRatio 1.7 --attrib XResolution 72.0 --attrib YResolution 60.0 --pixelaspect 1.0 -o OUT.exr
plain.tif | --pixelaspect:filter=box:highlightcomp=1 0.7 | --rotate 30
plain.tif | --warp:filter=triangle 1.2,0.1,0.003,-0.1,0.8,0.001,5,3,1 -o OUT.exr
plain.tif | --warp 1,0,0.05,0,1,0.05,0,0,-1 -o OUT.exr
over.exr | --transpose | --resample:interp=0 150%x70% | --resample 61x17 | --resize 130%x60%
over.exr | --resize:filter=box:highlightcomp=1 40% | --resize:from=1,2,20,15:to=5x9.5+3+2:filter=cubic 24x20
over.exr | --fit:highlightcomp=1 45x20 | --rotate:recompute_roi=1 -47.5
over.exr | --warp:recompute_roi=1 0.7,0.2,0,-0.3,1.4,0,5,3,1 | --warp:wrap=periodic 0.5,0.1,0,-0.1,0.4,0,5,3,1
parts.exr | --rotate90:allsubimages=1 -d float | --flop:subimages=1 -d float | --resize:allsubimages=1 31x40 -d float
parts.exr | --resize:filter=triangle 2 | --resize 31x23 | --fit:allsubimages=1 45x20 -d float
alpha.exr | --resize:filter=lanczos3 62x46 | --resize:filter=radial-lanczos3 62x46 | --resize:filter=disk 15x11
alpha.exr | --resize:filter=nuke-lanczos6 50% | --resize:from=10x8+3.5+2.25:filter=triangle 31x23
alpha.exr | --resize:to=10x8+3.5+2.25 31x23 | --fit:exact=1:pad=1:highlightcomp=1 20x20
alpha.exr | --warp:wrap=clamp:highlightcomp=1 0.5,0.1,0,-0.1,0.4,0,5,3,1
alpha.exr | --warp:wrap=mirror 0.5,0.1,0,-0.1,0.4,0,5,3,1
alpha.exr st.exr | --crop 31x23+0+0 --st_warp -d float
alpha.exr st.exr | --crop 31x23+0+0 --st_warp:filter=triangle:chan_s=1:chan_t=2:flip_s=1:flip_t=1 -d float
"""  # noqa: E501
FILTERED = """
plain.tif | --blur 5x5 | --kernel laplacian 3x3 --convolve -d float | --median 4x0 | --median 1x1 | --erode 3x4
plain.tif | --unsharp | --fft -d float -o OUT.exr
plain.tif | --decorrstretch:firstchannel=1:nchannels=2:scale=1.5:sigma=0.2:mean=0.5 -d float -o OUT.exr
over.exr | --blur 5x3 | --kernel gaussian 7x3 --convolve | --median 3x3 | --dilate 3x3 | --erode 1x7 -d float
over.exr | --unsharp:width=5:contrast=1.5 | --laplacian | --fillholes | --fft -d float
over.exr | --decorrstretch:percentile=5:mode=correlation
inset.exr | --blur:kernel=box 4x7 | --median 5x2 | --dilate 5x2 | --unsharp:kernel=median:width=4:threshold=0.2
inset.exr | --laplacian | --fft -d float
alpha.exr | --blur:kernel=binomial 5x3 | --blur:kernel=lanczos3 3.5x1
alpha.exr | --unsharp:kernel=box:width=2.5:threshold=0.3:contrast=-1 | --fillholes | --decorrstretch
parts.exr | --blur:allsubimages=1:kernel=triangle 3x3 -d float | -a --erode 3x3 -d float
parts.exr | --subimage 1 --fillholes -d float
plain.tif dark.exr | --crop 5x5+5+4 --convolve -d float -o OUT.exr
gray.tif | --laplacian -d float -o OUT.exr | --fft --ifft -d float -o OUT.exr | --demosaic -d float -o OUT.exr
gray.tif | --demosaic:algorithm=linear:layout=GRBG -d float -o OUT.exr | --demosaic:pattern=xtrans -d float -o OUT.exr
gray.tif | --crop 15x23+3+4 --demosaic:layout=BGGR:white_balance_mode=manual:white_balance=2,1,1.5,1.2 -d float -o OUT.exr
gray.tif | --demosaic:white_balance_mode=manual:white_balance=2,1,1.5 -d float -o OUT.exr
"""  # noqa: E501
DRAWN = """
plain.tif | --box:color=1,0,0 3,4,20,15 | --box:color=0.5:fill=1 -3,4,20,50 | --box:color=1,0,0,0.25:fill=1 3,4,20,15
plain.tif | --line:color=1,0.5,0.25 1,2,30,17,5,20,1,2 | --line:color=0.3 -9,-2,30,17,5,60 | --text Hello
plain.tif | --text:x=3:y=15:size=12:color=1,0,0 Hiya | --text:x=3:y=15:size=12:color=1,0,0,0.5:shadow=2 Hiya
plain.tif | --text:x=300 Hello | --fill:color=0.5,0.2 10x7+3+4 | --fill:top=1,0,0:bottom=0,0,1 10x70+3+4
over.exr | --box:color=0.1,0.2,0.3,0.5:fill=1 -4,4,20,15 | --box:color=0.1,0.2,0.3,0.5 20,15,-4,4
over.exr | --line:color=0.5,0.25,0.1,0.5 -9,-2,30,17,5,60 | --point:color=1,0.5,0.2,0.4 -4,1,7,11
over.exr | --text:xalign=center:yalign=center:size=20:color=0.5,0.2,0.1,0.6:shadow=1:font=DroidSerif Agq
over.exr | --text:xalign=right:yalign=top:size=14 Agq | --fill:left=1,0,0:right=0,0,1,0 17x9-9+4
inset.exr | --box 7,12,7,12 | --point:color=1,0.5 4,10,7,11,100,100
inset.exr | --fill:topleft=0.1:topright=0.2,0.3:bottomleft=0.5,1,2:bottomright=1,0,0 50%
five.exr | --text:xalign=r:yalign=b:size=14:color=0.3 Agq | --box:color=0.5:fill=1 2,3,9,9
parts.exr | --box:allsubimages=1:color=0.5 3,3,9,9 -d float | --box:color=0.5 3,3,9,9
parts.exr | --fill:color=0.5 5x5+1+1 -d float | --fill:color=0.5:allsubimages=1 5x5+1+1 -d float
alpha.exr | --fill 5x5+1+1
four.exr | --text:x=3:y=15:size=14:color=0.3,0.4,0.5,0.6,0.7 Agq
tiled.tif | --box:color=0.5:fill=1 2,3,9,9 | --flip | --fit 20x20
"""
NEW = """
- | --create 21x13 3 | --create:type=uint8 21x13-3+4 4 -o OUT.tif | --create:type=half 21x13-3+4 5
- | --pattern black 21x13 3 | --pattern constant 21x13 3 | --pattern:type=half constant:color=0.3,0.5 21x13-3+4 5
- | --pattern:type=uint8 fill:top=0.1,0.2:bottom=0.9 21x13 3 -o OUT.tif
- | --pattern fill:left=0.1,0.2:right=0.9 21x13+3-4 3
- | --pattern:type=half fill:topleft=0.1:topright=0.2,0.3:bottomleft=0.5,1,2:bottomright=1,0,0 21x13+3-4 3
- | --pattern fill:color=0.2 21x13 3 | --pattern fill 21x13 3 | --pattern checker 31x23-5-3 3
- | --pattern:type=uint16 checker:width=5:height=3:color1=0.1,0.2,0.3:color2=0.5 31x23 3 -o OUT.tif
- | --pattern noise 31x23-5-3 3 | --pattern:type=uint8 noise:type=uniform:min=0:max=0.5:seed=7 31x23 4 -o OUT.tif
- | --pattern:type=half noise:type=blue:seed=3 31x23+9+7 6
- | --pattern noise:type=salt:value=0.7:portion=0.3:mono=1 31x23 3 | --pattern noise:type=white:mono=1 31x23 3
- | --pattern noise:mean=1:stddev=0.5:mono=1 31x23 3 | --kernel gaussian 5x5 | --kernel binomial 5x3
- | --kernel laplacian 3x3 | --kernel blackman-harris 3.5x7
"""
TURNED = [f"turned{n}.tif --reorient -o OUT.tif" for n in range(1, 9)]


@pytest.mark.parametrize("chain", [*chains(MOVED + FILTERED + DRAWN + NEW), *TURNED])
def test_as_oiiotool(folder: Path, chain: str):
    """The same pixels, types, windows and metadata."""
    same(folder, *shlex.split(chain))


@pytest.mark.parametrize("size", ["62x46", "31x23"])
def test_edgeclamp(folder: Path, size: str):
    """The weights are divided out afterwards: the last bit or two may differ, at the edges only."""
    chain = f"alpha.exr --resize:from=40x30-5-4:edgeclamp=1 {size} -d float -o OUT.exr"
    same(folder, *chain.split(), tolerance=1e-6)


def test_quarter_turns_where_the_display_window_is_off_the_origin(folder: Path):
    """oiiotool loses pixels there; four turns bring everything back."""
    run(["inset.exr", *["--rotate90"] * 4, "-o", "round.exr"], folder)
    run(["inset.exr", "--rotate270", "--rotate90", "-o", "back.exr"], folder)
    for name in ("round.exr", "back.exr"):
        assert_same_file(folder / name, folder / "inset.exr")


REFUSED = """
plain.tif | --crop 0x0+1+1 | --crop 5,5,3,3 | --cut 5,5,3,3 | --cut -4x3+1+1 | --cshift 5x5
plain.tif | --resize 0x0 | --resize 0% | --resize:from=5,5,3,3 10x10 | --resize:filter=gausian 10x10 | --resample 0x0
plain.tif | --fit -5x5 | --fit 0x0 | --pixelaspect 0 | --median 0x0 | --blur:kernel=gausian 5x5
plain.tif | --warp 1,2,3 | --warp 0,0,0,0,0,0,0,0,0 | --rotate:center=1 30
plain.tif gray.tif | --paste 5 | --st_warp
- | --create 5,5,3,3 3 | --pattern chequer 5x5 3 | --pattern checker:with=5 5x5 3
"""


@pytest.mark.parametrize("chain", chains(REFUSED))
def test_refused(folder: Path, chain: str):
    """In one line."""
    refused(folder, f"{chain.partition(' -o ')[0]} -o o.exr", "")


def test_an_older_openimageio_is_refused_by_what_needs_a_newer_one(folder: Path, monkeypatch: pytest.MonkeyPatch):
    """OpenImageIO 3.1 has no decorrelation stretch. Said before a pixel is read."""
    monkeypatch.delattr(oiio.ImageBufAlgo, "decorr_stretch", raising=False)
    with pytest.raises(ImageError, match=rf"requires OpenImageIO 3.2, but {oiio.VERSION_STRING} is installed"):
        run(["plain.tif", "--decorrstretch", "-o", "old.tif"], folder)
    assert not (folder / "old.tif").exists()
