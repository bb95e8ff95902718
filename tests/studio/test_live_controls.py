# SPDX-License-Identifier: Apache-2.0
"""The page's controls: what they save, refuse, undo and show, at the sizes of small and large screens."""

from __future__ import annotations

import contextlib
import shlex
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("starlette", reason="NOT RUN: no starlette (pip install oiiotex-studio)")

from oiiotex_studio.api.images import Image, from_array
from oiiotex_studio.api.measures import region_uses

from tests import pictures
from tests.browser import Served, chromium, end_resident
from tests.conftest import load, oiiotex, save
from tests.studio.test_live import wait

STATE = "import('./main.js').then(({{ shell }}) => shell.state.{})"


@pytest.fixture(scope="module")
def folder() -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="oxc") as name:
        path = Path(name)
        save(pictures.pebbles(64, 80, seed=2), path / "photo.exr", "half", "lin_rec709_scene")
        yield path
        end_resident(path)


@pytest.fixture(scope="module")
def page(folder) -> Iterator[object]:
    server = Served(folder, "photo.exr", runtime=folder)
    with server_end(server), chromium() as browser:
        opened = browser.new_page(viewport={"width": 800, "height": 600})
        opened.set_default_timeout(90000)
        opened.goto(server.url)
        opened.wait_for_selector("[data-tile=whole]")
        yield opened


@contextlib.contextmanager
def server_end(server: Served) -> Iterator[None]:
    try:
        yield
    finally:
        server.end()


def state(page, name: str) -> object:
    return page.evaluate(STATE.format(name))


NOTED = """() => {
  window.noted = [];  // all texts of the status
  const added = (changes) => changes.flatMap((one) => [...one.addedNodes]);
  const take = (changes) => noted.push(...added(changes).map((node) => node.textContent));
  new MutationObserver(take).observe(document.getElementById("status"), { childList: true });
}"""


def test_a_file_that_is_saved_while_it_is_made_equals_its_line_in_the_type_that_is_chosen(page, folder):
    wait(page, "document.querySelector('.measures p.good')")
    wait(page, "document.getElementById('progress').hidden")
    for name, pixel_type in (("", "half"), ("wall.exr", "float")):
        page.fill("input[type=text] >> nth=0", name)
        page.locator("input[type=text] >> nth=0").blur()
        page.get_by_label("Type").first.select_option('""' if pixel_type == "half" else f'"{pixel_type}"')
        page.evaluate(NOTED)
        page.keyboard.press("s")
        page.keyboard.press("v")
        page.get_by_role("button", name="Save", exact=True).first.click()
        wait(page, "noted.some((text) => text.startsWith('Saved as'))")
        assert "The tile will be saved when it is finished" in page.evaluate("noted")
        line = shlex.split(page.input_value(".line >> nth=0"))
        assert line[-4:] == ["-d", pixel_type, "-o", name or "photo_tile.exr"]
        saved = load(folder / line[-1])
        (folder / line[-1]).unlink()
        done = oiiotex(*line[1:], cwd=folder)
        assert done.returncode == 0, done.stderr
        np.testing.assert_array_equal(load(folder / line[-1]), saved)
    assert len(state(page, "variants.list")) == 2
    with page.expect_download() as waiting:
        page.click("a.download >> nth=0")
    assert Path(waiting.value.path()).read_bytes() == (folder / "wall.exr").read_bytes()
    page.fill("input[type=text] >> nth=0", "../wall.exr")
    page.locator("input[type=text] >> nth=0").blur()
    assert "expected a name without a folder" in page.inner_text("#status.wrong")
    assert state(page, "output.tile") == "wall.exr"


