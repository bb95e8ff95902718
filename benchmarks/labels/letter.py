# SPDX-License-Identifier: Apache-2.0
"""The default of --texlabel, the text of LSA16, and its authors' program: `python -m benchmarks.labels.letter`.

Maps with ground truth; of each, the level with the best covering (levels.py).
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from benchmarks.labels.levels import cases, score
from oiiotex import filters
from oiiotex.engine.core.image import from_buffer, to_buffer
from oiiotex.engine.run import run
from oiiotex.engine.session import Session

WAYS: dict[str, dict[str, object]] = {
    "default": {},
    "default without the coarsest level": {"coarsest": "none"},
    "`paper=1`, the text": {"paper": True},
    "`paper=authors`, their program": {"paper": "authors"},
}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--name", default="mosaic", help="part of the maps' names")
    chosen = list(cases(parser.parse_args().name))
    print(f"{len(chosen)} maps. Means of the best level of each.\n")
    print("| settings | covering | Rand | labels by truth | labels (truth) | levels | one level only | CPU s |")
    print("|---|---|---|---|---|---|---|---|")
    for name, given in WAYS.items():
        session, rows = Session(), []
        for case in chosen:
            start = time.process_time()
            op = filters.op_named("label")(source=from_buffer(to_buffer(case.image.first)), **given)
            parts = [part for part in run(op, session)[0].image.parts if part.name.startswith("label.")]
            levels = [part.pixels()[..., 0].astype(np.int64) for part in parts]
            spent = time.process_time() - start
            best = max((score(case.truth, level, level) for level in levels), key=lambda one: one.covering)
            true = len(np.unique(case.truth[case.truth > 0]))
            rows.append((best.covering, best.rand, best.back, best.count, true, len(levels), len(levels) == 1, spent))
        covering, rand, back, count, true, many, single, spent = np.mean(rows, 0)
        alone = round(single * len(rows))
        print(
            f"| {name} | {covering:.3f} | {rand:.3f} | {back:.3f} | {count:.1f} ({true:.1f}) | {many:.1f} | {alone} |"
            f" {spent:.1f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
