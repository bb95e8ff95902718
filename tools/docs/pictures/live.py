# SPDX-License-Identifier: Apache-2.0
"""Screenshots of the page's rooms, by Chromium and Playwright: `python -m tools.docs.pictures.live`."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator
from pathlib import Path

import OpenImageIO as oiio

from benchmarks.shared.measures import data_folder
from tests.browser import Served, chromium, end_resident
from tools.docs.pictures.layout import FOLDER

DATA = data_folder().absolute()
SIZE = {"width": 1280, "height": 720}
SPACE = "srgb_rec709_scene"


def cut(name: str, folder: Path, window: oiio.ROI, width: int) -> str:
    """A part of a photo, reduced, as a file of the folder; its name."""
    photo = oiio.ImageBufAlgo.cut(oiio.ImageBuf(str(DATA / "photos" / f"{name}.jpg")), window)
    height = width * photo.spec().height // photo.spec().width
    small = oiio.ImageBufAlgo.resize(photo, roi=oiio.ROI(0, width, 0, height, 0, 1, 0, 3))
    small.write(str(folder / f"{name}.png"), "uint8")
    return f"{name}.png"


def tile(browser: object, folder: Path) -> None:
    """Pebbles and their tile, with a wipe, presets and seeds to choose from."""
    name = cut("pebbles_beach_shadow", folder, oiio.ROI(0, 1000, 0, 1000), 512)
    with served(folder, name, "--iscolorspace", SPACE) as url:
        page = opened(browser, url)
        page.wait_for_selector("[data-tile=whole]")
        page.keyboard.press("v")
        page.keyboard.press("Shift+A")
        page.locator("select[title^=Large]").select_option('"large"')
        page.wait_for_timeout(500)
        page.wait_for_selector("[data-tile=whole]")
        page.wait_for_timeout(4000)
        page.keyboard.press("v")
        page.keyboard.press("Shift+B")
        page.keyboard.press("w")
        page.get_by_role("button", name="Show seeds").click()
        while page.locator(".strip .group:last-child .thumb").count() < 8:
            page.wait_for_timeout(100)
        shot(page, "live_tile")


def paint(browser: object, folder: Path) -> None:
    """Moss and stones, painted, and the ground refined."""
    name = cut("moss_grass_stones_ground", folder, oiio.ROI(0, 1024, 0, 682), 512)
    with served(folder, name, "--iscolorspace", SPACE) as url:
        page = opened(browser, url)
        page.click("#tab-paint")
        page.wait_for_selector("[data-step='0']")
        view = page.locator("canvas[aria-label=Painting]").bounding_box()
        x, y, side = (
            view["x"] + view["width"] / 2,
            view["y"] + view["height"] / 2,
            min(view["width"], view["height"]) / 2,
        )
        strokes = (
            (1, [(-0.7, -0.5), (-0.3, -0.6), (0.1, -0.5), (0.3, -0.3), (0.7, -0.35)]),
            (3, [(-0.7, 0.35), (-0.3, 0.2), (0.1, 0.3), (0.4, 0.15), (0.75, 0.25)]),
            (2, [(-0.6, 0.75), (-0.2, 0.7), (0.2, 0.75), (0.6, 0.65)]),
            (0, [(-0.6, -0.1), (-0.2, -0.2), (0.1, -0.05), (0.5, -0.1)]),
        )
        for step, (label, places) in enumerate(strokes, 1):
            page.locator(".swatch").nth(min(label, page.locator(".swatch").count() - 1)).click()
            if step == len(strokes):
                page.locator(".entry.chosen .within button").first.click()
            for n, (across, down) in enumerate(places):
                page.mouse.move(x + side * across, y + side * down, steps=6)
                if n == 0:
                    page.mouse.down()
            page.mouse.up()
            page.wait_for_selector(f"[data-step='{step}']")
        shot(page, "live_paint")


def zoom(browser: object, folder: Path) -> None:
    """Five maps of different scales, flown into."""
    graph = DATA / "multiscale" / "map1800_bobruisk" / "graph.json"
    with served(folder, "--autocc", live=f":graph={graph}") as url:
        page = opened(browser, url)
        page.wait_for_selector("[data-missing='0']")
        for _ in range(3):
            page.keyboard.press("k")
            page.keyboard.press("PageDown")
            page.wait_for_timeout(300)
            page.wait_for_selector("[data-missing='0']")
        shot(page, "live_zoom")


def opened(browser: object, url: str) -> object:
    """A page of the size of a small laptop."""
    page = browser.new_page(viewport=SIZE)
    page.set_default_timeout(120_000)
    page.goto(url)
    return page


def shot(page: object, name: str) -> None:
    """The page as a picture of the docs."""
    page.mouse.move(5, 715)
    page.wait_for_timeout(300)
    page.screenshot(path=FOLDER / f"{name}.jpg", type="jpeg", quality=86)
    page.close()
    print(FOLDER / f"{name}.jpg")


@contextlib.contextmanager
def served(folder: Path, *words: str, live: str = "") -> Iterator[str]:
    """The page's server in a folder; its URL."""
    server = Served(folder, *words, live=live, runtime=folder)
    try:
        yield server.url
    finally:
        server.end()


if __name__ == "__main__":
    with tempfile.TemporaryDirectory(prefix="oxl") as name, chromium() as opened_browser:
        for room in (tile, paint, zoom):
            room(opened_browser, Path(name))
        end_resident(Path(name))
