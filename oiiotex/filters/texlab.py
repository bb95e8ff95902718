# SPDX-License-Identifier: Apache-2.0
"""--texlab: conversion to and from CIE Lab."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar, TypeAlias

from ..engine.color.config import as_float, color_space
from ..engine.color.lab import lens_for
from ..engine.color.lens import Lens, divisor
from ..engine.core.access import Pointwise
from ..engine.core.attributes import TAG, tag_colors
from ..engine.core.image import Channels, Image, Part, channels_of, derived_spec
from ..engine.core.op import Kind, Output, Plan, Space, no_pixels
from ..engine.core.parameters import image, param
from ..engine.core.tiling import tiled_spec, tiling_of
from ..engine.core.window import Window
from ..engine.deferred import np, oiio
from ..engine.errors import COLORSPACE, ColorError, ImageError, modifier
from ..engine.session import Session
from ..engine.session.facts import Facts

FROM = "oiiotex:labFrom"  # attribute: the color space before the conversion


Conversion: TypeAlias = "Callable[[np.ndarray, Window], np.ndarray]"
"""Rows of the image in a window -> converted."""


@dataclass(frozen=True, kw_only=True)
class Lab(Pointwise):
    """Convert to and from CIE Lab (D65).

    L is 0 for black and 100 for diffuse white; a and b are 0 for gray. HDR values exceed 100, and negative values are
    kept. L, a and b are stored as 32-bit floats in channels R, G and B, as OpenColorIO does, because most programs take
    a channel named 'a' for alpha. Gray images become three channels. Color is unpremultiplied first, and premultiplied
    again by the inverse; alpha and other channels are kept. The result is tagged as data, so that no program takes it
    for RGB. An attribute records the original color space for the inverse.
    """

    example: ClassVar[str] = """\
>>> lab = filters.lab("photo.png")
>>> lightness = lab.get_pixels()[..., 0]
"""
    name: ClassVar[str] = "lab"
    carries: ClassVar[bool] = True
    space: ClassVar[Space] = Space.LAB
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("lab", Kind.MEASURE, "L, a and b in channels R, G and B."),
        Output("color", Kind.PIXELS, "Color, in the type of the first input file.", asked_by="inverse", instead=True),
    )

    source: Image = image(help="Image to convert.")
    inverse: bool = param(False, help="Convert from Lab to color.")

    def plan(self, facts: Facts) -> Plan:
        """The converted part, and what converts its rows."""
        part, work = self._color(facts) if self.inverse else self._lab(facts)
        return Plan({"color" if self.inverse else "lab": part}, work)

    def make(self, plan: Plan, session: Session) -> dict[str, Part]:
        """The first part converted."""
        (name, planned), *_ = plan.results.items()
        return {name: replace(planned, fetch=self.mapped(self.source.first, plan.work, session).fetch)}

    def _lab(self, facts: Facts) -> tuple[Part, Conversion]:
        part = self.source.first
        origin = part.spec.get_string_attribute(FROM)
        if origin:
            back = f"{modifier(inverse=True)} converts it back"
            raise ColorError(f"is already in Lab, converted from '{origin}'; {back}", subject=self.source.source)
        space = color_space(self.source, facts.color, facts.settings.autocc)
        if space is None:
            problem = f"is data and cannot be converted to Lab; add {COLORSPACE} if it is color"
            raise ColorError(problem, subject=self.source.source)
        lens = lens_for(self.source, facts, space)
        places = _places(lens.channels, part.spec.nchannels)

        def work(rows: np.ndarray, _: Window) -> np.ndarray:
            values, _opaque = lens.values(rows)
            return _merged(values, rows, places)

        spec = tiled_spec(derived_spec(part.spec), tiling_of(part.spec))
        names = [*part.spec.channelnames]
        if len(lens.channels.color) == 1:
            names[lens.channels.color[0] : lens.channels.color[0] + 1] = ["R", "G", "B"]
            spec.nchannels = len(names)
            alpha = lens.channels.alpha
            spec.alpha_channel = -1 if alpha is None else names.index(part.spec.channelnames[alpha])
            spec.channelnames = tuple(names)
        spec.attribute(FROM, part.spec.get_string_attribute(TAG) or space)
        planned = replace(part, spec=spec, fetch=no_pixels, levels=(), ready=False)
        return replace(planned, stored=spec.format, typed=True), work

    def _color(self, facts: Facts) -> tuple[Part, Conversion]:
        part, name = self.source.first, self.source.source
        tag, space = part.spec.get_string_attribute(TAG), part.spec.get_string_attribute(FROM)
        if tag and not facts.color.is_data(tag):
            raise ColorError(f"is in '{tag}': expected Lab", subject=name)
        if not space:
            problem = f"does not record its original color space: expected its name in the attribute {FROM}"
            raise ColorError(problem, subject=name)
        if facts.color.is_data(space):
            raise ColorError(f"the attribute {FROM} is '{space}': expected a color space, not data", subject=name)
        channels = channels_of(part.spec)
        if len(channels.color) != 3:
            raise ImageError(
                f"has {len(channels.color)} channels apart from alpha: expected the 3 of Lab", subject=name
            )
        from_lab = facts.color.from_lab(space)
        lens = Lens(name, Channels(channels.color, None))  # Lab is not premultiplied
        places = _places(channels, part.spec.nchannels)

        def work(rows: np.ndarray, _: Window) -> np.ndarray:
            values, _opaque = lens.values(rows)
            from_lab(values)
            if channels.alpha is not None:
                values *= divisor(as_float(rows[..., channels.alpha]))[..., None]
            return _merged(values, rows, places)

        spec = tiled_spec(derived_spec(part.spec), tiling_of(part.spec))
        spec.set_format(oiio.TypeDesc(oiio.FLOAT))
        spec.channelformats = ()
        for stale in ("oiio:BitsPerSample", FROM):
            spec.erase_attribute(stale)
        tag_colors(spec, space)
        planned = replace(part, spec=spec, fetch=no_pixels, levels=(), ready=False)
        return replace(planned, stored=None, typed=False), work


def _places(channels: Channels, count: int) -> list[tuple[bool, int]]:
    """For each channel of the result: (whether it is one of the three values, index of the value or of the channel)."""
    places: list[tuple[bool, int]] = []
    for channel in range(count):
        if channel not in channels.color:
            places.append((False, channel))
        elif len(channels.color) == 1:
            places += [(True, 0), (True, 1), (True, 2)]
        else:
            places.append((True, channels.color.index(channel)))
    return places


def _merged(values: np.ndarray, rows: np.ndarray, places: list[tuple[bool, int]]) -> np.ndarray:
    """The three values and the other channels as floats, (height, width, len(places)) float32."""
    out = np.empty((*rows.shape[:2], len(places)), np.float32)
    for n, (is_value, index) in enumerate(places):
        out[..., n] = values[..., index] if is_value else as_float(rows[..., index])
    return out
