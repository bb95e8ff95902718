# SPDX-License-Identifier: Apache-2.0
"""Frames of hosts (hosts/openfx): an op on the pixels in a request, laid out for the host.

Frames are kept by the host's key, a hash of all that they depend on, so that showing one again computes nothing.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import replace
from typing import Any

from ...engine.core.image import Image, Part, from_pixels
from ...engine.core.op import Kind, Op, no_pixels
from ...engine.core.parameters import Size
from ...engine.core.window import Window
from ...engine.deferred import np, oiio
from ...engine.errors import ImageError
from ...engine.io.cryptomatte import coverage_of
from ...engine.run import is_provisional, planned, run
from ...engine.session import Session
from ...engine.session.facts import Facts
from ...engine.session.progress import Progress
from ...synthesis.quality.verdicts import GRADES
from .jobs import DeviceJob
from .messages import Memory
from .pictures import image_of, spec_of
from .work import bound, op_named

HostFrame = tuple[dict[str, Any], list[Memory]]
_UNASSOCIATED = "oiio:UnassociatedAlpha"
_TYPES = {"uint8": "uint8", "half": "float16", "float": "float32"}


class HostFrames:
    """Finished frames by key, evicted by last use. Safe to use from any thread.

    Parameters
    ----------
    budget : int
        Bytes.
    """

    def __init__(self, budget: int):
        self._budget, self._bytes = budget, 0
        self._kept: OrderedDict[str, HostFrame] = OrderedDict()
        self._lock = threading.Lock()

    def get(self, key: str) -> HostFrame | None:
        """The frame, or None."""
        with self._lock:
            if key in self._kept:
                self._kept.move_to_end(key)
            return self._kept.get(key)

    def put(self, key: str, frame: HostFrame) -> HostFrame:
        """Keep a frame, and return it."""
        with self._lock:
            self._bytes += _bytes_of(frame) - _bytes_of(self._kept.pop(key, ({}, [])))
            self._kept[key] = frame
            while self._bytes > self._budget:
                self._bytes -= _bytes_of(self._kept.popitem(last=False)[1])
        return frame


def _bytes_of(frame: HostFrame) -> int:
    return sum(memory.nbytes for memory in frame[1])


def frame(job: DeviceJob, asked: dict[str, Any], arrays: list[np.ndarray] | tuple[()], session: Session) -> HostFrame:
    """A frame: facts with its place, and its pixels, (height, width, channels), as the host asks for them.

    `asked` has an op with its values; `inputs`, a slot and an image of one part for each array; `part`, the required
    part of the result; and the `channels` and the `type` of the host's pixels.
    """
    progress = Progress(job.advance, measure=bool(asked.get("measure")))
    images = [
        _premultiplied(image_of(one["image"], [array])) for one, array in zip(asked["inputs"], arrays, strict=True)
    ]
    op, session = _op(asked, images), session.telling(progress)
    results = session.resources.on_a_device(lambda: run(op, session))
    part = _part(results[0].image, asked["part"])
    if asked.get("matte"):
        pixels = coverage_of(results[0].image, asked["matte"])[1][..., np.newaxis]
    elif part.name == "cryptomatte":
        pixels = _coarsest_layer(part, asked["type"])
    else:
        pixels = session.resources.on_a_device(part.pixels)
        if op.main().kind is Kind.PIXELS and part is results[0].image.first and _is_unpremultiplied(asked):
            pixels = _unpremultiplied(pixels, part.spec.alpha_channel)
    pixels = _of_host(pixels, asked["channels"], asked["type"], bool(asked.get("mask")), part)
    return _place(part) | {"verdict": _verdict(job.log)}, [Memory(pixels)]


def planned_places(asked: dict[str, Any], facts: Facts) -> dict[str, Any]:
    """Where the pixels of a frame will be, if that is known before the work; also the errors of the request."""
    images = []
    for one in asked["inputs"]:
        spec, about = spec_of(one["image"]["parts"][0]), one["image"]["parts"][0]
        images.append(Image((Part(str(about["name"]), spec, no_pixels, spec.format),), str(one["image"]["source"])))
    op = _op(asked, images)
    image = planned(op, facts, set())[0]
    if not is_provisional(image):
        return _place(_part(image, asked["part"]))
    size = op.values().get("size")
    return {"place": [0, 0, *size], "full": [0, 0, *size]} if isinstance(size, Size) else {}


def _op(asked: dict[str, Any], images: list[Image]) -> Op:
    """The op of a request."""
    given = dict(zip((str(one["slot"]) for one in asked["inputs"]), images, strict=True))
    if asked["op"] == "fill" and "region" not in given:
        given["region"] = _transparency(images[0])
    required = [slot.name for slot in op_named(asked["op"]).images()]
    return bound(asked, [given.pop(name) for name in required if name in given], given)


def _verdict(log: list[tuple[str, str]]) -> str:
    """The log's verdict on the quality of a result: warnings, and lines that begin with a grade."""
    texts = [(level, text.partition(": ")[2]) for level, text in log]
    judged = [text for level, text in texts if level == "warning" or text.partition(":")[0] in GRADES]
    return " ".join(judged) or "The result has no verdict."


