# SPDX-License-Identifier: Apache-2.0
"""What a signal leaves behind: the right exit code, nothing half, the old output; of one process and of several."""

from __future__ import annotations

import ast
import os
import re
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import load, oiiotex, save
from tests.faults import OLD, PROGRAM, SLOW, half_files, half_written, line_of, nobody_left, slow, start, wait_for

ENDS = [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)]
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals, mounts and limits of POSIX")


@pytest.mark.parametrize(
    ("name", "number", "code"),
    [*(("out.exr", *end) for end in ENDS), *((name, *ENDS[1]) for name in ("out.tif", "out.png", "out.jpg"))],
)
def test_a_signal_while_writing_leaves_the_old_output_and_nothing_half(tmp_path, name, number, code):
    (tmp_path / name).write_bytes(OLD)
    run = start(tmp_path, *SLOW[:-4], "-o", name)
    wait_for(lambda: half_files(tmp_path), run)
    run.send_signal(number)
    assert (*run.communicate(timeout=60), run.returncode) == ("", "", code)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {name: OLD}


@pytest.mark.parametrize(
    ("words", "number", "code"),
    [(["--testread", "big.png"] * 200, *ENDS[0]), (["big.png", "--fft", "--dup", "--pop"] * 50, *ENDS[1])],
    ids=["reading", "computing, SIGTERM"],
)
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


PROGRAMS = {"oiiotex": "oiiotex", "oiiotex-library": "oiiotex_studio.library.main"}


