# SPDX-License-Identifier: Apache-2.0
"""Texture kept and low-frequency variation removed in the first tile, if both are known; compared with other ways.

python -m benchmarks.tiles.first_tile OUT [--side 320 512 1024] [--photos N] [--ways default keep ...]
                                          [--drifts none ...] [--half tune|judge] [--seed 1] [--measure]
python -m benchmarks.tiles.first_tile OUT --scales [--side 512 1024 2048] ...

Drifts are added to even textures (drifts.py), each way makes a tile of the drifted photo, and the tile is
measured against the clean texture. OUT receives every tile, its figures as JSON, table.md and sheet.jpg. Tiles
in OUT are not made again: use another OUT after a change of the program. --measure measures them again.

Ways: default is --texstationarize; its presets are read from its declaration; paper is paper=1 (MJH17 exactly);
matchpatch is G'MIC's, if installed (see shared/peers.py); offset is the photo cross-faded with itself
shifted by half. --half selects textures by a hash of their names: tune on one half, judge by the other.

--scales makes tiles of the same texture at several sizes, and compares their band energies over the clean texture's.
Textures are enlarged for it to at most twice their size, which adds nothing to the bands.
"""

from __future__ import annotations

import argparse
import json
import resource
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from skimage import color

from benchmarks.shared.peers import PEERS, ToolError
from benchmarks.tiles import drifts
from oiiotex import filters
from oiiotex.engine.core.source_map import SourceMap
from oiiotex.engine.errors import Error
from oiiotex.engine.session import Session
from oiiotex.filters.texstationarize import Stationarize
from oiiotex.surfaces.charts.tile_preview import made_seamless
from oiiotex.synthesis.quality.copy_detection import copies_by_source
from oiiotex.synthesis.quality.seam_measures import seam_ratio
from tools.demo import save
from tools.docs.pictures.layout import pixels

SIDES, SCALES = (320, 512, 1024), (512, 1024, 2048)
SIMILAR = 0.9, 1.1  # band energies at one size over those at the smallest
PANE, LABEL = 176, 14  # px, on the sheet
SHOWN = ("none", "gradient+stain")  # drifts on the sheet
WARM = 96  # px, of a tile that builds the kernels

Made = tuple[np.ndarray, float | None, float]  # pixels, the most repeated region, CPU seconds
Way = Callable[[np.ndarray], Made]


# --- ways ---


def picture(values: np.ndarray) -> oiio.ImageBuf:
    """(h, w, 3) uint8 as an sRGB image."""
    made = oiio.ImageBuf(oiio.ImageSpec(values.shape[1], values.shape[0], 3, oiio.UINT8))
    made.set_pixels(made.roi, np.ascontiguousarray(values))
    made.specmod().attribute("oiio:ColorSpace", "srgb_rec709_scene")
    return made


def stationarized(photo: np.ndarray, session: Session, **modifiers: object) -> Made:
    """--texstationarize with modifiers, in this process: neither its start nor the building of kernels counts."""
    start = time.process_time()
    made = filters.stationarize(picture(photo), st=True, session=session, **modifiers)
    tile = pixels(next(iter(made.values())))
    spent = time.process_time() - start
    st = made["st"].get_pixels(oiio.FLOAT)
    source = SourceMap.of_coordinates(st, picture(photo).spec(), "st")
    return tile, copies_by_source(source, photo.shape[:2]).shown, spent


def matchpatch(photo: np.ndarray) -> Made:
    """G'MIC's syntexturize_matchpatch, as a process; its start counts."""
    with tempfile.TemporaryDirectory() as folder:
        before, after = (Path(folder) / name for name in ("photo.png", "tile.png"))
        save(photo, before)
        start = resource.getrusage(resource.RUSAGE_CHILDREN)
        PEERS[0].run(before, after, (photo.shape[1], photo.shape[0]))
        end = resource.getrusage(resource.RUSAGE_CHILDREN)
        spent = end.ru_utime + end.ru_stime - start.ru_utime - start.ru_stime
        return pixels(oiio.ImageBuf(str(after))), None, spent


