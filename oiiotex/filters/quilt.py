# SPDX-License-Identifier: Apache-2.0
"""--texquilt: a texture of any size from patches of an exemplar, chosen by what they contain."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import OpenImageIO as oiio

from ..analysis.regions import content_table, largest_window, patch_side, regions, whole_windows, window_keys
from ..color import working_values
from ..errors import ImageError, ParameterError
from ..images import Image, Part, derived_spec
from ..op import Op, Output, Reach, Space
from ..params import Size, image, param
from ..session import Session
from ..synthesis.patchmatch import to_grid
from ..synthesis.plans import MOST_PATCH, Grid, Plan, Renderer
from ..synthesis.quilting import GRID, Demand, Exemplar, Quilt, Rules, folded
from ..windows import Window
from ..writing import write
from .guides import Meaning, keys_in, labels_met, meaning_of, wishes_of
from .label import RHO
from .sources import LABEL, LABELS, LEVEL, MASK, both, label_part, label_parts, source_pixels
from .stationarize import source_coordinates, st_spec, tile_spec

log = logging.getLogger("oiiotex")

_TABLE_BYTES = 60  # held for every pixel of the exemplar while its windows are sorted by content
_LEAST_PATCH, _LEAST_GUIDED = 8, 32
_FINER = 3  # levels below that of the keys whose labels tell candidates apart
_REGIONS = 12  # of the exemplar, from which a guide's label should be had


@dataclass(frozen=True, kw_only=True)
class Quilting(Op):
    """Sew a texture of any size together from patches of a photo, as a stream.

    Image quilting (Efros & Freeman, SIGGRAPH 2001): square patches on a regular grid, each the one that fits what is
    there best, cut along the line where both look most alike. With label maps (--texlabel:keep=1) a guide says what is
    to be where: patches are looked up by their content, the two most frequent labels in them (LSA16: Lockerman,
    Sauvage, Allegre, Dischler, Dorsey, Rushmeier, Multi-Scale Label-Map Extraction for Texture Synthesis, SIGGRAPH
    2016, section 6.1). Every pixel of the result is a copy of one pixel of the photo, and the result does not depend
    on memory or threads. A plan of offsets and cuts is all that is kept, so memory does not grow with the pixels.
    """

    name: ClassVar[str] = "quilt"
    copies: ClassVar[bool] = True
    reach: ClassVar[Reach] = Reach.CAUSAL
    space: ClassVar[Space] = Space.LAB
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("quilt", "pixels copied from the photo, all channels together, in its own colour space and type"),
        Output(
            "st", "where every pixel comes from: 32-bit float source coordinates, as --texwarp and --st_warp read them"
        ),
    )

    exemplar: Image = image(help="the photo")
    mask: Image | None = image(None, help=MASK)
    labels: Image | None = image(None, help=LABELS)
    guide: Image | None = image(
        None, help="what is to be where: ids of labels, or ids or colours that table gives a meaning; of any size"
    )
    label: int | None = param(None, ge=1, help=LABEL)
    level: int | None = param(None, ge=1, help=f"{LEVEL}; of guides, too")
    table: Path | None = param(
        None, help='JSON: {"255,0,0": 3, "0,0,255": [1, 2]}: which label or key ids or 8-bit colours of the guide mean'
    )
    size: Size | None = param(
        None, ge=1, le=1 << 22, unit="px", help="of the result; the guide's or else the exemplar's when left out"
    )
    tile: str = param("none", choices=("none", "x", "y", "xy"), help="along which axes the result tiles")
    patch: int | None = param(
        None,
        ge=_LEAST_PATCH,
        le=MOST_PATCH,
        unit="px",
        help="side of a patch; the label level's scale, or shorter side / 8, as a power of two when left out (less"
        " where a guide's labels are found in too few places)",
    )
    overlap: int | None = param(
        None, ge=4, le=MOST_PATCH // 3, unit="px", help="of neighbours, at most patch / 3; patch / 4 when left out"
    )
    candidates: int = param(256, ge=1, le=65536, help="patches that are tried in a place, at most")
    reuse: float = param(
        2.0, ge=1, le=1e9, help="no region of the exemplar is used more often than this times its fair share"
    )
    finer: float = param(0.5, ge=0, le=100, help="weight of finer levels' labels in the overlaps, beside colour")
    guidance: float = param(1.0, ge=0, le=100, help="weight of the guide's labels inside a patch, beside colour")
    plan: Path | None = param(None, help="the plan goes to this file (.npz): offsets and cuts")
    render: bool = param(
        False, help="make the result from the plan in that file, of the photo or of any map of its size"
    )
    stmap: bool | Path = param(False, help="1: source coordinates as part 'st' of the result; a file name: there")
    keep: bool = param(False, help="label parts of the exemplar follow, made from the same sources")
    seed: int = param(0, ge=0, le=2**32 - 1, help="same seed, same pixels")
    data: bool = param(False, help="the channels are no colours: compare them as they are")

    def compute(self, session: Session) -> Image:
        """The quilt, followed by what else is asked for."""
        for path in (self.stmap, self.plan):
            if isinstance(path, Path) and os.path.realpath(path) == os.path.realpath(self.exemplar.source):
                raise ParameterError(f"{path} would overwrite the photo")
        sources, grid = self._rendered(session) if self.render else self._sewn(session)
        return self._image(sources, grid, session)

    # --- from a plan ---

    def _rendered(self, session: Session) -> tuple[Callable[[Window], np.ndarray], Grid]:
        if self.plan is None:
            raise ParameterError("render=1 makes the result from a plan: plan=FILE says which")
        said = self.size, self.mask, self.labels, self.guide, self.label, self.patch, self.overlap
        if any(value is not None for value in said):
            raise ParameterError("render=1 takes everything from the plan; say none of size, patch, mask, label, guide")
        plan, size = Plan.load(self.plan)
        spec = self.exemplar.first.spec
        if size != (spec.width, spec.height):
            raise ImageError(
                f"{self.plan} is of an exemplar of {size[0]}x{size[1]}, {self.exemplar.source} is"
                f" {spec.width}x{spec.height}"
            )
        made = Renderer.of(session.device, plan, size[0], session.budget)
        return made.sources, plan.grid

    # --- from the exemplar ---

    def _sewn(self, session: Session) -> tuple[Callable[[Window], np.ndarray], Grid]:
        spec = self.exemplar.first.spec
        if self.guide is not None and self.label is not None:
            raise ParameterError("guide and label both say what patches contain: give one of them")
        if self.table is not None and self.guide is None:
            raise ParameterError("table says what a guide means: say guide, too")
        uses_labels = self.label is not None or self.guide is not None or self.level is not None or self.labels
        pixels = spec.width * spec.height
        session.require(
            _TABLE_BYTES * pixels, f"the content table of {spec.width}x{spec.height}", "make the exemplar smaller"
        )
        with session.stats.time("read and colour"):
            working = working_values(self.exemplar, None if self.data else session.color, session.autocc)
            named = self.label is not None
            allowed = both(
                working.opaque,
                source_pixels(
                    self.exemplar, self.mask, self.labels if named else None, self.level if named else None, self.label
                ),
            )
            lab = to_grid(working.values, GRID)
            del working
        with session.stats.time("content"):
            part = label_part(self.exemplar, self.labels, self.level) if uses_labels else None
            ids = None if part is None else part.pixels()[..., 0]
            patch, overlap = self._sides(part, ids, allowed)
            size = self.size or _size(self.guide or self.exemplar)
            grid = Grid(size.width, size.height, patch, overlap, "x" in self.tile, "y" in self.tile)
            keyed = ids if self.guide is not None else np.ones((spec.height, spec.width), np.uint8)
            table = content_table(*window_keys(keyed, patch, allowed), patch, grid.step)
            demand = self._demand(grid, keyed, table, session)
        finer = self._finer(part)
        rules = Rules(
            seed=self.seed,
            candidates=self.candidates,
            reach=min(4, patch // 16),
            reuse=self.reuse,
            finer=self.finer,
            guidance=self.guidance,
        )
        log.info("%s: %d x %d patches of %d px that overlap by %d", self.flag(), *grid.shape[::-1], patch, overlap)
        made = Quilt(
            session.device,
            Exemplar(lab, table, finer, keyed if demand.guide is not None else None),
            grid,
            demand,
            rules,
            session.budget,
            held=pixels * self.exemplar.first.pixel_bytes,
            plan=self._begun(grid, demand, session),
            report=session.advance,
        )
        if self.plan is not None:
            self._save(made.finished(), demand, session)
        return made.sources, grid

    def _begun(self, grid: Grid, demand: Demand, session: Session) -> Plan | None:
        """A plan to begin with, for filters that stand on this one."""
        return None

    def _save(self, plan: Plan, demand: Demand, session: Session) -> None:
        """Write the plan where it is asked for."""
        spec = self.exemplar.first.spec
        plan.save(self.plan, (spec.width, spec.height))
        session.written.add(os.path.realpath(self.plan))

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
            if smaller >= _LEAST_PATCH:
                log.warning("%s: no patch of %d px fits what may be taken: %d px instead", self.flag(), patch, smaller)
                patch = smaller
        if self.patch is None and self.guide is not None:
            patch = self._guided_side(ids, patch)
        if patch > most:
            raise ImageError(
                f"no patch of {patch} px fits what may be taken of {self.exemplar.source}: the largest square is"
                f" {most} px" + (f", patch={most} takes it" if most >= _LEAST_PATCH else "")
            )
        overlap = self.overlap or max(4 if patch >= 12 else patch // 3, patch // 4)
        if 3 * overlap > patch:
            raise ParameterError(f"overlap={overlap}: at most a third of patch={patch}, {patch // 3}, is allowed")
        return patch, overlap

    def _guided_side(self, ids: np.ndarray, patch: int) -> int:
        """Halved until there are several places to take each of the guide's labels from: else the few would repeat."""
        meaning = self._meaning(np.flatnonzero(np.bincount(ids.ravel())))
        wanted = labels_met(self.guide.first, meaning)
        while patch > _LEAST_GUIDED:
            block = patch - patch // 4
            if all(regions(whole_windows(ids == label, patch), block) >= _REGIONS for label in wanted):
                break
            patch //= 2
        return patch

    def _demand(self, grid: Grid, ids: np.ndarray, table, session: Session) -> Demand:
        """The key of every cell."""
        if self.guide is None:
            return Demand(np.zeros(grid.shape, np.int32))
        there = np.flatnonzero(np.bincount(ids.ravel()))
        meaning = self._meaning(there)
        wishes = wishes_of(self.guide.first, meaning, grid, session)
        keys, replaced = keys_in(table, wishes.keys)
        if replaced:
            named = ", ".join(f"{a} by {b}" for a, b in list(replaced.items())[:5])
            more = f" and {len(replaced) - 5} more" if len(replaced) > 5 else ""
            log.warning("%s: keys that no patch has are replaced by the nearest: %s%s", self.flag(), named, more)
        return Demand(keys, wishes.wanted)

    def _meaning(self, there: np.ndarray) -> Meaning:
        """What the guide's ids or colours mean, of a label map that has the ids `there`."""
        return meaning_of(self.guide.first, self.table, there)

    def _finer(self, part: Part | None) -> tuple[np.ndarray, ...]:
        """Label maps of the levels below that of the part."""
        if part is None or self.finer == 0:
            return ()
        levels = label_parts(self.exemplar, self.labels)
        level = max(levels) if self.level is None else self.level
        below = [number for number in levels if number < level][-_FINER:]
        return tuple(folded(levels[number].pixels()[..., 0]) for number in below)

    # --- the result ---

    def _image(self, sources: Callable[[Window], np.ndarray], grid: Grid, session: Session) -> Image:
        source = self.exemplar.first
        spec, size = source.spec, (grid.width, grid.height)
        places = _Last(sources)

        def copied(part: Part, spec: oiio.ImageSpec) -> Part:
            pixels = part.pixels()
            flat = np.ascontiguousarray(pixels).reshape(-1, pixels.shape[2])

            def fetch(window: Window) -> np.ndarray:
                at = places(window)
                rows = max(1, (1 << 18) // max(1, window.width))
                pieces = [at[y : y + rows] for y in range(0, len(at), rows)]
                return np.concatenate(list(session.spread(lambda piece: flat[piece], pieces)))

            return Part(part.name, spec, fetch, part.stored or spec.format, exact=part.exact)

        def coordinates(window: Window) -> np.ndarray:
            return source_coordinates(*np.divmod(places(window), np.uint32(spec.width)), spec)

        tile = copied(source, tile_spec(spec, self, *size))
        st = Part("st", st_spec(*size), coordinates, oiio.TypeDesc(oiio.FLOAT), exact=True)
        if isinstance(self.stmap, Path):
            write(Image((st,), str(self.stmap)), self.stmap, st.spec.format)
            session.written.add(os.path.realpath(self.stmap))
        parts = [tile, *([st] if self.stmap is True else [])]
        for part in self.exemplar.parts[1:]:
            alike = (part.spec.width, part.spec.height) == (spec.width, spec.height)
            if self.keep and alike and part.name.startswith("label."):
                parts.append(replace(copied(part, derived_spec(part.spec, *size)), exact=True))
            elif not part.name.startswith("label."):
                log.warning("%s: part '%s' of %s is not carried along", self.name, part.name, self.exemplar.source)
        return Image(tuple(parts), self.exemplar.source)


class _Last:
    """The sources of a window, those of the last one kept: all parts are asked for the same."""

    def __init__(self, sources: Callable[[Window], np.ndarray]):
        self._sources = sources
        self._held: tuple[Window, np.ndarray] | None = None

    def __call__(self, window: Window) -> np.ndarray:
        held = self._held
        if held is None or held[0] != window:
            held = self._held = (window, self._sources(window))
        return held[1]


def _size(found: Image) -> Size:
    return Size(found.first.spec.width, found.first.spec.height)
