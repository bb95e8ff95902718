# SPDX-License-Identifier: Apache-2.0
"""Preview images of a material: flat, repeated, lit on a sphere or a plane, and compared with hex-tiling.

Shading is one GGX lobe (Walter, Marschner, Li, Torrance, Microfacet Models for Refraction, EGSR 2007) over Lambert.
"""

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
from ..api.materials import HORIZON, area_means, plane_in_perspective, repeated, shown_pixels
from .documents import ROUGHNESS

CARD = 160  # px; height of a card in the report
_MOST = 512  # px; longest side of a map in previews
_THUMBNAIL, _REPEATED, LIT, _RIVALS = 256, 512, 320, 256  # px
_ACROSS = 4  # tiles per side in the comparison with hex-tiling
_PLANE = 8  # tiles per side of a picture of Wang tiles
_PAPER = 0.93
LIGHTS = (
    ((-0.55, 0.65, 0.55), 3.6),
    ((0.8, 0.15, 0.35), 0.8),
)  # direction (x right, y up, z near), intensity
SKY, GROUND = 0.7, 0.25  # ambient light from above and below
_QUALITY = 85  # JPEG quality


@dataclass(frozen=True)
class Looks:
    """Maps of a tile, or atlases of Wang tiles, for drawing, all of the same size; constant maps can be a single texel.

    Attributes
    ----------
    color : (h, w, 3) float32
        Linear Rec. 709.
    normal : (h, w, 3) float32
        Unit normals, y up.
    roughness, metal, ao : (h, w, 1) float32
    side : int
        Tiles along a side of the maps; more than 1: atlases.
    index : (h, w, 3) uint8, optional
        The plane of an atlas: column and row of the tile of each cell.
    """

    color: np.ndarray
    normal: np.ndarray
    roughness: np.ndarray
    metal: np.ndarray
    ao: np.ndarray
    side: int = 1
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
        normal = np.array([[[0, 0, 1]]], np.float32)
        if "normal" in maps:
            signs = np.array([1, -1 if hand == "directx" else 1, 1], np.float32)
            normal = _fitted(vectors(maps["normal"]), size) * signs
            normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-6)
        return cls(color, normal, rough, scalar("metal", 0.0), scalar("ao", 1.0), side, index)

    def mean_lab(self) -> np.ndarray:
        """The mean color, in CIE Lab D65."""
        return lab_of_linear(self.color.reshape(-1, 3).mean(axis=0))

    def pictures(
        self, shape: str, lattice: bool, photo: np.ndarray, shaded: np.ndarray | None = None
    ) -> dict[str, np.ndarray]:
        """All preview images of an asset by file name, sRGB (h, w, 3).

        Parameters
        ----------
        shape : str
            Shape of the lit preview: 'sphere' or 'plane'.
        lattice : bool
            Whether the tile has a lattice; hex-tiling, which would break it, is then omitted.
        photo : (h, w, 3) float
            The photo, linear, for the card of the report.
        shaded : (h, w, 4) float, optional
            The lit preview by a renderer, linear, with its coverage.
        """
        if shaded is not None:
            lit = shaded[..., :3] + (1 - shaded[..., 3:]) * decoded(np.float32(_PAPER))
        else:
            lit = self.sphere(LIT) if shape == "sphere" else self.plane(LIT)
        tile = self.color[: self.color.shape[0] // self.side, : self.color.shape[1] // self.side]
        ways = [repeated(tile, _ACROSS, _RIVALS)]
        if not lattice:
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

    def sphere(self, side: int) -> np.ndarray:
        """The material on a sphere, orthographic: linear, (side, side, 3)."""
        fine = 2 * side  # 2x supersampling
        at = (np.arange(fine, dtype=np.float32) + 0.5) / fine * 2.1 - 1.05
        x, y = np.meshgrid(at, -at)
        inside = x * x + y * y < 1
        x, y = x[inside], y[inside]
        z = np.sqrt(np.maximum(1 - x * x - y * y, 1e-6))
        bulge = np.stack([x, y, z], axis=-1)
        round_axis = np.stack([z, np.zeros_like(x), -x], axis=-1)  # direction of increasing longitude
        round_axis /= np.maximum(np.linalg.norm(round_axis, axis=-1, keepdims=True), 1e-6)
        upwards = np.cross(bulge, round_axis)
        # four tiles around the equator
        u, v = (angle * (2 / np.pi / self.side) for angle in (np.arctan2(x, z), np.arccos(np.clip(y, -1, 1))))
        bumps = _bilinear(self.normal, u, v)
        normal = bumps[..., :1] * round_axis + bumps[..., 1:2] * upwards + bumps[..., 2:] * bulge
        picture = np.full((fine, fine, 3), decoded(np.float32(_PAPER)))
        picture[inside] = self._lit(u, v, normal, (0.0, 0.0, 1.0))
        return picture.reshape(side, 2, side, 2, 3).mean((1, 3))

    def plane(self, side: int) -> np.ndarray:
        """The material on a plane in perspective, lit from the viewer's left: linear, (side, side, 3)."""
        height, width = self.color.shape[:2]
        v, u = np.meshgrid(
            (np.arange(height, dtype=np.float32) + 0.5) / height, (np.arange(width, dtype=np.float32) + 0.5) / width,
            indexing="ij",
        )  # fmt: skip
        lit = self._lit(u, v, _bilinear(self.normal, u, v), (0.0, -0.4, 0.9))
        picture = plane_in_perspective(lit, side, side)
        picture[: round(side * HORIZON)] = decoded(np.float32(_PAPER))
        return picture

    def _lit(self, u: np.ndarray, v: np.ndarray, normal: np.ndarray, eye: tuple[float, float, float]) -> np.ndarray:
        """Radiance towards the eye of points of the tile with given normals."""
        normal = normal / np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-6)
        view = np.array(eye, np.float32) / np.linalg.norm(eye)
        base, rough, metal, ao = (_bilinear(m, u, v) for m in (self.color, self.roughness, self.metal, self.ao))
        alpha = np.maximum(rough, 0.05) ** 2
        reflected = 0.04 * (1 - metal) + base * metal  # at normal incidence
        n_v = np.maximum((normal @ view)[..., None], 1e-3)
        from_all = GROUND + (SKY - GROUND) * (0.5 + 0.5 * normal[..., 1:2])
        gloss = 0.04 * (1 - metal) * (1 - rough) + base * metal  # rough surfaces reflect no sky
        seen = from_all * ao * (base * (1 - metal) + gloss)
        for towards, strength in LIGHTS:
            light = np.array(towards, np.float32) / np.linalg.norm(towards)
            half = (light + view) / np.linalg.norm(light + view)
            n_l, n_h = (np.maximum((normal @ d)[..., None], 0) for d in (light, half))
            fresnel = reflected + (1 - reflected) * (1 - float(half @ view)) ** 5
            spread = alpha**2 / np.maximum(np.pi * (n_h**2 * (alpha**2 - 1) + 1) ** 2, 1e-9)
            shadowed = _smith(n_l, alpha) * _smith(n_v, alpha)
            glance = fresnel * spread * shadowed / np.maximum(4 * n_l * n_v, 1e-4)
            seen = seen + strength * n_l * (base * (1 - metal) * (1 - fresnel) / np.pi + glance)
        return seen