def offset(photo: np.ndarray) -> Made:
    """The photo cross-faded with itself shifted by half, as paint programs make an image seamless."""
    start = time.process_time()
    made = np.rint(255 * made_seamless(photo / 255.0)).astype(np.uint8)
    return made, None, time.process_time() - start


def ways(session: Session, seed: int) -> dict[str, Way]:
    """Ways to make tiles, by name."""
    presets = next(p for p in Stationarize.parameters() if p.name == "preset").choices
    modifiers: dict[str, dict[str, object]] = {"default": {}}
    modifiers |= {name: {"preset": name} for name in presets if name} | {"paper": {"paper": True}}
    ours: dict[str, Way] = {
        name: lambda photo, more=more: stationarized(photo, session, seed=seed, **more)
        for name, more in modifiers.items()
    }
    return {**ours, "matchpatch": matchpatch, "offset": offset}


# --- cases ---


@dataclass(frozen=True)
class Case:
    """One tile: of a texture with a drift, at a size, by a way, with a seed."""

    texture: Path
    side: int
    drift: str
    way: str
    seed: int = 1

    @property
    def stem(self) -> str:
        """Of its files."""
        return f"{self.texture.stem}_{self.side}_{self.drift}_{self.way}_{self.seed}"


class Bench:
    """Makes and measures tiles, or takes them from a folder."""

    def __init__(self, out: Path, seed: int, again: bool, enlarged: bool):
        self.out, self.seed, self._again, self._enlarged = out, seed, again, enlarged
        self.ways = ways(Session(), seed)
        self.kept = self.new = 0
        self._warm: set[tuple[str, int]] = set()
        self._clean: tuple[object, np.ndarray | None, drifts.Clean | None] = (None, None, None)

    def clean(self, texture: Path, side: int) -> np.ndarray | None:
        """The clean texture; None if its photo is smaller."""
        if self._clean[0] != (texture, side):
            enough = side <= 2 * min(_size(texture)) if self._enlarged else True
            self._clean = (texture, side), drifts.square(texture, side, self._enlarged) if enough else None, None
        return self._clean[1]

    def figures(self, case: Case) -> dict | None:
        """Of a tile; None if the photo is too small; only `refused`, a text, if no tile was made."""
        path = self.out / f"{case.stem}.json"
        clean = self.clean(case.texture, case.side)
        if clean is None:
            return None
        known = json.loads(path.read_text()) if path.is_file() else None
        if known and not (self._again and "bands" in known):
            self.kept += 1
            return known
        photo = drifts.drifted(clean, case.drift)
        tile_path = self.out / f"{case.stem}.png"
        if known:
            tile, shown, spent = pixels(oiio.ImageBuf(str(tile_path))), known["shown"], known["seconds"]
        else:
            self._warm_up(case, photo)
            try:
                tile, shown, spent = self.ways[case.way](photo)
            except (Error, ToolError) as error:
                path.write_text(json.dumps({"refused": str(error)}))
                return {"refused": str(error)}
            save(tile, tile_path)
        if self._clean[2] is None:
            self._clean = *self._clean[:2], drifts.Clean.of(clean)
        found = measured(tile, self._clean[2], color.rgb2lab(photo)) | {"shown": shown, "seconds": spent}
        path.write_text(json.dumps(found))
        self.new += 1
        return found

    def _warm_up(self, case: Case, photo: np.ndarray) -> None:
        """Build kernels by a tile that does not count."""
        if (case.way, case.side) not in self._warm and case.way not in ("matchpatch", "offset"):
            self._warm.add((case.way, case.side))
            try:
                self.ways[case.way](photo[:WARM, :WARM])
            except Error:
                pass  # of a photo that small


def _size(texture: Path) -> tuple[int, int]:
    spec = oiio.ImageBuf(str(texture)).spec()
    return spec.width, spec.height


