# SPDX-License-Identifier: Apache-2.0
"""What goes wrong around a run, through the program: the right exit code, one line, nothing half, nothing lost."""

from __future__ import annotations

import os
import resource
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import load, oiiotex, save
from tests.faults import OLD, PROGRAM, line_of, slow, start

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals, mounts and limits of POSIX")

# --- full disks ---

OUTPUTS = {
    "exr": ["-d", "half", "-o", "out.exr"],
    "tiled exr": ["-d", "half", "--tile", "64", "64", "-o", "out.exr"],
    "tiff": ["-o", "out.tif"],
    "tiled tiff": ["--tile", "64", "64", "-o", "out.tif"],
    "png": ["-o", "out.png"],
    "jpeg": ["--quality", "100", "-o", "out.jpg"],
    "webp": ["--quality", "100", "-o", "out.webp"],
    "texture": ["-otex", "out.tx"],
    "sgi": ["-o", "out.sgi"],  # its writer seeks, and does not notice
    "dpx": ["-o", "out.dpx"],  # its writer gives the reason itself
}


def on_small_disk(tmp_path: Path, size: str, *commands: str) -> subprocess.CompletedProcess:
    """Run lines of a shell in a folder with little room, as anyone may where user namespaces are allowed."""
    if shutil.which("unshare") is None:
        pytest.skip("no unshare to mount a small file system with")
    small = tmp_path / "small"
    small.mkdir()
    mount = f"mount -t tmpfs -o size={size} none {small} 2>/dev/null || exit 77; cd {small}"
    shell = ["sh", "-c", "\n".join((mount, *commands))]
    done = subprocess.run(["unshare", "-rm", *shell], capture_output=True, text=True, timeout=300)
    if done.returncode == 77 or "unshare" in done.stderr:
        pytest.skip("may not mount a small file system")
    return done


@pytest.mark.parametrize("output", OUTPUTS)
def test_a_full_disk_is_one_line_and_keeps_the_old_output(tmp_path, picture, output):
    name = OUTPUTS[output][-1]
    run = shlex.join([*PROGRAM, str(picture), *OUTPUTS[output]])
    done = on_small_disk(tmp_path, "48k", f"echo old >{name}", run, f"code=$?; cat {name}; ls -A; exit $code")
    line = line_of(done)
    assert name in line
    assert ".oiiotex-" not in line
    assert line.count("No space left") <= 1
    assert done.stdout.split() == ["old", name]


@pytest.mark.parametrize("output", [name if name in ("png", "jpeg") else slow(name) for name in OUTPUTS])
def test_a_file_that_may_not_grow_is_one_line_and_keeps_the_old_output(tmp_path, picture, output):
    name = OUTPUTS[output][-1]
    (tmp_path / name).write_bytes(OLD)

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, 50_000))

    assert name in line_of(oiiotex(picture, *OUTPUTS[output], cwd=tmp_path, preexec_fn=limit))
    assert (tmp_path / name).read_bytes() == OLD
    assert sorted(os.listdir(tmp_path)) == sorted(["a.png", name])


def test_a_full_disk_does_not_end_the_frames_that_fit(tmp_path, picture):
    save(np.zeros((8, 8, 3)), tmp_path / "f.0001.png")
    shutil.copy(picture, tmp_path / "f.0002.png")
    save(np.zeros((8, 8, 3)), tmp_path / "f.0003.png")
    words = f"{tmp_path}/f.#.png --quality 100 -o o.#.jpg"
    for parallel in ("", "--parallel-frames --threads 1"):  # one at a time: two share the room that there is
        run = f"{shlex.join(PROGRAM)} {parallel} --skip-bad-frames {words}"
        done = on_small_disk(tmp_path, "72k", run, "code=$?; ls -A; exit $code")
        assert "o.0002.jpg" in line_of(done)
        assert done.stdout.split() == ["o.0001.jpg", "o.0003.jpg"]
        (tmp_path / "small").rmdir()


def test_no_room_for_intermediate_results_is_one_line_that_names_tmpdir(tmp_path):
    words = "--create 1600x1600 3 --cache 16 --mulc 0.5 --rotate 30 -o " + str(tmp_path / "out.exr")
    done = on_small_disk(tmp_path, "1m", f"TMPDIR=$PWD {shlex.join(PROGRAM)} {words}", "code=$?; ls -A; exit $code")
    assert "no space for intermediate results" in line_of(done)
    assert "set TMPDIR" in done.stderr
    assert (done.stdout, os.listdir(tmp_path)) == ("", ["small"])


