# SPDX-License-Identifier: Apache-2.0
"""--texgraph: initial exemplar graphs from photos, and pictures of graphs (HRRG08 section 3.1)."""

from __future__ import annotations

import functools
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from ..engine.color.config import as_float
from ..engine.color.lens import in_type
from ..engine.core.access import Whole
from ..engine.core.demand import bands, resized
from ..engine.core.image import Image, Part, cropped, derived_spec, dtype_of
from ..engine.core.op import Kind, Output, Plan, Space
from ..engine.core.parameters import Numbers, Parameter, image, param
from ..engine.core.window import Window
from ..engine.deferred import np
from ..engine.errors import ImageError, ParameterError, present
from ..engine.io.reading import read
from ..engine.session import Session
from ..engine.session.facts import Facts
from ..surfaces.charts.drawing import sampled, shown_pixels
from ..surfaces.charts.graph_chart import Node, drawn_graph
from ..synthesis.multiscale.graph import LOOP_R, Graph, parse_graph
from ..synthesis.multiscale.infinite_plane import graph_images

_OCTAVES = 3  # between photos, by default
_LEAST = 16  # px; an exemplar's side
PANEL = 128  # px; side of an exemplar in the picture
_KEPT = (".exr", ".tif", ".tiff", ".png")  # lossless formats


