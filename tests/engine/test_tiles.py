# SPDX-License-Identifier: Apache-2.0
"""Pieces that are kept, windows put together of them, halos, streams, memory."""

from __future__ import annotations

import itertools
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oiiotex.engine.core.demand import assembled, bands, cached, on_a_torus, rows_for, stream
from oiiotex.engine.core.image import Part
from oiiotex.engine.core.piece_cache import PieceCache
from oiiotex.engine.core.window import Window
from oiiotex.engine.errors import ImageError
from tests.parts import NUMPY, coordinates, counted, part_of, refusal, spec_of

FUZZ = settings(max_examples=150, deadline=None, derandomize=True, database=None)
MEGABYTE = np.zeros(1 << 20, np.uint8)


def window_in(data: st.DataObject, whole: Window) -> Window:
    """Any window of a pixel or more inside another."""
    left, right = sorted(data.draw(st.sets(st.integers(whole.left, whole.right), min_size=2, max_size=2)))
    top, bottom = sorted(data.draw(st.sets(st.integers(whole.top, whole.bottom), min_size=2, max_size=2)))
    return Window(left, top, right, bottom)


# --- bands ---


@pytest.mark.parametrize(("height", "width", "kind"), [(1, 1, "uint8"), (5, 1 << 22, "float"), (4096, 4096, "uint16")])
def test_bands_cover_a_part_once_and_are_a_few_megabytes_or_one_row(height, width, kind):
    part = Part("a", spec_of(kind, height, width, 3, x=-3, y=7), lambda window: np.empty(0))
    windows = list(bands(part))
    assert [row for w in windows for row in range(w.top, w.bottom)] == list(range(7, 7 + height))
    assert all((w.left, w.right) == (-3, width - 3) for w in windows)
    row_bytes = width * 3 * max(4, np.dtype(NUMPY[kind]).itemsize)
    assert all(w.height * row_bytes <= 8 << 20 or w.height == 1 for w in windows)


def test_rows_are_counted_in_multiples():
    part = coordinates(1000, 1000)  # 8 kB a row
    assert [rows_for(part, 80_000, multiple) for multiple in (1, 3, 4, 16)] == [10, 9, 8, 16]


# --- beyond the border ---


@FUZZ
@given(data=st.data(), width=st.integers(1, 7), height=st.integers(1, 7))
def test_a_torus_is_what_numpy_pads(data, width, height):
    x, y = data.draw(st.tuples(st.integers(-9, 9), st.integers(-9, 9)))
    part = part_of("a", "half", height, width, 2, x=x, y=y)
    halo = 20  # some times the image
    padded = np.pad(part.pixels(), ((halo, halo), (halo, halo), (0, 0)), "wrap")
    around = part.window.grown(halo)
    window = window_in(data, around)  # also one that lies apart from the image
    asked: list[Window] = []
    pixels = on_a_torus(counted(part, asked), window)
    assert pixels.dtype == np.float16
    np.testing.assert_array_equal(pixels, padded[window.inside(around)])
    assert all(w & part.window == w and not w.empty for w in asked)


def test_a_window_inside_is_read_at_once():
    asked: list[Window] = []
    part = counted(part_of("a", "half", 9, 7, 3), asked)
    on_a_torus(part, Window(1, 2, 5, 6))
    assert asked == [Window(1, 2, 5, 6)]


# --- pieces that are kept ---


def test_a_piece_is_made_once_and_given_to_all():
    cache, made = PieceCache(1 << 20), []
    pieces = [cache.get("a", lambda: made.append(1) or np.arange(3)) for _ in range(3)]
    assert len(made) == 1
    assert all(piece is pieces[0] for piece in pieces)


def test_pieces_are_bounded_in_bytes_and_the_least_recently_used_go():
    cache, made = PieceCache(3 << 20), []

    def get(key: int) -> None:
        cache.get(key, lambda: made.append(key) or MEGABYTE.copy())

    for key in (0, 1, 2):
        get(key)
    get(0)  # used again: 1 is the oldest now
    get(3)
    assert made == [0, 1, 2, 3]
    for key in (0, 2, 3):
        get(key)
    assert made == [0, 1, 2, 3]
    get(1)
    assert made == [0, 1, 2, 3, 1]
    for key in range(50):
        get(key)
        assert sum(piece.result().nbytes for piece in cache._pieces.values()) <= 3 << 20


