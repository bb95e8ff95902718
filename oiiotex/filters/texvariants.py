# SPDX-License-Identifier: Apache-2.0
"""--texvariants: what a synthesis makes of a photo, over seeds and values of one modifier, as a captioned sheet."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from ..charts.drawing import PAPER, Sheet, sampled, shown_pixels
from ..color.lab import InLab
from ..core.access import Whole
from ..core.image import Image
from ..core.op import Kind, Op, Output
from ..core.parameters import Words, image, nearest, param
from ..deferred import np
from ..errors import ParameterError, texture_filter
from ..session import Session
from . import op_named

_FIXED = (
    "seed", "data", "n", "variants", "report", "fail", "json", "plan", "render", "stmap", "keep", "grown", "graph",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Variants(InLab, Whole):
    """Lay out what a synthesis makes of a photo: a column for every seed, a row for every value of one modifier.

    So a seed is chosen by eye, or it is seen what a modifier does: `vary=sigma:over=8,16,32` makes three rows of
    `stationarize`. Everything else is as the filter has it when nothing is said. The caption says what to say for
    the one that is liked. The result is an 8-bit sRGB image for screens: do not measure it.
    """

    example: ClassVar[str] = '>>> sheet = filters.variants("photo.png", filter="quilt", seeds=3)'
    name: ClassVar[str] = "variants"
    outputs: ClassVar[tuple[Output, ...]] = (Output("view", Kind.PICTURE, "the sheet"),)

    exemplar: Image = image(help="the photo; for composite with label maps")
    filter: str = param(
        "stationarize",
        choices=("stationarize", "patchmatch", "quilt", "cut", "synth", "composite"),
        help="the filter, by the name of its function",
    )
    seeds: int = param(4, ge=1, le=16, help="how many seeds, from seed on")
    seed: int = param(0, ge=0, le=2**32 - 17, help="the first seed")
    vary: str | None = param(None, help="the modifier that differs from row to row")
    over: Words | None = param(None, help="its values, as they are said for the filter")
    thumb: int = param(256, ge=32, le=2048, unit="px", help="longer side of a result in the sheet, at most")

    def compute(self, session: Session) -> dict[str, Any]:
        """The sheet."""
        uses = self._uses()
        panels = []
        for (caption, use), stage in zip(uses, session.stages(), strict=False):
            part = use.compute(stage)[use.main().name]
            step = -(-max(part.spec.width, part.spec.height) // self.thumb)
            panels.append((caption, shown_pixels(sampled(part, step), part, session.resources)))
        largest = np.max([picture.shape[:2] for _, picture in panels], axis=0)
        sheet = Sheet.of_panels([(title, _on_paper(picture, *largest)) for title, picture in panels], self.seeds)
        return {"view": sheet.image()}

    def _uses(self) -> list[tuple[str, Op]]:
        """All uses of the filter with their captions, checked before the first is made."""
        op = op_named(self.filter)
        uses = []
        for name, value, text in self._values(op):
            for seed in range(self.seed, self.seed + self.seeds):
                values = {"seed": seed, "data": self.data} | ({name: value} if name else {})
                images = {"exemplar": self.exemplar} | {i.attribute: None for i in op.optional_images()}
                uses.append((f"{text} seed={seed}".strip(), op(**images, **values)))
        return uses

    def _values(self, op: type[Op]) -> list[tuple[str, Any, str]]:
        """(parameter, value, caption) of every row."""
        if (self.vary is None) != (self.over is None):
            raise ParameterError("vary says which modifier differs, over its values: say both or neither")
        if self.vary is None or self.over is None:
            return [("", None, "")]
        known = {p.name: p for p in op.parameters() if p.name not in _FIXED}
        if self.vary not in known:
            names = ", ".join(known)
            of = f"of {texture_filter(op.name)} {names} can differ{nearest(self.vary, known)}"
            raise ParameterError(of, parameter="vary", value=self.vary)
        parameter = known[self.vary]
        return [(parameter.attribute, parameter.parse(text), f"{self.vary}={text}") for text in self.over]


def _on_paper(picture: np.ndarray, height: int, width: int) -> np.ndarray:
    """The picture in the corner of one that is as large as the largest."""
    out = np.full((height, width, 3), PAPER)
    out[: picture.shape[0], : picture.shape[1]] = picture
    return out
