# SPDX-License-Identifier: Apache-2.0
"""How images enter and leave: exactly as they are, or not at all."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex.errors import ImageError
from oiiotex.images import (
    Channels,
    Image,
    Part,
    channels_of,
    derived_spec,
    dtype_of,
    from_buffer,
    from_pixels,
    read,
    resized,
    tagged,
    to_buffer,
    type_named,
    without_nonfinite,
    write,
)

NUMPY = {
    "uint8": np.uint8, "int8": np.int8, "uint16": np.uint16, "int16": np.int16, "uint": np.uint32, "int": np.int32,
    "half": np.float16, "float": np.float32, "double": np.float64,
}  # fmt: skip
WIDE = 900_000  # pixels in a row that makes a band of few rows; libpng takes no more than a million
WINDOWS = {"x": 3, "y": -5, "full_x": -1, "full_y": 2, "full_width": 50, "full_height": 40}


def noise(kind: str, height: int, width: int, channels: int) -> np.ndarray:
    """Values over the type's whole range, negative and large ones among them."""
    random = np.random.default_rng([height, width, channels])
    dtype = np.dtype(NUMPY[kind])
    if dtype.kind in "ui":
        info = np.iinfo(dtype)
        return random.integers(info.min, info.max, (height, width, channels), dtype, endpoint=True)
    return (random.standard_normal((height, width, channels)) * 100).astype(dtype)


def spec_of(kind: str, height: int, width: int, channels: int | tuple[str, ...], **facts: object) -> oiio.ImageSpec:
    """`facts` are fields of the spec, or else attributes."""
    spec = oiio.ImageSpec(width, height, channels if isinstance(channels, int) else len(channels), oiio.TypeDesc(kind))
    if not isinstance(channels, int):
        spec.channelnames = channels
    for name, value in facts.items():
        if hasattr(spec, name):
            setattr(spec, name, value)
        else:
            spec.attribute(name, value)
    return spec


def part_of(name: str, kind: str, height: int, width: int, channels: int | tuple[str, ...], **facts: object) -> Part:
    spec = spec_of(kind, height, width, channels, **facts)
    return from_pixels(name, noise(kind, height, width, spec.nchannels), spec)


def put(path: Path, pixels: np.ndarray, spec: oiio.ImageSpec) -> Path:
    """A file written by OpenImageIO alone."""
    out = oiio.ImageOutput.create(str(path))
    assert out.open(str(path), spec), out.geterror()
    if spec.tile_width:
        window = spec.x, spec.x + spec.width, spec.y, spec.y + spec.height, 0, 1
        assert out.write_tiles(*window, pixels), out.geterror()
    else:
        assert out.write_image(pixels), out.geterror()
    assert out.close()
    return path


def refusal(call: Callable, *arguments: object) -> str:
    with pytest.raises(ImageError) as caught:
        call(*arguments)
    text = str(caught.value)
    assert text == " ".join(text.split())
    return text


def assert_same(part: Part, pixels: np.ndarray) -> None:
    assert part.pixels().dtype == pixels.dtype
    np.testing.assert_array_equal(part.pixels(), pixels)


def small(kind: str = "uint8", channels: int = 3) -> Image:
    return Image((part_of("part0", kind, 5, 6, channels),))


@pytest.fixture(scope="module")
def dead_pid() -> int:
    process = subprocess.Popen(["true"])
    process.wait()
    return process.pid


# --- in ---


