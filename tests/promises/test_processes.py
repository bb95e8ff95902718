# SPDX-License-Identifier: Apache-2.0
"""Processes are started in one place, nothing listens for strangers, and signals end workers with their run."""

from __future__ import annotations

import ast
import os
import signal
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from subprocess import PIPE

import numpy as np
import pytest

from oiiotex.engine.core.image import from_array
from oiiotex.engine.io.atomic import temporary_beside
from oiiotex.engine.machine import start_python
from oiiotex.oiiotool.cli.running.parallel import WorkerDied, worker_processes
from oiiotex.oiiotool.service.client import connect
from oiiotex.oiiotool.service.settings import ResidentSettings
from tests.browser import Served, end_resident
from tests.conftest import save
from tests.faults import SLOW, half_files, half_written, nobody_left, start, wait_for

ROOT = Path(__file__).parents[2]
PLACES = {  # who may start processes, and by what
    "oiiotex/engine/guard.py": {"os.fork"},  # runs no other program
    "oiiotex/engine/machine.py": {"subprocess.Popen"},  # for all of the package; test_isolation.py runs each use
    "studio/oiiotex_studio/live/server.py": {
        "webbrowser"
    },  # the user's browser, of $PATH as `forget_current_folder` leaves it
    "hosts/blender/oiiotex_blender/__init__.py": {"context.preferences.system"},  # a setting of that name
    "hosts/blender/oiiotex_blender/process.py": {"subprocess.run", "subprocess.Popen"},  # has none of the package
    "hosts/dcc/oiiotex_line.py": {"subprocess.run"},  # the user's oiiotex, which has none of the package either
    "hosts/openimageio/build.py": {"subprocess.run"},  # whoever builds names the folder
}
WORDS = {"PIPE", "DEVNULL", "STDOUT", "TimeoutExpired", "CalledProcessError"}  # of subprocess, that start nothing
MODULES = {"multiprocessing", "pty", "webbrowser", "joblib", "pexpect", "_posixsubprocess", "forkserver"}
NAMES = {
    "ProcessPoolExecutor", "create_subprocess_exec", "create_subprocess_shell", "subprocess_exec", "subprocess_shell",
    "LocalCluster", "SSHCluster", "SpecCluster", "Nanny", "system", "popen", "fork", "forkpty", "posix_spawn",
    "posix_spawnp", "startfile", "execl", "execle", "execlp", "execlpe", "execv", "execve", "execvp", "execvpe",
    "spawnl", "spawnle", "spawnlp", "spawnlpe", "spawnv", "spawnve", "spawnvp", "spawnvpe", "fork_exec",
}  # fmt: skip


def starters(code: str) -> Iterator[str]:
    """By what a source starts processes: modules, functions and classes; uses for typing alone are none."""
    pending: list[ast.AST] = [ast.parse(code)]
    while pending:
        node = pending.pop()
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            pending += node.orelse
            continue
        for field, value in ast.iter_fields(node):
            if field not in ("annotation", "returns"):  # which are not run: `from __future__ import annotations`
                pending += [child for child in (value if isinstance(value, list) else [value]) if _is_node(child)]
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name.partition(".")[0] in MODULES)
            yield from (
                f"{alias.name} as" for alias in node.names if alias.asname and alias.name in ("subprocess", "os")
            )
        elif isinstance(node, ast.ImportFrom) and not node.level:
            module = (node.module or "").partition(".")[0]
            for alias in node.names:
                if module == "subprocess" and alias.name not in WORDS:
                    yield f"subprocess.{alias.name}"
                elif module in MODULES or alias.name in (MODULES | NAMES):
                    yield f"{module}.{alias.name}"
        elif isinstance(node, ast.Attribute):
            base = ast.unparse(node.value)
            if base == "subprocess" and node.attr not in WORDS:
                yield f"subprocess.{node.attr}"
            elif node.attr in NAMES and base != "platform":  # whose `system` is a name
                yield f"{base}.{node.attr}"
        elif isinstance(node, ast.Constant) and node.value in (MODULES | {"subprocess"}):
            yield f"the word {node.value}"  # by which importlib would find it


