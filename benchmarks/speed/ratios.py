# SPDX-License-Identifier: Apache-2.0
"""Whole programs compared with another program that does the same work, run in turns: medians, and their ratios.

python -m benchmarks.speed.ratios [--runs 3] [--only PART]

G'MIC's matchpatch synthesizes an image that does not tile, and neither measures nor judges it. How to install it:
benchmarks/shared/peers.py. Each pair runs once to fill caches. On a shared machine, read the ratios of CPU time.
"""

from __future__ import annotations

import argparse
import os
import statistics
import tempfile
from pathlib import Path

from benchmarks.shared.measures import Spent, measured
from benchmarks.shared.peers import PEERS
from benchmarks.speed.programs import PROGRAM, SIZES, write_photos

MATCHPATCH = next(tool for tool in PEERS if tool.name == "gmic-matchpatch")
TILED = "{}.png --texstationarize -o out.png"
OIIOTOOL = str(Path(PROGRAM[0]).with_name("oiiotool"))  # of the same wheel


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--only", default="", help="lines that contain this")
    given = parser.parse_args()
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # programs in Python keep their bytecode, as after an install
    columns = "wall-clock s", "CPU s", "its wall-clock s", "its CPU s", "wall-clock ratio", "CPU ratio"
    print(f"| line | the other program | {' | '.join(columns)} |\n|{'---|' * 8}")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_photos(folder, large=False)
        for line, other, words in _pairs(folder):
            if given.only in line:
                ours = [*PROGRAM, "--iscolorspace", "sRGB"] if "--tex" in line else [*PROGRAM]
                _print(line, other, *_medians(([*ours, *line.split()], words), folder, given.runs))


def _pairs(folder: Path) -> list[tuple[str, str, list[str]]]:
    """Our line, the name of the other program, and its words."""
    pairs = [("640.png -o out.png", "oiiotool", [OIIOTOOL, "640.png", "-o", "other.png"])]
    for side in ("512", "1024"):
        if MATCHPATCH.available():
            words = MATCHPATCH.command(folder / f"{side}.png", folder / "other.png", SIZES[side])
            pairs.append((TILED.format(side), MATCHPATCH.name, words))
    return pairs


def _medians(pair: tuple[list[str], list[str]], folder: Path, runs: int) -> list[Spent]:
    taken = [[measured(words, folder) for words in pair] for _ in range(runs + 1)][1:]
    return [Spent(*map(statistics.median, zip(*of, strict=True))) for of in zip(*taken, strict=True)]


def _print(line: str, other: str, ours: Spent, theirs: Spent) -> None:
    ratios = f"{ours.wall / theirs.wall:.2f} | {ours.cpu / theirs.cpu:.2f}"
    seconds = " | ".join(f"{spent.wall:.2f} | {spent.cpu:.2f}" for spent in (ours, theirs))
    print(f"| `{line}` | {other} | {seconds} | {ratios} |", flush=True)


if __name__ == "__main__":
    main()
