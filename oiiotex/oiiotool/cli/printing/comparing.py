# SPDX-License-Identifier: Apache-2.0
"""Options that compare two images: --diff, --pdiff, --flipdiff, and their thresholds.

--diff reads both images in bands. --pdiff and --flipdiff need both images in memory.

Difference from oiiotool
------------------------
A NaN or infinity in one image only makes the largest error infinite, counts as a pixel above the thresholds, and never
enters the means. oiiotool ignores the first such pixel, the others make its means NaN, and a second one resets its
largest error.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from ....engine.core.demand import stream
from ....engine.core.image import Image, Part, cropped, in_memory
from ....engine.core.parameters import LARGEST, param
from ....engine.core.window import Window
from ....engine.deferred import np, oiio
from ....engine.errors import ImageError, ParameterError, one_line
from ..language.parse import Option
from ..stack.chain import Chain
from .metadata import shortest
from .pixel_statistics import as_floats, floats, full_rows, over_channels

# maximum bytes per pixel, measured on images of 1 to 3 megapixels
_YEE_BYTES = 100
_FLIP_BYTES = 160


@dataclass(frozen=True)
class Thresholds:
    """Values of --fail, --warn and the like: percentages of pixels, else differences of values."""

    fail: float = 1e-6
    failpercent: float = 0
    hardfail: float = LARGEST
    warn: float = 1e-6
    warnpercent: float = 0
    hardwarn: float = LARGEST


@dataclass
class Comparison:
    """Differences between two images: largest error and its place, means, pixels above the thresholds."""

    max_error: float = 0.0
    x: int = 0
    y: int = 0
    channel: int = 0
    mean: float = 0.0
    rms: float = 0.0
    psnr: float = math.inf
    warned: int = 0
    failed: int = 0


def compare(a: Part, b: Part, thresholds: Thresholds) -> Comparison:
    """Compare two parts in bands over the union of their data windows; missing pixels are black."""
    whole = a.window | b.window
    channels = max(a.spec.nchannels, b.spec.nchannels)
    comparison, total, squares, peak = Comparison(), 0.0, 0.0, np.float32(1)
    bands = [stream(cropped(part, whole), full_rows(whole), buffers=True) for part in (a, b)]
    for (window, left), (_, right) in zip(*bands, strict=True):
        x, y = _as_wide(as_floats(left, window), channels), _as_wide(as_floats(right, window), channels)
        with np.errstate(invalid="ignore", over="ignore"):
            error = np.abs(x - y)
        odd = ~(np.isfinite(x) & np.isfinite(y))
        if odd.any():
            same = (np.isnan(x) == np.isnan(y)) & (np.isinf(x) == np.isinf(y))
            error[odd] = np.where(same[odd], np.float32(0), np.float32(np.inf))
            x, y = np.where(odd, np.float32(0), x), np.where(odd, np.float32(0), y)
        peak = max(peak, np.abs(x).max(), np.abs(y).max())
        largest = int(error.argmax())
        if error.flat[largest] > comparison.max_error:
            comparison.max_error = float(error.flat[largest])
            row, column, comparison.channel = map(int, np.unravel_index(largest, error.shape))
            comparison.x, comparison.y = window.left + column, window.top + row
        worst = over_channels(np.maximum, error)
        comparison.warned += int((worst > thresholds.warn).sum())
        comparison.failed += int((worst > thresholds.fail).sum())
        plain = error.astype(np.float64)
        plain[odd] = 0
        total += float(plain.sum())
        squares += float(np.square(plain, out=plain).sum())
    values = max(1, whole.width * whole.height * channels)
    comparison.mean, comparison.rms = total / values, float(np.sqrt(squares / values))
    comparison.psnr = float(20 * np.log10(float(peak) / comparison.rms)) if comparison.rms > 0 else np.inf
    return comparison


def _as_wide(pixels: np.ndarray, channels: int) -> np.ndarray:
    lacking = channels - pixels.shape[2]
    return np.pad(pixels, ((0, 0), (0, 0), (0, lacking))) if lacking else pixels


_ORDER = ("PASS", "WARNING", "FAILURE")


def difference(chain: Chain) -> None:
    """Print the differences between the two top images; exit code 1 if they differ."""
    _difference(chain, perceptual=False)


def perceptual_difference(chain: Chain) -> None:
    """Print the visible differences between the two top images (Yee's metric); both must fit in memory."""
    _difference(chain, perceptual=True)


def _difference(chain: Chain, perceptual: bool) -> None:
    first, second = chain.image(1), chain.image(0)
    everything = chain.session.settings.all_parts
    pairs = list(zip(first.parts, second.parts, strict=False))[: None if everything else 1]
    for a, b in pairs if perceptual else ():
        _require(chain, a, b, _YEE_BYTES, "--pdiff")
    if not chain.acts(*first.parts, *second.parts):
        return
    kind = "perceptual " if perceptual else ""
    print(f'Computing {kind}diff of "{first.title}" vs "{second.title}"')
    verdict = 0
    for number, (a, b) in enumerate(pairs):
        alike = len(a.levels) == len(b.levels)
        levels = list(zip(a.levels, b.levels, strict=True)) if everything and alike else []
        for level, pair in enumerate([(a, b), *levels]):
            title = _title(first, number, level) if everything else ""
            verdict = max(verdict, _compared(chain, *pair, title, perceptual, verdict))
        if everything and a.levels and not alike:
            print("Files do not match in their number of MIPmap levels")
            verdict = 2
    counts = len(first.parts), len(second.parts)
    if everything and counts[0] != counts[1]:
        print(f"Images had differing numbers of subimages ({counts[0]} vs {counts[1]})")
        verdict = 2
    if not everything and max(counts) > 1:
        print(f"Only compared the first subimage (of {counts[0]} and {counts[1]}, respectively)")
    print(_ORDER[verdict])
    sys.stdout.flush()
    if verdict == 2:
        chain.status = 1


def _title(image: Image, number: int, level: int) -> str:
    part = image.parts[number]
    words = f"Subimage {number} " if len(image.parts) > 1 else ""
    words += f" MIP level {level} " if part.levels else ""
    return f"{words}{': ' if words else ''}{part.spec.width} x {part.spec.height}, {part.spec.nchannels} channel\n"


def _compared(chain: Chain, a: Part, b: Part, title: str, perceptual: bool, before: int) -> int:
    """Compare two parts, and print a report on or after a difference: returns 0 same, 1 warning, 2 failure."""
    limits = chain.settings.get("--diff", Thresholds())
    pixels = max(1, a.spec.width * a.spec.height)
    with chain.session.resources.stats.time("diff"):
        comparison = _yee(a, b) if perceptual else compare(a, b, limits)
    verdict = 0
    if comparison.failed > limits.failpercent / 100 * pixels or comparison.max_error > limits.hardfail:
        verdict = 2
    elif comparison.warned > limits.warnpercent / 100 * pixels or comparison.max_error > limits.hardwarn:
        verdict = 1
    if max(verdict, before) or chain.settings.get("-v"):
        print(title, end="")
        print("\n".join(_report(a, b, comparison, limits, pixels, perceptual)))
    return verdict


def _report(a: Part, b: Part, comparison: Comparison, limits: Thresholds, pixels: int, perceptual: bool) -> list[str]:
    means = (("Mean error", comparison.mean), ("RMS error", comparison.rms), ("Peak SNR", comparison.psnr))
    lines = [] if perceptual else [f"  {name} = {value:.6g}" for name, value in means]
    line = f"  Max error  = {shortest(comparison.max_error)}"
    if comparison.max_error != 0:
        names = a.spec.channelnames if comparison.channel < a.spec.nchannels else b.spec.channelnames
        values = " vs ".join(_values_at(part, comparison.x, comparison.y) for part in (a, b))
        line += f" @ ({comparison.x}, {comparison.y}, {names[comparison.channel]})  values are {values}"
    lines.append(line)
    counts = [
        (comparison.warned, f"over {shortest(limits.warn)}"),
        (comparison.failed, f"over {shortest(limits.fail)}"),
    ]
    if perceptual:
        counts = [(comparison.failed, "failed the perceptual test")]
    return [*lines, *(f"  {count} pixels ({100 * count / pixels:.3g}%) {limit}" for count, limit in counts)]


def _values_at(part: Part, x: int, y: int) -> str:
    window = Window.sized(x, y, 1, 1)
    values = floats(cropped(part, window), window)[0, 0]
    return ", ".join(map(shortest, values))


def _yee(a: Part, b: Part) -> Comparison:
    result = oiio.CompareResults()
    oiio.ImageBufAlgo.compare_Yee(a.buffer(a.window), b.buffer(b.window), result)
    # positions are relative to the corner of the window, and printed so
    return Comparison(result.maxerror, result.maxx, result.maxy, 0, failed=result.nfail)


def _require(chain: Chain, a: Part, b: Part, pixel_bytes: int, option: str) -> None:
    whole = a.window | b.window
    inputs = sum(part.spec.width * part.spec.height * part.spec.nchannels * 4 for part in (a, b))
    chain.session.resources.require(inputs + whole.width * whole.height * pixel_bytes, option)


@dataclass(frozen=True)
class FlipModifiers:
    """Modifiers of --flipdiff."""

    hdr: bool = param(True, help="HDR-FLIP, over several exposures. 0: LDR-FLIP.")
    maxluminance: float = param(2.0, ge=0, help="Luminance to which the brightest pixels are exposed.")
    medianluminance: float = param(0.18, ge=0, help="Luminance to which the median is exposed.")
    ppd: float = param(0.0, ge=0, help="Pixels per degree of visual angle. 0: those of a desktop monitor.")
    tonemapper: str = param("aces", choices=("aces", "hable", "reinhard"), help="Tone mapping operator.")
    colormap: str = param(
        "", example="turbo", help="Color map of the result, such as inferno, viridis, magma or turbo."
    )
    fail: float = param(10.0, ge=0, help="Largest error that passes. 10 or more: no check.")
    print: bool = param(True, help="Print the errors.")


def flip_difference(chain: Chain, given: FlipModifiers) -> None:
    """Replace two images by the map of their visible differences (FLIP)."""
    test, reference = chain.image(0), chain.image(1)
    a, b = reference.first, test.first
    _require(chain, a, b, _FLIP_BYTES, "--flipdiff")
    chain.needs_pixels()
    options = {name: getattr(given, name) for name in ("maxluminance", "medianluminance", "ppd", "tonemapper")}
    with chain.session.resources.stats.time("--flipdiff"):
        error = oiio.ImageBufAlgo.FLIP_diff(a.buffer(a.window), b.buffer(b.window), hdr=int(given.hdr), **options)
    if error.has_error:
        raise ImageError(one_line(error.geterror()))
    spec = error.spec()
    facts = {p.name: p.value for p in spec.extra_attribs if p.name.startswith("FLIP:")}
    if given.colormap:
        error = _in_colors(error, given.colormap, facts)
    del chain.stack[-2:]
    chain.push(Image((in_memory(a.name, error),), "flipdiff"))
    chain.unwritten = True
    _print_flip(chain, reference, test, facts, given)


def _in_colors(error: oiio.ImageBuf, colormap: str, facts: dict[str, Any]) -> oiio.ImageBuf:
    colored = oiio.ImageBufAlgo.color_map(error, 0, colormap)
    if colored.has_error:
        raise ImageError(one_line(colored.geterror()))
    for name, value in facts.items():
        colored.specmod().attribute(name, value)
    return colored


def _print_flip(chain: Chain, reference: Image, test: Image, facts: dict[str, Any], given: FlipModifiers) -> None:
    largest = float(facts.get("FLIP:maxerror", 0.0))
    judges = given.fail < 10
    fails = judges and largest > np.float32(given.fail)
    if not (given.print or judges):
        return
    chain.acts()
    print(f'FLIP diff of "{reference.title}" vs "{test.title}"')
    if given.print or fails:
        print(f"  Mean FLIP error  = {facts.get('FLIP:meanerror', 0.0):.4g}")
        line = f"  Max FLIP error   = {largest:.4g}"
        if largest != 0:
            x, y = facts["FLIP:maxx"], facts["FLIP:maxy"]
            values = " vs ".join(_values_at(image.first, x, y) for image in (reference, test))
            line += f"  @ ({x}, {y})  values are {values}"
        print(line)
        stops = facts.get("FLIP:numExposures", 0)
        if stops > 0:
            low, high = facts["FLIP:startExposure"], facts["FLIP:stopExposure"]
            print(f"  Exposure range   = [{low:.3g}, {high:.3g}] ({stops} stops)")
    if judges:
        print("FAILURE" if fails else "PASS")
        chain.status = 1 if fails else chain.status


def _setting(name: str) -> Callable[[Chain, str], None]:
    def run(chain: Chain, text: str) -> None:
        try:
            value = np.float32(float(text))
        except ValueError:
            raise ParameterError(f"'{text}': expected a number") from None
        chain.settings["--diff"] = replace(chain.settings.get("--diff", Thresholds()), **{name: value})

    return run


OPTIONS = (
    Option("--diff", difference, needs=2, flat=True),
    Option("--pdiff", perceptual_difference, needs=2, flat=True),
    Option("--flipdiff", flip_difference, FlipModifiers, needs=2, flat=True),
    *(
        Option(f"--{name} {argument}", _setting(name), text=text, state=True)
        for name, argument, text in (
            ("fail", "THRESHOLD", "Set the difference above which --diff counts a pixel as failed. Default: 1e-6"),
            ("failpercent", "PERCENT", "Set the percentage of failed pixels that --diff accepts. Default: 0"),
            ("hardfail", "THRESHOLD", "Set the difference above which a single pixel makes --diff fail"),
            ("warn", "THRESHOLD", "Set the difference above which --diff counts a pixel for a warning. Default: 1e-6"),
            (
                "warnpercent",
                "PERCENT",
                "Set the percentage of pixels above --warn that --diff accepts. Default: 0",
            ),
            ("hardwarn", "THRESHOLD", "Set the difference above which a single pixel makes --diff warn"),
        )
    ),
)
