# SPDX-License-Identifier: Apache-2.0
"""Preview images of a material: flat, repeated, lit on a sphere or a plane, and compared with a plane of hexagons."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from oiiotex.engine.deferred import np, oiio
from oiiotex.engine.errors import Error, present

from ..api.images import (
    TAG,
    Image,
    Part,
    Resources,
    as_float,
    channels_of,
    decoded,
    encoded,
    from_array,
    lab_of_linear,
    resized,
    tagged,
)
from ..api.materials import (
    FLAT,
    HORIZON,
    ROUGHNESS,
    LitMaterial,
    area_means,
    as_vectors,
    plane_in_perspective,
    repeated,
    shown_pixels,
    unit_normals,
)
from .hexagons import blended, gaussianized

CARD = 160  # px; height of a card in the report
_MOST = 512  # px; longest side of a map in previews
_THUMBNAIL, _REPEATED, LIT, _RIVALS = 256, 512, 320, 256  # px
_ACROSS = 4  # tiles per side in the comparison with a plane of hexagons
_PLANE = 8  # tiles per side of a picture of Wang tiles
_PAPER = float(decoded(np.float32(0.93)))  # linear
_QUALITY = 85  # JPEG quality


@dataclass(frozen=True)
class Looks(LitMaterial):
    """Maps for drawing, all of the same size.

    Attributes
    ----------
    index : (h, w, 3) uint8, optional
        The plane of an atlas: column and row of the tile of each cell.
    """

    index: np.ndarray | None = None

    @classmethod
    def of(
        cls, maps: Mapping[str, Image], resources: Resources, hand: str, side: int = 1, index: np.ndarray | None = None
    ) -> Looks:
        """From delivered maps; missing maps get constant values. `hand`: convention of the normals."""
        part = maps["color"].first
        color = reduced(linear_of(part, resources), _MOST, side)
        size = color.shape[:2]

        def scalar(role: str, plain: float) -> np.ndarray:
            if role not in maps:
                return np.full((1, 1, 1), plain, np.float32)
            return np.clip(_fitted(values(maps[role])[..., :1], size), 0, 1)

        rough = (
            1 - scalar("gloss", 0.3) if "gloss" in maps and "roughness" not in maps else scalar("roughness", ROUGHNESS)
        )
        normal = np.array([[FLAT]], np.float32)
        if "normal" in maps:
            normal = unit_normals(_fitted(vectors(maps["normal"]), size), hand)
        return cls(color, normal, rough, scalar("metal", 0.0), scalar("ao", 1.0), side, index)

    def mean_lab(self) -> np.ndarray:
        """The mean color, in CIE Lab D65."""
        return lab_of_linear(self.color.reshape(-1, 3).mean(axis=0))

    def pictures(
        self, shape: str, hexes: bool, photo: np.ndarray, shaded: np.ndarray | None = None
    ) -> dict[str, np.ndarray]:
        """All preview images of an asset by file name, sRGB (h, w, 3).

        Parameters
        ----------
        shape : str
            Shape of the lit preview: 'sphere' or 'plane'.
        hexes : bool
            Whether to compare with a plane of hexagons.
        photo : (h, w, 3) float
            The photo, linear, for the card of the report.
        shaded : (h, w, 4) float, optional
            The lit preview by a renderer, linear, with its coverage.
        """
        if shaded is None and shape == "sphere":
            shaded = self.sphere(LIT, 0, LIT)
        lit = self.plane(LIT) if shaded is None else shaded[..., :3] + (1 - shaded[..., 3:]) * _PAPER
        tile = self.color[: self.color.shape[0] // self.side, : self.color.shape[1] // self.side]
        ways = [repeated(tile, _ACROSS, _RIVALS)]
        if hexes:
            ways.append(hex_tiled(tile, _ACROSS, _RIVALS))
        if self.index is None:
            small, plane, name = self.color, repeated(tile, 2, _REPEATED), "preview_2x2.jpg"
        else:
            small, plane, name = self._laid_out(_ACROSS), self._laid_out(_PLANE), "preview_plane.jpg"
            ways.append(repeated(small, 1, _RIVALS))
        made = {"thumbnail.jpg": reduced(small, _THUMBNAIL), name: reduced(plane, _REPEATED), "lit.jpg": lit}
        card = [photo, lit, *([plane] if self.index is None else [])]
        if len(ways) > 1:
            made["compared.jpg"] = _side_by_side(ways, _RIVALS)
            card += ways
        made["card.jpg"] = _side_by_side(card, CARD)
        return {name: encoded(picture) for name, picture in made.items()}

    def _laid_out(self, count: int) -> np.ndarray:
        """The color of `count` x `count` cells of the plane of an atlas."""
        height, width = (n // self.side for n in self.color.shape[:2])
        tiles = self.color.reshape(self.side, height, self.side, width, 3).swapaxes(1, 2)
        column, row = np.moveaxis(present(self.index)[:count, :count], -1, 0)[:2]
        return tiles[row, column].swapaxes(1, 2).reshape(count * height, count * width, 3)

    def plane(self, side: int) -> np.ndarray:
        """The material on a plane in perspective, lit from the viewer's left: linear, (side, side, 3)."""
        height, width = self.color.shape[:2]
        lit = self.flat(width, height, 0, height, (0.0, -0.4, 0.9))
        picture = plane_in_perspective(lit, side, side)
        picture[: round(side * HORIZON)] = _PAPER
        return picture


