# SPDX-License-Identifier: Apache-2.0
"""What is printed, word for word as the wheel's own oiiotool prints it; and where we depart from it on purpose."""

from __future__ import annotations

import shlex
import subprocess

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex.engine.core.demand import sha1
from oiiotex.engine.errors import Error
from oiiotex.engine.io.reading import read
from oiiotex.oiiotool.cli.printing.comparing import Thresholds, compare
from oiiotex.oiiotool.cli.printing.metadata import shortest
from oiiotex.oiiotool.cli.running.line_run import run

from ..peer import OIIOTOOL

pytestmark = pytest.mark.skipif(not OIIOTOOL.exists(), reason="the OpenImageIO wheel has no oiiotool")

CONFIG = "ocio://cg-config-v4.0.0_aces-v2.0_ocio-v2.5"


def _write(path, *images):
    out = oiio.ImageOutput.create(str(path))
    specs = tuple(spec for spec, _ in images)
    assert out.open(str(path), specs[0] if len(specs) == 1 else specs), out.geterror()
    for number, (spec, pixels) in enumerate(images):
        if number:
            assert out.open(str(path), spec, "AppendSubimage"), out.geterror()
        assert out.write_image(np.ascontiguousarray(pixels)), out.geterror()
    out.close()


def _spec(width, height, channels, kind, **attributes):
    spec = oiio.ImageSpec(width, height, channels, kind)
    for name, value in attributes.items():
        spec.attribute(name.replace("__", ":"), value)
    return spec


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("printing")
    rng = np.random.default_rng(7)
    photo = rng.integers(0, 256, (90, 70, 3), np.uint8)
    # escaped characters, and a name without a space of its own
    _write(
        folder / "photo.png",
        (_spec(70, 90, 3, oiio.UINT8, Artist='A "quoted" \\ name', DateTime="2020:01:01 00:00:00"), photo),
    )
    other = photo.copy()
    other[40:44, 3:9] ^= 3
    other[80, 60, 1] ^= 255
    _write(folder / "other.png", (_spec(70, 90, 3, oiio.UINT8), other))
    off_by_one = photo.copy()
    off_by_one[::9, ::7] ^= 1
    _write(folder / "off_by_one.png", (_spec(70, 90, 3, oiio.UINT8), off_by_one))
    _write(folder / "gray.png", (_spec(5, 3, 1, oiio.UINT8), rng.integers(0, 256, (3, 5, 1), np.uint8)))
    _write(folder / "flat.tif", (_spec(9, 7, 3, oiio.UINT16), np.full((7, 9, 3), 12345, np.uint16)))
    window = _spec(50, 40, 3, oiio.UINT16)
    window.x, window.y, window.full_width, window.full_height = 20, 10, 100, 80
    _write(folder / "window.tif", (window, rng.integers(0, 65536, (40, 50, 3), np.uint16)))
    first = _spec(64, 72, 4, oiio.HALF, oiio__subimagename="first", Description="two\nlines")
    first.attribute("worldToCamera", oiio.TypeMatrix, tuple(float(n) for n in range(16)))
    second = _spec(32, 20, 1, oiio.FLOAT, oiio__subimagename="second")
    second.x, second.y, second.full_width, second.full_height = 5, 7, 64, 72
    second.channelnames = ("Y",)
    parts = [rng.random((72, 64, 4)).astype(np.float16), rng.normal(0, 3, (20, 32, 1)).astype(np.float32)]
    _write(folder / "parts.exr", (first, parts[0]), (second, parts[1]))
    changed = [parts[0].copy(), parts[1] + np.float32(1e-3)]
    _write(folder / "parts2.exr", (first, changed[0]), (second, changed[1]))
    mixed = _spec(6, 5, 3, oiio.FLOAT)
    mixed.channelnames, mixed.channelformats = ("R", "G", "Z"), (oiio.TypeHalf, oiio.TypeHalf, oiio.TypeFloat)
    _write(folder / "mixed.exr", (mixed, rng.random((5, 6, 3)).astype(np.float16).astype(np.float32)))
    hdr = (rng.random((33, 21, 3)) * 50 - 10).astype(np.float32)
    _write(folder / "hdr.exr", (_spec(21, 33, 3, oiio.FLOAT), hdr))
    odd = hdr.copy()
    odd[4, 5], odd[6, 7, 1], odd[8, 9, 2] = np.nan, np.inf, -np.inf
    _write(folder / "odd.exr", (_spec(21, 33, 3, oiio.FLOAT), odd))
    odd[10, 2] = 7
    _write(folder / "odd2.exr", (_spec(21, 33, 3, oiio.FLOAT), odd))
    _write(folder / "one.exr", (_spec(1, 1, 5, oiio.FLOAT), np.array([[[0.5, 0.1, -2, 1, 1e-7]]], np.float32)))
    _write(folder / "five.tif", (_spec(7, 4, 5, oiio.FLOAT), rng.normal(0, 1, (4, 7, 5)).astype(np.float32)))
    subprocess.run([OIIOTOOL, "photo.png", "-d", "half", "-otex:tile=16x16", "mip.exr"], cwd=folder, check=True)
    subprocess.run([OIIOTOOL, "other.png", "-d", "half", "-otex:tile=16x16", "mip2.exr"], cwd=folder, check=True)
    return folder


