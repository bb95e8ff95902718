# SPDX-License-Identifier: Apache-2.0
"""The page in a real browser: every change of a painting is a step; a full disk is said, and waited for."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("starlette", reason="NOT RUN: no starlette (pip install oiiotex-studio)")
pytest.importorskip("uvicorn", reason="NOT RUN: no uvicorn (pip install oiiotex-studio)")

from tests import pictures
from tests.browser import Served, chromium, end_resident
from tests.conftest import load, oiiotex, save
from tests.studio.test_live import SPACE, copied_line, pixels_of, shown_of, wait

PAINTED = "import('./main.js').then((m) => btoa(String.fromCharCode(...m.rooms.paint.layers.coarse.slice(0, 9000))))"


@pytest.fixture(scope="module")
def browser() -> Iterator[object]:
    with chromium() as opened:
        yield opened


@pytest.fixture(scope="module")
def runtime() -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="oxl") as name:
        yield Path(name)
        end_resident(Path(name))


@pytest.fixture
def folder(tmp_path) -> Path:
    save(pictures.stained(pictures.bricks(96, 112, seed=1)), tmp_path / "photo.png")
    return tmp_path


def served(folder: Path, runtime: Path, live: str = "") -> Served:
    return Served(folder, "photo.png", "--iscolorspace", SPACE, live=live, runtime=runtime)


def opened(browser, url: str, width: int = 1280) -> object:
    page = browser.new_page(viewport={"width": width, "height": 720})
    page.set_default_timeout(60000)
    page.goto(f"{url}#paint")
    page.wait_for_selector("[data-step]")
    return page


def stroke(page, *places: tuple[float, float], label: int = 1) -> None:
    """Paint through places, in parts of the painting's view."""
    page.locator(".swatch").nth(label).click()
    view = page.locator("canvas[aria-label=Painting]").bounding_box()
    for n, (x, y) in enumerate(places):
        page.mouse.move(view["x"] + x * view["width"], view["y"] + y * view["height"], steps=3)
        if n == 0:
            page.mouse.down()
    page.mouse.up()


def field(page, name: str) -> object:
    return page.locator(".row:visible", has=page.get_by_text(name, exact=True)).locator("input")


def set_field(page, name: str, value: int) -> None:
    field(page, name).fill(str(value))
    field(page, name).press("Enter")
    page.locator("canvas[aria-label=Painting]").focus()


def at_step(page, step: int, last: int) -> None:
    page.wait_for_selector(f"[data-step='{step}']")
    assert f"Step {step} of {last}" in page.inner_text(".hint:visible")


def at_same_step(*pages, folder: Path) -> int:
    """Wait until all pages show the last saved step, with the same painting; its number."""
    until = time.monotonic() + 60
    while True:
        shown = {(int(page.get_attribute("[data-step]", "data-step")), page.evaluate(PAINTED)) for page in pages}
        last = max(int(path.stem) for path in folder.glob("??????.png"))
        if {step for step, _ in shown} == {last} and len(shown) == 1:
            return last
        assert time.monotonic() < until, (last, shown)
        time.sleep(0.05)


@pytest.fixture
def small(folder) -> Path:
    """With a document whose painting begins small."""
    done = {"oiiotex.live": 1, "source": "photo.png", "paint": {"width": 256, "height": 192}}
    (folder / "photo.texlive.json").write_text(json.dumps(done))
    return folder


def test_size_seed_and_a_new_painting_are_steps_and_undo_brings_back_all(browser, small, runtime):
    server = served(small, runtime)
    page = opened(browser, server.url)
    try:
        stroke(page, (0.3, 0.3), (0.6, 0.6))
        at_step(page, 1, 1)
        seen = [pixels_of(page, "texture")]
        changes = (
            ("Width", 320, "Canvas 320x192"), ("Height", 128, "Canvas 320x128"), ("Seed", 7, "Seed 7"),
            ("Width", 64, "Canvas 64x128"),
        )  # fmt: skip
        for step, (name, value, said) in enumerate(changes, 2):
            set_field(page, name, value)
            at_step(page, step, step)
            assert said in page.inner_text(".hint:visible")
            seen.append(pixels_of(page, "texture"))
            assert not page.locator("#status.wrong").count()
        np.testing.assert_array_equal(seen[1][:96, :160], seen[0][:96, :160])  # what is painted stays where it is
        assert [one.shape[:2] for one in seen] == [(192, 256), (192, 320), (128, 320), (128, 320), (128, 64)]
        assert (seen[3] != seen[2]).any()
        page.get_by_role("button", name="New", exact=True).click()
        at_step(page, 6, 6)
        np.testing.assert_array_equal(pixels_of(page, "texture"), shown_of(copied_line(page), small, SPACE))
        page.locator("canvas[aria-label=Painting]").focus()
        values = []
        for step in (5, 4, 3, 2, 1):
            page.keyboard.press("Control+z")
            at_step(page, step, 6)
            np.testing.assert_array_equal(pixels_of(page, "texture"), seen[step - 1])
            values.append(tuple(int(field(page, name).input_value()) for name in ("Width", "Height", "Seed")))
        assert values == [(64, 128, 7), (320, 128, 7), (320, 128, 0), (320, 192, 0), (256, 192, 0)]
        for step in (2, 3, 4):
            page.keyboard.press("Control+Shift+Z")
            at_step(page, step, 6)
        np.testing.assert_array_equal(pixels_of(page, "texture"), shown_of(copied_line(page), small, SPACE))
    finally:
        page.close()
        server.end()
    # another server goes on where this one was, with the whole history
    again = served(small, runtime)
    try:
        page = opened(browser, again.url)
        at_step(page, 4, 6)
        np.testing.assert_array_equal(pixels_of(page, "texture"), seen[3])
        environment = os.environ | {"XDG_RUNTIME_DIR": str(runtime)}
        done = oiiotex("photo.png", "--iscolorspace", SPACE, "--texlive:open=0", cwd=small, env=environment)
        assert done.returncode == 1 and "photo.texlive.json is open in another --texlive" in done.stderr
        page.close()
    finally:
        again.end()


