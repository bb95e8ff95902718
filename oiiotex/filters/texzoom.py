# SPDX-License-Identifier: Apache-2.0
"""--texzoom: one frame of a zoom into an unbounded texture (HRRG08 figure 3)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, ClassVar

from ..engine.core.image import Part
from ..engine.core.op import Kind, Output, Plan
from ..engine.core.parameters import Numbers, Size, param
from ..engine.core.window import Window
from ..engine.errors import ParameterError
from ..engine.session import Session
from ..engine.session.facts import Facts
from ..synthesis.multiscale.graph import LOOP_R, Graph
from ..synthesis.multiscale.infinite_plane import Plane
from ..synthesis.multiscale.multiscale_op import FARTHEST, Multiscale, texture_spec, with_report
from ..synthesis.multiscale.stacks import common_side
from ..synthesis.multiscale.synthesizer import MOST_LEVEL
from ..synthesis.multiscale.zoom import Zoomed, views
from ..synthesis.quality.report import REPORT, Quality


@dataclass(frozen=True, kw_only=True)
class Zoom(Multiscale):
    """Render one frame of a zoom into an unbounded texture.

    A frame depends only on its number, which `--frames` sets, and only its visible part is synthesized (HRRG08: Han,
    Risser, Ramamoorthi, Grinspun, Multiscale Texture Synthesis, 2008, figure 3). At integer octaves, a frame is a
    window of `synth` at that level; in between, the two nearest levels are resampled and blended.

    Without `graph`, the zoom begins with the photo's pixels, cropped to a square, and is endless: past its finest
    resolution, the photo continues in itself.
    """

    example: ClassVar[str] = '>>> frames = [filters.zoom("photo.png", frame=n, size=(640, 360)) for n in (1, 2)]'
    name: ClassVar[str] = "zoom"
    blends: ClassVar[bool] = True
    outputs: ClassVar[tuple[Output, ...]] = (
        Output(
            "frame",
            Kind.PIXELS,
            "All channels, in the root's color space and type, with the display window at 0,0.",
        ),
        REPORT,
    )

    frame: int | None = param(
        None, example="25", frame=True, unset="that of --frames, otherwise first", help="Number of the frame."
    )
    first: int = param(1, help="Number of the frame at which the zoom begins.")
    speed: float = param(
        0.05,
        ge=-8,
        le=8,
        help="Octaves per frame. 1 doubles the scale each frame; negative values zoom out.",
    )
    lod: float | None = param(
        None,
        example="2",
        ge=0,
        le=MOST_LEVEL,
        unset="resolution of the root",
        help="Level of detail of the first frame, as in `synth`.",
    )
    center: Numbers | None = param(
        None,
        unit="px",
        unset="center of the root",
        example="64,48",
        help="Point X,Y to zoom into, in pixels of the root.",
    )
    size: Size | None = param(None, ge=1, le=1 << 16, unit="px", unset="the root's square", help="Size of the frame.")

    def single(self, name: str) -> Graph:
        """A graph of one exemplar with an edge to itself."""
        return Graph.loop(name, LOOP_R)

    @property
    def rooted(self) -> bool:
        """Whether the zoom begins with the photo. Departure: in HRRG08, levels up to the root's are random as well."""
        return self.graph is None and not self.paper

    def plan(self, facts: Facts) -> Plan:
        """The measures, and the exemplars."""
        if self.center is not None and len(self.center) != 2:
            raise ParameterError(parameter="center", value=self.center, expected="two numbers, X,Y")
        quality = Quality(op=self, facts=facts, copies=False)
        graph, images = self.exemplars(facts)
        side = common_side(images, graph, facts, self.most_side)
        size = self.size or Size(side, side)
        return Plan(work=(quality, graph, images, size))

    def make(self, plan: Plan, session: Session) -> dict[str, Any]:
        """The frame."""
        resources, progress = session.resources, session.progress
        quality, graph, images, (width, height) = plan.work
        quality = quality.during(resources, progress)
        plane = self.opened(graph, images, resources, progress)
        first = plane.root.first
        number = self.first if self.frame is None else self.frame
        zoom = self._zoom(plane, number)
        side = 1 << plane.finest
        x, y = (Fraction(n) / side for n in self.center or (side / 2, side / 2))
        if max(abs(x), abs(y)) * 2 ** math.ceil(zoom) > FARTHEST:
            problem = f"more than 2^60 px away from 0,0 at {zoom:.6g} octaves"
            raise ParameterError(problem, parameter="center", value=self.center)
        maker = self.maker(plane, plane.settings(seed=self.seed, lock=self.keeplayout, jitter=self.jitter), resources)
        whole = Window(0, 0, width, height)
        shown = Zoomed(resources, plane, maker, views(zoom, (x, y), width, height), width, height)
        spec = texture_spec(first.spec, whole, whole)
        spec.attribute("oiiotex:zoom", zoom)
        return with_report(quality, plane, {"frame": Part(first.name, spec, shown.pixels, first.stored)})

    def _zoom(self, plane: Plane, number: int) -> float:
        """The zoom of a frame: octaves below level 0, where one pixel covers the root."""
        begin = plane.finest if self.lod is None else self.lod
        zoom = begin + self.speed * (number - self.first)
        if not 0 <= zoom <= MOST_LEVEL:
            raise ParameterError(
                f"frame {number} is at {zoom:.6g} octaves: expected 0 to {MOST_LEVEL}; the zoom begins at {begin:.6g}"
                f" with frame {self.first} and speed={self.speed:.6g}"
            )
        deepest = plane.finest + plane.graph.depth()
        if zoom > deepest and not any(map(plane.graph.in_loop, range(len(plane.graph.names)))):
            self.warn(
                "frame %d is at %.6g octaves, but the finest exemplar ends at %d: its pixels repeat; for an endless"
                " zoom, add an edge from an exemplar to itself",
                number,
                zoom,
                deepest,
            )
        return zoom