def _same(folder, capsys, line):
    words = shlex.split(line)
    theirs = subprocess.run([OIIOTOOL, *words], cwd=folder, capture_output=True, text=True)
    status = run(words, folder)
    ours = capsys.readouterr().out
    assert ours == theirs.stdout
    assert status == (theirs.returncode != 0)


INFO = [
    "--info photo.png",
    "--info photo.png window.tif five.tif gray.png",
    "--info -v photo.png",
    "--info:verbose=1 photo.png",
    "--info:verbose=1 window.tif",
    "--info:verbose=1 hdr.exr",
    "--info parts.exr",
    "--info:verbose=1 parts.exr",
    "--info mixed.exr mip.exr",
    "--info:verbose=1 mixed.exr mip.exr",
    "-a --info parts.exr",
    "-a -v --info parts.exr",
    "-a -v --info mip.exr",
    "--info:format=xml photo.png",
    "--info:format=xml:verbose=1 parts.exr",
    "-a --info:format=xml:verbose=1 --hash parts.exr mip.exr",
    "-a --info:verbose=1:format=xml mip.exr",
    "--hash photo.png",
    "--hash mip.exr one.exr window.tif odd.exr",
    "-a --info:verbose=1 --hash parts.exr mixed.exr mip.exr",
    "--stats photo.png",
    "--stats window.tif flat.tif",
    "--stats odd.exr one.exr gray.png five.tif",
    "-a --stats parts.exr",
    "-a --info -v --stats mip.exr",
    "--stats mip.exr",
    "--metamatch oiio --info:verbose=1 parts.exr",
    "--metamatch 'resolution|compression' --info:verbose=1 parts.exr",
    "--metamatch res --info:verbose=1 mip.exr",
    "--metamatch 'date|sha|STATS' --info:verbose=1 --hash --stats photo.png",
    "--metamatch artist --info photo.png",
    "--no-metamatch 'oiio|date' --info:verbose=1 parts.exr",
    "--no-metamatch '^ +oiio:[[:alpha:]]' --metamatch 'oiio|tiff' --info:verbose=1 window.tif",
    "--dumpdata gray.png",
    "--dumpdata:C=pixels gray.png",
    "--dumpdata:empty=0 one.exr",
    "--dumpdata:C=data one.exr",
    "--info --dumpdata odd.exr",
    "--dumpdata:C=data mixed.exr",
    "--dumpdata flat.tif",
    "--dumpdata:C=data -a --stats mip.exr",
]

TOP = [
    "photo.png --printinfo",
    "photo.png --printinfo:native=1",
    "photo.png --printinfo:verbose=0",
    "parts.exr --printinfo",
    "parts.exr --printinfo:allsubimages=1:stats=1",
    "-a parts.exr --printinfo:native=1",
    "-a parts.exr --printinfo:verbose=0",
    "mixed.exr --printinfo --printinfo:native=1",
    "mip.exr --printinfo --printinfo:native=1:verbose=0",
    "-a mip.exr --printinfo:stats=1",
    "--native mip.exr --printinfo",
    "--stats photo.png --printinfo",
    "--metamatch oiio photo.png --printinfo",
    "photo.png --add photo.png --printinfo",
    "--create 6x4 3 --printinfo:stats=1",
    "photo.png --crop 10x10+5+5 --printinfo",
    "window.tif --attrib Artist me --printinfo",
    "photo.png --printstats",
    "window.tif --printstats:window=10x10+60+40",
    "window.tif --printstats:window=0,0,39,39",
    "-a parts.exr --printstats",
    "-a mip.exr --printstats",
    "parts.exr --printstats:allsubimages=1",
    "odd.exr --printstats",
    "flat.tif --addc 0.5 --printstats",
    "flat.tif --colorcount 0.18837:0,0,0",
    "photo.png --colorcount:eps=.1,.2,.3 '.5,.5,.5;1;0.2,,0.1'",
    "odd.exr --colorcount 7,7,7",
    "hdr.exr --rangecheck 0 1",
    "odd.exr --rangecheck 0,0,0 30,20,10",
    "five.tif --rangecheck -1,-.5 1,,0.5",
    "--echo hello --echo:newline=0 a --echo:newline=3 b",
    "photo.png --echo '{TOP.width}x{TOP.height} {TOP.METABRIEF}'",
    "parts.exr --echo '{TOP.META}' --echo '{TOP.METANATIVE}' --echo '{TOP.METANATIVEBRIEF}'",
    "window.tif --echo '{TOP.STATS} {TOP.MINCOLOR} {TOP.MAXCOLOR} {TOP.AVGCOLOR} {TOP.NONFINITE_COUNT}'",
    "odd.exr --echo '{TOP.NONFINITE_COUNT} {TOP.IS_CONSTANT}' flat.tif --echo '{TOP.IS_CONSTANT} {TOP.IS_BLACK}'",
    "--list-formats --buildinfo",
    f"--colorconfig {CONFIG} --colorconfiginfo",
]