def measured(tile: np.ndarray, clean: drifts.Clean, photo: np.ndarray) -> dict:
    """Figures of a tile, (h, w, 3) uint8, of a photo in Lab."""
    lab = color.rgb2lab(tile)
    return {
        "bands": (drifts.band_energies(lab, clean.side, True) / clean.bands).tolist(),
        "gone": drifts.drift_gone(lab, clean.lab, photo),
        "width": drifts.half_width(lab, clean.side, True) / clean.width,
        "seam": max(seam_ratio(lab, axis) for axis in (0, 1)),
        "copies": drifts.copies_seen(lab, clean.side, True),
        "copies_clean": clean.copies,
        "spread": drifts.spread(lab) / drifts.spread(clean.lab),
    }


# --- tables ---


def cell(values: Iterable[float | None], digits: int = 2) -> str:
    """Mean (minimum to maximum) of the values that are known."""
    known = [v for v in values if v is not None]
    if not known:
        return ""
    mean, least, most = (f"{v:.{digits}f}" for v in (np.mean(known), min(known), max(known)))
    return mean if len(known) == 1 else f"{mean} ({least} to {most})"


HEAD = (
    "side", "drift", "way", *(f"L/{n}" for n in drifts.BANDS), "all bands .8 to 1.25", "drift gone",
    "half width", "seam", "most repeated", "copies seen", "of the photo", "spread", "CPU s",
)  # fmt: skip


def table(found: dict[Case, dict]) -> str:
    """Markdown: a row for each side, drift and way."""
    rows = [HEAD, ("---",) * len(HEAD)]
    groups: dict[tuple[int, str, str], list[dict]] = {}
    for case, figures in found.items():
        groups.setdefault((case.side, case.drift, case.way), []).append(figures)
    for (side, drift, way), all_of in groups.items():
        made = [f for f in all_of if "bands" in f]
        if not made:
            rows.append((str(side), drift, way, *("",) * 3, f"0 of {len(all_of)}", *("",) * 8))
            continue
        bands = np.array([f["bands"] for f in made])
        good = int(((bands >= drifts.KEPT[0]) & (bands <= drifts.KEPT[1])).all(1).sum())
        column = {k: cell(f[k] for f in made) for k in ("gone", "width", "seam", "spread")}
        rows.append(
            (
                str(side), drift, way, *map(cell, bands.T), f"{good} of {len(all_of)}", column["gone"],
                column["width"], column["seam"], cell((f["shown"] for f in made), 1),
                cell((f["copies"] for f in made), 1), f"{np.mean([f['copies_clean'] for f in made]):.1f}",
                column["spread"], f"{np.mean([f['seconds'] for f in made]):.2f}",
            )
        )  # fmt: skip
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


def scale_table(found: dict[Case, dict]) -> str:
    """Markdown: band energies at each size over those at the smallest, for each drift and way."""
    groups: dict[tuple[str, str, int], list[np.ndarray]] = {}
    for case, figures in found.items():
        same = [c for c in found if (c.texture, c.drift, c.way) == (case.texture, case.drift, case.way)]
        first = min(same, key=lambda c: c.side)
        if case != first and "bands" in figures and "bands" in found[first]:
            ratio = np.array(figures["bands"]) / found[first]["bands"]
            groups.setdefault((case.drift, case.way, case.side), []).append(ratio)
    smallest = min(case.side for case in found)
    head = ("drift", "way", f"side, over {smallest}", *(f"L/{n}" for n in drifts.BANDS), "all .9 to 1.1")
    rows = [head, ("---",) * len(head)]
    for (drift, way, side), ratios in groups.items():
        good = int(((np.array(ratios) >= SIMILAR[0]) & (np.array(ratios) <= SIMILAR[1])).all(1).sum())
        rows.append((drift, way, str(side), *map(cell, np.transpose(ratios)), f"{good} of {len(ratios)}"))
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


# --- sheet ---


