# SPDX-License-Identifier: Apache-2.0
"""One look at an image: every row once, in order, with its halo; all that is broken is counted."""

from __future__ import annotations

import numpy as np
import pytest

from oiiotex.engine.color.lab import lens_of
from oiiotex.engine.color.lens import Lens
from oiiotex.engine.core.image import Image
from oiiotex.engine.core.op import Space
from oiiotex.engine.core.window import Window
from oiiotex.engine.errors import BrokenValues, Interrupted
from oiiotex.engine.scan import scan
from oiiotex.engine.session import Session
from oiiotex.engine.session.progress import Progress
from tests.colored import image_of
from tests.refusals import refused

HEIGHT, WIDTH = 83, 17
ROWS = np.arange(HEIGHT, dtype=np.float32)[:, None, None].repeat(WIDTH, 1).repeat(3, 2)


@pytest.fixture(autouse=True)
def small_pieces(monkeypatch):
    """Bands of 20 rows, pieces of 3."""
    monkeypatch.setattr("oiiotex.engine.scan.BAND_BYTES", 20 * WIDTH * 3 * 4)
    monkeypatch.setattr("oiiotex.engine.scan.PIECE_PIXELS", 3 * WIDTH)


def at(left: int, top: int, pixels: np.ndarray) -> tuple[Image, Lens]:
    """An image whose data window begins there, seen as it is."""
    image = image_of(pixels, ("x", "y", "z"))
    image = Image(
        (image.first.respecced(lambda spec: (setattr(spec, "x", left), setattr(spec, "y", top))),), "photo.exr"
    )
    return image, lens_of(image, Session().resources, Space.ANY)


@pytest.mark.parametrize("threads", [1, 5])
@pytest.mark.parametrize(
    ("cell", "halo", "larger"), [(0, 0, 1), (7, 0, 1), (1, 0, 1), (0, 4, 1), (0, 30, 2), (100, 0, 9)]
)
def test_every_row_is_seen_once_in_order_with_its_halo(threads, cell, halo, larger):
    image, lens = at(5, -11, ROWS)
    whole, kept, told = image.first.window, [], []

    def look(values: np.ndarray, opaque: np.ndarray | None, piece: Window) -> tuple[np.ndarray, int]:
        assert opaque is None and values.shape[1:] == (WIDTH, 4)
        above = piece.top - max(whole.top, piece.top - halo)
        return values[:, 0, 0].copy(), above

    def keep(piece: Window, found: tuple[np.ndarray, int]) -> None:
        rows, above = found
        first, last = piece.top - whole.top, piece.bottom - whole.top
        np.testing.assert_array_equal(rows, np.arange(max(0, first - halo), min(HEIGHT, last + halo)))
        assert above == min(halo, first) and (piece.left, piece.right) == (5, 5 + WIDTH)
        assert piece.height <= 3 * larger
        assert not cell or first // cell == (last - 1) // cell
        kept.extend(rows[above : above + piece.height])

    scan(image.first, lens, Session(threads=threads).resources, look, keep, cell=cell, halo=halo, larger=larger,
         advance=lambda done, total: told.append((done, total)))  # fmt: skip
    np.testing.assert_array_equal(kept, ROWS[:, 0, 0])
    assert told == sorted(set(told)) and told[-1] == (HEIGHT, HEIGHT)


@pytest.mark.parametrize("halo", [0, 6])
def test_all_that_is_broken_is_counted_once(halo):
    broken = ROWS.copy()
    broken[[0, 2, 3, 19, 20, 82], 4, 1] = np.nan
    broken[[21, 40], 0, 2] = np.inf
    image, lens = at(0, 0, broken)
    clean: list[Window] = []
    with refused(BrokenValues, subject="photo.exr", counts=[6, 2]):
        scan(image.first, lens, Session().resources, lambda *_: None, lambda piece, _: clean.append(piece), halo=halo)
    assert not any(piece.top <= y < piece.bottom for piece in clean for y in (0, 2, 3, 19, 20, 21, 40, 82))


def test_it_ends_where_progress_says_so():
    image, lens = at(0, 0, ROWS)
    kept: list[Window] = []
    resources, advance = Session().resources, Progress(lambda done, total: done < 10).advance
    with pytest.raises(Interrupted):
        scan(image.first, lens, resources, lambda *_: None, lambda piece, _: kept.append(piece), advance=advance)
    assert len(kept) == 4


def test_a_scan_frees_a_cache_that_the_image_exceeds():
    image, lens = at(0, 0, ROWS)
    for limit, stays in ((ROWS.nbytes, True), (ROWS.nbytes - 1, False)):
        resources = Session().resources
        resources.cache.limit = limit
        resources.cache.get("piece", lambda: np.zeros(1))
        scan(image.first, lens, resources, lambda values, opaque, piece: None, lambda piece, found: None)
        assert resources.cache.holds("piece") == stays
