# SPDX-License-Identifier: Apache-2.0
"""Tiles judged by TexTile (Rodriguez-Pardo et al., CVPR 2024), with weights that you supply; needs a GPU with CUDA.

TEXTILE_PYTHON benchmarks/tilebench/textile_judge.py WEIGHTS FOLDER

Prints a JSON object: for every FOLDER/PHOTO--TOOL.png, TexTile's figure of it laid out 2 x 2, from 0 (a seam or a
repeat shows) to 1. The package textile-metric must be installed in that Python.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path


def main(weights: str, folder: str) -> None:
    """Judge and print."""
    import textile
    import torch
    from textile.utils.image_utils import read_and_process_image

    judge = textile.Textile(model_path=weights)
    with torch.no_grad():
        tiles = sorted(Path(folder).glob("*--*.png"))
        print(json.dumps({tile.name: float(judge(read_and_process_image(str(tile)))) for tile in tiles}))


if __name__ == "__main__":
    main(*sys.argv[1:])
