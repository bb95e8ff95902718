# SPDX-License-Identifier: Apache-2.0
"""Texture of a painting's steps, rendered by the resident process, and larger versions that are saved as files."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

from ...api.images import read
from ...api.service import BRUSH, EXPORT, Client, Request
from ..hub import Hub
from .palette import COARSE, FINE
from .steps import Steps

_PATCHES = 16, 64  # px, smallest and largest


class LiveSewing:
    """Runs --texpaint on steps of a painting."""

    def __init__(self, hub: Hub, steps: Steps, table: Path):
        self._hub, self._steps, self.table = hub, steps, table

    async def texture(self, step: int, seed: int, before: Path | None, new: bool) -> dict[str, Any]:
        """The texture of a step: 'number' and 'parts', from the resident process.

        Parameters
        ----------
        step : int
        seed : int
        before : Path or None
            A plan to start from; None: all patches are chosen.
        new : bool
            Whether to write its plan.
        """
        hub, client = self._hub, await self._hub.client()
        values = self._values(seed) | ({"patch": self._patch()} if before is None else {"fromplan": before})
        values |= {"planfile": self._steps.plan(step)} if new else {}
        labeled, paintings = await self._images(client, step)
        hub.tell({"do": "busy", "room": "paint", "done": 0, "total": 1})
        try:
            advance = hub.advancing("Synthesizing the texture") if before is None else None
            facts, _ = await asyncio.wrap_future(_asked(client, labeled, paintings, values, BRUSH, advance))
        finally:
            for painting in paintings.values():
                client.drop(painting)
            hub.tell({"do": "busy", "room": "paint", "done": 1, "total": 1})
        made: dict[str, Any] = facts["images"][0]
        return made

    async def saving(
        self, step: int, seed: int, before: Path, size: tuple[int, int], name: str, pixel_type: str
    ) -> Coroutine[Any, Any, None]:
        """A coroutine that saves a step's texture at another size, in the background.

        Parameters
        ----------
        step : int
        seed : int
        before : Path
            A plan of that size to start from.
        size : (int, int)
            Width and height in pixels.
        name : str
            File name.
        pixel_type : str
            As -d names it.
        """
        client = await self._hub.client()
        labeled, paintings = await self._images(client, step)
        values = self._values(seed) | {"size": f"{size[0]}x{size[1]}", "fromplan": before}

        async def save() -> None:
            try:
                request = _asked(client, labeled, paintings, values, EXPORT, self._hub.advancing())
                facts, _ = await asyncio.wrap_future(request)
                try:
                    await self._hub.save(facts["images"][0], name, pixel_type, "paint")
                finally:
                    client.drop(facts["images"][0]["number"])
            finally:
                for painting in paintings.values():
                    client.drop(painting)

        return save()

    async def _images(self, client: Client, step: int) -> tuple[int, dict[str, int]]:
        """Numbers in the resident process of the labeled photo and of the step's layers."""
        labeled, cache = (await self._hub.made("label"))["number"], self._hub.session.resources.cache
        there = {layer: path for layer, path in self._steps.layers(step).items() if path.exists()}
        return labeled, {layer: await asyncio.to_thread(client.put, read(path, cache)) for layer, path in there.items()}

    def _values(self, seed: int) -> dict[str, Any]:
        return {"palette": self.table} | ({"seed": seed} if seed else {})

    def _patch(self) -> int:
        """A patch size of which the photo contains dozens."""
        image = self._hub.source.image
        assert image is not None
        shorter = min(image.first.spec.width, image.first.spec.height)
        return max(_PATCHES[0], min(_PATCHES[1], 1 << (shorter // 8).bit_length() - 1))


def _asked(
    client: Client, labeled: int, paintings: dict[str, int], values: dict[str, Any], priority: int,
    advance: Callable[[int, int], None] | None,
) -> Request:  # fmt: skip
    """Request the texture of layers in the resident process. Paths are absolute: it has another working folder."""
    fine = {FINE: paintings[FINE]} if FINE in paintings else None
    images = [labeled, paintings[COARSE]]
    absolute = {name: os.path.abspath(value) if isinstance(value, Path) else value for name, value in values.items()}
    return client.make("paint", images, absolute, optional=fine, priority=priority, on_progress=advance)
