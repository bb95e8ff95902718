# SPDX-License-Identifier: Apache-2.0
"""What goes wrong around a run, through the program: the right exit code, one line, nothing half, nothing lost."""

from __future__ import annotations

import contextlib
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters, host
from oiiotex.cli.running import run
from oiiotex.errors import Error
from tests.conftest import load, oiiotex, save
from tests.parts import deep_file

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals, mounts and limits of POSIX")

PROGRAM = [sys.executable, "-m", "oiiotex.cli.main"]
OLD = b"the user's own"
SLOW = ["--pattern", "noise", "3000x3000", "3", "--blur", "9x9", "-d", "half", "--compression", "none"]


def slow(*values: object) -> object:
    return pytest.param(*values, marks=pytest.mark.slow)


def line_of(done: subprocess.CompletedProcess, code: int = 1) -> str:
    """The one line on stderr of a run that failed as it should."""
    lines = done.stderr.splitlines()
    assert (done.returncode, len(lines)) == (code, 1), done
    assert lines[0].startswith("oiiotex ERROR: ")
    return lines[0]


def half_files(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir() if ".oiiotex-" in path.name]


def half_written(folder: Path) -> bool:
    """Whether a frame is being written: a name that is only tried is empty."""
    sizes = []
    for name in half_files(folder):
        with contextlib.suppress(FileNotFoundError):
            sizes.append((folder / name).stat().st_size)
    return any(sizes)


def wait_for(what: Callable[[], object], run: subprocess.Popen, seconds: float = 60) -> None:
    end = time.monotonic() + seconds
    while not what():
        assert run.poll() is None, f"ended with {run.returncode} before that: {run.communicate()}"
        assert time.monotonic() < end, "has not happened"
        time.sleep(0.01)


def start(folder: Path, *words: object) -> subprocess.Popen:
    command = [*PROGRAM, "--noprogress", *map(str, words)]
    return subprocess.Popen(
        command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )


def nobody_left(run: subprocess.Popen) -> bool:
    """Whether all processes of a run's session are gone, shortly after it."""
    for _ in range(500):
        try:
            os.killpg(run.pid, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.02)
    return False


@pytest.fixture
def picture(tmp_path: Path) -> Path:
    """An image of noise: no format makes it small."""
    return save(np.random.default_rng(0).random((200, 300, 3)), tmp_path / "a.png")


# --- signals ---


@pytest.mark.parametrize("name", ["out.exr", "out.tif", "out.png", "out.jpg"])
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_while_writing_leaves_the_old_output_and_nothing_half(tmp_path, name, number, code):
    (tmp_path / name).write_bytes(OLD)
    run = start(tmp_path, *SLOW[:-4], "-o", name)
    wait_for(lambda: half_files(tmp_path), run)
    run.send_signal(number)
    assert (*run.communicate(timeout=60), run.returncode) == ("", "", code)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {name: OLD}


@pytest.mark.parametrize(
    "words",
    [["--testread", "big.png"] * 200, ["big.png", "--fft", "--dup", "--pop"] * 50],
    ids=["reading", "computing"],
)
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_while_reading_or_computing_ends_the_run(tmp_path, words, number, code):
    save(np.zeros((700, 800, 3)), tmp_path / "big.png")
    (tmp_path / "out.exr").write_bytes(OLD)
    run = start(tmp_path, "--create", "8x8", "3", "-o", "begun.exr", *words, "-o", "out.exr")
    wait_for((tmp_path / "begun.exr").exists, run)
    time.sleep(0.1)
    run.send_signal(number)
    _, errors = run.communicate(timeout=60)
    assert (errors, run.returncode) == ("", code)
    assert sorted(os.listdir(tmp_path)) == ["begun.exr", "big.png", "out.exr"]
    assert (tmp_path / "out.exr").read_bytes() == OLD


@pytest.mark.parametrize("delay", [0.15, 0.3, 0.45])
def test_a_signal_while_the_program_is_loaded_leaves_no_traceback(tmp_path, delay):
    run = start(tmp_path, *SLOW, "-o", "out.exr")
    wait_for(lambda: handles(run.pid, signal.SIGTERM), run)
    time.sleep(delay)
    run.send_signal(signal.SIGINT)
    assert (run.communicate(timeout=60)[1], run.returncode) == ("", 130)
    assert os.listdir(tmp_path) == []


