# SPDX-License-Identifier: Apache-2.0
"""The page's server against a hostile page, and the document that it keeps."""

from __future__ import annotations

import asyncio
import base64
import errno
import json
import os
import signal
import socket
import struct
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("starlette", reason="NOT RUN: no starlette (pip install oiiotex-studio)")
pytest.importorskip("uvicorn", reason="NOT RUN: no uvicorn (pip install oiiotex-studio)")

from oiiotex_studio.live.document import Document, default_state
from oiiotex_studio.live.guard import token_for
from oiiotex_studio.live.hub import Hub, PageSource
from oiiotex_studio.live.lines import text_of, word_of

from oiiotex.engine.errors import Error, ParameterError
from oiiotex.engine.io import atomic
from oiiotex.engine.session import Session
from oiiotex.oiiotool.cli.language.parse import split_modifiers
from tests import pictures
from tests.browser import TOKEN, Served, end_resident
from tests.conftest import oiiotex, save
from tests.faults import full_disk

VIEWS = {"d": ["v"], "e": ["w"]}  # of a color config


@pytest.fixture(scope="module")
def served() -> Iterator[Served]:
    with tempfile.TemporaryDirectory(prefix="oxl") as name:
        folder = Path(name)
        save(pictures.stained(pictures.bricks(64, 64, seed=1)), folder / "photo.png")
        (folder / "secret.txt").write_text("secret")
        server = Served(folder, "photo.png", "--iscolorspace", "srgb_rec709_scene", runtime=folder)
        yield server
        assert server.end(signal.SIGHUP) == 129  # as of Ctrl-C, which tests/studio/test_live.py sends
        end_resident(folder)


def answer(served: Served, request: str, path: str = f"/{TOKEN}/", body: bytes = b"", **headers: str) -> bytes:
    """All that a raw request gets; headers by names with _ for -."""
    lines = {"Host": f"127.0.0.1:{served.port}", "Connection": "close"} | {
        k.replace("_", "-"): v for k, v in headers.items()
    }
    head = "".join(f"{name}: {value}\r\n" for name, value in lines.items() if value)
    with socket.create_connection(("127.0.0.1", served.port), 10) as connection:
        connection.sendall(f"{request} {path} HTTP/1.1\r\n{head}\r\n".encode() + body)
        received = b""
        while piece := connection.recv(1 << 16):
            received += piece
        return received


class Wire:
    """A WebSocket of a client that is no browser."""

    def __init__(self, served: Served, path: str = f"/{TOKEN}/wire", **headers: str):
        own = {
            "Host": f"127.0.0.1:{served.port}", "Upgrade": "websocket", "Connection": "Upgrade",
            "Sec-WebSocket-Key": base64.b64encode(os.urandom(16)).decode(), "Sec-WebSocket-Version": "13",
            "Origin": f"http://127.0.0.1:{served.port}",
        } | headers  # fmt: skip
        self.socket = socket.create_connection(("127.0.0.1", served.port), 20)
        head = "".join(f"{name}: {value}\r\n" for name, value in own.items() if value)
        self.socket.sendall(f"GET {path} HTTP/1.1\r\n{head}\r\n".encode())
        self.status = self._line()
        while self._line():
            pass

    def _line(self) -> str:
        line = b""
        while not line.endswith(b"\r\n"):
            piece = self.socket.recv(1)
            if not piece:
                break
            line += piece
        return line.decode().strip()

    def send(self, payload: bytes, kind: int = 1) -> None:
        mask = b"\0\0\0\0"
        length = len(payload)
        size = bytes([0x80 | min(length, 125)]) if length < 126 else bytes([0x80 | 127]) + struct.pack(">Q", length)
        self.socket.sendall(bytes([0x80 | kind]) + size + mask + payload)

    def exactly(self, count: int) -> bytes:
        received = b""
        while len(received) < count:
            piece = self.socket.recv(count - len(received))
            assert piece, "closed"
            received += piece
        return received

    def receive(self) -> tuple[int, bytes]:
        kind, length = self.exactly(2)
        if length >= 126:
            length = int.from_bytes(self.exactly(2 if length == 126 else 8), "big")
        return kind & 15, self.exactly(length)

    def until(self, do: str) -> dict:
        while True:
            kind, payload = self.receive()
            if kind == 1 and json.loads(payload)["do"] == do:
                return json.loads(payload)
            assert kind != 8, payload


