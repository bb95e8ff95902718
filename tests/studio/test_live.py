# SPDX-License-Identifier: Apache-2.0
"""The page in a real browser: what it shows is what its line makes, to the bit."""

from __future__ import annotations

import base64
import json
import os
import shlex
import shutil
import signal
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("starlette", reason="NOT RUN: no starlette (pip install oiiotex-studio)")
pytest.importorskip("uvicorn", reason="NOT RUN: no uvicorn (pip install oiiotex-studio)")

from oiiotex_studio.live.display import shown_by, usual_view, views

from oiiotex.engine.color.config import ColorConfig, as_float
from tests import pictures
from tests.browser import Served, chromium, copied_text, end_resident, resident_pid, watch_clipboard
from tests.conftest import load, oiiotex, save
from tests.faults import wait_for

SPACE = "srgb_rec709_scene"
PIXELS = """async (name) => {
  const { rooms } = await import("./main.js");
  const shown = { tile: rooms.tile?.tile, photo: rooms.tile?.photo, texture: rooms.paint?.texture };
  const canvas = shown[name] ?? rooms.zoom.tiles.get(name);
  const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  let text = "";
  for (let at = 0; at < data.length; at += 32768) text += String.fromCharCode(...data.subarray(at, at + 32768));
  return [canvas.height, canvas.width, btoa(text)];
}"""
MOVE = """([name, value]) => {
  const row = [...document.querySelectorAll(".row")].find((one) => one.firstChild.textContent === name);
  delete document.querySelector("[data-tile]").dataset.tile;
  const slider = row.querySelector("input[type=range]");
  slider.value = value;
  slider.dispatchEvent(new Event("input"));
}"""


@pytest.fixture(scope="module")
def browser() -> Iterator[object]:
    with chromium() as opened:
        yield opened


@pytest.fixture(scope="module")
def folder() -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="oxl") as name:
        path = Path(name)
        save(pictures.stained(pictures.bricks(96, 112, seed=1)), path / "photo.png")
        save(pictures.pebbles(64, 64, seed=2), path / "pebbles.exr", "half", "lin_rec709_scene")
        document = {
            "exemplars": [{"id": "a", "file": "pebbles.exr"}],
            "root": "a",
            "edges": [{"from": "a", "to": "a", "r": 1}],
        }
        (path / "graph.json").write_text(json.dumps(document))
        yield path
        end_resident(path)


@pytest.fixture
def served(folder) -> Iterator[Served]:
    server = Served(folder, "photo.png", "--iscolorspace", SPACE, runtime=folder)
    yield server
    server.end()
    for made in ("photo.paint", "photo.masks"):
        shutil.rmtree(folder / made, ignore_errors=True)
    for document in folder.glob("photo.*.*"):
        document.unlink()


@pytest.fixture
def page(browser, served) -> Iterator[object]:
    opened = browser.new_page(viewport={"width": 1280, "height": 720})
    errors: list[str] = []
    opened.on("pageerror", lambda error: errors.append(str(error)))
    opened.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
    opened.set_default_timeout(90000)
    opened.goto(served.url)
    opened.wait_for_selector("[data-tile=whole]")
    yield opened
    opened.close()
    assert not [error for error in errors if "WebSocket" not in error and "ERR_CONNECTION" not in error]


def wait(page, condition: str) -> None:
    """Until an expression holds; Playwright's own way evaluates strings, which the page's policy refuses."""
    until = time.monotonic() + 90
    while not page.evaluate(condition):
        assert time.monotonic() < until, condition
        time.sleep(0.2)  # each look costs 4 ms of three processes


def pixels_of(page, name: str) -> np.ndarray:
    height, width, text = page.evaluate(PIXELS, name)
    return np.frombuffer(base64.b64decode(text), np.uint8).reshape(height, width, 4)[..., :3]


def copied_line(page) -> list[str]:
    """The words of the line that the button copies, without a dialog."""
    watch_clipboard(page)
    page.click("#copy")
    return shlex.split(copied_text(page))


