# SPDX-License-Identifier: Apache-2.0
"""Choosing a device, memory that is declared before it is taken, time by kernel."""

from __future__ import annotations

import weakref
from importlib import resources

import numpy as np
import pytest

from oiiotex.engine.errors import DeviceError, MemoryBudgetError
from oiiotex.engine.machine import memory
from oiiotex.engine.opencl import device_choice as devices
from oiiotex.engine.opencl.buffers import Buffers
from oiiotex.engine.opencl.device import Device
from oiiotex.engine.opencl.source import kernel_source
from oiiotex.engine.session import Session
from oiiotex.engine.stats import Stats
from tests.refusals import refused


def test_a_device_is_chosen_by_number_kind_or_name(monkeypatch):
    first = devices.devices()[0]
    monkeypatch.delenv("OIIOTEX_DEVICE", raising=False)
    for wanted in (None, "0", first.kind, first.kind.upper(), first.platform[:8].lower(), first.name[-6:]):
        assert devices.choose(wanted) == first
    monkeypatch.setenv("OIIOTEX_DEVICE", first.kind)
    assert devices.choose() == first
    monkeypatch.setenv("OIIOTEX_DEVICE", "abacus")
    with pytest.raises(DeviceError, match="'abacus'; available: 0"):
        devices.choose()
    assert devices.choose("0") == first  # the option wins over the environment
    with pytest.raises(DeviceError, match="no device '99'"):
        devices.choose("99")


def test_a_checker_is_never_the_default():
    assert devices.devices()[0].platform != "Oclgrind"


def test_buffers_are_refused_before_they_are_taken(device):
    with refused(MemoryBudgetError, task="a test", budget=2 << 20):
        Buffers(device, {"a": 1 << 20, "b": 1 << 20}, 2 << 20, "a test", held=1 << 20)
    with pytest.raises(DeviceError, match=r"a test .*MB; .*MB"):
        Buffers(device, {"a": 1 << 50}, 1 << 60, "a test")


def test_buffers_hold_what_is_written_and_change_places(device):
    with Buffers(device, {"a": 16, "b": 16, "empty": 0}, 1 << 20, "a test") as buffers:
        device.write(buffers["a"], np.arange(4, dtype=np.int32))
        device.fill(buffers["b"], np.int32(7), 4)
        buffers.swap("a", "b")
        assert device.read(buffers["a"], (4,), np.int32).tolist() == [7] * 4
        assert device.read(buffers["b"], (2, 2), np.int32).tolist() == [[0, 1], [2, 3]]


def test_a_kernel_that_cannot_be_built_is_an_error_of_ours(device):
    with pytest.raises(DeviceError, match=r"cannot build patchmatch\.cl"):
        device.program("patchmatch", PATCH="(")


def test_programs_are_built_once(device):
    assert device.program("patchmatch", PATCH=7, CHANNELS=3, LATTICE=0, PIECES=0) is device.program(
        "patchmatch", PATCH=7, CHANNELS=3, LATTICE=0, PIECES=0
    )
    assert device.program("patchmatch", PATCH=7, CHANNELS=3, LATTICE=0, PIECES=0) is not device.program(
        "patchmatch", PATCH=9, CHANNELS=3, LATTICE=0, PIECES=0
    )


def test_kernels_are_timed_by_name():
    opened = Device(devices.choose())
    opened.record = True
    with Buffers(opened, {"image": 6 * 12, "padded": 6 * 100}, 1 << 20, "a test") as buffers:
        opened.write(buffers["image"], np.zeros((3, 4, 3), np.int16))
        opened.program("patchmatch", PATCH=5, CHANNELS=3, LATTICE=0, PIECES=0)(
            "pad", (8, 7), buffers["image"], buffers["padded"], 4, 3, 7
        )
        stats = Stats()
        opened.collect(stats)
    assert set(stats.seconds) == {"upload", "patchmatch_pad"}
    assert all(seconds >= 0 for seconds in stats.seconds.values())


def test_timing_holds_no_pixels():
    opened = Device(devices.choose())
    opened.record = True
    with Buffers(opened, {"image": 4000}, 1 << 20, "a test") as buffers:
        pixels = np.zeros(1000, np.float32)
        held = [weakref.ref(pixels)]
        opened.write(buffers["image"], pixels)
        read = opened.read(buffers["image"], (1000,), np.float32)
        held.append(weakref.ref(read))
        del pixels, read
        assert [array() for array in held] == [None, None]
        stats = Stats()
        opened.collect(stats)
    assert set(stats.seconds) == {"upload", "download"}


def test_the_default_budget_is_a_quarter_of_what_the_process_may_use():
    assert Session().resources.budget == memory() // 4
    assert memory() > 1 << 28


def test_no_folder_is_named_to_a_compiler(device):
    """Runtimes split build options at spaces, and people have folders with spaces."""
    source = kernel_source("quilting")
    assert "#include" not in source and source.count('#line 1 "offsets.h"') == 1
    own = (resources.files("oiiotex") / "cl" / "quilting.cl").read_text().splitlines()
    lines = source.splitlines()
    after = max(n for n, line in enumerate(lines) if line.endswith('"quilting.cl"'))
    number = int(lines[after].split()[1])
    assert lines[after + 1 :] == own[number - 1 :]  # messages of compilers say the true lines
    assert not any("-I" in option for option in getattr(device._cl, "_DEFAULT_INCLUDE_OPTIONS", []))
