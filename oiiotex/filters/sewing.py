# SPDX-License-Identifier: Apache-2.0
"""What --texquilt, --texpaint and --texcomposite share: patches of an exemplar sewn by content, LSA16 section 6.1."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio

from ..analysis.regions import (
    ContentTable,
    content_table,
    largest_window,
    patch_side,
    regions,
    whole_windows,
    window_keys,
)
from ..color import working_values
from ..errors import ImageError, ParameterError
from ..images import Image, Part, derived_spec
from ..op import Op
from ..params import Size
from ..session import Session
from ..synthesis.patchmatch import to_grid
from ..synthesis.plans import Grid
from ..synthesis.quilting import GRID, Demand, Exemplar, Quilt, Rules, cell_memory, folded
from ..windows import Window
from ..writing import write
from .guides import Meaning, keys_in, labels_met, meaning_of, wishes_of
from .label import RHO
from .paintings import Begun
from .sources import both, label_part, label_parts, source_pixels
from .stationarize import source_coordinates, st_spec, tile_spec

log = logging.getLogger("oiiotex")

Sources = Callable[[Window], np.ndarray]  # a window of the result -> y * exemplar width + x of each of its pixels

LEAST_PATCH, _LEAST_GUIDED = 8, 32
_TABLE_BYTES = 60  # held for every pixel of the exemplar while its windows are sorted by content
_FINER = 3  # levels below that of the keys whose labels tell candidates apart
_REGIONS = 12  # of the exemplar, from which a guide's label should be had


@dataclass(frozen=True, kw_only=True)
class Sewing:
    """What is to be sewn from which photo, and how.

    What has the name of a parameter of --texquilt means the same here.

    Attributes
    ----------
    flag : str
        In whose name messages speak.
    meaning : callable or None
        The ids that the label map has -> what the guide's ids or colours mean; None: ids that mean themselves.
    begun : Begun or None
        A painting to begin with: its patches stay where the same is asked for.
    """

    flag: str
    exemplar: Image
    mask: Image | None = None
    labels: Image | None = None
    guide: Image | None = None
    label: int | None = None
    level: int | None = None
    size: Size | None = None
    tile: str
    patch: int | None
    overlap: int | None = None
    candidates: int
    reuse: float
    finer: float
    guidance: float
    seed: int
    data: bool
    meaning: Callable[[np.ndarray], Meaning] | None = None
    begun: Begun | None = None

    @classmethod
    def of(cls, op: Op, **said: Any) -> Sewing:
        """From an op's images and parameters of the same names, but for what is `said` here."""
        declared = (*op.images(), *op.optional_images(), *op.parameters())
        given = {p.name: getattr(op, p.attribute) for p in declared}
        taken = {f.name: given[f.name] for f in fields(cls) if f.name in given}
        return cls(**{"flag": op.flag(), **taken, **said})

    def quilt(self, session: Session) -> Quilt:
        """The quilt, of which nothing is made yet: its sources, its grid, what it is asked for, its plan at the end.

        Raises
        ------
        ImageError, ParameterError
            It does not fit the memory, no patch fits the exemplar, or the guide asks for what there is not.
        """
        source = self.exemplar.first
        width, height = source.spec.width, source.spec.height
        session.require(_TABLE_BYTES * width * height, f"the content table of {width}x{height}",
                        "make the exemplar smaller")  # fmt: skip
        with session.stats.time("read and colour"):
            lab, allowed = self._pixels(session)
        with session.stats.time("content"):
            part = self._label_map()
            ids = None if part is None else part.pixels()[..., 0]
            grid = self._grid(part, ids, allowed)
            rows, columns = grid.shape
            what = f"quilting {grid.width}x{grid.height} in {rows * columns} patches of {grid.patch} px"
            session.require(cell_memory(grid, self.guide is not None), what)
            keyed = ids if self.guide is not None else np.ones((height, width), np.uint8)
            table = content_table(*window_keys(keyed, grid.patch, allowed), grid.patch, grid.step)
            demand = self._demand(grid, keyed, table, session)
        exemplar = Exemplar(lab, table, self._finer(part), keyed if demand.guide is not None else None)
        log.info("%s: %d x %d patches of %d px that overlap by %d", self.flag, columns, rows, grid.patch, grid.overlap)
        return Quilt(
            session.device, exemplar, grid, demand, self._rules(grid.patch), session.budget,
            held=width * height * source.pixel_bytes,
            plan=None if self.begun is None else self.begun.kept(grid, demand, self.flag),
            report=session.advance,
        )  # fmt: skip

    def _pixels(self, session: Session) -> tuple[np.ndarray, np.ndarray | None]:
        """The exemplar on the grid of Lab, and where patches may be taken from."""
        working = working_values(self.exemplar, None if self.data else session.color, session.autocc)
        # without a label, labels and level say what the guide and finer look up, not what may be taken
        looked_up = (None, None) if self.label is None else (self.labels, self.level)
        allowed = both(working.opaque, source_pixels(self.exemplar, self.mask, *looked_up, self.label))
        return to_grid(working.values, GRID), allowed

    def _label_map(self) -> Part | None:
        """The label map of the level, where anything speaks of labels."""
        if all(said is None for said in (self.label, self.guide, self.level, self.labels)):
            return None
        return label_part(self.exemplar, self.labels, self.level)

    def _rules(self, patch: int) -> Rules:
        return Rules(
            seed=self.seed,
            candidates=self.candidates,
            reach=min(4, patch // 16),
            reuse=self.reuse,
            finer=self.finer,
            guidance=self.guidance,
        )

    def _grid(self, part: Part | None, ids: np.ndarray | None, allowed: np.ndarray | None) -> Grid:
        patch, overlap = self._sides(part, ids, allowed)
        like = (self.guide or self.exemplar).first.spec
        width, height = self.size or (like.width, like.height)
        return Grid(width, height, patch, overlap, "x" in self.tile, "y" in self.tile)

    def _sides(self, part: Part | None, ids: np.ndarray | None, allowed: np.ndarray | None) -> tuple[int, int]:
        """Side of a patch and overlap, such that there is a patch at all, and of a guide's labels several."""
        spec = self.exemplar.first.spec
        if ids is not None:
            allowed = both(ids != 0, allowed)
        rho = 0.0 if part is None else part.spec.get_float_attribute(RHO)
        shorter = min(spec.width, spec.height)
        most = shorter if allowed is None else largest_window(allowed)
        patch = self.patch or patch_side(rho or shorter / 8)
        if patch > most and self.patch is None:
            smaller = 1 << max(0, most.bit_length() - 1)
            if smaller >= LEAST_PATCH:
                log.warning("%s: no patch of %d px fits what may be taken: %d px instead", self.flag, patch, smaller)
                patch = smaller
        if self.patch is None and self.guide is not None:
            patch = self._guided_side(ids, patch)
        if patch > most:
            raise ImageError(
                f"no patch of {patch} px fits what may be taken of {self.exemplar.source}: the largest square is"
                f" {most} px" + (f", patch={most} takes it" if most >= LEAST_PATCH else "")
            )
        overlap = self.overlap or max(4 if patch >= 12 else patch // 3, patch // 4)
        if 3 * overlap > patch:
            raise ParameterError(f"overlap={overlap}: at most a third of patch={patch}, {patch // 3}, is allowed")
        return patch, overlap

    def _guided_side(self, ids: np.ndarray, patch: int) -> int:
        """Halved until there are several places to take each of the guide's labels from: else the few would repeat."""
        meaning = self._meant(ids)
        wanted = labels_met(self.guide.first, meaning)
        while patch > _LEAST_GUIDED:
            block = patch - patch // 4
            if all(regions(whole_windows(ids == label, patch), block) >= _REGIONS for label in wanted):
                break
            patch //= 2
        return patch

    def _demand(self, grid: Grid, ids: np.ndarray, table: ContentTable, session: Session) -> Demand:
        """The key of every cell."""
        if self.guide is None:
            return Demand(np.zeros(grid.shape, np.int32))
        meaning = self._meant(ids)
        wishes = wishes_of(self.guide.first, meaning, grid, session)
        keys, replaced = keys_in(table, wishes.keys)
        if replaced:
            named = ", ".join(f"{a} by {b}" for a, b in list(replaced.items())[:5])
            more = f" and {len(replaced) - 5} more" if len(replaced) > 5 else ""
            log.warning(
                "%s: no patch holds these pairs of labels (dominant, second), the nearest are taken: %s%s",
                self.flag,
                named,
                more,
            )
        return Demand(keys, wishes.wanted)

    def _meant(self, ids: np.ndarray) -> Meaning:
        """What the guide's ids or colours mean."""
        there = np.flatnonzero(np.bincount(ids.ravel()))
        return meaning_of(self.guide.first, None, there) if self.meaning is None else self.meaning(there)

    def _finer(self, part: Part | None) -> tuple[np.ndarray, ...]:
        """Label maps of the levels below that of the part."""
        if part is None or self.finer == 0:
            return ()
        levels = label_parts(self.exemplar, self.labels)
        level = max(levels) if self.level is None else self.level
        below = [number for number in levels if number < level][-_FINER:]
        return tuple(folded(levels[number].pixels()[..., 0]) for number in below)


# --- the result ---


def sewn_image(op: Op, sources: Sources, grid: Grid, session: Session) -> Image:
    """Pixels of `op.exemplar` from their sources; `op.keep` asks for its labels, `op.stmap` for the sources."""
    source = op.exemplar.first
    spec, size = source.spec, (grid.width, grid.height)
    places = _Last(sources)

    def coordinates(window: Window) -> np.ndarray:
        return source_coordinates(*np.divmod(places(window), np.uint32(spec.width)), spec)

    tile = _copied(source, tile_spec(spec, op, *size), places, session)
    st = Part("st", st_spec(*size), coordinates, oiio.TypeDesc(oiio.FLOAT), exact=True)
    if isinstance(op.stmap, Path):
        write(Image((st,), str(op.stmap)), op.stmap, st.spec.format)
        session.written.add(os.path.realpath(op.stmap))
    parts = [tile, *([st] if op.stmap is True else [])]
    for part in op.exemplar.parts[1:]:
        alike = (part.spec.width, part.spec.height) == (spec.width, spec.height)
        if op.keep and alike and part.name.startswith("label."):
            parts.append(replace(_copied(part, derived_spec(part.spec, *size), places, session), exact=True))
        elif not part.name.startswith("label."):
            log.warning("%s: part '%s' of %s is not carried along", op.name, part.name, op.exemplar.source)
    return Image(tuple(parts), op.exemplar.source)


def sewn_whole(op: Op, sewing: Sewing, session: Session) -> Image:
    """The result of one sewing; where `op.plan` asks for it, it is sewn to the end for its plan."""
    quilt = sewing.quilt(session)
    if op.plan is not None:
        spec = op.exemplar.first.spec
        quilt.finished().save(op.plan, (spec.width, spec.height))
        session.written.add(os.path.realpath(op.plan))
    return sewn_image(op, quilt.sources, quilt.grid, session)


def _copied(part: Part, spec: oiio.ImageSpec, places: Sources, session: Session) -> Part:
    """The part's pixels at their places, on all threads."""
    pixels = part.pixels()
    flat = np.ascontiguousarray(pixels).reshape(-1, pixels.shape[2])

    def fetch(window: Window) -> np.ndarray:
        at = places(window)
        rows = max(1, (1 << 18) // max(1, window.width))
        pieces = [at[y : y + rows] for y in range(0, len(at), rows)]
        return np.concatenate(list(session.spread(lambda piece: flat[piece], pieces)))

    return Part(part.name, spec, fetch, part.stored or spec.format, exact=part.exact)


class _Last:
    """The sources of a window, those of the last one kept: all parts are asked for the same."""

    def __init__(self, sources: Sources):
        self._sources = sources
        self._held: tuple[Window, np.ndarray] | None = None

    def __call__(self, window: Window) -> np.ndarray:
        held = self._held
        if held is None or held[0] != window:
            held = self._held = (window, self._sources(window))
        return held[1]
