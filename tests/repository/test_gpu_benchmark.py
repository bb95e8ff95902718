# SPDX-License-Identifier: Apache-2.0
"""`python -m benchmarks.gpu.run` on the CPU: faults are rows, time is kept, every kernel declares its bound."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks.gpu import bounds, table
from benchmarks.gpu import run as gpu

ROOT = Path(__file__).parents[2]
SLIC, QUILT = "SLIC, ten iterations", "texquilt"
# on the path of a worker: a GPU that is the CPU seen as one, and what a driver does that does not like a kernel
FAULT = """
import dataclasses
from oiiotex.engine.opencl import device_choice
if {pretend}:
    found = device_choice.devices
    def devices(threads=0):
        cpu = next(d for d in found(threads) if d.kind == "cpu")
        return [dataclasses.replace(cpu, number=0, kind="gpu"), dataclasses.replace(cpu, number=1)]
    device_choice.devices = devices

import os
from oiiotex.engine.opencl.device import Program
launch = Program.__call__
def broken(self, name, *arguments, **options):
    if name == "best":
        {fault}
    launch(self, name, *arguments, **options)
Program.__call__ = broken
"""

# what packs, compares and times, each with one workload
BARE = f"""
import sys
from pathlib import Path
from benchmarks.gpu import compare, run, workloads
workloads.COMPARED = ["{SLIC}"]
compare.expect(Path(sys.argv[1]))
whole = run.Run("cpu", 1, [64], Path(sys.argv[1]) / "gpu.md")
whole.time(run.Worker("cpu"), "device", "{SLIC}", 64)
assert "seconds" in whole.results["filters"][0], whole.results
compare.check(Path(sys.argv[1]), "cpu", Path(sys.argv[1]) / "bits.md")
"""


@pytest.fixture
def planted(tmp_path, monkeypatch):
    """Break the kernel quilting_best in every process that is started from here on."""
    folder = tmp_path / "planted"
    folder.mkdir()

    def plant(fault: str, pretend: bool = False) -> None:
        (folder / "sitecustomize.py").write_text(FAULT.format(fault=fault, pretend=pretend))
        monkeypatch.setenv("PYTHONPATH", str(folder))

    return plant


def rows_of(text: str, begin: str) -> list[list[str]]:
    """Cells of the table's rows that begin with those words."""
    return [line.strip("| ").split(" | ") for line in text.splitlines() if line.startswith(f"| {begin} ")]


@pytest.mark.slow
def test_a_kernel_that_fails_is_a_row_and_all_else_goes_on(tmp_path, planted):
    planted('raise RuntimeError("clEnqueueNDRangeKernel failed: OUT_OF_RESOURCES")', pretend=True)
    run = gpu.Run("gpu", 3, [64], tmp_path / "gpu.md")
    run.everything([QUILT, SLIC], [QUILT, SLIC], [SLIC], tests=False)
    text = (tmp_path / "gpu.md").read_text()
    results = json.loads((tmp_path / "gpu.json").read_text())
    said = "RuntimeError: clEnqueueNDRangeKernel failed: OUT_OF_RESOURCES, after quilting_best"
    assert [r.get("error") for r in results["filters"]] == [said, None, said, None]
    assert [r["where"] for r in results["filters"]] == ["device", "device", "other", "other"]
    assert (results["facts"]["kind"], results["facts"]["lanes"]) == ("gpu", 1)
    assert [rows_of(text, f"{QUILT}{where} | 64")[0][2:4] for where in ("", ", CPU")] == 2 * [["failed", said]]
    assert "Traceback" not in text

    slic = results["filters"][1]
    seconds, in_kernels = slic["seconds"], sum(k["seconds"] for n, k in slic["kernels"].items() if "_" in n)
    assert 0 < in_kernels < seconds
    figures = [table.number(n) for n in (seconds, 64 * 64 / 1e6 / seconds, in_kernels)]
    assert rows_of(text, f"{SLIC} | 64")[0][2:5] == figures
    faster = results["filters"][3]["seconds"] / seconds
    assert rows_of(text, f"{SLIC} | 64")[0][7] == f"{faster:.1f}"
    assert [[part["share"] for part in row["parts"].values()] for row in results["bits"]] == [[0.0]]
    [built] = rows_of(text, "superpixels")
    assert float(built[2]) > 0 and "failed" not in built
    kernel = rows_of(text, "`superpixels_assign`")[0]
    assert kernel[1:3] == [SLIC, "64"] and int(kernel[3]) > 1
    assert kernel[6] != "not declared" and kernel[7].endswith("%") and "distances/s" in kernel[8]
    for fact in ("driver", "platform", "rounding", "lanes", "bandwidth, GB/s", "a launch"):
        assert len(rows_of(text, fact)) == 1
    for block in text.split("\n\n"):  # as many cells in each row
        assert len({line.replace("\\|", "").count("|") for line in block.splitlines() if line.startswith("|")}) <= 1
    assert not results["skipped"] and results["took"] < 180


