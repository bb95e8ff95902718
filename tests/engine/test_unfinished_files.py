# SPDX-License-Identifier: Apache-2.0
"""Unfinished files: a lock says who still writes one, what is left is swept, and what is done is on the disk."""

from __future__ import annotations

import errno
import fcntl
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from oiiotex.engine.core.image import Image
from oiiotex.engine.io import atomic
from oiiotex.engine.io.atomic import temporary_beside
from oiiotex.engine.io.reading import read
from oiiotex.engine.io.writing import write
from tests.conftest import oiiotex, save
from tests.faults import half_files
from tests.faults.test_faults import PROGRAM, on_small_disk
from tests.parts import small

WRITER = """
import os, platform, sys
from pathlib import Path
host, pid = sys.argv[1:]
platform.node = lambda: host
own, os.getpid = os.getpid, lambda: int(pid)
from oiiotex.engine.io.atomic import temporary_beside
with temporary_beside(Path("big.exr")) as temporary:
    temporary.write_bytes(b"half")
    print(temporary.name, flush=True)
    sys.stdin.read()
"""
HERE = os.uname().nodename


@pytest.fixture
def writer(tmp_path: Path) -> Iterator:
    """Begins a process that writes `big.exr` under a host's name and a pid, until its stdin is closed."""
    begun: list[subprocess.Popen] = []

    def begin(host: str, pid: int) -> tuple[subprocess.Popen, str]:
        command = [sys.executable, "-c", WRITER, host, str(pid)]
        begun.append(subprocess.Popen(command, cwd=tmp_path, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True))
        return begun[-1], begun[-1].stdout.readline().strip()

    yield begin
    for process in begun:
        process.kill()
        process.communicate()


def a_free_pid() -> int:
    process = subprocess.Popen(["true"])
    process.wait()
    return process.pid


@pytest.mark.parametrize("host", [HERE, "another-node"])
def test_a_writer_in_another_container_is_not_swept_while_it_lives(tmp_path, writer, host):
    process, name = writer(host, a_free_pid())  # as a container shows it: a pid that nobody here has
    assert name in os.listdir(tmp_path)
    write(small(), tmp_path / "a.png")
    assert (tmp_path / name).read_bytes() == b"half"
    process.communicate("")
    assert process.returncode == 0
    assert sorted(os.listdir(tmp_path)) == ["a.png", "big.exr"]
    assert (tmp_path / "big.exr").read_bytes() == b"half"


@pytest.mark.parametrize("pid", [None, os.getpid()], ids=["free pid", "a living pid"])
def test_a_killed_writer_is_swept_whatever_its_pid(tmp_path, writer, pid):
    process, name = writer(HERE, pid or a_free_pid())
    process.send_signal(signal.SIGKILL)
    process.communicate()
    assert os.listdir(tmp_path) == [name]
    write(small(), tmp_path / "a.png")
    assert os.listdir(tmp_path) == ["a.png"]


def aged(path: Path, hours: float) -> None:
    before = path.stat().st_mtime - 3600 * hours
    os.utime(path, (before, before))


def test_a_killed_writer_of_another_host_is_swept_after_a_day(tmp_path, writer):
    process, name = writer("another-node", a_free_pid())
    process.send_signal(signal.SIGKILL)
    process.communicate()
    aged(tmp_path / name, 23)
    write(small(), tmp_path / "a.png")
    assert name in os.listdir(tmp_path)  # its lock may be one that does not reach this host
    aged(tmp_path / name, 25)
    write(small(), tmp_path / "a.png")
    assert os.listdir(tmp_path) == ["a.png"]


@pytest.mark.parametrize("code", [errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS])
def test_without_locks_age_says_what_is_left(tmp_path, monkeypatch, code):
    def no_locks(file: int, how: int) -> None:
        raise OSError(code, os.strerror(code))

    with temporary_beside(tmp_path / "spy.exr") as temporary:
        young, old = (temporary.name.replace(temporary.name[-20:-4], digits * 16) for digits in "ab")
    for name in (young, old):
        (tmp_path / name).write_bytes(b"half")
    aged(tmp_path / young, 23)
    aged(tmp_path / old, 25)
    monkeypatch.setattr(fcntl, "flock", no_locks)
    write(small(), tmp_path / "a.png")
    assert sorted(os.listdir(tmp_path)) == sorted([young, "a.png", "spy.exr"])


def test_a_sweep_that_comes_between_making_and_locking_costs_nothing(tmp_path, monkeypatch):
    lock, begun = fcntl.flock, []

    def swept_before(file: int, how: int) -> None:
        if not begun:
            begun.append(half_files(tmp_path))
            (tmp_path / begun[0][0]).unlink()
        lock(file, how)

    monkeypatch.setattr(fcntl, "flock", swept_before)
    write(small(), tmp_path / "a.png")
    assert begun[0]
    assert os.listdir(tmp_path) == ["a.png"]


