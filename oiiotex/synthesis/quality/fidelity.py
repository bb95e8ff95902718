# SPDX-License-Identifier: Apache-2.0
"""The judge: whether a result looks like its photo, has its colors, keeps its objects whole, and repeats unseen.

Each measure has a value up to which people called tiles good, and one from which they called them unusable
(benchmarks/results/judge.md). The worst measure is the verdict.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import cast

from ...analysis.regularity.autocorrelation import (
    SLOW,
    Autocorrelation,
    autocorrelation,
    blurred,
    high_passed,
    wrapped_autocorrelation,
    wrapped_response,
)
from ...engine.core.demand import MadeRows, SomeRows, resized
from ...engine.core.source_map import SourceMap
from ...engine.deferred import np
from .missing_colors import missing_colors
from .repetition import salience, slow_waves, texture_waves
from .wholeness import cuts, times_shown, turning

SIDE = 256  # px; longer side at which a photo is measured, and its result at the same scale
LEAST = 48  # px; smaller shorter sides cannot be measured
SCALES = 96, 48, 24  # sigmas of the bands are the longer side divided by these
ENOUGH = 0.8  # of a band's energy, or its inverse: typical for another piece of the same texture
ALIKE = 0.7  # the same for two autocorrelations, of pieces as large as the photo
_LEAST_ALIKE = 0.2  # pieces that are less alike are too small to compare shapes
_LARGE = 0.8  # of the photo: larger results are compared with it, smaller ones also with pieces of their size
GOOD, FAIR = 0.8, 0.666  # a result below the first is tried again, warned about, or sent to review
NEARLY = 0.02  # values that differ by less are nearly equal, and a try that cannot gain as much is not worth its time
_NEAR, _FAR = 1 / 6, 0.4  # of the longer side: limit of shapes, and of long lines
_ORDER = 1.5  # ratio to the correlation that chance explains: above it, the photo has long lines or a lattice
_MOST = 2 * SIDE  # px of a result that are measured, in its middle
_AS_WHOLE = 3.0, 0.075  # cuts of an evened tile, of those of the first and in all, that are seen no more than those
_INVISIBLE = 0.1  # Lab: a band with less energy has none; a constant image has lost nothing
_AREA = 48  # the longer side over the sigma of a salient area
# a part, the last values that are good and fair, and what to say beyond the first
_LIMITS = (
    ("broken", 0.015, 0.04, "objects or patterns are cut"),
    ("waves", 3.5, 30.0, "light and dark areas repeat visibly"),
    ("salient", 7.5, 14.0, "a spot stands out in every tile"),
    ("uneven", 0.16, 0.5, "rough and plain, or fine and coarse areas repeat visibly"),
    ("missing", 0.1, 0.25, "colors of the photo are missing"),
    ("lost", 0.36, 0.6, "coarse structure is lost, or blotches were added"),
    ("unlike", 0.36, 0.6, "shapes are broken"),
    ("cut", 0.36, 0.6, "long lines are broken"),
)


@dataclass(frozen=True, kw_only=True)
class Fidelity:
    """How a result compares with its photo, and how visible its repetition is.

    Attributes
    ----------
    bands : tuple of float
        Energy of a Gaussian of the longer side / 96, 48 and 24, relative to the photo's. Below 1: structure is
        destroyed. Above 1: there are blotches.
    shapes : float
        1 minus the difference of the autocorrelations, as a share of the photo's. It counts only if nothing is known
        about `broken`: ripples of sand have other shapes everywhere, and no failure.
    lines : float
        Share of the photo's correlation over long distances (lines, courses, lattices) that the result has. 1 if
        the photo has no more of it than chance explains.
    missing : float
        Share of the original photo's pixels whose color has become rarer than half as frequent, 0 to 1.
    broken : float or None
        How much cuts and merged objects are seen: the cuts times the photo's turning of directions (`wholeness`).
        None: the sources of the pixels are unknown.
    waves : float or None
        Lab, of what repeats slowly with the tile. None: it does not tile in both directions.
    uneven : float or None
        The same of the logarithms of fine and coarse detail.
    salient : float
        Distance of the most salient area from the typical color, in typical deviations, times the square root of how
        often its place in the photo is shown within the tile.

    Of a result smaller than the photo, `shapes`, `lines` and `missing` are relative to pieces of the photo of that
    size, which also lack some of its shapes and colors.
    """

    bands: tuple[float, ...]
    shapes: float
    lines: float
    missing: float
    broken: float | None = None
    waves: float | None = None
    uneven: float | None = None
    salient: float | None = None

    @property
    def texture(self) -> float:
        """The bands as one number, 0 to 1."""
        return sum(min(1.0, min(band, 1.0 / max(band, 1e-9)) / ENOUGH) for band in self.bands) / len(self.bands)

    def _grades(self) -> Iterator[tuple[float, str, str]]:
        """Each part, 1 at the limit of good and 2 at that of fair, its name, and what to say about it."""
        unlike, cut = (1.0 - min(1.0, max(0.0, part) / ALIKE) for part in (self.shapes, self.lines))
        parts = {
            "broken": self.broken, "waves": self.waves, "uneven": self.uneven, "salient": self.salient,
            "missing": self.missing, "lost": 1.0 - self.texture, "cut": cut,
            "unlike": unlike if self.broken is None else None,
        }  # fmt: skip
        for name, good, fair, said in _LIMITS:
            value = parts[name]
            if value is not None:
                yield (value / good if value <= good else 1.0 + (value - good) / (fair - good)), name, said

    @property
    def value(self) -> float:
        """The fidelity, 0 to 1: the worst part decides. Rounded to three digits so that last bits decide nothing."""
        return self.without(())

    def without(self, parts: Collection[str]) -> float:
        """The value if those parts were perfect."""
        worst = max((grade for grade, name, _ in self._grades() if name not in parts), default=0.0)
        return round(1.0 / (1.0 + worst / 4.0), 3)

    def beats(self, other: Fidelity, despite: Collection[str] = ()) -> bool:
        """Whether it is better, those parts aside: of nearly equal values, the one whose parts exceed less."""
        mine, others = self.without(despite), other.without(despite)
        if abs(mine - others) >= NEARLY:
            return mine > others
        return self._excess(despite) < other._excess(despite)

    def _excess(self, aside: Collection[str]) -> float:
        return sum(max(0.0, grade - 1.0) for grade, name, _ in self._grades() if name not in aside)

    def exceeds(self, parts: Collection[str]) -> bool:
        """Whether one of those parts is beyond its limit."""
        return any(grade > 1.0 for grade, name, _ in self._grades() if name in parts)

    def evened(self, first: Fidelity) -> Fidelity | None:
        """How an evened tile compares with the first one by eye; None if objects are cut that the first has whole.

        Each patch is new, as levels are moved, and slow bands are weaker, as intended. Where the first tile's cuts are
        not seen among what the photo shows, neither are somewhat more of them. So cuts and bands are the first's.
        """
        if self.broken is None or first.broken is None:
            return self
        more, most = _AS_WHOLE
        if self.broken > max(first.broken, min(more * first.broken, most)):
            return None
        return replace(self, broken=min(self.broken, first.broken), bands=first.bands)

    def measures(self) -> dict[str, float]:
        """The measures by name, as in a report."""
        bands = {f"band_{scale}": band for scale, band in zip(SCALES, self.bands, strict=True)}
        known = {name: getattr(self, name) for name in _PARTS if getattr(self, name) is not None}
        return {"fidelity": self.value, **bands, **known}

    @classmethod
    def of_measures(cls, measures: Mapping[str, float]) -> Fidelity:
        """The inverse of `measures`."""
        bands = tuple(measures[f"band_{scale}"] for scale in SCALES)
        return cls(bands=bands, **{name: measures[name] for name in _PARTS if name in measures})

    @property
    def beyond(self) -> tuple[str, ...]:
        """The parts beyond their limits, in words, the worst first."""
        return tuple(said for grade, _, said in sorted(self._grades(), reverse=True) if grade > 1.0)

    def __str__(self) -> str:
        """A one-line summary: the parts beyond their limits, and the figures."""
        parts = {name: getattr(self, name) for name in ("broken", "waves", "uneven", "salient", "missing")}
        figures = ", ".join(f"{name} {value:.3g}" for name, value in parts.items() if value is not None)
        return f"fidelity {self.value:.2f}: {', '.join(self.beyond) or 'nothing is beyond its limit'} ({figures})"


_PARTS = "shapes", "lines", "missing", "broken", "waves", "uneven", "salient"


def fidelity(
    photo: SomeRows,
    usable: np.ndarray | None,
    result: SomeRows,
    wraps: tuple[bool, bool],
    source: SourceMap | None = None,
    original: SomeRows | None = None,
) -> Fidelity | None:
    """How much a result preserves of its photo. None: either is too small to measure.

    Parameters
    ----------
    photo : (height, width, 3) float32
        CIE Lab, without low-frequency variation if that was to be removed.
    usable : (height, width) bool or None
        Pixels that count. None: all.
    result : (height, width, 3) float32
        CIE Lab.
    wraps : (bool, bool)
        The result is a torus along y, along x.
    source : SourceMap, optional
        Where its pixels come from in the photo, if they are copies.
    original : (height, width, 3) float32, optional
        CIE Lab of the photo before anything was removed, for its colors. Default: `photo`.
    """
    return JudgedPhoto(photo, usable, original).fidelity(result, wraps, source)


@dataclass(frozen=True, eq=False)
class JudgedPhoto:
    """A photo that is measured once for all its results; see `fidelity`."""

    lab: SomeRows
    usable: np.ndarray | None = None
    original: SomeRows | None = None

    def fidelity(self, result: SomeRows, wraps: tuple[bool, bool], source: SourceMap | None = None) -> Fidelity | None:
        """How much a result preserves of the photo."""
        own, seen = self._reduced
        size = _size_at(self._factor, result)
        lab = _middle_of(result, *size)
        everywhere, wraps = np.ones(lab.shape[:2], bool), wraps if max(size) <= _MOST else (False, False)
        if min(*own.shape[:2], *lab.shape[:2]) < LEAST or np.count_nonzero(seen) < LEAST**2:
            return None
        longer = max(own.shape[:2])
        before = self.texture[0]
        if all(wraps):
            energies, of_result = _torus_energies(lab, longer), wrapped_autocorrelation(lab, longer)
        else:
            after = high_passed(lab, everywhere, wraps, longer)
            energies = [_energy(after, everywhere, longer / k, wraps) for k in SCALES]
            of_result = autocorrelation(after, everywhere)
        bands = tuple(max(energy, _INVISIBLE) / own for energy, own in zip(energies, self._energies, strict=True))
        shapes, lines = _compared(self._autocorrelation, of_result, longer)
        shown = self._colors
        missing = missing_colors(shown[seen], lab[everywhere])
        if pieces := list(_pieces(seen, *lab.shape[:2])):
            typical = [
                (
                    *_compared(self._autocorrelation, autocorrelation(before[at], seen[at]), longer),
                    missing_colors(shown[seen], shown[at][seen[at]]),
                )
                for at in pieces
            ]
            usual_shapes, usual_lines, usual_missing = np.mean(typical, 0).tolist()
            shapes, lines = _relative(shapes, usual_shapes), _relative(lines, usual_lines)
            missing = max(0.0, missing - usual_missing) / (1.0 - usual_missing)
        if np.square(before).sum(-1).mean() < _INVISIBLE**2:  # a constant image has no shapes
            shapes = lines = 1.0
        share = None if source is None else cuts(self.lab, source, wraps)
        return Fidelity(
            bands=bands, shapes=shapes, lines=lines, missing=missing,
            broken=None if share is None else round(share * self._turning, 4),
            waves=slow_waves(lab) if all(wraps) else None,
            uneven=texture_waves(lab[..., 0]) if all(wraps) else None,
            salient=self._salience(lab, wraps, source) if any(wraps) else None,
        )  # fmt: skip

    def _salience(self, lab: np.ndarray, wraps: tuple[bool, bool], source: SourceMap | None) -> float:
        own, photo = (cast("tuple[int, int]", one.shape[:2]) for one in (self._reduced[0], self.lab))
        sigma = max(own) / _AREA
        areas = blurred(lab - np.median(lab, (0, 1)), sigma, wraps)
        if source is None:
            return salience(areas)
        return salience(areas, times_shown(source, areas.shape[:2], photo, own, sigma))

    @property
    def _factor(self) -> float:
        return min(1.0, SIDE / max(self.lab.shape[:2]))

    @cached_property
    def _reduced(self) -> tuple[np.ndarray, np.ndarray]:
        return _reduced(self.lab, self.usable, self._factor)

    @cached_property
    def _colors(self) -> np.ndarray:
        """The reduced original."""
        if self.original is None or self.original is self.lab:
            return self._reduced[0]
        return _reduced(self.original, None, self._factor)[0]

    @cached_property
    def texture(self) -> tuple[np.ndarray, np.ndarray]:
        """The high-passed photo at the size at which it is measured, and its pixels that count."""
        return high_passed(*self._reduced), self._reduced[1]

    @cached_property
    def _energies(self) -> list[float]:
        seen = self._reduced[1]
        return [max(_energy(self.texture[0], seen, max(seen.shape) / k), _INVISIBLE) for k in SCALES]

    @cached_property
    def _autocorrelation(self) -> Autocorrelation:
        return autocorrelation(*self.texture)

    @cached_property
    def _turning(self) -> float:
        return turning(self._reduced[0][..., 0])


def _pieces(seen: np.ndarray, height: int, width: int) -> Iterator[tuple[slice, slice]]:
    """Pieces of the size of a smaller result: in the corners and the middle of the photo, where most pixels count."""
    high, wide = min(height, seen.shape[0]), min(width, seen.shape[1])
    if high * wide > _LARGE * seen.size:
        return
    for down, right in ((0, 0), (0, 2), (2, 0), (2, 2), (1, 1)):
        top, left = (seen.shape[0] - high) * down // 2, (seen.shape[1] - wide) * right // 2
        at = slice(top, top + high), slice(left, left + wide)
        if seen[at].mean() > _LARGE:
            yield at


def _relative(alike: float, usual: float) -> float:
    """A similarity to the photo, as a piece of the photo's size would have it that is as typical of the texture."""
    if usual < _LEAST_ALIKE:
        return 1.0
    return alike * max(1.0, ALIKE / usual)


