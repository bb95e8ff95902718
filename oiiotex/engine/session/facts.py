# SPDX-License-Identifier: Apache-2.0
"""Facts about a run that are known before its work: settings, memory and color config, but no pixels."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING

from ..core.piece_cache import PieceCache
from ..deferred import oiio
from ..errors import DeviceError, ImageError, MemoryBudgetError
from ..machine import usable_threads

if TYPE_CHECKING:
    from ..color.config import ColorConfig
    from ..core.image import Part
    from ..opencl.device import DeviceMemory
    from .settings import Settings

MOST_SIDE = 1 << 22  # px of a side of an image that is written or scanned


class Facts:
    """What ops plan with (`Op.plan`): neither pixels nor an open device.

    Parameters
    ----------
    settings : Settings
    """

    def __init__(self, settings: Settings):
        self.settings = settings

    @property
    def budget(self) -> int:
        """Memory budget of an op, in bytes."""
        return self.settings.budget

    @property
    def thread_count(self) -> int:
        """Number of CPU threads for computation."""
        return self.settings.threads or usable_threads()

    @functools.cached_property
    def color(self) -> ColorConfig:
        """The color config."""
        from ..color.config import ColorConfig

        return ColorConfig(self.settings.colorconfig, self.settings.interchange)

    @functools.cached_property
    def cache(self) -> PieceCache:
        """Cache of decoded pieces of files and of results."""
        return PieceCache(max(32 << 20, min(self.settings.budget // 8, 1 << 28)))

    @functools.cached_property
    def device_memory(self) -> DeviceMemory | None:
        """The memory of the device, which is not opened; None if there is no device, which only the work may need."""
        from ..opencl import device, device_choice

        try:
            return device.DeviceMemory(device_choice.choose(self.settings.device_name, self.settings.threads))
        except DeviceError:
            return None

    def require(self, need: int, task: str, advice: str = "reduce the size of the image") -> None:
        """Check a task, in bytes, against the memory budget.

        Raises
        ------
        MemoryBudgetError
            The task exceeds the budget.
        """
        if need > self.budget:
            raise MemoryBudgetError(task, need, self.budget, advice)

    def require_streamable(self, *parts: Part) -> None:
        """Check that images can be processed by rows, and written and read as files.

        Parameters
        ----------
        parts : Parts
            Parts whose pixels will all be read.

        Raises
        ------
        ImageError
            A side exceeds 2^22 pixels (files have an offset for each row), the image exceeds the limit of OpenImageIO,
            or 16 rows, which are held at once, exceed the budget.
        """
        most = oiio.get_int_attribute("limits:imagesize_MB")
        for part in parts:
            width, height = part.window.size
            image = f"an image of {width}x{height} pixels"
            if max(width, height) > MOST_SIDE:
                raise ImageError(f"{image}: expected at most {MOST_SIDE} along each side")
            size = width * height * part.pixel_bytes >> 20
            if most and size > most:
                raise ImageError(
                    f"{image} requires {size} MB: expected at most {most} MB, the limit of OpenImageIO; raise its"
                    " attribute limits:imagesize_MB"
                )
            self.require(16 * width * max(part.pixel_bytes, 4 * part.spec.nchannels), f"{image}")
