# SPDX-License-Identifier: Apache-2.0
"""How image files enter: any window, in any order, from any thread, decoded once; and what is refused."""

from __future__ import annotations

import itertools
import os
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex.engine.core.demand import bands
from oiiotex.engine.core.image import dtype_of
from oiiotex.engine.core.piece_cache import PieceCache
from oiiotex.engine.core.window import Window
from oiiotex.engine.errors import ImageError
from oiiotex.engine.io import reading
from oiiotex.engine.io.reading import read
from tests.parts import NUMPY, WINDOWS, assert_same, deep_file, noise, part_of, put, refusal, spec_of

# --- any window ---


@pytest.mark.parametrize("tile", [0, 16], ids=["scanlines", "tiles"])
@pytest.mark.parametrize(
    ("name", "kind"),
    [("a.exr", kind) for kind in ("half", "float", "uint")]
    + [("a.tif", kind) for kind in ("uint8", "int16", "uint16", "float", "uint")],
)
def test_any_window_of_a_file_is_that_of_the_whole_in_its_own_type(tmp_path, name, kind, tile):
    pixels = noise(kind, 37, 29, 3)
    facts = {"x": 3, "y": 5} | ({"tile_width": tile, "tile_height": tile} if tile else {})
    part = read(put(tmp_path / name, pixels, spec_of(kind, 37, 29, 3, **facts))).first
    assert (part.spec.tile_width, part.spec.x, part.spec.y) == (tile, 3, 5)
    assert dtype_of(part.spec) is NUMPY[kind]
    assert_same(part, pixels)
    rows = ((0, 1), (36, 37), (15, 16), (16, 17), (0, 16), (15, 33), (17, 37), (5, 6), (31, 32))
    columns = ((0, 29), (0, 1), (28, 29), (15, 17), (13, 29))
    for (top, bottom), (left, right) in itertools.product(rows, columns):
        window = Window(left + 3, top + 5, right + 3, bottom + 5)
        found = part.read(window)
        assert found.dtype == pixels.dtype
        np.testing.assert_array_equal(found, pixels[top:bottom, left:right])


@pytest.mark.parametrize("tile", [0, 16], ids=["scanlines", "tiles"])
@pytest.mark.parametrize("top", [0, 5])
def test_rows_of_a_tiff_of_doubles_are_right_or_refused(tmp_path, top, tile):
    # OpenImageIO 3.2 hands out uninitialized memory, without an error, for rows of doubles that are not whole strips
    pixels = noise("double", 37, 29, 3)
    facts = {"tile_width": tile, "tile_height": tile} if tile else {}
    path = put(tmp_path / "a.tif", pixels, spec_of("double", 37, 29, 3, y=top, **facts))
    for begin, end in ((0, 37), (7, 11), (20, 37)):
        try:
            rows = read(path).first.read(Window(0, top + begin, 29, top + end))
        except ImageError:
            continue
        np.testing.assert_array_equal(rows, pixels[begin:end])


@pytest.mark.parametrize("tile", [0, 64], ids=["scanlines", "tiles"])
def test_the_bands_of_a_large_file_put_together_are_the_whole(tmp_path, tile):
    pixels = noise("float", 1030, 701, 4)  # 11.5 MB
    facts = {"tile_width": tile, "tile_height": tile} if tile else {}
    part = read(put(tmp_path / "a.exr", pixels, spec_of("float", 1030, 701, 4, compression="none", **facts))).first
    windows = list(bands(part))
    assert len(windows) > 1
    np.testing.assert_array_equal(np.concatenate([part.read(window) for window in windows]), pixels)
    np.testing.assert_array_equal(part.pixels(), pixels)


def test_data_and_display_window_are_those_of_the_file(tmp_path):
    pixels = noise("half", 9, 7, 4)
    image = read(put(tmp_path / "a.exr", pixels, spec_of("half", 9, 7, 4, **WINDOWS)))
    spec = image.first.spec
    assert {name: getattr(spec, name) for name in WINDOWS} == WINDOWS
    assert (spec.width, spec.height, spec.alpha_channel) == (7, 9, 3)
    assert image.source == str(tmp_path / "a.exr")
    assert_same(image.first, pixels)


