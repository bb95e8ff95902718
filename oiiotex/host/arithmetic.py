# SPDX-License-Identifier: Apache-2.0
"""Arithmetic, and compositing of flat and of deep images."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from ..core.image import Image, Part
from ..core.parameters import Numbers, argument, image, param
from ..deferred import oiio
from ..errors import ImageError, ParameterError
from .kinds import AtOnce, OneImage, PointOp, op, worked

if TYPE_CHECKING:
    from ..session import Session

log = logging.getLogger("oiiotex")


def per_channel(given: Sequence[float], count: int, neutral: float) -> tuple[float, ...]:
    """A value for each channel: the one there is, or those given with `neutral` for the channels that get none."""
    given = tuple(given[:count]) if len(given) > 1 else tuple(given) * count
    return given + (neutral,) * (count - len(given))


def numbers_for_channels(text: str, count: int, default: float, name: str = "") -> tuple[float, ...]:
    """A comma-separated list as one number for each channel: `default` where a place is empty or missing.

    A single number holds for all channels. Where a place holds something else, a ParameterError names the modifier.
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

    def operands_after(self, *given: Any) -> Sequence[Any]:
        """A value for every channel of the image."""
        return [per_channel(self.value, given[0].nchannels, self.neutral)]


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
    op("invert", "Subtract the color from 1.", OneImage, _invert,
       chbegin=param(0, ge=0, help="the first channel that is inverted"),
       chend=(int | None, param(None, ge=1, help="the channel behind the last; 3 at most when left out"))),
    op("polar", "Turn two channels (real, imaginary) into (amplitude, phase).", OneImage, "complex_to_polar"),
    op("unpolar", "Turn two channels (amplitude, phase) into (real, imaginary).", OneImage, "polar_to_complex"),
)  # fmt: skip


# --- compositing ---


def warn_of_second_unpremult(spec: oiio.ImageSpec) -> None:
    """Say so where colors that have been divided by alpha are to be divided again."""
    if spec.get_int_attribute("oiio:UnassociatedAlpha") and spec.alpha_channel >= 0:
        log.warning("the image says that its colors are not multiplied by alpha, and they are divided by it once more")


@dataclass(frozen=True, kw_only=True)
class ByAlpha(OneImage):
    """Color by alpha."""

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
    op("premult", "Multiply the color by alpha.", ByAlpha),
    op("unpremult", "Divide the color by alpha.", ByAlpha),
    op("repremult", "Multiply the color by alpha, but leave it where alpha is 0.", ByAlpha),
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
