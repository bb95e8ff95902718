# SPDX-License-Identifier: Apache-2.0
"""Constant and linear transfer functions of HRRG08 section 5, compared: `python -m benchmarks.multiscale.transfer`.

For candidates in other exemplars: eq. 4 without a transfer function, with r(c) = c + b (what --texsynth uses), and with
r(c) = A c + b by least squares, rms per color in Lab units. `held out`: fitted to every other color of the
neighborhood and measured on the rest. Numerical stability: how much A, and A composed along random paths of a synthesis
through four transitions, enlarges a color difference at most (the largest singular value).
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.multiscale.quality import GRAPHS, drawn, prepared
from benchmarks.shared.measures import data_folder
from oiiotex.engine.color.lab_grid import FINE_STEPS
from oiiotex.engine.session import Session
from oiiotex.synthesis.multiscale.candidate_sets import neighborhoods

SAMPLED, PATHS, TRANSITIONS = 1000, 300, 4
_HALF = np.arange(25) % 2 == 0


def fitted(to: np.ndarray, of: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(A, b) of r for n neighborhoods (n, k, 3), such that A to + b is nearest to `of`, with the least change."""
    mean_to, mean_of = to.mean(1, keepdims=True), of.mean(1, keepdims=True)
    change = np.linalg.pinv(to - mean_to, rcond=1e-2) @ ((of - mean_of) - (to - mean_to))
    A = np.eye(3) + change.transpose(0, 2, 1)
    return A, (mean_of - mean_to @ A.transpose(0, 2, 1))[:, 0]


def rms(away: np.ndarray) -> float:
    """Of colors, Lab units."""
    return float(np.sqrt(np.square(away).sum(-1).mean()) / FINE_STEPS)


def measured(path: Path, session: Session, side: int) -> str:
    """A row of the table."""
    plane, _ = prepared(path, session, side)
    stacks, links = plane.analysis.stacks, plane.analysis.links.astype(np.int64)
    levels, texels, random = stacks.levels, links.shape[1], np.random.default_rng(0)
    around = [
        neighborhoods(p, levels.spacing(n), stacks.periodic[n]).reshape(-1, 25, 3) for n, p in enumerate(stacks.planes)
    ]
    exemplar = np.array([i for i, _ in levels.stacks])
    crossing = exemplar[np.arange(len(links))[:, None, None]] != exemplar[links // texels]
    at = np.argwhere(crossing)
    at = at[random.choice(len(at), min(SAMPLED, len(at)), replace=False)]

    def both(number: int, texel: int, k: int) -> tuple[np.ndarray, np.ndarray]:
        other, place = divmod(int(links[number, texel, k]), texels)
        return around[other][place], around[number][texel]

    to, of = (np.array(one) for one in zip(*(both(*a) for a in at.tolist()), strict=True))
    A, b = fitted(to, of)
    half, shift = fitted(to[:, _HALF], of[:, _HALF])
    offset = (of - to).mean(1, keepdims=True)
    offset_half = (of - to)[:, _HALF].mean(1, keepdims=True)
    largest = np.linalg.svd(A, compute_uv=False)[:, 0]
    path_of = []
    for _ in range(PATHS):
        number, texel, k = at[random.integers(len(at))].tolist()
        whole, count = np.eye(3), 0
        for _ in range(8 * TRANSITIONS):
            if exemplar[links[number, texel, k] // texels] != exemplar[number]:
                whole, count = whole @ fitted(*(one[None] for one in both(number, texel, k)))[0][0], count + 1
                number, texel = divmod(int(links[number, texel, k]), texels)
                if count == TRANSITIONS:
                    break
            number, k = levels.finer[number], int(random.integers(2))
        path_of.append(np.linalg.norm(whole, 2))
    held = rms((of - to @ half.transpose(0, 2, 1) - shift[:, None])[:, ~_HALF]), rms((of - to - offset_half)[:, ~_HALF])
    figures = rms(of - to), rms(of - to - offset), rms(of - to @ A.transpose(0, 2, 1) - b[:, None]), held[1], held[0]
    name = path.parent.name if path.name == "graph.json" else path.stem
    norms = [f"{np.median(one):.2f}, {np.percentile(one, 95):.2f}" for one in (largest, path_of)]
    return f"| {name} | {' | '.join(f'{f:.2f}' for f in figures)} | {' | '.join(norms)} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--side", type=int, default=128)
    side, session = parser.parse_args().side, Session(autocc=True)
    print("| graph | none | constant | linear | constant, held out | linear, held out | A: median, 95 % | four A |")
    print("|---|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for path in [*(data_folder() / "multiscale" / name / "graph.json" for name in GRAPHS), drawn(Path(folder))]:
            print(measured(path, session, side), flush=True)


if __name__ == "__main__":
    main()
