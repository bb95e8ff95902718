# SPDX-License-Identifier: Apache-2.0
"""The promises of docs/explanation/promises.md, over every filter in the tuple: a new filter cannot forget them."""

from __future__ import annotations

import dataclasses
import functools
import hashlib

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from oiiotex.engine import errors
from oiiotex.engine.core.access import Gather, InBands, Neighborhood, Pointwise, ScanThenMap, Whole
from oiiotex.engine.core.image import Image, Part, from_buffer
from oiiotex.engine.core.op import Kind, Op, Space
from oiiotex.engine.core.window import Window
from oiiotex.engine.io.reading import read
from oiiotex.engine.run import run
from oiiotex.engine.session import Session
from tests import pictures
from tests.any_filter import (
    COLOR,
    LABELED,
    PHOTO,
    PICTURES,
    RESAMPLED,
    SEVERAL,
    SUMS,
    apply,
    buffer,
    color_filters,
    copying_filters,
    every_filter,
    image_kind,
    image_of,
    is_view,
    named,
    of,
    operands,
    pixels,
    quarters,
    settings,
    with_labels,
)
from tests.conftest import load, oiiotex
from tests.refusals import refused

pytestmark = pytest.mark.usefixtures("few_places")
DATA = Kind.IDS, Kind.MASK, Kind.COORDINATES, Kind.MEASURE, Kind.CRYPTOMATTE  # whatever the input is


@of(list(filters.FILTERS))
def test_every_filter_is_a_function_with_its_declared_parameters(op):
    function = getattr(filters, op.name)
    further = {op.further_images().name} if op.further_images() else set()
    assert (
        set(function.__signature__.parameters)
        == {i.name for i in (*op.images(), *op.optional_images())}
        | {p.name for p in op.parameters()}
        | {"session", "roi", "nthreads", "colorspace", "as_array"}
        | further
    )
    for name in (p.name for p in op.parameters()):
        assert f"{name} : " in function.__doc__


TOLD: dict[str, list[tuple[int, int]]] = {}  # progress of `plain`: what is done, of how much


@functools.cache
def plain(op: type[Op]) -> np.ndarray:
    """What the op makes of the photo, to compare with what it makes of it in other ways."""
    told = TOLD[op.name] = []
    return pixels(apply(op, buffer(PHOTO), Session(progress=lambda done, total: told.append((done, total)))))


@of([op for op in PICTURES if "seed" in settings(op, seed=0) and image_kind(op) is not Kind.IDS])
def test_another_seed_is_another_result(op):
    """But of what starts at random only where asked to. That the same one makes the same is seen with moved windows."""
    least = 0.03 if op.name == "transition" else 0.3  # only borders move
    assert (pixels(apply(op, buffer(PHOTO), seed=4)) != plain(op)).mean() > least


