# SPDX-License-Identifier: Apache-2.0
"""Requests of a client: ops on its images, and windows of the results."""

from __future__ import annotations

import itertools
from typing import Any

from ... import filters
from ...engine.core.image import Image
from ...engine.core.op import Op
from ...engine.core.parameters import nearest, parse_modifiers
from ...engine.core.window import Window
from ...engine.deferred import np
from ...engine.errors import ImageError, Interrupted, ParameterError
from ...engine.run import run
from ...engine.session import Session
from ...engine.session.progress import Progress
from .. import host
from .jobs import DeviceJob
from .pictures import image_facts, window_of
from .textures import opened

MOST_IMAGES = 4096  # per client


class Bench:
    """A client's images by number, and the requests on them."""

    def __init__(self, session: Session):
        self._session = session
        self._images: dict[int, Image] = {}
        self._numbers = itertools.count(1)

    def keep(self, image: Image) -> int:
        """Keep an image, and return its number."""
        if len(self._images) >= MOST_IMAGES:
            raise ImageError(f"too many images of one client: expected at most {MOST_IMAGES}; drop some")
        number = next(self._numbers)
        self._images[number] = image
        return number

    def drop(self, number: int) -> None:
        """Delete an image."""
        self._images.pop(number, None)

    def image(self, number: int) -> Image:
        """The image with that number."""
        if number not in self._images:
            raise ImageError(f"unknown image {number}: it may have been dropped")
        return self._images[number]

    def make(self, job: DeviceJob, asked: dict[str, Any], look: Any) -> tuple[dict[str, Any], list[np.ndarray]]:
        """Run an op."""
        said = list[str]()
        only_look = asked.get("until") == "look"
        seen: list[np.ndarray] = []

        def looked(pixels: np.ndarray, whole: bool) -> None:
            if only_look:
                seen.append(pixels)
                raise Interrupted("seen")
            look(pixels, whole)

        looks = look is not None or only_look
        progress = Progress(job.advance, looked if looks else None, said.append, bool(asked.get("measure")))
        session = self._session.telling(progress)
        given = [self.image(number) for number in asked.get("images", ())]
        optional = {key: self._optional(what, given) for key, what in asked.get("optional", {}).items()}
        op = bound(asked, given, optional)
        try:
            results = session.resources.on_a_device(lambda: run(op, session))
        except Interrupted:
            if not seen:
                raise
            return {"images": [], "said": said, "log": job.log}, seen
        keep = asked.get("keep", True)
        images = [image_facts(one.image) | {"number": self.keep(one.image) if keep else 0} for one in results]
        failed = [text for one in results for text in one.failed]
        arrays = []
        if asked.get("read") is not None:
            arrays.append(_pixels(results[0].image, asked["read"], None))
        return {"images": images, "said": said, "log": job.log, "failed": failed}, arrays

    def read(self, job: DeviceJob, asked: dict[str, Any]) -> tuple[dict[str, Any], list[np.ndarray]]:
        """Pixels of a window (left, top, right, bottom; None: all) of an image's part ('': the first)."""
        return {}, [_pixels(self.image(asked["image"]), asked.get("part", ""), asked.get("window"))]

    def texture(self, job: DeviceJob, asked: dict[str, Any]) -> tuple[dict[str, Any], list[np.ndarray]]:
        """The specs of a texture file's parts, as OpenImageIO XML, and their number of levels."""
        session = self._session.telling(Progress(job.advance))
        texture = session.resources.on_a_device(lambda: opened(asked["texture"], session))
        return {"specs": [spec.to_xml() for spec in texture.specs], "levels": texture.levels}, []

    def tile(self, job: DeviceJob, asked: dict[str, Any]) -> tuple[dict[str, Any], list[np.ndarray]]:
        """Pixels of a window (left, top, right, bottom) of a level of a part of a texture file."""
        session, window = self._session.telling(Progress(job.advance)), Window(*map(int, asked["window"]))

        def made() -> np.ndarray:
            texture = opened(asked["texture"], session)
            return texture.tile(int(asked["level"]), window, session, int(asked["part"]))

        return {}, [session.resources.on_a_device(made)]

    def _optional(self, what: int | str, given: list[Image]) -> Image:
        if isinstance(what, int):
            return self.image(what)
        part = given[0].part(what) if given else None
        if part is None:
            raise ParameterError(f"the image has no part '{what}'")
        return Image((part,), what)


def bound(asked: dict[str, Any], given: list[Image], optional: dict[str, Image]) -> Op:
    """The op of a request with its values, which are text, its required images, and its optional ones by modifier."""
    op, words = op_named(asked["op"]), {key: str(text) for key, text in asked.get("values", {}).items()}
    name = op.name
    values = {p.attribute: p.parse(words.pop(p.name)) for p in op.arguments() if p.name in words}
    values |= parse_modifiers(op, words)
    taken = op.taken(values)
    count = len(given) if len(taken) == 1 and taken[0].many else len(taken) + op.further_count(values)
    if len(given) != count:
        raise ParameterError(f"{name} takes {count} image(s), not {len(given)}")
    slots = {i.name: i for i in op.optional_images()}
    images = {i.attribute: None for i in slots.values()} | op.with_images(given, values)
    for key, image in optional.items():
        if key not in slots:
            raise ParameterError(f"{name}: unknown image parameter '{key}'{nearest(key, slots)}")
        images[slots[key].attribute] = image
    return op(**images)


def op_named(name: str) -> type[Op]:
    """The op with that name, which is its flag without --tex or --."""
    shelves = (*filters.SHELVES, *host.SHELVES)
    flags = {flag.removeprefix("--tex"): (flag, shelf) for shelf in reversed(shelves) for flag in shelf.names}
    flags = {key.lstrip("-"): found for key, found in flags.items()}
    if name in flags:
        flag, shelf = flags[name]
        return next(op for op in shelf.declarations if flag in (op.flag(), *op.aliases))
    others = {op.name: op for op in filters.further()}
    if name not in others:
        raise ParameterError(f"unknown op '{name}'{nearest(name, [*flags, *others])}")
    return others[name]


def _pixels(image: Image, name: str, window: list[int] | None) -> np.ndarray:
    part = image.part(name) if name else image.first
    if part is None:
        raise ImageError(f"{image.source} has no part '{name}'")
    place = window_of(window, part)
    if place.empty:
        raise ImageError(f"window {window} is outside of {part.name}")
    return part.read(place)