@pytest.mark.parametrize("tile", [0, 16], ids=["scanlines", "tiles"])
@pytest.mark.parametrize(
    ("name", "kind"),
    [("a.exr", kind) for kind in ("half", "float", "uint")]
    + [("a.tif", kind) for kind in ("uint8", "int16", "uint16", "float", "uint")],
)
def test_any_rows_of_a_file_are_those_of_the_whole_in_its_own_type(tmp_path, name, kind, tile):
    pixels = noise(kind, 37, 29, 3)
    facts = {"x": 3, "y": 5} | ({"tile_width": tile, "tile_height": tile} if tile else {})
    part = read(put(tmp_path / name, pixels, spec_of(kind, 37, 29, 3, **facts))).first
    assert (part.spec.tile_width, part.spec.x, part.spec.y) == (tile, 3, 5)
    assert dtype_of(part.spec) is NUMPY[kind]
    assert_same(part, pixels)
    for begin, end in ((0, 1), (36, 37), (15, 16), (16, 17), (0, 16), (15, 33), (17, 37), (5, 6), (31, 32)):
        rows = part.rows(begin, end)
        assert rows.dtype == pixels.dtype
        np.testing.assert_array_equal(rows, pixels[begin:end])


@pytest.mark.parametrize("tile", [0, 16], ids=["scanlines", "tiles"])
@pytest.mark.parametrize("top", [0, 5])
def test_rows_of_a_tiff_of_doubles_are_right_or_refused(tmp_path, top, tile):
    # OpenImageIO 3.2 hands out uninitialised memory, without an error, for rows of doubles that are not whole strips
    pixels = noise("double", 37, 29, 3)
    facts = {"tile_width": tile, "tile_height": tile} if tile else {}
    path = put(tmp_path / "a.tif", pixels, spec_of("double", 37, 29, 3, y=top, **facts))
    for begin, end in ((0, 37), (7, 11), (20, 37)):
        try:
            rows = read(path).first.rows(begin, end)
        except ImageError:
            continue
        np.testing.assert_array_equal(rows, pixels[begin:end])


@pytest.mark.parametrize("tile", [0, 64], ids=["scanlines", "tiles"])
def test_the_bands_of_a_large_file_put_together_are_the_whole(tmp_path, tile):
    pixels = noise("float", 1030, 701, 4)  # 11.5 MB
    facts = {"tile_width": tile, "tile_height": tile} if tile else {}
    part = read(put(tmp_path / "a.exr", pixels, spec_of("float", 1030, 701, 4, compression="none", **facts))).first
    bands = list(part.bands())
    assert len(bands) > 1
    np.testing.assert_array_equal(np.concatenate([part.rows(*band) for band in bands]), pixels)
    np.testing.assert_array_equal(part.pixels(), pixels)


@pytest.mark.parametrize(("height", "width", "kind"), [(1, 1, "uint8"), (5, 1 << 22, "float"), (4096, 4096, "uint16")])
def test_bands_cover_a_part_once_and_are_a_few_megabytes_or_one_row(height, width, kind):
    spec = spec_of(kind, height, width, 3)
    bands = list(Part("a", spec, lambda begin, end: np.empty(0)).bands())
    assert [row for begin, end in bands for row in range(begin, end)] == list(range(height))
    row_bytes = width * 3 * np.dtype(NUMPY[kind]).itemsize
    assert all((end - begin) * row_bytes <= 16 << 20 or end - begin == 1 for begin, end in bands)


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
    assert refusal(read, path).startswith(f"{path}: not an image that can be read: ")


@pytest.mark.parametrize("name", ["a.exr", "a.tif", "a.png", "a.hdr", "a.jpg"])
def test_a_truncated_file_is_an_error_and_not_half_an_image(tmp_path, name):
    kind = "float" if name in ("a.exr", "a.hdr") else "uint8"
    path = put(tmp_path / name, np.abs(noise(kind, 64, 60, 3)), spec_of(kind, 64, 60, 3))
    read(path).first.pixels()  # the whole file is sound
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    assert refusal(lambda: read(path).first.pixels()).startswith(f"{path}: ")


def deep_file(path: Path) -> Path:
    spec = spec_of("float", 2, 2, ("R", "Z"), deep=True)
    samples = oiio.DeepData()
    samples.init(4, 2, (oiio.TypeDesc("float"),) * 2, ("R", "Z"))
    for pixel in range(4):
        samples.set_samples(pixel, 1)
    out = oiio.ImageOutput.create(str(path))
    assert out.open(str(path), spec)
    assert out.write_deep_image(samples)
    out.close()
    return path


