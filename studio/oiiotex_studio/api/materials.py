# SPDX-License-Identifier: Apache-2.0
"""Materials: kinds of maps by file names, MaterialX, USD and Blender documents, preview renders."""

from oiiotex.surfaces.capture.convention import convention_of
from oiiotex.synthesis.wang.atlas import atlas_side, first_tile
from oiiotex.synthesis.wang.plane import index_image
from oiiotex.synthesis.wang.viewer import SHADERS, shader, viewer_page

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
from ..materials.preview import LIT, Looks, lab_of_srgb, photo_linear, save, srgb_of, values, vectors
from ..materials.shaded import shaded_sphere
from ..materials.wang_documents import WangMaterial, write_wang_materialx
