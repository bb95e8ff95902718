# SPDX-License-Identifier: Apache-2.0
"""Limits of readers, of memory and of words: told before the work, in one line that says what to do."""

from __future__ import annotations

import errno
import os
import subprocess
import time

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from oiiotex.engine.core.image import from_buffer
from oiiotex.engine.errors import Error
from oiiotex.engine.io.atomic import temporary_beside
from oiiotex.engine.io.writing import require_writable
from oiiotex.engine.patterns import pattern_of
from tests.any_filter import buffer, pixels
from tests.conftest import oiiotex, save
from tests.faults import PROGRAM, line_of

resource = pytest.importorskip("resource", reason="limits of POSIX")


def shaped(width: int, height: int, channels: int) -> oiio.ImageBuf:
    return oiio.ImageBuf(oiio.ImageSpec(width, height, channels, oiio.HALF))


@pytest.mark.parametrize(
    ("size", "told"),
    [((4, 4, 1101), "has 1101 channels"), ((1 << 20 | 1, 1, 1), "has 1048577 px along a side")],
)
@pytest.mark.parametrize("suffix", ["exr", "tif"])
def test_what_no_reader_would_take_is_refused_before_the_work(tmp_path, size, told, suffix):
    with pytest.raises(Error, match=f"{told}, and could not be read again: expected at most .* raise its attribute"):
        require_writable(from_buffer(shaped(*size)), tmp_path / f"o.{suffix}")
    assert list(tmp_path.iterdir()) == []
    require_writable(from_buffer(shaped(4, 4, 1000)), tmp_path / f"o.{suffix}")


def test_the_limit_can_be_raised(tmp_path):
    words = ["--create", f"{(1 << 20) + 1}x1", "1", "-d", "half", "-o", "o.exr"]
    assert "limits:resolution" in line_of(oiiotex(*words, cwd=tmp_path))
    assert oiiotex("--oiioattrib", "limits:resolution", "2000000", *words, cwd=tmp_path).returncode == 0


def test_a_full_disk_is_told_with_the_file(tmp_path):
    for number in (errno.ENOSPC, errno.EDQUOT):
        with (
            pytest.raises(Error, match=rf"plan\.json: {os.strerror(number)}"),
            temporary_beside(tmp_path / "plan.json"),
        ):
            raise OSError(number, os.strerror(number))
    with pytest.raises(FileNotFoundError), temporary_beside(tmp_path / "plan.json"):
        open(tmp_path / "none").close()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["-o", "o.tif"], "-o : o.tif: "), (["-o", "o.exr"], "-o : o.exr: "), (["-o", "o.gif"], "-o : o.gif: "),
        (["-otex", "o.tx"], "-otex : o.tx: "), (["-o", "o.exr", "--farm", "openjd=j.json"], "j.json: "),
    ],
)  # fmt: skip
def test_a_disk_that_takes_nothing_is_told_with_op_file_and_reason(tmp_path, words, told):
    """A limit on the size of files stands in for the disk: the cache of kernels lies on another one."""

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))

    line = [*PROGRAM, "--pattern", "noise", "32x32", "3", "--iscolorspace", "srgb_rec709_scene", *words]
    done = subprocess.run(line, cwd=tmp_path, capture_output=True, text=True, preexec_fn=limit)
    assert told in line_of(done) and os.strerror(errno.EFBIG) in line_of(done) and ".oiiotex-" not in line_of(done)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("megabytes", [140, 300, 500])
def test_too_little_address_space_is_one_line(tmp_path, megabytes):
    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (megabytes << 20, megabytes << 20))

    words = [*PROGRAM, "--create", "4x4", "3", "-o", "o.exr"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, preexec_fn=limit)
    assert f"this process may take {megabytes} MB of address space: expected at least 512 MB" in line_of(done)


def test_a_variable_that_is_doubled_ends_with_an_error(tmp_path):
    done = oiiotex("--set", "a", "x", "--for", "i", "0,60", "--set", "a", '"{a}{a}"', "--endfor", cwd=tmp_path)
    assert "the word becomes longer than 1,048,576 characters" in line_of(done)


@pytest.mark.parametrize("text", ["(a+)+$", "(a|aa)+$", "(x{1,99}){1,99}", "((a)+|b)+", "(?=(a*)*)b", "a*a*a*a*a*a*b"])
def test_patterns_that_backtrack_are_refused(text):
    with pytest.raises(Error, match="could take years to match: expected a regular expression with at most 4 repeats"):
        pattern_of(text)


def test_patterns_that_people_write_are_not():
    texts = ("Exif:.*", "compression|time", "^(exif|xmp):.*$", "[[:alpha:]]+_[0-9]{4}", "(ab+)?", ".*x.*", "")
    begun = time.process_time()
    for text in texts:
        pattern_of(text).search("oiio:" + "a" * 250)
    assert time.process_time() - begun < 5


def test_patterns_of_ops_are_looked_at(tmp_path):
    save(np.zeros((4, 4, 3)), tmp_path / "a.exr")
    for words in (["a.exr", "--eraseattrib", "(a+)+$", "-o", "o.exr"], ["--info", "--metamatch", "(a+)+$", "a.exr"]):
        assert "could take years" in line_of(oiiotex(*words, cwd=tmp_path))


def test_each_takes_names_with_braces(tmp_path):
    for name in ("a.exr", "b{c}.exr", "{TOP.width}.exr"):
        save(np.zeros((4, 4, 3)), tmp_path / name)
    done = oiiotex("--each", "*.exr", "--flip", "-o", "{name}.png", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert {path.stem for path in tmp_path.glob("*.png")} == {"a", "b{c}", "{TOP.width}"}
    done = oiiotex("--each", "*.exr", "--echo", "{TOP.width}", "-o", "{name}.tif", cwd=tmp_path)
    assert "braces begin expressions, and the line has some; rename the file" in line_of(done)


@pytest.mark.parametrize("peak", [1.0, 1e30, 3e38])
def test_project_takes_values_of_any_size(peak):
    dice = np.random.default_rng(0)
    frame, plate = (dice.random((64, 64, 3), np.float32) * np.float32(peak) for _ in range(2))
    region = np.zeros((64, 64, 1), np.float32)
    region[20:40, 20:40] = 1
    made = pixels(filters.project(buffer(frame), buffer(plate), region=buffer(region, space="data"), grain=0))
    assert np.isfinite(made).all() and np.array_equal(made[:16], frame[:16])  # it fades over 4 px
    unit = pixels(
        filters.project(
            buffer(frame / np.float32(peak)), buffer(plate / np.float32(peak)), region=buffer(region, space="data"),
            grain=0,
        )
    )  # fmt: skip
    np.testing.assert_allclose(made / np.float32(peak), unit, rtol=1e-3)
