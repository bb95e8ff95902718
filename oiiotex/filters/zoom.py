# SPDX-License-Identifier: Apache-2.0
"""--texzoom: one frame of a zoom into a texture without end (HRRG08 figure 3)."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass
from fractions import Fraction
from typing import ClassVar

from ..errors import ParameterError
from ..images import Image, Part
from ..op import Output
from ..params import Numbers, Size, param
from ..session import Session
from ..synthesis.exemplars import LOOP_R, Graph
from ..synthesis.multiscale import MOST_LEVEL, Synthesizer
from ..synthesis.planes import Plane
from ..synthesis.zooming import Zoomed, views
from ..windows import Window
from .multiscale import Multiscale, texture_spec

log = logging.getLogger("oiiotex")

_FARTHEST = 1 << 60  # px; places of pixels


@dataclass(frozen=True, kw_only=True)
class Zoom(Multiscale):
    """Make one frame of a zoom into a texture without end.

    A frame follows from its number alone, whichever others are rendered, and only what it shows is synthesized (HRRG08:
    Han, Risser, Ramamoorthi, Grinspun, Multiscale Texture Synthesis, 2008, figure 3). `--frames` says the number; on
    whole octaves a frame is a window of --texsynth of that level, between them the two levels around it are resampled
    and blended. Without `graph` the top image is zoomed into for ever: one exemplar with an edge of r=1 to itself.
    """

    name: ClassVar[str] = "zoom"
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("frame", "all channels, in the root's colour space and type; its display window begins at 0"),
    )

    frame: int | None = param(None, frame=True, help="the frame's number; that of --frames, or first, when left out")
    first: int = param(1, help="the number of the frame where the zoom begins")
    speed: float = param(0.05, ge=-8, le=8, help="octaves a frame: 1 doubles the size of things, below 0 zooms out")
    level: float | None = param(
        None, ge=0, le=MOST_LEVEL, help="the zoom of the first frame, as of --texsynth; the root's own resolution"
    )
    at: Numbers | None = param(None, unit="px", help="X,Y: what is zoomed into, in pixels of the root; its middle")
    size: Size | None = param(None, ge=1, le=1 << 16, unit="px", help="of the frame; the root's own when left out")

    def single(self, name: str) -> Graph:
        """One exemplar with an edge to itself."""
        return Graph.loop(name, LOOP_R)

    def compute(self, session: Session) -> Image:
        """The frame."""
        if self.at is not None and len(self.at) != 2:
            raise ParameterError(f"at={self.at}: allowed are two numbers, X,Y")
        plane = self.opened(session)
        first = plane.root.first
        width, height = self.size or Size(first.spec.width, first.spec.height)
        zoom = self._zoom(plane)
        side = 1 << plane.finest
        at = tuple(Fraction(n) / side for n in self.at or (side / 2, side / 2))
        if max(map(abs, at)) * 2 ** math.ceil(zoom) > _FARTHEST:
            raise ParameterError(f"at={self.at}: at {zoom:.6g} octaves it is more than 2^60 px away from 0,0")
        maker = Synthesizer(
            session.device, plane.analysis, plane.settings(seed=self.seed, lock=self.lock), session.budget
        )
        session.device.collect(session.stats)
        shown = Zoomed(session, plane, maker, views(zoom, at, width, height), width, height)
        whole = Window(0, 0, width, height)
        spec = texture_spec(first.spec, whole, whole)
        spec.attribute("oiiotex:zoom", zoom)
        return Image((Part(first.name, spec, shown.pixels, first.spec.format),), self.source)

    def _zoom(self, plane: Plane) -> float:
        """How many octaves a pixel of the frame is below one as large as the root."""
        number = self.first if self.frame is None else self.frame
        begin = plane.finest if self.level is None else self.level
        zoom = begin + self.speed * (number - self.first)
        if not 0 <= zoom <= MOST_LEVEL:
            raise ParameterError(
                f"frame {number} would be at {zoom:.6g} octaves: allowed are 0 to {MOST_LEVEL};"
                f" it begins at {begin:.6g} with frame {self.first}, speed={self.speed:.6g}"
            )
        deepest = plane.finest + plane.graph.depth()
        if zoom > deepest and not any(map(plane.graph.in_loop, range(len(plane.graph.names)))):
            log.warning(
                "%s: frame %d is at %.6g octaves, the finest exemplar ends at %d: its pixels repeat (a graph with an"
                " edge from an exemplar to itself goes on)", self.name, number, zoom, deepest,
            )  # fmt: skip
        return zoom
