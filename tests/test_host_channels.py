# SPDX-License-Identifier: Apache-2.0
"""Channels chosen, named, appended, summed, mapped: as oiiotool does it."""

from __future__ import annotations

import logging
import shlex
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex.cli.running.line_run import run
from oiiotex.errors import ParameterError
from oiiotex.host.channels import chosen_channels
from tests.conftest import load
from tests.inputs import write_inputs
from tests.peer import refused, same


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_inputs(tmp_path_factory.mktemp("channels"))


CHAINS = (
    "rgb.exr --ch B,G,R -o OUT.exr",
    "rgb.exr --ch R,G,B -o OUT.exr",
    "parts.exr --ch RGB -o OUT.exr",
    "parts.exr -a --ch B,R -o OUT.exr",
    "parts.exr --ch:allsubimages=1 R=B,G=0.5,B=R -o OUT.exr",
    "rgba.exr --ch RGB -o OUT.exr",
    "rgb.exr --ch R,G,B,A=1.0 -o OUT.exr",
    "rgb.exr --ch 2,1,0 -o OUT.exr",
    "rgb.exr --ch =0.25,R=G,X=-1.5e-1,g -o OUT.exr",
    "rgb8.png --ch 0,0,0,=0.5 -o OUT.png",
    "five.exr --ch Z -o OUT.exr",
    "five.exr --ch A,Z,R -o OUT.exr",
    "five.exr --ch 'R, G,,B' -o OUT.exr",
    "rgb.exr --ch R,G,B, -o OUT.exr",
    "rgb.exr --ch R,7 -o OUT.exr",
    "rgb.exr --ch R,Q -o OUT.exr",
    "--native rgb8.png --ch B,=1,R -o OUT.png",
    "two.exr --ch 0,1,1 -d half -o OUT.exr",
    "rgba.exr --nchannels 3 -o OUT.exr",
    "rgb.exr --nchannels 3 -o OUT.exr",
    "rgb.exr --nchannels 6 -o OUT.exr",
    "rgb8.png --nchannels 1 -o OUT.png",
    "rgb.exr gray.exr --chappend -o OUT.exr",
    "rgba.exr b.exr --chappend -o OUT.exr",
    "gray.exr rgb8.png --chappend -o OUT.exr",
    "rgb.exr rgb8.png gray.exr --chappend:n=3 -o OUT.exr",
    "rgb.exr rgb8.png rgb.exr rgb.exr --chappend:n=3 -o OUT.exr",
    "rgb.exr five.exr --ch A --chappend -d half -o OUT.exr",
    "rgb.exr --chappend gray.exr -o OUT.exr",
    "--native rgb8.png gray.exr --chappend -o OUT.exr",
    "rgb.exr --chnames X,Y,Z -o OUT.exr",
    "rgba.exr --chnames d.R,,d.B,d.A -o OUT.exr",
    "rgba.exr --chnames R,G,B,A,Z,more -o OUT.exr",
    "gray.exr --chnames depth -o OUT.exr",
    "parts.exr -a --chnames a,b,c -o OUT.exr",
    "rgba.exr --chnames ,,,alpha --premult -o OUT.exr",
    "rgba.exr --chsum -o OUT.exr",
    "rgba.exr --chsum:weight=0.2126,0.7152,0.0722,0 -o OUT.exr",
    "five.exr --chsum:weight=0.5 -o OUT.exr",
    "five.exr --chsum:weight=0.5,0.25 -o OUT.exr",
    "rgb8.png --chsum:weight=.2,.7,.1 -o OUT.png",
    "rgba.exr --maxchan -o OUT.exr",
    "five.exr --minchan -o OUT.exr",
    "rgb8.png --maxchan -o OUT.png",
    *(f"rgba.exr --colormap {name} -o OUT.exr" for name in ("inferno", "viridis", "magma", "turbo", "plasma", "heat")),
    *(f"gray.exr --colormap {name} -o OUT.exr" for name in ("blue-red", "redblue", "spectrum")),
    "two.exr --colormap 0,0,0,1,0.5,0,.1,.2,1 -o OUT.exr",
    "rgb8.png --colormap turbo -o OUT.png",
)  # fmt: skip


@pytest.mark.parametrize("chain", CHAINS)
def test_as_oiiotool(folder, chain):
    same(folder, *shlex.split(chain))


REFUSED = (
    ("rgb.exr --ch '' -o o.exr", "names no channel"),
    ("rgb.exr --ch , -o o.exr", "names no channel"),
    ("rgb.exr --nchannels 0 -o o.exr", "count=0"),
    ("rgb.exr --nchannels three -o o.exr", "count=three"),
    ("rgb.exr gray.exr --chappend:n=1 -o o.exr", "n=1"),
    ("rgb.exr gray.exr --chappend:n=3 -o o.exr", "takes 3"),
    ("rgb.exr --chsum:weight=a -o o.exr", "weight=a"),
    ("rgb.exr --colormap rainbow -o o.exr", "inferno"),
    ("rgb.exr --colormap 0,0,0,1,1 -o o.exr", "two colours"),
    ("rgb.exr --colormap 0,0,0 -o o.exr", "two colours"),
)


@pytest.mark.parametrize(("chain", "says"), REFUSED)
def test_refused(folder, chain, says):
    refused(folder, chain, says)


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
