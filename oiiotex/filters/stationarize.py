# SPDX-License-Identifier: Apache-2.0
"""--texstationarize and its baseline --texpatchmatch: MJH17."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import OpenImageIO as oiio

from ..color import working_values
from ..errors import ParameterError
from ..images import Image, Part, derived_spec
from ..op import Op, Output, Reach, Space
from ..params import Size, image, param
from ..session import Session
from ..synthesis.patchmatch import unpack
from ..synthesis.stationarize import Recipe, synthesize
from ..windows import Window
from ..writing import write
from .measures import MEASURE, MEASURES, ORDER, order_of
from .sources import LABEL, LABELS, LEVEL, MASK, both, ruled_out, say_what_stays, source_pixels
from .tilereport import report

_PATCHES = tuple(range(5, 23, 2))
_ST = Output(
    "st", "where every pixel comes from: 32-bit float source coordinates, as --texwarp and --st_warp read them"
)


@dataclass(frozen=True, kw_only=True)
class _PatchSynthesis(Op):
    """What both ops share: inputs, how a recipe becomes an image, the report."""

    copies: ClassVar[bool] = True
    reach: ClassVar[Reach] = Reach.GLOBAL
    space: ClassVar[Space] = Space.LAB
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("tile", "pixels copied from the photo, all channels together, in its own colour space and type"),
        _ST,
    )

    exemplar: Image = image(help="the photo")
    mask: Image | None = image(None, help=MASK)
    labels: Image | None = image(None, help=LABELS)
    label: int | None = param(None, ge=1, help=LABEL)
    level: int | None = param(None, ge=1, help=LEVEL)
    size: Size | None = param(None, ge=5, le=65536, unit="px", help="of the result; the exemplar's own when left out")
    tile: str = param("xy", choices=("xy", "x", "y", "none"), help="along which axes the result tiles")
    patch: int = param(
        11, choices=_PATCHES, unit="px", help="side of a patch: the scale up to which detail is copied whole"
    )
    iterations: int = param(30, ge=1, le=1000, help="on the coarsest level; each finer one has 3")
    seed: int = param(0, ge=0, le=2**32 - 1, help="same seed, same pixels")
    uniformity: float = param(
        0.01,
        ge=0,
        le=1,
        help="how strongly the use of all parts of the exemplar is evened out; above 0.1 it costs coherence",
    )
    stmap: bool | Path = param(False, help="1: source coordinates as part 'st' of the result; a file name: there")
    data: bool = param(False, help="the channels are no colours: compare them as they are")

    def recipe(self, width: int, height: int) -> Recipe:
        """What to synthesize at this size."""
        raise NotImplementedError

    def _recipe(self, width: int, height: int, sigma: float | None, contrast: float, flat: bool) -> Recipe:
        return Recipe(
            width=width,
            height=height,
            wrap_x="x" in self.tile,
            wrap_y="y" in self.tile,
            # twice the tile is a flat window already
            sigma=None if sigma is None else min(sigma, 2.0 * max(width, height)),
            patch=self.patch,
            iterations=self.iterations,
            seed=self.seed,
            uniformity=self.uniformity,
            contrast=contrast,
            flat=flat,
        )

    def compute(self, session: Session) -> Image:
        """The tile, followed by the part 'st' where it is asked for."""
        refuse_overwriting(self.exemplar, stmap=self.stmap)
        source = self.exemplar.first
        width, height = self.size or Size(source.spec.width, source.spec.height)
        with session.stats.time("read and colour"):
            working = working_values(self.exemplar, None if self.data else session.color, session.autocc)
            pixels = source.pixels()
            allowed = source_pixels(self.exemplar, self.mask, self.labels, self.level, self.label)
        device = session.device
        recipe = self.recipe(width, height)
        made = synthesize(
            device,
            working.values,
            both(working.opaque, allowed),
            recipe,
            session.budget - pixels.nbytes,
            session.advance,
            ruled_out(working.opaque, allowed),
        )
        device.collect(session.stats)
        if session.measure:
            with session.stats.time("measure"):
                report(self.flag(), working, made, recipe, session)
        return tile_image(self, self.exemplar, pixels, made.source, session)


@dataclass(frozen=True, kw_only=True)
class Stationarize(_PatchSynthesis):
    """Turn a photo into a texture that tiles without visible repetition.

    Gradients of light, stains and other slow drift repeat visibly when a photo is tiled. This filter synthesizes the
    photo anew from its own patches while it makes local histograms the same everywhere above a scale sigma (MJH17:
    Moritz, James, Haines, Ritschel, Weyrich, Texture Stationarization, Eurographics 2017). Every pixel of the
    result is a copy of one pixel of the photo.
    """

    name: ClassVar[str] = "stationarize"

    sigma: float | None = param(
        None,
        ge=0.5,
        le=1e6,
        unit="px",
        help="scale above which the texture must look the same everywhere; longer side / 32 when left out",
    )
    contrast: float = param(
        0.7, ge=0, le=1, help="how strongly the overall histogram is held to the target's; 0: not at all"
    )
    target: str = param(
        "flat",
        choices=("flat", "exemplar"),
        help="the histogram that contrast holds to: that of the photo made stationary, or (as in the paper, fading out"
        " over the coarsest level) of the photo",
    )

    measure: str = param("histogram", choices=MEASURES, help=MEASURE)
    order: int | None = param(None, ge=2, le=4, help=ORDER)

    def recipe(self, width: int, height: int) -> Recipe:
        """MJH17 by the measure that was asked for."""
        order = order_of(self.measure, self.order)
        sigma = self.sigma or max(width, height) / 32
        plain = self._recipe(width, height, sigma, self.contrast, self.target == "flat")
        return replace(plain, measure=self.measure, order=order)


@dataclass(frozen=True, kw_only=True)
class PatchMatch(_PatchSynthesis):
    """The photo synthesized anew by PatchMatch alone: the paper's baselines (MJH17 section 5.2).

    The same as --texstationarize without its projection. `tile=xy` is toroidal PatchMatch, `tile=none` the plain one.
    """

    name: ClassVar[str] = "patchmatch"

    contrast: float = param(
        1.0, ge=0, le=1, help="how strongly the histogram is held to the photo's at first; it fades out"
    )

    def recipe(self, width: int, height: int) -> Recipe:
        """MJH17 without stationarity."""
        return self._recipe(width, height, None, self.contrast, False)


def refuse_overwriting(exemplar: Image, *paths: object, **named: object) -> None:
    """Refuse a file of ours that is the photo itself; it is called by its modifier where that is given."""
    for path, said in (*((p, f"{p}") for p in paths), *((p, f"{name}={p}") for name, p in named.items())):
        if isinstance(path, Path) and os.path.realpath(path) == os.path.realpath(exemplar.source):
            raise ParameterError(f"{said} would overwrite the photo")


def tile_image(op: Op, exemplar: Image, pixels: np.ndarray, places: np.ndarray, session: Session) -> Image:
    """The exemplar's pixels at packed places (y << 16 | x), whole; `op.stmap` asks for the places themselves."""
    source, whole = exemplar.first, Window(0, 0, places.shape[1], places.shape[0])

    def copied(window: Window) -> np.ndarray:
        return pixels[unpack(places[window.inside(whole)])]

    def coordinates(window: Window) -> np.ndarray:
        return source_coordinates(*unpack(places[window.inside(whole)]), source.spec)

    size = whole.width, whole.height
    tile = Part(source.name, tile_spec(source.spec, op, *size), copied, source.spec.format, ready=True)
    st = Part("st", st_spec(*size), coordinates, oiio.TypeDesc(oiio.FLOAT), ready=True, exact=True)
    if isinstance(op.stmap, Path):
        write(Image((st,), str(op.stmap)), op.stmap, st.spec.format)
        session.written.add(os.path.realpath(op.stmap))
    say_what_stays(op)
    return Image((tile, st) if op.stmap is True else (tile,), exemplar.source)


def source_coordinates(y: np.ndarray, x: np.ndarray, spec: oiio.ImageSpec) -> np.ndarray:
    """Pixel indices in the data window -> (s, t) over the display window, (height, width, 2) float32.

    (0, 0) is the display window's top left corner and (1, 1) its bottom right, as --st_warp has it; pixel centres
    lie half a pixel in.
    """
    s = (x + spec.x - spec.full_x + 0.5) / spec.full_width
    t = (y + spec.y - spec.full_y + 0.5) / spec.full_height
    return np.stack([s, t], axis=-1).astype(np.float32)


def tile_spec(spec: oiio.ImageSpec, op: Op, width: int, height: int) -> oiio.ImageSpec:
    """Of a result that is copied from an image with that spec."""
    new = derived_spec(spec, width, height)
    new.attribute(
        "wrapmodes",
        ",".join("periodic" if a in getattr(op, "tile", "none").replace("none", "") else "black" for a in "xy"),
    )
    return new


def st_spec(width: int, height: int) -> oiio.ImageSpec:
    """Of a map of source coordinates."""
    spec = oiio.ImageSpec(width, height, 2, oiio.FLOAT)
    spec.channelnames = ("R", "G")
    spec.attribute("oiio:ColorSpace", "data")
    return spec
