# SPDX-License-Identifier: Apache-2.0
"""How filters of labels are told to put image and Cryptomatte into one part."""

from __future__ import annotations

from ..core.op import Op
from ..errors import ParameterError

SINGLE = (
    "with cryptomatte: one nameless part of the image's channels and Cryptomatte's, as Blender and Nuke take it at once"
)


def require_single(op: Op) -> None:
    """Refuse what does not go with `single`.

    Raises
    ------
    ParameterError
        There is no Cryptomatte, or further parts are asked for.
    """
    values = op.values()
    if not values["single"]:
        return
    if not values["cryptomatte"]:
        raise ParameterError("single says how Cryptomatte is written: say cryptomatte, too")
    more = [name for name in ("keep", "soft") if values.get(name)]
    if more:
        raise ParameterError(f"single is one part, which has the image's channels: leave out {', '.join(more)}")
