# SPDX-License-Identifier: Apache-2.0
"""Chains by number through oiiotool and oiiotex: `python -m tests.generated_chains FIRST COUNT` says where they differ.

A number always stands for the same chain, so those that nobody has looked at yet stay unseen until they are run.
"""

from __future__ import annotations

import contextlib
import io
import os
import random
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from oiiotex.engine.errors import Error
from oiiotex.oiiotool.cli.running.line_run import run
from tests.conftest import save
from tests.peer import OIIOTOOL, assert_same_file, facts

_IMAGES = ("a.png", "c.exr", "b.exr", "g.tif", "--pattern checker:width=3 20x14 3", "--create 16x12 3", "d.exr")
_UNARY = (
    "--addc {v}", "--subc {v}", "--mulc {v}", "--divc 2", "--powc 2", "--abs", "--invert", "--clamp:min=0.2:max=0.7",
    "--contrast:black=0.1:white=0.8", "--saturate 0.5", "--rangecompress", "--rangeexpand", "--maxc {v}", "--minc {v}",
    "--absdiffc {v}", "--noise:type=uniform:seed={n}", "--fixnan black", "--flip", "--flop", "--transpose",
    "--rotate90", "--rotate180", "--rotate270", "--cshift +{n}+1", "--crop {w}x{h}+1+2", "--crop {w}x{h}-2-1",
    "--cut {w}x{h}+2+1", "--croptofull", "--fullpixels", "--trim", "--origin +{n}-3", "--originoffset +2-1",
    "--fullsize 20x18-1-1", "--resize {w}x{h}", "--resize 50%", "--resize:filter=box {w}x0", "--resample {w}x{h}",
    "--fit {w}x{h}", "--fit:pad=1 {w}x{h}", "--fit:fillmode=width {w}x{h}", "--pixelaspect 2",
    "--rotate {n}0", "--rotate:filter=triangle 30", "--warp 0.8,0.1,0,-0.1,0.9,0,1,2,1", "--blur 3x3",
    "--blur:kernel=box 3x5", "--median 3x3", "--dilate 3x3", "--erode 3x3", "--unsharp", "--laplacian",
    "--unsharp:kernel=median:width=3", "--ch R,G,B", "--ch B,G,R", "--ch R,G,B,A=1.0", "--ch 0", "--chnames x,y,z",
    "--chsum:weight=.2,.7,.1", "--maxchan", "--minchan", "--premult", "--unpremult", "--box:color=1,.5,.2 1,1,6,5",
    "--box:fill=1:color=.1,.2,.9 2,2,9,8", "--line:color=1,0,0 0,0,9,7", "--point:color=0,1,0 3,4",
    "--fill:color=.2,.4,.6 8x6+2+1", "--fill:top=0,0,0:bottom=1,1,1 10x8+1+1", "--colormap viridis",
    "--attrib foo {n}", "--sattrib artist me", "--keyword k", "--eraseattrib foo", "--iscolorspace lin_rec709_scene",
    "--tocolorspace ACEScg", "--colorconvert sRGB lin_rec709_scene", "--ccmatrix .5,.2,.1,.1,.8,.1,0,.1,.9",
    "--caption hello", "--orientation 6", "--reorient", "--normalize", "--polar --unpolar", "--limitchannels 3",
    "--dup --over", "--swap --swap", "--mosaic 1x1", "--ociolook ''", "--clear-keywords", "--zover",
)  # fmt: skip
_BINARY = (
    "--add", "--sub", "--mul", "--div", "--absdiff", "--min", "--max", "--over", "--paste +{n}+1", "--paste -2-1",
    "--chappend", "--mosaic 2x1", "--mosaic:pad=2 1x2", "--siappend --ch R,G", "--pastemeta", "--swap --pop",
    "--mulc 0.5 --add",
)  # fmt: skip
_OUTPUTS = ("-o OUT.exr", "-o OUT.tif", "-d uint8 -o OUT.png", "-d half -o OUT.exr", "-d uint16 -o OUT.tif",
            "-d float -o OUT.tif", "--compression zip -o OUT.exr", "--tile 16 16 -o OUT.exr", "-o OUT.png")  # fmt: skip
