# SPDX-License-Identifier: Apache-2.0
"""The photo of a synthesis without its low-frequency variation, and without the stains that are not copied."""

from __future__ import annotations

from dataclasses import dataclass

from ...analysis.drift.flattening import Flattening
from ...engine.color.lab import color_to_convert
from ...engine.core.image import Image
from ...engine.core.op import Op
from ...engine.core.parameters import param
from ...engine.deferred import np
from ...engine.io.disk_cache import hash_of
from ...engine.session.facts import Facts
from ...engine.session.progress import Progress
from ...engine.session.resources import Resources


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
        """The photo to copy from, and its stains, (height, width) bool; None: there are none.

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
        part, hashed = photo.first, None if allowed is None else hash_of(allowed)
        with resources.stats.time("flatten"):
            flat, _, stained = resources.remembered(
                ("flattened", id(part), strength, hashed),
                lambda: Flattening(amount=strength).of(
                    self.flag(), photo, self.working_space, resources, Progress(), allowed
                ),
                part,
            )
        if stained is not None and strength == 1:
            self.inform("a stain covers %.0f %% of the photo and is not copied", 100 * stained.mean())
        return Image((flat, *photo.parts[1:]), photo.source), stained if strength == 1 else None

    def _strength(self, photo: Image, alone: bool, facts: Facts) -> float:
        if self.flattening is not None:
            return self.flattening
        return float(alone and color_to_convert(photo, facts, self.working_space) is not None)
