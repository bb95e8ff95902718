# SPDX-License-Identifier: Apache-2.0
"""A failed, interrupted or killed write leaves what was there, and nothing half under its name."""

from __future__ import annotations

import dataclasses
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from oiiotex.engine.core.image import Image, Part, type_named
from oiiotex.engine.core.window import Window
from oiiotex.engine.errors import ImageError
from oiiotex.engine.io.reading import read
from oiiotex.engine.io.writing import write
from tests.engine.test_unfinished_files import a_free_pid
from tests.parts import assert_same, counted, part_of, refusal, small, spec_of

WIDE = 900_000  # pixels in a row that makes a band of few rows; libpng takes no more than a million


@pytest.fixture(scope="module")
def dead_pid() -> int:
    return a_free_pid()


# --- what is refused ---

CANNOT = {
    "a.png": ("half", "float", "uint", "int8"),
    "a.exr": ("uint8", "uint16", "double", "int"),
    "a.tif": ("half",),
    "a.jpg": ("uint16", "float"),
}


@pytest.mark.parametrize(("name", "kind"), [(name, kind) for name, kinds in CANNOT.items() for kind in kinds])
def test_a_type_asked_for_that_the_format_cannot_hold_is_refused(tmp_path, name, kind):
    asked: list[Window] = []
    part = counted(small("float").first, asked)
    text = refusal(write, Image((part,)), tmp_path / name, type_named(kind))
    assert asked == []  # before any pixel was computed
    assert text.startswith(f"{tmp_path / name}: ")
    assert text.endswith(f" cannot hold part 'part0' as {kind}")
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize(("name", "kind"), [("a.tif", "half"), ("a.exr", "uint16"), ("a.exr", "double")])
def test_a_part_that_must_be_as_it_is_is_refused_by_a_format_that_cannot_hold_it(tmp_path, name, kind):
    asked: list[Window] = []
    tile = part_of("tile", "float", 3, 3, 3)
    label = dataclasses.replace(part_of("label", kind, 3, 3, 1), exact=True)
    text = refusal(write, Image((counted(tile, asked), label)), tmp_path / name)
    assert asked == []
    assert text.endswith(f" cannot hold part 'label' as {kind}")
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("asked_for", [True, False])
def test_a_tiff_of_doubles_is_refused(tmp_path, asked_for):
    # it could not be read again: see test_files
    image, kind = (small("float"), type_named("double")) if asked_for else (small("double"), None)
    text = refusal(write, image, tmp_path / "a.tif", kind)
    assert text == f"{tmp_path / 'a.tif'}: TIFF files of type double are not supported"
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("name", ["a.png", "a.exr"])
def test_an_image_without_pixels_is_refused(tmp_path, name):
    part = Part("a", spec_of("uint8", 0, 0, 3), lambda window: np.empty((0, 0, 3), np.uint8))
    assert refusal(write, Image((part,)), tmp_path / name).startswith(f"{tmp_path / name}: the image has no pixels")
    assert os.listdir(tmp_path) == []


def fail_of_ours() -> None:
    raise ImageError("no more rows")


def fail_of_others() -> None:
    raise RuntimeError("a bug")


def stop() -> None:
    raise KeyboardInterrupt


def late(fail: Callable[[], None]) -> Part:
    """A part of several bands that fails after the first."""

    def fetch(window: Window) -> np.ndarray:
        if window.top > 0:
            fail()
        return np.zeros((window.height, WIDE, 3), np.uint8)

    return Part("late", spec_of("uint8", 7, WIDE, 3), fetch)


@pytest.mark.parametrize("old", [b"the user's own", None], ids=["old file", "no file"])
@pytest.mark.parametrize("fail", [fail_of_ours, fail_of_others, stop], ids=lambda f: f.__name__)
@pytest.mark.parametrize("name", ["a.exr", "a.tif", "a.png"])
def test_a_failure_in_the_middle_of_writing_leaves_what_was_there(tmp_path, name, fail, old):
    if old is not None:
        (tmp_path / name).write_bytes(old)
    with pytest.raises((ImageError, RuntimeError, KeyboardInterrupt), match=r"no more rows|a bug|^$"):
        write(Image((late(fail),)), tmp_path / name)
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == ({name: old} if old is not None else {})


@pytest.mark.parametrize("name", ["a.exr", "a.tif"])
def test_a_callback_that_stops_the_run_leaves_what_was_there(tmp_path, name):
    (tmp_path / name).write_bytes(b"the user's own")
    with pytest.raises(KeyboardInterrupt):
        write(Image((late(lambda: None),)), tmp_path / name, advance=lambda done, total: stop())
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == {name: b"the user's own"}


