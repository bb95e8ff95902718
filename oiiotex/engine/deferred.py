# SPDX-License-Identifier: Apache-2.0
"""Deferred imports: large libraries, and the modules that declare ops and options.

Declarations of ops and options refer to types of these libraries without using them, and importing numpy takes half a
second. So modules import the libraries from here, and do not use them at import time (tests/oiiotool/test_imports.py).
"""

from __future__ import annotations

import atexit
import importlib
from dataclasses import dataclass
from types import ModuleType
from typing import TYPE_CHECKING, Any

__all__ = ["Shelf", "np", "ocio", "oiio"]

if TYPE_CHECKING:
    import numpy as np
    import OpenImageIO as oiio
    import PyOpenColorIO as ocio
else:

    class _Deferred(ModuleType):
        """Placeholder that imports the library of its name at first use."""

        def __getattr__(self, name: str) -> Any:
            value = getattr(importlib.import_module(self.__name__), name)
            setattr(self, name, value)  # later lookups do not call this function
            return value

    np, oiio, ocio = map(_Deferred, ("numpy", "OpenImageIO", "PyOpenColorIO"))

    @atexit.register
    def _release() -> None:
        """Drop references to the libraries: OpenImageIO prints what is still held when Python ends."""
        for library in (np, oiio, ocio):
            for name in [name for name in vars(library) if not name.startswith("__")]:
                delattr(library, name)


@dataclass(frozen=True)
class Shelf:
    """The ops, or the options, that a module declares; their names are known before it is imported.

    Attributes
    ----------
    heading : str
        Their heading in the help; shelves with the same heading are consecutive.
    module : str
    names : tuple of str
        All their names on the command line, in the order of declaration.
    attribute : str
        Name of the module's tuple of them, or of a single one.
    """

    heading: str
    module: str
    names: tuple[str, ...]
    attribute: str

    @property
    def declarations(self) -> tuple[Any, ...]:
        """The ops, or the options; imports the module."""
        declared = getattr(importlib.import_module(self.module), self.attribute)
        return declared if isinstance(declared, tuple) else (declared,)
