# SPDX-License-Identifier: Apache-2.0
"""--texsynth: any window, at any zoom, of a texture without end (HRRG08; Lefebvre & Hoppe 2005)."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

from ..color.lab_grid import FINE_STEPS
from ..core.attributes import PLANE, WINDOW, note
from ..core.image import Part, spec_beside
from ..core.op import Kind, Output
from ..core.parameters import Size, param
from ..core.source_map import ST, SourceMap
from ..core.window import Domain, Window
from ..deferred import np, oiio
from ..errors import ParameterError, modifier
from ..exemplar.photo_lattice import Structured, fitting_size
from ..multiscale.graph import Graph
from ..multiscale.infinite_plane import Plane, States
from ..multiscale.multiscale_op import FARTHEST, Multiscale, texture_spec, with_report
from ..multiscale.synthesizer import MOST_LEVEL
from ..quality.report import REPORT, Quality
from ..regularity.offset_prices import InStep
from ..session import Session

_WINDOW = re.compile(r"([1-9]\d*)x([1-9]\d*)([+-]\d+)([+-]\d+)", re.ASCII)
_SHARE = re.compile(r"([1-9]\d{0,9})/([1-9]\d{0,9})", re.ASCII)


@dataclass(frozen=True, kw_only=True)
class Synth(Multiscale, Structured):
    """Synthesize a texture without end from one exemplar, or from a graph of exemplars at different scales.

    Without `graph` the top image is the one exemplar: a texture of any size grows from it (Lefebvre & Hoppe, Parallel
    controllable texture synthesis, 2005). A graph says of a few small exemplars how their scales relate, and any window
    of any level of detail can be had, alone and the same to the bit as in the whole (HRRG08: Han, Risser, Ramamoorthi,
    Grinspun, Multiscale Texture Synthesis, 2008). Exemplars are cut to squares of a power of two around their centers;
    one that does not tile is mirrored at its borders. Every pixel is a copy of one of an exemplar, but for the color
    offset by which exemplars that do not agree are brought together.
    """

    example: ClassVar[str] = '>>> texture = filters.synth("photo.png", size=(1024, 512), seed=7)'
    name: ClassVar[str] = "synth"
    copies: ClassVar[bool] = True  # of its source, the one exemplar; with a graph it has no source
    outputs: ClassVar[tuple[Output, ...]] = (
        Output(
            "texture",
            Kind.PIXELS,
            "pixels copied from the exemplars, all channels, in the root's color space and type",
        ),
        replace(ST, help="where every pixel comes from, as `warp` reads it; with graph also the exemplar's number"),
        Output(
            "transfer",
            Kind.COORDINATES,
            "with graph: the offset that was added to each copied pixel, L, a and b of CIE Lab as R, G and B",
            asked_by="stmap",
        ),
        REPORT,
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

    def files(self) -> dict[str, Path]:
        """One exemplar agrees with itself: there is no transfer."""
        return {name: path for name, path in super().files().items() if self.graph or name != "transfer"}

    def compute(self, session: Session) -> dict[str, Any]:
        """The texture, and its source coordinates."""
        resources, progress = session.resources, session.progress
        asked, wrap = self._asked_window(), (self.toroidal, self.toroidal)
        # limits are looked at now
        quality = Quality(op=self, resources=resources, progress=progress, wrap=wrap, copies=self.graph is None)
        plane = self.opened(resources, progress)
        first = plane.root.first
        level = plane.finest + plane.graph.depth() if self.level is None else self.level
        display, window = self._windows(first.spec, asked)
        around = self._around(level, display)
        in_step = self._in_step(plane, level, around, session)
        settings = plane.settings(seed=self.seed, lock=self.lock, around=around, around_level=level, in_step=in_step)
        maker = self.maker(plane, settings, resources)
        key = plane.key(settings, level) if self.resume or self.tiles else ""
        states = States(resources, maker, level, window, display or window, key if self.resume else "")
        spec = texture_spec(first.spec, states.display, states.place, self.toroidal)
        spec.attribute("oiiotex:level", level)
        spec.attribute(WINDOW, str(window))
        note(spec, "oiiotex:seed", settings.seed)
        if self.tiles:
            spec.attribute(PLANE, key)
        texture = Part(first.name, spec, lambda w: plane.pixels(states.read(w)), first.stored)
        results = {"texture": texture, **self._maps(plane, states, spec)}

        def source(window: Window) -> SourceMap:
            return SourceMap.of(*plane.source(states.read(window)).yx)

        copies = self.graph is None and level >= plane.finest  # of the one exemplar, as it is
        return with_report(quality, plane, results, source if copies else None)

    def _asked_window(self) -> Window | None:
        """What `window` says, inside of what `size` says; None where it says nothing."""
        if self.tiles and not _SHARE.fullmatch(self.tiles):
            raise ParameterError(parameter="tiles", value=self.tiles, expected="I/N, I from 1 to N")
        if not self.window:
            return None
        match = _WINDOW.fullmatch(self.window)
        if not match:
            expected = "WxH+X+Y, such as 1920x1080+0-400"
            raise ParameterError(parameter="window", value=self.window, expected=expected)
        width, height, left, top = map(int, match.groups())
        if max(width, height) > 1 << 30 or max(abs(left), abs(top)) > FARTHEST:
            expected = "sides up to 2^30 px, places up to 2^60 px away"
            raise ParameterError(parameter="window", value=self.window, expected=expected)
        window = Window.sized(left, top, width, height)
        if self.size is not None and window & Window(0, 0, *self.size) != window:
            raise ParameterError(parameter="window", value=self.window, expected=f"a window inside size={self.size}")
        return window

    def _windows(self, spec: oiio.ImageSpec, asked: Window | None) -> tuple[Window | None, Window]:
        """(what `size` says, the pixels that are made), both on the plane of the level.

        The share that `tiles` asks for is rows, so that shares are put together by pasting.
        """
        display = None if self.size is None else Window(0, 0, *self.size)
        window = asked or display or Window(0, 0, spec.width, spec.height)
        if not self.tiles:
            return display, window
        share, count = map(int, self.tiles.split("/"))
        if not 1 <= share <= count <= window.height:
            expected = f"I/N, I from 1 to N, N at most {window.height} rows"
            raise ParameterError(parameter="tiles", value=self.tiles, expected=expected)
        rows = (window.top + window.height * n // count for n in (share - 1, share))
        return display or window, Window(window.left, next(rows), window.right, next(rows))

    def _around(self, level: int, display: Window | None) -> tuple[int, int] | None:
        """After how many pixels of the level the plane repeats."""
        if not self.toroidal:
            return None
        if self.size is None or display is None:
            raise ParameterError(f"{modifier(toroidal=True)} requires size, after which the texture repeats")
        if any(n % (1 << level) for n in self.size):
            expected = f"multiples of {1 << level} px, for {modifier(toroidal=True)} on level {level}"
            raise ParameterError(parameter="size", value=self.size, expected=expected)
        return display.width, display.height

    def _in_step(self, plane: Plane, level: int, around: tuple[int, int] | None, session: Session) -> InStep | None:
        """What is kept of the lattice of the one exemplar, in px of its square; with lock or paper nothing."""
        if self.graph is not None or self.lock or self.paper:
            return None
        root = plane.exemplars[0]
        lattice = self.lattice_of(root.values, root.opaque, session.resources)
        if lattice is None or around is None:
            return self.in_step(lattice, Domain(root.side, root.side))
        zoom = 2.0 ** (level - plane.finest)  # pixels of the level in one of the square
        fitting_size(self.flag(), lattice.scaled(zoom, zoom), Size(*around), True, (True, True), 1 << level)
        width, height = (max(1, round(n / zoom)) for n in around)
        return self.in_step(lattice, Domain(width, height, True, True))

    def _maps(self, plane: Plane, states: States, texture: oiio.ImageSpec) -> dict[str, Part]:
        """The parts 'st' and, with a graph, 'transfer'."""
        of = np.array([exemplar for exemplar, _ in plane.analysis.stacks.levels.stacks])
        several = self.graph is not None

        def coordinates(window: Window) -> np.ndarray:
            source = plane.source(states.read(window))
            number = of[source.number]
            out = np.empty((*number.shape, 3 if several else 2), np.float32)
            for n, (given, exemplar) in enumerate(zip(plane.images, plane.exemplars, strict=True)):
                mine = number == n
                out[mine, :2] = source[mine].coordinates(given.first.spec, exemplar.place[:2], exemplar.factor)
            if several:
                out[..., 2] = number
            return out

        def transfers(window: Window) -> np.ndarray:
            offset = states.read(window).offset
            if offset is None:
                return np.zeros((window.height, window.width, 3), np.float32)
            return offset[..., :3] * np.float32(1 / FINE_STEPS)

        st = Part("st", _spec_of_map(texture, ("R", "G", "id") if several else ("R", "G")), coordinates)
        transfer = Part("transfer", _spec_of_map(texture, ("R", "G", "B")), transfers)
        return {"st": st, "transfer": transfer} if several else {"st": st}


def _spec_of_map(texture: oiio.ImageSpec, channels: tuple[str, ...]) -> oiio.ImageSpec:
    """Of floats where the texture lies."""
    spec = spec_beside(texture, channels)
    spec.attribute(WINDOW, texture.get_string_attribute(WINDOW))
    return spec
