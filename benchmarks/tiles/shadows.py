# SPDX-License-Identifier: Apache-2.0
"""Cast shadows of known shape and color on even textures, before and after --texflatten, and by its shadows=1 alone.

python -m benchmarks.tiles.shadows [--side 384] [--half tune|judge] [--out FOLDER]

A texture is lit by a lamp and by a bluish sky (Guo, Dai and Hoiem 2011, equation 1): I = (k D + E) R per channel of
linear RGB, for the texture R, the lamp D, the sky E and the visible share k of the lamp, from 0 to 1 across the
penumbra. The right result is known: k = 1 everywhere. A result is right up to one exposure, so it is scaled to the
median of the texture outside the shadow. Textures are those of drifts.py, in the same halves: tune on one, report the
other.

Inside is k < .02, the border .02 to .98, outside the rest. Delta E is CIE76 of what is slower than L/96, band energies
are those of drifts.py. --out receives photo and result of each case side by side.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter
from skimage import color

from benchmarks.tiles import drifts
from benchmarks.tiles.first_tile import cell, picture
from oiiotex import filters
from oiiotex.engine.session import Session
from tools.demo import save
from tools.docs.pictures.layout import pixels

SKY = np.array([0.3, 0.34, 0.42])  # of the light of lamp and sky together, per channel
SOFT = {"sharp": 0.01, "soft": 0.04}  # sigma of the penumbra, relative to the side
CHANGED = 3.0  # delta E: a pixel outside that differs more has changed
GOALS = "delta E <= 3 inside, bands .9 to 1.1 across the border, <= 2 % outside changed"


def _disc(y: np.ndarray, x: np.ndarray) -> np.ndarray:
    return np.hypot((x - 0.4) / 0.3, (y - 0.55) / 0.25) < 1


def _branch(y: np.ndarray, x: np.ndarray) -> np.ndarray:
    return np.abs(y - 0.5 - 0.12 * np.sin(5 * x)) < 0.12


def _half(y: np.ndarray, x: np.ndarray) -> np.ndarray:
    return x + 0.2 * y < 0.5


SHAPES: dict[str, Callable[[np.ndarray, np.ndarray], np.ndarray]] = {"disc": _disc, "branch": _branch, "half": _half}


def visible(side: int, shape: str, softness: str) -> np.ndarray:
    """k: the visible share of the lamp, (side, side) float, 0 in the umbra."""
    y, x = np.mgrid[:side, :side] / side
    return gaussian_filter((~SHAPES[shape](y, x)).astype(float), SOFT[softness] * side, mode="nearest")


def shaded(clean: np.ndarray, k: np.ndarray) -> np.ndarray:
    """A texture, (h, w, 3) uint8 sRGB, in the light of lamp and sky."""
    linear = (clean / 255.0) ** 2.2 * (k[..., None] * (1 - SKY) + SKY)
    return np.rint(255 * linear ** (1 / 2.2)).astype(np.uint8)


def measured(result: np.ndarray, clean: np.ndarray, k: np.ndarray) -> dict[str, float]:
    """Delta E inside, the least and the largest band at the border, and the share of pixels outside that changed."""
    side = clean.shape[0]
    inside, border, outside = k < 0.02, (k >= 0.02) & (k <= 0.98), k > 0.98
    light, wanted = ((image / 255.0) ** 2.2 for image in (result, clean))
    light = light * (np.median(wanted[outside]) / max(np.median(light[outside]), 1e-6))
    labs = [color.rgb2lab(np.clip(image, 0, 1) ** (1 / 2.2)) for image in (light, wanted)]
    slow = [drifts.blurred(lab, side / 96, False) for lab in labs]
    away = np.sqrt(((slow[0] - slow[1]) ** 2).sum(-1))
    detail = [
        [drifts.blurred(lab, side / n, False) - drifts.blurred(lab, side / drifts.DRIFT, False) for n in drifts.BANDS]
        for lab in labs
    ]
    bands = [
        np.sqrt((a[border] ** 2).sum(-1).mean() / (b[border] ** 2).sum(-1).mean()) for a, b in zip(*detail, strict=True)
    ]
    return {
        "inside": float(away[inside].mean()),
        "least": min(bands),
        "most": max(bands),
        "changed": float((away[outside] > CHANGED).mean()),
    }


def is_good(figures: dict[str, float]) -> bool:
    """Whether a result meets `GOALS`."""
    return figures["inside"] <= 3 and figures["least"] >= 0.9 and figures["most"] <= 1.1 and figures["changed"] <= 0.02


def main() -> None:
    """Print a table: a row for each shape, softness and way."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--side", type=int, default=384, help="px")
    parser.add_argument("--half", choices=drifts.HALVES, help="of the textures, default: both")
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    session = Session()
    ways = {
        "photo": lambda photo: photo,
        "flatten": lambda photo: pixels(filters.flatten(picture(photo), session=session)),
        "shadows": lambda photo: pixels(filters.flatten(picture(photo), shadows=True, flattening=0, session=session)),
    }
    cleans = {path.stem: drifts.square(path, given.side) for path in drifts.textures(given.half)}
    columns = "shadow", "way", "changed", "delta E inside", "least band", "largest band", "changed outside", "good"
    print(f"Goals: {GOALS}.\n\n| {' | '.join(columns)} |\n" + "| --- " * len(columns) + "|")
    for shape in SHAPES:
        for softness in SOFT:
            k = visible(given.side, shape, softness)
            for way, make in ways.items():
                found, changed = [], 0
                for name, clean in cleans.items():
                    if clean is None:
                        continue
                    photo = shaded(clean, k)
                    result = make(photo)[..., :3]
                    found.append(measured(result, clean, k))
                    changed += bool((result != photo).any())
                    if given.out:
                        given.out.mkdir(parents=True, exist_ok=True)
                        save(np.hstack([photo, result]), given.out / f"{name}_{shape}_{softness}_{way}.png")
                figures = [cell(f[key] for f in found) for key in ("inside", "least", "most", "changed")]
                good = f"{sum(map(is_good, found))} of {len(found)}"
                row = [f"{shape}, {softness}", way, f"{changed} of {len(found)}", *figures, good]
                print("| " + " | ".join(row) + " |", flush=True)


if __name__ == "__main__":
    main()
