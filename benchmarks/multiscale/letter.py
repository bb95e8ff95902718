# SPDX-License-Identifier: Apache-2.0
"""HRRG08 figure 3 by the letter, and what could keep its contrast: `python -m benchmarks.multiscale.letter`.

Standard deviation of L over the exemplar's in four windows of 64 px, for exemplars of 64 px with an edge of r = 1 to
themselves. `jitter to the root` has none on the root's two finest levels and beyond. Exact neighbors (eq. 2) replace
those of PatchMatch: of projected neighborhoods, or of whole ones, which no basis of principal components can surpass.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from unittest import mock

import numpy as np
import OpenImageIO as oiio

from benchmarks.multiscale.quality import PLACES, lab
from benchmarks.shared.measures import data_folder
from oiiotex.engine.core.op import Space
from oiiotex.engine.core.window import Window
from oiiotex.engine.io.reading import read
from oiiotex.engine.session import Session
from oiiotex.synthesis.multiscale import candidate_sets, infinite_plane
from oiiotex.synthesis.multiscale.candidate_sets import DISC, Stacks, basis_of, neighborhoods, project
from oiiotex.synthesis.multiscale.graph import Graph
from oiiotex.synthesis.multiscale.infinite_plane import opened
from oiiotex.synthesis.multiscale.synthesizer import Synthesizer, default_jitter
from tools.demo import save

PHOTOS = "pebbles_beach_shadow", "stone_breccia", "sandstone_wall_cracked", "clover_lawn"
LEVELS, SIDE, AT_ONCE = (9, 12, 16, 20), 64, 512


def exact(dims: int | None):
    """The two best candidates of every texel, by projected neighborhoods, or by whole ones for None."""

    def _level(device: object, buffers: object, stacks: Stacks, number: int) -> np.ndarray:
        side, admissible = SIDE, [to for to, _ in stacks.levels.admissible[number]]
        basis = None if dims is None else basis_of(stacks, dims)[0]

        def seen(level: int) -> np.ndarray:
            around = neighborhoods(stacks.planes[level], stacks.levels.spacing(level), stacks.periodic[level])
            return (around if basis is None else project(around, basis)).astype(np.float32)

        wanted, others = seen(number), np.concatenate([seen(to) for to in admissible])
        level, place = np.repeat(admissible, side * side), np.tile(np.arange(side * side), len(admissible))
        squares, found = np.square(others).sum(1), []
        for start in range(0, side * side, AT_ONCE):
            here = np.arange(start, min(start + AT_ONCE, side * side))
            away = squares - 2 * wanted[here] @ others.T
            first = here if admissible[0] == number else away.argmin(1)
            apart = np.abs(
                np.stack(np.divmod(place[first], side))[..., None] - np.stack(np.divmod(place, side))[:, None]
            )
            near = np.square(np.minimum(apart, side - apart)).sum(0) < (DISC * side) ** 2
            away[near & (level == level[first][:, None])] = np.inf
            best = np.stack([first, away.argmin(1)], 1)
            found.append(level[best] * side * side + place[best])
        return np.concatenate(found).astype(np.uint32)

    return _level


def spreads(path: Path, session: Session, dims: int, jitter: str, search: object) -> list[float]:
    """Of the levels, relative to the exemplar."""
    what = mock.patch.object(candidate_sets, "_level", search or candidate_sets._level)
    with what, mock.patch.object(infinite_plane, "analysis_folder", lambda: None):
        how = {"side": SIDE, "dims": dims, "correct": True, "literal": True, "space": Space.LAB}
        image = read(path, session.resources.cache)
        plane = opened(session.resources, session.progress, Graph.loop("photo", 1), (image,), str(path), **how)
    root = default_jitter(plane.finest) if jitter == "root" else None
    settings = plane.settings(seed=1, lock=0, jitter=root)
    maker = Synthesizer(session.resources.device, plane.analysis, settings, session.resources.budget)
    own = plane.exemplars[0].values[..., 0].std()
    return [
        float(np.mean([lab(plane, maker, n, Window.sized(x, y, 64, 64))[..., 0].std() for x, y in PLACES]) / own)
        for n in LEVELS
    ]


WAYS: dict[str, tuple[int, str, object]] = {
    "jitter to the root": (6, "root", None),
    "`paper=1`": (6, "all", None),
    "exact neighbors in six dimensions": (6, "all", exact(6)),
    "exact neighbors in all 75": (6, "all", exact(None)),
    "sixteen dimensions": (16, "all", None),
}


def main() -> None:
    """Print the table."""
    print("| candidates, jitter | " + " | ".join(f"level {n}" for n in LEVELS) + " |", "|---" * 5 + "|", sep="\n")
    with tempfile.TemporaryDirectory() as folder:
        paths = []
        for name in PHOTOS:
            photo = oiio.ImageBuf(str(data_folder() / "photos" / f"{name}.jpg")).get_pixels(oiio.UINT8)[..., :3]
            top, left = (n // 2 - SIDE // 2 for n in photo.shape[:2])
            paths.append(Path(folder) / f"{name}.png")
            save(np.ascontiguousarray(photo[top : top + SIDE, left : left + SIDE]), paths[-1])
        for name, way in WAYS.items():
            found = np.array([spreads(path, Session(autocc=True), *way) for path in paths])
            ends = zip(found.mean(0), found.min(0), found.max(0), strict=True)
            cells = [f"{mean:.3f} ({low:.3f} to {high:.3f})" for mean, low, high in ends]
            print(f"| {name} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
