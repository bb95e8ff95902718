# SPDX-License-Identifier: Apache-2.0
"""The dominant texture of a photo of any size: analyzed at reduced resolution, output in the photo's windows."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...engine.color.lab import lens_of
from ...engine.color.lab_reduced import LabPixels, lab_pixels, reduction
from ...engine.core.image import Image, Part
from ...engine.core.op import Space
from ...engine.errors import ImageError
from ...engine.session.facts import Facts
from ...engine.session.progress import Progress
from ...engine.session.resources import Resources
from ..regularity.lattice import find_lattice
from ..superpixels.superpixels import label_spec
from .diffusion import TEXELS, Dominance, Round, dominant_mask, dominant_texture, spread_over, step_for, times_of
from .patch_manifold import LEAST_PATCH, MOST_PATCH, memory_needed, patch_size

log = logging.getLogger("oiiotex")

WORKING_PIXELS = 1 << 20
_READ = 150, 1500  # ns: time of a pixel, with a given size of patches, and without
_PERIODS = 4  # minimum number along the shorter side: fewer elements do not make a texture


@dataclass(frozen=True, eq=False)
class PhotoMask:
    """Mask of the dominant texture of a photo."""

    photo: Part
    pixels: LabPixels  # of the photo, reduced
    texture: Dominance
    mask: np.ndarray  # (height, width) bool, of the reduced photo

    @property
    def part(self) -> Part:
        """Part 'dominant': 1 in the dominant texture, else 0; attributes record the analysis."""
        texture, kernel = self.texture, self.texture.kernel
        facts = {"patch": texture.texels.patch, "share": texture.share}
        if kernel is not None:
            facts |= {"epsilon": kernel.size, "dimension": kernel.dimension, "tau": texture.steps}
        return self._part("dominant", ("Y",), self.mask.astype(np.float32)[..., None], facts)

    @property
    def score(self) -> Part:
        """Part 'score': density, and the decimal logarithm of heat."""
        values = (one.astype(np.float32) for one in (self.texture.density, self.texture.heat))
        layers = [spread_over(self.texture.texels, one, self.pixels.seen.shape) for one in values]
        return self._part("score", ("density", "heat"), np.stack(layers, -1), {})

    def _part(self, name: str, channels: tuple[str, ...], values: np.ndarray, facts: dict[str, float]) -> Part:
        """Values of the reduced photo as a part in the windows of the photo; 0 where alpha is 0."""
        spec = label_spec(self.photo.spec)
        spec.nchannels, spec.channelnames = len(channels), channels
        for key, value in facts.items():
            spec.attribute(f"oiiotex:{key}", value)
        return self.pixels.part(name, spec, values)

    def facts(self) -> dict[str, Any]:
        """Facts for JSON: LDR09 figures 3 and 4 as numbers."""
        texture, kernel = self.texture, self.texture.kernel
        return {
            "patch": texture.texels.patch,
            "step": texture.texels.step,
            "texels": texture.texels.count,
            "reduction": self.pixels.factor,
            "rejected": texture.rejected,
            "share": texture.share,
            "types": np.bincount(texture.types, minlength=4).tolist(),
            "epsilon": kernel.size if kernel else None,
            "epsilon of landmarks": kernel.landmark_size if kernel else None,
            "dimension": kernel.dimension if kernel else None,
            "tau": texture.steps,
            "curve": kernel.curve.tolist() if kernel else [],
            "rounds": [self._round(r) for r in texture.rounds],
        }

    def _round(self, r: Round) -> dict[str, Any]:
        texels = self.texture.texels
        place = {"row": int(texels.rows[r.seed]), "column": int(texels.columns[r.seed])}
        return {**vars(r), "density": r.density if np.isfinite(r.density) else None, "seed": place}


def photo_mask(
    flag: str,
    photo: Image,
    space: Space,
    resources: Resources,
    progress: Progress,
    *,
    allowed: Callable[[], np.ndarray | None] = lambda: None,
    patch: int | None = None,
    paper: bool = False,
) -> PhotoMask:
    """Mask of the dominant texture, for op `flag`; parameters as for --texdominant.

    `allowed` gives the pixels to analyze, (height, width) bool or None.
    """
    factor, shape = _reduced(photo)
    side = None if patch is None else patch - 1 + patch % 2
    require_memory(flag, photo, resources, patch, paper)
    texels = _texel_count(shape, side or LEAST_PATCH, paper)
    if texels > TEXELS:  # each is compared with all others
        log.warning("%s: paper=1 takes about %.0f times as long as the default", flag, (texels / TEXELS) ** 2)
    pixels = lab_pixels(photo, lens_of(photo, resources, space), resources, factor, allowed())
    if side is None and not paper and (period := _period(pixels)):
        shrink = math.ceil(period / MOST_PATCH)
        if shrink > 1:
            pixels = lab_pixels(photo, lens_of(photo, resources, space), resources, factor * shrink, allowed())
            shape = (pixels.seen.shape[0], pixels.seen.shape[1])
        side = max(LEAST_PATCH, round(period / shrink) | 1)
    side = side or patch_size(pixels.lab[..., 0], resources.spread)
    require_memory(flag, photo, resources, side, paper)
    step = 1 if paper else step_for(shape, side)
    work = times_of(shape, side, step)
    reading, looking = progress.stages(shape[0] * shape[1] * _READ[patch is None], sum(work))
    reading.advance(1, 1)

    def colored() -> np.ndarray | None:
        """Colors that refine the mask, computed in parallel with texels: importing k-means takes 1/15 s."""
        from .refinement import pixel_colors

        return None if paper else pixel_colors(pixels)

    with resources.in_background(colored) as colors:
        rule = "paper" if paper else "repaired"
        texture = dominant_texture(pixels, resources, looking, patch=side, step=step, rule=rule)
        mask = _mask(texture, pixels, colors())
    if texture.rejected:
        log.warning("%s: %s has no dominant texture: %s", flag, photo.source, texture.rejected)
    else:
        log.info("%s: %.0f %% of patches of %d px are dominant", flag, 100 * texture.share, texture.texels.patch)
    looking.advance(1, 1)
    return PhotoMask(photo.first, pixels, texture, mask)


def _period(pixels: LabPixels) -> float:
    """Longest vector of the photo's lattice, px: a patch that holds it sees the whole pattern. 0: there is none.

    Not in LDR09. Patches smaller than the period of a weave or a plate see parts of it, and only one is dominant.
    """
    lattice = find_lattice(pixels.lab, pixels.seen)
    if lattice is None:
        return 0.0
    period = float(np.linalg.norm(lattice.vectors(), axis=1).max())
    return period if _PERIODS * period <= min(pixels.seen.shape) else 0.0


def require_memory(flag: str, photo: Image, facts: Facts, patch: int | None, paper: bool) -> None:
    """Refuse patches larger than the photo, and what exceeds the memory budget, by sizes alone."""
    (width, height), (_, shape) = photo.first.window.size, _reduced(photo)
    side = LEAST_PATCH if patch is None else patch - 1 + patch % 2
    if patch is not None and side > min(shape):
        problem = f"exceeds {photo.source}, {width}x{height}"
        raise ImageError(problem, parameter="patch", value=side)
    texels = _texel_count(shape, side, paper)
    need = memory_needed(shape[0] * shape[1], texels, side, facts.thread_count) + width * height // 8
    facts.require(need, f"{flag} of {width}x{height} px", "use a smaller photo")


def _reduced(photo: Image) -> tuple[int, tuple[int, int]]:
    """Reduction factor of a photo for the analysis, and its reduced height and width."""
    width, height = photo.first.window.size
    factor = reduction(width, height, WORKING_PIXELS)
    return factor, (-(-height // factor), -(-width // factor))


def _texel_count(shape: tuple[int, int], side: int, paper: bool) -> int:
    """Number of patches: with `paper` one around every pixel."""
    apart = 1 if paper else step_for(shape, side)
    return -(-shape[0] // apart) * -(-shape[1] // apart)


def _mask(texture: Dominance, pixels: LabPixels, colors: np.ndarray | None) -> np.ndarray:
    """Mask of the texture, (h, w) bool; as in LDR09 without colors."""
    from .refinement import refined_mask

    return dominant_mask(texture, pixels.seen) if colors is None else refined_mask(texture, pixels, colors)