def shown_of(words: list[str], folder: Path, space: str) -> np.ndarray:
    """What the page should show of the pixels that a line makes."""
    assert words[0] == "oiiotex"
    done = oiiotex(*words[1:], cwd=folder)
    assert done.returncode == 0, done.stderr
    return shown(folder / words[-1], space)


def shown(path: Path, space: str) -> np.ndarray:
    """What the page should show of a file."""
    config = ColorConfig()
    return shown_by(config, space, *usual_view(config, space))(as_float(load(path))[..., :3])


# what the tile has been, one after another: a coarse one is soon over
WATCH = """() => {
  const element = document.querySelector("[data-tile]");
  window.shown = [];
  new MutationObserver(() => shown.push(element.dataset.tile)).observe(element, { attributes: true });
}"""


def test_a_tile_is_tuned_and_its_line_makes_the_same_pixels(page, folder):
    page.evaluate(WATCH)
    page.evaluate(MOVE, ["Sigma", 0.4])
    wait(page, "shown.includes('whole')")
    assert "coarse" in page.evaluate("shown")
    words = copied_line(page)
    assert any(":sigma=12.1" in word for word in words), words
    np.testing.assert_array_equal(pixels_of(page, "tile"), shown_of(words, folder, SPACE))
    wait(page, "document.querySelector('.measures').textContent.includes('seam ratio')")
    assert page.locator(".measures > p.good").count() >= 3
    page.click(".measures summary")
    rows = [one.split("\t") for one in page.inner_text(".measures table").splitlines()]
    assert rows[0] == ["Measure", "Photo", "Tile"]
    assert {"seam ratio x", "seam ratio y", "texture cost"} <= {row[0] for row in rows}
    assert all(float(value.rstrip(" %")) >= 0 for row in rows if row[0].startswith("seam") for value in row[1:])
    line_made = load(folder / words[-1])
    page.get_by_role("button", name="Save", exact=True).click()
    wait(page, "document.getElementById('status').textContent.startsWith('Saved as')")
    saved = page.inner_text("#status").removeprefix("Saved as ")
    assert saved == "photo_tile_2.png"
    np.testing.assert_array_equal(load(folder / saved), line_made)
    page.keyboard.press("s")
    wait(page, "document.querySelector('[data-tile]').dataset.tile === 'coarse'")
    page.wait_for_selector("[data-tile=whole]")
    words = copied_line(page)
    assert any(":seed=1" in word for word in words)
    np.testing.assert_array_equal(pixels_of(page, "tile"), shown_of(words, folder, SPACE))


def test_a_display_without_the_view_that_is_chosen_shows_one_of_its_own(page, folder):
    config = ColorConfig()
    pixels = as_float(load(folder / "photo.png"))[..., :3]
    of_both, of_one = "Un-tone-mapped", "ACES 2.0 - SDR 100 nits (Rec.709)"
    displays = "sRGB - Display", "Display P3 - Display"
    theirs = views(config)[displays[1]]
    assert of_one in views(config)[displays[0]] and of_one not in theirs and of_both in theirs
    for before, after in ((of_both, of_both), (of_one, theirs[0])):
        page.select_option("select[aria-label=Display]", json.dumps(displays[0]))
        page.select_option("select[aria-label=View]", json.dumps(before))
        page.select_option("select[aria-label=Display]", json.dumps(displays[1]))
        assert page.input_value("select[aria-label=View]") == json.dumps(after)
        assert page.locator("select[aria-label=View] option").all_inner_texts() == theirs
        wanted = shown_by(config, SPACE, displays[1], after)(pixels)
        until = time.monotonic() + 30
        while not np.array_equal(pixels_of(page, "photo"), wanted):
            assert time.monotonic() < until
        assert not page.locator("#status.wrong").count()


