# SPDX-License-Identifier: Apache-2.0
"""The resident process: the same pixels, urgent jobs first, nothing lost or left behind whoever dies."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from concurrent.futures import CancelledError
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from oiiotex.engine.core.image import Image, from_array, tagged
from oiiotex.engine.core.window import Window
from oiiotex.engine.errors import Error
from oiiotex.engine.session import Session
from oiiotex.oiiotool.service.client import BRUSH, EXPORT, Client, connect
from oiiotex.oiiotool.service.frames import _of_host
from oiiotex.oiiotool.service.messages import Link, LinkError
from oiiotex.oiiotool.service.pictures import facts_of, image_facts, image_of
from oiiotex.oiiotool.service.settings import ResidentSettings
from tests import pictures

SETTINGS = ResidentSettings(budget=1 << 30, idle=30)
SPACE = "srgb_rec709_scene"
SMALL = {"size": "64x64", "sigma": 6, "histogram": 0.7}
LONG = SMALL | {"iterations": 1000, "size": "256x256"}


@pytest.fixture(scope="module")
def folder() -> Iterator[Path]:
    """A short one: sockets' names are."""
    with pytest.MonkeyPatch.context() as patch, contextlib.ExitStack() as stack:
        path = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="oxs")))
        patch.setenv("XDG_RUNTIME_DIR", str(path))
        yield path


@pytest.fixture(scope="module")
def client(folder: Path) -> Iterator[Client]:
    opened = connect(SETTINGS)
    yield opened
    opened.end()


@pytest.fixture(scope="module")
def pixels() -> np.ndarray:
    return pictures.stained(pictures.bricks(80, 96, seed=1)).astype(np.float32)


@pytest.fixture(scope="module")
def photo(client: Client, pixels: np.ndarray) -> int:
    return client.put(image(pixels))


def image(pixels: np.ndarray) -> Image:
    return tagged(from_array(pixels), SPACE)


def wait_for(condition, seconds: float = 20.0) -> None:
    until = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < until
        time.sleep(0.02)


def test_pixels_are_those_of_the_program_and_come_coarse_first(client, photo, pixels):
    looks = []
    reply, (tile,) = client.make(
        "stationarize", [photo], SMALL | {"seed": 3}, read="", on_look=lambda *look: looks.append(look)
    ).result(60)
    same = filters.stationarize(pixels, size=(64, 64), sigma=6, histogram=0.7, seed=3, colorspace=SPACE)
    np.testing.assert_array_equal(tile, same.get_pixels(oiio.FLOAT))
    assert [whole for _, whole in looks] == [False] * (len(looks) - 1) + [True]
    sizes = [look.shape[0] for look, _ in looks]
    assert len(looks) > 3 and sizes == sorted(sizes)
    np.testing.assert_array_equal(looks[-1][0], tile)
    made = reply["images"][0]
    assert made["parts"][0]["place"][:4] == [0, 0, 64, 64]
    window = client.read(made["number"], Window(8, 16, 40, 20)).result(20)[1][0]
    np.testing.assert_array_equal(window, tile[16:20, 8:40])


def test_what_is_remembered_is_bounded_by_bytes_and_forgotten_where_nothing_is_kept():
    resources, made = Session().resources, []

    def once(key: int) -> np.ndarray:
        return resources.remembered(key, lambda: made.append(key) or np.zeros(100, np.uint8))

    for key in (1, 1):
        once(key)
    assert made == [1, 1]  # a program that ends after its line
    resources.memory = 250
    for key in (2, 3, 2, 4, 2, 3):
        once(key)
    assert made[2:] == [2, 3, 4, 3]  # 3 went for 4: 2 was used after it


def test_the_first_look_is_enough_where_it_is_asked_for(client, photo):
    reply, (look,) = client.make("stationarize", [photo], LONG, until="look").result(60)
    assert reply["images"] == [] and 0 < look.shape[0] <= 256


def test_measures_and_warnings_come_with_the_result(client, photo):
    reply, _ = client.make("stationarize", [photo], SMALL, measure=True).result(60)
    assert any("seam" in text for _, text in reply["log"])


def test_images_travel_as_they_are():
    part = from_array(np.arange(24, dtype=np.uint16).reshape(2, 3, 4)).first

    def change(spec: oiio.ImageSpec) -> None:
        spec.x, spec.full_x, spec.alpha_channel = 5, -7, 3
        spec.channelnames = ("R", "G", "B", "depth.Z")
        spec.attribute("words", 'a "quote" <b>\n')
        spec.attribute("floats", oiio.TypeDesc("float[3]"), (0.1, 2.0, 3.0))

    sent = part.respecced(change)
    got = image_of(image_facts(Image((sent,), "name")), [np.asarray(sent.pixels())])
    assert facts_of(got.first) == facts_of(sent) and got.source == "name"
    np.testing.assert_array_equal(got.first.pixels(), sent.pixels())


