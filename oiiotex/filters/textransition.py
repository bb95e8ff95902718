# SPDX-License-Identifier: Apache-2.0
"""--textransition: the tiles of a map of two materials."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from ..engine.color.lab import color_to_convert
from ..engine.core.access import Whole
from ..engine.core.attributes import ATLAS, TAG, mark_as_data
from ..engine.core.image import Image, Part, derived_spec, dtype_of, from_pixels, spec_beside
from ..engine.core.op import Kind, Output, Plan, Space
from ..engine.core.parameters import Size, Words, image, param
from ..engine.core.tiling import retiled, tiled_spec, tiling_of
from ..engine.core.window import Window
from ..engine.deferred import np, oiio
from ..engine.errors import ColorError, ImageError, ParameterError
from ..engine.session import Session
from ..engine.session.facts import Facts
from ..synthesis.exemplar.exemplar_op import SEED
from ..synthesis.exemplar.materials import kinds_of, read_material

if TYPE_CHECKING:
    from ..synthesis.wang.transition import TransitionTiles

_SMALLEST = 16  # px
_LARGEST = 65536  # px, of all tiles together
_PIXEL_BYTES = 120  # of a tile: Lab, grids of all levels, pixels of both materials, and what a cut numbers
_MASK_BYTES = 3  # of a pixel of the result
_DECIDED_BYTES = 400  # of a pixel on which a cut decides


@dataclass(frozen=True, kw_only=True)
class Transition(Whole):
    """Create the tiles of a map of two materials, such as grass and sand, with all borders between them.

    Use them in an editor of tile maps (Tiled, Godot), or in a terrain. Takes two tiles of the same size, as
    `stationarize` makes them, or of several maps first all of one material, then all of the other. 16 tiles have all
    combinations of materials at their four corners; 47 tiles also have sides, as blob tile sets do, and show the second
    material as an area on the first.

    Borders follow the objects of both materials: stones and leaves stay whole where they can (minimum cuts, KSE03:
    Kwatra, Schödl, Essa, Turk, Bobick, Graphcut Textures, SIGGRAPH 2003). Each pixel is a copy of the pixel at the same
    place in one of the two tiles. Tiles that may meet have the same pixels along their edge, so any map is free of
    seams.
    """

    example: ClassVar[str] = """\
