# SPDX-License-Identifier: Apache-2.0
"""Labels against maps of two true classes: joints and tiles, rust and metal, stones and matrix.

python -m benchmarks.labels.classes [--name PART] [--paper] [--levels]

A label takes the class that most of its pixels have. IoU of both classes at the level at which their mean is best, and
with `--levels` at all levels, with the number of labels.
"""

from __future__ import annotations

import argparse
import time
from typing import NamedTuple

import numpy as np

from benchmarks.labels.levels import Case, cases
from oiiotex import filters
from oiiotex.engine.core.image import from_buffer, to_buffer
from oiiotex.engine.run import run
from oiiotex.engine.session import Session

NAMES = ("facade", "gravel", "rusty")


class Classes(NamedTuple):
    """Labels of one level that take their majority class."""

    scale: float
    count: int
    first: float  # IoU of class 1
    second: float  # IoU of class 2

    @property
    def mean(self) -> float:
        """Mean IoU."""
        return (self.first + self.second) / 2

    def __str__(self) -> str:
        return f"{self.first:.2f}/{self.second:.2f} with {self.count} labels at {self.scale:.0f} px"


def classes(truth: np.ndarray, ids: np.ndarray, scale: float) -> Classes:
    """IoU of classes 1 and 2 of (h, w) truth, 0 not counted, with labels (h, w)."""
    known = truth > 0
    labels, truth = ids[known], truth[known]
    table = np.zeros((labels.max() + 1, 3), np.int64)
    np.add.at(table, (labels, truth), 1)
    said = table[:, 1:].argmax(1)[labels] + 1
    ious = [((said == n) & (truth == n)).sum() / max(((said == n) | (truth == n)).sum(), 1) for n in (1, 2)]
    return Classes(scale, len(np.unique(labels)), *map(float, ious))


def levels(case: Case, session: Session, **given: object) -> tuple[list[Classes], float]:
    """Every level, finest first, and the CPU time, s."""
    start = time.process_time()
    op = filters.op_named("label")(source=from_buffer(to_buffer(case.image.first)), **given)
    parts = [part for part in run(op, session)[0].image.parts if part.name.startswith("label.")]
    maps = [(part.pixels()[..., 0].astype(np.int64), part.spec.get_float_attribute("oiiotex:rho")) for part in parts]
    spent = time.process_time() - start
    return [classes(case.truth, ids, scale) for ids, scale in maps], spent


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--name", default="")
    parser.add_argument("--paper", action="store_true", help="with paper=1")
    parser.add_argument("--levels", action="store_true", help="all levels, not only the best")
    given, session = parser.parse_args(), Session()
    chosen = [case for name in NAMES for case in cases(name) if given.name in case.name]
    print("| map | best level | finest level | CPU s |", "|---|---|---|---|", sep="\n")
    for case in chosen:
        found, spent = levels(case, session, paper=given.paper)
        best = max(found, key=lambda one: one.mean)
        print(f"| {case.name} | {best} | {found[0]} | {spent:.1f} |", flush=True)
        if given.levels:
            print(*(f"    {n}: {one}" for n, one in enumerate(found, 1)), sep="\n")


if __name__ == "__main__":
    main()
