# SPDX-License-Identifier: Apache-2.0
"""The pixels of every node are those of its filter, to the bit, however the host lays out its images."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from tests.hosts.openfx.conftest import SPACE, photo, region, rendered, with_source
from tests.hosts.openfx.host import OK, Host, Image

VALUES = {
    "Tile": {"sigma": 8.0, "seed": 3, "iterations": 3, "lattice": 0.0},
    "Fill": {"iterations": 3},
    "Flatten": {"radius": 12.0},
    "Quilt": {"size": (80, 48), "patch": 16, "lattice": 0.0},
    "DominantMask": {},
    "Height": {"sigma": 9.5, "light": 30.0},
    "Rectify": {"corners": "8,6,80,4,84,58,6,60", "size": (64, 48)},
    "Preview": {"panels": "2x2,3x3", "panel": 48},
}
FILTERS = {"Tile": "stationarize", "DominantMask": "dominant", "Height": "estimateheight"}


def buffer(pixels: np.ndarray, space: str = SPACE) -> oiio.ImageBuf:
    kind = {"f": "float", "e": "half", "B": "uint8"}[pixels.dtype.char]
    image = oiio.ImageBuf(oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], kind))
    image.set_pixels(image.roi, pixels)
    if space:
        image.specmod().attribute("oiio:ColorSpace", space)
    return image


def of_filter(name: str, *images: oiio.ImageBuf, **values: object) -> np.ndarray:
    made = getattr(filters, FILTERS.get(name, name.lower()))(*images, **values)
    return made.get_pixels(made.spec().format)


@pytest.mark.parametrize("name", [name for name in VALUES if name != "Fill"])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_node_gives_the_pixels_of_its_filter(host: Host, name: str, seed: int):
    pixels = photo(seed=seed)
    node = with_source(host, name, pixels, **VALUES[name])
    first = rendered(host, node)  # of some nodes only the pixels tell the size: the host asks again
    found = rendered(host, node)
    values = {key: list(value.split(",")) if key == "panels" else value for key, value in VALUES[name].items()}
    if name == "Rectify":
        values["corners"] = [float(number) for number in values["corners"].split(",")]
    wanted = of_filter(name, buffer(pixels), **values)
    if wanted.shape[2] == 1:
        alpha = wanted if name == "DominantMask" else np.ones_like(wanted)
        wanted = np.concatenate([wanted] * 3 + [alpha], -1)
    np.testing.assert_array_equal(found, wanted)
    if name != "Preview":
        np.testing.assert_array_equal(first, wanted)


def test_a_fill_takes_region_and_mask_from_clips(host: Host):
    pixels = photo()
    region = np.zeros((64, 96, 1), np.float32)
    region[20:36, 30:50] = 1
    node = with_source(host, "Fill", pixels, **VALUES["Fill"])
    node.clips["Region"].connect(Image(host, region))
    wanted = of_filter("Fill", buffer(pixels), buffer(region, ""), **VALUES["Fill"])
    np.testing.assert_array_equal(rendered(host, node), wanted)
    node.clips["Region"].connect(
        Image(host, np.concatenate([pixels[..., :3] * 0 + 0.5, region], -1))
    )  # its alpha counts
    np.testing.assert_array_equal(rendered(host, node), wanted)
    mask = np.ones_like(region)
    mask[:, 60:] = 0
    node.clips["Mask"].connect(Image(host, mask))
    wanted = of_filter("Fill", buffer(pixels), buffer(region, ""), mask=buffer(mask, ""), **VALUES["Fill"])
    np.testing.assert_array_equal(rendered(host, node), wanted)


def test_a_fill_without_region_fills_what_is_transparent(host: Host):
    """Also in a host with one clip; a soft border is filled, too, so that no rim is left."""
    alpha = np.ones((64, 96, 1), np.float32)
    alpha[20:36, 30:50] = 0
    alpha[20:36, 50] = 0.9
    pixels = photo() * alpha
    node = with_source(host, "Fill", pixels, "Filter", **VALUES["Fill"])
    found = rendered(host, node)
    np.testing.assert_array_equal(
        found, of_filter("Fill", buffer(pixels), buffer(np.float32(alpha < 1), ""), **VALUES["Fill"])
    )
    assert (found[..., 3] == 1).all() and (found[20:36, 30:51] != pixels[20:36, 30:51]).any(-1).all()
    eight = np.rint(pixels * 255).astype(np.uint8)
    node.clips["Source"].connect(Image(host, eight))
    wanted = of_filter("Fill", buffer(eight), buffer(np.float32(alpha < 1), ""), **VALUES["Fill"])
    np.testing.assert_array_equal(rendered(host, node, "uint8"), wanted)
    node.clips["Source"].connect(Image(host, photo()))  # the hole has left the frame
    np.testing.assert_array_equal(rendered(host, node), photo())
    node.clips["Source"].connect(Image(host, photo(channels=3)))
    assert host.render(node, (0, 0, 96, 64), Image(host, photo(channels=3))) != OK
    assert len(node.messages) == 1 and "Region is not connected, and Source has no alpha" in node.messages.pop()


def unpremultiplied(pixels: np.ndarray) -> np.ndarray:
    alpha = pixels[..., 3:]
    color = pixels[..., :3] / np.where(alpha == 0, np.float32(1), alpha)
    return np.concatenate([color, alpha], -1)


@pytest.mark.parametrize("dtype", ["float32", "float16", "uint8"])
@pytest.mark.parametrize("name", ["Flatten", "Tile", "DominantMask"])
def test_unpremultiplied_input_is_premultiplied_for_the_filter(host: Host, name: str, dtype: str):
    """The result is in the state of the input, and the host is told so."""
    alpha = np.linspace(0.25, 1, 96, dtype=np.float32)[np.newaxis, :, np.newaxis]
    given = np.concatenate([photo()[..., :3], np.broadcast_to(alpha, (64, 96, 1))], -1)
    given = np.rint(given * 255).astype(np.uint8) if dtype == "uint8" else given.astype(dtype)
    floats = given.astype(np.float32) / np.float32(255 if dtype == "uint8" else 1)
    straight = np.concatenate([floats[..., :3] * floats[..., 3:], floats[..., 3:]], -1)
    node = with_source(host, name, given, **VALUES[name])
    node.clips["Source"].connect(Image(host, given, state="UnPremultiplied"))
    status, out = node.ask("OfxImageEffectActionGetClipPreferences")
    state = "Premultiplied" if name == "DominantMask" else "UnPremultiplied"
    assert status == OK and out["OfxImageEffectPropPreMultiplication"] == f"OfxImageAlpha{state}"
    wanted = of_filter(name, buffer(straight), **VALUES[name])
    wanted = np.repeat(wanted, 4, -1) if name == "DominantMask" else unpremultiplied(wanted)
    wanted = np.rint(np.clip(wanted, 0, 1) * 255).astype(np.uint8) if dtype == "uint8" else wanted.astype(dtype)
    found = rendered(host, node, dtype)
    np.testing.assert_array_equal(found, wanted)
    node.clips["Source"].connect(Image(host, given))
    assert not np.array_equal(rendered(host, node, dtype), found)


def test_labels_are_ids_a_cryptomatte_or_the_matte_of_a_name(host: Host):
    pixels = photo()
    parts = filters.label(buffer(pixels), cryptomatte=True)
    levels = sum(name.startswith("label.") for name in parts)
    coarsest = parts[f"label.{levels}"].get_pixels(oiio.UINT32)
    node = with_source(host, "Labels", pixels)
    np.testing.assert_array_equal(rendered(host, node)[..., :3], np.repeat(coarsest, 3, -1).astype(np.float32))
    node.parameters["output"].set(1)
    layers = parts["cryptomatte"].get_pixels(oiio.FLOAT)
    np.testing.assert_array_equal(rendered(host, node), layers[..., -4:])
    assert host.render(node, (0, 0, 96, 64), Image(host, np.zeros((64, 96, 4), np.uint8))) != OK
    assert "change ids" in node.messages.pop()
    node.parameters["output"].set(2)
    total = np.zeros((64, 96, 1), np.float32)
    for label in np.unique(coarsest):
        node.parameters["matte"].set(f"label.{levels}/{label}")
        matte = rendered(host, node)
        assert (matte == matte[..., :1]).all() and (matte[..., 0][coarsest[..., 0] == label] > 0).all()
        total += matte[..., :1]
    assert (np.abs(total - 1) < 1e-3).mean() > 0.95  # where more than two labels meet, Cryptomatte keeps two
    node.parameters["matte"].set("wall")
    assert host.render(node, (0, 0, 96, 64), Image(host, pixels)) != OK
    assert "matte=wall" in node.messages[0] and f"label.{levels}/1" in node.messages[0]


@pytest.mark.parametrize("padding", [0, 52])
@pytest.mark.parametrize("backward", [False, True])
@pytest.mark.parametrize(
    ("dtype", "channels"), [("float32", 3), ("float32", 1), ("float16", 4), ("uint8", 4), ("uint8", 3)]
)
def test_rows_may_be_padded_run_backward_and_begin_anywhere(host: Host, padding, backward, dtype, channels):
    pixels = photo(channels=max(channels, 3))[..., :channels]
    pixels = np.rint(pixels * 255).astype(np.uint8) if dtype == "uint8" else pixels.astype(dtype)
    data = {"data": 1} if channels == 1 else {}
    node = with_source(host, "Flatten", pixels, radius=12.0, **data)
    corner = (-31, 17)
    node.clips["Source"].connect(Image(host, pixels, corner, padding, backward))
    assert region(node) == (-31, 17, 65, 81)
    found = rendered(host, node, dtype, channels, padding=2 * padding, backward=not backward)
    wanted = of_filter("Flatten", buffer(pixels, "" if data else SPACE), radius=12.0, **dict.fromkeys(data, True))
    np.testing.assert_array_equal(found, wanted)


def test_a_window_is_the_whole_cropped(host: Host):
    node = with_source(host, "Flatten", photo())
    whole = rendered(host, node)
    for left, bottom, right, top in ((0, 0, 10, 7), (33, 20, 96, 64), (90, 60, 120, 90), (-20, -20, -2, -2)):
        out = Image(host, np.full((top - bottom, right - left, 4), 7, np.float32), (left, bottom))
        assert host.render(node, (left, bottom, right, top), out) == OK
        wanted = np.zeros((top - bottom, right - left, 4), np.float32)
        for y in range(max(0, bottom), min(64, top)):
            for x in range(max(0, left), min(96, right)):
                wanted[top - 1 - y, x - left] = whole[63 - y, x]
        np.testing.assert_array_equal(out.rows(), wanted)


def test_only_the_render_window_is_written(host: Host):
    node = with_source(host, "Flatten", photo())
    whole = rendered(host, node)
    out = Image(host, np.full((64, 96, 4), 7, np.float32))
    assert host.render(node, (20, 10, 50, 30), out) == OK
    inside = np.zeros((64, 96), bool)
    inside[34:54, 20:50] = True
    assert (out.rows()[~inside] == 7).all()
    np.testing.assert_array_equal(out.rows()[inside], whole[inside])


def test_any_window_of_the_unbounded_plane(host: Host):
    pixels = photo(64, 64)
    node = with_source(host, "Synthesize", pixels, "Generator", exemplarside=3, seed=5, origin=(1000, -300))
    assert region(node) == (0, 0, 1920, 1080)
    values = {"exemplarside": 64, "seed": 5}
    for left, bottom, right, top in ((0, 0, 50, 40), (100, 1000, 164, 1030)):
        out = Image(host, np.zeros((top - bottom, right - left, 4), np.float32), (left, bottom))
        assert host.render(node, (left, bottom, right, top), out) == OK, node.messages
        window = f"{right - left}x{top - bottom}{left + 1000:+d}{1080 - top - 300:+d}"
        np.testing.assert_array_equal(out.rows(), of_filter("synth", buffer(pixels), window=window, **values))
    node.parameters["size"].set(300, 200)
    assert region(node) == (0, 0, 300, 200)


def test_lengths_are_those_of_the_full_size(host: Host):
    """At a render scale, sigma is that share of its value, and a choice of lengths the nearest one."""
    pixels = photo()
    node = with_source(host, "Tile", pixels, sigma=16.0, size=(120, 80), patch=4, iterations=3, lattice=0.0)
    for scale in (0.5, 0.75):
        out = Image(host, np.zeros((round(80 * scale), round(120 * scale), 4), np.float32))
        window = (0, 0, round(120 * scale), round(80 * scale))
        assert host.render(node, window, out, scale=(scale, scale)) == OK, node.messages
        size = (round(120 * scale), round(80 * scale))
        patch = {0.5: 5, 0.75: 9}[scale]
        wanted = of_filter("Tile", buffer(pixels), sigma=16 * scale, size=size, patch=patch, iterations=3, lattice=0.0)
        np.testing.assert_array_equal(out.rows(), wanted)