def _part(image: Image, name: str) -> Part:
    """The part of that name; a name that ends in '.' stands for the last, coarsest of several."""
    several = [part for part in image.parts if part.name.startswith(name)] if name.endswith(".") else []
    return several[-1] if several else image.part(name) or image.first


def _place(part: Part) -> dict[str, Any]:
    """Data and display window, as left, top, width, height."""
    data, display = part.window, Window.display(part.spec)
    return {
        "place": [data.left, data.top, data.width, data.height],
        "full": [display.left, display.top, display.width, display.height],
    }


def _is_unpremultiplied(asked: dict[str, Any]) -> bool:
    """Whether the host's first image is, so that the result must also be."""
    part = asked["inputs"][0]["image"]["parts"][0]
    return any(name == _UNASSOCIATED for name, *_ in part["attributes"])


def _premultiplied(image: Image) -> Image:
    """An unpremultiplied image, as floats premultiplied; other images as they are."""
    part, alpha = image.first, image.first.spec.alpha_channel
    if not part.spec.get_int_attribute(_UNASSOCIATED):
        return image
    pixels = _floats(part.pixels()).copy()
    pixels[..., :alpha] *= pixels[..., alpha : alpha + 1]
    spec = oiio.ImageSpec(part.spec)
    spec.erase_attribute(_UNASSOCIATED)
    spec.set_format(oiio.TypeDesc("float"))
    return Image((from_pixels(part.name, pixels, spec, part.stored),), image.source)


def _unpremultiplied(pixels: np.ndarray, alpha: int) -> np.ndarray:
    """Premultiplied pixels with color divided by alpha, where that is not 0."""
    if alpha < 0:
        return pixels
    divisor = pixels[..., alpha : alpha + 1]
    color = pixels[..., :alpha] / np.where(divisor == 0, np.float32(1), divisor)
    return np.concatenate([color, pixels[..., alpha:]], -1)


def _transparency(image: Image) -> Image:
    """A mask of the pixels of an image that are not opaque, as a host's line makes it (tools/openfx.py)."""
    part, alpha = image.first, image.first.spec.alpha_channel
    if alpha < 0:
        raise ImageError("the clip Region is not connected, and Source has no alpha: expected one of them")

    def change(spec: oiio.ImageSpec) -> None:
        spec.nchannels, spec.channelnames, spec.alpha_channel = 1, ("Y",), -1

    def fetch(window: Window) -> np.ndarray:
        return 1000 * (1 - _floats(part.read(window)[..., alpha : alpha + 1]))

    mask = part.respecced(change)
    mask.spec.set_format(oiio.TypeDesc("float"))
    return Image((replace(mask, fetch=fetch),), "region")


def _coarsest_layer(part: Part, kind: str) -> np.ndarray:
    """The Cryptomatte layer of the coarsest level, (height, width, 4)."""
    if kind != "float":
        raise ImageError(f"Cryptomatte in a {kind} image would change ids: expected a float image")
    return part.pixels()[..., -4:]


def _floats(pixels: np.ndarray) -> np.ndarray:
    """Integers as 32-bit fractions of their largest value; half as floats."""
    top = np.iinfo(pixels.dtype).max if pixels.dtype.kind in "ui" else 1
    return pixels.astype(np.float32, copy=False) / np.float32(top)


def _of_host(pixels: np.ndarray, channels: int, kind: str, mask: bool, part: Part) -> np.ndarray:
    """Pixels in the host's channels and type: one channel is repeated, alpha is 1 where there is none."""
    wanted, exact = np.dtype(_TYPES[kind]), part.exact
    if pixels.dtype != wanted and not exact:
        pixels = _floats(pixels)
    if pixels.dtype != wanted and wanted == np.uint8:
        pixels = np.clip(pixels, 0, 255) if exact else np.rint(np.clip(pixels, 0, 1) * np.float32(255))
    pixels = pixels.astype(wanted, copy=False)
    height, width, count = pixels.shape
    if count == channels:
        return pixels
    alpha = part.spec.alpha_channel
    if channels == 1:
        return pixels[..., alpha : alpha + 1] if alpha >= 0 and not mask else pixels[..., :1]
    out = np.zeros((height, width, channels), wanted)
    colors = min(3, channels)
    if count == 1:
        out[..., :colors] = pixels
    else:
        out[..., : min(count, channels)] = pixels[..., :channels]
    if channels == 4 and count < 4:
        out[..., 3:] = pixels[..., :1] if mask else 255 if wanted == np.uint8 else 1
    return out