def test_a_deep_image_is_refused(tmp_path):
    path = deep_file(tmp_path / "deep.exr")
    assert refusal(read, path) == f"{path}: deep and volume images are not supported"


# --- channels and types ---


@pytest.mark.parametrize(
    ("names", "alpha", "colour"),
    [
        (("R", "G", "B"), -1, (0, 1, 2)),
        (("R", "G", "B", "A"), 3, (0, 1, 2)),
        (("B", "G", "R"), -1, (2, 1, 0)),
        (("z", "r", "g", "b"), -1, (1, 2, 3)),
        (("A", "B", "G", "R"), 0, (3, 2, 1)),
        (("R", "A", "G", "B"), 1, (0, 2, 3)),
        (("Z", "R", "G", "B", "A"), 4, (1, 2, 3)),
        (("diffuse.R", "diffuse.G", "diffuse.B", "R", "G", "B", "A"), 6, (3, 4, 5)),
        (("Y",), -1, (0,)),
        (("Y", "A"), 1, (0,)),
        (("A", "Y"), 0, (1,)),
        (("U", "V"), -1, (0, 1)),
        (("N.x", "N.y", "N.z", "W"), -1, (0, 1, 2)),
        (("A", "N.x", "N.y", "N.z", "W"), 0, (1, 2, 3)),
        (("A",), 0, ()),
    ],
)
def test_colour_is_rgb_by_name_else_the_first_three_that_are_not_alpha(names, alpha, colour):
    spec = spec_of("half", 2, 2, names)
    spec.alpha_channel = alpha
    assert channels_of(spec) == Channels(colour, None if alpha < 0 else alpha)


@pytest.mark.parametrize(("names", "alpha"), [(("R", "G", "B", "A"), 3), (("a", "y"), 0), (("R", "G", "B"), None)])
def test_alpha_is_found_by_name_where_the_spec_does_not_say_it(names, alpha):
    spec = spec_of("half", 2, 2, names)
    spec.alpha_channel = -1
    assert channels_of(spec).alpha == alpha


@pytest.mark.parametrize("name", list(NUMPY))
def test_a_pixel_type_has_its_numpy_type(name):
    described = type_named(name)
    assert str(described) == name
    assert dtype_of(spec_of(name, 2, 2, 1)) is NUMPY[name]


@pytest.mark.parametrize(
    "name",
    ["uint32", "int32", "banana", "", "FLOAT", "float ", "int64", "string", "float[3]", "color", "point", "half[2]"],
)
def test_what_is_no_pixel_type_is_refused_with_those_there_are(name):
    assert refusal(type_named, name) == f"no pixel type '{name}'; there is {', '.join(NUMPY)}"


def test_pixels_of_a_type_that_numpy_lacks_are_refused():
    assert "int64" in refusal(dtype_of, spec_of("int64", 2, 2, 1))


# --- out: what is written ---


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


def test_parts_of_an_exr_may_have_a_pixel_aspect_ratio(tmp_path):
    tile = part_of("tile", "half", 4, 5, 3, PixelAspectRatio=2.0)
    st = part_of("st", "float", 4, 5, 2)
    write(Image((tile, st)), tmp_path / "a.exr")  # OpenEXR wants it the same in all parts
    image = read(tmp_path / "a.exr")
    assert image.first.spec.get_float_attribute("PixelAspectRatio") == 2
    assert_same(image.part("st"), st.pixels())


def test_the_type_asked_for_is_that_of_the_first_part_alone(tmp_path):
    parts = (part_of("tile", "half", 4, 5, 3), part_of("st", "float", 4, 5, 2), part_of("id", "uint", 4, 5, 1))
    write(Image(parts), tmp_path / "a.exr", type_named("float"))
    image = read(tmp_path / "a.exr")
    assert [str(p.spec.format) for p in image.parts] == ["float", "float", "uint"]
    assert_same(image.first, parts[0].pixels().astype(np.float32))
    assert_same(image.parts[2], parts[2].pixels())


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


