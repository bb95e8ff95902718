# SPDX-License-Identifier: Apache-2.0
"""resume=1: a run that was killed goes on where it stopped, and nothing of another run gets in."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from oiiotex.engine.core.window import Window
from oiiotex.engine.io.checkpoint import Checkpoint
from oiiotex.engine.session import Session
from tests import pictures
from tests.conftest import load, oiiotex, save

PLACE = Window(-3, 1 << 40, 5, (1 << 40) + 6)
KEY = "ab" * 32
SYNTH = "--texsynth:size=160x4200:exemplarside=32"  # several pieces


def pieces(folder: Path) -> list[Path]:
    """The finished ones."""
    return sorted(piece for piece in folder.glob("*.piece") if not piece.name.startswith("."))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("resume")
    save(pictures.pebbles(96, 96, 1), made / "large.png", space="srgb_rec709_scene")
    save(pictures.pebbles(32, 32, 1), made / "photo.png", space="srgb_rec709_scene")
    done = oiiotex("photo.png", SYNTH, "-o", "whole.tif", cwd=made)
    assert done.returncode == 0, done.stderr
    return made


def interrupted(
    folder: Path, name: str, number: signal.Signals, *words: str, photo: str = "photo.png"
) -> subprocess.CompletedProcess:
    """A run that gets a signal when it has finished two pieces."""
    before = len(pieces(folder / f"{name}.parts"))
    line = [sys.executable, "-m", "oiiotex", photo, *(words or (f"{SYNTH}:resume=1",)), "-o", name]
    running = subprocess.Popen(line, cwd=folder, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 120
    while len(pieces(folder / f"{name}.parts")) < before + 2 and time.monotonic() < deadline:
        time.sleep(0.005)
    running.send_signal(number)
    _, errors = running.communicate(timeout=60)
    assert not (folder / name).exists()
    return subprocess.CompletedProcess(line, running.returncode, "", errors)


def test_a_killed_run_goes_on_where_it_stopped(folder):
    assert interrupted(folder, "killed.tif", signal.SIGKILL).returncode == -signal.SIGKILL
    left = {piece: piece.stat().st_mtime_ns for piece in pieces(folder / "killed.tif.parts")}
    assert len(left) >= 2
    # another seed finds none of them, and does not take them away while it is not finished
    assert interrupted(folder, "killed.tif", signal.SIGKILL, f"{SYNTH}:resume=1:seed=5").returncode < 0
    assert {piece: piece.stat().st_mtime_ns for piece in left} == left
    assert len({piece.name.split(".")[0] for piece in pieces(folder / "killed.tif.parts")}) == 2
    done = oiiotex("photo.png", f"{SYNTH}:resume=1", "-o", "killed.tif", cwd=folder)
    assert done.returncode == 0, done.stderr
    np.testing.assert_array_equal(load(folder / "killed.tif"), load(folder / "whole.tif"))
    assert not (folder / "killed.tif.parts").exists()


def test_a_killed_tile_goes_on_at_the_level_where_it_stopped(folder):
    line = "--texstationarize:size=220x220:iterations=4:histogram=0.7:seed=2"
    assert oiiotex("large.png", line, "-o", "tile.exr", cwd=folder).returncode == 0
    stmap = f"{line}:resume=1:st=from.exr"
    assert interrupted(folder, "again.exr", signal.SIGKILL, stmap, photo="large.png").returncode == -signal.SIGKILL
    left = {piece: piece.read_bytes() for piece in pieces(folder / "again.exr.parts")}
    assert len(left) >= 2
    assert interrupted(folder, "again.exr", signal.SIGTERM, stmap, photo="large.png").returncode == 143
    assert {piece: piece.read_bytes() for piece in left} == left
    done = oiiotex("large.png", stmap, "-o", "again.exr", cwd=folder)
    assert done.returncode == 0, done.stderr
    np.testing.assert_array_equal(load(folder / "again.exr"), load(folder / "tile.exr"))
    assert (folder / "from.exr").exists() and not (folder / "again.exr.parts").exists()


def test_variants_that_are_kept_are_the_same(folder):
    line = "--texstationarize:size=64x64:iterations=2:histogram=0.7:variants=2"
    for words, name in ((line, "one%d.exr"), (f"{line}:resume=1", "two%d.exr")):
        assert oiiotex("large.png", words, "-o:all=1", name, cwd=folder).returncode == 0
    for n in (1, 2):
        np.testing.assert_array_equal(load(folder / f"two{n}.exr"), load(folder / f"one{n}.exr"))
    assert not list(folder.glob("*.parts"))


def test_an_interrupted_run_says_that_its_pieces_are_kept(folder):
    done = interrupted(folder, "stopped.tif", signal.SIGINT)
    assert done.returncode == 130
    (line,) = done.stderr.strip().splitlines()
    assert "finished pieces are stored in stopped.tif.parts; repeat the run to resume" in line
    assert len(pieces(folder / "stopped.tif.parts")) >= 2
    assert not list(folder.glob(".*oiiotex*"))


STUCK = """
import hashlib
from pathlib import Path
import numpy as np
from oiiotex.engine.core.window import Window
from oiiotex.engine.io.checkpoint import Checkpoint
from oiiotex.oiiotool.cli.main import exit_with

