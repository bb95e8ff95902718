# SPDX-License-Identifier: Apache-2.0
"""Photos of six known materials, rendered by Mitsuba 3 with cast shadows, interreflections and the noise of a sensor.

python -m benchmarks.captures.rendered CACHE

A material is a relief with albedo and roughness (Disney's principled BSDF, specular .5) below an orthographic camera,
lit by one distant light in each of 17 photos: 16 to capture it, of which every second and every fourth make sets of 8
and 4, and one to judge the result under. Renders take some minutes, and are kept in the folder CACHE. Mitsuba
(`pip install mitsuba`) is not a dependency of the project.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from scipy.ndimage import gaussian_filter

from benchmarks.shared.measures import data_folder
from tests import pictures
from tests.reference import reliefs

SIDE, COUNT, SAMPLES = 256, 16, 16  # px; lights; rays for each pixel
UNUSED = reliefs.light(107, 52)  # light of the photo that is predicted
GLOSSY = ("wet rock", "glazed bricks")


@dataclass(frozen=True)
class Material:
    """What is rendered.

    `heights` px and `roughness` (side, side); `albedo` (side, side, 3) linear. `normals` (side, side, 3) are unit
    vectors with y up.
    """

    heights: np.ndarray
    albedo: np.ndarray
    roughness: np.ndarray

    @property
    def normals(self) -> np.ndarray:
        """Those of the heights, with one-sided slopes at the border."""
        down, right = np.gradient(self.heights)
        vectors = np.stack([-right, down, np.ones_like(right)], -1)
        return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def lights() -> np.ndarray:
    """Directions of the 16 lights, 48 or 62 degrees high, as are every second and every fourth of them."""
    return np.array([reliefs.light(90 + 360 * n / COUNT, 48 + 14 * (n.bit_count() & 1)) for n in range(COUNT)])


def materials() -> dict[str, Material]:
    """Six materials by name."""
    rock, rust = _scan("mossy_rock", 0.4), _scan("rusty_metal", 0.15)
    paint = 0.1 + 0.5 * pictures.smooth_noise(SIDE, SIDE, 48, 3)[..., None] * np.array([1.0, 0.8, 0.6])
    brick = np.where(reliefs.courses(SIDE)[..., None] > 0, [0.42, 0.16, 0.1], [0.45, 0.42, 0.38])
    patches = 0.25 + 0.5 * pictures.smooth_noise(SIDE, SIDE, 64, 5)
    return {
        "mossy rock": rock,
        "rust": rust,
        "hills": Material(gaussian_filter(reliefs.hills(SIDE, 1), 1), paint, np.full((SIDE, SIDE), 0.9)),
        "stones": Material(gaussian_filter(reliefs.stones(SIDE, 1), 1), paint, patches),
        "wet rock": Material(rock.heights, rock.albedo, np.full((SIDE, SIDE), 0.3)),
        "glazed bricks": Material(gaussian_filter(reliefs.courses(SIDE), 1), brick, np.full((SIDE, SIDE), 0.3)),
    }


def _scan(name: str, slope: float) -> Material:
    """A scanned material at a quarter of its size, whose heights have this root mean square slope."""
    maps = {kind: _map(name, kind) for kind in ("albedo", "height", "roughness")}
    heights = gaussian_filter(maps["height"][..., 0], 1)
    down, right = np.gradient(heights)
    heights *= slope / np.sqrt((down**2 + right**2).mean())
    return Material(heights, maps["albedo"] ** 2.2, np.clip(maps["roughness"][..., 0], 0.05, 1))


def _map(name: str, kind: str) -> np.ndarray:
    buffer = oiio.ImageBuf(str(data_folder() / "pbr" / name / f"{name}_{kind}.jpg"))
    values = buffer.get_pixels("float")[: 4 * SIDE, : 4 * SIDE]
    return values.reshape(SIDE, 4, SIDE, 4, -1).mean((1, 3)).astype(np.float64)


def photos(name: str, cache: Path) -> np.ndarray:
    """The 17 renders of a material, (17, side, side, 3) float32, the unused light last; rendered if not in `cache`."""
    path = cache / f"{name.replace(' ', '_')}.npz"
    if not path.exists():
        cache.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(path, photos=_rendered(materials()[name]))
    return np.load(path)["photos"]


def noisy(photo: np.ndarray, seed: int) -> np.ndarray:
    """A photo with the shot noise of a sensor whose white has a signal-to-noise ratio of 100."""
    grain = np.random.default_rng(seed).normal(0, 0.01, photo.shape)
    return np.maximum(photo + grain * np.sqrt(np.maximum(photo, 0) + 1e-3), 0).astype(np.float32)


def _rendered(material: Material) -> np.ndarray:
    import mitsuba  # not a dependency

    mitsuba.set_variant("scalar_rgb")
    y, x = np.mgrid[:SIDE, :SIDE]
    places = np.stack([x + 0.5 - SIDE / 2, SIDE / 2 - y - 0.5, material.heights], -1)
    corner = (np.arange(SIDE - 1)[:, None] * SIDE + np.arange(SIDE - 1)).ravel()
    below, after = corner + SIDE, corner + 1
    faces = np.concatenate([np.stack([corner, below, after], 1), np.stack([after, below, below + 1], 1)])

    def texture(values: np.ndarray) -> dict[str, object]:
        return {"type": "bitmap", "bitmap": mitsuba.Bitmap(values.astype(np.float32)), "raw": True}

    properties = mitsuba.Properties()
    properties["bsdf"] = mitsuba.load_dict(
        {
            "type": "principled",
            "base_color": texture(material.albedo),
            "roughness": texture(material.roughness[..., None]),
            "specular": 0.5,
        }
    )
    mesh = mitsuba.Mesh("surface", SIDE * SIDE, len(faces), properties, True, True)
    values = mitsuba.traverse(mesh)
    values["vertex_positions"] = places.ravel().astype(np.float32)
    values["vertex_normals"] = material.normals.ravel().astype(np.float32)
    values["vertex_texcoords"] = np.stack([(x + 0.5) / SIDE, (y + 0.5) / SIDE], -1).ravel().astype(np.float32)
    values["faces"] = faces.ravel().astype(np.uint32)
    values.update()
    return np.stack([_lit(mitsuba, mesh, toward) for toward in (*lights(), UNUSED)])


def _lit(mitsuba: object, mesh: object, toward: np.ndarray) -> np.ndarray:
    """The mesh under one light that shows white as 1, (side, side, 3) float32."""
    moved = mitsuba.ScalarTransform4f
    camera = moved().look_at([0, 0, 1000], [0, 0, 0], [0, 1, 0]) @ moved().scale([SIDE / 2, SIDE / 2, 1])
    film = {"type": "hdrfilm", "width": SIDE, "height": SIDE, "pixel_format": "rgb", "rfilter": {"type": "box"}}
    light = {"type": "directional", "direction": list(map(float, -toward)), "irradiance": float(np.pi)}
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 4},
        "sensor": {"type": "orthographic", "to_world": camera, "film": film},
        "light": light,
        "mesh": mesh,
    }
    return np.array(mitsuba.render(mitsuba.load_dict(scene), spp=SAMPLES), np.float32)


if __name__ == "__main__":
    for each in materials():
        photos(each, Path(sys.argv[1]))
