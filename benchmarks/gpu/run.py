# SPDX-License-Identifier: Apache-2.0
"""Test a machine with a GPU in one command: builds, correctness, speed.

python -m benchmarks.gpu.run [--device gpu] [--minutes 10] [--sizes 1024,4096,16384] [--out gpu.md]

It writes the table of benchmarks/results/gpu.md, and the same as JSON next to it, after every result, so an interrupted
run keeps its results. Work on a device runs in separate processes, so a failure, crash or hang is only a row. The most
valuable work is done first. Work beyond the time limit is skipped and listed. On a CPU, bits are compared with the same
device at single lanes, which is the code that GPUs run.
"""

from __future__ import annotations

import argparse
import datetime
import json
import os
import queue
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from importlib import util
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.gpu import table
from oiiotex.engine.machine import usable_threads

ROOT = Path(__file__).parents[2]
COMPARED_SIDE = 256  # px
TESTS_LEAST, TESTS_MOST = 0.15, 0.4  # of the time: kept for the tests, and all that they get
ONE_MOST = 0.15  # of the time, for one workload of which nothing is known yet
# Builds of this process use no cache: neither pyopencl's nor NVIDIA's, AMD's, Intel's or PoCL's.
NO_CACHES = {
    "PYOPENCL_NO_CACHE": "1",
    "CUDA_CACHE_DISABLE": "1",
    "AMD_OCL_CACHE_DISABLE": "1",
    "NEO_CACHE_PERSISTENT": "0",
    "POCL_KERNEL_CACHE": "0",
}
_DEVICE_FIXTURES = re.compile(r"def \w+\([^)]*\b(?:device|any_lanes|narrow_device)\b")


class Failed(Exception):
    """The one-line error of a row."""


