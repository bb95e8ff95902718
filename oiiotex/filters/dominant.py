# SPDX-License-Identifier: Apache-2.0
"""--texdominant: where a photo shows its main texture, and nothing else."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import OpenImageIO as oiio

from ..errors import ImageError, ParameterError
from ..images import Image, Part
from ..op import Op, Output, Reach, Space
from ..params import image, param
from ..session import Session
from ..windows import Window
from ..working import lens_of
from ..writing import write
from .dominantchart import diagnostics
from .label import write_json
from .sources import source_pixels

if TYPE_CHECKING:
    from ..analysis.diffusion import Dominant as Found
    from ..analysis.diffusion import Round
    from ..analysis.labpixels import LabPixels

log = logging.getLogger("oiiotex")

PATCH, EPSILON, DIMENSION, STEPS, SHARE = (
    f"oiiotex:{n}" for n in ("patch", "epsilon", "dimension", "tau", "share")
)  # attributes of the mask
WORKING_PIXELS = 1 << 20
TEXELS = 12000  # at most, unless step says otherwise: the paper's images have up to 11,000 at a step of 1


@dataclass(frozen=True, kw_only=True)
class Dominant(Op):
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
    reach: ClassVar[Reach] = Reach.GLOBAL
    space: ClassVar[Space] = Space.LAB
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("dominant", "one channel, 1 where the dominant texture is, else 0; in the image's windows"),
    )

    source: Image = image(help="the photo")
    mask: Image | None = image(None, help="where to look: what it leaves out is no part of the photo")
    patch: int | None = param(
        None, ge=3, le=63, unit="px", help="side of a patch, made odd; from the Fourier transform when left out"
    )
    step: int | None = param(
        None, ge=1, le=256, unit="px", help=f"between patches; the smallest that leaves {TEXELS} of them when left out"
    )
    rule: str = param("repaired", choices=("repaired", "paper"), help="thresholds; paper: as its text has them")
    mode: str = param(
        "diffusion",
        choices=("diffusion", "euclidean", "spectral"),
        help="euclidean: the paper's eq. 7; spectral: the larger half of a normalised cut",
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

    def compute(self, session: Session) -> Image:
        """The mask, behind the photo where that is kept, and what else was asked for."""
        from ..analysis.diffusion import dominant_mask, dominant_texture, spread_over, step_for
        from ..analysis.labpixels import lab_pixels, reduction
        from ..analysis.texels import MOST_PATCH, memory_needed

        for path in (self.json, self.chart):
            if path is not None and os.path.realpath(path) == os.path.realpath(self.source.source):
                raise ParameterError(f"{path} would overwrite the photo")
        first, *others = self.source.parts
        width, height = first.window.width, first.window.height
        factor = reduction(width, height, WORKING_PIXELS)
        shape = -(-height // factor), -(-width // factor)
        patch = None if self.patch is None else self.patch - 1 + self.patch % 2
        if patch is not None and patch > min(shape):
            raise ImageError(f"patch={patch}: {self.source.source} has only {width}x{height} px")
        step = self.step or step_for(shape, patch or 5, TEXELS)
        texels = -(-shape[0] // step) * -(-shape[1] // step)
        need = memory_needed(shape[0] * shape[1], texels, patch or MOST_PATCH) + width * height // 8
        session.require(need, f"{self.flag()} of {width}x{height} px", "take a larger step")
        lens = lens_of(self.source, None if self.data else session.color, session.autocc)
        allowed = source_pixels(self.source, self.mask, None, None, None)
        pixels = lab_pixels(self.source, lens, session, factor, allowed)
        session.advance(1, 6)
        found = dominant_texture(
            pixels, session, patch=patch, step=self.step, most=TEXELS, mode=self.mode, rule=self.rule
        )
        if found.rejected:
            if self.strict:
                raise ImageError(f"{self.source.source} has no dominant texture: {found.rejected}")
            log.warning("%s: %s has no dominant texture: %s", self.flag(), self.source.source, found.rejected)
        else:
            log.info("%s: %.0f %% of patches of %d px are dominant", self.flag(), 100 * found.share, found.texels.patch)
        mask = dominant_mask(found, pixels.seen)
        parts = [_part(first, "dominant", ("Y",), mask.astype(np.float32)[..., None], pixels, _marks(found))]
        seen = pixels.seen.shape
        if self.types:
            ids = spread_over(found.texels, found.types.astype(np.uint32) + 1, seen, 0)
            parts.append(_part(first, "types", ("Y",), ids[..., None], pixels))
        if self.score:
            both = [spread_over(found.texels, v.astype(np.float32), seen, 0) for v in (found.density, found.heat)]
            parts.append(_part(first, "score", ("density", "heat"), np.stack(both, -1), pixels))
        if self.json is not None:
            write_json(self.json, summary(found, factor), session)
        if self.chart is not None:
            write(diagnostics(found), self.chart, oiio.TypeDesc(oiio.UINT8))
            session.written.add(os.path.realpath(self.chart))
        session.advance(6, 6)
        return Image((*((first,) if self.keep else ()), *parts, *others), self.source.source)


def _marks(found: Found) -> Callable[[oiio.ImageSpec], None]:
    def mark(spec: oiio.ImageSpec) -> None:
        spec.attribute(PATCH, found.texels.patch)
        spec.attribute(SHARE, found.share)
        if found.kernel is not None:
            spec.attribute(EPSILON, found.kernel.size)
            spec.attribute(DIMENSION, found.kernel.dimension)
            spec.attribute(STEPS, found.steps)

    return mark


def _part(
    like: Part,
    name: str,
    channels: tuple[str, ...],
    values: np.ndarray,
    pixels: LabPixels,
    mark: Callable[[oiio.ImageSpec], None] = lambda spec: None,
) -> Part:
    """Values of the reduced image as a part in the windows of the image; 0 where alpha is 0."""
    from ..analysis.superpixels import label_spec

    spec = label_spec(like.spec)
    kind = oiio.TypeDesc(oiio.UINT32 if values.dtype == np.uint32 else oiio.FLOAT)
    spec.set_format(kind)
    spec.nchannels, spec.channelnames = len(channels), channels
    spec.attribute("oiio:subimagename", name)
    mark(spec)

    def fetch(window: Window) -> np.ndarray:
        rows, columns = window.inside(like.window)
        y, x = (np.arange(s.start, s.stop) // pixels.factor for s in (rows, columns))
        here = values[np.ix_(y, x)]
        opaque = pixels.opaque_rows(rows.start, rows.stop)
        return here if opaque is None else np.where(opaque[:, columns, None], here, values.dtype.type(0))

    return Part(name, spec, fetch, kind, ready=True, exact=kind == oiio.UINT32)


def summary(found: Found, factor: int) -> dict[str, Any]:
    """What there is to say, for `json`: LDR09 figures 3 and 4 as numbers."""
    kernel = found.kernel
    return {
        "patch": found.texels.patch,
        "step": found.texels.step,
        "texels": found.texels.count,
        "reduction": factor,
        "rejected": found.rejected,
        "share": found.share,
        "types": np.bincount(found.types, minlength=4).tolist(),
        "epsilon": kernel.size if kernel else None,
        "epsilon of landmarks": kernel.landmark_size if kernel else None,
        "dimension": kernel.dimension if kernel else None,
        "tau": found.steps,
        "curve": kernel.curve.tolist() if kernel else [],
        "rounds": [_round(found, r) for r in found.rounds],
    }


def _round(found: Found, r: Round) -> dict[str, Any]:
    place = {"row": int(found.texels.rows[r.seed]), "column": int(found.texels.columns[r.seed])}
    return {**vars(r), "density": r.density if np.isfinite(r.density) else None, "seed": place}
