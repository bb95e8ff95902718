# SPDX-License-Identifier: Apache-2.0
"""Strange messages, by number, to the resident process and to the page's server: they go on, say nothing, stay small.

$OIIOTEX_STRANGE says how many of each, from $OIIOTEX_STRANGE_BEGIN on. What a number stands for never changes with how
many others are tried.
"""

from __future__ import annotations

import contextlib
import json
import os
import random
import socket
import struct
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from oiiotex.engine.errors import Error
from oiiotex.oiiotool.service.client import Client, connect
from oiiotex.oiiotool.service.messages import Link, LinkError
from oiiotex.oiiotool.service.settings import ResidentSettings
from tests import pictures
from tests.browser import TOKEN, Served, end_resident
from tests.conftest import save

MESSAGES = int(os.environ.get("OIIOTEX_STRANGE", "300"))
BEGIN = int(os.environ.get("OIIOTEX_STRANGE_BEGIN", "0"))
NUMBERS = range(BEGIN, BEGIN + MESSAGES)
SETTINGS = ResidentSettings(budget=1 << 30, idle=30)
GROWN = 256 << 20  # bytes that a process may have more than before
VALUES = (
    None, True, False, 0, 1, -1, 2**31, 2**63, -(2**70), 0.5, 1e300, float("inf"), float("nan"), "", "0", "x" * 5000,
    "../..", "\\0", "\\ud800", [], [1], [[]], [None] * 100, {}, {"a": 1}, {"": {}}, [1, 2, 3, 4], [0, 0, 1 << 40, 9],
    "float", "uint8", "float[2000000000]", "O", "(1,", "<f4", "V9", "stationarize", "flip", "coarse", "paint", "tile",
)  # fmt: skip
IMAGE = {
    "source": "s",
    "parts": [
        {
            "name": "p", "place": [0, 0, 2, 2, 0, 0, 2, 2], "type": "float", "channels": ["R", "G", "B"], "alpha": -1,
            "stored": None, "exact": False, "attributes": [["a", "int", 1], ["b", "float[2]", [1.0, 2.0]]],
        },
    ],
}  # fmt: skip
TEXTURE = {
    "name": "w.oiiotex", "photo": "/none.png", "graph": None, "tiles": None, "plan": None, "stamp": [1, 2], "width": 9,
    "height": 9,
}  # fmt: skip
REQUESTS: tuple[dict[str, Any], ...] = (
    {"do": "hello"},
    {"do": "put", "image": IMAGE},
    {"do": "read", "image": 1, "part": "", "window": [0, 0, 2, 2]},
    {"do": "make", "op": "flip", "images": [1], "values": {"": "1"}, "optional": {}, "priority": 5, "read": ""},
    {
        "do": "make",
        "op": "stationarize",
        "images": [1],
        "values": {"sigma": "1"},
        "optional": {"mask": "p"},
        "look": True,
    },
    {"do": "texture", "texture": json.dumps(TEXTURE)},
    {"do": "tile", "texture": json.dumps(TEXTURE), "part": 0, "level": 0, "window": [0, 0, 64, 64]},
    {"do": "drop", "image": 1},
    {"do": "cancel", "job": 1},
)
ASKED: tuple[dict[str, Any], ...] = (
    {"do": "set", "room": "tile", "values": {"seed": 1, "sigma": 8, "mask": "", "fill": ""}},
    {"do": "set", "room": "view", "values": {"display": "d", "view": "v", "exposure": 0}},
    {"do": "set", "room": "zoom", "values": {"x": "1", "keys": [{"x": "1", "y": "1", "zoom": 1}]}},
    {"do": "set", "room": "variants", "values": {"list": []}},
    {"do": "set", "room": "paint", "values": {"brush": 8, "label": 1}},
    {"do": "set", "room": "painting", "values": {"step": 1}},
    {"do": "set", "room": "masks", "values": {"mask": 1}},
    {"do": "set", "room": "history", "values": {"at": 1}},
    {"do": "stroke", "room": "paint", "layer": "coarse", "value": 1, "left": 0, "top": 0, "width": 2, "height": 2},
    {"do": "bring", "room": "paint", "name": "x"}, {"do": "undo", "room": "paint"}, {"do": "line", "room": "paint"},
    {"do": "save", "room": "paint", "times": 1}, {"do": "new", "room": "paint", "label": -1},
    {"do": "brush", "room": "tile", "name": "mask"}, {"do": "overlay", "room": "tile", "name": "x"},
    {"do": "line", "room": "zoom", "width": 9, "height": 9}, {"do": "path", "room": "zoom"},
    {"do": "tiles", "room": "zoom", "tiles": [[1, "0", "0"]]},
)  # fmt: skip
HEADS = (
    b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n", b"GET /" + b"a" * 100_000 + b" HTTP/1.1\r\n\r\n",
    b"GET / HTTP/1.1\r\n" + b"X: " + b"y" * 300_000 + b"\r\n\r\n", b"GET / HTTP/1.1\r\n" + b"X: y\r\n" * 30_000,
    f"GET /{TOKEN}/ HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 99999999999\r\n\r\n".encode(),
    f"GET /{TOKEN}/\xff%ff%00%2e HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode("latin-1"),
    f"GET /{TOKEN}/main.js HTTP/1.1\r\nHost: 127.0.0.1\r\nTransfer-Encoding: chunked\r\n\r\nffffffffff\r\n".encode(),
    f"POST /{TOKEN}/ HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: -1\r\n\r\n".encode(),
    b"\x16\x03\x01\x02\x00\x01\x00",
    f"GET /{TOKEN}/wire HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\r\n".encode(),
    b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n", b"\r\n" * 1000, b"GET http://x:99999999/ HTTP/1.1\r\nHost: \xff\r\n\r\n",
)  # fmt: skip


