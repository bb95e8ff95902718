# SPDX-License-Identifier: Apache-2.0
"""Room Paint: a painting of labels, coarse and fine, becomes texture (LSA16 section 6.2, figures 13 to 15).

An edit makes its neighbourhood anew. Where the fine layer has nothing, the coarse one stays; what it has lies inside
the label that it is part of.
"""

from __future__ import annotations

import asyncio
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..color.config import as_float
from ..core.window import Window
from ..deferred import np
from ..errors import Error, ImageError, ParameterError
from ..io.reading import read
from ..service.client import BRUSH, EXPORT, Client, Request
from .history import Steps
from .hub import Hub, Page
from .lines import line, output_name, word_of
from .painting import fine_of, paintings_in
from .palette import COARSE, FINE, LAYERS, Layers, Palette, palette_of

_MOST_TIMES = 64
_PATCHES = 16, 64  # px, the least and the largest


class PaintRoom:
    """What pages see of a painting.

    Parameters
    ----------
    hub : Hub
    """

    def __init__(self, hub: Hub):
        self._hub = hub
        self._steps = Steps(hub.document.beside("paint"))
        self._table = hub.document.beside("palette.json")
        self._palette: Palette | None = None
        self._step = -1
        self._begun: int | None = None  # the step before a stroke that goes on
        self._layers: Layers | None = None
        self._made: dict[str, Any] | None = None  # the texture, as the resident process says it
        self._pixels: np.ndarray | None = None  # as they are sent: of the photo's channels, float32
        self._turn = asyncio.Lock()

    async def greet(self, page: Page) -> None:
        """A page opens the room when it is looked at."""

    async def changed(self, room: str, names: set[str]) -> None:
        """Another size or seed is another painting; another view looks otherwise."""
        if room == "view" and self._pixels is not None:
            self._show_texture()
            self._show_palette()
        if room == "paint" and names & {"width", "height", "seed"} and self._layers is not None:
            async with self._turn:
                await self._new()

    async def take(self, page: Page, asked: dict[str, Any], data: bytes) -> None:
        """What a page asks for: strokes, one after the other."""
        do = asked["do"]
        if self._hub.source.image is None:
            raise ValueError(do)
        if do == "line":
            self._hub.tell({"do": "line", "room": "paint", "text": self.line()})
            return
        work = None
        async with self._turn:
            if do == "open":
                await self._open(page)
            elif do == "stroke":
                await self._stroke(asked, data, page)
            elif do == "undo":
                await self._go(self._step - 1)
            elif do == "redo":
                await self._go(self._step + 1)
            elif do == "save":
                work = self._save(int(asked["times"]))
            elif do == "new":
                await self._new(int(asked["label"]))
            elif do == "paintings":
                page.tell(json.dumps({"do": "paintings", "room": "paint", "names": list(self._paintings())}))
            elif do == "bring":
                await self._bring(asked["name"])
            else:
                raise ValueError(do)
        if work is not None:  # others paint on meanwhile
            await work

    def leave(self, page: Page) -> None:
        """A stroke that it has begun ends here."""
        self._begun = None

    def forget(self) -> None:
        """The resident process is another one."""
        self._made = None

    # --- what can be painted with ---

    async def _opened_palette(self) -> Palette:
        if self._palette is None:
            self._palette = await palette_of(self._hub, self._table)
        return self._palette

    def _show_palette(self, page: Page | None = None) -> None:
        assert self._palette is not None
        facts = {"room": "paint", "kind": "palette", "labels": self._palette.labels, "finer": self._palette.finer}
        self._hub.show(facts, self._hub.picture(self._palette.picture, self._hub.shown()), page)

    # --- the painting ---

    async def _open(self, page: Page) -> None:
        """Show a page all there is; begin, or go on with, the painting."""
        await self._opened_palette()
        self._show_palette(page)
        if self._layers is None:
            if self._steps.last < 0:
                await self._new()
                return
            await self._go(self._steps.last)
        self._show_layers(page)
        self._show_texture(page=page)
        self._tell_step()

    def _tell_step(self, going: bool = False) -> None:
        self._hub.tell({"do": "step", "room": "paint", "step": self._step, "last": self._steps.last, "going": going})

    async def _new(self, label: int = 0) -> None:
        """A painting of one label, by default the largest."""
        allowed = [entry["id"] for entry in (await self._opened_palette()).labels]
        if label and label not in allowed:
            raise ParameterError(f"label={label}: there is {', '.join(map(str, allowed))}")
        paint = self._hub.document.state["paint"]
        coarse = np.full((paint["height"], paint["width"]), label or allowed[0], np.uint8)
        await self._begin({COARSE: coarse, FINE: np.zeros_like(coarse)})

    async def _begin(self, layers: Layers) -> None:
        """A painting without a history."""
        self._step, self._layers, self._pixels = -1, None, None
        self._steps.begin()
        await self._make(layers, 0, None)
        self._show_layers()
        self._show_texture()
        self._tell_step()  # what can be seen is there

    def _paintings(self) -> dict[str, Path]:
        """What can be brought from elsewhere: files beside the photo and beside the document."""
        source = self._hub.source.image
        assert source is not None
        return paintings_in((Path(source.source).parent, self._hub.document.path.parent))

    async def _bring(self, name: str) -> None:
        """Go on with a painting from elsewhere: a step of this one, where they are of one size."""
        paths = self._paintings()
        if name not in paths:
            raise ParameterError(f"{name[:200]}: no painting beside the photo or the document has this name")
        palette, cache = await self._opened_palette(), self._hub.session.cache
        layers = await asyncio.to_thread(palette.read_layers, {COARSE: paths[name], FINE: fine_of(paths[name])}, cache)
        if self._layers is not None and layers[COARSE].shape == self._layers[COARSE].shape:
            self._begun = None
            self._steps.drop_after(self._step)
            await self._make(layers, self._step + 1, self._step)
            self._show_layers()
            self._tell_step()
            return
        height, width = layers[COARSE].shape
        size = self._hub.document.change("paint", {"width": width, "height": height})
        self._hub.tell({"do": "set", "room": "paint", "values": size})
        await self._begin(layers)

    async def _stroke(self, asked: dict[str, Any], data: bytes, page: Page) -> None:
        """Take a layer's box, and make its neighbourhood anew; looks at a stroke that goes on become one step."""
        if self._layers is None or self._pixels is None or self._palette is None:
            raise ImageError("there is no painting yet: open the room first")
        layer, box = asked["layer"], Window.sized(*(int(asked[name]) for name in ("left", "top", "width", "height")))
        if layer not in LAYERS or len(data) != box.width * box.height or box & self._whole != box:
            raise ValueError("box")
        painted = np.frombuffer(data, np.uint8).reshape(box.height, box.width)
        if not self._palette.allows(layer, painted):
            raise ValueError("labels")
        place = box.inside(self._whole)
        layers = {name: plane.copy() for name, plane in self._layers.items()}
        layers[layer][place] = painted
        self._palette.keep_inside(layers, place)
        if self._begun is None:
            self._begun = self._step
            self._steps.drop_after(self._step)
        try:
            await self._make(layers, self._step + 1, self._step)
        except Error:
            self._begun = None
            self._show_layers()  # the page has painted what could not be made
            raise
        going = asked.get("going") is True
        if not going:
            self._steps.join(self._begun, self._step)
            self._step, self._begun = self._begun + 1, None
        for other in self._hub.pages - {page}:
            self._show_layers(other, box)
        self._tell_step(going)

    async def _go(self, step: int) -> None:
        """Undo or redo: that step's painting, made with that step's patches."""
        if not 0 <= step <= self._steps.last:
            self._tell_step()
            return
        self._begun = None
        assert self._palette is not None
        layers = self._palette.read_layers(self._files(step), self._hub.session.cache)
        same = self._layers is not None and layers[COARSE].shape == self._layers[COARSE].shape
        before = self._step
        await self._make(layers, step, step, keep=True)
        self._show_layers()
        if not same or before < 0:
            self._show_texture()
        self._tell_step()

    @property
    def _whole(self) -> Window:
        assert self._layers is not None
        return Window.sized(0, 0, *self._layers[COARSE].shape[::-1])

    def _files(self, step: int) -> dict[str, Path]:
        """A step's layers on disk, of which the fine one may not be there."""
        return {COARSE: self._steps.picture(step), FINE: self._steps.fine(step)}

    async def _make(self, layers: Layers, step: int, before: int | None, keep: bool = False) -> None:
        """The texture of a painting, beginning with the plan of a step; what has changed is shown."""
        hub, client = self._hub, await self._hub.client()
        labelled = (await hub.made("label"))["number"]
        if not keep:
            self._write(step, layers)
        values: dict[str, Any] = {"table": os.path.abspath(self._table)}
        if before is None:
            values["patch"] = self._patch()
        else:
            values["before"] = os.path.abspath(self._steps.plan(before))
        if not keep:
            values["plan"] = os.path.abspath(self._steps.plan(step))
        paintings = await self._put(client, step)
        hub.tell({"do": "busy", "room": "paint", "done": 0, "total": 1})
        try:
            advance = hub.advancing("Sewing the painting") if before is None else None
            request = self._asked(client, labelled, paintings, values, BRUSH, advance)
            facts, _ = await asyncio.wrap_future(request)
        except Error:
            if not keep:
                self._steps.forget(step)
            raise
        finally:
            for painting in paintings.values():
                client.drop(painting)
            hub.tell({"do": "busy", "room": "paint", "done": 1, "total": 1})
        image = facts["images"][0]["number"]
        await self._look(client, image, step, layers[FINE])
        if self._made is not None:
            hub.release(client, self._made["number"])
        self._made = facts["images"][0]
        self._layers, self._step = layers, step

    async def _put(self, client: Any, step: int) -> dict[str, int]:
        """The numbers of a step's layers in the resident process."""
        cache = self._hub.session.cache
        there = {layer: path for layer, path in self._files(step).items() if path.exists()}
        return {layer: await asyncio.to_thread(client.put, read(path, cache)) for layer, path in there.items()}

    async def _look(self, client: Any, image: int, step: int, fine: np.ndarray) -> None:
        """Read what has changed of the texture, and show it; all of it where nothing is shown yet."""
        window = None
        if self._layers is not None and self._steps.plan(self._step).exists():
            layers = self._layers[FINE], fine
            budget = self._hub.session.budget
            window = await asyncio.to_thread(self._steps.changed, self._step, step, layers, budget)
        if window is not None and window.empty:
            return
        _, (pixels,) = await asyncio.wrap_future(client.read(image, window, priority=BRUSH))
        values = as_float(pixels)
        if window is None:
            self._pixels = values.copy()
        else:
            assert self._pixels is not None
            self._pixels[window.top : window.bottom, window.left : window.right] = values
            self._show_texture(window)

    def _write(self, step: int, layers: Layers) -> None:
        """A step's layers, of the fine one only what is painted."""
        assert self._palette is not None
        for layer, path in self._files(step).items():
            if layer == COARSE or layers[layer].any():
                self._palette.write(layer, path, layers[layer])
            else:
                path.unlink(missing_ok=True)

    def _patch(self) -> int:
        """A side of which the photo holds some dozens."""
        image = self._hub.source.image
        assert image is not None
        shorter = min(image.first.spec.width, image.first.spec.height)
        return max(_PATCHES[0], min(_PATCHES[1], 1 << (shorter // 8).bit_length() - 1))

    def _values(self) -> dict[str, Any]:
        seed = self._hub.document.state["paint"]["seed"]
        return {"seed": seed} if seed else {}

    # --- what is shown ---

    def _show_layers(self, page: Page | None = None, box: Window | None = None) -> None:
        assert self._layers is not None
        box = box or self._whole
        facts = {"room": "paint", "kind": "ids", "left": box.left, "top": box.top, "whole": list(self._whole.size)}
        for layer, plane in self._layers.items():
            self._hub.show(facts | {"layer": layer}, plane[box.inside(self._whole)][..., None], page)

    def _show_texture(self, window: Window | None = None, page: Page | None = None) -> None:
        assert self._pixels is not None
        whole = Window(0, 0, self._pixels.shape[1], self._pixels.shape[0])
        place = window or whole
        picture = self._hub.picture(self._pixels[place.inside(whole)], self._hub.shown())
        facts = {"room": "paint", "kind": "texture", "left": place.left, "top": place.top, "whole": list(whole.size)}
        self._hub.show(facts, picture, page)

    async def _save(self, times: int) -> None:
        """Write the texture; so many times larger it is sewn around the patches that the page shows."""
        if self._layers is None or self._made is None:
            raise ImageError("there is no painting yet: open the room first")
        if times == 1:
            await self._hub.save(self._made, self._name())
            return
        if not 1 < times <= _MOST_TIMES:
            raise ParameterError(f"times={times}: allowed is a whole number from 1 to {_MOST_TIMES}")
        hub, client = self._hub, await self._hub.client()
        labelled, paintings = (await hub.made("label"))["number"], await self._put(client, self._step)
        width, height = self._whole.size
        before = await asyncio.to_thread(self._steps.enlarged, self._step, times, hub.session.budget)
        values = {
            "table": os.path.abspath(self._table),
            "size": f"{times * width}x{times * height}",
            "before": os.path.abspath(before),
        }
        request = self._asked(client, labelled, paintings, values, EXPORT, hub.advancing())
        try:
            facts, _ = await asyncio.wrap_future(request)
            try:
                await hub.save(facts["images"][0], self._name())
            finally:
                client.drop(facts["images"][0]["number"])
        finally:
            for painting in paintings.values():
                client.drop(painting)

    def _asked(
        self, client: Client, labelled: int, paintings: dict[str, int], values: dict[str, Any], priority: int,
        advance: Callable[[int, int], None] | None,
    ) -> Request:  # fmt: skip
        """A painting's texture, of layers that the resident process has."""
        fine = {FINE: paintings[FINE]} if FINE in paintings else None
        images = [labelled, paintings[COARSE]]
        values |= self._values()
        return client.make("paint", images, values, optional=fine, priority=priority, on_progress=advance)

    def _name(self) -> str:
        source = self._hub.source
        assert source.image is not None
        return output_name(source.stem, "painted", str(source.image.first.spec.format))

    def line(self) -> str:
        """The command that makes this texture: with its plan, so that nothing is decided anew."""
        source = self._hub.source
        if self._step < 0 or source.image is None:
            raise ParameterError("there is no painting yet")
        values = {"table": self._table, "before": self._steps.plan(self._step)} | self._values()
        if self._steps.fine(self._step).exists():
            values["fine"] = self._steps.fine(self._step)
        name, picture = self._name(), str(self._steps.picture(self._step))
        return line([*source.words, "--texlabel:keep=1", picture, word_of("--texpaint", values), "-o", name])
