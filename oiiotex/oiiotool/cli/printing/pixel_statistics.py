# SPDX-License-Identifier: Apache-2.0
"""Pixel statistics, streamed in bands of fixed height and order: results do not depend on the memory budget."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from ....engine.core.demand import stream
from ....engine.core.image import Part, cropped, dtype_of, pixels_of
from ....engine.core.window import Window
from ....engine.deferred import np, oiio
from ....engine.errors import ImageError

ROWS = 64  # per band; OpenImageIO also sums this number of rows before it merges the sums


@dataclass(frozen=True)
class Statistics:
    """OpenImageIO's PixelStats, per channel, of finite values; 0 for channels without finite values."""

    min: tuple[float, ...]
    max: tuple[float, ...]
    avg: tuple[float, ...]
    stddev: tuple[float, ...]
    nancount: tuple[int, ...]
    infcount: tuple[int, ...]
    finitecount: tuple[int, ...]


def full_rows(window: Window) -> Iterator[Window]:
    """The window in bands, from top to bottom."""
    return window.cells(window.width, ROWS)


def floats(part: Part, window: Window) -> np.ndarray:
    """(height, width, channels) float32 values of a window."""
    return as_floats(part.buffer(window), window)


def as_floats(buffer: oiio.ImageBuf, window: Window) -> np.ndarray:
    """(height, width, channels) float32 values of a buffer's window."""
    return pixels_of(buffer, oiio.FLOAT, window.roi(buffer.nchannels))


def over_channels(combine: Callable[..., np.ndarray], values: np.ndarray) -> np.ndarray:
    """(height, width) values that `combine` folds the channels into; numpy is slow along a short axis."""
    return functools.reduce(combine, np.moveaxis(values, 2, 0))


def part_statistics(part: Part, window: Window | None = None, channels: int | None = None) -> Statistics:
    """The statistics of a part, or of the first channels of a window, which is black outside the part."""
    if part.window.empty:
        raise ImageError("the image has no pixels")
    window = part.window if window is None else window
    seen = part if window & part.window == window else cropped(part, window)
    count = part.spec.nchannels
    low, high = np.full(count, np.inf), np.full(count, -np.inf)
    sums, squares = np.zeros(count), np.zeros(count)
    counts = np.zeros((3, count), np.int64)
    for _, buffer in stream(seen, full_rows(window), buffers=True):
        band = oiio.ImageBufAlgo.computePixelStats(buffer)
        low, high = np.minimum(low, band.min), np.maximum(high, band.max)
        sums += band.sum
        squares += band.sum2
        counts += np.array([band.nancount, band.infcount, band.finitecount], np.int64)
    counts[:, channels if channels is not None else count :] = 0
    some = counts[2] > 0
    finite = np.maximum(counts[2], 1)
    mean = np.where(some, sums / finite, 0)
    spread = np.sqrt(np.maximum(0, np.where(some, squares / finite - mean * mean, 0)))
    least, most, middle, about = (_numbers(np.where(some, values, 0)) for values in (low, high, mean, spread))
    nans, infs, finites = (tuple(map(int, row)) for row in counts)
    return Statistics(least, most, middle, about, nans, infs, finites)


def _numbers(values: np.ndarray) -> tuple[float, ...]:
    return tuple(map(float, values.astype(np.float32)))


def part_color(part: Part) -> tuple[float, ...] | None:
    """The color of a part whose pixels are all equal, else None."""
    corner = Window.sized(part.window.left, part.window.top, 1, 1)
    first = part.read(corner)
    if part.spec.width * part.spec.height > 1:  # NaN differs from itself, but a single pixel is constant
        for _, pixels in stream(part, full_rows(part.window)):
            if not (pixels == first).all():
                return None
    return tuple(map(float, floats(part, corner)[0, 0]))


def is_monochrome(part: Part) -> bool:
    """Whether the channels of every pixel are equal."""
    bands = stream(part, full_rows(part.window), buffers=True)
    return all(oiio.ImageBufAlgo.isMonochrome(buffer) for _, buffer in bands)


def part_statistics_text(
    part: Part, indent: str = "", window: Window | None = None, channels: int | None = None
) -> str:
    """The statistics as oiiotool prints them, as integers for integer files; a constant color is the whole part's."""
    stats = part_statistics(part, window, channels)
    scale = largest_value(part.spec)
    footer = f"(of {scale})" if scale else "(float)"
    lines = [
        f"Stats {name}: {''.join(f'{_number(value, scale, whole)} ' for value in values)}{footer}"
        for name, values, whole in (
            ("Min", stats.min, True),
            ("Max", stats.max, True),
            ("Avg", stats.avg, False),
            ("StdDev", stats.stddev, False),
        )
    ]
    lines += [
        f"Stats {name}: {''.join(f'{value} ' for value in values)}"
        for name, values in (
            ("NanCount", stats.nancount),
            ("InfCount", stats.infcount),
            ("FiniteCount", stats.finitecount),
        )
    ]
    color = part_color(part)
    lines.append(f"Constant: {'No' if color is None else 'Yes'}")
    if color is not None:
        lines.append(f"Constant Color: {''.join(f'{_number(value, scale, False)} ' for value in color)}{footer}")
    lines.append(f"Monochrome: {'Yes' if is_monochrome(part) else 'No'}")
    return "".join(f"{indent}{line}\n" for line in lines)


def largest_value(spec: oiio.ImageSpec) -> int:
    """The integer that represents 1.0 in pixels of that type; 0 for float types."""
    kind = np.dtype(dtype_of(spec))
    if kind.kind not in "ui":
        return 0
    bits = spec.get_int_attribute("oiio:BitsPerSample") or kind.itemsize * 8
    return (1 << (bits - (kind.kind == "i"))) - 1


def _number(value: float, scale: int, whole: bool) -> str:
    if not math.isfinite(value):
        return "nan" if math.isnan(value) else "inf"
    if scale == 0:
        return f"{value:f}"
    scaled = min(float(np.float32(value) * np.float32(scale)), float(scale))  # floats round 2^32 - 1 up
    if whole:
        return str(int(math.copysign(math.floor(abs(scaled) + 0.5), scaled)))
    return f"{scaled:.2f}"


def color_counts(part: Part, colors: np.ndarray, tolerance: np.ndarray) -> list[int]:
    """Pixel counts of colors (colors x channels), with a tolerance per channel; NaN matches every color."""
    counts = [0] * len(colors)
    for window, buffer in stream(part, full_rows(part.window), buffers=True):
        pixels = as_floats(buffer, window)
        for n, color in enumerate(colors):
            other = over_channels(np.logical_or, np.abs(pixels - color) > tolerance)
            counts[n] += other.size - int(other.sum())
    return counts


def range_counts(part: Part, low: tuple[float, ...], high: tuple[float, ...]) -> tuple[int, int, int]:
    """Numbers of pixels with a value below `low`, with one above `high`, and of all others."""
    bands = stream(part, full_rows(part.window), buffers=True)
    counts = [oiio.ImageBufAlgo.color_range_check(buffer, low, high) for _, buffer in bands]
    below, above, within = map(sum, zip(*counts, strict=True))
    return below, above, within
