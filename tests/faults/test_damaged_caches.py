# SPDX-License-Identifier: Apache-2.0
"""Whatever a cache holds may be damaged, by a disk or a power loss: it is made again, and no run is told."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from oiiotex.engine.core.window import Window
from oiiotex.engine.io import sealed
from oiiotex.engine.io.checkpoint import Checkpoint
from oiiotex.engine.io.sealed import SealedFolder
from oiiotex.engine.opencl.runtime import _KERNEL_FILE as FILES
from tests.conftest import installed, load, save

DAMAGES: dict[str, Callable[[bytes], bytes]] = {
    "empty": lambda data: b"",
    "half": lambda data: data[: len(data) // 2],
    "zeros": lambda data: bytes(len(data)),
    "a bit": lambda data: data[: len(data) // 2] + bytes([data[len(data) // 2] ^ 4]) + data[len(data) // 2 + 1 :],
    "a byte more": lambda data: data + b"\0",
}


def files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file() and path.stat().st_size)


def run(folder: Path, out: str, kernels: Path | None = None) -> np.ndarray:
    there = {**os.environ, "XDG_CACHE_HOME": str(folder / "cache")}
    there.pop("POCL_CACHE_DIR", None)
    there |= {} if kernels is None else {"POCL_CACHE_DIR": str(kernels)}
    done = installed("a.exr", "--texsuperpixel", "-q", "-o", out, cwd=folder, env=there)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", ""), done
    return load(folder / out)


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with an image, what a first run makes of it, and the caches that it leaves."""
    folder = tmp_path_factory.mktemp("compiled")
    save(np.random.default_rng(0).random((24, 24, 3)), folder / "a.exr", "float", "lin_rec709_scene")
    run(folder, "first.exr")
    return folder


@pytest.fixture
def folder(compiled: Path, tmp_path: Path) -> Path:
    """A copy of it, with the times by which seals know files."""
    return Path(shutil.copytree(compiled, tmp_path / "own"))


@pytest.mark.parametrize("damage", ["empty", *(pytest.param(d, marks=pytest.mark.slow) for d in [*DAMAGES][1:])])
def test_a_run_makes_again_what_is_damaged_in_its_caches(folder, damage):
    expected = load(folder / "first.exr")
    whole = files(folder / "cache")
    assert {"program.bc", sealed._LIST} <= {path.name for path in whole} and any(p.suffix == ".json" for p in whole)
    for path in whole:
        path.write_bytes(DAMAGES[damage](path.read_bytes()))
    assert np.array_equal(run(folder, "second.exr"), expected)
    for path in (path for path in files(folder / "cache") if path.name == "program.bc"):
        path.write_bytes(DAMAGES[damage](path.read_bytes()))  # the list is whole, and knows what it was
    assert np.array_equal(run(folder, "third.exr"), expected)


def test_a_folder_that_the_user_names_for_kernels_loses_no_file(folder):
    named = Path(shutil.copytree(folder / "cache" / "oiiotex" / "pocl", folder / "named"))
    (named / sealed._LIST).unlink()  # as PoCL leaves it
    note = named / "below" / "note.txt"
    note.parent.mkdir()
    for text in ("first", "then longer"):
        note.write_text(text)
        run(folder, "out.exr", note.parents[1])
        assert note.read_text() == text
    assert not list(note.parents[1].glob(sealed._LIST))


def test_a_folder_that_the_user_names_is_not_used_where_pocl_would_abort(folder):
    named = folder / "named"
    shutil.copytree(folder / "cache" / "oiiotex" / "pocl", named)
    wrong = next(named.rglob("*.so"))
    wrong.unlink()
    wrong.mkdir()
    there = {**os.environ, "XDG_CACHE_HOME": str(folder / "cache"), "POCL_CACHE_DIR": str(named)}
    done = installed("a.exr", "--texsuperpixel", "-o", "second.exr", cwd=folder, env=there)
    assert done.returncode == 0 and f"remove {wrong}" in done.stdout + done.stderr, done
    assert np.array_equal(load(folder / "second.exr"), load(folder / "first.exr")) and wrong.is_dir()


def test_a_program_without_its_kernels_is_built_once_more(folder):
    """PoCL takes an empty program.bc for such a program, and so damaged as nobody has sealed it."""
    expected = load(folder / "first.exr")
    for path in files(folder / "cache"):
        if path.name == sealed._LIST:
            path.unlink()
        elif path.name == "program.bc":
            path.write_bytes(b"")
    assert np.array_equal(run(folder, "second.exr"), expected)