@pytest.mark.slow
def test_two_pages_paint_at_once_and_none_takes_the_others_work_away(browser, small, runtime):
    server = served(small, runtime)
    try:
        one, other = opened(browser, server.url), opened(browser, server.url)
        one.bring_to_front()
        view = one.locator("canvas[aria-label=Painting]").bounding_box()
        one.mouse.move(view["x"] + 0.2 * view["width"], view["y"] + 0.3 * view["height"])
        one.mouse.down()
        # meanwhile the other page paints across the box of this stroke, and makes the canvas larger
        stroke(other, (0.5, 0.2), (0.5, 0.8), label=1)
        other.wait_for_selector("[data-step='1']")
        one.mouse.move(view["x"] + 0.8 * view["width"], view["y"] + 0.7 * view["height"], steps=8)
        set_field(other, "Width", 320)
        for page in (one, other):
            wait(page, "document.getElementById('undo').title.startsWith('Undo: Canvas 320x192')")
        one.mouse.up()
        for page in (one, other):
            wait(page, "document.getElementById('undo').title.startsWith('Undo: Stroke')")
        last = at_same_step(one, other, folder=small / "photo.paint")
        layer = load(sorted((small / "photo.paint").glob("??????.png"))[-1])
        assert layer.shape[:2] == (192, 320)
        first, second = (
            one.evaluate(f"import('./main.js').then((m) => m.rooms.paint.labels[{n}].color)") for n in (0, 1)
        )
        begun = load(min((small / "photo.paint").glob("??????.png")))
        changed = (layer[:, : begun.shape[1]] != begun).any(-1)
        painted = layer[:, : begun.shape[1], :3][changed]
        shares = [(painted == np.array(c.split(","), int)).all(-1).sum() / changed.size for c in (first, second)]
        assert min(shares) > 0.01, shares
        for step in range(last - 1, -1, -1):  # and every one of these steps is undone
            one.keyboard.press("Control+z")
            one.wait_for_selector(f"[data-step='{step}']")
    finally:
        server.end()


@pytest.fixture
def tiny(tmp_path) -> Iterator[Path]:
    """A disk of half a megabyte."""
    path = tmp_path / "disk"
    path.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=512k", "none", str(path)]
    if shutil.which("mount") is None or subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("NOT RUN: no file system may be mounted here")
    try:
        yield path
    finally:
        subprocess.run(["umount", "-l", str(path)], check=True)


def fill(disk: Path) -> None:
    with open(disk / "large", "wb", buffering=0) as file, contextlib.suppress(OSError):
        while file.write(bytes(4096)):
            pass


def remount(disk: Path, how: str) -> None:
    subprocess.run(["mount", "-o", f"remount,{how}", str(disk)], check=True)


