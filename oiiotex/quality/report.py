# SPDX-License-Identifier: Apache-2.0
"""How stationary, faithful, seamless, sharp and new a texture is, by numbers alone.

What -v says, report= writes and fail= judges, of every op that synthesizes.
"""

from __future__ import annotations

import functools
import logging
import operator
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple, cast

from .. import __version__
from ..color.lab import working_values
from ..core.op import Kind, Output
from ..core.parameters import nearest
from ..core.source_map import SourceMap
from ..core.window import Domain
from ..deferred import np
from ..errors import ImageError, ParameterError, present
from ..patchmatch.matcher import match_patches
from ..patchmatch.recipe import Recipe
from ..patchmatch.use_prices import Lost
from ..regularity.regularity import peaks_over_floor
from ..session.progress import Progress
from ..session.resources import Resources
from ..stationarity.costs import stationarity_cost, texture_cost
from ..stationarity.measures import cost_text
from .report_measures import REPORT_MEASURES
from .seam_measures import seam_ratio, sharpness, wrap_percentile

if TYPE_CHECKING:
    from ..regularity.offset_prices import InStep

log = logging.getLogger("oiiotex")

SCHEMA = "oiiotex.report/1"
REPORT = Output("report", Kind.TABLE, "measures of the result, for machines", asked_by="report", judged_by="fail")
REPORT_HELP = "measures of the result go to this file, JSON (docs/report.md)"
FAIL_HELP = "limits of measures, NAME>NUMBER or NAME<NUMBER, such as seam>1.3 and repeat>4: beyond one the run exits 3"
_OF_COPIES = ("texture", "copied", "shown", "repeat")
_OF_LABELS = ("label_repeat", "label_shown", "label")
_OF_LOSSES = ("textured", "textured_photo", "regular", "regular_photo")
_LIMIT = re.compile(r"([a-z_]+)([<>])([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)", re.ASCII)
_BEYOND = {">": operator.gt, "<": operator.lt}
_BYTES = 200  # of a pixel of photo or result, held while they are measured
_MUCH = 0.08  # of a tile: texture that is lost
_TOO_MUCH = 0.1  # of a tile of a photo that is flat for the most part
_LEAST = 16  # px; a photo or a result that is smaller has nothing to be measured


def regularity_of(photo: np.ndarray, source: SourceMap, recipe: Recipe) -> dict[str, float]:
    """How regular a photo, (height, width, 3) Lab, and its tile are, by the lattice that the recipe keeps."""
    kept = cast("InStep", recipe.in_step)
    own = kept.lattice
    lattice, torus = replace(own, frequencies=kept.wanted), recipe.wrap_x and recipe.wrap_y
    tile = source.gather(photo)
    return {
        "regular_photo": float(min(peaks_over_floor(photo, own, False))),
        "regular": float(min(peaks_over_floor(tile, lattice, torus))),
    }


def say_what_was_lost(flag: str, lost: Lost) -> None:
    """Log how much of a photo's texture its tile lacks, and warn where that is much.

    Parameters
    ----------
    flag : str
        Of the op.
    lost : Lost

    Raises
    ------
    ImageError
        Most of it is gone where some of the photo is flat, or much where most is.
    """
    shares = f"{100 * lost.own:.0f} % of the photo is texture, {100 * lost.shown:.0f} % of the tile"
    log.info("%s: %s; the rest is flat (an eighth as active as texture, or less)", flag, shares)
    if lost.share <= _MUCH:
        return
    if lost.own >= 1 - _MUCH:  # no flat part is to blame
        log.warning("%s: texture is lost: %s: more iterations= keep more", flag, shares)
        return
    offer = "leave flat parts out by mask=1 with the mask that --texdominant makes"
    if lost.shown < 0.5 * lost.own or (lost.own < 0.5 and lost.share > _TOO_MUCH):
        raise ImageError(f"too much of the texture is lost: {shares}: {offer}")
    log.warning("%s: texture is lost: %s: %s", flag, shares, offer)


class Limit(NamedTuple):
    """A measure, and beyond what it fails."""

    measure: str
    relation: str
    limit: float

    def __str__(self) -> str:
        return f"{self.measure}{self.relation}{self.limit:g}"


