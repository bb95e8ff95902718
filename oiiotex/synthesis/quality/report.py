# SPDX-License-Identifier: Apache-2.0
"""Measures of how stationary, faithful, seamless, sharp and new a texture is.

They are shown by -v, written by report= and limited by fail=, for every op that synthesizes.
"""

from __future__ import annotations

import functools
import logging
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any, cast

from ... import __version__
from ...analysis.stationarity.costs import stationarity_cost
from ...analysis.stationarity.row_bands import PIXELS, channel, row_bands
from ...engine.color.lab import working_values
from ...engine.core.demand import MadeRows, SomeRows, rows_of
from ...engine.core.op import Kind, Output
from ...engine.core.parameters import nearest
from ...engine.core.scratch import empty_rows
from ...engine.core.source_map import SourceMap
from ...engine.core.window import Domain
from ...engine.deferred import np
from ...engine.errors import ImageError, ParameterError, present
from ...engine.session.facts import Facts
from ...engine.session.progress import Progress
from ...engine.session.resources import Resources
from .limit import Limit
from .report_measures import REPORT_MEASURES
from .seam_measures import seam_ratio, sharpness, wrap_percentile
from .verdicts import report_lines

log = logging.getLogger("oiiotex")

SCHEMA = "oiiotex.report/1"
REPORT = Output("report", Kind.TABLE, "Measures of the result, for programs.", asked_by="report", judged_by="fail")
REPORT_HELP = "JSON file for the measures of the result (see docs/reference/report.md)."
FAIL_HELP = (
    "Conditions that count as failure, such as fidelity<0.8,seam>1.5. If one is true, the result is still written, but"
    " the exit code is 3."
)
_OF_COPIES = ("texture", "copied", "shown", "repeat", "broken")
_OF_LABELS = ("label_repeat", "label_shown", "label")
_OF_LOSSES = ("textured", "textured_photo", "regular", "regular_photo")
_OF_FILLS = ("border", "step", "sharp")
_OF_WAVES = ("waves", "uneven")
_OF_JUDGE = ("fidelity", "broken", *_OF_WAVES, "salient", "missing", "lines", "band_96", "band_48", "band_24", "shapes")
_BYTES = 200  # per pixel of a band
_SIDE_BYTES = 1024  # per pixel along a side
_HALO = 16  # maximum number of additional rows of a band
_USE_BYTES = 4  # per pixel of the photo, whose uses are counted
_HELD_SHARE = 1 / 8  # of the budget, for each of photo and result; larger ones are in a file
_GATHERED = 512  # bytes of the budget for a pixel that is gathered from a file
_LEAST = 16  # px; minimum side of a photo and a result


@dataclass(frozen=True)
class Look:
    """A result to measure.

    Attributes
    ----------
    name : str
    lab : (height, width, 3) float32
    source : SourceMap or None
        Sources in the exemplar, if the pixels are copies.
    exemplar : (height, width, 3) float32, optional
        The image that the result is made from, if it is the flattened photo and not the photo itself.
    labels : (ids, ids) or None
        Label ids of the photo, and those that were painted.
    """

    name: str
    lab: SomeRows
    source: SourceMap | None = None
    exemplar: SomeRows | None = None
    labels: tuple[np.ndarray, SomeRows] | None = None


