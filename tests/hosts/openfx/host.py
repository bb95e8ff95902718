# SPDX-License-Identifier: Apache-2.0
"""A small host of OpenFX in ctypes. It loads a bundle as compositors do, and checks every property that is set."""

from __future__ import annotations

import ctypes
import itertools
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from tests.hosts.openfx.properties import DOUBLE, INT, POINTER, STRING, TYPES, expected

OK, FAILED, BAD_HANDLE, BAD_INDEX, REPLY_DEFAULT, UNKNOWN = 0, 1, 9, 10, 14, 3
_C = {STRING: ctypes.c_char_p, INT: ctypes.c_int, DOUBLE: ctypes.c_double, POINTER: ctypes.c_void_p}
_P, _S, _I, _D = ctypes.c_void_p, ctypes.c_char_p, ctypes.c_int, ctypes.c_double
COMPONENTS = {4: "OfxImageComponentRGBA", 3: "OfxImageComponentRGB", 1: "OfxImageComponentAlpha"}
DEPTHS = {"float32": "OfxBitDepthFloat", "float16": "OfxBitDepthHalf", "uint8": "OfxBitDepthByte"}
_OF_PIXELS = ("OfxImageEffectPropComponents", "OfxImageEffectPropPixelDepth", "OfxImageEffectPropPreMultiplication")
Rect = tuple[int, int, int, int]


class _OfxHost(ctypes.Structure):
    _fields_ = (("host", _P), ("suite", _P))


class _OfxPlugin(ctypes.Structure):
    _fields_ = (
        ("api", _S), ("api_version", _I), ("identifier", _S), ("major", ctypes.c_uint), ("minor", ctypes.c_uint),
        ("set_host", ctypes.CFUNCTYPE(None, _P)), ("main", ctypes.CFUNCTYPE(_I, _S, _P, _P, _P)),
    )  # fmt: skip


class Handles:
    """Objects by the numbers that the plugin gets as handles."""

    def __init__(self) -> None:
        self._numbers, self._objects = itertools.count(16, 16), dict[int, Any]()

    def of(self, thing: Any) -> int:
        """The handle of an object, until it is dropped."""
        number = next(self._numbers)
        self._objects[number] = thing
        return number

    def drop(self, number: int) -> None:
        """Make a handle invalid."""
        self._objects.pop(number, None)

    def get(self, number: int, kind: type) -> Any:
        """The object, or None if the handle is no longer valid, or of something else."""
        thing = self._objects.get(number)
        return thing if isinstance(thing, kind) else None

    def __len__(self) -> int:
        return len(self._objects)


class Properties:
    """A set of properties. `kind`: what the plugin may set in it, as of `properties.expected`; empty: nothing."""

    def __init__(self, host: Host, kind: str = "", **values: Any):
        self.kind, self._host, self.values = kind, host, dict[str, list[Any]]()
        for name, value in values.items():
            self.put(name, *(value if isinstance(value, (tuple, list)) else (value,)))
        self.handle = host.handles.of(self)

    def put(self, name: str, *values: Any) -> None:
        """Set a property as the host does; strings stay where they are."""
        self.values[name] = [v.encode() if isinstance(v, str) else v for v in values]

    def __getitem__(self, name: str) -> Any:
        values = [v.decode() if isinstance(v, bytes) else v for v in self.values[name]]
        return values[0] if len(values) == 1 else values

    def set_by_plugin(self, name: str, index: int, value: Any, kind: str) -> int:
        """Set a property as the plugin does."""
        wanted = expected(self.kind, name)
        if wanted is None or wanted[0] != kind or not 0 <= index < (wanted[1] or 1000):
            self._host.wrong.append((self.kind, name, index, kind))
            return UNKNOWN
        values = self.values.setdefault(name, [])
        if index > len(values):
            self._host.wrong.append((self.kind, name, index, "gap"))
            return BAD_INDEX
        values[index : index + 1] = [value]
        return OK


