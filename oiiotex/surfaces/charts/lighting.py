# SPDX-License-Identifier: Apache-2.0
"""A material in light: its maps on a plane or a sphere, shaded by two lights and a sky.

Shading is one GGX lobe (Walter, Marschner, Li, Torrance, Microfacet Models for Refraction, EGSR 2007) over Lambert.
"""

from __future__ import annotations

from dataclasses import dataclass

from ...engine.deferred import np

LIGHTS = (
    ((-0.55, 0.65, 0.55), 3.6),
    ((0.8, 0.15, 0.35), 0.8),
)  # direction (x right, y up, z near), intensity
SKY, GROUND = 0.7, 0.25  # ambient light from above and below
ROUGHNESS = 0.7  # without such a map: MaterialX's defaults, 0.2 and 0.3, are those of plastic
FLAT = (0.0, 0.0, 1.0)  # normal; also the direction to the viewer
_MARGIN = 1.05  # half the side of a picture of the unit sphere
_FINE = 2  # supersampling of the sphere


@dataclass(frozen=True)
class LitMaterial:
    """Maps of a tile, or atlases of Wang tiles, of any sizes; constant maps can be a single texel.

    Attributes
    ----------
    color : (h, w, 3) float32
        Linear Rec. 709.
    normal : (h, w, 3) float32
        Unit normals, y up.
    roughness, metal, ao : (h, w, 1) float32
    side : int
        Tiles along a side of the maps; more than 1: atlases.
    """

    color: np.ndarray
    normal: np.ndarray
    roughness: np.ndarray
    metal: np.ndarray
    ao: np.ndarray
    side: int = 1

    def flat(self, width: int, height: int, first: int, end: int, eye: tuple[float, float, float] = FLAT) -> np.ndarray:
        """Rows of the maps on a plane that faces us, in a picture of that size: linear, (end - first, width, 3)."""
        down = (np.arange(first, end, dtype=np.float32) + 0.5) / height
        right = (np.arange(width, dtype=np.float32) + 0.5) / width
        v, u = np.meshgrid(down, right, indexing="ij")
        return self.seen(u, v, bilinear(self.normal, u, v), eye)

    def sphere(self, side: int, first: int, end: int) -> np.ndarray:
        """Rows of a picture, `side` x `side`, of a sphere with four tiles around, orthographic: linear, with coverage.

        Returns (end - first, side, 4) float32. Light on pixels that the sphere covers in part is multiplied by the
        coverage, the last channel.
        """
        fine = _FINE * side
        at = ((np.arange(fine, dtype=np.float32) + 0.5) / fine * 2 - 1) * np.float32(_MARGIN)
        x, y = np.meshgrid(at, -at[_FINE * first : _FINE * end])
        inside = x * x + y * y < 1
        x, y = x[inside], y[inside]
        z = np.sqrt(np.maximum(1 - x * x - y * y, 1e-6))
        bulge = np.stack([x, y, z], axis=-1)
        round_axis = np.stack([z, np.zeros_like(x), -x], axis=-1)  # direction of increasing longitude
        round_axis /= np.maximum(np.linalg.norm(round_axis, axis=-1, keepdims=True), 1e-6)
        upwards = np.cross(bulge, round_axis)
        u, v = (angle * (2 / np.pi / self.side) for angle in (np.arctan2(x, z), np.arccos(np.clip(y, -1, 1))))
        bumps = bilinear(self.normal, u, v)
        normal = bumps[..., :1] * round_axis + bumps[..., 1:2] * upwards + bumps[..., 2:] * bulge
        picture = np.zeros((*inside.shape, 4), np.float32)
        picture[inside, :3] = self.seen(u, v, normal, FLAT)
        picture[..., 3] = inside
        return picture.reshape(end - first, _FINE, side, _FINE, 4).mean((1, 3))

    def seen(self, u: np.ndarray, v: np.ndarray, normal: np.ndarray, eye: tuple[float, float, float]) -> np.ndarray:
        """Radiance towards the eye of places of the maps (u right, v down, in maps) with given normals."""
        normal = normal / np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-6)
        view = np.array(eye, np.float32) / np.linalg.norm(eye)
        base, rough, metal, ao = (bilinear(m, u, v) for m in (self.color, self.roughness, self.metal, self.ao))
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


def as_vectors(pixels: np.ndarray) -> np.ndarray:
    """The vectors of a normal map's pixels; decoded from 0..1 if no value is negative."""
    return pixels if pixels.min() < 0 else 2 * pixels - 1


def unit_normals(pixels: np.ndarray, hand: str) -> np.ndarray:
    """Unit normals, y up, from a normal map's pixels. `hand`: their convention; 'directx': y down."""
    vectors = as_vectors(pixels) * np.array([1, -1 if hand == "directx" else 1, 1], np.float32)
    vectors /= np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-6)
    return vectors


def slope_normals(heights: np.ndarray) -> np.ndarray:
    """Unit normals, y up, of a periodic field of heights in px: (h, w, 3) float32."""
    right, down = ((np.roll(heights, -1, axis) - np.roll(heights, 1, axis)) / 2 for axis in (1, 0))
    normals = np.stack([-right, down, np.ones_like(heights)], axis=-1).astype(np.float32)
    return normals / np.linalg.norm(normals, axis=-1, keepdims=True)


def bilinear(texels: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
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
