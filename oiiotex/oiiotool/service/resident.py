# SPDX-License-Identifier: Apache-2.0
"""The resident process, `python -m oiiotex.oiiotool.service`, which clients start on demand.

There is one process per user and settings, on a Unix socket in a private folder. It ends after a time without clients
and jobs, or on SIGTERM, SIGHUP or SIGINT. When a client disconnects, its images and jobs are dropped.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import logging
import os
import signal
import socket
import struct
import threading
import time
from typing import Any

from ... import __version__
from ...engine.deferred import oiio
from ...engine.errors import Error, reason_of
from ...engine.io.atomic import discard_all
from ...engine.machine import usable_threads
from ...engine.session import Session
from ...engine.session.facts import Facts
from ...engine.session.progress import Progress
from ...engine.session.resources import Resources
from ..cli.running.stopping import watch_signals
from .frames import HostFrames, frame, planned_places
from .jobs import DeviceJob, Jobs
from .messages import Link, LinkError
from .pictures import image_of
from .settings import ResidentSettings
from .work import Bench

MOST_JOBS = 256  # waiting or running, per client
MOST_CLIENTS = 128  # each has a thread, and a message of up to 16 MB
MEMORY_SHARE = 4  # 1 / share of the memory budget that caches analysis results, and again that caches frames of hosts
_CREDENTIALS = struct.Struct("3i")

log = logging.getLogger("oiiotex")


class Resident:
    """The state that all clients share."""

    def __init__(self, settings: ResidentSettings):
        self._settings = settings
        self._session = Session.of(Resources(settings), Progress())
        self._session.resources.memory = settings.budget // MEMORY_SHARE
        self.jobs, self.frames = Jobs(), HostFrames(settings.budget // MEMORY_SHARE)
        self._clients: set[_Connection] = set()
        self._busy = time.monotonic()
        self._end = False
        log.setLevel(logging.INFO)
        log.addHandler(_ToJob(self.jobs))

    def serve(self) -> None:
        """Serve clients until idle; return at once if another process serves these settings."""
        path = self._settings.socket()
        with open(path.with_suffix(".lock"), "w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                return
            path.unlink(missing_ok=True)  # left by a killed process
            with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as listening:
                listening.bind(str(path))
                os.chmod(path, 0o600)
                listening.listen(16)
                listening.settimeout(min(1.0, self._settings.idle / 4))
                try:
                    self._accept(listening)
                finally:
                    path.unlink(missing_ok=True)

    def _accept(self, listening: socket.socket) -> None:
        while not self._end:
            try:
                connection, _ = listening.accept()
            except TimeoutError:
                if self._clients or self.jobs.count:
                    self._busy = time.monotonic()
                elif time.monotonic() - self._busy > self._settings.idle:
                    return
                continue
            except OSError as error:  # no free file descriptor, or the client has disconnected
                log.error("the resident process cannot accept a client: %s", error.strerror)
                time.sleep(0.1)
                continue
            connection.setblocking(True)
            if len(self._clients) >= MOST_CLIENTS or _user_of(connection) != os.geteuid():
                connection.close()
                continue
            client = _Connection(self, connection, Bench(self._session))
            self._clients.add(client)
            threading.Thread(target=client.serve, name="oiiotex-client", daemon=True).start()

    @property
    def facts_of_ops(self) -> Facts:
        """What plans of ops may know."""
        return self._session.resources

    def frame(self, job: DeviceJob, asked: dict[str, Any], arrays: list[Any] | tuple[()]) -> Any:
        """A frame of a host, which is also kept."""
        return self.frames.put(asked["key"], frame(job, asked, arrays, self._session))

    def leave(self, client: _Connection) -> None:
        """Remove a client."""
        self._clients.discard(client)
        self._busy = time.monotonic()

    def end(self) -> None:
        """Stop accepting clients."""
        self._end = True

    def facts(self) -> dict[str, Any]:
        """Version, process id, device, and numbers of clients and jobs."""
        device = self._session.resources.device.info.name if self._session.resources.has_device else None
        return {
            "version": __version__, "pid": os.getpid(), "device": device,
            "clients": len(self._clients), "jobs": self.jobs.count,
        }  # fmt: skip


class _Connection:
    def __init__(self, resident: Resident, connection: socket.socket, bench: Bench):
        self._resident, self._bench = resident, bench
        self._link = Link(connection)
        self._jobs: dict[int, DeviceJob] = {}

    def serve(self) -> None:
        """Serve the client until it disconnects, dies or violates the protocol."""
        try:
            while True:
                asked, arrays = self._link.receive()
                number = asked.get("id")
                try:
                    self._take(number, asked, arrays)
                except Error as error:
                    self._answer(number, "failed", error.facts())
                except Exception as error:  # a malformed message can raise anything
                    malformed = Error(f"malformed request: {reason_of(error)[:300]}")
                    self._answer(number, "failed", malformed.facts())
        except LinkError:
            pass
        except MemoryError:
            log.error("a client was disconnected: out of memory for its message")
        finally:
            for job in list(self._jobs.values()):
                self._resident.jobs.cancel(job)
            self._link.close()
            self._resident.leave(self)

    def _take(self, number: Any, asked: dict[str, Any], arrays: list[Any]) -> None:
        do = asked["do"]
        if do in ("make", "read", "texture", "tile"):
            self._begin(number, asked)
        elif do == "frame":
            kept = self._resident.frames.get(asked["key"])  # answered here: it need not wait for a running job
            if kept is not None:
                self._answer(number, "done", *kept)
            elif "op" in asked:
                self._begin(number, asked, arrays)
            else:
                self._answer(number, "done", {"missing": True})
        elif do == "plan":
            self._answer(number, "done", planned_places(asked, self._resident.facts_of_ops))
        elif do == "spaces":
            self._answer(number, "done", {"spaces": self._resident.facts_of_ops.color.roles_and_spaces()})
        elif do == "put":
            self._answer(number, "done", {"number": self._bench.keep(image_of(asked["image"], arrays))})
        elif do == "drop":
            self._bench.drop(asked["image"])
            self._answer(number, "done", {})
        elif do == "cancel":
            job = self._jobs.get(asked["job"])
            if job is not None:
                self._resident.jobs.cancel(job)
            self._answer(number, "done", {})
        elif do == "hello":
            self._answer(number, "done", self._resident.facts())
        elif do == "end":
            self._resident.end()
            self._answer(number, "done", {})
        else:
            raise ValueError(f"unknown request '{do}'")

    def _begin(self, number: int, asked: dict[str, Any], arrays: list[Any] | tuple[()] = ()) -> None:
        if len(self._jobs) >= MOST_JOBS:
            raise Error(f"too many jobs of one client: expected at most {MOST_JOBS}; wait until some have finished")

        def look(pixels: Any, whole: bool) -> None:
            self._answer(number, "look", {"whole": whole}, [pixels])

        def work(job: DeviceJob) -> Any:
            if asked["do"] == "make":
                return self._bench.make(job, asked, look if asked.get("look") else None)
            if asked["do"] == "frame":
                return self._resident.frame(job, asked, arrays)
            return {"read": self._bench.read, "texture": self._bench.texture, "tile": self._bench.tile}[asked["do"]](
                job, asked
            )

        def report(state: str, value: Any) -> None:
            if state == "progress":
                self._answer(number, state, {"done": value[0], "total": value[1]})
                return
            self._jobs.pop(number, None)
            facts, arrays = value if state == "done" else ({}, [])
            if state == "failed":
                facts = value.facts() | {"log": job.log}
            self._answer(number, state, facts, arrays)

        job = self._jobs[number] = DeviceJob(int(asked.get("priority", 5)), work, report)
        self._resident.jobs.add(job)

    def _answer(self, number: Any, state: str, facts: dict[str, Any], arrays: list[Any] | tuple[()] = ()) -> None:
        try:
            self._link.send(facts | {"re": number, "state": state}, arrays)
        except LinkError:  # the receiving thread sees it and cleans up
            pass
        except Exception as error:  # the result is too large, or not JSON
            failed = Error(f"cannot send the answer: {reason_of(error)[:300]}")
            with contextlib.suppress(LinkError):
                self._link.send(failed.facts() | {"log": [], "re": number, "state": "failed"})


class _ToJob(logging.Handler):
    """Adds log records to the running job."""

    def __init__(self, jobs: Jobs):
        super().__init__()
        self._jobs = jobs

    def emit(self, record: logging.LogRecord) -> None:
        """Add a record."""
        job = self._jobs.running
        if job is not None:
            job.log.append((record.levelname.lower(), record.getMessage()))


def _user_of(connection: socket.socket) -> int:
    """The user id of the other side."""
    packed = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    return int(_CREDENTIALS.unpack(packed)[1])


def main(text: str) -> None:
    """Run the resident process with `ResidentSettings` as JSON."""
    settings = ResidentSettings(**json.loads(text))
    for name in ("threads", "exr_threads"):  # OpenImageIO ignores CPU affinity and cgroup limits
        oiio.attribute(name, settings.threads or usable_threads())
    os.environ["OIIOTEX_RESIDENT"] = "1"  # tells the plugin of hosts/openimageio not to call this process
    os.chdir("/")
    resident, numbers = Resident(settings), list[int]()

    def end(number: int, _: object) -> None:
        numbers.append(number)
        resident.end()

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, end)
    watch_signals()
    resident.serve()
    if numbers or resident.jobs.count:  # a job still runs: a normal exit of Python would abort
        discard_all()
        os._exit(128 + numbers[0] if numbers else 0)
