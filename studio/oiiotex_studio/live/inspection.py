# SPDX-License-Identifier: Apache-2.0
"""Means to judge a tile: coarse tiles of all presets, values of pixels, maps of measures."""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
from collections.abc import AsyncIterator, Mapping
from typing import Any

from oiiotex.engine.deferred import np, oiio
from oiiotex.engine.errors import Error

from ..api.images import TAG, Image, Window, as_float, channels_of, from_array
from ..api.measures import region_uses
from ..api.painting import PRESETS, codes_of, color_of
from ..api.service import BRUSH, spec_of
from .hub import MOST_SHOWN, Hub, labels_of, reduced
from .pages import Page

BINS = 64  # of a histogram, for each channel
_COARSE = 128  # px; longer side of the photo for a coarse tile: patches are those of a full tile's coarse levels
_COARSE_CLEAN = 192  # px; the same for `clean`, whose mask leaves few whole patches in smaller photos
_MASK = {"photo": 1, "patch": 5}  # of `clean`; the whole photo's patches have up to 25 px
_WINDOW = 4  # half the width of a Gaussian window, in sigma
# by presets, or without a coarse tile
_DECIDED = {"preset", "sigma", "evenness", "patch", "histogram", "label", "size"}

Maps = dict[str, "np.ndarray"]  # (height, width) float32 of 'photo' and 'tile'


