# SPDX-License-Identifier: Apache-2.0
"""A use of an op is planned from its values and specs alone: no pixel is read and no device is opened."""

from __future__ import annotations

import dataclasses

import pytest

from oiiotex import filters
from oiiotex.engine.core.image import Image
from oiiotex.engine.core.op import Op, Plan, no_pixels
from oiiotex.engine.core.window import Window
from oiiotex.engine.opencl import device_choice
from oiiotex.engine.run import is_provisional, planned, run
from oiiotex.engine.session import Session
from oiiotex.engine.session.facts import Facts
from oiiotex.engine.session.settings import Settings
from tests.any_filter import PHOTO, buffer, image_of, named, of, operands, settings


def used(op: type[Op], *, pixels: bool, **more: object) -> Op:
    """A use of the op, on images that may be read or not."""

    def blind(image: Image) -> Image:
        parts = (part if pixels else dataclasses.replace(part, fetch=no_pixels) for part in image.parts)
        return Image(tuple(parts), image.source)

    given = named(op, [blind(image_of(one)) for one in operands(op, buffer(PHOTO))])
    return op(**given, **(settings(op) | more))


@of(list(filters.FILTERS))
def test_a_plan_reads_no_pixel_and_opens_no_device(op, monkeypatch):
    monkeypatch.setattr(device_choice, "open_device", lambda *_: pytest.fail("a device is opened"))
    use = used(op, pixels=False)
    plan = use.plan(Facts(Settings()))
    assert isinstance(plan, Plan)
    for image in planned(use, Facts(Settings()), set()):
        assert image.parts


# their sizes follow from the photo's or the size that is given; `stationarize` without a size is planned as provisional
KNOWN = {
    "lab": {}, "rectify": {}, "estimateao": {}, "checkmaterial": {}, "flatten": {"drift": True, "tiled": "x"},
    "stationarize": {"size": (64, 56), "drift": True, "st": True}, "patchmatch": {"st": True, "tiles": "y"},
    "synth": {"window": "24x20+8-4", "st": True},
}  # fmt: skip


@pytest.mark.parametrize(
    "more", [{"variants": 2}, {"variants": 9}, {"variants": 4, "pack": "atlas", "kinds": ("color",)}]
)
def test_the_tiles_of_a_planned_set_are_those_that_are_made(more):
    use = {"size": (48, 40), "patch": 7, "iterations": 1, "st": True} | more
    op = filters.op_named("stationarize")
    images = planned(used(op, pixels=False, **use), Facts(Settings()), set())
    results = run(used(op, pixels=True, **use), Session())
    assert len(images) == len(results)
    for image, result in zip(images, results, strict=True):
        for part, made in zip(image.parts, result.image.parts, strict=True):
            assert (part.window, part.name) == (made.window, made.name)
            for name in ("wrapmodes", "oiiotex:edges", "oiiotex:atlas"):
                assert part.spec.get_string_attribute(name) == made.spec.get_string_attribute(name)


@of([op for op in filters.FILTERS if op.name in KNOWN])
def test_planned_images_are_those_that_are_made(op):
    more = KNOWN[op.name]
    (image,) = planned(used(op, pixels=False, **more), Facts(Settings()), set())
    assert not is_provisional(image)
    (result,) = run(used(op, pixels=True, **more), Session())
    for part, made in zip(image.parts, result.image.parts, strict=True):
        assert (part.window, part.name) == (made.window, made.name)
        assert Window.display(part.spec) == Window.display(made.spec)
        wrapmodes = (one.spec.get_string_attribute("wrapmodes") for one in (part, made))
        assert len(set(wrapmodes)) == 1
        assert (part.spec.format, part.spec.channelnames) == (made.spec.format, made.spec.channelnames)
        with pytest.raises(AssertionError, match="before the work"):
            part.read(Window.sized(*part.window[:2], 1, 1))