def test_parts_of_a_file_have_their_own_names_windows_and_types(tmp_path):
    display = {"full_width": 20, "full_height": 10}
    parts = (
        part_of("tile", "half", 9, 7, 4, x=-2, y=4, **display),
        part_of("st", "float", 5, 4, 2, **display),
        part_of("label.1", "uint", 3, 3, 1, x=1, y=1, **display),
    )
    out = oiio.ImageOutput.create(str(tmp_path / "a.exr"))
    for part in parts:
        part.spec.attribute("oiio:subimagename", part.name)
    assert out.open(str(tmp_path / "a.exr"), tuple(p.spec for p in parts))
    for i, part in enumerate(parts):
        assert i == 0 or out.open(str(tmp_path / "a.exr"), part.spec, "AppendSubimage")
        assert out.write_image(part.pixels())
    out.close()
    image = read(tmp_path / "a.exr")
    assert [(p.name, p.spec.x, p.spec.width, str(p.spec.format)) for p in image.parts] == [
        ("tile", -2, 7, "half"),
        ("st", 0, 4, "float"),
        ("label.1", 1, 3, "uint"),
    ]
    for i in (2, 0, 1, 0, 2):  # in any order: they share one open file
        assert_same(image.parts[i], parts[i].pixels())
    assert image.part("label.1") is image.parts[2]
    assert image.part("label") is None
    assert image.first is image.parts[0]


def test_parts_without_a_name_are_numbered(tmp_path):
    pages = (part_of("a", "uint8", 3, 4, 3), part_of("b", "float", 5, 2, 1))
    out = oiio.ImageOutput.create(str(tmp_path / "a.tif"))
    for mode, page in zip(("Create", "AppendSubimage"), pages, strict=True):
        assert out.open(str(tmp_path / "a.tif"), page.spec, mode)
        assert out.write_image(page.pixels())
    out.close()
    image = read(tmp_path / "a.tif")
    assert [p.name for p in image.parts] == ["part0", "part1"]
    for got, page in zip(image.parts, pages, strict=True):
        assert_same(got, page.pixels())


def test_a_missing_file_is_said_to_be_missing(tmp_path):
    assert refusal(read, tmp_path / "no.exr") == f"{tmp_path / 'no.exr'}: no such file"


@pytest.mark.parametrize("name", ["text.exr", "text.txt", "text", "empty.png", "folder"])
def test_what_is_no_image_is_refused_by_name(tmp_path, name):
    path = tmp_path / name
    if name == "folder":
        path.mkdir()
    else:
        path.write_text("" if name.startswith("empty") else "not an image\n" * 100)
    says = "a folder" if name == "folder" else "cannot read the image: "
    assert refusal(read, path).startswith(f"{path}: {says}")


@pytest.mark.parametrize("name", ["a.exr", "a.tif", "a.png", "a.hdr", "a.jpg"])
def test_a_truncated_file_is_an_error_and_not_half_an_image(tmp_path, name):
    kind = "float" if name in ("a.exr", "a.hdr") else "uint8"
    path = put(tmp_path / name, np.abs(noise(kind, 64, 60, 3)), spec_of(kind, 64, 60, 3))
    read(path).first.pixels()  # the whole file is sound
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    assert refusal(lambda: read(path).first.pixels()).startswith(f"{path}: ")


def test_a_deep_image_has_no_flat_pixels(tmp_path):
    part = read(deep_file(tmp_path / "deep.exr")).first
    assert part.buffer(part.window).deep
    assert refusal(part.pixels) == f"part '{part.name}' is deep: expected a flat image; flatten it first"


# --- every common format ---

FORMATS = {
    "a.exr": "half", "b.exr": "float", "a.tif": "uint16", "a.png": "uint8", "b.png": "uint16", "a.jpg": "uint8",
    "a.tga": "uint8", "a.bmp": "uint8", "a.dpx": "uint16", "a.hdr": "float", "a.webp": "uint8", "a.jp2": "uint8",
    "a.sgi": "uint8", "a.ppm": "uint8", "a.gif": "uint8", "a.fits": "float", "a.rla": "uint8", "a.jxl": "uint8",
    "a.pfm": "float", "a.ico": "uint8", "a.iff": "uint8",
}  # fmt: skip
CODECS = ("none", "rle", "zips", "zip", "piz", "pxr24", "b44a", "dwaa", "dwab", "htj2k256")
TILED = {"tile_width": 32, "tile_height": 16}


def any_windows(whole: Window, count: int = 25) -> list[Window]:
    """In no order, single pixels and the whole among them."""
    random = np.random.default_rng(7)
    windows = [whole, Window.sized(whole.right - 1, whole.bottom - 1, 1, 1)]
    for _ in range(count):
        (x0, x1), (y0, y1) = (np.sort(random.integers(0, size, 2)) for size in (whole.width, whole.height))
        windows.append(Window(int(x0), int(y0), int(x1) + 1, int(y1) + 1).shifted(whole.left, whole.top))
    return windows


