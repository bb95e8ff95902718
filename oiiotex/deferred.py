# SPDX-License-Identifier: Apache-2.0
"""What is imported when something of it is first asked for: large libraries, and modules by what they declare.

All that is declared (ops, options, their help and checks) names their types, and none of it needs them: a line that
only prints, or that is wrong, must not wait half a second for numpy. So modules take them from here, and use nothing
of them while they are themselves imported (tests/test_imports.py).
"""

from __future__ import annotations

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
        """Stands for the library of its name, and hands on what is asked of it."""

        def __getattr__(self, name: str) -> Any:
            value = getattr(importlib.import_module(self.__name__), name)
            setattr(self, name, value)  # from now on it is asked for as quickly as of the library itself
            return value

    np, oiio, ocio = map(_Deferred, ("numpy", "OpenImageIO", "PyOpenColorIO"))


@dataclass(frozen=True)
class Shelf:
    """The ops, or the options, that a module declares: known by name before it is imported.

    Attributes
    ----------
    heading : str
        Under which help shows them; shelves of one heading follow each other.
    module : str
    names : tuple of str
        All by which a line may call them, in the order in which they are declared.
    attribute : str
        The module's tuple of them, or the one that there is.
    """

    heading: str
    module: str
    names: tuple[str, ...]
    attribute: str

    @property
    def declarations(self) -> tuple[Any, ...]:
        """The ops, or the options: the module is imported."""
        declared = getattr(importlib.import_module(self.module), self.attribute)
        return declared if isinstance(declared, tuple) else (declared,)