def test_a_process_that_dies_or_hangs_is_one_line(planted):
    planted("os.abort()")
    worker = gpu.Worker("cpu")
    try:
        with pytest.raises(gpu.Failed, match=r"^the process died \(SIGABRT\), after quilting_best[^\n]*$"):
            worker.ask(100, do="warm", workload=QUILT)
        planted("import time; time.sleep(100)")
        assert worker.ask(100, do="facts")["lanes"] in (16, 32)  # it is started again
        with pytest.raises(gpu.Failed, match=r"^no answer in 5 s, after [^\n]*$"):
            worker.ask(5, do="warm", workload=QUILT)
    finally:
        worker.stop()


def test_no_device_is_said(tmp_path):
    run = gpu.Run("abacus", 1, [64], tmp_path / "gpu.md")
    run.everything([SLIC], [SLIC], [SLIC])
    assert "No device could be opened: DeviceError: no device 'abacus'" in (tmp_path / "gpu.md").read_text()


def test_what_does_not_fit_the_time_is_left_out_and_listed(tmp_path):
    run = gpu.Run("cpu", 1, [64], tmp_path / "gpu.md")
    run.results["filters"].append({"where": "device", "workload": SLIC, "side": 64, "seconds": 1.0, "kernels": {}})
    run.time(None, "device", SLIC, 640)  # some 100 s
    run = gpu.Run("cpu", 0, [64], tmp_path / "late.md")
    run.time(None, "device", SLIC, 64)
    run.tests("0")
    assert not run.results["filters"] and run.results["tests"] is None
    text = (tmp_path / "late.md").read_text()
    skipped = "SLIC, ten iterations, 64 px, on the device; the tests."
    assert f"Skipped, because of the time limit or a missing device: {skipped}" in text
    assert "640 px, on the device (some 100 s)." in (tmp_path / "gpu.md").read_text()


def test_outcomes_of_tests_are_counted_also_of_a_run_that_dies(tmp_path):
    (tmp_path / "test_some.py").write_text(
        "import os, pytest\n"
        "def test_device(): assert os.environ['OIIOTEX_DEVICE'] == '7'\n"
        "def test_left_out(): pytest.skip('no')\n"
        "def test_wrong(): assert 1 == 2, 'a | b'\n"
        "def test_unprepared(nothing_of_that_name): pass\n"
        "def test_deadly(): os.abort()\n"
    )
    (tmp_path / "test_unimported.py").write_text("import nothing_of_that_name\ndef test_a(): pass\n")
    made = gpu.run_tests([str(tmp_path / "test_some.py")], "7", 60)
    assert [made[n] for n in ("collected", "passed", "failed", "skipped")] == [5, 1, 2, 1]
    assert made["ended"] == "it died (SIGABRT)"
    [(name, why), (_, unprepared)] = made["failures"]
    assert "'nothing_of_that_name' not found" in unprepared
    assert name.endswith("test_some.py::test_wrong") and "a / b" in why and "\n" not in why
    assert gpu.run_tests([str(tmp_path / "test_some.py")], "7", 0.01)["ended"] == "the time ended"


def test_differences_are_counted_by_pixels_and_to_the_bit(tmp_path):
    first = {"a": np.zeros((4, 5, 3), np.float32), "b": np.full((4, 5), np.nan, np.float32), "c": np.zeros(3, np.uint8)}
    second = {name: array.copy() for name, array in first.items()}
    second["a"][1, 2] = 1e-30
    second["c"] = second["c"][:2]
    for name, arrays in (("first", first), ("second", second)):
        np.savez(tmp_path / f"{name}.npz", **arrays)
    found = gpu.differences(f"{tmp_path}/first.npz", f"{tmp_path}/second.npz")
    there = {"share": 0.05, "place": [1, 2, 0], "values": [0.0, float(np.float32(1e-30))]}
    assert found == {"a": there, "b": {"share": 0.0}, "c": None}
    assert table.difference(found["a"]) == "5.000% of pixels, first at [1, 2, 0]: 0.0 and 1.0000000031710769e-30"
    assert [table.difference(found[name]) for name in "bc"] == ["", "other shape"]


