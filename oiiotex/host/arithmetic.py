# SPDX-License-Identifier: Apache-2.0
"""Ops pixel by pixel: arithmetic, ranges of values, compositing of flat and of deep images."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from ..core.demand import bands, cached
from ..core.image import Image, Part, pixels_of
from ..core.parameters import Numbers, argument, image, param
from ..core.window import Window
from ..deferred import np, oiio
from ..errors import ImageError, ParameterError
from ..session import Session
from .kinds import AtOnce, OneImage, PointOp, filled, op, window_of, worked
from .remapping import Area

log = logging.getLogger("oiiotex")

_LARGEST = (2 - 2**-23) * 2.0**127  # that a 32-bit float holds


def per_channel(given: Sequence[float], count: int, neutral: float) -> tuple[float, ...]:
    """A value for each channel: the one there is, or those given with `neutral` for the channels that get none."""
    given = tuple(given[:count]) if len(given) > 1 else tuple(given) * count
    return given + (neutral,) * (count - len(given))


def numbers_for_channels(text: str, count: int, default: float, name: str = "") -> tuple[float, ...]:
    """A comma-separated list as one number for each channel: `default` where a place is empty or missing.

    Parameters
    ----------
    text : str
        Such as '0.5,,1'; a single number holds for all channels.
    count : int
        Channels, 1 or more.
    default : float
    name : str
        The modifier, for the error.

    Raises
    ------
    ParameterError
        A place holds something else.
    """
    words = text.split(",")
    try:
        numbers = [float(word) if word.strip() else default for word in words]
    except ValueError:
        given = f"{name}={text}" if name else f"'{text}'"
        raise ParameterError(f"{given}: expected a comma-separated list of numbers") from None
    return per_channel(numbers, count, default)


# --- arithmetic ---


@dataclass(frozen=True, kw_only=True)
class TwoImages(PointOp):
    """Two images, pixel by pixel."""

    a: Image = image(help="the first image")
    b: Image = image(help="the second image")


@dataclass(frozen=True, kw_only=True)
class ImageAndValues(OneImage):
    """An image and a value for all channels, or one for each."""

    neutral: ClassVar[float] = 0.0  # for channels that get no value

    value: Numbers = argument(help="one value for all channels, or one for each")

    def operands_after(self, *buffers: oiio.ImageBuf) -> Sequence[Any]:
        """A value for every channel."""
        return [per_channel(self.value, buffers[0].nchannels, self.neutral)]


def _widened(buffer: oiio.ImageBuf, other: oiio.ImageBuf) -> oiio.ImageBuf:
    """The buffer with the further channels of another that has the same window."""
    missing = tuple(range(buffer.nchannels, other.nchannels))
    algo = oiio.ImageBufAlgo
    return algo.channel_append(buffer, algo.channels(other, missing)) if missing else buffer


def _maximum(a: oiio.ImageBuf, b: oiio.ImageBuf) -> oiio.ImageBuf:
    """The larger; OpenImageIO's max reads past the pixel of the image that has fewer channels."""
    return oiio.ImageBufAlgo.max(_widened(a, b), _widened(b, a))


def _multiply_add(a: oiio.ImageBuf, b: oiio.ImageBuf, c: oiio.ImageBuf) -> oiio.ImageBuf:
    """A * B + C."""
    counts = [buffer.nchannels for buffer in (a, b, c)]
    if len(set(counts)) > 1:  # OpenImageIO reads past the pixel of an image that has fewer
        raise ImageError(
            f"the images must have the same number of channels; they have {counts[0]}, {counts[1]} and {counts[2]}"
        )
    return oiio.ImageBufAlgo.mad(a, b, c)


def _invert(source: oiio.ImageBuf, chbegin: int, chend: int | None) -> oiio.ImageBuf:
    """1 - A, of some channels."""
    end = min(source.nchannels, 3 if chend is None else chend)
    if chbegin >= end:
        raise ParameterError(
            f"chbegin={chbegin}: there is no channel from there to {end}, the image has {source.nchannels}"
        )
    roi = source.roi
    roi.chbegin, roi.chend = chbegin, end
    result = oiio.ImageBufAlgo.copy(source)
    oiio.ImageBufAlgo.invert(result, source, roi)
    return result


ARITHMETIC = (
    op("add", "Add two images.", TwoImages),
    op("sub", "Subtract the second image from the first.", TwoImages),
    op("mul", "Multiply two images.", TwoImages),
    op("div", "Divide the first image by the second; what is divided by 0 becomes 0.", TwoImages),
    op("scale", "Scale all channels of one image by the single channel of the other.", TwoImages),
    op("absdiff", "Take the absolute difference of two images.", TwoImages),
    op("min", "Take the smaller value of two images; channels that only one of them has are its own.", TwoImages),
    op("max", "Take the larger value of two images; channels that only one of them has are its own.", TwoImages,
       _maximum),
    op("mad", "Multiply two images and add a third.", PointOp, _multiply_add,
       a=(Image, image(help="the first factor")),
       b=(Image, image(help="the second factor")),
       c=(Image, image(help="what is added"))),
    op("addc", "Add to all channels a value, or to each its own.", ImageAndValues, "add",
       aliases=("--cadd",), deep=True),
    op("subc", "Subtract from all channels a value, or from each its own.", ImageAndValues, "sub",
       aliases=("--csub",), deep=True),
    op("mulc", "Multiply all channels by a value, or each by its own.", ImageAndValues, "mul",
       aliases=("--cmul",), deep=True, neutral=1.0),
    op("divc", "Divide all channels by a value, or each by its own; what is divided by 0 becomes 0.", ImageAndValues,
       "div", deep=True, neutral=1.0),
    op("absdiffc", "Take the absolute difference from a value, or for each channel from its own.", ImageAndValues,
       "absdiff"),
    op("powc", "Raise all channels to a power, or each to its own.", ImageAndValues, "pow",
       aliases=("--cpow",), neutral=1.0),
    op("maxc", "Raise what is smaller to a value, or in each channel to its own.", ImageAndValues, "max"),
    op("minc", "Lower what is larger to a value, or in each channel to its own.", ImageAndValues, "min"),
    op("abs", "Take the absolute value.", OneImage),
    op("invert", "Subtract the colour from 1.", OneImage, _invert,
       chbegin=param(0, ge=0, help="the first channel that is inverted"),
       chend=(int | None, param(None, ge=1, help="the channel behind the last; 3 at most when left out"))),
    op("polar", "Turn two channels (real, imaginary) into (amplitude, phase).", OneImage, "complex_to_polar"),
    op("unpolar", "Turn two channels (amplitude, phase) into (real, imaginary).", OneImage, "polar_to_complex"),
)  # fmt: skip


