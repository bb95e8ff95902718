# SPDX-License-Identifier: Apache-2.0
"""Arithmetic, and compositing of flat and of deep images."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from ...engine.core.image import Image, Part
from ...engine.core.parameters import Numbers, argument, image, param
from ...engine.deferred import oiio
from ...engine.errors import ImageError, ParameterError
from .kinds import AtOnce, OneImage, PointOp, op, worked

if TYPE_CHECKING:
    from ...engine.session.facts import Facts

log = logging.getLogger("oiiotex")


def per_channel(given: Sequence[float], count: int, neutral: float) -> tuple[float, ...]:
    """One value per channel: a single value holds for all; channels without a value get `neutral`."""
    given = tuple(given[:count]) if len(given) > 1 else tuple(given) * count
    return given + (neutral,) * (count - len(given))


def numbers_for_channels(text: str, count: int, default: float, name: str = "") -> tuple[float, ...]:
    """A comma-separated list as one number per channel: `default` where an entry is empty or missing.

    A single number holds for all channels. Any other entry is a ParameterError, which names the modifier.
    """
    words = text.split(",")
    try:
        numbers = [float(word) if word.strip() else default for word in words]
    except ValueError:
        problem, value = ("", text) if name else (f"'{text}'", ...)
        raise ParameterError(
            problem, parameter=name, value=value, expected="a comma-separated list of numbers"
        ) from None
    return per_channel(numbers, count, default)


# --- arithmetic ---


@dataclass(frozen=True, kw_only=True)
class TwoImages(PointOp):
    """Two images, pixel by pixel."""

    a: Image = image(help="First image.")
    b: Image = image(help="Second image.")


@dataclass(frozen=True, kw_only=True)
class ImageAndValues(OneImage):
    """An image and one value for all channels, or one per channel."""

    neutral: ClassVar[float] = 0.0  # for channels without a value

    value: Numbers = argument(help="One value for all channels, or one per channel.", example="1,1.25,0.5")

    def operands_after(self, *given: Any) -> Sequence[Any]:
        """One value for each channel of the image."""
        return [per_channel(self.value, given[0].nchannels, self.neutral)]


def _widened(buffer: oiio.ImageBuf, other: oiio.ImageBuf) -> oiio.ImageBuf:
    """The buffer, followed by the channels that only `other` has; both have the same window."""
    missing = tuple(range(buffer.nchannels, other.nchannels))
    algo = oiio.ImageBufAlgo
    return algo.channel_append(buffer, algo.channels(other, missing)) if missing else buffer


def _maximum(a: oiio.ImageBuf, b: oiio.ImageBuf) -> oiio.ImageBuf:
    """The maximum; OpenImageIO's max reads past the pixel of the image with fewer channels."""
    return oiio.ImageBufAlgo.max(_widened(a, b), _widened(b, a))


def _multiply_add(a: oiio.ImageBuf, b: oiio.ImageBuf, c: oiio.ImageBuf) -> oiio.ImageBuf:
    """A * B + C."""
    counts = [buffer.nchannels for buffer in (a, b, c)]
    if len(set(counts)) > 1:  # OpenImageIO reads past the pixel of an image with fewer
        raise ImageError(f"the images must have the same number of channels, not {', '.join(map(str, counts))}")
    return oiio.ImageBufAlgo.mad(a, b, c)


def _invert(source: oiio.ImageBuf, chbegin: int, chend: int | None) -> oiio.ImageBuf:
    """1 - A, of some channels."""
    end = min(source.nchannels, 3 if chend is None else chend)
    if chbegin >= end:
        raise ParameterError(parameter="chbegin", value=chbegin, expected=f"a channel below {end}")
    roi = source.roi
    roi.chbegin, roi.chend = chbegin, end
    result = oiio.ImageBufAlgo.copy(source)
    oiio.ImageBufAlgo.invert(result, source, roi)
    return result


