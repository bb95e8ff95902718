# SPDX-License-Identifier: Apache-2.0
"""Mosaics of 2 to 12 textures with exact truth, drawn at random: one half to tune parameters, one to judge them.

Kinds alternate: photos in color, photos in gray, procedural textures in gray, procedural and photographed ones in
color, two photos in many small patches (with fine or soft borders), one photo in four versions (rotated, scaled), and
five photos in gray. The halves have no photo and no procedural texture in common. Photos come from
`$OIIOTEX_TEST_DATA` and from scikit-image's wheel. Fields are Voronoi cells with straight or wavy borders, or four
quarters around a disc; patches are where smooth noise is above a level.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Iterator

import numpy as np
import OpenImageIO as oiio
from scipy.ndimage import gaussian_filter, map_coordinates, rotate, zoom
from scipy.spatial import cKDTree

from benchmarks.labels.levels import Case
from benchmarks.shared.measures import data_folder
from oiiotex.engine.core.image import from_buffer

SIDE = 512
KINDS = (
    "photos color", "photos gray", "drawn gray", "all color", "patches fine", "patches soft", "versions", "five gray",
)  # fmt: skip
_SETS = {
    "tune": (
        "photos/clover_lawn.jpg", "photos/facade_tiles.jpg", "photos/pebbles_beach_shadow.jpg",
        "photos/roof_slates.jpg",
        "photos/sandstone_wall_cracked.jpg", "photos/fabric_gingham_weave.jpg", "photos/moss_grass_stones_ground.jpg",
        "photos/stained_plaster_wall.jpg", "multiscale/sand_grain_ladder/sand_0355um.jpg",
        "multiscale/sand_grain_ladder/sand_1400um.jpg", "skimage/brick.png", "skimage/grass.png",
        "pbr/mossy_rock/mossy_rock_albedo.jpg", "multiscale/mars/mars_s1.jpg",
    ),
    "judge": (
        "photos/bark_flaky.jpg", "photos/castle_brick_broken.jpg", "photos/drone_forest_canopy.jpg",
        "photos/flower_meadow_stones.jpg", "photos/stone_breccia.jpg", "photos/rust_barrel_side.jpg",
        "photos/rebar_concrete_decayed.jpg", "photos/onyx_veins.jpg", "photos/chalkboard_scratched.jpg",
        "multiscale/sand_grain_ladder/sand_0710um.jpg", "skimage/gravel.png", "pbr/rusty_metal/rusty_metal_albedo.jpg",
        "multiscale/map1800_bobruisk/map_bobruisk_z3.jpg", "photos/marble_tiles_4x4.jpg",
    ),
}  # fmt: skip

_DIRECTED = {  # of which a turned version can be told
    "tune": ("photos/roof_slates.jpg", "photos/sandstone_wall_cracked.jpg", "skimage/brick.png"),
    "judge": ("photos/bark_flaky.jpg", "photos/castle_brick_broken.jpg", "photos/marble_tiles_4x4.jpg"),
}


def suite(half: str, count: int = 40, first: int = 0) -> Iterator[Case]:
    """Mosaics `first` .. `first + count - 1` of the half: "tune" or "judge"."""
    for seed in range(first, first + count):
        yield mosaic(half, seed)


def mosaic(half: str, seed: int) -> Case:
    """One of them; the kind follows from the seed."""
    kind = KINDS[seed % len(KINDS)]
    random = np.random.default_rng([seed, half == "judge"])
    photos = random.permutation(len(_SETS[half])).tolist()
    if "patches" in kind:
        fields, cover = _patches(random, "soft" in kind)
        one, other = (_piece(_SETS[half][photos.pop()], random) for _ in range(2))
        picture = other + (one - other) * cover[..., None]
    elif kind == "versions":
        fields = _fields(4, random)
        picture = _pictured(fields, _versions(str(random.choice(_DIRECTED[half])), random))
    else:
        many = 5 if "five" in kind else int(random.integers(3, 13 if "all" in kind else 8))
        fields = _fields(many, random)
        looks = (
            _drawn(random)
            if kind.startswith("drawn") or ("all" in kind and (n % 2 == 1 or not photos))
            else _piece(_SETS[half][photos.pop()], random)
            for n in range(many)
        )
        picture = _pictured(fields, looks)
    if "gray" in kind:
        picture[:] = picture.mean(-1, keepdims=True)
    spec = oiio.ImageSpec(SIDE, SIDE, 3, oiio.FLOAT)
    spec.attribute("oiio:ColorSpace", "srgb_rec709_scene")
    buffer = oiio.ImageBuf(spec)
    buffer.set_pixels(buffer.roi, np.ascontiguousarray(np.rint(np.clip(picture, 0, 1) * 255) / 255, np.float32))
    return Case(f"{half} {seed:02d} {kind}", from_buffer(buffer), fields + 1)


def _pictured(fields: np.ndarray, looks: Iterable[np.ndarray]) -> np.ndarray:
    """Of every field the texture that is its own."""
    picture = np.zeros((*fields.shape, 3), np.float32)
    for n, look in enumerate(looks):
        picture[fields == n] = look[fields == n]
    return picture


def _patches(random: np.random.Generator, soft: bool) -> tuple[np.ndarray, np.ndarray]:
    """Fields 0 and 1 in many small patches, and how much of field 0's texture is seen: a border is a ramp of 2 px,
    or of up to 12 where `soft`."""
    height = _smooth(random, random.uniform(18, 30) if soft else random.uniform(9, 18))
    within = height > np.quantile(height, random.uniform(0.4, 0.7))
    cover = gaussian_filter(within.astype(np.float32), random.uniform(4, 12) if soft else 2.0)
    return (cover <= 0.5).astype(np.int64), cover


def _versions(name: str, random: np.random.Generator) -> Iterator[np.ndarray]:
    """One photo as it is, at about half its size, turned by a right angle, and by half of one."""
    piece = _piece(name, random)
    yield piece
    smaller = zoom(piece, (0.55, 0.55, 1), order=1)
    yield np.pad(smaller, [(0, SIDE - s) for s in smaller.shape[:2]] + [(0, 0)], mode="symmetric")
    yield np.rot90(piece)
    yield rotate(piece, 45, order=1, reshape=False, mode="mirror")


def _fields(count: int, random: np.random.Generator) -> np.ndarray:
    """(SIDE, SIDE) fields 0 .. count - 1, each with a fair share."""
    y, x = np.mgrid[0:SIDE, 0:SIDE] / SIDE
    strength = random.choice([0.0, 0.03, 0.08])
    waves = [gaussian_filter(random.normal(size=(SIDE, SIDE)), 30) for _ in range(2)]
    y, x = (c + strength * w / max(w.std(), 1e-9) for c, w in zip((y, x), waves, strict=True))
    if count == 5 and random.random() < 0.5:
        disc = (y - 0.5) ** 2 + (x - 0.5) ** 2 < 0.25**2
        return np.where(disc, 4, 2 * (y > 0.5) + (x > 0.5))
    while True:
        fields = cKDTree(random.random((count, 2))).query(np.stack([y, x], -1))[1]
        if np.bincount(fields.ravel(), minlength=count).min() > 0.35 / count * SIDE * SIDE:
            return fields


# --- photos ---


@functools.cache
def _photo(name: str) -> np.ndarray:
    if name.startswith("skimage/"):
        import skimage.data

        pixels = getattr(skimage.data, name[8:-4])()[..., None] / np.float32(255)
    else:
        pixels = oiio.ImageBuf(str(data_folder() / name)).get_pixels(oiio.FLOAT)[..., :3]
    return np.repeat(pixels, 3, axis=2) if pixels.shape[2] == 1 else pixels


def _piece(name: str, random: np.random.Generator) -> np.ndarray:
    """A piece at full or half size, in one of eight positions; mirrored where the photo is smaller than the mosaic."""
    photo = _photo(name)
    if min(photo.shape[:2]) > 700 and random.random() < 0.75:
        photo = photo[: photo.shape[0] // 2 * 2, : photo.shape[1] // 2 * 2]
        photo = (photo[::2, ::2] + photo[1::2, ::2] + photo[::2, 1::2] + photo[1::2, 1::2]) / 4
    photo = np.pad(photo, [(0, max(0, SIDE - s)) for s in photo.shape[:2]] + [(0, 0)], mode="symmetric")
    top, left = (random.integers(0, s - SIDE + 1) for s in photo.shape[:2])
    piece = photo[top : top + SIDE, left : left + SIDE]
    piece = np.rot90(piece, random.integers(4))
    return piece[::-1] if random.random() < 0.5 else piece


# --- textures drawn by code ---


def _drawn(random: np.random.Generator) -> np.ndarray:
    """A texture of random kind, size, direction, contrast and color, (SIDE, SIDE, 3) in 0 .. 1."""
    make: Callable = _LOOKS[random.integers(len(_LOOKS))]
    gray = make(random)
    gray = (gray - gray.mean()) / max(gray.std(), 1e-6)
    gray = gray + random.uniform(0, 0.4) * random.normal(size=gray.shape)
    middle = random.uniform(0.3, 0.7) + random.uniform(-0.12, 0.12, 3)
    away = random.uniform(0.05, 0.18) * (1 + random.uniform(-0.5, 0.5, 3))
    return np.clip(middle + away * gray[..., None], 0, 1).astype(np.float32)


def _turned(random: np.random.Generator, wobble: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates in px of a plane that is turned, and warped by up to about `wobble` px."""
    y, x = np.mgrid[0:SIDE, 0:SIDE].astype(float)
    y, x = (c + wobble * _smooth(random, 12) for c in (y, x))
    angle = random.uniform(0, np.pi)
    return x * np.sin(angle) + y * np.cos(angle) + 1e4, x * np.cos(angle) - y * np.sin(angle) + 1e4


