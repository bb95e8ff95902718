# SPDX-License-Identifier: Apache-2.0
"""A library made by shares, jobs and processes: who is at what, and what the death of one leaves to others."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path

from oiiotex_studio.library import asset as making
from oiiotex_studio.library import catalog as catalogs
from oiiotex_studio.library import ingest, runs
from oiiotex_studio.library.catalog import Catalog
from oiiotex_studio.library.commands import run
from oiiotex_studio.library.steps import StepFile, read_step, step_path
from oiiotex_studio.library.upkeep import check

from oiiotex.oiiotool.cli.running.progress import Display
from tests import pictures as drawn
from tests.conftest import save
from tests.library_makings import LINE, brought_in, recipe, touched
from tests.library_makings import here as here
from tests.library_makings import photos as photos


def test_shares_are_made_apart_and_recorded_by_the_run_that_joins(photos, tmp_path, here, monkeypatch):
    library = tmp_path / "library"
    for share in ((1, 2), (2, 2)):
        tally, _ = brought_in(photos, library, recipe(), share=share)
        assert tally.made == 1
    assert not (library / runs.FILE).exists()
    monkeypatch.setattr(making, "make", None)  # nothing is made any more
    tally, _ = brought_in(photos, library, recipe())
    assert tally.counts == {"ok": 2}
    with Catalog(library) as catalog:
        assert list(check(catalog)) == []


def test_a_job_template_has_shares_and_a_join(photos, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("r.toml").write_text("schema = 1\n" + LINE)
    assert run(["ingest", "photos", "lib", "--recipe", "r.toml", "--farm", "openjd=job.json,3"]) == 0
    template = json.loads(Path("job.json").read_text())
    words = template["steps"][0]["script"]["actions"]["onRun"]["args"]
    assert " ".join(words[4:]) == "ingest photos lib --recipe r.toml --share {{Task.Param.Share}}/3 --openjd"
    assert template["parameterDefinitions"][1]["default"] == "oiiotex-library"


def test_claims_of_a_dead_run_are_free_and_those_of_a_live_one_are_not(tmp_path):
    with Catalog(tmp_path, create=True) as one, Catalog(tmp_path) as two:
        with one.run() as run_one, two.run() as run_two:
            assert one.claim("moss", run_one) and not two.claim("moss", run_two)
            two.sweep()
            assert not two.claim("moss", run_two)
            one.release("moss", run_one)
            assert two.claim("moss", run_two)
        with one.run() as run_one:
            assert one.claim("moss", run_one)
        dead = tmp_path / runs.WORK / "run-0123456789abcdef"
        dead.mkdir()
        (dead / "half").touch()
        one.put(catalogs.Asset("moss", "k", "ok"))
        with one._transaction():
            one._data.execute("INSERT INTO claims VALUES ('moss', ?)", (dead.name,))
        with two.run() as run_two:
            assert two.claim("moss", run_two) and not dead.exists()


def dies_or_makes(job: making.AssetJob) -> making.Outcome:
    """What a worker does whose material kills it."""
    if job.material.name.startswith("deadly"):
        os.kill(os.getpid(), 9)
    return making.Outcome(job.material.name, None, "made")


def test_a_material_that_kills_its_process_takes_no_other_with_it(tmp_path, monkeypatch):
    monkeypatch.setattr(ingest, "make", dies_or_makes)
    for name in ("a", "b", "deadly", "z"):
        save(drawn.noise(8, 8, 1)[..., None], touched(tmp_path, "p/x") and tmp_path / "p" / f"{name}.png")
    (tmp_path / "p/x").unlink()
    tally, said = brought_in(tmp_path / "p", tmp_path / "library", recipe(), workers=2)
    assert tally.counts == {"failed": 4}
    assert sorted(said[1:]) == [
        "a: failed: made", "b: failed: made",
        "deadly: failed: its process has ended unexpectedly (killed, or out of memory)", "z: failed: made",
    ]  # fmt: skip


def test_what_is_short_of_memory_is_tried_alone_with_all_of_it(photos, tmp_path, monkeypatch):
    seen = []

    def outcomes(jobs, workers):
        for job in jobs:
            seen.append((workers, job.budget))
            yield making.Outcome(job.material.name, None, "x", short_of_memory=job.budget < 1 << 30), job

    monkeypatch.setattr(ingest, "_in_processes", outcomes)
    _, said = brought_in(photos, tmp_path / "library", recipe(), workers=2, budget=1 << 30)
    assert seen == [(2, 1 << 29)] * 2 + [(1, 1 << 30)] * 2
    assert said == ["2 to make (gravel, wall), 0 unchanged", "gravel: failed: x", "wall: failed: x"]


def reports_and_waits(job: making.AssetJob) -> making.Outcome:
    """What a worker does that is half done, until its run has seen it."""
    step = StepFile(job.work)
    step.advance(1, 2)
    step.begin("tile")
    while not (Path(job.photos).parent / "seen").exists():
        time.sleep(0.01)
    return making.Outcome(job.material.name, None, "made")


class Noted(Display):
    """A display that keeps what it is told of."""

    def __init__(self, seen: Path):
        super().__init__(terminal=False)
        self.noted, self.seen = set[tuple[str, float]](), seen

    def note(self, text: str) -> None:
        super().note(text)
        self.noted.add((text, self._done / self._total))
        if "tile" in text:
            self.seen.touch()


def test_a_run_shows_the_step_of_an_asset_in_the_making_in_another_process(photos, tmp_path, monkeypatch):
    monkeypatch.setattr(ingest, "make", reports_and_waits)
    display, settings = Noted(tmp_path / "seen"), ingest.IngestSettings(workers=1)
    ingest.ingest(photos, tmp_path / "library", recipe(), settings, lambda text: None, display)
    assert ("gravel, tile", 0.25) in display.noted  # half of the first of two
    assert display.noted >= {("", 0.0), ("", 0.5), ("", 1.0)}


def test_an_asset_reports_its_lines_their_ops_and_its_delivery(photos, tmp_path, here, monkeypatch):
    told = []

    class Recorded(StepFile):
        def _write(self) -> None:
            super()._write()
            told.append(read_step(self._path))

    monkeypatch.setattr(making, "StepFile", Recorded)
    monkeypatch.setattr("oiiotex_studio.library.steps._TICK", 0)
    brought_in(photos, tmp_path / "library", recipe(LINE.replace("$maps", "$maps --median 3x3")))
    shares, steps = zip(*told[: 1 + [step for _, step in told].index("pictures")], strict=True)
    assert list(shares) == sorted(shares) and shares[0] == 0 and 0.9 < shares[-1] < 1
    assert {"tile", "tile --median", "tile write", "measures and documents", "pictures"} <= set(steps)


def test_an_asset_that_cannot_report_its_step_is_made_all_the_same(photos, tmp_path, here, monkeypatch):
    monkeypatch.setattr("oiiotex_studio.library.steps._FOLDER", "lock/steps")  # below a file
    tally, _ = brought_in(photos, tmp_path / "library", recipe())
    assert tally.counts == {"ok": 2}
    assert read_step(step_path(str(tmp_path / "assets/none"))) == (0.0, "")