def strange(dice: random.Random, asked: Any, deep: int = 0) -> Any:
    """An object with a few of its values, names or items replaced."""
    if deep and dice.random() < 0.25:
        return dice.choice(VALUES)
    if isinstance(asked, dict):
        kept = {name: strange(dice, value, deep + 1) for name, value in asked.items() if dice.random() < 0.95}
        return kept | ({str(dice.choice(VALUES)): dice.choice(VALUES)} if dice.random() < 0.1 else {})
    if isinstance(asked, list):
        return [strange(dice, value, deep + 1) for value in asked for _ in range(dice.choice((1, 1, 1, 1, 0, 2)))]
    return asked


def broken(dice: random.Random, text: bytes) -> bytes:
    """A text cut short, with bytes changed, or another one."""
    kind = dice.randrange(6)
    if kind == 0:
        return text[: dice.randrange(len(text) + 1)]
    if kind == 1:
        return dice.randbytes(dice.choice((1, 7, 8, 9, 100, 5000)))
    if kind == 2:
        return b"[" * dice.choice((10, 100_000)) + text
    if kind == 3:
        return dice.choice(
            (b"", b"null", b"1", b'"x"', b"[]", b"{}", b"\xff\xfe", b'{"id":1e999}', b"9" * 6000, b"NaN")
        )
    at = dice.randrange(len(text) or 1)
    return text[:at] + dice.randbytes(dice.choice((1, 2, 4))) + text[at + 1 :]


def memory_of(pid: int) -> int:
    """Bytes that a process has in memory."""
    line = next(x for x in Path(f"/proc/{pid}/status").read_text().splitlines() if x.startswith("VmRSS"))
    return int(line.split()[1]) << 10


def sent(connection: socket.socket, data: bytes, dice: random.Random) -> None:
    """Send, look what comes, hang up in one way or another."""
    connection.settimeout(0.02)
    with contextlib.suppress(OSError):
        connection.sendall(data)
        if dice.random() < 0.5:
            connection.shutdown(socket.SHUT_WR)
        if dice.random() < 0.7:
            connection.recv(1 << 16)
    if dice.random() < 0.3:  # as a process that is killed with something unread
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))


# --- the resident process ---


@pytest.fixture(scope="module")
def client() -> Iterator[Client]:
    with pytest.MonkeyPatch.context() as patch, tempfile.TemporaryDirectory(prefix="oxs") as name:
        patch.setenv("XDG_RUNTIME_DIR", name)
        opened = connect(SETTINGS)
        yield opened
        opened.end()


def linked() -> Link:
    raw = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    raw.connect(str(SETTINGS.socket()))
    raw.settimeout(60)
    return Link(raw)


def goes_on(client: Client, pid: int, before: int, log: Callable[[], str]) -> None:
    assert client.hello()["pid"] == pid
    assert memory_of(pid) - before < GROWN
    assert log() == ""


def no_traceback(text: str) -> bool:
    """Whether a log has plain lines alone."""
    return not any(line.startswith((" ", "Traceback")) or len(line) > 400 for line in text.splitlines())


def test_bytes_that_are_no_message_end_their_connection_alone(client):
    pid, log = client.hello()["pid"], SETTINGS.socket().with_suffix(".log")
    before = memory_of(pid)
    for number in NUMBERS:
        dice = random.Random(number)
        text = json.dumps(dice.choice(REQUESTS) | {"id": 1, "arrays": []}).encode()
        data = broken(dice, text) if dice.random() < 0.7 else text
        length = len(data) if dice.random() < 0.6 else dice.choice((0, 1, 16 << 20, 1 << 31, 2**32 - 1))
        head = b"oxs\x01" if dice.random() < 0.9 else dice.randbytes(4)
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as raw:
            raw.connect(str(SETTINGS.socket()))
            memory = os.memfd_create("x")
            if dice.random() < 0.2:
                with contextlib.suppress(OSError):
                    socket.send_fds(raw, [head], [memory] * dice.choice((1, 3, 64)))
                head = b""
            os.close(memory)
            sent(raw, head + struct.pack("<I", length) + data, dice)
    goes_on(client, pid, before, log.read_text)
    assert client.hello()["clients"] < 64


