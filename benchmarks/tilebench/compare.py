# SPDX-License-Identifier: Apache-2.0
"""Every installed tool makes a tile of every photo: one table, and a page where people vote.

python -m benchmarks.tilebench.compare OUT [--side 256] [--photos N] [--tools NAME ...] [--drift gradient+stain]

A known gradient and stain (benchmarks/tiles/drifts.py) are added to textures whose clean form is known. A good tile has
the energies of the clean texture, and none of what was added. Photos are made by code, or come with scikit-image (CC0),
so everything in OUT may be published. Tiles that are there are not made again.

OUT receives table.md. OUT/tiles receives the photos, the tiles, results.json and vote.html. README.md explains the
columns, how to add a tool, and how TexTile judges.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path
from shutil import which

import numpy as np
import OpenImageIO as oiio
from skimage import color

from benchmarks.shared.measures import machine
from benchmarks.shared.peers import PEERS, Tool, ToolError
from benchmarks.tilebench.votes import page
from benchmarks.tiles import drifts
from benchmarks.tiles.first_tile import measured
from tests import pictures
from tools.demo import save
from tools.docs.pictures.layout import pixels

HERE = Path(__file__).parent
SEED = 1


def ours(name: str, words: str) -> Tool:
    """oiiotex with a line, as a tool."""
    line = [sys.executable, "-m", "oiiotex"]
    return Tool(
        name, "pip install oiiotex[cpu]", lambda: True, lambda photo, out, _: [*line, str(photo), words, "-o", str(out)]
    )


def listed(file: Path) -> tuple[Tool, ...]:
    """The tools of a TOML file."""

    def tool(facts: dict) -> Tool:
        def command(photo: Path, out: Path, size: tuple[int, int]) -> list[str]:
            known = {"photo": photo, "tile": out, "width": size[0], "height": size[1]}
            return [word.format(**known) for word in facts["command"]]

        return Tool(facts["name"], facts["install"], lambda: which(facts["command"][0]) is not None, command)

    return tuple(map(tool, tomllib.loads(file.read_text()).get("tool", ())))


def tools() -> tuple[Tool, ...]:
    """All tools: ours, those of benchmarks/shared/peers.py, those of tools.toml."""
    mine = ours("oiiotex", "--texstationarize"), ours("oiiotex-patchmatch", "--texpatchmatch")
    return (*mine, *PEERS, *listed(HERE / "tools.toml"))


def photos(side: int) -> dict[str, np.ndarray]:
    """Clean textures, (side, side, 3) uint8: three of scikit-image, three made by code."""
    import skimage

    inside = Path(skimage.__file__).parent / "data"
    found = {name: drifts.square(inside / f"{name}.png", side) for name in ("gravel", "grass", "brick")}
    makers: dict[str, Callable[[int, int, int], np.ndarray]] = {
        "made_bricks": pictures.bricks, "made_pebbles": pictures.pebbles, "made_moss": pictures.moss,
    }  # fmt: skip
    for name, make in makers.items():
        found[name] = np.rint(255 * make(side, side, SEED)).astype(np.uint8)
    return {name: picture for name, picture in found.items() if picture is not None}


def made(tool: Tool, photo: Path, tile: Path, side: int) -> float:
    """Make a tile: CPU seconds of the tool.

    Raises
    ------
    ToolError
        It failed.
    """
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    tool.run(photo, tile, (side, side))
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def judged_by_textile(out: Path) -> dict[str, float]:
    """TexTile's figure of every tile, by file name; empty without $TEXTILE_PYTHON and $TEXTILE_WEIGHTS."""
    python, weights = (os.environ.get(name) for name in ("TEXTILE_PYTHON", "TEXTILE_WEIGHTS"))
    if not python or not weights:
        return {}
    command = [python, str(HERE / "textile_judge.py"), weights, str(out)]
    return json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout)


