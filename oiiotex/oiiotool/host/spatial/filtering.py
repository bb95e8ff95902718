# SPDX-License-Identifier: Apache-2.0
"""Filters over a neighborhood or the whole image."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from ....engine.core.access import Whole
from ....engine.core.image import Image, Part, in_memory
from ....engine.core.op import Plan
from ....engine.core.parameters import Numbers, argument, image, nearest, param
from ....engine.core.tiling import repeated, retiled
from ....engine.core.window import Window
from ....engine.deferred import oiio
from ....engine.errors import ImageError, ParameterError
from ....engine.io.cryptomatte import require_no_ids, require_unmixed
from ....engine.session import Session
from ....engine.session.facts import Facts
from ..geometry_text import parse_size
from ..kinds import AtOnce, Hosted, checked, op, window_of
from ..remapping import Area, remapped, require_kernel, with_edges
from .warping import FILTERS

KERNELS = (*FILTERS, "binomial", "laplacian")
_STACK = 1 << 20  # bytes; OpenImageIO sorts a median's values on a thread's stack, and crashes if it overflows
_PERIOD = 12  # px, of all mosaic patterns


def kernel_of(name: str, width: float, height: float) -> oiio.ImageBuf:
    """A kernel centered at the origin; raises as `kernel_size` does."""
    kernel_size(name, width, height)
    return checked(oiio.ImageBufAlgo.make_kernel(name, width, height))


def kernel_size(name: str, width: float, height: float) -> tuple[int, int]:
    """Columns and rows of the kernel that `kernel_of` would make, odd numbers; 0 stands for the filter's own width.

    Raises ParameterError for an unknown kernel, or a size that it cannot have.
    """
    if name not in KERNELS:
        raise ParameterError(f"unknown kernel {name}{nearest(name, KERNELS)}", expected=f"one of {', '.join(KERNELS)}")
    size = f"kernel {width:g}x{height:g}"
    if width < 0 or height < 0:
        raise ParameterError(size, expected="a size >= 0")
    # OpenImageIO would read past the end of these kernels
    if name == "binomial" and not (width % 2 == height % 2 == 1):
        raise ParameterError(size, expected="odd integer sizes for a binomial kernel")
    if name == "laplacian" and (width, height) != (3, 3):
        raise ParameterError(size, expected="3x3 for a laplacian kernel")
    columns = width or FILTERS.get(name, 1)
    rows = height or columns
    return math.ceil(columns) | 1, math.ceil(rows) | 1


def _reach(kernel: Part) -> tuple[int, int]:
    """The larger reach of a kernel across (left or right) and down (up or down), px."""
    window = kernel.window
    return max(abs(window.left), abs(window.right - 1)), max(abs(window.top), abs(window.bottom - 1))


def _blur_halo(use: Any) -> tuple[int, int]:
    """Half the kernel."""
    columns, rows = kernel_size(use.kernel, *parse_size(use.size))
    return columns // 2, rows // 2


@dataclass(frozen=True, kw_only=True)
class Convolve(Area):
    """Convolve the image with a kernel image, centered at its origin."""

    name: ClassVar[str] = "convolve"

    kernel: Image = image(help="Kernel, of which the first channel is used.")

    def halo(self) -> tuple[int, int]:
        """The largest reach of the kernel's parts."""
        across, down = zip(*map(_reach, self.kernel.parts), strict=True)
        return max(across), max(down)

    def result(self, parts: Sequence[Part], facts: Facts) -> Part:
        """The convolved part, not yet computed; the whole kernel is in memory."""
        kernel = parts[1]
        require_kernel(kernel.spec.width, kernel.spec.height, facts)
        facts.require(kernel.spec.width * kernel.spec.height * kernel.pixel_bytes, "a kernel")
        weights = functools.cache(lambda: kernel.buffer(kernel.window))

        def apply(target: oiio.ImageSpec, buffer: oiio.ImageBuf) -> oiio.ImageBuf:
            return oiio.ImageBufAlgo.convolve(buffer, weights(), True, Window.data(target).roi(target.nchannels))

        return remapped(self, parts[:1], parts[0].spec, lambda wanted: self.needs(wanted, ()), apply, facts)