class Inspection:
    """Judging the photo and its tile."""

    def __init__(self, hub: Hub):
        self._hub = hub
        self._presets: Maps = {}  # coarse tiles by preset; '': none

    def show_presets(self, page: Page | None = None) -> None:
        """Show the coarse tiles again, as after a change of the view."""
        for preset in self._presets:
            self._show_preset(preset, page)

    def _show_preset(self, preset: str, page: Page | None = None) -> None:
        small = self._hub.picture(self._presets[preset], self._hub.shown())
        self._hub.show({"room": "tile", "kind": "preset", "preset": preset}, small, page)

    async def show_overlay(self, name: str) -> None:
        """Show the dominant texture or the labels as an overlay of the photo."""
        made, client = await self._hub.made(name), await self._hub.client()
        number = made["number"]
        part = name if name == "dominant" else labels_of(made)[-1]
        _, (pixels,) = await asyncio.wrap_future(client.read(number, part=part, priority=BRUSH))
        if name == "dominant":
            ids = (as_float(pixels[..., 0]) > 0.5).astype(np.uint8)
        else:
            ids = pixels[..., 0].clip(0, 255).astype(np.uint8)
        there = [int(n) for n in np.flatnonzero(np.bincount(ids.ravel())) if n]
        colors = [color_of(int(code)) for code in codes_of(np.array(there, int))]
        step = -(-max(ids.shape) // MOST_SHOWN)
        facts = {"room": "tile", "kind": "overlay", "name": name, "ids": there, "colors": colors}
        self._hub.show(facts, ids[::step, ::step, None])

    async def find_presets(self, values: Mapping[str, Any]) -> None:
        """Synthesize coarse tiles of all presets, with the other modifiers of the document."""
        others = {name: value for name, value in values.items() if name not in _DECIDED}
        async with self._fitted(_COARSE) as (number, _):
            for preset in ("", *(name for name in PRESETS if name != "clean")):
                with contextlib.suppress(Error):  # choosing the preset says why
                    pixels = await self._made("stationarize", number, others | ({"preset": preset} if preset else {}))
                    self._found(preset, pixels)
        with contextlib.suppress(Error):
            self._found("clean", await self._clean(others))

    def _found(self, preset: str, pixels: np.ndarray) -> None:
        self._presets[preset] = as_float(pixels)
        self._show_preset(preset)

    async def _clean(self, values: Mapping[str, Any]) -> np.ndarray:
        client = await self._hub.client()
        async with self._fitted(_COARSE_CLEAN) as (number, smaller):
            asked = client.make("dominant", [number], _MASK if smaller else {"photo": 1}, priority=BRUSH)
            facts, _ = await asyncio.wrap_future(asked)
            masked = int(facts["images"][0]["number"])
            try:
                return await self._made("stationarize", masked, {**values, "preset": "clean"}, {"mask": "dominant"})
            except Error:  # no dominant texture: the preset then uses the whole photo
                return await self._made("stationarize", number, {**values, "preset": "even", "histogram": 0})
            finally:
                client.drop(masked)

    @contextlib.asynccontextmanager
    async def _fitted(self, side: int) -> AsyncIterator[tuple[int, bool]]:
        """The number of the photo, reduced to a longer side if it is larger, and whether it is."""
        if max(self._photo_size) <= side:
            yield await self._hub.photo(), False
            return
        client, pixels = await self._hub.client(), reduced(await self._hub.small_photo(), side)
        number = await asyncio.to_thread(client.put, self._like_photo(pixels))
        try:
            yield number, True
        finally:
            client.drop(number)

    def _like_photo(self, pixels: np.ndarray) -> Image:
        """An image with the photo's channels and color space."""
        spec = self._photo_spec

        def change(new: oiio.ImageSpec) -> None:
            new.channelnames, new.alpha_channel = spec.channelnames, spec.alpha_channel
            new.attribute(TAG, spec.get_string_attribute(TAG))

        return Image((from_array(pixels).first.respecced(change),), "photo")

    async def _made(
        self, op: str, number: int, values: Mapping[str, Any], optional: Mapping[str, str] | None = None
    ) -> np.ndarray:
        """Pixels of an op's first result."""
        client = await self._hub.client()
        request = client.make(op, [number], values, optional=optional, priority=BRUSH, keep=False, read="")
        return (await asyncio.wrap_future(request))[1][0]

    @property
    def _photo_size(self) -> tuple[int, int]:
        spec = self._photo_spec
        return spec.width, spec.height

    @property
    def _photo_spec(self) -> oiio.ImageSpec:
        assert self._hub.source.image is not None
        return self._hub.source.image.first.spec

    # --- values and maps ---

    async def sample(self, page: Page, asked: Mapping[str, Any], tile: dict[str, Any] | None) -> None:
        """Tell a page the values of a pixel of the photo or the tile, in the file's space and as displayed.

        None are told of a tile that is not finished.
        """
        x, y, what = int(asked["x"]), int(asked["y"]), asked["what"]
        facts = {"do": "sample", "room": "tile", "what": what, "x": x, "y": y, "values": [], "shown": []}
        client, photo = await self._hub.client(), await self._hub.photo()
        number, spec = photo, self._photo_spec
        if what == "tile" and tile is not None:
            number, spec = tile["number"], spec_of(tile["parts"][0])
        if (what == "photo" or tile is not None) and 0 <= x < spec.width and 0 <= y < spec.height:
            window = Window(spec.x + x, spec.y + y, spec.x + x + 1, spec.y + y + 1)
            _, (pixels,) = await asyncio.wrap_future(client.read(number, window, priority=BRUSH))
            values = as_float(pixels)
            facts["values"] = list(zip(spec.channelnames, (f"{value:.5g}" for value in values[0, 0]), strict=True))
            facts["shown"] = self._hub.picture(values, self._hub.shown())[0, 0].tolist()
        page.tell(json.dumps(facts))

    async def show_measure(self, name: str, tile: dict[str, Any] | None, measure: str) -> None:
        """Show a map of the photo and, when it is finished, of the tile: 'drift' or 'repetition'."""
        maps = await (self._drift(tile, measure) if name == "drift" else self._repetition(tile))
        high = max((float(values.max()) for values in maps.values()), default=0.0) or 1.0
        for what, values in maps.items():
            step = -(-max(values.shape) // MOST_SHOWN)
            plane = np.rint(np.clip(values[::step, ::step, None] / high, 0, 1) * 255).astype(np.uint8)
            facts = {"room": "tile", "kind": "measure", "name": name, "what": what, "high": high}
            self._hub.show(facts, plane)

    async def _drift(self, tile: dict[str, Any] | None, measure: str) -> Maps:
        """Deviation of local statistics from those elsewhere, at one scale."""
        sigma = max(1.0, max(self._photo_size) / 32)
        values = {"sigma": sigma, "measure": measure}
        maps = {"photo": (await self._made("stationarity", await self._hub.photo(), values))[..., 0]}
        if tile is None:
            return maps
        client, spec = await self._hub.client(), spec_of(tile["parts"][0])
        if spec.get_string_attribute("wrapmodes") != "periodic,periodic":
            return maps | {"tile": (await self._made("stationarity", tile["number"], values))[..., 0]}
        # the op knows no torus
        _, (pixels,) = await asyncio.wrap_future(client.read(tile["number"], priority=BRUSH))
        margin = math.ceil(_WINDOW * sigma)
        around = np.pad(
            pixels[..., list(channels_of(spec).color)], ((margin, margin), (margin, margin), (0, 0)), "wrap"
        )
        part = from_array(around).first.respecced(lambda new: new.attribute(TAG, spec.get_string_attribute(TAG)))
        number = await asyncio.to_thread(client.put, Image((part,), "tile"))
        wide = await self._made("stationarity", number, values)
        client.drop(number)
        return maps | {"tile": wide[margin:-margin, margin:-margin, 0]}

    async def _repetition(self, tile: dict[str, Any] | None) -> Maps:
        if tile is None:
            return {}
        client = await self._hub.client()
        _, (st,) = await asyncio.wrap_future(client.read(tile["number"], part="st", priority=BRUSH))
        uses, shown = await asyncio.to_thread(region_uses, st, self._photo_spec)
        return {"photo": uses, "tile": shown}


def histogram(picture: np.ndarray) -> list[list[int]]:
    """Counts of the values of (height, width, 3) uint8, `BINS` for each channel, in thousandths of the largest."""
    counts = np.stack([np.bincount(one.ravel() // (256 // BINS), minlength=BINS) for one in np.moveaxis(picture, 2, 0)])
    return np.ceil(1000 * counts / max(1, counts.max())).astype(int).tolist()
