# SPDX-License-Identifier: Apache-2.0
"""Nonsense lines and files: what comes out is a result or an `oiiotex.Error`, never another exception."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests import fuzz

# --- command lines ---


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("fuzz")
    fuzz.make_folder(path)
    return path


@pytest.mark.parametrize("first", range(0, 800, 100))
def test_any_command_line_is_done_or_refused(folder, first):
    for number in range(first, first + 100):
        fuzz.do(fuzz.line(number), folder)


# --- files ---

# where OpenImageIO itself ends with a signal: (name of the seed, number of the mutation): why that is tolerated
CRASHES: dict[tuple[str, int], str] = {}

BATCH = """
import contextlib, io, os, sys
from oiiotex.oiiotool.cli.running.line_run import run
from oiiotex.engine.errors import Error

log, output, *names = sys.argv[1:]
for name in names:
    with open(log, "a") as file:
        file.write(f"{name}\\n")
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            run(["-q", name, "--info:verbose=1", "--stats", "-d", "float", "-o", output])
    except Error as error:
        assert "\\n" not in str(error), (name, str(error))
"""


def read_broken_ones(folder: Path, names: list[str], numbers: range) -> None:
    """In a process of its own: OpenImageIO or a library under it may crash."""
    files = []
    for name in names:
        whole = fuzz.seed(folder / name, *fuzz.SEEDS[name])
        for number in numbers if whole is not None else ():  # else this OpenImageIO does not write it
            if (name, number) not in CRASHES:
                files.append(folder / f"{number:04d}-{name}")
                files[-1].write_bytes(fuzz.broken(whole, number))
    assert files
    command = [sys.executable, "-c", BATCH, folder / "log", folder / "out.exr", *files]
    done = subprocess.run(
        [str(word) for word in command], capture_output=True, text=True, errors="replace", timeout=500
    )
    last = (folder / "log").read_text().splitlines()[-1]
    assert done.returncode == 0, (last, done.returncode, done.stderr[-2000:])
    assert not [path.name for path in folder.iterdir() if ".oiiotex-" in path.name]


@pytest.mark.parametrize("first", range(3))
def test_broken_files_are_read_or_refused(tmp_path, first):
    read_broken_ones(tmp_path, list(fuzz.SEEDS)[first::3], range(60))


@pytest.mark.parametrize("first", range(0, 240, 60))
def test_broken_documents_and_plans_are_read_or_refused(folder, first):
    kinds = len(fuzz.SEEDS) + len(fuzz.TAKES)
    for n in range(first, first + 60):
        number = n // len(fuzz.TAKES) * kinds + len(fuzz.SEEDS) + n % len(fuzz.TAKES)
        fuzz.do(fuzz.broken_file(number, folder), folder)
