# SPDX-License-Identifier: Apache-2.0
"""Updates a library from a folder of photos: makes what has changed, with local processes or a farm, and records it.

A run claims an asset before making it, so concurrent runs share the work. An asset is a folder named by the hash of
everything that determines it: it is made in a working folder, renamed atomically, then recorded. If a run is killed,
folders are still complete, and all assets in the catalog exist.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, wait
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from oiiotex.engine.errors import Error, ParameterError, one_line

from ..api.files import digest_of, owned, remove_folder
from ..api.lines import Display, WorkerDied, memory, usable_threads, worker_processes
from ..recipes.found import Material, materials
from ..recipes.lines import require_confined, require_lines
from ..recipes.recipe import LibraryRecipe
from .asset import AssetJob, Outcome, key_of, make, read_sidecar, role_of
from .catalog import PLACES, SIDECAR, Asset, AssetLabel, Catalog
from .digests import digests_of, faults, is_text
from .report import convention_text
from .runs import WORK
from .steps import calling, read_step, step_path

_POLL = 0.3  # s between checks for assets of another run, and for steps of assets
_SHARES = 1000  # steps of progress per asset
_DIED = "its process has ended unexpectedly (killed, or out of memory)"


class IngestSettings(NamedTuple):
    """Settings of a run.

    `share`: (number, count) of the share of materials to make, without the catalog; (0, 0): all materials.
    """

    workers: int = 0  # Processes; 0: number of threads, at most number of materials
    budget: int = 0  # Memory for all workers, in bytes; 0: a quarter of the memory
    cluster: str = ""  # Address of a Dask scheduler; '': local processes
    share: tuple[int, int] = (0, 0)


class Tally(NamedTuple):
    """The result of a run."""

    made: int
    unchanged: int
    counts: dict[str, int]
    seconds: float

    @property
    def status(self) -> int:
        """The exit code: 1 if a material failed, 3 if one needs attention (review, asked)."""
        return 1 if self.counts.get("failed") else 3 if self.counts.get("review") or self.counts.get("asked") else 0


def ingest(
    photos: Path,
    library: Path,
    recipe: LibraryRecipe,
    settings: IngestSettings,
    say: Callable[[str], object],
    display: Display,
) -> Tally:
    """Create or update a library from a folder of photos."""
    start = time.perf_counter()
    require_lines(recipe)
    require_confined(recipe)
    if photos.resolve() == library.resolve():
        raise ParameterError(f"{library}: photos and library are the same folder: expected two folders")
    found = materials(photos, recipe)
    photos, library = photos.resolve(), library.resolve()
    for folder in (photos, library):
        if not is_text(folder):
            raise ParameterError(f"{folder}: the name is not UTF-8; rename the folder")
    number, count = settings.share
    if count:
        found = found[number - 1 :: count]
    with Catalog(library, create=True, recorded=not count) as catalog, catalog.run() as run:
        digests, unread = digests_of(photos, found, catalog)
        work = _IngestRun(photos, library, recipe, settings, say, display, catalog, run)
        todo = work.plan(found, digests, unread)
        return work.carry_out(todo, start)


@dataclass
class _IngestRun:
    """A run in progress."""

    photos: Path
    library: Path
    recipe: LibraryRecipe
    settings: IngestSettings
    say: Callable[[str], object]
    display: Display
    catalog: Catalog
    name: str
    counts: dict[str, int] = field(default_factory=dict)
    made: int = 0
    total: int = 0
    unchanged: int = 0
    underway: set[str] = field(default_factory=set)  # materials in the making

    def __post_init__(self) -> None:
        self._lock = threading.Lock()  # of what `_tell` shows

    def plan(self, found: Sequence[Material], digests: dict[str, str], unread: dict[str, str]) -> list[AssetJob]:
        """The jobs of a run. Questions and unreadable files are recorded; unchanged assets are counted."""
        old, asked, todo = self.catalog.assets(), list[tuple[Any, ...]](), []
        self.total = len(found)  # until the number of assets to make is known
        for material in found:
            before = old.get(material.name)
            own = {role: digests.get(file.path, "") for role, file in material.maps.items()}
            key = key_of(material, self.recipe, own)
            folder = str(owned(self.library / before.folder, self.library)) if before and before.folder else ""
            job = AssetJob(
                material, self.recipe, str(self.photos), str(self.library), "", folder,
                tuple(sorted(own.items())), 0, 0,
            )  # fmt: skip
            wrong = next((unread[file.path] for file in material.maps.values() if file.path in unread), "")
            if wrong:
                self._record(Outcome(material.name, None, wrong), job)
                continue
            questions = tuple(map(one_line, material.questions)) or self._taken_by_another(before, key)
            if questions:
                self._count("asked")
                if not before or before.reasons != questions:
                    self.say(f"{material.name}: asked: {'; '.join(questions)}")
                if not before or (not before.folder and before.reasons != questions):  # keep an existing folder
                    asked.append((Asset(material.name, key, "asked", "", questions, str(self.photos)), (), {}, (), ()))
                continue
            if before and self._is_made(before, key):
                self._count(before.status)
                self.unchanged += 1
                continue
            if before and before.status == "asked" and before.key == key:  # its maps do not tell
                self._count("asked")
                self.unchanged += 1
                continue
            todo.append(job)
        if asked:
            self.catalog.put_all(asked)
        return todo

    def _taken_by_another(self, before: Asset | None, key: str) -> tuple[str, ...]:
        """A question if another folder has a material of that name: they would replace each other at every run."""
        if before is None or before.key == key or before.root in ("", str(self.photos)) or before.status == "asked":
            return ()
        if not os.path.isdir(before.root):  # the other folder has been moved
            return ()
        return (f"{before.root} also has a material of that name: rename the files of one of them",)

    def _is_made(self, asset: Asset, key: str) -> bool:
        """Whether an asset is up to date and its folder exists."""
        return asset.key == key and asset.status in ("ok", "review") and (self.library / asset.folder).is_dir()

    def _count(self, status: str) -> None:
        self.counts[status] = self.counts.get(status, 0) + 1

    def carry_out(self, todo: list[AssetJob], start: float) -> Tally:
        """Run all jobs; wait for those that another run has claimed."""
        later, self.total = list(todo), self.made + len(todo)
        if todo:
            names = ", ".join(job.material.name for job in todo[:3]) + ", ..." * (len(todo) > 3)
            self.say(f"{len(todo)} to make ({names}), {self.unchanged} unchanged")
        self.display.stage("ingest", True)
        self._tell()
        while later:
            self.catalog.sweep()
            tried: set[str] = set()
            with calling(self._tell, _POLL):
                self._make(self._claimed(later, tried), len(later))
            later = [job for job in later if job.material.name not in tried]
            if later and not tried:
                time.sleep(_POLL)
        self.display.stage("ingest", False)
        return Tally(self.made, self.unchanged, self.counts, time.perf_counter() - start)

    def _tell(self) -> None:
        """Show the finished share of the run, and the step of the asset that is furthest."""
        with self._lock:
            steps = {name: read_step(step_path(str(self._work_of(name)))) for name in sorted(self.underway)}
            done = self.made + sum(share for share, _ in steps.values())
            self.display.advance(round(_SHARES * done), _SHARES * self.total)
            name = max(steps, key=lambda name: steps[name][0], default="")
            further = f" (and {len(steps) - 1} more)" * (len(steps) > 1)
            self.display.note(f"{one_line(name)}{further}, {steps[name][1]}".rstrip(", ") if name else "")

    def _claimed(self, jobs: Sequence[AssetJob], tried: set[str]) -> Iterator[AssetJob]:
        """Yield jobs that no other run has made or claimed, claiming each on demand, so that runs share the work."""
        for job in jobs:
            name = job.material.name
            if not self.catalog.claim(name, self.name):
                continue
            tried.add(name)
            asset = self.catalog.asset(name)
            if asset and self._is_made(asset, self._key(job)):  # by another run, meanwhile
                self.catalog.release(name, self.name)
                self._count(asset.status)
                self.unchanged += 1
                continue
            there = self._there(job)
            if there is None:
                self.underway.add(name)
                yield self._placed(job)
            else:
                self._record(Outcome(name, there), job)

    def _key(self, job: AssetJob) -> str:
        return key_of(job.material, self.recipe, dict(job.digests))

    # --- making ---

    def _make(self, jobs: Iterator[AssetJob], most: int) -> None:
        """Run at most `most` jobs as they arrive, and record the results."""
        if self.settings.cluster:
            for made, job in self._on_farm(list(jobs)):
                self._record(made, job)
            return
        workers = min(most, self.settings.workers or usable_threads())
        budget = self.settings.budget or memory() // 4
        threads = max(1, usable_threads() // workers)
        alone = []
        ready = (job._replace(budget=budget // workers, threads=threads) for job in jobs)
        for outcome, job in _in_processes(ready, workers):
            if outcome is None or outcome.short_of_memory:
                alone.append(job)
            else:
                self._record(outcome, job)
        for job in alone:  # retry failed jobs one at a time, with the whole memory budget
            again = job._replace(budget=budget, threads=usable_threads())
            for outcome, _ in _in_processes(iter([again]), 1):
                self._record(outcome or Outcome(job.material.name, None, _DIED), job)

    def _placed(self, job: AssetJob) -> AssetJob:
        return job._replace(work=str(self._work_of(job.material.name)))

    def _work_of(self, material: str) -> Path:
        return self.library / WORK / self.name / "assets" / material

    def _on_farm(self, jobs: list[AssetJob]) -> Iterator[tuple[Outcome, AssetJob]]:
        from ..farm.dask_cluster import cluster, results

        if not jobs:
            return
        by_name = {job.material.name: job for job in jobs}
        budget = self.settings.budget or memory() // 4
        with cluster(self.settings.cluster) as (client, _):
            ready = [job._replace(budget=budget) for job in jobs]
            for outcome in results(client, make, ready, lambda job, _: Outcome(job.material.name, None, _DIED)):
                yield outcome, by_name[outcome.name]

    # --- recording ---

    def _there(self, job: AssetJob) -> dict[str, Any] | None:
        """The asset.json of a folder that was made but not recorded, or None; removes broken folders."""
        key = self._key(job)
        for place in PLACES:
            folder = owned(self.library / place / job.material.name / key, self.library)
            if not folder.is_dir():
                continue
            with contextlib.suppress(Error, KeyError, TypeError, ValueError, AttributeError):
                sidecar = read_sidecar(folder)
                says = sidecar["name"], sidecar["key"], sidecar["status"] == "ok"
                if says == (job.material.name, key, place == "assets") and not faults(folder, sidecar["files"]):
                    _row(self.library, f"{place}/{job.material.name}/{key}", sidecar, "")  # raises if it is broken
                    return sidecar
            aside = self.library / WORK / self.name / f"broken-{key}"
            folder.rename(aside)
            remove_folder(aside, self.library / WORK)
        return None

    def _record(self, outcome: Outcome, job: AssetJob) -> None:
        """Move a finished folder to its place, then record and report it."""
        name, sidecar = outcome.name, outcome.sidecar
        with self._lock:
            self.made += 1
            self.underway.discard(name)
        self._tell()
        if sidecar is None:
            status = "asked" if outcome.asks else "failed"
            self._count(status)
            self.say(f"{name}: {status}: {outcome.error}")
            why, root = (outcome.error,), str(self.photos)
            before = self.catalog.asset(name)
            if not (outcome.asks and before and before.folder):  # keep an existing folder
                self.catalog.put(Asset(name, self._key(job), status, "", why, root, seconds=outcome.seconds))
            self.catalog.release(name, self.name)
            return
        folder = self._published(job, sidecar)
        self._count(sidecar["status"])
        self.catalog.put(*_row(self.library, folder, sidecar, str(self.photos)))
        self.catalog.release(name, self.name)
        own = sidecar["measures"]
        measures = ", ".join(f"{m} {own[m]:.3g}" for m in ("seam", "repeat") if m in own)
        told = own.get("convention")
        normals = "" if told is None else f", normals {convention_text(told)}"
        reasons = f" ({'; '.join(sidecar['reasons'])})" if sidecar["reasons"] else ""
        self.say(
            f"{name}: {sidecar['status']}{reasons}, {len(sidecar['files'])} files, "
            f"{sum(file['bytes'] for file in sidecar['files']) / 1e6:.1f} MB, {outcome.seconds:.1f} s"
            + (f", {measures}" if measures else "")
            + normals
        )

    def _published(self, job: AssetJob, sidecar: dict[str, Any]) -> str:
        """Move an asset's folder to its place, unless it is there, and return its path below the library."""
        place = "assets" if sidecar["status"] == "ok" else "review"
        folder = Path(place) / job.material.name / self._key(job)
        made = self._work_of(job.material.name)
        if made.is_dir():
            target = owned(self.library / folder, self.library)
            target.parent.mkdir(parents=True, exist_ok=True)
            try:
                made.rename(target)
            except OSError:
                if not (target / SIDECAR).is_file():
                    raise
                remove_folder(made, self.library / WORK)  # another run was first
        return folder.as_posix()