def test_numbers_out_of_range_are_refused_and_automatic_values_are_those_in_effect(page):
    width, height = page.get_by_label("Width").first, page.get_by_label("Height").first
    assert (width.get_attribute("placeholder"), height.get_attribute("placeholder")) == ("80", "64")
    width.fill("3")
    width.blur()
    assert page.inner_text("#status.wrong") == "Width: 3: expected an integer from 16 to 16384"
    assert width.input_value() == "" and state(page, "tile.width") is None
    width.fill("48")
    width.blur()
    assert state(page, "tile.height") is None and height.get_attribute("placeholder") == "64"
    wait(page, "document.querySelector('.line').value.includes('size=48x64')")
    patch = page.locator("select[title^='Patch size'] option").first
    for preset, shown in (("large", "21 px"), ("even", "11 px"), (None, "13 px")):
        page.select_option("select[title^='Large:']", f'"{preset}"' if preset else "null")
        assert patch.inner_text() == f"Automatic ({shown})"


def dab(page) -> None:
    """Paint one spot of the photo."""
    view = page.locator("canvas[aria-label=Photo]").bounding_box()
    page.mouse.move(view["x"] + view["width"] / 2, view["y"] + view["height"] / 2)
    page.mouse.down()
    page.mouse.up()


def marked(page) -> int:
    """Pixels of the painted mask."""
    counted = "rooms.tile.regions.planes.mask?.reduce((n, v) => n + (v > 0), 0) ?? 0"
    return page.evaluate(f"import('./main.js').then(({{ rooms }}) => {counted})")


def test_parameters_and_masks_have_one_history_that_survives_the_page(page, folder):
    seed = page.get_by_label("Seed", exact=True).first
    seed.fill("7")
    seed.blur()
    title = "Undo: seed (Ctrl Z)"
    wait(page, f"document.getElementById('undo').title === {title!r}")  # all earlier changes have arrived
    before = {name: state(page, f"tile.{name}") for name in ("flattening", "lattice", "mask")}
    slider = page.get_by_label("Lattice", exact=True)
    slider.scroll_into_view_if_needed()
    slider = slider.bounding_box()
    middle = slider["y"] + slider["height"] / 2
    page.mouse.move(slider["x"] + 10, middle)
    page.mouse.down()
    for n in range(4):  # a drag that rests in between is one step
        page.mouse.move(slider["x"] + 10 + 3 * n, middle)
        page.wait_for_timeout(90)
    page.mouse.up()
    moved = state(page, "tile.lattice")
    wait(page, "document.getElementById('undo').title.startsWith('Undo: lattice')")
    page.keyboard.press("p")
    dab(page)
    wait(page, "document.getElementById('undo').title.startsWith('Undo: Source mask')")
    assert state(page, "tile.mask") == "brush" and marked(page) > 0 and state(page, "masks.mask") == 1
    assert (folder / "photo.masks" / "000001.png").exists()
    page.reload()
    page.wait_for_selector("[data-tile=whole]")
    for _ in range(2):
        page.keyboard.press("Control+z")
    wait(page, f"document.getElementById('undo').title === {title!r}")
    assert before == {name: state(page, f"tile.{name}") for name in before} and marked(page) == 0
    wait(page, "!document.querySelector('.line').value.includes('mask')")
    page.click("#redo")
    wait(page, f"import('./main.js').then(({{ shell }}) => shell.state.tile.lattice === {moved})")
    page.keyboard.press("Control+Shift+Z")
    wait(page, "import('./main.js').then(({ shell }) => shell.state.tile.mask === 'brush')")
    wait(page, "import('./main.js').then(({ rooms }) => rooms.tile.regions.planes.mask.includes(255))")
    assert page.is_disabled("#redo") and page.inner_text("#status") == "Redone: Source mask"
    page.keyboard.press("Control+z")
    wait(page, "import('./main.js').then(({ shell }) => shell.state.tile.mask === '')")
    page.wait_for_timeout(300)
    assert not page.locator("#status.wrong").count()