@pytest.mark.parametrize("name", ["a.exr", "a.tif"])
def test_a_failure_in_a_further_part_leaves_what_was_there(tmp_path, name):
    (tmp_path / name).write_bytes(b"the user's own")
    with pytest.raises(RuntimeError, match="a bug"):
        first = part_of("a", "float", 3, 4, 1, full_width=WIDE, full_height=7)
        write(Image((first, late(fail_of_others))), tmp_path / name)
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == {name: b"the user's own"}


@pytest.mark.parametrize(
    ("kinds", "channels", "name", "kind", "says"),
    [
        (("uint8",), 3, "a.banana", None, "no writer for '.banana'"),
        (("uint8",), 3, "a", None, "no writer for ''"),
        (("uint8",), 3, "a.exr", "uint8", "openexr cannot hold part 'part0' as uint8"),
        (("uint8",), 3, "a.zfile", None, "cannot be written: zfile does not support 3-channel images"),
    ],
    ids=["unknown extension", "no extension", "type", "channels"],
)
def test_a_refusal_names_the_file_and_leaves_what_was_there(tmp_path, kinds, channels, name, kind, says):
    image = Image(tuple(part_of(f"part{i}", k, 3, 3, channels) for i, k in enumerate(kinds)))
    (tmp_path / name).write_bytes(b"the user's own")
    text = refusal(write, image, tmp_path / name, kind and type_named(kind))
    assert text.startswith(f"{tmp_path / name}: {says}")
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == {name: b"the user's own"}


def test_a_missing_folder_is_said_to_be_missing(tmp_path):
    path = tmp_path / "no" / "a.exr"
    assert refusal(write, small(), path) == f"{path}: no such folder: {path.parent}"


def test_a_folder_or_a_pipe_is_not_written_over(tmp_path):
    (tmp_path / "folder.exr").mkdir()
    os.mkfifo(tmp_path / "pipe.exr")
    for name in ("folder.exr", "pipe.exr"):
        assert refusal(write, small(), tmp_path / name) == f"{tmp_path / name}: not a regular file"
    assert (tmp_path / "pipe.exr").is_fifo()
    assert sorted(os.listdir(tmp_path)) == ["folder.exr", "pipe.exr"]


def test_a_device_is_not_written_over():
    assert refusal(write, small(), "/dev/null") == "/dev/null: not a regular file"
    assert Path("/dev/null").is_char_device()


def test_a_format_that_writes_no_file_is_refused(tmp_path):
    refusal(write, small(), tmp_path / "a.null")
    assert os.listdir(tmp_path) == []


def test_a_name_as_long_as_the_disk_allows_is_written_or_refused(tmp_path):
    path = tmp_path / ("n" * 251 + ".png")
    path.write_bytes(b"the user's own")
    try:
        write(small(), path)
    except ImageError:
        assert path.read_bytes() == b"the user's own"
    else:
        assert_same(read(path).first, small().first.pixels())
    assert os.listdir(tmp_path) == [path.name]


# --- temporary files ---


def temporary_name(folder: Path) -> str:
    """The name that a run which is writing uses."""
    seen: list[str] = []

    def fetch(window: Window) -> np.ndarray:
        seen.extend(os.listdir(folder))
        return np.zeros((window.height, window.width, 1), np.uint8)

    write(Image((Part("spy", spec_of("uint8", 2, 2, 1), fetch),)), folder / "spy.tif")
    (folder / "spy.tif").unlink()
    (name,) = seen
    return name


def test_what_is_being_written_is_hidden_and_bears_pid_and_host(tmp_path):
    name = temporary_name(tmp_path)
    assert name.startswith(".spy.")
    assert name.endswith(".tif")
    assert f"-{os.getpid()}-" in name
    assert os.uname().nodename.split(".")[0].replace("-", "_") in name
    assert os.listdir(tmp_path) == []


def test_what_bears_no_lock_is_swept_and_the_users_own_stays(tmp_path, dead_pid):
    mine = temporary_name(tmp_path)
    dead = mine.replace(f"-{os.getpid()}-", f"-{dead_pid}-")
    gone = [mine, dead, dead.replace(".spy.", ".other name."), dead.replace(".tif", ".exr"), dead.replace(".tif", "")]
    kept = [dead.removeprefix("."), f"{dead}.bak.gz", ".spy.oiiotex-notes.tif"]
    for name in gone + kept:
        (tmp_path / name).write_bytes(b"half")
    write(small(), tmp_path / "a.png")
    assert sorted(os.listdir(tmp_path)) == sorted({*kept, "a.png"})