def test_a_painted_mask_is_in_the_line(page, folder):
    page.keyboard.press("p")
    view = page.locator("canvas[aria-label=Photo]").bounding_box()
    middle = [view["x"] + view["width"] / 2, view["y"] + view["height"] / 2]
    page.mouse.move(middle[0] - 150, middle[1] - 100)
    page.mouse.down()
    for n in range(12):
        page.mouse.move(middle[0] - 150 + 30 * n, middle[1] - 100 + 20 * (n % 6), steps=2)
    page.evaluate("delete document.querySelector('[data-tile]').dataset.tile")
    page.mouse.up()
    page.wait_for_selector("[data-tile=whole]")
    wait(page, "document.body.dataset.busy === 'false'")
    words = copied_line(page)
    assert any("mask=photo.masks/000001.png" in word for word in words), words
    mask = load(folder / "photo.masks" / "000001.png")
    assert set(np.unique(mask)) == {0, 255} and 0.05 < (mask == 255).mean() < 0.9
    np.testing.assert_array_equal(pixels_of(page, "tile"), shown_of(words, folder, SPACE))


@pytest.mark.slow
def test_a_painted_area_is_filled(page, folder):
    page.keyboard.press("p")
    page.locator("button", has_text="Replace").click()
    view = page.locator("canvas[aria-label=Photo]").bounding_box()
    page.mouse.move(view["x"] + view["width"] / 2, view["y"] + view["height"] / 2)
    page.mouse.down()
    page.mouse.move(view["x"] + view["width"] / 2 + 40, view["y"] + view["height"] / 2, steps=3)
    page.mouse.up()
    page.evaluate("delete document.querySelector('[data-tile]').dataset.tile")
    page.evaluate("import('./main.js').then(({ shell }) => shell.set('tile', { fill: 'brush' }))")
    page.wait_for_selector("[data-tile=whole]")
    wait(page, "document.body.dataset.busy === 'false'")
    words = copied_line(page)
    assert "--texfill" in words and any("photo.masks" in word for word in words), words
    np.testing.assert_array_equal(pixels_of(page, "tile"), shown_of(words, folder, SPACE))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"mask": "dominant"}, ":mask=dominant"),
        ({"mask": 1}, ":label=1"),
        ({"evenness": 0.7}, ":evenness=0.7"),
        ({"preset": "clean"}, ":preset=clean"),
        ({"measure": "moments", "patch": 7, "width": 80, "height": 64, "lattice": 0, "histogram": 0.3}, ":size=80x64"),
    ],
    ids=lambda value: None if isinstance(value, str) else next(iter(value)),
)
def test_whatever_is_chosen_the_line_makes_the_same_pixels(page, folder, values, said):
    page.evaluate("delete document.querySelector('[data-tile]').dataset.tile")
    page.evaluate("(values) => import('./main.js').then(({ shell }) => shell.set('tile', values))", values)
    page.wait_for_selector("[data-tile=whole]")
    words = copied_line(page)
    assert any(said in word for word in words), words
    np.testing.assert_array_equal(pixels_of(page, "tile"), shown_of(words, folder, SPACE))


