# SPDX-License-Identifier: Apache-2.0
"""What was held whole and is looked through in bands: memory does not grow with the image, and bands do not show."""

from __future__ import annotations

import dataclasses
import tracemalloc
from collections.abc import Callable

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex.analysis.labels import content_scan
from oiiotex.engine.core import demand
from oiiotex.engine.core.image import Image, Part, from_pixels
from oiiotex.engine.core.label_map import LabelMap
from oiiotex.engine.core.op import Op
from oiiotex.engine.core.parameters import Size
from oiiotex.engine.core.window import Window
from oiiotex.engine.run import run
from oiiotex.engine.session import Session
from oiiotex.engine.session.resources import Resources
from oiiotex.filters import texpalette
from oiiotex.filters.texcontent import Content
from oiiotex.filters.texcut import Cut
from oiiotex.filters.texpaint import Paint
from oiiotex.filters.texpalette import Palette
from oiiotex.filters.texpreview import Preview
from oiiotex.filters.texquilt import Quilting
from oiiotex.surfaces.charts import content_chart, tile_preview
from oiiotex.synthesis.graphcut import photo as photo_in_tiles
from oiiotex.synthesis.quilting.quilt_job import Quilted


def picture(width: int, height: int) -> Part:
    """A photo that is not held: any window of it."""
    spec = oiio.ImageSpec(width, height, 3, oiio.UINT8)
    spec.attribute("oiio:ColorSpace", "srgb_rec709_scene")

    def fetch(window: Window) -> np.ndarray:
        y, x = np.ogrid[window.top : window.bottom, window.left : window.right]
        return np.stack([x * y % 251 + 0 * x, 7 * x % 256 + 0 * y, (x + 3 * y) % 256], -1).astype(np.uint8)

    return Part("photo", spec, fetch)


