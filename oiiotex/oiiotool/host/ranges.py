# SPDX-License-Identifier: Apache-2.0
"""Ranges of values: contrast, clamping, noise, repair."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from ...engine.core.demand import bands, cached
from ...engine.core.image import Image, Part, pixels_of
from ...engine.core.op import Plan
from ...engine.core.parameters import LARGEST, Numbers, argument, param
from ...engine.core.window import Window
from ...engine.deferred import np, oiio
from ...engine.errors import ImageError
from ...engine.session import Session
from ...engine.session.facts import Facts
from .arithmetic import numbers_for_channels
from .kinds import OneImage, filled, op, window_of
from .remapping import Area


def _clamp(source: oiio.ImageBuf, low: str, high: str, alpha: bool) -> oiio.ImageBuf:
    """The image, clamped."""
    least = numbers_for_channels(low, source.nchannels, -LARGEST, "min")
    most = numbers_for_channels(high, source.nchannels, LARGEST, "max")
    return oiio.ImageBufAlgo.clamp(source, least, most, alpha)


def _contrast(
    source: oiio.ImageBuf, black: Numbers, white: Numbers, low: Numbers, high: Numbers, steep: Numbers, middle: Numbers,
    clamp: bool,
) -> oiio.ImageBuf:  # fmt: skip
    """The image, remapped; the last value given holds for further channels."""
    result = oiio.ImageBufAlgo.contrast_remap(source, black, white, low, high, steep, middle)
    if clamp:
        oiio.ImageBufAlgo.clamp(result, result, low, high)
    return result


def _normalize(source: oiio.ImageBuf, incenter: float, outcenter: float, scale: float) -> oiio.ImageBuf:
    """Unit vectors; a fourth channel is copied."""
    if source.nchannels not in (3, 4):
        raise ImageError(f"the image has {source.nchannels} channels", expected="3 or 4")
    return oiio.ImageBufAlgo.normalize(source, incenter, outcenter, scale)


def _noise(
    source: oiio.ImageBuf, type: str, mean: float, stddev: float, min: float, max: float, value: float,
    portion: float, mono: bool, seed: int, nchannels: int | None,
) -> oiio.ImageBuf:  # fmt: skip
    """The image with noise added."""
    low, high = {"gaussian": (mean, stddev), "salt": (value, portion)}.get(type, (min, max))
    result = oiio.ImageBufAlgo.copy(source)
    roi = result.roi
    if nchannels is not None and nchannels < roi.chend:
        roi.chend = nchannels
    oiio.ImageBufAlgo.noise(result, type, low, high, mono, seed, roi)
    return result


def _fixnan(source: oiio.ImageBuf, roi: oiio.ROI, strategy: str) -> oiio.ImageBuf:
    """A window of the image without NaN and Inf."""
    window, spec = window_of(roi), source.spec()
    whole = Window.data(spec)
    pixels = pixels_of(source, spec.format)
    out = np.array(pixels[window.inside(whole)])
    if np.issubdtype(pixels.dtype, np.floating) and strategy in ("black", "box3"):
        broken = np.argwhere(~np.isfinite(out))
        out[tuple(broken.T)] = 0.0 if strategy == "black" else _means(pixels, broken, window, whole)
    return filled(window.apply_to(spec), out)


def _means(pixels: np.ndarray, broken: np.ndarray, window: Window, whole: Window) -> np.ndarray:
    """For each broken value of `window` (row, column, channel), the mean of its finite neighbors in `whole`.

    OpenImageIO repairs in place, so a value depends on the neighbors repaired before it. Here only values that were
    finite count. Sums are taken row by row in the pixels' own type, as in OpenImageIO.
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
    """Replace NaN and Inf values."""

    name: ClassVar[str] = "fixnan"
    function = staticmethod(_fixnan)

    strategy: str = argument(
        choices=("none", "black", "box3", "error"),
        help="Replacement. none: the values are kept; black: 0; box3: the mean of the finite values among the"
        " 8 neighbors; error: the run stops with an error.",
    )

    def halo(self) -> tuple[int, int]:
        """The radius of the neighborhood."""
        return (1, 1) if self.strategy == "box3" else (0, 0)

    def make(self, plan: Plan, session: Session) -> Image:
        """The result, not yet computed; with `error`, all pixels are read now."""
        return self.of_parts(session.resources, self._finite) if self.strategy == "error" else plan.results

    def _finite(self, parts: Sequence[Part], facts: Facts) -> Part:
        near = cached(parts[0], facts.cache)
        count = sum(int((~np.isfinite(near.read(w))).any(axis=2).sum()) for w in bands(near))
        if count:
            raise ImageError(f"{count} pixel(s) have NaN or Inf values")
        return self.result(parts, facts)


