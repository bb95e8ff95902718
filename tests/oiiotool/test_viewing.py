# SPDX-License-Identifier: Apache-2.0
"""--tev, seen by a viewer of the tests that takes tev's packets apart."""

from __future__ import annotations

import socket
import struct
import threading

import numpy as np
import pytest

from oiiotex.engine import errors
from oiiotex.oiiotool.cli.files import viewing
from oiiotex.oiiotool.cli.running.line_run import run
from tests.conftest import save

pytest.importorskip("tevclient", reason="NOT RUN: no tevclient (pip install oiiotex[tev])")


class Viewer:
    """Listens as tev does and keeps what it is shown: name -> (channels, pixels)."""

    def __init__(self):
        self.images, self.updates = {}, 0
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port = self._listening.getsockname()[1]
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _serve(self):
        self._listening.settimeout(30)
        while not self.images:  # the line is looked through before it is run
            connection, _ = self._listening.accept()
            with connection, connection.makefile("rb") as stream:
                while head := stream.read(4):
                    self._take(stream.read(struct.unpack("<I", head)[0] - 4))

    def _take(self, packet):
        kind, rest = packet[0], packet[2:]
        name, rest = rest.split(b"\0", 1)
        if kind == 4:  # CreateImage
            width, height, count = struct.unpack_from("<3i", rest)
            channels = rest[12:].split(b"\0")[:count]
            self.images[name.decode()] = channels, np.full((height, width, count), np.nan, np.float32)
        if kind == 6:  # UpdateImage, by strides
            (count,) = struct.unpack_from("<i", rest)
            *_, rest = rest[4:].split(b"\0", count)
            x, y, width, height = struct.unpack_from("<4i", rest)
            pixels = np.frombuffer(rest[16 + 16 * count :], "<f4").reshape(height, width, count)
            self.images[name.decode()][1][y : y + height, x : x + width] = pixels
            self.updates += 1

    def seen(self):
        self._thread.join(20)
        return self.images


@pytest.fixture
def viewer():
    return Viewer()


def test_an_image_is_shown_band_by_band_in_linear_light_and_written_as_ever(tmp_path, monkeypatch, viewer):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(viewing, "_BAND", 1 << 14)
    gray = np.full((130, 40, 3), 0.5)
    save(gray, tmp_path / "a.png", space="srgb_rec709_scene")
    run(["a.png", "--flip", f"--tev:port={viewer.port}", "-o", "b.png"])
    ((name, (channels, pixels)),) = viewer.seen().items()
    assert (name, channels) == ("a.png", [b"R", b"G", b"B"])
    np.testing.assert_allclose(pixels, 0.214, atol=0.004)
    assert viewer.updates > 3
    assert (tmp_path / "b.png").exists()


def test_ids_and_further_parts_are_shown_as_they_are(tmp_path, monkeypatch, viewer):
    monkeypatch.chdir(tmp_path)
    pixels = np.random.default_rng(0).random((60, 60, 3))
    save(pixels, tmp_path / "a.png", space="srgb_rec709_scene")
    run(["a.png", "--texsuperpixel", f"--tev:port={viewer.port}:name=look"])
    ids = next(shown for name, (_, shown) in viewer.seen().items() if name.startswith("look"))
    assert ids.min() == 1 and ids.max() > 3 and (ids == np.rint(ids)).all()


def test_where_nobody_listens_is_one_line_before_the_work(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save(np.zeros((64, 64, 3)), tmp_path / "a.png", space="srgb_rec709_scene")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    with pytest.raises(errors.Error, match=f"no tev at 127.0.0.1:{port} .*: start tev first"):
        run(["a.png", "--texstationarize", f"--tev:port={port}"])
