# SPDX-License-Identifier: Apache-2.0
"""What is asked of any filter: images for all of its inputs, cheap parameters, and which filters a promise concerns."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from oiiotex.engine.core.image import Image, from_buffer
from oiiotex.engine.core.op import Kind, Op, Space
from oiiotex.engine.core.parameters import Numbers, Size, Words
from oiiotex.engine.session import Session
from tests import pictures

# fewer rounds and small places, where beauty does not matter
SMALL = {"iterations": 4, "threshold": 0.9, "radius": 16, "panel": 64}


def settings(op: type[Op], **more: object) -> dict[str, object]:
    """Cheap parameters that the op has."""
    names = {p.name for p in op.parameters()}
    found = {name: value for name, value in SMALL.items() if name in names}
    found |= {"count": 3} if op.name == "sigmas" else {"op": "quilt", "count": 2} if op.name == "sheet" else {}
    found |= {"corners": Numbers((3, 2, 66, 5, 70, 60, 1, 62))} if op.name == "rectify" else {}
    found |= {"panel": 32} if op.name == "palette" else {}
    found |= {"fail": Words(("none",))} if op.name == "checkmaterial" else {}
    found |= {"mesh": pictures.cube_file(), "size": Size(20, 18)} if op.name == "atlas" else {}
    found |= {"size": Size(32, 32)} if op.name == "cut" else {"size": Size(72, 64)} if op.name == "composite" else {}
    found |= {"tiled": "xy"} if op.name == "transition" else {}
    found |= {"lights": Numbers(LIGHTS)} if op.name == "capture" else {}
    # its first frame is the middle of the photo, whatever the seed
    found |= {"frame": 2, "speed": 1.0, "size": Size(72, 64)} if op.name == "zoom" else {}
    return found | {name: value for name, value in more.items() if name in names}


def ids(values: np.ndarray, **attributes: float) -> oiio.ImageBuf:
    """A label map, (height, width); attributes of ours."""
    spec = oiio.ImageSpec(values.shape[1], values.shape[0], 1, oiio.UINT32)
    for name, value in attributes.items():
        spec.attribute(f"oiiotex:{name}", value)
    made = oiio.ImageBuf(spec)
    made.set_pixels(made.roi, values.astype(np.uint32)[..., None])
    return made


def quarters() -> oiio.ImageBuf:
    """A label map for the photo: four labels, in four pieces."""
    y, x = np.indices((64, 72))
    return ids(1 + x // 36 + 2 * (y // 32))


def buffer(pixels: np.ndarray, kind=oiio.FLOAT, space: str = "srgb_rec709_scene", names=None) -> oiio.ImageBuf:
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], kind)
    if names:
        spec.channelnames = names
    if space:
        spec.attribute("oiio:ColorSpace", space)
    made = oiio.ImageBuf(spec)
    made.set_pixels(made.roi, np.ascontiguousarray(pixels, np.float32))
    return made


def scramble(height: int, width: int, like: oiio.ImageBuf) -> oiio.ImageBuf:
    """A map of source coordinates in random order."""
    spec = like.spec()
    y, x = (np.random.default_rng(0).integers(0, n, (height, width)) for n in (spec.height, spec.width))
    st = np.stack([(x + 0.5) / spec.width, (y + 0.5) / spec.height], -1)
    return buffer(st, space="data", names=("R", "G"))


def labeled(photo: oiio.ImageBuf, labels: oiio.ImageBuf | None = None) -> dict[str, oiio.ImageBuf]:
    """The photo with a label map, as parts of one image."""
    return {"photo": photo, "label.1": labels or quarters()}


def image_of(given: oiio.ImageBuf | dict[str, oiio.ImageBuf]) -> Image:
    """An image of one buffer, or of the parts of `labeled`."""
    if isinstance(given, oiio.ImageBuf):
        return from_buffer(given)
    return Image(tuple(replace(from_buffer(one).first, name=name) for name, one in given.items()), "photo")


def with_labels(op: type[Op], photo: Image) -> Image:
    """The photo, with a label map if the op takes one."""
    labels = (replace(from_buffer(quarters()).first, name="label.1"),) if op.name in LABELED else ()
    return Image((*photo.parts, *labels), photo.source)


def operands(op: type[Op], photo: oiio.ImageBuf) -> list[Any]:
    """Images for all of an op's inputs, the photo first; a label map for what takes one."""
    if is_view(op):
        return [ids(np.indices((64, 72)).sum(0) // 30 + 1)]
    if op.name in LABELED:
        return [labeled(photo), quarters()][: len(op.images())]
    if op.name in REGIONS:
        return [photo, ids(np.indices((64, 72))[1] >= 20)]
    if op.name in PLATES:
        return [photo, photo]
    if op.name == "transition":  # a second tile
        return [photo, oiio.ImageBufAlgo.flop(photo)]
    if op.name in SEVERAL:
        return [photo] * SEVERAL[op.name]
    return [photo, *(scramble(40, 48, photo) for _ in op.images()[1:])]


def named(op: type[Op], given: list[Any]) -> dict[str, Any]:
    """Images by the names of the op's inputs."""
    inputs = op.images()
    return {inputs[0].name: tuple(given)} if inputs[0].many else {i.name: g for i, g in zip(inputs, given, strict=True)}


def apply(op: type[Op], photo: oiio.ImageBuf, session: Session | None = None, **values: object) -> oiio.ImageBuf:
    made = getattr(filters, op.name)(*operands(op, photo), session=session, **settings(op, **values))
    made = made[0] if isinstance(made, list) else made
    return next(iter(made.values())) if isinstance(made, dict) else made


def pixels(image: oiio.ImageBuf) -> np.ndarray:
    return image.get_pixels(image.spec().format, image.roi)


def of(found: list[type[Op]]) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("op", found, ids=lambda op: op.name)


def image_kind(op: type[Op]) -> Kind:
    """What the op's image is."""
    return op.main().kind


def is_view(op: type[Op]) -> bool:
    """Whether it draws what it takes for people: label maps here."""
    return image_kind(op) is Kind.PICTURE and op.space is Space.ANY


# What is true of few and does not follow from the kinds of their outputs; a new filter is held to everything else.
RESAMPLED = ("zoom",)  # their results are pixels of another size
LABELED = ("composite", "palette", "paint")  # take a picture with its label maps, and a painting of labels
PLATES = ("project",)  # and a plate with the same channels
LIGHTS = (0, 1, 1, -1, -0.5, 1, 1, -0.5, 1, 0, -1, 1, 1, 0.5, 1, -1, 0.5, 1)  # of its photos, equally high
SEVERAL = {"capture": 6, "transition": 2}  # images that they take: of one surface under other lights; tiles
REGIONS = ("fill",)  # and a mask of what is replaced: most of the photo
SUMS = ("preview",)  # what a pixel is worth is a difference of sums over all before it
PICTURES = [op for op in filters.FILTERS if image_kind(op) is not Kind.PICTURE]  # take pictures and draw no sheets
COLOR = [op for op in PICTURES if op.space is Space.LAB]
every_filter = of(PICTURES)
color_filters = of(COLOR)
copying_filters = of([op for op in filters.FILTERS if op.copies])
PHOTO = pictures.stained(pictures.bricks(64, 72, seed=2))