def test_who_does_not_know_the_token_or_comes_from_elsewhere_gets_nothing(served):
    own = f"http://127.0.0.1:{served.port}"
    assert b" 200 " in answer(served, "GET").splitlines()[0]
    assert b" 200 " in answer(served, "GET", Origin=own).splitlines()[0]
    for path, headers, status in (
        ("/", {}, 403),
        ("/wire", {}, 403),
        (f"/{TOKEN[:-1]}/", {}, 403),
        (f"/{TOKEN}x/", {}, 403),
        (f"/{TOKEN}", {}, 403),
        (f"/{TOKEN}/", {"Host": "evil.example"}, 421),
        (f"/{TOKEN}/", {"Host": f"127.0.0.1.evil.example:{served.port}"}, 421),
        (f"/{TOKEN}/", {"Origin": "http://evil.example"}, 403),
        (f"/{TOKEN}/", {"Origin": "null"}, 403),
        (f"/{TOKEN}/", {"Origin": f"http://127.0.0.1:{served.port + 1}"}, 403),
    ):
        got = answer(served, "GET", path, **headers)
        assert int(got.split()[1]) == status, (path, headers)
        assert got.partition(b"\r\n\r\n")[2] == b""


def test_no_file_but_the_pages_own(served):
    for path in (
        "../photo.png",
        "..%2fphoto.png",
        "secret.txt",
        "%2e%2e/secret.txt",
        "/etc/passwd",
        "page",
        "main.js/..",
        "\\..\\x",
    ):
        got = answer(served, "GET", f"/{TOKEN}/{path}")
        assert int(got.split()[1]) in (403, 404), path
        assert b"secret" not in got and b"PNG" not in got
    policy = answer(served, "GET", f"/{TOKEN}/main.js").partition(b"\r\n\r\n")[0].decode()
    assert "default-src 'none'" in policy and "frame-ancestors 'none'" in policy and "nosniff" in policy


def test_nothing_is_uploaded_but_through_the_page(served):
    for method in ("POST", "PUT", "DELETE", "OPTIONS"):
        got = answer(served, method, body=b"x" * 1000, Content_Length=str(2 << 30))
        assert int(got.split()[1]) == 405


def test_a_wire_wants_an_origin(served):
    assert " 101 " in Wire(served).status
    for path, headers in (
        (f"/{TOKEN}/wire", {"Origin": ""}),
        (f"/{TOKEN}/wire", {"Origin": "http://evil.example"}),
        ("/wire", {}),
        (f"/{TOKEN}/wire", {"Host": "evil.example", "Origin": "http://evil.example"}),
    ):
        assert " 403 " in Wire(served, path, **headers).status, headers


def test_nonsense_on_the_wire_is_refused_in_words_and_a_flood_closes_it(served):
    wire = Wire(served)
    wire.until("hello")
    for nonsense in (
        b"{}", b"[", b"[]", b'{"do":"set"}', b'{"do":"dance","room":"tile"}', b'{"do":"set","room":"tile","values":[]}',
        b'{"do":"brush","room":"tile","name":"../../x"}', b'{"do":"tiles","room":"zoom","tiles":[[99,"0","0"]]}',
        b'{"do":"tiles","room":"zoom","tiles":[[1,"1e9",0]]}',
        b'{"do":"seeds","room":"tile","first":"x","count":1}',
        b'{"do":"bring","room":"paint","name":"../secret.png"}', b'{"do":"bring","room":"paint","name":["photo.png"]}',
        b'{"do":"bring","room":"paint","name":"secret.txt"}',
        b"[" * 100000,
    ):  # fmt: skip
        wire.send(nonsense)
        assert wire.until("error")["text"], nonsense
    for values in (
        '{"sigma":-1}',
        '{"sigma":1e999}',
        '{"mask":"../x"}',
        '{"nonsense":1}',
        '{"seed":1.5}',
        '{"measure":"x"}',
    ):
        wire.send(f'{{"do":"set","room":"tile","values":{values}}}'.encode())
        text = wire.until("error")["text"]
        assert "expected" in text or "unknown parameter 'nonsense'" in text or "malformed" in text, values
    for short in (b"", b"\xff\xff\xff\xff", struct.pack("<I", 10) + b"{}"):
        wire.send(short, kind=2)
        assert "malformed" in wire.until("error")["text"]
    wire.socket.sendall(bytes([0x82, 0xFF]) + struct.pack(">Q", 2 << 30) + b"\0\0\0\0" + bytes(1000))
    with pytest.raises((AssertionError, ConnectionError)):
        while wire.receive()[0] != 8:
            pass
        raise AssertionError
    assert " 101 " in Wire(served).status


def test_a_page_that_asks_for_too_much_waits(served):
    wire = Wire(served)
    wire.until("hello")
    for _ in range(300):
        wire.send(b'{"do":"open","room":"paint"}')
    while "too many requests" not in wire.until("error")["text"]:
        pass
    wire.socket.close()


