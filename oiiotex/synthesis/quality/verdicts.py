# SPDX-License-Identifier: Apache-2.0
"""Measures of a result as text: sentences with a grade (good, fair or poor), then figures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from ...analysis.stationarity.measures import cost_text
from .fidelity import FAIR, GOOD, Fidelity

GRADES = "good", "fair", "poor"
# a measure, the last values that are good and fair (increasing: larger is worse), and a sentence for each grade
_VERDICTS: tuple[tuple[str, float, float, tuple[str, str, str]], ...] = (
    ("seam", 1.2, 1.5, (
        "No seam is visible.",
        "A seam may be visible on plain areas.",
        "A seam is visible.",
    )),
    ("border", 1.3, 1.8, (
        "The border of the fill is not visible.",
        "The border of the fill may be visible.",
        "The border of the fill is visible.",
    )),
    ("step", 1.6, 2.5, (
        "The fill is as light as its surroundings.",
        "The fill differs slightly in light or color from its surroundings.",
        "The fill differs in light or color from its surroundings.",
    )),
    ("sharp", 0.8, 0.5, (
        "The fill is as sharp as its surroundings.",
        "The fill is softer than its surroundings.",
        "The fill is blurred.",
    )),
    ("loss", 0.1, 0.3, (
        "The tile is as sharp as the photo.",
        "The tile is softer than the photo.",
        "The tile is blurred.",
    )),
    ("kept", 0.8, 0.5, (
        "The regular structure is kept.",
        "The regular structure is partly lost.",
        "The regular structure is lost.",
    )),
)  # fmt: skip


def verdicts(measures: Mapping[str, float]) -> Iterator[str]:
    """`GRADE: SENTENCE` for each measure of a report that has a verdict; the judge's comes first."""
    values = dict(measures)
    if "fidelity" in values:
        grade = sum(values["fidelity"] < limit for limit in (GOOD, FAIR))
        said = Fidelity.of_measures(values).beyond or ("the result looks like the photo, and repeats without notice",)
        yield f"{GRADES[grade]}: {', '.join(said).capitalize()}."
    if values.get("regular_photo", 0.0) > 0:
        values["kept"] = values["regular"] / values["regular_photo"]
    for name, good, fair, sentences in _VERDICTS:
        if name in values:
            sign = 1.0 if good < fair else -1.0
            grade = sum(not sign * values[name] <= sign * limit for limit in (good, fair))
            yield f"{GRADES[grade]}: {sentences[grade]}"


def report_lines(result: Mapping[str, Any], measure: str, order: int, sigma: float | None) -> Iterator[str]:
    """The verdicts and figures of an entry of a report. `measure`, `order`, `sigma`: see `report.Quality`."""
    m, side = result["measures"], max(result["width"], result["height"])
    yield from verdicts(m)
    if "fidelity" in m:
        yield str(Fidelity.of_measures(m))
    if "border" in m:
        yield f"jumps across the border {m['border']:.2f} times those around it, levels {m['step']:.2f} times"
        yield f"sharpness {100 * m['sharp']:.0f} % of the surroundings' (mean |L - blurred L|)"
    if "cost" in m:
        cost = cost_text(m["cost"], measure, order, m["cost_photo"])
        yield f"{cost} at sigma {sigma or side / 32:g} px"
    if "texture" in m:
        text = "(MJH17 eq. 5, upper bound)"
        yield f"texture cost {m['texture']:.2f} Lab^2 per pixel {text}"
    for axis in "xy":
        if f"seam_{axis}" in m:
            change = f"{m[f'seam_{axis}_photo']:.2f} -> {m[f'seam_{axis}']:.2f} (1 is invisible)"
            yield f"seam ratio {axis} {change}; {m[f'quieter_{axis}']:.0f} % of the lines inside are smoother"
    if "loss" in m:
        yield f"sharpness loss {100 * m['loss']:.1f} % (mean |L - blurred L|; negative: sharper than the photo)"
    if "regular" in m:
        change = f"{m['regular_photo']:.2f} -> {m['regular']:.2f}"
        yield f"regularity {change} (autocorrelation above its floor, minimum of three vectors)"
    if "copied" in m:
        copied = f"{100 * m['copied']:.0f} % of the pixels lie in verbatim copies of 8x8 px"
        if "shown" in m:
            shown = _shown(m["shown"], m["repeat"])
            copied += f"; the most repeated region of 32x32 {shown}"
        yield copied
    elif "shown" in m:
        yield f"the most repeated region of 32x32 {_shown(m['shown'], m['repeat'])}"
    if "label" in m:
        shown = _shown(m["label_shown"], m["label_repeat"])
        yield f"the most repeated region of a painted label, {m['label']:.0f}, {shown}"


def _shown(times: float, repeat: float) -> str:
    """How often a region is shown; the average, if it is more than once."""
    return f"is shown {times:.1f} times" + (
        f"; the average region {times / repeat:.1f} times" if repeat < times else ""
    )