DIFF = [
    "photo.png photo.png --diff",
    "photo.png other.png --diff",
    "-v photo.png photo.png --diff",
    "-v photo.png other.png --diff",
    "--warn 0.001 --fail 2 photo.png off_by_one.png --diff",
    "--fail 0.5 --warn 0.1 photo.png other.png --diff",
    "--fail 0.01 --failpercent 2 photo.png other.png --diff",
    "--fail 0.01 --failpercent 2 --warnpercent 50 photo.png off_by_one.png --diff",
    "--fail 1 --warn 1 --hardwarn 0.01 photo.png other.png --diff",
    "--fail 12345678 --warn 123456 --hardfail 0.01 photo.png other.png --diff",
    "photo.png window.tif --diff",
    "window.tif photo.png --diff",
    "photo.png five.tif --diff",
    "five.tif photo.png --diff",
    "hdr.exr gray.png --diff",
    "odd.exr odd.exr --diff",
    "odd.exr odd2.exr --diff",
    "parts.exr parts2.exr --diff",
    "-a parts.exr parts2.exr --diff",
    "-a -v parts.exr parts.exr --diff",
    "-a parts.exr photo.png --diff",
    "-a parts2.exr parts.exr --fail 0.1 --warn 1e-4 --diff",
    "mip.exr mip2.exr --diff",
    "-a mip.exr mip2.exr --diff",
    "-a mip.exr photo.png --diff",
    "--diff photo.png photo.png",
    "photo.png other.png --diff --diff --echo after",
    "photo.png photo.png --pdiff",
    "photo.png other.png --pdiff",
    "hdr.exr window.tif --pdiff",
    "--failpercent 1 -v photo.png other.png --pdiff",
    "photo.png other.png --flipdiff",
    "photo.png other.png --flipdiff:hdr=0 --printinfo",
    "photo.png other.png --flipdiff:hdr=0:colormap=magma:ppd=40 --printinfo",
    "photo.png photo.png --flipdiff:fail=0.1",
    "photo.png other.png --flipdiff:fail=0.1:print=0",
    "photo.png other.png --flipdiff:fail=0.999:print=0:hdr=0",
    "hdr.exr five.tif --flipdiff:hdr=1:tonemapper=hable",
]


SAID = [
    "-v photo.png other.png --echo hi --add -o said.png",
    "photo.png -v --echo hi -o said.png",
    "photo.png --info -v other.png",
    "-v photo.png --label x --flip x --add -o said.png",
    "-v -n photo.png -o said.png",
    "-v photo.png --echo '{TOP.width}'",
    "-v photo.png --printinfo other.png -o said.png",
    "-v --pattern fill:color=1,0,0 8x8 3 -o said.png",
    "--testread photo.png",
    "-v --testread photo.png",
    r"--echo 'a\nb\tc\101\\d\q'",
    "--echo:newline=2 'x' --echo:newline=0 y",
    "photo.png --flip other.png --flop --diff",
    "photo.png --flip --label x other.png --addc 0.1 --diff",
    "photo.png --dup --addc 0.1 --flipdiff",
    "photo.png --resize 50% --echo '{TOP.filename} {TOP.file_extension} {TOP.file_noextension}'",
    "photo.png --attrib a b --crop 9x9 --echo '{TOP.filename}'",
    "photo.png --flip --attrib a b --crop 9x9 --echo '{TOP.filename}'",
    "photo.png other.png --add --abs --dup --echo '{TOP.filename}'",
    "photo.png --resize 70x90 --echo '{TOP.filename}'",
    "photo.png --native --addc 0.5 --printinfo:verbose=0",
    "photo.png --addc 0 --native --addc 0.5 --printinfo:verbose=0",
    "photo.png --addc 0.5 --printstats:native=1",
    "photo.png --printstats:native=1",
    "flat.tif --printstats:native=1",
    "photo.png --attrib:type=timecode smpte:TimeCode 01:02:03:04 --printinfo",
    "photo.png other.png '-o:all=1' '{TOP.file_noextension}_said.png' --echo done",
]