@dataclass(frozen=True)
class Look:
    """A result as it is measured.

    Attributes
    ----------
    name : str
    lab : (height, width, 3) float32
    source : SourceMap or None
        Of the exemplar, where its pixels are copies.
    exemplar : (height, width, 3) float32, optional
        What the result is made from, where that is not the photo itself but the photo without its drift.
    labels : (ids, ids) or None
        Of the photo, and those that were painted.
    """

    name: str
    lab: np.ndarray
    source: SourceMap | None = None
    exemplar: np.ndarray | None = None
    labels: tuple[np.ndarray, np.ndarray] | None = None

    @classmethod
    def of_copies(cls, name: str, exemplar: np.ndarray, source: SourceMap, labels: Any = None) -> Look:
        """A result that is made of those pixels of the exemplar."""
        return cls(name, source.gather(exemplar), source, exemplar, labels)


@dataclass(frozen=True, kw_only=True)
class Quality:
    """What is measured of an op's results, and held to which limits; made before the work.

    Attributes
    ----------
    op : Op
        With the parameters `report` and `fail`.
    wrap : (bool, bool)
        The results tile along x, along y.
    size : (int, int)
        Pixels of the photo, and of the largest result.
    copies : bool
        It is known of which place of the photo every pixel is a copy.
    losses : bool
        It is known how much of the photo's texture is lost.
    painted : bool
        It is known which labels were painted.
    sigma : float or None
        Scale of the stationarity cost, px; longer side / 32 where it is None.
    contrast : float or None
        How strongly the overall histogram was held, 0 to 1; None: it was not looked at.
    measure, order, patch
        As of --texstationarize.
    cycles : (float, float)
        Periods per pixel along x and y of the lattice that is kept; 0 where there is none.
    lattice : tuple of (float, float)
        Its shortest steps as the results have them, x and y px: none, one or two.
    """

    op: Any  # with parameters that not every Op has
    resources: Resources
    progress: Progress
    wrap: tuple[bool, bool] = (False, False)
    size: tuple[int, int] = (0, 0)
    copies: bool = True
    losses: bool = False
    painted: bool = False
    sigma: float | None = None
    contrast: float | None = None
    measure: str = "histogram"
    order: int = 2
    patch: int = 11
    cycles: tuple[float, float] = (0.0, 0.0)
    lattice: tuple[tuple[float, float], ...] = ()
    limits: tuple[Limit, ...] = field(init=False)

    @classmethod
    def of_copies(
        cls,
        op: Any,
        resources: Resources,
        progress: Progress,
        size: tuple[int, int],
        tile: str | None = None,
        **more: Any,
    ) -> Quality:
        """Of results whose pixels are copied from the op's exemplar.

        Parameters
        ----------
        op : Op
            With the parameters `exemplar`, `report` and `fail`.
        size : (int, int)
            Width and height of a result, px.
        tile : str, optional
            Along which axes results tile: xy, x, y or none; as the op says when left out.
        """
        spec, tile = op.exemplar.first.spec, tile or op.tile
        sizes = spec.width * spec.height, size[0] * size[1]
        return cls(op=op, resources=resources, progress=progress, wrap=("x" in tile, "y" in tile), size=sizes, **more)

    def __post_init__(self) -> None:
        object.__setattr__(self, "limits", tuple(map(self._limit, self.op.fail or ())))
        if self.op.report or self.limits:
            self.resources.require(self._memory(), "measuring the result", "leave out report and fail")

    def add_to(
        self, results: dict[str, Any], seen: Callable[[], tuple[np.ndarray, Iterable[Look]]], **more: float
    ) -> dict[str, Any]:
        """The op's results with its report, made where it is asked for; -v logs it now.

        Parameters
        ----------
        results : dict
        seen : callable
            Gives the photo, (height, width, 3) float32 Lab, and the results as they are measured.
        more : float
            Measures that the op has taken.
        """

        @functools.cache
        def report() -> dict[str, Any]:
            with self.resources.stats.time("measure"):
                photo, looks = seen()
                return self._document([(look, self._measures(photo, look) | more) for look in looks])

        if self.progress.measure:
            need = self._memory()
            if need > self.resources.budget:
                log.info("%s: not measured: that would need %d MB of memory", self.op.flag(), -(-need >> 20))
            else:
                for line in self._lines(report()):
                    log.info("%s: %s", self.op.flag(), line)
        return results | {"report": report}

    def add_to_copies(self, results: dict[str, Any], labels: Callable[[], Any] = lambda: None) -> dict[str, Any]:
        """The same of an op with one exemplar, whose part 'st' says where its pixels come from; `Look.labels`."""
        exemplar, main = self.op.exemplar, results[self.op.main().name]

        def seen() -> tuple[np.ndarray, list[Look]]:
            photo = np.asarray(working_values(exemplar, self.resources, self.op.working_space)[0])
            source = SourceMap.of_coordinates(results["st"].pixels(), exemplar.first.spec, "st")
            return photo, [Look.of_copies(main.name, photo, source, labels())]

        return self.add_to(results, seen)

    @property
    def is_asked_for(self) -> bool:
        """By -v, report or fail."""
        fits = self.progress.measure and self._memory() <= self.resources.budget  # else the others have been refused
        return bool(fits or self.op.report or self.limits)

    def _memory(self) -> int:
        return _BYTES * sum(self.size)

    def _limit(self, text: str) -> Limit:
        match = _LIMIT.fullmatch(text)
        if not match:
            raise ParameterError(f"fail={text}: allowed is NAME>NUMBER or NAME<NUMBER, such as seam>1.3")
        name, relation, number = match.groups()
        if name not in REPORT_MEASURES:
            names = ", ".join(REPORT_MEASURES)
            raise ParameterError(f"fail={text}: no measure '{name}'{nearest(name, REPORT_MEASURES)}; there is {names}")
        axes = [axis for axis, wraps in zip("xy", self.wrap, strict=True) if wraps]
        absent = not self.copies and name in _OF_COPIES
        absent |= not self.losses and name in _OF_LOSSES
        absent |= not self.painted and name in _OF_LABELS
        absent |= name == "seam" and not axes
        absent |= name.startswith(("seam_", "quieter_")) and name.split("_")[1] not in axes
        if absent:
            raise ParameterError(f"fail={text}: {name} is not measured of this result")
        return Limit(name, relation, float(number))

    # --- measures ---

    def _measures(self, photo: np.ndarray, look: Look) -> dict[str, float]:
        """By name, those of `REPORT_MEASURES` that this result has."""
        height, width = look.lab.shape[:2]
        if min(height, width, *photo.shape[:2]) < _LEAST:
            raise ImageError(
                f"{look.name} is {width}x{height}, too small to be measured: {_LEAST} px a side are the least"
            )
        sigma = self.sigma or max(height, width) / 32
        cost = functools.partial(stationarity_cost, sigma=sigma, measure=self.measure, order=self.order)
        measures = {
            "cost_photo": cost(photo, domain=Domain(photo.shape[1], photo.shape[0])),
            "cost": cost(look.lab, domain=Domain(width, height, *self.wrap), like=photo),
        }
        light, before = look.lab[..., 0], photo[..., 0]
        self.progress.advance(1, 1)  # who does not want to know any more is let go
        for axis, letter, wraps, cycles in zip((1, 0), "xy", self.wrap, self.cycles, strict=True):
            if wraps:
                measures[f"seam_{letter}_photo"] = seam_ratio(before, axis, cycles)
                measures[f"seam_{letter}"] = seam_ratio(light, axis, cycles)
                measures[f"quieter_{letter}"] = wrap_percentile(light, axis)
        if any(self.wrap):
            measures["seam"] = max(measures[name] for name in ("seam_x", "seam_y") if name in measures)
        from .fidelity import fidelity  # help needs none of it

        exemplar = photo if look.exemplar is None else look.exemplar
        measures["loss"] = 1.0 - sharpness(light) / max(sharpness(exemplar[..., 0]), 1e-12)
        kept = fidelity(exemplar, None, look.lab, self.wrap[::-1])
        measures |= {} if kept is None else kept.measures()
        if look.source is not None:
            self.progress.advance(1, 1)
            measures |= self._of_copies(exemplar, look)
        return measures

    def _of_copies(self, photo: np.ndarray, look: Look) -> dict[str, float]:
        from .copy_detection import copies_by_source, label_copies  # scipy is loaded where it is needed

        source = present(look.source)
        y, x = source.yx
        rows, columns = (
            n if wraps else n - self.patch + 1 for n, wraps in zip(y.shape, reversed(self.wrap), strict=True)
        )
        measures = {}
        if min(rows, columns, *(n - self.patch + 1 for n in (*y.shape, *photo.shape[:2]))) > 0:
            last = (n - self.patch for n in photo.shape[:2])
            start = SourceMap.of(
                *(np.minimum(at[:rows, :columns], most) for at, most in zip((y, x), last, strict=True))
            )
            domain = Domain(y.shape[1], y.shape[0], *self.wrap)
            matches = match_patches(
                self.resources.device, look.lab, photo, start, self.patch, domain, 0, self.resources.budget
            )
            measures["texture"] = texture_cost(look.lab, photo, matches, self.patch)
        copies = copies_by_source(source, photo.shape[:2])
        measures["copied"] = copies.exact
        if copies.shown is not None:
            measures |= {"shown": copies.shown, "repeat": present(copies.over_fair)}
            if look.labels is not None:
                measures |= dict(zip(_OF_LABELS, label_copies(source, *look.labels), strict=True))
        return measures

    # --- what is said of them ---

    def _document(self, measured: list[tuple[Look, dict[str, float]]]) -> dict[str, Any]:
        """What report= writes; `failed` says in words which limits are passed."""
        results = [
            {"name": look.name, "width": look.lab.shape[1], "height": look.lab.shape[0], "measures": measures}
            | ({"lattice": self.lattice} if self.lattice else {})
            for look, measures in measured
        ]
        limits, failed = [], []
        for result in results:
            for limit in self.limits:
                value = result["measures"].get(limit.measure)
                passed = value is not None and not _BEYOND[limit.relation](value, limit.limit)
                limits.append({"result": result["name"], "limit": str(limit), "value": value, "passed": passed})
                if not passed:
                    shown = "not measured" if value is None else f"{value:.4g}"
                    failed.append(f"{result['name']}: {limit.measure} is {shown}: fail={limit}")
        header: dict[str, Any] = {"schema": SCHEMA, "version": __version__, "filter": self.op.name}
        header["parameters"] = self.op.provenance()["oiiotex:parameters"]
        header |= {"measure": self.measure, "sigma": self.sigma, "contrast": self.contrast}
        return {**header, "results": results, "limits": limits, "passed": not failed, "failed": failed}

    def _lines(self, report: dict[str, Any]) -> Iterator[str]:
        """The measures for people."""
        for result in report["results"]:
            m, side = result["measures"], max(result["width"], result["height"])
            if "fidelity" in m:
                from .fidelity import Fidelity

                yield str(Fidelity.of_measures(m))
            cost = cost_text(m["cost"], self.measure, self.order, m["cost_photo"])
            yield f"{cost} at sigma {self.sigma or side / 32:g} px"
            if "texture" in m:
                text = "(MJH17 eq. 5, upper bound by PatchMatch)"
                yield f"texture cost {m['texture']:.2f} Lab^2 per pixel {text}"
            for axis in "xy":
                if f"seam_{axis}" in m:
                    change = f"{m[f'seam_{axis}_photo']:.2f} -> {m[f'seam_{axis}']:.2f} (1 is invisible)"
                    yield f"seam ratio {axis} {change}; {m[f'quieter_{axis}']:.0f} % of the lines inside are quieter"
            yield f"sharpness loss {100 * m['loss']:.1f} % (mean |L - blurred L|, negative: sharper than the photo)"
            if "regular" in m:
                change = f"{m['regular_photo']:.2f} -> {m['regular']:.2f}"
                yield f"regularity {change} (autocorrelation over its floor, the least of three steps of the lattice)"
            if "copied" in m:
                copied = f"{100 * m['copied']:.0f} % of the pixels lie in verbatim copies of 8x8 px"
                if "shown" in m:
                    shown = f"is shown {m['shown']:.1f} times, {m['repeat']:.1f} times its share"
                    copied += f"; the most repeated region of 32x32 {shown}"
                yield copied
            if "label" in m:
                shown = f"is shown {m['label_shown']:.1f} times, {m['label_repeat']:.1f} times its share of the label"
                yield f"the most repeated region of a painted label, {m['label']:.0f}, {shown}"
