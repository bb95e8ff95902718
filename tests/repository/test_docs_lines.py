# SPDX-License-Identifier: Apache-2.0
"""Lines of the pages that teach (docs/start, docs/how-to) run, each page from top to bottom in one folder.

The pictures are small, and so are sizes and ranges of frames in the lines. Python of the pages is run by
tests/repository/test_docs_code.py; that all lines of all pages parse is seen by tests/oiiotool/test_words.py.
"""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests import forked, pictures
from tests.conftest import save
from tests.reference import captures, reliefs

ROOT = Path(__file__).parents[2]
PAGES = {
    f"{page.parent.name}/{page.stem}": page
    for part in ("start", "how-to")
    for page in (ROOT / "docs" / part).glob("*.md")
}
ELSEWHERE = {  # run by a test that knows what comes out
    "how-to/farm": "studio/test_farm.py",
    "how-to/fills-in-moving-shots": "surfaces/test_motion.py",
    "how-to/studio": "studio/test_library_faults.py",
    "how-to/your_own_filter": "oiiotool/test_plugins.py",
}
SLOW = {  # more than two seconds of an idle machine
    f"how-to/{name}"
    for name in (
        "a-folder",
        "blobs-and-repetition",
        "eight-variations",
        "godot",
        "keep-or-remove-objects",
        "library",
        "painting-with-labels",
        "transition-tiles",
        "udim-mesh",
        "unity",
        "unreal",
        "wang-tiles",
    )
} | {"start/first-material"}
NOT_RUN = {  # by what stands in a line
    "--texlive": "serves a page until it is ended",
    "matte=chair": "needs a render with a chair",
    "sources.png": "needs a painted mask",
    "--device gpu": "there may be no GPU",
    "dask=tcp": "asks a cluster",
    "dask=tls": "asks a cluster",
    "export library shared": "photos of 64 px go to review; test_library_faults.py exports",
    "--label 'moss*'": "asks for labels, which the recipe as it is printed does not make",
}
OURS = ("oiiotex ", "oiiotex-library ", "echo ")
SIDE = 64


def small(line: str) -> str:
    """The line with sizes of at most SIDE px, corners within them, and two frames."""

    def reduced(size: re.Match[str]) -> str:
        sides = [int(side) for side in size.groups()]
        return "x".join(str(max(16, side * SIDE // max(*sides, SIDE))) for side in sides)

    line = re.sub(r"(?<![\w.])(\d{3,5})x(\d{3,5})", reduced, line)
    line = re.sub(r"(--cut \d+x\d+)\+\d+\+\d+", r"\1+0+0", line)
    line = re.sub(r"corners=[\d,]+", "corners=5,3,58,6,60,58,4,60", line)
    return re.sub(r"--frames (\d+)-\d+", lambda at: f"--frames {at[1]}-{int(at[1]) + 1}", line)


def lines(page: Path) -> Iterator[str]:
    """Lines of shell that the page shows, but those of other programs."""
    for _, block in re.findall(r"^( *)```(?:sh)?\n(.*?)^\1```", page.read_text(), re.DOTALL | re.MULTILINE):
        for line in textwrap.dedent(block).replace("\\\n", " ").splitlines():
            if line.startswith(OURS) and not any(word in line for word in NOT_RUN):
                yield small(re.sub(r"\s+# .*", "", line))


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the files that the pages begin with."""
    folder = tmp_path_factory.mktemp("shown")
    stones, wall = pictures.pebbles(SIDE, SIDE, 1), pictures.bricks(SIDE, SIDE, 1)
    save(pictures.stained(stones), folder / "photo.png")
    save(pictures.stained(stones), folder / "photo.exr", "half")
    window = wall.copy()
    window[16:38, 30:50] = 0.15, 0.2, 0.5
    save(window, folder / "wall.png")
    save(stones, folder / "gravel.jpg")
    for name, pixels in (("grass", pictures.moss(SIDE, SIDE, 1)), ("pebbles", stones)):
        save(pixels, folder / f"{name}.jpg")
        save(np.broadcast_to(np.float32([0.5, 0.5, 1]), pixels.shape), folder / f"{name}_normal.png")
    save(wall, folder / "color.png")
    up = np.broadcast_to(np.float32([0.5, 0.5, 1]), wall.shape)
    save(up, folder / "normal.png")
    save(wall[..., :1], folder / "roughness.png")
    save(wall[..., :1], folder / "height.exr", "half", "data")
    y, x = np.mgrid[:SIDE, :SIDE]
    save((np.hypot(x - 40, y - 26) < 9)[..., None] * 1.0, folder / "mask.png")
    painting = np.where(x[..., None] < 26, np.float32([51, 128, 230]), np.float32([255, 230, 204])) / 255
    save(painting, folder / "painting.png")  # in the colors that --texpalette gives to labels 1 and 2
    (folder / "statue.obj").write_text(pictures.cube_obj(0.5))
    for frame in range(1001, 1003):
        save(stones * (0.8 + frame % 2 / 10), folder / f"plate.{frame}.exr", "half", "lin_rec709_scene")
    lights = captures.lights(8, turn=90)
    for n, light in enumerate(lights, 1):
        save(captures.photo(reliefs.hills(SIDE, 1), wall, light), folder / f"p{n}.jpg")
    save(np.full((SIDE, SIDE, 3), 0.9), folder / "white1.jpg")
    (folder / "lights.lp").write_text("\n".join(f"p{n}.jpg {x} {y} {z}" for n, (x, y, z) in enumerate(lights, 1)))
    photos = folder / "photos"
    photos.mkdir()
    save(stones, photos / "meadow.jpg")
    for role, pixels in (("Color", wall), ("Roughness", wall[..., :1])):
        save(pixels, photos / f"Wall_1K-PNG_{role}.png")
    return folder


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[pytest.mark.slow] * (name in SLOW)) for name in sorted(PAGES.keys() - ELSEWHERE.keys())],
)
def test_lines_of_a_page_run(name, shown, tmp_path):
    for file in shown.iterdir():
        (tmp_path / file.name).symlink_to(file)
    for line in lines(PAGES[name]):
        if line.startswith("oiiotex "):
            words = shlex.split(re.split(r" \|\| | && ", line)[0])[1:]
            done = forked.run(["--noprogress", *words], tmp_path, 300)
        else:
            shell = line.replace("oiiotex-library", f"{sys.executable} -m oiiotex_studio.library.main")
            done = subprocess.run(["sh", "-e", "-c", shell], cwd=tmp_path, capture_output=True, text=True)
        expected = {0, 3} if " || " in line or "oiiotex-library" in line else {0}  # 3: somebody is to look at it
        assert done.returncode in expected, (line, done.stdout, done.stderr)


@pytest.mark.parametrize("name", ELSEWHERE)
def test_a_page_that_is_run_elsewhere_is_named_there(name):
    assert f"{PAGES[name].name}" in (ROOT / "tests" / ELSEWHERE[name]).read_text()


@pytest.mark.parametrize("word", NOT_RUN)
def test_what_is_not_run_is_shown(word):
    assert any(word in page.read_text() for page in PAGES.values())
