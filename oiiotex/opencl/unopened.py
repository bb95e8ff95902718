# SPDX-License-Identifier: Apache-2.0
"""A device before it is opened: what memory it has is known, all else is work."""

from __future__ import annotations

from typing import NoReturn

from ..errors import Unseen
from .device import Device, DeviceInfo


class UnopenedDevice(Device):
    """Says what memory a device has; who asks for more is about to work (`Unseen`)."""

    def __init__(self, info: DeviceInfo):
        self.info = info
        self._measure(info)

    @property
    def lanes(self) -> int:
        """Not known before it is tried."""
        raise Unseen

    def __getattr__(self, name: str) -> NoReturn:
        raise Unseen