def hex_tiled(texels: np.ndarray, across: int, side: int) -> np.ndarray:
    """Hex-tile a texture, as MaterialX's `hextiledimage` does with rotation 1 and scale 0.

    The plane is a triangle grid. Each vertex is the center of a hexagon with the tile in random rotation and offset.
    A point blends its three hexagons by the seventh powers of its barycentric coordinates (M. S. Mikkelsen, Practical
    Real-Time Hex-Tiling, JCGT 11(2), 2022).

    `texels` (h, w, c) float; `across`: tiles per side of the image; `side`: size in pixels. Returns (side, side, c)
    float32.
    """
    fine = _fitted(texels, (max(8, side // across),) * 2)
    at = (np.arange(side, dtype=np.float64) + 0.5) / side * across
    u, v = np.meshgrid(at, at)
    scale = 2 * np.sqrt(3)
    skewed = np.stack([u - v / np.sqrt(3), 2 * v / np.sqrt(3)], axis=-1) * scale
    corner = np.floor(skewed)
    x, y = np.moveaxis(skewed - corner, -1, 0)
    far = x + y > 1  # the upper triangle of a cell
    ids = np.stack([corner + far[..., None], corner + np.stack([far, ~far], -1), corner + np.stack([~far, far], -1)])
    weights = np.stack([np.abs(1 - x - y), np.where(far, 1 - y, y), np.where(far, 1 - x, x)]) ** 7
    weights /= weights.sum(axis=0)
    shown = np.zeros((side, side, texels.shape[2]))
    for at_corner, weight in zip(ids, weights, strict=True):
        first, second = _hashes(at_corner)
        turn = 2 * np.pi * first
        center_u = (at_corner[..., 0] + 0.5 * at_corner[..., 1]) / scale
        center_v = at_corner[..., 1] * np.sqrt(3) / 2 / scale
        right, down = u - center_u, v - center_v
        place_u = np.cos(turn) * right + np.sin(turn) * down + center_u + first
        place_v = -np.sin(turn) * right + np.cos(turn) * down + center_v + second
        shown += weight[..., None] * _bilinear(fine, place_u, place_v)
    return shown.astype(np.float32)


def values(image: Image) -> np.ndarray:
    """The color channels of an image's first part as floats, (h, w, c); integers are scaled to 0..1."""
    pixels = image.first.pixels()[..., list(channels_of(image.first.spec).color)]
    return as_float(pixels)


def vectors(normals: Image) -> np.ndarray:
    """A normal map as vectors; decoded from 0..1 if no value is negative."""
    pixels = values(normals)
    return pixels if pixels.min() < 0 else 2 * pixels - 1


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


def _hashes(ids: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two hashes in 0..1 for every pair of integers."""
    a, b = ids[..., 0].astype(np.int64).astype(np.uint32), ids[..., 1].astype(np.int64).astype(np.uint32)
    mixed = a * np.uint32(0x9E3779B1) ^ b * np.uint32(0x85EBCA77)
    for shift, factor in ((15, 0x2C1B3C6D), (12, 0x297A2D39)):
        mixed = (mixed ^ mixed >> np.uint32(shift)) * np.uint32(factor)
    mixed ^= mixed >> np.uint32(15)
    return (mixed & np.uint32(0xFFFF)) / 65536, (mixed >> np.uint32(16)) / 65536


def _bilinear(texels: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Bilinear lookup with repeat; u and v are in tiles."""
    height, width = texels.shape[:2]
    if height == width == 1:
        return texels.reshape(*(1,) * u.ndim, -1)
    x, y = u * width - 0.5, v * height - 0.5
    left, top = np.floor(x), np.floor(y)
    right, down = (x - left)[..., None], (y - top)[..., None]  # fractions, computed before the conversion to indices
    left, top = left.astype(np.intp), top.astype(np.intp)
    columns, rows = (left % width, (left + 1) % width), (top % height, (top + 1) % height)
    above = texels[rows[0], columns[0]] * (1 - right) + texels[rows[0], columns[1]] * right
    below = texels[rows[1], columns[0]] * (1 - right) + texels[rows[1], columns[1]] * right
    return above * (1 - down) + below * down


def _smith(cosine: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    """Smith masking function (Walter et al. eq. 34)."""
    return 2 * cosine / np.maximum(cosine + np.sqrt(alpha**2 + (1 - alpha**2) * cosine**2), 1e-6)


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
    paper = np.full((height, 6, 3), decoded(np.float32(_PAPER)))
    row = [piece for panel in panels for piece in (repeated(panel, 1, height), paper)]
    return np.concatenate(row[:-1], axis=1)
