# SPDX-License-Identifier: Apache-2.0
"""--texsheet: contact sheet of a synthesis over seeds and values of one modifier."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from ..engine.color.lab import InLab
from ..engine.core.access import Whole
from ..engine.core.image import Image
from ..engine.core.op import Kind, Op, Output, Plan
from ..engine.core.parameters import Words, image, nearest, param
from ..engine.deferred import np
from ..engine.errors import ParameterError, texture_filter
from ..engine.session import Session
from ..engine.session.facts import Facts
from ..surfaces.charts.drawing import PAPER, Sheet, sampled, shown_pixels
from . import op_named

_FIXED = (
    "seed", "data", "kinds", "variants", "report", "fail", "planfile", "fromplan", "st", "grown", "graph",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class ContactSheet(InLab, Whole):
    """Compare results of a synthesis filter in a contact sheet, with a column for each seed.

    Use it to choose a seed, or to see the effect of a modifier: `vary=sigma:over=8,16,32` makes three rows of
    `stationarize`. All other modifiers have their defaults. Captions show the modifiers of each result. The result is
    an 8-bit sRGB image for display, not for measurement.
    """

    example: ClassVar[str] = '>>> sheet = filters.sheet("photo.png", op="quilt", count=3)'
    name: ClassVar[str] = "sheet"
    outputs: ClassVar[tuple[Output, ...]] = (Output("view", Kind.PICTURE, "Contact sheet."),)

    exemplar: Image = image(help="Photo; for op=composite, with label maps.")
    op: str = param(
        "stationarize",
        choices=("stationarize", "patchmatch", "quilt", "cut", "synth", "composite"),
        help="Name of the synthesis filter.",
    )
    count: int = param(4, ge=1, le=16, help="Number of seeds, one for each column.")
    seed: int = param(0, ge=0, le=2**32 - 17, help="First seed.")
    vary: str | None = param(
        None, example="sigma", help="Name of a modifier that varies from row to row. Requires over."
    )
    over: Words | None = param(
        None, example="8,16,32", help="Values of the modifier that vary names, one for each row."
    )
    panel: int = param(256, ge=32, le=2048, unit="px", help="Maximum longer side of a result in the sheet.")

    def plan(self, facts: Facts) -> Plan:
        """All uses of the filter, with their captions and plans."""
        return Plan(work=[(caption, use, use.plan(facts)) for caption, use in self._uses()])

    def make(self, plan: Plan, session: Session) -> dict[str, Any]:
        """The contact sheet."""
        uses = plan.work
        panels = []
        for (caption, use, planned), stage in zip(uses, session.stages(*[1] * len(uses)), strict=True):
            part = use.make(planned, stage)[use.main().name]
            step = -(-max(part.spec.width, part.spec.height) // self.panel)
            panels.append((caption, shown_pixels(sampled(part, step), part, session.resources)))
        largest = np.max([picture.shape[:2] for _, picture in panels], axis=0)
        sheet = Sheet.of_panels([(title, _on_paper(picture, *largest)) for title, picture in panels], self.count)
        return {"view": sheet.image()}

    def _uses(self) -> list[tuple[str, Op]]:
        """All uses of the filter with their captions, checked before the first is run."""
        op = op_named(self.op)
        uses = []
        for name, value, text in self._values(op):
            for seed in range(self.seed, self.seed + self.count):
                values = {"seed": seed, "data": self.data} | ({name: value} if name else {})
                images = {"exemplar": self.exemplar} | {i.attribute: None for i in op.optional_images()}
                uses.append((f"{text} seed={seed}".strip(), op(**images, **values)))
        return uses

    def _values(self, op: type[Op]) -> list[tuple[str, Any, str]]:
        """(parameter, value, caption) of every row."""
        if (self.vary is None) != (self.over is None):
            raise ParameterError("vary and over require each other")
        if self.vary is None or self.over is None:
            return [("", None, "")]
        known = {p.name: p for p in op.parameters() if p.name not in _FIXED}
        if self.vary not in known:
            names = ", ".join(known)
            expected = f"a modifier of {texture_filter(op.name)} ({names}){nearest(self.vary, known)}"
            raise ParameterError(parameter="vary", value=self.vary, expected=expected)
        parameter = known[self.vary]
        return [(parameter.attribute, parameter.parse(text), f"{self.vary}={text}") for text in self.over]


def _on_paper(picture: np.ndarray, height: int, width: int) -> np.ndarray:
    """The picture padded to the size of the largest one."""
    out = np.full((height, width, 3), PAPER)
    out[: picture.shape[0], : picture.shape[1]] = picture
    return out