@pytest.mark.parametrize("delay", [0.0, slow(0.01), 0.03, slow(0.1), 0.3])
@pytest.mark.parametrize("module", PROGRAMS.values(), ids=PROGRAMS)
def test_a_signal_while_the_program_is_loaded_leaves_no_traceback(tmp_path, module, delay):
    words = ["ingest", ".", "x", "--recipe", "none"] if "library" in module else [*SLOW, "-o", "out.exr"]
    run = subprocess.Popen([sys.executable, "-m", module, *words], cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    wait_for(lambda: handles(run.pid, signal.SIGTERM), run)
    time.sleep(delay)
    run.send_signal(signal.SIGINT)
    said, code = run.communicate(timeout=60)[1], run.returncode
    assert (said, code) == ("", 130) or "ERROR: none: no such file" in said, (said, code)  # it has ended before
    assert os.listdir(tmp_path) == []


def test_a_signal_where_python_drops_exceptions_ends_the_run():
    code = """
import signal
from oiiotex.oiiotool.cli.running.stopping import stop_on_signals
class Dropped:
    def __del__(self):
        signal.raise_signal(signal.SIGTERM)
stop_on_signals()
Dropped()
print("went on")
"""
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (ended.stdout, ended.stderr, ended.returncode) == ("", "", 143)


REPLACED = """
import atexit, signal, sys
from oiiotex.engine.errors import Error
from oiiotex.oiiotool.cli import main

def replaced(error, *_):
    try:
        signal.raise_signal(signal.SIGTERM)
    except BaseException:
        if error is not None:
            raise error  # as the locks of Python's library do, which are released twice

def work(words):
    if words[0] == "at the end":
        atexit.register(replaced, RuntimeError("x"))
    else:
        replaced({"error": Error("x"), "internal": KeyError("x"), "pipe": BrokenPipeError(), "nothing": None}[words[0]])
    return 0

if sys.argv[1] == "before":
    main.watch_signals = lambda: replaced(RuntimeError("release unlocked lock"))
main.exit_with(sys.argv[1:], work)
"""


@pytest.mark.parametrize("when", ["before", "error", "internal", "pipe", "nothing", "at the end"])
def test_a_signal_whose_exception_is_replaced_or_lost_ends_the_run(when):
    ended = subprocess.run([sys.executable, "-c", REPLACED, when], capture_output=True, text=True)
    assert (ended.stdout, ended.stderr, ended.returncode) == ("", "", 143)


EVERY_LINE = """
import collections, os, signal, sys
from oiiotex.oiiotool.cli import main
from oiiotex.oiiotool.cli.running import stopping

process, places, codes = os.getpid(), set(), collections.Counter()

def stopped_here(frame, event, _):
    place = frame.f_code.co_filename, frame.f_lineno, event
    if os.getpid() != process:  # the guard
        return None
    handled = signal.getsignal(signal.SIGINT) is stopping._stop
    ours = "/oiiotex/oiiotool/cli/" in place[0] or place[0].endswith("threading.py")
    if handled and ours and event in ("call", "line", "return") and place not in places:
        places.add(place)
        if os.fork() == 0:
            sys.settrace(None)
            signal.set_wakeup_fd(-1)  # this process shares it
            signal.alarm(60)
            signal.raise_signal(signal.SIGINT)
            return None
        codes[os.waitstatus_to_exitcode(os.wait()[1])] += 1
    return stopped_here

def work(words):
    from oiiotex.oiiotool.cli.running.line_run import run
    status = run(words)
    sys.settrace(None)
    print(dict(codes))
    return status

sys.settrace(stopped_here)
main.exit_with(sys.argv[1:], work)
"""


@pytest.mark.slow
def test_a_signal_at_any_line_of_the_front_end_ends_the_run_with_its_code(tmp_path):
    words = ["--create", "8x8", "3", "--flip", "--echo", "x"]
    ended = subprocess.run([sys.executable, "-c", EVERY_LINE, *words], cwd=tmp_path, capture_output=True, text=True)
    assert (ended.stderr, ended.returncode) == ("", 0)
    codes = ast.literal_eval(ended.stdout.splitlines()[-1])
    assert set(codes) == {130} and codes[130] > 300, codes


STUCK = {"out.jxl": ["-o"], "out.webp": ["--compression", "lossless:100", "-o"], "out.tx": ["-otex"]}


LOCKED = """
import signal, sys
from collections import deque
from functools import partial
from itertools import chain, repeat
from pathlib import Path
from oiiotex.engine.io.atomic import temporary_beside
from oiiotex.oiiotool.cli.main import exit_with

def work(words):
    if words[0] == "server":
        signal.signal(signal.SIGTERM, lambda *_: print("handled", flush=True))
    with temporary_beside(Path("out.exr")) as temporary:
        temporary.write_bytes(b"half")
        temporary.with_suffix(".0123abcd.temp.exr").write_bytes(b"as maketx adds")
        begun = map(partial(print, flush=True), ["begun"])
        # C code that runs for good and holds Python's lock: no handler and no thread runs
        deque(chain(begun, repeat(0)) if words[0] == "library" else begun, 0)
        sys.stdin.readline()
    return 0

signal.alarm(100)  # ends the program even if nobody else does: its test may have been killed
exit_with(sys.argv[1:], work)
"""


def locked(folder: Path, kind: str) -> subprocess.Popen:
    """A program that writes a file: in a library's code that holds Python's lock, or with a handler of its own."""
    (folder / "out.exr").write_bytes(OLD)
    run = subprocess.Popen(
        [sys.executable, "-c", LOCKED, kind], cwd=folder, text=True, stdin=subprocess.PIPE,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True,
    )  # fmt: skip
    assert run.stdout.readline() == "begun\n", run.communicate()
    return run


@pytest.mark.parametrize(("number", "to_all"), [(ENDS[0][0], True), (ENDS[1][0], False), (ENDS[2][0], False)])
def test_a_signal_ends_a_run_in_a_library_that_holds_pythons_lock(tmp_path, number, to_all):
    run = locked(tmp_path, "library")
    os.killpg(run.pid, number) if to_all else run.send_signal(number)  # as Ctrl-C does, which the guard gets as well
    assert (*run.communicate(timeout=60), run.returncode) == ("", "", -signal.SIGKILL)
    assert nobody_left(run)
    if os.path.isdir("/proc"):
        assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {"out.exr": OLD}


def test_a_server_takes_its_time_to_end(tmp_path):
    run = locked(tmp_path, "server")
    run.send_signal(signal.SIGTERM)
    assert run.stdout.readline() == "handled\n"
    time.sleep(2)  # the guard would have ended it
    assert (*run.communicate("\n", timeout=60), run.returncode) == ("", "", 0)
    assert nobody_left(run)


@pytest.mark.parametrize(
    ("name", "number", "code"),
    [("out.jxl", *ENDS[1]), slow("out.webp", *ENDS[0]), slow("out.tx", *ENDS[2])],
)
def test_a_signal_is_heard_while_a_format_encodes_for_seconds(tmp_path, name, number, code):
    """OpenImageIO's own code keeps the main thread, so that Python's handlers do not run."""
    side = 6000 if name == "out.tx" else 2500
    save(np.random.default_rng(1).random((side, side, 3), np.float32), tmp_path / "a.tif")
    (tmp_path / name).write_bytes(OLD)
    run = start(tmp_path, "a.tif", "-v", *STUCK[name], name)
    while not run.stdout.readline().startswith("Writing"):
        assert run.poll() is None, run.communicate()
    time.sleep(1.5)
    if run.poll() is not None:
        pytest.skip("NOT RUN: this machine encodes in a second")
    run.send_signal(number)
    begun = time.monotonic()
    assert (run.communicate(timeout=60)[1], run.returncode) == ("", code)
    assert time.monotonic() - begun < 4  # a second of grace; to the end it takes ten
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.name != "a.tif"} == {name: OLD}


