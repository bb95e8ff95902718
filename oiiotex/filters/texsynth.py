# SPDX-License-Identifier: Apache-2.0
"""--texsynth: any window, at any zoom, of an unbounded texture (HRRG08; Lefebvre & Hoppe 2005)."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

from ..analysis.regularity.courses import Courses
from ..analysis.regularity.lattice import Lattice
from ..engine.color.lab_grid import FINE_STEPS
from ..engine.core.attributes import WINDOW, note
from ..engine.core.image import Part, spec_beside
from ..engine.core.op import Kind, Output, Plan, no_pixels
from ..engine.core.parameters import Size, param
from ..engine.core.source_map import ST, SourceMap
from ..engine.core.window import Domain, Window
from ..engine.deferred import np, oiio
from ..engine.errors import ParameterError, modifier
from ..engine.session import Session
from ..engine.session.facts import Facts
from ..engine.session.resources import Resources
from ..synthesis.exemplar.exemplar_op import ExemplarPixels
from ..synthesis.exemplar.first_result import say_fidelity
from ..synthesis.exemplar.flattened import Flattened
from ..synthesis.exemplar.photo_lattice import Structured, fitting_size
from ..synthesis.multiscale.graph import Graph
from ..synthesis.multiscale.infinite_plane import Plane, States, analysis_folder, in_file
from ..synthesis.multiscale.judged_quilt import best_quilt
from ..synthesis.multiscale.multiscale_op import FARTHEST, Multiscale, texture_spec, with_report
from ..synthesis.multiscale.plane_quilt import LEAST_PATCH, OCTAVES, PlaneQuilt, period_of
from ..synthesis.multiscale.plane_quilt import quilted as quilt_of
from ..synthesis.multiscale.synthesizer import MOST_LEVEL, PlaneSettings, Synthesizer
from ..synthesis.quality.report import REPORT, Quality
from ..synthesis.quilting.quilt_plan import Grid

_WINDOW = re.compile(r"([1-9]\d*)x([1-9]\d*)([+-]\d+)([+-]\d+)", re.ASCII)


@dataclass(frozen=True, kw_only=True)
class Synth(Multiscale, Structured, Flattened):
    """Synthesize an unbounded texture from one exemplar, or from a graph of exemplars at different scales.

    Without `graph`, a texture of any size is synthesized from the top image (Lefebvre & Hoppe, Parallel controllable
    texture synthesis, 2005). With `graph`, several small exemplars at different scales are combined. Any window at any
    level of detail can be computed alone, and has the same pixels as in the whole texture (HRRG08: Han, Risser,
    Ramamoorthi, Grinspun, Multiscale Texture Synthesis, 2008).

    A single photo is read as a whole up to 512 px, and the texture is laid from patches of it that keep its objects
    whole. Exemplars of a graph are cropped to centered squares with a power-of-two side. One that does not tile is
    mirrored at its borders. Every pixel is a copy of an exemplar's pixel, plus a color offset where exemplars of a
    graph differ. The gradients and stains of a single photo are removed first.
    """

    example: ClassVar[str] = '>>> texture = filters.synth("photo.png", size=(1024, 512), seed=7)'
    name: ClassVar[str] = "synth"
    copies: ClassVar[bool] = True  # of the single exemplar; a graph has no single source
    outputs: ClassVar[tuple[Output, ...]] = (
        Output(
            "texture",
            Kind.PIXELS,
            "Pixels copied from the exemplars, all channels, in the root's color space and type.",
        ),
        replace(ST, help="Source coordinates of every pixel, for `warp`; with graph, also the exemplar's number."),
        Output(
            "transfer",
            Kind.COORDINATES,
            "Color offset added to each copied pixel: L, a and b of CIE Lab in R, G and B. Only with graph.",
            asked_by="st",
        ),
        REPORT,
    )

    size: Size | None = param(
        None, ge=1, le=1 << 30, unit="px", unset="size of window, otherwise of the exemplar", help="Size of the result."
    )
    window: str | None = param(
        None, example="1920x1080+0-400", help="Window of the unbounded plane to compute, as WxH+X+Y."
    )
    lod: int | None = param(
        None,
        example="2",
        ge=0,
        le=MOST_LEVEL,
        unset="finest level of the exemplars",
        help="Resolution. At level N, the root exemplar (without `graph`, the photo) is 2^N pixels wide. Reduce it"
        " for a preview.",
    )
    tiles: str = param(
        "none",
        choices=("none", "xy"),
        help="Axes along which the result tiles. xy requires size, with sides that are multiples of 8 px or,"
        " with graph, jitter, keeplayout or paper, of 2^lod px.",
    )
    resume: bool = param(
        False,
        advanced=True,
        help="Save a checkpoint after each finished piece next to the output, in the folder OUTPUT.parts. Run the"
        " same command again to resume.",
    )
    st: bool | Path = param(
        False,
        example="st.exr",
        advanced=True,
        help="Source coordinates of every pixel. 1: append them as parts; a file name: write them to that file.",
    )

    @property
    def most_side(self) -> int:
        """As `Multiscale.most_side`, and more of a single photo, so that its places repeat less often."""
        return self.exemplarside or (256 if self.graph or self.paper else 512)

    def single(self, name: str) -> Graph:
        """A graph of one exemplar without edges."""
        return Graph.single(name)

    def files(self) -> dict[str, Path]:
        """Output files; without graph there is no transfer."""
        return {name: path for name, path in super().files().items() if self.graph or name != "transfer"}

    def plan(self, facts: Facts) -> Plan:
        """The texture and its maps without pixels, the measures, the windows on the plane, and the exemplars."""
        asked, wrap = self._asked_window(), (self.tiles == "xy",) * 2
        alone = self.graph is None
        quality = Quality(op=self, facts=facts, wrap=wrap, copies=alone, judged=alone and self.lod is None)
        graph, images = self.exemplars(facts)
        root = images[graph.root].first
        display, window = self._windows(root.spec, asked)
        place, shown = in_file(window, display or window)
        spec = texture_spec(root.spec, shown, place, self.tiles)
        spec.attribute(WINDOW, str(window))
        channels = {"st": ("R", "G")} if self.graph is None else {"st": ("R", "G", "id"), "transfer": ("R", "G", "B")}
        maps = {name: Part(name, _spec_of_map(spec, of), no_pixels) for name, of in channels.items()}
        texture = Part(root.name, spec, no_pixels, root.stored)
        return Plan({"texture": texture, **maps}, (display, window, quality, graph, images))

    def make(self, plan: Plan, session: Session) -> dict[str, Any]:
        """The texture and its source coordinates."""
        resources, progress = session.resources, session.progress
        display, window, quality, graph, images = plan.work
        quality = quality.during(resources, progress)
        own, excluded = images, None
        if self.graph is None:
            flat, excluded = self.flattened(images[0], not (self.paper or self.keeplayout), resources)
            images = (flat,)
        plane = self.opened(graph, images, resources, progress, excluded)
        original = plane.root_lab(own[graph.root], self.working_space, resources)
        level = plane.finest + plane.graph.depth() if self.lod is None else self.lod
        around = self._around(level, display, plane.finest)
        how: dict[str, Any] = {"seed": self.seed, "lock": self.keeplayout, "jitter": self.jitter}
        settings = plane.settings(**how, around=around, around_level=level)
        if self.quilted:
            settings = self._quilted(plane, settings, original, session)
        maker = self.maker(plane, settings, resources)
        key = plane.key(settings, level) if self.resume else ""
        states = States(resources, maker, level, window, display or window, key)

        def describe(spec: oiio.ImageSpec) -> None:
            spec.attribute("oiiotex:level", level)
            note(spec, "oiiotex:seed", settings.seed)

        texture = replace(plan.results["texture"].respecced(describe), fetch=lambda w: plane.pixels(states.read(w)))
        results = {"texture": texture, **self._maps(plane, states, plan.results)}

        def source(window: Window) -> SourceMap:
            return SourceMap.of(*plane.source(states.read(window)).yx)

        if self.graph is not None:
            self.inform("not judged: the exemplars differ in scale, so that no single photo explains the result")
        copies = self.graph is None and level >= plane.finest  # of the single exemplar, unchanged
        return with_report(quality, plane, results, source if copies else None, original)

    @property
    def quilted(self) -> bool:
        """Whether the plane starts from patches of the photo."""
        return self.graph is None and self.jitter is None and not self.keeplayout and not self.paper

    def _quilted(self, plane: Plane, settings: PlaneSettings, original: np.ndarray, session: Session) -> PlaneSettings:
        """The settings with patches that keep the photo's objects whole; warns if none do."""
        resources, root = session.resources, plane.exemplars[0]
        structure, period = self._structure(plane, settings, resources)

        def quilted(patch: int) -> PlaneQuilt:
            grid = Grid(*period, True, True, patch=patch, overlap=max(1, patch // 4))
            in_step = self.kept_structure(structure, grid, settings.seed)
            return quilt_of(resources.device, resources.budget, root, grid, settings.seed, in_step)

        def maker(one: PlaneSettings) -> Synthesizer:
            return self.maker(plane, one, resources)

        with resources.stats.time("quilt"):
            strength = self.lattice if structure else 0.0
            best, kept, patches = best_quilt(
                self.flag(), plane, settings, period, strength, original, quilted, maker, analysis_folder()
            )
        say_fidelity(self.flag(), kept, patches, warn=True)
        return best

    def _structure(
        self, plane: Plane, settings: PlaneSettings, resources: Resources
    ) -> tuple[Lattice | Courses | None, tuple[int, int]]:
        """The lattice or courses of the photo, and the period of the plane's start, px, on which they close."""
        root, around = plane.exemplars[0], settings.around
        usable = None if root.opaque is None else root.opaque[root.photo]
        pixels = ExemplarPixels(root.values[root.photo], usable, usable, "transparent pixels")
        structure = self.structure_of(pixels, resources)
        if around is None:
            width, height = period_of(root.side, None)
            if isinstance(structure, Lattice):
                width, height = structure.fitting(Domain(width, height, True, True), 1 << OCTAVES)
            return structure, (width, height)
        zoom = 2.0 ** (plane.finest - settings.around_level)  # pixels of the photo for each of the level
        width, height = (round(n * zoom) for n in around)
        fitting_size(self.flag(), structure, Size(width, height), True, (True, True), 1 << OCTAVES)
        return structure, period_of(root.side, (width, height))

    def _asked_window(self) -> Window | None:
        """The value of `window`, which must lie inside `size`; None if not given."""
        if not self.window:
            return None
        match = _WINDOW.fullmatch(self.window)
        if not match:
            expected = "WxH+X+Y, such as 1920x1080+0-400"
            raise ParameterError(parameter="window", value=self.window, expected=expected)
        width, height, left, top = map(int, match.groups())
        if max(width, height) > 1 << 30 or max(abs(left), abs(top)) > FARTHEST:
            expected = "sides up to 2^30 px, offsets up to 2^60 px"
            raise ParameterError(parameter="window", value=self.window, expected=expected)
        window = Window.sized(left, top, width, height)
        if self.size is not None and window & Window(0, 0, *self.size) != window:
            raise ParameterError(parameter="window", value=self.window, expected=f"a window inside size={self.size}")
        return window

    def _windows(self, spec: oiio.ImageSpec, asked: Window | None) -> tuple[Window | None, Window]:
        """(display window by `size`, pixels to compute), both on the plane of the level."""
        display = None if self.size is None else Window(0, 0, *self.size)
        window = asked or display or Window(0, 0, spec.width, spec.height)
        return display, window

    def _around(self, level: int, display: Window | None, finest: int) -> tuple[int, int] | None:
        """Period of the plane, in pixels of the level."""
        if self.tiles == "none":
            return None
        if self.size is None or display is None:
            raise ParameterError(f"{modifier(tiles='xy')} requires size, the period of the texture")
        multiple = LEAST_PATCH << max(0, level - finest) if self.quilted else 1 << level
        if any(n % multiple for n in self.size):
            expected = f"multiples of {multiple} px, for {modifier(tiles='xy')} on level {level}"
            raise ParameterError(parameter="size", value=self.size, expected=expected)
        return display.width, display.height

    def _maps(self, plane: Plane, states: States, planned: dict[str, Part]) -> dict[str, Part]:
        """The parts 'st' and, with a graph, 'transfer'."""
        of = np.array([exemplar for exemplar, _ in plane.analysis.stacks.levels.stacks])
        several = self.graph is not None

        def coordinates(window: Window) -> np.ndarray:
            source = plane.source(states.read(window))
            number = of[source.number]
            out = np.empty((*number.shape, 3 if several else 2), np.float32)
            for n, (image, exemplar) in enumerate(zip(plane.images, plane.exemplars, strict=True)):
                mine = number == n
                out[mine, :2] = source[mine].coordinates(image.first.spec, exemplar.place[:2], exemplar.factor)
            if several:
                out[..., 2] = number
            return out

        def transfers(window: Window) -> np.ndarray:
            offset = states.read(window).offset
            if offset is None:
                return np.zeros((window.height, window.width, 3), np.float32)
            return offset[..., :3] * np.float32(1 / FINE_STEPS)

        fetches = {"st": coordinates, "transfer": transfers}
        return {name: replace(part, fetch=fetches[name]) for name, part in planned.items() if name in fetches}


def _spec_of_map(texture: oiio.ImageSpec, channels: tuple[str, ...]) -> oiio.ImageSpec:
    """A float spec with the windows of the texture."""
    spec = spec_beside(texture, channels)
    spec.attribute(WINDOW, texture.get_string_attribute(WINDOW))
    return spec