def test_a_bare_checkout_is_compared_and_timed(tmp_path):
    """A copy that nothing has installed, with dependencies on the path and without a network where that is allowed."""
    for name in ("oiiotex", "benchmarks", "tests", "tools", "ocio"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__", "results"))
    alone = ["unshare", "-rn"]
    allowed = subprocess.run([*alone, "true"], capture_output=True).returncode == 0
    python = [*(alone if allowed else []), str(Path(sys.base_prefix) / "bin" / "python3")]
    paths = ":".join(map(str, (tmp_path, *(p for p in sys.path if p.endswith("site-packages")))))
    said = subprocess.run(
        [*python, "-c", BARE, str(tmp_path / "bits")], cwd=tmp_path, env={**os.environ, "PYTHONPATH": paths},
        capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert said.returncode == 0, said.stderr
    assert said.stdout.splitlines()[-1] == f"| {SLIC} | 0: equal |"


def test_kernel_tests_are_found():
    files = gpu.kernel_tests()
    assert {
        "tests/synthesis/test_patchmatch.py",
        "tests/synthesis/test_quilting.py",
        "tests/promises/test_golden.py",
    } < set(files)
    assert "tests/oiiotool/test_parse.py" not in files


KERNELS = {name for stem in bounds.stems() for name in bounds.signatures(stem)}


def test_every_kernel_declares_what_it_moves_at_least():
    assert not KERNELS - set(bounds.BYTES), "no bound in benchmarks/gpu/bounds.py: it will be shown without"
    assert not (set(bounds.BYTES) | set(bounds.WORK)) - KERNELS, "these kernels are gone"


def test_bounds_name_arguments_that_their_kernels_have():
    for stem in bounds.stems():
        for kernel, names in bounds.signatures(stem).items():
            macros = dict.fromkeys(("PATCH", "CHANNELS", "BINS", "INVERSE"), 4)
            launch = bounds.launch_of(stem, kernel, macros, (8, 8), (4,) * len(names))
            cost = bounds.Cost()
            cost.add(kernel, launch)
            assert cost.bytes is not None and cost.bytes > 0, f"{kernel} has no such argument any more"
            assert (cost.work is not None) == (kernel in bounds.WORK)


def test_a_bound_is_what_must_be_moved():
    class Buffer:
        size = 600

    launch = bounds.launch_of("patchmatch", "patchmatch_pad", {"PATCH": 5}, (14, 11), (Buffer(), Buffer(), 10, 7, 11))
    assert launch.CHANNELS == 3  # the file's own
    cost = bounds.Cost()
    cost.add("patchmatch_pad", launch)
    cost.add("patchmatch_pad", launch)
    assert cost.bytes == 2 * 2 * 3 * (10 * 7 + 14 * 11)
    cost.add("patchmatch_pad", bounds.launch_of("patchmatch", "patchmatch_unknown", {}, (1,), (1, 2)))
    assert cost.bytes is None  # an argument has gone: no bound rather than a wrong one


def test_numbers_have_three_digits_and_no_exponent():
    assert [table.number(n) for n in (0.0, 1e-5, 0.01234, 5.678, 99.96, 12345.6)] == [
        "0", "< 0.001", "0.0123", "5.68", "100", "12346",
    ]  # fmt: skip


def test_what_nvidias_compiler_says_is_shortened():
    log = """ptxas info    : Compiling entry function 'patchmatch_pick' for 'sm_90'
ptxas info    : Function properties for patchmatch_pick
ptxas         .     968 bytes stack frame, 12 bytes spill stores, 12 bytes spill loads
ptxas info    : Used 40 registers, 400 bytes cmem[0]
ptxas info    : Compiling entry function 'patchmatch_pad' for 'sm_90'
    0 bytes stack frame, 0 bytes spill stores, 0 bytes spill loads
ptxas info    : Used 12 registers"""
    assert table.said(log) == "registers: pick 40 (968 bytes of stack, 12 spilled), pad 12"
    assert table.said("") == "nothing"
    assert table.said("a.cl:1: warning: x\nb\na.cl:2: warning: y") == "2 warnings, as a.cl:1: warning: x"