def test_a_thousand_requests_change_nothing(served):
    start = time.monotonic()
    wires = [Wire(served) for _ in range(40)]  # more than pages may be
    for n in range(1000):
        if n % 4 == 0:
            assert b" 403 " in answer(served, "GET", "/guess/")[:20]
    told = [wire.until("error")["text"] for wire in wires[16:]]
    assert set(told) == {"16 tabs are open already: close one of them, and this one connects"}
    for wire in wires:
        wire.socket.close()
    assert time.monotonic() - start < 60
    deadline = time.monotonic() + 10
    while True:  # those pages are let go, and there is room again
        wire = Wire(served)
        if json.loads(wire.receive()[1])["do"] == "hello":
            break
        assert time.monotonic() < deadline
        time.sleep(0.05)


def test_beyond_this_machine_a_token_is_demanded():
    assert len(token_for("127.0.0.1", "")) >= 32 and token_for("127.0.0.1", "") != token_for("127.0.0.1", "")
    with pytest.raises(ParameterError, match="the connection is not encrypted"):
        token_for("0.0.0.0", "")
    with pytest.raises(ParameterError, match="16 letters"):
        token_for("0.0.0.0", "short")
    assert token_for("0.0.0.0", TOKEN) == TOKEN


def test_a_document_is_reopened_and_anothers_refused(tmp_path):
    state = default_state("d", "v", 256)
    path = tmp_path / "x.texlive.json"
    document = Document(path, json.loads(json.dumps(state)), "photo.png", VIEWS)
    assert document.change("tile", {"seed": 7, "sigma": 8}) == {"seed": 7, "sigma": 8.0}
    assert document.change("tile", {"seed": 7}) == {}
    document.save()
    again = Document(path, json.loads(json.dumps(state)), "photo.png", VIEWS)
    assert again.state == document.state and again.state["tile"]["seed"] == 7
    with pytest.raises(Error, match=r"belongs to photo\.png, not to other\.png"):
        Document(path, state, "other.png", VIEWS)
    content = json.loads(path.read_text())
    for changed, text in (
        ({"oiiotex.live": 2}, "version 2"),
        ({"tile": {"sigma": "x"}}, r"x\.texlive\.json: tile.sigma: expected a number from 0.5 to 1000000, not 'x'"),
    ):
        path.write_text(json.dumps(content | changed))
        with pytest.raises(Error, match=text):
            Document(path, json.loads(json.dumps(state)), "photo.png", VIEWS)
    path.write_text("{}")
    with pytest.raises(Error, match="is not a document of --texlive"):
        Document(path, state, "photo.png", VIEWS)


def test_autosave_goes_on_after_a_full_disk_and_keeps_the_last_state(tmp_path, monkeypatch):
    path, left, told = tmp_path / "x.texlive.json", tmp_path / "spare.json", []
    state = default_state("d", "v", 256)

    def opened() -> Document:
        return Document(path, json.loads(json.dumps(state)), "photo.png", VIEWS, left)

    hub = Hub(PageSource(None, "", (), "x", None, 256, "uint8"), opened(), Session(), tmp_path)
    monkeypatch.setattr(hub, "tell", told.append)
    monkeypatch.setattr("oiiotex_studio.live.hub.SAVE_EVERY", 0.01)
    monkeypatch.setattr("oiiotex_studio.live.hub.RETRY_EVERY", 0.01)

    async def until(condition: Callable[[], bool]) -> None:
        async with asyncio.timeout(20):
            while not condition():
                await asyncio.sleep(0.01)

    async def work() -> None:
        saving = asyncio.create_task(hub.autosave())
        for seed, kind in enumerate((errno.ENOSPC, errno.EROFS, errno.EACCES, errno.EDQUOT), 1):
            why = f"{path}: {os.strerror(kind)}. Your work is kept in memory until saving succeeds."
            with monkeypatch.context() as patch:
                full_disk(patch, kind)
                hub.document.change("tile", {"seed": seed, "lattice": 0.1})
                await until(lambda: bool(hub.unsaved))
                hub.document.change("tile", {"lattice": 0.2})
                await asyncio.sleep(0.05)  # it is tried again, and said once
                assert told == [{"do": "unsaved", "text": f"Not saved: {why}"}] and hub.unsaved == f"Not saved: {why}"
            await until(lambda: not hub.unsaved)
            assert told[1:] == [{"do": "unsaved", "text": ""}]
            tile = json.loads(path.read_text())["tile"]
            assert (tile["seed"], tile["lattice"]) == (seed, 0.2)
            told.clear()
        assert not saving.done()
        saving.cancel()

    asyncio.run(work())
    hub.document.change("tile", {"seed": 99})
    with monkeypatch.context() as patch:  # at its end the server tells where it is, and the next one finds it
        real = atomic.temporary_beside
        patch.setattr(atomic, "temporary_beside", lambda to: real(to) if to == left else real(Path("/dev/null/x")))
        with pytest.raises(Error, match=r"Until the next restart of the computer, --texlive .* from .*spare"):
            hub.document.save()
    again = opened()
    assert again.state["tile"]["seed"] == 99 and json.loads(path.read_text())["tile"]["seed"] != 99
    again.save()
    assert json.loads(path.read_text())["tile"]["seed"] == 99 and not left.exists()


