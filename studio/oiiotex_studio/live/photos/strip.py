# SPDX-License-Identifier: Apache-2.0
"""The strip of open photos: opening and closing, color spaces, and a batch with the parameters of one photo."""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from starlette.websockets import WebSocket

from oiiotex.engine.deferred import np
from oiiotex.engine.errors import Error, ParameterError, failure_of

from ...api.images import Image, Session, as_float, read, resized
from ..hub import Hub
from ..pages import Page, Pages
from .opening import OpenPhoto, hub_of, materials_of, require_memory, tag_photo
from .upload import MOST, Upload, photos_in

MOST_PHOTOS = 64
_THUMBNAIL = 96  # px
_OWN = {"mask", "fill"}  # parameters of the Tile room that mean something in one photo only
_USUAL = "sRGB", "lin_rec709", "ACEScg", "data"  # offered first, in the config's own names


class PhotoStrip(Pages):
    """The open photos of a server. Its own pages are those without a photo."""

    def __init__(self, session: Session, folder: Path, words: tuple[str, ...] = (), pixel_type: str = ""):
        super().__init__()
        self.session, self.folder, self._words, self._pixel_type = session, folder, words, pixel_type
        self.hubs: dict[str, Hub] = {}
        self._keys: dict[Path, str] = {}  # of photos, by file
        self._thumbnails: dict[str, np.ndarray] = {}
        self._states: dict[str, dict[str, Any]] = {}  # of the batch, by key
        self._uploads: dict[Page, Upload] = {}
        self._stored: set[Path] = set()  # uploads that are not opened yet
        self._saving: dict[str, asyncio.Task[None]] = {}  # regularly, by key
        self._closing: set[Path] = set()  # photos whose files are still being written
        self._added = 0
        self._batch: asyncio.Task[None] | None = None
        self._making: Hub | None = None  # the one that the batch works on
        self._canceled = False

    # --- the server ---

    async def attend_photo(self, wire: WebSocket) -> None:
        """Serve a page of the photo in its address; of the first photo, or none, if there is no such photo."""
        hub = self.hubs.get(wire.query_params.get("photo", "")) or next(iter(self.hubs.values()), None)
        await (self if hub is None else hub).attend(wire)

    def start(self) -> None:
        """Save changes regularly, and prepare the first photo."""
        for key, hub in self.hubs.items():
            self._saving[key] = asyncio.create_task(hub.autosave())
        for hub in list(self.hubs.values())[:1]:
            hub.begin(hub.warm_up())

    async def end(self) -> None:
        """Save all documents, and disconnect from the resident process."""
        for task in self._saving.values():
            task.cancel()
        for hub in self.hubs.values():
            await asyncio.to_thread(hub.close)

    def saved(self, name: str) -> Path | None:
        """A file that a page has saved."""
        return next((hub.saved[name] for hub in self.hubs.values() if name in hub.saved), None)

    # --- photos ---

    def add(self, hub: Hub, path: Path | None = None) -> str:
        """Add a hub, of a photo in `path`. Returns its key, which addresses have."""
        self._added += 1
        key = str(self._added)
        self.hubs[key] = hub
        self._states[key] = {"text": ""}
        if path is not None:
            self._keys[path] = key
        hub.further = lambda: self._facts(key)
        hub.strip = self
        hub.watch = lambda message: self._watched(key, message)
        return key

    def open(self, photos: Sequence[OpenPhoto], document: Path | None = None) -> list[str]:
        """Open photos, those that are open already once. Returns their keys.

        Raises
        ------
        Error
            As by `hub_of`; too many photos.
        """
        keys = list[str]()
        for photo in materials_of(photos):
            if photo.path not in self._keys:
                if len(self.hubs) >= MOST_PHOTOS:
                    raise ParameterError(f"{photo.path.name}: expected at most {MOST_PHOTOS} open photos")
                taken = {hub.document.path for hub in self.hubs.values()}
                hub = hub_of(
                    photo, self.session, self.folder, taken=taken, document=document, pixel_type=self._pixel_type
                )
                self.add(hub, photo.path)
            keys.append(self._keys[photo.path])
            for one in photo.maps:
                self._keys.setdefault(Path(one.image.source).resolve(), keys[-1])
        return keys

    async def _open(self, names: Sequence[str], page: Page) -> None:
        """Open files of the folder, without those that are not images, and show the first."""
        offered, photos, refused = photos_in(self.folder), list[OpenPhoto](), list[str]()
        for name in names:
            try:
                if name not in offered:
                    raise ParameterError(f"{str(name)[:120]}: expected an image in {self.folder.absolute()}")
                image = read(self.folder / name, self.session.resources.cache)
                photos.append(OpenPhoto(image, (*self._words, str(self.folder / name))))
            except Error as error:
                refused.append(str(error))
        keys = list[str]()
        for photo in materials_of(photos):
            try:
                if photo.path in self._closing:
                    raise Error(f"{photo.path.name}: its files are still being written: open it again afterwards")
                if photo.path not in self._keys:
                    require_memory(photo, self.session)
                    small = await asyncio.to_thread(_small, photo.image)  # also finds damaged pixels
                    (key,) = self.open([photo])
                    self._thumbnails[key] = small
                    self._saving[key] = asyncio.create_task(self.hubs[key].autosave())
                keys.append(self._keys[photo.path])
            except Error as error:
                refused.append(str(error))
        opened = set(self._keys)
        for path in {path for path in self._stored if path.name in names}:
            self._stored.discard(path)
            if path.resolve() not in opened:
                path.unlink(missing_ok=True)
        self._tell_list()
        page.tell(json.dumps({"do": "opened", "photo": keys[0] if keys else None, "refused": refused}))

    async def _close(self, key: str, page: Page) -> None:
        """Close a photo. Its document and its files are kept, and its pages are told the photo to go to."""
        if (hub := self.hubs.get(key)) is None:  # another page was faster
            return
        if self._batch is not None:
            raise Error("parameters are being applied to the open photos: wait, or cancel")
        for shown in hub.pages:
            hub.left(shown)  # ends its stroke
        await hub.save_all()
        if hub.unsaved:
            raise Error(f"{hub.source.stem} stays open. {hub.unsaved}")
        if self.hubs.get(key) is not hub:
            return
        keys = list(self.hubs)
        n = keys.index(key)
        paths = {path for path, other in self._keys.items() if other == key}
        for by_key in (self.hubs, self._states, self._thumbnails):
            by_key.pop(key, None)
        self._keys = {path: other for path, other in self._keys.items() if other != key}
        self._closing |= paths
        self._saving.pop(key).cancel()
        hub.watch = lambda message: None
        text = f"Closed {hub.source.stem}. {hub.document.path.name} keeps its parameters"
        hub.tell({"do": "closed", "photo": next(iter(keys[n + 1 :] + keys[:n][::-1]), None), "text": text})
        if page not in hub.pages:
            page.tell(json.dumps({"do": "note", "text": text}))
        self._tell_list()
        try:
            await hub.end()
        finally:
            self._closing -= paths

    def _facts(self, key: str = "") -> dict[str, Any]:
        """What pages know of the open photos; `key`: the photo of the page."""
        listed = [
            {
                "key": other, "name": hub.source.stem, "document": hub.document.path.name, "asks": hub.source.asks,
                "roles": [one.role for one in hub.source.maps],
            }
            | self._states[other]
            for other, hub in self.hubs.items()
        ]  # fmt: skip
        facts = {
            "list": listed,
            "folder": str(self.folder.absolute()),
            "working": self._batch is not None,
            "most": MOST,
        }
        return {"photos": facts, "key": key}

    def _everywhere(self) -> list[Pages]:
        return [self, *self.hubs.values()]

    def _tell_list(self) -> None:
        for pages in self._everywhere():
            Pages.tell(pages, {"do": "photos", **self._facts()["photos"]})

    # --- pages ---

    async def greet(self, page: Page) -> None:
        """Send the list to a page without a photo."""
        page.tell(json.dumps({"do": "hello", "state": None} | self._facts()))

    def left(self, page: Page) -> None:
        """Remove an unfinished upload."""
        if upload := self._uploads.pop(page, None):
            upload.discard()

    def answer(self, page: Page, asked: dict[str, Any], data: bytes) -> None:
        """Handle a message of any page about photos."""
        do = asked["do"]
        if do == "files":
            page.tell(json.dumps({"do": "files", "names": photos_in(self.folder)}))
        elif do == "upload":
            self._upload(asked, data, page)
        elif do == "open":
            self.begin(self._open([str(name) for name in asked["names"]][:MOST_PHOTOS], page), page)
        elif do == "close":
            self.begin(self._close(str(asked["key"]), page), page)
        elif do == "thumbnails":
            self.begin(self._show_thumbnails(page), page)
        elif do == "spaces":
            page.tell(json.dumps({"do": "spaces"} | self._spaces()))
        elif do == "space":
            self._tag(str(asked["key"]), str(asked["space"]), asked["all"] is True)
        elif do == "apply":
            self._apply(self.hubs[str(asked["key"])])
        elif do == "cancel":
            self._canceled = True
            if self._making is not None:
                self._making.rooms["tile"].stop()
        else:
            raise ValueError(do)

    async def _show_thumbnails(self, page: Page) -> None:
        for key, hub in list(self.hubs.items()):
            if hub.source.image is not None:
                with contextlib.suppress(Error):  # the photo's own page says it
                    if key not in self._thumbnails:
                        self._thumbnails[key] = await asyncio.to_thread(_small, hub.source.image)
                    hub.show({"room": "photos", "key": key}, hub.picture(self._thumbnails[key], hub.shown()), page)

    def _upload(self, asked: dict[str, Any], data: bytes, page: Page) -> None:
        if asked["offset"] == 0:
            self.left(page)
            self._uploads[page] = Upload(self.folder, str(asked["name"]), int(asked["size"]))
        if name := self._uploads[page].take(data):
            if self._uploads.pop(page).created:
                self._stored.add(self.folder / name)
            page.tell(json.dumps({"do": "uploaded", "name": name}))
        else:
            page.tell(json.dumps({"do": "received"}))

    # --- color spaces ---

    def _spaces(self) -> dict[str, list[str]]:
        """Names of color spaces: the usual ones, and all."""
        color, usual = self.session.resources.color, list[str]()
        for name in _USUAL:
            with contextlib.suppress(Error):
                usual.append(color.resolve(name))
        names = [space.getName() for space in color.config.getColorSpaces()]
        return {"usual": usual, "others": [name for name in names if name not in usual]}

    def _tag(self, key: str, space: str, all_untagged: bool) -> None:
        """Give a photo, or all that have none, a color space. Their pages start again."""
        for other, hub in self.hubs.items():
            if hub.source.asks and (all_untagged or other == key):
                tag_photo(hub, space)
                hub.tell({"do": "again"})
        self._tell_list()

    # --- the batch ---

    def _apply(self, hub: Hub) -> None:
        """Use the tile parameters of a photo for all others, and save their tiles next to their documents."""
        if self._batch is not None:
            raise Error("parameters are already being applied: wait, or cancel")
        values = {name: value for name, value in hub.document.state["tile"].items() if name not in _OWN}
        if isinstance(hub.document.state["tile"]["mask"], str):
            values["mask"] = "dominant" if hub.document.state["tile"]["mask"] == "dominant" else ""
        others = [key for key, one in self.hubs.items() if one is not hub and one.source.image is not None]
        if not others:
            raise Error("no other photo is open: add one first")
        self._canceled = False
        self._batch = asyncio.create_task(self._make_all(others, values, f"Parameters of {hub.source.stem}"))

    async def _make_all(self, keys: Sequence[str], values: dict[str, Any], text: str) -> None:
        for key in keys:
            self._states[key] = {"text": "waiting"}
        self._tell_list()
        for key in keys:
            self._states[key] = {"text": "making", "done": 0, "total": 1}
            self._tell_list()
            self._making = self.hubs[key]
            try:
                names = [] if self._canceled else await self._make(self._making, values, text)
                self._states[key] = {"text": f"saved: {', '.join(names)}" if names else "canceled"}
            except Exception as error:
                self._states[key] = {"text": str(failure_of(error)), "wrong": True}
        self._making = self._batch = None
        self._tell_list()

    async def _make(self, hub: Hub, values: dict[str, Any], text: str) -> list[str]:
        """Make and save the tile of a photo. Returns the names of its files."""
        if hub.source.asks:
            raise Error("no color space: open the photo, and choose one")
        before, room = set(hub.saved), hub.rooms["tile"]
        changed = hub.document.change("tile", values, text)
        if changed:
            hub.tell({"do": "set", "room": "tile", "values": changed})
            hub.tell({"do": "history"} | hub.document.history.facts())
        await room.deliver(bool(changed))
        names = [name for name in hub.saved if name not in before]
        if not names and not self._canceled:
            raise Error("not saved: the parameters were changed meanwhile")
        if not hub.pages:
            hub.rest()
        return names

    def _watched(self, key: str, message: dict[str, Any]) -> None:
        """Pass on the progress of a photo of the batch."""
        if message["do"] == "busy" and self._states[key]["text"] == "making":
            facts = {"done": message["done"], "total": message["total"]}
            self._states[key] |= facts
            for pages in self._everywhere():
                Pages.tell(pages, {"do": "photo", "key": key} | facts)


def _small(image: Image) -> np.ndarray:
    """A photo for its thumbnail, float32."""
    pixels = as_float(image.first.pixels())
    scale = min(1.0, _THUMBNAIL / max(pixels.shape[:2]))
    height, width = (max(1, round(n * scale)) for n in pixels.shape[:2])
    return resized(pixels, width, height)
