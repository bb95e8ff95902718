# SPDX-License-Identifier: Apache-2.0
"""--texpreview: a tile, repeated side by side and on a plane in perspective."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

from ..engine.color.lens import in_type
from ..engine.core.access import Gather
from ..engine.core.demand import materialized
from ..engine.core.image import Image, Part, derived_spec, dtype_of
from ..engine.core.op import Kind, Output, Plan, Space
from ..engine.core.parameters import Words, image, param
from ..engine.core.window import Window
from ..engine.deferred import np
from ..engine.errors import ImageError, ParameterError, present
from ..engine.session import Session
from ..engine.session.facts import Facts
from ..surfaces.charts.tile_preview import (
    WIDEST,
    PreviewPanel,
    bytes_needed,
    fitted,
    laid,
    look_through,
    plane,
    reduced,
)

PANELS = ("exemplar", "seamless", "2x2", "3x3", "plane")
_OF_EXEMPLAR = ("exemplar", "seamless")
_GAP = 8  # px between panels


@dataclass(frozen=True, kw_only=True)
class Preview(Gather):
    """Preview a tile as it will be used: repeated 2 x 2 and 3 x 3, and on a plane in perspective.

    The plane extends to the horizon, where any repetition becomes visible (the stress test of MJH17, section 5.2). With
    `exemplar`, the preview also shows the photo, and the photo made seamless by blending it with itself shifted by
    half, as paint programs do.

    Every pixel is the mean of the area that it covers. Stored values are averaged without conversion: for correct
    brightness near the horizon, convert the tile to a linear color space first (OpenImageIO's `colorconvert`).
    """

    example: ClassVar[str] = '>>> sheet = filters.preview(filters.stationarize("photo.png"), panels=["3x3"])'
    name: ClassVar[str] = "preview"
    blends: ClassVar[bool] = True
    space: ClassVar[Space] = Space.ANY
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("preview", Kind.PIXELS, "Panels side by side, in the tile's color space and type."),
    )

    tile: Image = image(help="Tile to preview.")
    exemplar: Image | None = image(None, help="Photo from which the tile was made.")
    panels: Words | None = param(
        None,
        unset="all; without exemplar, 2x2,3x3,plane",
        example="2x2,plane",
        help=f"Panels to show, in order: {', '.join(PANELS)}.",
    )
    panel: int = param(
        512, ge=16, le=16384, unit="px", help=f"Height of each panel. It is at most {WIDEST} times as wide."
    )

    def plan(self, facts: Facts) -> Plan:
        """The names of the panels."""
        names, tile = self._names(), self.tile.first
        photo = None if self.exemplar is None else self.exemplar.first
        channels = tile.spec.nchannels
        if photo is not None and photo.spec.nchannels != channels:
            raise ImageError(f"exemplar has {photo.spec.nchannels} channels, but the tile has {channels}: must match")
        widest = max(part.spec.width for part in (tile, photo or tile))
        task = f"a preview of rows of {widest} px, {self.panel} px high,"
        shown = {name: ((photo if name in _OF_EXEMPLAR else tile) or tile).spec for name in names}
        across = (max(1.5, fitted((spec.width, spec.height), self.panel)[0] / self.panel) for spec in shown.values())
        sheet = sum(self.panel * width + _GAP for width in across)
        values = channels * max(widest, round(sheet))  # in a row of an image and of the sheet
        facts.require(bytes_needed(values), task, "reduce panel")
        return Plan(work=names)

    def make(self, plan: Plan, session: Session) -> dict[str, Part]:
        """One image of all panels."""
        resources, names, tile = session.resources, plan.work, self.tile.first
        photo = None if self.exemplar is None else self.exemplar.first
        if photo is not None and not photo.ready:
            photo = materialized(photo, resources.budget)
        panels = self._panels(names, tile, photo, resources.budget)
        with resources.stats.time("read"):
            look_through(tile, [panels[name] for name in names if name not in _OF_EXEMPLAR], self.tile.source)
            if photo is not None:
                seamless = [panels[name] for name in names if name == "seamless"]
                look_through(photo, seamless, present(self.exemplar).source, seamless=True)
        return {"preview": self._sheet(tile, [panels[name] for name in names])}

    def _panels(self, names: list[str], tile: Part, photo: Part | None, budget: int) -> dict[str, PreviewPanel]:
        """The requested panels, still empty."""
        across, channels = self.panel * 3 // 2, tile.spec.nchannels
        kept = 8 * channels * (self.panel + 1)  # bytes for the sums of a column
        need = sum(kept * ((photo if name in _OF_EXEMPLAR else tile) or tile).spec.width for name in names)
        here = need <= budget // 4
        makers: dict[str, Callable[[], PreviewPanel]] = {
            "exemplar": lambda: reduced(present(photo), self.panel),
            "seamless": lambda: laid(present(photo).window.size, channels, 2, self.panel, here),
            "2x2": lambda: laid(tile.window.size, channels, 2, self.panel, here),
            "3x3": lambda: laid(tile.window.size, channels, 3, self.panel, here),
            "plane": lambda: plane(tile.window.size, channels, across, self.panel, here),
        }
        return {name: makers[name]() for name in names}

    def _sheet(self, tile: Part, panels: list[PreviewPanel]) -> Part:
        """All panels side by side, not yet drawn."""
        width = sum(panel.width for panel in panels) + _GAP * (len(panels) - 1)
        spec = derived_spec(tile.spec, width, self.panel)
        dtype, channels = np.dtype(dtype_of(tile.spec)), tile.spec.nchannels

        def fetch(window: Window) -> np.ndarray:
            gap = np.zeros((window.height, _GAP, channels))
            drawn = [piece for panel in panels for piece in (gap, panel.rows(window.top, window.bottom))][1:]
            sheet = np.concatenate([piece.astype(np.float32) for piece in drawn], axis=1)
            return in_type(sheet[:, window.left : window.right], dtype)

        return Part(tile.name, spec, fetch, tile.stored)

    def _names(self) -> list[str]:
        if self.panels is None:
            return [name for name in PANELS if self.exemplar is not None or name not in _OF_EXEMPLAR]
        names = list(self.panels)
        if any(name not in PANELS for name in names):
            raise ParameterError(parameter="panels", value=self.panels, expected=", ".join(PANELS))
        missing = [name for name in names if name in _OF_EXEMPLAR]
        if self.exemplar is None and missing:
            raise ParameterError(f"{missing[0]} requires exemplar", parameter="panels", value=self.panels)
        return names
