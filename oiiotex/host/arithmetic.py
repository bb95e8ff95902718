# SPDX-License-Identifier: Apache-2.0
"""Arithmetic on pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from ..core.image import Image, pixels_of
from ..core.op import Op
from ..core.parameters import Numbers, argument, image, param
from ..deferred import np, oiio
from ..errors import ImageError, ParameterError
from .kinds import PointOp


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


@dataclass(frozen=True, kw_only=True)
class OneImage(PointOp):
    """One image, pixel by pixel."""

    source: Image = image(help="the image")


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

    def apply(self, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """The function of the image and a value for every channel."""
        return self.of_buffers(*buffers, per_channel(self.value, buffers[0].nchannels, self.neutral))


# --- two images ---


@dataclass(frozen=True, kw_only=True)
class Add(TwoImages):
    """Add two images."""

    name: ClassVar[str] = "add"
    function = "add"


@dataclass(frozen=True, kw_only=True)
class Subtract(TwoImages):
    """Subtract the second image from the first."""

    name: ClassVar[str] = "sub"
    function = "sub"


@dataclass(frozen=True, kw_only=True)
class Multiply(TwoImages):
    """Multiply two images."""

    name: ClassVar[str] = "mul"
    function = "mul"


@dataclass(frozen=True, kw_only=True)
class Divide(TwoImages):
    """Divide the first image by the second; what is divided by 0 becomes 0."""

    name: ClassVar[str] = "div"
    function = "div"


@dataclass(frozen=True, kw_only=True)
class Scale(TwoImages):
    """Scale all channels of one image by the single channel of the other."""

    name: ClassVar[str] = "scale"
    function = "scale"


@dataclass(frozen=True, kw_only=True)
class AbsoluteDifference(TwoImages):
    """Take the absolute difference of two images."""

    name: ClassVar[str] = "absdiff"
    function = "absdiff"


@dataclass(frozen=True, kw_only=True)
class Minimum(TwoImages):
    """Take the smaller value of two images; channels that only one of them has are its own."""

    name: ClassVar[str] = "min"
    function = "min"


@dataclass(frozen=True, kw_only=True)
class Maximum(TwoImages):
    """Take the larger value of two images; channels that only one of them has are its own."""

    name: ClassVar[str] = "max"

    def apply(self, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """The larger of A and B."""
        a, b = buffers
        # OpenImageIO's max reads past the pixel of the image that has fewer channels
        return oiio.ImageBufAlgo.max(_widened(a, b), _widened(b, a))


def _widened(buffer: oiio.ImageBuf, other: oiio.ImageBuf) -> oiio.ImageBuf:
    """The buffer with the further channels of another that has the same window."""
    count = buffer.nchannels
    if count >= other.nchannels:
        return buffer
    spec, further = oiio.ImageSpec(buffer.spec()), other.spec()
    spec.nchannels = further.nchannels
    spec.channelnames = (*spec.channelnames[:count], *further.channelnames[count:])
    if spec.alpha_channel < 0 and further.alpha_channel >= count:
        spec.alpha_channel = further.alpha_channel
    if spec.z_channel < 0 and further.z_channel >= count:
        spec.z_channel = further.z_channel
    own = pixels_of(buffer, spec.format)
    theirs = pixels_of(other, spec.format)
    wide = oiio.ImageBuf(spec)
    wide.set_pixels(wide.roi, np.concatenate([own, theirs[..., count:]], axis=-1))
    return wide


@dataclass(frozen=True, kw_only=True)
class MultiplyAdd(PointOp):
    """Multiply two images and add a third."""

    name: ClassVar[str] = "mad"

    a: Image = image(help="the first factor")
    b: Image = image(help="the second factor")
    c: Image = image(help="what is added")

    def apply(self, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """A * B + C."""
        counts = [buffer.nchannels for buffer in buffers]
        if len(set(counts)) > 1:  # OpenImageIO reads past the pixel of an image that has fewer
            raise ImageError(
                f"the images must have the same number of channels; they have {counts[0]}, {counts[1]} and {counts[2]}"
            )
        return oiio.ImageBufAlgo.mad(buffers[0], buffers[1], buffers[2])


# --- an image and values ---


@dataclass(frozen=True, kw_only=True)
class AddValues(ImageAndValues):
    """Add to all channels a value, or to each its own."""

    name: ClassVar[str] = "addc"
    deep: ClassVar[bool] = True
    aliases: ClassVar[tuple[str, ...]] = ("--cadd",)
    function = "add"


@dataclass(frozen=True, kw_only=True)
class SubtractValues(ImageAndValues):
    """Subtract from all channels a value, or from each its own."""

    name: ClassVar[str] = "subc"
    deep: ClassVar[bool] = True
    aliases: ClassVar[tuple[str, ...]] = ("--csub",)
    function = "sub"


@dataclass(frozen=True, kw_only=True)
class MultiplyValues(ImageAndValues):
    """Multiply all channels by a value, or each by its own."""

    name: ClassVar[str] = "mulc"
    deep: ClassVar[bool] = True
    aliases: ClassVar[tuple[str, ...]] = ("--cmul",)
    function = "mul"
    neutral = 1.0


@dataclass(frozen=True, kw_only=True)
class DivideValues(ImageAndValues):
    """Divide all channels by a value, or each by its own; what is divided by 0 becomes 0."""

    name: ClassVar[str] = "divc"
    deep: ClassVar[bool] = True
    function = "div"
    neutral = 1.0


@dataclass(frozen=True, kw_only=True)
class AbsoluteDifferenceValues(ImageAndValues):
    """Take the absolute difference from a value, or for each channel from its own."""

    name: ClassVar[str] = "absdiffc"
    function = "absdiff"


@dataclass(frozen=True, kw_only=True)
class Power(ImageAndValues):
    """Raise all channels to a power, or each to its own."""

    name: ClassVar[str] = "powc"
    aliases: ClassVar[tuple[str, ...]] = ("--cpow",)
    function = "pow"
    neutral = 1.0


@dataclass(frozen=True, kw_only=True)
class MaximumValues(ImageAndValues):
    """Raise what is smaller to a value, or in each channel to its own."""

    name: ClassVar[str] = "maxc"
    function = "max"


@dataclass(frozen=True, kw_only=True)
class MinimumValues(ImageAndValues):
    """Lower what is larger to a value, or in each channel to its own."""

    name: ClassVar[str] = "minc"
    function = "min"


# --- one image ---


@dataclass(frozen=True, kw_only=True)
class Absolute(OneImage):
    """Take the absolute value."""

    name: ClassVar[str] = "abs"
    function = "abs"


@dataclass(frozen=True, kw_only=True)
class Invert(OneImage):
    """Subtract the colour from 1."""

    name: ClassVar[str] = "invert"

    chbegin: int = param(0, ge=0, help="the first channel that is inverted")
    chend: int | None = param(None, ge=1, help="the channel behind the last; 3 at most when left out")

    def apply(self, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """1 - A."""
        (source,) = buffers
        end = min(source.nchannels, 3 if self.chend is None else self.chend)
        if self.chbegin >= end:
            raise ParameterError(
                f"chbegin={self.chbegin}: there is no channel from there to {end}, the image has {source.nchannels}"
            )
        roi = source.roi
        roi.chbegin, roi.chend = self.chbegin, end
        result = oiio.ImageBufAlgo.copy(source)
        oiio.ImageBufAlgo.invert(result, source, roi)
        return result


@dataclass(frozen=True, kw_only=True)
class ComplexToPolar(OneImage):
    """Turn two channels (real, imaginary) into (amplitude, phase)."""

    name: ClassVar[str] = "polar"
    function = "complex_to_polar"


@dataclass(frozen=True, kw_only=True)
class PolarToComplex(OneImage):
    """Turn two channels (amplitude, phase) into (real, imaginary)."""

    name: ClassVar[str] = "unpolar"
    function = "polar_to_complex"


OPS: tuple[type[Op], ...] = (
    Add,
    Subtract,
    Multiply,
    Divide,
    Scale,
    AbsoluteDifference,
    Minimum,
    Maximum,
    MultiplyAdd,
    AddValues,
    SubtractValues,
    MultiplyValues,
    DivideValues,
    AbsoluteDifferenceValues,
    Power,
    MaximumValues,
    MinimumValues,
    Absolute,
    Invert,
    ComplexToPolar,
    PolarToComplex,
)
