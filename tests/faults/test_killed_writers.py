# SPDX-License-Identifier: Apache-2.0
"""Writing runs that are killed at random moments: an old output as it was or a new one whole, and nothing left.

$OIIOTEX_KILLS says how many of them; a few dozens else.
"""

from __future__ import annotations

import hashlib
import json
import os
import random
import re
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from oiiotex_studio.library import runs
from oiiotex_studio.library.catalog import Catalog
from oiiotex_studio.library.upkeep import check

from oiiotex.engine.errors import Error
from oiiotex.engine.io.reading import read
from tests import pictures
from tests.conftest import save
from tests.faults import OLD, PROGRAM

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX"),
]
KILLS = int(os.environ.get("OIIOTEX_KILLS", "20"))
SIGNALS = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGHUP: 129, signal.SIGKILL: -9}
LIBRARY = [sys.executable, "-m", "oiiotex_studio.library.main"]
_PROGRESS = re.compile(r"^ingest\b.*: \d+ s\b.*\n", re.MULTILINE)  # of a run of more than ten seconds
RECIPE = 'schema = 1\n[[product]]\nname = "tile"\nline = "$maps --flip $outputs"\n[deliver]\ntx = false\n'


@dataclass(frozen=True)
class Case:
    """A run, and the files that it writes."""

    words: tuple[str, ...]
    outputs: tuple[str, ...]
    program: tuple[str, ...] = (*PROGRAM, "-q")


def case(words: str, *outputs: str) -> Case:
    return Case(tuple(words.split()), outputs)


LABELS = "photo.tif --iscolorspace srgb_rec709_scene --texlabel:photo=1"
FRAMES = tuple(f"f.{n:04d}.exr" for n in range(1, 7))
CASES = {
    "exr": case("big.tif -d half -o out.exr", "out.exr"),
    "tiles": case("big.tif --tile 64 64 -d half -o out.exr", "out.exr"),
    "png": case("big.tif -o out.png", "out.png"),
    "tif": case("big.tif --flip -o out.tif", "out.tif"),
    "jpg": case("big.tif -o out.jpg", "out.jpg"),
    "webp": case("small.tif -o out.webp", "out.webp"),
    "jxl": case("small.tif -o out.jxl", "out.jxl"),
    "gif": case("small.tif -o out.gif", "out.gif"),
    "texture": case("big.tif -otex out.tx", "out.tx"),
    "several": case("small.tif -o a.exr --flip -o b.png --dup -o c.tif -o d.jpg", "a.exr", "b.png", "c.tif", "d.jpg"),
    "report": case(f"{LABELS} --texcontent:facts=r.json -o s.exr", "r.json", "s.exr"),
    "frames": case("--frames 1-6 small.tif --mulc 0.5 -o f.#.exr", *FRAMES),
    "parallel": case("--frames 1-6 --parallel-frames --threads 2 small.tif -o f.#.exr", *FRAMES),
    "farm": case("big.tif --blur 5x5 -d half -o out.exr --farm dask=local:2", "out.exr"),
    "library": Case(("ingest", "photos", "library", "--recipe", "recipe.toml", "--workers", "2"), (), tuple(LIBRARY)),
}  # fmt: skip


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("inputs")
    noise = np.random.default_rng(1).random((1400, 1400, 3), np.float32)
    save(noise, folder / "big.tif")
    save(noise[:500, :500], folder / "small.tif")
    save(pictures.stained(pictures.bricks(64, 72, seed=2)), folder / "photo.tif")
    (folder / "photos").mkdir()
    for n in range(3):
        save(pictures.noise(16, 16, n)[..., None], folder / "photos" / f"m{n}_diff.png")
    (folder / "recipe.toml").write_text(RECIPE)
    return folder


def laid_out(inputs: Path, folder: Path) -> None:
    folder.mkdir()
    for path in inputs.iterdir():
        (folder / path.name).symlink_to(path)


def hidden(folder: Path) -> list[str]:
    """Everything in a folder that a run leaves and no user has asked for."""
    return [str(path.relative_to(folder)) for path in folder.rglob("*") if ".oiiotex-" in path.name]


