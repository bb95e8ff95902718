# SPDX-License-Identifier: Apache-2.0
"""--texplate: a clean plate of a shot, in which a region can be filled once for all frames."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, cast

from ..engine.color.lens import in_type
from ..engine.core.access import Whole
from ..engine.core.image import Image, Part, channels_of, derived_spec, dtype_of, from_pixels, spec_beside
from ..engine.core.op import Kind, Output, Plan, Space
from ..engine.core.parameters import image, param
from ..engine.core.window import Window
from ..engine.deferred import np
from ..engine.errors import ImageError, ParameterError
from ..engine.io.reading import read
from ..engine.session import Session
from ..engine.session.facts import Facts

if TYPE_CHECKING:
    from ..surfaces.motion.clean_plate import PlateLayout
    from ..surfaces.motion.frame_motion import Shot
    from ..surfaces.motion.tracking import SeenFrame

_COPIES = 5  # of a plate in memory while it is assembled: sum, result and the samples of a frame


@dataclass(frozen=True, kw_only=True)
class Plate(Whole):
    """Assemble a clean plate of a shot: the surface that an object hides, from all frames that show it.

    The motion of the surface is tracked around the region (a homography for each frame), or given by `motion`. The
    plate is parallel to the reference frame, and extends to what other frames show. Its resolution is that of the
    frame that shows the region largest. It has little grain, because it is a mean of frames.

    Pixels that no frame shows are transparent. Those that frames need are white in part 'region': fill them once with
    `fill`, then render the plate into every frame with `project`. All frames show the same fill, so it does not
    flicker, and each is resampled once.
    """

    example: ClassVar[str] = '>>> plate = filters.plate("photo.png")'
    name: ClassVar[str] = "plate"
    blends: ClassVar[bool] = True
    space: ClassVar[Space] = Space.ANY
    outputs: ClassVar[tuple[Output, ...]] = (
        Output(
            "plate",
            Kind.PIXELS,
            "The surface, in the frames' color space and type. Alpha is 0 where no frame shows it.",
        ),
        Output("region", Kind.MASK, "Pixels to fill: frames need them, and none shows them."),
        Output(
            "motionfile",
            Kind.ARRAYS,
            "Frames and their matrices, from frame to plate, for `project`.",
            asked_by="motionfile",
        ),
    )

    source: Image = image(help="Reference frame of the shot. The plate is parallel to it.")
    region: Image | None = image(None, help="Mask of the reference frame. White is replaced, in all frames.")
    frames: str | None = param(
        None,
        unset="the reference frame alone",
        example="1001-1200",
        help="Frames of the shot, FIRST-LAST. The files of other frames, masks and motion images are found by the frame"
        " number in their names. A mask without a number is used for all frames.",
    )
    motion: Path | None = param(
        None,
        unset="tracked",
        example="st.1001.exr",
        help="Motion of the surface: the image for the reference frame, in the convention of `vectors`, or a file"
        " written by `motionfile`.",
    )
    vectors: str = param(
        "st",
        choices=("st", "backward", "forward"),
        help="Convention of `motion`. st: position in the reference frame, from 0 to 1; backward, forward: vectors in"
        " pixels to the previous or the next frame. Channels are s and t, backward.u and backward.v, or forward.u and"
        " forward.v, otherwise the first two.",
    )
    flip: bool = param(False, help="Read `motion` with t or v pointing up, as in Nuke and Blender.")
    motionfile: Path | None = param(
        None, example="shot.npz", help="File to write the motion of all frames to, for `project`."
    )

    def plan(self, facts: Facts) -> Plan:
        """The frames with their regions."""
        shown = self._frames()
        display = Window.display(self.source.first.spec)
        size, advice = display.width * display.height, "choose a shorter range of frames"
        held = size * (len(shown) + 4 * self.source.first.spec.nchannels)
        facts.require(held, "reading the frames", advice)
        if self.motion is not None:
            self._require_motion(self.motion, list(shown), facts)
        return Plan(work=shown)

    def make(self, plan: Plan, session: Session) -> dict[str, Any]:
        """The plate, the pixels to fill, and the motion."""
        from ..surfaces.motion.clean_plate import laid_out, region_points
        from ..surfaces.motion.frame_motion import stored

        shown, display = plan.work, Window.display(self.source.first.spec)
        given = next(iter(shown))
        regions = {number: region for number, (_, region) in self._read(shown, display)}
        if all(region.all() for region in regions.values()):
            raise ImageError(f"region covers every pixel of {self.source.source}: expected some surface around it")
        shot = self._motion(list(shown), regions, display, session)
        points = {number: region_points(region) for number, region in regions.items()}
        layout = laid_out(shot, points, display.size, given)
        results, grain = self._assembled(layout, shown, regions, display, session)
        saved = {n: replace(motion, grain=grain) for n, motion in layout.shot.items()}
        return {**results, "motionfile": lambda: stored(saved, layout.size)}

    def _frames(self) -> dict[int, tuple[str, str]]:
        """Files of the frame and of the region by number, the reference frame first; '': as on the stack."""
        from ..surfaces.motion.frame_files import files, frame_range, numbered

        number = numbered(self.source.source)
        if not self.frames:
            return {number or 0: ("", "")}
        numbers = frame_range(self.frames, number)
        given = cast(int, number)
        numbers.sort(key=lambda n: abs(n - given))
        pictures = files(self.source, numbers, given, "frame")
        if self.region is None:
            return {n: (pictures[n], "") for n in numbers}
        masks = files(self.region, numbers, given, "region", still=True)
        return {n: (pictures[n], masks[n]) for n in numbers}

    def _read(
        self, shown: dict[int, tuple[str, str]], display: Window
    ) -> Iterator[tuple[int, tuple[Part, np.ndarray]]]:
        """Each frame with its region, (h, w) bool."""
        from ..surfaces.motion.frame_files import covered

        for number, (picture, mask) in shown.items():
            part = read(picture).first if picture else self.source.first
            holder = read(mask) if mask else self.region
            if holder is None:
                region = np.zeros(display.size[::-1], bool)
            else:
                region = covered(holder.first, display, f"region {mask or holder.source}")
            yield number, (part, region)

    def _values(self, part: Part, number: int, display: Window) -> np.ndarray:
        from ..surfaces.motion.frame_files import values_of

        if part.spec.channelnames != self.source.first.spec.channelnames:
            names = ", ".join(part.spec.channelnames)
            raise ImageError(f"frame {number} has channels {names}: expected those of {self.source.source}")
        return values_of(part, display, f"frame {number}")

    def _require_motion(self, motion: Path, numbers: list[int], facts: Facts) -> None:
        """Refuse a motion that does not cover the frames."""
        from ..surfaces.motion.frame_motion import read_shot

        given = numbers[0]
        if motion.suffix.lower() == ".npz":
            missing = sorted(set(numbers) - set(read_shot(motion, facts.budget)))
            if missing:
                raise ImageError(f"{motion} contains no motion for frame {missing[0]}")
        elif self.vectors != "st" and given != (min if self.vectors == "backward" else max)(numbers):
            side = "first" if self.vectors == "backward" else "last"
            expected = f"a range with {given}, the reference frame, as its {side}: {self.vectors} vectors lead to it"
            raise ParameterError(parameter="frames", value=self.frames, expected=expected)

    def _motion(self, numbers: list[int], regions: dict[int, np.ndarray], display: Window, session: Session) -> Shot:
        """From each frame to a common plane."""
        from ..surfaces.motion.frame_files import siblings
        from ..surfaces.motion.frame_motion import FrameMotion, after, of_st_map, read_shot

        given = numbers[0]
        if self.motion is None:
            return self._tracked(numbers, regions, display, session)
        if self.motion.suffix.lower() == ".npz":
            saved = read_shot(self.motion, session.resources.budget)
            return {n: saved[n] for n in numbers}
        named = siblings(str(self.motion), numbers, given, "motion")
        shot: Shot = {}
        for before, number in zip([given, *numbers], numbers, strict=False):
            part, name = read(named[number]).first, f"motion {named[number]}"
            if (part.spec.width, part.spec.height) != display.size:
                size = f"{part.spec.width}x{part.spec.height}, but the frame is {display.width}x{display.height}"
                raise ImageError(f"{name} is {size}: expected the same size")
            if self.vectors == "st":
                shot[number] = of_st_map(part, self.flip, name)
            elif number == given:
                shot[number] = FrameMotion(np.eye(3))
            else:
                shot[number] = after(shot[before], part, self.vectors, self.flip, name)
        return shot

    def _tracked(self, numbers: list[int], regions: dict[int, np.ndarray], display: Window, session: Session) -> Shot:
        """The motion tracked from the reference frame, forward and backward in time."""
        from ..surfaces.motion.frame_motion import FrameMotion
        from ..surfaces.motion.tracking import SeenFrame, gray_view, surroundings, tracked

        if len(numbers) == 1:
            return {numbers[0]: FrameMotion(np.eye(3))}
        shot: Shot = {}
        shown = self._frames()
        colors = list(channels_of(self.source.first.spec).color)

        def views(order: list[int]) -> Iterator[SeenFrame]:
            for number in order:
                part = read(shown[number][0]).first
                values = self._values(part, number, display)[..., colors]
                yield SeenFrame(number, gray_view(values), surroundings(regions[number]))

        for order in (
            sorted(n for n in numbers if n >= numbers[0]),
            sorted((n for n in numbers if n <= numbers[0]), reverse=True),
        ):
            if len(order) > 1:
                for number, motion in tracked(views(order)):
                    shot[number] = motion
                    session.progress.advance(len(shot), 2 * len(numbers))
        return shot

    def _assembled(
        self,
        layout: PlateLayout,
        shown: dict[int, tuple[str, str]],
        regions: dict[int, np.ndarray],
        display: Window,
        session: Session,
    ) -> tuple[dict[str, Part], np.ndarray | None]:
        """The plate with the pixels to fill, and the grain of the shot."""
        from ..surfaces.motion.clean_plate import assembled

        first, window = self.source.first, Window(0, 0, *layout.size)
        need = _COPIES * 4 * (first.spec.nchannels + 2) * window.width * window.height
        need += sum(region.nbytes for region in regions.values())
        session.resources.require(
            need, f"a plate of {window.width}x{window.height} px", "choose a shorter range of frames"
        )
        frames = ((n, self._values(part, n, display), regions[n]) for n, (part, _) in self._read(shown, display))
        colors, count = channels_of(first.spec), len(shown)
        matched = max(colors.color, default=-1) + 1 if colors.alpha is None or colors.alpha > max(colors.color) else 0
        values, known, hole, grain = assembled(
            layout, frames, matched, lambda n: session.progress.advance(count + n, 2 * count)
        )
        spec = window.apply_to(derived_spec(first.spec))
        window.show_in(spec)
        spec.attribute("oiiotex:scale", float(layout.scale))
        values[~known] = 0
        if colors.alpha is None and not known.all():
            values = np.concatenate([values, known[..., None]], 2, dtype=np.float32)
            spec.nchannels, spec.alpha_channel = spec.nchannels + 1, spec.nchannels
            spec.channelnames = (*first.spec.channelnames, "A")
            if spec.channelformats:
                spec.channelformats = ()
        made = from_pixels(first.name, in_type(values, np.dtype(dtype_of(spec))), spec, first.stored)
        need_fill = from_pixels("region", hole[..., None].astype(np.float32), spec_beside(spec, ("Y",)))
        self.inform("%d x %d px, %d of them to fill", *window.size, np.count_nonzero(hole))
        return {"plate": made, "region": need_fill}, grain
