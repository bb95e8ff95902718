# SPDX-License-Identifier: Apache-2.0
"""Lines in the manner of pipelines that take oiiotool from a path: conversion, thumbnails, sequences, information."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from oiiotex.engine.color.config import DEFAULT_CONFIG

from ..conftest import oiiotex
from ..peer import OIIOTOOL, assert_same_file, same

COLOR = "--colorconvert:subimages=0 ACEScg sRGB"
LINES = [
    "--compression none -i:ch=R,G,B,A=1.0 shot.0001.exr --ch R,G,B,A --eraseattrib comments -o OUT.exr",
    f"--nosoftwareattrib --colorconfig {DEFAULT_CONFIG} shot.0001.exr {COLOR} -d uint8 --compression zip -o OUT.png",
    "-i:ch=R,G,B shot.0001.exr --subimage 0 --fit:pad=1 48x48 --iscolorspace ACEScg --ociodisplay default default"
    " -d uint8 -o OUT.jpg",
    "shot.0001.exr --ch R=R,G=R,B=R,A=A --attrib:type=string note made --crop 20x16+3+2 -o OUT.exr",
    "shot.0001.exr --oiioattrib try_all_readers 0 --dup --flop --over --resize 50% -d uint16 -o OUT.tif",
    *(f"--colorconfig {DEFAULT_CONFIG} layers.exr --ch R=R,G=G,B=B,A=A {COLOR} {how}"
      for how in ("-d uint8 -o OUT.png", "-o OUT.jpg", "-d uint10 -o OUT.dpx", "-d half -o OUT.exr")),
    "layers.exr -o OUT.png",
    "-i:ch=R,G,B,A shot.0001.exr --ch R=R,G=G,B=B,A=A --resize 20x13 -o OUT.exr",
    "-a layers.exr --ch R,G,B -o OUT.jpg",
    "-i:ch=R,G,B,A shot.0001.exr --ch R=R,G=G,B=B,A=A --subimage 0 --resize:filter=lanczos3 20x13 --origin +0+2"
    " --fullsize 20x17 --pattern constant:color=0.100,0.200,0.300,1.000 20x17 4 --over -d uint8 -o OUT.png",
    f"--colorconfig {DEFAULT_CONFIG} -i:ch=R,G,B shot.0001.exr --ch R=R,G=G,B=B --ociodisplay:inverse=1:subimages=0"
    " default default --colorconvert:subimages=0 scene_linear ACES2065-1 -d half -o OUT.exr",
]  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A shot of renders: color in half, depth in float."""
    there = tmp_path_factory.mktemp("vendors")
    for number in range(1, 4):
        words = f"--pattern noise:seed={number}:mean=0.4:stddev=0.1 36x24 5 --chnames R,G,B,A,Z -d half -d Z=float"
        words += f" --attrib comments x -o shot.{number:04}.exr"
        subprocess.run([OIIOTOOL, *words.split()], cwd=there, check=True)
    layers = "--pattern noise 36x24 4 --chnames R,G,B,A --attrib oiio:subimagename rgba --pattern noise 36x24 3"
    layers += " --chnames N.X,N.Y,N.Z --attrib oiio:subimagename N --siappend -d half -o layers.exr"
    subprocess.run([OIIOTOOL, *layers.split()], cwd=there, check=True)
    return there


@pytest.mark.parametrize("line", LINES)
def test_files_are_the_same(folder, line):
    same(folder, *line.split())


def test_sequences_are_the_same(folder):
    words = f"--frames 1-3 --parallel-frames -i:ch=R,G,B shot.#.exr {COLOR} -d uint16 -o"
    subprocess.run([OIIOTOOL, *words.split(), "theirs.#.tif"], cwd=folder, check=True)
    assert oiiotex(*words.split(), "ours.#.tif", cwd=folder).returncode == 0
    for number in range(1, 4):
        assert_same_file(folder / f"ours.{number:04}.tif", folder / f"theirs.{number:04}.tif")


def test_information_is_the_same(folder):
    words = ["--info", "-v", "-a", "-i:infoformat=xml", "shot.0001.exr"]
    theirs = subprocess.run([OIIOTOOL, *words], cwd=folder, check=True, capture_output=True, text=True).stdout
    assert oiiotex(*words, cwd=folder).stdout == theirs and "<ImageSpec" in theirs
