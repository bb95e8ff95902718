# SPDX-License-Identifier: Apache-2.0
"""Ranges of values: contrast, clamping, noise, repair."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from ..core.demand import bands, cached
from ..core.image import Part, pixels_of
from ..core.parameters import Numbers, argument, param
from ..core.window import Window
from ..deferred import np, oiio
from ..errors import ImageError
from ..session import Session
from .arithmetic import numbers_for_channels
from .kinds import OneImage, filled, op, window_of
from .remapping import Area

_LARGEST = (2 - 2**-23) * 2.0**127  # that a 32-bit float holds


def _clamp(source: oiio.ImageBuf, low: str, high: str, alpha: bool) -> oiio.ImageBuf:
    """Within bounds."""
    least = numbers_for_channels(low, source.nchannels, -_LARGEST, "min")
    most = numbers_for_channels(high, source.nchannels, _LARGEST, "max")
    return oiio.ImageBufAlgo.clamp(source, least, most, alpha)


def _contrast(
    source: oiio.ImageBuf, black: Numbers, white: Numbers, low: Numbers, high: Numbers, steep: Numbers, middle: Numbers,
    clamp: bool,
) -> oiio.ImageBuf:  # fmt: skip
    """Remapped; the last value given holds for further channels."""
    result = oiio.ImageBufAlgo.contrast_remap(source, black, white, low, high, steep, middle)
    if clamp:
        oiio.ImageBufAlgo.clamp(result, result, low, high)
    return result


def _normalize(source: oiio.ImageBuf, incenter: float, outcenter: float, scale: float) -> oiio.ImageBuf:
    """Unit vectors; a fourth channel stays."""
    if source.nchannels not in (3, 4):
        raise ImageError(f"takes images of 3 or 4 channels; this one has {source.nchannels}")
    return oiio.ImageBufAlgo.normalize(source, incenter, outcenter, scale)


def _noise(
    source: oiio.ImageBuf, type: str, mean: float, stddev: float, min: float, max: float, value: float,
    portion: float, mono: bool, seed: int, nchannels: int | None,
) -> oiio.ImageBuf:  # fmt: skip
    """Noisy."""
    low, high = {"gaussian": (mean, stddev), "salt": (value, portion)}.get(type, (min, max))
    result = oiio.ImageBufAlgo.copy(source)
    roi = result.roi
    if nchannels is not None and nchannels < roi.chend:
        roi.chend = nchannels
    oiio.ImageBufAlgo.noise(result, type, low, high, mono, seed, roi)
    return result


def _fixnan(source: oiio.ImageBuf, roi: oiio.ROI, strategy: str) -> oiio.ImageBuf:
    """Repaired."""
    window, spec = window_of(roi), source.spec()
    whole = Window.data(spec)
    pixels = pixels_of(source, spec.format)
    out = np.array(pixels[window.inside(whole)])
    if np.issubdtype(pixels.dtype, np.floating) and strategy in ("black", "box3"):
        broken = np.argwhere(~np.isfinite(out))
        out[tuple(broken.T)] = 0.0 if strategy == "black" else _means(pixels, broken, window, whole)
    return filled(window.apply_to(spec), out)


def _means(pixels: np.ndarray, broken: np.ndarray, window: Window, whole: Window) -> np.ndarray:
    """For values of `window` (row, column, channel), the mean of the finite ones around each in `whole`.

    OpenImageIO repairs in place, so that a value depends on neighbors that happened to be repaired before it; here
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


@dataclass(frozen=True, kw_only=True)
class FixNonFinite(Area):
    """Replace NaN and infinite values."""

    name: ClassVar[str] = "fixnan"
    function = staticmethod(_fixnan)

    strategy: str = argument(
        choices=("none", "black", "box3", "error"),
        help="by 0 (black), or by the mean of the finite values among the 8 neighbors (box3); error: refuse the image",
    )

    def halo(self) -> tuple[int, int]:
        """The neighbors, where they are looked at."""
        return (1, 1) if self.strategy == "box3" else (0, 0)

    def result(self, parts: Sequence[Part], session: Session) -> Part:
        """The result, not yet computed; to refuse an image, its pixels are read now."""
        if self.strategy == "error":
            near = cached(parts[0], session.resources.cache)
            count = sum(int((~np.isfinite(near.read(w))).any(axis=2).sum()) for w in bands(near))
            if count:
                raise ImageError(f"{count} pixel(s) have NaN or Inf values")
        return super().result(parts, session)


def _numbers(value: float, help: str) -> Any:
    """A parameter: one number, for all channels or for each."""
    return param(Numbers((value,)), help=help)


def _bound(which: str) -> Any:
    text = f"{which} bound of all channels, or a comma-separated list; an empty place sets no bound"
    return param("", help=text)


_LUMA = {"luma": param(False, help="scale colors by their luma, instead of each channel alone")}

RANGES = (
    op("clamp", "Keep values within bounds.", OneImage, _clamp, min=_bound("lower"), max=_bound("upper"),
       clampalpha=param(False, help="keep alpha in 0 .. 1 as well")),
    op("contrast", "Remap values from black .. white to min .. max, straight or along a sigmoid.", OneImage, _contrast,
       black=_numbers(0.0, "what becomes min, for all channels or for each"),
       white=_numbers(1.0, "what becomes max; equal to black: a threshold"),
       min=_numbers(0.0, "what black becomes"),
       max=_numbers(1.0, "what white becomes"),
       scontrast=_numbers(1.0, "slope of the sigmoid; 1: a straight line"),
       sthresh=_numbers(0.5, "where the sigmoid is steepest, 0 at black and 1 at white"),
       clamp=param(False, help="keep the result within min .. max")),
    op("saturate", "Scale the saturation of the first three channels.", OneImage,
       scale=(float, argument(help="0 leaves gray, 1 changes nothing"))),
    op("rangecompress", "Compress large values on a log scale.", OneImage, **_LUMA),
    op("rangeexpand", "Undo --rangecompress.", OneImage, **_LUMA),
    op("normalize", "Give the vectors in the first three channels unit length: repair a normal map.", OneImage,
       _normalize,
       incenter=param(0.0, help="what stands for 0 in the image: 0.5 for normals stored in 0 .. 1"),
       outcenter=param(0.0, help="what stands for 0 in the result"),
       scale=param(1.0, help="length of the result's vectors")),
    op("noise", "Add noise; the same seed gives the same noise at a pixel, whatever the image.", OneImage, _noise,
       type=param("gaussian", choices=("gaussian", "white", "uniform", "salt"), help="distribution"),
       mean=param(0.0, help="of gaussian noise"),
       stddev=param(0.1, ge=0, help="standard deviation of gaussian noise"),
       min=param(0.0, help="of uniform noise"),
       max=param(0.1, help="of uniform noise"),
       value=param(0.0, help="what salt noise puts"),
       portion=param(0.01, ge=0, le=1, help="of the pixels that salt noise replaces"),
       mono=param(False, help="the same noise in all channels"),
       seed=param(0, ge=-(1 << 31), le=(1 << 31) - 1, help="another seed, other noise"),
       nchannels=(int | None, param(None, ge=1, help="only in the first channels; all when left out"))),
    FixNonFinite,
)  # fmt: skip