class Image(Properties):
    """Pixels as a host keeps them: any bounds, rows upward, padded rows, rows that run backward in memory.

    `pixels`: (height, width, channels), the top row first. `state`: Premultiplied or UnPremultiplied.
    """

    def __init__(
        self, host: Host, pixels: np.ndarray, corner: tuple[int, int] = (0, 0), padding=0, backward=False,
        state="Premultiplied",
    ):  # fmt: skip
        height, width, channels = pixels.shape
        self.row = width * channels * pixels.itemsize + padding
        self.memory = np.full((height + 2, self.row), 0xAB, np.uint8)  # a row before and after are guards
        self.backward, self.shape, self.dtype = backward, pixels.shape, pixels.dtype
        self.rows()[...] = pixels
        first = 1 if not backward else height
        data = self.memory.ctypes.data + first * self.row
        bounds = (*corner, corner[0] + width, corner[1] + height)
        super().__init__(
            host, OfxImagePropData=data, OfxImagePropBounds=bounds, OfxImagePropRegionOfDefinition=bounds,
            OfxImagePropRowBytes=-self.row if backward else self.row,
            OfxImageEffectPropComponents=COMPONENTS[channels], OfxImageEffectPropPixelDepth=DEPTHS[pixels.dtype.name],
            OfxImageEffectPropPreMultiplication=f"OfxImageAlpha{state}", OfxImagePropPixelAspectRatio=1.0,
        )  # fmt: skip

    def rows(self) -> np.ndarray:
        """The pixels in place, the top row first."""
        height, width, channels = self.shape
        inside = self.memory[1:-1, : width * channels * self.dtype.itemsize]
        return (inside if self.backward else inside[::-1]).view(self.dtype).reshape(height, width, channels)

    def guarded(self) -> bool:
        """Whether nothing was written outside of the pixels."""
        width = self.shape[1] * self.shape[2] * self.dtype.itemsize
        outside = (self.memory[0], self.memory[-1], self.memory[1:-1, width:])
        return all((part == 0xAB).all() for part in outside)


class Clip:
    """A clip of an instance. `image_at(time)` returns an `Image`, or None: not connected."""

    def __init__(self, host: Host, name: str):
        self.host, self.name, self.image_at = host, name, None
        self.properties, self.asked = Properties(host), list[float]()
        self.handle = host.handles.of(self)
        self.connect(None)

    def connect(self, image_at: Callable[[float], Image] | Image | None, frames: tuple[float, float] = (0, 0)) -> None:
        """Connect an image, or a function that gives the image of a frame; None disconnects."""
        self.image_at = (lambda _: image_at) if isinstance(image_at, Image) else image_at
        like = self.image_at(frames[0]) if self.image_at else None
        self.properties.put("OfxImageClipPropConnected", int(like is not None))
        self.properties.put("OfxImageEffectPropFrameRange", *map(float, frames))
        self.properties.put("OfxImagePropPixelAspectRatio", 1.0)
        for name in _OF_PIXELS:
            self.properties.values[name] = like.values[name] if like else [b""]


class Parameter:
    """A parameter of an instance."""

    def __init__(self, host: Host, described: Properties):
        self.type, count = described.kind, TYPES[described.kind][1]
        zero: list[Any] = [b"" if TYPES[self.type][0] == STRING else 0] * count
        self.values = list(described.values.get("OfxParamPropDefault", zero))
        self.properties = Properties(host, "options" if self.type == "OfxParamTypeChoice" else "")
        if "OfxParamPropChoiceOption" in described.values:
            self.properties.put("OfxParamPropChoiceOption", *described.values["OfxParamPropChoiceOption"])
        self.handle = host.handles.of(self)

    def set(self, *values: Any) -> None:
        """Set the values as a user does."""
        self.values = [v.encode() if isinstance(v, str) else v for v in values]


