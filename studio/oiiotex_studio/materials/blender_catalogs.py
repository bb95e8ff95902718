# SPDX-License-Identifier: Apache-2.0
"""Blender's list of asset catalogs."""

from __future__ import annotations

import uuid
from collections.abc import Iterable

BLENDER = "blender_assets.cats.txt"
_NAMESPACE = uuid.UUID("6f1d8a52-0f0b-4c55-9d0a-0a7d3f0e5b11")  # of Blender's catalogs


def blender_catalog(paths: Iterable[str], there: str = "") -> str:
    """The content of Blender's list of catalogs: a line per path, with a stable id.

    Parameters
    ----------
    paths : iterable of str
        Paths such as 'Materials/ground'.
    there : str
        Previous content. Other catalogs and changed names are kept.
    """
    made = {catalog_id(path): f"{path}:{path.replace('/', '-')}" for path in sorted(set(paths))}
    others = {}
    for line in there.splitlines():
        identifier, colon, rest = line.partition(":")
        if colon and not line.startswith("#") and identifier != catalog_id(rest.partition(":")[0]):
            others[identifier] = rest
    lines = ["# Catalogs of assets for Blender's asset browser.", "VERSION 1", ""]
    return "\n".join(lines + [f"{identifier}:{rest}" for identifier, rest in (made | others).items()]) + "\n"


def catalog_id(path: str) -> str:
    """The stable id of a catalog path."""
    return str(uuid.uuid5(_NAMESPACE, path))
