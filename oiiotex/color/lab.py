# SPDX-License-Identifier: Apache-2.0
"""The one way into a filter's working space, CIE Lab D65 or data, and back into the pixels of the image.

An op declares its space and gets a `Lens` for each of its images, which shows rows as they come by; `working_values`
is a whole image through it. A pixel's values depend on nothing but that pixel, so the bits are the same through any
window.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar

from ..core.image import Channels, Image, Part, channels_of
from ..core.op import Op, Space
from ..core.parameters import param
from ..core.scratch import RowStore, empty_rows
from ..core.window import Window
from ..deferred import np
from ..errors import BrokenValues
from ..scan import scan
from ..session.resources import Resources
from .config import as_float, color_space

DATA = "the channels are no colors: compare them as they are"
_SMALL = ("uint8", "uint16", "float16", "float32")  # types whose values are the same after a visit to float
_MOST_LAB = 1e6
_TINY = 2.0**-126  # the least normal number of 32 bits


@dataclass(frozen=True)
class Lens:
    """How rows of an image are seen by a filter.

    Attributes
    ----------
    name : str
        The image's, for messages.
    channels : Channels
    space : str or None
        The image's color space; None: the channels are data.
    to_lab, from_lab : callable or None
        As `ColorConfig` gives them; None for data.
    low, scale : float
        Data become (value - low) * scale.
    """

    name: str
    channels: Channels
    space: str | None = None
    to_lab: Callable[[np.ndarray], None] | None = None
    from_lab: Callable[[np.ndarray], None] | None = None
    low: float = 0.0
    scale: float = 1.0

    @property
    def count(self) -> int:
        """How many of the values mean something: 3 of Lab, as many as there are of data."""
        return len(self.channels.color) if self.space is None else 3

    def values(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        """Rows of the image -> what the filter works on.

        Parameters
        ----------
        rows : (height, width, channels)
            Pixels of the image's own type.

        Returns
        -------
        values : (height, width, 4) float32
            Lab of unpremultiplied color, or scaled data, and a fourth value that is not to be changed. Gray is there
            three times; the third of two channels of data is 0.
        opaque : (height, width) bool or None
            Where alpha is not 0; None: everywhere.

        Raises
        ------
        ImageError
            NaN or Inf in color or alpha.
        """
        values, alpha = self._unpremultiplied(rows)
        if self.to_lab is not None:
            self.to_lab(values)
            if not _all_finite(values):  # color over next to no alpha, in a space that takes powers of it
                np.nan_to_num(values, copy=False, nan=0.0, posinf=_MOST_LAB, neginf=-_MOST_LAB)
        else:
            color = values[..., : 3 if len(self.channels.color) == 1 else len(self.channels.color)]
            color -= np.float32(self.low)
            color *= np.float32(self.scale)
        opaque = None if alpha is None or alpha.all() else alpha != 0
        return values, opaque

    def replaced(self, rows: np.ndarray, values: np.ndarray, opaque: np.ndarray | None) -> np.ndarray:
        """A copy of `rows` whose color is that of `values`, premultiplied again; where alpha is 0 nothing changes.

        `values` is used up. Gray takes the mean of what the three channels have become.
        """
        if self.from_lab is not None:
            self.from_lab(values)
        else:
            values[..., :3] *= np.float32(1.0 / self.scale)
            values[..., :3] += np.float32(self.low)
        color = self.channels.color
        if self._is_rgba(rows) and opaque is None and rows.dtype in _SMALL:  # alpha has come along in the fourth value
            if not (values[..., 3] == 1).all():
                values[..., :3] *= divisor(values[..., 3])[..., None]
            return in_type(values, rows.dtype)
        if self.channels.alpha is not None:
            values *= divisor(as_float(rows[..., self.channels.alpha]))[..., None]
        out = rows.copy()
        if len(color) == 1 and self.space is not None:
            # the weights are those of no space: the three are equal but for rounding, unless a and b were moved
            values[..., 0] = (values[..., 0] + values[..., 1] + values[..., 2]) * np.float32(1.0 / 3.0)
        stored = in_type(values, rows.dtype)
        for n, channel in enumerate(color):
            plane = stored[..., n]
            out[..., channel] = plane if opaque is None else np.where(opaque, plane, rows[..., channel])
        return out

    def _is_rgba(self, rows: np.ndarray) -> bool:
        return rows.shape[2] == 4 and self.channels == Channels((0, 1, 2), 3)

    def _unpremultiplied(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        """Color (height, width, 4) as floats without alpha, and alpha where there is one."""
        color, alpha = self.channels.color, self.channels.alpha
        share: np.ndarray | None
        if self._is_rgba(rows):
            values = as_float(rows)
            self._check(values)
            share = values[..., 3]
        else:
            values = np.zeros((*rows.shape[:2], 4), np.float32)
            for n, channel in enumerate(color):
                values[..., n] = as_float(rows[..., channel])
            share = None if alpha is None else as_float(rows[..., alpha])
            self._check(values[..., : len(color)], share)
            if len(color) == 1:
                values[..., 1:3] = values[..., :1]
        if share is not None and not (share == 1).all():
            values[..., :3] /= divisor(share)[..., None]
        return values, share

    def broken(self, rows: np.ndarray) -> np.ndarray:
        """How many NaN and how many Inf there are in color and alpha: (2,) int64."""
        alpha = () if self.channels.alpha is None else (self.channels.alpha,)
        return count_broken(as_float(rows[..., [*self.channels.color, *alpha]]))

    def _check(self, *seen: np.ndarray | None) -> None:
        given = [s for s in seen if s is not None]
        if all(map(_all_finite, given)):
            return
        counts = count_broken(*given)
        if counts.any():
            raise BrokenValues(self.name, counts)


def _all_finite(values: np.ndarray) -> bool:
    """Whether there is neither NaN nor Inf; a quick look, which may say no where a sum overflows."""
    with np.errstate(over="ignore", invalid="ignore"):
        return bool(np.isfinite(values.sum()))


def divisor(alpha: np.ndarray) -> np.ndarray:
    """What premultiplied color is divided by: alpha, but 1 where there is none."""
    return np.where(np.abs(alpha) < _TINY, np.float32(1.0), alpha)


def count_broken(*seen: np.ndarray) -> np.ndarray:
    """How many NaN and how many Inf there are: (2,) int64."""
    return np.array([sum(np.count_nonzero(f(s)) for s in seen) for f in (np.isnan, np.isinf)], np.int64)


def in_type(values: np.ndarray, dtype: np.dtype) -> np.ndarray:
    """Floats as OpenImageIO stores them: integers rounded and cut to their range, halves kept finite."""
    if dtype.kind in "ui":
        most = np.iinfo(dtype).max
        wide = values.astype(np.float64) if dtype.itemsize > 2 else values
        return np.clip(np.floor(wide * wide.dtype.type(most) + wide.dtype.type(0.5)), np.iinfo(dtype).min, most).astype(
            dtype
        )
    if dtype == np.float16:
        return np.clip(values, np.float32(-65504.0), np.float32(65504.0)).astype(np.float16)
    return values.astype(dtype, copy=False)


def lens_of(image: Image, resources: Resources, space: Space = Space.LAB) -> Lens:
    """How an op that works in `space` sees the image's first part.

    Parameters
    ----------
    image : Image
        Gray, gray + alpha, RGB, RGBA, with any further channels.
    space : Space
        As `Op.working_space` gives it. Of an image whose own space says that it holds data, LAB is DATA: the common
        range of its channels becomes 0 .. 100, so that distances mean what they mean in Lab. That range is asked of
        the pixels: one look at the image.

    Raises
    ------
    ImageError
        NaN or Inf in data or their alpha, or two channels that are to be taken as color.
    ColorError
        As by `config.space_of`.
    """
    named = color_space(image, resources.color, resources.settings.autocc) if space is Space.LAB else None
    if named is not None:
        return lens_for(image, resources, named)
    plain = Lens(image.source, channels_of(image.first.spec))
    return plain if space is Space.ANY else _scaled(plain, image.first, resources)


def lens_for(image: Image, resources: Resources, space: str) -> Lens:
    """How an image of that color space is seen in Lab."""
    config = resources.color
    return Lens(image.source, channels_of(image.first.spec), space, config.to_lab(space), config.from_lab(space))


def _scaled(plain: Lens, part: Part, resources: Resources) -> Lens:
    """The lens for data, with the range of what is opaque."""
    limits: list[tuple[float, float]] = []

    def look(values: np.ndarray, opaque: np.ndarray | None, _: Window) -> tuple[float, float] | None:
        seen = values[..., : plain.count]
        seen = seen if opaque is None else seen[opaque]
        return (float(seen.min()), float(seen.max())) if seen.size else None

    def keep(_: Window, limit: tuple[float, float] | None) -> None:
        limits.extend([] if limit is None else [limit])

    scan(part, plain, resources, look, keep)
    if not limits:
        return plain
    low, high = min(low for low, _ in limits), max(high for _, high in limits)
    return replace(plain, low=low, scale=100.0 / max(high - low, 1e-12))


def working_values(
    image: Image, resources: Resources, space: Space = Space.LAB, in_memory: bool = True
) -> tuple[np.ndarray | RowStore, np.ndarray | None]:
    """The image's first part as an op that works in `space` sees it, whole.

    Returns
    -------
    values : (height, width, 3) float32
        Lab (L 0 to 100 for diffuse white, a, b), or data scaled to 0 .. 100; an array where it is held in memory.
    opaque : (height, width) bool or None
        Where alpha is not 0; None: everywhere.

    Raises
    ------
    ImageError, ColorError
        As by `lens_of`; NaN or Inf in color or alpha.
    """
    part, lens = image.first, lens_of(image, resources, space)
    values = empty_rows((part.spec.height, part.spec.width, 3), np.float32, in_memory)
    opaque = np.ones(values.shape[:2], bool)

    def keep(piece: Window, seen: tuple[np.ndarray, np.ndarray | None]) -> None:
        at = piece.inside(part.window)
        values[at[0]] = seen[0][..., :3]
        if seen[1] is not None:
            opaque[at] = seen[1]

    scan(part, lens, resources, lambda seen, opaque, _: (seen, opaque), keep)
    return values, None if opaque.all() else opaque


@dataclass(frozen=True, kw_only=True)
class InLab(Op):
    """What looks at color in CIE Lab, and with `data` at channels as they are."""

    space: ClassVar[Space] = Space.LAB

    data: bool = param(False, help=DATA)
