# SPDX-License-Identifier: Apache-2.0
"""Measures of a tile as sentences, each with a grade: good, fair or poor."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

GRADES = "good", "fair", "poor"
# a measure, the last values that are good and fair (increasing: larger is worse), and a sentence for each grade
_VERDICTS: tuple[tuple[str, float, float, tuple[str, str, str]], ...] = (
    ("fidelity", 0.8, 0.65, (
        "The tile looks like the photo.",
        "The tile differs from the photo.",
        "The tile does not look like the photo.",
    )),
    ("seam", 1.15, 1.5, (
        "No seam is visible.",
        "A seam may be visible on plain areas.",
        "A seam is visible.",
    )),
    ("repeat", 2.5, 4.0, (
        "No region of the photo is repeated noticeably.",
        "A region of the photo is repeated. Other seeds may repeat less.",
        "A region of the photo is repeated many times.",
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
    """`GRADE: SENTENCE` for each measure of a report that has a verdict."""
    values = dict(measures)
    if values.get("regular_photo", 0.0) > 0:
        values["kept"] = values["regular"] / values["regular_photo"]
    for name, good, fair, sentences in _VERDICTS:
        if name in values:
            sign = 1.0 if good < fair else -1.0
            grade = sum(not sign * values[name] <= sign * limit for limit in (good, fair))
            yield f"{GRADES[grade]}: {sentences[grade]}"
