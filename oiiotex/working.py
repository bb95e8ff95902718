# SPDX-License-Identifier: Apache-2.0
"""A filter's working space window by window: CIE Lab D65 or data, and back into the pixels of the image.

What `color.working_values` does for a whole image that is held, a `Lens` does for rows as they come by. A pixel's
values depend on nothing but that pixel, so the bits are the same through any window.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import OpenImageIO as oiio

from .color import BrokenValues, ColorConfig, as_float, colour_space
from .images import Channels, Image, Part, channels_of
from .session import Session
from .tiles import bands, stream
from .windows import Window

_PIECE_PIXELS = 1 << 16  # what is worked on at once: small enough for caches
_SMALL = (np.uint8, np.uint16, np.float16, np.float32)  # types whose values are the same after a visit to float
_MOST_LAB = 1e6
_TINY = np.finfo(np.float32).tiny


@dataclass(frozen=True)
class Lens:
    """How rows of an image are seen by a filter.

    Attributes
    ----------
    name : str
        The image's, for messages.
    channels : Channels
    space : str or None
        The image's colour space; None: the channels are data.
    to_lab, from_lab : callable or None
        As `ColorConfig` gives them; None for data.
    low, scale : float
        Data become (value - low) * scale.
    """

    name: str
    channels: Channels
    space: str | None
    to_lab: Callable[[np.ndarray], None] | None
    from_lab: Callable[[np.ndarray], None] | None
    low: float = 0.0
    scale: float = 1.0

    @property
    def count(self) -> int:
        """How many of the values mean something: 3 of Lab, as many as there are of data."""
        return len(self.channels.colour) if self.space is None else 3

    def values(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        """Rows of the image -> what the filter works on.

        Parameters
        ----------
        rows : (height, width, channels)
            Pixels of the image's own type.

        Returns
        -------
        values : (height, width, 4) float32
            Lab of unpremultiplied colour, or scaled data, and a fourth value that is not to be changed. Gray is there
            three times before it becomes Lab.
        opaque : (height, width) bool or None
            Where alpha is not 0; None: everywhere.

        Raises
        ------
        ImageError
            NaN or Inf in colour or alpha.
        """
        values, alpha = self._unpremultiplied(rows)
        if self.to_lab is not None:
            self.to_lab(values)
            if not _all_finite(values):  # colour over next to no alpha, in a space that takes powers of it
                np.nan_to_num(values, copy=False, nan=0.0, posinf=_MOST_LAB, neginf=-_MOST_LAB)
        else:
            values -= np.float32(self.low)
            values *= np.float32(self.scale)
        opaque = None if alpha is None or alpha.all() else alpha != 0
        return values, opaque

    def replaced(self, rows: np.ndarray, values: np.ndarray, opaque: np.ndarray | None) -> np.ndarray:
        """A copy of `rows` whose colour is that of `values`, premultiplied again; where alpha is 0 nothing changes.

        `values` is used up. Gray takes the mean of what the three channels have become.
        """
        if self.from_lab is not None:
            self.from_lab(values)
        else:
            values *= np.float32(1.0 / self.scale)
            values += np.float32(self.low)
        colour = self.channels.colour
        if self._is_rgba(rows) and opaque is None and rows.dtype in _SMALL:  # alpha has come along in the fourth value
            if not (values[..., 3] == 1).all():
                values[..., :3] *= divisor(values[..., 3])[..., None]
            return in_type(values, rows.dtype)
        if self.channels.alpha is not None:
            values *= divisor(as_float(rows[..., self.channels.alpha]))[..., None]
        out = rows.copy()
        if len(colour) == 1 and self.space is not None:
            # the weights are those of no space: the three are equal but for rounding, unless a and b were moved
            values[..., 0] = (values[..., 0] + values[..., 1] + values[..., 2]) * np.float32(1.0 / 3.0)
        stored = in_type(values, rows.dtype)
        for n, channel in enumerate(colour):
            plane = stored[..., n]
            out[..., channel] = plane if opaque is None else np.where(opaque, plane, rows[..., channel])
        return out

    def _is_rgba(self, rows: np.ndarray) -> bool:
        return rows.shape[2] == 4 and self.channels == Channels((0, 1, 2), 3)

    def _unpremultiplied(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        """Colour (height, width, 4) as floats without alpha, and alpha where there is one."""
        colour, alpha = self.channels.colour, self.channels.alpha
        if self._is_rgba(rows):
            values = as_float(rows)
            self._check(values)
            share = values[..., 3]
        else:
            values = np.zeros((*rows.shape[:2], 4), np.float32)
            for n, channel in enumerate(colour):
                values[..., n] = as_float(rows[..., channel])
            share = None if alpha is None else as_float(rows[..., alpha])
            self._check(values[..., : len(colour)], share)
            if len(colour) == 1:
                values[..., 1:3] = values[..., :1]
        if share is not None and not (share == 1).all():
            values[..., :3] /= divisor(share)[..., None]
        return values, share

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
    """What premultiplied colour is divided by: alpha, but 1 where there is none."""
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


def lens_of(image: Image, config: ColorConfig | None, autocc: bool = False) -> Lens:
    """How a filter sees the image's first part.

    Parameters
    ----------
    image : Image
    config : ColorConfig or None
        None: its channels are data, and their common range becomes 0 .. 100, so that distances mean what they mean
        in Lab. It is asked of the pixels: one pass over the image.
    autocc : bool
        Ask the config's file rules where the image has no tag.

    Raises
    ------
    ImageError, ColorError
        As by `color.working_values`.
    """
    space = colour_space(image, config, autocc)
    if config is not None and space is not None:
        return lens_for(image, config, space)
    return _scaled(Lens(image.source, channels_of(image.first.spec), None, None, None), image)


def lens_for(image: Image, config: ColorConfig, space: str) -> Lens:
    """How an image of that colour space is seen in Lab."""
    return Lens(image.source, channels_of(image.first.spec), space, config.to_lab(space), config.from_lab(space))


def _scaled(plain: Lens, image: Image) -> Lens:
    """The lens for data, with their range."""
    low, high = np.inf, -np.inf

    def look(rows: np.ndarray) -> None:
        nonlocal low, high
        values, opaque = plain.values(rows)
        seen = values[..., : plain.count]
        seen = seen if opaque is None else seen[opaque]
        if seen.size:
            low, high = min(low, float(seen.min())), max(high, float(seen.max()))

    part = image.first
    broken: np.ndarray | int = 0
    for _, rows in stream(part, bands(part)):
        try:
            look(rows)
        except BrokenValues as error:
            broken = broken + error.counts
    if not isinstance(broken, int):
        raise BrokenValues(plain.name, broken)
    if low > high:
        return plain
    return replace(plain, low=low, scale=100.0 / max(high - low, 1e-12))


def computed(
    part: Part, spec: oiio.ImageSpec, session: Session, work: Callable[[np.ndarray, Window], np.ndarray]
) -> Part:
    """A part of the same size, of which every pixel follows from the pixel at its place, computed on all threads.

    Parameters
    ----------
    part : Part
        Where pixels come from.
    spec : oiio.ImageSpec
        Of the result.
    session : Session
    work : callable
        (pixels, their window) -> pixels of the result. It must give a pixel the same value in any window.
    """

    def fetch(window: Window) -> np.ndarray:
        rows = part.read(window)
        pieces = list(window.cells(window.width, max(1, _PIECE_PIXELS // max(1, window.width))))
        if len(pieces) == 1:
            return work(rows, window)
        made = session.spread(lambda piece: work(rows[piece.inside(window)], piece), pieces)
        return np.concatenate(list(made))

    return replace(part, spec=spec, fetch=fetch, levels=(), ready=False)
