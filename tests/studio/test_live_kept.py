# SPDX-License-Identifier: Apache-2.0
"""Pictures of the page that are there already: kept tiles of earlier states, maps before their tile."""

from __future__ import annotations

import numpy as np
import pytest
from oiiotex_studio.live import kept_tiles
from oiiotex_studio.live.kept_tiles import KeptTile, KeptTiles

from oiiotex.engine.core.image import from_array
from oiiotex.oiiotool.service.pictures import image_facts
from tests import pictures
from tests.conftest import save
from tests.studio.test_live import WATCH, pixels_of, wait
from tests.studio.test_live_controls import folder, page

__all__ = ["folder", "page"]  # fixtures


def tile(side: int) -> KeptTile:
    facts = image_facts(from_array(np.zeros((side, side, 3), np.float32)))
    return KeptTile([facts | {"number": side}], np.zeros((1, 1, 3)), {}, {})


def test_the_oldest_tiles_are_forgotten_and_the_last_never(monkeypatch):
    monkeypatch.setattr(kept_tiles, "_MOST", 3)
    monkeypatch.setattr(kept_tiles, "_MOST_VALUES", 3 * (10 * 10 + 11 * 11))
    kept, first, other = KeptTiles(), tile(10), tile(11)
    assert kept.put("first", first) == [] and kept.put("other", other) == []
    assert kept.get("first") is first  # which makes it the last one
    assert kept.put("small", tile(1)) == [other] and not kept.holds(other.images)
    again = tile(9)
    assert kept.put("first", again) == [first] and kept.get("other") is None
    assert len(kept.put("large", tile(100))) == 2 and kept.get("large") is not None
    kept.forget()
    assert kept.get("large") is None


def test_undo_shows_the_tile_of_the_earlier_state_without_making_it_again(page):
    wait(page, "document.body.dataset.busy === 'false'")  # a tile is kept when it is measured
    first, turn = pixels_of(page, "tile"), page.get_attribute("[data-turn]", "data-turn")
    page.keyboard.press("s")
    page.wait_for_selector(f"[data-tile=whole]:not([data-turn='{turn}'])")
    wait(page, "document.body.dataset.busy === 'false'")
    second = pixels_of(page, "tile")
    assert (first != second).any()
    page.evaluate(WATCH)
    for key, expected in (("Control+z", first), ("Control+Shift+z", second)):
        before = page.get_attribute("[data-turn]", "data-turn")
        page.keyboard.press(key)
        page.wait_for_selector(f"[data-tile=whole]:not([data-turn='{before}'])")
        np.testing.assert_array_equal(pixels_of(page, "tile"), expected)
        wait(page, "document.querySelector('.measures').textContent.includes('seam ratio')")
    assert set(page.evaluate("shown")) == {"whole"}  # a tile that is made is coarse first


def test_a_picture_of_earlier_values_is_marked_until_its_successor_is_there(page):
    marked = """() => {
      const element = document.querySelector(".fact.mark");
      window.marks = [];
      const note = () => marks.push(element.hidden ? "" : element.textContent);
      new MutationObserver(note).observe(element, { attributes: true });
    }"""
    page.evaluate(marked)
    page.keyboard.press("s")
    wait(page, "window.marks.includes('Outdated') && window.marks.at(-1) === ''")
    assert page.locator(".outdated").count() == 0


def test_maps_are_shown_before_their_tile_is_made(page, tmp_path):
    color = pictures.pebbles(48, 64, seed=2)
    save(color, tmp_path / "wall_color.exr", "half", "lin_rec709_scene")
    save(np.clip(color * 0.2 + [0.4, 0.4, 0.8], 0, 1), tmp_path / "wall_nor_gl.exr", "half")
    page.set_input_files("input[type=file]", list(tmp_path.iterdir()))
    page.wait_for_selector("[data-given='1']")
    page.wait_for_selector("[data-maps='1']")  # then those of the tile
    page.get_by_role("button", name="Lit", exact=True).click()
    assert page.locator(".fact.mark").is_hidden()


def test_the_tile_of_a_tab_that_is_not_shown_is_made_when_it_is(page):
    address = page.url.partition("#")[0]
    page.goto("about:blank")
    page.goto(f"{address}#zoom")
    page.wait_for_selector("#tab-zoom[aria-selected=true]")
    page.click("#tab-tile")
    page.wait_for_selector("[data-tile=whole]")


@pytest.mark.parametrize("width", [800, 1280, 1920])
def test_the_page_has_room_for_everything_at_every_width(page, width):
    page.set_viewport_size({"width": width, "height": 900})
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    covered = """() => [...document.querySelectorAll("header button")].filter((one) => {
      if (!one.offsetParent) return false;
      const box = one.getBoundingClientRect();
      return !one.contains(document.elementFromPoint(box.x + box.width / 2, box.y + box.height / 2));
    }).map((one) => one.textContent)"""
    assert page.evaluate(covered) == []
