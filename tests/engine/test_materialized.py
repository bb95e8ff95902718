# SPDX-License-Identifier: Apache-2.0
"""A materialized part gives any window in any order, from memory or from a temporary file."""

from __future__ import annotations

import dataclasses
import os
import subprocess
import sys
import threading

import numpy as np
import pytest

from oiiotex.engine.core.demand import materialized
from oiiotex.engine.core.image import Part
from oiiotex.engine.core.window import Window
from tests.parts import coordinates, counted, part_of, spec_of


@pytest.mark.parametrize("budget", [1 << 30, 1], ids=["in memory", "in a file"])
@pytest.mark.parametrize(("width", "height"), [(1, 1), (256, 256), (700, 517)])
def test_a_settled_part_gives_any_window_in_any_order_and_was_computed_once(width, height, budget):
    asked: list[Window] = []
    part = part_of("a", "half", height, width, 3, x=-5, y=9)
    kept = materialized(dataclasses.replace(counted(part, asked), native=True, exact=True), budget)
    assert sum(w.width * w.height for w in asked) == width * height
    assert (kept.ready, kept.native, kept.exact, kept.stored, kept.name) == (True, True, True, part.stored, "a")
    assert kept.window == part.window
    computed = len(asked)
    random = np.random.default_rng(1)
    for _ in range(30):
        x, y = np.sort(random.integers(0, (width, height), (2, 2)), 0).T
        window = Window(int(x[0]) - 5, int(y[0]) + 9, int(x[1]) - 4, int(y[1]) + 10)
        pixels = kept.read(window)
        assert pixels.dtype == np.float16
        np.testing.assert_array_equal(pixels, part.read(window))
    assert len(asked) == computed


def test_a_settled_part_is_read_by_several_threads_at_once():
    part = coordinates(600, 900)
    kept, failures = materialized(part, 1), []

    def work(seed: int) -> None:
        random = np.random.default_rng(seed)
        for _ in range(50):
            x, y = (int(n) for n in random.integers(0, 500, 2))
            window = Window.sized(x, y, 100, 100)
            if not np.array_equal(kept.read(window), part.read(window)):
                failures.append(window)

    threads = [threading.Thread(target=work, args=(n,)) for n in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    assert failures == []


def test_a_wide_part_is_settled_in_pieces_of_some_megabytes():
    asked: list[Window] = []
    black = Part("a", spec_of("float", 260, 100_000, 2), lambda w: np.zeros((w.height, w.width, 2), np.float32))
    materialized(counted(black, asked), 1)  # 256 rows are 200 MB
    assert max(w.width * w.height * 8 for w in asked) <= 32 << 20


def test_a_spilled_part_leaves_no_file(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    kept = materialized(coordinates(300, 300), 1)
    assert os.listdir(tmp_path) == []
    assert kept.read(Window(7, 8, 9, 10))[0, 0].tolist() == [7, 8]


SPILL_INTO_A_SMALL_DISK = """
import resource, sys
import numpy as np
from oiiotex.engine.errors import ImageError
from oiiotex.engine.core.demand import materialized
from tests.parts import coordinates

resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]), resource.RLIM_INFINITY))
try:
    materialized(coordinates(512, 256), 1)  # two tiles of 512 kB
except ImageError as error:
    print(error)
"""


@pytest.mark.parametrize("room", [0, 300_000, 700_000, (1 << 20) - 1], ids=lambda room: f"room for {room}")
def test_a_full_folder_for_temporary_files_is_refused_in_one_line(tmp_path, room):
    command = [sys.executable, "-c", SPILL_INTO_A_SMALL_DISK, str(room)]
    done = subprocess.run(command, env={**os.environ, "TMPDIR": str(tmp_path)}, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (line,) = done.stdout.splitlines()
    full = f"no space for intermediate results in {tmp_path}: "
    says = full if room else "cannot create a file for intermediate results: "
    assert line.startswith(says) and line.endswith("; set TMPDIR")
