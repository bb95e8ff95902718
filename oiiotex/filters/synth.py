# SPDX-License-Identifier: Apache-2.0
"""--texsynth: any window, at any zoom, of a texture without end (HRRG08; Lefebvre & Hoppe 2005)."""

from __future__ import annotations

import logging
import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import OpenImageIO as oiio

from ..errors import ParameterError
from ..files import read
from ..images import Image, Part, derived_spec
from ..op import Op, Output, Reach, Space
from ..params import Parameter, Size, image, param
from ..session import Session
from ..synthesis.candidates import Analysis, analyse
from ..synthesis.exemplars import Graph, read_graph
from ..synthesis.multiscale import KEPT_IN_LOOPS, MOST_LEVEL, Settings, State, Synthesizer, default_jitter
from ..synthesis.stacks import STEPS, Exemplar, load_exemplars, nearest_opaque, shown_level
from ..synthesis.targets import stacks_of
from ..tiles import assembled
from ..windows import Window
from ..working import Lens
from ..writing import write
from .stationarize import source_coordinates

log = logging.getLogger("oiiotex")

_WINDOW = re.compile(r"([1-9]\d*)x([1-9]\d*)([+-]\d+)([+-]\d+)", re.ASCII)
_SHARE = re.compile(r"([1-9]\d{0,9})/([1-9]\d{0,9})", re.ASCII)
_CELL = 1 << 19  # pixels made at once: large beside their halo, small beside the memory
_STATE_BYTES = 12  # of a pixel that is kept as texel and offset
_FARTHEST = 1 << 60  # px; places of windows


