# SPDX-License-Identifier: Apache-2.0
"""The notebook of the docs, docs/start/first-tile.ipynb: `python -m tools.docs.notebook` writes it, without outputs."""

from __future__ import annotations

import json
from pathlib import Path

NOTEBOOK = Path(__file__).parents[2] / "docs" / "start" / "first-tile.ipynb"
CELLS = (  # Markdown begins with #
    """\
# The first tile

A photo of gravel becomes a tile. The photo comes with scikit-image. To use your own, put its file name instead:
`photo = "photo.png"`.""",
    """\
from skimage import data

from oiiotex import filters

SRGB = "srgb_rec709_scene"  # arrays do not name their color space
photo = data.gravel()[:256, :256]
tile = filters.stationarize(photo, colorspace=SRGB, seed=7)
tile""",
    """\
## Look at the repeats

If your eye finds the same stone at regular distances, the tile is too small or too uneven.""",
    'filters.preview(tile, panels=["3x3", "plane"])',
    """\
## Compare seeds

Every seed gives another tile, and always the same one. A list of results is shown as pictures.""",
    "[filters.stationarize(photo, colorspace=SRGB, seed=seed) for seed in range(3)]",
    """\
## Ask for more than the tile

`st=True` adds the place in the photo that each pixel was copied from. The result is a dict of parts by name.
`filters.stationarity` maps how far each neighborhood is from the average: dark is good.""",
    """\
parts = filters.stationarize(photo, colorspace=SRGB, seed=7, st=True)
parts["deviation"] = filters.stationarity(parts["tile"])
parts""",
    """\
## Save it

A result is an OpenImageIO `ImageBuf`. `tile.get_pixels()` is a NumPy array. `help(filters.stationarize)` lists all
parameters.""",
    'tile.write("tile.png")',
)


def text() -> str:
    """The whole file: nbformat 4.5."""
    cells = [
        {"cell_type": "markdown", "id": f"cell-{n}", "metadata": {}, "source": cell.splitlines(True)}
        if cell.startswith("#")
        else {
            "cell_type": "code", "execution_count": None, "id": f"cell-{n}", "metadata": {}, "outputs": [],
            "source": cell.splitlines(True),
        }
        for n, cell in enumerate(CELLS)
    ]  # fmt: skip
    kernel = {"kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"}}
    return json.dumps({"cells": cells, "metadata": kernel, "nbformat": 4, "nbformat_minor": 5}, indent=1) + "\n"


def main() -> None:
    """Write it."""
    NOTEBOOK.write_text(text())
    print(NOTEBOOK)


if __name__ == "__main__":
    main()