def _row(library: Path, folder: str, sidecar: dict[str, Any], root: str) -> tuple[Any, ...]:
    """The catalog row of an asset; TypeError, ValueError or KeyError if its asset.json is invalid."""
    names = ("name", "key", "status", "license", "author", "made")
    name, key, status, license, author, made = _texts(sidecar[key] for key in names)
    asset = Asset(
        name, key, status, folder, _texts(sidecar["reasons"]), root,
        license, author, int(sidecar["width"]), int(sidecar["height"]),
        _numbers(sidecar["tile_m"] or sidecar["size_m"]),
        _numbers(sidecar["color_lab"]), float(sidecar["seconds"]), made,
    )  # fmt: skip
    path = library / folder / SIDECAR
    files = [(*_texts((f["path"], f["role"])), int(f["bytes"]), *_texts([f["sha256"]])) for f in sidecar["files"]]
    files.append((SIDECAR, role_of(SIDECAR), path.stat().st_size, digest_of(path)))
    labels = [
        AssetLabel(_texts([one["name"]])[0], float(one["share"]), _numbers(one["color_lab"]))
        for one in sidecar["labels"]
    ]
    measures = sidecar["measures"]
    return asset, files, dict(zip(measures, _numbers(measures.values()), strict=True)), _texts(sidecar["tags"]), labels


def _texts(values: Iterable[Any]) -> tuple[str, ...]:
    strings = tuple(values)
    if not all(isinstance(one, str) for one in strings):
        raise TypeError(f"{strings}: expected strings")
    return strings


def _numbers(values: Iterable[Any]) -> tuple[float, ...]:
    return tuple(map(float, values))


def _in_processes(jobs: Iterator[AssetJob], workers: int) -> Iterator[tuple[Outcome | None, AssetJob]]:
    """Yield the results of jobs as they end, in persistent processes; None if a job's process has died.

    A job is taken only when a process is free, because another run may claim it before.
    """
    with worker_processes(workers, debugging=False) as pool:
        waiting = {pool.submit(make, job): job for job in itertools.islice(jobs, workers)}
        while waiting:
            done, _ = wait(waiting, return_when=FIRST_COMPLETED)
            for future in done:
                job = waiting.pop(future)
                try:
                    yield future.result(), job
                except WorkerDied:
                    yield None, job
                waiting |= {pool.submit(make, following): following for following in itertools.islice(jobs, 1)}