@pytest.mark.parametrize(
    ("close", "open_again", "why"),
    [
        (fill, lambda disk: (disk / "large").unlink(), "No space left on device"),
        (lambda disk: remount(disk, "ro"), lambda disk: remount(disk, "rw"), "cannot be written"),
    ],
    ids=("full", "read-only"),
)
def test_a_disk_that_takes_nothing_is_said_and_all_is_saved_when_it_does(
    browser, small, tiny, runtime, close, open_again, why
):
    for name in ("photo.png", "photo.texlive.json"):
        shutil.copy(small / name, tiny)
    server = served(tiny, runtime)
    try:
        page = opened(browser, server.url)
        close(tiny)
        stroke(page, (0.3, 0.3), (0.6, 0.6))
        at_step(page, 1, 1)  # painting goes on
        after = pixels_of(page, "texture")
        page.wait_for_selector("#unsaved:not([hidden])")
        said = page.inner_text("#unsaved")
        assert said.startswith("Not saved: ") and why in said and str(tiny) in said
        assert "Your work is kept in memory until saving succeeds." in said
        for width in (800, 1280, 1920):  # all of it can be read
            page.set_viewport_size({"width": width, "height": 720})
            box = page.locator("#unsaved").bounding_box()
            assert box["x"] >= 0 and box["x"] + box["width"] <= width and box["height"] < 80
            assert page.evaluate("(({ scrollWidth, clientWidth }) => scrollWidth <= clientWidth)(unsaved)")
        late = browser.new_page()
        late.goto(server.url)  # a page that comes later is told, too
        late.wait_for_selector("#unsaved:not([hidden])")
        late.close()
        assert not (tiny / "photo.paint" / "000001.npz").exists()
        open_again(tiny)
        page.wait_for_selector("#unsaved", state="hidden")
        assert (tiny / "photo.paint" / "000001.npz").exists()
        assert json.loads((tiny / "photo.texlive.json").read_text())["painting"] == {"step": 1}
        page.reload()
        page.wait_for_selector("[data-step='1']")
        np.testing.assert_array_equal(pixels_of(page, "texture"), after)
        page.close()
    finally:
        server.end()


@pytest.mark.slow
def test_a_photo_with_other_labels_begins_another_painting_and_keeps_the_steps(browser, small, runtime):
    server = served(small, runtime)
    page = opened(browser, server.url)
    stroke(page, (0.3, 0.3), (0.6, 0.6))
    at_step(page, 1, 1)
    before = pixels_of(page, "texture")
    page.close()
    server.end()
    files = {path.name: path.read_bytes() for path in (small / "photo.paint").iterdir()}
    photo = (small / "photo.png").read_bytes()
    save(pictures.pebbles(80, 72, seed=3), small / "photo.png")
    server = served(small, runtime)
    page = opened(browser, server.url)
    at_step(page, 2, 2)
    assert "cannot show step 1 (it is kept): " in page.inner_text("#status.wrong")
    page.keyboard.press("Control+z")
    wait(page, "document.querySelector('#status').textContent.includes('cannot show step 1')")
    page.close()
    server.end()
    assert files.items() <= {path.name: path.read_bytes() for path in (small / "photo.paint").iterdir()}.items()
    (small / "photo.png").write_bytes(photo)
    server = served(small, runtime)
    try:
        page = opened(browser, server.url)
        at_step(page, 1, 2)
        np.testing.assert_array_equal(pixels_of(page, "texture"), before)
        page.close()
    finally:
        server.end()


@pytest.mark.slow
def test_strokes_are_not_lost_with_the_server_nor_with_the_room(browser, small, runtime):
    server = served(small, runtime)
    page = opened(browser, server.url)
    try:
        page.locator(".swatch").nth(1).click()
        view = page.locator("canvas[aria-label=Painting]").bounding_box()
        page.mouse.move(view["x"] + 0.3 * view["width"], view["y"] + 0.4 * view["height"])
        page.mouse.down()
        page.mouse.move(view["x"] + 0.5 * view["width"], view["y"] + 0.5 * view["height"])
        page.keyboard.press("3")  # another room, with the button down: the stroke ends
        page.mouse.move(view["x"] + 0.9 * view["width"], view["y"] + 0.5 * view["height"])
        page.keyboard.press("2")
        page.mouse.move(view["x"] + 0.9 * view["width"], view["y"] + 0.9 * view["height"])
        page.mouse.up()
        at_step(page, 1, 1)
        assert page.evaluate("import('./main.js').then((m) => m.rooms.paint.painting)") is None
        color = page.evaluate("import('./main.js').then((m) => m.rooms.paint.labels[0].color)")

        def share() -> float:
            """Of the label of the second stroke in the painting."""
            layer = load(max((small / "photo.paint").glob("??????.png")))
            return (layer[..., :3] == np.array(color.split(","), int)).all(-1).mean()

        before = share()
        server.end(signal.SIGKILL)
        page.wait_for_selector("#link.wrong")
        page.evaluate("import('./main.js').then(({ shell }) => shell.set('tile', { seed: 3 }))")
        assert page.inner_text("#status.wrong") == "The server is not connected: this change is not applied"
        stroke(page, (0.3, 0.6), (0.6, 0.3), label=0)
        server = served(small, runtime, f":port={server.port}")
        page.wait_for_selector("#link:not(.wrong)", state="attached")
        # the first stroke is two steps where the server was killed between its last look and the step that they become
        wait(page, "['2', '3'].some((step) => document.querySelector(`[data-step='${step}']`))")
        end = time.monotonic() + 60
        while share() < before + 0.01:
            assert time.monotonic() < end, "the second stroke is lost"
            time.sleep(0.2)
        page.close()
    finally:
        server.end()
