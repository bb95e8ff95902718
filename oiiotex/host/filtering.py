# SPDX-License-Identifier: Apache-2.0
"""Filters that look at a neighbourhood, or at all of the image."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from ..core.access import Whole
from ..core.image import Image, Part, in_memory
from ..core.op import Op
from ..core.parameters import Numbers, argument, image, nearest, param
from ..core.window import Window
from ..deferred import oiio
from ..errors import ImageError, ParameterError
from ..session import Session
from .geometry_text import parse_size
from .kinds import Area, AtOnce, Hosted, checked, remapped, require_kernel, with_edges
from .turning import moved
from .warping import FILTERS

KERNELS = (*FILTERS, "binomial", "laplacian")
_STACK = 1 << 20  # bytes; OpenImageIO keeps what a median sorts on a thread's stack, and dies where it is too much


def kernel_of(name: str, width: float, height: float) -> oiio.ImageBuf:
    """A kernel, its middle at the origin; raises as `kernel_size` does."""
    kernel_size(name, width, height)
    return checked(oiio.ImageBufAlgo.make_kernel(name, width, height))


def kernel_size(name: str, width: float, height: float) -> tuple[int, int]:
    """Columns and rows of the kernel that `kernel_of` would make, odd numbers; 0 stands for the filter's own width.

    Raises
    ------
    ParameterError
        No such kernel, or a size that it cannot have.
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


