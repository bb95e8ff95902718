# SPDX-License-Identifier: Apache-2.0
"""One run of --texfill: from the marked pixels to the filled photo."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from ...analysis.regularity.courses import Courses, InCourses
from ...analysis.regularity.lattice import Lattice
from ...analysis.regularity.lattice import bytes_needed as lattice_bytes
from ...analysis.regularity.offset_prices import InStep
from ...analysis.stationarity.row_bands import row_bands
from ...engine.color.config import as_float
from ...engine.color.lab import lens_of
from ...engine.core.demand import SomeRows, rows_of
from ...engine.core.image import Image, Part, spec_beside
from ...engine.core.source_map import SourceMap, tile_spec
from ...engine.core.tiling import tiling_of
from ...engine.core.window import Window
from ...engine.deferred import np
from ...engine.errors import ImageError, MemoryBudgetError
from ..exemplar.exemplar_masks import both, label_map, labeled_pixels, masked_pixels
from ..exemplar.exemplar_op import ExemplarPixels
from ..exemplar.heights import height_tile
from ..exemplar.materials import read_material
from ..exemplar.photo_lattice import photo_structure
from ..patchmatch.constraints import Constraints, FixedPixels
from ..patchmatch.memory import ExemplarHeld
from ..patchmatch.optimization import require_memory, synthesize
from ..patchmatch.recipe import Recipe
from ..quality.report import Quality
from ..quality.verdicts import GRADES, verdicts
from .border import BYTES as BORDER_BYTES
from .border import border_offsets
from .fill_measures import BYTES as MEASURE_BYTES
from .fill_measures import NAMES, SOURCE_BYTES, fill_measures, repeats
from .light import Light, drift_within, light_of
from .onion_peel import BYTES as START_BYTES
from .onion_peel import peeled
from .region import marked_pixels, surroundings
from .seam_zone import cut_bytes, grown, replaced_pixels
from .source_layout import in_layout_of

if TYPE_CHECKING:
    from ...engine.color.lens import Lens
    from ...engine.session.facts import Facts
    from ...engine.session.progress import Progress
    from ...engine.session.resources import Resources

_SHARES = 1, 1, 8, 1  # of the time: reading, light, synthesis, cut
_UNIFORMITY = 0.01  # of the use of the source (MJH17 eq. 6)
_FINE = 4  # iterations of each finer level: at the border, patches must fit pixels that do not change
_COLOR_BYTES = 12  # of a pixel of a map
_SOURCE_BYTES = 1  # of a pixel of the source: whether it is valid
_PLACE_BYTES = 16  # of a pixel of the window: its source, and the step at the border
_UNCHANGED = 1, 0, 0, 0  # gain and offsets
_AROUND = 0.5  # margin in which light is measured, in longer sides of the region


@dataclass(frozen=True)
class Filling:
    """The source of each pixel of a window, and where it is shown.

    `source`: of a window at (0, 0) of the photo's data window; `shown` (height, width) bool; `step` (height, width, 3)
    float32 or None: offsets, at the common level if there is one, that close the step at the border. `measures`: how
    good it is, by name.
    """

    window: Window
    source: SourceMap
    shown: np.ndarray
    step: np.ndarray | None = None
    measures: dict[str, float] = field(default_factory=dict)


def quality_of(op: Any, facts: Facts) -> Quality:
    """The measures of --texfill: its border, and uses of the source's pixels."""
    spec = op.source_maps()[0].first.spec
    return Quality(op=op, facts=facts, own=NAMES, need=SOURCE_BYTES * spec.width * spec.height + (32 << 20))


