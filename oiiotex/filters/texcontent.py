# SPDX-License-Identifier: Apache-2.0
"""--texcontent: where an image has the same content, and a table of all contents."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from ..analysis.labels.content_scan import Contents, scan_bytes
from ..analysis.labels.content_table import histogram, key_of, patch_side
from ..engine.core.access import ScanThenMap
from ..engine.core.demand import cached
from ..engine.core.image import Image, Part, dtype_of
from ..engine.core.op import Kind, Output, Plan, Space
from ..engine.core.parameters import Numbers, image, param
from ..engine.core.window import Window
from ..engine.deferred import np
from ..engine.errors import ImageError, ParameterError
from ..engine.session import Session
from ..engine.session.facts import Facts
from ..engine.session.resources import Resources
from ..surfaces.charts.drawing import colored, shown_pixels
from ..synthesis.exemplar.exemplar_masks import label_levels, label_map
from ..synthesis.exemplar.exemplar_op import COARSEST


def _lines(facts: dict[str, Any]) -> Iterator[str]:
    """The label histogram of the patch, and the number of patches with the same key."""
    for name, counts in facts["histograms"].items():
        ordered = sorted(counts.items(), key=lambda i: (-i[1], int(i[0])))
        shares = ", ".join(f"{c}: {n / facts['patch'] ** 2:.1%}" for c, n in ordered)
        yield f"{name}: {shares or 'none'}"
    first, second = facts["key"]
    yield f"key ({first}, {second}) of label.{facts['level']}: {facts['patches']} patches"


@dataclass(frozen=True, kw_only=True)
class Content(ScanThenMap):
    """Show where an image has the same content as a given patch, or draw a table of all contents.

    The two most frequent labels in a square patch are its key, by which `quilt` selects patches (LSA16: Lockerman,
    Sauvage, Allegre, Dischler, Dorsey, Rushmeier, Multi-Scale Label-Map Extraction for Texture Synthesis, SIGGRAPH
    2016, section 6.1). Use this to see why a guide selects certain patches. The patch at `center` is outlined on the
    photo, and the centers of all patches with the same key are marked red (figure 10). The label histograms of the
    patch at each level are printed (figure 9); facts= writes them to a file. With `keys`, a table shows a patch for
    each key: rows are the first label, columns the second (figure 11). The result is an 8-bit sRGB image for
    display, not for measurement.
    """

    example: ClassVar[str] = """\
>>> labeled = filters.label("photo.png", photo=True)
>>> same = filters.content(labeled, center=(20, 30))
"""
    name: ClassVar[str] = "content"
    space: ClassVar[Space] = Space.ANY
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("view", Kind.PICTURE, "Photo with similar patches marked, or the table of keys."),
        Output(
            "facts", Kind.TABLE, "Key, histograms at each level, number of patches of each key.",
            asked_by="facts", lines=_lines,
        ),
    )  # fmt: skip

    source: Image = image(help="Image with label parts, from `label` with `photo`.")
    center: Numbers | None = param(
        None, unit="px", unset="the center of the image", example="512,384",
        help="Center X,Y of the patch, in the data window.",
    )  # fmt: skip
    labellevel: int | None = param(
        None, example="2", ge=1, unset=COARSEST, help="Level of the label map: N of label.N."
    )
    patch: int | None = param(
        None, ge=4, le=256, unit="px", unset="the power of two nearest to the level's scale, from 16 to 256",
        example="32", help="Side of a patch.",
    )  # fmt: skip
    keys: bool = param(False, help="Draw the table of keys instead.")
    facts: Path | None = param(
        None, example="content.json", help="File for the key, histograms and the number of patches of each key."
    )

    def plan(self, facts: Facts) -> Plan:
        """The labels, the side of a patch, and its place."""
        from ..surfaces.charts.content_chart import drawing_bytes  # not needed to parse the command line

        first = self.source.first
        labels = label_map(self.source, self.labellevel)
        width, height = first.spec.width, first.spec.height
        side = self.patch or patch_side(labels.scale or min(width, height) / 8)
        side = side if self.patch else min(side, 1 << (min(width, height).bit_length() - 1))
        if side > min(width, height):
            raise ImageError(
                f"exceeds {self.source.source}, {width}x{height}", parameter="patch", value=self.patch,
                hint="reduce patch",
            )  # fmt: skip
        needed = scan_bytes(width, height, side, facts) + drawing_bytes(width)
        facts.require(needed, f"the content of rows of {width} px in patches of {side} px")
        return Plan(work=(labels, side, *self._place(first, side)))

    def make(self, plan: Plan, session: Session) -> dict[str, Any]:
        """The picture, and its data."""
        from ..surfaces.charts.content_chart import key_table, marked  # not needed to parse the command line

        first, (labels, side, left, top) = self.source.first, plan.work
        levels = label_levels(self.source)
        histograms = {level: _histogram(one.part, left, top, side) for level, one in levels.items()}
        key = key_of(histograms[labels.level])
        contents = Contents(labels.part, side, session.resources, session.progress, key, passes=2 if self.keys else 1)
        photo, labeled = (cached(part, session.resources.cache) for part in (first, labels.part))
        picture = functools.partial(_shown, photo, labeled, session.resources)
        drawn = key_table(picture, contents) if self.keys else marked(first, picture, contents, (left, top))
        return {"view": drawn, "facts": lambda: _facts(contents, labels.level, left, top, histograms)}

    def _place(self, part: Part, side: int) -> tuple[int, int]:
        """Left and top of the patch, relative to the data window."""
        width, height = part.spec.width, part.spec.height
        if self.center is None:
            return (width - side) // 2, (height - side) // 2
        if len(self.center) != 2:
            raise ParameterError(parameter="center", value=self.center, expected="two numbers, X,Y")
        x, y = (int(np.floor(n)) for n in self.center)
        x, y = x - part.spec.x, y - part.spec.y
        if not (0 <= x < width and 0 <= y < height):
            raise ParameterError(
                parameter="center", value=self.center, expected=f"a point in the data window {part.window}"
            )
        return min(max(x - side // 2, 0), width - side), min(max(y - side // 2, 0), height - side)


def _histogram(labels: Part, left: int, top: int, side: int) -> dict[int, int]:
    """Histogram of the labels in a window."""
    whole = labels.window
    return histogram(labels.read(Window.sized(whole.left + left, whole.top + top, side, side))[..., 0], 0, 0, side)


def _shown(photo: Part, labels: Part, resources: Resources, window: Window) -> np.ndarray:
    """A window (in the data window) as sRGB, or its labels in colors without a photo; (h, w, 3) float32."""
    if not (photo.exact or dtype_of(photo.spec) == np.uint32):
        return shown_pixels(photo.read(window.shifted(photo.spec.x, photo.spec.y)), photo, resources).astype(np.float32)
    around = Window(max(0, window.left - 1), max(0, window.top - 1), window.right, window.bottom)  # for borders
    ids = labels.read(around.shifted(labels.spec.x, labels.spec.y))[..., 0]
    return colored(ids.astype(np.int64), None, 1.0).astype(np.float32)[window.inside(around)]


def _facts(
    contents: Contents, level: int, left: int, top: int, histograms: dict[int, dict[int, int]]
) -> dict[str, Any]:
    return {
        "level": level,
        "patch": contents.side,
        "left": left,
        "top": top,
        "key": list(contents.key),
        "patches": contents.counts.get(contents.key, 0),
        "histograms": {f"label.{n}": {str(c): k for c, k in counts.items()} for n, counts in histograms.items()},
        "keys": [{"key": list(key), "patches": n} for key, n in contents.counts.items()],
    }
