# SPDX-License-Identifier: Apache-2.0
"""--texrectify: perspective correction of a photographed flat surface."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

from ..engine.color.config import as_float
from ..engine.color.lab import color_to_convert, working_values
from ..engine.color.lens import in_type, resampled
from ..engine.core.access import Gather
from ..engine.core.demand import materialized
from ..engine.core.image import Image, Part, derived_spec, dtype_of, pixels_of, spec_beside
from ..engine.core.op import Kind, Output, Plan, Space
from ..engine.core.parameters import Numbers, Size, image, param
from ..engine.core.source_map import STMAP
from ..engine.core.window import Window, warp_needs
from ..engine.deferred import np, oiio
from ..engine.errors import ImageError, ParameterError
from ..engine.session import Session
from ..engine.session.facts import Facts
from ..surfaces.capture.front_rectangle import FrontRectangle
from ..surfaces.capture.homography import aspect_of, homography, require_quadrangle, sides_of

_FILTER, _FILTER_WIDTH = "lanczos3", 6  # px
_INCH = 0.0254  # m
_CELL = 512  # px; side of a piece that is computed at once
_LARGEST = 65536  # px; limit of a size derived from corners


def _lines(facts: dict[str, Any]) -> Iterator[str]:
    """The rectangle as modifiers, to be reused for other maps of the photo."""
    corners = ",".join(f"{value:.10g}" for value in facts["corners"])
    yield f"corners={corners}:size={facts['width']}x{facts['height']}"
    if facts["cells"]:
        yield f"{facts['cells'][0]} x {facts['cells'][1]} cells of the lattice"
    if facts["meters"]:
        yield f"{facts['meters'][0]:g} x {facts['meters'][1]:g} m"


@dataclass(frozen=True, kw_only=True)
class Rectify(Gather):
    """Correct the perspective of a flat surface that was photographed obliquely.

    The four corners of a real rectangle become the corners of the result. The aspect ratio is derived from the
    perspective (Zhang and He 2007: uncropped photo) or from `meters`. The result has square pixels, also if the photo's
    PixelAspectRatio is not 1.

    Without `corners`, the lattice of a surface that repeats regularly in two directions (tiles, bricks, a weave) is
    detected and straightened. The result contains as many complete cells of the lattice as the photo, so it tiles along
    both axes. Without a lattice, the perspective that makes the texture the same everywhere (planks, shingles, cobbles,
    grass) is straightened, and the result contains most of the photo.

    With `meters`, the size of a pixel is stored in the metadata (XResolution, YResolution, ResolutionUnit), which all
    filters preserve. Stored values are filtered without conversion, and vectors in normal maps are not rotated.
    """

    example: ClassVar[str] = '>>> front = filters.rectify("photo.png", corners=(3, 2, 66, 5, 70, 60, 1, 62))'
    name: ClassVar[str] = "rectify"
    rescales: ClassVar[bool] = True
    blends: ClassVar[bool] = True
    space: ClassVar[Space] = Space.ANY
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("rectified", Kind.PIXELS, "Surface seen from the front, in the photo's color space and type."),
        Output(
            "st", Kind.COORDINATES, "Source coordinates of every pixel, with subpixel precision, for `st_warp`.",
            asked_by="st",
        ),
        Output("facts", Kind.TABLE, "Corners, size, cells, meters and matrix.", asked_by="facts", lines=_lines),
    )  # fmt: skip

    source: Image = image(help="Photo to rectify.")
    corners: Numbers | None = param(
        None, unit="px", unset="detected from the photo's lattice or texture", example="9,4,120,16,110,90,2,80",
        help="Corners as x,y of top left, top right, bottom right, bottom left, relative to the display window.",
    )  # fmt: skip
    size: Size | None = param(
        None,
        ge=1,
        le=_LARGEST,
        unit="px",
        unset="lengths of the longer sides in the photo",
        help="Size of the result.",
    )
    meters: Numbers | None = param(
        None,
        unit="m",
        ge=1e-9,
        le=1e9,
        example="1.2,0.8",
        help="Width and height, in meters, of the area between `corners`; without `corners`, of one cell of the"
        " lattice, such as a brick or a tile.",
    )
    st: bool | Path = param(False, help=STMAP, example="st.exr", advanced=True)
    facts: Path | None = param(
        None, example="rectangle.json", advanced=True, help="JSON file for corners, size, cells, meters and the matrix."
    )

    def plan(self, facts: Facts) -> Plan:
        """The rectified part, if its corners are given; otherwise its size depends on the photo."""
        if self.source.first.exact:
            raise ImageError(f"{self.source.source} contains ids or source coordinates, which cannot be resampled")
        if self.corners is None:
            self._meters(None)
            from ..surfaces.capture.front_rectangle import search_bytes  # only without corners

            spec, task = self.source.first.spec, "finding the perspective of the photo"
            facts.require(search_bytes(spec.width, spec.height), task, "set corners")
            color_to_convert(self.source, facts, Space.LAB)
            return Plan()
        if len(self.corners) != 8:
            expected = "eight numbers: x,y of four points"
            raise ParameterError(parameter="corners", value=self.corners, expected=expected)
        corners = np.array(self.corners, float).reshape(4, 2)
        require_quadrangle(corners)
        results = self._rectified(corners, None, facts)
        part, spec = self.source.first, results["rectified"].spec
        whole = Window.sized(0, 0, spec.width, spec.height)
        photo = part.window.shifted(-part.spec.full_x, -part.spec.full_y)
        if (warp_needs(np.linalg.inv(results["facts"]["matrix"]), whole, 0, photo) & photo).empty:
            expected = f"an area that the photo shows: x from {photo.left} to {photo.right}, y from {photo.top} to"
            raise ParameterError(parameter="corners", value=self.corners, expected=f"{expected} {photo.bottom}")
        return Plan(results)

    def make(self, plan: Plan, session: Session) -> dict[str, Any]:
        """The rectified first part; the photo is read ahead only to find its perspective."""
        if plan.results is not None:
            results: dict[str, Any] = plan.results
            return results
        found = self._found(session)
        return self._rectified(found.corners, found.cells, session.resources, found.size)

    def _rectified(
        self, corners: np.ndarray, cells: tuple[int, int] | None, facts: Facts, found: tuple[int, int] | None = None
    ) -> dict[str, Any]:
        part = self.source.first
        meters = self._meters(cells)
        square = self._pixel_aspect() == 1
        width, height = found if found and square and not self.size and not meters else self._size(corners, meters)
        matrix = homography(corners, width, height)
        spec = derived_spec(part.spec, width, height)
        for stale in ("XResolution", "YResolution", "ResolutionUnit", "PixelAspectRatio"):
            spec.erase_attribute(stale)
        if meters is not None:
            spec.attribute("XResolution", width * _INCH / meters[0])
            spec.attribute("YResolution", height * _INCH / meters[1])
            spec.attribute("ResolutionUnit", "in")  # the only unit of EXR
        geometry = {
            "corners": corners.ravel().tolist(), "width": width, "height": height, "cells": cells, "meters": meters,
            "matrix": matrix.tolist(),
        }  # fmt: skip
        rectified = Part(part.name, spec, self._seen(part, matrix, spec, facts), part.stored)
        return {"rectified": rectified, "st": _coordinates(matrix, part, spec), "facts": geometry}

    def _found(self, session: Session) -> FrontRectangle:
        """The rectangle that the photo's lattice or texture shows."""
        from ..surfaces.capture.front_rectangle import SIDE, front_rectangle  # only without corners

        spec = self.source.first.spec
        is_small = spec.width * spec.height <= SIDE * SIDE
        values, opaque = working_values(self.source, session.resources, in_memory=is_small)
        with session.resources.stats.time("lattice"):
            found = front_rectangle(values, opaque)
        if found is None:
            raise ImageError(
                "has no lattice at right angles, and its texture shows no perspective",
                subject=self.source.source,
                hint="set corners=x,y,x,y,x,y,x,y of a rectangle",
            )
        if found.cells is None and self.meters is not None:
            expected = "corners as well, because the photo has no lattice"
            raise ParameterError(parameter="meters", value=self.meters, expected=expected)
        return replace(found, corners=found.in_display(spec))  # as logged for other maps

    def _meters(self, cells: tuple[int, int] | None) -> tuple[float, float] | None:
        """Width and height of the result in the world."""
        if self.meters is None:
            return None
        if len(self.meters) != 2:
            expected = "two numbers: width,height in meters"
            raise ParameterError(parameter="meters", value=self.meters, expected=expected)
        across, down = cells or (1, 1)
        return self.meters[0] * across, self.meters[1] * down

    def _pixel_aspect(self) -> float:
        """Width over height of the photo's pixels; those of the result are square."""
        aspect: float = self.source.first.spec.get_float_attribute("PixelAspectRatio", 1.0)
        return aspect if aspect > 0 and np.isfinite(aspect) else 1.0

    def _size(self, corners: np.ndarray, meters: tuple[float, float] | None) -> tuple[int, int]:
        """Size of the result, px."""
        if self.size is not None:
            return self.size.width, self.size.height
        display = self.source.first.spec
        corners, high = corners * (self._pixel_aspect(), 1), display.full_height
        wide = display.full_width * self._pixel_aspect()
        aspect = meters[0] / meters[1] if meters else aspect_of(corners, (wide, high))
        across, down = sides_of(corners)
        width = max(across, down * aspect)
        found = max(1, round(width)), max(1, round(width / aspect))
        if max(found) > _LARGEST:
            raise ParameterError(
                f"the result would be {found[0]}x{found[1]} px: expected at most {_LARGEST} px a side", hint="set size"
            )
        return found

    def _seen(
        self, part: Part, matrix: np.ndarray, spec: oiio.ImageSpec, facts: Facts
    ) -> Callable[[Window], np.ndarray]:
        """A function that computes a window of the result."""
        # relative to the display window, so that its position does not affect rounding
        x, y = part.spec.full_x, part.spec.full_y
        photo = part.window.shifted(-x, -y)
        inverse = np.linalg.inv(matrix)
        values, dtype = tuple(float(v) for v in matrix.ravel()), np.dtype(dtype_of(spec))
        near = functools.cache(lambda: part if part.ready else materialized(part, facts.budget))

        def piece(window: Window) -> np.ndarray:
            wanted = warp_needs(inverse, window, _FILTER_WIDTH, photo) & photo
            if wanted.empty:
                return np.zeros((window.height, window.width, spec.nchannels), dtype)
            need = 8 * spec.nchannels * wanted.width * wanted.height
            if need > facts.budget // 2 and max(window.size) > 1:  # a small result shows much of a photo
                across = window.width >= window.height
                half = (-(-window.width // 2), window.height) if across else (window.width, -(-window.height // 2))
                return np.concatenate([piece(one) for one in window.cells(*half)], int(across))
            facts.require(need, self.flag())
            source = oiio.ImageBuf(_floats(wanted, part.spec))
            pixels = np.ascontiguousarray(as_float(near().read(wanted.shifted(x, y))))
            source.set_pixels(source.roi, pixels)
            target = oiio.ImageBuf(_floats(window, spec))
            roi = window.roi(spec.nchannels)
            oiio.ImageBufAlgo.warp(target, source, values, _FILTER, 0.0, False, "black", roi)
            return in_type(resampled(pixels_of(target, oiio.FLOAT, roi), pixels, self.source.source), dtype)

        def fetch(window: Window) -> np.ndarray:
            out = np.empty((window.height, window.width, spec.nchannels), dtype)
            for cell in window.cells(_CELL, _CELL):
                out[cell.inside(window)] = piece(cell)
            return out

        return fetch


def _floats(window: Window, like: oiio.ImageSpec) -> oiio.ImageSpec:
    """A float spec for that window, with the channels of another spec."""
    spec = oiio.ImageSpec(window.width, window.height, like.nchannels, oiio.FLOAT)
    spec.x, spec.y = window.left, window.top
    spec.channelnames, spec.alpha_channel = like.channelnames, like.alpha_channel
    return spec


def _coordinates(matrix: np.ndarray, part: Part, spec: oiio.ImageSpec) -> Part:
    """Part 'st': coordinates in the display window, 0 to 1 from its top left; pixel centers at halves."""
    inverse, full = np.linalg.inv(matrix), (part.spec.full_width, part.spec.full_height)

    def fetch(window: Window) -> np.ndarray:
        x = np.arange(window.left, window.right)[None] + 0.5
        y = np.arange(window.top, window.bottom)[:, None] + 0.5
        seen = x[..., None] * inverse[0] + y[..., None] * inverse[1] + inverse[2]
        return (seen[..., :2] / seen[..., 2:] / full).astype(np.float32)

    return Part("st", spec_beside(spec, ("R", "G")), fetch, ready=True)
