# SPDX-License-Identifier: Apache-2.0
"""Maps of --texcapture from rendered photos of six known materials, compared with what was rendered.

python -m benchmarks.captures.accuracy CACHE [--lights given|found]

CACHE holds the renders of `benchmarks.captures.rendered`. Normals: mean angle, degrees. Bands: standard deviations of
the albedo in Lab, blurred with sigma L/96, L/48 and L/24, relative to the truth, and the median of the albedo relative
to it. Relit: the photo under an unused light, as the maps predict it (matte, GGX of 4 % with the captured roughness,
shadows of the captured heights), against the render, both clipped to white; dB below it. Four photos tell no
roughness: .6 is assumed. Roughness: mean absolute error. Borders of 8 px
are not compared: the rendered surface ends there.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from skimage import color

from benchmarks.captures.rendered import COUNT, GLOSSY, UNUSED, Material, lights, materials, noisy, photos
from benchmarks.tiles.drifts import band_energies
from oiiotex import filters
from oiiotex.engine.errors import ImageError
from tests.any_filter import buffer, pixels
from tests.reference import captures

INNER = (slice(8, -8), slice(8, -8))
ROUGH = 6  # photos


def row(name: str, material: Material, seen: np.ndarray, count: int, found: bool) -> str:
    """A row of the table."""
    chosen = np.arange(0, COUNT, COUNT // count)
    shots = [buffer(noisy(seen[n], n), space="lin_rec709_scene") for n in chosen]
    more = {} if found else {"lights": lights()[chosen].ravel()}
    head = f"| {name}{' (glossy)' if name in GLOSSY else ''} | {count} "
    try:
        albedo, normal, height, *rest = filters.capture(*shots, roughness=count >= ROUGH, **more)
    except ImageError as error:
        return f"{head}| refused: {error.problem} | | | | |"
    normals = pixels(normal) * 2 - 1
    angle = captures.degrees_between(normals, material.normals)[INNER].mean()
    made, truth = (np.clip(each[INNER], 0, 1) for each in (pixels(albedo), material.albedo))
    labs = [color.rgb2lab(color_of(each)) for each in (made, truth)]
    bands = np.divide(*(band_energies(lab, len(lab), False) for lab in labs))
    ratio = np.median(made / np.maximum(truth, 1e-3))
    roughness = pixels(rest[0])[..., 0] if rest else np.full(normals.shape[:2], 0.6)
    error = f"{np.abs(roughness - material.roughness)[INNER].mean():.2f}" if rest else ""
    heights = pixels(height)[..., 0] * height.spec().getattribute("oiiotex:heightpx")
    relit = np.maximum(0, normals @ UNUSED)[..., None] * pixels(albedo)
    relit = relit + captures.highlight(normals, UNUSED, roughness)[..., None]
    relit = relit * captures.shadowed(heights, UNUSED)[..., None]
    decibels = -10 * np.log10(((np.clip(relit, 0, 1) - np.clip(seen[-1], 0, 1))[INNER] ** 2).mean())
    written = ", ".join(f"{each:.2f}" for each in bands)
    return f"{head}| {angle:.1f} | {written} | {ratio:.2f} | {decibels:.1f} | {error} |"


def color_of(linear: np.ndarray) -> np.ndarray:
    """sRGB of linear values."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("cache", type=Path)
    parser.add_argument("--lights", choices=("given", "found"), default="given")
    given = parser.parse_args()
    print("| material | photos | normals | bands | albedo | relit | roughness |\n|---|---|---|---|---|---|---|")
    for name, material in materials().items():
        seen = photos(name, given.cache)
        for count in (4, 8, 16) if given.lights == "given" else (8, 16):
            print(row(name, material, seen, count, given.lights == "found"), flush=True)


if __name__ == "__main__":
    main()
