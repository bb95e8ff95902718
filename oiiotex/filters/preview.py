# SPDX-License-Identifier: Apache-2.0
"""--texpreview: what a tile looks like when it is used."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

from ..charts.tile_preview import made_seamless, plane_in_perspective, repeated
from ..color.config import as_float
from ..color.lab import count_broken, in_type
from ..core.access import Whole
from ..core.image import Image, Part, derived_spec, dtype_of, from_pixels, resized
from ..core.op import Kind, Output, Space
from ..core.parameters import Words, image, param
from ..deferred import np
from ..errors import BrokenValues, ImageError, ParameterError
from ..session import Session

PANELS = ("exemplar", "seamless", "2x2", "3x3", "plane")
_OF_EXEMPLAR = ("exemplar", "seamless")
_GAP = 8  # px between panels
_PANEL_BYTES = 14  # bytes a value of the panels and their sheet; measured, as the next
_SUM_BYTES = 24  # bytes a value while the widest panel is summed up in doubles


@dataclass(frozen=True, kw_only=True)
class Preview(Whole):
    """Lay a tile out as it will be seen: 2 x 2, 3 x 3, and on a plane in perspective to the horizon.

    The plane is the stress test of MJH17 (section 5.2): all repetition shows there. With `exemplar` the photo stands
    beside it, and what a paint program's 'make seamless' makes of it, 2 x 2: the photo blended with itself shifted by
    half. Every pixel is the mean of all it covers. Values are averaged as they are stored: of a picture that is not
    linear convert a copy first (--tocolorspace), where the light at the horizon must be right.
    """

    name: ClassVar[str] = "preview"
    space: ClassVar[Space] = Space.ANY
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("preview", Kind.PIXELS, "the panels side by side, in the tile's colour space and type"),
    )

    tile: Image = image(help="the tile")
    exemplar: Image | None = image(None, help="the photo that it was made from")
    panels: Words | None = param(
        None, help=f"which, in their order: {', '.join(PANELS)}; when left out all there can be"
    )
    height: int = param(512, ge=16, le=16384, unit="px", help="of each panel")

    def compute(self, session: Session) -> dict[str, Part]:
        """One image of all panels."""
        names = self._names()
        part = self.tile.first
        task = f"a preview of a tile of {part.spec.width}x{part.spec.height}, {self.height} px high,"
        session.require(self._memory(names), task, "take a smaller height")
        with session.stats.time("read"):
            tile = _values(self.tile)
            photo = None if self.exemplar is None else _values(self.exemplar)
        if photo is not None and photo.shape[2] != tile.shape[2]:
            raise ImageError(f"exemplar has {photo.shape[2]} channels, the tile {tile.shape[2]}: they must be alike")
        makers: dict[str, Callable[[], np.ndarray]] = {
            "exemplar": lambda: _at_height(photo, self.height),
            "seamless": lambda: repeated(made_seamless(photo), 2, self.height),
            "2x2": lambda: repeated(tile, 2, self.height),
            "3x3": lambda: repeated(tile, 3, self.height),
            "plane": lambda: plane_in_perspective(tile, self.height * 3 // 2, self.height),
        }
        panels = [makers[name]() for name in names]
        gap = np.zeros((self.height, _GAP, tile.shape[2]))
        sheet = np.concatenate([piece for panel in panels for piece in (gap, panel)][1:], axis=1)
        spec = derived_spec(part.spec, sheet.shape[1], self.height)
        pixels = in_type(sheet.astype(np.float32), np.dtype(dtype_of(part.spec)))
        return {"preview": from_pixels(part.name, pixels, spec, part.stored)}

    def _memory(self, names: list[str]) -> int:
        """Bytes: the images, the panels and their sheet, and what the widest of them is summed up in."""
        images = [self.tile.first.spec, *([] if self.exemplar is None else [self.exemplar.first.spec])]
        across = {name: (images[-1] if name in _OF_EXEMPLAR else images[0]) for name in names}
        widths = [
            self.height * 3 // 2 if name == "plane" else self.height * spec.width // spec.height + 1
            for name, spec in across.items()
        ]
        inputs = 24 * sum(spec.width * spec.height for spec in images)
        summed = max(*widths, *(spec.width for spec in images))
        return images[0].nchannels * (
            inputs + _PANEL_BYTES * self.height * sum(widths) + _SUM_BYTES * self.height * summed
        )

    def _names(self) -> list[str]:
        if self.panels is None:
            return [name for name in PANELS if self.exemplar is not None or name not in _OF_EXEMPLAR]
        names = list(self.panels)
        if any(name not in PANELS for name in names):
            raise ParameterError(f"panels={self.panels}: allowed is {', '.join(PANELS)}")
        missing = [name for name in names if name in _OF_EXEMPLAR]
        if self.exemplar is None and missing:
            raise ParameterError(f"panels={self.panels}: {missing[0]} needs exemplar=")
        return names


def _values(image: Image) -> np.ndarray:
    """All channels; one broken value would spoil every mean, so there must be none."""
    values = as_float(image.first.pixels())
    counts = count_broken(values)
    if counts.any():
        raise BrokenValues(image.source, counts)
    return values


def _at_height(photo: np.ndarray, height: int) -> np.ndarray:
    return resized(photo, max(1, round(height * photo.shape[1] / photo.shape[0])), height)