def test_a_tiled_file_can_be_written_out_again(tmp_path):
    pixels = noise("float", 37, 29, 3)
    put(tmp_path / "a.exr", pixels, spec_of("float", 37, 29, 3, tile_width=16, tile_height=8, x=-4))
    for name in ("b.exr", "b.tif"):
        write(read(tmp_path / "a.exr"), tmp_path / name)
        assert_same(read(tmp_path / name).first, pixels)


def test_a_file_can_be_written_over_while_it_is_read(tmp_path):
    image = small("half")
    write(image, tmp_path / "a.exr")
    write(read(tmp_path / "a.exr"), tmp_path / "a.exr", type_named("float"))
    assert_same(read(tmp_path / "a.exr").first, image.first.pixels().astype(np.float32))


def test_rows_are_asked_for_band_by_band_in_order_and_once(tmp_path):
    spec = spec_of("uint8", 7, WIDE, 3)
    asked = []

    def rows(begin, end):
        asked.append((begin, end))
        return np.zeros((end - begin, WIDE, 3), np.uint8)

    part = Part("wide", spec, rows)
    write(Image((part,)), tmp_path / "a.tif")
    assert asked == list(part.bands())
    assert len(asked) > 1


# --- out: what is refused, and what that leaves ---

CANNOT = {
    "a.png": ("half", "float", "uint", "int8"),
    "a.exr": ("uint8", "uint16", "double", "int"),
    "a.tif": ("half",),
    "a.jpg": ("uint16", "float"),
}


@pytest.mark.parametrize(("name", "kind"), [(name, kind) for name, kinds in CANNOT.items() for kind in kinds])
def test_a_type_asked_for_that_the_format_cannot_hold_is_refused(tmp_path, name, kind):
    text = refusal(write, small("float"), tmp_path / name, type_named(kind))
    assert text.startswith(f"{tmp_path / name}: ")
    assert text.endswith(f" cannot hold part 'part0' as {kind}")
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize(("name", "kind"), [("a.tif", "half"), ("a.exr", "uint16"), ("a.exr", "double")])
def test_a_further_part_that_the_format_cannot_hold_as_it_is_is_refused(tmp_path, name, kind):
    text = refusal(write, Image((part_of("tile", "float", 3, 3, 3), part_of("label", kind, 3, 3, 1))), tmp_path / name)
    assert text.endswith(f" cannot hold part 'label' as {kind}")
    assert os.listdir(tmp_path) == []


def fail_of_ours() -> None:
    raise ImageError("no more rows")


def fail_of_others() -> None:
    raise RuntimeError("a bug")


def stop() -> None:
    raise KeyboardInterrupt


def late(fail: Callable[[], None]) -> Part:
    """A part of several bands that fails after the first."""

    def rows(begin: int, end: int) -> np.ndarray:
        if begin > 0:
            fail()
        return np.zeros((end - begin, WIDE, 3), np.uint8)

    return Part("late", spec_of("uint8", 7, WIDE, 3), rows)


@pytest.mark.parametrize("old", [b"the user's own", None], ids=["old file", "no file"])
@pytest.mark.parametrize("fail", [fail_of_ours, fail_of_others, stop], ids=lambda f: f.__name__)
@pytest.mark.parametrize("name", ["a.exr", "a.tif", "a.png"])
def test_a_failure_in_the_middle_of_writing_leaves_what_was_there(tmp_path, name, fail, old):
    if old is not None:
        (tmp_path / name).write_bytes(old)
    with pytest.raises((ImageError, RuntimeError, KeyboardInterrupt), match=r"no more rows|a bug|^$"):
        write(Image((late(fail),)), tmp_path / name)
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == ({name: old} if old is not None else {})