CANVAS = """async (path) => {
  const { rooms } = await import("./main.js");
  const canvas = path.reduce((one, name) => (one instanceof Map ? one.get(name) : one[name]), rooms.tile);
  const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  let text = "";  // a million numbers as a list would take seconds on their way
  for (let at = 0; at < data.length; at += 32768) text += String.fromCharCode(...data.subarray(at, at + 32768));
  return `${canvas.width} ${btoa(text)}`;
}"""
USUAL = dict.fromkeys(("flattening", "sigma", "evenness", "histogram", "patch", "width", "height", "preset"))
USUAL |= {"lattice": 0.5, "seed": 0, "measure": "histogram", "mask": "", "fill": ""}


DRAWN = "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
SET = """async (values) => {
  const { rooms, shell } = await import("./main.js");
  if (Object.entries(values).every(([name, value]) => shell.state.tile[name] === value)) return 0;
  rooms.tile.set(values);
  return Number(rooms.tile.element.dataset.turn) + 1;
}"""
SETTLED = """document.querySelector('[data-tile=whole]') && document.body.dataset.busy === 'false'
  && !document.querySelector('.stale')"""


def finished(page, **values) -> None:
    """Set parameters when all earlier work is done, and wait for the tile and its measures."""
    wait(page, SETTLED)
    turn = page.evaluate(SET, values)
    wait(page, f"Number(document.querySelector('[data-turn]').dataset.turn) >= {turn} && {SETTLED}")


def test_a_preset_is_shown_coarse_and_chosen_by_a_click(page):
    """The photo is smaller than a coarse tile, so that it equals the full one."""
    thumbs = page.locator(".strip .group:first-child .thumb")
    assert thumbs.all_inner_texts() == ["Automatic", "Even", "Clean", "Large", "Layout"]
    finished(page, **USUAL)
    page.get_by_role("button", name="Show presets").click()
    shown = {preset: page.evaluate(CANVAS, ["strip", "presets", preset]) for preset in ("", "even", "large")}
    assert shown[""] == page.evaluate(CANVAS, ["tile"]) and thumbs.first.get_attribute("aria-pressed") == "true"
    finished(page, sigma=3)
    assert not page.locator(".strip .thumb[aria-pressed=true]").count()
    for number, preset in ((3, "large"), (1, "even")):
        page.evaluate("delete document.querySelector('[data-tile]').dataset.tile")
        thumbs.nth(number).click()
        page.wait_for_selector("[data-tile=whole]")
        assert state(page, "tile") == USUAL | {"preset": preset}
        assert page.evaluate(CANVAS, ["tile"]) == shown[preset]
    wait(page, "document.querySelector('.measures').textContent.includes('preset=even is equivalent to')")
    assert ":st=" not in page.inner_text(".measures") + page.input_value(".line >> nth=0")
    page.locator("canvas[aria-label=Tile]").focus()


def test_two_stored_tiles_a_wipe_and_linked_views_compare(page):
    inside = "import('./main.js').then(({{ rooms: {{ tile }} }}) => {})"
    finished(page, **USUAL)
    first = page.evaluate(CANVAS, ["tile"])
    page.keyboard.press("Shift+A")
    finished(page, seed=1)
    second = page.evaluate(CANVAS, ["tile"])
    page.keyboard.press("Shift+B")
    assert "A: seed 0. B: seed 1." in page.inner_text(".low .fact")
    shown = ["shown"]
    page.evaluate(inside.format("Object.defineProperty(tile, 'shown', { get: () => tile.compare.shown().canvas })"))
    for key, pixels in (("a", first), ("b", second), ("a", first), ("a", second)):
        page.keyboard.press(key)
        assert page.evaluate(CANVAS, shown) == pixels
    page.keyboard.press("b")
    page.keyboard.press("w")
    divider = page.get_by_role("slider", name="Wipe")
    assert divider.evaluate("(one) => [one.dataset.left, one.dataset.right]") == ["A", "B"]
    view = page.locator("canvas[aria-label=Tile]")
    sides = {}
    for key, now in (("End", "100"), ("Home", "0")):  # A alone, then B alone
        divider.press(key)
        assert divider.get_attribute("aria-valuenow") == now
        page.evaluate(DRAWN)
        sides[key] = page.evaluate(CANVAS, ["tileView", "canvas"])
    page.keyboard.press("w")
    page.evaluate(DRAWN)
    assert page.evaluate(CANVAS, ["tileView", "canvas"]) == sides["Home"] != sides["End"]
    page.keyboard.press("a")
    page.evaluate(DRAWN)
    assert page.evaluate(CANVAS, ["tileView", "canvas"]) == sides["End"]
    page.get_by_role("button", name="Use").click()
    assert state(page, "tile.seed") == 0
    page.keyboard.press("l")
    page.keyboard.press("0")
    for _ in range(2):
        view.press("PageDown")
        view.press("ArrowRight")
    middle = "[view.scale, (view.element.clientWidth / 2 - view.x) / view.scale]"
    places = [f"((view) => {middle})(tile.{one})" for one in ("photoView", "tileView")]
    photo, tile = (page.evaluate(inside.format(place)) for place in places)
    assert tile[0] == 1.25**2 and photo == pytest.approx(tile)
    page.keyboard.press("l")
    page.keyboard.press("f")


