# SPDX-License-Identifier: Apache-2.0
"""The visible effect of sigma on a photo: perceptually motivated control (MJH17 section 4.4).

Sigmas are sampled, a small tile is synthesized with each, and neighboring sigmas are compared by the earth mover's
distance between the overall histograms of their tiles, which ignores the positions of features. The cumulative
distance from the smallest sigma on, inverted, is a scale on which equal steps look equal.

Each sigma yields a different random tile, so distances are noisy. Two departures from the paper, which inverts a single
measurement, reduce the noise: histograms combine tiles of several seeds, and sigmas are respaced by the measured scale
and measured again, with the cumulative distances of all rounds averaged. A scale reports the steps of its most even
round, measured at that round's own sigmas.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

from ...engine.core.demand import SomeRows
from ...engine.deferred import np
from ...engine.io.disk_cache import cached_arrays, hash_of
from ...engine.opencl.device import Device, DeviceMemory
from ..patchmatch.constraints import Octaves, coarse_mask
from ..patchmatch.memory import ExemplarHeld
from ..patchmatch.optimization import require_memory, synthesize
from ..patchmatch.recipe import Recipe

DEFAULT_COUNT = 9  # default number of sigmas of a scale
SIDE = 160  # px; longer side of the small tiles
SEEDS = 3  # tiles of a sigma
ROUNDS = 2  # of respacing sigmas
SMALLEST, LARGEST = 1 / 64, 1 / 2  # limits of sigma, as shares of the tile's longer side
_ITERATIONS = 15  # on the coarsest level; more do not change the histogram
_GRID = 257  # samples at which the rounds are averaged
_VERSION = "sigmas 1"


@dataclass(frozen=True)
class Scale:
    """Sigmas and their visible differences."""

    sigmas: np.ndarray  # (n,) float, ascending, px of the tile, at equal visible steps
    steps: np.ndarray  # (n - 1,) float: earth mover's distance between tiles of neighboring sigmas, Lab
    first_sigmas: np.ndarray  # the first round's sigmas, in equal ratios, and their steps
    first_steps: np.ndarray
    curve: np.ndarray  # (257,) float: log sigma at equal steps of the amount, from 1 (the smallest sigma) to 0

    def sigma_at(self, amount: float) -> float:
        """The sigma, px, of an amount: 0 gives the least stationary tile of the scale, 1 the most."""
        return float(np.exp(np.interp(1.0 - amount, np.linspace(0, 1, len(self.curve)), self.curve)))

    def amounts(self, sigmas: np.ndarray) -> np.ndarray:
        """The inverse of `sigma_at`."""
        return 1.0 - np.interp(np.log(sigmas), self.curve, np.linspace(0, 1, len(self.curve)))


def variation(steps: np.ndarray) -> float:
    """Coefficient of variation: 0 if all steps are equal."""
    return float(np.std(steps) / max(float(np.mean(steps)), 1e-12))


def distance(a: np.ndarray, b: np.ndarray) -> float:
    """Earth mover's distance between two images, (n, channels), summed over channels.

    Each channel is sorted: in one dimension the distance is the mean difference of equal ranks.
    """
    return float(np.abs(a.astype(np.float64) - b).mean(0).sum())


def _reduction(recipe: Recipe, photo: tuple[int, ...]) -> tuple[float, tuple[int, int, int, int]]:
    """The scale factor of small tiles, and the reduced sizes of a tile and of a photo, (height, width, ...)."""
    shorter = min(recipe.width, recipe.height, *photo[:2])
    factor = min(1.0, max(SIDE / max(recipe.width, recipe.height), 2 * recipe.patch / shorter))
    width, height, e_width, e_height = (
        max(1, round(n * factor)) for n in (recipe.width, recipe.height, photo[1], photo[0])
    )
    return factor, (width, height, e_width, e_height)


def require_tiles(device: DeviceMemory, recipe: Recipe, photo: tuple[int, int], budget: int) -> None:
    """Refuse a `SigmaTiles` of a photo, (height, width), that exceeds the memory budget by sizes alone."""
    width, height, e_width, e_height = _reduction(recipe, photo)[1]
    small = replace(recipe, width=width, height=height, sigma=None)
    require_memory(device, small, (e_height, e_width, 3), budget, ExemplarHeld())


class SigmaTiles:
    """Small tiles of a photo's Lab, (height, width, channels) float32, at any sigma; the recipe is of the full size."""

    def __init__(
        self, device: Device, values: SomeRows, usable: np.ndarray | None, recipe: Recipe, budget: int,
        ruled_out: str,
    ):  # fmt: skip
        self._device, self._budget, self._ruled_out = device, budget, ruled_out
        self._factor, (width, height, e_width, e_height) = _reduction(recipe, values.shape)
        iterations = min(recipe.iterations, _ITERATIONS)
        self.recipe, self._full = replace(recipe, width=width, height=height, iterations=iterations), recipe
        self.usable = coarse_mask(usable, e_width, e_height)
        if self.usable is not None and not self.usable.any():  # a mask too thin for the reduced size
            self.usable, self._factor, self.recipe = usable, 1.0, recipe
            e_width, e_height = values.shape[1::-1]
        self.photo = Octaves(values, usable).reduced(e_width, e_height)

    def limits(self) -> tuple[float, float]:
        """The smallest and the largest sigma of a scale, px of the full tile."""
        side = max(self._full.width, self._full.height)
        return max(0.5, side * SMALLEST), max(1.0, side * LARGEST)

    def tile(self, sigma: float, seed: int, advance: Callable[[int, int], None]) -> np.ndarray:
        """A tile with that sigma, (height, width, channels) float32."""
        recipe = replace(self.recipe, sigma=sigma * self._factor, seed=(self.recipe.seed + seed) % 2**32)
        synthesis = synthesize(
            self._device, self.photo, self.usable, recipe, self._budget, advance, self._ruled_out
        )  # fmt: skip
        return synthesis.source.gather(self.photo)

    def scale(self, count: int, advance: Callable[[int, int], None]) -> Scale:
        """The scale of `count` sigmas; `advance` is called with (tiles done, total)."""
        total, tiles = count * SEEDS * (1 + ROUNDS), 0

        def seen(sigma: float) -> np.ndarray:
            nonlocal tiles
            pixels = []
            for seed in range(SEEDS):
                tile = self.tile(sigma, seed, lambda *_: None)
                pixels.append(tile.reshape(-1, tile.shape[2])[:, :3])
                tiles += 1
                advance(tiles, total)
            return np.sort(np.concatenate(pixels), axis=0)

        def steps_of(sigmas: np.ndarray) -> np.ndarray:
            looks = [seen(float(s)) for s in sigmas]
            return np.array([distance(a, b) for a, b in pairwise(looks)])

        low, high = self.limits()
        grid, even = np.linspace(np.log(low), np.log(high), _GRID), np.linspace(0, 1, _GRID)
        sums, curve, rounds = np.zeros(_GRID), grid, []
        for _ in range(1 + ROUNDS):
            sigmas = np.exp(np.interp(np.linspace(0, 1, count), even, curve))
            steps = steps_of(sigmas)
            rounds.append((sigmas, steps, curve))
            if not steps.sum() > 0:  # a photo of a single value
                steps = np.ones(count - 1)
            sums += np.interp(grid, np.log(sigmas), np.concatenate([[0], steps.cumsum()]) / steps.sum())
            rising = sums / sums[-1] + 1e-9 * np.arange(_GRID)
            curve = np.interp(even, rising / rising[-1], grid)
        sigmas, steps, curve = min(rounds[1:], key=lambda r: variation(r[1]))
        return Scale(sigmas, steps, *rounds[0][:2], curve)


def perceived_scale(tiles: SigmaTiles, count: int, advance: Callable[[int, int], None], folder: Path) -> Scale:
    """`SigmaTiles.scale`, cached for the same photo and recipe."""
    recipe = replace(tiles.recipe, sigma=None)
    settings = (tiles.limits(), count, SIDE, SEEDS, ROUNDS)
    name = hash_of(_VERSION, tiles.photo, tiles.usable, recipe, settings)
    return Scale(*cached_arrays(folder, name, lambda: tuple(vars(tiles.scale(count, advance)).values())))
