# SPDX-License-Identifier: Apache-2.0
"""--texcapture: the maps of a material from photos of one surface under several lights."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from ..engine.color.lab import color_to_convert, lens_of
from ..engine.color.lens import Lens
from ..engine.color.normal_maps import NORMALS
from ..engine.core.access import InBands
from ..engine.core.attributes import ESTIMATE, HEIGHT_PX
from ..engine.core.image import Image, Part, channels_of, derived_spec, measure_spec
from ..engine.core.op import Kind, Output, Plan, Space, no_pixels
from ..engine.core.parameters import Numbers, image, param
from ..engine.core.window import Window
from ..engine.deferred import np, oiio
from ..engine.errors import ImageError, ParameterError, present
from ..engine.session import Session
from ..engine.session.facts import Facts

if TYPE_CHECKING:
    from ..surfaces.capture.lights import Lights
    from ..surfaces.capture.photos import ReducedPhotos

_UNKNOWN = 6  # least number of photos without lights or a ball
_AGREED = 0.35  # share of the photos that the surface under found lights must explain: .5 to .8, .15 to .3 if wrong
_OVEREXPOSED = 0.05  # share of clipped pixels that is warned of


@dataclass(frozen=True, kw_only=True)
class Capture(InBands):
    """Capture the maps of a material from photos of one surface under several lights.

    Takes all images on the stack: photos by a fixed camera that faces the surface, with the light elsewhere in each.
    The results are an albedo, a normal map and a height map, as images in this order. `stationarize` takes them as one
    material: `kinds=color,normal,height`.

    Every pixel is fitted alone (photometric stereo, Woodham 1980). Photos in which it is a highlight or in shadow are
    excluded by reweighting. Wide highlights of a surface that mirrors 4 % are fitted with the normals if the lights are
    known, and else subtracted. Exposure and power of lights may differ from photo to photo: they are those for which
    the surface faces the camera on average. Heights are the surface closest to the normals (Simchony and others 1990).

    Directions of the lights come from a file, from a ball in the photos, or from the photos themselves. Photos alone do
    not tell how strong the relief is, nor whether it is raised or recessed: the lights are then taken to be 45 degrees
    high on average, and the first one to come from `light`.
    """

    example: ClassVar[str] = """\