def sheet(bench: Bench, cases: Sequence[Case], path: Path) -> None:
    """Clean texture, drifted photo and the tile of every way, a row for each texture, size and drift."""
    from PIL import Image, ImageDraw

    names = list(dict.fromkeys(case.way for case in cases))
    drawn = [c for c in cases if c.drift in SHOWN] or list(cases)
    rows = list(dict.fromkeys((c.texture, c.side, c.drift) for c in drawn))
    size = (len(names) + 2) * (PANE + 4), len(rows) * (PANE + LABEL + 4) + LABEL
    made = Image.new("RGB", size, "white")
    pen = ImageDraw.Draw(made)
    for row, (texture, side, drift) in enumerate(rows):
        clean = bench.clean(texture, side)
        assert clean is not None
        top = row * (PANE + LABEL + 4)
        panes: list[tuple[str, np.ndarray | None]] = [
            (f"{texture.stem} {side}"[:30], clean), (drift, drifts.drifted(clean, drift)),
        ]  # fmt: skip
        for way in names:
            file = bench.out / f"{Case(texture, side, drift, way, bench.seed).stem}.png"
            panes.append((way, pixels(oiio.ImageBuf(str(file))) if file.is_file() else None))
        for column, (label, pane) in enumerate(panes):
            left = column * (PANE + 4)
            pen.text((left + 2, top + 1), label if pane is not None else f"{label}: none", fill="black")
            if pane is not None:
                shown = Image.fromarray(pane)
                shown.thumbnail((PANE, PANE), Image.Resampling.LANCZOS)
                made.paste(shown, (left, top + LABEL))
    made.save(path, quality=80)


def main() -> None:
    """Make what is missing; print and write the table; draw the sheet."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--side", type=int, nargs="+", help=f"px, default: {SIDES}; with --scales {SCALES}")
    parser.add_argument("--photos", type=int, help="number of textures, default: all")
    parser.add_argument("--ways", nargs="+", help="default: all")
    parser.add_argument("--drifts", nargs="+", choices=drifts.DRIFTS, help="default: all; with --scales none")
    parser.add_argument("--half", choices=drifts.HALVES, help="of the textures, default: both")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--scales", action="store_true", help="compare sizes")
    parser.add_argument("--measure", action="store_true", help="measure the tiles that are in OUT again")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    bench = Bench(given.out, given.seed, given.measure, given.scales)
    names = given.ways or list(bench.ways)
    if unknown := set(names) - set(bench.ways):
        parser.error(f"--ways: {', '.join(unknown)}: expected some of {', '.join(bench.ways)}")
    if "matchpatch" in names and not PEERS[0].available():
        print(f"SKIPPED: matchpatch: G'MIC is not installed: {PEERS[0].install}", flush=True)
        names.remove("matchpatch")
    sides = sorted(given.side or (SCALES if given.scales else SIDES))
    added = given.drifts or (["none"] if given.scales else list(drifts.DRIFTS))
    files = drifts.textures(given.half)[: given.photos]
    found: dict[Case, dict] = {}
    for side in sides:
        for texture in files:
            if bench.clean(texture, side) is None:
                print(f"SKIPPED: {texture.name} is too small for {side} px", flush=True)
                continue
            for case in (Case(texture, side, drift, way, bench.seed) for drift in added for way in names):
                figures = bench.figures(case)
                assert figures is not None
                if "refused" in figures:
                    print(f"NO TILE: {case.stem}: {figures['refused']}", flush=True)
                found[case] = figures
            print(f"{side} px: {texture.stem}", flush=True)
    if not found:
        parser.error("no texture is left to measure")
    order = sorted(found, key=lambda c: (c.side, added.index(c.drift), names.index(c.way)))
    found = {case: found[case] for case in order}
    text = table(found) + "\n" + (f"\n{scale_table(found)}\n" if given.scales else "")
    (given.out / "table.md").write_text(text)
    sheet(bench, sorted(found, key=lambda c: (c.side, files.index(c.texture))), given.out / "sheet.jpg")
    print(text, f"{bench.new} tiles made or measured, {bench.kept} taken from {given.out}", sep="\n")


if __name__ == "__main__":
    main()
