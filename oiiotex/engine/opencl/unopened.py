# SPDX-License-Identifier: Apache-2.0
"""A device before it is opened: only its memory size is known."""

from __future__ import annotations

from typing import NoReturn

from ..errors import Unseen
from .device import Device, DeviceInfo


class UnopenedDevice(Device):
    """Knows a device's memory size; any other request raises `Unseen`, since it would start work."""

    def __init__(self, info: DeviceInfo):
        self.info = info
        self._measure(info)

    @property
    def lanes(self) -> int:
        """Not known before the device is probed."""
        raise Unseen

    def __getattr__(self, name: str) -> NoReturn:
        raise Unseen
