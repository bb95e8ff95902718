# SPDX-License-Identifier: Apache-2.0
"""Indexed images: a result as its photo and an index gives the bits of the result, by windows, or is refused."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex.engine.core.image import Image, Part, from_pixels
from oiiotex.engine.core.piece_cache import PieceCache
from oiiotex.engine.core.source_map import SourceMap
from oiiotex.engine.core.window import Window
from oiiotex.engine.errors import ImageError
from oiiotex.engine.io.copies import is_indexed
from oiiotex.engine.io.formats import Format
from oiiotex.engine.io.reading import read
from oiiotex.engine.io.writing import require_writable, write
from tests.conftest import run_in, save

PHOTO = 61, 47  # width and height, px
RESULT = 530, 290  # cells of 256 px, and parts of cells


def photo(channels: int = 3, kind: str = "half") -> Part:
    values = np.random.default_rng(channels).random((PHOTO[1], PHOTO[0], channels)).astype(kind.replace("half", "f2"))
    return from_pixels("photo", values, oiio.ImageSpec(*PHOTO, channels, kind), oiio.TypeDesc(kind))


def pieces(seed: int = 0, size: tuple[int, int] = RESULT) -> SourceMap:
    """Source pixels of pieces of 20 x 30 px, and of single pixels."""
    random, (width, height) = np.random.default_rng(seed), size
    y, x = np.indices((height, width))
    down, right = random.integers(0, 1000, (2, height // 30 + 1, width // 20 + 1))[:, y // 30, x // 20]
    single = random.random(y.shape) < 0.001
    return SourceMap.of((y + down + single) % PHOTO[1], (x + right + 3 * single) % PHOTO[0])


def material(source: SourceMap | None = None) -> Image:
    """Three maps that are copied from the same places."""
    source = source or pieces()
    parts = [source.parts(f"map{n}", photo(n), "xy")[f"map{n}"] for n in (3, 1, 4)]
    return Image(tuple(replace(part, name=f"map{n}") for n, part in enumerate(parts)))


def written(image: Image, path: Path, **settings: object) -> Path:
    write(image, path, Format(**settings))
    return path


@pytest.mark.parametrize(
    "settings", [{}, {"tile": (64, 32)}, {"scanline": True}, {"pixel_type": oiio.TypeDesc("float")}]
)
def test_the_bits_are_those_of_an_exr_file(tmp_path, settings):
    indexed, plain = (read(written(material(), tmp_path / name, **settings)) for name in ("a.oiiotex", "a.exr"))
    assert [part.name for part in indexed.parts] == [part.name for part in plain.parts] == ["map0", "map1", "map2"]
    for ours, theirs in zip(indexed.parts, plain.parts, strict=True):
        assert (ours.window, ours.spec.format, ours.spec.channelnames) == (
            theirs.window,
            theirs.spec.format,
            theirs.spec.channelnames,
        )
        assert ours.spec["wrapmodes"] == theirs.spec["wrapmodes"] == "periodic,periodic"
        np.testing.assert_array_equal(ours.pixels(), theirs.pixels())


@pytest.mark.parametrize("compression", ["none", "piz", "dwaa", "b44a", "pxr24"])
def test_no_compression_rounds_the_index(tmp_path, compression):
    path = written(material(), tmp_path / "a.oiiotex", attributes={"compression": compression})
    source, kept = pieces(), read(path).first.fetch.sources
    np.testing.assert_array_equal(kept.read(Window(0, 0, *RESULT)).yx, source.yx)


@pytest.mark.parametrize("limit", [1 << 30, 1 << 16])  # the photo is held, or read by rows
def test_a_window_is_the_whole_cropped(tmp_path, limit):
    path = written(material(), tmp_path / "a.oiiotex")
    whole, cache = read(path).first.pixels(), PieceCache(limit)
    part = read(path, cache).first
    for window in (Window(250, 100, 260, 290), Window(0, 0, 1, 1), Window(512, 256, *RESULT), Window(3, 5, 400, 9)):
        np.testing.assert_array_equal(part.read(window), whole[window.inside(part.window)])


def test_a_copy_of_the_file_is_written_from_its_maps(tmp_path):
    first = written(material(), tmp_path / "a.oiiotex")
    second = written(read(first), tmp_path / "b.oiiotex")
    assert abs(first.stat().st_size - second.stat().st_size) < 500 and is_indexed(second)
    np.testing.assert_array_equal(read(second).parts[2].pixels(), read(first).parts[2].pixels())


def test_large_pieces_take_little(tmp_path):
    y, x = np.indices((1024, 1024))
    source = SourceMap.of((y + y // 128 * 11) % PHOTO[1], (x + x // 128 * 7) % PHOTO[0])
    indexed = written(material(source), tmp_path / "a.oiiotex")
    maps = sum(part.spec.width * part.spec.height * part.pixel_bytes for part in map(photo, (3, 1, 4)))
    assert 8 * (indexed.stat().st_size - maps) < 0.3 * 1024**2  # bits of the index for each pixel


def changed(part: Part) -> Part:
    return replace(part, fetch=lambda window: 2 * part.read(window))


@pytest.mark.parametrize(
    ("image", "text"),
    [
        (Image((photo(),)), "photo: not copied from a photo, or changed since"),
        (Image((*material().parts[:2], changed(material().parts[2]))), "map2: not copied"),
        (Image((material().first, material(pieces(0, (90, 90))).parts[1])), "expected maps of one size"),
    ],
)
def test_what_is_no_copy_is_refused_before_the_work(tmp_path, image, text):
    for refuse in (require_writable, write):
        with pytest.raises(ImageError, match=rf"a\.oiiotex: .*{text}"):
            refuse(image, tmp_path / "a.oiiotex")
    assert not os.listdir(tmp_path)


def test_maps_that_are_copied_from_different_places_are_refused(tmp_path):
    image = Image((material().first, material(pieces(1)).parts[1]))
    with pytest.raises(ImageError, match="map0, map1: expected maps that are copied from the same places"):
        write(image, tmp_path / "a.oiiotex")
    assert not os.listdir(tmp_path)


def spoiled(tmp_path: Path, change) -> Path:
    """An indexed image whose parts are changed before they are written."""
    stored = read(written(material(), tmp_path / "whole.oiiotex").rename(tmp_path / "whole.exr")).parts
    path = written(Image(tuple(change(list(stored)))), tmp_path / "bad.exr", tile=(256, 256))
    return path.rename(tmp_path / "bad.oiiotex")


def with_index(values=None, **attributes: int):
    def change(parts: list[Part]) -> list[Part]:
        *maps, index = parts
        pixels = np.array(index.pixels())
        if values is not None:
            pixels[3, 5] = values
        spec = oiio.ImageSpec(index.spec)
        for name, value in attributes.items():
            spec.attribute(f"oiiotex:{name}", value)
        return [*maps, replace(index, spec=spec, fetch=lambda window: pixels[window.inside(index.window)])]

    return change


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (with_index((4000, 0)), "the index is damaged: it has numbers without an offset"),
        (with_index((1 << 31, 0)), "the index is damaged: it has numbers"),
        (with_index(index=2), "version 2 of the index: expected 1"),
        (lambda parts: parts[:3], "expected maps of one size, and their index"),
        (lambda parts: [parts[0], parts[3], parts[1]], "expected maps of one size, and their index"),
        (lambda parts: parts[3:], "expected maps of one size, and their index"),
    ],
    ids=["number", "large", "version", "none", "order", "alone"],
)
def test_an_index_that_is_wrong_is_refused(tmp_path, change, text):
    path = spoiled(tmp_path, change)
    with pytest.raises(ImageError, match=rf"bad\.oiiotex: {text}"):
        read(path).first.pixels()


@pytest.mark.parametrize("offset", [PHOTO[0], PHOTO[1] << 16, 0xFFFFFFFF])
def test_offsets_outside_the_maps_are_refused(tmp_path, offset):
    def change(parts: list[Part]) -> list[Part]:
        *maps, index = parts
        pixels = np.array(index.pixels())
        pixels[0, 0, 1] = offset  # of the first number
        return [*maps, replace(index, fetch=lambda window: pixels[window.inside(index.window)])]

    part = read(spoiled(tmp_path, change)).first
    with pytest.raises(ImageError, match="offsets outside the 61x47 pixels of the maps"):
        part.pixels()
    beside = Window(256, 0, *RESULT)  # other cells are read without it
    np.testing.assert_array_equal(part.read(beside), material().first.read(beside))


def test_maps_of_different_sizes_are_refused(tmp_path):
    def change(parts: list[Part]) -> list[Part]:
        spec = oiio.ImageSpec(parts[1].spec)
        spec.width -= 1
        return [parts[0], replace(parts[1], spec=spec), *parts[2:]]

    with pytest.raises(ImageError, match="expected maps of one size"):
        read(spoiled(tmp_path, change))


def test_a_truncated_file_is_refused(tmp_path):
    whole = written(material(), tmp_path / "a.oiiotex").read_bytes()
    path = tmp_path / "cut.oiiotex"
    for count in (0, 3, 4, 100, len(whole) // 3, len(whole) - 1):
        path.write_bytes(whole[:count])
        with pytest.raises(ImageError, match=r"cut\.oiiotex: ") as caught:
            for part in read(path).parts:
                part.pixels()
        assert "/dev/fd" not in str(caught.value) and "\n" not in str(caught.value)


def test_lines_write_and_read_it(tmp_path):
    random = np.random.default_rng(2)
    for name, channels in (("color", 3), ("height", 1)):
        save(
            random.random((40, 48, channels)),
            tmp_path / f"{name}.exr",
            "half",
            "lin_rec709_scene" if channels > 1 else "data",
        )
    make = ("color.exr", "height.exr", "--texstationarize:kinds=color,height:size=70x60:sigma=8:flattening=0.5")
    run_in(tmp_path, "--nosoftwareattrib", *make, "--siappendall", "-o", "tile.exr", "-o", "tile.oiiotex")
    run_in(tmp_path, "--nosoftwareattrib", "tile.oiiotex", "-o", "back.exr")
    assert run_in(tmp_path, "-a", "--diff", "tile.exr", "back.exr").stdout.endswith("PASS\n")
    one, other = (run_in(tmp_path, "-a", "--info:verbose=1", name).stdout for name in ("tile.exr", "back.exr"))
    assert one.replace("tile", "back") == other


def test_a_line_is_refused_before_its_work(tmp_path, fails):
    save(np.random.default_rng(3).random((40, 48, 3)), tmp_path / "photo.exr", "half", "lin_rec709_scene")
    for words in (["--texsynth:size=64x64"], ["--texquilt:size=64x64:st=1"], ["--texquilt", "--blur", "3x3"]):
        assert "not copied from a photo" in fails("photo.exr", *words, "-o", "out.oiiotex")
