# SPDX-License-Identifier: Apache-2.0
"""The filters: one file per op. `OURS` lists them; each is also a function (see `docs/reference/python.md`).

The file of a filter has the name of its option (`texquilt.py`), and is imported when the filter is first used, by a
command line or from Python. No other module imports it: use `op_named` to get its class.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from ..engine.deferred import Shelf

if TYPE_CHECKING:
    from ..engine.core.op import Op

_GROUPS = {  # the name of each filter and the class that declares it, in the order of help
    "Texture synthesis": {
        "stationarize": "Stationarize", "synth": "Synth", "quilt": "Quilting", "cut": "Cut",
        "patchmatch": "PatchMatch", "transition": "Transition", "composite": "Composite", "paint": "Paint",
        "atlas": "Atlas", "zoom": "Zoom", "graph": "ExemplarGraph", "fill": "Fill",
    },
    "Texture preparation and material maps": {
        "flatten": "Flatten", "rectify": "Rectify", "warp": "Warp", "capture": "Capture",
        "estimateheight": "EstimateHeight", "estimateao": "EstimateAO", "estimateroughness": "EstimateRoughness",
        "checkmaterial": "CheckMaterial",
    },
    "Fills that move with a shot": {"plate": "Plate", "project": "Project"},
    "Texture analysis and labels": {
        "label": "Label", "superpixel": "Superpixel", "decompose": "Decompose", "dominant": "Dominant",
        "palette": "Palette", "content": "Content", "stationarity": "Stationarity", "sigmas": "Sigmas", "lab": "Lab",
    },
    "Texture previews": {"preview": "Preview", "sheet": "ContactSheet", "labelview": "LabelView"},
}  # fmt: skip
SHELVES = tuple(
    Shelf(heading, f"{__name__}.tex{name}", (f"--tex{name}",), declared)
    for heading, group in _GROUPS.items()
    for name, declared in group.items()
)

__all__ = ["FILTERS", "OURS"]


def op_named(name: str) -> type[Op]:
    """The class of a filter, ours or of another package; KeyError if there is none of that name."""
    for shelf in SHELVES:
        if shelf.names == (f"--tex{name}",):
            return shelf.declarations[0]
    return {op.name: op for op in further()}[name]


@functools.cache
def further() -> tuple[type[Op], ...]:
    """The filters of other packages."""
    from ..python.declared_entries import installed_filters

    return installed_filters(shelf.names[0].removeprefix("--tex") for shelf in SHELVES)


@functools.cache
def _lists(name: str) -> tuple[type[Op], ...]:
    ours = tuple(op for shelf in SHELVES for op in shelf.declarations)
    return ours if name == "OURS" else (*ours, *further())


@functools.cache
def _function(name: str) -> Callable[..., Any]:
    from ..python.python_api import function_of

    return function_of(op_named(name))


def __getattr__(name: str) -> Any:
    """`OURS`, `FILTERS`, and the filters' functions."""
    if name in __all__:
        return _lists(name)
    if not name.startswith(("_", "tex")):  # modules are looked up by import
        try:
            return _function(name)
        except KeyError:
            pass
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """The names of the functions."""
    return sorted(op.name for op in _lists("FILTERS"))