def test_views_that_the_config_has_not_are_refused_and_left_out_of_a_document(tmp_path):
    path, state = tmp_path / "x.texlive.json", default_state("d", "v", 256)
    document = Document(path, json.loads(json.dumps(state)), "photo.png", VIEWS)
    for values in ({"display": "x"}, {"view": "x"}, {"display": "e"}, {"display": "d", "view": "w"}):
        with pytest.raises(ParameterError, match="the color config has no view"):
            document.change("view", values)
    assert document.state == state
    assert document.change("view", {"display": "e", "view": "w"}) and document.change("view", {"exposure": 2})
    document.save()
    again = Document(path, json.loads(json.dumps(state)), "photo.png", {"d": ["v"]})
    assert again.state["view"] == {"display": "d", "view": "v", "exposure": 2.0}


def test_what_stands_behind_and_a_port_that_is_taken_are_refused_in_one_line(tmp_path):
    save(np.zeros((16, 16, 3)), tmp_path / "p.png")
    for behind in (["-o", "x.png"], ["--resize", "8x8"], ["q.png"]):
        done = oiiotex("p.png", "--texlive:open=0", *behind, cwd=tmp_path)
        wanted = f"--texlive : {behind[0]} after --texlive never runs: save results on the page"
        assert (done.returncode, done.stderr.strip()) == (1, f"oiiotex ERROR: {wanted}")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        done = oiiotex("p.png", f"--texlive:open=0:port={port}", "--threads", "1", cwd=tmp_path)
    assert done.returncode == 1
    assert done.stderr.startswith(f"oiiotex ERROR: --texlive : cannot listen on port {port} of 127.0.0.1: ")


def test_a_line_says_the_same_numbers():
    for value in (0.1, 1 / 3, 8.0, 1e-7, 123456.789, True, 7, "a:b", "16x16-3+5"):
        word = word_of("--texop", {"name": value, "none": None})
        _, modifiers = split_modifiers(word)
        assert modifiers == {"name": text_of(value)}
        if isinstance(value, float):
            assert float(modifiers["name"]) == value


def test_a_step_after_undo_keeps_what_was_undone_and_a_gesture_is_one_step(tmp_path):
    path, state = tmp_path / "x.texlive.json", default_state("d", "v", 256)
    document = Document(path, json.loads(json.dumps(state)), "photo.png", VIEWS)

    def seen(forward: bool) -> tuple[object, object]:
        assert document.go(forward) is not None
        return document.state["tile"]["seed"], document.state["tile"]["sigma"]

    for gesture, values in enumerate(({"seed": 1}, {"sigma": 4.0}, {"seed": 2})):
        for _ in range(2):  # the second is the same gesture, of the same values
            document.change("tile", values, gesture=gesture)
        document.change("tile", {"flattening": 0.5}, gesture=gesture)
        document.change("tile", {"flattening": None}, gesture=gesture)  # and back: no change
    assert len(document.history.steps) == 3 and document.go(True) is None
    assert [seen(False) for _ in range(2)] == [(1, 4.0), (1, None)]
    document.change("tile", {"seed": 9})
    document.change("zoom", {"x": "5"})  # a place is no step
    document.save()
    document = Document(path, json.loads(json.dumps(state)), "photo.png", VIEWS)
    assert document.history.facts() == {"undo": "seed", "redo": ""}
    assert [seen(False) for _ in range(5)] == [(1, None), (2, 4.0), (1, 4.0), (1, None), (0, None)]
    assert document.go(False) is None and [seen(True) for _ in range(5)][-1] == (9, None)
    content = json.loads(path.read_text())
    for change, text in (
        ({"room": "tile", "name": "seed", "before": 0, "after": -1}, "tile.seed"),
        ({"room": "output", "name": "tile", "before": "", "after": "a.png"}, "output has no such parameter"),
        ({"room": "tile", "name": "x"}, "before is missing"),
    ):
        path.write_text(json.dumps(content | {"history": {"at": 1, "steps": [{"text": "", "changes": [change]}]}}))
        with pytest.raises(ParameterError, match=text):
            Document(path, json.loads(json.dumps(state)), "photo.png", VIEWS)
