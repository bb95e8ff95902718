# SPDX-License-Identifier: Apache-2.0
"""The filters: one thin file per op. `OURS` lists them; each is also a function, as `docs/python.md` shows.

A file is imported when its filter is asked for, by a line that names it or from Python.
"""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable
from types import ModuleType
from typing import TYPE_CHECKING, Any

from ..deferred import Shelf

if TYPE_CHECKING:
    from ..core.op import Op

HEADING = "Texture filters"
SHELVES = tuple(
    Shelf(HEADING, f"{__name__}.{file}", (f"--tex{name}",), declared)
    for name, file, declared in (
        ("stationarize", "stationarize", "Stationarize"),
        ("patchmatch", "patchmatch", "PatchMatch"),
        ("quilt", "quilt", "Quilting"),
        ("synth", "synth", "Synth"),
        ("zoom", "zoom", "Zoom"),
        ("graph", "graph", "ExemplarGraph"),
        ("join", "join", "Join"),
        ("atlas", "atlas", "Atlas"),
        ("cut", "cut", "Cut"),
        ("composite", "composite", "Composite"),
        ("palette", "palette", "Palette"),
        ("paint", "paint", "Paint"),
        ("flatten", "flatten", "Flatten"),
        ("sigmas", "sigmas", "Sigmas"),
        ("stationarity", "stationarity", "Stationarity"),
        ("superpixel", "superpixel", "Superpixel"),
        ("label", "label", "Label"),
        ("decompose", "decompose", "Decompose"),
        ("dominant", "dominant", "Dominant"),
        ("labelview", "labelview", "LabelView"),
        ("content", "content", "Content"),
        ("lab", "lab", "Lab"),
        ("warp", "warp", "Warp"),
        ("rectify", "rectify", "Rectify"),
        ("estimateheight", "estimateheight", "EstimateHeight"),
        ("estimateao", "estimateao", "EstimateAO"),
        ("estimateroughness", "estimateroughness", "EstimateRoughness"),
        ("checkmaterial", "checkmaterial", "CheckMaterial"),
        ("preview", "preview", "Preview"),
        ("variants", "variants", "Variants"),
    )
)

__all__ = ["FILTERS", "OURS"]


@functools.cache
def further() -> tuple[type[Op], ...]:
    """The filters of other packages."""
    from ..installed_filters import installed

    return installed(shelf.names[0].removeprefix("--tex") for shelf in SHELVES)


@functools.cache
def _lists(name: str) -> tuple[type[Op], ...]:
    ours = tuple(op for shelf in SHELVES for op in shelf.declarations)
    return ours if name == "OURS" else (*ours, *further())


@functools.cache
def _function(op: type[Op]) -> Callable[..., Any]:
    from ..python_api import function_of

    _lists("OURS")  # what its text says of other filters' modifiers is said in words of Python, too
    return function_of(op)


def __getattr__(name: str) -> Any:
    """`OURS`, `FILTERS`, the classes that declare filters, and the functions of other packages' filters."""
    if name in __all__:
        return _lists(name)
    for shelf in SHELVES:
        if shelf.attribute == name:
            return shelf.declarations[0]
    for op in () if name.startswith("_") else further():
        if op.name == name:
            return _function(op)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """The functions alone."""
    return sorted(op.name for op in _lists("FILTERS"))


class _Function:
    """A filter's function as this package's attribute, which `import` would set to the file of the same name."""

    def __init__(self, shelf: Shelf):
        self._shelf = shelf

    def __get__(self, package: ModuleType, _: type) -> Callable[..., Any]:
        return _function(self._shelf.declarations[0])

    def __set__(self, package: ModuleType, file: ModuleType) -> None:
        pass


sys.modules[__name__].__class__ = type(
    "Filters", (ModuleType,), {shelf.names[0].removeprefix("--tex"): _Function(shelf) for shelf in SHELVES}
)
