# SPDX-License-Identifier: Apache-2.0
"""Further parts of a photo are in the result of a filter that makes pixels, or a warning names them."""

import logging

import pytest

from oiiotex import filters
from oiiotex.engine.core.op import Kind, Op
from tests import pictures
from tests.any_filter import buffer, image_kind, of, operands, settings

PIXELS = [op for op in filters.FILTERS if image_kind(op) is Kind.PIXELS]
pytestmark = pytest.mark.usefixtures("few_places")


def made_of(op: type[Op], *further: str) -> set[str]:
    """Names of the parts of what the filter makes of a photo with further parts."""
    first, *others = operands(op, buffer(pictures.bricks(64, 72, seed=1)))
    parts = first if isinstance(first, dict) else {"photo": first}
    depth = buffer(pictures.moss(64, 72, seed=2)[..., :1], space="data", names=("Z",))
    made = getattr(filters, op.name)({**parts, **dict.fromkeys(further, depth)}, *others, **settings(op))
    return set(made) if isinstance(made, dict) else set()


@of(PIXELS)
def test_a_further_part_is_kept_or_named(op: type[Op], caplog: pytest.LogCaptureFixture):
    with caplog.at_level(logging.WARNING, "oiiotex"):
        kept = "depth" in made_of(op, "depth")
    said = f"{op.flag()}: photo: further parts are not in the result: depth" in caplog.messages
    assert kept is not said


@of([op for op in PIXELS if op.name in ("warp", "rectify")])
def test_nothing_is_said_of_a_photo_alone(op: type[Op], caplog: pytest.LogCaptureFixture):
    with caplog.at_level(logging.WARNING, "oiiotex"):
        made_of(op)
    assert not [text for text in caplog.messages if "further" in text]
