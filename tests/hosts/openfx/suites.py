# SPDX-License-Identifier: Apache-2.0
"""The suites of the host: tables of C functions, in the order of the specification."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from tests.hosts.openfx.host import BAD_HANDLE, BAD_INDEX, FAILED, OK, UNKNOWN, Clip, Image, Node, Parameter, Properties
from tests.hosts.openfx.properties import DOUBLE, INT, POINTER, STRING, TYPES

if TYPE_CHECKING:
    from tests.hosts.openfx.host import Host

_P, _S, _I, _D = ctypes.c_void_p, ctypes.c_char_p, ctypes.c_int, ctypes.c_double
_C = {STRING: _S, INT: _I, DOUBLE: _D, POINTER: _P}
_ORDER = (POINTER, STRING, DOUBLE, INT)
Function = tuple[Any, Callable[..., int]]


def suites(host: Host) -> dict[tuple[str, int], int]:
    """Addresses of the tables by name and version; they live as long as the host."""
    tables = {
        ("OfxPropertySuite", 1): _property_suite(host),
        ("OfxImageEffectSuite", 1): _effect_suite(host),
        ("OfxParameterSuite", 1): _parameter_suite(host),
        ("OfxMessageSuite", 2): _message_suite(host),
        ("OfxProgressSuite", 1): _progress_suite(host),
    }
    host.kept_tables = {key: _table(functions) for key, functions in tables.items()}
    return {key: ctypes.addressof(table) for key, (table, _) in host.kept_tables.items()}


def _table(functions: list[Function | None]) -> tuple[Any, list[Any]]:
    kept = [None if one is None else ctypes.CFUNCTYPE(_I, *one[0])(one[1]) for one in functions]
    table = (_P * len(kept))(*(None if one is None else ctypes.cast(one, _P).value for one in kept))
    return table, kept


def _property_suite(host: Host) -> list[Function | None]:
    def setter(kind: str) -> Function:
        def put(handle: int, name: bytes, index: int, value: Any) -> int:
            found = host.handles.get(handle, Properties)
            return BAD_HANDLE if found is None else found.set_by_plugin(name.decode(), index, value, kind)

        return (_P, _S, _I, _C[kind]), put

    def getter(kind: str) -> Function:
        def get(handle: int, name: bytes, index: int, to: int) -> int:
            found = host.handles.get(handle, Properties)
            if found is None:
                return BAD_HANDLE
            values = found.values.get(name.decode())
            if values is None:
                return UNKNOWN
            if not 0 <= index < len(values):
                return BAD_INDEX
            _C[kind].from_address(to).value = values[index]
            return OK

        return (_P, _S, _I, _P), get

    def reset(handle: int, name: bytes) -> int:
        found = host.handles.get(handle, Properties)
        if found is None or found.kind != "options":
            return BAD_HANDLE
        found.values[name.decode()] = []
        return OK

    return [*map(setter, _ORDER), *(None,) * 4, *map(getter, _ORDER), *(None,) * 4, ((_P, _S), reset), None]


def _effect_suite(host: Host) -> list[Function | None]:
    def of_node(answer: Callable[[Node], int]) -> Function:
        def get(handle: int, to: int) -> int:
            node = host.handles.get(handle, Node)
            if node is None:
                return BAD_HANDLE
            _P.from_address(to).value = answer(node)
            return OK

        return (_P, _P), get

    def define(handle: int, name: bytes, to: int) -> int:
        node = host.handles.get(handle, Node)
        made = node.clips[name.decode()] = Properties(host, "clip")
        _P.from_address(to).value = made.handle
        return OK

    def clip(handle: int, name: bytes, to: int, properties: int | None) -> int:
        node = host.handles.get(handle, Node)
        found = node and node.clips.get(name.decode())
        if not isinstance(found, Clip):
            return FAILED
        _P.from_address(to).value = found.handle
        if properties:
            _P.from_address(properties).value = found.properties.handle
        return OK

    def image(handle: int, time: float, region: int | None, to: int) -> int:
        found = host.handles.get(handle, Clip)
        if found is None or found.image_at is None:
            return FAILED
        found.asked.append(time)
        made = found.image_at(time)
        host.taken += 1
        _P.from_address(to).value = made.handle
        return OK

    def release(handle: int) -> int:
        if host.handles.get(handle, Image) is None:
            return BAD_HANDLE
        host.taken -= 1
        return OK

    def definition(handle: int, time: float, to: int) -> int:
        found = host.handles.get(handle, Clip)
        if found is None or found.image_at is None:
            return FAILED
        (_D * 4).from_address(to)[:] = found.image_at(time)["OfxImagePropRegionOfDefinition"]
        return OK

    def aborted(handle: int) -> int:
        return int(host.handles.get(handle, Node).abort())

    return [
        of_node(lambda node: node.properties.handle), of_node(lambda node: node.handle), ((_P, _S, _P), define),
        ((_P, _S, _P, _P), clip), None, ((_P, _D, _P, _P), image), ((_P,), release), ((_P, _D, _P), definition),
        ((_P,), aborted), *(None,) * 4,
    ]  # fmt: skip


def _parameter_suite(host: Host) -> list[Function | None]:
    def define(handle: int, kind: bytes, name: bytes, to: int) -> int:
        node = host.handles.get(handle, Node)
        if name.decode() in node.parameters or kind.decode() not in TYPES:
            host.wrong.append((kind, name, "defined"))
            return FAILED
        made = node.parameters[name.decode()] = Properties(host, kind.decode())
        _P.from_address(to).value = made.handle
        return OK

    def parameter(handle: int, name: bytes, to: int, properties: int | None) -> int:
        found = host.handles.get(handle, Node).parameters.get(name.decode())
        if not isinstance(found, Parameter):
            return UNKNOWN
        _P.from_address(to).value = found.handle
        if properties:
            _P.from_address(properties).value = found.properties.handle
        return OK

    def value(handle: int, time: float, first: int, second: int) -> int:
        found = host.handles.get(handle, Parameter)
        if found is None:
            return BAD_HANDLE
        kind = TYPES[found.type][0]
        for to, one in zip((first, second), found.values, strict=False):
            _C[kind].from_address(to).value = one
        return OK

    def put(handle: int, value: int) -> int:  # variable arguments: one integer or pointer
        found = host.handles.get(handle, Parameter)
        if found is None:
            return BAD_HANDLE
        text = TYPES[found.type][0] == STRING
        found.values = [ctypes.string_at(value) if text else ctypes.c_int(value or 0).value]
        return OK

    get = ((_P, _D, _P, _P), value)
    return [((_P, _S, _S, _P), define), ((_P, _S, _P, _P), parameter), None, None, None, get, None, None,
            ((_P, _P), put), *(None,) * 9]  # fmt: skip


def _message_suite(host: Host) -> list[Function | None]:
    def persist(handle: int, kind: bytes, name: bytes, form: bytes, text: bytes) -> int:
        assert form == b"%s"
        host.handles.get(handle, Node).messages.append(text.decode())
        return OK

    def clear(handle: int) -> int:
        host.handles.get(handle, Node).messages.clear()
        return OK

    return [None, ((_P, _S, _S, _S, _S), persist), ((_P,), clear)]


def _progress_suite(host: Host) -> list[Function | None]:
    def report(handle: int, share: float) -> int:
        host.handles.get(handle, Node).progress.append(share)
        return OK

    return [((_P, _S), lambda *_: OK), ((_P, _D), report), ((_P,), lambda _: OK)]
