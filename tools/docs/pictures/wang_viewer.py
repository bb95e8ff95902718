# SPDX-License-Identifier: Apache-2.0
"""The picture of the page of Wang tiles in a browser: `python -m tools.docs.pictures.wang_viewer`. Needs Chromium."""

from __future__ import annotations

import tempfile
from pathlib import Path

import OpenImageIO as oiio
from oiiotex_studio.library.commands import run

from oiiotex import filters
from tests.browser import DRAWING, chromium
from tools.docs.pictures.layout import draw, pixels, stacked, test_photo, write_jpeg

SIDE, SEED = 192, 7  # of a tile, px


def viewer() -> None:
    """Moss, to the horizon and from above."""
    photo = test_photo("moss_grass_stones_ground.jpg", 3 * SIDE)
    with tempfile.TemporaryDirectory() as text:
        folder = Path(text)
        atlas = filters.stationarize(photo, variants=16, pack="atlas", size=(SIDE, SIDE), seed=SEED)
        atlas.write(str(folder / "atlas.png"))
        run(["wang", str(folder / "moss"), f"color={folder / 'atlas.png'}"])
        with chromium(DRAWING) as browser:
            page = browser.new_page(viewport={"width": 1020, "height": 300})
            page.add_init_script("window.held = true")
            page.goto((folder / "moss/moss.html").as_uri())
            page.wait_for_selector("html[data-ready]", state="attached", timeout=120_000)
            page.add_style_tag(content="footer{display:none}")
            for number, call in enumerate(("stopped(0.5, 1.6)", "fromAbove()")):
                page.evaluate(call)
                page.screenshot(path=str(folder / f"{number}.png"))
        shots = [pixels(oiio.ImageBuf(str(folder / f"{number}.png")))[..., :3] for number in range(2)]
    write_jpeg(stacked(shots), "wang_viewer.jpg")


if __name__ == "__main__":
    draw(viewer)
