# SPDX-License-Identifier: Apache-2.0
"""--texzoom: one frame of a zoom into a texture without end (HRRG08 figure 3)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, ClassVar

from ..charts.drawing import shown_pixels
from ..core.image import Part
from ..core.op import Kind, Output
from ..core.parameters import Numbers, Size, param
from ..core.window import Window
from ..deferred import np
from ..errors import ParameterError
from ..multiscale.graph import LOOP_R, Graph
from ..multiscale.infinite_plane import Plane
from ..multiscale.multiscale_op import FARTHEST, Multiscale, texture_spec, with_report
from ..multiscale.synthesizer import MOST_LEVEL
from ..multiscale.zoom import Zoomed, views
from ..quality.report import REPORT, Quality
from ..session import Session


@dataclass(frozen=True, kw_only=True)
class Zoom(Multiscale):
    """Make one frame of a zoom into a texture without end.

    A frame follows from its number alone, whichever others are rendered, and only what it shows is synthesized (HRRG08:
    Han, Risser, Ramamoorthi, Grinspun, Multiscale Texture Synthesis, 2008, figure 3). `--frames` says the number; on
    whole octaves a frame is a window of `synth` of that level, between them the two levels around it are resampled
    and blended. Without `graph` the top image is zoomed into for ever: one exemplar with an edge of r=1 to itself.
    """

    example: ClassVar[str] = '>>> frames = [filters.zoom("photo.png", frame=n, size=(640, 360)) for n in (1, 2)]'
    name: ClassVar[str] = "zoom"
    outputs: ClassVar[tuple[Output, ...]] = (
        Output(
            "frame", Kind.PIXELS, "all channels, in the root's color space and type; its display window begins at 0"
        ),
        Output("movie", Kind.MOVIE, "the zoom from this frame on, in sRGB", asked_by="movie"),
        REPORT,
    )

    frame: int | None = param(None, frame=True, help="the frame's number; that of --frames, or first, when left out")
    first: int = param(1, help="the number of the frame where the zoom begins")
    speed: float = param(0.05, ge=-8, le=8, help="octaves a frame: 1 doubles the size of things, below 0 zooms out")
    level: float | None = param(
        None, ge=0, le=MOST_LEVEL, help="the zoom of the first frame, as of `synth`; the root's own resolution"
    )
    at: Numbers | None = param(None, unit="px", help="X,Y: what is zoomed into, in pixels of the root; its middle")
    size: Size | None = param(None, ge=1, le=1 << 16, unit="px", help="of the frame; the root's own when left out")
    movie: Path | None = param(
        None, help="a movie to look at goes to this file: .gif by Pillow, .mp4 by ffmpeg where it is in $PATH"
    )
    count: int = param(48, ge=2, le=1 << 16, help="frames of the movie, from this one on")
    rate: float = param(24.0, ge=0.1, le=240, help="frames of the movie in a second")

    def single(self, name: str) -> Graph:
        """One exemplar with an edge to itself."""
        return Graph.loop(name, LOOP_R)

    def compute(self, session: Session) -> dict[str, Any]:
        """The frame."""
        resources, progress = session.resources, session.progress
        if self.at is not None and len(self.at) != 2:
            raise ParameterError(f"at={self.at}: expected two numbers, X,Y")
        # what is wrong with its limits is said now
        quality = Quality(op=self, resources=resources, progress=progress, copies=False)
        plane = self.opened(resources, progress)
        first = plane.root.first
        width, height = self.size or Size(first.spec.width, first.spec.height)
        number = self.first if self.frame is None else self.frame
        zoom = self._zoom(plane, number)
        side = 1 << plane.finest
        x, y = (Fraction(n) / side for n in self.at or (side / 2, side / 2))
        last = self._zoom(plane, number + self.count - 1) if self.movie else zoom
        farthest = max(zoom, last)
        if max(abs(x), abs(y)) * 2 ** math.ceil(farthest) > FARTHEST:
            raise ParameterError(f"at={self.at}: at {farthest:.6g} octaves it is more than 2^60 px away from 0,0")
        if self.movie and self.movie.suffix.lower() == ".gif":
            resources.require(2 * self.count * width * height, f"a GIF of {self.count} frames", "take fewer: count=")
        maker = self.maker(plane, plane.settings(seed=self.seed, lock=self.lock), resources)
        whole = Window(0, 0, width, height)

        def frame_at(zoom: float) -> Part:
            shown = Zoomed(resources, plane, maker, views(zoom, (x, y), width, height), width, height)
            spec = texture_spec(first.spec, whole, whole)
            spec.attribute("oiiotex:zoom", zoom)
            return Part(first.name, spec, shown.pixels, first.stored)

        def frames() -> Iterator[np.ndarray]:
            for n in range(self.count):
                part = frame_at(self._zoom(plane, number + n))
                yield np.rint(255 * shown_pixels(part.pixels(), part, resources)).astype(np.uint8)
                progress.advance(n + 1, self.count)

        results = {"frame": frame_at(zoom), "movie": lambda: (frames(), self.rate)}
        return with_report(quality, plane, results)

    def _zoom(self, plane: Plane, number: int) -> float:
        """How many octaves a pixel of the frame of that number is below one as large as the root."""
        begin = plane.finest if self.level is None else self.level
        zoom = begin + self.speed * (number - self.first)
        if not 0 <= zoom <= MOST_LEVEL:
            raise ParameterError(
                f"frame {number} would be at {zoom:.6g} octaves: expected 0 to {MOST_LEVEL};"
                f" it begins at {begin:.6g} with frame {self.first}, speed={self.speed:.6g}"
            )
        deepest = plane.finest + plane.graph.depth()
        asked = self.first if self.frame is None else self.frame
        if number == asked and zoom > deepest and not any(map(plane.graph.in_loop, range(len(plane.graph.names)))):
            self.warn(
                "frame %d is at %.6g octaves, the finest exemplar ends at %d: its pixels repeat (a graph with an"
                " edge from an exemplar to itself goes on)",
                number,
                zoom,
                deepest,
            )
        return zoom
