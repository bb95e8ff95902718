# SPDX-License-Identifier: Apache-2.0
"""Limits of a kept layout that follow from the photo's size."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...engine.errors import ImageError

if TYPE_CHECKING:
    from ...engine.deferred import oiio
    from ...engine.session.facts import Facts

LEAST = 16  # px; shorter sides have no room for a seam
_BYTES, _COMMON = 90, 64 << 20  # for each pixel of the photo; for periods and cuts


def require_layout(spec: oiio.ImageSpec, facts: Facts) -> None:
    """Refuse a photo whose layout cannot be kept: too small for a seam, or too large for the budget."""
    if min(spec.width, spec.height) < LEAST:
        raise ImageError(
            f"the photo is {spec.width}x{spec.height} px: expected at least {LEAST}x{LEAST} px to keep its layout"
        )
    facts.require(_bytes_needed(spec), "keeping the photo's layout")


def fits_layout(spec: oiio.ImageSpec, facts: Facts) -> bool:
    """Whether `require_layout` accepts the photo."""
    return min(spec.width, spec.height) >= LEAST and _bytes_needed(spec) <= facts.budget


def _bytes_needed(spec: oiio.ImageSpec) -> int:
    return _BYTES * spec.width * spec.height + _COMMON
