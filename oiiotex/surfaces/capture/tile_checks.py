# SPDX-License-Identifier: Apache-2.0
"""Checks of finished maps, whoever made them: seams, mirrored and cross-faded borders, repetition, and alignment."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Sequence
from typing import Any

from ...analysis.regularity.autocorrelation import high_passed
from ...engine.color.config import as_float
from ...engine.color.lab import working_values
from ...engine.core.demand import MadeRows, SomeRows, at_most, rows_of
from ...engine.core.image import Image, channels_of
from ...engine.core.op import Space
from ...engine.deferred import np
from ...engine.errors import ColorError, ImageError
from ...engine.session.resources import Resources
from ...synthesis.quality.fidelity import LEAST, SIDE, graded, repetition_of
from ...synthesis.quality.seam_measures import line_jumps
from . import alignment
from .material_checks import ERROR, WARNING, Fault

# of 60 tiles, the jump across the wrap was at most .98 of the strongest interior lines; of 60 photos, 56 had 1.05 to 12
_STRONGEST = 99.0  # percentile of the interior lines that counts as the strongest
_SEEN, _DOUBTFUL = 1.1, 1.05  # of it
_MIRRORED = 0.5  # correlation with the mirror image: 1 of a mirrored photo, less of one that was resized or compressed
_SOFT = 0.85  # sharpness at the border relative to the softest interior
_BAND = 16  # the side over the width of the bands whose sharpness is compared
_BESIDE = 8  # the side over the width of the border
_HELD_SHARE = 1 / 8  # of the budget; larger maps are in a file
_PER_AXIS = "seam", "quieter", "excess", "soft", "mirror"
MEASURES = (*(f"{name}_{axis}" for name in _PER_AXIS for axis in "xy"), "seam", "excess", "waves", "salient", "moved")
OF_TILES = "seam", "mirror", "soft", "waves", "salient"  # checks


def finished_findings(
    images: Sequence[Image], kinds: Sequence[str], measures: Sequence[dict[str, Any]], axes: str, resources: Resources
) -> Iterator[Fault]:
    """Findings about maps that are to tile along these axes, or none, and to lie on each other.

    The measures of each map are added to its dictionary. Maps that are too small are not judged, nor those whose colors
    are unknown: that is a finding by itself.
    """
    for image, kind, own in zip(images, kinds, measures, strict=True):
        if axes != "none" and min(image.first.window.size) >= LEAST:
            with contextlib.suppress(ColorError, ImageError):
                yield from _tile_findings(image, kind, axes, own, resources)
    first = next(iter(images), None)
    for image, own in zip(images[1:], measures[1:], strict=True):
        if first is not None and image.first.window == first.first.window:
            yield from _moved(image, first, axes, own)


def _tile_findings(
    image: Image, kind: str, axes: str, measures: dict[str, Any], resources: Resources
) -> Iterator[Fault]:
    values = _values(image, kind, resources)
    small = _reduced(values, SIDE)
    detail = high_passed(small, np.ones(small.shape[:2], bool), ("y" in axes, "x" in axes))
    for axis in axes:
        number = "yx".index(axis)
        measures |= {f"{name}_{axis}": value for name, value in _across(values, number).items()}
        measures[f"mirror_{axis}"] = _likeness(detail, np.flip(detail, number))
        yield from _at_border(image.source, axis, measures)
    measures["seam"] = max(measures[f"seam_{axis}"] for axis in axes)
    measures["excess"] = max(measures[f"excess_{axis}"] for axis in axes)
    if kind == "color" and axes == "xy":
        for name, value in repetition_of(small).items():
            measures[name] = value
            grade, said = graded(name, value)
            if grade:
                yield Fault((WARNING, ERROR)[grade - 1], image.source, name, f"{said} ({name} {value:.3g})")


def _moved(image: Image, first: Image, axes: str, measures: dict[str, Any]) -> Iterator[Fault]:
    """The offset of a map from the first, if its edges say so."""
    map, other = (_reduced(_plain(one), alignment.SIDE) for one in (image, first))
    found = alignment.offset_between(map, other, ("y" in axes, "x" in axes))
    scale = max(1.0, max(image.first.window.size) / alignment.SIDE)
    x, y = round(found.x * scale), round(found.y * scale)
    measures["moved"] = math.hypot(x, y) if found.moved else 0.0
    if found.moved:
        text = f"does not lie on {first.source}: its edges match if it is moved by {x:+d},{y:+d} px"
        yield Fault(ERROR, image.source, "moved", text)


def _reduced(values: SomeRows, side: int) -> np.ndarray:
    """An image whose longer side is at most `side`, (h, w, c) float64."""
    return at_most(side, values)[0].astype(np.float64)


def _values(image: Image, kind: str, resources: Resources) -> SomeRows:
    """Lab of a color map; of others their own channels."""
    part = image.first
    if kind != "color":
        return _plain(image)
    fits = 12 * part.spec.width * part.spec.height <= resources.budget * _HELD_SHARE
    return working_values(image, resources, Space.LAB, fits)[0]


def _plain(image: Image) -> SomeRows:
    """The channels of a map apart from alpha."""
    rows, channels = rows_of(image.first), list(channels_of(image.first.spec).color)
    shape = *rows.shape[:2], len(channels)
    return MadeRows(shape, np.dtype(np.float32), lambda first, last: as_float(rows[first:last][..., channels]))


def _across(values: SomeRows, axis: int) -> dict[str, float]:
    """The jump across the wrap compared with those inside, and the sharpness near it compared with the softest."""
    jumps = line_jumps(values, axis)
    first, inside = jumps[0], jumps[1:]
    wide, beside = max(1, len(inside) // _BAND), max(1, len(inside) // _BESIDE)
    bands = np.convolve(inside, np.ones(wide) / wide, "valid")
    middle = bands[beside:-beside]
    border = np.concatenate([bands[:beside], bands[-beside:]])
    softest = float(middle.min(initial=np.inf))
    return {
        "seam": float(first / max(inside.mean(), 1e-12)),
        "quieter": float(100.0 * (inside < first).mean()),
        "excess": float(first / max(np.percentile(inside, _STRONGEST), 1e-12)),
        "soft": float(border.min()) / softest if softest > 0 else 1.0,
    }


def _likeness(detail: np.ndarray, other: np.ndarray) -> float:
    """Correlation of two images with mean 0."""
    return float((detail * other).sum() / max(float((detail * detail).sum()), 1e-12))


def _at_border(name: str, axis: str, measures: dict[str, Any]) -> Iterator[Fault]:
    seam, quieter, excess, soft, mirror = (measures[f"{part}_{axis}"] for part in _PER_AXIS)
    if excess > _DOUBTFUL:
        level, verb = (ERROR, "has") if excess > _SEEN else (WARNING, "may have")
        text = f"{verb} a seam along {axis}: its jump is {seam:.2f} times those of interior lines"
        yield Fault(level, name, "seam", f"{text}, {quieter:.0f} % of which are smoother")
    if mirror > _MIRRORED and quieter == 0:
        yield Fault(WARNING, name, "mirror", f"is mirrored at its border along {axis}: symmetry shows where it repeats")
    elif soft < _SOFT:
        text = (
            f"is softer at its border along {axis}, {100 * soft:.0f} % of the softest part inside: it was cross-faded"
        )
        yield Fault(WARNING, name, "soft", text)
