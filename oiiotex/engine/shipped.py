# SPDX-License-Identifier: Apache-2.0
"""Files that are shipped with the package but lie beside it in a checkout, which may run without being installed."""

from __future__ import annotations

from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path


def shipped(folder: str, in_checkout: str) -> Traversable:
    """The folder inside the installed package, else its place in the checkout: setuptools maps one to the other."""
    packed = resources.files("oiiotex") / folder
    return packed if packed.is_dir() else Path(__file__).parents[2] / in_checkout