# --- where nothing can be written ---


def without_privileges(folder: Path, *words: str) -> subprocess.CompletedProcess:
    """The program under the permissions of files: root may else do all."""
    drop: list[str] = []
    if os.geteuid() == 0:
        if shutil.which("setpriv") is None:
            pytest.skip("root may do all")
        drop = ["setpriv", "--bounding-set", "-dac_override,-dac_read_search"]
    return subprocess.run([*drop, *PROGRAM, *words], cwd=folder, capture_output=True, text=True, timeout=60)


def test_a_folder_that_may_not_be_written_is_one_line(tmp_path):
    save(np.zeros((8, 8, 3)), tmp_path / "a.tif")
    (tmp_path / "out.png").write_bytes(OLD)
    tmp_path.chmod(0o555)
    try:
        done = without_privileges(tmp_path, "a.tif", "-o", "out.png")
    finally:
        tmp_path.chmod(0o755)
    assert "out.png: the folder . cannot be written" in line_of(done)
    assert (tmp_path / "out.png").read_bytes() == OLD
    assert sorted(os.listdir(tmp_path)) == ["a.tif", "out.png"]


@pytest.mark.parametrize("folder", ["ro", "a.tif"])
def test_a_folder_that_cannot_be_created_is_named_by_the_file_asked_for(tmp_path, folder):
    save(np.zeros((8, 8, 3)), tmp_path / "a.tif")
    (tmp_path / "ro").mkdir(mode=0o555)
    done = without_privileges(tmp_path, "a.tif", "--create-dir", "-o", f"{folder}/new/out.png")
    assert f"cannot create the folder of {folder}/new/out.png: {folder} is not a folder" in line_of(done)


def test_a_file_that_may_not_be_read_is_one_line(tmp_path):
    save(np.zeros((8, 8, 3)), tmp_path / "a.png").chmod(0)
    assert "a.png" in line_of(without_privileges(tmp_path, "a.png", "-o", "out.png"))
    assert os.listdir(tmp_path) == ["a.png"]


@pytest.mark.parametrize("option", ["-o", "-otex", "--iccwrite"])
def test_a_folder_a_device_and_a_pipe_are_not_written_over(tmp_path, picture, option):
    (tmp_path / "folder.tif").mkdir()
    os.mkfifo(tmp_path / "pipe.tif")
    for target in ("folder.tif", "pipe.tif", "/dev/null"):
        assert line_of(oiiotex(picture, option, target, cwd=tmp_path))
    assert (tmp_path / "folder.tif").is_dir()
    assert (tmp_path / "pipe.tif").is_fifo()
    assert Path("/dev/null").is_char_device()
    assert sorted(os.listdir(tmp_path)) == ["a.png", "folder.tif", "pipe.tif"]


def test_what_a_symbolic_link_leads_to_is_replaced(tmp_path, picture):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "target.png").write_bytes(OLD)
    (tmp_path / "link.png").symlink_to(tmp_path / "elsewhere" / "target.png")
    assert oiiotex(picture, "-o", "link.png", cwd=tmp_path).returncode == 0
    assert (tmp_path / "link.png").is_symlink()
    assert load(tmp_path / "elsewhere" / "target.png").shape == load(picture).shape
    assert os.listdir(tmp_path / "elsewhere") == ["target.png"]


def test_two_processes_that_write_the_same_output_leave_a_whole_one(tmp_path):
    words = [["--create", "900x900", "3", *fill, "-o", "out.exr"] for fill in ([], ["--addc", "1"])]
    for _ in range(3):
        runs = [start(tmp_path, *line) for line in words]
        for each in runs:
            assert (each.communicate(timeout=120)[1], each.returncode) == ("", 0)
        pixels = load(tmp_path / "out.exr")
        assert pixels.shape == (900, 900, 3)
        assert len(np.unique(pixels)) == 1
        assert os.listdir(tmp_path) == ["out.exr"]


# --- names ---

LATIN = os.fsdecode(b"caf\xe9.png")