def whole_by_oiio(path: Path, level: int = 0) -> np.ndarray:
    file = oiio.ImageInput.open(str(path), oiio.ImageSpec())  # as oiiotool does: PFM is flipped upright
    assert file.seek_subimage(0, level)
    spec = file.spec()
    return file.read_image(0, level, 0, spec.nchannels, spec.format).reshape(spec.height, spec.width, spec.nchannels)


def assert_any_window(path: Path, small_pieces: pytest.MonkeyPatch) -> None:
    small_pieces.setattr(reading, "_PIECE_BYTES", 1 << 14)
    part, pixels = read(path).first, whole_by_oiio(path)
    for window in any_windows(part.window):
        np.testing.assert_array_equal(part.read(window), pixels[window.inside(part.window)])


def made(path: Path, spec: oiio.ImageSpec) -> Path:
    buffer = oiio.ImageBuf(spec)
    pixels = np.random.default_rng(3).random((spec.height, spec.width, spec.nchannels))
    buffer.set_pixels(buffer.roi, pixels.astype(np.float32))
    assert buffer.write(str(path)), buffer.geterror()
    return path


@pytest.mark.parametrize(("name", "kind"), FORMATS.items())
def test_any_window_of_any_format_is_the_whole_cropped(tmp_path, monkeypatch, name, kind):
    side = (150, 190) if name != "a.ico" else (64, 96)
    assert_any_window(made(tmp_path / name, spec_of(kind, *side, 3)), monkeypatch)


@pytest.mark.parametrize("facts", [{}, TILED], ids=["scanlines", "tiles"])
@pytest.mark.parametrize("codec", CODECS)
def test_any_window_of_any_exr_is_the_whole_cropped(tmp_path, monkeypatch, codec, facts):
    spec = spec_of("half", 330, 190, 4, compression=codec, **facts, **WINDOWS)
    assert_any_window(made(tmp_path / "a.exr", spec), monkeypatch)


@pytest.mark.parametrize("facts", [{}, TILED], ids=["scanlines", "tiles"])
@pytest.mark.parametrize("planes", ["contig", "separate"])
@pytest.mark.parametrize("codec", ["none", "zip", "lzw", "packbits"])
def test_any_window_of_any_tiff_is_the_whole_cropped(tmp_path, monkeypatch, codec, planes, facts):
    spec = spec_of("uint16", 150, 190, 4, compression=codec, planarconfig=planes, **facts)
    assert_any_window(made(tmp_path / "a.tif", spec), monkeypatch)


@pytest.mark.parametrize("name", ["a.tx", "a.exr"])
def test_any_window_of_any_level_of_a_mip_mapped_file_is_that_level_cropped(tmp_path, monkeypatch, name):
    monkeypatch.setattr(reading, "_PIECE_BYTES", 1 << 14)
    buffer = oiio.ImageBuf(str(made(tmp_path / "photo.exr", spec_of("float", 150, 190, 3))))
    assert oiio.ImageBufAlgo.make_texture(oiio.MakeTxTexture, buffer, str(tmp_path / name)), oiio.geterror()
    (part,) = read(tmp_path / name).parts
    assert len(part.levels) >= 7
    assert (part.levels[-1].spec.width, part.levels[-1].spec.height) == (1, 1)
    for n, level in enumerate((part, *part.levels)):
        pixels = whole_by_oiio(tmp_path / name, n)
        for window in any_windows(level.window, 10):
            np.testing.assert_array_equal(level.read(window), pixels[window.inside(level.window)])


@pytest.mark.parametrize("name", ["a.exr", "a.tif", "a.png", "a.jpg", "a.webp", "a.tx"])
def test_several_threads_read_one_file_at_once(tmp_path, monkeypatch, name):
    monkeypatch.setattr(reading, "_PIECE_BYTES", 1 << 14)
    facts = TILED | {"tile_height": 32} if name == "a.tx" else {}
    path = made(tmp_path / name, spec_of("uint8" if name != "a.exr" else "half", 300, 190, 3, **facts))
    pixels, part = whole_by_oiio(path), read(path, PieceCache(1 << 17)).first  # a cache of a few pieces
    windows = any_windows(part.window, 60)
    with ThreadPoolExecutor(6) as pool:
        for window, found in zip(windows, pool.map(part.read, windows), strict=True):
            np.testing.assert_array_equal(found, pixels[window.inside(part.window)])


# --- how often and how much is decoded ---


