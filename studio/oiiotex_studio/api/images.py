# SPDX-License-Identifier: Apache-2.0
"""Images: parts, windows, color spaces; reading and writing them; a session to compute in."""

from oiiotex.engine.color.config import ColorConfig, as_float
from oiiotex.engine.color.srgb import decoded, encoded, lab_of_linear
from oiiotex.engine.core.attributes import PARAMETERS, TAG
from oiiotex.engine.core.demand import resized
from oiiotex.engine.core.image import Image, Part, channels_of, from_array, tagged
from oiiotex.engine.core.piece_cache import PieceCache
from oiiotex.engine.core.upright import upright
from oiiotex.engine.core.window import Window
from oiiotex.engine.io.paint_palette import write_indexed
from oiiotex.engine.io.reading import read
from oiiotex.engine.io.writing import write
from oiiotex.engine.session import Session
from oiiotex.engine.session.progress import Progress
from oiiotex.engine.session.resources import Resources
