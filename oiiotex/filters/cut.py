# SPDX-License-Identifier: Apache-2.0
"""--texcut: graph-cut textures, KSE03 and LSA16 section 5.2."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from ..color import working_values
from ..errors import ImageError
from ..images import Image
from ..op import Op, Output, Reach, Space
from ..params import Size, image, param
from ..session import Session
from .sources import LABEL, LABELS, LEVEL, MASK, both, ruled_out, source_pixels
from .stationarize import refuse_overwriting, tile_image

log = logging.getLogger("oiiotex")


@dataclass(frozen=True, kw_only=True)
class Cut(Op):
    """Lay a texture from large pieces of a photo, cut where it is seen least.

    Graph-cut textures (KSE03: Kwatra, Schoedl, Essa, Turk, Bobick, Graphcut Textures, SIGGRAPH 2003): patches that fit
    are laid one after another, and each is cut against all that is there along the cheapest line of any shape; where
    an old seam is expensive, a new patch covers it. Of a photo with labels it takes one alone (LSA16: Lockerman,
    Sauvage, Allegre, Dischler, Dorsey, Rushmeier, Multi-Scale Label-Map Extraction for Texture Synthesis, SIGGRAPH
    2016, section 5.2): label=3, or a mask. Every pixel of the result is a copy of one pixel of the photo.
    """

    name: ClassVar[str] = "cut"
    copies: ClassVar[bool] = True
    reach: ClassVar[Reach] = Reach.GLOBAL
    space: ClassVar[Space] = Space.LAB
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("cut", "pixels copied from the photo, all channels together, in its own colour space and type"),
        Output(
            "st", "where every pixel comes from: 32-bit float source coordinates, as --texwarp and --st_warp read them"
        ),
    )

    exemplar: Image = image(help="the photo")
    mask: Image | None = image(None, help=MASK)
    labels: Image | None = image(None, help=LABELS)
    label: int | None = param(None, ge=1, help=LABEL)
    level: int | None = param(None, ge=1, help=LEVEL)
    size: Size | None = param(None, ge=5, le=16384, unit="px", help="of the result; the exemplar's own when left out")
    tile: str = param("xy", choices=("xy", "x", "y", "none"), help="along which axes the result tiles")
    patch: int | None = param(
        None,
        ge=5,
        le=512,
        unit="px",
        help="side of a patch; shorter side of the exemplar / 5, 16 to 96, when left out",
    )
    passes: int = param(1, ge=0, le=100, help="of refinement: patches over the worst seams, as many as were laid")
    seed: int = param(0, ge=0, le=2**32 - 1, help="same seed, same pixels")
    stmap: bool | Path = param(False, help="1: source coordinates as part 'st' of the result; a file name: there")
    data: bool = param(False, help="the channels are no colours: compare them as they are")

    def compute(self, session: Session) -> Image:
        """The texture, followed by the part 'st' where it is asked for."""
        from ..synthesis.graphcut import Layout, bytes_needed, graph_cut  # scipy is not loaded before it is needed

        refuse_overwriting(self.exemplar, stmap=self.stmap)
        spec = self.exemplar.first.spec
        width, height = self.size or Size(spec.width, spec.height)
        layout = Layout(
            width=width,
            height=height,
            wrap_x="x" in self.tile,
            wrap_y="y" in self.tile,
            patch=self.patch or min(96, max(16, min(spec.width, spec.height) // 5)),
            passes=self.passes,
            seed=self.seed,
        )
        session.require(
            bytes_needed(layout, (spec.height, spec.width))
            + spec.width * spec.height * self.exemplar.first.pixel_bytes,
            f"cutting {width}x{height} from {spec.width}x{spec.height}",
            "make the result or the photo smaller",
        )
        with session.stats.time("read and colour"):
            working = working_values(self.exemplar, None if self.data else session.color, session.autocc)
            pixels = self.exemplar.first.pixels()
            mask = source_pixels(self.exemplar, self.mask, self.labels, self.level, self.label)
            allowed = both(working.opaque, mask)
        if allowed is not None and not allowed.any():
            raise ImageError(f"no pixel of {self.exemplar.source} is free of {ruled_out(working.opaque, mask)}")
        with session.stats.time("cut"):
            places = graph_cut(working.values, allowed, layout, session.advance)
        return tile_image(self, self.exemplar, pixels, places, session)