@dataclass(frozen=True, kw_only=True)
class Ranked(Area):
    """Replaces each value by one from its neighborhood."""

    size: str = argument(help="Width and height WxH of the neighborhood, in integer pixels.", example="5x5")

    def operands_after(self, *given: Any) -> Sequence[Any]:
        """Width and height, before the region."""
        width, height = parse_size(self.size)
        if width % 1 or height % 1 or width < 1 or height < 0:
            raise ParameterError(parameter="size", value=self.size, expected="integers WxH, at least 1x1")
        return int(width), int(height) or int(width)

    def halo(self) -> tuple[int, int]:
        """Half the size."""
        width, height = self.operands_after()
        return max(1, width // 2), max(1, height // 2)


def _median(source: oiio.ImageBuf, roi: oiio.ROI, width: int, height: int) -> oiio.ImageBuf:
    """The median-filtered window."""
    _require_stack("size", f"{width}x{height}", width * height, roi)
    return oiio.ImageBufAlgo.median_filter(source, width, height, roi)


def _require_stack(parameter: str, value: str, neighbors: int, roi: oiio.ROI) -> None:
    """Refuse a median that would overflow its stack."""
    most = _STACK // (4 * roi.nchannels)
    if neighbors > most:
        expected = f"at most {most} pixels for {roi.nchannels} channels"
        raise ParameterError(parameter=parameter, value=value, expected=expected)


@dataclass(frozen=True, kw_only=True)
class Unsharp(Area):
    """Sharpen with an unsharp mask."""

    name: ClassVar[str] = "unsharp"

    kernel: str = param("gaussian", help="Kernel of the blur, such as gaussian or box, or median.", example="median")
    width: float = param(3.0, ge=0, unit="px", help="Width of the kernel.")
    contrast: float = param(1.0, help="Factor for the difference that is added to the image.")
    threshold: float = param(0.0, help="Absolute difference below which pixels are not changed.", example="0.02")

    def half(self) -> int:
        """The radius of each blur."""
        if self.kernel == "median":
            return max(1, math.ceil(self.width) // 2)
        if self.width > 3:  # ImageBufAlgo::unsharp_mask blurs the columns, then the rows
            return kernel_size(self.kernel, 1, self.width)[1] // 2
        return kernel_size(self.kernel, self.width, self.width)[0] // 2

    def neighborhood(self) -> tuple[int, int]:
        """The neighborhood of each one-dimensional blur; a median has two dimensions."""
        return 2 * self.half() + 1, 2 * self.half() + 1 if self.kernel == "median" else 1

    def halo(self) -> tuple[int, int]:
        """Two blurs, one after the other."""
        return 2 * self.half(), 2 * self.half()

    def needs(self, window: Window, specs: Sequence[oiio.ImageSpec]) -> Sequence[Window]:
        """The second blur's halo with the edge pixels that it repeats, and around it the first blur's halo."""
        half = self.half()
        return [with_edges(window.grown(half), specs[0]).grown(half)]

    def called(self, source: oiio.ImageBuf, roi: oiio.ROI) -> oiio.ImageBuf:
        """The sharpened window, from all of `source`: the second blur reads results of the first around the window."""
        if self.kernel == "median":
            _require_stack("width", f"{self.width:g}", math.ceil(self.width) ** 2, roi)
        values = (self.kernel, self.width, self.contrast, self.threshold)
        return oiio.ImageBufAlgo.crop(checked(oiio.ImageBufAlgo.unsharp_mask(source, *values)), roi=roi)


@dataclass(frozen=True, kw_only=True)
class FillHoles(Hosted, Whole):
    """Fill holes (pixels with alpha below 1) from their surroundings."""

    name: ClassVar[str] = "fillholes"
    wraps: ClassVar[bool] = True

    source: Image = image(help="Image with alpha.")

    def plan(self, facts: Facts) -> Plan:
        """The union of data and display window."""
        part = self.source.first
        require_unmixed(part, self.flag())
        require_no_ids(part, self.flag())
        whole, around = part.window | Window.display(part.spec), self._around(part)
        pixels = (around.width * around.height) * 4 + whole.width * whole.height
        facts.require(pixels * part.spec.nchannels * 4, self.flag())
        return Plan(work=whole)

    def _around(self, part: Part) -> Window:
        """The pixels that holes are filled from: of a tile, also half of it beyond the border."""
        return part.window.grown(part.window.width // 2, part.window.height // 2) & repeated(part).window

    def make(self, plan: Plan, session: Session) -> Image:
        """The first part, filled over that window."""
        part, whole, around = self.source.first, plan.work, self._around(self.source.first)
        spec = (whole | around).apply_to(part.spec)
        spec.set_format(part.working_type)
        result = oiio.ImageBuf(spec)
        oiio.ImageBufAlgo.fillholes_pushpull(result, repeated(part).buffer(around))
        filled = oiio.ImageBufAlgo.crop(checked(result), roi=whole.roi(spec.nchannels))
        made = in_memory(part.name, checked(filled))
        return Image((retiled(made, self.tiling([part], made)),), self.source.source)


@dataclass(frozen=True, kw_only=True)
class Fourier(AtOnce):
    """A Fourier transform."""

    untiles: ClassVar[bool] = True

    source: Image = image(help="Input image.")

    def result_bytes(self, parts: Sequence[Part]) -> int:
        """Four buffers of two channels."""
        whole = parts[0].window | Window.display(parts[0].spec)
        return whole.width * whole.height * 2 * 4 * 4


def _ifft(source: oiio.ImageBuf) -> oiio.ImageBuf:
    """The inverse transform."""
    spec = source.spec()
    if spec.nchannels != 2 or Window.data(spec) != Window(0, 0, spec.full_width, spec.full_height):
        # ImageBufAlgo::ifft aborts the process for other windows
        raise ImageError(expected="the result of --fft: two channels, display window equal to the data window")
    is_float = spec.format == oiio.TypeDesc(oiio.FLOAT)
    return oiio.ImageBufAlgo.ifft(source if is_float else oiio.ImageBufAlgo.copy(source, oiio.FLOAT))


class Decorrelation(AtOnce):
    """A decorrelation stretch."""

    def plan(self, facts: Facts) -> Plan:
        """As of `AtOnce`; an older OpenImageIO is refused."""
        if not hasattr(oiio.ImageBufAlgo, "decorr_stretch"):
            raise ImageError(f"requires OpenImageIO 3.2, but {oiio.VERSION_STRING} is installed")
        return super().plan(facts)


def _decorrelated(source: oiio.ImageBuf, *values: Any) -> oiio.ImageBuf:
    """The stretched image; in one thread, because sums depend on their order."""
    first, count, scale, sigma, mean, percentile, mode = values
    return oiio.ImageBufAlgo.decorr_stretch(source, first, count, scale, sigma, mean, percentile, mode, nthreads=1)


def _moved(buffer: oiio.ImageBuf, x: int, y: int) -> oiio.ImageBuf:
    """The same pixels with both windows moved; a copy unless x and y are 0."""
    if x == y == 0:
        return buffer
    copy = buffer.copy()
    spec = copy.specmod()
    spec.x, spec.y, spec.full_x, spec.full_y = spec.x + x, spec.y + y, spec.full_x + x, spec.full_y + y
    return copy


def _demosaic(
    source: oiio.ImageBuf, roi: oiio.ROI, pattern: str, algorithm: str, layout: str, mode: str, white: Numbers | None
) -> oiio.ImageBuf:
    """The window in color."""
    if white is not None and len(white) not in (3, 4):
        raise ParameterError(parameter="white_balance", value=white, expected="three or four values")
    # ImageBufAlgo computes coordinates modulo the period, which fails for negative ones
    x, y = (-(min(0, edge) // _PERIOD) * _PERIOD for edge in (source.spec().x, source.spec().y))
    there = window_of(roi).shifted(x, y).roi(3)
    balance: Any = white  # None is the function's default, which its type stub lacks
    values = (pattern, algorithm, layout, mode, balance)
    return _moved(checked(oiio.ImageBufAlgo.demosaic(_moved(source, x, y), *values, there)), -x, -y)


FILTERING = (
    op("blur", "Blur the image.", Area,
       lambda source, roi, size, kernel: oiio.ImageBufAlgo.convolve(
           source, kernel_of(kernel, *parse_size(size)), True, roi),
       halo=_blur_halo,
       size=(str, argument(help="Width and height WxH of the kernel, in integer or fractional pixels.", example="5x5")),
       kernel=param("gaussian", help="Kernel, such as gaussian, box, triangle, binomial or disk.", example="box")),
    Convolve,
    op("median", "Median-filter the image.", Ranked, _median),
    op("dilate", "Dilate the image: take the maximum of the neighborhood.", Ranked,
       lambda source, roi, width, height: oiio.ImageBufAlgo.dilate(source, width, height, roi)),
    op("erode", "Erode the image: take the minimum of the neighborhood.", Ranked,
       lambda source, roi, width, height: oiio.ImageBufAlgo.erode(source, width, height, roi)),
    Unsharp,
    op("laplacian", "Filter the image with a 3x3 Laplacian (second derivative).", Area, halo=lambda use: (1, 1)),
    FillHoles,
    op("fft", "Take the Fourier transform of the first channel, as (real, imaginary).", Fourier),
    op("ifft", "Take the inverse Fourier transform of (real, imaginary), as one channel.", Fourier, _ifft),
    op("decorrstretch", "Exaggerate subtle color differences by a decorrelation stretch.", Decorrelation,
       _decorrelated,
       source=(Image, image(help="Input image.")),
       firstchannel=param(0, ge=0, help="First channel to stretch."),
       nchannels=param(0, ge=0, help="Number of channels to stretch. 0: up to three, without alpha and depth."),
       scale=param(1.0, help="Factor for the stretch."),
       sigma=param(0.0, help="Standard deviation of each channel of the result. 0: unchanged.", example="0.2"),
       mean=(float | None, param(None, unset="unchanged", help="Mean of each channel of the result.", example="0.5")),
       percentile=param(0.0, ge=0, le=49.9999, unit="%", help="Percentile, at both ends, that is mapped to 0 and 1."),
       mode=param("covariance", choices=("covariance", "correlation"),
                  help="Matrix whose eigenvectors are the stretched axes.")),
    op("demosaic", "Interpolate color from a raw mosaic.", Area, _demosaic,
       wraps=False, untiles=True,  # a tile need not be a multiple of the pattern
       halo=lambda use: (_PERIOD + 4, _PERIOD + 4),  # two pixels, and at the edges a period of the pattern
       source=(Image, image(help="Raw mosaic.")),
       pattern=param("auto", choices=("auto", "bayer", "xtrans"), help="Type of mosaic. auto: from the metadata."),
       algorithm=param("auto", choices=("auto", "linear", "MHC"), help="Interpolation algorithm."),
       layout=param("auto", help="Order of the color filters. auto: from the metadata.", example="RGGB"),
       white_balance_mode=param("auto", choices=("auto", "manual", "none"),
                                help="Source of the white balance. auto: from the metadata."),
       white_balance=(Numbers | None, param(None, unset="1,1,1", example="2.1,1,1,1.6",
                                            help="Factors R,G1,B,G2 or R,G,B for white_balance_mode=manual."))),
)  # fmt: skip