def test_a_signal_where_python_drops_exceptions_ends_the_run():
    code = """
import signal
from oiiotex.cli.stopping import stop_on_signals
class Dropped:
    def __del__(self):
        signal.raise_signal(signal.SIGTERM)
stop_on_signals()
Dropped()
print("went on")
"""
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (ended.stdout, ended.stderr, ended.returncode) == ("", "", 143)


def handles(pid: int, number: int) -> bool:
    status = Path(f"/proc/{pid}/status")
    if not status.exists():
        pytest.skip("no /proc")
    caught = next((line.split()[1] for line in status.read_text().splitlines() if line.startswith("SigCgt")), "0")
    return bool(int(caught, 16) >> (number - 1) & 1)


def test_a_second_signal_ends_the_run_at_once_and_leaves_nothing_half(tmp_path):
    (tmp_path / "out.exr").write_bytes(OLD)
    run = start(tmp_path, *SLOW, "-o", "out.exr")
    wait_for(lambda: half_files(tmp_path), run)
    for number in (signal.SIGTERM, signal.SIGTERM, signal.SIGINT):
        run.send_signal(number)
    assert run.wait(timeout=60) in (130, 143)
    assert run.communicate()[1] == ""
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {"out.exr": OLD}


def test_a_run_that_is_to_ignore_interrupts_ignores_them(tmp_path):
    script = f"trap '' INT; exec {' '.join(PROGRAM)} --create 8x8 3 --echo begun --testread a.png -o out.exr"
    save(np.zeros((8, 8, 3)), tmp_path / "a.png")
    run = subprocess.Popen(["sh", "-c", script], cwd=tmp_path, stderr=subprocess.PIPE, start_new_session=True)
    wait_for(lambda: handles(run.pid, signal.SIGTERM), run)
    run.send_signal(signal.SIGINT)
    assert (run.communicate(timeout=60)[1], run.returncode) == (b"", 0)
    assert (tmp_path / "out.exr").exists()


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGINT, 130), slow(signal.SIGTERM, 143), slow(signal.SIGKILL, -9)]
)
def test_a_signal_to_parallel_frames_ends_all_processes(tmp_path, number, code):
    (tmp_path / "out.0001.exr").write_bytes(OLD)
    words = ["--frames", "1-8", "--parallel-frames", "--threads", "2", *SLOW, "-o", "out.#.exr"]
    run = start(tmp_path, *words)
    wait_for(lambda: half_written(tmp_path), run)
    run.send_signal(number)
    _, errors = run.communicate(timeout=60)
    assert (errors, run.returncode) == ("", code)
    assert nobody_left(run)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {"out.0001.exr": OLD}


def test_a_ctrl_c_which_goes_to_all_processes_is_silent_too(tmp_path):
    words = ["--frames", "1-8", "--parallel-frames", "--threads", "2", *SLOW, "-o", "out.#.exr"]
    run = start(tmp_path, *words)
    wait_for(lambda: half_files(tmp_path), run)
    os.killpg(run.pid, signal.SIGINT)
    _, errors = run.communicate(timeout=60)
    assert (errors, run.returncode) == ("", 130)
    assert nobody_left(run)
    assert half_files(tmp_path) == []


def test_a_killed_worker_is_an_error_and_not_an_endless_wait(tmp_path):
    words = ["--frames", "1-8", "--parallel-frames", "--threads", "2", *SLOW, "-o", "out.#.exr"]
    run = start(tmp_path, *words)
    workers: list[int] = []

    def a_worker_writes() -> bool:  # and not the parent, which looks at formats before the work
        pids = {int(name.split("-")[-2]) for name in half_files(tmp_path)} - {run.pid}
        workers.extend(pids)
        return bool(pids)

    wait_for(a_worker_writes, run)
    pid = workers[0]
    os.kill(pid, signal.SIGKILL)
    output, errors = run.communicate(timeout=60)
    assert "has ended of itself" in line_of(subprocess.CompletedProcess([], run.returncode, output, errors))
    assert nobody_left(run)
    assert [name for name in half_files(tmp_path) if f"-{pid}-" not in name] == []
    oiiotex("--create", "8x8", "3", "-o", "next.exr", cwd=tmp_path)
    assert os.listdir(tmp_path) == ["next.exr"]


