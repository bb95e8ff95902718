# SPDX-License-Identifier: Apache-2.0
"""The photo of a synthesis without its low-frequency variation, and what of it is not copied."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from ...analysis.drift.flattening import Flattening, correction_part
from ...analysis.drift.rare_regions import rare_regions
from ...engine.color.lab import color_to_convert, lens_of
from ...engine.core.demand import materialized
from ...engine.core.image import Image, Part, from_pixels
from ...engine.core.op import Op
from ...engine.core.parameters import param
from ...engine.deferred import np
from ...engine.errors import present, spelled, texture_filter
from ...engine.io.disk_cache import hash_of
from ...engine.session.facts import Facts
from ...engine.session.progress import Progress
from ...engine.session.resources import Resources
from .exemplar_masks import both, mask_of

if TYPE_CHECKING:
    from .patch_synthesis import PatchSynthesis, SynthesisPlan


def flat_photo(
    op: Op, photo: Image, strength: float, resources: Resources, progress: Progress, allowed: np.ndarray | None,
    kept: Callable[[Part], Part] = lambda part: part,
) -> tuple[Image, Part, np.ndarray | None]:  # fmt: skip
    """The flattened photo, the correction, and what is not copied, (height, width) bool; None: everything is.

    Stains are not copied, as they cannot be corrected. Nor is what looks like nothing else, as it would be seen in
    every tile, unless a mask or label says what to copy (`allowed`). `kept`: keeps the pixels of the flattened photo,
    which is corrected at each reading otherwise.
    """
    part, hashed = photo.first, None if allowed is None else hash_of(allowed)

    def make() -> tuple[Part, Part, np.ndarray | None]:
        how = Flattening(amount=strength)
        return how.of(op.flag(), photo, op.working_space, resources, progress, allowed)

    flat, drift, stained = resources.remembered(("flattened", id(part), strength, hashed), make, part)
    flat = kept(flat)

    def find() -> np.ndarray | None:
        lens = lens_of(photo, resources, op.working_space)
        is_searched = allowed is None and lens.space is not None
        rare = rare_regions(Image((flat,), photo.source), lens, resources) if is_searched else None
        found = [regions for regions in (stained, rare) if regions is not None]
        return np.logical_or.reduce(found) if found else None

    excluded = resources.remembered(("excluded", id(part), hashed), find, part) if strength == 1 else None
    if excluded is not None:
        keep = spelled(f"to keep it, use {texture_filter('flatten')} first, then flattening=0")
        op.inform("%.0f %% of the photo stands out and is not copied; %s", 100 * excluded.mean(), keep)
    return Image((flat, *photo.parts[1:]), photo.source), drift, excluded


def flattened_photo(
    plan: SynthesisPlan, resources: Resources, progress: Progress
) -> tuple[PatchSynthesis, dict[str, Part]]:
    """The op on the flattened photo without what is not copied, and the correction."""
    op, part, strength = plan.op, plan.op.exemplar.first, plan.flattening
    if not strength:
        return op, {} if strength is None else {"drift": correction_part(None, part)}
    allowed = op._allowed()
    kept = functools.partial(in_any_order, in_memory=plan.in_memory)
    exemplar, drift, excluded = flat_photo(op, op.exemplar, strength, resources, progress, allowed, kept)
    mask = op.mask if excluded is None else mask_of(present(both(~excluded, allowed)), part)
    changed: dict[str, Any] = {"exemplar": exemplar, "mask": mask, "flattening": 0.0}
    return replace(op, **changed), {"drift": drift}


def in_any_order(part: Part, in_memory: bool) -> Part:
    """The decoded pixels, in memory if the photo is held there."""
    if in_memory:
        return from_pixels(part.name, part.pixels(), part.spec, part.stored)
    return Part(part.name, part.spec, materialized(part, 0).fetch, part.stored, ready=True)


@dataclass(frozen=True, kw_only=True)
class Flattened(Op):
    """An op that removes gradients and stains from its photo before it copies from it."""

    flattening: float | None = param(
        None,
        example="0.5",
        ge=0,
        le=1,
        unset="1 for a photo alone; for data, and with labels, a guide, a plan or a graph, 0",
        help="Fraction of the photo's gradients and stains to remove before synthesis. 0: every pixel is a verbatim"
        " copy.",
    )

    def flattened(
        self, photo: Image, alone: bool, resources: Resources, allowed: np.ndarray | None = None
    ) -> tuple[Image, np.ndarray | None]:
        """The photo to copy from, and what of it is not copied, (height, width) bool; None: everything is.

        Parameters
        ----------
        photo : Image
        alone : bool
            Nothing but the photo decides the result.
        allowed : (height, width) bool, optional
            Pixels to measure. Default: all.
        """
        strength = self._strength(photo, alone, resources)
        if strength == 0:
            return photo, None
        with resources.stats.time("flatten"):
            flat, _, excluded = flat_photo(self, photo, strength, resources, Progress(), allowed)
        return flat, excluded

    def _strength(self, photo: Image, alone: bool, facts: Facts) -> float:
        if self.flattening is not None:
            return self.flattening
        return float(alone and color_to_convert(photo, facts, self.working_space) is not None)