def test_what_maketx_leaves_under_its_own_name_is_swept(tmp_path):
    with temporary_beside(tmp_path / "spy.tx") as temporary:
        mark = temporary.name.removesuffix(".tx")
    for name in (f"{mark}.tx", f"{mark}.texture.tx", f"{mark}.texture.30e1b780.temp.tx", f"{mark}.kept.png"):
        (tmp_path / name).write_bytes(b"half")
    write(small(), tmp_path / "a.png")
    assert sorted(os.listdir(tmp_path)) == ["a.png", "spy.tx"]


def test_a_texture_that_is_made_is_not_swept(tmp_path):
    save(small().first.pixels(), tmp_path / "a.png")
    done = oiiotex("a.png", "-otex", "a.tx", cwd=tmp_path)
    assert (done.returncode, sorted(os.listdir(tmp_path))) == (0, ["a.png", "a.tx"])
    with temporary_beside(tmp_path / "b.tx") as temporary:
        made = atomic.part_of(temporary, "texture")
        made.write_bytes(b"made")
        write(small(), tmp_path / "c.png")
        assert made.read_bytes() == b"made"
        atomic.take(temporary, made)
        write(small(), tmp_path / "c.png")
    assert (tmp_path / "b.tx").read_bytes() == b"made"


def test_a_photo_that_is_read_on_while_it_is_replaced_is_not_swept(tmp_path):
    write(small(), tmp_path / "a.png")
    image = read(tmp_path / "a.png")
    write(small(), tmp_path / "a.png")
    (kept,) = [name for name in half_files(tmp_path) if ".kept" in name]
    write(small(), tmp_path / "b.png")
    assert kept in os.listdir(tmp_path)
    assert image.first.pixels().shape == small().first.pixels().shape
    del image
    assert half_files(tmp_path) == []


# --- on the disk ---


def synced(monkeypatch: pytest.MonkeyPatch, work) -> list[str]:
    """The names that `fsync` and `rename` were called for, in order."""
    calls: list[str] = []
    fsync, replace = os.fsync, Path.replace

    def name_of(file: int) -> str:
        return re.sub(r"\.oiiotex-.*\.", "~.", os.path.basename(os.readlink(f"/proc/self/fd/{file}")))

    monkeypatch.setattr(os, "fsync", lambda file: (calls.append(f"sync {name_of(file)}"), fsync(file))[1])
    monkeypatch.setattr(Path, "replace", lambda *a: (calls.append(f"rename to {a[1].name}"), replace(*a))[1])
    work()
    return calls


def test_a_file_is_on_the_disk_before_its_name_and_the_name_before_the_end(tmp_path, monkeypatch):
    calls = synced(monkeypatch, lambda: write(small(), tmp_path / "a.png"))
    assert calls == ["sync .a~.png", "rename to a.png", f"sync {tmp_path.name}"]


def test_a_variable_and_caches_do_without(tmp_path, monkeypatch):
    def cache() -> None:
        with temporary_beside(tmp_path / "a.arrays", cache=True):
            pass

    assert synced(monkeypatch, cache) == ["rename to a.arrays"]
    monkeypatch.setenv("OIIOTEX_FSYNC", "0")
    assert synced(monkeypatch, lambda: write(small(), tmp_path / "a.png")) == ["rename to a.png"]


def test_a_disk_that_fails_to_sync_keeps_the_old_output(tmp_path, monkeypatch):
    def fail(file: int) -> None:
        raise OSError(errno.EIO, "Input/output error")

    (tmp_path / "a.png").write_bytes(b"the user's own")
    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(atomic.ImageError, match=r"a\.png: Input/output error"):
        write(small(), tmp_path / "a.png")
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {"a.png": b"the user's own"}


def test_a_file_system_that_counts_no_free_blocks_takes_files(tmp_path, picture):
    """Ramfs says 0 of 0 blocks are free, as some of FUSE do."""
    small_disk = " ".join((*PROGRAM, str(picture), "-o", "out.png"))
    mount = "umount . 2>/dev/null; mount -t ramfs none $PWD || exit 77; cd $PWD"
    done = on_small_disk(tmp_path, "72k", mount, "stat -f -c %f .", small_disk, "code=$?; ls -A; exit $code")
    assert (done.returncode, done.stdout.split()) == (0, ["0", "out.png"]), done


def test_a_part_of_an_image_that_is_not_there_is_an_error(tmp_path):
    image = Image(small().parts)
    write(image, tmp_path / "a.tif")
    whole = (tmp_path / "a.tif").read_bytes()
    (tmp_path / "half.tif").write_bytes(whole[: len(whole) // 2])
    from oiiotex.engine.io.writing import require_arrived

    with pytest.raises(atomic.ImageError, match="the file is incomplete"):
        require_arrived(tmp_path / "half.tif", tmp_path / "b.tif", image, "tiff")
