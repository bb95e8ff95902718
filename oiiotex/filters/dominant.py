# SPDX-License-Identifier: Apache-2.0
"""--texdominant: where a photo shows its main texture, and nothing else."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from ..color.lab import lens_of
from ..core.access import ScanThenMap
from ..core.image import Image, Part
from ..core.op import Kind, Output, Space
from ..core.parameters import image, param
from ..deferred import np
from ..errors import ImageError
from ..exemplar.exemplar_masks import masked_pixels
from ..session import Session

if TYPE_CHECKING:
    from ..color.lab_reduced import LabPixels
    from ..dominant.diffusion import Dominant as DominantTexture
    from ..dominant.diffusion import Round

log = logging.getLogger("oiiotex")

WORKING_PIXELS = 1 << 20
TEXELS = 12000  # at most, unless step says otherwise: the paper's images have up to 11,000 at a step of 1


@dataclass(frozen=True, kw_only=True)
class Dominant(ScanThenMap):
    """Find the dominant texture of a photo: a mask without objects, cracks, stains and shadows.

    Overlapping patches are points in a space of colours; heat that spreads from the densest one reaches the large
    group of patches that look alike, and hardly those that do not (LDR09: Lu, Dorsey, Rushmeier, Dominant Texture and
    Diffusion Distance Manifolds, Eurographics 2009). The mask is 1 where dominant patches lie, else 0. A photo of
    which no group of patches holds 40 % is rejected: a warning and an empty mask, or an error with strict=1. With
    keep=1 the photo stays the first part and the mask follows it as part 'dominant', ready to guide a synthesis.
    Attributes say the patch's side in px (oiiotex:patch), the kernel's size (oiiotex:epsilon), the manifold's
    dimension (oiiotex:dimension), the steps of the diffusion (oiiotex:tau) and the share of dominant patches
    (oiiotex:share).
    """

    name: ClassVar[str] = "dominant"
    carries: ClassVar[bool] = True
    space: ClassVar[Space] = Space.LAB
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("photo", Kind.PIXELS, "the photo, before all others", asked_by="keep", of="source"),
        Output("dominant", Kind.MASK, "1 where the dominant texture is; in the image's windows"),
        Output("types", Kind.IDS, "1 to 4 for patches of type 0 to III around a pixel, 0 where none", asked_by="types"),
        Output("score", Kind.MEASURE, "density, and the decimal logarithm of heat", asked_by="score"),
        Output("facts", Kind.TABLE, "the kernel's curve, thresholds, rounds and shares", asked_by="json"),
        Output("chart", Kind.PICTURE, "the kernel's curve, and density over heat", asked_by="chart"),
    )

    source: Image = image(help="the photo")
    mask: Image | None = image(None, help="where to look: what it leaves out is no part of the photo")
    patch: int | None = param(
        None, ge=3, le=63, unit="px", help="side of a patch, made odd; from the Fourier transform when left out"
    )
    step: int | None = param(
        None, ge=1, le=256, unit="px", help=f"between patches; the smallest that leaves {TEXELS} of them when left out"
    )
    rule: str = param("repaired", choices=("repaired", "paper"), help="thresholds, mask; paper: as its text has them")
    mode: str = param(
        "diffusion",
        choices=("diffusion", "euclidean", "spectral"),
        help="euclidean: the paper's eq. 7; spectral: the larger half of a normalised cut",
    )
    paper: bool = param(
        False, help="LDR09 by the letter: rule=paper:mode=diffusion:step=1, and noise is not looked for"
    )
    strict: bool = param(False, help="a photo without a dominant texture is an error")
    keep: bool = param(False, help="the photo stays the first part, the mask follows it")
    types: bool = param(False, help="a further part: 1 to 4 for patches of type 0 to III around a pixel, 0 where none")
    score: bool = param(False, help="a further part: density, and the decimal logarithm of heat")
    json: Path | None = param(None, help="the kernel's curve, thresholds, rounds and shares go to this file")
    chart: Path | None = param(
        None, help="a picture of the kernel's curve, and of density over heat with their thresholds, goes to this file"
    )
    data: bool = param(False, help="the channels are no colours: compare them as they are")

    PAPER: ClassVar[dict[str, Any]] = {"rule": "paper", "mode": "diffusion", "step": 1}

    def compute(self, session: Session) -> dict[str, Any]:
        """The mask, and what else can be asked for."""
        from ..color.lab_reduced import lab_pixels, reduction
        from ..dominant.diffusion import dominant_texture, spread_over, step_for
        from ..dominant.patch_manifold import MOST_PATCH, memory_needed

        resources, progress = session.resources, session.progress
        first = self.source.first
        width, height = first.window.width, first.window.height
        factor = reduction(width, height, WORKING_PIXELS)
        shape = -(-height // factor), -(-width // factor)
        patch = None if self.patch is None else self.patch - 1 + self.patch % 2
        if patch is not None and patch > min(shape):
            raise ImageError(f"patch={patch}: {self.source.source} has only {width}x{height} px")
        step = self.step or step_for(shape, patch or 5, TEXELS)
        texels = -(-shape[0] // step) * -(-shape[1] // step)
        threads = resources.thread_count
        need = memory_needed(shape[0] * shape[1], texels, patch or MOST_PATCH, threads) + width * height // 8
        resources.require(need, f"{self.flag()} of {width}x{height} px", "take a larger step")
        lens = lens_of(self.source, resources, self.working_space)
        allowed = None if self.mask is None else masked_pixels(self.mask, self.source)
        pixels = lab_pixels(self.source, lens, resources, factor, allowed)
        progress.advance(1, 6)
        literal = self.rule == "paper"

        def coloured() -> np.ndarray | None:
            """What refines the mask, found while texels are: to import k-means takes a fifteenth of a second."""
            from ..dominant.refinement import pixel_colours

            return None if literal else pixel_colours(pixels)

        with resources.beside(coloured) as colours:
            texture = dominant_texture(
                pixels, resources, progress, patch=patch, step=self.step, most=TEXELS, mode=self.mode, rule=self.rule
            )
            mask = _mask(texture, pixels, colours())
        if texture.rejected:
            if self.strict:
                raise ImageError(f"{self.source.source} has no dominant texture: {texture.rejected}")
            log.warning("%s: %s has no dominant texture: %s", self.flag(), self.source.source, texture.rejected)
        else:
            share, side = 100 * texture.share, texture.texels.patch
            log.info("%s: %.0f %% of patches of %d px are dominant", self.flag(), share, side)
        progress.advance(6, 6)

        def spread(name: str, channels: tuple[str, ...], *values: np.ndarray) -> Part:
            layers = [spread_over(texture.texels, v, pixels.seen.shape, 0) for v in values]
            return _part(first, name, channels, np.stack(layers, -1), pixels, {})

        return {
            "dominant": _part(first, "dominant", ("Y",), mask, pixels, _attributes(texture)),
            "types": lambda: spread("types", ("Y",), texture.types.astype(np.uint32) + 1),
            "score": lambda: spread(
                "score", ("density", "heat"), texture.density.astype(np.float32), texture.heat.astype(np.float32)
            ),
            "facts": lambda: _facts(texture, factor),
            "chart": lambda: _chart(texture),
        }


def _mask(texture: DominantTexture, pixels: LabPixels, colours: np.ndarray | None) -> np.ndarray:
    """Where the texture is, (h, w, 1) float32; by LDR09 where no colours are given."""
    from ..dominant.diffusion import dominant_mask
    from ..dominant.refinement import refined_mask

    mask = dominant_mask(texture, pixels.seen) if colours is None else refined_mask(texture, pixels, colours)
    return mask.astype(np.float32)[..., None]


def _chart(texture: DominantTexture) -> np.ndarray:
    from ..charts.dominant_chart import diagnostics

    return diagnostics(texture)


def _attributes(texture: DominantTexture) -> dict[str, float]:
    attributes = {"patch": texture.texels.patch, "share": texture.share}
    if texture.kernel is not None:
        attributes |= {"epsilon": texture.kernel.size, "dimension": texture.kernel.dimension, "tau": texture.steps}
    return attributes


def _part(
    like: Part, name: str, channels: tuple[str, ...], values: np.ndarray, pixels: LabPixels,
    attributes: dict[str, float],
) -> Part:  # fmt: skip
    """Values of the reduced image as a part in the windows of the image; 0 where alpha is 0."""
    from ..superpixels.superpixels import label_spec

    spec = label_spec(like.spec)
    spec.nchannels, spec.channelnames = len(channels), channels
    for key, value in attributes.items():
        spec.attribute(f"oiiotex:{key}", value)
    return pixels.part(name, spec, values)


def _facts(texture: DominantTexture, factor: int) -> dict[str, Any]:
    """What there is to say, for `json`: LDR09 figures 3 and 4 as numbers."""
    kernel = texture.kernel
    return {
        "patch": texture.texels.patch,
        "step": texture.texels.step,
        "texels": texture.texels.count,
        "reduction": factor,
        "rejected": texture.rejected,
        "share": texture.share,
        "types": np.bincount(texture.types, minlength=4).tolist(),
        "epsilon": kernel.size if kernel else None,
        "epsilon of landmarks": kernel.landmark_size if kernel else None,
        "dimension": kernel.dimension if kernel else None,
        "tau": texture.steps,
        "curve": kernel.curve.tolist() if kernel else [],
        "rounds": [_round(texture, r) for r in texture.rounds],
    }


def _round(texture: DominantTexture, r: Round) -> dict[str, Any]:
    place = {"row": int(texture.texels.rows[r.seed]), "column": int(texture.texels.columns[r.seed])}
    return {**vars(r), "density": r.density if np.isfinite(r.density) else None, "seed": place}
