# SPDX-License-Identifier: Apache-2.0
"""Materials: kinds of maps by file names, MaterialX, USD and Blender documents, preview renders."""

from ..materials.documents import (
    BLENDER,
    Described,
    blender_catalog,
    has_materialx,
    materialx_faults,
    usd_faults,
    write_materialx,
    write_usd,
)
from ..materials.label_colors import label_colors
from ..materials.naming import COLORS, PACKED, PACKED_ROLES, ROLES, Name, read_name
from ..materials.preview import Looks, lab_of_srgb, save, values, vectors

__all__ = [
    "BLENDER",
    "COLORS",
    "PACKED",
    "PACKED_ROLES",
    "ROLES",
    "Described",
    "Looks",
    "Name",
    "blender_catalog",
    "has_materialx",
    "lab_of_srgb",
    "label_colors",
    "materialx_faults",
    "read_name",
    "save",
    "usd_faults",
    "values",
    "vectors",
    "write_materialx",
    "write_usd",
]