_CONTROL = (
    "--if '{{TOP.width > 15}}' --mulc 0.5 --else --addc 0.1 --endif", "--for i 0,3 --addc '{{i/10}}' --endfor",
    "--set v {v} --addc '{{v}}'", "--label L --addc .1 L --add", "--mulc '{{TOP.height/20}}'",
    "--resize '{{TOP.width+2}}x{{TOP.height-1}}'", "--attrib w '{{TOP.width}}'",
)  # fmt: skip


def make_images(folder: Path) -> None:
    """What the chains read."""
    dice = np.random.default_rng(3)
    save(dice.random((12, 16, 3)), folder / "a.png")
    save(dice.random((10, 14, 4)), folder / "b.exr", "half", "ACEScg", x=-2, y=1, full_width=18, full_height=13)
    save(2 * dice.random((12, 16, 3)) - 0.3, folder / "c.exr", "float")
    save(
        dice.random((12, 16, 4)), folder / "d.exr", "half", x=3, y=2, full_x=1, full_y=1, full_width=20, full_height=16
    )
    save(dice.random((12, 16, 1)), folder / "g.tif", "uint16")


def chain(number: int) -> list[str]:
    """The words of that chain."""
    dice = random.Random(number)
    values = {"v": dice.choice(("0.25", ".1,.2,.3", "-0.5", "1.5")), "n": dice.randint(1, 4)}
    values |= {"w": dice.randint(5, 24), "h": dice.randint(4, 20)}
    pieces = [dice.choice(_IMAGES)]
    for _ in range(dice.randint(1, 5)):
        kind = dice.randrange(10)
        if kind < 6:
            pieces.append(dice.choice(_UNARY))
        elif kind < 8:
            pieces += [dice.choice(_IMAGES), dice.choice(_BINARY)]
        elif kind < 9:
            pieces.append(dice.choice(_CONTROL))
        else:
            pieces.append(dice.choice(_OUTPUTS).replace("OUT.", "OUT.0."))
    pieces.append(dice.choice(_OUTPUTS))
    return shlex.split(" ".join(piece.format(**values) for piece in pieces))


def difference(words: list[str], folder: Path) -> str:
    """In what the programs differ: '' where they agree, in files that both write or in that both refuse."""
    for entry in folder.glob("*s.*"):
        if entry.name.startswith(("ours.", "theirs.")):
            entry.unlink()
    done = subprocess.run([OIIOTOOL, *(word.replace("OUT.", "theirs.") for word in words)], cwd=folder,
                            capture_output=True, text=True)  # fmt: skip
    said = ""
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            status = run([word.replace("OUT.", "ours.") for word in words], folder)
    except Error as error:
        status, said = 1, str(error)
    if (status == 0) != (done.returncode == 0):
        return f"oiiotool exits {done.returncode}, we {status}: {said or done.stderr.strip()[:200]}"
    if status:
        return ""
    for name in sorted({word for word in words if word.startswith("OUT.")}):
        try:
            assert_same_file(folder / name.replace("OUT.", "ours."), folder / name.replace("OUT.", "theirs."), 2e-6)
        except AssertionError as error:
            ours, theirs = (facts(oiio.ImageBuf(str(folder / name.replace("OUT.", who))).spec())
                            for who in ("ours.", "theirs."))  # fmt: skip
            keys = {*ours, *theirs} - {"oiio:SourcePath"}
            unlike = {key: (ours.get(key), theirs.get(key)) for key in keys if ours.get(key) != theirs.get(key)}
            return f"{name}: {unlike or ' '.join(str(error).split())[:300]}"
    return ""


def main() -> None:
    """Run so many chains from a number on."""
    first, count = map(int, sys.argv[1:])
    agree = 0
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        make_images(folder)
        os.environ.setdefault("OIIOTEX_DEVICE", "cpu")
        for number in range(first, first + count):
            words = chain(number)
            text = difference(words, folder)
            agree += not text
            if text:
                print(f"{number}: {shlex.join(words)}\n    {text}", flush=True)
    print(f"{agree} of {count} agree", flush=True)


if __name__ == "__main__":
    main()
