# SPDX-License-Identifier: Apache-2.0
"""Response times of the page: opening, slider to first tile, stroke to texture, tiles per second, memory after strokes.

`python -m benchmarks.studio.live [--photo 512] [--painting 2048] [--runs 20] [--strokes 500]`: in Chromium.

Median and 95 %.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from pathlib import Path

import numpy as np

from tests import pictures
from tests.browser import Served, chromium, end_resident, resident_pid
from tests.conftest import save

SLIDER = """async (value) => {
  const room = document.querySelector("[data-tile]");
  const row = [...document.querySelectorAll(".row")].find((one) => one.firstChild.textContent === "Sigma");
  const slider = row.querySelector("input[type=range]");
  const { turn } = room.dataset;
  const begun = performance.now();
  slider.value = value;
  slider.dispatchEvent(new Event("input"));
  while (room.dataset.turn === turn) await new Promise((go) => setTimeout(go, 2));
  return performance.now() - begun;
}"""
STROKE = """async ([x, y, paint]) => {
  const { rooms, shell } = await import("./main.js");
  const room = rooms.paint;
  Object.assign(shell.state.paint, paint);
  const before = room.element.dataset.step;
  const event = { pointerType: "mouse" };
  const begun = performance.now();
  room.down(x, y, event);
  room.move(x + 40, y + 20, event);
  room.up();
  while (!room.element.dataset.step) await new Promise((go) => setTimeout(go, 2));
  return performance.now() - begun;
}"""
FLY = """async (octaves) => {
  const { rooms } = await import("./main.js");
  const room = rooms.zoom;
  const before = room.tiles.size;
  const begun = performance.now();
  room.fly(octaves);
  await new Promise((go) => setTimeout(go, 30));
  while (room.element.dataset.missing !== "0") await new Promise((go) => setTimeout(go, 2));
  return [performance.now() - begun, room.tiles.size - before];
}"""


def line(name: str, times: list[float], unit: str = "ms") -> None:
    """A row of the table."""
    print(
        f"| {name} | {np.median(times):.0f} {unit} | {np.percentile(times, 95):.0f} {unit} | {len(times)} |", flush=True
    )


def resident_memory(folder: Path) -> int:
    """MB that the resident process holds."""
    rows = (row.split() for row in Path(f"/proc/{resident_pid(folder)}/status").read_text().splitlines())
    return next(int(row[1]) for row in rows if row[0] == "VmRSS:") >> 10


def cpu_seconds(*processes: int) -> float:
    """User and system time of processes."""
    rows = (Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split() for process in processes)
    return sum(int(row[11]) + int(row[12]) for row in rows) / os.sysconf("SC_CLK_TCK")


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser()
    for name, default in (("photo", 512), ("painting", 2048), ("runs", 20), ("strokes", 500)):
        parser.add_argument(f"--{name}", type=int, default=default)
    given = parser.parse_args()
    rng = np.random.default_rng(1)
    with tempfile.TemporaryDirectory(prefix="oxl") as name, chromium() as browser:
        folder = Path(name)
        save(pictures.stained(pictures.bricks(given.photo, given.photo, seed=1)), folder / "photo.png")
        server = Served(folder, "photo.png", "--iscolorspace", "srgb_rec709_scene", runtime=folder)
        page = browser.new_page(viewport={"width": 1280, "height": 720})
        page.set_default_timeout(300_000)
        begun = time.monotonic()
        page.goto(server.url)
        page.wait_for_selector(".thumb >> nth=3")
        took, cpu = time.monotonic() - begun, cpu_seconds(server.process.pid, resident_pid(folder))
        page.wait_for_selector("[data-tile=whole]")
        time.sleep(5)
        print("| | median | 95 % | of |\n|---|---|---|---|")
        line(f"from opening to four coarse tiles, {given.photo} px", [1000 * took])
        print(f"| CPU time of both processes from their start to these | {cpu:.1f} s | | 1 |")
        times = []
        for value in rng.uniform(0.2, 0.8, given.runs):
            times.append(page.evaluate(SLIDER, float(value)))
            time.sleep(0.5)
        line(f"slider to first tile, {given.photo} px", times)
        size = {"width": given.painting, "height": given.painting, "brush": 64}
        page.evaluate("(size) => import('./main.js').then(({ shell }) => shell.set('paint', size))", size)
        page.click("#tab-paint")
        page.wait_for_selector("[data-step='0']")
        labels = page.evaluate("import('./main.js').then(({ rooms }) => rooms.paint.labels.map((one) => one.id))")
        parents = page.evaluate("import('./main.js').then(({ rooms }) => [...rooms.paint.parents])")
        places = rng.uniform(64, given.painting - 128, (given.strokes, 2))
        first = resident_memory(folder)
        others = labels[1:]
        coarse = [{"layer": "coarse", "label": others[n % len(others)], "finer": 0} for n in range(given.strokes)]
        times = [page.evaluate(STROKE, [*map(float, at), paint]) for at, paint in zip(places, coarse, strict=True)]
        line(f"stroke of 64 px to texture, {given.painting} px", times)
        print(f"| memory before and after these strokes | {first} MB | {resident_memory(folder)} MB | 1 |")
        fine = {
            "layer": "fine",
            "label": labels[0],
            "finer": next(n for n, some in enumerate(parents) if labels[0] in some),
        }
        times = [page.evaluate(STROKE, [*map(float, at), fine]) for at in places[: given.runs]]
        line(f"stroke of a finer label to texture, {given.painting} px", times)
        page.click("#tab-zoom")
        page.wait_for_selector("[data-missing='0']")
        rates = []
        for _ in range(min(given.runs, 20)):
            took, tiles = page.evaluate(FLY, 1)
            rates.append(1000 * tiles / took)
        line("tiles of 256 px a second, one octave after the other", rates, "/s")
        page.close()
        server.end()
        end_resident(folder)


if __name__ == "__main__":
    main()