@pytest.fixture
def decoded(monkeypatch) -> list[Window]:
    """Which pieces have been decoded."""
    seen: list[Window] = []
    genuine = reading._OpenFile.read

    def spy(self, place: Window, *rest: object) -> np.ndarray:
        pixels = genuine(self, place, *rest)
        seen.append(place)
        return pixels

    monkeypatch.setattr(reading._OpenFile, "read", spy)
    return seen


@pytest.mark.parametrize("facts", [{}, {"tile_width": 64, "tile_height": 64}], ids=["scanlines", "tiles"])
def test_every_pixel_is_decoded_once_where_bands_overlap(tmp_path, decoded, facts):
    path = made(tmp_path / "a.exr", spec_of("half", 1500, 900, 4, compression="none", **facts))
    part = read(path).first
    assert decoded == []  # nothing before it is asked for
    for band in part.window.cells(900, 50):
        part.read(band.grown(0, 20) & part.window)
    assert len(decoded) > 1
    assert len(set(decoded)) == len(decoded)
    assert sum(place.width * place.height for place in decoded) == 1500 * 900


def test_only_what_lies_under_a_window_and_the_next_piece_are_decoded(tmp_path, decoded):
    path = made(tmp_path / "a.exr", spec_of("float", 3000, 1000, 4, compression="none", tile_width=64, tile_height=64))
    part = read(path).first
    part.read(Window(500, 1500, 510, 1510))
    while len(decoded) < 2:  # the next one is decoded on a thread of its own
        assert threading.active_count() > 1
    assert sum(place.width * place.height * 16 for place in decoded) <= 9 << 20
    assert all(abs(place.top - 1500) < 600 for place in decoded)


def test_a_wide_scanline_file_is_read_by_bands_and_held_in_some_pieces(tmp_path, decoded):
    row = np.random.default_rng(1).random((1, 100_000, 4)).astype(np.float32)
    spec = spec_of("float", 200, 100_000, 4, compression="none")  # 320 MB
    out = oiio.ImageOutput.create("a.tif")
    assert out.open(str(tmp_path / "a.tif"), spec)
    for y in range(200):
        assert out.write_scanlines(y, y + 1, 0, row + np.float32(y)), out.geterror()
    assert out.close()
    cache = PieceCache(32 << 20)
    part = read(tmp_path / "a.tif", cache).first
    for band in bands(part):
        pixels = part.read(band)
        np.testing.assert_array_equal(
            pixels[:, ::501], row[:, ::501] + np.arange(band.top, band.bottom, dtype=np.float32)[:, None, None]
        )
        held = sum(piece.result().nbytes for piece in cache._pieces.values() if piece.done())
        assert held <= cache.limit + (8 << 20)  # those being decoded come on top
    assert len(decoded) == len(set(decoded))
    assert max(place.width * place.height * 16 for place in decoded) <= 4 << 20


def test_files_of_a_run_share_a_cache(tmp_path, decoded):
    cache = PieceCache(1 << 20)
    paths = [put(tmp_path / f"{n}.tif", noise("uint8", 5, 6, n), spec_of("uint8", 5, 6, n)) for n in (1, 3)]
    parts = [read(path, cache).first for path in paths]
    for _ in range(2):
        for n, part in zip((1, 3), parts, strict=True):
            assert_same(part, noise("uint8", 5, 6, n))
    assert len(decoded) == 2
    assert len(cache._pieces) == 2


# --- how it is opened ---


def test_what_ops_of_the_host_see_is_said_when_a_file_is_read(tmp_path):
    path = put(tmp_path / "a.png", noise("uint8", 5, 6, 3), spec_of("uint8", 5, 6, 3))
    for native, kind in ((False, "float"), (True, "uint8")):
        part = read(path, native=native).first
        assert (str(part.stored), part.native, str(part.working_type)) == ("uint8", native, kind)


def test_hints_reach_the_reader(tmp_path):
    pixels = np.uint8([[[200, 100, 50, 128]]])
    path = put(tmp_path / "a.png", pixels, spec_of("uint8", 1, 1, 4, **{"oiio:UnassociatedAlpha": 1}))
    hint = oiio.ImageSpec()
    hint.attribute("oiio:UnassociatedAlpha", 1)
    np.testing.assert_array_equal(read(path, config=hint).first.pixels(), pixels)
    assert read(path).first.pixels()[0, 0, 0] < 110  # premultiplied


def test_a_name_that_is_not_utf_8_is_refused(tmp_path):
    name = os.fsdecode(os.fsencode(tmp_path) + b"/caf\xe9.exr")
    Path(name).write_bytes(b"")
    assert refusal(read, name) == f"{tmp_path}/caf\\xe9.exr: the file name is not UTF-8, as OpenImageIO requires"