def test_what_parallel_frames_print_arrives_in_order(tmp_path, picture):
    done = oiiotex("--frames", "1-3", "--parallel-frames", picture, "--echo", "frame #", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (0, "frame 0001\nframe 0002\nframe 0003\n")


@pytest.mark.parametrize("name", ["out.exr", "out.tif", "out.png"])
def test_what_kill_9_leaves_is_hidden_bears_pid_and_host_and_is_swept(tmp_path, name):
    (tmp_path / name).write_bytes(OLD)
    run = start(tmp_path, *SLOW[:-4], "-o", name)
    wait_for(lambda: half_files(tmp_path), run)
    run.kill()
    run.communicate(timeout=60)
    (left,) = half_files(tmp_path)
    assert left.startswith(".out.oiiotex-")
    assert f"-{run.pid}-" in left
    assert "".join(c if c.isalnum() else "_" for c in os.uname().nodename) in left
    assert (tmp_path / name).read_bytes() == OLD
    assert oiiotex("--create", "8x8", "3", "-o", "next.exr", cwd=tmp_path).returncode == 0
    assert sorted(os.listdir(tmp_path)) == ["next.exr", name]


# --- full disks ---

OUTPUTS = {
    "exr": ["-d", "half", "-o", "out.exr"],
    "tiled exr": ["-d", "half", "--tile", "64", "64", "-o", "out.exr"],
    "tiff": ["-o", "out.tif"],
    "tiled tiff": ["--tile", "64", "64", "-o", "out.tif"],
    "png": ["-o", "out.png"],
    "jpeg": ["--quality", "100", "-o", "out.jpg"],
    "texture": ["-otex", "out.tx"],
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
    run = " ".join([*PROGRAM, str(picture), *OUTPUTS[output]])
    done = on_small_disk(tmp_path, "72k", f"echo old >{name}", run, f"code=$?; cat {name}; ls -A; exit $code")
    line = line_of(done)
    assert name in line
    assert ".oiiotex-" not in line
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
        run = f"{' '.join(PROGRAM)} {parallel} --skip-bad-frames {words}"
        done = on_small_disk(tmp_path, "72k", run, "code=$?; ls -A; exit $code")
        assert "o.0002.jpg" in line_of(done)
        assert done.stdout.split() == ["o.0001.jpg", "o.0003.jpg"]
        (tmp_path / "small").rmdir()


def test_no_room_for_intermediate_results_is_one_line_that_names_tmpdir(tmp_path):
    words = "--create 1600x1600 3 --cache 16 --mulc 0.5 --rotate 30 -o " + str(tmp_path / "out.exr")
    done = on_small_disk(tmp_path, "1m", f"TMPDIR=$PWD {' '.join(PROGRAM)} {words}", "code=$?; ls -A; exit $code")
    assert "no room for intermediate results" in line_of(done)
    assert "set TMPDIR" in done.stderr
    assert (done.stdout, os.listdir(tmp_path)) == ("", ["small"])


# --- files that are not what they were ---

ENDINGS = ["exr", "tif", "png", "jpg"]


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("share", [slow(0.0), 0.03, slow(0.5), 0.97])
def test_a_truncated_file_is_one_line(tmp_path, picture, ending, share):
    whole = tmp_path / f"whole.{ending}"
    save(np.random.default_rng(0).random((200, 300, 3)), whole, "half" if ending == "exr" else "uint8")
    data = whole.read_bytes()
    (tmp_path / f"cut.{ending}").write_bytes(data[: int(len(data) * share)])
    (tmp_path / "out.tif").write_bytes(OLD)
    assert f"cut.{ending}" in line_of(oiiotex(f"cut.{ending}", "--flip", "-o", "out.tif", cwd=tmp_path))
    assert (tmp_path / "out.tif").read_bytes() == OLD
    assert half_files(tmp_path) == []


@pytest.mark.parametrize("skip", [False, True])
@pytest.mark.parametrize("parallel", [False, True])
def test_a_frame_that_is_not_there_ends_the_run_or_is_skipped(tmp_path, skip, parallel):
    for number in (1, 3):
        save(np.zeros((8, 8, 3)), tmp_path / f"f.{number:04d}.png")
    words = ["--skip-bad-frames"] * skip + ["--parallel-frames", "--threads", "1"] * parallel
    done = oiiotex("--frames", "1-3", *words, "f.#.png", "-o", "o.#.png", cwd=tmp_path)
    assert "f.0002.png: no such file" in line_of(done)
    for number, there in ((1, skip), (2, False), (3, skip)):  # a gap is seen before the first frame is worked on
        assert (tmp_path / f"o.{number:04d}.png").exists() == there


def test_a_file_that_vanishes_between_frames_ends_its_frame_alone(tmp_path):
    for number in (1, 2, 3):
        save(np.zeros((8, 8, 3)), tmp_path / f"f.{number:04d}.png")
    run = start(
        tmp_path, "--frames", "1-3", "--skip-bad-frames",
        "f.#.png", "--pattern", "noise", "1200x1200", "3", "--blur", "9x9", "-o", "o.#.png",
    )  # fmt: skip
    wait_for(lambda: half_files(tmp_path), run)
    (tmp_path / "f.0002.png").unlink()
    output, errors = run.communicate(timeout=120)
    done = subprocess.CompletedProcess([], run.returncode, output, errors)
    assert "f.0002.png: no such file" in line_of(done)
    assert sorted(path.name for path in tmp_path.glob("o.*")) == ["o.0001.png", "o.0003.png"]


def striped(path: Path, side: int = 3600) -> np.ndarray:
    """More pixels than are kept in memory with a small --cache."""
    pixels = np.zeros((side, side, 3), np.uint8)
    pixels[..., 0], pixels[..., 1] = (np.arange(side) % 251)[:, None], np.arange(side) % 241
    spec = oiio.ImageSpec(side, side, 3, oiio.UINT8)
    spec.attribute("compression", "none" if path.suffix == ".tif" else "zip")
    spec.attribute("png:compressionLevel", 1)
    out = oiio.ImageOutput.create(str(path))
    assert out.open(str(path), spec)
    assert out.write_image(pixels)
    assert out.close()
    return pixels


@pytest.mark.parametrize("name", ["a.png", "a.tif"])
def test_an_input_that_is_written_over_is_still_what_it_was(tmp_path, name):
    pixels = striped(tmp_path / name)
    words = [name, "--dup", "--mulc", "0.5", "-o", name, "--pop", "--cache", "8", "--flip", "-o", "b.tif"]
    done = oiiotex(*words, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    np.testing.assert_array_equal(load(tmp_path / "b.tif"), pixels[::-1])
    assert sorted(os.listdir(tmp_path)) == sorted([name, "b.tif"])


@pytest.mark.parametrize(
    "op", [["--flip"], slow(["--transpose"]), slow(["--rotate", "90"]), ["--blur", "3x3"], slow(["--resize", "50%"])]
)
@pytest.mark.parametrize("name", ["a.png", "a.exr", "a.tif"])
def test_an_op_in_place_gives_what_it_gives_elsewhere(tmp_path, name, op):
    save(np.random.default_rng(0).random((60, 50, 3)), tmp_path / name, "half" if name == "a.exr" else "uint8")
    assert oiiotex(name, *op, "-o", "b" + name, cwd=tmp_path).returncode == 0
    assert oiiotex(name, *op, "-o", name, cwd=tmp_path).returncode == 0
    np.testing.assert_array_equal(load(tmp_path / name), load(tmp_path / f"b{name}"))
    assert sorted(os.listdir(tmp_path)) == sorted([name, f"b{name}"])


CHANGED = """
import os, shutil, sys
from oiiotex.errors import Error
from oiiotex.io.reading import read
from oiiotex.core.demand import PieceCache
from oiiotex.core.window import Window

part = read(sys.argv[1], PieceCache(1)).first
part.read(Window(0, 3500, 3600, 3600))
how = sys.argv[2]
if how == "replaced":
    shutil.copy(sys.argv[1], "new"), os.replace("new", sys.argv[1])
elif how == "removed":
    os.remove(sys.argv[1])
else:
    os.truncate(sys.argv[1], 10_000)
try:
    part.read(Window(0, 0, 3600, 100))
except Error as error:
    print(error)
"""


@pytest.mark.parametrize("how", ["replaced", "removed", "truncated"])
@pytest.mark.parametrize("name", ["a.png", "a.tif"])
def test_an_input_that_another_changes_while_it_is_read_is_an_error(tmp_path, name, how):
    striped(tmp_path / name)
    done = subprocess.run([sys.executable, "-c", CHANGED, name, how], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done
    assert done.stdout == f"{name}: was changed by someone else while it was read\n"


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
    program = " ".join(PROGRAM)
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
        ("oiiotex --help >/dev/full", 1, 1),
        ("oiiotex --info a.png >/dev/full", 1, 1),
        ("oiiotex --echo x none.png >/dev/full", 1, 1),
        ("oiiotex none.png 2>/dev/full", 1, 0),
        ("oiiotex --help | head -1 >/dev/null; exit 0", 0, 0),
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


# --- sizes ---


def peak_of(folder: Path, *words: object) -> int:
    """Megabytes that a run has held at most; of a child of a small process, whose own peak a child begins with."""
    script = "import resource as r, subprocess as s, sys; s.run(sys.argv[1:], check=True)"
    script += "; print(r.getrusage(r.RUSAGE_CHILDREN).ru_maxrss)"
    done = subprocess.run(
        [sys.executable, "-c", script, *PROGRAM, "--noprogress", *words], cwd=folder, capture_output=True, text=True
    )
    assert (done.returncode, done.stderr) == (0, "")
    return int(done.stdout) >> 10


def wide(path: Path, height: int) -> Path:
    """Scanlines of a hundred thousand pixels."""
    spec = oiio.ImageSpec(100_000, height, 3, oiio.UINT8 if path.suffix == ".tif" else oiio.HALF)
    spec.attribute("compression", "none")
    pixels = np.zeros((height, 100_000, 3), np.uint8)
    pixels[..., 0], pixels[..., 1] = (np.arange(height) % 251)[:, None], np.arange(100_000) % 251
    out = oiio.ImageOutput.create(str(path))
    assert out.open(str(path), spec)
    assert out.write_image(pixels)
    assert out.close()
    return path


@pytest.mark.parametrize("op", ["--flip", slow("--mulc 0.5"), "--cut 700x50+99300+9"])
@pytest.mark.parametrize("ending", ["exr", "tif"])
def test_memory_does_not_grow_with_the_scanlines_of_a_wide_file(tmp_path, ending, op):
    low, high = (wide(tmp_path / f"{height}.{ending}", height) for height in (64, 320))
    words = ["--cache", "32", "--compression", "none", *op.split(), "-o", f"out.{ending}"]
    grown = peak_of(tmp_path, high, *words) - peak_of(tmp_path, low, *words)
    assert grown < 100  # its floats alone are 293 MB more
    if op == "--flip":
        np.testing.assert_array_equal(load(tmp_path / f"out.{ending}"), load(low)[::-1])
    if op.startswith("--cut"):
        np.testing.assert_array_equal(load(tmp_path / f"out.{ending}"), load(low)[9:59, 99300:])


def test_wide_scanlines_are_resized_or_refused_with_the_figure(tmp_path):
    wide(tmp_path / "wide.tif", 64)
    assert oiiotex("wide.tif", "--resize", "1000x16", "-o", "out.tif", cwd=tmp_path).returncode == 0
    assert load(tmp_path / "out.tif").shape == (16, 1000, 3)
    done = oiiotex("--cache", "16", "wide.tif", "--resize", "1000x16", "-o", "out.tif", cwd=tmp_path)
    assert done.returncode == 0 or "of memory; the budget is 16 MB" in line_of(done)


# what an op's argument may be, by its name; by the op's flag where one is to differ
ARGUMENTS = {
    "value": "0.5", "scale": "0.5", "strategy": "box3", "channels": "R,G,B", "count": "3", "names": "A,B,C",
    "map": "inferno", "space": "ACEScg", "to_space": "ACEScg", "from_space": "ACEScg", "matrix": "1,0,0,0,1,0,0,0,1",
    "orientation": "6", "place": "+3+4", "offset": "+1+1", "size": "3x3", "codes": "1,13", "position": "+0+0",
    "shift": "+1+1", "aspect": "2", "angle": "30", "corners": "0,0,1,1", "points": "0,0,1,1", "kernel": "gaussian",
    "--crop": "1x1+0+0", "--cut": "1x1+0+0", "--mosaic": "1x1", "--resize": "1x1", "--create": "1x1 3",
    "--pattern": "noise 1x1 3",
}  # fmt: skip


@pytest.mark.parametrize("op", [*host.OPS, *filters.FILTERS], ids=lambda op: op.flag())
def test_a_single_pixel_has_a_result_or_a_one_line_refusal(tmp_path, op):
    one = np.full((1, 1, 4), 0.5)
    sources = {"rgb.exr": one[..., :3], "rgba.tif": one, "st.exr": one[..., :2], "y.png": one[..., :1]}
    for name, pixels in sources.items():
        save(pixels, tmp_path / name, "uint8" if name == "y.png" else "float", "ACEScg")
    given = ARGUMENTS.get(op.flag(), " ".join(ARGUMENTS.get(p.name, "1") for p in op.arguments())).split()
    for source in sources:
        images = [source, *["st.exr" if "warp" in op.name else source] * (max(1, len(op.images())) - 1)]
        words = [*images, op.flag(), *given, "-d", "float", "-o", "out.exr"]
        try:
            run([str(word) for word in words], tmp_path)
        except Error as error:
            assert "\n" not in str(error)
        else:
            assert np.prod(load(tmp_path / "out.exr").shape) > 0
            (tmp_path / "out.exr").unlink()
    assert sorted(os.listdir(tmp_path)) == sorted(sources)


@pytest.mark.parametrize("op", ["--fft", "--ifft"])
def test_an_op_that_needs_the_whole_image_refuses_with_the_figure(tmp_path, op):
    words = ["--create", "3000x2000", "2", "--cache", "20", op, "-o", "out.exr"]
    line = line_of(oiiotex(*words, cwd=tmp_path))
    assert f"{op} needs " in line
    assert " MB of memory; the budget is 20 MB: raise --cache" in line
    assert os.listdir(tmp_path) == []


@pytest.mark.slow
def test_thirty_two_channels_go_through_or_are_cut_with_a_warning(tmp_path):
    save(np.random.default_rng(0).random((20, 30, 32)), tmp_path / "many.exr", "float")
    pixels = load(tmp_path / "many.exr")
    for op, expected in (("--flip", pixels[::-1]), ("--mulc 0.5", pixels * np.float32(0.5)), ("--crop 9x9", None)):
        done = oiiotex("many.exr", *op.split(), "-o", "o.tif", "-o", "o.exr", cwd=tmp_path)
        assert (done.returncode, done.stderr) == (0, "")
        for name in ("o.tif", "o.exr"):
            assert load(tmp_path / name).shape[2] == 32
            if expected is not None:
                np.testing.assert_allclose(load(tmp_path / name), expected, atol=1e-6)
    done = oiiotex("many.exr", "-d", "uint8", "-o", "o.png", cwd=tmp_path)
    assert (done.returncode, load(tmp_path / "o.png").shape[2]) == (0, 4)
    assert "cannot hold 32 channels" in done.stderr


def test_a_deep_image_is_refused_in_one_clear_line(tmp_path):
    deep_file(tmp_path / "deep.exr")
    for words in (["--flip", "-o", "o.exr"], ["--info"], ["-otex", "o.tx"]):
        line = line_of(oiiotex("deep.exr", *words, cwd=tmp_path))
        assert "deep.exr: deep and volume images are not supported" in line
    assert os.listdir(tmp_path) == ["deep.exr"]
    assert "deep images are not supported" in line_of(oiiotex("deep.exr", "--flatten", cwd=tmp_path))


# --- errors and tracebacks ---


def test_an_error_is_one_line_and_debug_shows_where(tmp_path, picture):
    for words in ([picture, "--resize", "nonsense"], ["none.png"], ["--bananas"]):
        line = line_of(oiiotex(*words, cwd=tmp_path))
        done = oiiotex(*words, "--debug", cwd=tmp_path)
        assert "Traceback" in done.stderr
        assert (done.returncode, done.stderr.splitlines()[-1]) == (1, line)
