# SPDX-License-Identifier: Apache-2.0
"""A line on a farm: cost of tasks on 1 and 2 workers here, a model of 1,000 workers, and a plan for 1 Tpix.

`python -m benchmarks.studio.farm [--size 3000x6000] [--disk 2000]`

Measured costs are every share of a line alone, the join, and an empty task of Dask. A model of the scheduler and of a
shared disk replays them: the scheduler hands out tasks one after another, the disk transfers bytes one after another,
and workers compute in between. The model ignores network failures, differing machines and other jobs.
"""

from __future__ import annotations

import argparse
import heapq
import random
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from oiiotex_studio.farm.dask_cluster import cluster, results

from oiiotex.engine.core.demand import BAND_BYTES
from oiiotex.oiiotool.cli.language.parse import parse
from oiiotex.oiiotool.cli.language.sequences import Frame
from oiiotex.oiiotool.cli.running.shares import Shares, line_of
from oiiotex.oiiotool.cli.running.tasks import Job, Task, work
from oiiotex.oiiotool.cli.vocabulary import LANGUAGE
from tests import pictures
from tests.conftest import save

EXEMPLAR = 128  # px
NO_CELL = 99_999  # shares, of which the first has no cell
NOTHINGS = 400  # tasks that do nothing, by which the scheduler is timed
PIECE_ROWS = 64  # of a cell of a wide image, at least (cli/shares)
PLAN = 10**6  # px: side of the plane that is planned


class Costs(NamedTuple):
    """What was measured.

    Attributes
    ----------
    tasks : list of float
        s of CPU of each share of one cell, one thread. Wall-clock times would include the load of the machine.
    fixed : float
        Of a share of no cell: what every task costs before it makes a pixel.
    join : float
        s.
    dispatch : float
        s of the scheduler for one task.
    pixels, written, result : int
        Of the image; bytes of its shares, and of the file.
    """

    tasks: list[float]
    fixed: float
    join: float
    dispatch: float
    pixels: int
    written: int
    result: int


def nothing(job: int) -> int:
    return job


def timed(job: Job) -> tuple[str, float, float]:
    """Do a share: (its error, wall-clock s, s of CPU)."""
    start, cpu = time.perf_counter(), time.process_time()
    _, error, _ = work(job)
    return error, time.perf_counter() - start, time.process_time() - cpu


