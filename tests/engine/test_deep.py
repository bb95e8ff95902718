# SPDX-License-Identifier: Apache-2.0
"""Deep images: through oiiotool and through oiiotex, and what refuses them."""

from __future__ import annotations

import shlex
import subprocess
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex.oiiotool.cli.running.line_run import run
from tests.peer import OIIOTOOL, chains, refused, same

pytestmark = pytest.mark.skipif(not OIIOTOOL.exists(), reason="no oiiotool")


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Deep images of up to three samples a pixel, of two types, and a flat one."""
    folder = tmp_path_factory.mktemp("deep")
    for name, seed in (("a.exr", 1), ("b.exr", 2)):
        _write(folder / name, seed)
    line = "--pattern noise 9x7 4 --chnames R,G,B,A --fill:color=0,0,0,0 3x3+2+2 -d half -o flat.exr"
    subprocess.run([OIIOTOOL, *shlex.split(line)], cwd=folder, check=True)
    return folder


def _write(path: Path, seed: int) -> None:
    """Random samples; in the last column none."""
    spec = oiio.ImageSpec(9, 7, 5, "float")
    spec.channelnames = ("R", "G", "B", "A", "Z")
    spec.alpha_channel, spec.z_channel = 3, 4
    spec.channelformats = tuple(map(oiio.TypeDesc, ("half", "half", "half", "half", "float")))
    spec.deep = True
    spec.attribute("Artist", "me")
    data, random = oiio.DeepData(), np.random.default_rng(seed)
    data.init(63, 5, spec.channelformats, spec.channelnames)
    for pixel in range(63):
        if pixel % 9 == 8:
            continue
        data.set_samples(pixel, int(random.integers(0, 4)))
        for n in range(data.samples(pixel)):
            alpha = random.uniform(0.1, 0.9)
            values = (*random.uniform(0, alpha, 3), alpha, n + random.uniform(1, 1.9))
            for channel, value in enumerate(values):
                data.set_deep_value(pixel, channel, n, float(np.float16(value)))
    file = oiio.ImageOutput.create(str(path))
    assert file.open(str(path), spec) and file.write_deep_image(data) and file.close(), file.geterror()


LINES = """
a.exr | -o OUT.exr | --attrib shot 3 --eraseattrib Artist --origin +4-5 | -d half | -d Z=half -d A=float
a.exr | --tile 4 4 --compression zip | --dup --pop --label x x --swap | --flatten | --flatten --resize 200% -d float
a.exr | --attrib shot 3 --flatten | --ch A,Z | --crop 4x3+2+1 | --crop 20x20-2-1 | --crop 20x20-2-1 --trim
a.exr | --cut 4x3+2+1 | --fullsize 12x12 --croptofull | --resample 50%
a.exr | --addc 0,0,0,0,10 --subc 0,0,0,0,1 --mulc 1,0.5,1,1,2 --divc 2
a.exr b.exr | --siappend | --deepmerge | --deepmerge --flatten | --deepholdout
flat.exr | --deepen | --deepen:z=4
"""


@pytest.mark.parametrize("line", chains(LINES))
def test_the_same_chain_gives_the_same_samples(folder, line):
    for old in folder.glob("*ours*"):
        old.unlink()
    same(folder, *shlex.split(line))


def test_a_deep_file_is_replaced_by_what_is_made_of_it(folder):
    (folder / "c.exr").write_bytes((folder / "a.exr").read_bytes())
    assert run(shlex.split("c.exr --addc 1 -o c.exr"), folder) == 0
    a, c = (oiio.ImageInput.open(str(folder / name)).read_native_deep_image() for name in ("a.exr", "c.exr"))
    pixel = next(n for n in range(63) if a.samples(n))
    assert c.deep_value(pixel, 4, 0) == a.deep_value(pixel, 4, 0) + 1


def test_info_is_of_the_file(folder, capfd):
    for words in (["--info", "-v", "a.exr"], ["a.exr", "--printinfo"]):
        done = subprocess.run([OIIOTOOL, *words], cwd=folder, capture_output=True, text=True, check=True)
        capfd.readouterr()
        assert run(words, folder) == 0
        assert capfd.readouterr().out == done.stdout and ", deep half/half/half/half/float openexr" in done.stdout


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("a.exr --texstationarize -o o.exr", "--texstationarize : a.exr is deep: expected a flat image"),
        ("a.exr --blur 3x3 -o o.exr", "--blur : a.exr is deep: expected a flat image; add --flatten before this step"),
        ("a.exr flat.exr --over -o o.exr", "--over : a.exr is deep"),
        ("a.exr b.exr --diff --flatten -o o.exr", "--diff : a.exr is deep"),
        ("a.exr --printstats --flatten -o o.exr", "--printstats : a.exr is deep"),
        ("--hash a.exr --flatten -o o.exr", "a.exr is deep"),
        ("a.exr -otex o.exr", "-otex : a.exr is deep"),
        ("a.exr -o o.tif", "tiff cannot hold deep images: expected EXR"),
        ("flat.exr a.exr --deepmerge -o o.exr", "--deepmerge : "),
    ],
)
def test_what_wants_flat_images_says_so(folder, line, says):
    refused(folder, line, says)