@pytest.mark.parametrize("line", SAID)
def test_what_is_said_is_what_oiiotool_says(folder, capsys, line):
    _same(folder, capsys, line)


TITLES = """
    addc:1 mulc:2 abs invert contrast saturate:2 rangecompress premult chsum maxchan flip flop rotate90 transpose
    cshift:+1+1 resample:50% pixelaspect:2 warp:1,0,0,0,1,0,0,0,1 rotate:10 blur:3x3 median:3x3 unsharp laplacian
    fillholes fft colormap:inferno clamp fixnan:box3 ch:R chnames:A,B,C,D attrib:a,b origin:+1+1 fullpixels cut:4x4
    fit:20x20 box:1,1,2,2 fill:2x2 reorient orient180 erode:3x3 powc:2 normalize
"""


@pytest.mark.parametrize("op", TITLES.split())
def test_what_ops_make_is_called_as_oiiotool_calls_it(folder, capsys, op):
    name, _, arguments = op.partition(":")
    words = arguments.split(",") if name == "attrib" else [arguments] * bool(arguments)
    _same(folder, capsys, shlex.join(["parts.exr", f"--{name}", *words, "--echo", "{TOP.filename}"]))


@pytest.mark.parametrize("line", INFO)
def test_inputs_are_described_as_oiiotool_describes_them(folder, capsys, line):
    _same(folder, capsys, line)


@pytest.mark.parametrize("line", TOP)
def test_the_top_image_is_described_as_oiiotool_describes_it(folder, capsys, line):
    _same(folder, capsys, line)


@pytest.mark.parametrize("line", DIFF)
def test_images_are_compared_as_oiiotool_compares_them(folder, capsys, line):
    _same(folder, capsys, line)


def test_the_error_map_is_that_of_oiiotool(folder):
    from ..peer import same

    same(folder, "photo.png", "other.png", "--flipdiff", "-d", "float", "-o", "OUT.exr", tolerance=1e-6)


def test_lone_nans_count_as_different(folder, capsys):
    _ = capsys
    a, b = read(folder / "hdr.exr").first, read(folder / "odd.exr").first
    found = compare(a, b, Thresholds())
    assert found.max_error == np.inf and (found.x, found.y, found.channel) == (5, 4, 0)
    assert found.failed == found.warned == 3 and found.mean == found.rms == 0


def test_the_hash_equals_that_of_the_whole_image(folder):
    part = read(folder / "window.tif").first
    buffer = oiio.ImageBuf(str(folder / "window.tif"))
    assert sha1(part) == oiio.ImageBufAlgo.computePixelHashSHA1(buffer)


def test_a_hash_that_would_be_wrong_is_refused(folder, tmp_path):
    spec = oiio.ImageSpec(4, 3, 2, oiio.FLOAT)
    spec.channelnames, spec.channelformats = ("R", "id"), (oiio.TypeFloat, oiio.TypeUInt)
    _write(tmp_path / "ids.exr", (spec, np.ones((3, 4, 2), np.float32)))
    with pytest.raises(Error, match="both integer and float channels"):
        run(["--hash", "ids.exr"], tmp_path)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"), (1.0, "1"), (-0.5, "-0.5"), (np.float32(1e-6), "1e-06"), (np.float32(0.1), "0.1"), (0.1, "0.1"),
        (np.float32(1234567), "1234567"), (np.float32(12345678), "1.2345678e+07"), (12345678.0, "12345678"),
        (1e16, "1e+16"), (1e15, "1000000000000000"), (0.0001, "0.0001"), (0.00001, "1e-05"), (1e100, "1e+100"),
        (np.inf, "inf"), (-np.inf, "-inf"), (np.nan, "nan"), (np.float32(-1e-10), "-1e-10"),
    ],
)  # fmt: skip
def test_numbers_are_written_as_the_fmt_library_writes_them(value, text):
    assert shortest(value) == text


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("photo.png --rangecheck a 1", "expected a comma-separated list of numbers"),
        ("photo.png --colorcount 1,x", "expected a comma-separated list of numbers"),
        ("--fail much photo.png photo.png --diff", "expected a number"),
        ("--metamatch '(' --info photo.png", "expected a regular expression"),
        ("photo.png --printstats:window=0x0+0+0", "expected a region with at least one pixel"),
        ("photo.png --diff", "2 image"),
        ("--info:format=json photo.png", "expected"),
        (
            "--cache 1 hdr.exr photo.png --add photo.png --resize 400x400 --dup --flipdiff",
            "MB of memory; the budget is 1 MB",
        ),
    ],
)
def test_what_cannot_be_done_is_said(folder, line, message):
    with pytest.raises(Error, match=message):
        run(shlex.split(line), folder)
