# SPDX-License-Identifier: Apache-2.0
"""The base of multiscale synthesis ops: their exemplars, and the parameters of matching."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

from ...engine.color.lab import InLab, color_to_convert
from ...engine.core.access import AnyWindow
from ...engine.core.demand import MadeRows, rows_of
from ...engine.core.image import Image
from ...engine.core.parameters import Numbers, Parameter, image, param
from ...engine.core.source_map import SourceMap, tile_spec
from ...engine.core.window import Window
from ...engine.deferred import np, oiio
from ...engine.errors import ParameterError
from ...engine.session.facts import Facts
from ...engine.session.progress import Progress
from ...engine.session.resources import Resources
from ..quality.report import Look, Quality
from ..quality.reported_op import Reported
from .graph import Graph
from .infinite_plane import Plane, analysis_folder, graph_images, opened
from .stacks import common_side, require_channels
from .synthesizer import MOST_LEVEL, PlaneSettings, Synthesizer

FARTHEST = 1 << 60  # px; maximum coordinate on the plane


@dataclass(frozen=True, kw_only=True)
class Multiscale(InLab, Reported, AnyWindow):
    """An unbounded texture from one exemplar or a graph of them."""

    exemplar: Image | None = image(help="Exemplar. Omit it with graph.")
    graph: Path | None = param(
        None,
        help="Exemplar graph (JSON or YAML), as the graph filter writes it: photos at"
        " several scales, and which one refines which.",
        example="graph.json",
    )
    keeplayout: bool | int = param(
        False,
        ge=0,
        le=MOST_LEVEL,
        help="Layout of the root exemplar that is kept, so that only finer detail is random. 0: nothing is kept. 1:"
        " up to the root's resolution. 2 to 60: up to that level.",
        advanced=True,
    )
    jitter: Numbers | None = param(
        None,
        ge=0,
        le=1,
        example="0,1,1,0.6",
        unset="that of the graph, else 1 on coarse levels, 0.6 on further ones, and 0 on the root's two finest; 0.6 on"
        " all levels of an endless zoom and with paper; none for a texture from one photo, which starts from patches",
        help="Randomness of each level, from level 0 on (HRRG08 section 4.3). The last number applies to all further"
        " levels. Reduce it where structures break, increase it where the exemplar repeats.",
        advanced=True,
    )
    matchcolor: bool = param(
        True,
        help="Correction of color differences between the exemplars of a graph (HRRG08 section 5). Set it to"
        " 0 for verbatim colors.",
        advanced=True,
    )
    exemplarside: int | None = param(
        None,
        example="256",
        choices=(16, 32, 64, 128, 256, 512, 1024, None),
        unit="px",
        unset="512 for a texture from one exemplar, otherwise 256",
        help="Maximum side of the square that is cropped from an exemplar.",
    )
    paper: bool = param(
        False,
        help="Settings of the paper (HRRG08): 6 principal components instead of 16, jitter on all levels, and without"
        " the corrections that preserve contrast in endless zooms.",
        advanced=True,
    )
    seed: int | None = param(
        None,
        example="7",
        ge=0,
        le=2**32 - 1,
        unset="seed of the graph, else 0",
        help="Seed of the random numbers. The same seed gives the same pixels.",
    )

    PAPER: ClassVar[dict[str, Any]] = {"matchcolor": True}

    @classmethod
    def taken(cls, values: dict[str, Any]) -> tuple[Parameter, ...]:
        """No image if a graph names the exemplars."""
        return () if values.get("graph") else cls.images()

    def single(self, name: str) -> Graph:
        """The graph of a single exemplar."""
        raise NotImplementedError

    @property
    def most_side(self) -> int:
        """Maximum side of an exemplar, px."""
        return self.exemplarside or 256

    @property
    def rooted(self) -> bool:
        """Whether the plane's first cell is the root itself."""
        return False

    @property
    def quilted(self) -> bool:
        """Whether the plane of a single exemplar starts from patches of it."""
        return False

    @property
    def source(self) -> str:
        """Name of the input, for messages and the result."""
        return str(self.graph) if self.graph else self.exemplar.source if self.exemplar else ""

    def exemplars(self, facts: Facts) -> tuple[Graph, tuple[Image, ...]]:
        """The graph, and the images of its exemplars; raises for all errors that do not depend on pixels."""
        if self.graph is not None:
            graph, images = graph_images(self.graph, facts)
        elif self.exemplar is not None:
            graph, images = self.single(self.exemplar.source), (self.exemplar,)
        else:
            raise ParameterError("no exemplar", expected="an image, or graph=FILE")
        side, root = common_side(images, graph, facts, self.most_side, self.quilted), images[graph.root]
        color_to_convert(root, facts, self.working_space)
        for other in images:
            require_channels(other, root)
        graph.require_levels(side.bit_length() - 1, self.source)
        return graph, images

    def opened(
        self, graph: Graph, images: tuple[Image, ...], resources: Resources, progress: Progress,
        excluded: np.ndarray | None = None,
    ) -> Plane:  # fmt: skip
        """The plane, with its exemplars read and analyzed.

        `excluded` (height, width) bool: pixels of the single exemplar that are not copied.
        """
        if self.keeplayout:  # the root is reproduced only if its neighborhoods wrap, as its plane does
            graph = replace(graph, wraps=tuple("periodic" if n == graph.root else w for n, w in enumerate(graph.wraps)))
        how: dict[str, Any] = {
            "side": self.most_side,
            "dims": 6 if self.paper else 16,
            "correct": self.matchcolor,
            "literal": self.paper,
            "rooted": self.rooted,
            "quilted": self.quilted,
        }
        parts = tuple(image.first for image in images)
        read = tuple(map(_changed, graph.files)) if self.graph else tuple(map(id, parts))
        return resources.remembered(
            ("plane", graph, read, *how.values(), self.working_space, excluded is None),
            lambda: opened(
                resources, progress, graph, images, self.source, space=self.working_space, excluded=excluded, **how
            ),
            parts,
        )

    def maker(self, plane: Plane, settings: PlaneSettings, resources: Resources) -> Synthesizer:
        """The synthesizer of the plane's windows."""
        maker = resources.remembered(
            ("maker", id(plane.analysis), settings),
            lambda: _made(plane, settings, resources),
            plane.analysis,
        )
        resources.device.collect(resources.stats)
        return maker