def work(words):
    kept = Checkpoint(Path("out.exr"))
    kept.keep("ab" * 32, Window(0, 1, 0, 1), np.zeros(3))
    print("begun", flush=True)
    hashlib.pbkdf2_hmac("sha256", b"", b"", 10**8)  # a library that hears no signal for a minute
    return 0

exit_with([], work)
"""


def test_a_run_that_ends_inside_a_library_says_it_too(tmp_path):
    """Python's handler cannot run there, so that nothing unwinds."""
    running = subprocess.Popen(
        [sys.executable, "-c", STUCK], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert running.stdout.readline() == "begun\n"
    running.send_signal(signal.SIGINT)
    _, errors = running.communicate(timeout=60)
    assert running.returncode == 130
    assert "1 finished pieces are stored in out.exr.parts; repeat the run to resume" in errors
    assert len(pieces(tmp_path / "out.exr.parts")) == 1


def test_pieces_are_made_once_and_go_when_the_file_is_whole(tmp_path):
    made = []

    def make(value=7):
        made.append(value)
        return np.full((6, 8, 2), value, np.int16)

    path = tmp_path / "out.exr"
    first = Checkpoint(path)
    np.testing.assert_array_equal(first.piece(KEY, PLACE, make), make())
    np.testing.assert_array_equal(Checkpoint(path).piece(KEY, PLACE, lambda: 1 / 0), make())  # of a run before
    assert Checkpoint(path).piece("cd" * 32, PLACE, lambda: make(9))[0, 0, 0] == 9  # determined by something else
    assert Checkpoint(path).piece(KEY, PLACE.shifted(1, 0), lambda: make(8))[0, 0, 0] == 8
    (path.parent / "out.exr.parts" / "mine.txt").write_text("the user's own")
    half = f".{KEY[:32]}.{PLACE}.oiiotex-host-99999999-0.piece"
    (path.parent / "out.exr.parts" / half).write_bytes(b"what a kill has left")
    Checkpoint(path).discard()  # a run that knows of none
    assert len(pieces(tmp_path / "out.exr.parts")) == 3
    first.discard()
    assert [f.name for f in (tmp_path / "out.exr.parts").iterdir()] == ["mine.txt"]


def test_a_spoiled_piece_is_made_again(tmp_path):
    Checkpoint(tmp_path / "a.exr").piece(KEY, PLACE, lambda: np.arange(9))
    (piece,) = pieces(tmp_path / "a.exr.parts")
    whole = piece.read_bytes()
    for spoiled in (b"", whole[:-3], whole[:20] + b"x" + whole[21:]):
        piece.write_bytes(spoiled)
        np.testing.assert_array_equal(Checkpoint(tmp_path / "a.exr").piece(KEY, PLACE, lambda: np.arange(9)), range(9))
        assert piece.read_bytes() == whole


def test_what_cannot_be_kept_is_said_once_and_does_not_stop_the_run(tmp_path, caplog):
    (tmp_path / "a.exr.parts").write_text("a file of that name")
    keeper = Checkpoint(tmp_path / "a.exr")
    for n in range(3):
        assert keeper.piece(KEY, PLACE.shifted(n, 0), lambda: np.ones(2)).sum() == 2
    keeper.discard()
    assert len(caplog.records) == 1 and "cannot write checkpoints to" in caplog.text
    assert (tmp_path / "a.exr.parts").read_text() == "a file of that name"


def test_a_failed_run_leaves_its_pieces_in_silence(tmp_path, caplog):
    resources = Session().resources
    with pytest.raises(ZeroDivisionError), resources.checkpoints(tmp_path / "a.exr"):
        resources.keeper.piece(KEY, PLACE, lambda: np.ones(2))
        raise ZeroDivisionError
    assert resources.keeper is None and len(pieces(tmp_path / "a.exr.parts")) == 1 and not caplog.records