# --- ranges of values ---


def _clamp(source: oiio.ImageBuf, low: str, high: str, alpha: bool) -> oiio.ImageBuf:
    """Within bounds."""
    bounds = (
        numbers_for_channels(text, source.nchannels, default, name)
        for text, default, name in ((low, -_LARGEST, "min"), (high, _LARGEST, "max"))
    )
    return oiio.ImageBufAlgo.clamp(source, *bounds, alpha)


def _contrast(source: oiio.ImageBuf, *values: Any) -> oiio.ImageBuf:
    """Remapped; the last value given holds for further channels."""
    *lists, clamp = values
    result = oiio.ImageBufAlgo.contrast_remap(source, *map(tuple, lists))
    if clamp:
        low, high = lists[2:4]
        oiio.ImageBufAlgo.clamp(result, result, tuple(low), tuple(high))
    return result


def _normalize(source: oiio.ImageBuf, *values: float) -> oiio.ImageBuf:
    """Unit vectors; a fourth channel stays."""
    if source.nchannels not in (3, 4):
        raise ImageError(f"takes images of 3 or 4 channels; this one has {source.nchannels}")
    return oiio.ImageBufAlgo.normalize(source, *values)


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


@dataclass(frozen=True, kw_only=True)
class FixNonFinite(Area):
    """Replace NaN and infinite values."""

    name: ClassVar[str] = "fixnan"
    function = staticmethod(_fixnan)

    strategy: str = argument(
        choices=("none", "black", "box3", "error"),
        help="by 0 (black), or by the mean of the finite values among the 8 neighbours (box3); error: refuse the image",
    )

    def halo(self) -> tuple[int, int]:
        """The neighbours, where they are looked at."""
        return (1, 1) if self.strategy == "box3" else (0, 0)

    def result(self, parts: Sequence[Part], session: Session) -> Part:
        """The result, not yet computed; to refuse an image, its pixels are read now."""
        if self.strategy == "error":
            near = cached(parts[0], session.cache)
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


_LUMA = {"luma": param(False, help="scale colours by their luma, instead of each channel alone")}

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


# --- compositing ---


def warn_of_second_unpremult(spec: oiio.ImageSpec) -> None:
    """Say so where colours that have been divided by alpha are to be divided again."""
    if spec.get_int_attribute("oiio:UnassociatedAlpha") and spec.alpha_channel >= 0:
        log.warning("the image says that its colours are not multiplied by alpha, and they are divided by it once more")


@dataclass(frozen=True, kw_only=True)
class ByAlpha(OneImage):
    """Colour by alpha."""

    def result(self, parts: Sequence[Part], session: Session) -> Part:
        """The result, not yet computed; where there is no alpha, what there is: OpenImageIO would move its pixels."""
        if self.name == "unpremult":
            warn_of_second_unpremult(parts[0].spec)
        return super().result(parts, session) if parts[0].spec.alpha_channel >= 0 else worked(parts[0])


@dataclass(frozen=True, kw_only=True)
class TwoDeep(AtOnce):
    """Two deep images; OpenImageIO holds them whole."""

    deep: ClassVar[bool] = True

    a: Image = image(help="the first deep image")
    b: Image = image(help="the second deep image")


COMPOSITING = (
    op("over", "Put the first image over the second, by its alpha.", TwoImages),
    op("zover", "Put that one of two images over the other that is nearer, by channel Z.", TwoImages,
       zeroisinf=param(False, help="depth 0 means infinitely far")),
    op("premult", "Multiply the colour by alpha.", ByAlpha),
    op("unpremult", "Divide the colour by alpha.", ByAlpha),
    op("repremult", "Multiply the colour by alpha, but leave it where alpha is 0.", ByAlpha),
    op("deepen", "Turn a flat image into a deep one, with a sample in each pixel that is not empty.", AtOnce, deep=True,
       source=(Image, image(help="the image")),
       z=param(1.0, help="depth of the samples of an image without channel Z")),
    op("flatten", "Composite the samples of each pixel of a deep image into a flat image.", AtOnce, deep=True,
       source=(Image, image(help="the deep image"))),
    op("deepmerge", "Merge the samples of two deep images; samples behind an opaque one are removed.", TwoDeep,
       "deep_merge"),
    op("deepholdout", "Remove the samples of the first deep image that lie behind an opaque sample of the second.",
       TwoDeep, "deep_holdout"),
)  # fmt: skip
