# SPDX-License-Identifier: Apache-2.0
"""Filters that look at a neighborhood, or at all of the image."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from ...core.access import Whole
from ...core.image import Image, Part, in_memory
from ...core.parameters import Numbers, argument, image, nearest, param
from ...core.window import Window
from ...deferred import oiio
from ...errors import ImageError, ParameterError
from ...session import Session
from ..geometry_text import parse_size
from ..kinds import AtOnce, Hosted, checked, op, window_of
from ..remapping import Area, remapped, require_kernel, with_edges
from .placing import moved
from .warping import FILTERS

KERNELS = (*FILTERS, "binomial", "laplacian")
_STACK = 1 << 20  # bytes; OpenImageIO keeps what a median sorts on a thread's stack, and dies where it is too much
_PERIOD = 12  # of all patterns of mosaics


def kernel_of(name: str, width: float, height: float) -> oiio.ImageBuf:
    """A kernel, its middle at the origin; raises as `kernel_size` does."""
    kernel_size(name, width, height)
    return checked(oiio.ImageBufAlgo.make_kernel(name, width, height))


def kernel_size(name: str, width: float, height: float) -> tuple[int, int]:
    """Columns and rows of the kernel that `kernel_of` would make, odd numbers; 0 stands for the filter's own width.

    Raises ParameterError for a kernel that there is not, or a size that it cannot have.
    """
    if name not in KERNELS:
        raise ParameterError(f"kernel {name}: no such kernel{nearest(name, KERNELS)}; there is {', '.join(KERNELS)}")
    if width < 0 or height < 0:
        raise ParameterError(f"kernel {width:g}x{height:g}: a size of 0 or more is wanted")
    # both read past their end there
    if name == "binomial" and not (width % 2 == height % 2 == 1):
        raise ParameterError(f"kernel {width:g}x{height:g}: a binomial kernel has odd whole sizes")
    if name == "laplacian" and (width, height) != (3, 3):
        raise ParameterError(f"kernel {width:g}x{height:g}: a laplacian kernel is 3x3")
    columns = width or FILTERS.get(name, 1)
    rows = height or columns
    return math.ceil(columns) | 1, math.ceil(rows) | 1


def _reach(kernel: Part) -> tuple[int, int]:
    """How far a kernel looks to the side it looks farther to, each way."""
    window = kernel.window
    return max(abs(window.left), abs(window.right - 1)), max(abs(window.top), abs(window.bottom - 1))


def _blur_halo(use: Any) -> tuple[int, int]:
    """Half the kernel."""
    columns, rows = kernel_size(use.kernel, *parse_size(use.size))
    return columns // 2, rows // 2


@dataclass(frozen=True, kw_only=True)
class Convolve(Area):
    """Convolve with an image, the kernel; its origin is its middle."""

    name: ClassVar[str] = "convolve"

    kernel: Image = image(help="the kernel; its first channel counts")

    def halo(self) -> tuple[int, int]:
        """As far as any of the kernel's parts goes."""
        across, down = zip(*map(_reach, self.kernel.parts), strict=True)
        return max(across), max(down)

    def result(self, parts: Sequence[Part], session: Session) -> Part:
        """The convolved part, not yet computed; the kernel is held whole."""
        kernel = parts[1]
        require_kernel(kernel.spec.width, kernel.spec.height, session)
        session.resources.require(kernel.spec.width * kernel.spec.height * kernel.pixel_bytes, "a kernel")
        weights = kernel.buffer(kernel.window)

        def apply(target: oiio.ImageSpec, buffer: oiio.ImageBuf) -> oiio.ImageBuf:
            return oiio.ImageBufAlgo.convolve(buffer, weights, True, Window.data(target).roi(target.nchannels))

        return remapped(self, parts[:1], parts[0].spec, lambda wanted: self.needs(wanted, ()), apply, session)


