# SPDX-License-Identifier: Apache-2.0
"""Peak memory of every filter that streams, on large images under a small budget.

python -m benchmarks.speed.memory [--side 10000] [--cache 512] [--limit 600] [--only PART] [--rows FILE]

Each line runs once. Images have SIDE x SIDE px, so the default is 100 megapixels: photos of clover, mirrored and
brightened here and there. Peak is the largest resident size of the process. It includes libraries and the pages of
mapped files, which the system takes back when it needs them; "own" is without these. A line that has taken `--limit`
CPU seconds is ended, and its row says so: such a row is a lower bound.

With `--rows`, each row is written to FILE when it is ready, and lines that have a row there are not run again.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import OpenImageIO as oiio

from benchmarks.shared.measures import data_folder
from oiiotex.engine.errors import one_line

PROGRAM = (sys.executable, "-m", "oiiotex", "--iscolorspace", "sRGB")
HEAD = "| line | megapixels | CPU s | peak MB | own MB | outcome |\n|---|---|---|---|---|---|"
LINES = (  # SIDE is the side of a large image. A line may read what an earlier one wrote
    "photo.tif st.exr --texwarp -d uint8 -o out.tif",
    "photo.tif --texlab -d half -o out.exr",
    "photo.tif --texflatten -d uint8 -o out.tif",
    "photo.tif --texstationarity -o out.exr",
    "photo.tif --texrectify:corners=9,5,SIDE,50,SIDE,SIDE,1,SIDE -d uint8 -o out.tif",
    "heights.tif --texestimateao -o out.exr",
    "photo.tif --texestimateroughness -o out.exr",
    "photo.tif --texcheckmaterial:fail=none -d uint8 -o out.tif",
    "photo.tif --texpreview -o out.png",
    "photo.tif --texdominant -o out.png",
    "photo.tif --texdecompose -o out.exr",
    "photo.tif --texsuperpixel -o out.exr",
    "photo.tif --texlabel -o labels.exr",
    "photo.tif --texlabel:photo=1 -o labeled.exr",
    "labeled.exr --texlabelview -o out.png",
    "labeled.exr --texcontent -o out.png",
    "labeled.exr --texpalette -o out.png",
    "photo.tif other.tif --iscolorspace sRGB third.tif --iscolorspace sRGB --texcapture:lights=0,1,1,-1,-.5,1,1,-.5,1"
    " -d half -o out.exr",
    "photo.tif region.tif --texfill -d uint8 -o out.tif",
    "photo.tif --texsynth -o out.png",
    "photo.tif --texzoom:frame=41 -o out.png",
    "photo.tif --texquilt:size=1024x1024 -o out.png",
    "photo.tif --texcut:size=512x512 -o out.png",
    "photo.tif --texpatchmatch:size=1024x1024 -o out.png",
    "photo.tif --texstationarize:size=1024x1024 -o out.png",
    "512.png --texsynth:size=SIDExSIDE -d uint8 -o out.tif",
    "512.png --texzoom:frame=41:size=SIDExSIDE -d uint8 -o out.tif",
    "512.png --texquilt:size=SIDExSIDE -d uint8 -o out.tif",
    "labels512.exr --texcomposite:size=SIDExSIDE -d uint8 -o out.tif",
    "labels512.exr painting.tif --texpaint -d uint8 -o out.tif",
    "512.png --texpatchmatch:size=SIDExSIDE -d uint8 -o out.tif",
    "512.png --texstationarize:size=SIDExSIDE -d uint8 -o out.tif",
)
PREPARED = (  # small ones, by the program itself
    "512.png --texlabel:photo=1 -o labels512.exr",
)
_BAND = 64  # rows of a tile


class Peak(NamedTuple):
    """Cost of a process: CPU seconds, peak resident megabytes, those without mapped files, and how it ended."""

    cpu: float
    resident: int
    own: int
    outcome: str


def watched(words: list[str], folder: Path, limit: float) -> Peak:
    """Run a command, which is ended after `limit` CPU seconds."""
    own, ended = 0, False
    with open(folder / "messages.txt", "w+") as messages:
        process = subprocess.Popen(words, cwd=folder, stdout=messages, stderr=messages)
        while True:
            pid, status, usage = os.wait4(process.pid, os.WNOHANG)
            if pid:
                break
            own = max(own, _own_memory(process.pid))
            if not ended and _seconds(process.pid) > limit:
                process.terminate()
                ended = True
            time.sleep(0.05)
        messages.seek(0)
        said = [one_line(line) for line in messages.read().splitlines() if "ERROR" in line]
    code = os.waitstatus_to_exitcode(status)
    outcome = "ended at the limit" if ended else "done" if code == 0 else said[-1] if said else f"exit code {code}"
    return Peak(usage.ru_utime + usage.ru_stime, usage.ru_maxrss >> 10, own, outcome)


def _own_memory(pid: int) -> int:
    """Resident megabytes of a running process that are not of files."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return 0
    return sum(int(line.split()[1]) for line in lines if line.startswith("RssAnon")) >> 10