def test_strange_requests_are_answered_in_words(client):
    pid, log = client.hello()["pid"], SETTINGS.socket().with_suffix(".log")
    before, link = memory_of(pid), linked()
    answered = 0
    for number in NUMBERS:
        dice = random.Random(number)
        asked = strange(dice, dice.choice(REQUESTS))
        if not isinstance(asked, dict) or asked.get("do") == "end":
            continue
        arrays = [np.zeros((2, 2, 3), np.float32)] * dice.choice((1, 1, 1, 0, 2))
        try:
            link.send({"id": 1} | asked, arrays if asked.get("do") == "put" else ())
            while (state := link.receive()[0]["state"]) in ("progress", "look"):
                pass
            assert state in ("done", "failed", "canceled")
            answered += 1
        except LinkError:  # it was no message
            link = linked()
        except (Error, ValueError, UnicodeError):  # this side cannot say it
            pass
    goes_on(client, pid, before, log.read_text)
    assert answered > MESSAGES / 2


@pytest.mark.slow
def test_who_takes_no_answer_holds_nobody_up_for_long(client):
    link = linked()
    for number in range(60):  # whose answers are more than the connection holds
        link.send({"do": "read", "image": 1, "id": f"{number}{'x' * 60_000}"})
    other = client.read(10**6)
    with pytest.raises(Error, match="unknown image"):
        other.result(30)
    link.close()


# --- the page's server ---


@pytest.fixture(scope="module")
def server() -> Iterator[tuple[Served, Callable[[], str]]]:
    pytest.importorskip("starlette", reason="NOT RUN: no starlette (pip install oiiotex-studio)")
    pytest.importorskip("uvicorn", reason="NOT RUN: no uvicorn (pip install oiiotex-studio)")
    with tempfile.TemporaryDirectory(prefix="oxl") as name:
        folder = Path(name)
        save(pictures.stained(pictures.bricks(64, 64, seed=1)), folder / "photo.png")
        with open(folder / "errors", "wb") as errors:
            words = "photo.png", "--iscolorspace", "srgb_rec709_scene"
            served = Served(folder, *words, runtime=folder, errors=errors)
            yield served, (folder / "errors").read_text
            served.end()
        end_resident(folder)


def test_bytes_that_are_no_request_are_refused_without_a_word(server):
    served, errors = server
    before = memory_of(served.process.pid)
    for number in NUMBERS:
        dice = random.Random(number)
        data = dice.choice(HEADS)
        if dice.random() < 0.5:
            data = broken(dice, data)
        with socket.create_connection(("127.0.0.1", served.port), 10) as raw:
            sent(raw, data, dice)
    from tests.studio.test_live_guard import answer

    assert b" 200 " in answer(served, "GET").splitlines()[0]
    assert memory_of(served.process.pid) - before < GROWN
    assert no_traceback(errors()), errors()


def test_strange_messages_of_a_page_are_refused_in_words(server):
    from tests.studio.test_live_guard import Wire

    served, errors = server
    wire = Wire(served)
    wire.until("hello")
    before = memory_of(served.process.pid)
    for number in NUMBERS:
        dice = random.Random(number)
        asked = strange(dice, dice.choice(ASKED))
        text = json.dumps(asked).encode()
        if dice.random() < 0.3:
            text = broken(dice, text)
        try:
            if dice.random() < 0.3:
                length = len(text) if dice.random() < 0.7 else dice.choice((0, 5, 2**31, 2**32 - 1))
                wire.send(struct.pack("<I", length) + text + dice.randbytes(dice.choice((0, 4, 4096))), kind=2)
            elif dice.random() < 0.05:
                wire.socket.sendall(dice.randbytes(dice.choice((1, 2, 10, 100))))
                wire.socket.shutdown(socket.SHUT_WR)
                wire = Wire(served)
            else:
                wire.send(text)
            if dice.random() < 0.1:
                wire.socket.close()
                wire = Wire(served)
        except OSError:
            wire = Wire(served)
    for _ in range(600):  # until what was asked for is done, or refused
        wire = Wire(served)
        wire.send(b"{}")
        if "malformed" in wire.until("error")["text"]:
            break
        wire.socket.close()
        time.sleep(0.1)
    else:
        raise AssertionError("it does not go on")
    assert memory_of(served.process.pid) - before < GROWN
    assert no_traceback(errors()), errors()
