# SPDX-License-Identifier: Apache-2.0
"""The maps of a photo's material: they are copied as the photo is, shown together, and saved together."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

from oiiotex.engine.deferred import np

from ...api.images import as_float
from ...api.service import BRUSH, Client, image_of
from ...materials.preview import srgb_of
from ..hub import Hub, MaterialMap, reduced
from ..lines import output_name
from ..pages import Page

MOST_MAP = 1024  # px; longest side of a map sent to a page

Outputs = list[tuple[str, str]]  # names and pixel types of the files of a tile and its maps


class MaterialMaps:
    """Maps of a material in the Tile room; none for a single photo."""

    def __init__(self, hub: Hub):
        self._hub = hub
        self._numbers: list[int] = []  # in the resident process
        self._shown: list[tuple[dict[str, Any], np.ndarray]] = []

    @property
    def values(self) -> dict[str, Any]:
        """Modifiers of --texstationarize for these maps."""
        maps = self._hub.source.maps
        return {"kinds": ",".join(["color", *(one.kind for one in maps)])} if maps else {}

    def outputs(self) -> Outputs:
        """Files of the tile and its maps. Maps keep their own pixel types, unless one is chosen."""
        chosen = self._hub.document.state["output"]["type"]
        outputs = [self._hub.output("tile")]
        for one in self._hub.source.maps:
            pixel_type = chosen or str(one.image.first.spec.format)
            outputs.append((output_name(Path(one.image.source).stem, "tile", pixel_type), pixel_type))
        return outputs

    def written(self) -> list[str]:
        """Words of the line that write the maps, and leave the tile on top."""
        words = list[str]()
        for name, pixel_type in reversed(self.outputs()[1:]):
            words += ["-d", pixel_type, "-o", name, "--pop"]
        return words

    async def save(self, images: list[dict[str, Any]], outputs: Outputs) -> None:
        """Write the images of a tile and its maps."""
        names = [await self._hub.save(image, *output, "tile") for image, output in zip(images, outputs, strict=True)]
        if len(names) > 1:
            self._hub.tell({"do": "note", "text": f"Saved {len(names)} maps: {', '.join(names)}"})

    async def numbers(self, client: Client) -> list[int]:
        """Numbers of the maps in the resident process."""
        if not self._numbers:
            self._numbers = [await asyncio.to_thread(client.put, one.image) for one in self._hub.source.maps]
        return self._numbers

    def forget(self) -> None:
        """Drop references to images of a resident process that has ended."""
        self._numbers = []

    async def find(self, client: Client, images: list[dict[str, Any]]) -> None:
        """Read the maps of a finished tile, and show them to all pages; first its color in sRGB, to be lit."""
        self._shown, maps = [], self._hub.source.maps
        for one, image in zip((None, *maps) if maps else (), images, strict=bool(maps)):
            _, (pixels,) = await asyncio.wrap_future(client.read(image["number"], priority=BRUSH))
            role, hand = (one.role, one.hand) if one else ("color", "")
            if one is None:
                picture = await asyncio.to_thread(self._srgb, image["parts"][0], pixels)
            else:
                picture = self._picture(one, reduced(as_float(pixels), MOST_MAP))
            self._shown.append(({"room": "tile", "kind": "map", "given": False, "role": role, "hand": hand}, picture))
        for shown in self._shown:
            self._hub.show(*shown)

    def _srgb(self, facts: dict[str, Any], pixels: np.ndarray) -> np.ndarray:
        """Pixels of a tile as sRGB in 8 bits, as they are lit in previews of a library, whatever the view."""
        part = image_of({"source": "tile", "parts": [facts]}, [pixels]).first
        size = _fitting(*pixels.shape[:2])
        return np.rint(255 * srgb_of(part, self._hub.session.resources, size)).astype(np.uint8)

    async def show(self, page: Page) -> None:
        """Show the maps of the finished tile to a page; before there is one, those of the photo."""
        given = [] if self._shown else await asyncio.to_thread(self._given)
        for one in self._shown or given:  # a tile may have been finished meanwhile
            self._hub.show(*one, page)

    def _given(self) -> list[tuple[dict[str, Any], np.ndarray]]:
        """The photo and its maps as they are; none without a color space."""
        source = self._hub.source
        if source.image is None or source.asks or not source.maps:
            return []
        part, facts = source.image.first, {"room": "tile", "kind": "map", "given": True}
        color = np.rint(255 * srgb_of(part, self._hub.session.resources, _fitting(part.spec.height, part.spec.width)))
        shown = [(facts | {"role": "color", "hand": ""}, color.astype(np.uint8))]
        for one in source.maps:
            pixels = reduced(as_float(one.image.first.pixels()), MOST_MAP)
            shown.append((facts | {"role": one.role, "hand": one.hand}, self._picture(one, pixels)))
        return shown

    def _picture(self, one: MaterialMap, pixels: np.ndarray) -> np.ndarray:
        """A map in 8 bits: colors as the display shows them, heights from lowest to highest."""
        if one.kind == "color":
            return self._hub.picture(pixels, self._hub.shown())
        low, high = (float(pixels.min()), float(pixels.max())) if one.kind == "height" else (0.0, 1.0)
        low = -1.0 if one.kind == "normal" and pixels.min() < 0 else low
        scaled = ((pixels - low) / max(high - low, 1e-9)).clip(0, 1)
        return np.round(scaled * 255).astype(np.uint8)[..., : 3 if pixels.shape[2] >= 3 else 1]


def _fitting(height: int, width: int) -> list[int]:
    """Height and width of a picture of a map on a page."""
    scale = min(1.0, MOST_MAP / max(height, width))
    return [max(1, round(n * scale)) for n in (height, width)]
