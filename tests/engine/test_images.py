# SPDX-License-Identifier: Apache-2.0
"""What travels between ops: parts that give any window, their specs, and the Python edge."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex.engine.core.demand import bands, resized
from oiiotex.engine.core.image import (
    Channels,
    Image,
    Part,
    channels_of,
    cropped,
    derived_spec,
    dtype_of,
    from_buffer,
    in_memory,
    tagged,
    to_buffer,
    type_named,
)
from oiiotex.engine.core.window import Window
from tests.parts import (
    NUMPY,
    WINDOWS,
    assert_same,
    counted,
    deep_file,
    noise,
    part_of,
    put,
    refusal,
    small,
    spec_of,
)

WHOLE = Window(3, -5, 10, 4)  # of 7 x 9 pixels with WINDOWS
PLACES = [WHOLE, Window(3, -5, 4, -4), Window(5, -2, 9, 3), Window(9, 3, 10, 4)]

# --- any window ---


def of_array(kind: str) -> tuple[Part, np.ndarray]:
    part = part_of("a", kind, 9, 7, 3, **WINDOWS)
    return part, part.pixels()


def of_buffer(kind: str) -> tuple[Part, np.ndarray]:
    part, pixels = of_array(kind)
    return in_memory("a", to_buffer(part)), pixels


def of_op(kind: str) -> tuple[Part, np.ndarray]:
    """Computed window by window as an ImageBuf."""
    part, pixels = of_array(kind)

    def fetch(window: Window) -> oiio.ImageBuf:
        return to_buffer(cropped(part, window))

    return Part("a", part.spec, fetch), pixels


@pytest.mark.parametrize("kind", list(NUMPY))
@pytest.mark.parametrize("made", [of_array, of_buffer, of_op], ids=lambda made: made.__name__)
def test_a_part_gives_any_window_as_an_array_or_a_buffer(made, kind):
    part, pixels = made(kind)
    assert part.window == WHOLE
    for window in PLACES:
        expected = pixels[window.inside(WHOLE)]
        array, buffer = part.read(window), part.buffer(window)
        assert array.dtype == expected.dtype
        np.testing.assert_array_equal(array, expected)
        assert (Window.data(buffer.spec()), buffer.spec().format) == (window, part.working_type)
        if str(buffer.spec().format) == kind:
            np.testing.assert_array_equal(buffer.get_pixels(oiio.TypeDesc(kind), buffer.roi), expected)
    assert part.pixel_bytes == pixels[0, 0].nbytes


@pytest.mark.parametrize(
    ("stored", "native", "kind"), [(None, False, "uint8"), ("uint8", True, "uint8"), ("uint8", False, "float")]
)
def test_ops_of_the_host_see_what_is_stored_as_float_unless_it_is_native(stored, native, kind):
    pixels = np.uint8([[[0, 51, 255]]])
    part = Part("a", spec_of("uint8", 1, 1, 3), lambda w: pixels, stored and type_named(stored), native)
    buffer = part.buffer(part.window)
    assert str(part.working_type) == str(buffer.spec().format) == kind
    expected = pixels if kind == "uint8" else np.float32([[[0, 0.2, 1]]])
    np.testing.assert_allclose(buffer.get_pixels(oiio.TypeDesc(kind), buffer.roi), expected, atol=1e-7)
    np.testing.assert_array_equal(part.read(part.window), pixels)  # filters of ours see what it is


def test_a_buffer_is_untiled_and_keeps_channel_names():
    part = part_of("a", "half", 9, 7, ("Z", "R", "G"), tile_width=16, tile_height=16)
    spec = part.buffer(part.window).spec()
    assert (spec.tile_width, spec.channelnames) == (0, ("Z", "R", "G"))


def test_a_respecced_part_has_the_same_pixels_where_its_window_has_moved():
    part, pixels = of_array("half")
    asked: list[Window] = []

    def move(spec: oiio.ImageSpec) -> None:
        spec.x, spec.y = 100, 200
        spec.attribute("Artist", "Ada")

    moved = counted(part, asked).respecced(move)
    assert asked == []
    assert moved.window == Window.sized(100, 200, 7, 9)
    assert_same(moved, pixels)
    np.testing.assert_array_equal(moved.read(Window(101, 202, 103, 205)), pixels[2:5, 1:3])
    assert (set(asked[:-1]), asked[-1]) == ({WHOLE}, Window(4, -3, 6, 0))
    assert moved.spec.get_string_attribute("Artist") == "Ada"
    assert (moved.stored, part.spec.x) == (part.stored, 3)
    assert part.spec.get_string_attribute("Artist") == ""


def test_smaller_versions_are_respecced_too_but_not_where_a_window_changes():
    level = part_of("a", "half", 4, 5, 3)
    part = Part("a", spec_of("half", 8, 10, 3), lambda w: np.empty(0), levels=(level,))
    named = part.respecced(lambda spec: spec.attribute("Artist", "Ada"))
    assert [held.spec.get_string_attribute("Artist") for held in named.levels] == ["Ada"]
    assert_same(named.levels[0], level.pixels())
    for field in ("x", "full_width"):
        assert part.respecced(lambda spec, field=field: setattr(spec, field, 3)).levels == ()


@pytest.mark.parametrize(
    "window",
    [Window(5, -2, 9, 3), Window(0, -9, 20, 20), Window(0, 0, 5, 2), Window(50, 60, 53, 61), WHOLE],
    ids=["inside", "around", "overlapping", "apart", "the same"],
)
def test_a_cropped_part_is_black_beyond_its_own_window(window):
    part, pixels = of_array("half")
    asked: list[Window] = []
    crop = cropped(counted(part, asked), window)
    y, x = np.mgrid[window.top : window.bottom, window.left : window.right]
    there = (x >= 3) & (x < 10) & (y >= -5) & (y < 4)
    expected = np.zeros((window.height, window.width, 3), np.float16)
    expected[there] = pixels[y[there] + 5, x[there] - 3]
    assert_same(crop, expected)
    assert crop.window == window
    assert all(wanted & WHOLE == wanted and not wanted.empty for wanted in asked)
    corner = Window(window.right - 2, window.bottom - 1, window.right, window.bottom)
    np.testing.assert_array_equal(crop.read(corner), expected[-1:, -2:])
    display = {name: value for name, value in WINDOWS.items() if name.startswith("full")}
    assert {name: getattr(crop.spec, name) for name in display} == display
    assert crop.stored == part.stored


def test_a_crop_to_the_same_window_is_the_part_itself():
    part, _ = of_array("half")
    assert cropped(part, WHOLE) is part


# --- channels and types ---


@pytest.mark.parametrize(
    ("names", "alpha", "color"),
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
def test_color_is_rgb_by_name_else_the_first_three_that_are_not_alpha(names, alpha, color):
    spec = spec_of("half", 2, 2, names)
    spec.alpha_channel = alpha
    assert channels_of(spec) == Channels(color, None if alpha < 0 else alpha)


@pytest.mark.parametrize(
    ("names", "alpha"),
    [
        (("R", "G", "B", "crypto00.R", "crypto00.A"), None),
        (("crypto00.A", "R", "G", "B"), None),
        (("R", "G", "B", "A", "crypto00.A"), 3),
        (("beauty.R", "beauty.G", "beauty.B", "beauty.A"), 3),
        (("beauty.R", "beauty.G", "beauty.B", "A"), 3),
        (("crypto00.A",), 0),
    ],
)
def test_the_alpha_of_another_layer_is_no_alpha_of_the_color(names, alpha):
    spec = spec_of("half", 2, 2, names)
    spec.alpha_channel = next(n for n, name in enumerate(names) if name.endswith("A"))
    assert channels_of(spec).alpha == alpha


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
    ("name", "kind"),
    [("uint32", "uint"), ("int32", "int"), ("sint8", "int8"), ("sint16", "int16"), ("sint32", "int")],
)
def test_oiiotools_other_names_of_a_type_mean_the_same(name, kind):
    assert type_named(name) == type_named(kind)


@pytest.mark.parametrize(
    "name",
    ["banana", "", "FLOAT", "float ", "int64", "uint64", "string", "float[3]", "color", "point", "half[2]", "vector"],
)
def test_what_is_no_pixel_type_is_refused_with_those_there_are(name):
    assert refusal(type_named, name) == f"unknown pixel type '{name}': expected one of {', '.join(NUMPY)}"


def test_pixels_of_a_type_that_numpy_lacks_are_refused():
    assert "int64" in refusal(dtype_of, spec_of("int64", 2, 2, 1))


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
    new = tagged(image, "ACEScg")
    assert new.first.spec.get_string_attribute("oiio:ColorSpace") == "ACEScg"
    assert new.first.spec.get_string_attribute("Artist") == "Ada"
    assert (new.first.name, new.source, new.parts[1]) == ("a", "a.exr", image.parts[1])
    assert image.first.spec.get_string_attribute("oiio:ColorSpace") == ""
    assert_same(new.first, image.first.pixels())


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
    assert str(back.stored) == kind
    np.testing.assert_array_equal(back.read(Window(4, -3, 9, 0)), part.pixels()[2:5, 1:6])


def test_a_large_part_goes_to_a_buffer_band_by_band():
    part = part_of("a", "float", 1030, 701, 4)
    assert len(list(bands(part))) > 1
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
    assert refusal(from_buffer, oiio.ImageBuf()) == "ImageBuf: contains no image"
    text = refusal(from_buffer, oiio.ImageBuf(str(tmp_path / "no.exr")))
    assert text.startswith(f"{tmp_path / 'no.exr'}: ")


def test_a_buffer_of_a_file_that_breaks_off_is_refused(tmp_path):
    """OpenImageIO reads on, and leaves black what it has not read."""
    put(tmp_path / "a.exr", noise("half", 64, 64, 3), spec_of("half", 64, 64, 3))
    (tmp_path / "b.exr").write_bytes((tmp_path / "a.exr").read_bytes()[:-5000])
    text = refusal(from_buffer, oiio.ImageBuf(str(tmp_path / "b.exr")))
    assert text.startswith(f"{tmp_path / 'b.exr'}: ") and "missing or corrupted" in text


def test_a_buffer_of_a_volume_is_refused():
    refusal(from_buffer, oiio.ImageBuf(spec_of("uint8", 4, 4, 1, depth=3, full_depth=3)))


def test_a_deep_buffer_is_refused(tmp_path):
    deep_file(tmp_path / "deep.exr")
    script = "import OpenImageIO as o; from oiiotex.engine.core.image import from_buffer; "
    script += "from_buffer(o.ImageBuf('deep.exr'))"
    # in a process of its own: OpenImageIO crashes when it is asked for a deep buffer's pixels
    done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 1
    assert "ImageError" in done.stderr


# --- resizing ---


def triangle(pixels: np.ndarray, size: int, axis: int) -> np.ndarray:
    """The equation: weights fall linearly to 0 one target pixel (at least one source pixel) from its center."""
    scale = pixels.shape[axis] / size
    centers, sources = (np.arange(size) + 0.5) * scale, np.arange(pixels.shape[axis]) + 0.5
    weights = np.maximum(0, 1 - np.abs(centers[:, None] - sources) / max(1, scale))
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
    assert np.shares_memory(resized(pixels, 7, 9), pixels)