>>> import OpenImageIO as oiio
>>> lights = [0, 1, 1, 1, -1, 1, -1, -1, 1]  # x, y and z of each; y is up, z is towards the camera
>>> photos = [oiio.ImageBufAlgo.mul(oiio.ImageBuf("photo.png"), share) for share in (0.3, 0.27, 0.27)]
>>> albedo, normal, height = filters.capture(*photos, lights=lights, colorspace="lin_rec709_scene")
"""
    name: ClassVar[str] = "capture"
    space: ClassVar[Space] = Space.LAB
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("albedo", Kind.PIXELS, "Albedo: 1 is what a white surface shows that faces a light."),
        Output("normal", Kind.MEASURE, "Normal map, encoded as 0 to 1."),
        Output("height", Kind.MEASURE, "Height map: one channel, 0 to 1, higher values are closer to the viewer."),
        Output(
            "roughness", Kind.MEASURE, "Roughness map: one channel, 0 (mirror) to 1 (matte).", asked_by="roughness"
        ),
    )  # fmt: skip

    photos: tuple[Image, ...] = image(help="Photos of one surface, 3 to 16, with the light elsewhere in each.")
    lights: Numbers | Path | None = param(
        None, example="lights.lp", unset="from the photos",
        help="Directions of the lights: x, y and z for each photo, to the right, up, and towards the camera. A file has"
        " a line `NAME X Y Z` for each photo (.lp), or lists of three numbers (.json).",
    )  # fmt: skip
    span: float | None = param(
        None, ge=1e-6, le=1e9, example="300", unset="far lights",
        help="Length that the longer side of the photos shows, in the unit of lights. With it, lights are positions"
        " relative to the middle of the surface, and their light falls off with the square of the distance.",
    )  # fmt: skip
    ball: str | None = param(
        None, example="200x200+40+60",
        help="Box WxH+X+Y around a ball in the photos, chrome or matte white, that shows the directions of the"
        " lights. It becomes a gap of the normals and heights.",
    )  # fmt: skip
    light: float = param(
        90.0, ge=-360, le=360, unit="degrees",
        help="Direction of the light in the first photo, counterclockwise from the right: 90 is above. Used if the"
        " lights are found from the photos. If raised and recessed parts are swapped, set it to the other side.",
    )  # fmt: skip
    strength: float = param(
        1.0, ge=0.01, le=100,
        help="Multiplier of heights and slopes. If the lights are found from the photos, set the tangent of their"
        " mean elevation.",
    )  # fmt: skip
    roughness: bool = param(
        False, help="Add a roughness map as the last image, from the width of highlights. Requires six photos."
    )
    normals: str = NORMALS
    data: bool = param(False, advanced=True, help="Treat the channels as linear light, not color.")

    @classmethod
    def arity(cls, values: dict[str, Any], depth: int) -> int:
        """All images on the stack."""
        return max(1, depth)

    def result_count(self) -> int:
        """The number of maps."""
        return 4 if self.roughness else 3

    def plan(self, facts: Facts) -> Plan:
        """The maps without pixels; lights and box of the ball, if they are given."""
        from ..surfaces.capture.captured import bytes_for
        from ..surfaces.capture.lights import ball_box, read_lights

        first, count = self.photos[0].first, len(self.photos)
        self._require_photos(facts)
        need = bytes_for(self.photos, self.roughness, facts.thread_count)
        facts.require(need, f"the maps of {count} photos of {first.spec.width}x{first.spec.height}")
        if self.lights is not None and self.ball is not None:
            raise ParameterError("conflicts with lights", parameter="ball", value=self.ball)
        box = None if self.ball is None else ball_box(self.ball, first.window)
        if self.span is not None and self.lights is None:
            raise ParameterError("requires lights", parameter="span", value=self.span)
        known = None if self.lights is None else read_lights(self.lights, [photo.source for photo in self.photos])
        if known is None and box is None and count < _UNKNOWN:
            expected = f"at least {_UNKNOWN} photos without lights or a ball"
            raise ImageError(f"{count} photos: {expected}", hint="set lights or ball")
        return Plan(tuple({name: part} for name, part in self._maps(first.spec).items()), (known, box))

    def make(self, plan: Plan, session: Session) -> tuple[dict[str, Part], ...]:
        """The maps; all of them are computed in one pass over the photos, after another one to find intensities."""
        from ..surfaces.capture.captured import captured
        from ..surfaces.capture.photos import reduced

        resources, (known, box) = session.resources, plan.work
        lenses = [self._lens(photo, session) for photo in self.photos]
        reading, fitting = session.progress.stages(1, 4)
        small = reduced(self.photos, lenses, resources, reading)
        self._warn_if_moved(small)
        lights = self._lit(known, box, small, lenses)
        maps = captured(self.photos, lenses, lights, box, self.strength, self.roughness, resources, fitting)
        for photo, share in zip(self.photos, maps.clipped, strict=True):
            if share > _OVEREXPOSED:
                self.warn("%.0f %% of %s is clipped: use a shorter exposure", 100 * share, photo.source)
        how = f"from {len(self.photos)} photos, lights {self._whence}"
        fetches, high = maps.fetches(self.normals == "directx")
        return tuple(
            {name: replace(part.respecced(_noting(name, how, high)), fetch=fetches[name], ready=True)}
            for one in plan.results
            for name, part in one.items()
        )

    @property
    def _whence(self) -> str:
        return "given" if self.lights is not None else "seen on a ball" if self.ball is not None else "found"

    def _lens(self, photo: Image, session: Session) -> Lens:
        """Color to Lab; data as they are, for the scales of several photos must not differ."""
        named = color_to_convert(photo, session.resources, self.working_space)
        return lens_of(photo, session.resources, Space.ANY if named is None else self.working_space)

    def _maps(self, spec: oiio.ImageSpec) -> dict[str, Part]:
        """The maps without pixels."""
        channels = {"normal": ("R", "G", "B"), "height": ("Y",)} | ({"roughness": ("Y",)} if self.roughness else {})
        albedo = Part(self.photos[0].first.name, derived_spec(spec), no_pixels, self.photos[0].first.stored)
        return {"albedo": albedo} | {
            name: Part(name, measure_spec(spec, names), no_pixels) for name, names in channels.items()
        }

    def _require_photos(self, facts: Facts) -> None:
        """Refuse photos that are not several of one size and kind."""
        from ..surfaces.capture import lobes
        from ..surfaces.capture.photometric import FEWEST, MOST

        count, first = len(self.photos), self.photos[0]
        if not FEWEST <= count <= MOST:
            raise ImageError(f"{count} photo{'s' * (count != 1)}: expected {FEWEST} to {MOST} of one surface")
        if self.roughness and count < lobes.FEWEST:
            raise ParameterError("requires six photos", parameter="roughness", value=True)
        spaces = [color_to_convert(photo, facts, self.working_space) is None for photo in self.photos]
        for photo, is_data in zip(self.photos, spaces, strict=True):
            if photo.first.window != first.first.window:
                size, wanted = (f"{one.first.spec.width}x{one.first.spec.height}" for one in (photo, first))
                problem = f"is {size}" if size != wanted else "has another data window"
                raise ImageError(f"{problem}: expected {wanted}, as {first.source}", subject=photo.source)
            if is_data != spaces[0]:
                raise ImageError(f"is {'data' if is_data else 'color'}, unlike {first.source}", subject=photo.source)
            if len(channels_of(photo.first.spec).color) != len(channels_of(first.first.spec).color):
                raise ImageError(f"has other channels than {first.source}", subject=photo.source)

    def _warn_if_moved(self, small: ReducedPhotos) -> None:
        """Warn if the camera moved; one photo alone may show a lattice a period further."""
        from ..surfaces.capture.alignment import moved_photos

        moved = moved_photos(small.luminance)
        if len(moved) > max(1, len(self.photos) // 4):
            names = ", ".join(self.photos[n].source for n in moved)
            self.warn("the camera moved: %s show the surface elsewhere; fix it on a tripod", names)

    def _lit(self, known: np.ndarray | None, box: Window | None, small: ReducedPhotos, lenses: list[Lens]) -> Lights:
        """The lights with their intensities."""
        from ..surfaces.capture.found_lights import found_directions, with_intensities
        from ..surfaces.capture.lights import Lights, on_ball, require_lights
        from ..surfaces.capture.photos import luminance_of

        first = self.photos[0].first.window
        middle = first.left + first.width / 2, first.top + first.height / 2
        surface = small.without(box)
        if known is None and box is not None:
            known = np.stack([on_ball(luminance_of(*one, box)) for one in zip(self.photos, lenses, strict=True)])
            require_lights(known, "ball")
        elif known is None:
            known = found_directions(surface.luminance, self.light)
            if known is None:
                raise ImageError("the photos do not tell where the lights are", hint="set lights or ball")
        unit = None if self.span is None else self.span / max(first.size)
        lights = Lights(known, unit, middle, known=self._whence != "found")
        lights, agreed = with_intensities(lights, *surface.samples())
        if self._whence == "found" and agreed < _AGREED:
            problem = f"the photos agree with one surface in {100 * agreed:.0f} % of their pixels only"
            raise ImageError(problem, hint="set lights or ball: highlights are too wide to find the lights")
        for photo, toward, power in zip(self.photos, lights.directions, present(lights.intensities), strict=True):
            azimuth, elevation = np.degrees([np.arctan2(toward[1], toward[0]), np.arcsin(toward[2])])
            self.inform("%s: light at %.0f, %.0f degrees high, x %.2f", photo.source, azimuth, elevation, power)
        if self._whence == "found":
            self.inform("strength of the relief, and what is raised, are not in the photos: see strength and light")
        return lights


def _noting(name: str, how: str, high: float) -> Callable[[oiio.ImageSpec], None]:
    """What the spec of a map says of its origin and scale."""

    def note(spec: oiio.ImageSpec) -> None:
        spec.attribute(ESTIMATE, f"{name} {how}")
        if name == "height":
            spec.attribute(HEIGHT_PX, high)

    return note
