# SPDX-License-Identifier: Apache-2.0
"""How filters of labels are told to put image and Cryptomatte into one part, and what they then do."""

from __future__ import annotations

from pathlib import Path

from ..core.image import Part
from ..core.op import Kind, Op, Output
from ..errors import ParameterError

SINGLE = (
    "with cryptomatte: one nameless part of the image's channels and Cryptomatte's, as Blender and Nuke take it at once"
)


class OnePart(Op):
    """Makes label maps, in parts or in Cryptomatte's channels alone; declares `single` and `cryptomatte`."""

    single: bool

    def require_single(self) -> None:
        """Refuse `single` without Cryptomatte, and with further parts."""
        values = self.values()
        if not self.single:
            return
        if not values["cryptomatte"]:
            raise ParameterError("single says how Cryptomatte is written: say cryptomatte, too")
        more = [name for name in ("keep", "soft") if values.get(name)]
        if more:
            raise ParameterError(f"single is one part, which has the image's channels: leave out {', '.join(more)}")

    def asked(self, output: Output) -> bool | Path:
        """Ids are in Cryptomatte's channels where one part holds all."""
        return False if self.single and output.kind is Kind.IDS else super().asked(output)

    def carried(self) -> tuple[Part, ...]:
        """None where one part holds all."""
        return () if self.single else super().carried()