def test_a_stroke_changes_its_neighborhood_alone_and_is_undone_to_the_bit(page, folder):
    page.evaluate("import('./main.js').then(({ shell }) => shell.set('paint', { width: 512, height: 384, brush: 64 }))")
    page.click("#tab-paint")
    page.wait_for_selector("[data-step='0']")
    before = pixels_of(page, "texture")
    assert before.shape == (384, 512, 3)
    having_finer = "[...document.querySelectorAll('.entry')].findIndex((one) => one.querySelector('.within button'))"
    chosen = page.evaluate(having_finer)
    entry = page.locator(".entry").nth(chosen)  # the first label with finer ones
    entry.locator(".swatch").first.click()
    view = page.locator("canvas[aria-label=Painting]").bounding_box()
    scale = min((view["width"] - 24) / 512, (view["height"] - 24) / 384)
    corner = view["x"] + (view["width"] - 512 * scale) / 2, view["y"] + (view["height"] - 384 * scale) / 2
    page.mouse.move(corner[0] + 150 * scale, corner[1] + 150 * scale)
    page.mouse.down()
    page.mouse.move(corner[0] + 220 * scale, corner[1] + 180 * scale, steps=5)
    page.wait_for_timeout(400)  # so that it is looked at while it goes on
    page.mouse.move(corner[0] + 235 * scale, corner[1] + 190 * scale)
    wait(page, "import('./main.js').then((m) => !m.rooms.paint.working)")
    assert (pixels_of(page, "texture") != before).any()
    page.mouse.move(corner[0] + 250 * scale, corner[1] + 200 * scale)
    page.mouse.up()
    page.wait_for_selector("[data-step='1']")
    assert len(list((folder / "photo.paint").iterdir())) == 4  # two steps
    after = pixels_of(page, "texture")
    rows, columns = np.nonzero((before != after).any(-1))
    reach = 32 + 2 * 16  # px: half the brush, and patches around it
    assert 150 - reach < columns.min() and columns.max() < 250 + reach
    assert 150 - reach < rows.min() and rows.max() < 200 + reach
    assert len(rows) > 2000
    words = copied_line(page)
    np.testing.assert_array_equal(after, shown_of(words, folder, SPACE))
    page.keyboard.press("Control+z")
    page.wait_for_selector("[data-step='0']")
    np.testing.assert_array_equal(pixels_of(page, "texture"), before)
    page.keyboard.press("Control+Shift+Z")
    page.wait_for_selector("[data-step='1']")
    np.testing.assert_array_equal(pixels_of(page, "texture"), after)
    page.reload()  # painting and history are there
    page.wait_for_selector("[data-step='1']")
    np.testing.assert_array_equal(pixels_of(page, "texture"), after)
    # a finer label, which does not leave the one that it is part of
    entry.locator(".swatch").first.click()
    entry.locator(".within button").first.click()
    page.mouse.move(corner[0] + 100 * scale, corner[1] + 175 * scale)
    page.mouse.down()
    page.mouse.move(corner[0] + 250 * scale, corner[1] + 175 * scale, steps=5)
    page.mouse.up()
    page.wait_for_selector("[data-step='2']")
    refined = pixels_of(page, "texture")
    words = copied_line(page)
    np.testing.assert_array_equal(refined, shown_of(words, folder, SPACE))
    page.keyboard.press("Control+z")
    page.wait_for_selector("[data-step='1']")
    np.testing.assert_array_equal(pixels_of(page, "texture"), after)
    painted = load(folder / "photo.paint" / "000002.fine.png").any(-1)
    coarse = {",".join(map(str, color)) for color in load(folder / "photo.paint" / "000002.png")[painted].tolist()}
    table = json.loads((folder / "photo.palette.json").read_text())
    finer = table["labels"][chosen]["children"][0]
    within = {one["color"] for one in table["labels"] if finer in one["children"]}
    assert np.count_nonzero(painted) > 3000 and coarse <= within
    paint = next(n for n, word in enumerate(words) if word.startswith("--texpaint"))
    words = [*words[1:paint], f"{words[paint]}:labelmaps=1", "-o", "labels.exr"]
    done = oiiotex(*words, cwd=folder)
    assert done.returncode == 0, done.stderr
    labels = load(folder / "labels.exr", table["level"] - 1)[..., 0]  # after the picture comes label.1
    assert (labels[painted] == finer).mean() > 0.8
    # a painting from elsewhere is a step of this one; what was undone stays in the history
    ids = np.full((384, 512, 1), table["labels"][0]["id"])
    ids[100:250, 200:400] = table["labels"][-1]["id"]
    save(ids, folder / "elsewhere.exr", "uint32")
    page.get_by_role("button", name="Open", exact=True).click()
    page.get_by_role("button", name="elsewhere.exr").click()
    page.wait_for_selector("[data-step='3']")
    assert not (folder / "photo.paint" / "000003.fine.png").exists()
    brought = pixels_of(page, "texture")
    assert (brought != after).any(-1)[100:250, 200:400].mean() > 0.9
    np.testing.assert_array_equal(brought, shown_of(copied_line(page), folder, SPACE))
    for step, wanted in ((1, after), (2, refined), (1, after), (0, before)):
        page.keyboard.press("Control+z")
        page.wait_for_selector(f"[data-step='{step}']")
        np.testing.assert_array_equal(pixels_of(page, "texture"), wanted)


