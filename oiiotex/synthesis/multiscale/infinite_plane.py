# SPDX-License-Identifier: Apache-2.0
"""An unbounded plane of texture: a graph's exemplars, read and analyzed, and windows of it as pixels.

Shared by --texsynth and --texzoom. Pixels are synthesized as texels and offsets (`States`), and rendered as copies of
exemplars' pixels with their offset added (`Plane.pixels`).
"""

from __future__ import annotations

import itertools
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path

from ... import __version__
from ...engine.color.lab import lens_of
from ...engine.color.lab_grid import FINE_STEPS
from ...engine.color.lens import Lens
from ...engine.core.demand import assembled, cells_of
from ...engine.core.image import Image
from ...engine.core.op import Space
from ...engine.core.source_map import SourceMap
from ...engine.core.window import Window
from ...engine.deferred import np
from ...engine.io.disk_cache import hash_of
from ...engine.io.reading import read
from ...engine.session.facts import Facts
from ...engine.session.progress import Progress
from ...engine.session.resources import Resources
from .candidate_sets import Analysis, analyze
from .coverage import MUCH, RARE, shares, unmatched
from .graph import Graph, read_graph
from .plane_quilt import OCTAVES
from .stacks import Exemplar, load_exemplars, nearest_opaque, shown_level
from .synthesizer import (
    KEPT_IN_LOOPS,
    PENALTY,
    PlaneSettings,
    PlaneState,
    Synthesizer,
    default_jitter,
)
from .targets import stacks_of

log = logging.getLogger("oiiotex")

_CELL = 1 << 19  # pixels synthesized at a time: large compared with their halo, small compared with the memory
_SLAB = 1 << 17  # pixels rendered at a time: temporaries fit the caches
_STATE_BYTES = 12  # per pixel kept as texel and offset
_LAYOUT = 2  # of kept cells; increment if it changes
_FARTHEST = 1 << 30  # px; maximum coordinate in a file


