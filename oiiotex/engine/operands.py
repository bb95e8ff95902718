# SPDX-License-Identifier: Apache-2.0
"""The images of an op, checked before it is planned."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .core.op import Op, Space
from .errors import ImageError
from .io.cryptomatte import require_no_ids, require_unmixed
from .io.evidence import is_described

if TYPE_CHECKING:
    from .session.facts import Facts


def check_operands(op: Op, facts: Facts) -> None:
    """Refuse images without pixels, and tag untagged ones as their profiles say if the op compares colors.

    Raises
    ------
    ImageError
        An image has no pixels, as the first part of some FITS files, or a filter would average ids of Cryptomatte.
    """
    for image in op.operands():
        if image.first.window.empty:
            hint = "select another part: --subimage 1" if len(image.parts) > 1 else ""
            raise ImageError("has no pixels", subject=image.source, hint=hint)
    if op.blends:
        for image in (given for slot, given in op.given() if slot in op.images()):
            require_unmixed(image.first, op.flag())
            require_no_ids(image.first, op.flag())
    if op.working_space is Space.LAB and any(map(is_described, op.operands())):
        op.change_images(facts.color.believed)