def _seconds(pid: int) -> float:
    """CPU seconds of a running process, all threads."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def in_bands(path: Path, side: int, kind: str, channels: int, band_at: Callable[[np.ndarray], np.ndarray]) -> None:
    """Write a square image by tiles; `band_at`: rows (n,) -> their pixels (n, side, channels)."""
    spec = oiio.ImageSpec(side, side, channels, kind)
    spec.tile_width = spec.tile_height = _BAND
    out = oiio.ImageOutput.create(str(path))
    out.open(str(path), spec)
    for first in range(0, side, _BAND):
        last = min(side, first + _BAND)
        band = np.ascontiguousarray(band_at(np.arange(first, last)))
        if not out.write_tiles(0, side, first, last, 0, 1, band):
            raise SystemExit(out.geterror())
    out.close()


def write_images(folder: Path, side: int) -> None:
    """The files that the lines name."""
    photo = oiio.ImageBuf(str(data_folder() / "photos" / "clover_lawn.jpg"))
    small = oiio.ImageBufAlgo.resize(photo, roi=oiio.ROI(0, 512, 0, 512))
    small.write(str(folder / "512.png"), "uint8")
    clover = photo.get_pixels(oiio.UINT8)[..., :3]
    x = np.arange(side)
    waves = np.sin(x / 900.0)

    def mirrored(places: np.ndarray) -> np.ndarray:
        return np.abs((places + len(clover)) % (2 * len(clover)) - len(clover)).clip(0, len(clover) - 1)

    def lit(y: np.ndarray, shift: int) -> np.ndarray:
        """Clover whose brightness varies, moved by a shift."""
        values = clover[mirrored(y + shift)][:, mirrored(x + 3 * shift)]
        return (values * (0.8 + 0.2 * waves[y][:, None, None] * waves[None, :, None])).astype(np.uint8)

    def swirled(y: np.ndarray) -> np.ndarray:
        """Source coordinates, 0 to 1: every row reads from rows far apart."""
        s, t = x[None] + 0.5 + 300 * waves[y][:, None], y[:, None] + 0.5 + 300 * waves[None]
        return (np.stack([s, t], -1) / side % 1).astype(np.float32)

    for name, shift in (("photo.tif", 0), ("other.tif", 2), ("third.tif", 5)):
        in_bands(folder / name, side, "uint8", 3, lambda y, shift=shift: lit(y, shift))
    in_bands(folder / "heights.tif", side, "uint8", 1, lambda y: lit(y, 0)[..., 1:2])
    in_bands(folder / "st.exr", side, "float", 2, swirled)
    half, reach = side // 2, min(300, side // 8) ** 2
    in_bands(
        folder / "region.tif", side, "uint8", 1,
        lambda y: np.uint8(255) * (((y[:, None] - half) ** 2 + (x[None] - half) ** 2) < reach)[..., None],
    )  # fmt: skip
    in_bands(
        folder / "painting.tif", side, "uint8", 1,
        lambda y: (1 + (waves[y][:, None] * waves[None] > 0)).astype(np.uint8)[..., None],
    )  # fmt: skip


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--side", type=int, default=10000)
    parser.add_argument("--cache", type=int, default=512, help="MB")
    parser.add_argument("--limit", type=float, default=600, help="CPU seconds of a line")
    parser.add_argument("--only", default="", help="lines that contain this")
    parser.add_argument("--rows", type=Path, help="file of rows")
    given = parser.parse_args()
    rows = given.rows.read_text().splitlines() if given.rows and given.rows.exists() else []
    print(HEAD)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        size = {"SIDE": str(given.side)}
        write_images(folder, given.side)
        for line in PREPARED:
            watched([*PROGRAM, *_filled(line, size)], folder, given.limit)
        for line in LINES:
            key = f"| `{line}` | {given.side**2 / 1e6:.0f} |"
            row = next((row for row in rows if row.startswith(key)), "")
            if given.only not in line:
                continue
            if not row:
                words = [*PROGRAM, "--cache", str(given.cache), *_filled(line, size)]
                peak = watched(words, folder, given.limit)
                row = f"{key} {peak.cpu:.0f} | {peak.resident} | {peak.own} | {peak.outcome} |"
                if given.rows:
                    with given.rows.open("a") as file:
                        print(row, file=file)
            print(row, flush=True)


def _filled(line: str, size: dict[str, str]) -> list[str]:
    """Words of a line, with its sizes."""
    for name, number in size.items():
        line = line.replace(name, number)
    return line.split()


if __name__ == "__main__":
    main()