@pytest.mark.parametrize("name", ["a.exr", "a.tif"])
def test_a_failure_in_a_further_part_leaves_what_was_there(tmp_path, name):
    (tmp_path / name).write_bytes(b"the user's own")
    with pytest.raises(RuntimeError, match="a bug"):
        first = part_of("a", "float", 3, 4, 1, full_width=WIDE, full_height=7)
        write(Image((first, late(fail_of_others))), tmp_path / name)
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == {name: b"the user's own"}


@pytest.mark.parametrize(
    ("kinds", "channels", "name", "kind", "says"),
    [
        (("uint8", "float"), 3, "a.png", None, "png holds one image, here are part0, part1; use EXR or TIFF"),
        (("uint8", "float"), 3, "a.jpg", None, "jpeg holds one image, here are part0, part1; use EXR or TIFF"),
        (("uint8",), 3, "a.banana", None, "no format writes '.banana'"),
        (("uint8",), 3, "a", None, "no format writes ''"),
        (("uint8",), 3, "a.exr", "uint8", "openexr cannot hold part 'part0' as uint8"),
        (("uint8",), 5, "a.png", None, "cannot be written: "),
    ],
    ids=["two parts to png", "two parts to jpeg", "unknown extension", "no extension", "type", "channels"],
)
def test_a_refusal_names_the_file_and_leaves_what_was_there(tmp_path, kinds, channels, name, kind, says):
    image = Image(tuple(part_of(f"part{i}", k, 3, 3, channels) for i, k in enumerate(kinds)))
    (tmp_path / name).write_bytes(b"the user's own")
    text = refusal(write, image, tmp_path / name, kind and type_named(kind))
    assert text.startswith(f"{tmp_path / name}: {says}")
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == {name: b"the user's own"}


def test_a_missing_folder_is_said_to_be_missing(tmp_path):
    path = tmp_path / "no" / "a.exr"
    assert refusal(write, small(), path) == f"{path}: no such folder as {path.parent}"


def test_a_folder_or_a_pipe_is_not_written_over(tmp_path):
    (tmp_path / "folder.exr").mkdir()
    os.mkfifo(tmp_path / "pipe.exr")
    for name in ("folder.exr", "pipe.exr"):
        assert refusal(write, small(), tmp_path / name) == f"{tmp_path / name}: not a regular file"
    assert (tmp_path / "pipe.exr").is_fifo()
    assert sorted(os.listdir(tmp_path)) == ["folder.exr", "pipe.exr"]


def test_a_device_is_not_written_over():
    assert refusal(write, small(), "/dev/null") == "/dev/null: not a regular file"
    assert Path("/dev/null").is_char_device()


def test_a_format_that_writes_no_file_is_refused(tmp_path):
    refusal(write, small(), tmp_path / "a.null")
    assert os.listdir(tmp_path) == []


def test_a_name_as_long_as_the_disk_allows_is_written_or_refused(tmp_path):
    path = tmp_path / ("n" * 251 + ".png")
    path.write_bytes(b"the user's own")
    try:
        write(small(), path)
    except ImageError:
        assert path.read_bytes() == b"the user's own"
    else:
        assert_same(read(path).first, small().first.pixels())
    assert os.listdir(tmp_path) == [path.name]


# --- temporary files ---


def temporary_name(folder: Path) -> str:
    """The name that a run which is writing uses."""
    seen: list[str] = []

    def rows(begin: int, end: int) -> np.ndarray:
        seen.extend(os.listdir(folder))
        return np.zeros((end - begin, 2, 1), np.uint8)

    write(Image((Part("spy", spec_of("uint8", 2, 2, 1), rows),)), folder / "spy.tif")
    (folder / "spy.tif").unlink()
    (name,) = seen
    return name


def test_what_is_being_written_is_hidden_and_bears_pid_and_host(tmp_path):
    name = temporary_name(tmp_path)
    assert name.startswith(".spy.")
    assert name.endswith(".tif")
    assert f"-{os.getpid()}-" in name
    assert os.uname().nodename.split(".")[0].replace("-", "_") in name
    assert os.listdir(tmp_path) == []


