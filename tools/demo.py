# SPDX-License-Identifier: Apache-2.0
"""`make demo`: a real photograph becomes a tile.

By default it uses scikit-image's gravel, with a light gradient and a stain added, so that the effect is visible.
"""

from __future__ import annotations

import argparse
import os
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import OpenImageIO as oiio


def gravel() -> np.ndarray:
    """scikit-image's gravel photo, (512, 512) uint8 gray."""
    import skimage

    photo = oiio.ImageBuf(str(Path(skimage.__file__).parent / "data" / "gravel.png"))
    return photo.get_pixels(oiio.UINT8)[..., 0]


def stained(gray: np.ndarray) -> np.ndarray:
    """A photo with a light gradient and a stain.

    The mean light is 1, so sharpness and contrast compare with those of the clean photo. (h, w) -> (h, w, 3) uint8.
    """
    height, width = gray.shape
    y, x = np.mgrid[0:height, 0:width]
    y, x = y / height, x / width
    light = 1.0 + 0.6 * (0.8 * (0.5 - x) + 0.6 * (0.5 - y))
    spill = np.exp(-((((x - 0.66) / 0.14) ** 2 + ((y - 0.36) / 0.11) ** 2) ** 2))
    rust = np.array([0.82, 0.62, 0.42])
    rgb = gray[..., None] * light[..., None] * (1.0 - spill[..., None] * (1.0 - rust))
    return np.clip(rgb + 0.5, 0, 255).astype(np.uint8)


def save(pixels: np.ndarray, path: Path) -> None:
    """Write (h, w, c) uint8 as an sRGB image."""
    buffer = oiio.ImageBuf(oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], oiio.UINT8))
    buffer.set_pixels(buffer.roi, np.ascontiguousarray(pixels))
    if not buffer.write(str(path)):
        sys.exit(f"{path}: {buffer.geterror()}")


def preview(tile: Path, path: Path) -> None:
    """The tile laid out 2 x 2."""
    pixels = oiio.ImageBuf(str(tile)).get_pixels(oiio.UINT8)
    save(np.tile(pixels, (2, 2, 1)), path)


def main() -> None:
    """Make photo, tile and preview, and print their paths."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--photo", type=Path, help="your own photo")
    parser.add_argument("--out", type=Path, default=Path("demo-out"))
    arguments = parser.parse_args()
    out: Path = arguments.out
    out.mkdir(parents=True, exist_ok=True)
    photo = arguments.photo
    if photo is None:
        photo = out / "photo.png"
        save(stained(gravel()), photo)
    tile = out / "tile.png"
    program = os.path.relpath(Path(sys.executable).with_name("oiiotex"))  # works without activating the environment
    command = [program, "-v", str(photo), "--texstationarize:seed=7", "-d", "uint8", "-o", str(tile)]
    print(shlex.join(command), flush=True)
    if subprocess.run(command).returncode != 0:
        sys.exit(1)
    preview(tile, out / "preview_2x2.png")
    print(f"photo:        {photo}\ntile:         {tile}\n2x2 preview:  {out / 'preview_2x2.png'}")


if __name__ == "__main__":
    main()
