# SPDX-License-Identifier: Apache-2.0
"""The pictures of the docs: `python -m tools.docs.pictures [NAME ...]`, by default all of them, one after the other."""

from __future__ import annotations

import runpy
import sys

ALL = (
    "gallery", "photos", "decompose", "stationarize", "comparison", "dominant", "atlas", "capture", "structure",
    "measures", "hexagons", "motion", "multiscale", "synth", "library", "live", "hosts",
)  # fmt: skip


def main(names: list[str]) -> None:
    """Run these modules of the package as programs, without arguments."""
    unknown = sorted(set(names) - set(ALL))
    if unknown:
        sys.exit(f"no pictures are called {', '.join(unknown)}: expected {', '.join(ALL)}")
    sys.argv[1:] = []
    for name in names or ALL:
        runpy.run_module(f"tools.docs.pictures.{name}", run_name="__main__")


if __name__ == "__main__":
    main(sys.argv[1:])
