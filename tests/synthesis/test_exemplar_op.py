# SPDX-License-Identifier: Apache-2.0
"""What ops read of their exemplar: values, the pixels that may be taken, and why the others may not."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from oiiotex import filters
from oiiotex.engine.color.lab import working_values
from oiiotex.engine.core.image import Image, Part, from_buffer
from oiiotex.engine.core.op import Space
from oiiotex.engine.errors import ImageError, ParameterError
from oiiotex.engine.session import Session
from oiiotex.filters.texcut import Cut
from oiiotex.filters.texquilt import Quilting
from oiiotex.synthesis.exemplar.exemplar_op import ExemplarOp, LabeledExemplar
from tests import pictures
from tests.any_filter import buffer, quarters

PHOTO = pictures.bricks(64, 72, seed=3)
LEFT = np.indices((64, 72))[1] < 40
THERE = np.indices((64, 72))[0] > 9  # where alpha is not 0


def image_of(pixels: np.ndarray, **facts: object) -> Image:
    return from_buffer(buffer(pixels, **facts))


def photo(*parts: Part) -> Image:
    opaque = np.concatenate([PHOTO * THERE[..., None], THERE[..., None]], -1)
    first = image_of(opaque, names=tuple("RGBA"))
    return Image((*first.parts, *parts), "photo")


LABELS = dataclasses.replace(from_buffer(quarters()).first, name="label.1")
MASK = image_of(LEFT[..., None] * 1.0, names=("Y",))
UPPER = np.indices((64, 72))[0] < 32
MANY = "transparent pixels and of pixels outside the mask or label"


@pytest.mark.parametrize(
    ("given", "also", "usable", "why"),
    [
        ({}, None, THERE, "transparent pixels"),
        ({"mask": MASK}, None, THERE & LEFT, MANY),
        ({"label": 1}, None, THERE & UPPER & (np.indices((64, 72))[1] < 36), MANY),
        ({"mask": MASK, "label": 2}, None, THERE & UPPER & LEFT & (np.indices((64, 72))[1] >= 36), MANY),
        ({"mask": MASK}, UPPER, THERE & UPPER & LEFT, MANY),
    ],
    ids=["alpha", "mask", "label", "mask and label", "what an op adds"],
)
def test_what_may_be_taken_is_what_all_allow(given, also, usable, why):
    exemplar = photo(LABELS)
    seen = Cut(exemplar=exemplar, **given).read(Session().resources, also)
    values, opaque = working_values(exemplar, Session().resources, Space.LAB)
    np.testing.assert_array_equal(seen.values, values)
    np.testing.assert_array_equal(seen.opaque, opaque)
    np.testing.assert_array_equal(seen.usable, usable)
    assert seen.why == why


def test_all_of_a_plain_photo_may_be_taken():
    seen = Cut(exemplar=image_of(PHOTO)).read(Session().resources)
    assert (seen.opaque, seen.usable, seen.why) == (None, None, "transparent pixels")
    seen = Cut(exemplar=image_of(PHOTO), mask=MASK).read(Session().resources)
    np.testing.assert_array_equal(seen.usable, LEFT)
    assert seen.why == "pixels outside the mask or label"


def test_a_level_alone_says_nothing_but_to_what_looks_labels_up():
    with pytest.raises(ParameterError, match="labellevel=1: requires label"):
        Cut(exemplar=photo(LABELS), labellevel=1).plan(Session().resources)
    usable = Quilting(exemplar=photo(LABELS), labellevel=1).read(Session().resources).usable
    np.testing.assert_array_equal(usable, THERE)


def test_a_single_part_of_ids_is_a_label_map_and_two_need_names():
    """`labels.tif --siappend` appends it; formats without part names number parts."""
    ids = dataclasses.replace(LABELS, name="subimage01")
    usable = Cut(exemplar=photo(ids), label=1).read(Session().resources).usable
    np.testing.assert_array_equal(usable, THERE & UPPER & (np.indices((64, 72))[1] < 36))
    with pytest.raises(ImageError, match="has no label parts"):
        Cut(exemplar=photo(ids, dataclasses.replace(ids, name="subimage02")), label=1).plan(Session().resources)


def test_what_leaves_nothing_is_refused():
    nothing, corner = (
        image_of(where[..., None] * 1.0, names=("Y",)) for where in (LEFT & ~LEFT, LEFT & ~THERE & UPPER)
    )
    for given in ({"mask": nothing}, {"mask": corner, "label": 4}):  # label 4 is below, at the right
        with pytest.raises(ImageError, match="no pixel of"):
            Cut(exemplar=photo(LABELS), **given).read(Session().resources)


def test_every_op_that_copies_from_a_photo_declares_it_there():
    names = {op.name for op in filters.FILTERS if issubclass(op, LabeledExemplar)}
    assert names == {"stationarize", "patchmatch", "quilt", "cut", "composite", "palette", "paint", "atlas", "fill"}
    assert {op.name for op in filters.FILTERS if issubclass(op, ExemplarOp)} == {
        "stationarize",
        "patchmatch",
        "cut",
        "atlas",
        "fill",
    }