def _smooth(random: np.random.Generator, sigma: float | tuple[float, float]) -> np.ndarray:
    noise = gaussian_filter(random.normal(size=(SIDE, SIDE)), sigma, mode="wrap")
    return noise / noise.std()


def _grain(random: np.random.Generator) -> np.ndarray:
    """Noise of one size: sand, plaster, granite."""
    size = random.uniform(0.5, 5)
    noise = _smooth(random, size) - random.uniform(0, 1) * _smooth(random, 2 * size)
    return noise if random.random() < 0.5 else np.tanh(3 * noise)


def _fibres(random: np.random.Generator) -> np.ndarray:
    """Noise drawn out in one direction: wood, fur, brushed metal."""
    long = gaussian_filter(random.normal(size=(2 * SIDE, 2 * SIDE)), (random.uniform(0.7, 3), random.uniform(5, 25)))
    v, u = (c - 1e4 for c in _turned(random, random.uniform(0, 3)))
    return map_coordinates(long, [v + SIDE, u + SIDE], order=1, mode="grid-wrap")


def _waves(random: np.random.Generator) -> np.ndarray:
    """Noise around one wavelength, in one direction or all."""
    v, u = np.meshgrid(np.fft.fftfreq(SIDE), np.fft.fftfreq(SIDE), indexing="ij")
    wave, angle = 1 / random.uniform(4, 24), random.uniform(0, np.pi)
    ring = np.exp(-(((np.hypot(v, u) - wave) / (0.2 * wave)) ** 2))
    turned = np.abs(np.cos(np.arctan2(v, u) - angle)) ** random.choice([0, 2, 20])
    return np.fft.ifft2(np.fft.fft2(random.normal(size=(SIDE, SIDE))) * ring * turned).real