def content(path: Path) -> str:
    """A hash of a file's pixels or values, as metadata may say when it was made; of what is cut off there is none."""
    if path.suffix in (".exr", ".tx"):
        return ", ".join(hashlib.sha1(part.pixels().tobytes()).hexdigest() for part in read(path).parts)
    if path.suffix == ".json":
        return json.dumps(json.loads(path.read_text()), sort_keys=True)
    return hashlib.sha1(path.read_bytes()).hexdigest()


def begun(one: Case, folder: Path) -> subprocess.Popen:
    return subprocess.Popen(
        [*one.program, *one.words], cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        start_new_session=True,
    )  # fmt: skip


def done(one: Case, folder: Path) -> float:
    start = time.monotonic()
    run = begun(one, folder)
    said = run.communicate(timeout=300)
    assert run.returncode == 0, said
    return time.monotonic() - start


@dataclass
class Whole:
    """What a run that nobody kills writes, and how long it takes."""

    seconds: float
    contents: dict[str, str]


def whole(one: Case, inputs: Path, folder: Path) -> Whole:
    laid_out(inputs, folder)
    seconds = done(one, folder)
    assert hidden(folder) == []
    return Whole(seconds, {name: content(folder / name) for name in one.outputs})


def checked_library(folder: Path, killed: bool = False) -> None:
    """Each asset is whole. A first run that was killed between an asset and its row says to run ingest again."""
    if (folder / "library" / runs.FILE).exists():
        try:
            with Catalog(folder / "library") as catalog:
                assert list(check(catalog)) == []
        except Error as error:
            assert killed and "run ingest again, which restores the catalog" in str(error)


def kill(one: Case, known: Whole, inputs: Path, folder: Path, number: int, moment: float) -> tuple[str, int]:
    """Kill a run; what became of it, and how many files it left that the next run sweeps."""
    laid_out(inputs, folder)
    for name in one.outputs:
        (folder / name).write_bytes(OLD)
    run = begun(one, folder)
    try:
        run.wait(moment)
        fate = "had ended"
    except subprocess.TimeoutExpired:
        run.send_signal(number)
        fate = signal.Signals(number).name
    said = _PROGRESS.sub("", run.communicate(timeout=60)[1])
    where = f"{one.words}, signal {number} after {moment:.3f} s: {said}"
    if number == signal.SIGINT and "KeyboardInterrupt" in said:  # Python had not come to the program yet
        assert run.returncode in (1, -number), where
    else:  # and it ends by a signal as soon as it no longer minds it
        assert run.returncode in (0, SIGNALS[number], -number, -signal.SIGKILL), where  # the last by its guard
    if number in (signal.SIGTERM, signal.SIGHUP):  # SIGKILL leaves processes without a parent, and Python says so
        assert said == "", where
    for name in one.outputs:
        as_it_was = (folder / name).read_bytes() == OLD
        assert as_it_was or content(folder / name) == known.contents[name], f"{name}: neither old nor new: {where}"
    left = hidden(folder)
    if number != signal.SIGKILL:
        assert left == [], where
    checked_library(folder, killed=True)
    done(one, folder)
    assert hidden(folder) == [], where
    for name in one.outputs:
        assert content(folder / name) == known.contents[name], where
    checked_library(folder)
    return fate, len(left)


def killed_again_and_again(inputs: Path, tmp_path: Path, count: int, seed: int, say: Callable[[str], object]) -> None:
    chance, fates, left = random.Random(seed), Counter[str](), Counter[str]()
    known = {name: whole(one, inputs, tmp_path / f"whole-{name}") for name, one in CASES.items()}
    names = list(CASES)
    for n in range(count):
        name = names[n % len(names)]
        number = chance.choice(list(SIGNALS))
        moment = chance.uniform(0.05, 1.05 * known[name].seconds)
        folder = tmp_path / f"kill-{n}"
        fate, swept = kill(CASES[name], known[name], inputs, folder, number, moment)
        fates[fate] += 1
        left[fate] += swept
        subprocess.run(["rm", "-rf", str(folder)], check=True)
    say(f"{count} runs: {dict(fates)}; left and then swept: {dict(left)}")
    assert fates.total() - fates["had ended"] > count / 2


def test_a_killed_run_leaves_the_old_output_or_the_new_one_and_nothing_else(inputs, tmp_path, capsys):
    killed_again_and_again(inputs, tmp_path, KILLS, 1, print)
