# SPDX-License-Identifier: Apache-2.0
"""Figures 3 and 4 of MJH17, and a table, from the results of stationarization.py."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

import matplotlib
import numpy as np
from scipy import stats

from benchmarks.shared.stationarization_results import (
    BASELINE,
    DEFAULT,
    FLAT_TEXTURE,
    MEASURES,
    TEXTURE,
    best_seed,
    rows,
)

matplotlib.use("Agg")
from matplotlib import pyplot

_OURS, _THEIRS = "#1f77b4", "#ff7f0e"  # as in the paper: ours blue, toroidal PatchMatch orange
_COLORS = {BASELINE: _THEIRS, "histogram": _OURS, "moments": "#2ca02c", "steerable": "#9467bd", DEFAULT: "#7f7f7f"}
_NAMES = {BASELINE: "toroidal PatchMatch", DEFAULT: "our default"}
_COMPARED = (("histogram", "histogram"), (DEFAULT, "histogram"), *((m, m) for m in MEASURES[1:]))  # variant, measure
_CONFIDENCE = 0.95

Costs = dict[tuple[str, int, str, str], float]  # photo, seed, variant, measure


def plot(out: Path) -> None:
    """Write figure3.png, figure4.png and table.md next to the CSV files."""
    table = rows(out / "costs.csv")
    costs = {(r["photo"], int(r["seed"]), r["variant"], r["measure"]): float(r["cost"]) for r in table}
    _figure_3(costs, rows(out / "traces.csv"), out / "figure3.png")
    _figure_4(costs, out / "figure4.png")
    (out / "table.md").write_text(_table(costs, table))


def over_seeds(costs: Costs, variant: str, measure: str) -> dict[str, np.ndarray]:
    """A variant's costs by photo, in the order of seeds."""
    found = defaultdict(list)
    for photo, _, v, m in sorted(costs):
        if (v, m) == (variant, measure):
            found[photo].append(costs[photo, _, v, m])
    return {photo: np.array(values) for photo, values in found.items()}


def pairs(costs: Costs, of: str, what: str, theirs: str = "") -> list[tuple[str, int, float, float]]:
    """(photo, seed, a variant's, baseline's) by `what` (the baseline's by `theirs`), for seeds that both have."""
    theirs = theirs or what
    return [
        (photo, seed, cost, costs[photo, seed, BASELINE, theirs])
        for (photo, seed, variant, m), cost in sorted(costs.items())
        if (variant, m) == (of, what) and (photo, seed, BASELINE, theirs) in costs
    ]


def t_width(values: np.ndarray) -> float:
    """Width of the 0.95 confidence interval of the mean by the t-test; NaN for fewer than two values."""
    if len(values) < 2:
        return float("nan")
    low, high = stats.t.interval(_CONFIDENCE, len(values) - 1, values.mean(), max(stats.sem(values), 1e-12))
    return float(high - low)


def _figure_3(costs: Costs, traces: list[dict[str, str]], path: Path) -> None:
    """(a) Combined cost by iteration; (b) its distribution at the end, (c) stationarity's, (d) texture's."""
    figure, axes = pyplot.subplots(1, 4, figsize=(15, 4))
    for variant in (BASELINE, "histogram"):
        curves = defaultdict(list)
        for r in traces:
            if r["variant"] == variant:
                deviation = float(r["deviation"])
                combined = float(r["stationarity"]) / deviation + float(r["texture"]) / deviation**2
                curves[int(r["iteration"])].append(combined)
        # the number of iterations depends on a photo's shape: plot as far as most go
        most = max((len(v) for v in curves.values()), default=0)
        iterations = sorted(n for n, v in curves.items() if len(v) > most / 2)
        if not iterations:
            continue
        low, middle, high = np.array([np.percentile(curves[n], (5, 50, 95)) for n in iterations]).T
        color, name = _COLORS[variant], _NAMES.get(variant, "ours, histogram")
        axes[0].plot(iterations, middle, color=color, linewidth=2, label=name)
        axes[0].fill_between(iterations, low, high, color=color, alpha=0.2)
    axes[0].set(xlabel="iteration", title="a) combined cost, median and 90 % band")
    axes[0].legend(fontsize=8)

    def final(variant: str, cost: Callable[[str, int], float]) -> list[float]:
        return [cost(p, s) for p, s, v, m in costs if (v, m) == (variant, TEXTURE)]

    deviations = {r["photo"]: float(r["deviation"]) for r in traces}  # of the last iteration, at full size
    for axis, title, what in (
        (axes[1], "b) combined cost at the end", None),
        (axes[2], "c) stationarity cost, Lab", "histogram"),
        (axes[3], "d) texture cost, Lab²", TEXTURE),
    ):
        found = {}
        for variant in (BASELINE, "histogram", DEFAULT):

            def cost(photo: str, seed: int, v: str = variant, what: str | None = what) -> float:
                if what is not None:
                    return costs[photo, seed, v, what]
                s = deviations.get(photo, np.nan)
                return costs[photo, seed, v, "histogram"] / s + costs[photo, seed, v, TEXTURE] / s**2

            found[variant] = np.array([c for c in final(variant, cost) if np.isfinite(c)])
        if not all(len(v) for v in found.values()):
            continue
        edges = np.linspace(0, np.percentile(np.concatenate(list(found.values())), 99), 25)
        for variant, values in found.items():
            axis.hist(values, edges, orientation="horizontal", color=_COLORS[variant], alpha=0.6)
        axis.set(xlabel="tiles", title=title)
    _save(figure, path)