def _weave(random: np.random.Generator) -> np.ndarray:
    """Threads over and under each other: canvas, carpet, baskets."""
    v, u = _turned(random, random.uniform(0, 2))
    p, q = random.uniform(5, 20), random.uniform(5, 20)
    over = (np.floor(v / p) + np.floor(u / q)) % 2 > 0
    return np.where(over, np.sin(np.pi * (v / p % 1)), random.uniform(0.3, 1) * np.sin(np.pi * (u / q % 1)))


def _stones(random: np.random.Generator) -> np.ndarray:
    """Cells around random points, shaded, with dark joints: pebbles, leather, cracks."""
    size, jitter = random.uniform(6, 26), random.uniform(0.3, 1)
    n = int(SIDE / size) + 4
    points = np.stack(np.mgrid[0:n, 0:n], -1).reshape(-1, 2) - 1.5 + jitter * (random.random((n * n, 2)) - 0.5)
    distance, nearest = cKDTree(points * size).query(np.stack(np.mgrid[0:SIDE, 0:SIDE], -1), k=2)
    shade = random.uniform(0, 1) * random.random(n * n)[nearest[..., 0]]
    return shade + np.minimum((distance[..., 1] - distance[..., 0]) / size / random.uniform(0.1, 1), 1)


def _spots(random: np.random.Generator) -> np.ndarray:
    """Noise above a level: flecks, lichen, cork."""
    return (_smooth(random, random.uniform(1.5, 6)) > random.uniform(-1, 1)).astype(float)


def _wall(random: np.random.Generator) -> np.ndarray:
    """Courses of bricks or tiles, each with another shade."""
    v, u = _turned(random, random.uniform(0, 1.5))
    high, wide = random.uniform(6, 20), random.uniform(8, 40)
    row = np.floor(v / high)
    along = u / wide + random.choice([0, 0.5]) * (row % 2)
    shades = random.random(1 << 16)
    shade = shades[((row * 7919 + np.floor(along) * 104729) % (1 << 16)).astype(int)]
    joint = (v / high % 1 < 1.5 / high) | (along % 1 < 1.5 / wide)
    return np.where(joint, random.choice([-0.7, 1.7]), random.uniform(0.2, 1) * shade)


_LOOKS = (_grain, _fibres, _waves, _weave, _stones, _spots, _wall)
