# SPDX-License-Identifier: Apache-2.0
"""How images leave: exactly as they are, as far as the format has types, windows, channels, tiles and levels."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex.engine.core.image import Image, Part, from_pixels, type_named
from oiiotex.engine.core.window import Window
from oiiotex.engine.io.formats import Format
from oiiotex.engine.io.reading import read
from oiiotex.engine.io.writing import write
from tests.parts import (
    NUMPY,
    WINDOWS,
    assert_same,
    coordinates,
    counted,
    noise,
    part_of,
    put,
    refusal,
    small,
    spec_of,
)

WIDE = 900_000  # pixels in a row that makes a band of few rows; libpng takes no more than a million

# --- pixels, parts, metadata ---


@pytest.mark.parametrize(
    ("name", "kind"),
    [("a.exr", "half"), ("a.exr", "float"), ("a.exr", "uint"), ("a.png", "uint8"), ("a.png", "uint16")]
    + [("a.tif", kind) for kind in NUMPY if kind not in ("half", "double")],
)
def test_what_is_written_in_a_type_the_format_has_comes_back_to_the_bit(tmp_path, name, kind):
    image = small(kind)
    write(image, tmp_path / name)
    assert_same(read(tmp_path / name).first, image.first.pixels())
    assert os.listdir(tmp_path) == [name]


@pytest.mark.parametrize("name", ["a.exr", "a.tif"])
def test_parts_with_their_own_types_come_back_to_the_bit(tmp_path, name):
    kinds = ("half", "float", "uint") if name == "a.exr" else ("uint16", "float", "uint")
    parts = [part_of(f"p.{kind}", kind, 9, 7, channels) for kind, channels in zip(kinds, (4, 2, 1), strict=True)]
    write(Image(tuple(parts)), tmp_path / name)
    image = read(tmp_path / name)
    assert [str(p.spec.format) for p in image.parts] == list(kinds)
    assert [p.spec.nchannels for p in image.parts] == [4, 2, 1]
    for got, part in zip(image.parts, parts, strict=True):
        assert_same(got, part.pixels())


def test_parts_of_an_exr_keep_their_names_and_windows(tmp_path):
    windows = [WINDOWS, WINDOWS | {"x": 0, "y": 0}]
    parts = [part_of("tile", "half", 9, 7, 3, **windows[0]), part_of("st", "float", 4, 5, 2, **windows[1])]
    write(Image(tuple(parts)), tmp_path / "a.exr")
    image = read(tmp_path / "a.exr")
    assert [p.name for p in image.parts] == ["tile", "st"]
    assert [{name: getattr(p.spec, name) for name in WINDOWS} for p in image.parts] == windows
    assert_same(image.part("st"), parts[1].pixels())


@pytest.mark.parametrize("tiled", [True, False], ids=["first tiled", "second tiled"])
def test_parts_of_an_exr_are_all_tiled_or_none(tmp_path, tiled):
    """As where labels follow a photo from a tiled TIFF."""
    tile = {"tile_width": 16, "tile_height": 16}
    parts = (
        part_of("photo", "half", 50, 40, 3, **(tile if tiled else {})),
        part_of("label.1", "uint", 50, 40, 1, **({} if tiled else tile)),
    )
    write(Image(parts), tmp_path / "a.exr")
    made = read(tmp_path / "a.exr").parts
    assert [p.spec.tile_width for p in made] == [16 * tiled] * 2
    for part, before in zip(made, parts, strict=True):
        assert_same(part, before.pixels())


def test_parts_of_an_exr_may_have_a_pixel_aspect_ratio(tmp_path):
    tile = part_of("tile", "half", 4, 5, 3, PixelAspectRatio=2.0)
    st = part_of("st", "float", 4, 5, 2)
    write(Image((tile, st)), tmp_path / "a.exr")  # OpenEXR wants it the same in all parts
    image = read(tmp_path / "a.exr")
    assert image.first.spec.get_float_attribute("PixelAspectRatio") == 2
    assert_same(image.part("st"), st.pixels())


def test_the_type_asked_for_is_that_of_all_parts_but_ids_and_what_must_be_exact(tmp_path):
    st = dataclasses.replace(part_of("st", "float", 4, 5, 2), exact=True)
    parts = (part_of("tile", "float", 4, 5, 3), part_of("more", "float", 4, 5, 3), st, part_of("id", "uint", 4, 5, 1))
    write(Image(parts), tmp_path / "a.exr", type_named("half"))
    image = read(tmp_path / "a.exr")
    assert [str(p.spec.format) for p in image.parts] == ["half", "half", "float", "uint"]
    for got, part in zip(image.parts, parts, strict=True):
        assert_same(got, part.pixels().astype(got.pixels().dtype))


def test_without_a_type_asked_for_the_format_takes_what_it_has(tmp_path):
    pixels = np.float32([[[0, 0.5, 1], [0.25, 2, -1]]])
    write(Image((from_pixels("a", pixels, spec_of("float", 1, 2, 3)),)), tmp_path / "a.png")
    assert_same(read(tmp_path / "a.png").first, np.uint8([[[0, 128, 255], [64, 255, 0]]]))


def test_windows_metadata_and_channel_names_leave_as_they_came(tmp_path):
    spec = spec_of("half", 9, 7, ("Z", "B", "diffuse.R", "R", "A", "G"), **WINDOWS)
    for name, value in (("Artist", "Ada"), ("studio:shot", 17), ("studio:gain", 2.5)):
        spec.attribute(name, value)
    spec.attribute("oiio:ColorSpace", "lin_rec709_scene")
    pixels = noise("half", 9, 7, 6)
    put(tmp_path / "a.exr", pixels, spec)
    write(read(tmp_path / "a.exr"), tmp_path / "b.exr")
    source, part = read(tmp_path / "a.exr").first, read(tmp_path / "b.exr").first
    assert part.spec.channelnames == source.spec.channelnames
    assert {name: getattr(part.spec, name) for name in WINDOWS} == WINDOWS
    assert part.spec.get_string_attribute("Artist") == "Ada"
    assert part.spec.get_int_attribute("studio:shot") == 17
    assert part.spec.get_float_attribute("studio:gain") == 2.5
    assert part.spec.get_string_attribute("oiio:ColorSpace") == "lin_rec709_scene"
    for i, name in enumerate(("Z", "B", "diffuse.R", "R", "A", "G")):
        np.testing.assert_array_equal(part.pixels()[..., part.spec.channelindex(name)], pixels[..., i])


def test_a_file_can_be_written_over_while_it_is_read(tmp_path):
    image = small("half")
    write(image, tmp_path / "a.exr")
    write(read(tmp_path / "a.exr"), tmp_path / "a.exr", type_named("float"))
    assert_same(read(tmp_path / "a.exr").first, image.first.pixels().astype(np.float32))


def test_rows_are_asked_for_band_by_band_in_order_and_once(tmp_path):
    spec = spec_of("uint8", 7, WIDE, 3)
    asked: list[Window] = []

    def fetch(window: Window) -> np.ndarray:
        asked.append(window)
        return np.zeros((window.height, window.width, 3), np.uint8)

    part = Part("wide", spec, fetch)
    write(Image((part,)), tmp_path / "a.tif")
    assert len(asked) > 1
    assert all((window.left, window.right) == (0, WIDE) for window in asked)
    assert [row for window in asked for row in range(window.top, window.bottom)] == list(range(7))


def test_progress_is_told_in_rows(tmp_path):
    told: list[tuple[int, int]] = []
    parts = (part_of("a", "uint8", 7, WIDE, 3), part_of("b", "uint8", 5, 6, 3))
    write(Image(parts), tmp_path / "a.tif", advance=lambda done, total: told.append((done, total)))
    assert told == sorted(told)
    assert (told[-1], len(told) > 2) == ((12, 12), True)


# --- types ---


@pytest.mark.parametrize(("stored", "kind"), [(None, "half"), ("float", "float")], ids=["computed", "of a file"])
def test_what_is_computed_is_written_as_the_first_file_was_and_what_is_stored_as_it_is(tmp_path, stored, kind):
    pixels = noise("float", 5, 6, 3)
    part = from_pixels("a", pixels, spec_of("float", 5, 6, 3), stored and type_named(stored))
    write(Image((part,)), tmp_path / "a.exr", Format(computed_type=type_named("half")))
    assert_same(read(tmp_path / "a.exr").first, pixels.astype(NUMPY[kind]))


def mixed(path: Path) -> Path:
    spec = spec_of("float", 4, 5, ("R", "G", "B", "Z"))
    spec.channelformats = tuple(map(oiio.TypeDesc, ("half", "half", "half", "float")))
    return put(path, noise("float", 4, 5, 4), spec)


def kinds(path: Path) -> list[str]:
    spec = read(path).first.spec
    return [str(spec.channelformat(c)) for c in range(spec.nchannels)]


@pytest.mark.parametrize(
    ("how", "expected"),
    [
        (None, ["half", "half", "half", "float"]),
        (type_named("float"), ["float"] * 4),
        (type_named("half"), ["half"] * 4),
        (Format(channel_types={"Z": type_named("half"), "G": type_named("float")}), ["half", "float", "half", "half"]),
        (Format(channel_types={"part0.R": type_named("uint")}), ["uint", "half", "half", "float"]),
        (Format(pixel_type=type_named("half"), channel_types={"Z": type_named("uint")}), ["half"] * 3 + ["uint"]),
        (Format(computed_channels={"R": type_named("float")}), ["half", "half", "half", "float"]),
    ],
    ids=["as they are", "all float", "all half", "single ones", "of a part", "all but one", "of what is computed"],
)
def test_channels_keep_their_own_types_unless_others_are_asked_for(tmp_path, how, expected):
    write(read(mixed(tmp_path / "a.exr")), tmp_path / "b.exr", how)
    assert kinds(tmp_path / "b.exr") == expected


def test_channels_of_what_is_computed_have_the_types_of_the_first_file(tmp_path):
    part = from_pixels("a", noise("float", 4, 5, 3), spec_of("float", 4, 5, ("R", "G", "Z")))
    how = Format(computed_type=type_named("half"), computed_channels={"Z": type_named("float")})
    write(Image((part,)), tmp_path / "a.exr", how)
    assert kinds(tmp_path / "a.exr") == ["half", "half", "float"]


def test_significant_bits_are_said(tmp_path):
    write(small("uint16"), tmp_path / "a.dpx", Format(pixel_type=type_named("uint16"), bits=10))
    assert read(tmp_path / "a.dpx").first.spec.get_int_attribute("oiio:BitsPerSample") == 10
    write(read(tmp_path / "a.dpx"), tmp_path / "b.dpx", type_named("uint8"))
    assert read(tmp_path / "b.dpx").first.spec.get_int_attribute("oiio:BitsPerSample") in (0, 8)


def test_attributes_are_set_and_erased_on_all_parts(tmp_path):
    parts = tuple(part_of(name, "half", 4, 5, 3, Artist="Ada") for name in ("a", "b"))
    write(Image(parts), tmp_path / "a.exr", Format(attributes={"compression": "piz", "Artist": None}))
    for part in read(tmp_path / "a.exr").parts:
        assert part.spec.get_string_attribute("compression") == "piz"
        assert part.spec.get_string_attribute("Artist") == ""
    assert parts[0].spec.get_string_attribute("Artist") == "Ada"


def test_a_format_may_be_named_whatever_the_extension(tmp_path):
    write(small("uint16"), tmp_path / "a.exr", Format(format_name="png"))
    assert (tmp_path / "a.exr").read_bytes()[1:4] == b"PNG"
    assert_same(read(tmp_path / "a.exr").first, small("uint16").first.pixels())


# --- windows and channels that the format lacks ---


@pytest.mark.parametrize("name", ["a.png", "a.jpg", "a.tga"])
def test_a_format_without_a_display_window_gets_its_pixels(tmp_path, name):
    display = {"full_x": 2, "full_y": 1, "full_width": 9, "full_height": 5}
    part = part_of("a", "uint8", 4, 6, 3, x=0, y=3, **display)
    write(Image((part,)), tmp_path / name)
    held = read(tmp_path / name).first
    assert (held.spec.width, held.spec.height) == (9, 5)
    expected = np.zeros((5, 9, 3), np.uint8)
    expected[2:5, 0:4] = part.pixels()[:3, 2:]
    if name != "a.jpg":
        assert_same(held, expected)
    write(Image((part,)), tmp_path / name, Format(autocrop=False))
    assert (read(tmp_path / name).first.spec.width, read(tmp_path / name).first.spec.height) == (6, 4)


def test_a_display_window_without_pixels_is_black(tmp_path):
    write(Image((part_of("a", "uint8", 4, 6, 3, x=100, full_width=5, full_height=5),)), tmp_path / "a.png")
    assert_same(read(tmp_path / "a.png").first, np.zeros((5, 5, 3), np.uint8))


@pytest.mark.parametrize(
    ("name", "channels", "kept"),
    [
        ("a.png", ("R", "G", "B", "A", "Z"), ("R", "G", "B", "A")),
        ("a.png", ("R", "G", "B", "Z", "id"), ("R", "G", "B")),
        ("a.jpg", ("R", "G", "B", "A"), ("R", "G", "B")),
        ("a.hdr", ("R", "G", "B", "X", "Y", "Z"), ("R", "G", "B")),
    ],
)
def test_a_format_gets_as_many_channels_as_it_has_and_the_log_says_so(tmp_path, caplog, name, channels, kept):
    kind = "float" if name == "a.hdr" else "uint8"
    image = Image((part_of("a", kind, 4, 6, channels, alpha_channel=3 if "A" in channels else -1),))
    write(image, tmp_path / name)
    (record,) = caplog.records
    assert record.levelname == "WARNING"
    assert f"{len(channels)} channels; only {', '.join(kept)} are written" in record.getMessage()
    held = read(tmp_path / name).first
    assert held.spec.channelnames == kept
    if name == "a.png" and len(kept) == 3:  # the file has unassociated alpha, the image has not
        assert_same(held, image.first.pixels()[..., :3])


def test_a_format_that_has_all_channels_says_nothing(tmp_path, caplog):
    write(small("half", 7), tmp_path / "a.exr")
    write(small("uint8", 4), tmp_path / "a.png")
    write(small("uint8", 7), tmp_path / "a.tif")
    assert caplog.records == []


# --- tiles and levels ---


def tile_of(path: Path) -> tuple[int, int]:
    spec = read(path).first.spec
    return spec.tile_width, spec.tile_height


@pytest.mark.parametrize("x", [4, 0, -4])
@pytest.mark.parametrize("tile", [(16, 8), (16, 32), (64, 64)])
def test_a_tiled_file_that_is_copied_stays_tiled_where_the_format_has_such_tiles(tmp_path, tile, x):
    pixels = noise("float", 37, 29, 3)
    facts = {"tile_width": tile[0], "tile_height": tile[1], "x": x, "full_x": x}
    put(tmp_path / "a.exr", pixels, spec_of("float", 37, 29, 3, **facts))
    for name in ("b.exr", "b.tif", "b.hdr"):
        write(read(tmp_path / "a.exr"), tmp_path / name)
        if name != "b.tif" or x >= 0:  # TIFF has no negative origins
            assert name == "b.hdr" or np.array_equal(read(tmp_path / name).first.pixels(), pixels)
    assert tile_of(tmp_path / "b.exr") == tile
    assert tile_of(tmp_path / "b.tif") == (tile if tile[1] % 16 == 0 else (0, 0))
    assert tile_of(tmp_path / "b.hdr") == (0, 0)


def test_tiles_are_as_asked_for(tmp_path):
    put(tmp_path / "a.exr", noise("float", 37, 29, 3), spec_of("float", 37, 29, 3, tile_width=16, tile_height=8))
    expected = {"scanline": (0, 0), "tile": (32, 16), "as it was": (16, 8)}
    hows = {"scanline": Format(scanline=True), "tile": Format(tile=(32, 16)), "as it was": None}
    for name, how in hows.items():
        write(read(tmp_path / "a.exr"), tmp_path / "b.exr", how)
        assert tile_of(tmp_path / "b.exr") == expected[name]
        assert_same(read(tmp_path / "b.exr").first, read(tmp_path / "a.exr").first.pixels())
    write(small(), tmp_path / "c.tif", Format(tile=(16, 16)))
    assert tile_of(tmp_path / "c.tif") == (16, 16)
    assert "multiple of 16" in refusal(write, small(), tmp_path / "c.tif", Format(tile=(20, 20)))


def test_tiles_are_asked_for_in_the_order_of_the_file_and_once(tmp_path):
    asked: list[Window] = []
    part = coordinates(60_000, 100, 0, 0)  # a row of tiles is more than a band
    write(Image((counted(part, asked),)), tmp_path / "a.exr", Format(tile=(64, 64), attributes={"compression": "none"}))
    assert asked == sorted(asked, key=lambda window: (window.top, window.left))
    assert sum(w.width * w.height for w in asked) == 60_000 * 100
    assert all(w.left % 64 == 0 and w.top % 64 == 0 for w in asked)
    assert max(w.width * w.height * 8 for w in asked) <= 32 << 20
    held = read(tmp_path / "a.exr").first
    window = Window(31_000, 40, 32_500, 90)
    np.testing.assert_array_equal(held.read(window), part.read(window))


def mapped(path: Path) -> Path:
    buffer = oiio.ImageBuf(spec_of("half", 50, 70, 3))
    buffer.set_pixels(buffer.roi, noise("half", 50, 70, 3))
    assert oiio.ImageBufAlgo.make_texture(oiio.MakeTxTexture, buffer, str(path)), oiio.geterror()
    return path


@pytest.mark.parametrize("target", ["b.exr", "b.tx", "b.tif"])
@pytest.mark.parametrize("source", ["a.exr", "a.tx"])
def test_a_copy_keeps_the_smaller_versions(tmp_path, source, target):
    image = read(mapped(tmp_path / source))
    said = image.first.respecced(lambda spec: spec.attribute("Artist", "Ada"))
    write(Image((said,)), tmp_path / target)
    (part,) = read(tmp_path / target).parts
    assert part.spec.get_string_attribute("Artist") == "Ada"
    assert len(part.levels) == len(image.first.levels) >= 6
    for level, expected in zip((part, *part.levels), (image.first, *image.first.levels), strict=True):
        np.testing.assert_array_equal(level.pixels(), expected.pixels())


@pytest.mark.parametrize(("target", "how"), [("b.png", None), ("b.tif", Format(scanline=True))])
def test_a_copy_without_tiles_or_to_a_format_without_levels_has_none(tmp_path, target, how):
    image = read(mapped(tmp_path / "a.tx"))
    write(image, tmp_path / target, how)
    (part,) = read(tmp_path / target).parts
    assert part.levels == ()
    assert (part.spec.width, part.spec.height) == (image.first.spec.width, image.first.spec.height)
    assert part.spec.get_string_attribute("textureformat") == ""
