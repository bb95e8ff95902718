# SPDX-License-Identifier: Apache-2.0
"""Room Paint: a painting of coarse and fine labels becomes texture (LSA16 section 6.2, figures 13 to 15).

An edit resynthesizes its neighborhood. The fine layer refines the coarse one, inside the coarse label. Every change
adds a step to the history (`steps`), which never removes one.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import Coroutine
from pathlib import Path
from typing import Any

from oiiotex.engine.deferred import np
from oiiotex.engine.errors import Error, ImageError, ParameterError

from ...api.images import Window, as_float
from ...api.service import BRUSH, LinkError
from ..document import KEPT
from ..hub import Hub
from ..lines import line, word_of
from ..pages import Page
from .palette import COARSE, FINE, LAYERS, LabelPalette, Layers, extended, palette_of, step_facts
from .plans import changed_box
from .sewing import LiveSewing
from .steps import Steps, fine_of, paintings_in

_MOST_TIMES = 64
_OWN = {"width", "height", "seed"}  # document values that belong to the painting


class PaintRoom:
    """The Paint room of all pages."""

    def __init__(self, hub: Hub):
        self._hub = hub
        hub.keepers.append(self)
        self._steps = Steps(hub.document.beside("paint"), hub.spare)
        self._sewing = LiveSewing(hub, self._steps, hub.document.beside("palette.json"))
        self._palette: LabelPalette | None = None
        self._step, self._seed, self._change = -1, 0, ""
        self._going: tuple[Page, list[int]] | None = None  # page of an unfinished stroke, and its previews
        self._wanted: set[str] = set()  # values of _OWN that are set but not yet applied
        self._layers: Layers | None = None
        self._made: dict[str, Any] | None = None  # the texture: 'number' and 'parts'
        self._pixels: np.ndarray | None = None  # (height, width, channels) float32 of the texture
        self._turn = asyncio.Lock()

    async def greet(self, page: Page) -> None:
        """Nothing to send: a page asks when its user opens the room."""

    async def changed(self, room: str, names: set[str]) -> None:
        """A change of size or seed adds a step; a change of view updates the display."""
        if room == "view" and self._pixels is not None:
            self._show_texture()
            self._show_palette()
        if room == "output" and self._step >= 0:
            self._tell_line()
        if room == "painting" and self._layers is not None:
            async with self._turn:
                await self._follow()
        if room == "paint" and names & _OWN:
            self._wanted |= names & _OWN
            if self._layers is not None:
                async with self._turn:
                    await self._reshape()

    async def take(self, page: Page, asked: dict[str, Any], data: bytes) -> None:
        """Handle a request of a page; requests that change the painting run one at a time."""
        do = asked["do"]
        if self._hub.source.image is None:
            raise ValueError(do)
        if do == "line":
            self._tell_line(asked=True)
            return
        work, refused = None, ""
        async with self._turn:
            if do == "open":
                refused = await self._open(page)
            elif do == "stroke":
                self._end_stroke(but=page)
                await self._stroke(asked, data, page)
            elif do == "save":
                work = await self._saving(int(asked["times"]))
            elif do == "new":
                await self._new(int(asked["label"]))
            elif do == "paintings":
                page.tell(json.dumps({"do": "paintings", "room": "paint", "names": list(self._paintings())}))
            elif do == "bring":
                await self._bring(asked["name"])
            else:
                raise ValueError(do)
        if refused:
            raise ImageError(refused)
        if work is not None:  # outside the lock: painting continues meanwhile
            await work

    def leave(self, page: Page) -> None:
        """End the unfinished stroke of a page; its previews stay as steps."""
        if self._going is not None and self._going[0] is page:
            self._going = None
            self._record()

    async def save_work(self) -> None:
        """Move unsaved steps to the disk."""
        if self._steps.unsaved and self._going is None:
            async with self._turn:
                if self._going is None:
                    await asyncio.to_thread(self._steps.save)

    def close(self) -> None:
        """Save at the end; the error says where unsaved steps are."""
        try:
            self._steps.save()
        except ImageError as error:
            raise ImageError(f"{error}. {KEPT} {self._hub.spare}") from error

    def forget(self) -> None:
        """Drop references to images of a resident process that has ended."""
        self._made = None

    # --- the palette ---

    async def _opened_palette(self) -> LabelPalette:
        if self._palette is None:
            self._palette, self._sewing.table = await palette_of(self._hub, self._sewing.table)
        return self._palette

    def _show_palette(self, page: Page | None = None) -> None:
        assert self._palette is not None
        facts = {"room": "paint", "kind": "palette", "labels": self._palette.labels, "finer": self._palette.finer}
        self._hub.show(facts, self._hub.picture(self._palette.picture, self._hub.shown()), page)

    # --- the painting ---

    async def _open(self, page: Page) -> str:
        """Send everything to a page, after loading or creating the painting. Returns why a step was skipped, or ''."""
        await self._opened_palette()
        self._show_palette(page)
        if self._layers is not None:
            self._show_layers(page)
            self._show_texture(page=page)
            self._tell_step()
            return ""
        there, at = self._steps.numbers, self._hub.document.state["painting"]["step"]
        refusals = list[str]()
        for step in (n for n in reversed(there) if n <= at or at not in there):
            refusals.append(await self._try(step))
            if not refusals[-1]:
                await self._settle()
                break
        else:
            await self._new()
        await self._reshape()
        return next(filter(None, refusals), "")

    def _tell_step(self, going: bool = False) -> None:
        facts = {"step": self._step, "last": self._steps.last, "going": going, "change": self._change}
        self._hub.tell({"do": "step", "room": "paint"} | facts)
        self._tell_line()

    def _tell_line(self, asked: bool = False) -> None:
        """Show the line next to the button that saves; `asked`: in a dialog, to copy it."""
        self._hub.tell({"do": "line", "room": "paint", "text": self.line(), "asked": asked})

    def _tell_own(self) -> None:
        """Copy the painting's size and seed to the document and the pages, except values set meanwhile."""
        own = {"width": self._whole.width, "height": self._whole.height, "seed": self._seed}
        changed = self._hub.document.change("paint", {n: v for n, v in own.items() if n not in self._wanted})
        if changed:
            self._hub.tell({"do": "set", "room": "paint", "values": changed})

    async def _new(self, label: int = 0) -> None:
        """Start a painting filled with one label, by default with the labels of the photo."""
        palette = await self._opened_palette()
        allowed = [entry["id"] for entry in palette.labels]
        if label and label not in allowed:
            raise ParameterError(f"label={label}: expected one of {', '.join(map(str, allowed))}")
        paint = self._hub.document.state["paint"]
        width, height = paint["width"], paint["height"]
        coarse = np.full((height, width), label, np.uint8) if label else palette.photo(width, height)
        await self._add({COARSE: coarse, FINE: np.zeros_like(coarse)}, "New painting")
        self._show_layers()
        await self._settle()

    async def _reshape(self) -> None:
        """Apply the size and the seed that pages have set. The painting keeps its position."""
        wanted, self._wanted = self._wanted, set()
        if self._layers is None or not wanted:
            return
        paint = self._hub.document.state["paint"]
        size, seed = (paint["width"], paint["height"]), paint["seed"]
        differs = {f"canvas {size[0]}x{size[1]}": size != self._whole.size, f"seed {seed}": seed != self._seed}
        changes = [text for text, other in differs.items() if other]
        if not changes:
            return
        self._end_stroke()
        try:
            before = None
            if seed == self._seed:
                budget = self._hub.session.resources.budget
                before = await asyncio.to_thread(self._steps.resized, self._step, size, budget)
            await self._add(extended(self._layers, *size), ", ".join(changes).capitalize(), before, seed)
        except Error:
            self._tell_own()
            raise
        self._show_layers()
        await self._settle()

    def _paintings(self) -> dict[str, Path]:
        """Images in the folders of the photo and of the document, which can be opened."""
        source = self._hub.source.image
        assert source is not None
        return paintings_in((Path(source.source).parent, self._hub.document.path.parent))

    async def _bring(self, name: str) -> None:
        """Open a painting from a file as the next step, at its size."""
        paths = self._paintings()
        if name not in paths:
            raise ParameterError(f"{name[:200]}: expected an image in the folder of the photo or the document")
        palette, cache = await self._opened_palette(), self._hub.session.resources.cache
        layers = await asyncio.to_thread(palette.read_layers, {COARSE: paths[name], FINE: fine_of(paths[name])}, cache)
        self._wanted = set()
        same = self._layers is not None and layers[COARSE].shape == self._layers[COARSE].shape
        await self._add(layers, f"Opened {Path(name).name[:100]}", self._steps.plan(self._step) if same else None)
        self._show_layers()
        await self._settle()

    async def _stroke(self, asked: dict[str, Any], data: bytes, page: Page) -> None:
        """Paint a label where the page's mask is set. Previews of one stroke become one step."""
        if self._layers is None or self._pixels is None or self._palette is None:
            raise ImageError("there is no painting yet: open the Paint tab first")
        layer, label = asked["layer"], int(asked["value"])
        whole, box = self._whole, Window.sized(*(int(asked[name]) for name in ("left", "top", "width", "height")))
        if layer not in LAYERS or box.empty or len(data) != box.width * box.height or not 0 <= label < 256:
            raise ValueError("box")
        if not self._palette.allows(layer, np.array([label])):
            raise ValueError("label")
        seen = box & whole  # another page may have cropped the canvas meanwhile
        if not seen.empty:
            mask = np.frombuffer(data, np.uint8).reshape(box.height, box.width)[seen.inside(box)] > 0
            layers = {name: plane.copy() for name, plane in self._layers.items()}
            self._palette.paint(layers, layer, seen.inside(whole), mask, label)
            looks = self._going[1] if self._going is not None and self._going[0] is page else []
            try:
                looks.append(await self._add(layers, "Stroke", self._steps.plan(self._step)))
            except Error:
                self._show_layers()  # undo the stroke on the page
                raise
            self._going = page, looks
        going = asked.get("going") is True
        if not going:
            self._end_stroke()
        for other in set() if seen.empty else self._hub.pages - ({page} if going else set()):
            self._show_layers(other, seen)
        await self._settle(going)

    async def _add(self, layers: Layers, change: str, before: Path | None = None, seed: int | None = None) -> int:
        """Add a step."""
        assert self._palette is not None
        self._going = None
        if seed is None:
            seed = self._hub.document.state["paint"]["seed"] if self._layers is None else self._seed
        step = self._steps.start()
        try:
            self._palette.write_layers(self._steps.layers(step), layers, {"seed": seed, "change": change})
            await self._make(layers, step, seed, before, new=True)
        except Error:
            self._steps.forget(step)
            raise
        self._change = change
        return step

    async def _settle(self, going: bool = False) -> None:
        """Save, and tell pages which step is shown."""
        if not going:
            self._record()
        self._tell_own()
        if not going:
            with contextlib.suppress(Error):  # the next autosave retries and reports the error
                await asyncio.to_thread(self._steps.save)
        self._tell_step(going)

    def _end_stroke(self, but: Page | None = None) -> None:
        """Make one step of the previews of an unfinished stroke, unless it is `but`'s, so that it can be undone."""
        if self._going is not None and self._going[0] is not but:
            self._step, self._going = self._steps.join(self._going[1]), None
            self._record()

    def _record(self) -> None:
        """Add the step that is shown to the document's history."""
        self._hub.change("painting", {"step": self._step}, self._change)

    async def _follow(self) -> None:
        """Show the step that undo or redo has chosen."""
        step = self._hub.document.state["painting"]["step"]
        if step not in (self._step, -1):
            if refused := await self._try(step):
                raise ImageError(refused)
            self._tell_own()
            self._tell_step()

    async def _try(self, step: int) -> str:
        """Show a step. Returns why it cannot be shown, or ''."""
        try:
            await self._show(step)
        except LinkError:
            raise
        except Error as error:
            return f"cannot show step {step} (it is kept): {error}"
        return ""

    async def _show(self, step: int) -> None:
        """Show a step, with its painting, seed and patches."""
        assert self._palette is not None
        self._going, cache = None, self._hub.session.resources.cache
        layers = await asyncio.to_thread(self._palette.read_layers, self._steps.layers(step), cache)
        facts = await asyncio.to_thread(step_facts, self._steps.picture(step), cache)
        await self._make(layers, step, facts["seed"], self._steps.plan(step))
        self._change = facts["change"]
        self._show_layers()

    @property
    def _whole(self) -> Window:
        assert self._layers is not None
        return Window.sized(0, 0, *self._layers[COARSE].shape[::-1])

    async def _make(self, layers: Layers, step: int, seed: int, before: Path | None, new: bool = False) -> None:
        """Render the texture of a step, starting from a plan, and show what has changed."""
        made = await self._sewing.texture(step, seed, before, new)
        client = await self._hub.client()
        await self._look(client, made["number"], step, layers[FINE])
        if self._made is not None:
            self._hub.release(client, self._made["number"])
        self._made = made
        self._layers, self._step, self._seed = layers, step, seed

    async def _look(self, client: Any, image: int, step: int, fine: np.ndarray) -> None:
        """Read and show the changed window of the texture, or all of it the first time."""
        window = None
        if self._layers is not None and self._steps.plan(self._step).exists():
            layers = self._layers[FINE], fine
            budget = self._hub.session.resources.budget
            plans = self._steps.plan(self._step), self._steps.plan(step)
            window = await asyncio.to_thread(changed_box, *plans, layers, budget)
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

    # --- display ---

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

    async def _saving(self, times: int) -> Coroutine[Any, Any, object]:
        """A coroutine that saves the texture, `times` as large, around the patches that the page shows."""
        if self._layers is None or self._made is None:
            raise ImageError("there is no painting yet: open the Paint tab first")
        if not 1 <= times <= _MOST_TIMES:
            raise ParameterError(f"times={times}: expected an integer from 1 to {_MOST_TIMES}")
        if times == 1:
            return self._hub.save(self._made, *self._hub.output("painted"), "paint")
        width, height = self._whole.size
        size = times * width, times * height
        before = await asyncio.to_thread(self._steps.enlarged, self._step, times, self._hub.session.resources.budget)
        return await self._sewing.saving(self._step, self._seed, before, size, *self._hub.output("painted"))

    def line(self) -> str:
        """The command that renders this texture, from its plan, which fixes all patches."""
        source = self._hub.source
        if self._step < 0 or source.image is None:
            raise ParameterError("there is no painting yet: open the Paint tab first")
        values: dict[str, Any] = {"palette": self._sewing.table, "fromplan": self._steps.plan(self._step)}
        values |= {"seed": self._seed} if self._seed else {}
        if self._steps.fine(self._step).exists():
            values["fine"] = self._steps.fine(self._step)
        words = [*source.words, "--texlabel:photo=1", str(self._steps.picture(self._step))]
        return line([*words, word_of("--texpaint", values)], *self._hub.output("painted"))