@dataclass(frozen=True, kw_only=True)
class Ranked(Area):
    """A pixel becomes one of those around it."""

    size: str = argument(help="width x height in whole pixels")

    def operands_after(self, *given: Any) -> Sequence[Any]:
        """Width and height, before the region."""
        width, height = parse_size(self.size)
        if width % 1 or height % 1 or width < 1 or height < 0:
            raise ParameterError(f"size={self.size}: whole pixels are wanted, 1x1 or more")
        return int(width), int(height) or int(width)

    def halo(self) -> tuple[int, int]:
        """Half the size."""
        width, height = self.operands_after()
        return max(1, width // 2), max(1, height // 2)


def _median(source: oiio.ImageBuf, roi: oiio.ROI, width: int, height: int) -> oiio.ImageBuf:
    """Median filtered."""
    _require_stack(f"size={width}x{height}", width * height, roi)
    return oiio.ImageBufAlgo.median_filter(source, width, height, roi)


def _require_stack(given: str, neighbors: int, roi: oiio.ROI) -> None:
    """Refuse what a median would keep on its stack."""
    if neighbors * roi.nchannels * 4 > _STACK:
        raise ParameterError(f"{given}: too large for {roi.nchannels} channels")


@dataclass(frozen=True, kw_only=True)
class Unsharp(Area):
    """Sharpen: add what a blur takes away."""

    name: ClassVar[str] = "unsharp"

    kernel: str = param("gaussian", help="name of the blur's kernel, or median")
    width: float = param(3.0, ge=0, unit="px", help="of the kernel")
    contrast: float = param(1.0, help="how much of the difference is added")
    threshold: float = param(0.0, help="differences below it are left alone")

    def half(self) -> int:
        """How far each of its blurs looks."""
        if self.kernel == "median":
            return max(1, math.ceil(self.width) // 2)
        if self.width > 3:  # ImageBufAlgo::unsharp_mask blurs the columns, then the rows
            return kernel_size(self.kernel, 1, self.width)[1] // 2
        return kernel_size(self.kernel, self.width, self.width)[0] // 2

    def neighborhood(self) -> tuple[int, int]:
        """Of each of its blurs, of columns and of rows; of a median, of both."""
        return 2 * self.half() + 1, 2 * self.half() + 1 if self.kernel == "median" else 1

    def halo(self) -> tuple[int, int]:
        """One blur's behind the other."""
        return 2 * self.half(), 2 * self.half()

    def needs(self, window: Window, specs: Sequence[oiio.ImageSpec]) -> Sequence[Window]:
        """The second blur's halo with what it repeats at the edges, and around these the first one's."""
        half = self.half()
        return [with_edges(window.grown(half), specs[0]).grown(half)]

    def called(self, source: oiio.ImageBuf, roi: oiio.ROI) -> oiio.ImageBuf:
        """Sharpened, over all that there is: the second blur looks at what the first left beside the window."""
        if self.kernel == "median":
            _require_stack(f"width={self.width:g}", math.ceil(self.width) ** 2, roi)
        values = (self.kernel, self.width, self.contrast, self.threshold)
        return oiio.ImageBufAlgo.crop(checked(oiio.ImageBufAlgo.unsharp_mask(source, *values)), roi=roi)


@dataclass(frozen=True, kw_only=True)
class FillHoles(Hosted, Whole):
    """Fill what is transparent from around it."""

    name: ClassVar[str] = "fillholes"

    source: Image = image(help="the image, with alpha")

    def compute(self, session: Session) -> Image:
        """The first part, over data and display window together, filled."""
        part = self.source.first
        whole = part.window | Window.display(part.spec)
        pixels = (part.spec.width * part.spec.height) * 4 + whole.width * whole.height
        session.resources.require(pixels * part.spec.nchannels * 4, self.flag())
        spec = whole.apply_to(part.spec)
        spec.set_format(part.working_type)
        result = oiio.ImageBuf(spec)
        oiio.ImageBufAlgo.fillholes_pushpull(result, part.buffer(part.window))
        return Image((in_memory(part.name, checked(result)),), self.source.source)


@dataclass(frozen=True, kw_only=True)
class Fourier(AtOnce):
    """A Fourier transform."""

    source: Image = image(help="the image")

    def result_bytes(self, parts: Sequence[Part]) -> int:
        """Two channels, four times."""
        whole = parts[0].window | Window.display(parts[0].spec)
        return whole.width * whole.height * 2 * 4 * 4


def _ifft(source: oiio.ImageBuf) -> oiio.ImageBuf:
    """Transformed back."""
    spec = source.spec()
    if spec.nchannels != 2 or Window.data(spec) != Window(0, 0, spec.full_width, spec.full_height):
        # with other windows ImageBufAlgo::ifft ends the program
        raise ImageError("an image as --fft leaves it is wanted: two channels, data and display window the same")
    is_float = spec.format == oiio.TypeDesc(oiio.FLOAT)
    return oiio.ImageBufAlgo.ifft(source if is_float else oiio.ImageBufAlgo.copy(source, oiio.FLOAT))


def _decorrelated(source: oiio.ImageBuf, *values: Any) -> oiio.ImageBuf:
    """Stretched; in one thread, as sums depend on their order."""
    first, count, scale, sigma, mean, percentile, mode = values
    return oiio.ImageBufAlgo.decorr_stretch(source, first, count, scale, sigma, mean, percentile, mode, nthreads=1)


def _demosaic(
    source: oiio.ImageBuf, roi: oiio.ROI, pattern: str, algorithm: str, layout: str, mode: str, white: Numbers | None
) -> oiio.ImageBuf:
    """In color."""
    if white is not None and len(white) not in (3, 4):
        raise ParameterError(f"white_balance={white}: three or four values are wanted")
    # ImageBufAlgo takes the remainder of coordinates, which fails for negative ones
    x, y = (-(min(0, edge) // _PERIOD) * _PERIOD for edge in (source.spec().x, source.spec().y))
    there = window_of(roi).shifted(x, y).roi(3)
    balance: Any = white  # None is the function's default, which the stub does not say
    values = (pattern, algorithm, layout, mode, balance)
    return moved(checked(oiio.ImageBufAlgo.demosaic(moved(source, x, y), *values, there)), -x, -y)


FILTERING = (
    op("blur", "Blur with a kernel.", Area,
       lambda source, roi, size, kernel: oiio.ImageBufAlgo.convolve(
           source, kernel_of(kernel, *parse_size(size)), True, roi),
       halo=_blur_halo,
       size=(str, argument(help="width x height of the kernel: 5x5, 3.5x1")),
       kernel=param("gaussian", help="name of the kernel: gaussian, box, triangle, binomial, disk ...")),
    Convolve,
    op("median", "Each channel becomes the median of the pixels around it.", Ranked, _median),
    op("dilate", "Each channel becomes the greatest value around it.", Ranked,
       lambda source, roi, width, height: oiio.ImageBufAlgo.dilate(source, width, height, roi)),
    op("erode", "Each channel becomes the least value around it.", Ranked,
       lambda source, roi, width, height: oiio.ImageBufAlgo.erode(source, width, height, roi)),
    Unsharp,
    op("laplacian", "The second derivative, by a 3x3 kernel.", Area, halo=lambda use: (1, 1)),
    FillHoles,
    op("fft", "Fourier transform of the first channel, to real and imaginary.", Fourier),
    op("ifft", "Inverse Fourier transform of real and imaginary, to one channel.", Fourier, _ifft),
    op("decorrstretch", "Stretch colors along their principal axes, so that slight differences show.", AtOnce,
       _decorrelated,
       source=(Image, image(help="the image")),
       firstchannel=param(0, ge=0, help="first channel"),
       nchannels=param(0, ge=0, help="how many channels; 0: three, without alpha and depth"),
       scale=param(1.0, help="multiplies the stretch"),
       sigma=param(0.0, help="standard deviation of each result channel; 0: as it was"),
       mean=(float | None, param(None, help="mean of each result channel; as it was when left out")),
       percentile=param(0.0, ge=0, le=49.9999, unit="%", help="map what lies this far from both ends on 0 and 1"),
       mode=param("covariance", choices=("covariance", "correlation"), help="which matrix gives the axes")),
    op("demosaic", "Color from a raw mosaic of color filters.", Area, _demosaic,
       halo=lambda use: (_PERIOD + 4, _PERIOD + 4),  # two pixels, and at the edges a period of the pattern
       source=(Image, image(help="the mosaic")),
       pattern=param("auto", choices=("auto", "bayer", "xtrans"), help="kind of mosaic"),
       algorithm=param("auto", choices=("auto", "linear", "MHC"), help="how color is interpolated"),
       layout=param("auto", help="of the mosaic, such as RGGB, or GRBG; by the metadata if auto"),
       white_balance_mode=param("auto", choices=("auto", "manual", "none"), help="auto: by the metadata"),
       white_balance=(Numbers | None, param(None, help="R,G1,B,G2 or R,G,B; counts if manual"))),
)  # fmt: skip