ARITHMETIC = (
    op("add", "Add two images.", TwoImages),
    op("sub", "Subtract the second image from the first.", TwoImages),
    op("mul", "Multiply two images.", TwoImages),
    op("div", "Divide the first image by the second (division by 0 yields 0).", TwoImages),
    op("scale", "Scale all channels of one image by the single channel of the other.", TwoImages),
    op("absdiff", "Take the absolute difference of two images.", TwoImages),
    op("min", "Take the minimum of two images; channels that only one image has are copied.", TwoImages),
    op("max", "Take the maximum of two images; channels that only one image has are copied.", TwoImages, _maximum),
    op("mad", "Multiply two images and add a third.", PointOp, _multiply_add,
       a=(Image, image(help="First factor.")),
       b=(Image, image(help="Second factor.")),
       c=(Image, image(help="Image to add to the product."))),
    op("addc", "Add a constant to all channels, or one constant per channel.", ImageAndValues, "add",
       aliases=("--cadd",), deep=True),
    op("subc", "Subtract a constant from all channels, or one constant per channel.", ImageAndValues, "sub",
       aliases=("--csub",), deep=True),
    op("mulc", "Multiply all channels by a constant, or by one constant per channel.", ImageAndValues, "mul",
       aliases=("--cmul",), deep=True, neutral=1.0),
    op("divc", "Divide all channels by a constant, or by one constant per channel (division by 0 yields 0).",
       ImageAndValues, "div", deep=True, neutral=1.0),
    op("absdiffc", "Take the absolute difference from a constant, or from one constant per channel.", ImageAndValues,
       "absdiff"),
    op("powc", "Raise all channels to a power, or to one power per channel.", ImageAndValues, "pow",
       aliases=("--cpow",), neutral=1.0),
    op("maxc", "Take the maximum of the image and a constant, or one constant per channel.", ImageAndValues, "max"),
    op("minc", "Take the minimum of the image and a constant, or one constant per channel.", ImageAndValues, "min"),
    op("abs", "Take the absolute value of all pixel values.", OneImage),
    op("invert", "Invert the color: subtract it from 1.", OneImage, _invert,
       chbegin=param(0, ge=0, help="First channel to invert."),
       chend=(int | None, param(None, ge=1, unset="3, at most the number of channels",
                                help="End of the inverted channels: the first one that is not inverted."))),
    op("polar", "Convert two channels from (real, imaginary) to (amplitude, phase).", OneImage, "complex_to_polar"),
    op("unpolar", "Convert two channels from (amplitude, phase) to (real, imaginary).", OneImage, "polar_to_complex"),
)  # fmt: skip


# --- compositing ---


def warn_of_second_unpremult(spec: oiio.ImageSpec) -> None:
    """Warn before unpremultiplied colors are divided by alpha a second time."""
    if spec.get_int_attribute("oiio:UnassociatedAlpha") and spec.alpha_channel >= 0:
        log.warning("the image is already unpremultiplied (oiio:UnassociatedAlpha); it is divided by alpha again")


@dataclass(frozen=True, kw_only=True)
class ByAlpha(OneImage):
    """Multiply or divide color by alpha."""

    def result(self, parts: Sequence[Part], facts: Facts) -> Part:
        """The result, not yet computed. Without alpha, the part unchanged: OpenImageIO would move its pixels."""
        if self.name == "unpremult":
            warn_of_second_unpremult(parts[0].spec)
        return super().result(parts, facts) if parts[0].spec.alpha_channel >= 0 else worked(parts[0])


@dataclass(frozen=True, kw_only=True)
class TwoDeep(AtOnce):
    """Two deep images; OpenImageIO holds them whole."""

    deep: ClassVar[bool] = True

    a: Image = image(help="First deep image.")
    b: Image = image(help="Second deep image.")


COMPOSITING = (
    op("over", "Composite the first image over the second.", TwoImages),
    op("zover", "Composite two images by depth (channel Z): the nearer one over the other.", TwoImages,
       zeroisinf=param(False, help="Treat depth 0 as infinitely far away.")),
    op("premult", "Multiply all color channels by alpha.", ByAlpha),
    op("unpremult", "Divide all color channels by alpha.", ByAlpha),
    op("repremult", "Multiply all color channels by alpha, but keep the color where alpha is 0.", ByAlpha),
    op("deepen", "Convert a flat image to a deep one, with one sample in each nonempty pixel.", AtOnce, deep=True,
       source=(Image, image(help="Flat image.")),
       z=param(1.0, help="Depth of the samples where the image has no channel Z.")),
    op("flatten", "Composite the samples of each pixel of a deep image into a flat image.", AtOnce, deep=True,
       source=(Image, image(help="Deep image."))),
    op("deepmerge", "Merge the samples of two deep images; samples hidden by an opaque one are removed.", TwoDeep,
       "deep_merge"),
    op("deepholdout", "Remove the samples of the first deep image that opaque samples of the second hide.",
       TwoDeep, "deep_holdout"),
)  # fmt: skip