def test_a_dead_run_is_swept_and_a_living_one_and_another_hosts_stay(tmp_path, dead_pid):
    mine = temporary_name(tmp_path)
    ours = f"-{os.getpid()}-"
    host = mine.split(".oiiotex-")[1].split(ours)[0]
    dead = mine.replace(ours, f"-{dead_pid}-")
    gone = [dead, dead.replace(".spy.", ".other name."), dead.replace(".tif", ".exr"), dead.replace(".tif", "")]
    kept = [
        mine,
        mine.replace(ours, f"-{os.getppid()}-"),
        mine.replace(ours, "-1-"),
        dead.replace(host, "elsewhere"),
        dead.replace(host, f"{host}2"),
        dead.removeprefix("."),  # the user's own
        f"{dead}.bak.gz",
    ]
    for name in gone + kept:
        (tmp_path / name).write_bytes(b"half")
    write(small(), tmp_path / "a.png")
    assert sorted(os.listdir(tmp_path)) == sorted({*kept, "a.png"})


def test_what_cannot_be_swept_stops_no_one(tmp_path, dead_pid):
    name = temporary_name(tmp_path)
    (tmp_path / name.replace(f"-{os.getpid()}-", f"-{dead_pid}-")).mkdir()
    (tmp_path / name.replace(f"-{os.getpid()}-", f"-{'9' * 30}-")).write_bytes(b"no pid is as large")
    write(small(), tmp_path / "a.png")
    assert_same(read(tmp_path / "a.png").first, small().first.pixels())


KILLED = """
import os, signal
import numpy as np, OpenImageIO as oiio
from oiiotex.images import Image, Part, write

def rows(begin, end):
    if begin > 0:
        os.kill(os.getpid(), signal.SIGKILL)
    return np.zeros((end - begin, 900_000, 3), np.uint8)

write(Image((Part("a", oiio.ImageSpec(900_000, 7, 3, oiio.UINT8), rows),)), "a.tif")
"""


def test_a_killed_run_leaves_the_old_file_and_the_next_run_sweeps(tmp_path):
    (tmp_path / "a.tif").write_bytes(b"the user's own")
    assert subprocess.run([sys.executable, "-c", KILLED], cwd=tmp_path).returncode == -signal.SIGKILL
    assert (tmp_path / "a.tif").read_bytes() == b"the user's own"
    (left,) = set(os.listdir(tmp_path)) - {"a.tif"}
    assert left.startswith(".a.")
    write(small(), tmp_path / "b.png")
    assert sorted(os.listdir(tmp_path)) == ["a.tif", "b.png"]
    assert (tmp_path / "a.tif").read_bytes() == b"the user's own"


# --- specs ---


def test_a_derived_spec_drops_what_changed_pixels_make_untrue_and_keeps_the_rest():
    stale = ("oiio:SHA-1", "oiio:ConstantColor", "oiio:AverageColor", "textureformat", "wrapmodes")
    spec = spec_of("half", 9, 7, ("R", "G", "B", "Z"), tile_width=16, tile_height=16, **WINDOWS)
    for name in (*stale, "Artist", "oiio:ColorSpace"):
        spec.attribute(name, "said")
    new = derived_spec(spec)
    assert [a.name for a in new.extra_attribs] == ["Artist", "oiio:ColorSpace"]
    assert {name: getattr(new, name) for name in WINDOWS} == WINDOWS
    assert (new.width, new.height, new.channelnames, str(new.format)) == (7, 9, ("R", "G", "B", "Z"), "half")
    assert (new.tile_width, new.tile_height, new.tile_depth) == (0, 0, 0)
    assert spec.tile_width == 16  # the original stays as it was
    assert {a.name for a in spec.extra_attribs} >= set(stale)