@dataclass(frozen=True)
class Plane:
    """A graph with its exemplars."""

    graph: Graph
    images: tuple[Image, ...]  # one for each exemplar
    exemplars: tuple[Exemplar, ...]
    lens: Lens  # of the root
    analysis: Analysis
    finest: int  # L: the level with pixels of the root's size
    rooted: bool = False  # its first cell is the root itself, up to L
    _planes: dict[int, np.ndarray] = field(default_factory=dict, repr=False)

    @property
    def root(self) -> Image:
        """The image that defines color space, channels, type and size."""
        return self.images[self.graph.root]

    def settings(
        self, *, seed: int | None, lock: bool | int, jitter: tuple[float, ...] | None = None,
        around: tuple[int, int] | None = None, around_level: int = 0,
    ) -> PlaneSettings:  # fmt: skip
        """The settings, with the graph's seed and jitter as defaults.

        `jitter`: rho by level; the last holds for all finer levels.
        `lock`: last level without jitter (HRRG08 figure 7; 1 or True: L). `around`: period (width, height) of the plane
        in px of `around_level`.
        """
        looping = any(self.graph.in_loop(n) for n in range(len(self.graph.names)))
        literal = self.analysis.stacks.levels.literal
        loops = looping and not literal
        jitter = jitter or self.graph.jitter
        jitter = jitter or default_jitter(self.finest, everywhere=loops or literal, rooted=self.rooted)
        if lock:
            last = self.finest if lock == 1 else int(lock)
            longer = (*jitter, *jitter[-1:] * (last + 1))
            jitter = tuple(0.0 if n <= last else rho for n, rho in enumerate(longer))
        return PlaneSettings(
            seed=seed if seed is not None else self.graph.seed or 0,
            jitter=jitter,
            penalty=1.0 if literal else PENALTY,
            kept=KEPT_IN_LOOPS if loops else 1.0,
            around=around,
            around_level=around_level,
            root_level=self.finest if self.rooted else -1,
        )

    def key(self, settings: PlaneSettings, level: int) -> str:
        """A hash of everything that texels and offsets of a level depend on, including graph, seed and version."""
        values = (getattr(self.analysis, f.name) for f in fields(self.analysis))
        arrays = (value for value in values if isinstance(value, np.ndarray))
        stacks = self.analysis.stacks
        return hash_of(__version__, _LAYOUT, stacks.levels, settings, level, stacks.planes, *arrays)

    def pixels(self, state: PlaneState) -> np.ndarray:
        """Render pixels: (height, width, channels) of the root's pixel type.

        All channels of the copied pixels, with their offset added in Lab.
        """
        exemplar = self.exemplars[0].pixels
        out = np.empty((*state.texel.shape, exemplar.shape[2]), exemplar.dtype)
        rows = max(1, _SLAB // max(1, out.shape[1]))
        for top in range(0, len(out), rows):
            piece = slice(top, top + rows)
            self._copy(self.source(state)[piece], out[piece])
            if state.offset is not None:
                self._move(state.offset[piece], out[piece])
        return out

    def root_lab(self, image: Image, space: Space, resources: Resources) -> np.ndarray:
        """Values of the root's pixels in another image of the same size: (height, width, 3) float32."""
        root = self.exemplars[self.graph.root]
        if image is self.root:
            return root.values[root.photo][..., :3]
        corner = image.first.window
        place = root.place.shifted(corner.left, corner.top)
        return lens_of(image, resources, space).values(image.first.read(place))[0][..., :3]

    def source(self, state: PlaneState) -> SourceMap:
        """The copied pixels. Indices of exemplars are those of the stack's levels."""
        return SourceMap(state.texel, self.analysis.stacks.side_bits)

    def _copy(self, source: SourceMap, out: np.ndarray) -> None:
        number = source.number
        numbers = np.flatnonzero(np.bincount(number.ravel()))
        if len(numbers) == 1:  # always the case for one exemplar at its own scale
            out[...] = source.gather(self._shown(int(numbers[0])))
            return
        for n in numbers:
            mine = number == n
            out[mine] = source[mine].gather(self._shown(int(n)))

    def _move(self, offset: np.ndarray, out: np.ndarray) -> None:
        moved = offset.any(-1)
        if moved.any():
            rows = out[moved][None]
            values, opaque = self.lens.values(rows)
            values[..., :3] += offset[moved][None, :, :3] * np.float32(1 / FINE_STEPS)
            out[moved] = self.lens.replaced(rows, values, opaque)[0]

    def _shown(self, number: int) -> np.ndarray:
        """(side, side, channels) of a stack level. Transparent pixels show the nearest opaque one."""
        if number not in self._planes:
            of, level = self.analysis.stacks.levels.shown[number]
            plane = shown_level(self.exemplars[of], level, self.finest)
            opaque = self.exemplars[of].opaque
            self._planes[number] = plane if opaque is None else nearest_opaque(opaque).gather(plane)
        return self._planes[number]


def graph_images(path: str | Path, facts: Facts) -> tuple[Graph, tuple[Image, ...]]:
    """The graph in a document, and its exemplar files, opened."""
    graph = read_graph(path)
    return graph, tuple(read(file, facts.cache) for file in graph.files)


def opened(
    resources: Resources, progress: Progress, graph: Graph, images: Sequence[Image], name: str, *, side: int, dims: int,
    correct: bool, literal: bool, space: Space,
    excluded: np.ndarray | None = None, rooted: bool = False, quilted: bool = False,
) -> Plane:  # fmt: skip
    """Read and analyze the exemplars of a graph, called `name` in messages. Other arguments are those of --texsynth.

    `rooted`: the plane's first cell is the root itself up to its resolution, and the plane continues it. `quilted`: it
    starts from a `PlaneQuilt`.
    """
    with resources.stats.time("read and color"):
        exemplars, lens = load_exemplars(images, graph, resources, space, side, quilted)
        if excluded is not None:
            exemplars = tuple(one.without(excluded) for one in exemplars)
    finest = exemplars[0].side.bit_length() - 1
    graph.require_levels(finest, name)
    looks = [array for exemplar in exemplars for array in (exemplar.values, exemplar.opaque)]
    first = max(0, finest - OCTAVES) if quilted else 0
    key = hash_of(graph, dims, correct, literal, rooted, first, *looks)
    analysis = resources.once(
        key, lambda: _analyzed(resources, progress, graph, exemplars, dims, correct, literal, rooted, first)
    )
    return Plane(graph, tuple(images), exemplars, lens, analysis, finest, rooted)


def analysis_folder() -> Path:
    """Folder of the cached results of `analyze`."""
    from ...engine.io.cache_folders import cache_folder  # not needed for help

    return cache_folder() / "candidates"


def _analyzed(
    resources: Resources, progress: Progress, graph: Graph, exemplars: tuple[Exemplar, ...], dims: int, correct: bool,
    literal: bool, rooted: bool, first: int,
) -> Analysis:  # fmt: skip
    with resources.stats.time("Gaussian stacks"):
        stacks = stacks_of(graph, exemplars, literal, rooted, first)
    resources.cache.forget()  # everything has been read
    analysis = analyze(resources.device, stacks, dims, correct, resources.budget, progress.advance, analysis_folder())
    resources.cache.forget()
    _report(graph, exemplars, analysis)
    return analysis


def _report(graph: Graph, exemplars: Sequence[Exemplar], analysis: Analysis) -> None:
    """Log how often each exemplar is used, and warn of those that will not appear (HRRG08 section 8)."""
    for n, share in shares(graph, analysis):
        name = graph.names[n]
        log.info("exemplar '%s' is a candidate for %.1f %% of the texels that it may replace", name, 100 * share)
        if share < RARE:
            log.warning(
                "exemplar '%s' appears %s: others match better (it is a candidate for %.2g %% of the texels that it may"
                " replace; HRRG08 section 8)", name, "nowhere" if share == 0 else "hardly anywhere", 100 * share,
            )  # fmt: skip
    for n, share, x, y, away in unmatched(analysis):
        if share >= MUCH:
            place, factor = exemplars[n].place, exemplars[n].factor
            log.warning(
                "exemplar '%s': %.0f %% of it has no finer match (color difference up to %.0f Lab units, at %d,%d px);"
                " unrelated detail appears there (HRRG08 section 8)",
                graph.names[n], 100 * share, away, (place.left + x) / factor, (place.top + y) / factor,
            )  # fmt: skip


def in_file(window: Window, display: Window) -> tuple[Window, Window]:
    """Data and display window in the image's coordinates, which begin at 0 if the plane's exceed 32 bits."""
    near = max(map(abs, display)) < _FARTHEST
    left, top = (0, 0) if near else display[:2]
    return window.shifted(-left, -top), display.shifted(-left, -top)


class States:
    """Pixels of a level as texels and offsets, synthesized in cells that are cached.

    `window`: data window, and `display`: display window, in pixels of the level. The attribute `place` is the first
    of `in_file`. With a `key` (`Plane.key`) cells are also written to a checkpoint next to the output file, from which
    an interrupted run resumes.
    """

    def __init__(
        self, resources: Resources, maker: Synthesizer, level: int, window: Window, display: Window, key: str = ""
    ):
        self._resources, self._maker, self._level, self._key = resources, maker, level, key
        self.place = in_file(window, display)[0]
        self._shift = window.left - self.place.left, window.top - self.place.top
        row = _STATE_BYTES * self.place.width
        height = max(32, min(512, resources.cache.limit // 3 // row))
        self._cell = max(32, _CELL // height), height
        self._ahead: dict[Window, Callable[[], PlaneState]] = {}

    def read(self, window: Window) -> PlaneState:
        """The pixels of a window."""
        cache, cells = self._resources.cache, cells_of(window, self._cell, self.place)
        following = dict(itertools.pairwise(cells))

        def piece(at: Window) -> np.ndarray:
            return cache.get((self, at), lambda: self._kept(at, following.get(at)))

        packed = assembled(window, self._cell, self.place, piece)
        return PlaneState(packed[..., 0], packed[..., 1:].view(np.int16) if packed.shape[2] > 1 else None)

    def _kept(self, place: Window, following: Window | None) -> np.ndarray:
        """(height, width, 1 or 3) uint32: a texel index, and the four halves of an offset if there are any."""
        keeper = self._resources.keeper
        if keeper is None or not self._key:
            return self._made(place, following)
        return keeper.piece(self._key, place.shifted(*self._shift), lambda: self._made(place, None))

    def _made(self, place: Window, following: Window | None) -> np.ndarray:
        """The cell, while the device already works on the following one."""
        begun = self._ahead.pop(place, None) or self._begun(place)
        if following is not None and not self._resources.cache.holds((self, following)):
            self._ahead[following] = self._begun(following)
        texel, offset = begun()
        # a stream would keep the events of all its cells
        self._resources.device.collect(self._resources.stats, wait=False)
        if offset is None:
            return texel[..., None]
        packed = np.empty((*texel.shape, 3), np.uint32)
        packed[..., 0], packed[..., 1:] = texel, offset.view(np.uint32)
        return packed

    def _begun(self, place: Window) -> Callable[[], PlaneState]:
        return self._maker.begin(self._level, place.shifted(*self._shift))
