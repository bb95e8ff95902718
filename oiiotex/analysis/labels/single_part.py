# SPDX-License-Identifier: Apache-2.0
"""Label filters that write image and Cryptomatte as one part."""

from __future__ import annotations

from pathlib import Path

from ...engine.core.image import Part
from ...engine.core.op import Kind, Op, Output
from ...engine.errors import ParameterError, modifier

SINGLE = (
    "Output as one unnamed part with the channels of the image and of Cryptomatte, as Blender and Nuke expect. Requires"
    " cryptomatte."
)


class OnePart(Op):
    """A filter that outputs label maps, as parts or only as Cryptomatte; declares `onepart` and `cryptomatte`."""

    onepart: bool

    def require_single(self) -> None:
        """Raise ParameterError for `onepart` without `cryptomatte`, or with further parts."""
        values = self.values()
        if not self.onepart:
            return
        if not values["cryptomatte"]:
            raise ParameterError(f"requires {modifier(cryptomatte=True)}", parameter="onepart", value=True)
        more = [name for name in ("photo", "membership") if values.get(name)]
        if more:
            problem = f"conflicts with {', '.join(more)}: a single part has only the image's channels"
            raise ParameterError(problem, parameter="onepart", value=True)

    def asked(self, output: Output) -> bool | Path:
        """No id parts with `onepart`: Cryptomatte holds the labels."""
        return False if self.onepart and output.kind is Kind.IDS else super().asked(output)

    def carried(self) -> tuple[Part, ...]:
        """No carried parts with `onepart`."""
        return () if self.onepart else super().carried()
