# SPDX-License-Identifier: Apache-2.0
"""What ops of multiscale synthesis share: their exemplars, and how these are matched."""

from __future__ import annotations

import logging
import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import OpenImageIO as oiio

from ..errors import ParameterError
from ..images import Image, derived_spec
from ..op import Op, Reach, Space
from ..params import Parameter, image, param
from ..session import Session
from ..synthesis.exemplars import Graph
from ..synthesis.multiscale import MOST_LEVEL
from ..synthesis.planes import Plane, graph_images, opened
from ..windows import Window

log = logging.getLogger("oiiotex")


@dataclass(frozen=True, kw_only=True)
class Multiscale(Op):
    """A texture without end, of one exemplar or of a graph of them."""

    reach: ClassVar[Reach] = Reach.WINDOW
    space: ClassVar[Space] = Space.LAB

    exemplar: Image | None = image(help="the one exemplar; none is taken where graph says them")
    graph: Path | None = param(None, help="an exemplar graph, JSON or YAML")
    lock: bool | int = param(
        False,
        ge=0,
        le=MOST_LEVEL,
        help="1: no jitter up to the root's own resolution, finer detail for it as it is; 2 and more: up to that level",
    )
    correct: bool = param(True, help="bring exemplars that do not agree in colour together (HRRG08 section 5)")
    dims: int = param(16, ge=1, le=16, help="of projected neighbourhoods; 6 are the paper's, 16 repeat less")
    side: int = param(
        256, choices=(16, 32, 64, 128, 256, 512, 1024), unit="px", help="of an exemplar's square, at most"
    )
    seed: int | None = param(None, ge=0, le=2**32 - 1, help="same seed, same pixels; the graph's, or 0, when left out")
    data: bool = param(False, help="the channels are no colours: compare them as they are")

    @classmethod
    def taken(cls, values: dict[str, Any]) -> tuple[Parameter, ...]:
        """No image where a graph says which."""
        return () if values.get("graph") else cls.images()

    def single(self, name: str) -> Graph:
        """The graph of the one exemplar."""
        raise NotImplementedError

    @property
    def source(self) -> str:
        """What it is made from, for messages and as the result's name."""
        return str(self.graph) if self.graph else self.exemplar.source if self.exemplar else ""

    def opened(self, session: Session) -> Plane:
        """The plane, its exemplars read and analysed."""
        if self.graph is not None:
            graph, images = graph_images(self.graph, session)
        elif self.exemplar is not None:
            graph, images = self.single(self.exemplar.source), (self.exemplar,)
        else:
            raise ParameterError(f"{self.name}: takes an image, or graph=FILE")
        if self.lock:  # the root comes out as it is only where its neighbourhoods go around, as its plane does
            graph = replace(graph, wraps=tuple("periodic" if n == graph.root else w for n, w in enumerate(graph.wraps)))
        for given in images:
            for part in given.parts[1:]:
                log.warning("%s: part '%s' of %s is not carried along", self.name, part.name, given.source)
        return opened(
            session, graph, images, self.source, side=self.side, dims=self.dims, correct=self.correct, data=self.data
        )

    def refuse_overwriting(self, **named: Any) -> None:
        """Refuse a file of ours that is what it is made from; it is called by its modifier."""
        for name, path in named.items():
            if isinstance(path, Path) and os.path.realpath(path) == os.path.realpath(self.source or os.devnull):
                raise ParameterError(f"{name}={path} would overwrite what it is made from")


def texture_spec(spec: oiio.ImageSpec, display: Window, place: Window, toroidal: bool = False) -> oiio.ImageSpec:
    """Of a window of a texture whose root has that spec."""
    new = derived_spec(spec, display.width, display.height)
    new.full_x, new.full_y = display.left, display.top
    new.x, new.y, new.width, new.height = place.left, place.top, place.width, place.height
    new.attribute("wrapmodes", "periodic,periodic" if toroidal else "black,black")
    return new