class RegionFill:
    """The inputs of one run of the op, and its results."""

    def __init__(self, op: Any, resources: Resources, progress: Progress, quality: Quality):
        self._op, self._resources, self._stages = op, resources, progress.stages(*_SHARES)
        self._photos = op.all_maps()
        self._sources = op.source_maps()
        self._other = op.donor is not None
        given = op.exemplar, op.region, op.replace, op.labellevel, op.matte
        with resources.stats.time("read and color"):
            self._marked = marked_pixels(*given)
        self._tiling = tiling = op.tiled or tiling_of(op.exemplar.first.spec)
        self._wraps = "x" in tiling, "y" in tiling
        self._quality, self._measured = quality.during(resources, progress), progress.measure
        self._light: tuple[Light, Light] | None = None

    def results(self) -> tuple[dict[str, Any], ...]:
        """One mapping for each map of the material."""
        op, progress = self._op, next(self._stages)
        if not self._marked.any():
            op.warn("the region is empty; the photo is unchanged")
            empty = np.zeros((0, 0), bool)
            first, *others = self._parts(Filling(Window(0, 0, 0, 0), SourceMap(np.zeros((0, 0), np.uint32)), empty))
            return self._quality.add_own(first, lambda: None), *others
        if self._marked.all() and not self._other:
            raise ImageError(
                f"the region covers every pixel of {op.exemplar.source}: no source pixels remain; mark fewer, or give"
                " another photo with donor="
            )
        zone = grown(self._marked, op.seamzone)
        filling = self._filled(zone, progress)
        first, *others = self._parts(filling)
        if not self._measured:  # otherwise they are among the measures
            for grade, _, sentence in (line.partition(": ") for line in verdicts(filling.measures)):
                if grade == GRADES[-1]:
                    op.warn("%s", sentence)
        results = (self._quality.add_own(first, lambda: filling.measures), *others)
        if progress.look is not None:
            progress.look(as_float(results[0]["fill"].pixels()), True)
        return results

    # --- synthesis ---

    def _filled(self, zone: np.ndarray, progress: Progress) -> Filling:
        op, resources = self._op, self._resources
        window = surroundings(zone, 2 * op.side, self._wraps)
        recipe = self._recipe(window)
        in_memory = op.holds_photo(resources)
        spec = self._sources[0].first.spec
        left, masked = op.budget_left(resources, window) - START_BYTES, ExemplarHeld(in_memory, True)
        self._require_rest(left, window, in_memory, int(zone.sum() - self._marked.sum()))
        require_memory(resources.device, recipe, (spec.height, spec.width, 3), left, masked)
        with resources.stats.time("read and color"):
            pixels, shown, opaque = self._read(in_memory)
        if not in_memory:
            resources.cache.forget()  # everything has been read
        progress.advance(1, 1)
        inside = window.inside(Window(0, 0, *zone.shape[::-1]))
        kept = np.empty((window.height, window.width, shown.shape[2]), np.float32)
        for band in row_bands(kept):
            kept[band] = shown[window.top + band.start : window.top + band.stop][:, inside[1]]
        stage = next(self._stages)
        values = pixels.values
        with resources.stats.time("light"):
            if op.strength > 0:
                self._light = self._lights(pixels, stage)
            if self._light is not None:
                mine, other = self._light
                values = other.removed_from(values, Window(0, 0, *self._sources[0].first.window.size))
                kept = np.asarray(mine.removed_from(kept, window))
        if not self._other and op.lattice > 0:
            recipe = self._in_step(recipe, pixels, window)
        marked = self._marked[inside]
        is_fixed = ~marked if opaque is None else ~marked & opaque[inside]
        places = None
        if not self._other:
            places = SourceMap.of(np.arange(window.top, window.bottom)[:, None], np.arange(window.left, window.right))
        fixed = FixedPixels(is_fixed, places, np.ascontiguousarray(kept), peeled) if is_fixed.any() else None
        with resources.stats.time("synthesis"):
            source = synthesize(
                resources.device, values, pixels.usable, recipe, left, next(self._stages).advance,
                pixels.why, Constraints(fixed=fixed),
            ).source  # fmt: skip
        resources.device.collect(resources.stats)
        source = SourceMap(np.asarray(source.packed))
        if op.seamzone:
            with resources.stats.time("cut"):
                marked = replaced_pixels(marked, zone[inside], kept, values, source)
        step, clear = None, ~marked if opaque is None else ~marked & opaque[inside]
        if op.fade_width > 0 and lens_of(op.exemplar, resources, op.first_space).space is not None:  # not data
            with resources.stats.time("border"):
                step = border_offsets(kept, values, source, marked, clear, pixels.usable, op.fade_width, self._wraps)
        next(self._stages).advance(1, 1)
        measures = self._measures(kept, values, source, marked, clear, step)
        if step is not None:
            step /= np.float32(op.first_weight**0.5)  # values are weighted for the comparison
        return Filling(window, source, marked, step, measures)

    def _measures(
        self, kept: np.ndarray, values: SomeRows, source: SourceMap, shown: np.ndarray, is_kept: np.ndarray,
        step: np.ndarray | None,
    ) -> dict[str, float]:  # fmt: skip
        """The measures of the fill; those that take longer only if requested."""
        with self._resources.stats.time("measure"):
            lab = kept[..., :3].copy()
            lab[shown] = source[shown].gather(values)[:, :3]
            if step is not None:
                lab += step
            measures = fill_measures(lab, shown, is_kept)
            if self._quality.is_asked_for:
                measures |= repeats(source, shown, (values.shape[0], values.shape[1]), self._other)
        return measures

    def _require_rest(self, left: int, window: Window, in_memory: bool, free: int) -> None:
        """Refuse what other steps than synthesis cannot do in `left` bytes. `free`: pixels that a cut decides on."""
        op, spec = self._op, self._sources[0].first.spec
        colors = _SOURCE_BYTES * spec.width * spec.height  # those that the synthesis counts
        colors += _COLOR_BYTES * len(self._photos) * spec.width * spec.height * in_memory
        area, advice = window.width * window.height, "make the region or the photo smaller"
        steps = [("closing and measuring the border", (_PLACE_BYTES + max(BORDER_BYTES, MEASURE_BYTES)) * area, advice)]
        if not self._other and op.lattice > 0:
            steps.append(("finding the photo's structure", lattice_bytes(spec.height, spec.width), "set lattice=0"))
        if op.seamzone:
            steps.append(("cutting the border", cut_bytes(area, free, spec.width * spec.height), "reduce seamzone"))
        task, need, hint = max(steps, key=lambda step: step[1])
        if need + colors > left:
            raise MemoryBudgetError(task, need + colors, left, hint)

    def _recipe(self, window: Window) -> Recipe:
        op = self._op
        return Recipe.tiling(
            *window.size, self._tiling, sigma=None, patch=op.side, iterations=op.iterations, seed=op.seed,
            uniformity=_UNIFORMITY, contrast=0.0, flat=False, fine=_FINE, search=op.search,
        )  # fmt: skip

    def _in_step(self, recipe: Recipe, pixels: ExemplarPixels, window: Window) -> Recipe:
        """The recipe that keeps the photo's lattice or courses."""
        op = self._op
        structure = pixels.remembered(self._resources, photo_structure, op.flag())
        whole = replace(recipe, width=self._marked.shape[1], height=self._marked.shape[0])
        if isinstance(structure, Lattice):
            step: InStep | InCourses = InStep(structure, structure.on_torus(whole), op.lattice)
        elif isinstance(structure, Courses):
            step = InCourses.of(structure, whole, op.lattice)
        else:
            return recipe
        return replace(recipe, in_step=step.moved(window.left, window.top))

    def _read(self, in_memory: bool) -> tuple[ExemplarPixels, SomeRows, np.ndarray | None]:
        """The source, values of the photo, and the photo's opaque pixels."""
        op, resources = self._op, self._resources
        match = op.weights()
        shown, opaque = read_material(self._photos, op.kinds, match, op.data, resources, in_memory)
        values, clear = shown, opaque
        if self._other:
            values, clear = read_material(self._sources, op.kinds, match, op.data, resources, in_memory)
        name = "the source" if self._other else "the exemplar"
        allowed = None if op.mask is None else masked_pixels(op.mask, self._sources[0], name)
        if op.label is not None:
            labels = label_map(op.donor or op.exemplar, op.labellevel)
            allowed = both(labeled_pixels(labels, op.label), allowed)
        usable = both(clear, allowed)
        if not self._other:
            usable = both(usable, ~self._marked)
        if usable is not None and not usable.any():
            raise ImageError("no source pixels remain: all are transparent, or excluded by mask, label or region")
        why = "pixels that are transparent, outside mask or label" + ("" if self._other else ", or in the region")
        return ExemplarPixels(values, clear, usable, why), shown, opaque

    def _lights(self, pixels: ExemplarPixels, progress: Progress) -> tuple[Light, Light] | None:
        """Corrections of the photo and of the source to one level; None if the photo has nothing around the region."""
        op, resources, zone = self._op, self._resources, self._marked
        space = op.first_space
        around = surroundings(zone, max(4 * op.side, int(_AROUND * _longer_side(zone))), self._wraps)
        inside = around.inside(Window(0, 0, *zone.shape[::-1]))
        mine = drift_within(op.exemplar, around, ~zone[inside], space, resources, progress)
        whole = Window(0, 0, *self._sources[0].first.window.size)
        usable = np.ones((whole.height, whole.width), bool) if pixels.usable is None else pixels.usable
        other = drift_within(self._sources[0], whole, usable, space, resources, progress)
        if mine is None or other is None:
            return None
        in_lab = lens_of(op.exemplar, resources, space).space is not None
        corners = [one.first.window[:2] for one in (op.exemplar, self._sources[0])]
        target = mine.overall_level
        first, second = (
            light_of(d, target, op.strength, in_lab, c) for d, c in zip((mine, other), corners, strict=True)
        )
        return first, second

    # --- results ---

    def _parts(self, filling: Filling) -> tuple[dict[str, Any], ...]:
        op, changed = self._op, self._change(filling)
        sources = iter(self._sources)

        def make(one: Part, kind: str) -> dict[str, Any]:
            source, photo = next(sources), Image((one,), op.exemplar.source)
            part = in_layout_of(photo, source, kind == "color", self._resources) if self._other else source.first
            first = source is self._sources[0]
            filled = {"fill": self._filled_part(one, part, filling, changed if first else None)}
            return filled | ({"st": self._st(filling), "drift": self._drift(filling, changed)} if first else {})

        results = op.of_all([one.first for one in self._photos], make)
        if self._other:
            return results
        return tuple(
            result | {"fill": self._leveled(result["fill"], image, filling)} if kind == "height" else result
            for result, image, kind in zip(results, self._photos, op.map_kinds, strict=True)
        )

    def _filled_part(self, photo: Part, source: Part, filling: Filling, changed: np.ndarray | None) -> Part:
        """The photo with the shown pixels copied from the source, and moved into its light."""
        op, by_rows = self._op, not self._op.holds_photo(self._resources)
        spec = tile_spec(photo.spec, self._tiling)
        pixels: SomeRows = rows_of(op.in_any_order(source, False)) if by_rows else np.ascontiguousarray(source.pixels())
        lens = None if changed is None else lens_of(op.exemplar, self._resources, op.first_space)
        place = filling.window.shifted(*photo.window[:2])

        def fetch(window: Window) -> np.ndarray:
            rows, shared = photo.read(window), place & window
            here = shared.inside(place)
            shown = filling.shown[here]
            if shared.empty or not shown.any():
                return rows
            picked = filling.source[here][shown].gather(pixels)[None]
            if lens is not None and changed is not None:
                change = changed[here][shown]
                moved = (change != _UNCHANGED).any(1)  # the others are copied bit for bit
                if moved.any():
                    picked[:, moved] = _corrected(lens, picked[:, moved], change[moved])
            rows = rows.copy()
            rows[shared.inside(window)][shown] = picked[0]
            return rows

        return replace(photo, spec=spec, fetch=fetch, levels=(), thumbnail=None)

    def _change(self, filling: Filling) -> np.ndarray | None:
        """Gain and offsets from the source to the photo at each pixel of the window, (height, width, 4) float32."""
        if self._light is None and filling.step is None:
            return None
        change = np.zeros((*filling.shown.shape, 4), np.float32)
        change[..., 0] = 1
        if filling.step is not None:
            change[..., 1:] = filling.step
        if self._light is not None:
            mine, other = self._light
            there = mine.at(filling.window)[filling.shown]
            here = other.at_pixels(*filling.source[filling.shown].yx)
            here[:, 1:] += change[filling.shown][:, 1:] - there[:, 1:]
            change[filling.shown] = here / there[:, :1]
        return change

    def _st(self, filling: Filling) -> Part:
        """Source coordinates; with another photo, also 1 where they lie in it and 0 where they lie in the photo."""
        spec, origin = self._photos[0].first.spec, self._sources[0].first.spec
        whole, names = Window.data(spec), ("R", "G", "B") if self._other else ("R", "G")
        place = filling.window.shifted(*whole[:2])

        def fetch(window: Window) -> np.ndarray:
            rows, columns = window.inside(whole)
            own = SourceMap.of(np.arange(rows.start, rows.stop)[:, None], np.arange(columns.start, columns.stop))
            out = np.zeros((window.height, window.width, len(names)), np.float32)
            out[..., :2] = own.coordinates(spec)
            shared = place & window
            here, there = shared.inside(place), shared.inside(window)
            shown = filling.shown[here]
            out[there][shown, :2] = filling.source[here][shown].coordinates(origin)
            out[there][shown, 2:] = 1
            return out

        return Part("st", spec_beside(spec, names), fetch, ready=True)

    def _drift(self, filling: Filling, changed: np.ndarray | None) -> Part:
        """The correction of each pixel, as `drift.flattening.correction_part`."""
        spec = self._photos[0].first.spec
        place = filling.window.shifted(*Window.data(spec)[:2])
        names = tuple(f"{kind}.{channel}" for kind in ("gain", "offset") for channel in "Lab")

        def fetch(window: Window) -> np.ndarray:
            out = np.zeros((window.height, window.width, 6), np.float32)
            out[..., :3] = 1
            shared = place & window
            if changed is not None and not shared.empty:
                out[shared.inside(window)] = changed[shared.inside(place)][..., [0, 0, 0, 1, 2, 3]]
            return out

        return Part("drift", spec_beside(spec, names), fetch, ready=True)

    def _leveled(self, part: Part, image: Image, filling: Filling) -> Part:
        """A filled height map, with its steps logged, and leveled with relevel."""
        op, shape = self._op, self._marked.shape
        source = SourceMap.of(np.arange(shape[0])[:, None], np.arange(shape[1]))
        packed = np.array(source.packed)
        shown = np.zeros(shape, bool)
        at = filling.window.inside(Window(0, 0, *shape[::-1]))
        packed[at] = np.where(filling.shown, filling.source.packed, packed[at])
        shown[at] = filling.shown
        source_map = SourceMap(packed)
        return height_tile(op.flag(), part, image, source_map, self._wraps, op.relevel, ~shown, self._resources)


def _corrected(lens: Lens, pixels: np.ndarray, change: np.ndarray) -> np.ndarray:
    """Pixels, (1, n, channels), with gain and offsets (n, 4) applied to their color."""
    values, opaque = lens.values(pixels)
    values[..., :3] = values[..., :3] * change[:, :1] + change[:, 1:]
    corrected, colors = lens.replaced(pixels, values, opaque), list(lens.channels.color)
    if corrected.dtype.kind == "f":  # next to a dark pixel, a bright step must not make a value negative
        corrected[..., colors] = np.maximum(corrected[..., colors], np.minimum(pixels[..., colors], 0))
    return corrected


def _longer_side(zone: np.ndarray) -> int:
    window = surroundings(zone, 0)
    return max(window.size)
