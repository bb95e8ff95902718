# SPDX-License-Identifier: Apache-2.0
"""The pictures of studio.md and library.md in docs/how-to: a library of the test photos, its report in Chromium.

`python -m tools.docs.pictures.library [--keep FOLDER]`: a library in FOLDER is updated.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from oiiotex_studio.library.catalog import Catalog

from benchmarks.studio.library import RECIPE, write_photos
from oiiotex.surfaces.charts.tile_preview import repeated
from tests.conftest import data_folder
from tools.docs.pictures.layout import FOLDER, beside, write_jpeg

SHOWN = (("rusty_metal", "lit"), ("mossy_rock", "lit"), ("clover_lawn_003", "compared"),
         ("bark_flaky_000", "compared"))  # fmt: skip
PHOTOS, SIZE = 12, 512
WIDTH, HEIGHT = 1720, 1040  # px of the window
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
FLAGS = ("--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking", "--hide-scrollbars")


def write_materials(folder: Path) -> None:
    """The materials of several maps, half as large: normals are kept as they are, their lengths say it."""
    for path in sorted((data_folder() / "pbr").rglob("*.jpg")):
        small = oiio.ImageBufAlgo.resize(oiio.ImageBuf(str(path)), roi=oiio.ROI(0, SIZE, 0, SIZE))
        small.write(str(folder / f"{path.stem}.png"), "uint8")


def photographed(page: Path, target: Path) -> None:
    """A page as the browser shows it."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        raise SystemExit("no Chromium: apt install chromium")
    with tempfile.TemporaryDirectory() as scratch:
        picture = Path(scratch, "page.png")
        flags = [*FLAGS, f"--user-data-dir={scratch}/profile", f"--window-size={WIDTH},{HEIGHT}"]
        command = [browser, *flags, f"--screenshot={picture}", page.resolve().as_uri()]
        subprocess.run(command, check=True, capture_output=True, timeout=120)
        shown = oiio.ImageBuf(str(picture))
        shown.specmod().attribute("Compression", "jpeg:80")
        oiio.ImageBufAlgo.channels(shown, (0, 1, 2)).write(str(target))


def shown(library: Path, name: str, picture: str) -> np.ndarray:
    """A picture of an asset, 256 px high."""
    with Catalog(library) as catalog:
        asset = catalog.asset(name)
    assert asset is not None
    path = library / asset.folder / f"{picture}.jpg"
    pixels = oiio.ImageBuf(str(path)).get_pixels(oiio.UINT8)
    return np.rint(repeated(pixels, 1, 256)).astype(np.uint8)


def main() -> None:
    """Make the library, then its picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--keep", type=Path, help="folder of the library, kept and updated")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = (given.keep or Path(scratch)).resolve()
        if not (folder / "photos").is_dir():
            write_photos(folder / "photos", PHOTOS, SIZE)
        write_materials(folder / "photos")
        (folder / "recipe.toml").write_text(RECIPE)
        program = [sys.executable, "-m", "oiiotex_studio.library.main"]
        line = [*program, "ingest", "photos", "library", "--recipe", "recipe.toml"]
        done = subprocess.run(line, cwd=folder)
        assert done.returncode in (0, 3), done
        photographed(folder / "library" / "report.html", FOLDER / "library_report.jpg")
        write_jpeg(beside(*(shown(folder / "library", *one) for one in SHOWN)), "library_materials.jpg")


if __name__ == "__main__":
    main()
