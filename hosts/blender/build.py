# SPDX-License-Identifier: Apache-2.0
"""Build the extension: `python hosts/blender/build.py oiiotex_blender.zip`.

Blender's Python cannot import oiiotex, which requires a newer numpy. The zip contains copies of the three modules that
connect to the resident process, which import only numpy.
"""

from __future__ import annotations

import sys
import zipfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
PACKAGE = HERE.parents[1] / "oiiotex"
LINK = ("engine/errors.py", "engine/deferred.py", "oiiotool/service/messages.py")


def build(target: Path) -> None:
    """Write the zip file."""
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted((HERE / "oiiotex_blender").glob("*.*")):
            archive.write(path, path.name)
        for folder in ("link", "link/engine", "link/oiiotool", "link/oiiotool/service"):
            archive.writestr(f"{folder}/__init__.py", "")
        for name in LINK:
            archive.write(PACKAGE / name, f"link/{name}")


if __name__ == "__main__":
    build(Path(sys.argv[1]))
