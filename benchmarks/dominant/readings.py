# SPDX-License-Identifier: Apache-2.0
"""Three readings that the text of LDR09 step 6 allows, on composites: `python -m benchmarks.dominant.readings`.

"The first valley beyond the 0.4-quantile point" of heat can be counted from the coldest texel or from the hottest, and
"if no such valley is found, we simply consider all remaining texels as ... (Type 0)" can leave the threshold of density
in force or not. `paper=1` is the first row. Masks are the dominant patches' centers, dilated by a patch.
"""

from __future__ import annotations

from collections.abc import Callable
from unittest import mock

import numpy as np

from benchmarks.dominant.composites import TWELVE, composite, seen_as
from oiiotex.analysis.dominant import diffusion
from oiiotex.analysis.dominant.diffusion import dominant_mask, dominant_texture
from oiiotex.engine.session import Session

Decide = Callable[[np.ndarray, np.ndarray, int], tuple[float, float | None, bool]]


def from_the_hottest(keeps_density: bool) -> Decide:
    """The valley that leaves at least 40 % counted from the hottest; without one, a threshold of density or none."""

    def decide(density: np.ndarray, heat: np.ndarray, count: int) -> tuple[float, float | None, bool]:
        shown = diffusion._shown(heat)
        counts, edges = diffusion._histogram(shown)
        point, dense = np.quantile(shown, 1 - diffusion.SHARE), diffusion._dense_above(density)
        below = [float(edges[v + 1]) for v in diffusion._valleys(counts, 0.0)[0] if edges[v + 1] <= point]
        if not below:
            return dense if keeps_density else -np.inf, None, False
        hot = below[-1]
        return dense, hot, bool(((density > dense) & (heat > hot)).sum() <= diffusion.SHARE * count)

    return decide


READINGS: dict[str, Decide] = {
    "from the coldest; without a valley all": diffusion._literal,
    "from the hottest; without a valley all": from_the_hottest(False),
    "from the hottest; without a valley all that are dense": from_the_hottest(True),
}


def main() -> None:
    """Print the table."""
    session = Session()
    print(
        "| reading of step 6 | IoU, seed 0 | precision | IoU, seed 1 | precision |", "|---|---|---|---|---|", sep="\n"
    )
    for name, decide in READINGS.items():
        cells = []
        for seed in (0, 1):
            rows = []
            for n in range(len(TWELVE)):
                _, picture, truth = composite(n, seed)
                pixels = seen_as(picture, session)
                with mock.patch.object(diffusion, "_literal", decide):
                    found = dominant_texture(pixels, session.resources, session.progress, rule="paper", step=1)
                mask = dominant_mask(found, pixels.seen)
                rows.append(
                    ((mask & truth).sum() / max((mask | truth).sum(), 1), (mask & truth).sum() / max(mask.sum(), 1))
                )
            cells += [f"{value:.3f}" for value in np.mean(rows, 0)]
        print(f"| {name} | {' | '.join(cells)} |", flush=True)
    truths = [[composite(n, seed)[2].mean() for n in range(len(TWELVE))] for seed in (0, 1)]
    print(f"| a mask of everything | {' | '.join(f'{np.mean(t):.3f} | {np.mean(t):.3f}' for t in truths)} |")


if __name__ == "__main__":
    main()
