# SPDX-License-Identifier: Apache-2.0
"""A line in shares, and on a farm: the pixels of one run on one machine, whatever becomes of a worker."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from oiiotex_studio.farm import dask_cluster, openjd

from oiiotex.engine import errors
from oiiotex.engine.io.checkpoint import Checkpoint
from oiiotex.oiiotool.cli.language.sequences import Frame
from oiiotex.oiiotool.cli.running import shares as sharing
from oiiotex.oiiotool.cli.running.line_run import run
from oiiotex.oiiotool.cli.running.parallel import WorkerDied, worker_processes
from oiiotex.oiiotool.cli.running.tasks import Job, Task, work
from tests import pictures
from tests.conftest import load, oiiotex, save

LINE = ["a.png", "--resize", "200x1500", "--blur", "9x9", "-d", "half"]
SYNTH = ["a.png", "--texsynth:size=300x1200:seed=2:st=1"]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    save(pictures.pebbles(64, 64, 1), tmp_path / "a.png", space="srgb_rec709_scene")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sharing, "rows_for", lambda part, multiple: multiple)  # small cells: many
    return tmp_path


def all_of(path: str) -> list[np.ndarray]:
    return [load(Path(path), n) for n in range(oiio.ImageBuf(path).nsubimages)]


def same(a: str, b: str) -> None:
    mine, theirs = all_of(a), all_of(b)
    assert len(mine) == len(theirs)
    for one, other in zip(mine, theirs, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("line", [LINE, SYNTH, ["a.png", "--iscolorspace", "srgb_rec709_scene", "--texflatten"]])
def test_shares_in_any_order_are_the_image_of_one_run(folder, line):
    run([*line, "-o", "one.exr"])
    for number in (3, 1, 2):
        run([*line, "-o", "out.exr", "--share", f"{number}/3"])
        assert not os.path.exists("out.exr")
    run([*line, "-o", "out.exr", "--join"])
    same("one.exr", "out.exr")
    assert not os.path.exists("out.exr.parts")


def test_what_is_good_is_not_computed_again_and_what_is_not_is(folder, monkeypatch):
    for number in (1, 2):
        run([*LINE, "-o", "out.exr", "--share", f"{number}/2"])
    pieces = sorted(Path("out.exr.parts").iterdir())
    assert len(pieces) > 10
    before = {path: path.stat().st_mtime_ns for path in pieces}
    pieces[3].write_bytes(pieces[3].read_bytes()[:-20])  # cut off
    pieces[5].unlink()
    computed = []
    keep = Checkpoint.keep
    monkeypatch.setattr(
        Checkpoint, "keep",
        lambda self, key, place, pixels: (computed.append(self._file(key, place)), keep(self, key, place, pixels)),
    )  # fmt: skip
    for number in (1, 2):
        run([*LINE, "-o", "out.exr", "--share", f"{number}/2", "-v", "--threads", "2"])  # how it is run says nothing
    assert {path.name for path in computed} == {pieces[3].name, pieces[5].name}
    assert all(p.stat().st_mtime_ns == before[p] for p in pieces if p.name not in {c.name for c in computed})
    run([*LINE, "-o", "one.exr"])
    pieces[7].unlink()
    run([*LINE, "-o", "out.exr", "--join"])
    same("one.exr", "out.exr")


def test_shares_of_another_line_and_of_another_photo_are_not_taken(folder):
    run([*LINE, "-o", "out.exr", "--share", "1/1"])
    run(["a.png", "--resize", "200x1500", "--blur", "5x5", "-d", "half", "-o", "out.exr", "--join"])
    run(["a.png", "--resize", "200x1500", "--blur", "5x5", "-d", "half", "-o", "one.exr"])
    same("one.exr", "out.exr")
    run([*LINE, "-o", "out.exr", "--share", "1/1"])
    save(pictures.pebbles(64, 64, 9), folder / "a.png", space="srgb_rec709_scene")
    run([*LINE, "-o", "out.exr", "--join"])
    run([*LINE, "-o", "one.exr"])
    same("one.exr", "out.exr")


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--share", "4/3"], "--share 4/3: expected I/N with I from 1 to N"),
        (["--share", "1/1000000"], "--share 1/1000000: expected I/N with I from 1 to N, and N up to 999999"),
        (["--share", "1/2", "--join"], "--share conflicts with --join"),
        (["--farm", "slurm=x"], "--farm slurm=x: expected dask="),
        (["--farm", "dask=here"], "dask=here: expected the address of a scheduler, such as tcp://HOST:PORT"),
        (["--farm", "dask=tcp://127.0.0.1:9"], "no answer from the scheduler"),
    ],
)
def test_what_cannot_be_spread_is_one_line(folder, monkeypatch, words, text):
    monkeypatch.setattr(dask_cluster, "_WAIT", "0.3s")
    with pytest.raises(errors.Error, match=text):
        run([*LINE, "-o", "out.exr", *words])
    assert not os.path.exists("out.exr")


def test_what_needs_the_whole_image_is_not_cut(folder):
    with pytest.raises(errors.Error, match=r"--farm cannot split --texpatchmatch: each .*; distribute"):
        run(["a.png", "--texpatchmatch", "-o", "out.exr", "--farm", "openjd=job.json"])
    with pytest.raises(errors.Error, match="--share cannot split a MIP-mapped texture"):
        run([*LINE, "-otex", "out.tx", "--share", "1/2"])


def test_a_worker_of_another_version_or_without_the_folder_says_so(folder):
    task = Task(Frame(None, (*LINE, "-o", "out.exr")), len(LINE))
    assert "expected 9.9, the version of the sender" in str(work(Job(task, version="9.9"))[1])
    assert str(work(Job(task, folder="/nowhere"))[1]) == "a worker has no access to the folder /nowhere"
    lost = Task(Frame(None, ("gone.png", "--flip", "-o", "out.exr")), 3)
    assert "gone.png" in str(work(Job(lost, folder=str(folder)))[1])


def test_a_job_template_has_shares_and_a_join_behind_them(folder):
    run([*LINE, "-o", "out.exr", "--farm", "openjd=job.json,5", "--cache", "3000"])
    template = json.loads(Path("job.json").read_text())
    first, last = template["steps"]
    assert first["parameterSpace"]["taskParameterDefinitions"] == [{"name": "Share", "type": "INT", "range": "1-5"}]
    assert last["dependencies"] == [{"dependsOn": "Shares"}]
    assert first["hostRequirements"]["amounts"] == [{"name": "amount.worker.memory", "min": 3000}]
    assert "--farm" not in json.dumps(template)
    with pytest.raises(errors.Error, match="a job template cannot contain"):
        openjd.share_template("x", ["--echo", "{{x}}"], 2, 100)


def test_a_job_template_takes_no_each(folder):
    with pytest.raises(errors.Error, match="use --farm dask"):
        run(["--farm", "openjd=x.json", "--each", "a.png", "--flip", "-o", "{name}.exr"])


@pytest.mark.parametrize(
    ("place", "text"),
    [
        ("a.png", "reads or writes that file"),
        ("./out.exr", "reads or writes that file"),
        ("notes.txt", "is not a job template of oiiotex"),
        ("job.json,0", "expected openjd=FILE or openjd=FILE,SHARES"),
        ("job.json,999999", "expected openjd=FILE or openjd=FILE,SHARES"),
    ],
)
def test_a_job_template_takes_no_other_files_place(folder, place, text):
    (folder / "notes.txt").write_text("mine")
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    with pytest.raises(errors.Error, match=text):
        run(["a.png", "--flip", "-o", "out.exr", "--farm", f"openjd={place}"])
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    for _ in range(2):  # an older one it does take
        run(["a.png", "--flip", "-o", "out.exr", "--farm", "openjd=job.json"])


def test_a_template_over_frames_has_a_task_for_each(folder):
    for n in (1, 2, 5):
        shutil.copy("a.png", f"in.{n:04d}.png")
    run(["in.#.png", "--flip", "-o", "out.#.png", "--frames", "1-2,5", "--farm", "openjd=job.json"])
    (step,) = json.loads(Path("job.json").read_text())["steps"]
    assert step["parameterSpace"]["taskParameterDefinitions"][0]["range"] == "1,2,5"


def test_progress_and_failure_are_told_as_a_runner_reads_them(folder):
    told = oiiotex(*LINE, "-o", "out.exr", "--openjd", cwd=folder)
    assert told.stdout.splitlines()[-1] == "openjd_progress: 100.0"
    failed = oiiotex("gone.png", "--flip", "-o", "out.exr", "--openjd", cwd=folder)
    assert failed.returncode == 1
    assert failed.stdout.startswith("openjd_fail: gone.png")


@pytest.mark.slow
def test_open_job_descriptions_own_runner_takes_the_template(folder):
    program = Path(sys.executable).parent / "openjd"
    if not program.exists():
        pytest.skip("NOT RUN: no openjd (pip install openjd-cli)")
    run([*LINE, "-o", "one.exr"])
    run([*LINE, "-o", "out.exr", "--farm", "openjd=job.json,3"])
    subprocess.run([program, "check", "job.json"], check=True, capture_output=True)
    command = [program, "run", "job.json", "--step", "Join", "--run-dependencies"]
    told = f"Program={Path(sys.executable).parent / 'oiiotex'}"
    subprocess.run([*command, "-p", told], check=True, capture_output=True, timeout=600)
    same("one.exr", "out.exr")


@pytest.fixture
def scheduler():
    """The address of a new cluster, of one worker: tests kill it."""
    distributed = pytest.importorskip("distributed", reason="NOT RUN: no Dask (pip install oiiotex-studio[farm])")
    own = {"n_workers": 1, "threads_per_worker": 1, "dashboard_address": None, "memory_limit": 0}
    with distributed.LocalCluster(**own) as cluster:
        yield cluster.scheduler_address


@pytest.mark.slow
@pytest.mark.parametrize("local", [True, False])
def test_dask_gives_the_pixels_of_one_run(folder, local, request):
    place = "local:2" if local else request.getfixturevalue("scheduler")
    for line in (LINE, SYNTH):
        run([*line, "-o", "one.exr"])
        done = oiiotex(*line, "-o", "out.exr", "--farm", f"dask={place}", cwd=folder, env=dict(os.environ))
        assert (done.returncode, done.stderr) == (0, "")
        same("one.exr", "out.exr")
        assert not os.path.exists("out.exr.parts")
    for n in (1, 2):
        shutil.copy("a.png", f"in.{n:04d}.png")
    words = ["in.#.png", "--texpatchmatch:size=48x48", "-o", "out.#.png", "--frames", "1-2"]
    oiiotex(*words, "--farm", f"dask={place}", cwd=folder, env=dict(os.environ))
    shutil.copy("out.0001.png", "farm.png")
    run(words)
    same("out.0001.png", "farm.png")


@pytest.mark.slow
def test_a_cluster_with_tls_refuses_who_has_no_key(folder):
    distributed = pytest.importorskip("distributed", reason="NOT RUN: no Dask (pip install oiiotex-studio[farm])")
    openssl = shutil.which("openssl")
    if openssl is None:
        pytest.skip("NOT RUN: no openssl")
    words = "req -x509 -newkey rsa:2048 -nodes -keyout key.pem -out cert.pem -days 1 -subj /CN=farm"
    subprocess.run([openssl, *words.split()], check=True, capture_output=True)
    files = {"cert": str(folder / "cert.pem"), "key": str(folder / "key.pem")}
    roles = {f"tls_{role}_{what}": files[what] for role in ("scheduler", "worker", "client") for what in files}
    security = distributed.Security(tls_ca_file=files["cert"], require_encryption=True, **roles)
    own = {"n_workers": 1, "threads_per_worker": 1, "dashboard_address": None, "memory_limit": 0}
    keys = {f"DASK_DISTRIBUTED__COMM__TLS__CLIENT__{what.upper()}": path for what, path in files.items()}
    keys["DASK_DISTRIBUTED__COMM__TLS__CA_FILE"] = files["cert"]
    with distributed.LocalCluster(**own, protocol="tls://", security=security) as cluster:
        address = cluster.scheduler_address
        for place, environment, text in (
            (address, {}, "TLS requires a certificate, a key and a certificate authority; configure them"),
            (address.replace("tls:", "tcp:"), {}, "no answer from the scheduler"),
            (address, keys, ""),
        ):
            done = oiiotex(*LINE, "-o", "out.exr", "--farm", f"dask={place}", cwd=folder, env=os.environ | environment)
            assert done.returncode == bool(text) and text in done.stderr
            assert (folder / "out.exr").exists() == (not text)


def dies(job: str) -> str:
    """What a worker does whose job kills it."""
    if job == "deadly":
        os.kill(os.getpid(), 9)
    return job


class Unpicklable(Exception):
    def __init__(self, one: str, other: str):
        super().__init__(one + other)


def fails(job: str) -> None:
    raise errors.ParameterError(job) if job == "fails" else Unpicklable(job, "!")


def dies_once(mark: str) -> str:
    """What a worker does that is killed in mid-share, and the one after it."""
    if not os.path.exists(mark):
        Path(mark).touch()
        os.kill(os.getpid(), 9)
    return mark


def test_a_share_whose_worker_is_killed_is_done_by_another(folder):
    marks = [str(folder / f"mark{n}") for n in range(2)]
    with worker_processes(1, debugging=False) as pool:
        futures = [pool.submit(dies_once, mark, dask_cluster.RETRIES) for mark in marks]
        assert [future.result() for future in futures] == marks


def test_a_job_that_kills_its_worker_takes_no_other_with_it():
    with worker_processes(2, debugging=False) as pool:
        deadly, *others = (pool.submit(dies, job) for job in ("deadly", "a", "b", "c"))
        assert [future.result() for future in others] == ["a", "b", "c"]
        with pytest.raises(WorkerDied, match="was killed or ran out of memory"):
            deadly.result()


def test_a_worker_hands_errors_on_and_does_the_next_job():
    with worker_processes(1, debugging=False) as pool:
        for job, error in (("fails", errors.ParameterError), ("unpicklable", errors.Error)):
            with pytest.raises(error, match=job):
                pool.submit(fails, job).result()
        assert pool.submit(dies, "a").result() == "a"


@pytest.mark.slow
def test_a_share_whose_worker_is_killed_is_done_by_another_of_dask(folder, scheduler):
    marks = [str(folder / f"mark{n}") for n in range(3)]
    with dask_cluster.cluster(scheduler) as (client, count):
        assert count == 1
        assert sorted(dask_cluster.results(client, dies_once, marks)) == marks


@pytest.mark.slow
def test_a_job_that_kills_workers_of_dask_takes_no_other_with_it(scheduler):
    with dask_cluster.cluster(scheduler) as (client, _):
        ended = dask_cluster.results(client, dies, ["a", "deadly", "b"], lambda job, why: f"{job} failed")
        assert sorted(ended) == ["a", "b", "deadly failed"]


@pytest.mark.slow
def test_the_lines_of_the_page_make_one_image(folder):
    shutil.copy("a.png", "photo.png")
    page = (Path(__file__).parents[2] / "docs" / "how-to" / "farm.md").read_text()
    made = []
    for block in page.split("```sh\n")[1:]:
        path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
        lines = block.split("```")[0].replace("3000x2000", "300x1200")
        if "openjd" in lines and not shutil.which("openjd", path=path):
            continue
        subprocess.run(["sh", "-e", "-c", lines], check=True, timeout=600, env={**os.environ, "PATH": path})
        made.append(load(folder / "wall.exr"))
        (folder / "wall.exr").unlink()
    assert len(made) >= 2
    assert all(np.array_equal(made[0], other) for other in made)


@pytest.mark.slow
@pytest.mark.parametrize("local", [True, False])
def test_each_file_is_a_job_and_a_broken_one_stops_no_other(folder, local, request):
    place = "local:2" if local else request.getfixturevalue("scheduler")
    os.makedirs("photos")
    for name in ("a", "b"):
        shutil.copy("a.png", f"photos/{name}.png")
    with open("a.png", "rb") as whole, open("photos/half.png", "wb") as half:
        half.write(whole.read()[:-200])  # found by the worker
    with open("photos/none.png", "wb") as none:
        none.write(b"no picture")  # found before the work
    words = ["--farm", f"dask={place}", "--create-dir", "-o", "out/{name}.png"]
    done = oiiotex("--each", "photos/*.png", "--flip", *words, cwd=folder, env=dict(os.environ))
    assert done.returncode == 1
    assert sorted(line.split(": ")[1] for line in done.stderr.splitlines()) == ["photos/half.png", "photos/none.png"]
    run(["photos/a.png", "--flip", "-o", "one.png"])
    for name in ("a", "b"):
        same("one.png", f"out/{name}.png")
    for files, count in (("photos/none.png", 1), ("photos/b.png", 0)):  # no job, and one
        done = oiiotex("--each", files, "--texpatchmatch:size=48x48", *words, cwd=folder, env=dict(os.environ))
        assert (done.returncode, len(done.stderr.splitlines())) == (count, count)
