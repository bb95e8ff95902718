# SPDX-License-Identifier: Apache-2.0
"""Materials: label maps, handedness of normals, atlases of Wang tiles, pictures of tiles."""

from oiiotex.engine.core.label_map import holds_ids, label_maps, opened_level
from oiiotex.engine.core.source_map import SourceMap
from oiiotex.surfaces.capture.convention import convention_of
from oiiotex.surfaces.charts.drawing import shown_pixels
from oiiotex.surfaces.charts.lighting import (
    FLAT,
    GROUND,
    LIGHTS,
    ROUGHNESS,
    SKY,
    LitMaterial,
    as_vectors,
    bilinear,
    unit_normals,
)
from oiiotex.surfaces.charts.tile_preview import HORIZON, area_means, plane_in_perspective, repeated
from oiiotex.synthesis.quality.fidelity import LEAST, Fidelity, JudgedPhoto
from oiiotex.synthesis.wang.atlas import atlas_side, first_tile
from oiiotex.synthesis.wang.plane import CELLS, index_image
from oiiotex.synthesis.wang.transition import LAYOUT as TRANSITION_LAYOUT
from oiiotex.synthesis.wang.transition import controls, count_of
from oiiotex.synthesis.wang.viewer import HEX_SHADERS, SHADERS, shader, viewer_page