@dataclass(frozen=True, kw_only=True)
class Blur(Area):
    """Blur with a kernel."""

    name: ClassVar[str] = "blur"

    source: Image = image(help="the image")
    size: str = argument(help="width x height of the kernel: 5x5, 3.5x1")
    kernel: str = param("gaussian", help="name of the kernel: gaussian, box, triangle, binomial, disk ...")

    def halo(self) -> tuple[int, int]:
        """Half the kernel."""
        columns, rows = kernel_size(self.kernel, *parse_size(self.size))
        return columns // 2, rows // 2

    def apply(self, target: oiio.ImageSpec, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """Convolved."""
        kernel = kernel_of(self.kernel, *parse_size(self.size))
        return oiio.ImageBufAlgo.convolve(buffers[0], kernel, True, Window.data(target).roi(target.nchannels))


@dataclass(frozen=True, kw_only=True)
class Convolve(Area):
    """Convolve with an image, the kernel; its origin is its middle."""

    name: ClassVar[str] = "convolve"

    source: Image = image(help="the image")
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

    source: Image = image(help="the image")
    size: str = argument(help="width x height in whole pixels")

    def sizes(self) -> tuple[int, int]:
        """Width and height."""
        width, height = parse_size(self.size)
        if width % 1 or height % 1 or width < 1 or height < 0:
            raise ParameterError(f"size={self.size}: whole pixels are wanted, 1x1 or more")
        return int(width), int(height) or int(width)

    def halo(self) -> tuple[int, int]:
        """Half the size."""
        width, height = self.sizes()
        return max(1, width // 2), max(1, height // 2)

    def roi(self, target: oiio.ImageSpec) -> oiio.ROI:
        """Of the window wanted."""
        return Window.data(target).roi(target.nchannels)


@dataclass(frozen=True, kw_only=True)
class Median(Ranked):
    """Each channel becomes the median of the pixels around it."""

    name: ClassVar[str] = "median"

    def apply(self, target: oiio.ImageSpec, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """Median filtered."""
        width, height = self.sizes()
        if width * height * target.nchannels * 4 > _STACK:
            raise ParameterError(f"size={self.size}: too large for {target.nchannels} channels")
        return oiio.ImageBufAlgo.median_filter(buffers[0], width, height, self.roi(target))


@dataclass(frozen=True, kw_only=True)
class Dilate(Ranked):
    """Each channel becomes the greatest value around it."""

    name: ClassVar[str] = "dilate"

    def apply(self, target: oiio.ImageSpec, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """Dilated."""
        return oiio.ImageBufAlgo.dilate(buffers[0], *self.sizes(), self.roi(target))


@dataclass(frozen=True, kw_only=True)
class Erode(Ranked):
    """Each channel becomes the least value around it."""

    name: ClassVar[str] = "erode"

    def apply(self, target: oiio.ImageSpec, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """Eroded."""
        return oiio.ImageBufAlgo.erode(buffers[0], *self.sizes(), self.roi(target))


@dataclass(frozen=True, kw_only=True)
class Unsharp(Area):
    """Sharpen: add what a blur takes away."""

    name: ClassVar[str] = "unsharp"

    source: Image = image(help="the image")
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

    def neighbourhood(self) -> tuple[int, int]:
        """Of each of its blurs, of columns and of rows; of a median, of both."""
        return 2 * self.half() + 1, 2 * self.half() + 1 if self.kernel == "median" else 1

    def halo(self) -> tuple[int, int]:
        """One blur's behind the other."""
        return 2 * self.half(), 2 * self.half()

    def needs(self, window: Window, specs: Sequence[oiio.ImageSpec]) -> Sequence[Window]:
        """The second blur's halo with what it repeats at the edges, and around these the first one's."""
        half = self.half()
        return [with_edges(window.grown(half), specs[0]).grown(half)]

    def apply(self, target: oiio.ImageSpec, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """Sharpened, over all that there is: the second blur looks at what the first left beside the window."""
        width = math.ceil(self.width)
        if self.kernel == "median" and width * width * target.nchannels * 4 > _STACK:
            raise ParameterError(f"width={self.width:g}: too large for {target.nchannels} channels")
        result = checked(
            oiio.ImageBufAlgo.unsharp_mask(buffers[0], self.kernel, self.width, self.contrast, self.threshold)
        )
        return oiio.ImageBufAlgo.crop(result, roi=Window.data(target).roi(target.nchannels))


@dataclass(frozen=True, kw_only=True)
class Laplacian(Area):
    """The second derivative, by a 3x3 kernel."""

    name: ClassVar[str] = "laplacian"

    source: Image = image(help="the image")

    def halo(self) -> tuple[int, int]:
        """One pixel."""
        return 1, 1

    def apply(self, target: oiio.ImageSpec, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """Laplacian."""
        return oiio.ImageBufAlgo.laplacian(buffers[0], Window.data(target).roi(target.nchannels))


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
class FFT(AtOnce):
    """Fourier transform of the first channel, to real and imaginary."""

    name: ClassVar[str] = "fft"

    source: Image = image(help="the image")

    def result_bytes(self, parts: Sequence[Part]) -> int:
        """Two channels, four times."""
        whole = parts[0].window | Window.display(parts[0].spec)
        return whole.width * whole.height * 2 * 4 * 4

    def apply(self, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """Transformed."""
        return oiio.ImageBufAlgo.fft(buffers[0])


@dataclass(frozen=True, kw_only=True)
class IFFT(FFT):
    """Inverse Fourier transform of real and imaginary, to one channel."""

    name: ClassVar[str] = "ifft"

    def apply(self, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """Transformed back."""
        spec = buffers[0].spec()
        if spec.nchannels != 2 or Window.data(spec) != Window(0, 0, spec.full_width, spec.full_height):
            # with other windows ImageBufAlgo::ifft ends the program
            raise ImageError("an image as --fft leaves it is wanted: two channels, data and display window the same")
        if spec.format != oiio.TypeDesc(oiio.FLOAT):
            return oiio.ImageBufAlgo.ifft(oiio.ImageBufAlgo.copy(buffers[0], oiio.FLOAT))
        return oiio.ImageBufAlgo.ifft(buffers[0])


@dataclass(frozen=True, kw_only=True)
class DecorrStretch(AtOnce):
    """Stretch colours along their principal axes, so that slight differences show."""

    name: ClassVar[str] = "decorrstretch"

    source: Image = image(help="the image")
    firstchannel: int = param(0, ge=0, help="first channel")
    nchannels: int = param(0, ge=0, help="how many channels; 0: three, without alpha and depth")
    scale: float = param(1.0, help="multiplies the stretch")
    sigma: float = param(0.0, help="standard deviation of each result channel; 0: as it was")
    mean: float | None = param(None, help="mean of each result channel; as it was when left out")
    percentile: float = param(0.0, ge=0, le=49.9999, unit="%", help="map what lies this far from both ends on 0 and 1")
    mode: str = param("covariance", choices=("covariance", "correlation"), help="which matrix gives the axes")

    def apply(self, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """Stretched; in one thread, as sums depend on their order."""
        return oiio.ImageBufAlgo.decorr_stretch(
            buffers[0], self.firstchannel, self.nchannels, self.scale, self.sigma, self.mean, self.percentile,
            self.mode, nthreads=1,
        )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Demosaic(Area):
    """Colour from a raw mosaic of colour filters."""

    name: ClassVar[str] = "demosaic"
    period: ClassVar[int] = 12  # of all patterns

    source: Image = image(help="the mosaic")
    pattern: str = param("auto", choices=("auto", "bayer", "xtrans"), help="kind of mosaic")
    algorithm: str = param("auto", choices=("auto", "linear", "MHC"), help="how colour is interpolated")
    layout: str = param("auto", help="of the mosaic, such as RGGB, or GRBG; by the metadata if auto")
    white_balance_mode: str = param("auto", choices=("auto", "manual", "none"), help="auto: by the metadata")
    white_balance: Numbers | None = param(None, help="R,G1,B,G2 or R,G,B; counts if manual")

    def halo(self) -> tuple[int, int]:
        """Two pixels, and at the edges a period of the pattern."""
        return self.period + 4, self.period + 4

    def apply(self, target: oiio.ImageSpec, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """In colour."""
        if self.white_balance is not None and len(self.white_balance) not in (3, 4):
            raise ParameterError(f"white_balance={self.white_balance}: three or four values are wanted")
        window = Window.data(target)
        spec = buffers[0].spec()
        # ImageBufAlgo takes the remainder of coordinates, which fails for negative ones
        x, y = (-(min(0, edge) // self.period) * self.period for edge in (spec.x, spec.y))
        result = checked(
            oiio.ImageBufAlgo.demosaic(
                moved(buffers[0], x, y),
                self.pattern,
                self.algorithm,
                self.layout,
                self.white_balance_mode,
                self.white_balance,  # type: ignore[arg-type]  # None is its default, which the stub does not say
                window.shifted(x, y).roi(3),
            )
        )
        return moved(result, -x, -y)


OPS: tuple[type[Op], ...] = (
    Blur, Convolve, Median, Dilate, Erode, Unsharp, Laplacian, FillHoles, FFT, IFFT, DecorrStretch, Demosaic,
)  # fmt: skip