@dataclass(frozen=True, kw_only=True)
class Quality:
    """The measures of an op's results and their limits. Created before the work.

    Attributes
    ----------
    op : Op
        An op with the parameters `report` and `fail`.
    wrap : (bool, bool)
        The results tile along x, along y.
    sizes : ((int, int), (int, int))
        Width and height of the photo and of the largest result, px.
    copies : bool
        The source of every pixel in the photo is known.
    losses : bool
        The lost share of the photo's texture is known.
    painted : bool
        The painted labels are known.
    judged : bool
        The result is to look like the photo. A painting or a composition is not.
    sigma : float or None
        Scale of the stationarity cost, px. None: longer side / 32.
    contrast : float or None
        Weight of the global histogram matching, 0 to 1. None: there was none.
    measure, order, patch
        As in --texstationarize.
    cycles : (float, float)
        Periods per pixel along x and y of the lattice that is kept. 0: none.
    lattice : tuple of (float, float)
        Its shortest vectors in the results, x and y px: none, one or two.
    own : tuple of str
        Names of the measures, if the op takes them itself (`add_own`), with `need` bytes of memory.
    """

    op: Any  # with parameters that not every Op has
    facts: Facts
    resources: Resources | None = None  # None: before the work
    progress: Progress | None = None
    wrap: tuple[bool, bool] = (False, False)
    sizes: tuple[tuple[int, int], tuple[int, int]] = ((1, 1), (1, 1))
    copies: bool = True
    losses: bool = False
    painted: bool = False
    judged: bool = True
    sigma: float | None = None
    contrast: float | None = None
    measure: str = "histogram"
    order: int = 2
    patch: int = 11
    cycles: tuple[float, float] = (0.0, 0.0)
    lattice: tuple[tuple[float, float], ...] = ()
    own: tuple[str, ...] = ()
    need: int = 0
    limits: tuple[Limit, ...] = field(init=False)

    @classmethod
    def of_copies(
        cls,
        op: Any,
        facts: Facts,
        size: tuple[int, int],
        tile: str | None = None,
        **more: Any,
    ) -> Quality:
        """For results whose pixels are copies from the op's exemplar.

        Parameters
        ----------
        op : Op
            An op with the parameters `exemplar`, `report` and `fail`.
        size : (int, int)
            Width and height of a result, px.
        tile : str, optional
            Axes along which results tile: xy, x, y or none. Default: those of the op.
        """
        spec, tile = op.exemplar.first.spec, tile or op.tiles
        sizes = (spec.width, spec.height), (size[0], size[1])
        return cls(op=op, facts=facts, wrap=("x" in tile, "y" in tile), sizes=sizes, **more)

    def __post_init__(self) -> None:
        object.__setattr__(self, "limits", tuple(map(self._limit, self.op.fail or ())))
        if self.op.report or self.limits:
            self.facts.require(self._memory(), "measuring the result", "omit report and fail")

    def during(self, resources: Resources, progress: Progress) -> Quality:
        """The same for the work."""
        return replace(self, resources=resources, progress=progress)

    def add_to(
        self, results: dict[str, Any], seen: Callable[[], tuple[SomeRows, Iterable[Look]]], **more: float
    ) -> dict[str, Any]:
        """The op's results with its report, computed on demand. With -v it is logged now.

        Parameters
        ----------
        results : dict
        seen : callable
            Returns the photo, (height, width, 3) float32 Lab, and the results to measure.
        more : float
            Measures that the op has computed itself.
        """

        def entries() -> Iterator[dict[str, Any]]:
            photo, looks = seen()
            for look in looks:
                yield self._entry(look.name, look.lab.shape, self._measures(photo, look, more))

        return self._added(results, entries)

    def add_own(self, results: dict[str, Any], measures: Callable[[], dict[str, float] | None]) -> dict[str, Any]:
        """The same with measures that the op takes itself. None: there is nothing to measure."""
        name = self.op.main().name
        main = results[name]

        def entries() -> Iterator[dict[str, Any]]:
            found = measures()
            if found is not None:
                yield self._entry(name, main.window.size[::-1], found)

        return self._added(results, entries)

    def _added(self, results: dict[str, Any], entries: Callable[[], Iterable[dict[str, Any]]]) -> dict[str, Any]:
        """The results with a report of these entries."""

        @functools.cache
        def report() -> dict[str, Any]:
            with present(self.resources).stats.time("measure"):
                return self._document(list(entries()))

        if present(self.progress).measure:
            need = self._memory()
            if need > self.facts.budget:
                log.info("%s: not measured: requires %d MB of memory", self.op.flag(), -(-need >> 20))
            else:
                for result in report()["results"]:
                    for line in report_lines(result, self.measure, self.order, self.sigma):
                        log.info("%s: %s", self.op.flag(), line)
        return results | {"report": report}

    def add_to_copies(
        self, results: dict[str, Any], labels: Callable[[], Any] = lambda: None, copied: Any = None
    ) -> dict[str, Any]:
        """The same for an op with one exemplar, and its sources in part 'st'. `labels`: see `Look.labels`.

        `copied`: the image that pixels are copied from, if it is not the exemplar itself.
        """
        exemplar, main = self.op.exemplar, results[self.op.main().name]

        def seen() -> tuple[SomeRows, list[Look]]:
            in_memory = self._fits(12 * self.sizes[0][0] * self.sizes[0][1])
            photo, source_lab = (
                working_values(image, present(self.resources), self.op.working_space, in_memory)[0]
                for image in (exemplar, copied or exemplar)
            )
            spec, st = exemplar.first.spec, rows_of(results["st"])

            def places(first: int, last: int) -> SourceMap:
                return SourceMap.of_coordinates(st[first:last], spec, "st")

            like = places(0, 1)
            packed = MadeRows(st.shape[:2], like.packed.dtype, lambda first, last: places(first, last).packed)
            source = SourceMap(cast("np.ndarray", self.kept(packed)), like.bits)
            return photo, [self.look_of_copies(main.name, source_lab, source, labels())]

        return self.add_to(results, seen)

    def look_of_copies(self, name: str, exemplar: SomeRows, source: SourceMap, labels: Any = None) -> Look:
        """A result that consists of those pixels of the exemplar."""
        shape = *source.packed.shape, *exemplar.shape[2:]
        lab = MadeRows(shape, exemplar.dtype, lambda first, last: source[first:last].gather(exemplar))
        at_once = PIXELS if isinstance(exemplar, np.ndarray) else max(PIXELS, self.facts.budget // _GATHERED)
        return Look(name, self.kept(lab, at_once), source, exemplar, labels)

    def kept(self, rows: MadeRows, at_once: int = PIXELS) -> SomeRows:
        """Rows computed once, `at_once` pixels at a time, and kept: in memory, or in a file if they are large."""
        fits = self._fits(math.prod(rows.shape) * rows.dtype.itemsize)
        store = empty_rows(rows.shape, rows.dtype, fits)
        for band in row_bands(rows, at_once):
            store[band] = rows[band]
        return store

    def _fits(self, size: int) -> bool:
        return size <= self.facts.budget * _HELD_SHARE

    @property
    def is_asked_for(self) -> bool:
        """Whether -v, report or fail request it."""
        fits = present(self.progress).measure and self._memory() <= self.facts.budget  # for -v alone
        return bool(fits or self.op.report or self.limits)

    def _memory(self) -> int:
        """Memory in bytes, without data that is in files if it is large."""
        if self.own:
            return self.need
        from .lost_structure import regularity_bytes  # not needed for help
        from .patch_texture import texture_bytes

        (width, height), result = self.sizes
        bands = (min(w * h, max(PIXELS, w) + _HALO * w) for w, h in self.sizes)
        need = _BYTES * max(bands) + _SIDE_BYTES * max(w + h for w, h in self.sizes)
        if self.losses:  # possibly regularity
            need = max(need, regularity_bytes(*self.sizes))
        if self.copies:
            need += _USE_BYTES * width * height + texture_bytes(result, (width, height), self.patch)
        return need

    def _limit(self, text: str) -> Limit:
        limit = Limit.read(text, "fail")
        name = limit.measure
        if name not in REPORT_MEASURES:
            raise ParameterError(
                f"unknown measure '{name}'{nearest(name, REPORT_MEASURES)}",
                parameter="fail",
                value=text,
                expected=f"one of {', '.join(REPORT_MEASURES)}",
            )
        axes = [axis for axis, wraps in zip("xy", self.wrap, strict=True) if wraps]
        absent = not self.copies and name in _OF_COPIES
        absent |= not self.losses and name in _OF_LOSSES
        absent |= not self.painted and name in _OF_LABELS
        absent |= name in ("seam", "salient") and not axes
        absent |= name in _OF_WAVES and len(axes) < 2
        absent |= not self.judged and name in _OF_JUDGE
        absent |= name.startswith(("seam_", "quieter_")) and name.split("_")[1] not in axes
        absent |= name in _OF_FILLS
        if self.own:
            absent = name not in self.own
        if absent:
            raise ParameterError(f"{name} is not measured for this result", parameter="fail", value=text)
        return limit

    # --- measures ---

    def _measures(self, photo: SomeRows, look: Look, known: dict[str, float]) -> dict[str, float]:
        """The `REPORT_MEASURES` of a result, by name; the fidelity only if it is not `known`."""
        from .fidelity import fidelity  # not needed for help

        height, width = look.lab.shape[:2]
        if min(height, width, *photo.shape[:2]) < _LEAST:
            problem = f"{look.name} is {width}x{height} px, too small to be measured"
            raise ImageError(problem, expected=f"at least {_LEAST} px a side")
        sigma = self.sigma or max(height, width) / 32
        cost = functools.partial(stationarity_cost, sigma=sigma, measure=self.measure, order=self.order)
        measures = {
            "cost_photo": cost(photo, domain=Domain(photo.shape[1], photo.shape[0])),
            "cost": cost(look.lab, domain=Domain(width, height, *self.wrap), like=photo),
        }
        light, before = channel(look.lab, 0), channel(photo, 0)
        present(self.progress).advance(1, 3)  # a chance to cancel
        for axis, letter, wraps, cycles in zip((1, 0), "xy", self.wrap, self.cycles, strict=True):
            if wraps:
                measures[f"seam_{letter}_photo"] = seam_ratio(before, axis, cycles)
                measures[f"seam_{letter}"] = seam_ratio(light, axis, cycles)
                measures[f"quieter_{letter}"] = wrap_percentile(light, axis)
        if any(self.wrap):
            measures["seam"] = max(measures[name] for name in ("seam_x", "seam_y") if name in measures)
        exemplar = photo if look.exemplar is None else look.exemplar
        measures["loss"] = 1.0 - sharpness(light) / max(sharpness(channel(exemplar, 0)), 1e-12)
        if self.judged and "fidelity" not in known:
            kept = fidelity(exemplar, None, look.lab, self.wrap[::-1], look.source, photo)
            measures |= {} if kept is None else kept.measures()
        if look.source is not None:
            present(self.progress).advance(2, 3)
            measures |= self._of_copies(exemplar, look)
        return measures | known

    def _of_copies(self, photo: SomeRows, look: Look) -> dict[str, float]:
        from .copy_detection import copies_by_source, label_copies  # not needed for help
        from .patch_texture import texture_of

        source = present(look.source)
        texture = texture_of(
            present(self.resources), present(self.progress), look.lab, source, photo, self.patch, self.wrap
        )
        measures = {} if texture is None else {"texture": texture}
        copies = copies_by_source(source, (photo.shape[0], photo.shape[1]))
        measures["copied"] = copies.exact
        if copies.shown is not None:
            measures |= {"shown": copies.shown, "repeat": present(copies.over_fair)}
            if look.labels is not None:
                measures |= dict(zip(_OF_LABELS, label_copies(source, *look.labels), strict=True))
        return measures

    # --- output ---

    def _entry(self, name: str, shape: tuple[int, ...], measures: dict[str, float]) -> dict[str, Any]:
        height, width = shape[:2]
        entry = {"name": name, "width": width, "height": height, "measures": measures}
        return entry | ({"lattice": self.lattice} if self.lattice else {})

    def _document(self, results: list[dict[str, Any]]) -> dict[str, Any]:
        """The contents of report=. `failed`: exceeded limits, as text."""
        limits, failed = [], []
        for result in results:
            for limit in self.limits:
                value = result["measures"].get(limit.measure)
                passed = value is not None and not limit.passed_by(value)
                limits.append({"result": result["name"], "limit": str(limit), "value": value, "passed": passed})
                if not passed:
                    shown = "not measured" if value is None else f"{value:.4g}"
                    failed.append(f"{result['name']}: {limit.measure} is {shown}: fail={limit}")
        header: dict[str, Any] = {"schema": SCHEMA, "version": __version__, "filter": self.op.name}
        header["parameters"] = self.op.provenance()["oiiotex:parameters"]
        if not self.own:
            header |= {"measure": self.measure, "sigma": self.sigma, "histogram": self.contrast}
        return {**header, "results": results, "limits": limits, "passed": not failed, "failed": failed}