def test_a_piece_larger_than_the_limit_is_given_and_goes():
    cache, made = PieceCache(10), []
    for _ in range(2):
        assert cache.get("large", lambda: made.append(1) or MEGABYTE) is MEGABYTE
    cache.get("small", lambda: np.zeros(1))
    cache.get("large", lambda: made.append(1) or MEGABYTE)
    assert len(made) == 2


def test_threads_that_ask_for_the_same_piece_wait_for_one():
    cache, made = PieceCache(1 << 30), []
    start = threading.Barrier(8)

    def make(key: int) -> np.ndarray:
        made.append(key)
        time.sleep(0.01)
        return np.full(5, key)

    found: list[tuple[int, int]] = []

    def work() -> None:
        start.wait()
        found.extend((key, int(cache.get(key, lambda key=key: make(key))[0])) for key in range(10))

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda _: work(), range(8)))
    assert sorted(made) == list(range(10))
    assert sorted(found) == sorted([(key, key) for key in range(10)] * 8)


@pytest.mark.parametrize("error", [ImageError("no more rows"), RuntimeError("a bug"), KeyboardInterrupt()])
def test_an_error_is_passed_on_and_not_kept(error):
    cache = PieceCache(1 << 20)

    def fail() -> np.ndarray:
        raise error

    for _ in range(2):
        with pytest.raises(type(error)):
            cache.get("a", fail)
    np.testing.assert_array_equal(cache.get("a", lambda: np.arange(3)), [0, 1, 2])


def test_an_error_reaches_every_thread_that_waits():
    cache, seen, waiting = PieceCache(1 << 20), [], threading.Event()

    def fail() -> np.ndarray:
        waiting.wait(30)
        raise ImageError("no more rows")

    def work() -> None:
        with pytest.raises(ImageError, match="no more rows"):
            cache.get("a", fail)
        seen.append(1)

    with ThreadPoolExecutor(4) as pool:
        waits = [pool.submit(work) for _ in range(4)]
        waiting.set()
    assert all(one.result() is None for one in waits)
    assert len(seen) == 4


def test_what_is_made_ahead_is_there_when_it_is_asked_for():
    cache, made = PieceCache(1 << 20), []

    def make() -> np.ndarray:
        made.append(threading.current_thread())
        return np.arange(3)

    for _ in range(3):
        cache.ahead("a", make)
    np.testing.assert_array_equal(cache.get("a", make), [0, 1, 2])
    assert len(made) == 1
    assert made[0] is not threading.current_thread()


def test_an_error_made_ahead_is_told_to_who_asks_or_made_good():
    cache, gate = PieceCache(1 << 20), threading.Event()

    def fail() -> np.ndarray:
        gate.wait(30)
        raise ImageError("no more rows")

    cache.ahead("a", fail)
    threading.Timer(0.05, gate.set).start()
    assert refusal(cache.get, "a", lambda: np.arange(3)) == "no more rows"
    np.testing.assert_array_equal(cache.get("a", lambda: np.arange(3)), [0, 1, 2])


# --- windows of pieces ---


@FUZZ
@given(data=st.data(), cell=st.tuples(st.integers(1, 9), st.integers(1, 9)))
def test_a_window_is_assembled_of_whole_cells(data, cell):
    part = coordinates(20, 15, -7, 3)
    window = window_in(data, part.window)
    asked: list[Window] = []

    def piece(place: Window) -> np.ndarray:
        asked.append(place)
        return part.read(place)

    np.testing.assert_array_equal(assembled(window, cell, part.window, piece), part.read(window))
    grid = list(part.window.cells(*cell))
    assert len(asked) == len(set(asked))
    assert set(asked) == {place for place in grid if not (place & window).empty}


@pytest.mark.parametrize("halo", [0, 1, 40])
def test_a_remembered_part_computes_each_row_once_where_bands_overlap(halo):
    asked: list[Window] = []
    part = coordinates(5000, 1000, -5, 3)  # 40 MB
    near = cached(counted(part, asked), PieceCache(16 << 20))
    for band in bands(part, 4 << 20):
        window = band.grown(0, halo) & part.window
        np.testing.assert_array_equal(near.read(window)[:, ::97], part.read(window)[:, ::97])
    rows = [row for window in asked for row in range(window.top, window.bottom)]
    assert rows == list(range(3, 1003))
    assert max(window.height for window in asked) * 40_000 <= 8 << 20


