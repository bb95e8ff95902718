# SPDX-License-Identifier: Apache-2.0
"""Checks of the maps of a material, as findings and the measures that they derive from.

Albedo: values that no daylit surface has, and baked lighting: low-frequency variation of lightness, or lightness that
correlates with the normals (directional light) or with the heights (occlusion). Normals: unit vectors that point up.
`convention` measures the sign of green.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

from ...analysis.drift.drift_field import drift_of
from ...analysis.stationarity.grid_statistics import MARGIN
from ...engine.color.config import as_float, color_space
from ...engine.color.lab import lens_for
from ...engine.color.lens import count_broken
from ...engine.color.normal_maps import FORMATS
from ...engine.core.attributes import TAG
from ...engine.core.demand import bands
from ...engine.core.image import Image, channels_of
from ...engine.core.window import Window
from ...engine.deferred import np
from ...engine.errors import COLORSPACE, IS_DATA, BrokenValues, ColorError, ImageError, present, spelled
from ...engine.io.description import is_tagged
from ...engine.scan import scan
from ...engine.session.progress import Progress
from ...engine.session.resources import Resources
from .convention import convention_of, decoder, limits

# CIE L of the darkest and the brightest sRGB values of nonmetals, 30 and 240 (Allegorithmic, The PBR guide, part 2:
# charcoal and fresh snow), and of a surface that reflects more light than it receives
DARKEST, BRIGHTEST, IMPOSSIBLE = 11.3, 94.8, 100.5
_FEW = 0.01  # proportion of pixels: holes and glints
DRIFT = 4.0  # L: standard deviation of local means; 0.8 and 2.9 in two albedo maps, 4.1 to 7.1 in unevenly lit photos
_DRIFT_SCALE = 1 / 8  # of the longer side
_LIT, _OCCLUDED = 0.1, 0.25  # proportion of the variance of lightness explained by normals and by heights
_LENGTH = 0.05  # tolerance of the length of a normal; 8 bits cause 0.007
_LEAN = 5.0  # degrees
_GRID = 1024.0  # steps per unit: integer sums do not depend on their order

ERROR, WARNING = "error", "warning"


@dataclass(frozen=True)
class Fault:
    """A finding about a map."""

    level: str  # `ERROR`: renders incorrectly; `WARNING`: may render incorrectly
    map: str  # Name of the map
    check: str  # One word for programs
    text: str  # What is wrong and what to do

    def __str__(self) -> str:
        return f"{self.level}: {self.map}: {self.text}"


@dataclass
class _Map:
    """A map with its kind and measures."""

    image: Image
    kind: str
    measures: dict[str, Any]
    usable: bool = True


class _Unusable(Exception):
    """A failed check, after which a map cannot be checked further: (check, text)."""


def check_material(
    images: tuple[Image, ...], kinds: list[str], convention: str, resources: Resources, progress: Progress
) -> tuple[list[dict[str, Any]], list[Fault]]:
    """Check the maps of a material, each in bands.

    Parameters
    ----------
    kinds : list of str
        Kind of each map: color, data, normal or height.
    convention : str
        Expected direction of the green channel of normals: opengl (up) or directx (down).

    Returns
    -------
    maps : list of dict
        Name, kind, size and measures of each map.
    findings : list of Fault
    """
    maps = [_Map(image, kind, {}) for image, kind in zip(images, kinds, strict=True)]
    findings = list(_sizes(maps))
    by_kind = {one.kind: one for one in reversed(maps)}
    for one in maps:
        findings += _alone(one, resources, progress)
        if one.kind != "color":
            findings += _tagged(one, resources)
    together = [one for one in by_kind.values() if one.usable and one.image.first.window == maps[0].image.first.window]
    usable = {one.kind: one for one in together}
    if "normal" in usable:
        findings += _handedness(usable["normal"], usable.get("height"), convention)
    if "color" in usable and len(usable) > 1:
        findings += _baked(usable["color"], usable.get("normal"), usable.get("height"), resources)
    facts = [
        {"name": one.image.source, "kind": one.kind, "width": width, "height": height, "measures": one.measures}
        for one in maps
        for width, height in (one.image.first.window.size,)
    ]
    return facts, findings


def document(maps: list[dict[str, Any]], findings: list[Fault]) -> dict[str, Any]:
    """Maps and findings as a JSON document."""
    return {"maps": maps, "findings": [asdict(finding) for finding in findings]}


# --- maps of any kind ---


def _sizes(maps: list[_Map]) -> Iterator[Fault]:
    first = maps[0].image
    for one in maps[1:]:
        if one.image.first.window != first.first.window:
            sizes = f"{one.image.first.window}: expected {first.first.window}, as {first.source}"
            yield Fault(ERROR, one.image.source, "size", f"has size {sizes}; use --resize")
        densities = [image.first.spec.get_float_attribute("XResolution", 0.0) for image in (one.image, first)]
        if all(densities) and not math.isclose(*densities, rel_tol=0.01):
            text = f"has {densities[0]:g} pixels per unit, {first.source} has {densities[1]:g}: physical sizes differ"
            yield Fault(WARNING, one.image.source, "density", text)


def _alone(one: _Map, resources: Resources, progress: Progress) -> Iterator[Fault]:
    try:
        _require_finite(one)
        if one.kind == "color":
            yield from _albedo(one, resources, progress)
        else:
            yield from {"normal": _normals, "height": _heights, "data": _data}[one.kind](one)
    except _Unusable as error:
        one.usable = False
        yield Fault(ERROR, one.image.source, *error.args)


def _require_finite(one: _Map) -> None:
    channels, counts = list(channels_of(one.image.first.spec).color), np.zeros(2, np.int64)
    for band in bands(one.image.first):
        counts += count_broken(as_float(one.image.first.read(band)[..., channels]))
    if counts.any():
        raise _Unusable("broken", f"has {counts[0]} NaN and {counts[1]} Inf values")


def _tagged(one: _Map, resources: Resources) -> Iterator[Fault]:
    """A color space tag on a map of data, unless a reader of JPEG or PNG assumed it for an untagged file."""
    spec, path = one.image.first.spec, one.image.source
    tag, format_name = spec.get_string_attribute(TAG), FORMATS.get(os.path.splitext(path)[1].lower())
    assumed = format_name is not None and os.path.isfile(path) and not is_tagged(spec, format_name, path)
    if tag and not assumed and not resources.color.is_data(tag):
        text = f"is tagged '{tag}': a renderer would convert its data as color; add {IS_DATA}"
        yield Fault(WARNING, path, "colorspace", text)


# --- albedo ---


def _albedo(one: _Map, resources: Resources, progress: Progress) -> Iterator[Fault]:
    name, part = one.image.source, one.image.first
    count = len(channels_of(part.spec).color)
    if count not in (1, 3):
        raise _Unusable("channels", f"has {count} channels apart from alpha: expected 1 or 3 for color")
    try:
        space = color_space(one.image, resources.color, resources.settings.autocc)
    except (ColorError, ImageError) as error:
        raise _Unusable("colorspace", spelled(error.problem)) from None
    if space is None:
        raise _Unusable("colorspace", f"is tagged as data: expected a color space; add {COLORSPACE} if it is color")
    counts = np.zeros(4, np.int64)

    def look(values: np.ndarray, opaque: np.ndarray | None, _: Window) -> np.ndarray:
        seen = values[..., 0] if opaque is None else values[opaque][:, 0]
        beyond = (seen < DARKEST, seen > BRIGHTEST, (seen > IMPOSSIBLE) | (seen < 0))
        return np.array([seen.size, *(np.count_nonzero(each) for each in beyond)], np.int64)

    def keep(_: Window, found: np.ndarray) -> None:
        counts[:] += found

    lens = lens_for(one.image, resources, space)
    try:
        scan(part, lens, resources, look, keep)
    except BrokenValues as error:  # of alpha
        raise _Unusable("broken", spelled(error.problem)) from None
    dark, bright, impossible = (counts[1:] / max(1, counts[0])).tolist()
    one.measures |= {"dark": dark, "bright": bright, "impossible": impossible}
    if impossible > 0:
        text = f"{_percent(impossible)} of its pixels are negative or reflect more light than they receive"
        yield Fault(ERROR, name, "range", text)
    if dark > _FEW:
        text = f"{_percent(dark)} of its pixels are darker than charcoal (sRGB 30): shadow or metal"
        yield Fault(WARNING, name, "range", text)
    if bright > max(_FEW, impossible):
        text = f"{_percent(bright)} of its pixels are brighter than fresh snow (sRGB 240): highlights or metal"
        yield Fault(WARNING, name, "range", text)
    drift = drift_of(one.image, lens, max(1.0, 2 * max(part.window.size) * _DRIFT_SCALE), resources, progress)
    if drift is not None:
        spread = one.measures["drift"] = float(drift.level[MARGIN:-MARGIN, MARGIN:-MARGIN, 0].std())
        if spread > DRIFT:
            text = f"its lightness varies by {spread:.1f} L at large scale: baked lighting; use --texflatten"
            yield Fault(WARNING, name, "drift", text)


def _percent(share: float) -> str:
    percent = 100 * share
    return "less than 0.01 %" if percent < 0.01 else f"{percent:{'.0f' if percent >= 99 else '.2g'}} %"


# --- normals, heights, data ---


def _normals(one: _Map) -> Iterator[Fault]:
    part, name = one.image.first, one.image.source
    count = len(channels_of(part.spec).color)
    if count not in (2, 3):
        raise _Unusable("channels", f"has {count} channels apart from alpha: expected 2 or 3 for normals")
    vectors, off, below, mean, total = decoder(one.image), 0, 0, np.zeros(3, np.int64), 0
    for band in bands(part):
        seen = vectors(part.read(band))
        squared = (seen**2).sum(-1)
        if count == 3:
            off += int(np.count_nonzero(np.abs(np.sqrt(squared) - 1) > _LENGTH))
            below += int(np.count_nonzero(seen[..., 2] <= 0))
        else:
            off += int(np.count_nonzero(squared > (1 + _LENGTH) ** 2))
        mean[:count] += np.rint(seen * _GRID).astype(np.int64).sum((0, 1))
        total += squared.size
    if count == 2:
        mean[2] = round(_GRID * total)
    lean = math.degrees(math.atan2(math.hypot(*mean[:2].tolist()), float(mean[2])))
    one.measures |= {"not_unit": float(off / total), "below": float(below / total), "lean": lean}
    if off / total > _FEW:
        text = f"{_percent(off / total)} of its vectors differ from length 1 by more than {_LENGTH:g}"
        yield Fault(ERROR, name, "length", text)
    if below / total > _FEW:
        yield Fault(ERROR, name, "below", f"{_percent(below / total)} of its vectors point into the surface")
    if lean > _LEAN:
        yield Fault(WARNING, name, "lean", f"its mean normal leans by {lean:.1f} degrees: the surface was not level")


def _heights(one: _Map) -> Iterator[Fault]:
    part, name = one.image.first, one.image.source
    low, high = limits(one.image)
    one.measures |= {"least": low, "largest": high}
    if low == high:
        yield Fault(WARNING, name, "flat", f"all heights are {low:g}")
    elif part.spec.format.size() == 1:
        yield Fault(WARNING, name, "steps", "has 8 bits: displacement shows steps; use 16 bits or floats")


def _data(one: _Map) -> Iterator[Fault]:
    low, high = limits(one.image)
    one.measures |= {"least": low, "largest": high}
    if low < 0 or high > 1:
        yield Fault(ERROR, one.image.source, "range", f"has values from {low:g} to {high:g}: expected 0 to 1")


# --- maps together ---


def _handedness(normal: _Map, height: _Map | None, convention: str) -> Iterator[Fault]:
    """Sign of the green channel."""
    found = convention_of(normal.image, None if height is None else height.image)
    name = normal.image.source
    normal.measures |= {"no_curl": found.no_curl, "convention": found.hand or None}
    if found.agrees is not None:
        normal.measures["agrees_x"], normal.measures["agrees_y"] = found.agrees
    if found.inverted:
        yield Fault(ERROR, name, "inverted", "its slopes along x are opposite to the heights")
    if found.hand not in ("", convention):
        points = "down (DirectX)" if found.hand == "directx" else "up (OpenGL)"
        text = f"green points {points}, judging by {found.by}; flip it: --mulc 1,-1,1 --addc 0,1,0"
        yield Fault(ERROR, name, "handedness", text)


def _baked(albedo: _Map, normal: _Map | None, height: _Map | None, resources: Resources) -> Iterator[Fault]:
    """Proportion of the variance of lightness that normals, and heights, explain."""
    part, name = albedo.image.first, albedo.image.source
    space = present(color_space(albedo.image, resources.color, resources.settings.autocc))  # checked in `_albedo`
    lens = lens_for(albedo.image, resources, space)
    vectors = None if normal is None else decoder(normal.image)
    # products of 1, L, normal x and y, height: integers, whose sums do not depend on their order
    sums, steps = np.zeros((5, 5)), np.array([1, 64, 4096, 4096, 4096])[:, None]
    for band in bands(part):
        lab, opaque = lens.values(part.read(band))
        layers = np.zeros((5, band.height, band.width))
        layers[0], layers[1] = 1, lab[..., 0]
        if normal is not None and vectors is not None:
            layers[2:4] = np.moveaxis(vectors(normal.image.first.read(band))[..., :2], -1, 0)
        if height is not None:
            layers[4] = as_float(height.image.first.read(band)[..., channels_of(height.image.first.spec).first])
        values = np.rint((layers.reshape(5, -1) if opaque is None else layers[:, opaque]) * steps)
        sums += values @ values.T
    count = max(sums[0, 0], 1.0)
    covariance = sums[1:, 1:] / count - np.outer(sums[0, 1:], sums[0, 1:]) / count**2
    own = max(float(covariance[0, 0]), 1e-12)
    if normal is not None:
        gain = np.linalg.lstsq(covariance[1:3, 1:3], covariance[1:3, 0], rcond=1e-6)[0]
        lit = albedo.measures["lit"] = float(gain @ covariance[1:3, 0]) / own
        if lit > _LIT:
            up = -1 if normal.measures["convention"] == "directx" else 1
            toward = math.degrees(math.atan2(up * gain[1], gain[0])) % 360
            text = f"{_percent(lit)} of its lightness follows the normals: baked light from {toward:.0f} degrees"
            yield Fault(WARNING, name, "lit", text)
    if height is not None and covariance[3, 3] > 0:
        share = albedo.measures["occluded"] = float(covariance[0, 3] ** 2 / covariance[3, 3]) / own
        if share > _OCCLUDED and covariance[0, 3] > 0:
            text = f"{_percent(share)} of its lightness follows the heights: baked occlusion, or dark recesses"
            yield Fault(WARNING, name, "occluded", text)
