# SPDX-License-Identifier: Apache-2.0
"""The page's strip of photos: adding, closing, color spaces, one photo's settings for all, maps of a material."""

from __future__ import annotations

import contextlib
import json
import shlex
import socket
import time
from pathlib import Path

import numpy as np
import pytest
from oiiotex_studio.materials.preview import Looks

from oiiotex.engine.color.srgb import encoded
from oiiotex.oiiotool.service.client import Client
from oiiotex.oiiotool.service.messages import Link
from oiiotex.surfaces.charts.lighting import bilinear
from tests import pictures
from tests.conftest import load, oiiotex, save
from tests.studio.test_live import wait
from tests.studio.test_live_controls import folder, page, state

__all__ = ["folder", "page"]  # fixtures


def chosen(page, *paths: Path) -> None:
    """Files of this computer."""
    page.set_input_files("input[type=file]", list(paths))


def test_photos_are_added_asked_for_their_color_space_and_get_the_settings_of_another(page, folder, tmp_path):
    page.set_viewport_size({"width": 800, "height": 600})
    page.keyboard.press("Escape")
    page.click("#tab-tile")
    save(pictures.pebbles(150, 200, seed=1), tmp_path / "loose.tif", "uint8")
    (tmp_path / "note.txt").write_text("text")
    (tmp_path / "broken.png").write_bytes((tmp_path / "loose.tif").read_bytes()[:300])
    chosen(page, *(tmp_path / name for name in ("note.txt", "broken.png", "loose.tif")))
    page.wait_for_selector("dialog[open] select")
    said = page.inner_text("#status.wrong")
    assert "note.txt: expected an image" in said and "broken.png: " in said
    assert "photo=2" in page.url and page.is_disabled("dialog[open] >> text=Use")  # nothing is guessed
    assert not page.locator("[data-tile]").count() and not (folder / "broken.png").exists()
    page.keyboard.press("Escape")
    page.click("#ask")
    page.select_option("dialog[open] select", label="ACEScg")
    page.click("dialog[open] >> text=Use")
    page.wait_for_selector("[data-tile=whole]")
    wait(page, "document.querySelector('.line').value.includes('loose.tif --iscolorspace ACEScg --tex')")
    coarse = "import('./main.js').then(({ rooms }) => rooms.tile.strip.presets)"
    wait(page, f"{coarse}.then((all) => all.size === 5)")
    assert page.evaluate(f"{coarse}.then((all) => [all.get('').width, all.get('clean').width])") == [128, 192]
    chosen(page, tmp_path / "loose.tif")  # the same again
    wait(page, "document.getElementById('status').textContent === 'This photo is already open'")
    assert [path.name for path in folder.glob("loose*.tif")] == ["loose.tif"]
    page.select_option("select[title^='Large:']", '"large"')
    page.get_by_role("button", name="Apply to all").click()
    wait(page, "document.querySelector('.photo small')?.textContent.startsWith('saved: ')")
    made = folder / page.locator(".photo small").first.inner_text().removeprefix("saved: ")
    page.click(".photo >> nth=0")
    wait(page, "document.getElementById('undo').title === 'Undo: Parameters of loose (Ctrl Z)'")
    assert state(page, "tile.preset") == "large"
    wait(page, "document.querySelector('.line').value.includes('preset=large')")
    line = shlex.split(page.input_value(".line >> nth=0"))
    pixels = load(made)
    made.unlink()
    done = oiiotex(*line[1:-1], made.name, cwd=folder)
    assert done.returncode == 0, done.stderr
    np.testing.assert_array_equal(load(made), pixels)


def clients(folder: Path) -> int:
    """Connections to the resident process of a runtime folder: one for each photo with images there, and this one."""
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    connection.connect(str(next(path for path in folder.rglob("*") if path.is_socket())))
    with contextlib.closing(Client(Link(connection))) as client:
        return int(client.hello()["clients"])


def test_a_closed_photo_leaves_its_pages_and_the_memory_and_its_document_brings_it_back(page, folder):
    first = page.url
    page.click(".photo >> nth=1")
    page.wait_for_selector("[data-tile=whole]")
    wait(page, "document.getElementById('undo').title.startsWith('Undo: preset')")
    other = page.context.browser.new_page()
    other.goto(first)
    other.wait_for_selector("[data-tile=whole]")
    before = clients(folder)
    page.locator(".photo >> nth=1").focus()
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.getAttribute('aria-label')") == "Close loose"
    other.get_by_role("button", name="Close loose").click()
    page.wait_for_url("**/?photo=1*")
    for one in (page, other):
        said = "Closed loose. loose.texlive.json keeps its parameters"
        wait(one, f"document.getElementById('status').textContent === '{said}'")
        assert one.is_hidden("#photos")
    until = time.monotonic() + 20
    while clients(folder) >= before:
        assert time.monotonic() < until
        time.sleep(0.05)
    assert json.loads((folder / "loose.texlive.json").read_text())["tile"]["preset"] == "large"
    other.close()
    page.click("#open")
    page.check("dialog[open] input[value='loose.tif']")
    page.click("dialog[open] >> text=Open >> nth=-1")
    page.wait_for_url("**/?photo=3*")
    wait(page, "document.querySelector('.line')?.value.includes('preset=large')")
    assert state(page, "photo.space") == "ACEScg"


