# SPDX-License-Identifier: Apache-2.0
"""HRRG08 figure 3 by the letter, and what could keep its contrast: `python -m benchmarks.multiscale.letter`.

Standard deviation of L over the exemplar's in four windows of 64 px, some octaves below the exemplar's resolution, for
exemplars with an edge to themselves: crops of four photos, and noise of a 1/f spectrum, which is similar to itself at
all scales. `jitter to the root` has none on the root's two finest levels and beyond. Exact neighbors (eq. 2), of 64 px,
replace those of PatchMatch: of projected neighborhoods, or of whole ones, which no basis of principal components can
surpass.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import NamedTuple
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
from oiiotex.synthesis.multiscale.contrast import with_contrast
from oiiotex.synthesis.multiscale.graph import Graph
from oiiotex.synthesis.multiscale.infinite_plane import opened
from oiiotex.synthesis.multiscale.synthesizer import Synthesizer, default_jitter
from tools.demo import save

PHOTOS = "pebbles_beach_shadow", "stone_breccia", "sandstone_wall_cracked", "clover_lawn"
OCTAVES, AT_ONCE = (3, 6, 10, 20), 512


def exact(dims: int | None):
    """The two best candidates of every texel, by projected neighborhoods, or by whole ones for None."""

    def _level(device: object, buffers: object, stacks: Stacks, number: int) -> np.ndarray:
        side, admissible = stacks.planes.shape[1], [to for to, _ in stacks.levels.admissible[number]]
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


class Way(NamedTuple):
    """How a zoom is made: with `paper=1` and its exceptions, or as by default."""

    side: int = 64  # px of the exemplar
    r: int = 1
    dims: int = 6
    to_root: bool = False
    search: object = None
    literal: bool = True


WAYS = {
    "jitter to the root, 64 px": Way(to_root=True),
    "`paper=1`, 64 px": Way(),
    "exact neighbors in six dimensions, 64 px": Way(search=exact(6)),
    "exact neighbors in all 75, 64 px": Way(search=exact(None)),
    "sixteen dimensions, 64 px": Way(dims=16),
    "`paper=1`, 128 px": Way(128),
    "`paper=1`, 256 px": Way(256),
    "`paper=1`, 256 px, r = 3": Way(256, r=3),
    "default, 256 px": Way(256, dims=16, literal=False),
    "default, 256 px, r = 3": Way(256, r=3, dims=16, literal=False),
}


def spreads(path: Path, session: Session, way: Way) -> list[float]:
    """Some octaves below the exemplar, relative to its own."""
    what = mock.patch.object(candidate_sets, "_level", way.search or candidate_sets._level)
    how = {"side": way.side, "dims": way.dims, "correct": True, "literal": way.literal, "space": Space.LAB}
    with what, mock.patch.object(infinite_plane, "analysis_folder", lambda: None):
        image = read(path, session.resources.cache)
        plane = opened(session.resources, session.progress, Graph.loop("photo", way.r), (image,), str(path), **how)
    settings = plane.settings(seed=1, lock=0, jitter=default_jitter(plane.finest) if way.to_root else None)
    maker = Synthesizer(session.resources.device, plane.analysis, settings, session.resources.budget)
    if not way.literal:
        maker = with_contrast(maker, plane.analysis, None, "")
    own = plane.exemplars[0].values[..., 0].std()
    levels = [plane.finest + octaves for octaves in OCTAVES]
    return [
        float(np.mean([lab(plane, maker, n, Window.sized(x, y, 64, 64))[..., 0].std() for x, y in PLACES]) / own)
        for n in levels
    ]


def noise(side: int) -> np.ndarray:
    """Gray noise of a 1/f spectrum that tiles: (side, side, 3) uint8."""
    frequency = np.hypot(np.fft.fftfreq(side)[:, None], np.fft.rfftfreq(side)[None])
    spectrum = np.fft.rfft2(np.random.default_rng(0).standard_normal((side, side))) / np.maximum(frequency, 1 / side)
    spectrum[0, 0] = 0
    values = np.fft.irfft2(spectrum, (side, side))
    return np.repeat(np.clip(128 + 40 * values / values.std(), 0, 255).astype(np.uint8)[..., None], 3, -1)


def exemplars(side: int, folder: Path) -> list[Path]:
    """The middles of the photos, and noise."""
    paths = []
    for name in (*PHOTOS, "noise"):
        if name == "noise":
            square = noise(side)
        else:
            photo = oiio.ImageBuf(str(data_folder() / "photos" / f"{name}.jpg")).get_pixels(oiio.UINT8)[..., :3]
            top, left = (n // 2 - side // 2 for n in photo.shape[:2])
            square = np.ascontiguousarray(photo[top : top + side, left : left + side])
        paths.append(folder / f"{name}_{side}.png")
        save(square, paths[-1])
    return paths


def main() -> None:
    """Print the table."""
    heads = [f"{n} octaves" for n in OCTAVES]
    print(
        "| candidates, jitter, exemplar | " + " | ".join([*heads, f"1/f noise: {', '.join(map(str, OCTAVES))}"]) + " |"
    )
    print("|---" * 6 + "|")
    with tempfile.TemporaryDirectory() as folder:
        for name, way in WAYS.items():
            found = np.array([spreads(path, Session(autocc=True), way) for path in exemplars(way.side, Path(folder))])
            photos, own = found[:-1], found[-1]
            ends = zip(photos.mean(0), photos.min(0), photos.max(0), strict=True)
            cells = [f"{mean:.3f} ({low:.3f} to {high:.3f})" for mean, low, high in ends]
            print(f"| {name} | {' | '.join(cells)} | {', '.join(f'{one:.3f}' for one in own)} |", flush=True)


if __name__ == "__main__":
    main()
