# SPDX-License-Identifier: Apache-2.0
"""The CSV files of stationarization.py: the measures, reading and writing."""

from __future__ import annotations

import csv
from pathlib import Path

MEASURES = ("histogram", "moments", "steerable")
BASELINE, DEFAULT = "patchmatch", "default"
FIELDS = ("photo", "seed", "variant", "measure", "cost")
TEXTURE, FLAT_TEXTURE = "texture", "texture of the flattened photo"
TRACE_FIELDS = ("photo", "variant", "iteration", "stationarity", "texture", "deviation")


def best_seed(table: list[dict[str, str]], photo: str, measure: str) -> int:
    """With which the baseline is most stationary."""
    mine = [r for r in table if (r["photo"], r["variant"], r["measure"]) == (photo, BASELINE, measure)]
    return int(min(mine, key=lambda r: float(r["cost"]))["seed"])


def rows(path: Path) -> list[dict[str, str]]:
    """Of a CSV file; none where there is no file."""
    if not path.exists():
        return []
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def append(path: Path, fields: tuple[str, ...], more: list[tuple]) -> None:
    """Write rows, below a head where the file is new."""
    new = not path.exists()
    with open(path, "a", newline="") as file:
        writer = csv.writer(file)
        writer.writerows([fields] if new else [])
        writer.writerows([f"{v:.6g}" if isinstance(v, float) else v for v in row] for row in more)