LIT = """async () => {
  const { rooms, shell } = await import("./main.js"), { lit } = rooms.tile;
  const plain = { element: { clientWidth: 240, clientHeight: 200 } };
  lit.maps.delete("height");
  Object.assign(lit, { light: [-0.55, 0.65], stale: true, room: { tileView: plain, shell, tile: rooms.tile.tile } });
  rooms.tile.setMode("lit");
  const copy = new OffscreenCanvas(240, 200).getContext("2d");
  copy.drawImage(lit.lit, 0, 0);
  return [...copy.getImageData(0, 0, 240, 200).data].filter((_, n) => (n >> 2) % 8 == 0 && (n / 960 | 0) % 8 == 0);
}"""


def compare_lit(page, saved: dict[str, np.ndarray]) -> None:
    """The Lit view has the colors of a library's previews, at points of its perspective plane."""
    seen = np.array(page.evaluate(LIT), float).reshape(25, 30, 4)[..., :3]
    normal = (2 * saved["wall_nor_dx_tile.exr"] - 1) * [1, -1, 1]
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    rough, metal, ao = saved["wall_rough_tile.png"][..., :1] / 255, np.zeros((1, 1, 1)), np.ones((1, 1, 1))
    looks = Looks(np.clip(saved["wall_color_tile.exr"], 0, 1), normal, rough, metal, ao)
    eye = np.array([0, -1.5, 1.9])
    ahead, right = -eye / np.linalg.norm(eye), np.array([1.0, 0, 0])
    y, x = np.mgrid[:200:8, :240:8]
    rays = ahead + 0.55 * ((2 * x[..., None] - 239) * right + (199 - 2 * y[..., None]) * np.cross(right, ahead)) / 200
    places = eye[:2] - rays[..., :2] * (eye[2] / rays[..., 2:])
    height, width = normal.shape[:2]
    expected = np.zeros_like(seen)
    for at in np.ndindex(*seen.shape[:2]):
        u, v = (places[at] * [1, -1] * max(height, width) / [width, height] + 0.5)[:, None]
        color = looks.seen(u, v, bilinear(normal, u, v), tuple(-rays[at]))
        expected[at] = 255 * encoded(color)[0]
    assert np.abs((seen - expected).mean((0, 1))).max() < 1 and np.median(np.abs(seen - expected)) < 1  # of 255


def test_maps_of_a_material_are_shown_and_saved_together(page, folder, tmp_path):
    color = pictures.pebbles(48, 64, seed=2)
    save(color, tmp_path / "wall_color.exr", "half", "lin_rec709_scene")
    maps = {
        "wall_height.exr": color[..., :1],
        "wall_nor_dx.exr": color * 0.2 + [0.4, 0.4, 0.8],
        "wall_rough.png": color[..., :1],
    }
    for name, pixels in maps.items():
        save(np.clip(pixels, 0, 1), tmp_path / name, "uint8" if name.endswith("png") else "half")
    chosen(page, *tmp_path.iterdir())
    page.wait_for_selector("[data-maps='3']")
    assert page.locator(".photo[aria-current]").inner_text() == "wall_color (4 maps)"
    page.get_by_role("button", name="Save", exact=True).first.click()
    wait(page, "document.getElementById('status').textContent.startsWith('Saved 4 maps: ')")
    saved = {path.name: load(path) for path in folder.glob("wall_*_tile.*")}
    assert set(saved) == {"wall_color_tile.exr", "wall_height_tile.exr", "wall_nor_dx_tile.exr", "wall_rough_tile.png"}
    assert page.locator("a.download").all_inner_texts() == [f"Download {name}" for name in sorted(saved)]
    for name in saved:
        (folder / name).unlink()
    line = shlex.split(page.input_value(".line >> nth=0"))
    done = oiiotex(*line[1:], cwd=folder)
    assert done.returncode == 0, done.stderr
    for name, pixels in saved.items():
        np.testing.assert_array_equal(load(folder / name), pixels)
    page.get_by_role("button", name="Maps", exact=True).click()
    drawn = "document.querySelector(\"canvas[aria-label='Maps of the material']\").getContext('2d')"
    colors = page.evaluate(f"new Set(new Uint32Array({drawn}.getImageData(0, 0, 200, 200).data.buffer)).size")
    assert colors > 50
    compare_lit(page, saved)
    axe = pytest.importorskip("axe_playwright_python", reason="NOT RUN: pip install oiiotex[test]")
    page.evaluate((Path(axe.__file__).parent / "axe.min.js").read_text())
    page.click("#open")
    page.wait_for_selector("dialog[open] input")
    found = page.evaluate("axe.run().then((all) => all.violations)")
    assert not [one["id"] for one in found if one["impact"] in ("serious", "critical")]
    page.keyboard.press("Escape")
    for width, height in ((800, 600), (1280, 800), (1920, 1080)):
        page.set_viewport_size({"width": width, "height": height})
        for control in page.locator(":is(header, #photos) :is(button, select, a):visible").all():
            box = control.bounding_box()
            assert box["x"] >= 0 and box["x"] + box["width"] <= width, control.inner_text()
