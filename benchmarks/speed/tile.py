# SPDX-License-Identifier: Apache-2.0
"""The demo's photo at 512x512, from the command line to the written tile, compared with other tools (shared/peers.py).

python -m benchmarks.speed.tile [--runs 5]

Every tool runs once to warm up (caches of files and kernels). Then all of them alternate, so that a slow phase of the
machine affects all. Other tools solve a smaller problem: most fix only the borders and keep light and stain, which LowF
shows.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path
from statistics import median

import numpy as np
import OpenImageIO as oiio

from benchmarks.shared.measures import machine, tile_figures
from benchmarks.shared.peers import PEERS, Tool, ToolError
from oiiotex.opencl.device import choose
from tools.demo import gravel, save, stained

SIZE = (512, 512)
OURS = Tool(
    "oiiotex",
    "pip install -e .",
    lambda: True,
    lambda photo, out, size: [
        sys.executable, "-m", "oiiotex", str(photo), "--texstationarize", "-o", str(out),
    ],
)  # fmt: skip
NUMBERS = "{:9.1f} {:9.1f} {:6.2f} {:6.3f} {:9.3f}"


def pixels(path: Path) -> np.ndarray:
    """(h, w, 3) uint8 of an image file; gray is repeated, alpha omitted."""
    values = oiio.ImageBuf(str(path)).get_pixels(oiio.UINT8)
    return values[..., :3] if values.shape[2] >= 3 else values[..., :1].repeat(3, axis=2)


def measure(tools: list[Tool], photo: Path, folder: Path, runs: int) -> dict[str, list[float]]:
    """Seconds of every run of every tool, by name; results stay in `folder`. Tools that fail are skipped."""
    seconds: dict[str, list[float]] = {tool.name: [] for tool in tools}
    for number in range(runs + 1):
        for tool in tools:
            if tool.name not in seconds:
                continue
            try:
                spent = tool.run(photo, folder / f"{tool.name}.png", SIZE)
            except ToolError as error:
                print(f"{tool.name} failed: {error}")
                del seconds[tool.name]
                continue
            if number > 0:
                seconds[tool.name].append(spent)
    return seconds


def print_table(seconds: dict[str, list[float]], photo: Path, folder: Path) -> None:
    """Times and quality of what each tool wrote; sharpness and contrast are relative to the photo without the stain."""
    clean = gravel().astype(np.float64)
    print(
        f"{'tool':24s} {'median s':>8s} {'min .. max':>15s} {'x ours':>7s}"
        f" {'wrap % x':>9s} {'wrap % y':>9s} {'LowF':>6s} {'sharp':>6s} {'contrast':>9s}  size"
    )
    print(f"{'(the photo)':24s} {'':32s}", NUMBERS.format(*tile_figures(pixels(photo), clean)))
    ours = median(seconds[OURS.name])
    for name, spent in seconds.items():
        made = pixels(folder / f"{name}.png")
        spread = f"{min(spent):.2f} .. {max(spent):.2f}"
        print(
            f"{name:24s} {median(spent):8.2f} {spread:>15s} {median(spent) / ours:7.2f}",
            NUMBERS.format(*tile_figures(made, clean)) + f"  {made.shape[1]}x{made.shape[0]}",
        )


def main() -> None:
    """Run all tools that are installed and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=5, help="of each tool, after one to warm up")
    arguments = parser.parse_args()
    if arguments.runs < 1:
        parser.error("--runs must be 1 or more")
    print(machine())
    print(f"oiiotex on {choose().name}; runs of each tool: {arguments.runs}", flush=True)
    tools = [OURS]
    for peer in PEERS:
        if peer.available():
            tools.append(peer)
        else:
            print(f"{peer.name} is not installed: {peer.install}")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        photo = folder / "photo.png"
        save(stained(gravel()), photo)
        seconds = measure(tools, photo, folder, arguments.runs)
        if OURS.name not in seconds:
            sys.exit(1)
        print_table(seconds, photo, folder)


if __name__ == "__main__":
    main()
