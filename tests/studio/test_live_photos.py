# SPDX-License-Identifier: Apache-2.0
"""Photos of the page: which lines and materials they are opened as, and what an upload may do."""

from __future__ import annotations

import asyncio
import errno
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("starlette", reason="NOT RUN: no starlette (pip install oiiotex-studio)")

from oiiotex_studio.api.images import from_array
from oiiotex_studio.live.document import Document, default_state
from oiiotex_studio.live.hub import Hub
from oiiotex_studio.live.option import _photos
from oiiotex_studio.live.pages import Page
from oiiotex_studio.live.photos.opening import OpenPhoto, hub_of, materials_of
from oiiotex_studio.live.photos.strip import PhotoStrip
from oiiotex_studio.live.photos.upload import MOST, Upload, photos_in

from oiiotex.engine.core.image import Image
from oiiotex.engine.errors import Error, MemoryBudgetError
from oiiotex.engine.io.atomic import temporary_beside
from oiiotex.engine.session import Session
from oiiotex.oiiotool.cli.language.parse import parse
from oiiotex.oiiotool.cli.vocabulary import LANGUAGE
from tests.faults import full_disk


def image(name: str) -> Image:
    return Image(from_array(np.zeros((64, 64, 3), np.float32)).parts, name)


@pytest.mark.parametrize(
    ("words", "lines"),
    [
        ("a.png b.png", ["a.png", "b.png"]),
        ("--cache 99 a.png b.png --iscolorspace sRGB", ["--cache 99 a.png", "--cache 99 b.png --iscolorspace sRGB"]),
        ("--cache 99", []),
        ("a.png --flip b.png", ["a.png --flip b.png --pop", "a.png --flip b.png"]),
        ("a.png b.png --over", ["a.png b.png --over"]),
    ],
)
def test_each_image_of_the_line_is_a_photo_with_its_own_line(words, lines):
    line = words.split()
    photos, throughout = _photos([image("x")] * len(lines), line, parse(line, LANGUAGE))
    assert [" ".join(said) for _, said in photos] == lines
    assert throughout == (("--cache", "99") if "--cache" in line else ())


def test_maps_of_one_material_are_opened_together():
    names = [
        "w_rough.png",
        "w_color.png",
        "w_nor_gl.png",
        "b.png",
        "x/w_height.png",
        "c_color.png",
        "d_nor.png",
        "d_rough.png",
    ]
    photos = [OpenPhoto(image(name), ("--cache", "9", name)) for name in names]
    opened = materials_of(photos)
    assert [one.image.source for one in opened] == [
        "w_color.png",
        "b.png",
        "x/w_height.png",
        "c_color.png",
        "d_nor.png",
        "d_rough.png",
    ]
    assert [(one.role, one.kind, one.hand, one.words) for one in opened[0].maps] == [
        ("roughness", "data", "", ("w_rough.png",)),
        ("normal", "normal", "opengl", ("w_nor_gl.png",)),
    ]
    twice = [OpenPhoto(image(name), (name,)) for name in ("w_color.png", "w_albedo.png", "w_rough.png")]
    assert [len(one.maps) for one in materials_of(twice)] == [0, 0, 0]  # which is the color? none is guessed


def test_an_upload_replaces_no_file_and_leaves_nothing_when_it_fails(tmp_path):
    def sent(name: str, data: bytes, size: int | None = None) -> str:
        upload = Upload(tmp_path, name, len(data) if size is None else size)
        return upload.take(data[:2]) or upload.take(data[2:])

    assert [sent("a.png", b"first"), sent("a.png", b"other"), sent("a.png", b"first")] == ["a.png", "a_2.png", "a.png"]
    assert (tmp_path / "a.png").read_bytes() == b"first"
    (tmp_path / "link.png").symlink_to(tmp_path / "elsewhere")
    assert sent("link.png", b"third") == "link_2.png" and not (tmp_path / "elsewhere").exists()
    for name, size in (
        ("../a.png", 5),
        (".a.png", 5),
        ("a.txt", 5),
        ("a\n.png", 5),
        ("b.png", MOST + 1),
        ("b.png", 0),
        ("b.png", 3),
    ):
        with pytest.raises(Error, match="expected"):
            sent(name, b"12345", size)
    unfinished = Upload(tmp_path, "c.png", 9)
    assert unfinished.take(b"1") == ""
    unfinished.discard()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.png", "a_2.png", "link.png", "link_2.png"]
    assert photos_in(tmp_path) == ["a.png", "a_2.png", "link_2.png"]


