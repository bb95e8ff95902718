# SPDX-License-Identifier: Apache-2.0
"""Ops that move pixels, beside the wheel's own oiiotool."""

from __future__ import annotations

from pathlib import Path

import pytest

from oiiotex.cli.running.line_run import run
from oiiotex.errors import Error

from .peer import assert_same_file, same
from .sources import sources


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the sources are."""
    return sources(tmp_path_factory.mktemp("geometry"))


CHAINS = """
inset.exr --crop 11x7+1+12 -o OUT.exr
inset.exr --crop 40x40-5+1 -o OUT.exr
inset.exr --crop 4,10,9,15 -o OUT.exr
plain.tif --crop +5-3 -o OUT.tif
plain.tif --crop 37x23 -o OUT.tif
plain.tif --crop 50x0 -o OUT.exr
parts.exr --crop:allsubimages=1 9x9+3+3 -d float -o OUT.exr
parts.exr --crop 9x9+3+3 -o OUT.exr
inset.exr --croptofull -o OUT.exr
over.exr --croptofull -o OUT.exr
parts.exr --croptofull:allsubimages=1 -d float -o OUT.exr
parts.exr --croptofull -o OUT.exr
dark.exr --trim -o OUT.exr
dark.exr --mulc 0 --trim -o OUT.exr
inset.exr --trim -o OUT.exr
inset.exr --cut 11x7+1+12 -o OUT.exr
over.exr --cut 0,0,10,9 -o OUT.exr
parts.exr --cut:allsubimages=1 9x9+3+3 -d float -o OUT.exr
alpha.exr over.exr --paste +3-4 -o OUT.exr
alpha.exr inset.exr --paste - -d float -o OUT.exr
inset.exr alpha.exr --paste:mergeroi=1 auto -d float -o OUT.exr
gray.tif plain.tif --paste 5,6 -o OUT.tif
gray.tif plain.tif alpha.exr --paste:all=1 +2+2 -d float -o OUT.exr
plain.tif gray.tif inset.exr over.exr --mosaic 2x2 -d float -o OUT.exr
plain.tif gray.tif alpha.exr --mosaic:pad=3 2x2 -d float -o OUT.exr
plain.tif gray.tif --mosaic:fit=20x15:pad=2 2x1 -o OUT.exr
plain.tif --mosaic 3x1 -o OUT.tif
over.exr --flip -o OUT.exr
inset.exr --flip -o OUT.exr
over.exr --flop -o OUT.exr
inset.exr --flop -o OUT.exr
inset.exr --rotate180 -o OUT.exr
over.exr --flipflop -o OUT.exr
over.exr --rotate90 -o OUT.exr
origin.exr --rotate90 -o OUT.exr
over.exr --rotate270 -o OUT.exr
origin.exr --rotate270 -o OUT.exr
plain.tif --rotate270 -o OUT.tif
inset.exr --transpose -o OUT.exr
over.exr --transpose -o OUT.exr
parts.exr --rotate90:allsubimages=1 -d float -o OUT.exr
parts.exr --flop:subimages=1 -d float -o OUT.exr
turned1.tif --reorient -o OUT.tif
turned2.tif --reorient -o OUT.tif
turned3.tif --reorient -o OUT.tif
turned4.tif --reorient -o OUT.tif
turned5.tif --reorient -o OUT.tif
turned6.tif --reorient -o OUT.tif
turned7.tif --reorient -o OUT.tif
turned8.tif --reorient -o OUT.tif
inset.exr --cshift +20-10 -o OUT.exr
plain.tif --cshift -100+7 -o OUT.tif
inset.exr --resample 50% -o OUT.exr
over.exr --resample:interp=0 150%x70% -o OUT.exr
plain.tif --resample 61x17 -o OUT.tif
plain.tif --resample:interp=0 61x17 -o OUT.tif
over.exr --resample 61x17 -o OUT.exr
plain.tif --resize 50% -o OUT.tif
plain.tif --resize 30% -o OUT.tif
plain.tif --resize 75x0 -o OUT.tif
plain.tif --resize 0x75 -o OUT.tif
inset.exr --resize 61x13 -o OUT.exr
over.exr --resize 130%x60% -o OUT.exr
over.exr --resize:filter=box:highlightcomp=1 40% -o OUT.exr
alpha.exr --resize:filter=lanczos3 62x46 -o OUT.exr
alpha.exr --resize:filter=radial-lanczos3 62x46 -o OUT.exr
alpha.exr --resize:filter=disk 15x11 -o OUT.exr
alpha.exr --resize:filter=nuke-lanczos6 50% -o OUT.exr
parts.exr --resize:allsubimages=1 31x40 -d float -o OUT.exr
parts.exr --resize:filter=triangle 2 -o OUT.exr
parts.exr --resize 31x23 -o OUT.exr
alpha.exr --resize:from=10x8+3.5+2.25:filter=triangle 31x23 -o OUT.exr
alpha.exr --resize:to=10x8+3.5+2.25 31x23 -o OUT.exr
over.exr --resize:from=1,2,20,15:to=5x9.5+3+2:filter=cubic 24x20 -o OUT.exr
plain.tif --fit 20x20 -o OUT.tif
plain.tif --fit:pad=1 20x20 -o OUT.tif
plain.tif --fit:fillmode=width 64x20 -o OUT.tif
plain.tif --fit:fillmode=height:filter=box 30x50 -o OUT.tif
plain.tif --fit:exact=1 50x45 -o OUT.exr
alpha.exr --fit:exact=1:pad=1:highlightcomp=1 20x20 -o OUT.exr
over.exr --fit:highlightcomp=1 45x20 -o OUT.exr
origin.exr --fit:pad=1 45x20 -o OUT.exr
parts.exr --fit:allsubimages=1 45x20 -d float -o OUT.exr
plain.tif --fit 37x23 -o OUT.tif
plain.tif --pixelaspect 2.0 -o OUT.tif
plain.tif --attrib PixelAspectRatio 1.7 --attrib XResolution 72.0 --attrib YResolution 60.0 --pixelaspect 1.0 -o OUT.exr
plain.tif --pixelaspect:filter=box:highlightcomp=1 0.7 -o OUT.tif
plain.tif --rotate 30 -o OUT.tif
over.exr --rotate:recompute_roi=1 -47.5 -o OUT.exr
inset.exr --rotate:center=4,7:filter=triangle:recompute_roi=1:highlightcomp=1 90 -o OUT.exr
over.exr --warp:recompute_roi=1 0.7,0.2,0,-0.3,1.4,0,5,3,1 -o OUT.exr
plain.tif --warp:filter=triangle 1.2,0.1,0.003,-0.1,0.8,0.001,5,3,1 -o OUT.exr
over.exr --warp:wrap=periodic 0.5,0.1,0,-0.1,0.4,0,5,3,1 -o OUT.exr
alpha.exr --warp:wrap=clamp:highlightcomp=1 0.5,0.1,0,-0.1,0.4,0,5,3,1 -o OUT.exr
alpha.exr --warp:wrap=mirror 0.5,0.1,0,-0.1,0.4,0,5,3,1 -o OUT.exr
plain.tif --warp 1,0,0.05,0,1,0.05,0,0,-1 -o OUT.exr
alpha.exr st.exr --crop 31x23+0+0 --st_warp -d float -o OUT.exr
alpha.exr st.exr --crop 31x23+0+0 --st_warp:filter=triangle:chan_s=1:chan_t=2:flip_s=1:flip_t=1 -d float -o OUT.exr
"""


# a type is given where files of several types meet: oiiotool then takes that of the file it happens to read first


@pytest.mark.parametrize("chain", [line for line in CHAINS.splitlines() if line])
def test_as_oiiotool(folder: Path, chain: str):
    """The same pixels, types, windows and metadata."""
    same(folder, *chain.split())


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


@pytest.mark.parametrize(
    "chain",
    [
        "plain.tif --crop 0x0+1+1",
        "plain.tif --cut 5,5,3,3",
        "plain.tif --resize 0x0",
        "plain.tif --resize:from=5,5,3,3 10x10",
        "plain.tif --resize:filter=gausian 10x10",
        "plain.tif --fit -5x5",
        "plain.tif --pixelaspect 0",
        "plain.tif --warp 1,2,3",
        "plain.tif --rotate:center=1 30",
        "plain.tif gray.tif --paste 5",
        "plain.tif --cshift 5x5",
        "plain.tif gray.tif --st_warp",
    ],
)
def test_refused(folder: Path, chain: str):
    """In one line."""
    with pytest.raises(Error) as caught:
        run([*chain.split(), "-o", "none.exr"], folder)
    assert "\n" not in str(caught.value)
    assert not (folder / "none.exr").exists()