@pytest.mark.parametrize("sealed_list", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_folder_in_place_of_a_kernel_and_a_file_in_place_of_a_folder_are_removed(folder, sealed_list):
    """PoCL aborts on both."""
    expected = load(folder / "first.exr")
    swap(folder, lambda path: path.suffix == ".so" or path.name == "last_accessed", sealed_list)
    assert np.array_equal(run(folder, "second.exr"), expected)
    swap(folder, lambda path: path.name.endswith("-smallgrid"), sealed_list)
    assert np.array_equal(run(folder, "third.exr"), expected)
    swap(folder, lambda path: path.name == "pocl", sealed_list)
    assert np.array_equal(run(folder, "fourth.exr"), expected)


def swap(folder: Path, chosen: Callable[[Path], bool], sealed_list: bool) -> None:
    """Each chosen file of the caches becomes a folder with a file in it, and each chosen folder a file."""
    found = [path for path in sorted((folder / "cache").rglob("*")) if chosen(path)]
    assert found
    for path in found:
        if path.is_dir():
            shutil.rmtree(path)
            path.write_bytes(b"x")
        else:
            path.unlink()
            path.mkdir()
            (path / "x").write_bytes(b"x")
    for path in [] if sealed_list else (folder / "cache").rglob(sealed._LIST):
        path.unlink()


# --- the seals of a folder ---


@pytest.fixture
def kernels(tmp_path: Path) -> Path:
    folder = tmp_path / "kernels"
    (folder / "AB" / "one").mkdir(parents=True)
    (folder / "AB" / "program.bc").write_bytes(b"program")
    (folder / "AB" / "one" / "one.so").write_bytes(b"kernel")
    (folder / "AB" / "last_accessed").write_bytes(b"")
    SealedFolder(folder, FILES).seal()
    return folder


def left(folder: Path) -> set[str]:
    SealedFolder(folder, FILES).remove_damaged()
    return {path.name for path in folder.rglob("*") if path.is_file()} - {sealed._LIST}


def test_damaged_files_are_removed_and_others_kept(kernels):
    everything = {"program.bc", "one.so", "last_accessed"}
    assert left(kernels) == everything
    os.utime(kernels / "AB" / "last_accessed")
    (kernels / "AB" / "new.so").write_bytes(b"kept by a process that was killed")
    assert left(kernels) == everything | {"new.so"}
    times = os.stat(kernels / "AB" / "program.bc")
    (kernels / "AB" / "program.bc").write_bytes(b"PROGRAM")
    os.utime(kernels / "AB" / "program.bc", ns=(times.st_atime_ns, times.st_mtime_ns))
    assert left(kernels) == {"one.so", "last_accessed", "new.so"}
    assert left(kernels.parent / "none") == set()


def test_links_and_pipes_among_kernels_are_removed(kernels, tmp_path):
    """A library would write through the one and wait for the other."""
    note, at = tmp_path / "note.txt", kernels / "AB" / "one"
    note.write_text("precious")
    (at / "link.so").symlink_to(note)
    os.mkfifo(at / "pipe.so")
    left(kernels)
    assert {path.name for path in at.iterdir()} == {"one.so"} and note.read_text() == "precious"
    os.mkfifo(at / "sealed")
    with pytest.raises(FileNotFoundError):
        sealed.read_sealed(at / "sealed")


def test_after_a_start_of_the_machine_all_files_are_read(kernels, monkeypatch, tmp_path):
    """A power loss leaves sizes and times as they were, and zeros in a file; of files without a seal none is whole."""
    (kernels / "AB" / "new.so").write_bytes(b"")
    seals = SealedFolder(kernels, FILES)
    monkeypatch.setattr(sealed, "digest_of", lambda path: "0" * 64)
    assert len(left(kernels)) == 4
    for name, text in (("_BOOT", "another"), ("_UPTIME", "0.0 1")):
        (tmp_path / name).write_text(text)
        monkeypatch.setattr(sealed, name, tmp_path / name)
    time.sleep(1.1)
    assert left(kernels) == set() and seals.folder.is_dir()


def test_a_damaged_list_vouches_for_no_file(kernels):
    path = kernels / sealed._LIST
    path.write_bytes(path.read_bytes()[:-3])
    assert left(kernels) == set()


def test_links_in_a_folder_are_not_followed(kernels, tmp_path):
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "photo.exr").write_bytes(b"photo")
    (kernels / "link.so").symlink_to(tmp_path / "own")
    (kernels / "AB" / "link").symlink_to(tmp_path / "own")
    (kernels / sealed._LIST).write_bytes(b"")
    left(kernels)
    assert (tmp_path / "own" / "photo.exr").read_bytes() == b"photo"


# --- pieces ---


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_piece_is_made_again(tmp_path, damage):
    place, pixels = Window(0, 0, 4, 3), np.arange(12.0)
    Checkpoint(tmp_path / "o.exr").piece("0" * 32, place, lambda: pixels)
    (file,) = files(tmp_path)
    whole = file.read_bytes()
    file.write_bytes(DAMAGES[damage](whole))
    again = Checkpoint(tmp_path / "o.exr")
    assert not again.holds("0" * 32, place)
    assert again.piece("0" * 32, place, lambda: pixels) is pixels
    assert file.read_bytes() == whole and again.holds("0" * 32, place)


def test_a_piece_takes_no_more_memory_than_its_file(tmp_path):
    """Its header may say what it likes."""
    header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000, 1000000), }"
    head = b"\x93NUMPY\x01\x00" + (len(header) + 1).to_bytes(2, "little") + header + b"\n"
    sealed.write_sealed(tmp_path / "a", [head, bytes(16)])
    with pytest.raises(ValueError, match="too small"):
        sealed.read_arrays(tmp_path / "a")


def test_a_probe_is_repeated_if_its_answer_is_damaged(tmp_path):
    code = "from oiiotex.engine.opencl import device_choice as d, runtime as r; i = d.choose('cpu'); "
    code += "print(r.tried(i.handle).lanes, r._answer_file(i.handle))"
    there = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}

    def told() -> list[str]:
        return subprocess.run([sys.executable, "-c", code], env=there, capture_output=True, text=True).stdout.split()

    lanes, name = told()
    whole = Path(name).read_bytes()
    Path(name).write_bytes(whole.replace(f'"lanes": {lanes}'.encode(), b'"lanes": 8'))
    assert told() == [lanes, name] and Path(name).read_bytes() == whole