COLUMNS = (
    ("bands kept", lambda rows: f"{np.mean([kept(row) for row in rows]):.2f}"),
    ("drift gone", lambda rows: mean_of(rows, "gone")),
    ("seam", lambda rows: mean_of(rows, "seam")),
    ("spread", lambda rows: mean_of(rows, "spread")),
    ("copies more", lambda rows: f"{np.mean([row['copies'] - row['copies_clean'] for row in rows]):.1f}"),
    ("CPU s", lambda rows: mean_of(rows, "seconds")),
    ("TexTile", lambda rows: mean_of(rows, "textile")),
)


def kept(row: dict) -> float:
    """Share of the three band energies within .8 to 1.25 of the clean texture's."""
    return float(np.mean([drifts.KEPT[0] <= band <= drifts.KEPT[1] for band in row["bands"]]))


def mean_of(rows: list[dict], key: str) -> str:
    """The mean of what is known."""
    known = [row[key] for row in rows if row.get(key) is not None]
    return f"{np.mean(known):.2f}" if known else ""


def table(results: dict[str, dict[str, dict]]) -> str:
    """Markdown: a row for each tool, means over the photos."""
    lines = ["| tool | tiles | " + " | ".join(name for name, _ in COLUMNS) + " |", "|---" * (len(COLUMNS) + 2) + "|"]
    for name, of_photos in results.items():
        rows = [row for row in of_photos.values() if "bands" in row]
        cells = [cell(rows) for _, cell in COLUMNS] if rows else [""] * len(COLUMNS)
        lines.append(f"| {name} | {len(rows)} of {len(of_photos)} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Make what is missing, measure, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, nargs="?", default=Path("tilebench-out"))
    parser.add_argument("--side", type=int, default=256, help="px (default: 256)")
    parser.add_argument("--photos", type=int, help="number of photos (default: all)")
    parser.add_argument("--tools", nargs="+", help="default: all that are installed")
    parser.add_argument("--drift", choices=drifts.DRIFTS, default="gradient+stain")
    given = parser.parse_args()
    out: Path = given.out / "tiles"
    out.mkdir(parents=True, exist_ok=True)
    chosen = [tool for tool in tools() if not given.tools or tool.name in given.tools]
    for tool in [tool for tool in chosen if not tool.available()]:
        print(f"SKIPPED: {tool.name} is not installed: {tool.install}")
        chosen.remove(tool)
    results: dict[str, dict[str, dict]] = {tool.name: {} for tool in chosen}
    for name, picture in list(photos(given.side).items())[: given.photos]:
        photo = out / f"{name}.png"
        save(drifts.drifted(picture, given.drift), photo)
        clean = drifts.Clean.of(picture)
        for tool in chosen:
            tile, facts = (out / f"{name}--{tool.name}.{ending}" for ending in ("png", "json"))
            try:
                if not facts.exists():
                    facts.write_text(json.dumps({"seconds": made(tool, photo, tile, given.side)}))
                lab = color.rgb2lab(pixels(oiio.ImageBuf(str(photo))))
                row = json.loads(facts.read_text()) | measured(pixels(oiio.ImageBuf(str(tile))), clean, lab)
            except ToolError as error:
                row = {"failed": str(error)[-300:]}
                print(f"{tile.stem}: {row['failed']}")
            results[tool.name][name] = row
        print(name, flush=True)
    for file, figure in judged_by_textile(out).items():
        photo_name, _, tool_name = Path(file).stem.partition("--")
        results[tool_name][photo_name]["textile"] = figure
    text = table(results)
    (given.out / "table.md").write_text(text)
    about = {"machine": machine(), "side": given.side, "drift": given.drift, "results": results}
    (out / "results.json").write_text(json.dumps(about, indent=1))
    pairs = [tile.name for tile in sorted(out.glob("*--*.png"))]
    (out / "vote.html").write_text(page(pairs))
    print(text, f"vote: open {out / 'vote.html'}", sep="\n")


if __name__ == "__main__":
    main()