@dataclass(frozen=True, kw_only=True)
class ExemplarGraph(Whole):
    """Create an exemplar graph from one or more photos, or draw an existing graph.

    An exemplar graph says which photo supplies finer detail for which (an edge), and how many octaves finer it is
    (r). Several photos, coarsest first, become a chain: each has pixels `ratio` times smaller than the one before.
    A single photo gets an edge to itself, for an unbounded zoom; with `scales`, a chain of exemplars is cut out of
    it, from the whole photo at reduced resolution to a crop at full resolution.

    graphfile=FILE writes the graph for `synth` and `zoom`. You can edit it; file names are relative to the graph. The
    picture arranges exemplars by octave and labels edges with r (HRRG08: Han, Risser, Ramamoorthi, Grinspun,
    Multiscale Texture Synthesis, 2008, section 3.1, figures 8 and 9).
    """

    example: ClassVar[str] = """\
>>> drawing = filters.graph("photo.png", graphfile="graph.json")
>>> texture = filters.synth(None, graph="graph.json", size=(256, 256))
"""
    name: ClassVar[str] = "graph"
    space: ClassVar[Space] = Space.ANY
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("picture", Kind.PICTURE, "Diagram of exemplars and edges."),
        Output("graphfile", Kind.TABLE, "Graph for `synth` and `zoom`.", asked_by="graphfile"),
        Output(
            "exemplar.N", Kind.PIXELS, "Crop of the photo reduced N times, next to the graph; with scales.",
            asked_by="graphfile",
        ),
    )  # fmt: skip

    photos: tuple[Image, ...] = image(help="Photos, coarsest first. None are taken if draw is given.")
    draw: Path | None = param(
        None, example="graph.json", help="Existing graph to draw (JSON or YAML), instead of creating one."
    )
    graphfile: Path | None = param(None, example="graph.json", help="File for the graph.")
    ratio: Numbers | None = param(
        None, ge=1, unset="8, less for small photos; with scales, 2", example="4,8",
        help="Ratio between the pixel sizes of each photo and the next, or one ratio for all.",
    )  # fmt: skip
    loop: int | None = param(
        None, example="2", ge=0, le=7, unset="1 for one photo, else 0",
        help="Octaves after which the last exemplar continues in itself, which makes a zoom endless. 0: the zoom"
             " ends.",
    )  # fmt: skip
    scales: int = param(
        1,
        ge=1,
        le=16,
        help="Number of exemplars at different scales to cut out of one photo. They are written next to graphfile.",
    )
    exemplarside: int = param(
        256, choices=(16, 32, 64, 128, 256, 512, 1024), unit="px", help="Maximum side of an exemplar."
    )

    @classmethod
    def taken(cls, values: dict[str, Any]) -> tuple[Parameter, ...]:
        """No images if a graph names them."""
        return () if values.get("draw") else cls.images()

    @classmethod
    def arity(cls, values: dict[str, Any], depth: int) -> int:
        """All images on the stack, or none."""
        return max(1, depth) if cls.taken(values) else 0

    def files(self) -> dict[str, Path]:
        """The graph, and next to it the exemplars that are cut out of one photo."""
        if self.graphfile is None or self.draw is not None:
            return {}
        cut = self._factors() if self.scales > 1 else ()
        return {"graphfile": self.graphfile} | {f"exemplar.{factor}": self._file(factor) for factor in cut}

    def plan(self, facts: Facts) -> Plan:
        """The graph, its images, and those that are cut out of a photo."""
        if self.draw is not None:
            graph, images = graph_images(self.draw, facts)
            _common_side(images, graph.factors, self.exemplarside)
            return Plan(work=(graph, images, {}))
        photos = self.photos or ()
        if not photos:
            raise ParameterError("requires at least one image, or draw=FILE")
        _require_alike(photos)
        cut = self._cut() if self.scales > 1 else {}
        photos = tuple(cut.values()) or photos
        document = self._document(photos)
        graph = parse_graph(document, self.graphfile or Path("graph"))
        graph.require_levels(
            _common_side(photos, graph.factors, self.exemplarside).bit_length() - 1, str(self.graphfile or "graph")
        )
        if self.graphfile is not None and not cut:
            for photo in photos:
                _stored(photo, facts)
        exemplars = {f"exemplar.{factor}": exemplar.first for factor, exemplar in cut.items()}
        return Plan(work=(graph, photos, {"graphfile": document, **exemplars}))

    def make(self, plan: Plan, session: Session) -> dict[str, Any]:
        """The picture, the graph, and the exemplars that are cut out of a photo."""
        graph, images, others = plan.work
        if self.draw is None and self.graphfile is not None and self.scales == 1:
            for photo in images:
                _require_written(photo, session.resources)
        return {"picture": self._picture(graph, images, session), **others}

    # --- the graph as JSON ---

    def _document(self, photos: Sequence[Image]) -> dict[str, Any]:
        """The graph as written: a chain, with an optional loop at its end."""
        highest = max(1, _common_side(photos, [1.0] * len(photos), self.exemplarside).bit_length() - 4)  # r_max = L - 3
        usual = 1 if self.scales > 1 else min(_OCTAVES, highest)
        asked = tuple(self.ratio or ())
        if not asked and len(photos) > 1 and self.scales == 1:
            self.warn("no ratio given: assuming that each photo is %d times finer than the one before", 2**usual)
        if len(asked) not in (0, 1, len(photos) - 1):
            expected = f"one number, or one for each edge ({len(photos) - 1})"
            raise ParameterError(parameter="ratio", value=self.ratio, expected=expected)
        ratios = asked if len(asked) > 1 else (asked or (2.0**usual,)) * (len(photos) - 1)
        names = _names(photos)
        edges = [{"from": a, "to": b, **_relation(q)} for a, b, q in zip(names, names[1:], ratios, strict=False)]
        loop = self.loop if self.loop is not None else LOOP_R if len(photos) == 1 else 0
        if loop:
            edges.append({"from": names[-1], "to": names[-1], "r": loop})
        folder = self.graphfile.parent if self.graphfile is not None else Path()
        files = [os.path.relpath(photo.source, folder) for photo in photos]
        nodes = [{"id": name, "file": file} for name, file in zip(names, files, strict=True)]
        return {"exemplars": nodes, "root": names[0], "edges": edges, "seed": 0}

    # --- one photo at several scales ---

    def _factors(self) -> list[int]:
        """Reduction factor of each exemplar."""
        if len(self.photos or ()) != 1:
            expected = f"one photo, not {len(self.photos or ())}"
            raise ParameterError(parameter="scales", value=self.scales, expected=expected)
        step = (self.ratio or Numbers([2.0]))[0]
        if len(self.ratio or (2,)) != 1 or math.frexp(step)[0] != 0.5 or step < 2:
            raise ParameterError(parameter="ratio", value=self.ratio, expected="one power of two >= 2, with scales")
        return [int(step) ** n for n in range(self.scales - 1, -1, -1)]

    def _file(self, factor: int) -> Path:
        """File of an exemplar next to the graph, in the photo's format if that is lossless."""
        photo = self.photos[0]
        suffix = Path(photo.source).suffix.lower()
        if suffix not in _KEPT:
            suffix = ".png" if np.dtype(dtype_of(photo.first.spec)).kind in "ui" else ".exr"
        return present(self.graphfile).with_name(f"{present(self.graphfile).stem}_{factor}{suffix}")

    def _cut(self) -> dict[int, Image]:
        """Exemplars around the photo's center, from the whole photo, reduced, to a crop at full resolution."""
        factors, photo = self._factors(), self.photos[0]
        shorter = min(photo.first.spec.width, photo.first.spec.height)
        side = min(self.exemplarside, 1 << max(0, (shorter // factors[0]).bit_length() - 1))
        if side < _LEAST:
            raise ParameterError(
                f"reduces {photo.source} to {shorter // factors[0]} px", parameter="scales", value=self.scales,
                expected=f"at least {_LEAST} px for an exemplar",
            )  # fmt: skip
        names = {factor: "" if self.graphfile is None else str(self._file(factor)) for factor in factors}
        return {factor: _reduced(photo, factor, side, name) for factor, name in names.items()}

    # --- the picture ---

    def _picture(self, graph: Graph, images: Sequence[Image], session: Session) -> np.ndarray:
        side = _common_side(images, graph.factors, self.exemplarside)
        nodes = [
            Node(label, octave, _thumbnail(image, round(side / factor), session))
            for label, octave, image, factor in zip(graph.names, graph.octaves(), images, graph.factors, strict=True)
        ]
        return drawn_graph(nodes, graph.edges, graph.root)


def _require_alike(photos: Sequence[Image]) -> None:
    """Raise ImageError unless all photos of a graph have the same channels."""
    for photo in photos:
        mine, wanted = (",".join(p.first.spec.channelnames) for p in (photo, photos[0]))
        if mine != wanted:
            raise ImageError(f"has channels {mine}: expected {wanted}, as {photos[0].source}", subject=photo.source)


def _common_side(images: Sequence[Image], factors: Sequence[float], most: int) -> int:
    """Common side of all exemplars, a power of two."""
    shorter = [
        (round(min(i.first.spec.width, i.first.spec.height) * f), i.source)
        for i, f in zip(images, factors, strict=True)
    ]
    least, source = min(shorter)
    if least < _LEAST:
        raise ImageError(f"is {least} px wide or high: expected at least {_LEAST} px", subject=source)
    return 1 << (min(least, most).bit_length() - 1)


def _names(photos: Sequence[Image]) -> list[str]:
    """A unique name for each photo, from its file."""
    names: list[str] = []
    for photo in photos:
        stem = Path(photo.source).stem or "photo"
        names.append(next(n for n in (stem, *(f"{stem}-{k}" for k in range(2, len(photos) + 2))) if n not in names))
    return names


def _relation(ratio: float) -> dict[str, Any]:
    """Field `r` if the ratio is a power of two, else `scale`."""
    octaves = math.log2(ratio)
    return {"r": int(octaves)} if octaves.is_integer() else {"scale": ratio}


def _stored(photo: Image, facts: Facts) -> Part:
    """The file of an image, which the graph will read; raises ImageError if it cannot be the same image."""
    if not os.path.isfile(photo.source):
        raise ImageError("is not a file that the graph can name; write it to a file first", subject=photo.source)
    mine, stored = photo.first, read(photo.source, facts.cache).first
    alike = (mine.window.width, mine.window.height, mine.spec.nchannels, str(mine.spec.format)) == (
        stored.window.width, stored.window.height, stored.spec.nchannels, str(stored.spec.format))  # fmt: skip
    if not alike:
        raise _differs(photo)
    return stored


def _differs(photo: Image) -> ImageError:
    problem = "differs from its file, which the graph names; write it to a file first"
    return ImageError(problem, subject=photo.source)


def _require_written(photo: Image, facts: Facts) -> None:
    """Raise ImageError if an image differs from its file."""
    mine, stored = photo.first, _stored(photo, facts)
    x, y = stored.window.left - mine.window.left, stored.window.top - mine.window.top
    if not all(np.array_equal(mine.read(b), stored.read(b.shifted(x, y)), equal_nan=True)
                            for b in bands(mine)):  # fmt: skip
        raise _differs(photo)


def _reduced(photo: Image, factor: int, side: int, name: str) -> Image:
    """A square around the photo's center, box-filtered to 1 / `factor` of its resolution."""
    part, whole = photo.first, photo.first.window
    left, top = (whole.left + (whole.width - side * factor) // 2, whole.top + (whole.height - side * factor) // 2)
    dtype = np.dtype(dtype_of(part.spec))

    @functools.cache
    def reduced() -> np.ndarray:
        pixels = np.empty((side, side, part.spec.nchannels), dtype)
        for row in range(side):
            band = part.read(Window.sized(left, top + row * factor, side * factor, factor))
            cells = as_float(band).reshape(factor, side, factor, -1)
            pixels[row] = in_type(cells.mean((0, 2), dtype=np.float64).astype(np.float32)[None], dtype)[0]
        return pixels

    spec, square = derived_spec(part.spec, side, side), Window(0, 0, side, side)
    stem = f"{Path(photo.source).stem}_{factor}"
    exemplar = Part(part.name, spec, lambda w: reduced()[w.inside(square)], part.spec.format, ready=True)
    return Image((exemplar,), name or stem)


def _thumbnail(image: Image, side: int, session: Session) -> np.ndarray:
    """Thumbnail of the central square that synthesis uses: (PANEL, PANEL, 3) float sRGB."""
    part, whole = image.first, image.first.window
    left, top = whole.left + (whole.width - side) // 2, whole.top + (whole.height - side) // 2
    square: Part = cropped(part, Window.sized(left, top, side, side))
    pixels = shown_pixels(sampled(square, max(1, side // (4 * PANEL))), part, session.resources)
    return np.clip(resized(pixels.astype(np.float32), PANEL, PANEL), 0, 1)
