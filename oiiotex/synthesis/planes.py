# SPDX-License-Identifier: Apache-2.0
"""A plane without end, ready to be looked at: a graph's exemplars read and analysed, and windows of it as pixels.

What --texsynth and --texzoom share. Pixels are made as texels and offsets (`States`), and shown as copies of exemplars'
pixels with their offset on them (`Plane.pixels`).
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path

import numpy as np

from .. import __version__
from ..files import read
from ..images import Image
from ..kept import hash_of
from ..session import Session
from ..tiles import assembled
from ..windows import Window
from ..working import Lens
from .candidates import Analysis, analyse
from .coverage import MUCH, RARE, shares, unmatched
from .exemplars import Graph, read_graph
from .multiscale import KEPT_IN_LOOPS, Settings, State, Synthesizer, default_jitter
from .stacks import STEPS, Exemplar, load_exemplars, nearest_opaque, shown_level
from .targets import stacks_of

log = logging.getLogger("oiiotex")

_CELL = 1 << 19  # pixels made at once: large beside their halo, small beside the memory
_SLAB = 1 << 17  # pixels shown at once: what is computed on the way fits the caches
_STATE_BYTES = 12  # of a pixel that is kept as texel and offset
_FARTHEST = 1 << 30  # px; a file's windows lie nearer


@dataclass(frozen=True)
class Plane:
    """A graph with its exemplars.

    Attributes
    ----------
    graph : Graph
    images : tuple of Image
        One for each exemplar.
    exemplars : tuple of Exemplar
    lens : Lens
        How the root is seen.
    analysis : Analysis
    finest : int
        L: on that level a pixel is as large as one of the root.
    """

    graph: Graph
    images: tuple[Image, ...]
    exemplars: tuple[Exemplar, ...]
    lens: Lens
    analysis: Analysis
    finest: int
    _planes: dict[int, np.ndarray] = field(default_factory=dict, repr=False)

    @property
    def root(self) -> Image:
        """The image that says space, channels, type and size."""
        return self.images[self.graph.root]

    def settings(
        self, *, seed: int | None, lock: bool | int, around: tuple[int, int] | None = None, around_level: int = 0
    ) -> Settings:
        """How it is made; the graph's own seed and jitter where they are not said.

        `lock` says the last level without jitter (HRRG08 figure 7); 0: none, 1 or True: L.
        """
        loops = any(self.graph.in_loop(n) for n in range(len(self.graph.names)))
        jitter = self.graph.jitter or default_jitter(self.finest, endless=loops)
        if lock:
            last = self.finest if lock == 1 else int(lock)
            longer = (*jitter, *jitter[-1:] * (last + 1))
            jitter = tuple(0.0 if n <= last else rho for n, rho in enumerate(longer))
        return Settings(
            seed=seed if seed is not None else self.graph.seed or 0,
            jitter=jitter,
            kept=KEPT_IN_LOOPS if loops else 1.0,
            around=around,
            around_level=around_level,
        )

    def key(self, settings: Settings, level: int) -> str:
        """What texels and offsets of a level follow from, as a word: another graph, seed or version has another."""
        found = (getattr(self.analysis, f.name) for f in fields(self.analysis))
        arrays = (value for value in found if isinstance(value, np.ndarray))
        stacks = self.analysis.stacks
        return hash_of(__version__, stacks.levels, settings, level, stacks.planes, *arrays)

    def pixels(self, state: State) -> np.ndarray:
        """What pixels look like: (height, width, channels) of the root's pixel type.

        All channels of what they copy, with their offset added in Lab.
        """
        exemplar = self.exemplars[0].pixels
        out = np.empty((*state.texel.shape, exemplar.shape[2]), exemplar.dtype)
        rows = max(1, _SLAB // max(1, out.shape[1]))
        for top in range(0, len(out), rows):
            self._show(state.texel[top : top + rows], state.offset[top : top + rows], out[top : top + rows])
        return out

    def _show(self, texel: np.ndarray, offset: np.ndarray, out: np.ndarray) -> None:
        bits = 2 * self.analysis.stacks.side_bits
        number, at = texel >> np.uint32(bits), texel & np.uint32((1 << bits) - 1)
        used = np.flatnonzero(np.bincount(number.ravel()))
        for n in used:
            mine = slice(None) if len(used) == 1 else number == n
            out[mine] = self._shown(int(n))[at[mine]]
        moved = offset.any(-1)
        if moved.any():
            rows = out[moved][None]
            values, opaque = self.lens.values(rows)
            values[..., :3] += offset[moved][None, :, :3] * np.float32(1 / STEPS)
            out[moved] = self.lens.replaced(rows, values, opaque)[0]

    def places(self, state: State) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(number of the stack level, y, x) of what pixels copy."""
        bits = self.analysis.stacks.side_bits
        at, inside = state.texel.astype(np.int64), (1 << bits) - 1
        return at >> 2 * bits, (at >> bits) & inside, at & inside

    def _shown(self, number: int) -> np.ndarray:
        """(side^2, channels) of a stack level; transparent pixels show the nearest opaque one."""
        if number not in self._planes:
            of, level = self.analysis.stacks.levels.stacks[number]
            plane = shown_level(self.exemplars[of], level, self.finest)
            plane = plane.reshape(-1, plane.shape[2])
            opaque = self.exemplars[of].opaque
            self._planes[number] = plane if opaque is None else plane[nearest_opaque(opaque).ravel()]
        return self._planes[number]


