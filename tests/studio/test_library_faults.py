# SPDX-License-Identifier: Apache-2.0
"""A library whose runs are killed, run beside each other, or spread: consistent each time, and in the end complete."""

from __future__ import annotations

import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import pytest
from oiiotex_studio.library import runs
from oiiotex_studio.library.catalog import Catalog
from oiiotex_studio.library.upkeep import check

from oiiotex.engine.errors import Error
from tests import pictures
from tests.conftest import load, save
from tests.oiiotool.test_imports import LARGE

PROGRAM = [sys.executable, "-m", "oiiotex_studio.library.main"]
RECIPE = 'schema = 1\n[[product]]\nname = "tile"\nline = "$maps --flip $outputs"\n[deliver]\ntx = false\n'
MATERIALS = 5


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "photos").mkdir()
    for n in range(MATERIALS):
        change(tmp_path, n, 0)
    (tmp_path / "recipe.toml").write_text(RECIPE)
    return tmp_path


def change(folder: Path, number: int, seed: int) -> None:
    save(pictures.noise(16, 16, 100 * seed + number)[..., None], folder / "photos" / f"m{number}_diff.png")


def line(*further: object) -> list[str]:
    return [*PROGRAM, "ingest", "photos", "library", "--recipe", "recipe.toml", *map(str, further)]


def library(*words: object, cwd: Path) -> subprocess.CompletedProcess:
    return subprocess.run([*PROGRAM, *map(str, words)], cwd=cwd, capture_output=True, text=True, timeout=300)


def killed_again_and_again(folder: Path, rounds: int, seed: int) -> int:
    """Runs that are killed at random moments while photos change; how many of them had not ended before."""
    moments = random.Random(seed)
    count, took = 0, 2.0
    for n in range(rounds):
        for number in moments.sample(range(MATERIALS), 3):
            change(folder, number, n + 1)
        process = subprocess.Popen(
            line("-q", "--workers", 2), cwd=folder, stderr=subprocess.DEVNULL, start_new_session=True
        )
        start = time.monotonic()
        try:
            process.wait(moments.uniform(0.3, took))
            took = min(took, 1.2 * (time.monotonic() - start))  # so that most moments lie within the work
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            count += 1
        if (folder / "library" / runs.FILE).exists():
            with Catalog(folder / "library") as catalog:
                assert list(check(catalog)) == [], f"round {n}"
    done = subprocess.run(line(), cwd=folder, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    with Catalog(folder / "library") as catalog:
        assert list(check(catalog)) == []
        assert {asset.status for asset in catalog.assets().values()} == {"ok"}
        assert len(catalog.assets()) == MATERIALS
    assert not list((folder / "library" / runs.WORK).glob("run-*"))
    return count


def test_a_killed_run_leaves_a_library_that_is_consistent_and_goes_on(folder):
    assert killed_again_and_again(folder, rounds=2, seed=1) >= 1


@pytest.mark.slow
def test_fifty_killed_runs_leave_a_library_that_is_consistent(folder):
    assert killed_again_and_again(folder, rounds=50, seed=2) >= 25


def test_an_interrupted_run_ends_at_once_and_leaves_nothing_half(folder):
    process = subprocess.Popen(
        line("--workers", 1), cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        start_new_session=True,
    )  # fmt: skip
    assert process.stdout.readline() == "5 to make (m0, m1, m2, ...), 0 unchanged\n"
    assert re.match(r"m\d: ok", process.stdout.readline())
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert (process.returncode, said) == (130, "")
    assert not list((folder / "library" / runs.WORK).glob("run-*"))
    with Catalog(folder / "library") as catalog:
        assert list(check(catalog)) == [] and 1 <= len(catalog.assets()) < MATERIALS
    assert (folder / "library/ingest.log").read_text().count(": ok,") == len(catalog_names(folder))


def catalog_names(folder: Path) -> list[str]:
    with Catalog(folder / "library") as catalog:
        return list(catalog.assets())


def test_two_runs_at_once_share_the_work(folder):
    both = [
        subprocess.Popen(line("--workers", 1), cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        for _ in range(2)
    ]
    printed = [process.communicate(timeout=300) for process in both]
    assert [process.returncode for process in both] == [0, 0], printed
    made = [re.match(r"(m\d): ok", text)[1] for out, _ in printed for text in out.splitlines()[1:-1]]
    assert sorted(made) == [f"m{n}" for n in range(MATERIALS)]  # nothing twice, nothing left out
    with Catalog(folder / "library") as catalog:
        assert list(check(catalog)) == []


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["ingest", "photos"], "the following arguments are required: LIBRARY, --recipe"),
        (["ingest", "photos", "x", "--recipe", "none.toml"], "none.toml: no such file"),
        (["ingest", "photos", "x", "--recipe", "bad.toml"], "product tile: unknown option '--texflat'"),
        (
            ["ingest", "photos", "x", "--recipe", "recipe.toml", "--farm", "openjd=recipe.toml"],
            "reads or writes that file",
        ),
        (["ingest", "photos", "x", "--recipe", "recipe.toml", "--farm", "openjd=j.json,0"], "openjd=FILE,SHARES"),
        (["ingest", "photos", "x", "--recipe", "recipe.toml", "--share", "1/1000000"], "I from 1 to N, N to 999999"),
        (["list", "photos"], "photos is not a library; create one with oiiotex-library ingest PHOTOS photos"),
        (["lst", "photos"], "invalid choice: 'lst'"),
        (["export", "photos", ""], "argument FOLDER: '': expected a path"),
    ],
)
def test_errors_are_one_line_and_touch_no_large_library(folder, words, text):
    (folder / "bad.toml").write_text(RECIPE.replace("--flip", "--texflat"))
    told = (
        "import sys\nfrom oiiotex_studio.library.main import main\n"
        f"try:\n main({words!r})\nexcept SystemExit as done:\n assert done.code == 1\nprint(*sys.modules)"
    )
    done = subprocess.run([sys.executable, "-P", "-c", told], cwd=folder, capture_output=True, text=True, timeout=100)
    (said,) = done.stderr.splitlines()
    assert said.startswith("oiiotex ERROR: ") and text in said
    assert not LARGE & {name.partition(".")[0] for name in done.stdout.split()}
    assert not (folder / "x").exists()


