# SPDX-License-Identifier: Apache-2.0
"""Frame sequences: the same command lines as the installed oiiotool makes of the words."""

import re
import subprocess

import numpy as np
import OpenImageIO as oiio
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from oiiotex.engine.errors import ParameterError
from oiiotex.oiiotool.cli.language.sequences import MOST_FRAMES, Frame, frame_numbers
from oiiotex.oiiotool.cli.language.sequences import frames as all_frames
from tests.conftest import oiiotex, save
from tests.peer import OIIOTOOL


def frames(words, takes=lambda option: int(option in ("-i", "--i") or option.startswith("-o"))):
    return all_frames(words, takes)


# Names only: oiiotool resolves the words before it opens any file, and --debug prints what it makes of them.
FILES = """
    a.0001.tif a.0002.tif a.0005.tif a.12345.tif a.00007.tif a.01.tif
    b.0011.tif b.0012.tif b.0015.tif b.0020.tif b.0030.tif
    c.1.tif c.2.tif c.10.tif c.003.tif c.-4.tif c.x.tif
    d/x_8.tif d/x_9.tif d/x_10.tif d/x_0008.tif
    neg.-0005.tif lit#.tif brackets[1](2){3}.0001.tif brackets[1](2){3}.0002.tif
    s.left.0001.tif s.right.0001.tif s.left.0003.tif s.right.0003.tif s.mid.0001.tif
    left/l.0001.tif left/l.0002.tif right/r.0001.tif right/r.0002.tif
"""
SEQUENCES = {
    "scan": "a.#.tif",
    "scan, output follows": "a.#.tif -o out.#.tif",
    "scan, output in another padding": "a.#.tif -o out.@@.tif",
    "scan, output with printf": "a.#.tif -o out.%d.tif",
    "scan, output padded with blanks": "a.#.tif -o out.%6d.tif",
    "scan by one digit": "c.@.tif",
    "scan by three digits": "a.@@@.tif",
    "scan by printf": "a.%04d.tif",
    "scan by %03d": "c.%03d.tif",
    "scan in a folder": "d/x_%01d.tif",
    "scan, doubled slashes": "d//x_#.tif",
    "scan, dot slash": "./a.#.tif",
    "scan by %d finds nothing": "c.%d.tif",
    "scan by %4d finds nothing": "a.%4d.tif",
    "scan, no folder": "nowhere/a.#.tif",
    "scan, no files": "nothing.#.tif",
    "scan, brackets in the name": "brackets[1](2){3}.#.tif",
    "scan, two inputs pair by order": "a.#.tif b.#.tif -o out.#.tif",
    "scan, first input's numbers": "b.#.tif a.#.tif -o out.#.tif",
    "scan, unequal": "a.#.tif c.@.tif",
    "scan, second without files": "a.#.tif --echo frame#",
    "scan with --framepadding": "a.#.tif --framepadding 5",
    "output only": "--create 1x1 3 -o out#.tif",
    "output before input": "-o out#.tif a.#.tif",
    "output twice": "a.#.tif -o x.#.tif -otex y.@.tif -o:all=1 z.%04d.tif",
    "literal file named like a sequence": "lit#.tif",
    "range in the name": "img.1-3#.exr",
    "range with a step in the name": "img.1-10x2#.exr -o out.#.exr",
    "range in the name, complement": "img.1-10y3@.exr",
    "range in the name, several": "img.1,3,7-9,20-10x5#.exr -o out.@@@.exr",
    "range in the name, for output only": "a.#.tif -o out.11-15#.tif",
    "range in the name, unequal": "img.1-3#.exr -o out.1-4#.exr",
    "range in the name before --frames": "img.1-3#.exr --frames 5-7 -o out.#.exr",
    "range in the name, printf": "img.1-3%04d.exr",
    "range in the name, negative is none": "neg.-5-5#.tif",
    "range in the name, negative step": "img.1-5x-2#.exr",
    "range in the name, step 0": "img.1-3x0#.exr",
    "range in the name after digits": "v2-5-10#.exr",
    "range in the name, empty": "img.1-3y1#.exr",
    "single number in the name": "v3#.exr",
    "--frames": "--frames 1-3 a.#.tif",
    "--frames behind": "a.#.tif -o out.#.tif --frames 1-10x3",
    "--frames with one dash": "-frames 1-3 a.#.tif",
    "--frames twice, the last counts": "--frames 1-3 a.#.tif --frames 7",
    "--frames without wildcards": "--frames 3-5 --create 1x1 3",
    "--frames reversed": "--frames 5-1 a.#.tif",
    "--frames reversed with a step": "--frames 10-1x3 a.#.tif",
    "--frames, step below 0 swaps": "--frames 1-10x-3 a.#.tif",
    "--frames, step below 0, reversed": "--frames 10-1x-3 a.#.tif",
    "--frames, step 0": "--frames 1-3x0 a.#.tif",
    "--frames, complement": "--frames 1-10y2 a.#.tif",
    "--frames, reversed complement": "--frames 10-1y2 a.#.tif",
    "--frames, complement of all": "--frames 1-10y1 a.#.tif",
    "--frames, complement of all, own range": "--frames 1-10y1 a.1-2#.tif",
    "--frames, negative": "--frames -5--3,-1-1 a.#.tif b.@.tif c.%d.tif d.%3d.tif",
    "--frames, plus": "--frames +1-+3 a.#.tif",
    "--frames, repeated": "--frames 1,1,2-1 a.#.tif",
    "--frames, blanks": ["--frames", " 1 - 3 , 7", "a.#.tif"],
    "--frames, empty": ["--frames", "", "a.#.tif"],
    "--frames, wide numbers": "--frames 99998-100001 a.#.tif b.@.tif",
    "padding 1 of @": "--frames 7,77 a.@.tif",
    "padding of mixed signs": "--frames 7 a.#@#@@.tif",
    "padding of printf": "--frames 7,-7 a.%03d.tif b.%0d.tif c.%d.tif d.%00012d.tif",
    "--framepadding": "--frames 7 --framepadding 6 a.#.tif b.@.tif c.%03d.tif",
    "--framepadding twice": "--framepadding 6 --frames 7 a.#.tif --framepadding 2",
    "--framepadding 10 is not for names": "--framepadding 10 --frames 7 a.#.tif",
    "--framepadding of negative frames": "--framepadding 4 --frames -7 a.#.tif",
    "only the first wildcard": "--frames 1-2 a.#.#.@.tif",
    "doubled percent": "--frames 1-2 a%%.#.tif b%%04d.tif",
    "doubled slashes": "--frames 1-2 a//b///c.#.tif",
    "words of options": "--frames 1-2 --echo frame@ --attrib Caption 5%done",
    "modifiers": "--frames 1-2 --create:x=#.tif 1x1 3",
    "modifiers of -o are not scanned": "--frames 1-2 a.#.tif -o:x=# out.tif",
    "-o:all": "--frames 1-2 a.#.tif -o:all=1 out.%04d.tif",
    "--wildcardoff": "--frames 1-2 a.#.tif --wildcardoff b.#.tif --wildcardon c.#.tif",
    "--wildcardoff with one dash": "--frames 1-2 -wildcardoff a.#.tif",
    "--wildcardoff, no sequence": "--wildcardoff lit#.tif",
    "--wildcardoff in an output": "--frames 1-2 a.#.tif --wildcardoff -o out.#.tif",
    "--wildcardoff does not hide --frames": "--wildcardoff --frames 1-2 a.#.tif",
    "--parallel-frames": "--parallel-frames --threads 1 --frames 1-3 a.#.tif",
    "views, scan": "s.%V.#.tif -o out.%v.@@.tif",
    "views, output without one": "s.%V.#.tif -o out.#.tif",
    "views, named": "--views right,mid,left s.%V.#.tif",
    "views, one": "--views left s.%V.#.tif -o out.#.%V.tif",
    "views, folders": "%V/%v.%04d.tif -o %V.%v.%04d.tif",
    "views, none exists": "--views up,down s.%V.#.tif",
    "views, unequal": "s.%V.#.tif a.#.tif",
    "no wildcards": "a.0001.tif -o out.tif",
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    touch(tmp_path, FILES)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def touch(folder, names):
    for name in names.split():
        path = folder / name
        path.parent.mkdir(exist_ok=True)
        path.touch()


def ours(words):
    """FRAME_NUMBER and the words that changed, of each frame; None where the words are refused."""
    try:
        found = frames(words)
    except ParameterError as error:
        assert "\n" not in str(error)
        return None
    return [
        (str(frame.number or 0), [f"{old} -> {new}" for old, new in zip(words, frame.words, strict=True) if old != new])
        for frame in found
    ]


def oiiotool(words):
    """The same, of oiiotool: what its --debug prints before it opens any file."""
    # The files are empty, so every frame is a bad one.
    command = [OIIOTOOL, "-n", "--debug", "--skip-bad-frames", "--echo", "FRAME {FRAME_NUMBER}", *words]
    run = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    if run.returncode < 0 or "terminate called" in run.stderr or re.search("ERROR : (Not all|No file)", run.stderr):
        return None
    found: list[tuple[str, list[str]]] = []
    names: list[str] = []
    for line in run.stdout.splitlines():
        if line.startswith("Begin sequence iteration"):
            names = []
        elif line.startswith("  ") and " -> " in line:
            names.append(line[2:])
        elif line.startswith("FRAME "):
            found.append((line.removeprefix("FRAME "), names))
    return found


needs_oiiotool = pytest.mark.skipif(not OIIOTOOL.exists(), reason="no oiiotool beside Python")


@needs_oiiotool
@pytest.mark.parametrize("words", SEQUENCES.values(), ids=SEQUENCES)
def test_a_command_line_stands_for_the_same_lines_as_in_oiiotool(words, folder):
    words = words.split() if isinstance(words, str) else words
    assert ours(words) == oiiotool(words)


RANGES = st.one_of(
    st.integers(0, 12).map(str),
    st.builds(
        "{}-{}{}".format, st.integers(0, 12), st.integers(0, 15), st.sampled_from(["", "", "x2", "x-3", "y2", "x0"])
    ),
).filter(frame_numbers)  # where the name has no frames and --frames has, oiiotool reads beyond its list
NAMES = st.builds(
    "{}{}{}{}".format,
    st.sampled_from(["a.", "b.", "c.", "d/x_", "./a.", "v2-", "s.left.", "no/", "x%%"]),
    st.one_of(st.just(""), st.just(""), RANGES, st.lists(RANGES, min_size=2, max_size=3).map(",".join)),
    st.sampled_from(["#", "@", "@@", "##@", "%04d", "%d", "%2d", "%01d", "0001"]),
    st.sampled_from([".tif", ".#.tif", "#", "-5.tif"]),
)
COMMAND_LINES = st.lists(
    st.one_of(
        NAMES.map(lambda name: [name]),
        NAMES.map(lambda name: ["-o", name]),
        NAMES.map(lambda name: ["--echo", name]),
        st.lists(RANGES, min_size=1, max_size=2).map(lambda ranges: ["--frames", ",".join(ranges)]),
        st.integers(0, 12).map(lambda digits: ["--framepadding", str(digits)]),
        st.sampled_from([["--wildcardoff"], ["-wildcardon"], ["-o:all=1", "z.%04d.tif"], ["-n"]]),
    ),
    min_size=1,
    max_size=5,
).map(lambda pieces: [word for piece in pieces for word in piece])
RELAXED = settings(
    max_examples=25, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@needs_oiiotool
@RELAXED
@given(COMMAND_LINES)
def test_any_command_line_stands_for_the_same_lines_as_in_oiiotool(folder, words):
    assert ours(words) == oiiotool(words)


@needs_oiiotool
@pytest.mark.parametrize("settings", ["", "--framepadding 3", "--framepadding 12", "--framepadding 0"])
@pytest.mark.parametrize("ranges", ["7", "-7", "12345", ""])
def test_padded_numbers_are_as_in_oiiotool(settings, ranges, folder):
    words = [*settings.split(), *(["--frames", ranges] if ranges else []), "--echo", "{FRAME_NUMBER_PAD}"]
    run = subprocess.run([OIIOTOOL, *words], capture_output=True, text=True, timeout=60, check=True)
    assert [f"{frame.number or 0:0{frame.padding}d}" for frame in frames(words)] == run.stdout.split()


# --- where we depart from oiiotool


@pytest.mark.parametrize(
    "ranges", ["abc", "1-", "1-5z", "1-5x", "1,,2", "1,", "x2", "1:5", "--5", "1-2-3", "1.5", "9" * 5000, "\n1\n2"]
)
def test_a_malformed_range_is_refused(ranges, folder):
    with pytest.raises(ParameterError, match="expected FIRST") as error:
        frames(["--frames", ranges, "a.#.tif"])
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("word", ["100%_#.tif", "a.%d.%d.tif", "a.%x.#.tif", "50%.@.tif", "%V%.#.tif"])
def test_a_stray_percent_is_refused(word, folder):
    with pytest.raises(ParameterError, match="%"):
        frames(["--frames", "1-2", word])


@pytest.mark.parametrize(
    "width", ["%0256d", "%99999999999d", "%0" + "9" * 5000 + "d", "#" * 64, "@" * 256, "%%04d%0999999d"]
)
def test_a_number_wider_than_any_name_is_refused(width, folder):
    with pytest.raises(ParameterError):
        frames(["--frames", "1-2", f"a.{width}.tif"])


def test_frames_of_views_are_enumerated_like_those_found(folder):
    words = ["--views", "right,left", "s.%V.@.tif", "-o", "out.%v.#.tif"]
    found = frames(["--frames", "1,3", *words])
    assert [(frame.number, *frame.words[4:]) for frame in found] == [
        (1, "s.left.1.tif", "-o", "out.l.0001.tif"),
        (1, "s.right.1.tif", "-o", "out.r.0001.tif"),
        (3, "s.left.3.tif", "-o", "out.l.0003.tif"),
        (3, "s.right.3.tif", "-o", "out.r.0003.tif"),
    ]
    scanned = frames(["--views", "right,left", "s.%V.#.tif", "-o", "out.%v.#.tif"])
    assert [(frame.number, frame.words[-1]) for frame in found] == [
        (frame.number, frame.words[-1]) for frame in scanned
    ]


def test_views_without_numbers_run_once_per_view(folder):
    touch(folder, "v.left.tif v.right.tif")
    found = frames(["v.%V.tif", "-o", "out.%v.tif"])
    assert [(frame.number, frame.words) for frame in found] == [
        (None, ("v.left.tif", "-o", "out.l.tif")),
        (None, ("v.right.tif", "-o", "out.r.tif")),
    ]
    with pytest.raises(ParameterError, match="no frame number"):
        frames(["v.%V.tif", "-o", "out.#.tif"])


def test_an_output_by_view_wants_an_input_by_view(folder):
    with pytest.raises(ParameterError, match="%"):
        frames(["a.#.tif", "-o", "out.%V.#.tif"])


def test_signs_in_names_stand_for_themselves(folder):
    touch(folder, "p+q*.0001.tif ppq.0001.tif p+q*.0002.tif")
    assert [frame.words for frame in frames(["p+q*.#.tif"])] == [("./p+q*.0001.tif",), ("./p+q*.0002.tif",)]


def test_a_timestamp_is_a_number(folder):
    touch(folder, "t.20240131235959.tif")
    (found,) = frames(["t.#.tif", "-o", "u.#.tif"])
    assert found == Frame(20240131235959, ("./t.20240131235959.tif", "-o", "u.20240131235959.tif"))
    assert frame_numbers("20240131235959-20240131235960") == [20240131235959, 20240131235960]


@pytest.mark.parametrize("ranges", ["1-1000000000", "-999999999999999999-999999999999999999", "1-1000000000y7"])
@pytest.mark.parametrize("words", [["a.#.tif", "--frames"], ["--create", "1x1", "3", "--frames"]])
def test_endless_ranges_are_refused(ranges, words, folder):
    with pytest.raises(ParameterError, match=f"at most {MOST_FRAMES}"):
        frames([*words, ranges])
    with pytest.raises(ParameterError, match=f"at most {MOST_FRAMES}"):
        frame_numbers(",".join(["1-60000"] * 2))


def test_an_endless_range_of_few_frames_is_none():
    assert frame_numbers("1-1000000000x400000000") == [1, 400000001, 800000001]
    assert frame_numbers("1-1000000000y1") == []


def test_a_range_without_frames_in_a_name_does_not_go_with_frames_elsewhere(folder):
    with pytest.raises(ParameterError, match=r"has no frames: expected 2 \(--frames\)"):
        frames(["a.1-2y1#.tif", "--frames", "1-2"])


def test_a_pattern_without_files_is_a_literal_name_with_a_warning(folder):
    assert frames(["lit#.tif"])[0].warning
    assert not frames(["a.0001.tif"])[0].warning
    assert not frames(["--wildcardoff", "lit#.tif"])[0].warning


@pytest.mark.parametrize("digits", ["many", "", "-3", "256", "9999"])
def test_framepadding_wants_digits(digits, folder):
    with pytest.raises(ParameterError, match="--framepadding"):
        frames(["--framepadding", digits])


# --- what frames share ---


@pytest.mark.parametrize(
    "words",
    ["--frames 1-3", "--frames 2-3", "--frames 2-2", "--frames 1-3 --parallel-frames", "--frames 2,1"],
)
def test_a_missing_frame_has_the_size_channels_and_type_of_its_sequence(tmp_path, words):
    for number in (1, 3):
        save(np.full((24, 32, 3), 0.25, np.float32), tmp_path / f"f.{number:04}.exr", "half")
    save(np.zeros((9, 7, 1), np.float32), tmp_path / "other.exr", "float")
    done = oiiotex("--missingfile", "black", *words.split(), "f.#.exr", "-o", "o.#.exr", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    spec = oiio.ImageBuf(str(tmp_path / "o.0002.exr")).nativespec()
    assert (spec.width, spec.height, spec.nchannels, str(spec.format)) == (32, 24, 3, "half")


@pytest.mark.parametrize("words", ["--frames 1-4", "--frames 1-1", "--frames 3-3", "--farm dask=local:2 --frames 1-4"])
def test_a_missing_or_damaged_frame_has_the_parts_tags_and_channels_of_a_readable_one(tmp_path, words):
    tags = "--iscolorspace ACEScg --attrib PixelAspectRatio 2.0"
    line = f"--create 32x24 3 {tags} --create 32x24 1 --chnames R --siappend -d half -o f.0002.exr"
    assert oiiotex(*line.split(), "-o", "f.0004.exr", cwd=tmp_path).returncode == 0
    (tmp_path / "f.0001.exr").write_bytes((tmp_path / "f.0002.exr").read_bytes()[:99])  # and 3 is missing
    given = ["--missingfile", "black", "-a", *words.split(), "-i:ch=R", "f.#.exr", "--addc", "1", "-o", "o.#.exr"]
    done = oiiotex("--noprogress", *given, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    for made in tmp_path.glob("o.*.exr"):
        parts = [oiio.ImageBuf(str(made), part, 0) for part in (0, 1)]
        specs = [part.nativespec() for part in parts]
        assert [spec.channelnames for spec in specs] == [("R",)] * 2
        assert {str(spec.channelformat(0)) for spec in specs} == {"half"}
        assert specs[0].get_string_attribute("oiio:ColorSpace") == "lin_ap1_scene"
        assert specs[0].get_float_attribute("PixelAspectRatio") == 2
        assert {part.getpixel(0, 0)[0] for part in parts} == {1}


def test_a_missing_partner_of_each_file_is_like_the_others(tmp_path):
    for name in ("a", "b"):
        save(np.full((24, 32, 3), 0.25, np.float32), tmp_path / f"{name}.exr", "half")
    save(np.full((24, 32, 1), 0.5, np.float32), tmp_path / "b.mask.tif", "uint16")
    words = ["--missingfile", "black", "--each", "?.exr", "{name}.mask.tif", "--swap", "--pop", "-o", "o/{name}.tif"]
    done = oiiotex("--create-dir", *words, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    specs = [oiio.ImageBuf(str(tmp_path / "o" / f"{name}.tif")).nativespec() for name in "ab"]
    assert [(spec.width, spec.nchannels) for spec in specs] == [(32, 1), (32, 1)]
