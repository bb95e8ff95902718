# SPDX-License-Identifier: Apache-2.0
"""What a label part says of itself is read back in one place."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio

from oiiotex.analysis.labels.legend import Legend, code_of, codes_of, color_of
from oiiotex.engine.core.image import Image, Part, from_pixels
from oiiotex.engine.core.label_map import LabelMap, label_maps, opened_level


def part(name: str, ids: np.ndarray) -> Part:
    spec = oiio.ImageSpec(ids.shape[1], ids.shape[0], 1, oiio.UINT32)
    return from_pixels(name, ids.astype(np.uint32)[..., None], spec)


def test_levels_come_from_names_finest_first():
    image = Image(
        tuple(part(name, np.ones((2, 3))) for name in ("photo", "label.10", "label.2", "label.x", "alabel.1"))
    )
    assert list(label_maps(image)) == [2, 10]


def test_the_coarsest_level_with_several_labels_is_opened():
    one, two, unknown = (LabelMap.of(part("any", np.ones((2, 3))), n, [()] * n) for n in (1, 2, 0))
    assert opened_level({1: two, 2: two, 3: one}) == 2
    assert opened_level({1: one, 2: one}) == 2 and opened_level({1: two, 2: unknown}) == 2


def test_what_is_said_is_read_back():
    one = LabelMap.of(part("any", np.array([[1, 2, 2]])), 3, [(7, 3), ()], 12.5)
    again = label_maps(Image((one.part,)))[3]
    assert (again.part.name, again.count, again.scale, again.name(2)) == ("label.3", 2, 12.5, "label.3/2")
    assert again.part.spec["oiiotex:parents"] == "7 3,0"
    assert again.parents(4) == [[7, 3], [], [], []] and again.parents(1) == [[7, 3]]
    plain = LabelMap(part("label.1", np.ones((2, 2))), 1)
    assert (plain.count, plain.scale, plain.parents(2)) == (0, 0.0, [[], []])


def test_a_legend_counts_what_is_opaque_the_largest_first():
    ids = np.array([[1, 2, 2, 0], [3, 2, 4, 4]])
    legend = Legend.of(
        LabelMap.of(part("label.1", ids), 1, [(1,), (1,), (2, 1), (2,)]), np.array([[1, 1, 1, 1], [0, 1, 1, 1]], bool)
    )
    entries = legend.entries()
    assert [(e["id"], e["area"], e["parents"]) for e in entries] == [(2, 3, [1]), (4, 2, [2]), (1, 1, [1])]
    assert [code_of(e["color"]) for e in entries] == codes_of(np.array([2, 4, 1])).tolist()
    assert color_of(code_of("1,22,255")) == "1,22,255"