def _is_node(value: object) -> bool:
    return isinstance(value, ast.AST)


def test_processes_are_started_in_these_places_alone():
    found: dict[str, set[str]] = {}
    folders = ("oiiotex", "studio/oiiotex_studio", "hosts")
    for path in sorted(path for folder in folders for path in (ROOT / folder).rglob("*.py")):
        ways = set(starters(path.read_text()))
        if ways:
            found[path.relative_to(ROOT).as_posix()] = ways
    assert found == PLACES


@pytest.mark.parametrize(
    "code",
    [
        "import subprocess\nsubprocess.run(['a'])", "from subprocess import Popen", "import subprocess as s",
        "def f():\n    from subprocess import check_output", "import os\nos.system('a')", "os.execvp('a', ['a'])",
        "from os import fork", "import multiprocessing.pool", "from multiprocessing import Process", "import pty",
        "from concurrent.futures import ProcessPoolExecutor", "concurrent.futures.ProcessPoolExecutor(2)",
        "async def f():\n    await asyncio.create_subprocess_exec('a')", "from distributed import Client, LocalCluster",
        "distributed.Nanny('a')", "importlib.import_module('subprocess')", "os.posix_spawn('/a', ['a'], {})",
        "loop.subprocess_exec(f, 'a')", "from webbrowser import open",
    ],
)  # fmt: skip
def test_every_way_to_start_a_process_is_seen(code):
    assert list(starters(code))


def test_what_starts_none_is_not_taken_for_it():
    code = (
        "if TYPE_CHECKING:\n    from subprocess import Popen\ndef f(a: subprocess.Popen) -> subprocess.Popen:\n    pass"
    )
    assert not list(starters(code + "\nimport subprocess\nsubprocess.PIPE\nplatform.system()"))


# --- while it runs ---


def family(pid: int) -> list[int]:
    """The processes of a run's session."""
    pids = []
    for path in Path("/proc").glob("[0-9]*"):
        try:
            if os.getsid(int(path.name)) == pid:
                pids.append(int(path.name))
        except OSError:  # it has ended
            continue
    return pids


def listening(pids: list[int]) -> list[str]:
    """Sockets of these processes that wait for somebody: TCP, and those of a path or a name."""
    inodes = set()
    for pid in pids:
        for link in Path(f"/proc/{pid}/fd").glob("*"):
            try:
                inodes.add(os.readlink(link))
            except OSError:
                continue
    lines = []
    for name, state, number in (("tcp", (3, "0A"), 9), ("tcp6", (3, "0A"), 9), ("unix", (3, "00010000"), 6)):
        table = Path(f"/proc/net/{name}")
        for line in table.read_text().splitlines()[1:] if table.exists() else ():
            words = line.split()
            if words[state[0]] == state[1] and f"socket:[{words[number]}]" in inodes:
                lines.append(f"{name} {line}")
    return lines


FARM = ("--farm", "dask=local:2")


@pytest.mark.skipif(not Path("/proc/net/tcp").exists(), reason="no /proc/net")
def test_no_process_of_a_farm_on_this_machine_listens(tmp_path):
    run = start(tmp_path, "--pattern", "noise", "1500x1500", "3", "--blur", "9x9", "-o", "out.exr", *FARM)
    looks = 0
    while run.poll() is None:
        pids = family(run.pid)
        assert listening(pids) == []
        looks += len(pids) >= 3
        time.sleep(0.1)
    assert run.communicate() == ("", "") and run.returncode == 0
    assert looks > 2


def test_a_socket_that_listens_is_seen(tmp_path):
    import socket

    for family_, place in ((socket.AF_INET, ("127.0.0.1", 0)), (socket.AF_UNIX, str(tmp_path / "s"))):
        assert listening([os.getpid()]) == []
        with socket.socket(family_) as own:
            own.bind(place)
            own.listen()
            assert len(listening([os.getpid()])) == 1