def _figure_4(costs: Costs, path: Path) -> None:
    """Distributions over photos of (a) the mean and (b) the variance over seeds of each measure's own cost."""
    measures = [m for m in MEASURES if over_seeds(costs, m, m)]
    figure, axes = pyplot.subplots(len(measures), 2, figsize=(10, 3 * len(measures)), squeeze=False)
    for row, measure in zip(axes, measures, strict=True):
        compared = (BASELINE, measure, *((DEFAULT,) if measure == "histogram" else ()))
        per_photo = {v: over_seeds(costs, v, measure) for v in compared}
        for axis, title, statistic in (
            (row[0], f"{measure}: mean cost over seeds", np.mean),
            (row[1], f"{measure}: variance over seeds", lambda v: np.var(v, ddof=1)),
        ):
            found = {
                v: np.array([statistic(c) for c in by.values() if statistic is np.mean or len(c) > 1])
                for v, by in per_photo.items()
            }
            if not all(len(v) for v in found.values()):  # a variance asks for two seeds
                axis.set_axis_off()
                continue
            edges = np.linspace(0, np.percentile(np.concatenate(list(found.values())), 95), 20)
            for variant, values in found.items():
                label = f"{_NAMES.get(variant, 'ours')} ({min(map(len, per_photo[variant].values()))} seeds or more)"
                axis.hist(np.clip(values, 0, edges[-1]), edges, color=_COLORS[variant], alpha=0.6, label=label)
                middle, half = values.mean(), 0.5 * t_width(values)
                top = axis.get_ylim()[1]
                axis.errorbar(middle, top, xerr=half, color=_COLORS[variant], marker="|", capsize=4)
            axis.set(title=title, ylabel="photos")
            axis.legend(fontsize=7)
    _save(figure, path)


def _save(figure: pyplot.Figure, path: Path) -> None:
    figure.tight_layout()
    figure.savefig(path, dpi=80, pil_kwargs={"optimize": True})
    pyplot.close(figure)


def _table(costs: Costs, table: list[dict[str, str]]) -> str:
    lines = [
        "| tiles, measure | runs | cost lower than toroidal PatchMatch's | cost, ratio (median) |"
        " texture cost, ratio (median) | with the baseline's best seed: lower on |",
        "|---|---|---|---|---|---|",
    ]
    lost = []
    for variant, measure in _COMPARED:
        own, texture = pairs(costs, variant, measure), pairs(costs, variant, TEXTURE)
        if not own:
            continue
        name = "default" if variant == DEFAULT else "paper=1"
        best = [p for p in own if p[1] == best_seed(table, p[0], measure)]
        lost += [f"{name}, {measure}: {p} (seed {s}, {c / b:.2f})" for p, s, c, b in own if c >= b]
        lines.append(
            f"| {name}, {measure} | {len(own)} | {np.mean([c < b for *_, c, b in own]):.1%} |"
            f" {_median(own):.2f} | {_median(texture):.2f} | {sum(c < b for *_, c, b in best)} of {len(best)} photos |"
        )
    flat = pairs(costs, DEFAULT, FLAT_TEXTURE, TEXTURE)
    lines += ["", "Not lower: " + ("; ".join(lost) or "none") + ".", ""]
    lines += [
        f"The default's texture cost of the flattened photo is {_median(flat):.2f} of PatchMatch's of the photo.",
        "",
    ]
    lines += [
        "| cost over seeds, mean over photos | seeds | mean | its 0.95 t-interval | variance | its 0.95 t-interval |"
    ]
    lines += ["|---|---|---|---|---|---|"]
    for measure in MEASURES:
        for variant in dict.fromkeys((BASELINE, *(v for v, m in _COMPARED if m == measure))):
            seen = [c for c in over_seeds(costs, variant, measure).values() if len(c) > 1]
            if not seen:
                continue
            # the variance is also a mean: of squared distances from the mean
            squares = [(c - c.mean()) ** 2 * len(c) / (len(c) - 1) for c in seen]
            figures = (
                np.mean([c.mean() for c in seen]), np.mean([t_width(c) for c in seen]),
                np.mean([s.mean() for s in squares]),
                np.mean([t_width(s) if len(s) > 2 else np.nan for s in squares]),  # two squares are always equal
            )  # fmt: skip
            counts = sorted({len(c) for c in seen})
            name = f"{measure}, {_NAMES.get(variant, 'paper=1')}"
            lines.append(
                f"| {name} | {'-'.join(map(str, dict.fromkeys((counts[0], counts[-1]))))} |"
                + "".join(f" {f:.3g} |" for f in figures)
            )
    return "\n".join(lines) + "\n"


def _median(found: list[tuple[str, int, float, float]]) -> float:
    """Of the ratios."""
    return float(np.median([ours / theirs for *_, ours, theirs in found]))
