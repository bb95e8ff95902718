# SPDX-License-Identifier: Apache-2.0
"""The lens of an image: converts its rows to a filter's working space, CIE Lab D65 or data, and back.

The conversion is pointwise, so the bits are the same through any window.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ..core.image import Channels
from ..deferred import np
from ..errors import BrokenValues, ImageError
from .config import as_float

_SMALL = ("uint8", "uint16", "float16", "float32")  # types that survive a round trip through float
_MOST_LAB = 1e6
_MOST = 1e36  # largest value of color: products with a few of a matrix's elements must not overflow
_TINY = 2.0**-126  # the smallest normal 32-bit float


@dataclass(frozen=True)
class Lens:
    """Converts rows of an image to a filter's working space and back.

    Attributes
    ----------
    name : str
        The image's name, for messages.
    channels : Channels
    space : str or None
        The image's color space; None: the channels are data.
    to_lab, from_lab : callable or None
        From `ColorConfig`; None for data.
    low, scale : float
        Data are mapped to (value - low) * scale.
    least_alpha : float
        Pixels whose alpha is smaller are not opaque.
    """

    name: str
    channels: Channels
    space: str | None = None
    to_lab: Callable[[np.ndarray], None] | None = None
    from_lab: Callable[[np.ndarray], None] | None = None
    low: float = 0.0
    scale: float = 1.0
    least_alpha: float = 0.0

    @property
    def count(self) -> int:
        """Number of used values per pixel: 3 for Lab, the number of channels for data."""
        return len(self.channels.color) if self.space is None else 3

    def values(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        """Rows of the image in the filter's working space.

        Parameters
        ----------
        rows : (height, width, channels)
            Pixels of the image's own type.

        Returns
        -------
        values : (height, width, 4) float32
            Lab of unpremultiplied color, or scaled data, and a fourth value that must not be changed. Gray is repeated
            three times; for two channels of data the third value is 0.
        opaque : (height, width) bool or None
            Where alpha is neither 0 nor below `least_alpha`; None: everywhere.

        Raises
        ------
        ImageError
            NaN or Inf in color or alpha.
        """
        values, alpha = self._unpremultiplied(rows)
        if self.to_lab is not None:
            self.to_lab(values)
            if not _moderate(values):  # color divided by a tiny alpha overflows in spaces with a power curve
                np.nan_to_num(values, copy=False, nan=0.0, posinf=_MOST_LAB, neginf=-_MOST_LAB)
        else:
            color = values[..., : 3 if len(self.channels.color) == 1 else len(self.channels.color)]
            color -= np.float32(self.low)
            color *= np.float32(self.scale)
        if alpha is None:
            return values, None
        opaque = (alpha != 0) & (alpha >= np.float32(self.least_alpha))
        return values, None if opaque.all() else opaque

    def replaced(self, rows: np.ndarray, values: np.ndarray, opaque: np.ndarray | None) -> np.ndarray:
        """A copy of `rows` with the color of `values`, premultiplied again; pixels with alpha 0 do not change.

        `values` is overwritten. Gray becomes the mean of the three channels.
        """
        if self.from_lab is not None:
            self.from_lab(values)
        else:
            values[..., :3] *= np.float32(1.0 / self.scale)
            values[..., :3] += np.float32(self.low)
        color = self.channels.color
        if self._is_rgba(rows) and opaque is None and rows.dtype in _SMALL:  # the fourth value is alpha
            if not (values[..., 3] == 1).all():
                values[..., :3] *= divisor(values[..., 3])[..., None]
            return in_type(values, rows.dtype)
        if self.channels.alpha is not None:
            values *= divisor(as_float(rows[..., self.channels.alpha]))[..., None]
        out = rows.copy()
        if len(color) == 1 and self.space is not None:
            # a plain mean: the three are equal up to rounding, unless a filter changed a or b
            values[..., 0] = (values[..., 0] + values[..., 1] + values[..., 2]) * np.float32(1.0 / 3.0)
        stored = in_type(values, rows.dtype)
        for n, channel in enumerate(color):
            plane = stored[..., n]
            out[..., channel] = plane if opaque is None else np.where(opaque, plane, rows[..., channel])
        return out

    def _is_rgba(self, rows: np.ndarray) -> bool:
        return rows.shape[2] == 4 and self.channels == Channels((0, 1, 2), 3)

    def _unpremultiplied(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        """Unpremultiplied color (height, width, 4) as floats, and alpha if the image has it."""
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
        """Number of NaN and of Inf in color and alpha: (2,) int64."""
        alpha = () if self.channels.alpha is None else (self.channels.alpha,)
        return count_broken(as_float(rows[..., [*self.channels.color, *alpha]]))

    def _check(self, *seen: np.ndarray | None) -> None:
        given = [s for s in seen if s is not None]
        if all(map(_moderate, given)):
            return
        counts = count_broken(*given)
        raise BrokenValues(self.name, counts) if counts.any() else too_large(self.name)


def _moderate(values: np.ndarray) -> bool:
    """Whether there is neither NaN nor Inf, nor a value whose color would overflow."""
    return not values.size or bool(values.max() <= _MOST and values.min() >= -_MOST)


def too_large(name: str) -> ImageError:
    """The error for finite values with which arithmetic overflows."""
    return ImageError(f"has values beyond {_MOST:g}: scale them first, such as with --mulc 1e-9", subject=name)


def resampled(values: np.ndarray, source: np.ndarray, name: str) -> np.ndarray:
    """Sums of pixels, as they are; raises ImageError if they overflow though the pixels are finite."""
    if not np.isfinite(values).all() and np.isfinite(source).all():
        raise too_large(name)
    return values


def divisor(alpha: np.ndarray) -> np.ndarray:
    """The divisor to unpremultiply color: alpha, but 1 where alpha is 0."""
    return np.where(np.abs(alpha) < _TINY, np.float32(1.0), alpha)


def count_broken(*seen: np.ndarray) -> np.ndarray:
    """Number of NaN and of Inf: (2,) int64."""
    return np.array([sum(np.count_nonzero(f(s)) for s in seen) for f in (np.isnan, np.isinf)], np.int64)


def in_type(values: np.ndarray, dtype: np.dtype) -> np.ndarray:
    """Floats as OpenImageIO stores them: integers rounded and clamped to their range, halves kept finite."""
    if dtype.kind in "ui":
        most = np.iinfo(dtype).max
        wide = values.astype(np.float64) if dtype.itemsize > 2 else values
        return np.clip(np.floor(wide * wide.dtype.type(most) + wide.dtype.type(0.5)), np.iinfo(dtype).min, most).astype(
            dtype
        )
    if dtype == np.float16:
        return np.clip(values, np.float32(-65504.0), np.float32(65504.0)).astype(np.float16)
    return values.astype(dtype, copy=False)
