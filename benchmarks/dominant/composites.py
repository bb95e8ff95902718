# SPDX-License-Identifier: Apache-2.0
"""The dominant texture against known outliers: twelve composites, IoU and precision of the mask, by mode and rule.

python -m benchmarks.dominant.composites [--modes diffusion,euclidean,spectral] [--pictures DIR] [--step N] [--seed N]

Composites are 125 x 94 px, the paper's size: a test texture or a photo, covered with outliers as in the paper's
figures: objects, scratches and cracks, shadows, rust, dirt, growth. Truth is the uncovered area.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from scipy.ndimage import gaussian_filter

from benchmarks.shared.collages import _photo
from oiiotex.analysis.dominant.diffusion import dominant_mask, dominant_texture
from oiiotex.analysis.dominant.refinement import pixel_colors, refined_mask
from oiiotex.engine.color.lab import lens_of
from oiiotex.engine.color.lab_reduced import LabPixels, lab_pixels
from oiiotex.engine.core.image import Image, from_buffer
from oiiotex.engine.session import Session
from oiiotex.engine.session.progress import Progress
from tests import pictures

HEIGHT, WIDTH = 94, 125
BASES = ("bricks", "pebbles", "moss", "clover_lawn.jpg", "stone_breccia.jpg", "fabric_gingham_weave.jpg")
KINDS = ("pipe", "window", "scratches", "cracks", "shadow", "rust", "dirt", "growth")
TWELVE = (
    ("bricks", "pipe"), ("bricks", "growth"), ("bricks", "shadow"), ("moss", "window"), ("moss", "rust"),
    ("pebbles", "scratches"), ("pebbles", "dirt"), ("clover_lawn.jpg", "pipe"), ("clover_lawn.jpg", "rust"),
    ("stone_breccia.jpg", "window"), ("fabric_gingham_weave.jpg", "dirt"), ("bricks", "cracks"),
)  # fmt: skip


def base(name: str, seed: int) -> np.ndarray:
    """(94, 125, 3) of one texture."""
    if hasattr(pictures, name):
        return getattr(pictures, name)(HEIGHT, WIDTH, seed)
    photo = _photo(name, False)
    photo = photo[: photo.shape[0] // 4 * 4, : photo.shape[1] // 4 * 4]
    small = photo.reshape(photo.shape[0] // 4, 4, photo.shape[1] // 4, 4, 3).mean((1, 3))
    return small[40 + seed // 100 * 37 :, 30 + seed // 100 * 41 :][:HEIGHT, :WIDTH]


def outliers(kind: str, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """An outlier over a texture: (94, 125, 3) color, (94, 125) coverage 0 to 1, and its mask in the truth."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH].astype(float)
    color = np.zeros((HEIGHT, WIDTH, 3))
    noise = pictures.noise(HEIGHT, WIDTH, seed, 51)[..., None]
    blob = pictures.smooth_noise(HEIGHT, WIDTH, 22, seed, 52)
    fine = pictures.smooth_noise(HEIGHT, WIDTH, 4, seed, 53)
    cover = np.zeros((HEIGHT, WIDTH))
    if kind == "pipe":
        across = np.abs(x - 84 - 0.05 * y) / 8
        cover = (across < 1).astype(float)
        color[:] = 0.25 + 0.45 * np.sqrt(np.clip(1 - across**2, 0, 1))[..., None] + 0.02 * noise
    elif kind == "window":
        cover = ((np.abs(x - 40) < 17) & (np.abs(y - 42) < 20)).astype(float)
        frame = (np.abs(x - 40) > 14) | (np.abs(y - 42) > 17) | (np.abs(x - 40) < 2)
        color[:] = np.where(frame[..., None], [0.9, 0.9, 0.85], [0.1, 0.14, 0.2]) + 0.02 * noise
    elif kind in ("scratches", "cracks"):
        for n in range(4):
            slope, start = np.random.default_rng([seed, n]).uniform([-0.8, 5], [0.8, 90])
            bend = (6 * (pictures.smooth_noise(HEIGHT, WIDTH, 10, seed, 60 + n) - 0.5)) if kind == "cracks" else 0
            cover = np.maximum(cover, np.abs(y - start - slope * (x - 60) + bend) < 1.6)
        color[:] = (0.97 if kind == "scratches" else 0.03) + 0.02 * (noise - 0.5)
    elif kind == "shadow":
        cover = 0.75 * gaussian_filter((x + 0.4 * y > 112).astype(float), 1.5)
    else:
        cover = gaussian_filter((blob > np.quantile(blob, 0.78)).astype(float), 1.0) * (0.9 if kind != "dirt" else 0.8)
        shade = {"rust": [0.5, 0.2, 0.06], "dirt": [0.16, 0.12, 0.09], "growth": [0.12, 0.35, 0.08]}[kind]
        color[:] = np.array(shade) * (0.6 + 0.8 * fine[..., None])
    return np.clip(color, 0, 1), cover, cover > 0.3