class Worker:
    """A process of `gpu_worker`; started when it is asked, and again after it has failed."""

    def __init__(self, device: str, lanes: int = 0, environment: dict[str, str] | None = None):
        self._arguments, self._environment = (device, str(lanes)), environment or {}
        self._process: subprocess.Popen | None = None
        self._folder = tempfile.TemporaryDirectory(prefix="oiiotex-gpu-")
        self._last = Path(self._folder.name) / "last"
        self._errors = Path(self._folder.name) / "errors"

    def ask(self, seconds: float, **request: Any) -> dict[str, Any]:
        """The answer to a request; raises `Failed` with one line if there is none in time."""
        if self._process is None:
            self._start()
        try:
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()
            line = self._lines.get(timeout=max(seconds, 0.1))
        except queue.Empty:
            self.stop()
            raise Failed(f"no answer in {seconds:.0f} s{self._after()}") from None
        except OSError:
            line = ""
        if not line:  # it is gone
            status = self._process.wait()
            self._process = None
            raise Failed(f"the process died ({_status(status)}){self._after()}{self._last_words()}")
        answer = json.loads(line)
        if "error" in answer:
            self._process.wait()
            self._process = None
            raise Failed(answer["error"] + self._after())
        return answer

    def stop(self) -> None:
        """End the process, if there is one."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None

    def _start(self) -> None:
        command = [sys.executable, "-m", "benchmarks.gpu.worker", *self._arguments, str(self._last)]
        self._last.write_text("")
        with self._errors.open("w") as errors:
            self._process = process = subprocess.Popen(
                command, cwd=ROOT, env={**os.environ, **self._environment}, text=True,
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors,
            )  # fmt: skip
        self._lines = lines = queue.Queue()

        def pass_on() -> None:
            for line in process.stdout:
                lines.put(line)
            lines.put("")

        threading.Thread(target=pass_on, daemon=True).start()

    def _after(self) -> str:
        last = self._last.read_text().strip()
        return f", after {last}" if last else ""

    def _last_words(self) -> str:
        said = [line.strip() for line in self._errors.read_text(errors="replace").splitlines() if line.strip()]
        return f": {said[-1][:200]}" if said else ""


def _status(status: int) -> str:
    return signal.Signals(-status).name if status < 0 else f"exit {status}"


class Run:
    """One run within its minutes; `results` is what the table is made of."""

    def __init__(self, device: str | None, minutes: float, sizes: list[int], out: Path):
        self._begin, self._minutes, self._sizes, self._out = time.monotonic(), minutes, sizes, out
        self._reserved = 0.0  # seconds for later work
        self._worker = Worker(device or "")
        self.results: dict[str, Any] = {
            "date": str(datetime.date.today()), "minutes": minutes, "sizes": sizes,
            "facts": {}, "copies": {}, "other": None, "filters": [], "programs": [], "bits": [], "tests": None,
            "skipped": [],
        }  # fmt: skip
        self.save()

    @property
    def left(self) -> float:
        """Remaining seconds, without the reserved ones."""
        return 60 * self._minutes - (time.monotonic() - self._begin) - self._reserved

    def everything(self, timed: list[str], every_size: list[str], compared: list[str], tests: bool = True) -> None:
        """Everything, the most valuable first."""
        self._reserved = 60 * self._minutes * TESTS_LEAST if tests else 0.0
        try:
            self._step("facts", lambda seconds: self._worker.ask(min(seconds, 150), do="facts"))
            facts = self.results["facts"]
            if "error" in facts:
                return
            other = self._other(facts)
            self._step("copies", lambda seconds: self._worker.ask(min(seconds, 60), do="copies"))
            self.builds(timed)
            self._times(self._worker, "device", every_size, self._sizes[:2])
            self.compare(compared, other)
            self._times(self._worker, "device", [w for w in timed if w not in every_size], self._sizes[:1])
            if tests:
                self.tests(str(facts["number"]))
            if facts["kind"] != "cpu":
                self._times(other, "other", every_size, self._sizes[:1])
            self._times(self._worker, "device", every_size, self._sizes[2:])
            if facts["kind"] != "cpu":
                self._times(other, "other", every_size, self._sizes[1:])
            if other is not None:
                other.stop()
        finally:
            self._worker.stop()
            self.results["took"] = time.monotonic() - self._begin
            self.save()

    def _other(self, facts: dict[str, Any]) -> Worker | None:
        """The device to compare bits and times with: a CPU runtime, or, on one, the code of GPUs."""
        if facts["kind"] == "cpu":
            self.results["other"] = "the same device, single lanes"
            return Worker(str(facts["number"]), lanes=1)
        if facts["cpu"] is None:
            self.results["skipped"].append(
                "everything that requires a CPU runtime: none is installed (pip install 'oiiotex[cpu]')"
            )
            return None
        self.results["other"] = facts["devices"][facts["cpu"]]
        return Worker(str(facts["cpu"]))

    def _step(self, name: str, work: Any) -> None:
        try:
            self.results[name] = work(self.left)
        except Failed as failed:
            self.results[name] = {"error": str(failed)}
        self.save()

    def builds(self, workloads: list[str]) -> None:
        """Build every program that a small run of the workloads asks for, without caches and with its warnings."""
        builder = Worker(str(self.results["facts"]["number"]), environment=NO_CACHES)
        seen = []
        for workload in workloads:
            if self._is_late(f"{workload} at 64 px"):
                continue
            try:
                programs = self._worker.ask(min(self.left, 120), do="warm", workload=workload)["programs"]
            except Failed as failed:
                self.results["programs"].append({"stem": f"({workload})", "macros": {}, "error": str(failed)})
                self.save()
                continue
            for stem, macros in programs:
                if (stem, macros) in seen:
                    continue
                seen.append((stem, macros))
                row = {"stem": stem, "macros": macros}
                try:
                    row |= builder.ask(min(self.left, 120), do="build", stem=stem, macros=macros)
                except Failed as failed:
                    row["error"] = str(failed)
                self.results["programs"].append(row)
                self.save()
        builder.stop()

    def time(self, worker: Worker, where: str, workload: str, side: int) -> None:
        """Time a workload; skipped if a smaller size shows that it takes too long."""
        smaller = [
            r for r in self.results["filters"] if (r["where"], r["workload"]) == (where, workload) and "seconds" in r
        ]
        guess = max((r["seconds"] * (side / r["side"]) ** 2 for r in smaller[-1:]), default=0.0)
        label = f"{workload}, {side} px, on the {'CPU' if where == 'other' else 'device'}"
        if self._is_late(label, guess):
            return
        row = {"where": where, "workload": workload, "side": side}
        most = 60 * self._minutes * ONE_MOST
        try:
            row |= worker.ask(min(self.left, max(most, 3 * guess)), do="time", workload=workload, side=side)
        except Failed as failed:
            row["error"] = str(failed)
        self.results["filters"].append(row)
        self.save()

    def _times(self, worker: Worker | None, where: str, workloads: list[str], sizes: list[int]) -> None:
        for side in sizes:
            for workload in workloads:
                if worker is not None:
                    self.time(worker, where, workload, side)

    def compare(self, workloads: list[str], other: Worker | None) -> None:
        """One small run of each on both, pixel by pixel."""
        if other is None:
            return
        with tempfile.TemporaryDirectory(prefix="oiiotex-gpu-") as folder:
            paths = [f"{folder}/{n}.npz" for n in range(2)]
            for workload in workloads:
                if self._is_late(f"bits of {workload}"):
                    continue
                row: dict[str, Any] = {"workload": workload}
                try:
                    for worker, path in zip((self._worker, other), paths, strict=True):
                        seconds = min(self.left, 120)
                        worker.ask(seconds, do="compare", workload=workload, side=COMPARED_SIDE, path=path)
                    row["parts"] = differences(*paths)
                except Failed as failed:
                    row["error"] = str(failed)
                self.results["bits"].append(row)
                self.save()

    def tests(self, device: str) -> None:
        """Tests of kernels and the goldens on the device."""
        self._reserved = 0.0
        limit = min(self.left, 60 * self._minutes * TESTS_MOST)
        if self._is_late("the tests"):
            return
        self._worker.stop()  # its memory is the tests'
        self.results["tests"] = run_tests(kernel_tests(), device, limit)
        self.save()

    def _is_late(self, what: str, seconds: float = 0.0) -> bool:
        """Whether that does not fit the remaining time; then it is listed."""
        if self.left > max(seconds, 1.0):
            return False
        needed = f" (some {seconds:.0f} s)" if seconds >= 1 else ""
        self.results["skipped"].append(f"{what}{needed}")
        self.save()
        return True

    def save(self) -> None:
        """Write the table and the JSON, whole or not at all."""
        texts = {self._out: table.table(self.results), self._out.with_suffix(".json"): json.dumps(self.results)}
        for path, text in texts.items():
            part = path.with_name(f".{path.name}.part")
            part.write_text(text)
            part.replace(path)


def differences(first: str, second: str) -> dict[str, Any]:
    """By part: the share of pixels that differ in any channel, and the first place that does with both values.

    None: the shapes differ.
    """
    with np.load(first) as mine, np.load(second) as theirs:
        parts: dict[str, Any] = {}
        for name in sorted({*mine, *theirs}):
            if name not in mine or name not in theirs or mine[name].shape != theirs[name].shape:
                parts[name] = None
                continue
            values = mine[name], theirs[name]
            a, b = (one.view(f"u{one.itemsize}") for one in values)  # bits, so that NaN compares equal
            apart = a != b
            part: dict[str, Any] = {"share": float((apart.any(-1) if apart.ndim > 2 else apart).mean())}
            if apart.any():
                place = np.unravel_index(int(apart.argmax()), apart.shape)
                part |= {"place": [int(n) for n in place], "values": [one[place].item() for one in values]}
            parts[name] = part
    return parts


def kernel_tests() -> list[str]:
    """Test files that open a device through the fixtures, and the goldens; what takes long comes last."""
    files = [f for f in sorted(ROOT.glob("tests/*/test_*.py")) if _DEVICE_FIXTURES.search(f.read_text())]
    golden, promises = (ROOT / "tests" / "promises" / f"test_{name}.py" for name in ("golden", "promises"))
    quick = [f for f in files if f not in (golden, promises)]
    return [str(f.relative_to(ROOT)) for f in (*quick, golden, promises)]


def run_tests(files: list[str], device: str, seconds: float) -> dict[str, Any]:
    """Counts of outcomes, and one line for each failure, of the tests that ran within the time limit."""
    if util.find_spec("pytest") is None:
        return {"error": "pytest is not installed"}
    with tempfile.TemporaryDirectory(prefix="oiiotex-gpu-") as folder:
        report, said = Path(folder) / "report", Path(folder) / "said"
        report.touch()
        command = [sys.executable, "-m", "pytest", "-q", "-o", "addopts=", "-p", "no:cacheprovider"]
        command += ["-p", "benchmarks.gpu.outcomes", "-m", "not slow"]
        command += ["--continue-on-collection-errors", *files]  # modules that do not import are failures of their own
        processes = min(8, usable_threads() // 2)
        if util.find_spec("xdist") is not None and processes > 1:
            command += ["-n", str(processes)]
        environment = {**os.environ, "OIIOTEX_DEVICE": device, "OIIOTEX_TEST_REPORT": str(report)}
        begin = time.monotonic()
        with said.open("w") as out:
            process = subprocess.Popen(
                command, cwd=ROOT, env=environment, stdout=out, stderr=out, start_new_session=True
            )
            try:
                status: int | None = process.wait(timeout=seconds)
            except subprocess.TimeoutExpired:
                status = None
            finally:  # also where this process is to end
                if process.poll() is None:
                    os.killpg(process.pid, signal.SIGKILL)
                    process.wait()
        ended = "the time ended" if status is None else "" if status in (0, 1) else f"it died ({_status(status)})"
        entries = [json.loads(line) for line in report.read_text().splitlines() if line.endswith("}")]
        tests = [e for e in entries if "test" in e]
        made: dict[str, Any] = {
            "files": len(files), "seconds": time.monotonic() - begin, "ended": ended, "processes": processes,
            "collected": sum(e.get("collected", 0) for e in entries),
            **{o: len({e["test"] for e in tests if e["outcome"] == o}) for o in ("passed", "failed", "skipped")},
            "failures": [(e["test"], table.short(e["why"])) for e in tests if e["outcome"] == "failed"],
        }  # fmt: skip
        if not tests and status is not None:
            words = said.read_text(errors="replace").strip().splitlines()
            made["error"] = f"pytest ran nothing: {words[-1] if words else status}"
        return made


def _sizes(text: str) -> list[int]:
    sizes = sorted({int(size) for size in text.split(",")})
    if sizes[0] < 64:
        raise argparse.ArgumentTypeError("expected sizes >= 64 px")
    return sizes


def main() -> None:
    """Run all of it, and print the table."""
    from benchmarks.gpu import workloads

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", help="as for oiiotex; default: $OIIOTEX_DEVICE or the first GPU")
    parser.add_argument("--out", type=Path, default=Path("gpu.md"), help="the table; JSON is written next to it")
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--sizes", type=_sizes, default="1024,4096,16384", help="sides of the results, px")
    arguments = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # through what ends other processes
    run = Run(arguments.device, arguments.minutes, arguments.sizes, arguments.out.resolve())
    run.everything(list(workloads.TIMED), list(workloads.AT_EVERY_SIZE), list(workloads.COMPARED))
    print(arguments.out.read_text())


if __name__ == "__main__":
    main()
