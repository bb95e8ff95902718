# SPDX-License-Identifier: Apache-2.0
"""Courses of unequal height: straight joints through the whole photo, and the penalty for deviating from them.

Not in MJH17. Rows of ashlar, slates or boards do not form a lattice, as their heights differ, but every joint between
two of them is a row of pixels that is consistently darker or lighter. Joints are peaks of the mean of the high-passed
photo along its rows (or columns), which must be similar in both halves. The phase of a row is its signed distance to
the nearest joint, in median courses. A match has a penalty that grows with the difference between its phase and that
of the target's row: as on a lattice (offset_prices), but phases are from a table instead of a frequency.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace

from ...engine.core.demand import SomeRows
from ...engine.core.elementary import gaussian_taps
from ...engine.core.window import Domain
from ...engine.deferred import np
from .lattice import HighPass, high_pass_of
from .offset_prices import BITS, MOST, STRENGTH, Prices

LEAST = 4  # minimum number of joints in a photo
ALIKE = 0.835  # minimum correlation of the profiles of both halves; photos without straight lines reach .82
UNEVEN = 4.0  # maximum ratio of two courses: beyond it, joints are single ledges
THIN = 1.0  # px; sigma of the Gaussian that smooths a profile
STRONG = 0.5  # minimum height of a joint in the profile, relative to the mean of the strongest
SMALLEST = 6  # px, of a strip
STRIPS = 8  # into which a photo is divided to follow joints that are not straight
FOLLOWED = 0.65  # median likeness of the profiles of neighboring strips; of most photos without joints, up to .6
PARTS = 3  # of a profile that are followed apart, as joints that converge move by different amounts
ALONG = 0.5  # of the first and the last strip's in place: above it, joints are straight
TURN = 1 / 32  # of the photo: most by which a joint moves between neighboring strips
NEAR = 0.15  # of a course; phase difference at which the penalty is at its maximum


@dataclass(frozen=True)
class Courses:
    """The joints of a photo.

    Attributes
    ----------
    rows : bool
        Joints are horizontal. Otherwise vertical.
    joints : (n,) float64
        Their positions, px from the top (the left), increasing.
    extent : int
        The photo's size across the joints, px.
    """

    rows: bool
    joints: np.ndarray
    extent: int

    @property
    def heights(self) -> np.ndarray:
        """Distances from each joint to the next."""
        return np.diff(self.joints)

    def on_torus(self, domain: Domain) -> np.ndarray:
        """Joints of a tile: the photo's courses in order, stretched to close where the tile wraps.

        None lies near the wrap, where it would look like a seam. If possible, they are at their places in the photo.
        """
        size, heights = domain.size[self.rows], self.heights
        if not domain.wraps[self.rows]:
            if size <= self.extent:
                return self.joints
            later = np.cumsum(np.tile(heights, int(size / heights.sum()) + 1))
            return np.concatenate([self.joints, self.joints[-1] + later])
        nearest = math.inf, 0, heights[:1]
        for first in range(len(heights)):
            ends = np.cumsum(np.tile(np.roll(heights, -first), int(size / heights.sum()) + 2))
            count = int(np.abs(ends - size).argmin()) + 1
            nearest = min(
                nearest, (abs(float(ends[count - 1]) - size), first, ends[:count]), key=lambda found: found[0]
            )
        _, first, ends = nearest
        ends = ends * (size / ends[-1])
        own, low = self.joints[1 + (first + np.arange(len(ends))) % len(heights)], float(heights.min())
        places = self.joints[first] + ends
        if (np.abs((places + size / 2) % size - size / 2) < low / 4).any():
            places = places + low / 2
        return np.sort((own + np.rint(places - own)) % size)  # moved by whole pixels, without resampling

    def __str__(self) -> str:
        low, high = self.heights.min(), self.heights.max()
        return (
            f"{len(self.joints)} {'horizontal' if self.rows else 'vertical'} joints, {low:.0f} to {high:.0f} px apart"
        )


def find_courses(values: SomeRows, usable: np.ndarray | None = None, seen: HighPass | None = None) -> Courses | None:
    """The courses of a photo. None: it has none.

    Parameters
    ----------
    values : (height, width, channels) float32
        CIE Lab.
    usable : (height, width) bool or None
        Pixels that count. None: all.
    seen : HighPass, optional
        `high_pass_of` these arguments, if it is known.
    """
    seen = seen or high_pass_of(values, usable)
    if seen is None:
        return None
    texture, counted = seen
    light = texture[..., 0]
    found = [
        (likeness, rows, joints)
        for rows in (True, False)
        for likeness, joints in [_joints(light if rows else light.T, counted if rows else counted.T)]
        if _are_courses(likeness, joints)
    ]
    if not found:
        return None
    _, rows, joints = max(found, key=lambda one: one[:2])
    axis = 0 if rows else 1
    extent = values.shape[axis]
    return Courses(rows, np.rint(64 * joints * (extent / light.shape[axis])) / 64, extent)


def courses_turn(texture: np.ndarray, counted: np.ndarray) -> bool:
    """Whether a photo has joints through all of it that are oblique or converge, as in perspective.

    The profile of each strip continues in the next one, moved by a little, but the first and the last differ. A lattice
    or straight courses cannot follow such joints.

    Parameters
    ----------
    texture : (height, width, channels) float
        The photo high-passed, lightness first.
    counted : (height, width) bool
        Pixels that count.
    """
    if min(counted.shape) < SMALLEST * STRIPS:
        return False
    light = texture[..., 0]
    return any(_turn(*both) for both in ((light, counted), (light.T, counted.T)))


def _turn(light: np.ndarray, usable: np.ndarray) -> bool:
    profiles = [
        _profile(light[:, strip], usable[:, strip]) for strip in np.array_split(np.arange(light.shape[1]), STRIPS)
    ]
    most = max(1, int(TURN * len(light)))
    if _likeness(profiles[0], profiles[-1]) >= ALONG:
        return False
    followed = [_followed(one, other, most) for one, other in itertools.pairwise(profiles)]
    return sorted(followed)[len(followed) // 2] >= FOLLOWED


def _followed(one: np.ndarray, other: np.ndarray, most: int) -> float:
    """The mean likeness of the parts of two profiles, each moved by the best of up to `most` px."""
    size = len(one)
    ends = [part * size // PARTS for part in range(PARTS + 1)]
    return (
        sum(
            max(
                _likeness(one[max(first, -d) : min(last, size - d)], other[max(first + d, 0) : min(last + d, size)])
                for d in range(-most, most + 1)
            )
            for first, last in itertools.pairwise(ends)
        )
        / PARTS
    )


def _likeness(one: np.ndarray, other: np.ndarray) -> float:
    """The correlation of two lines as far as both reach."""
    size = min(len(one), len(other))
    one, other = one[:size], other[:size]
    return float((one * other).sum() / max(1e-12, np.sqrt((one * one).sum() * (other * other).sum())))


def _are_courses(likeness: float, joints: np.ndarray) -> bool:
    heights = np.diff(joints)
    return len(joints) >= LEAST and likeness >= ALIKE and bool(heights.max() <= UNEVEN * heights.min())


def _profile(light: np.ndarray, usable: np.ndarray) -> np.ndarray:
    """The mean along rows, minus its own mean over a wider range."""
    mean = (light * usable).sum(1) / np.maximum(usable.sum(1), 1)
    return _blurred(mean, THIN) - _blurred(mean, 4 * THIN)


def _blurred(line: np.ndarray, sigma: float) -> np.ndarray:
    """A line through a Gaussian, reflected at its ends. np.convolve would use BLAS, which differs between CPUs."""
    taps = gaussian_taps(sigma, 3.0)
    padded = np.pad(line, len(taps) // 2, "reflect")
    return sum(tap * padded[k : k + len(line)] for k, tap in enumerate(taps))


def _joints(light: np.ndarray, usable: np.ndarray) -> tuple[float, np.ndarray]:
    """The correlation of the profiles of both halves, and peaks of the whole profile."""
    half = light.shape[1] // 2
    one, other = _profile(light[:, :half], usable[:, :half]), _profile(light[:, half:], usable[:, half:])
    likeness = _likeness(one, other)
    profile = _profile(light, usable)
    if (profile**3).sum() < 0:  # joints are dark
        profile = -profile
    peak = np.flatnonzero((profile[1:-1] > profile[:-2]) & (profile[1:-1] >= profile[2:])) + 1
    if not len(peak):
        return 0.0, peak.astype(np.float64)
    strong = np.sort(profile[peak])[::-1][: max(3, len(profile) // 40)].mean()
    peak = peak[profile[peak] >= STRONG * strong]
    bend = profile[peak - 1] - 2 * profile[peak] + profile[peak + 1]
    between = 0.5 * (profile[peak - 1] - profile[peak + 1]) / np.minimum(bend, -1e-12)
    return likeness, peak + 0.5 + between


@dataclass(frozen=True)
class InCourses:
    """The exemplar's courses, as kept by a result.

    Attributes
    ----------
    courses : Courses
        Courses of the exemplar.
    wanted : (n,) float64
        Joints of the result, as from `Courses.on_torus`.
    size : int
        Size of the result across the joints, px.
    wraps : bool
        The result wraps in that direction.
    structure : float
        Strength, 0 to 1.
    origin : int
        Position of the result's first pixel in `wanted`, px.
    """

    courses: Courses
    wanted: np.ndarray
    size: int
    wraps: bool
    structure: float
    origin: int = 0

    @staticmethod
    def of(courses: Courses, domain: Domain, structure: float) -> InCourses:
        """Courses for a result on a domain."""
        axis = int(courses.rows)
        return InCourses(courses, courses.on_torus(domain), domain.size[axis], domain.wraps[axis], structure)

    def facts(self) -> list[object]:
        """Everything that a result depends on."""
        return [self.wanted, *vars(self.courses).values()]

    def moved(self, x: int, y: int) -> InCourses:
        """The same for a part of the result that begins at (x, y)."""
        return replace(self, origin=self.origin + (y if self.courses.rows else x))

    def prices(self, own_scale: tuple[float, float], scale: tuple[float, float], patch: int, variance: float) -> Prices:
        """Penalties on a level. Arguments as in `InStep.prices`."""
        axis = int(self.courses.rows)
        places = [
            (np.arange(round(size * along[axis])) + patch / 2) / along[axis]
            for size, along in ((self.courses.extent, own_scale), (self.size, scale))
        ]
        phases, table = self._table(min(self.most(patch**2 * variance), MOST), *places)
        median = np.zeros((1, 2))
        median[0, axis] = np.median(self.courses.heights) * own_scale[axis]
        return Prices(phases, table, median, warped=True)

    def most(self, variance: float) -> float:
        """As `InStep.most`."""
        return STRENGTH * self.structure * variance

    def of_patches(self, patch: int, most: float) -> tuple[np.ndarray, np.ndarray]:
        """As `InStep.of_patches`. Phases are those of rows, which a kernel compares at several rows of a patch."""
        return self._table(most, np.arange(self.courses.extent) + 0.5, np.arange(self.size + patch) + 0.5)

    def steps(self) -> np.ndarray:
        """As `InStep.steps`: a whole cycle is the median course."""
        steps = np.zeros((2, 2), np.int32)
        steps[0, int(self.courses.rows)] = round(256 * float(np.median(self.courses.heights)))
        return steps

    def rows(self) -> tuple[np.ndarray, np.ndarray]:
        """Phases of the rows of the exemplar, and of the result, in cycles / 2^32: uint32."""
        return (
            self._phases(np.arange(self.courses.extent) + 0.5, self.courses.joints, False),
            self._phases(np.arange(self.size) + 0.5 + self.origin, self.wanted, self.wraps),
        )

    def _table(self, most: float, own_places: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Starts of a table's parts, and the table: penalties of differences, phases of the exemplar, of the result."""
        bins = 1 << BITS
        far = np.minimum(np.arange(bins), bins - np.arange(bins)) / bins  # in cycles
        losses = np.rint(np.minimum(far / NEAR, 1.0) * most).astype(np.int32)
        own = self._phases(own_places, self.courses.joints, False) + np.uint32(1 << (31 - BITS))
        wanted = self._phases(places + self.origin, self.wanted, self.wraps)
        table = np.concatenate([losses, own.view(np.int32), wanted.view(np.int32)])
        return np.array([int(self.courses.rows), bins, bins + len(own)], np.uint32), table

    def _phases(self, places: np.ndarray, joints: np.ndarray, wraps: bool) -> np.ndarray:
        """The signed distance to the nearest joint in median courses, -1/2 to 1/2, in cycles / 2^32."""
        if wraps:
            places = places % self.size
            joints = np.concatenate([joints[-1:] - self.size, joints, joints[:1] + self.size])
        at = np.searchsorted((joints[1:] + joints[:-1]) / 2, places)
        cycles = np.clip((places - joints[at]) / float(np.median(self.courses.heights)), -0.5, 0.5)
        return (np.rint(cycles % 1.0 * 2.0**32).astype(np.uint64) & np.uint64(0xFFFFFFFF)).astype(np.uint32)