def graph_images(path: str | Path, session: Session) -> tuple[Graph, tuple[Image, ...]]:
    """The graph of a document, and its exemplars' files, opened.

    Raises
    ------
    ImageError
        As by `exemplars.read_graph` and `files.read`.
    """
    graph = read_graph(path)
    return graph, tuple(read(file, session.cache) for file in graph.files)


def opened(
    session: Session, graph: Graph, images: Sequence[Image], name: str, *, side: int, dims: int, correct: bool,
    data: bool,
) -> Plane:  # fmt: skip
    """Read and analyse the exemplars of a graph.

    Parameters
    ----------
    session : Session
    graph : Graph
    images : sequence of Image
    name : str
        The graph's, for messages.
    side : int
        Of the exemplars' squares, at most; px.
    dims : int
        Of projected neighbourhoods.
    correct : bool
        Bring exemplars that do not agree in colour together.
    data : bool
        The channels are no colours.

    Raises
    ------
    ImageError, ColorError, DeviceError
        As by `stacks.load_exemplars`, `Graph.require_levels` and `candidates.analyse`.
    """
    with session.stats.time("read and colour"):
        config = None if data else session.color
        exemplars, lens = load_exemplars(images, graph, config, session.autocc, side)
    finest = exemplars[0].side.bit_length() - 1
    graph.require_levels(finest, name)
    looks = [array for exemplar in exemplars for array in (exemplar.values, exemplar.opaque)]
    key = hash_of(graph, dims, correct, *looks)
    analysis = session.once(key, lambda: _analysed(session, graph, exemplars, dims, correct))
    return Plane(graph, tuple(images), exemplars, lens, analysis, finest)


def _analysed(session: Session, graph: Graph, exemplars: tuple[Exemplar, ...], dims: int, correct: bool) -> Analysis:
    import platformdirs

    with session.stats.time("Gaussian stacks"):
        stacks = stacks_of(graph, exemplars)
    folder = Path(platformdirs.user_cache_dir("oiiotex")) / "candidates"
    found = analyse(session.device, stacks, dims, correct, session.budget, session.advance, folder)
    _report(graph, exemplars, found)
    return found


def _report(graph: Graph, exemplars: Sequence[Exemplar], analysis: Analysis) -> None:
    """Say how often each exemplar is taken, and warn of what will not show well (HRRG08 section 8)."""
    for n, share in shares(graph, analysis):
        name = graph.names[n]
        log.info("exemplar '%s' is a candidate of %.1f %% of the texels that it may replace", name, 100 * share)
        if share < RARE:
            log.warning(
                "exemplar '%s' appears %s: others match better (%.2g %% of the texels that it may replace; HRRG08"
                " section 8)", name, "nowhere" if share == 0 else "hardly anywhere", 100 * share,
            )  # fmt: skip
    for n, share, x, y, away in unmatched(analysis):
        if share >= MUCH:
            place, factor = exemplars[n].place, exemplars[n].factor
            log.warning(
                "exemplar '%s': nothing finer is like %.0f %% of it (%.0f Lab units off at most, at %d,%d px):"
                " its detail is another's there (HRRG08 section 8)",
                graph.names[n], 100 * share, away, (place.left + x) / factor, (place.top + y) / factor,
            )  # fmt: skip


class States:
    """Pixels of a level as texels and offsets, made in cells that are kept for a while.

    `place` and `display` are in an image's own coordinates, which begin at 0 where the plane's do not fit 32 bits.
    With a `key` (`Plane.key`) cells are also kept beside the file that is being written, for a run that goes on.
    """

    def __init__(
        self, session: Session, maker: Synthesizer, level: int, window: Window, display: Window, key: str = ""
    ):
        self._session, self._maker, self._level, self._key = session, maker, level, key
        near = max(map(abs, display)) < _FARTHEST
        self._shift = (0, 0) if near else (display.left, display.top)
        self.place, self.display = (w.shifted(-self._shift[0], -self._shift[1]) for w in (window, display))
        row = _STATE_BYTES * self.place.width
        height = max(32, min(512, session.cache.limit // 3 // row))
        self._cell = max(32, _CELL // height), height

    def read(self, window: Window) -> State:
        """The pixels of a window."""
        cache = self._session.cache
        packed = assembled(window, self._cell, self.place, lambda at: cache.get((self, at), lambda: self._kept(at)))
        texel = np.ascontiguousarray(packed[..., :2]).view(np.uint32)[..., 0]
        return State(texel, packed[..., 2:])

    def _kept(self, place: Window) -> np.ndarray:
        """(height, width, 6) int16: a texel number in two halves, an offset."""
        window, keeper = place.shifted(*self._shift), self._session.keeper
        if keeper is None or not self._key:
            return self._made(window)
        return keeper.piece(self._key, window, lambda: self._made(window))

    def _made(self, window: Window) -> np.ndarray:
        state = self._maker.window(self._level, window)
        self._session.device.collect(self._session.stats)  # now: a stream would hold the events of all its cells
        return np.concatenate([np.ascontiguousarray(state.texel)[..., None].view(np.int16), state.offset], -1)
