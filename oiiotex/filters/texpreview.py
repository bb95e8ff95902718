# SPDX-License-Identifier: Apache-2.0
"""--texpreview: a tile, repeated side by side, on a plane in perspective, and in light."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

from ..engine.color.lab import color_to_convert, lens_of
from ..engine.color.lens import in_type
from ..engine.color.normal_maps import NORMALS
from ..engine.core.access import Gather
from ..engine.core.demand import materialized
from ..engine.core.image import Image, Part, derived_spec, dtype_of
from ..engine.core.op import Kind, Output, Plan, Space
from ..engine.core.parameters import Words, image, param
from ..engine.core.window import Window
from ..engine.deferred import np
from ..engine.errors import ColorError, ImageError, ParameterError, present
from ..engine.session import Session
from ..engine.session.facts import Facts
from ..surfaces.charts.lit_panels import LitPanels, lit_bytes, lit_material, roles_of, whole_panel
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
from ..synthesis.exemplar.materials import KINDS_HELP, kinds_of

PANELS = ("exemplar", "seamless", "2x2", "3x3", "plane", "lit", "sphere")
_OF_EXEMPLAR = ("exemplar", "seamless")
_LIT = ("lit", "sphere")
_GAP = 8  # px between panels


@dataclass(frozen=True, kw_only=True)
class Preview(Gather):
    """Preview a tile as it will be used: repeated, on a plane in perspective, and as a material in light.

    The plane extends to the horizon, where any repetition becomes visible (the stress test of MJH17, section 5.2). With
    `exemplar`, the preview also shows the photo, and the photo made seamless by blending it with itself shifted by
    half, as paint programs do.

    Panels lit and sphere show the maps of a material under two lights and a sky: from above, and four times around a
    sphere. `kinds` names the maps on the stack. Of data, the first is the roughness, the second the metalness. Heights
    occlude the sky, and replace missing normals. A missing roughness is 0.7.

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
    maps: tuple[Image, ...] = image((), help="Other maps of the tile's material, for lit and sphere.", count="kinds")
    exemplar: Image | None = image(None, help="Photo from which the tile was made.")
    kinds: Words | None = param(None, help=KINDS_HELP, unset="one map: color", example="color,normal,data")
    normals: str = NORMALS
    panels: Words | None = param(
        None,
        unset="2x2,3x3,plane; first exemplar,seamless if exemplar is given, last lit,sphere if kinds is given",
        example="2x2,plane",
        help=f"Panels to show, in order: {', '.join(PANELS)}.",
    )
    panel: int = param(
        512, ge=16, le=16384, unit="px", help=f"Height of each panel. It is at most {WIDEST} times as wide."
    )

    def plan(self, facts: Facts) -> Plan:
        """The names of the panels, and the maps by their roles."""
        names, tile = self._names(), self.tile.first
        roles = roles_of(kinds_of(self.kinds, 1 + len(self.maps), data=False))
        lit = [name for name in names if name in _LIT]
        if lit and (roles[0] != "color" or color_to_convert(self.tile, facts, Space.LAB) is None):
            raise ColorError(f"is not a color map: panels={lit[0]} requires one", subject=self.tile.source)
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
        broad = max(self.panel, fitted((tile.spec.width, tile.spec.height), self.panel)[0])
        maps = lit_bytes(self.panel, broad) if lit else 0
        facts.require(bytes_needed(values) + maps, task, "reduce panel")
        return Plan(work=(names, dict(zip(roles[1:], self.maps, strict=True))))

    def make(self, plan: Plan, session: Session) -> dict[str, Part]:
        """One image of all panels."""
        resources, (names, maps), tile = session.resources, plan.work, self.tile.first
        photo = None if self.exemplar is None else self.exemplar.first
        if photo is not None and not photo.ready:
            photo = materialized(photo, resources.budget)
        lit = [name for name in names if name in _LIT]
        panels = self._panels([name for name in names if name not in _LIT], tile, photo, resources.budget)
        whole = [whole_panel(tile, self.panel)] * bool(lit)
        with resources.stats.time("read"):
            others = [panels[name] for name in panels if name not in _OF_EXEMPLAR]
            look_through(tile, [*others, *whole], self.tile.source)
            if photo is not None:
                seamless = [panels[name] for name in names if name == "seamless"]
                look_through(photo, seamless, present(self.exemplar).source, seamless=True)
        for panel in whole:
            lens = lens_of(self.tile, resources)
            texels = panel.rows(0, fitted(tile.window.size, self.panel)[1])
            with resources.stats.time("light"):
                material = lit_material(texels, lens, maps, self.normals, self.panel)
            shown = LitPanels(material, lens, tile.spec.nchannels, self.panel)
            panels |= {"lit": shown.lit(), "sphere": shown.sphere()}
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
            left_out = (_OF_EXEMPLAR if self.exemplar is None else ()) + (_LIT if self.kinds is None else ())
            return [name for name in PANELS if name not in left_out]
        names = list(self.panels)
        if any(name not in PANELS for name in names):
            raise ParameterError(parameter="panels", value=self.panels, expected=", ".join(PANELS))
        missing = [name for name in names if name in _OF_EXEMPLAR]
        if self.exemplar is None and missing:
            raise ParameterError(f"{missing[0]} requires exemplar", parameter="panels", value=self.panels)
        return names
