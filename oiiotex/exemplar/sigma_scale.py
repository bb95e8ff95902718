# SPDX-License-Identifier: Apache-2.0
"""How much of a photo's drift is seen to be gone at a sigma: perceptually motivated control, MJH17 section 4.4.

Sigmas are sampled, a small tile is made with each, and neighbors are compared by the earth mover's distance between
their overall histograms, which does not mind where features have gone. Distances are summed up from the smallest sigma
on; that sum, inverted, is a scale on which equal steps look equal.

A tile of another sigma is another random tile, so distances have noise. It is lowered in two ways: a histogram is that
of tiles of several seeds, and sigmas are spread again by what was found, measured again, and the sums of all rounds
are averaged (departures: the paper inverts what it has measured once). Of the rounds the most even one is taken, and
the steps that were measured with its own sigmas are what a scale says of itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

from ..core.demand import SomeRows
from ..deferred import np
from ..io.disk_cache import cached_arrays, hash_of
from ..opencl.device import Device
from ..patchmatch.constraints import coarse_image, coarse_mask
from ..patchmatch.memory import ExemplarHeld
from ..patchmatch.optimization import require_memory, synthesize
from ..patchmatch.recipe import Recipe

DEFAULT_COUNT = 9  # sigmas of a scale where nobody says how many
SIDE = 160  # px; longer side of the small tiles
SEEDS = 3  # tiles of a sigma
ROUNDS = 2  # of spreading sigmas anew
SMALLEST, LARGEST = 1 / 64, 1 / 2  # of the tile's longer side: what sigmas lie between
_ITERATIONS = 15  # on the coarsest level: more change no histogram
_GRID = 257  # places at which the sums of rounds are averaged
_VERSION = "sigmas 1"


@dataclass(frozen=True)
class Scale:
    """Sigmas and what is seen of them."""

    sigmas: np.ndarray  # (n,) float, rising, px of the tile: spread evenly over what is seen
    steps: np.ndarray  # (n - 1,) float: earth mover's distance between the tiles of neighbors, Lab
    first_sigmas: np.ndarray  # as they were before, and their steps: in equal ratios
    first_steps: np.ndarray
    curve: np.ndarray  # (257,) float: log sigma at equal steps of the amount, from 1 (the smallest sigma) to 0

    def sigma_at(self, amount: float) -> float:
        """The sigma, px, at which this much is seen: 0 the least stationary tile of the scale, 1 the most."""
        return float(np.exp(np.interp(1.0 - amount, np.linspace(0, 1, len(self.curve)), self.curve)))

    def amounts(self, sigmas: np.ndarray) -> np.ndarray:
        """The inverse of `sigma_at`."""
        return 1.0 - np.interp(np.log(sigmas), self.curve, np.linspace(0, 1, len(self.curve)))


def variation(steps: np.ndarray) -> float:
    """Coefficient of variation: 0 where all steps look alike."""
    return float(np.std(steps) / max(float(np.mean(steps)), 1e-12))


def distance(a: np.ndarray, b: np.ndarray) -> float:
    """Earth mover's distance between two images, (n, channels), summed over channels.

    Each channel is sorted: in one dimension the distance is that between equal ranks.
    """
    return float(np.abs(a.astype(np.float64) - b).mean(0).sum())


def _reduction(recipe: Recipe, photo: tuple[int, ...]) -> tuple[float, tuple[int, int, int, int]]:
    """The factor of small tiles; width and height of a tile, and of the photo, (height, width, ...)."""
    shorter = min(recipe.width, recipe.height, *photo[:2])
    factor = min(1.0, max(SIDE / max(recipe.width, recipe.height), 2 * recipe.patch / shorter))
    width, height, e_width, e_height = (
        max(1, round(n * factor)) for n in (recipe.width, recipe.height, photo[1], photo[0])
    )
    return factor, (width, height, e_width, e_height)


def require_tiles(device: Device, recipe: Recipe, photo: tuple[int, int], budget: int) -> None:
    """Refuse what sizes alone show `SigmaTiles` not to fit: of a photo, (height, width), that is not read."""
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
        if self.usable is not None and not self.usable.any():  # thin: too little is left of it
            self.usable, self._factor, self.recipe = usable, 1.0, recipe
            e_width, e_height = values.shape[1::-1]
        self.photo = coarse_image(values, usable, e_width, e_height)

    def limits(self) -> tuple[float, float]:
        """The smallest and the largest sigma of a scale, px of the full tile."""
        side = max(self._full.width, self._full.height)
        return max(0.5, side * SMALLEST), max(1.0, side * LARGEST)

    def tile(self, sigma: float, seed: int, advance: Callable[[int, int], None]) -> np.ndarray:
        """(height, width, channels) float32."""
        recipe = replace(self.recipe, sigma=sigma * self._factor, seed=(self.recipe.seed + seed) % 2**32)
        synthesis = synthesize(
            self._device, self.photo, self.usable, recipe, self._budget, advance, self._ruled_out
        )  # fmt: skip
        return synthesis.source.gather(self.photo)

    def scale(self, count: int, advance: Callable[[int, int], None]) -> Scale:
        """The scale of `count` sigmas; `advance` is called with (tiles made, tiles in all)."""
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
            if not steps.sum() > 0:  # nothing is to be seen: a photo of one value
                steps = np.ones(count - 1)
            sums += np.interp(grid, np.log(sigmas), np.concatenate([[0], steps.cumsum()]) / steps.sum())
            rising = sums / sums[-1] + 1e-9 * np.arange(_GRID)
            curve = np.interp(even, rising / rising[-1], grid)
        sigmas, steps, curve = min(rounds[1:], key=lambda r: variation(r[1]))
        return Scale(sigmas, steps, *rounds[0][:2], curve)


def perceived_scale(tiles: SigmaTiles, count: int, advance: Callable[[int, int], None], folder: Path) -> Scale:
    """`SigmaTiles.scale`, out of the cache where the same photo was asked for with the same recipe before."""
    recipe = replace(tiles.recipe, sigma=None)
    settings = (tiles.limits(), count, SIDE, SEEDS, ROUNDS)
    name = hash_of(_VERSION, tiles.photo, tiles.usable, recipe, settings)
    return Scale(*cached_arrays(folder, name, lambda: tuple(vars(tiles.scale(count, advance)).values())))
