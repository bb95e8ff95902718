# SPDX-License-Identifier: Apache-2.0
"""Ranges of values: contrast, clamping, noise, repair."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from ..core.demand import bands, cached
from ..core.image import Image, Part, pixels_of
from ..core.op import Op
from ..core.parameters import Numbers, argument, image, param
from ..core.window import Window
from ..deferred import np, oiio
from ..errors import ImageError
from ..session import Session
from .arithmetic import OneImage, numbers_for_channels
from .kinds import Area

_LARGEST = (2 - 2**-23) * 2.0**127  # that a 32-bit float holds


@dataclass(frozen=True, kw_only=True)
class Clamp(OneImage):
    """Keep values within bounds."""

    name: ClassVar[str] = "clamp"

    min: str = param("", help="lower bound of all channels, or a comma-separated list; an empty place sets no bound")
    max: str = param("", help="upper bound of all channels, or a comma-separated list; an empty place sets no bound")
    clampalpha: bool = param(False, help="keep alpha in 0 .. 1 as well")

    def apply(self, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """Clamped."""
        count = buffers[0].nchannels
        low = numbers_for_channels(self.min, count, -_LARGEST, "min")
        high = numbers_for_channels(self.max, count, _LARGEST, "max")
        return oiio.ImageBufAlgo.clamp(buffers[0], low, high, self.clampalpha)


@dataclass(frozen=True, kw_only=True)
class Contrast(OneImage):
    """Remap values from black .. white to min .. max, straight or along a sigmoid."""

    name: ClassVar[str] = "contrast"

    black: Numbers = param(Numbers((0.0,)), help="what becomes min, for all channels or for each")
    white: Numbers = param(Numbers((1.0,)), help="what becomes max; equal to black: a threshold")
    min: Numbers = param(Numbers((0.0,)), help="what black becomes")
    max: Numbers = param(Numbers((1.0,)), help="what white becomes")
    scontrast: Numbers = param(Numbers((1.0,)), help="slope of the sigmoid; 1: a straight line")
    sthresh: Numbers = param(Numbers((0.5,)), help="where the sigmoid is steepest, 0 at black and 1 at white")
    clamp: bool = param(False, help="keep the result within min .. max")

    def apply(self, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """Remapped; the last value given holds for further channels."""
        lists = (self.black, self.white, self.min, self.max, self.scontrast, self.sthresh)
        black, white, low, high, steep, middle = map(tuple, lists)
        result = oiio.ImageBufAlgo.contrast_remap(buffers[0], black, white, low, high, steep, middle)
        if self.clamp:
            oiio.ImageBufAlgo.clamp(result, result, low, high)
        return result


@dataclass(frozen=True, kw_only=True)
class Saturate(OneImage):
    """Scale the saturation of the first three channels."""

    name: ClassVar[str] = "saturate"

    scale: float = argument(help="0 leaves gray, 1 changes nothing")

    def apply(self, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """Between luma and colour, or beyond."""
        return oiio.ImageBufAlgo.saturate(buffers[0], self.scale)


@dataclass(frozen=True, kw_only=True)
class RangeCompress(OneImage):
    """Compress large values on a log scale."""

    name: ClassVar[str] = "rangecompress"

    luma: bool = param(False, help="scale colours by their luma, instead of each channel alone")

    def apply(self, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """Compressed."""
        return oiio.ImageBufAlgo.rangecompress(buffers[0], self.luma)


@dataclass(frozen=True, kw_only=True)
class RangeExpand(OneImage):
    """Undo --rangecompress."""

    name: ClassVar[str] = "rangeexpand"

    luma: bool = param(False, help="scale colours by their luma, instead of each channel alone")

    def apply(self, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """Expanded."""
        return oiio.ImageBufAlgo.rangeexpand(buffers[0], self.luma)


@dataclass(frozen=True, kw_only=True)
class Normalize(OneImage):
    """Give the vectors in the first three channels unit length: repair a normal map."""

    name: ClassVar[str] = "normalize"

    incenter: float = param(0.0, help="what stands for 0 in the image: 0.5 for normals stored in 0 .. 1")
    outcenter: float = param(0.0, help="what stands for 0 in the result")
    scale: float = param(1.0, help="length of the result's vectors")

    def apply(self, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """Normalized; a fourth channel stays."""
        if buffers[0].nchannels not in (3, 4):
            raise ImageError(f"takes images of 3 or 4 channels; this one has {buffers[0].nchannels}")
        return oiio.ImageBufAlgo.normalize(buffers[0], self.incenter, self.outcenter, self.scale)


@dataclass(frozen=True, kw_only=True)
class Noise(OneImage):
    """Add noise; the same seed gives the same noise at a pixel, whatever the image."""

    name: ClassVar[str] = "noise"

    type: str = param("gaussian", choices=("gaussian", "white", "uniform", "salt"), help="distribution")
    mean: float = param(0.0, help="of gaussian noise")
    stddev: float = param(0.1, ge=0, help="standard deviation of gaussian noise")
    min: float = param(0.0, help="of uniform noise")
    max: float = param(0.1, help="of uniform noise")
    value: float = param(0.0, help="what salt noise puts")
    portion: float = param(0.01, ge=0, le=1, help="of the pixels that salt noise replaces")
    mono: bool = param(False, help="the same noise in all channels")
    seed: int = param(0, ge=-(1 << 31), le=(1 << 31) - 1, help="another seed, other noise")
    nchannels: int | None = param(None, ge=1, help="only in the first channels; all when left out")

    def apply(self, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """Noisy."""
        low, high = {"gaussian": (self.mean, self.stddev), "salt": (self.value, self.portion)}.get(
            self.type, (self.min, self.max)
        )
        result = oiio.ImageBufAlgo.copy(buffers[0])
        roi = result.roi
        roi.chend = min(roi.chend, self.nchannels or roi.chend)
        oiio.ImageBufAlgo.noise(result, self.type, low, high, self.mono, self.seed, roi)
        return result


# --- NaN and Inf ---


@dataclass(frozen=True, kw_only=True)
class FixNonFinite(Area):
    """Replace NaN and infinite values."""

    name: ClassVar[str] = "fixnan"

    source: Image = image(help="the image")
    strategy: str = argument(
        choices=("none", "black", "box3", "error"),
        help="by 0 (black), or by the mean of the finite values among the 8 neighbours (box3); error: refuse the image",
    )

    def halo(self) -> tuple[int, int]:
        """The neighbours, where they are looked at."""
        return (1, 1) if self.strategy == "box3" else (0, 0)

    def apply(self, target: oiio.ImageSpec, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """Repaired."""
        window, spec = Window.data(target), buffers[0].spec()
        pixels = pixels_of(buffers[0], spec.format)
        out = pixels[window.inside(Window.data(spec))]
        if np.issubdtype(pixels.dtype, np.floating) and self.strategy in ("black", "box3"):
            out = out.copy()
            broken = np.argwhere(~np.isfinite(out))
            out[tuple(broken.T)] = (
                0.0 if self.strategy == "black" else _means(pixels, broken, window, Window.data(spec))
            )
        result = oiio.ImageBuf(window.apply_to(spec))
        result.set_pixels(result.roi, np.ascontiguousarray(out))
        return result

    def result(self, parts: Sequence[Part], session: Session) -> Part:
        """The result, not yet computed; to refuse an image, its pixels are read now."""
        if self.strategy == "error":
            near = cached(parts[0], session.resources.cache)
            count = sum(int((~np.isfinite(near.read(w))).any(axis=2).sum()) for w in bands(near))
            if count:
                raise ImageError(f"{count} pixel(s) have NaN or Inf values")
        return super().result(parts, session)


def _means(pixels: np.ndarray, broken: np.ndarray, window: Window, whole: Window) -> np.ndarray:
    """For values of `window` (row, column, channel), the mean of the finite ones around each in `whole`.

    OpenImageIO repairs in place, so that a value depends on neighbours that happened to be repaired before it; here
    only what was finite counts. Sums are taken row by row in the pixels' own type, as there.
    """
    rows, columns, channels = broken.T
    rows, columns = rows + window.top - whole.top, columns + window.left - whole.left
    total, count = np.zeros(len(broken), pixels.dtype), np.zeros(len(broken), np.int32)
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            y, x = rows + dy, columns + dx
            there = (y >= 0) & (y < whole.height) & (x >= 0) & (x < whole.width)
            values = pixels[np.where(there, y, 0), np.where(there, x, 0), channels]
            there &= np.isfinite(values)
            total += np.where(there, values, 0).astype(pixels.dtype)
            count += there
    wide = total.astype(np.promote_types(pixels.dtype, np.float32))
    return (wide / np.maximum(count, 1).astype(wide.dtype)).astype(pixels.dtype)


OPS: tuple[type[Op], ...] = (
    Clamp,
    Contrast,
    Saturate,
    RangeCompress,
    RangeExpand,
    Normalize,
    Noise,
    FixNonFinite,
)