def hex_tiled(texels: np.ndarray, across: int, side: int) -> np.ndarray:
    """A plane of hexagons of a tile: linear, (side, side, 3) float32. `across`: tiles per side of the picture."""
    fine = _fitted(texels, (max(8, side // across),) * 2)
    u, v = np.meshgrid(*[(np.arange(side, dtype=np.float64) + 0.5) / side * across] * 2)
    return blended(gaussianized(fine), u, v).astype(np.float32)


def values(image: Image) -> np.ndarray:
    """The color channels of an image's first part as floats, (h, w, c); integers are scaled to 0..1."""
    pixels = image.first.pixels()[..., list(channels_of(image.first.spec).color)]
    return as_float(pixels)


def vectors(normals: Image) -> np.ndarray:
    """A normal map as vectors."""
    return as_vectors(values(normals))


def linear_of(part: Part, resources: Resources) -> np.ndarray:
    """The colors of a part as linear Rec. 709, (h, w, 3), 0 to 1."""
    return decoded(shown_pixels(part.pixels(), part, resources)).astype(np.float32)


def photo_linear(photo: Image, space: str, resources: Resources) -> np.ndarray:
    """A photo as linear Rec. 709 in the height of the report's cards. `space`: its color space; '': as tagged."""
    pixels = values(photo)
    small = resized(pixels, max(1, round(CARD * pixels.shape[1] / pixels.shape[0])), CARD)
    space = space or resources.color.believed(photo).first.spec.get_string_attribute(TAG)
    return linear_of(tagged(from_array(small), space).first, resources)


def srgb_of(part: Part, resources: Resources, size: Sequence[int]) -> np.ndarray:
    """The colors of a part as sRGB, 0 to 1, (height, width, 3), in a smaller size by area averages of linear values."""
    return encoded(_fitted(linear_of(part, resources), (size[0], size[1])))


def lab_of_srgb(code: Sequence[float]) -> np.ndarray:
    """Convert an sRGB color, 0 to 1, to CIE Lab D65."""
    return lab_of_linear(decoded(np.asarray(code, np.float64)))


def save(picture: np.ndarray, path: Path) -> None:
    """Write an sRGB image, (h, w, 3), 0 to 1, as a JPEG."""
    spec = oiio.ImageSpec(picture.shape[1], picture.shape[0], 3, oiio.UINT8)
    spec.attribute("Compression", f"jpeg:{_QUALITY}")
    spec.attribute("oiio:ColorSpace", "srgb_rec709_scene")
    out = oiio.ImageOutput.create(str(path))
    pixels = np.ascontiguousarray(np.clip(picture * 255 + 0.5, 0, 255).astype(np.uint8))
    if out is None or not out.open(str(path), spec) or not out.write_image(pixels) or not out.close():
        raise Error(f"{path}: {out.geterror() if out else oiio.geterror()}")


def reduced(texels: np.ndarray, most: int, side: int = 1) -> np.ndarray:
    """Texels whose longer side is at most about `most`, and whose sides are multiples of `side`."""
    longer = max(texels.shape[:2])
    height, width = (side * max(1, round(n * min(1, most / longer) / side)) for n in texels.shape[:2])
    return _fitted(texels, (height, width))


def _fitted(texels: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Resample texels to a size by area averages: (height, width, c) float32."""
    if texels.shape[:2] == size:
        return texels.astype(np.float32)
    for axis, count in enumerate(size):
        borders = np.linspace(0, texels.shape[axis], count + 1)
        texels = np.moveaxis(area_means(np.moveaxis(texels, axis, 0), borders[:-1], borders[1:]), 0, axis)
    return texels.astype(np.float32)


def _side_by_side(panels: list[np.ndarray], height: int) -> np.ndarray:
    """Place panels of equal height side by side."""
    paper = np.full((height, 6, 3), _PAPER)
    row = [piece for panel in panels for piece in (repeated(panel, 1, height), paper)]
    return np.concatenate(row[:-1], axis=1)
