# SPDX-License-Identifier: Apache-2.0
"""Golden images: what the filters make of procedural pictures. `python -m tests.golden` renews them."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from oiiotex.oiiotool.cli.running.line_run import run
from tests import pictures
from tests.conftest import save

FOLDER = Path(__file__).parents[1] / "golden"


_SYNTHESES = tuple(
    f"--tex{n}"
    for n in ("stationarize", "patchmatch", "quilt", "cut", "composite", "palette", "paint", "synth", "atlas")
)


@dataclass(frozen=True)
class Case:
    """A picture, and what is done to it."""

    picture: Callable[[], np.ndarray]
    words: tuple[str, ...]
    space: str = "srgb_rec709_scene"
    second: Callable[[], np.ndarray] | None = None  # another image on the stack
    mesh: Callable[[], str] | None = None  # the text of mesh.obj

    @property
    def kind(self) -> str:
        """How its result is compared: a synthesis chooses pixels, labels are ids under any numbers, and a mask and what
        is computed hold as they are."""
        if any(word.startswith(_SYNTHESES) for word in self.words):
            return "synthesis"
        if self.words[-1].startswith("--texdominant"):
            return "mask"
        ids = self.words[-1].startswith(("--texsuperpixel", "--texlabel", "--texdecompose"))
        return "labels" if ids else "computed"


def _with_hole() -> np.ndarray:
    picture = pictures.moss(96, 96, 5)
    alpha = np.ones((96, 96, 1))
    alpha[40:60, 30:70] = 0
    return np.concatenate([picture * alpha, alpha], -1)


def _two_textures() -> np.ndarray:
    return np.concatenate([pictures.bricks(96, 64, 1), pictures.moss(96, 64, 2)], 1)


_LABELED = "--texlabel:photo=1"
CASES = {
    "stationarize_bricks": Case(lambda: pictures.stained(pictures.bricks(96, 128, 1)), ("--texstationarize:seed=1",)),
    "stationarize_pebbles_larger": Case(
        lambda: pictures.stained(pictures.pebbles(128, 128, 2)),
        ("--texstationarize:sigma=10:size=192x160:seed=2:patch=9",),
    ),
    "stationarize_layout_bricks": Case(
        lambda: pictures.stained(pictures.bricks(96, 128, 1)), ("--texstationarize:preset=layout",)
    ),
    "stationarize_moss_hdr": Case(
        lambda: 8 * pictures.stained(pictures.moss(112, 96, 3)),
        ("--texstationarize:paper=1",),
        "lin_rec709_scene",
    ),
    "fill_moss_hdr": Case(
        lambda: 8 * pictures.stained(pictures.moss(112, 96, 3)),
        ("second.exr", "--texfill:seed=3:patch=7"),
        "lin_rec709_scene",
        second=lambda: (np.hypot(*(np.indices((112, 96)) - np.array([46, 60])[:, None, None])) < 24)[..., None] * 1.0,
    ),
    "plate_bricks": Case(
        lambda: pictures.bricks(64, 80, 1),
        ("second.exr", "--texplate:region=1"),
        second=lambda: (np.abs(np.indices((64, 80))[0] - 30) < 8)[..., None] * 1.0,
    ),
    "project_moss_hdr": Case(
        lambda: 8 * pictures.stained(pictures.moss(64, 80, 3)),
        ("second.exr", "--texproject"),
        "lin_rec709_scene",
        second=lambda: pictures.bricks(64, 80, 1),
    ),
    "stationarize_sigmamap_bricks": Case(
        lambda: pictures.stained(pictures.bricks(96, 128, 1)),
        ("second.exr", "--texstationarize:sigmamap=1:seed=1"),
        second=lambda: np.geomspace(3, 40, 128)[None, :, None].repeat(96, 0),
    ),
    "stationarize_material": Case(
        lambda: pictures.stained(pictures.bricks(96, 128, 1)),
        ("second.exr", "--texstationarize:kinds=color,data:mapweights=1,0.5:seed=1:patch=7", "--pop"),
        second=lambda: pictures.moss(96, 128, 2),
    ),
    "stationarize_wang": Case(
        lambda: pictures.pebbles(128, 128, 2), ("--texstationarize:variants=9:size=64x56:seed=2:patch=7",)
    ),
    "stationarize_moments_pebbles": Case(
        lambda: pictures.stained(pictures.pebbles(96, 112, 1)), ("--texstationarize:measure=moments4:seed=1",)
    ),
    "stationarize_steerable_hole": Case(_with_hole, ("--texstationarize:measure=steerable:seed=2",)),
    "stationarize_alpha_hole": Case(_with_hole, ("--texstationarize:seed=4:tiles=x",)),
    "rectify_bricks_hdr": Case(
        lambda: 8 * pictures.stained(pictures.bricks(96, 128, 1)),
        ("--texrectify:corners=9,4,120,16,110,90,2,80",),
        "lin_rec709_scene",
    ),
    "estimateheight_pebbles": Case(lambda: pictures.pebbles(96, 128, 1), ("--texestimateheight:overcast=1",)),
    "estimateheight_alpha_hole": Case(_with_hole, ("--texestimateheight:light=90:sigma=9",)),
    "capture_pebbles": Case(
        lambda: pictures.pebbles(96, 128, 1),
        ("--dup", "--flip", "--dup", "--flop", "--texcapture:lights=0,1,1,-1,-0.5,1,1,-0.5,1", "--pop"),
    ),
    "estimateao_heights": Case(
        lambda: pictures.smooth_noise(96, 128, 12, 3)[..., None],
        ("--texestimateao:radius=12:relief=8:tiled=x",),
        "data",
    ),
    "estimateroughness_alpha_hole": Case(_with_hole, ("--texestimateroughness:sigma=6",)),
    "checkmaterial_bricks": Case(
        lambda: pictures.stained(pictures.bricks(48, 64, 1)), ("--texcheckmaterial:fail=none",)
    ),
    "flatten_bricks": Case(lambda: pictures.stained(pictures.bricks(96, 128, 1)), ("--texflatten",)),
    "flatten_moss_hdr": Case(
        lambda: 8 * pictures.stained(pictures.moss(112, 96, 3)),
        ("--texflatten:radius=40:flattening=0.8:tone=gray",),
        "lin_rec709_scene",
    ),
    "flatten_alpha_hole": Case(_with_hole, ("--texflatten:radius=18",)),
    "stationarity_bricks": Case(lambda: pictures.stained(pictures.bricks(96, 128, 1)), ("--texstationarity",)),
    "preview_bricks": Case(
        lambda: pictures.bricks(96, 128, 1),
        ("second.exr", "--texpreview:exemplar=1:panel=64"),
        second=lambda: pictures.stained(pictures.bricks(80, 112, 1)),
    ),
    "stationarity_moments_pebbles": Case(
        lambda: pictures.stained(pictures.pebbles(96, 112, 1)), ("--texstationarity:measure=moments4",)
    ),
    "stationarity_steerable_hole": Case(_with_hole, ("--texstationarity:measure=steerable:sigma=8",)),
    "lab_moss_hdr": Case(lambda: 8 * pictures.moss(64, 80, 3) - 0.1, ("--texlab",), "lin_rec709_scene"),
    "superpixel_bricks": Case(
        lambda: pictures.stained(pictures.bricks(96, 128, 1)), ("--texsuperpixel:sigmamin=6:sigma=12",)
    ),
    "label_two_textures": Case(_two_textures, ("--texlabel",)),
    "transition_bricks_moss": Case(
        lambda: pictures.bricks(64, 64, 1),
        ("second.exr", "--iscolorspace", "srgb_rec709_scene", "--textransition:tiled=xy:seed=3"),
        second=lambda: pictures.moss(64, 64, 2),
    ),
    "composite_two_textures": Case(_two_textures, (_LABELED, "--texcomposite:size=200x160:patch=16:seed=2")),
    "palette_two_textures": Case(_two_textures, (_LABELED, "--texpalette:panel=40")),
    "paint_two_textures": Case(
        _two_textures,
        (_LABELED, "second.exr", "--texpaint:patch=16"),
        second=lambda: 1.0 + (np.indices((120, 144)).sum(0) // 60 % 2)[..., None],
    ),
    "cut_pebbles": Case(lambda: pictures.pebbles(96, 128, 2), ("--texcut:seed=1:patch=40:size=128x112",)),
    "atlas_pebbles_on_a_cube": Case(
        lambda: pictures.pebbles(96, 112, 2), ("--texatlas:mesh=mesh.obj:size=128x96:seed=1",), mesh=pictures.cube_obj
    ),
    "quilt_pebbles": Case(lambda: pictures.pebbles(96, 112, 2), ("--texquilt:size=160x128:patch=24:tiles=xy:seed=3",)),
    "quilt_alpha_hole": Case(_with_hole, ("--texquilt:size=120x90:patch=16:seed=4",)),
    "decompose_two_textures": Case(
        lambda: np.concatenate([pictures.bricks(96, 64, 1), pictures.moss(96, 64, 2)], 1), ("--texdecompose",)
    ),
    "dominant_moss_with_a_pipe": Case(
        lambda: np.where((np.abs(np.arange(96) - 70) < 8)[:, None], [0.5, 0.5, 0.55], pictures.moss(96, 96, 4)),
        ("--texdominant",),
    ),
    "synth_pebbles_larger": Case(lambda: pictures.pebbles(96, 112, 2), ("--texsynth:size=192x160:seed=1",)),
    "zoom_pebbles_between_octaves": Case(
        lambda: pictures.pebbles(64, 64, 2), ("--texzoom:size=96x80:frame=10:speed=0.15:center=20,40",)
    ),
    "patchmatch_bricks": Case(lambda: pictures.stained(pictures.bricks(96, 128, 1)), ("--texpatchmatch:seed=1",)),
}


def make(name: str, folder: Path) -> Path:
    """Run a case; a synthesis with its source map: it says which pixel was chosen, whatever the pixel looks like."""
    case = CASES[name]
    words = [word + ":st=1" if word.startswith(_SYNTHESES) else word for word in case.words]
    save(case.picture(), folder / "in.exr", "half", case.space)
    if case.second is not None:
        save(case.second(), folder / "second.exr", "float")
    if case.mesh is not None:
        (folder / "mesh.obj").write_text(case.mesh())
    assert run(["in.exr", *words, "-o", f"{name}.exr"], folder) == 0
    return folder / f"{name}.exr"


def main() -> None:
    """Renew the goldens whose names begin with a word of the command line; all without one."""
    FOLDER.mkdir(exist_ok=True)
    for name in (name for name in CASES if name.startswith(tuple(sys.argv[1:]) or "")):
        with tempfile.TemporaryDirectory() as folder:
            (FOLDER / f"{name}.exr").write_bytes(make(name, Path(folder)).read_bytes())
        print(FOLDER / f"{name}.exr")


if __name__ == "__main__":
    main()
