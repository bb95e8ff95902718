# SPDX-License-Identifier: Apache-2.0
"""What the tests share: devices, pictures on disk, the installed program."""

from __future__ import annotations

import logging
import os
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex.engine.core.op import Op
from oiiotex.engine.io.cache_folders import cache_folder
from oiiotex.engine.opencl import device_choice as devices
from oiiotex.engine.opencl.device import Device, Program
from oiiotex.engine.session import Session
from tests import budget, forked, pictures, skips
from tests.kernel_options import require_known

# PoCL's own folder: in ours, each line that opens a device would check the kernels of all tests, some thousand files
KERNELS = Path(os.environ.setdefault("POCL_CACHE_DIR", str(cache_folder().parent / "pocl" / "kcache")))
KERNELS.mkdir(parents=True, exist_ok=True)


class NarrowDevice(Device):
    """The CPU seen as a GPU is: every work-item a single lane."""

    lanes = 1


@pytest.fixture(scope="session", autouse=True)
def known_kernel_options() -> Iterator[None]:
    """Whatever any test builds is in the table that is compiled for other devices."""
    build = Device.program

    def program(self: Device, stem: str, **macros: int) -> Program:
        built = build(self, stem, **macros)
        require_known(stem, macros)
        return built

    Device.program = program
    yield
    Device.program = build


@pytest.fixture(autouse=True)
def untouched_log() -> Iterator[None]:
    """A program that is run within a test says how much is logged, of that test alone."""
    log = logging.getLogger("oiiotex")
    log.setLevel(logging.NOTSET)  # fixtures of a module may have run one before
    yield
    log.setLevel(logging.NOTSET)
    assert not log.disabled


@pytest.fixture(scope="session")
def device() -> Device:
    return devices.open_device()


@pytest.fixture(scope="session")
def narrow_device(device: Device) -> Device:
    return device if device.lanes == 1 else NarrowDevice(devices.choose())


@pytest.fixture(scope="session")
def all_lanes(device: Device, narrow_device: Device) -> list[Device]:
    """The same two in one test, whose oracle costs more than the device."""
    return [device, narrow_device]


@pytest.fixture(params=["wide", "narrow"])
def any_lanes(request: pytest.FixtureRequest, device: Device) -> Device:
    """The device with its own lanes, and with one."""
    if request.param == "wide" and device.lanes == 1:
        pytest.skip("the device has no wide lanes")
    return request.getfixturevalue("device" if request.param == "wide" else "narrow_device")


@pytest.fixture(scope="module")
def few_places() -> Iterator[None]:
    """Results are judged at some hundred places, not thousands, and label maps grow in few iterations.

    For tests that do not ask how good they are.
    """
    with pytest.MonkeyPatch.context() as patch:
        for module, constant, few in forked.fewer():
            patch.setattr(module, constant, few)
        patch.setenv(forked.FEW_PLACES, "1")
        yield


@pytest.fixture
def photo(tmp_path: Path) -> Path:
    """A 96 x 80 sRGB PNG of stained bricks."""
    path = tmp_path / "photo.png"
    save(pictures.stained(pictures.bricks(80, 96, seed=1)), path)
    return path


@pytest.fixture
def picture(tmp_path: Path) -> Path:
    """An image of noise: no format makes it small."""
    return save(np.random.default_rng(0).random((200, 300, 3)), tmp_path / "a.png")


def made_by(op: Op, session: Session | None = None) -> Any:
    """The outputs of an op, planned and made."""
    session = session or Session()
    return op.make(op.plan(session.resources), session)


def save(pixels: np.ndarray, path: Path, kind: str = "uint8", space: str = "", **windows: int) -> Path:
    """Write (h, w, c) floats in 0 .. 1 (or beyond, for float types) as an image; `windows` are ImageSpec fields."""
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], oiio.FLOAT)
    for name, value in windows.items():
        setattr(spec, name, value)
    if space:
        spec.attribute("oiio:ColorSpace", space)
    buffer = oiio.ImageBuf(spec)
    buffer.set_pixels(buffer.roi, np.ascontiguousarray(pixels, np.float32))
    assert buffer.write(str(path), kind), buffer.geterror()
    return path


def load(path: Path, subimage: int = 0) -> np.ndarray:
    """All pixels of a file in their own type."""
    buffer = oiio.ImageBuf(str(path), subimage, 0)
    assert not buffer.has_error, buffer.geterror()
    return buffer.get_pixels(buffer.spec().format, buffer.roi)


