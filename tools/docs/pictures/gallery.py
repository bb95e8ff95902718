# SPDX-License-Identifier: Apache-2.0
"""Pictures of docs/gallery.md, made by the lines on it: `python -m tools.docs.pictures.gallery [PICTURE ...]`."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import skimage

from benchmarks.shared.measures import data_folder
from tests.lattices import regular
from tests.masonry import ashlar
from tools.demo import save
from tools.docs.pictures.layout import FOLDER, beside, pixels, shrunk, twice, write_jpeg

SIDE = 384  # px, longer side of the photo and of the tile laid out
MOST_BYTES = 60_000


def entries() -> list[tuple[str, str]]:
    """Pictures of the page, and their lines."""
    page = (FOLDER.parent / "gallery.md").read_text()
    return re.findall(r"\]\(pictures/(\w+\.jpg)\)\n\n```\n(oiiotex .+)\n```\n\n\S", page)


def collect(folder: Path) -> None:
    """Put the photos that there are, and the drawn ones, where lines find them."""
    for file in (Path(skimage.__file__).parent / "data" / "brick.png", *data_folder().rglob("*.jpg")):
        if not (folder / file.name).exists():
            (folder / file.name).symlink_to(file.resolve())
    drawn = {"ashlar": ashlar(512, 512, 3, (36, 80), 5)[0], "parquet": regular("parquet", 192, 192, 1)}
    for name, picture in drawn.items():
        save(np.rint(255 * np.clip(picture, 0, 1)).astype(np.uint8), folder / f"{name}.png")


def make(picture: str, line: str, folder: Path) -> None:
    """Run the line, and write photo and tile side by side."""
    words = shlex.split(line)[1:]
    if not (folder / words[0]).is_file():
        print(f"no {words[0]}: its picture stays as it is")
        return
    command = [sys.executable, "-m", "oiiotex", "--noprogress", "-v", *words]
    subprocess.run(command, cwd=folder, check=True)
    photo, tile = (oiio.ImageBuf(str(folder / name)) for name in (words[0], words[-1]))
    sheet = beside(pixels(shrunk(photo, SIDE)), twice(pixels(shrunk(tile, SIDE // 2))))
    for quality in range(80, 20, -5):
        write_jpeg(sheet, picture, quality)
        if (FOLDER / picture).stat().st_size <= MOST_BYTES:
            return


def main() -> None:
    """Make all, or those that are named."""
    with tempfile.TemporaryDirectory() as folder:
        collect(Path(folder))
        for picture, line in entries():
            if not sys.argv[1:] or picture in sys.argv[1:]:
                make(picture, line, Path(folder))


if __name__ == "__main__":
    main()
