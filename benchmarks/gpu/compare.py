# SPDX-License-Identifier: Apache-2.0
"""Compare what a device makes of small workloads with files, bit by bit: where the device is alone on its machine.

python -m benchmarks.gpu.compare expect FOLDER          write what the CPU here makes
python -m benchmarks.gpu.compare check FOLDER [--device gpu] [--out bits.md]   say where the device differs from it
"""

from __future__ import annotations

import argparse
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
    return folder / f"{workload.replace('/', '_')}.npz"


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


def check(folder: Path, device: str) -> str:
    """A table: for every workload and part, which share of the pixels differs, and where the first one does."""
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
    worker.stop()
    return "\n".join(rows) + "\n"


def main() -> None:
    """Write the files, or compare with them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("job", choices=("expect", "check"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--device", default="gpu", help="as for oiiotex")
    parser.add_argument("--out", type=Path, help="file for the table")
    arguments = parser.parse_args()
    if arguments.job == "expect":
        expect(arguments.folder)
        return
    said = check(arguments.folder, arguments.device)
    if arguments.out is not None:
        arguments.out.write_text(said)


if __name__ == "__main__":
    main()