@pytest.mark.parametrize("number", [signal.SIGHUP, signal.SIGINT], ids=["by nohup", "by a shell's background"])
def test_a_run_that_is_started_to_ignore_a_signal_goes_on(tmp_path, number):
    name = number.name.removeprefix("SIG")
    script = f"trap '' {name}; exec {shlex.join(PROGRAM)} --create 8x8 3 --echo begun --testread a.png -o out.exr"
    save(np.zeros((8, 8, 3)), tmp_path / "a.png")
    run = subprocess.Popen(["sh", "-c", script], cwd=tmp_path, stderr=subprocess.PIPE, start_new_session=True)
    wait_for(lambda: handles(run.pid, signal.SIGTERM), run)
    run.send_signal(number)
    assert (run.communicate(timeout=60)[1], run.returncode) == (b"", 0)
    assert (tmp_path / "out.exr").exists()


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


@pytest.mark.parametrize(
    ("number", "code"),
    [(signal.SIGINT, 130), slow(signal.SIGTERM, 143), slow(signal.SIGHUP, 129), slow(signal.SIGKILL, -9)],
)
def test_a_signal_to_parallel_frames_ends_all_processes(tmp_path, number, code):
    (tmp_path / "out.0001.exr").write_bytes(OLD)
    words = ["--frames", "1-4", "--parallel-frames", "--threads", "2", *SLOW, "-o", "out.#.exr"]
    run = start(tmp_path, *words)
    wait_for(lambda: half_written(tmp_path), run)
    run.send_signal(number)
    _, errors = run.communicate(timeout=60)
    assert (errors, run.returncode) == ("", code)
    assert nobody_left(run)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {"out.0001.exr": OLD}


def test_a_ctrl_c_which_goes_to_all_processes_is_silent_too(tmp_path):
    words = ["--frames", "1-4", "--parallel-frames", "--threads", "2", *SLOW, "-o", "out.#.exr"]
    run = start(tmp_path, *words)
    wait_for(lambda: half_files(tmp_path), run)
    os.killpg(run.pid, signal.SIGINT)
    _, errors = run.communicate(timeout=60)
    assert (errors, run.returncode) == ("", 130)
    assert nobody_left(run)
    assert half_files(tmp_path) == []


def test_a_killed_worker_is_an_error_and_not_an_endless_wait(tmp_path):
    words = ["--frames", "1-4", "--parallel-frames", "--threads", "2", *SLOW, "-o", "out.#.exr"]
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
    assert "was killed or ran out of memory" in line_of(subprocess.CompletedProcess([], run.returncode, output, errors))
    assert nobody_left(run)
    assert [name for name in half_files(tmp_path) if f"-{pid}-" not in name] == []
    oiiotex("--create", "8x8", "3", "-o", "next.exr", cwd=tmp_path)
    whole = set(os.listdir(tmp_path)) - {"next.exr"}  # frames that others had done by then
    assert all(re.fullmatch(r"out\.000[1-4]\.exr", name) for name in whole)
    assert all(load(tmp_path / name).size for name in whole)


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