def cells_of(size: str) -> int:
    """How many cells an image of three channels is cut into."""
    width, height = map(int, size.split("x"))
    return -(-height // (max(1, BAND_BYTES // (width * 12) // PIECE_ROWS) * PIECE_ROWS))


def measured(folder: Path, size: str, count: int) -> Costs:
    """Every share alone, then the join."""
    line = ["photo.png", f"--texsynth:size={size}:seed=7", "-d", "half", "-o", "wall.exr"]
    task = Task(Frame(None, tuple(line)), len(parse(line, LANGUAGE).steps))
    words = line_of(line)
    job = Job(task, 1 << 30, 1, folder=str(folder))
    small = ("photo.png", "--texsynth:size=64x64", "-d", "half", "-o", "small.exr")
    assert not work(job._replace(task=Task(Frame(None, small), task.steps)))[1]  # warms up
    error, _, fixed = min(timed(job._replace(shares=Shares.of(words, 1, NO_CELL))) for _ in range(5))
    assert not error, error
    times = []
    for n in range(1, count + 1):
        error, _, cpu = timed(job._replace(shares=Shares.of(words, n, count)))
        assert not error, error
        times.append(cpu)
    parts = [path.stat().st_size for path in (folder / "wall.exr.parts").iterdir()]
    start = time.perf_counter()
    _, error, _ = work(job._replace(shares=Shares.of(words), threads=0))
    assert not error, error
    join = time.perf_counter() - start
    width, height = map(int, size.split("x"))
    result = (folder / "wall.exr").stat().st_size
    return Costs(times, fixed, join, 0.0, width * height, sum(parts), result)


class OnDask(NamedTuple):
    """Shares done by warm workers: wall-clock s, busy s of all workers, s of CPU in shares."""

    wall: float
    busy: float
    cpu: float
    dispatch: float  # s of a task that does nothing


def on_dask(folder: Path, size: str, count: int, workers: int) -> OnDask:
    line = ["photo.png", f"--texsynth:size={size}:seed={7 + workers}", "-d", "half", "-o", f"wall{workers}.exr"]
    task = Task(Frame(None, tuple(line)), len(parse(line, LANGUAGE).steps))
    job = Job(task, 1 << 30, 1, folder=str(folder))
    shares = [job._replace(shares=Shares.of(line_of(line), n, count)) for n in range(1, count + 1)]
    small = ("photo.png", "--texsynth:size=64x64", "-d", "half", "-o", "small.exr")
    with cluster(f"local:{workers}") as client:
        client.run(work, job._replace(task=Task(Frame(None, small), task.steps)))  # each worker warms up
        start = time.perf_counter()
        errors, clocks, cpus = zip(*results(client, timed, shares), strict=True)
        wall = time.perf_counter() - start
        assert not any(errors), errors
        start = time.perf_counter()
        for _ in results(client, nothing, list(range(NOTHINGS))):
            pass
        return OnDask(wall, sum(clocks), sum(cpus), (time.perf_counter() - start) / NOTHINGS)


def simulated(
    costs: Costs, workers: int, tasks: int, scale: float, disk: float, seed: int = 1
) -> tuple[float, float, str]:
    """Replay measured tasks on that number of workers.

    Parameters
    ----------
    costs : Costs
    workers, tasks : int
    scale : float
        How many more pixels a task makes than the measured ones, and how many more bytes it writes.
    disk : float
        Bytes/s that the disk takes from all together.
    seed : int
        By which tasks take one of the measured times.

    Returns
    -------
    (seconds, share of them that workers compute, what was waited for most)
    """
    draw = random.Random(seed)
    size = costs.written / len(costs.tasks) * scale
    free = [(0.0, n) for n in range(workers)]
    scheduler = disk_free = ended = work_done = 0.0
    waited = {"scheduler": 0.0, "disk": 0.0}
    computed: list[tuple[float, int]] = []  # what is ready to be written, in the order of time
    left = tasks
    while left or computed:
        if left and (not computed or (free and free[0][0] <= computed[0][0])) and free:
            asked, worker = heapq.heappop(free)
            given = max(asked, scheduler) + costs.dispatch
            scheduler = given
            waited["scheduler"] += given - asked
            takes = costs.fixed + scale * (draw.choice(costs.tasks) - costs.fixed)
            work_done += takes
            heapq.heappush(computed, (given + takes, worker))
            left -= 1
        else:
            ready, worker = heapq.heappop(computed)
            disk_free = max(ready, disk_free) + size / disk
            waited["disk"] += disk_free - ready
            heapq.heappush(free, (disk_free, worker))
            ended = max(ended, disk_free)
    return ended, work_done / workers / ended, max(waited, key=lambda name: waited[name])


def table(costs: Costs, disk: float) -> None:
    """The model for more workers, 16 tasks of 30 s for each."""
    scale = 30 / (sum(costs.tasks) / len(costs.tasks) - costs.fixed)
    print("\n| workers | tasks | s | efficiency | waited for most |\n|---|---|---|---|---|")
    for workers in (1, 2, 10, 100, 300, 1000, 3000, 10000):
        tasks = 16 * workers
        seconds, used, reason = simulated(costs, workers, tasks, scale, disk)
        print(f"| {workers} | {tasks} | {seconds:.0f} | {used:.2f} | {reason} |")
    rate = costs.written / len(costs.tasks) * scale / 30
    print(f"the scheduler is full at {30 / costs.dispatch:.0f} workers, the disk at {disk / rate:.0f}")


def plan(costs: Costs, disk: float) -> None:
    """1 Tpix: tasks, bytes, hours, and what breaks first."""
    pixels, tasks = PLAN**2, -(-PLAN // PIECE_ROWS)
    a_task = PLAN * PIECE_ROWS
    rate = costs.pixels / (sum(costs.tasks) - len(costs.tasks) * costs.fixed)  # of a thread
    scale = a_task / (costs.pixels / len(costs.tasks))
    print(f"\n1 Tpix, {PLAN} x {PLAN} px, half RGB")
    print(f"tasks: {tasks} of {a_task / 1e6:.0f} Mpix: {a_task / rate:.0f} s, {a_task * 12 / 1e9:.1f} GB as floats")
    shares, file = (count / costs.pixels * pixels / 1e12 for count in (costs.written, costs.result))
    print(f"bytes: {shares:.1f} TB of shares, {file:.1f} TB of file")
    for workers in (100, 1000):
        seconds, used, reason = simulated(costs, workers, tasks, scale, disk)
        print(f"{workers} workers: {seconds / 3600:.1f} h, {used:.2f} of them used; most wait for the {reason}")
    join = pixels / (costs.pixels / costs.join)
    moved = (shares + file) * 1e12 / disk
    print(f"join by one client: {join / 3600:.0f} h; its bytes alone {moved / 3600:.1f} h at {disk / 1e9:.0f} GB/s")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", default="3000x6000", help="size of the image whose shares are timed")
    parser.add_argument("--disk", type=float, default=2000.0, help="MB/s of the shared disk in the model")
    given = parser.parse_args()
    disk = given.disk * 1e6
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        save(pictures.pebbles(EXEMPLAR, EXEMPLAR, 1), folder / "photo.png", space="srgb_rec709_scene")
        count = cells_of(given.size)
        costs = measured(folder, given.size, count)
        total = sum(costs.tasks)
        least, most, pure = min(costs.tasks), max(costs.tasks), total - count * costs.fixed
        print(f"{given.size}, {count} shares of a cell: {least:.2f} to {most:.2f} s of CPU each, {total:.1f} s in all")
        print(f"of which {costs.fixed:.2f} s before a task makes a pixel: 5 % of tasks of {20 * costs.fixed:.0f} s")
        print(f"{costs.pixels / pure / 1e6:.2f} Mpix/s of a thread otherwise; the join {costs.join:.1f} wall-clock s")
        print(f"{costs.written / 1e6:.0f} MB of shares, {costs.result / 1e6:.0f} MB of file")
        for workers in (1, 2):
            dask = on_dask(folder, given.size, count, workers)
            costs = costs._replace(dispatch=dask.dispatch)
            print(
                f"dask=local:{workers}: {dask.wall:.1f} s, {1000 * dask.dispatch:.1f} ms for a task that does nothing"
            )
            print(f"  workers at work {dask.busy / workers / dask.wall:.3f} of the time (goal .9 of two);", end=" ")
            print(f"CPU in shares {dask.cpu / total:.2f} of that alone (goal 1.05)")
    table(costs, disk)
    plan(costs, disk)


if __name__ == "__main__":
    main()