def test_a_derived_spec_of_another_size_has_a_new_window_at_the_origin():
    new = derived_spec(spec_of("half", 9, 7, 3, **WINDOWS), 64, 48)
    window = new.x, new.y, new.width, new.height
    assert window == (new.full_x, new.full_y, new.full_width, new.full_height) == (0, 0, 64, 48)


def test_a_tag_is_set_on_the_first_part_of_a_new_image():
    image = Image((part_of("a", "half", 3, 4, 3, Artist="Ada"), part_of("b", "half", 3, 4, 3)), "a.exr")
    new = tagged(image, "oiio:ColorSpace", "ACEScg")
    assert new.first.spec.get_string_attribute("oiio:ColorSpace") == "ACEScg"
    assert new.first.spec.get_string_attribute("Artist") == "Ada"
    assert (new.first.name, new.source, new.parts[1]) == ("a", "a.exr", image.parts[1])
    assert image.first.spec.get_string_attribute("oiio:ColorSpace") == ""
    assert_same(new.first, image.first.pixels())


# --- NaN and Inf ---


def broken(kind: str) -> Image:
    part = part_of("beauty", kind, 9, 7, 3, Artist="Ada", **WINDOWS)
    part.pixels()[4, 3, 1] = np.nan
    part.pixels()[7, 5, 1] = -np.inf
    part.pixels()[0, 0, 2] = np.inf
    return Image((part, part_of("st", "float", 2, 2, 2)), "render.exr")


@pytest.mark.parametrize("kind", ["half", "float", "double"])
@pytest.mark.parametrize("mode", ["black", "box3"])
def test_nan_and_inf_are_repaired_and_nothing_else_is_touched(mode, kind):
    image = broken(kind)
    before = image.first.pixels().copy()
    fixed = without_nonfinite(image, mode)
    pixels = fixed.first.pixels()
    bad = ~np.isfinite(before)
    assert pixels.dtype == before.dtype
    np.testing.assert_array_equal(pixels[~bad], before[~bad])
    finite = np.where(bad, np.nan, before.astype(np.float64))
    boxes = (finite[3:6, 2:5, 1], finite[6:9, 4:7, 1], finite[0:2, 0:2, 2])
    for value, box in zip((pixels[4, 3, 1], pixels[7, 5, 1], pixels[0, 0, 2]), boxes, strict=True):
        expected = 0 if mode == "black" else np.nanmean(box)
        np.testing.assert_allclose(float(value), expected, rtol=1e-3 if kind == "half" else 1e-5)
    assert (fixed.source, fixed.parts[1]) == ("render.exr", image.parts[1])
    assert {name: getattr(fixed.first.spec, name) for name in WINDOWS} == WINDOWS
    assert fixed.first.spec.get_string_attribute("Artist") == "Ada"
    np.testing.assert_array_equal(image.first.pixels(), before)


def test_a_repaired_part_keeps_its_name():
    assert without_nonfinite(broken("float"), "black").first.name == "beauty"


def test_integers_need_no_repair():
    image = small("uint16")
    assert_same(without_nonfinite(image, "box3").first, image.first.pixels())


def test_an_unknown_repair_is_refused_with_those_there_are():
    text = refusal(without_nonfinite, small(), "purple")
    assert text.startswith("no mode 'purple'; allowed is black, box3")


# --- the Python edge ---


@pytest.mark.parametrize("kind", list(NUMPY))
def test_a_part_goes_to_a_buffer_and_back_to_the_bit(kind):
    part = part_of("a", kind, 9, 7, ("Z", "R", "G", "B"), Artist="Ada", **WINDOWS)
    buffer = to_buffer(part)
    assert str(buffer.spec().format) == kind
    assert {name: getattr(buffer.spec(), name) for name in WINDOWS} == WINDOWS
    assert buffer.spec().channelnames == ("Z", "R", "G", "B")
    assert buffer.spec().get_string_attribute("Artist") == "Ada"
    back = from_buffer(buffer).first
    assert_same(back, part.pixels())
    assert {name: getattr(back.spec, name) for name in WINDOWS} == WINDOWS
    np.testing.assert_array_equal(back.rows(2, 5), part.pixels()[2:5])