def test_values_under_the_pointer_and_false_color_are_those_of_the_files(page, folder):
    finished(page, **USUAL)
    page.get_by_role("button", name="1 × 1").click()
    page.get_by_role("button", name="Save", exact=True).first.click()
    wait(page, "document.getElementById('status').textContent.startsWith('Saved as')")
    saved = page.inner_text("#status").removeprefix("Saved as ")
    for name, file in (("Photo", "photo.exr"), ("Tile", saved)):
        values = load(folder / file)
        view = page.locator(f"canvas[aria-label={name}]")
        box = view.bounding_box()
        view.hover(position={"x": box["width"] / 2, "y": box["height"] / 2})
        wait(page, f"document.getElementById('place').textContent.startsWith('{name} ')")
        place, _, text = page.inner_text("#place").partition(": ")
        x, y = map(int, place.split(" ", 1)[1].split(", "))
        told = [float(word) for word in text.split("display")[0].split() if word not in "RGB"]
        np.testing.assert_allclose(told, values[y, x, :3], rtol=1e-4)
    page.keyboard.press("r")
    wait(page, "document.querySelector('.ramp') !== null")
    done = oiiotex("photo.exr", "--texstationarize:st=st.exr", "-o", "again.exr", cwd=folder)
    assert done.returncode == 0, done.stderr
    spec = Image((from_array(load(folder / "photo.exr")).first,), "").first.spec
    uses, shown = region_uses(load(folder / "st.exr")[..., :2], spec)
    high = max(uses.max(), shown.max())
    for what, wanted in (("photo", uses), ("tile", shown)):
        plane = page.evaluate(f"import('./main.js').then(({{ rooms }}) => [...rooms.tile.inspect.maps.{what}.plane])")
        np.testing.assert_allclose(np.array(plane).reshape(wanted.shape) * high / 255, wanted, atol=0.51 * high / 255)
    page.keyboard.press("d")
    wait(page, "document.querySelector('.inspect').textContent.startsWith('Drift 0')")
    page.keyboard.press("d")


PACE = """async (parts) => {
  const { shell } = await import("./main.js");
  const real = performance.now;
  let seconds = 1e6;
  performance.now = () => 1000 * seconds++;
  const texts = [0, ...parts].map((part) => shell.progress(part, 1, "Work"));
  performance.now = real;
  return texts;
}"""


