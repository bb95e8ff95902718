# SPDX-License-Identifier: Apache-2.0
"""MJH17 algorithm 1: a texture that looks the same everywhere, from a photo that does not.

Departures from the paper, all measured in benchmarks/README.md:

- Global histogram matching may aim at the projected exemplar ('flat') with a constant weight instead of the exemplar
  with a weight that fades: this keeps the contrast of detail where the photo's slow drift is taken away.
- The projection goes `OVERSHOOT` times the way: PatchMatch pulls part of the drift back in each iteration.
- The last vote picks one exemplar pixel for each pixel instead of a mean, which would blur.
- Pixels of the exemplar may be ruled out (alpha, a mask, a label: LSA16 §5.2). Then the exemplar is what is left: only
  this is in histograms, in the fair share of uniformity, and in the means of coarse levels.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..device import Buffers, Device
from ..errors import ImageError
from ..images import resized
from .guidance import NOTHING, Guidance, VaryingProjection, coarse_image, coarse_mask, ease_from, octaves
from .histograms import OUTSIDE, Cells, apply_table, matching_table, value_counts
from .patchmatch import (
    SEARCHES,
    Geometry,
    Matcher,
    allowed_patches,
    only_allowed,
    random_field,
    to_grid,
    upsample_field,
)
from .projections import Projecting, layout, projection

SCALE = 1.3  # between pyramid levels (section 4.2)
COARSEST = 64  # px: the top level is a quarter of the tile, but its shorter side not less than this (section 4.2)
FINE_ITERATIONS = 3  # on every finer level (section 4.2: 2 or 3)
COARSE_PASSES, FINE_PASSES, LAST_PASSES = 2, 1, 3  # of PatchMatch: on the coarsest level, finer ones, at the very end
FINE_SEARCHES = 3  # on finer levels the coarsest has found where to look, and wide windows find nothing better
OVERSHOOT = 1.2
FIELD_BYTES = 12  # of a target pixel on the host: two fields, and the places that come of them
COUNTED_ROWS = 256  # of an image whose histogram is taken
EASE = 2.0  # patches away from pixels that stay: how far in the projection begins to have its full strength
ENOUGH = 0.25  # of the finest level's share of whole patches: what a coarse level must have to be of use


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """What to synthesize; sizes in px.

    Attributes
    ----------
    width, height : int
        Of the result.
    wrap_x, wrap_y : bool
        Along which axes it tiles.
    sigma : float or None
        Scale above which it must look the same everywhere; None: plain PatchMatch, no projection.
    patch : int
        Side of a patch, odd.
    iterations : int
        On the coarsest level.
    seed : int
    uniformity : float
        Weight of the spatial uniformity term, in units of the exemplar's variance.
    contrast : float
        Weight alpha of global histogram matching, 0 to 1.
    flat : bool
        Match to the projected exemplar with constant weight; else to the exemplar with a weight that fades to 0 over
        the coarsest level, as in the paper.
    coarsest : float
        Scale of the coarsest level at least; the paper's 1/4.
    measure : str
        What must look the same everywhere: histogram, moments or steerable (MJH17 section 3).
    order : int
        Moments up to this one, 2 to 4.
    """

    width: int
    height: int
    wrap_x: bool
    wrap_y: bool
    sigma: float | None
    patch: int
    iterations: int
    seed: int
    uniformity: float
    contrast: float
    flat: bool
    coarsest: float = 0.25
    measure: str = "histogram"
    order: int = 2

    def alpha(self, iteration: int) -> float:
        """Weight of global histogram matching in an iteration, counted over all levels."""
        return self.contrast if self.flat else self.contrast * max(0.0, 1.0 - iteration / self.iterations)


@dataclass(frozen=True)
class Synthesis:
    """For every pixel the exemplar pixel it copies, and the field that led there (both packed y << 16 | x)."""

    source: np.ndarray
    field: np.ndarray


def level_scales(width: int, height: int, least: float = 0.25) -> list[float]:
    """Scales of the pyramid levels relative to the tile, coarse to fine, about SCALE apart; the last is 1."""
    coarsest = min(1.0, max(least, COARSEST / min(width, height)))
    steps = math.ceil(math.log(1.0 / coarsest) / math.log(SCALE) - 0.5)
    return [coarsest ** (1.0 - level / steps) for level in range(steps)] + [1.0]


def geometry_at(recipe: Recipe, shape: tuple[int, ...], scale: float) -> Geometry:
    """Sizes at one level for an exemplar of `shape` (height, width, channels).

    Raises
    ------
    ImageError
        Exemplar or tile are smaller than a patch there.
    """
    width, height, e_width, e_height = (
        max(1, round(n * scale)) for n in (recipe.width, recipe.height, shape[1], shape[0])
    )
    patch = recipe.patch
    if max(shape[:2]) > 65536:
        raise ImageError(f"the exemplar of {shape[1]}x{shape[0]} px is larger than 65536 px on a side")
    for what, size, full in (
        ("exemplar", (e_width, e_height), (shape[1], shape[0])),
        ("tile", (width, height), (recipe.width, recipe.height)),
    ):
        if min(size) < patch:
            coarse = "" if size == full else f" is {size[0]}x{size[1]} on the coarsest level, which"
            raise ImageError(f"the {what} of {full[0]}x{full[1]} px{coarse} is smaller than a patch of {patch}x{patch}")
    return Geometry(width, height, e_width, e_height, patch, recipe.wrap_x, recipe.wrap_y, shape[2])


def synthesize(
    device: Device,
    exemplar: np.ndarray,
    allowed: np.ndarray | None,
    recipe: Recipe,
    budget: int,
    progress: Callable[[int, int], None],
    ruled_out: str = "transparent pixels",
    guidance: Guidance = NOTHING,
) -> Synthesis:
    """Run MJH17 algorithm 1.

    Parameters
    ----------
    device : Device
    exemplar : (height, width, channels) float32
        CIE Lab, and three more channels on its scale for each further map of the material.
    allowed : (height, width) bool or None
        Pixels that may be used; None: all.
    recipe : Recipe
    budget : int
        Bytes for everything that is held at a time.
    progress : callable
        Called with (iterations done, iterations in all); may raise to stop.
    ruled_out : str
        What the pixels are that may not be used, for the error's text.
    guidance : Guidance
        What the user prescribes.

    Raises
    ------
    ImageError
        The exemplar is too small, or has no usable patch.
    DeviceError
        It does not fit the budget.
    """
    scales = level_scales(recipe.width, recipe.height, recipe.coarsest)
    geometries = [geometry_at(recipe, exemplar.shape, scale) for scale in scales]
    start = first_level(allowed, geometries, ruled_out)
    scales, geometries = scales[start:], geometries[start:]
    total = recipe.iterations + FINE_ITERATIONS * (len(scales) - 1)
    what = f"a tile of {recipe.width}x{recipe.height} from an exemplar of {exemplar.shape[1]}x{exemplar.shape[0]}"
    done, field, coarser = 0, None, None
    held = guidance.held
    needed = _layout(recipe, geometries, scales, guidance)
    on_host = 2 * exemplar.nbytes + FIELD_BYTES * recipe.width * recipe.height
    if held is not None:
        on_host += 2 * exemplar.shape[2] * 4 * recipe.width * recipe.height
    with Buffers(device, needed, budget, what, held=on_host) as buffers:
        for geometry, scale in zip(geometries, scales, strict=True):
            e_size = geometry.exemplar_width, geometry.exemplar_height
            image = to_grid(coarse_image(exemplar, allowed, *e_size), recipe.patch)
            usable = coarse_mask(allowed, *e_size)
            patches = allowed_patches(usable, geometry)
            weights = guidance.patch_weights(patches, geometry)
            if field is None:
                field = random_field(geometry, patches, recipe.seed, weights)
                if held is not None:
                    field = only_allowed(held.first_guess(field, exemplar.shape, geometry), patches, recipe.seed)
            else:
                field = upsample_field(field, coarser, geometry, patches, recipe.seed)
            searches = SEARCHES if done == 0 else FINE_SEARCHES
            matcher = Matcher(
                device, buffers, geometry, image, patches, field, recipe.uniformity, recipe.seed, searches, usable,
                None if weights is None else 1 / weights,
            )  # fmt: skip
            stays = None if held is None else held.image(exemplar, geometry)
            level = _Level(device, buffers, matcher, image, usable, recipe, scale, guidance, stays)
            coarsest = done == 0
            for _ in range(recipe.iterations if coarsest else FINE_ITERATIONS):
                last = done == total - 1
                level.iterate(done, LAST_PASSES if last else COARSE_PASSES if coarsest else FINE_PASSES)
                done += 1
                progress(done, total)
            field, coarser = matcher.field(), geometry
        source = matcher.pick()
        return Synthesis(source if held is None else np.where(held.where, held.places, source), field)


def first_level(allowed: np.ndarray | None, geometries: list[Geometry], ruled_out: str) -> int:
    """The level to start on: the coarsest with about as many whole patches, for its size, as the finest.

    A mask shrinks with every level while patches stay as large. On a level too coarse for it there is no whole patch,
    or a few from its thickest spots alone: the texture would start as copies of these, and finer levels, which search
    near by, would not leave them.

    Raises
    ------
    ImageError
        The finest has none.
    """
    if allowed is None:
        return 0
    finest = geometries[-1]
    share = allowed_patches(allowed, finest).mean()
    if share == 0:
        size = f"{finest.exemplar_width}x{finest.exemplar_height}"
        raise ImageError(
            f"no {finest.patch}x{finest.patch} patch of the exemplar of {size} px is free of {ruled_out}:"
            " a smaller patch= may fit"
        )

    def serves(geometry: Geometry) -> bool:
        mask = coarse_mask(allowed, geometry.exemplar_width, geometry.exemplar_height)
        return bool(allowed_patches(mask, geometry).mean() >= ENOUGH * share)

    return next(n for n, geometry in enumerate(geometries) if geometry is finest or serves(geometry))


class _Level:
    """One pyramid level: the body of algorithm 1's inner loop."""

    def __init__(
        self, device: Device, buffers: Buffers, matcher: Matcher, exemplar: np.ndarray, usable: np.ndarray | None,
        recipe: Recipe, scale: float, guidance: Guidance = NOTHING, held: np.ndarray | None = None,
    ):  # fmt: skip
        self._device, self._buffers, self._matcher, self._recipe = device, buffers, matcher, recipe
        self._free = None if held is None else held[..., 0] == OUTSIDE
        g = self._geometry = matcher.geometry
        self._usable = usable
        values = self._counted(exemplar)
        self._low, self._high = values.min(axis=0), values.max(axis=0)
        self._first = int(self._low.min())
        self._entries = int(self._high.max()) - self._first + 1
        if held is not None:  # what no patch can show would only push the others away
            held = np.where(self._free[..., None], OUTSIDE, np.clip(held, self._low, self._high)).astype(np.int16)
            device.write(buffers["held"], held)
            ease = ease_from(self._free, EASE * recipe.patch)
            device.write(buffers["ease"], ease)
            self._ease = ease[..., None].astype(np.int32)
        sigma = None if recipe.sigma is None else recipe.sigma * scale
        if recipe.contrast > 0:
            if held is not None and guidance.held.is_goal and not self._free.all():
                goal = held[~self._free]
            else:
                goal = self._counted(self._goal_image(exemplar, sigma))
            self._goal = value_counts(goal, self._first, self._entries)
        self._projection: Projecting | None = None
        target = g.width, g.height
        if guidance.sigmas is not None:
            sigmas = np.exp(resized(np.log(guidance.sigmas)[..., None], *target)[..., 0]) * np.float32(scale)
            stack = [self._projected(*target, one, g.wrap_x, g.wrap_y) for one in octaves(sigmas)]
            self._projection = VaryingProjection(device, buffers, stack, sigmas)
        elif sigma is not None:
            self._projection = self._projected(*target, sigma, g.wrap_x, g.wrap_y)

    def _projected(self, width: int, height: int, sigma: float, wrap_x: bool, wrap_y: bool) -> Projecting:
        cells, recipe = Cells.of(width, height, sigma), self._recipe
        what = self._device, self._buffers, cells, sigma, self._low, self._high, wrap_x, wrap_y
        return projection(recipe.measure, recipe.order, *what)

    def _goal_image(self, exemplar: np.ndarray, sigma: float | None) -> np.ndarray:
        """The image whose histogram is aimed at."""
        if not self._recipe.flat or sigma is None:
            return exemplar
        g, source = self._geometry, "exemplar"
        if self._usable is not None:
            source = "image"  # which nothing has been voted into yet
            self._device.write(self._buffers[source], np.where(self._usable[..., None], exemplar, OUTSIDE))
        self._projected(g.exemplar_width, g.exemplar_height, sigma, False, False).project(source, "target")
        return self._device.read(self._buffers["target"], exemplar.shape, np.int16)

    def _counted(self, exemplar: np.ndarray) -> np.ndarray:
        """Its pixels that may be used, (n, 3)."""
        return exemplar.reshape(-1, exemplar.shape[2]) if self._usable is None else exemplar[self._usable]

    def iterate(self, iteration: int, passes: int) -> None:
        """vote, matchHistogram, project, patchMatch: the source's own pixels have the last word (section 4.2)."""
        self._matcher.vote()
        self._hold()
        self._match_histogram(self._recipe.alpha(iteration))
        if self._projection is not None:
            self._projection.project("image", "target", OVERSHOOT)
            if self._free is not None:
                self._matcher.ease("target")
            self._buffers.swap("image", "target")
            self._hold()
        self._matcher.improve(passes, iteration)

    def _hold(self) -> None:
        if self._free is not None:
            self._matcher.hold()

    def _match_histogram(self, alpha: float) -> None:
        if alpha <= 0:
            return
        g = self._geometry
        table = matching_table(self._counts(), self._goal, self._first, alpha)
        if self._free is None:
            apply_table(self._device, self._buffers, "image", g.width * g.height, table, self._first)
        else:  # eased as the projection is
            image = self._device.read(self._buffers["image"], (g.height, g.width, g.channels), np.int16)
            far = table[np.arange(g.channels), image - np.int32(self._first)] - image.astype(np.int32)
            self._device.write(self._buffers["image"], (image + far * self._ease // 255).astype(np.int16))

    def _counts(self) -> np.ndarray:
        """`value_counts` of the image's free pixels, band by band: a large image is never held beside the device."""
        g, total = self._geometry, np.int64(0)
        for top in range(0, g.height, COUNTED_ROWS):
            rows = slice(top, min(top + COUNTED_ROWS, g.height))
            shape = rows.stop - top, g.width, g.channels
            band = self._device.read(self._buffers["image"], shape, np.int16, offset=2 * g.channels * g.width * top)
            band = band if self._free is None else band[self._free[rows]]
            total = total + value_counts(band, self._first, self._entries)
        return total


def _layout(
    recipe: Recipe, geometries: list[Geometry], scales: list[float], guidance: Guidance = NOTHING
) -> dict[str, int]:
    """Device memory that every level fits into.

    A projection goes into `target`, which stands empty between two searches, and changes places with `image`: they are
    of one size.
    """
    needed = geometries[-1].layout()
    if guidance.held is not None:
        needed |= {"held": needed["image"], "ease": recipe.width * recipe.height}
    for geometry, scale in zip(geometries, scales, strict=True):
        if recipe.sigma is None:
            break
        finest = recipe.sigma if guidance.sigmas is None else float(guidance.sigmas.min())
        sizes = [(geometry.width, geometry.height, finest * scale)]
        if recipe.contrast > 0 and recipe.flat:
            sizes.append((geometry.exemplar_width, geometry.exemplar_height, recipe.sigma * scale))
        for size in sizes:
            for name, need in layout(recipe.measure, Cells.of(*size), geometry.channels).items():
                needed[name] = max(needed.get(name, 0), need)
    needed["image"] = needed["target"] = max(needed["image"], needed["target"], needed.pop("matched", 0))
    return needed
