# SPDX-License-Identifier: Apache-2.0
"""Images: parts, windows, color spaces; reading and writing them; a session to compute in."""

from ..color.config import as_float
from ..color.display import Shown, shown_by, usual_view, views
from ..core.attributes import PARAMETERS, TAG
from ..core.demand import PieceCache
from ..core.image import Image, Part, channels_of, from_array, resized, tagged
from ..core.window import Window
from ..io.paint_palette import write_indexed
from ..io.reading import read
from ..io.writing import write
from ..session import Session