def test_what_is_urgent_is_done_in_between_and_what_is_canceled_ends(client, photo):
    begun = threading.Event()
    export = client.make("stationarize", [photo], LONG, priority=EXPORT, on_progress=lambda *_: begun.set())
    assert begun.wait(30)
    client.make("stationarize", [photo], SMALL, priority=BRUSH).result(30)
    assert not export.done()
    waiting = client.make("stationarize", [photo], SMALL, priority=EXPORT)
    waiting.stop()
    export.stop()
    for request in (waiting, export):
        with pytest.raises(CancelledError):
            request.result(10)


def test_errors_are_in_words(client, photo):
    for op, images, values, text in (
        ("stationarise", [photo], {}, "did you mean 'stationarize'"),
        ("stationarize", [photo], {"sigma": 0}, "sigma=0: expected a number from 0.5 to 1000000 px"),
        ("stationarize", [], {}, "takes 1 image"),
        ("stationarize", [10**6], {}, "unknown image 1000000"),
    ):
        with pytest.raises(Error, match=text):
            client.make(op, images, values).result(30)


def test_a_client_that_dies_takes_its_jobs_with_it(client, folder):
    line = """
import sys, time
import numpy as np
from oiiotex.oiiotool.service.client import connect
from tests.oiiotool.test_service import LONG, SETTINGS, image
client = connect(SETTINGS)
client.make("stationarize", [client.put(image(np.random.default_rng(1).random((96, 96, 3), np.float32)))], LONG,
            on_progress=lambda *_: print("at work", flush=True))
time.sleep(100)
"""
    with subprocess.Popen([sys.executable, "-c", line], stdout=subprocess.PIPE, cwd=Path(__file__).parents[2]) as other:
        assert other.stdout.readline() == b"at work\n"
        assert client.hello()["clients"] == 2
        other.kill()
    wait_for(lambda: client.hello()["jobs"] == 0 and client.hello()["clients"] == 1)


def test_nonsense_ends_its_connection_alone(client, folder):
    path = str(SETTINGS.socket())
    for nonsense in (
        b"GET / HTTP/1.1\r\n\r\n",
        b"oxs\x02" + bytes(4),
        b"oxs\x01\xff\xff\xff\xff",
        b"oxs\x01\x02\0\0\0{}",
    ):
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as raw:
            raw.connect(path)
            raw.sendall(nonsense)
            raw.settimeout(10)
            with contextlib.suppress(ConnectionResetError):
                assert raw.recv(1) == b""
    link = Link(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
    link._socket.connect(path)
    for request in ({"do": "dance"}, {"do": "make"}, {"do": "put", "image": {"parts": [{}], "source": ""}}):
        link.send(request | {"id": 1})
        assert link.receive()[0]["state"] == "failed"
    link.close()
    assert client.hello()["pid"]


class Broken:
    """A link to a process that has just been killed: its end has not been heard."""

    def __init__(self):
        self.heard = threading.Event()

    def send(self, facts, arrays=()):
        raise LinkError("the resident process has ended: Broken pipe")

    def receive(self):
        self.heard.wait(60)
        raise LinkError("the resident process has ended")


def test_a_request_to_one_that_was_just_killed_fails_as_a_pending_one():
    link = Broken()
    client = Client(link)
    for _ in range(2):  # the second does not try
        request = client.make("stationarize", [1])
        with pytest.raises(LinkError, match="has ended"):
            request.result(10)
        assert client.ended
    client.drop(1)
    link.heard.set()


def test_one_that_is_killed_is_replaced(folder):
    settings = ResidentSettings(budget=1 << 30, idle=20.5)
    clients: list[Client] = []
    threads = [threading.Thread(target=lambda: clients.append(connect(settings))) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(40)
    pids = {one.hello()["pid"] for one in clients}
    assert len(pids) == 1 and len(clients) == 3
    pending = clients[0].make("stationarize", [clients[0].put(image(np.zeros((64, 64, 3), np.float32)))], LONG)
    os.kill(pids.pop(), signal.SIGKILL)
    with pytest.raises(LinkError, match="has ended"):
        pending.result(10)
    assert clients[0].ended
    again = connect(settings)
    assert again.hello()["clients"] == 1
    again.end()
    wait_for(lambda: not settings.socket().exists())


def test_it_ends_when_nobody_wants_anything(folder):
    settings = ResidentSettings(budget=1 << 30, idle=0.4)
    one = connect(settings)
    pid = one.hello()["pid"]
    time.sleep(1)
    assert one.hello()["pid"] == pid  # somebody is there
    one.close()
    wait_for(lambda: not settings.socket().exists())


def test_a_folder_that_is_open_to_others_is_refused(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    (tmp_path / "oiiotex").mkdir(mode=0o755)
    with pytest.raises(Error, match="expected a private folder"):
        SETTINGS.socket()


def test_numbers_are_rounded_for_hosts_of_8_bits_and_ids_are_cut_off():
    levels, ids = np.array([[[-1], [0.5], [2]]], np.float32), np.array([[[1], [255], [300]]], np.uint32)
    for pixels, exact, wanted in ((levels, False, [0, 128, 255]), (ids, True, [1, 255, 255])):
        part = replace(from_array(pixels).first, exact=exact)
        host = _of_host(pixels, 4, "uint8", False, part)
        np.testing.assert_array_equal(host, [[[one, one, one, 255] for one in wanted]])