class Node:
    """A plugin of the bundle as it describes itself in a context, or an instance of it."""

    def __init__(self, host: Host, plugin: _OfxPlugin, kind: str):
        self.host, self.plugin, self.properties = host, plugin, Properties(host, kind)
        self.clips, self.parameters = dict[str, Any](), dict[str, Any]()
        self.messages, self.progress, self.abort = list[str](), list[float](), lambda: False
        self.handle = host.handles.of(self)

    def do(self, action: str, out: Properties | None = None, **given: Any) -> int:
        """Call an action with these properties of its first argument."""
        arguments = Properties(self.host, **given) if given else None
        handles = (one.handle if one else None for one in (arguments, out))
        status = self.plugin.main(action.encode(), self.handle, *handles)
        if arguments:
            self.host.handles.drop(arguments.handle)
        return status

    def ask(self, action: str, **given: Any) -> tuple[int, Properties]:
        """The status of an action and what it sets."""
        out = Properties(self.host, "out")
        return self.do(action, out, **given), out


class Host:
    """A loaded bundle.

    Attributes
    ----------
    wrong : list
        Properties that the plugin has set against the specification.
    """

    def __init__(self, file: Path):
        from tests.hosts.openfx.suites import suites

        self.handles, self.wrong, self.taken = Handles(), [], 0
        self.library = ctypes.CDLL(str(file))
        self.library.OfxGetPlugin.restype = ctypes.POINTER(_OfxPlugin)
        self._tables = suites(self)
        fetch = ctypes.CFUNCTYPE(_P, _P, _S, _I)
        self._fetch = fetch(lambda _, name, version: self._tables.get((name.decode(), version)))
        self.properties = Properties(self, OfxPropName="org.oiiotex.test")
        self._struct = _OfxHost(self.properties.handle, ctypes.cast(self._fetch, _P))
        self.plugins = {}
        for number in range(self.library.OfxGetNumberOfPlugins()):
            plugin = self.library.OfxGetPlugin(number).contents
            plugin.set_host(ctypes.addressof(self._struct))
            assert plugin.main(b"OfxActionLoad", None, None, None) == OK
            self.plugins[plugin.identifier.decode().rpartition(".")[2]] = plugin

    def described(self, name: str, context: str) -> Node:
        """A node as it describes itself in a context."""
        node = Node(self, self.plugins[name], "effect")
        assert node.do("OfxActionDescribe") == OK
        given = {"OfxImageEffectPropContext": f"OfxImageEffectContext{context}"}
        assert node.do("OfxImageEffectActionDescribeInContext", **given) == OK
        return node

    def instance(self, name: str, context: str = "General", **properties: Any) -> Node:
        """A new instance, with further properties."""
        described = self.described(name, context)
        node = Node(self, self.plugins[name], "")
        node.properties.put("OfxImageEffectPropProjectSize", 1920.0, 1080.0)
        node.properties.put("OfxImageEffectPropProjectOffset", 0.0, 0.0)
        for key, value in properties.items():
            node.properties.put(key, value)
        node.clips = {clip: Clip(self, clip) for clip in described.clips}
        node.parameters = {key: Parameter(self, one) for key, one in described.parameters.items()}
        assert node.do("OfxActionCreateInstance") == OK
        return node

    def render(
        self, node: Node, window: Rect, out: Image, time: float = 0.0, scale: tuple[float, float] = (1.0, 1.0)
    ) -> int:
        """Render a window of the result into an image, as one frame of a sequence."""
        node.clips["Output"].connect(out)
        return self.render_into(node, window, time, scale)

    def render_into(self, node: Node, window: Rect, time: float, scale: tuple[float, float] = (1.0, 1.0)) -> int:
        """The same for an output that is already connected."""
        given = {"OfxPropTime": time, "OfxImageEffectPropRenderWindow": window, "OfxImageEffectPropRenderScale": scale}
        return node.do("OfxImageEffectActionRender", **given, OfxImageEffectPropFieldToRender="OfxFieldNone")

    @contextmanager
    def threads(self, count: int) -> Iterator[Callable[[Callable[[], Any]], None]]:
        """Start work on threads, and wait for it."""
        started: list[threading.Thread] = []

        def start(work: Callable[[], Any]) -> None:
            started.append(threading.Thread(target=work))
            started[-1].start()

        yield start
        for one in started:
            one.join()
        assert len(started) <= count

    def unload(self) -> None:
        """Unload all plugins."""
        for plugin in self.plugins.values():
            assert plugin.main(b"OfxActionUnload", None, None, None) == OK
