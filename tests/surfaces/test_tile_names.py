# SPDX-License-Identifier: Apache-2.0
"""Tiles in names: a command line runs once per tile that exists; and no words end in more than one line of error."""

import re

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from oiiotex.engine.errors import ParameterError
from oiiotex.oiiotool.cli.language.sequences import OPTIONS, Frame
from oiiotex.oiiotool.cli.language.tiles import names_tiles, tile_files, tile_name
from tests.oiiotool.test_sequences import RELAXED, frames, touch

TILES = """
    t.1001.tif t.1002.tif t.1011.tif t.1000.tif t.101.tif t.10011.tif m.1001.tif m.1002.tif m.1011.tif n.1001.tif
    uv/u1_v1.tif uv/u2_v1.tif uv/u1_v2.tif uv/u0_v1.tif uv0/a_u0_v0.tif uv0/a_u1_v0.tif uv0/a_u0_v1.tif
    wide.u11_v1.tif wide.u1_v1.tif r.1001.1001.tif r.1001.1002.tif
    x.1001.0001.tif x.1002.0001.tif x.1001.0002.tif x.1002.0002.tif
"""
TAKES = {"-i": 1, "-o": 1, "--echo": 1, "--create": 2, "--mul": 0, "--tex": 0, "--frames": 1, "--wildcardoff": 0}


@pytest.fixture
def tiles(tmp_path, monkeypatch):
    touch(tmp_path, TILES)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def tiled(*words):
    return [(frame.number, " ".join(frame.words)) for frame in frames(words, lambda option: TAKES[option])]


@pytest.mark.parametrize(
    "words", ["{} -o o.<UDIM>.tif", "-i {} -o:all=1 o.<UDIM>.tif", "{} --echo #1 --frames 1 -o o.%(UDIM)d.tif"]
)
def test_a_command_line_runs_once_per_tile(words, tiles):
    words = words.format("t.<UDIM>.tif")
    lines = [re.sub(r"<UDIM>|%\(UDIM\)d", tile, words).replace("#", "0001") for tile in ("1001", "1002", "1011")]
    found = tiled(*words.split())
    assert [line for _, line in found] == lines
    assert [number for number, _ in found] == ([1, 1, 1] if "--frames" in words else [1001, 1002, 1011])


@pytest.mark.parametrize(
    ("name", "names"),
    {
        "t.<UDIM>.tif": "t.1001.tif t.1002.tif t.1011.tif",
        "./t.%(UDIM)d.tif": "./t.1001.tif ./t.1002.tif ./t.1011.tif",
        "uv/<UVTILE>.tif": "uv/u1_v1.tif uv/u2_v1.tif uv/u1_v2.tif",
        "uv/<U>_<V>.tif": "uv/u1_v1.tif uv/u2_v1.tif uv/u1_v2.tif",
        "uv0/a_<uvtile>.tif": "uv0/a_u0_v0.tif uv0/a_u1_v0.tif uv0/a_u0_v1.tif",
        "uv0/a_<u>_<v>.tif": "uv0/a_u0_v0.tif uv0/a_u1_v0.tif uv0/a_u0_v1.tif",
        "r.<UDIM>.<UDIM>.tif": "r.1001.1001.tif",
        "none.<UDIM>.tif": "",
        "none/<UDIM>.tif": "",
        "<UDIM>/none.tif": "",
        "uv/<U>.tif": "",
        "t.1001.tif": "",
        "\0<UDIM>.tif": "",
        "wide.<UVTILE>.tif": "wide.u1_v1.tif wide.u11_v1.tif",
    }.items(),
)
def test_tiles_that_exist(name, names, tiles):
    found = tile_files(name)
    assert list(found.values()) == names.split()
    assert all(tile_name(name, tile) == file for tile, file in found.items())


def test_tiles_of_one_notation_become_another(tiles):
    assert tiled("uv/<UVTILE>.tif", "-o", "o.<UDIM>_<u><v>.tif") == [
        (1001, "uv/u1_v1.tif -o o.1001_u0v0.tif"),
        (1002, "uv/u2_v1.tif -o o.1002_u1v0.tif"),
        (1011, "uv/u1_v2.tif -o o.1011_u0v1.tif"),
    ]
    assert [number for number, _ in tiled("uv/<U>_<V>.tif")] == [1001, 1002, 1011]


def test_a_tile_beyond_ten_columns_has_no_udim_number(tiles):
    assert [number for number, _ in tiled("wide.<UVTILE>.tif", "-o", "o.<uvtile>.tif")] == [1001, None]
    with pytest.raises(ParameterError, match=r"u10 v0 .*UDIM"):
        tiled("wide.<UVTILE>.tif", "-o", "o.<UDIM>.tif")