def test_a_photo_beyond_the_memory_is_refused_before_it_is_read(tmp_path):
    photo = OpenPhoto(image("p.png"), ("p.png",))
    with pytest.raises(MemoryBudgetError, match=r"p\.png needs 1 MB"):
        hub_of(photo, Session(budget=1000), tmp_path)


def test_photos_of_one_name_have_a_document_each(tmp_path):
    def opened(source: str) -> str:
        hub = hub_of(OpenPhoto(image(source), (source,)), Session(), tmp_path, taken=taken)
        hub.document.change("tile", {"seed": 1})
        hub.document.save()
        taken.append(hub.document.path)
        return hub.document.path.name

    taken: list[Path] = []
    assert [opened("p/a.png"), opened("q/a.png")] == ["a.texlive.json", "a_2.texlive.json"]


KILLED = """
import contextlib, os, signal
from pathlib import Path
from oiiotex_studio.api import files
from oiiotex_studio.live import document
from oiiotex_studio.live.numbered import make_folder

@contextlib.contextmanager
def killed(path):
    with files.written(path) as file, files.written(path.with_name("photo.masks") / "000001.png"):
        file.write(b"half")
        yield file
        os.kill(os.getpid(), signal.SIGKILL)

make_folder(Path("photo.masks"), "masks")
document.written = killed
path = Path("photo.texlive.json")
made = document.Document(path, document.default_state("d", "v", 256), "photo.png", {"d": ["v"]})
made.change("tile", {"seed": 7})
made.save()
"""


def test_what_a_killed_page_leaves_is_removed_when_its_document_is_opened(tmp_path):
    ended = subprocess.run([sys.executable, "-c", KILLED], cwd=tmp_path)
    assert ended.returncode == -signal.SIGKILL

    def left() -> list[str]:
        return [path.name for path in tmp_path.rglob(".*")]

    assert len(left()) == 2 and not (tmp_path / "photo.texlive.json").exists()
    with temporary_beside(tmp_path / "photo.png") as living:  # as of an upload on another page
        Document(tmp_path / "photo.texlive.json", default_state("d", "v", 256), "photo.png", {"d": ["v"]})
        assert left() == [living.name]
    assert left() == [] and sorted(os.listdir(tmp_path)) == ["photo.masks", "photo.png"]


def test_a_photo_whose_work_cannot_be_saved_stays_open(tmp_path, monkeypatch):
    async def idle(hub: Hub) -> None:
        pass

    async def close(strip: PhotoStrip, key: str) -> None:
        strip.answer(page, {"do": "close", "key": key}, b"")
        while strip._tasks:
            await asyncio.wait(strip._tasks)

    async def work() -> None:
        strip = PhotoStrip(Session(), tmp_path)
        keys = strip.open([OpenPhoto(image(name), (name,)) for name in ("a.png", "b.png")])
        strip.start()
        hub = strip.hubs[keys[0]]
        hub.document.change("tile", {"seed": 7})
        with monkeypatch.context() as patch:
            full_disk(patch, errno.ENOSPC)
            await close(strip, keys[0])
        assert told[-1]["text"].startswith("a stays open. Not saved: ") and strip.hubs[keys[0]] is hub
        await close(strip, keys[0])
        assert list(strip.hubs) == keys[1:] and "Closed a." in told[-1]["text"]
        (again,) = strip.open([OpenPhoto(image("a.png"), ("a.png",))])  # its document is free, and its key is new
        assert strip.hubs[again].document.state["tile"]["seed"] == 7 and again not in keys
        await strip.end()

    page, told = Page(None), []
    monkeypatch.setattr(page, "tell", lambda text: told.append(json.loads(text)))
    monkeypatch.setattr(Hub, "warm_up", idle)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    asyncio.run(work())