def test_progress_says_what_is_made_and_for_how_long_and_survives_a_reload(page):
    finished(page, **USUAL)
    even = page.evaluate(PACE, [n / 20 for n in range(1, 21)])
    assert even[1] == "Work: 5 %" and even[20] == "" and even[10] == "Work: 50 %, 10 s left"
    slower = page.evaluate(PACE, [0.1, 0.2, 0.3, *(0.3 + 0.05 * n for n in range(1, 15))])
    for second in range(8, 16):  # within 30 %, although the pace changed to half
        left = int(slower[second].split(", ")[1].split()[0])
        assert left == pytest.approx(17 - second, rel=0.3, abs=1), slower
    finished(page, **USUAL)
    page.evaluate(NOTED.replace("status", "doing"))
    finished(page, seed=31)
    said = page.evaluate("noted")
    assert any(text.startswith("Making the tile: ") for text in said), said
    assert any(text.startswith("Measuring the tile: ") for text in said), said
    assert page.locator("#progress").is_hidden() and page.inner_text("#doing") == ""
    page.evaluate("import('./main.js').then(({ rooms }) => rooms.tile.set({ seed: 32, width: 256, height: 256 }))")
    wait(page, "document.getElementById('doing').textContent.startsWith('Making the tile')")
    page.reload()
    wait(page, "document.getElementById('doing').textContent.includes('ing the tile')")
    page.evaluate(SET, USUAL)  # which ends the large one
    finished(page, **USUAL)


def test_an_error_without_a_tile_is_shown_in_its_place(page):
    text = page.evaluate("""import("./main.js").then(({ rooms }) => {
      rooms.tile.fail("no device");
      return rooms.tile.tileView.empty.textContent;
    })""")
    assert text == "no device"


def test_zoom_is_never_black(page):
    page.evaluate("import('./main.js').then(({ shell }) => shell.status('a hint of this tab'))")
    page.click("#tab-zoom")
    assert not page.text_content("#status")
    page.wait_for_selector("[data-missing='0']")
    color = page.evaluate("""import("./main.js").then(({ rooms: { zoom } }) => {
      const tiles = zoom.tiles;
      [zoom.tiles, zoom.ground] = [new Map(), undefined];
      zoom.drawNow();
      zoom.tiles = tiles;
      return [...zoom.canvas.getContext("2d").getImageData(5, 300, 1, 1).data];
    })""")
    photo = page.evaluate("import('./main.js').then(({ shell: { photo } }) => photo.toDataURL())")
    assert photo.startswith("data:") and color[:3] != [20, 20, 20]
    page.click("#tab-tile")


def test_all_controls_can_be_reached_and_nothing_overflows(page):
    for width, height in ((800, 600), (1920, 1080)):
        page.set_viewport_size({"width": width, "height": height})
        for tab in ("paint", "zoom", "tile"):
            page.click(f"#tab-{tab}")
            if tab == "paint":
                page.wait_for_selector("[data-step]")
            panel = page.locator(".room:not([hidden]) aside")
            wide = panel.evaluate("(one) => [one.scrollWidth, one.clientWidth]")
            assert wide[0] <= wide[1], (tab, wide)
            parts = page.locator(".room:not([hidden])").locator("aside, .bar")
            for control in parts.locator("button:visible, select:visible, input:visible").all():
                control.scroll_into_view_if_needed()
                box = control.bounding_box()
                inside = box["x"] >= 0 and box["y"] >= 38 and box["x"] + box["width"] <= width
                assert inside and box["y"] + box["height"] <= height - 23, (tab, width, box)


def test_axe_finds_nothing_serious(page):
    axe = pytest.importorskip("axe_playwright_python", reason="NOT RUN: pip install oiiotex[test]")
    script = (Path(axe.__file__).parent / "axe.min.js").read_text()
    for tab, keys in (("paint", ()), ("zoom", ()), ("tile", ("w", "Shift+A", "d")), ("tile", ("?",))):
        page.click(f"#tab-{tab}")
        for key in keys:
            page.keyboard.press(key)
        page.evaluate(script)
        found = page.evaluate("axe.run().then((all) => all.violations)")
        serious = {one["id"]: one["nodes"][0]["html"] for one in found if one["impact"] in ("serious", "critical")}
        assert not serious, (tab, serious)
    for key in ("Escape", "w", "d"):
        page.keyboard.press(key)
