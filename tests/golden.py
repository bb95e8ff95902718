# SPDX-License-Identifier: Apache-2.0
"""Golden images: what the filters make of procedural pictures. `python -m tests.golden` renews them."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tests import pictures
from tests.conftest import oiiotex, save

FOLDER = Path(__file__).parents[1] / "golden"


@dataclass(frozen=True)
class Case:
    """A picture, and what is done to it."""

    picture: Callable[[], np.ndarray]
    words: tuple[str, ...]
    space: str = "srgb_rec709_scene"

    @property
    def synthesis(self) -> bool:
        """Whether it chooses pixels; else it computes them, and the result holds to a tolerance."""
        return self.words[0].startswith(("--texstationarize", "--texpatchmatch", "--texsynth"))

    @property
    def labels(self) -> bool:
        """Whether its result is ids, which are compared as they are or under other numbers, never by tolerance."""
        return self.words[0].startswith(("--texsuperpixel", "--texlabel"))


def _with_hole() -> np.ndarray:
    picture = pictures.moss(96, 96, 5)
    alpha = np.ones((96, 96, 1))
    alpha[40:60, 30:70] = 0
    return np.concatenate([picture * alpha, alpha], -1)


CASES = {
    "stationarize_bricks": Case(lambda: pictures.stained(pictures.bricks(96, 128, 1)), ("--texstationarize:seed=1",)),
    "stationarize_pebbles_larger": Case(
        lambda: pictures.stained(pictures.pebbles(128, 128, 2)),
        ("--texstationarize:sigma=10:size=192x160:seed=2:patch=9",),
    ),
    "stationarize_moss_hdr": Case(
        lambda: 8 * pictures.stained(pictures.moss(112, 96, 3)),
        ("--texstationarize:target=exemplar:contrast=1",),
        "lin_rec709_scene",
    ),
    "stationarize_alpha_hole": Case(_with_hole, ("--texstationarize:seed=4:tile=x",)),
    "flatten_bricks": Case(lambda: pictures.stained(pictures.bricks(96, 128, 1)), ("--texflatten",)),
    "flatten_moss_hdr": Case(
        lambda: 8 * pictures.stained(pictures.moss(112, 96, 3)),
        ("--texflatten:sigma=20:amount=0.8:keep=none",),
        "lin_rec709_scene",
    ),
    "flatten_alpha_hole": Case(_with_hole, ("--texflatten:sigma=9",)),
    "stationarity_bricks": Case(lambda: pictures.stained(pictures.bricks(96, 128, 1)), ("--texstationarity",)),
    "lab_moss_hdr": Case(lambda: 8 * pictures.moss(64, 80, 3) - 0.1, ("--texlab",), "lin_rec709_scene"),
    "superpixel_bricks": Case(
        lambda: pictures.stained(pictures.bricks(96, 128, 1)), ("--texsuperpixel:finest=6:sigma=12",)
    ),
    "label_two_textures": Case(
        lambda: np.concatenate([pictures.bricks(96, 64, 1), pictures.moss(96, 64, 2)], 1), ("--texlabel",)
    ),
    "synth_pebbles_larger": Case(lambda: pictures.pebbles(96, 112, 2), ("--texsynth:size=192x160:seed=1",)),
    "patchmatch_bricks": Case(lambda: pictures.stained(pictures.bricks(96, 128, 1)), ("--texpatchmatch:seed=1",)),
}


def make(name: str, folder: Path) -> Path:
    """Run a case; a synthesis with its source map: it says which pixel was chosen, whatever the pixel looks like."""
    case = CASES[name]
    first = case.words[0] + (":stmap=1" if case.synthesis else "")
    save(case.picture(), folder / "in.exr", "half", case.space)
    done = oiiotex("in.exr", first, *case.words[1:], "-o", f"{name}.exr", cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder / f"{name}.exr"


def main() -> None:
    """Renew all goldens."""
    FOLDER.mkdir(exist_ok=True)
    for name in CASES:
        with tempfile.TemporaryDirectory() as folder:
            (FOLDER / f"{name}.exr").write_bytes(make(name, Path(folder)).read_bytes())
        print(FOLDER / f"{name}.exr")


if __name__ == "__main__":
    main()