def composite(number: int, seed: int = 0) -> tuple[str, np.ndarray, np.ndarray]:
    """Name, picture, and where its texture is dominant; other seeds move textures and outliers."""
    name, kind = TWELVE[number]
    color, cover, there = outliers(kind, number + 100 * seed)
    picture = base(name, number + 100 * seed) * (1 - cover[..., None]) + color * cover[..., None]
    return f"{name.removesuffix('.jpg')}_{kind}", picture, ~there


def seen_as(picture: np.ndarray, session: Session) -> LabPixels:
    """A picture (h, w, 3) in sRGB as the filter sees it."""
    spec = oiio.ImageSpec(picture.shape[1], picture.shape[0], 3, oiio.FLOAT)
    spec.attribute("oiio:ColorSpace", "srgb_rec709_scene")
    buffer = oiio.ImageBuf(spec)
    buffer.set_pixels(buffer.roi, np.ascontiguousarray(picture, np.float32))
    image = from_buffer(buffer)
    return lab_pixels(image, lens_of(image, session.resources), session.resources)


def mask_by(image: Image, mode: str, step: int | None = None, patch: int | None = None) -> np.ndarray:
    """Mask (h, w) bool of the dominant texture of an image, by a way to compare its patches."""
    resources = Session().resources
    pixels = lab_pixels(image, lens_of(image, resources), resources)
    found = dominant_texture(pixels, resources, Progress(), mode=mode, step=step, patch=patch)
    return refined_mask(found, pixels, pixel_colors(pixels))


def main() -> None:
    """Measure and print tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--modes", default="diffusion")
    parser.add_argument("--rules", default="repaired")
    parser.add_argument("--step", type=int)
    parser.add_argument("--seed", type=int, default=0, help="seed of the composites; 0: those used for tuning")
    parser.add_argument("--pictures", type=Path)
    arguments = parser.parse_args()
    session = Session()
    for mode in arguments.modes.split(","):
        for rule in arguments.rules.split(","):
            rows = []
            for n in range(len(TWELVE)):
                name, picture, truth = composite(n, arguments.seed)
                pixels = seen_as(picture, session)
                start = time.process_time()
                found = dominant_texture(
                    pixels, session.resources, session.progress, mode=mode, rule=rule, step=arguments.step
                )
                took = time.process_time() - start
                literal = rule == "paper"
                mask = (
                    dominant_mask(found, pixels.seen) if literal else refined_mask(found, pixels, pixel_colors(pixels))
                )
                iou = (mask & truth).sum() / max((mask | truth).sum(), 1)
                precision = (mask & truth).sum() / max(mask.sum(), 1)
                rows.append((iou, precision, took))
                kernel = found.kernel
                print(f"{name:32s} {mode} {rule} patch {found.texels.patch:2d} N {found.texels.count} IoU {iou:.3f}"
                      f" precision {precision:.3f} share {found.share:.2f} rounds {len(found.rounds)}"
                      f" d {kernel.dimension if kernel else 0:.1f} tau {found.steps} {took:.2f} s CPU"
                      f" {found.rejected}", flush=True)  # fmt: skip
                if arguments.pictures:
                    save(arguments.pictures / f"{name}_{mode}_{rule}.png", picture, mask, truth)
            mean = np.mean(rows, 0)
            print(f"mean {mode} {rule}: IoU {mean[0]:.3f} precision {mean[1]:.3f}, {mean[2]:.2f} s CPU\n")


def save(path: Path, picture: np.ndarray, mask: np.ndarray, truth: np.ndarray) -> None:
    """Picture, what the mask leaves of it, and what it should leave."""
    panes = [picture, picture * mask[..., None], picture * truth[..., None]]
    sheet = np.concatenate(panes, axis=1).astype(np.float32)
    buffer = oiio.ImageBuf(oiio.ImageSpec(sheet.shape[1], sheet.shape[0], 3, oiio.UINT8))
    buffer.set_pixels(buffer.roi, np.ascontiguousarray(sheet))
    path.parent.mkdir(parents=True, exist_ok=True)
    buffer.write(str(path))


if __name__ == "__main__":
    main()