@pytest.mark.slow
def test_names_that_are_not_utf_8_are_refused_in_one_line(tmp_path, picture):
    try:
        shutil.copy(picture, tmp_path / LATIN)
    except OSError:
        pytest.skip("the file system has only names that are UTF-8")
    before = sorted(os.listdir(tmp_path))
    for words in (
        [LATIN, "-o", "b.png"],
        [picture, "-o", LATIN],
        [picture, "--history", "-o", LATIN],
        [picture, "--dup", "-o:all=1", os.fsdecode(b"\xe9%d.png")],
        ["--testread", LATIN],
        [picture, "--label", LATIN],
        [f"--{LATIN}"],
        [picture, "--keyword", LATIN, "-o", "b.png"],
        [picture, f"--blur:kernel={LATIN}", "3x3", "-o", "b.png"],
    ):
        line = line_of(subprocess.run([*PROGRAM, *map(os.fspath, words)], cwd=tmp_path, **CAPTURED))
        assert "internal" not in line
        assert sorted(os.listdir(tmp_path)) == before


CAPTURED = {"capture_output": True, "encoding": "utf-8", "errors": "backslashreplace", "timeout": 60}


def test_echo_gives_back_the_bytes_that_it_was_given():
    done = subprocess.run([*PROGRAM, "--echo", b"caf\xe9"], capture_output=True, timeout=60)
    assert (done.returncode, done.stdout) == (0, b"caf\xe9\n")


@pytest.mark.slow
def test_names_as_long_as_the_disk_allows_are_written(tmp_path, picture):
    for name in ("n" * 251 + ".png", "日" * 83 + ".png", "\U0001f9f1" * 62 + ".png"):
        assert oiiotex(picture, "-o", name, cwd=tmp_path).returncode == 0
        assert (tmp_path / name).exists()
        (tmp_path / name).unlink()
    assert "File name too long" in line_of(oiiotex(picture, "-o", "n" * 300 + ".png", cwd=tmp_path))
    assert os.listdir(tmp_path) == ["a.png"]


# --- what is printed ---


def shell(line: str, folder: Path) -> subprocess.CompletedProcess:
    program = shlex.join(PROGRAM)
    script = line.replace("oiiotex", program)
    return subprocess.run(["bash", "-c", script], cwd=folder, capture_output=True, text=True, timeout=60)


@pytest.mark.parametrize(
    ("line", "code", "says"),
    [
        ("oiiotex a.png --info --flip -o b.png >&-", 0, 0),
        ("oiiotex a.png --info --flip -o b.png 2>&-", 0, 0),
        ("oiiotex a.png --info --flip -o b.png <&- >&- 2>&-", 0, 0),
        ("oiiotex none.png --info --flip -o b.png >&-", 1, 1),
        ("oiiotex none.png 2>&-", 1, 0),
        ("oiiotex --help all >/dev/full", 1, 1),
        ("oiiotex --info a.png >/dev/full", 1, 1),
        ("oiiotex --echo x none.png >/dev/full", 1, 1),
        ("oiiotex none.png 2>/dev/full", 1, 0),
        ("oiiotex --help all | head -1 >/dev/null; exit 0", 0, 0),
    ],
)
def test_closed_full_and_broken_streams_are_no_traceback(tmp_path, picture, line, code, says):
    done = shell(line, tmp_path)
    assert (done.returncode, len(done.stderr.splitlines())) == (code, says), done
    if "-o b.png" in line and code == 0:
        np.testing.assert_array_equal(load(tmp_path / "b.png"), load(picture)[::-1])


def test_a_reader_that_has_gone_before_files_are_written_is_no_success(tmp_path, picture):
    done = shell("oiiotex --echo x a.png --info --info -o b.png | true; exit ${PIPESTATUS[0]}", tmp_path)
    assert done.stderr == ""
    assert done.returncode == (0 if (tmp_path / "b.png").exists() else 141)


# --- errors and tracebacks ---


def test_an_error_is_one_line_and_debug_shows_where(tmp_path, picture):
    for words in ([picture, "--resize", "nonsense"], ["none.png"], ["--bananas"]):
        line = line_of(oiiotex(*words, cwd=tmp_path))
        done = oiiotex(*words, "--debug", cwd=tmp_path)
        assert "Traceback" in done.stderr
        assert (done.returncode, done.stderr.splitlines()[-1]) == (1, line)