def test_two_pages_see_the_same_and_a_killed_server_is_reopened(page, browser, served, folder):
    other = browser.new_page()
    other.goto(served.url)
    other.wait_for_selector("[data-tile=whole]")
    page.select_option("select[title^='Statistics']", json.dumps("moments"))
    wait(other, "document.querySelector(\"select[title^='Statistics']\").value === '\"moments\"'")
    page.keyboard.press("v")
    document = folder / "photo.texlive.json"  # without the last half second
    wait_for(lambda: document.exists() and '"measure": "moments"' in document.read_text(), served.process)
    page.keyboard.press("p")
    view = page.locator("canvas[aria-label=Photo]").bounding_box()
    page.mouse.move(view["x"] + 200, view["y"] + 200)
    page.mouse.down()
    page.mouse.move(view["x"] + 300, view["y"] + 200)
    served.end(signal.SIGKILL)
    page.mouse.up()
    page.wait_for_selector("#link.wrong")
    again = Served(folder, "photo.png", "--iscolorspace", SPACE, live=f":port={served.port}", runtime=folder)
    try:
        for one in (page, other):
            wait(one, "document.getElementById('link').textContent === ''")
            one.wait_for_selector("[data-tile=whole]")
            assert one.input_value("select[title^='Statistics']") == '"moments"'
        os.kill(resident_pid(folder), signal.SIGKILL)  # the one that works: another is started
        other.select_option("select[title^='Statistics']", json.dumps("histogram"))
        measured = "document.querySelector('.measures').textContent.includes('seam ratio')"
        wait(page, f"{measured} && !document.querySelector('.stale')")
    finally:
        other.close()
        again.end()


def test_tiles_of_a_zoom_are_windows_of_a_line_twenty_levels_down(browser, folder):
    server = Served(folder, live=":graph=graph.json", runtime=folder)
    page = browser.new_page(viewport={"width": 900, "height": 600})
    try:
        page.set_default_timeout(90000)
        page.goto(server.url)
        tiles = {}
        for (x, y), count in (((3 << 96, 5 << 96), 3), ((-(12345 << 96), (1 << 110) + 77), 2)):
            page.goto(f"{server.url}#zoom/26/{x}/{y}")  # another place in the address of the open page
            wait(page, f"document.getElementById('place').textContent === 'level 26  {x >> 70}, {y >> 70}'")
            page.wait_for_selector("[data-missing='0']")
            names = page.evaluate("import('./main.js').then((m) => [...m.rooms.zoom.tiles.keys()])")
            new = [name for name in names if name.startswith("26/") and name not in tiles]
            tiles |= {name: pixels_of(page, name) for name in new[-count:]}  # the last drawn
        assert len(tiles) == 5
        words = []
        for number, (level, x, y) in enumerate(tuple(map(int, name.split("/"))) for name in tiles):
            window = f"256x256{256 * x:+d}{256 * y:+d}"
            words += [f"--texsynth:graph=graph.json:lod={level}:window={window}", "-o", f"tile{number}.exr"]
        done = oiiotex(*words, cwd=folder)
        assert done.returncode == 0, done.stderr
        for number, pixels in enumerate(tiles.values()):
            np.testing.assert_array_equal(pixels, shown(folder / f"tile{number}.exr", "lin_rec709_scene"))
        words = copied_line(page)
        assert any(":window=" in word and ":lod=26" in word for word in words)
        number = page.get_by_label("Jitter (number)")
        number.fill("0.3")
        number.press("Enter")
        page.keyboard.press("Escape")
        assert any(":jitter=0.3" in word for word in copied_line(page))
        for keys in ("k", "PageDown", "PageDown", "k"):
            page.keyboard.press(keys)
        watch_clipboard(page)
        page.keyboard.press("p")
        words = shlex.split(copied_text(page))
        assert words[3:5] == ["--frames", "1-96"] and "speed=0.021052632" in words[5], words
    finally:
        page.close()
        server.end()
