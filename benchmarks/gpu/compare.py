# SPDX-License-Identifier: Apache-2.0
"""Compare what a device makes of small workloads with files, bit by bit: where the device is alone on its machine.

python -m benchmarks.gpu.compare expect FOLDER          write what the CPU here makes
python -m benchmarks.gpu.compare check FOLDER [--device gpu] [--out bits.md]   say where the device differs from it
"""

from __future__ import annotations

import argparse
import re
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.gpu import run, table, workloads

_SECONDS = 120.0  # at most, for one workload
_LARGE = "analysis"  # in the names of workloads whose results are some 50 MB


def compared() -> list[str]:
    """The workloads, but those with results that are too large to be packed."""
    return [name for name in workloads.COMPARED if _LARGE not in name]


def file_of(workload: str, folder: Path) -> Path:
    """The file of a workload's pixels."""
    return folder / f"{re.sub(r'[^a-z0-9]+', '_', workload.lower())}.npz"


def expect(folder: Path) -> None:
    """Write the pixels that the CPU makes, compressed."""
    folder.mkdir(parents=True, exist_ok=True)
    worker = run.Worker("cpu")
    for workload in compared():
        path = file_of(workload, folder)
        worker.ask(_SECONDS, do="compare", workload=workload, side=run.COMPARED_SIDE, path=str(path))
        with np.load(path) as made:
            np.savez_compressed(path, **made)
    worker.stop()


def check(folder: Path, device: str, out: Path) -> None:
    """Write a table, row by row: for every workload and part, which share of pixels differs, first where."""
    rows = [f"| workload, {run.COMPARED_SIDE} px | compared with the CPU that packed |", "|---|---|"]
    worker = run.Worker(device)
    with tempfile.TemporaryDirectory(prefix="oiiotex-gpu-") as scratch:
        for workload in compared():
            made = file_of(workload, Path(scratch))
            try:
                worker.ask(_SECONDS, do="compare", workload=workload, side=run.COMPARED_SIDE, path=str(made))
                parts = run.differences(str(made), str(file_of(workload, folder)))
                said = "; ".join(f"{n.strip()}: {table.difference(part) or 'equal'}" for n, part in parts.items())
            except (run.Failed, FileNotFoundError) as failed:
                said = f"failed: {failed}"
            rows.append(f"| {workload} | {table.short(said)} |")
            print(rows[-1], flush=True)
            out.write_text("\n".join(rows) + "\n")
    worker.stop()


def main() -> None:
    """Write the files, or compare with them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("job", choices=("expect", "check"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--device", default="gpu", help="as for oiiotex")
    parser.add_argument("--out", type=Path, default=Path("bits.md"), help="file for the table")
    arguments = parser.parse_args()
    if arguments.job == "expect":
        expect(arguments.folder)
    else:
        check(arguments.folder, arguments.device, arguments.out)


if __name__ == "__main__":
    main()