@pytest.mark.parametrize(
    ("number", "to_all"), [(signal.SIGINT, True), (signal.SIGTERM, False)], ids=["Ctrl+C to all", "TERM to the run"]
)
def test_a_signal_to_a_farm_on_this_machine_ends_all_of_it(tmp_path, number, to_all):
    run = start(tmp_path, *SLOW[:-4], "-d", "half", "-o", "out.exr", *FARM)
    wait_for(lambda: len(family(run.pid)) >= 3 and (tmp_path / "out.exr.parts").exists(), run)
    os.killpg(run.pid, number) if to_all else run.send_signal(number)
    _, errors = run.communicate(timeout=60)
    assert (run.returncode, "Traceback" in errors, "Fatal" in errors) == (128 + number, False, False), errors
    assert nobody_left(run) and not half_files(tmp_path) and not (tmp_path / "out.exr").exists()


def holds(path: str) -> None:
    """What a worker does that writes for a minute."""
    with temporary_beside(Path(path)) as temporary:
        temporary.write_bytes(b"half")
        time.sleep(60)


@pytest.mark.parametrize("number", [signal.SIGHUP])
def test_a_signal_ends_a_worker_that_leaves_nothing_half(tmp_path, number):
    with worker_processes(1, debugging=False) as pool:
        done = pool.submit(holds, str(tmp_path / "out.exr"))
        while not half_written(tmp_path):
            assert not done.done(), done.exception()
        (worker,) = pool._processes
        worker.send_signal(signal.SIGINT)  # which is for the run
        time.sleep(0.05)
        assert worker.poll() is None
        worker.send_signal(number)
        with pytest.raises(WorkerDied):
            done.result()
        assert worker.wait() == 128 + number and not half_files(tmp_path)


def test_workers_are_ended_where_the_run_fails(tmp_path):
    with pytest.raises(KeyError), worker_processes(1, debugging=False) as pool:
        pool.submit(holds, str(tmp_path / "out.exr"))
        while not half_written(tmp_path):
            time.sleep(0.01)
        raise KeyError
    assert pool._processes[0].returncode == 128 + signal.SIGTERM and not half_files(tmp_path)


@pytest.mark.parametrize("number", [None, signal.SIGTERM])
def test_what_ends_the_resident_process_ends_its_job_without_an_abort(monkeypatch, number):
    with tempfile.TemporaryDirectory(prefix="oxp") as folder:  # a short name: sockets' are
        monkeypatch.setenv("XDG_RUNTIME_DIR", folder)
        settings = ResidentSettings(budget=1 << 28, idle=60)
        with start_python("oiiotex.oiiotool.service", settings.text(), stderr=PIPE, text=True) as process:
            while not settings.socket().exists():
                assert process.poll() is None
            client = connect(settings)
            assert client.hello()["pid"] == process.pid
            photo = client.put(from_array(np.random.default_rng(1).random((96, 96, 3), np.float32)))
            begun = threading.Event()
            long = {"size": "256x256", "sigma": 6, "iterations": 1000, "data": 1}
            client.make("stationarize", [photo], long, on_progress=lambda *_: begun.set())
            assert begun.wait(60)
            client.end() if number is None else process.send_signal(number)
            assert (process.wait(20), process.stderr.read()) == (128 + number if number else 0, "")
            assert not settings.socket().exists()


@pytest.mark.parametrize("number", [signal.SIGTERM])
def test_a_signal_ends_the_page_server(tmp_path, number):
    save(np.zeros((64, 64, 3)), tmp_path / "photo.png")
    (tmp_path / "run").mkdir(mode=0o700)
    with open(tmp_path / "errors", "w+b") as errors:
        served = Served(tmp_path, "photo.png", runtime=tmp_path / "run", errors=errors)
        try:
            assert served.end(number) == 128 + number
        finally:
            served.process.kill()
            end_resident(tmp_path / "run")
        errors.seek(0)
        assert errors.read() == b""