def oiiotex(*words: object, cwd: Path | None = None, **options: object) -> subprocess.CompletedProcess:
    """Run the program; where the machine is slow it shall not tell of its progress.

    With `options` of `subprocess.run`, or without words, it is started as it is installed; else in a fork (`forked`).
    """
    line = [*(["--noprogress"] if words else []), *map(str, words)]
    if words and not options:
        return forked.run(line, cwd or Path.cwd(), 300)
    return installed(*line, cwd=cwd, **options)


def run_in(folder: Path, *words: object) -> subprocess.CompletedProcess:
    """Run the program in a folder, and expect exit 0."""
    done = oiiotex(*words, cwd=folder)
    assert done.returncode == 0, done.stderr
    return done


def installed(*words: object, **options: object) -> subprocess.CompletedProcess:
    """Run the installed program."""
    command = [sys.executable, "-m", "oiiotex", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, **options)


@pytest.fixture
def fails(tmp_path: Path) -> Callable[..., str]:
    """Run the program, expect exit 1, one line on stderr and an untouched old output; returns the line."""

    def run(*words: object) -> str:
        old = tmp_path / "old.png"
        old.write_bytes(b"the user's own")
        done = oiiotex(*words, "-o", old, cwd=tmp_path)
        lines = done.stderr.strip().splitlines()
        assert (done.returncode, len(lines)) == (1, 1), done
        assert lines[0].startswith("oiiotex ERROR: ")
        assert old.read_bytes() == b"the user's own"
        assert not list(tmp_path.glob(".*oiiotex*"))
        return lines[0]

    return run


def data_folder() -> Path:
    """The real photos; tests skip where they are absent."""
    folder = Path(os.environ.get("OIIOTEX_TEST_DATA", Path(__file__).parents[2] / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip("no test photos: set OIIOTEX_TEST_DATA")
    return folder


_begun = time.monotonic()
_cpu = pytest.StashKey[float]()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--budget", action="store_true", help="write tests/budget.toml from this run")


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]) -> Iterator[None]:
    """With the last report of a test go the CPU seconds since its beginning."""
    if call.when == "teardown":
        item.user_properties.append(("cpu", budget.seconds() - item.stash[_cpu]))
    return (yield)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """Name the files that take more than their share of the run."""
    ended = [report for reports in terminalreporter.stats.values() for report in reports]
    spent = budget.of_reports([report for report in ended if getattr(report, "when", "") == "teardown"])
    if config.getoption("--budget"):
        budget.write(spent)
    for kind, seconds in spent.items():
        for line in budget.above(seconds, budget.read()[kind]):
            terminalreporter.write_line(line)


@pytest.hookimpl(trylast=True)  # of the tests that -m leaves
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The files that take longest are run first: at the end no process is left alone with one of them.

    Where time is short the number of seconds draws an order, so that no slow test is left out in all runs.
    """
    known: Counter[str] = Counter()
    for kind in {"slow" if item.get_closest_marker("slow") else "fast" for item in items}:
        known.update(budget.read()[kind])
    if until := os.environ.get("OIIOTEX_SLOW_UNTIL"):
        draw = Random(until)
        known = Counter({file: draw.randrange(1 << 20) for file in sorted(known)})
    items.sort(key=lambda item: (-known[item.path.stem], item.path))  # each file's own order stays


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Where time is short ($OIIOTEX_SLOW_UNTIL, seconds from the start) slow tests are left out by then, and said."""
    item.stash[_cpu] = budget.seconds()
    until = os.environ.get("OIIOTEX_SLOW_UNTIL")
    if until and item.get_closest_marker("slow") and time.monotonic() - _begun > float(until):
        pytest.skip("LEFT OUT: the time for slow tests is over")


def pytest_sessionfinish(session: pytest.Session) -> None:
    """In CI a test that is skipped for a reason that skips.toml does not list is a failure."""
    terminal = session.config.pluginmanager.get_plugin("terminalreporter")
    if os.environ.get("CI") != "true" or terminal is None:
        return
    told = [report.longrepr for report in terminal.stats.get("skipped", ())]
    for reason in skips.unexpected(one[2] if isinstance(one, tuple) else str(one) for one in told):
        terminal.write_line(f"SKIPPED IN CI: {reason}: .ci/run installs what is missing, or tests/skips.toml says why")
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