def _made(plane: Plane, settings: PlaneSettings, resources: Resources) -> Synthesizer:
    maker = Synthesizer(resources.device, plane.analysis, settings, resources.budget)
    if settings.kept == 1.0:
        return maker
    from .contrast import with_contrast  # only for endless zooms

    plain = replace(settings, seed=0, around=None)
    with resources.stats.time("contrast"):
        return with_contrast(maker, plane.analysis, analysis_folder(), plane.key(plain, 0))


def _changed(path: Path) -> tuple[int, int] | None:
    """Modification time and size of a file."""
    try:
        status = os.stat(path)
    except OSError:  # reported when the file is read
        return None
    return status.st_mtime_ns, status.st_size


def with_report(
    quality: Quality, plane: Plane, results: dict[str, Any], source: Callable[[Window], SourceMap] | None = None,
    original: np.ndarray | None = None,
) -> dict[str, Any]:  # fmt: skip
    """The op's results with its image's measures.

    `source`: the root's pixels in a window, if all are copies. `original` (height, width, 3): Lab of the root before
    flattening.
    """
    main, root = results[quality.op.main().name], plane.exemplars[plane.graph.root]
    sizes = root.place.size, main.window.size
    measured = replace(quality, sizes=sizes, copies=source is not None)
    rows, place, (height, width) = rows_of(main), main.window, main.window.size[::-1]

    def seen() -> tuple[np.ndarray, list[Look]]:
        lab = MadeRows(
            (height, width, 3), np.float32, lambda first, last: plane.lens.values(rows[first:last])[0][..., :3]
        )
        copies = None
        if source is not None:
            packed = MadeRows((height, width), np.uint32, lambda first, last: source(
                Window(place.left, place.top + first, place.right, place.top + last)
            ).packed)  # fmt: skip
            copies = SourceMap.of_rows(measured.kept(packed))
        own = root.values[root.photo][..., :3]
        return own if original is None else original, [Look(main.name, measured.kept(lab), copies, own)]

    return measured.add_to(results, seen)


def texture_spec(spec: oiio.ImageSpec, display: Window, place: Window, tile: str = "none") -> oiio.ImageSpec:
    """The spec of a window of a texture, display and data window on its plane. Toroidal: the display window tiles."""
    new = tile_spec(spec, tile, (display.width, display.height))
    new.full_x, new.full_y = display.left, display.top
    new.x, new.y, new.width, new.height = place.left, place.top, place.width, place.height
    return new