def test_a_second_input_gives_its_counterparts(tiles):
    assert tiled("t.<UDIM>.tif", "m.<UDIM>.tif", "--mul")[2] == (1011, "t.1011.tif m.1011.tif --mul")
    assert tiled("n.<UDIM>.tif", "t.<UDIM>.tif", "--mul") == [(1001, "n.1001.tif t.1001.tif --mul")]
    with pytest.raises(ParameterError, match=r"'n.1002.tif'.* 't.1002.tif'"):
        tiled("t.<UDIM>.tif", "-i", "n.<UDIM>.tif", "--mul")


def test_words_that_are_no_inputs_get_the_number_without_a_file(tiles):
    (line,) = tiled("--echo", "<UDIM>!", "n.<UDIM>.tif", "--tex:mask=no.<UDIM>.tif:json=<UVTILE>.json")
    assert line == (1001, "--echo 1001! n.1001.tif --tex:mask=no.1001.tif:json=u1_v1.json")


def test_an_input_without_tiles_is_refused(tiles):
    with pytest.raises(ParameterError, match=r"no tiles match 'none.<UDIM>.tif'"):
        tiled("none.<UDIM>.tif", "-o", "o.<UDIM>.tif")


def test_tiles_of_outputs_alone_stay_with_a_warning(tiles):
    words = ("--create", "1x1", "3", "-o", "o.<UDIM>.tif")
    assert [(frame.number, frame.words, bool(frame.warning)) for frame in frames(words)] == [(None, words, True)]


def test_wildcardoff_protects_tiles(tiles):
    assert tiled("--wildcardoff", "t.<UDIM>.tif", "-o", "<UDIM>") == [(None, "--wildcardoff t.<UDIM>.tif -o <UDIM>")]
    assert tiled("n.<UDIM>.tif", "--wildcardoff", "-o", "<UDIM>") == [(1001, "n.1001.tif --wildcardoff -o <UDIM>")]


def test_a_file_of_that_very_name_is_a_file(tiles):
    touch(tiles, "t.<UDIM>.tif")
    assert tiled("t.<UDIM>.tif") == [(None, "t.<UDIM>.tif")]


@pytest.mark.parametrize("ranges", ["", "--frames 1-2"])
def test_frames_of_tiles_run_once_per_frame_and_tile(ranges, tiles):
    found = tiled(*ranges.split(), "./x.<UDIM>.#.tif", "-o", "o.@.<UDIM>.tif")
    assert [(number, line.removeprefix(f"{ranges} ")) for number, line in found] == [
        (1, "./x.1001.0001.tif -o o.1.1001.tif"),
        (1, "./x.1002.0001.tif -o o.1.1002.tif"),
        (2, "./x.1001.0002.tif -o o.2.1001.tif"),
        (2, "./x.1002.0002.tif -o o.2.1002.tif"),
    ]


def test_a_name_with_a_column_alone_names_no_tiles():
    named = ["a<u><v>", "<U>.<V>", "<u><V>", "<UDIM>"]
    assert list(filter(names_tiles, ["<u>", "<U>x", "<V>", "<udim>", *named])) == named


WORDS = st.one_of(
    st.text(max_size=20),
    st.text("#@%dvV04-,x19yoi:/.<>U", max_size=16),
    st.lists(
        st.sampled_from(
            ["#", "@", "%04d", "%d", "%V", "1-5", ",7", "x2", "<UDIM>", "<U>", "<V>", "a.", "/", "-o", "\0", ".."]
        ),
        max_size=6,
    ).map("".join),
    st.sampled_from(
        [option.name for option in OPTIONS]
        + ["-o", "-i", "-o:all=1", "1-3", "1-1000000000", "-5-5x2", "a.#.tif", "t.<UDIM>.tif", "99999999999"]
    ),
)


@settings(RELAXED, max_examples=300)
@example(["--frames", "1-99999", "--views", ",".join("abcdefgh"), "%V#"])
@example(["\0/#.tif"])
@example(["\ud800/#.tif"])
@given(st.lists(WORDS, max_size=6))
def test_any_words_end_in_frames_or_in_one_line(tiles, words):
    try:
        found = frames(words, lambda option: len(option) % 3)
    except ParameterError as error:
        assert len(str(error).splitlines()) == 1
    else:
        assert found
        assert all(isinstance(frame, Frame) and len(frame.words) == len(words) for frame in found)
