# SPDX-License-Identifier: Apache-2.0
"""What a line prints: each warning once, what came before an error, statistics within the range of their type."""

from __future__ import annotations

import numpy as np

from tests.conftest import oiiotex, save


def test_a_warning_is_given_once(tmp_path):
    save(np.zeros((8, 8, 1), np.float32), tmp_path / "a.exr", "float")
    for words in (["-i:ch=Q", "a.exr"], ["a.exr", "--ch", "Q"], ["a.exr", "--ch", "Q", "a.exr", "--ch", "Q"]):
        done = oiiotex(*words, "-o", "o.exr", cwd=tmp_path)
        assert done.returncode == 0 and done.stderr.count("no channel 'Q'") == 1, done.stderr


def test_what_stood_before_an_error_is_printed(tmp_path):
    done = oiiotex(
        "--echo", "before", "--echo:newline=0", "and", "none.exr", "--echo", "after", "-o", "o.exr", cwd=tmp_path
    )
    assert (done.returncode, done.stdout) == (1, "before\nand") and "none.exr: no such file" in done.stderr


def test_an_unknown_channel_of_d_is_warned_of(tmp_path):
    save(np.zeros((8, 8, 3), np.float32), tmp_path / "a.exr", "float")
    done = oiiotex("a.exr", "-d", "Q=half,R=half", "-o", "o.exr", cwd=tmp_path)
    assert done.stderr.strip() == "o.exr has no channel Q: its type of -d has no effect"


def test_statistics_do_not_exceed_the_largest_integer(tmp_path):
    save(np.ones((8, 8, 1), np.float32), tmp_path / "a.tif", "uint")
    done = oiiotex("--stats", "a.tif", cwd=tmp_path)
    assert "Stats Max: 4294967295 (of 4294967295)" in done.stdout