@pytest.mark.slow
def test_dask_makes_what_processes_here_make(folder):
    distributed = pytest.importorskip("distributed", reason="NOT RUN: no Dask (pip install oiiotex-studio[farm])")
    own = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None, "memory_limit": 0}
    with distributed.LocalCluster(**own) as cluster:
        words = line("--farm", f"dask={cluster.scheduler_address}")
        done = subprocess.run(words, cwd=folder, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    shutil.move(folder / "library", folder / "farmed")
    assert subprocess.run(line("-q"), cwd=folder, timeout=300).returncode == 0
    with Catalog(folder / "library") as one, Catalog(folder / "farmed") as other:
        assert list(check(other)) == []
        assert [a[:4] for a in one.assets().values()] == [a[:4] for a in other.assets().values()]


@pytest.mark.slow
def test_a_job_template_is_run_by_open_job_descriptions_own_runner(folder):
    program = Path(sys.executable).parent / "openjd"
    if not program.exists():
        pytest.skip("NOT RUN: no openjd (pip install openjd-cli)")
    assert subprocess.run(line("--farm", "openjd=job.json,2"), cwd=folder, timeout=100).returncode == 0
    own = f"Program={Path(sys.executable).parent / 'oiiotex-library'}"
    if not Path(own.partition("=")[2]).exists():
        pytest.skip("NOT RUN: the program is not installed")
    command = [program, "run", "job.json", "--step", "Join", "--run-dependencies", "-p", own]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout[-2000:]
    shown = json.loads(library("show", "library", "m0", cwd=folder).stdout)
    assert shown["status"] == "ok" and os.path.isdir(folder / shown["folder"])


@pytest.mark.slow
def test_the_commands_of_the_studio_page_do_what_it_says(tmp_path):
    programs = Path(sys.executable).parent
    if not (programs / "oiiotex-library").exists():
        pytest.skip("NOT RUN: the program is not installed")
    photos = tmp_path / "photos"
    photos.mkdir()
    save(pictures.pebbles(128, 128, 1), photos / "meadow.png")
    with zipfile.ZipFile(photos / "Wall_1K.zip", "w") as archive:
        for role, pixels in (
            ("Color", pictures.bricks(64, 64, 2)),
            ("Roughness", pictures.noise(64, 64, 3)[..., None]),
        ):
            archive.write(save(pixels, tmp_path / "map.png"), f"Wall_1K-PNG_{role}.png")
    page = (Path(__file__).parents[2] / "docs" / "how-to" / "studio.md").read_text()
    (tmp_path / "recipe.toml").write_text(page.split("```toml\n")[1].split("```")[0])
    blocks = [block.split("```")[0].replace("3000x2000", "300x200") for block in page.split("```sh\n")[1:]]
    environment = {**os.environ, "PATH": f"{programs}{os.pathsep}{os.environ['PATH']}"}
    for block in blocks:
        done = subprocess.run(["sh", "-e", "-c", block], cwd=tmp_path, env=environment, capture_output=True, text=True)
        assert done.returncode == 0, (block, done.stdout, done.stderr)
    assert (tmp_path / "shared/meadow/meadow.mtlx").is_file()
    assert load(tmp_path / "ground.exr").shape == (200, 300, 3)
    assert {"steps"} <= set(json.loads((tmp_path / "ground.json").read_text()))
    with Catalog(tmp_path / "library") as one, Catalog(tmp_path / "farmed") as other:
        assert sorted(one.assets()) == ["Wall", "meadow"]
        assert [a[:4] for a in one.assets().values()] == [a[:4] for a in other.assets().values()]
        assert list(check(other)) == []


def test_a_library_that_cannot_be_created_is_told_by_folder_and_reason(tmp_path):
    (tmp_path / "photo.png").touch()
    with pytest.raises(Error, match=r"^\S+/photo\.png/library/\.making: Not a directory$"):
        Catalog(tmp_path / "photo.png" / "library", create=True)