def _size_at(factor: float, values: SomeRows) -> tuple[int, int]:
    """Width and height of an image at a scale."""
    height, width = values.shape[:2]
    return max(1, round(width * factor)), max(1, round(height * factor))


def _reduced(values: SomeRows, usable: np.ndarray | None, factor: float) -> tuple[np.ndarray, np.ndarray]:
    """Pixels at a scale, (h, w, 3) float64, and a mask of those that count."""
    size = _size_at(factor, values)
    counted = np.ones(size[::-1], bool)
    if usable is not None:
        mask = MadeRows((*usable.shape, 1), np.float32, lambda first, last: usable[first:last, :, None])
        counted = resized(mask, *size)[..., 0] > 0.99
    return resized(values, *size).astype(np.float64), counted


def _middle_of(values: SomeRows, width: int, height: int) -> np.ndarray:
    """At most `_MOST` pixels a side from the middle of an image of that size, (h, w, 3) float64."""
    starts = (max(0, (most - _MOST) // 2) for most in (height, width))
    rows, columns = (slice(n, min(n + _MOST, most)) for n, most in zip(starts, (height, width), strict=True))
    return resized(values, width, height, rows)[:, columns].astype(np.float64)


def _energy(texture: np.ndarray, seen: np.ndarray, sigma: float, wraps: tuple[bool, bool] = (False, False)) -> float:
    """Standard deviation of a high-passed texture after a Gaussian, summed over channels."""
    return float(np.sqrt((blurred(texture, sigma, wraps)[seen] ** 2).sum(-1).mean()))


def _torus_energies(lab: np.ndarray, longer: int) -> list[float]:
    """The same of a high-passed torus at all `SCALES`: a Gaussian scales its waves, whose energies add (Parseval)."""
    height, width = lab.shape[:2]
    power = (np.abs(np.fft.rfft2(lab, axes=(0, 1))) ** 2).sum(-1)
    power[:, 1 : (width + 1) // 2] *= 2.0  # waves that are stored once for both directions

    def response(sigma: float) -> np.ndarray:
        down, right = (wrapped_response(sigma, n) for n in (height, width))
        return down[:, None] * right[: power.shape[1]]

    power *= (1.0 - response(SLOW * longer)) ** 2
    return [float(np.sqrt((power * response(longer / k) ** 2).sum())) / (height * width) for k in SCALES]


def _compared(photo: Autocorrelation, result: Autocorrelation, longer: int) -> tuple[float, float]:
    """Similarity of shapes, and share of the correlation over long distances that is preserved."""
    x, y = (min(pair) for pair in zip(photo.reach, result.reach, strict=True))
    a, b, weight = (
        plane[one.reach[1] - y : one.reach[1] + y + 1, one.reach[0] - x : one.reach[0] + x + 1]
        for plane, one in ((photo.ncc, photo), (result.ncc, result), (photo.weight, photo))
    )
    distance = np.hypot(*np.meshgrid(np.arange(-x, x + 1), np.arange(-y, y + 1)))
    near = (distance > 0) & (distance <= _NEAR * longer)
    far = (distance > _NEAR * longer) & (distance <= _FAR * longer) & (weight > 0)
    energy = float((a[near] ** 2).sum())
    shapes = 1.0 - float(np.sqrt(((a - b)[near] ** 2).sum() / max(energy, 1e-12)))
    if not far.any():
        return shapes, 1.0
    own = float((a[far] ** 2).mean())
    # independent pieces of a texture correlate by chance, depending on their correlation length
    if own <= _ORDER * (1.0 + energy) / float(weight[far].mean()):
        return shapes, 1.0
    return shapes, float((a * b)[far].mean()) / own


def graded(name: str, value: float) -> tuple[int, str]:
    """Grade of a part of the fidelity (0 good, 1 fair, 2 poor), and what to say where it is not good."""
    _, good, fair, said = next(limits for limits in _LIMITS if limits[0] == name)
    return int(value > good) + int(value > fair), said


def repetition_of(tile: np.ndarray) -> dict[str, float]:
    """The parts of the fidelity that need no photo.

    Parameters
    ----------
    tile : (height, width, 3) float
        CIE Lab, a torus, reduced to `SIDE` px or less.
    """
    areas = blurred(tile - np.median(tile, (0, 1)), max(tile.shape[:2]) / _AREA, (True, True))
    return {"waves": slow_waves(tile), "salient": salience(areas)}
