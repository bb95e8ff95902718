# SPDX-License-Identifier: Apache-2.0
"""Promise 10 for memory: what sizes alone show not to fit is refused with the figure before a pixel is read."""

from __future__ import annotations

import re

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from oiiotex.engine import errors
from oiiotex.engine.core.access import Pointwise
from oiiotex.engine.core.image import Image, Part
from oiiotex.engine.core.op import Op
from oiiotex.engine.core.window import Window
from oiiotex.engine.run import run
from oiiotex.engine.session import Session
from tests.any_filter import LABELED, SEVERAL, is_view, named, of, settings

FIGURE = re.compile(r"needs \d+ MB.* the budget is \d+ MB")
SIDE = 30_000
# what reads first, and why it may
READS = {
    "graph": "exemplars are reduced to `side` as they are read",
    "labelview": "every so many-th row is read, into a sheet of a fixed size",
    "warp": "the map of coordinates is materialized: in memory where it is small, else in a file",
    "estimateroughness": "bands, and a coarse grid",
    "checkmaterial": "bands, and sums",
}
# of a megapixel, and what they found only then
LATE = {"superpixel": "how many runs of rows there are depends on pixels"}


class Reads:
    """Counts windows that are read of pictures that lie nowhere."""

    def __init__(self) -> None:
        self.count = 0

    def part(self, name: str, side: int, channels: int, kind: oiio.BASETYPE, tag: str = "") -> Part:
        spec = oiio.ImageSpec(side, side, channels, kind)
        if tag:
            spec.attribute("oiio:ColorSpace", tag)

        def fetch(window: Window) -> np.ndarray:
            self.count += 1
            if side == SIDE:
                raise errors.Interrupted("read")
            y, x = np.ogrid[window.top : window.bottom, window.left : window.right]
            values = (7 * y + 13 * x)[..., None] % 97
            if kind == oiio.UINT32:
                return (values % 5 + 1).astype(np.uint32)
            return np.repeat(values / np.float32(97), channels, 2).astype(np.float32)

        return Part(name, spec, fetch)

    def op(self, op: type[Op], side: int, **more: object) -> Op:
        """One use of a filter, of a photo of side x side px and whatever else it takes."""
        label = Image(
            (self.part("label.1", side, 1, oiio.UINT32), self.part("label.2", side, 1, oiio.UINT32)), "labels"
        )
        parts = label.parts if op.name in LABELED else ()
        photo = Image((self.part("photo", side, 3, oiio.FLOAT, "srgb_rec709_scene"), *parts), "photo")
        coordinates = Image((self.part("st", side, 2, oiio.FLOAT, "data"),), "st")
        second = {"warp": coordinates, "project": photo}.get(op.name, label)
        images = [label if is_view(op) else photo, second][: len(op.images())]
        given = named(op, [photo] * SEVERAL[op.name] if op.name in SEVERAL else images)
        return op(**given, **settings(op, **more))


@of(list(filters.FILTERS))
def test_what_cannot_fit_is_refused_before_a_pixel_is_read(op: type[Op]):
    """Of a photo of 900 megapixels and a budget of 4 MB: a figure and no read, or nothing that must fit."""
    reads = Reads()
    try:
        run(reads.op(op, SIDE), Session(budget=4 << 20))
    except errors.Interrupted:
        assert op.name in READS, "it reads before it refuses, or says nothing"
    except errors.Error as error:
        assert FIGURE.search(str(error)) and reads.count == 0, error
    else:
        assert reads.count == 0 and (issubclass(op, Pointwise) or op.name in ("rectify", "estimateao")), "it is lazy"


@of([op for op in filters.FILTERS if op.name not in LATE])
@pytest.mark.parametrize("megabytes", [1, 6, 24])
def test_a_refusal_never_comes_after_reading(op: type[Op], megabytes: int):
    """Of a megapixel, which is there: what has begun to read goes on to its end."""
    reads = Reads()
    stopped = Session(budget=megabytes << 20, progress=lambda done, total: False)  # the work itself is not of interest
    try:
        run(reads.op(op, 1100), stopped)
    except errors.Interrupted:
        pass
    except errors.Error as error:
        assert reads.count == 0 or not FIGURE.search(str(error)), error