def test_what_costs_little_is_not_remembered():
    part = part_of("a", "half", 9, 7, 3)
    assert cached(part, PieceCache(1 << 20)) is part


def test_two_parts_share_a_cache_and_are_not_mixed_up():
    cache = PieceCache(1 << 20)
    ones, twos = (
        cached(Part("a", spec_of("float", 4, 4, 1), lambda w, n=n: np.full((w.height, w.width, 1), n)), cache)
        for n in (1, 2)
    )
    window = Window(0, 0, 4, 4)
    assert [ones.read(window)[0, 0], twos.read(window)[0, 0], ones.read(window)[0, 0]] == [1, 2, 1]


# --- streams ---


def computing_threads() -> list[threading.Thread]:
    return [thread for thread in threading.enumerate() if thread.name.startswith("oiiotex-compute")]


@pytest.mark.parametrize("buffers", [False, True])
def test_a_stream_gives_windows_in_order_as_arrays_or_buffers(buffers):
    part, asked = coordinates(30, 100, -4, 6), []
    windows = list(part.window.cells(30, 7))
    for window, (place, pixels) in zip(windows, stream(counted(part, asked), iter(windows), buffers), strict=True):
        assert place == window
        array = pixels.get_pixels() if buffers else pixels
        np.testing.assert_array_equal(array, part.read(window))
    assert asked == windows
    assert computing_threads() == []


def test_a_stream_of_nothing_is_empty():
    assert list(stream(coordinates(3, 3), [])) == []


def test_a_stream_computes_one_window_ahead_and_no_more():
    asked: list[Window] = []
    part = counted(coordinates(10, 100), asked)
    for n, (_, _) in enumerate(stream(part, part.window.cells(10, 10))):
        time.sleep(0.02)
        assert len(asked) <= n + 2


@pytest.mark.parametrize("error", [ImageError("no more rows"), RuntimeError("a bug"), KeyboardInterrupt()])
def test_an_error_in_the_middle_stops_a_stream_and_is_raised(error):
    asked: list[Window] = []

    def fetch(window: Window) -> np.ndarray:
        asked.append(window)
        if window.top == 30:
            raise error
        return np.zeros((window.height, window.width, 1))

    part, seen = Part("a", spec_of("double", 100, 5, 1), fetch), []
    with pytest.raises(type(error)):
        seen.extend(window.top for window, _ in stream(part, part.window.cells(5, 10)))
    assert seen == [0, 10, 20]
    assert len(asked) <= 5
    assert computing_threads() == []


def test_a_stream_that_is_closed_early_joins_its_thread():
    part = coordinates(10, 100)
    running = stream(part, part.window.cells(10, 10))
    assert [window.top for window, _ in itertools.islice(running, 2)] == [0, 10]
    assert len(computing_threads()) == 1
    running.close()
    assert computing_threads() == []


# --- memory ---

STREAM_A_LARGE_ONE = """
import resource
import numpy as np
import OpenImageIO as oiio
from oiiotex.engine.core.image import Image, Part, type_named
from oiiotex.engine.core.demand import cached
from oiiotex.engine.core.piece_cache import PieceCache
from oiiotex.engine.core.window import Window
from oiiotex.engine.io.formats import Format
from oiiotex.engine.io.writing import write

def fetch(window):
    y, x = np.ogrid[window.top : window.bottom, window.left : window.right]
    out = np.empty((window.height, window.width, 4), np.float32)
    out[...] = ((x // 64 + y // 64) % 7 / 7)[..., None]
    return out

spec = oiio.ImageSpec(7000, 7000, 4, oiio.FLOAT)  # 784 MB
part = Part("a", spec, fetch)
write(Image((Part("a", oiio.ImageSpec(8, 8, 4, oiio.FLOAT), fetch),)), "first.tif")  # what is loaded once
start = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
write(Image((part,)), "a.tif", Format(pixel_type=type_named("uint8"), TILING attributes={"compression": "COMPRESSION"}))
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - start)
"""


@pytest.mark.parametrize(("tiling", "compression"), [("tile=(64, 64),", "none"), ("", "packbits")])
def test_memory_is_bounded_by_the_bands_and_not_by_the_image(tmp_path, tiling, compression):
    script = STREAM_A_LARGE_ONE.replace("TILING", tiling).replace("COMPRESSION", compression)
    done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True)
    (tmp_path / "a.tif").unlink()
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) < 250 << 10  # kilobytes