@pytest.mark.slow
@every_filter
def test_threads_and_budget_do_not_show(op, tmp_path):
    inputs: list[str] = []
    quarters().write(str(tmp_path / "labels.tif"))
    append = "labels.tif", "--attrib", "oiio:subimagename", "label.1", "--siappend"
    for n, image in enumerate(operands(op, buffer(PHOTO))):
        inputs += append if n == 1 and op.name in LABELED else ()
        image = image["photo"] if isinstance(image, dict) else image
        inputs.append(f"in{n}{'.exr' if image.spec().format == oiio.FLOAT else '.tif'}")
        assert image.write(str(tmp_path / inputs[-1])), image.geterror()
    inputs += append if len(inputs) == 1 and op.name in LABELED else ()
    modifiers = "".join(f":{k}={v}" for k, v in settings(op, seed=5).items())
    found = set()
    for n, more in enumerate((["--threads", "1"], ["--threads", "2"], ["--cache", "600"])):
        done = oiiotex(*inputs, f"{op.flag()}{modifiers}", *more, "-o", f"{n}.exr", cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        found.add(hashlib.sha256(load(tmp_path / f"{n}.exr").tobytes()).hexdigest())
    assert len(found) == 1


@color_filters
def test_lanes_do_not_show(op, narrow_device):
    narrow = Session()
    narrow.resources.device = narrow_device
    np.testing.assert_array_equal(plain(op), pixels(apply(op, buffer(PHOTO), narrow)))


@every_filter
def test_any_window_is_the_whole_cropped(op, tmp_path):
    """Windows in any order, of files in scanlines and in tiles that do not start at 0, on any number of threads."""
    random = np.random.default_rng(1)
    spec = oiio.ImageSpec(72, 64, 5, oiio.HALF)
    spec.channelnames = ("R", "G", "B", "A", "Z")
    spec.x, spec.y, spec.full_x, spec.full_y, spec.full_width, spec.full_height = -9, 13, -9, 13, 72, 64
    spec.attribute("oiio:ColorSpace", "lin_rec709_scene")
    many = np.concatenate([PHOTO * 4 - 0.1, random.random((64, 72, 2))], -1)
    whole = None
    for threads, tile in ((1, (0, 0)), (3, (32, 16))):
        spec.tile_width, spec.tile_height = tile
        out = oiio.ImageOutput.create(str(tmp_path / "a.exr"))
        assert out.open(str(tmp_path / "a.exr"), spec) and out.write_image(many.astype(np.float16)) and out.close()
        first, others = with_labels(op, read(tmp_path / "a.exr")), operands(op, buffer(PHOTO))[1:]
        images = named(op, [first, *(first if op.name in SEVERAL else from_buffer(one) for one in others)])
        part = run(op(**images, **settings(op)), Session(threads=threads))[0].image.first
        if whole is None:
            whole = part.read(part.window)
        np.testing.assert_array_equal(part.read(part.window), whole)
        for _ in range(10):
            left, right = np.sort(random.choice(part.spec.width + 1, 2, replace=False)) + part.window.left
            top, bottom = np.sort(random.choice(part.spec.height + 1, 2, replace=False)) + part.window.top
            window = Window(int(left), int(top), int(right), int(bottom))
            np.testing.assert_array_equal(part.read(window), whole[window.inside(part.window)])


@copying_filters
def test_every_pixel_is_a_copy_of_a_source_pixel_with_all_channels(op):
    random = np.random.default_rng(0)
    many = np.concatenate(
        [PHOTO * 30 - 1, random.random((64, 72, 1)) * 0.5 + 0.5, random.normal(0, 1e4, (64, 72, 2))], -1
    )
    photo = buffer(many, oiio.HALF, "lin_rec709_scene", ("R", "G", "B", "A", "Z", "id"))
    made = apply(op, photo, flattening=0, **{"fill": {"fade": 0}}.get(op.name, {}))  # else corrected
    assert made.spec().format == oiio.HALF
    assert made.spec().channelnames == photo.spec().channelnames
    known = {p.tobytes() for p in pixels(photo).reshape(-1, 6)}
    assert all(p.tobytes() in known for p in pixels(made).reshape(-1, 6))
    assert np.abs(pixels(made)[..., :3].astype(float)).max() > 5  # HDR stays HDR


@of([op for op in COLOR if not op.copies and image_kind(op) not in DATA and op.name not in RESAMPLED])
def test_what_changes_color_leaves_the_rest_alone(op):
    random = np.random.default_rng(0)
    many = np.concatenate(
        [PHOTO * 30 - 1, random.random((64, 72, 1)) * 0.5 + 0.5, random.normal(0, 1e4, (64, 72, 2))], -1
    )
    many[5, 6, 4], many[30:34, 7:9, 3] = np.inf, 0  # depth may be infinite; nothing is to be seen at alpha 0
    photo = buffer(many, oiio.HALF, "lin_rec709_scene", ("R", "G", "B", "A", "Z", "id"))
    made = apply(op, photo)
    assert (made.spec().format, made.spec().channelnames) == (oiio.HALF, photo.spec().channelnames)
    np.testing.assert_array_equal(pixels(made)[..., 3:], pixels(photo)[..., 3:])
    np.testing.assert_array_equal(pixels(made)[30:34, 7:9], pixels(photo)[30:34, 7:9])
    assert np.abs(pixels(made)[..., :3].astype(float)).max() > 5  # HDR stays HDR


@of([op for op in COLOR if op.copies and op.name != "transition"])  # these copy each pixel to its own place
def test_pixels_of_alpha_0_are_never_a_source(op):
    alpha = np.ones((64, 72, 1))
    alpha[20:30, 30:50] = 0
    photo = buffer(np.concatenate([PHOTO * alpha, alpha], -1), names=("R", "G", "B", "A"))
    assert (pixels(apply(op, photo))[..., 3] == 1).all()


@of([op for op in COLOR if image_kind(op) is Kind.IDS])
def test_pixels_of_alpha_0_have_no_label(op):
    alpha = np.ones((64, 72, 1))
    alpha[20:30, 30:50] = 0
    made = pixels(apply(op, buffer(np.concatenate([PHOTO * alpha, alpha], -1), names=tuple("RGBA"))))
    np.testing.assert_array_equal(made[..., 0] == 0, alpha[..., 0] == 0)


@of([op for op in COLOR if not op.copies])
def test_what_lies_under_alpha_0_is_not_looked_at(op):
    alpha = np.ones((64, 72, 1))
    alpha[20:30, 30:50] = 0
    colors = np.random.default_rng(0).random((64, 72, 3)) * 50
    a, b = (
        pixels(apply(op, buffer(np.concatenate([np.where(alpha, PHOTO, under), alpha], -1), names=tuple("RGBA"))))
        for under in (0.0, colors)
    )
    seen = alpha[..., 0] > 0
    np.testing.assert_array_equal(a[seen], b[seen])


@color_filters
def test_color_is_taken_unpremultiplied(op):
    """A photo at half alpha looks as it does at full: the same pixels are chosen, the same colors made."""
    half = np.concatenate([PHOTO, np.ones((64, 72, 1))], -1) * 0.5
    made = pixels(apply(op, buffer(half, names=("R", "G", "B", "A"))))
    if image_kind(op) in DATA:  # Lab is not premultiplied
        np.testing.assert_array_equal(made[..., :3], plain(op)[..., :3])
    else:
        np.testing.assert_array_equal(made[..., :3], plain(op) * np.float32(0.5))
        assert (made[..., 3] == 0.5).all()


@color_filters
def test_color_is_never_guessed(op):
    with pytest.raises(errors.ColorError, match="add colorspace=NAME"):
        apply(op, buffer(PHOTO, space=""))
    with pytest.raises(errors.ColorError, match="nonsense"):
        apply(op, buffer(PHOTO, space="nonsense"))


@of([op for op in COLOR if "data" not in {p.name for p in op.parameters()}])
def test_data_is_refused_by_what_makes_no_sense_of_it(op):
    with pytest.raises(errors.ColorError, match="data"):
        apply(op, buffer(PHOTO, space="data"))


@of([op for op in COLOR if "data" in {p.name for p in op.parameters()}])
def test_data_skips_color(op):
    made = apply(op, buffer(PHOTO * 2 - 1, space=""), data=True)
    assert made.spec().nchannels == (1 if image_kind(op) in DATA else 3)
    tagged = apply(op, buffer(PHOTO * 2 - 1, space="data"))
    np.testing.assert_array_equal(pixels(made), pixels(tagged))


@every_filter
@pytest.mark.parametrize(("channels", "kind"), [(1, oiio.UINT16), (2, oiio.UINT8)], ids=str)
def test_gray_alpha_and_integers_work(op, channels, kind):
    """Those of colors are half or float elsewhere: a copy of half, windows of R, G, B, A and Z, and straight alpha."""
    gray = PHOTO[..., :1].copy()
    gray[:, 44:56] = 1  # a pipe, which is not of the dominant texture
    picture = np.concatenate([gray, np.ones_like(gray)], -1)[..., :channels]
    made = apply(op, buffer(picture, kind, names=("Y", "A")[:channels]))
    if image_kind(op) in DATA:
        assert made.spec().format == (oiio.UINT32 if image_kind(op) is Kind.IDS else oiio.FLOAT)
    else:
        assert (made.spec().nchannels, made.spec().format) == (channels, kind)
    channels = made.spec().nchannels
    assert len(np.unique(pixels(made).reshape(-1, channels), axis=0)) > (
        1 if image_kind(op) in (Kind.IDS, Kind.MASK) else 4
    )


@every_filter
def test_broken_values_are_counted_or_left_alone(op):
    broken = PHOTO.copy()
    broken[3, 4, 0], broken[5, 6, 1:] = np.nan, np.inf
    if op.space is Space.LAB or op.name in SUMS:
        with pytest.raises(errors.ImageError, match="1 NaN and 2 Inf"):
            apply(op, buffer(broken))
    elif op.name == "estimateao":  # heights are one channel
        with pytest.raises(errors.BrokenValues):
            apply(op, buffer(broken))
    else:
        apply(op, buffer(broken))


@every_filter
def test_a_seed_is_a_promise_metadata_goes_through_stale_hashes_do_not_and_nothing_is_printed(op, capfd):
    """Of a photo whose windows do not start at 0."""
    spec = oiio.ImageSpec(72, 64, 3, oiio.FLOAT)
    spec.x, spec.y, spec.full_x, spec.full_y, spec.full_width, spec.full_height = -7, 11, -7, 11, 72, 64
    spec.attribute("oiio:ColorSpace", "srgb_rec709_scene")
    spec.attribute("studio:shot", "ab_010")
    spec.attribute("oiio:SHA-1", "0123")
    moved = oiio.ImageBuf(spec)
    moved.set_pixels(moved.roi, PHOTO.astype(np.float32))
    made = apply(op, moved, seed=0)
    assert made.spec().get_string_attribute("studio:shot") == "ab_010"
    assert made.spec().get_string_attribute("oiio:SHA-1") == ""
    tag = "data" if image_kind(op) in DATA else "srgb_rec709_scene"
    assert made.spec().get_string_attribute("oiio:ColorSpace") == tag
    assert capfd.readouterr() == ("", "")
    np.testing.assert_array_equal(pixels(made), plain(op))


@of(list(filters.FILTERS))
def test_unknown_modifiers_are_refused_with_the_nearest_name(op, fails, photo):
    line = fails(*[photo] * len(op.images()), f"{op.flag()}:sgima=3")
    assert op.flag() in line and "'sgima'" in line
    if "sigma" in {p.name for p in op.parameters()}:
        assert "did you mean 'sigma'" in line
    with pytest.raises(errors.ParameterError, match="sgima"):
        getattr(filters, op.name)(*operands(op, buffer(PHOTO)), sgima=3)


def watched(photo: np.ndarray, asked: list[Window], space: str = "srgb_rec709_scene") -> Image:
    """The photo, of which every window that is read joins the list."""
    part = from_buffer(buffer(photo, space=space)).first

    def fetch(window: Window) -> np.ndarray:
        asked.append(window)
        return part.read(window)

    return Image((dataclasses.replace(part, fetch=fetch),))


def made_of(op: type[Op], photo: Image) -> Part:
    """The op's image, of the photo and what else it takes."""
    others = map(from_buffer, operands(op, buffer(PHOTO))[1:])
    images = named(op, [with_labels(op, photo), *(photo if op.name in SEVERAL else one for one in others)])
    return run(op(**settings(op), **images), Session(threads=2))[0].image.first


@of([op for op in filters.FILTERS if issubclass(op, Pointwise | Neighborhood | ScanThenMap) and not is_view(op)])
def test_a_filter_reads_what_its_access_kind_says(op, monkeypatch):
    """Nothing before a window is asked for, unless it scans: then bands of full rows; and then that window alone."""
    asked: list[Window] = []
    for band in ("oiiotex.engine.core.demand.BAND_BYTES", "oiiotex.engine.scan.BAND_BYTES"):
        monkeypatch.setattr(band, 8 * 72 * 3 * 4)  # eight rows
    part = made_of(op, watched(PHOTO, asked))
    if issubclass(op, ScanThenMap):
        assert all((w.left, w.right) == (0, 72) and w.height <= 8 for w in asked)
    else:
        assert asked == []
    asked.clear()
    window = Window(20, 17, 50, 40)
    part.read(window)
    assert all(w & window == w for w in asked) or issubclass(op, Neighborhood)  # test_access.py knows its halo


@of([op for op in COLOR if op.name in ("flatten", "stationarity")])
def test_what_streams_needs_memory_for_its_statistics_alone(op):
    """Coarse ones fit any budget; fine ones are refused with a figure."""
    scale = "radius" if op.name == "flatten" else "sigma"
    apply(op, buffer(PHOTO), Session(budget=1 << 20), **{scale: 16})
    with pytest.raises(errors.ImageError, match=rf"{scale}=1 needs \d+ MB of memory; the budget is 1 MB"):
        apply(op, buffer(PHOTO), Session(budget=1 << 19), **{scale: 1})


@of(
    [
        op
        for op in COLOR  # of texcut only caches and patches must fit: tests/synthesis/test_cut.py
        if issubclass(op, (Whole, InBands)) and "size" in {p.name for p in op.parameters()} and op.name != "cut"
    ]
)
def test_what_does_not_fit_the_budget_says_how_much_it_needs(op, fails, photo):
    needed = f":mesh={pictures.cube_file()}" if op.name == "atlas" else ""
    line = fails(photo, f"{op.flag()}:size=3000x2000{needed}", "--cache", "64")
    assert "3000x2000" in line and "the budget is 64 MB" in line and " needs " in line


@of([op for op in COLOR if issubclass(op, Gather) and op.name != "composite"])  # which holds the map that it grows
def test_what_is_made_causally_needs_memory_for_its_plan_alone(op):
    """Nothing is held for the pixels; a plan that does not fit is refused with a figure."""
    images = dict(zip((i.name for i in op.images()), map(image_of, operands(op, buffer(PHOTO))), strict=True))
    small = settings(op, size=(9216, 60)) | images
    part = run(op(**small), Session(budget=6 << 20))[0].image.first
    assert part.read(Window(8928, 0, 9216, 32)).shape == (32, 288, 3)  # its floats alone would be 6.6 MB
    with refused(errors.ImageError, budget=6 << 20) as caught:
        run(op(**{**small, "size": (65536, 40000)}), Session(budget=6 << 20))
    assert "65536x40000" in str(caught.value)


@of([op for op in COLOR if not issubclass(op, Pointwise)])
def test_progress_is_reported_and_can_stop_a_run(op):
    assert plain(op).size
    seen = TOLD[op.name]
    done = [done for done, _ in seen]
    assert done == sorted(set(done)) and seen[-1][0] == seen[-1][1]
    with pytest.raises(errors.Interrupted):
        apply(op, buffer(PHOTO), Session(progress=lambda done, total: done < 2))


@of(list(filters.FILTERS))
def test_what_is_no_image_is_refused(op):
    needed = {"mesh": pictures.cube_file()} if op.name == "atlas" else {}
    for wrong in (np.zeros((0, 64, 3)), np.zeros(64), np.zeros((64, 64, 3), complex), "no.png", {}, oiio.ImageBuf()):
        with pytest.raises(errors.ImageError):
            getattr(filters, op.name)(*[wrong] * len(op.images()), **needed)
    for wrong in (None, 3, [[0.5]], b"photo.png", {"a": "photo.png"}):
        with pytest.raises(TypeError) as caught:
            getattr(filters, op.name)(*[wrong] * len(op.images()), **needed)
        assert isinstance(caught.value, errors.Error)


@of([op for op in filters.FILTERS if op not in PICTURES])
def test_what_draws_labels_never_prints(op, capfd):
    apply(op, buffer(PHOTO))
    assert capfd.readouterr() == ("", "")
