# SPDX-License-Identifier: Apache-2.0
"""Tiles: images that repeat, by their metadata `wrapmodes` (x, then y), and their pixels beyond the border.

An image tiles along an axis if `wrapmodes` says `periodic` and its data window spans the display window. Axes are
written as in `tiled`: x, y, xy or none.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from ..deferred import oiio
from .demand import on_a_torus
from .image import Part
from .parameters import param
from .window import Window

_TAG = "wrapmodes"
_FAR = 1 << 24  # px; nothing is read farther beyond the border
TILED = param(
    None,
    choices=("none", "x", "y", "xy", None),
    unset="those that the image's wrapmodes call periodic",
    example="xy",
    help="Axes along which the image tiles. The result then tiles along the same axes.",
)


def tiling_of(spec: oiio.ImageSpec) -> str:
    """Axes along which an image with this spec tiles."""
    data, display = Window.data(spec), Window.display(spec)
    spans = {"x": (data.left, data.right) == (display.left, display.right)}
    spans["y"] = (data.top, data.bottom) == (display.top, display.bottom)
    return _axes(axis for axis in _tagged(spec) if spans.get(axis))


def shared_tiling(specs: Iterable[oiio.ImageSpec]) -> str:
    """Axes along which all images with these specs tile."""
    tilings = [tiling_of(spec) for spec in specs]
    return _axes(axis for axis in "xy" if tilings and all(axis in tiling for tiling in tilings))


def tiled_spec(spec: oiio.ImageSpec, axes: str) -> oiio.ImageSpec:
    """A copy of a spec with periodic `wrapmodes` along these axes, if its windows allow it; without any along none."""
    new = oiio.ImageSpec(spec)
    new.attribute(_TAG, ",".join("periodic" if axis in axes else "black" for axis in "xy"))
    if tiling_of(new) == "none":
        new.erase_attribute(_TAG)
    return new


def retiled(part: Part, axes: str) -> Part:
    """The part, tagged as tiling along these axes and no others."""
    return (
        part if _tagged(part.spec) == axes == tiling_of(part.spec) else replace(part, spec=tiled_spec(part.spec, axes))
    )


def repeated(part: Part, axes: str | None = None) -> Part:
    """The part, repeated beyond its data window along some axes; by default those that it tiles along."""
    axes = tiling_of(part.spec) if axes is None else axes
    if axes == "none" or part.spec.deep:
        return part
    plane = part.window.grown(_FAR * ("x" in axes), _FAR * ("y" in axes))
    spec = plane.apply_to(part.spec)
    return replace(part, spec=spec, fetch=lambda window: on_a_torus(part, window), levels=())


def _tagged(spec: oiio.ImageSpec) -> str:
    """The axes that `wrapmodes` calls periodic."""
    modes = spec.get_string_attribute(_TAG).split(",")
    return _axes(axis for axis, mode in zip("xy", modes, strict=False) if mode.strip() == "periodic")


def _axes(axes: Iterable[str]) -> str:
    return "".join(axes) or "none"