def _numbers(value: float, help: str, example: str) -> Any:
    """A parameter with one number for all channels, or one per channel."""
    return param(Numbers((value,)), help=help, example=example)


def _bound(which: str, example: str) -> Any:
    help = f"{which} bound of all channels, or a comma-separated list. An empty entry sets no bound."
    return param("", help=help, example=example)


_LUMA = {"luma": param(False, help="Scale all channels by the luma instead of each channel separately.")}

RANGES = (
    op("clamp", "Clamp values to bounds.", OneImage, _clamp, min=_bound("Lower", "0"), max=_bound("Upper", "1,1,1,"),
       clampalpha=param(False, help="Clamp alpha to 0 to 1 as well.")),
    op("contrast", "Remap values from [black, white] to [min, max], linearly or along a sigmoid.", OneImage, _contrast,
       black=_numbers(0.0, "Input value that becomes min: one value, or one per channel.", "0.1"),
       white=_numbers(1.0, "Input value that becomes max. If equal to black, values are thresholded.", "0.9"),
       min=_numbers(0.0, "Output value for black.", "0.1"),
       max=_numbers(1.0, "Output value for white.", "0.9"),
       scontrast=_numbers(1.0, "Slope of the sigmoid. 1 is linear.", "5"),
       sthresh=_numbers(0.5, "Position of the steepest slope, between 0 (black) and 1 (white).", "0.4"),
       clamp=param(False, help="Clamp the result to [min, max].")),
    op("saturate", "Scale the saturation of the first three channels.", OneImage,
       scale=(float, argument(help="Saturation factor: 0 yields gray, 1 changes nothing.", example="1.2"))),
    op("rangecompress", "Compress the range of pixel values on a log scale.", OneImage, **_LUMA),
    op("rangeexpand", "Expand pixel values from the log scale of --rangecompress back to linear.", OneImage, **_LUMA),
    op("normalize", "Normalize the vectors in the first three channels to unit length, as in a normal map.", OneImage,
       _normalize,
       incenter=param(0.0, help="Value that encodes 0 in the input: 0.5 for normals stored as 0 to 1.", example="0.5"),
       outcenter=param(0.0, help="Value that encodes 0 in the result.", example="0.5"),
       scale=param(1.0, help="Length of the vectors in the result.", example="0.5")),
    op("noise", "Add noise that depends only on the seed and the pixel's coordinates.", OneImage, _noise,
       type=param("gaussian", choices=("gaussian", "white", "uniform", "salt"), help="Noise distribution."),
       mean=param(0.0, help="Mean of gaussian noise.", example="0.1"),
       stddev=param(0.1, ge=0, help="Standard deviation of gaussian noise."),
       min=param(0.0, help="Minimum of uniform noise.", example="-0.1"),
       max=param(0.1, help="Maximum of uniform noise."),
       value=param(0.0, help="Value of the pixels that salt noise replaces."),
       portion=param(0.01, ge=0, le=1, help="Fraction of the pixels that salt noise replaces."),
       mono=param(False, help="Use the same noise in all channels."),
       seed=param(0, ge=-(1 << 31), le=(1 << 31) - 1, help="Seed of the random numbers."),
       nchannels=(int | None, param(None, ge=1, unset="all", advanced=True, example="3",
                                    help="Number of channels, from the first, that get noise."))),
    FixNonFinite,
)  # fmt: skip