@dataclass(frozen=True, kw_only=True)
class Synth(Op):
    """Synthesize a texture without end from one exemplar, or from a graph of exemplars at different scales.

    Without `graph` the top image is the one exemplar: a texture of any size grows from it (Lefebvre & Hoppe, Parallel
    controllable texture synthesis, 2005). A graph says of a few small exemplars how their scales relate, and any window
    of any level of detail can be had, alone and the same to the bit as in the whole (HRRG08: Han, Risser, Ramamoorthi,
    Grinspun, Multiscale Texture Synthesis, 2008). Exemplars are cut to squares of a power of two around their centres
    and taken for periodic. Every pixel is a copy of one of an exemplar, but for the colour offset by which exemplars
    that do not agree are brought together.
    """

    name: ClassVar[str] = "synth"
    copies: ClassVar[bool] = True  # of its source, the one exemplar; with a graph it has no source
    reach: ClassVar[Reach] = Reach.WINDOW
    space: ClassVar[Space] = Space.LAB
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("texture", "pixels copied from the exemplars, all channels, in the root's colour space and type"),
        Output("st", "32-bit float source coordinates as --texwarp reads them; with graph also the exemplar's number"),
        Output(
            "transfer",
            "with graph: the offset that was added to each copied pixel, L, a and b of CIE Lab as R, G and B",
        ),
    )

    exemplar: Image | None = image(help="the one exemplar; none is taken where graph says them")
    graph: Path | None = param(None, help="an exemplar graph, JSON or YAML")
    size: Size | None = param(
        None, ge=1, le=1 << 30, unit="px", help="of the result; the window's, or the exemplar's own, when left out"
    )
    window: str | None = param(None, help="WxH+X+Y: only these pixels of the plane")
    tiles: str | None = param(
        None, help="I/N: the share I, from 1 to N, of these pixels, some rows of them, for a farm"
    )
    level: int | None = param(
        None, ge=0, le=MOST_LEVEL, help="octaves below a pixel as large as the root; the finest that exemplars hold"
    )
    toroidal: bool = param(False, help="the result of that size tiles")
    lock: bool = param(False, help="no jitter up to the root's own resolution: finer detail for the root as it is")
    correct: bool = param(True, help="bring exemplars that do not agree in colour together (HRRG08 section 5)")
    dims: int = param(16, ge=1, le=16, help="of projected neighbourhoods; 6 are the paper's, 16 repeat less")
    side: int = param(
        256, choices=(16, 32, 64, 128, 256, 512, 1024), unit="px", help="of an exemplar's square, at most"
    )
    stmap: bool | Path = param(False, help="1: source coordinates as parts of the result; a file name: there")
    seed: int | None = param(None, ge=0, le=2**32 - 1, help="same seed, same pixels; the graph's, or 0, when left out")
    data: bool = param(False, help="the channels are no colours: compare them as they are")

    @classmethod
    def taken(cls, values: dict[str, Any]) -> tuple[Parameter, ...]:
        """No image where a graph says which."""
        return () if values.get("graph") else cls.images()

    def compute(self, session: Session) -> Image:
        """The texture, followed by its source coordinates where they are asked for."""
        graph, images, name = self._given(session)
        source = images[graph.root].first
        with session.stats.time("read and colour"):
            config = None if self.data else session.color
            exemplars, lens = load_exemplars(images, graph.factors, config, session.autocc, self.side, graph.root)
        finest = exemplars[0].side.bit_length() - 1
        graph.require_levels(finest, name)
        level = finest + graph.depth() if self.level is None else self.level
        display, window = self._windows(source.spec)
        settings = self._settings(graph, finest, level, display)
        analysis = self._analysed(session, graph, exemplars)
        _report_shares(graph, analysis)
        maker = Synthesizer(session.device, analysis, settings, session.budget)
        session.device.collect(session.stats)
        states = _States(session, maker, level, window, display or window)
        shower = _Shower(analysis, exemplars, lens, finest)
        spec = _texture_spec(source.spec, states.display, states.place, self.toroidal)
        spec.attribute("oiiotex:level", level)
        spec.attribute("oiiotex:window", str(window))
        texture = Part(source.name, spec, lambda w: shower.pixels(states.read(w)), source.spec.format)
        maps = self._maps(graph, images, exemplars, analysis, states)
        if isinstance(self.stmap, Path):
            write(Image(maps, str(self.stmap)), self.stmap, oiio.TypeDesc(oiio.FLOAT))
            session.written.add(os.path.realpath(self.stmap))
        for given in images:
            for part in given.parts[1:]:
                log.warning("%s: part '%s' of %s is not carried along", self.name, part.name, given.source)
        return Image((texture, *(maps if self.stmap is True else ())), name)

    def _given(self, session: Session) -> tuple[Graph, tuple[Image, ...], str]:
        """The graph, its images, and what both are called."""
        if isinstance(self.stmap, Path):
            inputs = [self.graph] if self.graph else [self.exemplar.source] if self.exemplar else []
            if os.path.realpath(self.stmap) in map(os.path.realpath, inputs):
                raise ParameterError(f"stmap={self.stmap} would overwrite what it is made from")
        if self.graph is not None:
            graph = read_graph(self.graph)
            return graph, tuple(read(file, session.cache) for file in graph.files), str(self.graph)
        if self.exemplar is None:
            raise ParameterError(f"{self.name}: takes an image, or graph=FILE")
        return Graph.single(self.exemplar.source), (self.exemplar,), self.exemplar.source

    def _windows(self, spec: oiio.ImageSpec) -> tuple[Window | None, Window]:
        """(what `size` says, the pixels that are made), both on the plane of the level."""
        display = None if self.size is None else Window(0, 0, *self.size)
        if not self.window:
            return self._share(display, display or Window(0, 0, spec.width, spec.height))
        found = _WINDOW.fullmatch(self.window)
        if not found:
            raise ParameterError(f"window={self.window}: allowed is WxH+X+Y, such as 1920x1080+0-400")
        width, height, left, top = map(int, found.groups())
        if max(width, height) > 1 << 30 or max(abs(left), abs(top)) > _FARTHEST:
            raise ParameterError(f"window={self.window}: allowed are sides up to 2^30 px, places up to 2^60 px away")
        window = Window.sized(left, top, width, height)
        if display is not None and window & display != window:
            raise ParameterError(f"window={self.window} is not inside size={self.size}")
        return self._share(display, window)

    def _share(self, display: Window | None, window: Window) -> tuple[Window | None, Window]:
        """(display, window) of the share that `tiles` asks for: rows, so that shares are put together by pasting."""
        if not self.tiles:
            return display, window
        found = _SHARE.fullmatch(self.tiles)
        share, count = map(int, found.groups()) if found else (0, 0)
        if not 1 <= share <= count <= window.height:
            raise ParameterError(f"tiles={self.tiles}: allowed is I/N, I from 1 to N, N at most {window.height} rows")
        rows = (window.top + window.height * n // count for n in (share - 1, share))
        return display or window, Window(window.left, next(rows), window.right, next(rows))

    def _settings(self, graph: Graph, finest: int, level: int, display: Window | None) -> Settings:
        around = None
        if self.toroidal:
            if display is None:
                raise ParameterError("toroidal=1: say size, after which the texture repeats")
            around = display.width, display.height
            if any(n % (1 << level) for n in around):
                raise ParameterError(
                    f"toroidal=1: size={self.size}: on level {level} allowed are multiples of {1 << level} px"
                )
        jitter = graph.jitter or default_jitter(finest)
        if self.lock:
            jitter = tuple(0.0 if n <= finest else rho for n, rho in enumerate((*jitter, *jitter[-1:] * (finest + 1))))
        loops = any(graph.in_loop(n) for n in range(len(graph.names)))
        return Settings(
            seed=self.seed if self.seed is not None else graph.seed or 0,
            jitter=jitter,
            kept=KEPT_IN_LOOPS if loops else 1.0,
            around=around,
            around_level=level,
        )

    def _analysed(self, session: Session, graph: Graph, exemplars: tuple[Exemplar, ...]) -> Analysis:
        import platformdirs

        with session.stats.time("Gaussian stacks"):
            stacks = stacks_of(graph, exemplars, self.lock)
        folder = Path(platformdirs.user_cache_dir("oiiotex")) / "candidates"
        return analyse(session.device, stacks, self.dims, self.correct, session.budget, session.advance, folder)

    def _maps(
        self, graph: Graph, images: tuple[Image, ...], exemplars: tuple[Exemplar, ...], analysis: Analysis,
        states: _States,
    ) -> tuple[Part, ...]:  # fmt: skip
        """The parts 'st' and, with a graph, 'transfer'."""
        side_bits, stacks = analysis.stacks.side_bits, analysis.stacks.levels.stacks
        of = np.array([exemplar for exemplar, _ in stacks])
        several = self.graph is not None

        def coordinates(window: Window) -> np.ndarray:
            state = states.read(window)
            number, y, x = _places(state.texel, side_bits)
            out = np.empty((*number.shape, 3 if several else 2), np.float32)
            for n, (given, exemplar) in enumerate(zip(images, exemplars, strict=True)):
                mine = of[number] == n
                v, u = ((at[mine] + begin + 0.5) / exemplar.factor - 0.5 for at, begin in (
                    (y, exemplar.place.top), (x, exemplar.place.left)))  # fmt: skip
                out[mine, :2] = source_coordinates(v, u, given.first.spec)
            if several:
                out[..., 2] = of[number]
            return out

        def transfers(window: Window) -> np.ndarray:
            return states.read(window).offset[..., :3] * np.float32(1 / STEPS)

        names = ("R", "G", "id") if several else ("R", "G")
        found = [("st", names, coordinates)] + ([("transfer", ("R", "G", "B"), transfers)] if several else [])
        kind = oiio.TypeDesc(oiio.FLOAT)
        return tuple(
            Part(name, _map_spec(states.place, channels), fetch, kind, exact=True) for name, channels, fetch in found
        )


class _States:
    """Pixels as texels and offsets, made in cells that are kept for a while.

    `place` and `display` are in the image's own coordinates, which begin at 0 where the plane's do not fit 32 bits.
    """

    def __init__(self, session: Session, maker: Synthesizer, level: int, window: Window, display: Window):
        self._cache, self._maker, self._level = session.cache, maker, level
        near = max(map(abs, display)) < 1 << 30
        self._shift = (0, 0) if near else (display.left, display.top)
        self.place, self.display = (w.shifted(-self._shift[0], -self._shift[1]) for w in (window, display))
        row = _STATE_BYTES * self.place.width
        height = max(32, min(512, session.cache.limit // 3 // row))
        self._cell = max(32, _CELL // height), height

    def read(self, window: Window) -> State:
        """The pixels of a window."""
        packed = assembled(
            window, self._cell, self.place, lambda at: self._cache.get((self, at), lambda: self._made(at))
        )
        texel = np.ascontiguousarray(packed[..., :2]).view(np.uint32)[..., 0]
        return State(texel, packed[..., 2:])

    def _made(self, place: Window) -> np.ndarray:
        """(height, width, 6) int16: a texel number in two halves, an offset."""
        state = self._maker.window(self._level, place.shifted(*self._shift))
        return np.concatenate([np.ascontiguousarray(state.texel)[..., None].view(np.int16), state.offset], -1)


class _Shower:
    """What pixels look like: all channels of what they copy, with their offset added in Lab."""

    def __init__(self, analysis: Analysis, exemplars: tuple[Exemplar, ...], lens: Lens, finest: int):
        self._side, self._stacks = analysis.stacks.side_bits, analysis.stacks.levels.stacks
        self._exemplars, self._lens, self._finest = exemplars, lens, finest
        self._planes: dict[int, np.ndarray] = {}

    def pixels(self, state: State) -> np.ndarray:
        """(height, width, channels) of the root's pixel type."""
        number, y, x = _places(state.texel, self._side)
        used = np.flatnonzero(np.bincount(number.ravel(), minlength=1))
        at = (y << self._side) + x
        out = np.empty((*number.shape, self._exemplars[0].pixels.shape[2]), self._exemplars[0].pixels.dtype)
        for n in used:
            mine = slice(None) if len(used) == 1 else number == n
            out[mine] = self._plane(int(n))[at[mine]]
        moved = state.offset.any(-1)
        if moved.any():
            rows = out[moved][None]
            values, opaque = self._lens.values(rows)
            values[..., :3] += state.offset[moved][None, :, :3] * np.float32(1 / STEPS)
            out[moved] = self._lens.replaced(rows, values, opaque)[0]
        return out

    def _plane(self, number: int) -> np.ndarray:
        """(side^2, channels) of a stack level; transparent pixels show the nearest opaque one."""
        if number not in self._planes:
            exemplar = self._exemplars[self._stacks[number][0]]
            plane = shown_level(exemplar, self._stacks[number][1], self._finest)
            plane = plane.reshape(-1, plane.shape[2])
            if exemplar.opaque is not None:
                plane = plane[nearest_opaque(exemplar.opaque).ravel()]
            self._planes[number] = plane
        return self._planes[number]


def _places(texel: np.ndarray, side_bits: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Texel numbers -> (number of the level, y, x)."""
    at, inside = texel.astype(np.int64), (1 << side_bits) - 1
    return at >> 2 * side_bits, (at >> side_bits) & inside, at & inside


def _report_shares(graph: Graph, analysis: Analysis) -> None:
    """Say how much of what may be replaced by each exemplar is; warn of one that appears nowhere (section 8)."""
    of = np.array([exemplar for exemplar, _ in analysis.stacks.levels.stacks])
    for n, name in enumerate(graph.names):
        if n == graph.root:
            continue
        numbers = [
            m
            for m, onward in enumerate(analysis.stacks.levels.admissible)
            if of[m] != n and n in of[[k for k, _ in onward]]
        ]
        if not numbers:
            continue
        into = of[(analysis.links[numbers] >> np.uint32(2 * analysis.stacks.side_bits)).astype(np.int64)]
        share = float((into == n).any(-1).mean())
        log.info("exemplar '%s' is a candidate of %.1f %% of the texels that it may replace", name, 100 * share)
        if share == 0:
            log.warning("exemplar '%s' appears nowhere: others match better everywhere (HRRG08 section 8)", name)


def _texture_spec(spec: oiio.ImageSpec, display: Window, place: Window, toroidal: bool) -> oiio.ImageSpec:
    new = derived_spec(spec, display.width, display.height)
    new.full_x, new.full_y = display.left, display.top
    new.x, new.y, new.width, new.height = place.left, place.top, place.width, place.height
    new.attribute("wrapmodes", "periodic,periodic" if toroidal else "black,black")
    return new


def _map_spec(place: Window, channels: tuple[str, ...]) -> oiio.ImageSpec:
    spec = oiio.ImageSpec(place.width, place.height, len(channels), oiio.FLOAT)
    spec.x = spec.full_x = place.left
    spec.y = spec.full_y = place.top
    spec.channelnames = channels
    spec.attribute("oiio:ColorSpace", "data")
    return spec
