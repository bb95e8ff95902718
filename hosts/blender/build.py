# SPDX-License-Identifier: Apache-2.0
"""Make the extension's zip: `python hosts/blender/build.py oiiotex_blender.zip`.

Blender's Python cannot have our package, whose numpy is newer than its own. What speaks to the resident process goes
into the zip as it is: three modules that import nothing but numpy.
"""

from __future__ import annotations

import sys
import zipfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
PACKAGE = HERE.parents[1] / "oiiotex"
LINK = ("errors.py", "deferred.py", "service/messages.py")


def build(target: Path) -> None:
    """Write the zip."""
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted((HERE / "oiiotex_blender").glob("*.*")):
            archive.write(path, path.name)
        for folder in ("link", "link/service"):
            archive.writestr(f"{folder}/__init__.py", "")
        for name in LINK:
            archive.write(PACKAGE / name, f"link/{name}")


if __name__ == "__main__":
    build(Path(sys.argv[1]))