def test_a_large_part_goes_to_a_buffer_band_by_band():
    part = part_of("a", "float", 1030, 701, 4)
    assert len(list(part.bands())) > 1
    buffer = to_buffer(part)
    np.testing.assert_array_equal(buffer.get_pixels(oiio.FLOAT, buffer.roi), part.pixels())


def test_an_image_of_a_buffer_is_the_buffer_as_it_stood():
    buffer = to_buffer(small().first)
    image = from_buffer(buffer)
    oiio.ImageBufAlgo.zero(buffer)
    buffer.specmod().attribute("Artist", "Eve")
    assert_same(image.first, small().first.pixels())
    assert image.first.spec.get_string_attribute("Artist") == ""


def test_a_buffer_of_a_file_is_read_and_named(tmp_path):
    pixels = noise("half", 37, 29, 3)
    spec = spec_of("half", 37, 29, 3, tile_width=16, tile_height=16, **(WINDOWS | {"full_width": 60}))
    put(tmp_path / "a.exr", pixels, spec)
    image = from_buffer(oiio.ImageBuf(str(tmp_path / "a.exr")))
    assert image.source == str(tmp_path / "a.exr")
    assert_same(image.first, pixels)


def test_a_buffer_that_holds_no_image_is_refused(tmp_path):
    assert refusal(from_buffer, oiio.ImageBuf()) == "ImageBuf: holds no image"
    text = refusal(from_buffer, oiio.ImageBuf(str(tmp_path / "no.exr")))
    assert text.startswith(f"{tmp_path / 'no.exr'}: ")


def test_a_buffer_of_a_volume_is_refused():
    refusal(from_buffer, oiio.ImageBuf(spec_of("uint8", 4, 4, 1, depth=3, full_depth=3)))


def test_a_deep_buffer_is_refused(tmp_path):
    deep_file(tmp_path / "deep.exr")
    script = "import OpenImageIO as o; from oiiotex.images import from_buffer; from_buffer(o.ImageBuf('deep.exr'))"
    # in a process of its own: OpenImageIO crashes when it is asked for a deep buffer's pixels
    done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 1
    assert "ImageError" in done.stderr


# --- resizing ---


def triangle(pixels: np.ndarray, size: int, axis: int) -> np.ndarray:
    """The equation: weights fall linearly to 0 one target pixel (at least one source pixel) from its centre."""
    scale = pixels.shape[axis] / size
    centres, sources = (np.arange(size) + 0.5) * scale, np.arange(pixels.shape[axis]) + 0.5
    weights = np.maximum(0, 1 - np.abs(centres[:, None] - sources) / max(1, scale))
    return np.moveaxis(np.tensordot(weights / weights.sum(1, keepdims=True), pixels.astype(float), (1, axis)), 0, axis)


@pytest.mark.parametrize(("width", "height"), [(11, 9), (14, 18), (29, 40), (50, 19)])
def test_resizing_weighs_by_a_triangle_as_wide_as_the_reduction(width, height):
    pixels = np.random.default_rng(3).random((37, 29, 2)).astype(np.float32)
    small_one = resized(pixels, width, height)
    assert (small_one.shape, small_one.dtype) == ((height, width, 2), np.float32)
    inside = slice(3, -3)  # what lies beyond an edge is the filter's own business
    expected = triangle(triangle(pixels, height, 0), width, 1)
    np.testing.assert_allclose(small_one[inside, inside], expected[inside, inside], atol=2e-4)


def test_resizing_keeps_a_constant_and_the_same_size_as_it_is():
    pixels = np.full((9, 7, 3), [0.25, -2, 64], np.float32)
    np.testing.assert_allclose(resized(pixels, 4, 3), np.full((3, 4, 3), [0.25, -2, 64]), rtol=1e-6)
    assert resized(pixels, 7, 9) is pixels
