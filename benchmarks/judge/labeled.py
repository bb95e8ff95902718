# SPDX-License-Identifier: Apache-2.0
"""The judge against the eye: tiles that people labeled, by what the judge calls them.

    python -m benchmarks.judge.labeled labels.json

The file is a list of tiles: {"photo": "a.png", "st": "a.st.exr", "kind": "cobbles", "set": "tune", "label": "ship",
"before": "good"}. `st` is the tile's part of that name. Labels are ship, work or unusable, and "before" is an earlier
verdict. Paths are relative to the file. Photos and tiles are not in the repository.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from pathlib import Path

import OpenImageIO as oiio

from oiiotex import filters
from oiiotex.engine.color.lab import working_values
from oiiotex.engine.core.image import from_buffer
from oiiotex.engine.core.source_map import SourceMap
from oiiotex.engine.session import Session
from oiiotex.synthesis.quality.fidelity import FAIR, GOOD, fidelity
from oiiotex.synthesis.quality.verdicts import GRADES

LABELS = "ship", "work", "unusable"


def verdict(photo: Path, st: Path, session: Session) -> str:
    """What the judge calls a tile of a photo."""
    original = oiio.ImageBuf(str(photo))
    original.specmod().attribute("oiio:ColorSpace", "srgb_rec709_scene")
    flat = filters.flatten(original, session=session)
    own, lab = (working_values(from_buffer(one), session.resources)[0] for one in (original, flat))
    places = oiio.ImageBuf(str(st)).get_pixels(oiio.FLOAT)[..., :2]
    source = SourceMap.of_coordinates(places, original.spec(), "st")
    value = fidelity(lab, None, source.gather(lab), (True, True), source, own).value
    return GRADES[sum(value < limit for limit in (GOOD, FAIR))]


def main() -> None:
    """Print a table for each set of tiles, and the tiles on which eye and judge disagree most, by kind."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("labels", type=Path)
    path, session = parser.parse_args().labels, Session()
    tiles = json.loads(path.read_text())
    for tile in tiles:
        tile["after"] = verdict(path.parent / tile["photo"], path.parent / tile["st"], session)
    print("| set | label | tiles | before: good | fair | poor | now: good | fair | poor |")
    print("|---|---|---|---|---|---|---|---|---|")
    for name in dict.fromkeys(tile["set"] for tile in tiles):
        for label in LABELS:
            own = [tile for tile in tiles if (tile["set"], tile["label"]) == (name, label)]
            counts = [Counter(tile[when] for tile in own)[grade] for when in ("before", "after") for grade in GRADES]
            print(f"| {name} | {label} | {len(own)} | {' | '.join(map(str, counts))} |")
    print()
    for label, grade in (
        ("unusable", "good"),
        ("unusable", "fair"),
        ("ship", "poor"),
        ("ship", "fair"),
        ("work", "good"),
    ):
        kinds = Counter(tile["kind"] for tile in tiles if (tile["label"], tile["after"]) == (label, grade))
        said = ", ".join(kind if n == 1 else f"{n} {kind}" for kind, n in kinds.most_common())
        print(f"{label}, called {grade}: {said or 'none'}")


if __name__ == "__main__":
    main()