def labels(width: int, height: int) -> Part:
    """A label map that is not held."""
    spec = oiio.ImageSpec(width, height, 1, oiio.UINT32)

    def fetch(window: Window) -> np.ndarray:
        y, x = np.ogrid[window.top : window.bottom, window.left : window.right]
        return ((y // 37 * 7 + x // 29 * 3) % 9 + 1).astype(np.uint32)[..., None]

    return Part("label.1", spec, fetch)


def marked(width: int, height: int, **more: object) -> Op:
    return Content(source=Image((picture(width, height), labels(width, height))), patch=16, **more)


def shown(width: int, height: int, **more: object) -> Op:
    return Preview(tile=Image((picture(width, height),)), exemplar=Image((picture(width, height),)), panel=32, **more)


def pixels_of(op: Op, session: Session, rows: int) -> np.ndarray:
    """The op's image, read in bands of so many rows; its columns in two halves."""
    part = run(op, session)[0].image.first
    read = [part.read(window) for window in part.window.cells(-(-part.spec.width // 2), rows)]
    return np.concatenate([np.concatenate(pair, 1) for pair in zip(read[::2], read[1::2], strict=True)])


@pytest.mark.parametrize("op", [marked, shown], ids=["content", "preview"])
def test_memory_does_not_grow_with_the_height(monkeypatch, op: Callable[..., Op]):
    """Of one thread, with small bands; what the cache of pieces holds has a limit of its own."""
    monkeypatch.setattr(demand, "BAND_BYTES", 1 << 18)
    monkeypatch.setattr(content_scan, "_STRIP_PIXELS", 1 << 15)
    monkeypatch.setattr(tile_preview, "AT_ONCE", 1 << 14)

    def peak(height: int) -> int:
        session = Session(threads=1, budget=4 << 20)
        session.resources.cache.limit = 1 << 20
        tracemalloc.start()
        try:
            part = run(op(400, height), session)[0].image.first
            for window in part.window.cells(part.spec.width, 16):
                part.read(window)
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    peak(900)  # what is loaded once is loaded
    low, high = peak(900), peak(5400)
    assert high - low < 1 << 20, f"{low >> 10} and {high >> 10} kB"  # its pixels alone are 5273 kB more


@pytest.mark.parametrize("more", [{}, {"keys": True}], ids=["marked", "keys"])
def test_strips_do_not_show_in_contents(monkeypatch, more: dict[str, bool]):
    at_once = pixels_of(marked(150, 190, **more), Session(), 1000)
    monkeypatch.setattr(content_scan, "_STRIP_PIXELS", 150 * 20)
    monkeypatch.setattr(content_scan, "_STEP", 32)
    monkeypatch.setattr(content_chart, "_ROWS", 3)
    monkeypatch.setattr(Resources, "require", lambda *_: None)
    for threads, budget, rows in ((1, 1 << 10, 7), (3, 1 << 20, 50)):  # a bit for each pixel is 3.6 kB
        seen = pixels_of(marked(150, 190, **more), Session(threads=threads, budget=budget), rows)
        np.testing.assert_array_equal(seen, at_once)


def test_bands_do_not_show_in_previews(monkeypatch):
    at_once = pixels_of(shown(150, 190), Session(), 1000)
    monkeypatch.setattr(Resources, "require", lambda *_: None)
    monkeypatch.setattr(tile_preview, "AT_ONCE", 150 * 3 * 11)
    for budget, rows in ((1 << 12, 5), (1 << 30, 13)):
        np.testing.assert_array_equal(pixels_of(shown(150, 190), Session(budget=budget), rows), at_once)


@pytest.mark.parametrize("op", [Cut, Palette], ids=["cut", "palette"])
def test_photos_in_files_give_the_same(monkeypatch, op: type[Op]):
    """Pixels, coordinates and tables, of a photo with transparent pixels and labels."""
    photo, ids = picture(150, 190), labels(150, 190)
    hidden = np.indices((190, 150)).sum(0) % 41 < 4

    def seen(window: Window) -> np.ndarray:
        alpha = 255 * ~hidden[window.inside(photo.window)]
        return np.concatenate([photo.read(window), alpha[..., None]], -1).astype(np.uint8)

    spec = oiio.ImageSpec(150, 190, 4, oiio.UINT8)
    spec.attribute("oiio:ColorSpace", "srgb_rec709_scene")
    given = Image((Part("photo", spec, seen), ids))
    values = (
        {"label": 3, "size": Size(40, 30), "patch": 12} if op is Cut else {"panel": 16, "maxlabels": 3, "labellevel": 1}
    )
    monkeypatch.setattr(texpalette, "_REACH", 64)
    for module in (texpalette, content_scan):
        monkeypatch.setattr(module, "CELL", 32)
    made = []
    for held in (True, False):
        monkeypatch.setattr(op, "holds_photo", lambda *_, held=held: held)
        parts = run(op(exemplar=given, st=True, **values), Session())[0].image.parts
        made.append([part.pixels() for part in parts])
    for one, other in zip(*made, strict=True):
        np.testing.assert_array_equal(one, other)
    at = np.floor(made[0][1] * (150, 190)).astype(int)
    assert (made[0][0][..., 3] == 255).all() and not hidden[at[..., 1], at[..., 0]].any()
    found = ids.pixels()[at[..., 1], at[..., 0], 0]
    assert (found == 3).all() if op is Cut else [len(np.unique(row)) for row in np.split(found, 3)] == [1, 1, 1]


@pytest.mark.parametrize("op", [Quilting, Paint], ids=["quilt", "paint"])
def test_quilts_of_photos_in_files_are_the_same(monkeypatch, op: type[Quilted]):
    """Pixels, coordinates, labels; colors, own pixels and what seams compare lie in files."""
    ids = labels(150, 190)
    finer = Part("label.1", ids.spec, lambda window: ids.fetch(window) * 2 + 1)
    coarse = dataclasses.replace(ids, name="label.2")
    given = Image((picture(150, 190), finer, coarse))
    painted = Part("painting", oiio.ImageSpec(60, 50, 1, oiio.UINT32), coarse.fetch)
    fine = np.zeros((50, 60, 1), np.uint32)
    fine[20:40, 15:45] = 7
    more = {"painting": Image((painted,)), "fine": Image((from_pixels("fine", fine, painted.spec),))}
    made = []
    for held in (True, False):
        monkeypatch.setattr(Quilted, "holds", lambda *_, held=held: held)
        if not held:
            monkeypatch.setattr(photo_in_tiles, "_PHOTO_BYTES", 1 << 30)
        own = more if op is Paint else {"size": Size(120, 90), "flattening": 0.0}
        use = op(exemplar=given, st=True, labelmaps=True, patch=16, **own)
        made.append([part.pixels() for part in run(use, Session())[0].image.parts])
    assert len(made[0]) == 4
    for one, other in zip(*made, strict=True):
        np.testing.assert_array_equal(one, other)
    at = np.floor(made[0][1] * (150, 190)).astype(int)
    np.testing.assert_array_equal(made[0][0], given.first.pixels()[at[..., 1], at[..., 0]])


def test_a_swatch_is_made_from_where_most_of_its_label_lies(monkeypatch):
    ids = np.ones((700, 500, 1), np.uint32)
    ids[140:150, 130:140], ids[520:640, 300:390] = 2, 2
    part = Part("label.1", oiio.ImageSpec(500, 700, 1, oiio.UINT32), lambda w: ids[w.top : w.bottom, w.left : w.right])
    usable = np.ones((700, 500), bool)
    found = content_scan.fullest_windows(LabelMap(part, 1), usable, [1, 2], 256)
    assert found[1].size == (256, 256) and found[2] & Window(300, 520, 390, 640) == Window(300, 520, 390, 640)
    usable[500:] = False  # the smaller one is left
    assert content_scan.fullest_windows(LabelMap(part, 1), usable, [2], 128)[2] == Window(128, 128, 256, 256)
    areas = content_scan.areas_of(LabelMap(part, 1), usable)
    assert areas[2] == 100 and areas.sum() == 700 * 500