def test_what_cannot_be_swept_stops_no_one(tmp_path, dead_pid):
    name = temporary_name(tmp_path)
    (tmp_path / name.replace(f"-{os.getpid()}-", f"-{dead_pid}-")).mkdir()
    (tmp_path / name.replace(f"-{os.getpid()}-", f"-{'9' * 30}-")).symlink_to("nowhere")
    write(small(), tmp_path / "a.png")
    assert_same(read(tmp_path / "a.png").first, small().first.pixels())


KILLED = """
import os, signal
import numpy as np, OpenImageIO as oiio
from oiiotex.engine.core.image import Image, Part
from oiiotex.engine.io.writing import write

def fetch(window):
    if window.top > 0:
        os.kill(os.getpid(), signal.SIGKILL)
    return np.zeros((window.height, 900_000, 3), np.uint8)

write(Image((Part("a", oiio.ImageSpec(900_000, 7, 3, oiio.UINT8), fetch),)), "a.tif")
"""


def test_a_killed_run_leaves_the_old_file_and_the_next_run_sweeps(tmp_path):
    (tmp_path / "a.tif").write_bytes(b"the user's own")
    assert subprocess.run([sys.executable, "-c", KILLED], cwd=tmp_path).returncode == -signal.SIGKILL
    assert (tmp_path / "a.tif").read_bytes() == b"the user's own"
    (left,) = set(os.listdir(tmp_path)) - {"a.tif"}
    assert left.startswith(".a.")
    write(small(), tmp_path / "b.png")
    assert sorted(os.listdir(tmp_path)) == ["a.tif", "b.png"]
    assert (tmp_path / "a.tif").read_bytes() == b"the user's own"


# --- a disk that is full ---

FULL = """
import resource, sys
import numpy as np, OpenImageIO as oiio
from oiiotex.engine.errors import ImageError
from oiiotex.engine.core.image import Image, Part
from oiiotex.engine.io.writing import write

def fetch(window):
    return np.random.default_rng(window.top).integers(0, 255, (window.height, window.width, 3), np.uint8)

most = int(sys.argv[2]) or resource.RLIM_INFINITY
resource.setrlimit(resource.RLIMIT_FSIZE, (most, resource.RLIM_INFINITY))
try:
    write(Image((Part("a", oiio.ImageSpec(200, 300, 3, oiio.UINT8), fetch),)), sys.argv[1])
except ImageError as error:
    print(error)
"""


@pytest.mark.parametrize("name", ["a.tif", "a.exr", "a.png", "a.jpg", "a.tga", "a.bmp", "a.webp", "a.gif"])
def test_a_disk_that_takes_no_more_is_an_error_in_one_line_and_leaves_what_was_there(tmp_path, name):
    (tmp_path / name).write_bytes(b"the user's own")
    done = subprocess.run(
        [sys.executable, "-c", FULL, name, "20000"], cwd=tmp_path, capture_output=True, text=True, timeout=60
    )
    (line,) = done.stdout.splitlines()
    assert line.startswith(f"{name}: ")
    assert ".oiiotex-" not in line
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == {name: b"the user's own"}


@pytest.mark.parametrize("name", ["a.png", "a.tga", "a.gif", "a.fits"])
def test_a_disk_that_lacks_a_byte_is_an_error_too(tmp_path, name):
    """Several of OpenImageIO's writers do not notice that the last bytes have found no room."""

    def said(most: int) -> str:
        words = [sys.executable, "-c", FULL, name, str(most)]
        return subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, timeout=60).stdout

    assert said(0) == ""
    whole = (tmp_path / name).read_bytes()
    assert "the file is incomplete" in said(len(whole) - 1)
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == {name: whole}


INTERRUPTED = """
import os, signal, sys, threading, time
import numpy as np, OpenImageIO as oiio
from oiiotex.engine.core.image import Image, from_array
from oiiotex.engine.io.writing import write

def pester():
    while True:
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(0.0005)

signal.signal(signal.SIGTERM, lambda number, frame: None)
image = from_array(np.random.default_rng(1).integers(0, 255, (2000, 2000, 3), dtype=np.uint8))
threading.Thread(target=pester, daemon=True).start()
write(image, sys.argv[1])
print("whole", flush=True)
os._exit(0)
"""


@pytest.mark.parametrize("name", ["a.jpg", "a.webp"])
def test_a_signal_that_cuts_a_write_to_a_pipe_short_is_no_full_disk(tmp_path, name):
    """Libjpeg ends the process where a write fails, as it does when a signal comes while the pipe is full."""
    words = [sys.executable, "-c", INTERRUPTED, name]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert (done.stdout, done.returncode) == ("whole\n", 0), done.stderr
    assert os.listdir(tmp_path) == [name]
