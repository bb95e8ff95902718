# SPDX-License-Identifier: Apache-2.0
"""What is kept on disk: it comes back to the bit, spoiled files do not, the folder is held to its size."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest

from oiiotex.engine.io import disk_cache
from oiiotex.engine.io.disk_cache import cached_arrays, hash_of

ARRAYS = (np.arange(70, dtype=np.uint32).reshape(7, 10), np.zeros((3, 0), np.int16), np.array([0.25]))


def fail():
    raise AssertionError("it was there")


def test_arrays_come_back(tmp_path):
    folder = tmp_path / "new" / "folder"
    assert cached_arrays(folder, "a", lambda: ARRAYS) is ARRAYS
    for found, wanted in zip(cached_arrays(folder, "a", fail), ARRAYS, strict=True):
        np.testing.assert_array_equal(found, wanted)
        assert (found.dtype, found.shape) == (wanted.dtype, wanted.shape) and not found.flags.writeable
    turned = np.asfortranarray(ARRAYS[0])
    cached_arrays(folder, "b", lambda: (turned,))
    np.testing.assert_array_equal(cached_arrays(folder, "b", fail)[0], turned)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda data: b"",
        lambda data: b"spoiled",
        lambda data: data[:-1],
        lambda data: data[: len(data) // 2],
        lambda data: data + b"x",
        lambda data: data[:-9] + bytes([data[-9] ^ 1]) + data[-8:],
        lambda data: bytes([data[0] ^ 1]) + data[1:],
    ],
    ids=["empty", "other", "a byte less", "half", "a byte more", "a bit", "its hash"],
)
def test_a_spoiled_file_is_made_again(tmp_path, spoil):
    cached_arrays(tmp_path, "a", lambda: ARRAYS)
    (file,) = tmp_path.iterdir()
    whole = file.read_bytes()
    file.write_bytes(spoil(whole))
    assert cached_arrays(tmp_path, "a", lambda: ARRAYS) is ARRAYS
    assert file.read_bytes() == whole
    cached_arrays(tmp_path, "a", fail)


def test_a_folder_that_cannot_be_written_is_no_fault(tmp_path):
    (tmp_path / "file").write_text("")
    assert cached_arrays(tmp_path / "file" / "folder", "a", lambda: ARRAYS) is ARRAYS
    assert cached_arrays(None, "a", lambda: ARRAYS) is ARRAYS


def test_what_was_not_asked_for_goes_first(tmp_path, monkeypatch):
    one = (np.zeros(1000, np.uint8),)
    for n, name in enumerate("abc"):
        cached_arrays(tmp_path, name, lambda: one)
        os.utime(tmp_path / f"{name}.arrays", (n, n))
    cached_arrays(tmp_path, "a", fail)  # so b is the oldest
    (tmp_path / ".c.oiiotex-here-1-1.arrays").write_bytes(bytes(5000))  # another process is writing it
    size = (tmp_path / "a.arrays").stat().st_size
    monkeypatch.setattr(disk_cache, "MOST_BYTES", 3 * size)
    cached_arrays(tmp_path, "d", lambda: one)
    assert sorted(p.name[0] for p in tmp_path.iterdir()) == [".", "a", "c", "d"]
    cached_arrays(tmp_path, "e", lambda: (np.zeros(3 * size + 1, np.uint8),))  # more than the folder may hold
    assert sorted(p.name[0] for p in tmp_path.iterdir()) == [".", "a", "c", "d"]


def test_processes_do_not_disturb_each_other(tmp_path):
    """Four write, read, and sweep a folder that holds two of their five files."""
    program = f"""
import numpy as np
from pathlib import Path
from oiiotex.engine.io import disk_cache
disk_cache.MOST_BYTES = 250_000
for turn in range(60):
    number = (turn * 7 + {{}}) % 5
    arrays = (np.full(100_000, number, np.uint8),)
    (found,) = disk_cache.cached_arrays(Path({str(tmp_path)!r}), str(number), lambda: arrays)
    assert (found == number).all()
"""
    runs = [subprocess.Popen([sys.executable, "-c", program.format(n)], stderr=subprocess.PIPE) for n in range(4)]
    for run in runs:
        assert run.communicate()[1] == b"" and run.returncode == 0
    assert 1 <= len(list(tmp_path.iterdir())) <= 3  # the last sweeps may have run at once
    assert sum(p.stat().st_size for p in tmp_path.iterdir()) < 400_000


def test_a_name_is_of_all_facts():
    a = np.zeros((2, 3), np.int16)
    bent = a.copy()
    bent[1, 1] = 1
    names = {
        hash_of(*facts)
        for facts in [(a,), (bent,), (a.reshape(3, 2),), (a.astype(np.int32),), (a.view(np.uint16),), (a, 1), (a, "1")]
    }
    assert len(names) == 7
    assert hash_of(np.asfortranarray(bent)) == hash_of(bent)
