# SPDX-License-Identifier: Apache-2.0
"""--texsynth: any window, at any zoom, of a texture without end (HRRG08; Lefebvre & Hoppe 2005)."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import OpenImageIO as oiio

from ..errors import ParameterError
from ..images import Image, Part
from ..op import Output
from ..params import Size, param
from ..session import Session
from ..synthesis.exemplars import Graph
from ..synthesis.multiscale import MOST_LEVEL, Synthesizer
from ..synthesis.planes import Plane, States
from ..synthesis.stacks import STEPS
from ..windows import Window
from ..writing import write
from .multiscale import Multiscale, texture_spec
from .stationarize import source_coordinates

PLANE = "oiiotex:plane"  # the attribute that says of a share what its pixels follow from

_WINDOW = re.compile(r"([1-9]\d*)x([1-9]\d*)([+-]\d+)([+-]\d+)", re.ASCII)
_SHARE = re.compile(r"([1-9]\d{0,9})/([1-9]\d{0,9})", re.ASCII)
_FARTHEST = 1 << 60  # px; places of windows


@dataclass(frozen=True, kw_only=True)
class Synth(Multiscale):
    """Synthesize a texture without end from one exemplar, or from a graph of exemplars at different scales.

    Without `graph` the top image is the one exemplar: a texture of any size grows from it (Lefebvre & Hoppe, Parallel
    controllable texture synthesis, 2005). A graph says of a few small exemplars how their scales relate, and any window
    of any level of detail can be had, alone and the same to the bit as in the whole (HRRG08: Han, Risser, Ramamoorthi,
    Grinspun, Multiscale Texture Synthesis, 2008). Exemplars are cut to squares of a power of two around their centres;
    one that does not tile is mirrored at its borders. Every pixel is a copy of one of an exemplar, but for the colour
    offset by which exemplars that do not agree are brought together.
    """

    name: ClassVar[str] = "synth"
    copies: ClassVar[bool] = True  # of its source, the one exemplar; with a graph it has no source
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("texture", "pixels copied from the exemplars, all channels, in the root's colour space and type"),
        Output("st", "32-bit float source coordinates as --texwarp reads them; with graph also the exemplar's number"),
        Output(
            "transfer",
            "with graph: the offset that was added to each copied pixel, L, a and b of CIE Lab as R, G and B",
        ),
    )

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
    toroidal: bool = param(False, help="the result of that size tiles; sides are multiples of 2^level px")
    resume: bool = param(
        False, help="keep finished pieces in OUT.parts until OUT is whole: a run that was killed goes on from there"
    )
    stmap: bool | Path = param(False, help="1: source coordinates as parts of the result; a file name: there")

    def single(self, name: str) -> Graph:
        """One exemplar without scale edges."""
        return Graph.single(name)

    def compute(self, session: Session) -> Image:
        """The texture, followed by its source coordinates where they are asked for."""
        self.refuse_overwriting(stmap=self.stmap)
        plane = self.opened(session)
        first = plane.root.first
        level = plane.finest + plane.graph.depth() if self.level is None else self.level
        display, window = self._windows(first.spec)
        around = self._around(level, display)
        settings = plane.settings(seed=self.seed, lock=self.lock, around=around, around_level=level)
        maker = Synthesizer(session.device, plane.analysis, settings, session.budget)
        session.device.collect(session.stats)
        key = plane.key(settings, level) if self.resume or self.tiles else ""
        states = States(session, maker, level, window, display or window, key if self.resume else "")
        spec = texture_spec(first.spec, states.display, states.place, self.toroidal)
        spec.attribute("oiiotex:level", level)
        spec.attribute("oiiotex:window", str(window))
        spec.attribute("oiiotex:seed", settings.seed)
        if self.tiles:
            spec.attribute(PLANE, key)
        texture = Part(first.name, spec, lambda w: plane.pixels(states.read(w)), first.spec.format)
        maps = self._maps(plane, states)
        if isinstance(self.stmap, Path):
            with session.keeping(self.stmap):
                write(Image(maps, str(self.stmap)), self.stmap, oiio.TypeDesc(oiio.FLOAT))
            session.written.add(os.path.realpath(self.stmap))
        return Image((texture, *(maps if self.stmap is True else ())), self.source)

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

    def _around(self, level: int, display: Window | None) -> tuple[int, int] | None:
        """After how many pixels of the level the plane repeats."""
        if not self.toroidal:
            return None
        if self.size is None or display is None:
            raise ParameterError("toroidal=1: say size, after which the texture repeats")
        if any(n % (1 << level) for n in self.size):
            raise ParameterError(
                f"toroidal=1: size={self.size}: on level {level} allowed are multiples of {1 << level} px"
            )
        return display.width, display.height

    def _maps(self, plane: Plane, states: States) -> tuple[Part, ...]:
        """The parts 'st' and, with a graph, 'transfer'."""
        of = np.array([exemplar for exemplar, _ in plane.analysis.stacks.levels.stacks])
        several = self.graph is not None

        def coordinates(window: Window) -> np.ndarray:
            number, y, x = plane.places(states.read(window))
            out = np.empty((*number.shape, 3 if several else 2), np.float32)
            for n, (given, exemplar) in enumerate(zip(plane.images, plane.exemplars, strict=True)):
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
            Part(name, _map_spec(states, channels), fetch, kind, exact=True) for name, channels, fetch in found
        )


def _map_spec(states: States, channels: tuple[str, ...]) -> oiio.ImageSpec:
    """Of a part beside the texture, in the same windows: files of several parts want that."""
    spec = oiio.ImageSpec(states.place.width, states.place.height, len(channels), oiio.FLOAT)
    spec.x, spec.y = states.place[:2]
    spec.full_x, spec.full_y = states.display[:2]
    spec.full_width, spec.full_height = states.display.width, states.display.height
    spec.channelnames = channels
    spec.attribute("oiio:ColorSpace", "data")
    return spec
