# SPDX-License-Identifier: Apache-2.0
"""A program that a device's compiler refuses: the next device does all, once, and never in place of a named one."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from oiiotex import filters
from oiiotex.engine.errors import BuildError, DeviceError, NoDeviceError, ParameterError
from oiiotex.engine.opencl import device_choice as devices
from oiiotex.engine.opencl.device import Device, DeviceInfo, Program
from oiiotex.engine.session import Session
from tests import pictures
from tests.any_filter import buffer


class Refusing(Device):
    """A device whose compiler refuses programs from the n-th on."""

    def __init__(self, info: DeviceInfo, left: int):
        super().__init__(info)
        self.left = left

    def program(self, stem: str, **macros: int) -> Program:
        self.left -= 1
        if self.left < 0:
            raise BuildError(f"{self.info.name} cannot build {stem}.cl: error: no")
        return super().program(stem, **macros)


def refusing(monkeypatch: pytest.MonkeyPatch, *left: int | None) -> list[str]:
    """Make the machine one of several devices, each of which builds so many programs; returns who is opened."""
    real = devices.choose()
    listed = [dataclasses.replace(real, number=n, name=f"device {n}") for n in range(len(left))]
    opened: list[str] = []

    def choose(wanted: str | None, threads: int = 0) -> DeviceInfo:
        number = int(wanted) if wanted else next((n for n in range(len(left)) if n not in refused), None)
        if number is None:
            raise NoDeviceError("none", "")
        return listed[number]

    def open_device(wanted: str | None, threads: int = 0) -> Device:
        info = choose(wanted)
        opened.append(info.name)
        return Device(info) if left[info.number] is None else Refusing(info, left[info.number])

    def refuse(info: DeviceInfo, threads: int = 0) -> DeviceInfo | None:
        refused.add(info.number)
        return next((d for d in listed if d.number not in refused), None)

    refused: set[int] = set()
    monkeypatch.setattr(devices, "open_device", open_device)
    monkeypatch.setattr(devices, "refuse", refuse)
    monkeypatch.delenv("OIIOTEX_DEVICE", raising=False)
    return opened


def tile(**settings: object) -> np.ndarray:
    made = filters.stationarize(
        buffer(pictures.pebbles(20, 22, seed=1)), sigma=6, iterations=1, session=Session(**settings)
    )
    return made.get_pixels(made.spec().format)


@pytest.mark.parametrize("left", [0, 1])
def test_where_a_program_does_not_build_the_next_device_does_it_all(monkeypatch, caplog, left):
    expected = tile()
    opened = refusing(monkeypatch, left, None)
    assert np.array_equal(tile(), expected)
    assert opened == ["device 0", "device 1"]
    assert [m for m in caplog.messages if "cannot build" in m and "repeating all work on device 1" in m]


def test_only_once_and_never_where_a_device_is_named(monkeypatch):
    opened = refusing(monkeypatch, 0, 0, None)
    with pytest.raises(BuildError, match="device 1 cannot build"):
        tile()
    assert opened == ["device 0", "device 1"]
    for settings in ({"device_name": "0"}, {}):
        opened = refusing(monkeypatch, 0, None)
        if not settings:
            monkeypatch.setenv("OIIOTEX_DEVICE", "device 0")
        with pytest.raises(BuildError, match="device 0 cannot build"):
            tile(**settings)
        assert opened == ["device 0"]
    with pytest.raises(ParameterError):
        filters.stationarize(buffer(pictures.pebbles(8, 8, seed=1)), sigma=-1)


def test_an_error_that_is_its_own_cause_ends_the_run():
    def work() -> None:
        error = DeviceError("no")
        raise error from error

    with pytest.raises(DeviceError, match="no"):
        Session().resources.on_a_device(work)