>>> grass, sand = (filters.stationarize("photo.png", seed=n, size=(256, 256)) for n in (1, 2))
>>> atlas = filters.transition(grass, sand)
"""
    name: ClassVar[str] = "transition"
    copies: ClassVar[bool] = True
    space: ClassVar[Space] = Space.LAB
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("atlas", Kind.PIXELS, "All tiles in one image: 4 x 4, or 8 x 6 of which the last has no border."),
        Output(
            "splat", Kind.MEASURE, "Weight of the second material: a ramp from 0 to 1 across borders, by which an"
            " engine blends materials.", asked_by="splat",
        ),
    )  # fmt: skip

    materials: tuple[Image, ...] = image(
        help="Tile of each material; of several maps, all of the first material first."
    )
    kinds: Words | None = param(
        None, unset="one map: color", example="color,normal",
        help="Kind of each map of a material: color, data, normal or height. The last images on the stack are used: all"
        " maps of the first material, then all of the second.",
    )  # fmt: skip
    count: int = param(
        16, choices=(16, 47),
        help="Number of tiles. 16: by their corners. 47: by corners and sides, a blob tile set.",
    )  # fmt: skip
    width: float | None = param(
        None, ge=1, unit="px", unset="80 % of the largest width", example="24",
        help="Width of the zone in which borders run. At 1, they are straight.",
    )  # fmt: skip
    splat: bool | Path = param(
        False, example="splat.exr", help="Weight of the second material. 1: append it; a file name: write it there."
    )
    tiled: str | None = param(
        None, choices=("none", "x", "y", "xy", None), example="xy",
        unset="those that the image's wrapmodes call periodic", help="Axes along which the given tiles repeat.",
    )  # fmt: skip
    seed: int = param(0, ge=0, le=2**32 - 1, help=SEED)

    @classmethod
    def arity(cls, values: dict[str, Any], depth: int) -> int:
        """Two images for each kind."""
        return 2 * len(values.get("kinds") or (None,))

    def result_count(self) -> int:
        """One image for each map."""
        return len(self.materials) // 2

    def plan(self, facts: Facts) -> Plan:
        """The maps of both materials, and the width of borders."""
        from ..synthesis.wang.transition import LAYOUT, widest

        count = self.result_count()
        if len(self.materials) != 2 * max(1, len(self.kinds or (None,))):
            raise ImageError(f"takes 2 images for each kind of map: got {len(self.materials)}")
        kinds = kinds_of(self.kinds, count, data=False)
        pairs = list(zip(self.materials[:count], self.materials[count:], strict=True))
        for pair, kind in zip(pairs, kinds, strict=True):
            _require_alike(*pair, self.materials[0], kind == "color")
            for tile in pair:
                self._require_tiles(tile)
        if kinds[0] == "color":
            for tile in pairs[0]:
                if color_to_convert(tile, facts, Space.LAB) is None:
                    raise ColorError("is data: it has no Lab", subject=tile.source, hint="use kinds=data")
        spec = self.materials[0].first.spec
        side, most = min(spec.width, spec.height), widest(self.count, min(spec.width, spec.height))
        if side < _SMALLEST:
            raise ImageError(
                f"tiles of {spec.width}x{spec.height} px are too small", expected=f"{_SMALLEST} px or more"
            )
        if self.width is not None and self.width > most:
            expected = f"at most {most:.0f} px for tiles of {spec.width}x{spec.height}"
            raise ParameterError(parameter="width", value=f"{self.width:g}", expected=expected)
        columns, rows = LAYOUT[self.count]
        size = Size(columns * spec.width, rows * spec.height)
        if max(size) > _LARGEST:
            raise ImageError(f"an atlas of {size} exceeds {_LARGEST} px", expected="smaller tiles")
        need = _MASK_BYTES * size.width * size.height + _PIXEL_BYTES * spec.width * spec.height * count
        facts.require(need + _DECIDED_BYTES * min(spec.width, 256) * min(spec.height, 256), f"an atlas of {size}")
        return Plan(work=(pairs, kinds, size, self.width or 0.8 * most))

    def make(self, plan: Plan, session: Session) -> tuple[dict[str, Any], ...]:
        """The atlas of each map; the first has the weights."""
        from ..synthesis.wang.transition import LAYOUT, in_sheet, shown

        pairs, kinds, size, width = plan.work
        resources = session.resources
        with resources.stats.time("read and color"):
            first, second = (read_material((one,), Words(kinds[:1]), None, False, resources)[0] for one in pairs[0])
        with resources.stats.time("borders"):
            found = shown((first, second), self.count, width, self.seed, session.progress.advance)
        sheet, results = in_sheet(found.tiles, LAYOUT[self.count]), list[dict[str, Any]]()
        for pair, kind in zip(pairs, kinds, strict=True):
            atlas = _atlas(pair, sheet)
            results.append({"atlas": atlas if kind == "color" else atlas.respecced(mark_as_data)})
        results[0]["splat"] = lambda: self._splat(found, results[0]["atlas"].spec)
        return tuple(results)

    def _splat(self, found: TransitionTiles, spec: oiio.ImageSpec) -> Part:
        from ..synthesis.wang.transition import LAYOUT, in_sheet

        weights = in_sheet([found.weights(number) for number in range(len(found.tiles))], LAYOUT[self.count])
        return from_pixels("splat", weights[..., None], spec_beside(spec, ("Y",)))

    def _require_tiles(self, tile: Image) -> None:
        """Refuse an image that does not repeat in both directions."""
        part = tile.first if self.tiled is None else retiled(tile.first, self.tiled)
        if (axes := tiling_of(part.spec)) != "xy":
            raise ImageError(
                f"{tile.source} {'does not tile' if axes == 'none' else f'tiles along {axes} only'}",
                expected="a tile, such as a result of stationarize",
                hint="use tiled=xy if it repeats in both directions but does not say so",
            )


def _require_alike(first: Image, second: Image, like: Image, color: bool) -> None:
    """Refuse maps that cannot be parts of one atlas."""
    specs = [one.first.spec for one in (like, first, second)]
    for one, spec in zip((first, second), specs[1:], strict=True):
        if (spec.width, spec.height) != (specs[0].width, specs[0].height):
            size = f"{spec.width}x{spec.height}"
            expected = f"{specs[0].width}x{specs[0].height}, as {like.source}"
            raise ImageError(f"{one.source} is {size}: expected {expected}", hint="give both the same size")
    for name, values in (
        ("channels", [",".join(spec.channelnames) for spec in specs[1:]]),
        ("pixel type", [_type_of(one) for one in (first, second)]),
        ("color space", [spec.get_string_attribute(TAG) for spec in specs[1:]] if color else []),
    ):
        if len(set(values)) > 1:
            raise ImageError(f"{second.source} has {name} {values[1]}: expected {values[0]}, as {first.source}")


def _type_of(image: Image) -> str:
    """Its pixel type; all floats fit each other."""
    spec = image.first.spec
    return "float" if np.issubdtype(dtype_of(spec), np.floating) else str(spec.format)


def _atlas(pair: tuple[Image, Image], sheet: np.ndarray) -> Part:
    """The pixels of one material where the sheet of all tiles is False, and those of the other where it is True."""
    first = pair[0].first.pixels()
    second = pair[1].first.pixels().astype(first.dtype)
    height, width = first.shape[:2]
    tile = Window.sized(0, 0, width, height)
    rows, columns = sheet.shape[0] // height, sheet.shape[1] // width
    spec = tiled_spec(derived_spec(pair[0].first.spec, *sheet.shape[::-1]), "xy" if columns == rows else "none")
    spec.attribute(ATLAS, f"{columns}x{rows}")

    def fetch(window: Window) -> np.ndarray:
        out = np.empty((window.height, window.width, first.shape[2]), first.dtype)
        for piece in window.cells(width, height, (0, 0)):
            place = piece.shifted(-(piece.left // width) * width, -(piece.top // height) * height).inside(tile)
            other = sheet[piece.top : piece.bottom, piece.left : piece.right, None]
            out[piece.inside(window)] = np.where(other, second[place], first[place])
        return out

    return replace(pair[0].first, spec=spec, fetch=fetch, levels=(), ready=True)
