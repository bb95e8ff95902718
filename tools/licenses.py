# SPDX-License-Identifier: Apache-2.0
"""`make licenses`: the table of licenses of everything that an environment has, in docs/explanation/dependencies.md.

`python -m tools.licenses PYTHON` reads the metadata of that Python's packages by pip-licenses.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "explanation" / "dependencies.md"
MARK = "<!-- by make licenses -->\n"
# where metadata has a whole text, or nothing: read in the package's license file
READ = {
    "opencolorio": "BSD-3-Clause",
    "opencv-python-headless": "Apache-2.0 (OpenCV), LGPL-2.1-or-later (FFmpeg)",
    "pocl-binary-distribution": "MIT (PoCL), Apache-2.0 WITH LLVM-exception (LLVM), BSD-3-Clause (hwloc)",
    "xatlas": "MIT",
}
OURS = ("oiiotex", "oiiotex-studio", "pip", "setuptools")


def table(python: str) -> str:
    """Markdown: each package with version, license and whether oiiotex or an extra asks for it."""
    command = [sys.executable, "-m", "piplicenses", "--python", python, "--format=json", "--from=mixed", "--with-urls"]
    found = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout)
    direct = asked_for()
    lines = ["| package | version | license | required by |", "|---|---|---|---|"]
    for one in sorted(found, key=lambda one: one["Name"].lower()):
        name = normalized(one["Name"])
        if name not in OURS:
            text = READ.get(name, " ".join(one["License"].split()))
            if name not in READ and (len(text) > 80 or text == "UNKNOWN"):
                sys.exit(f"{name}: its metadata names no license: read it, and name it in READ of tools/licenses.py")
            lines.append(f"| {one['Name']} | {one['Version']} | {text} | {direct.get(name, 'another package')} |")
    return "\n".join(lines) + "\n"


def normalized(name: str) -> str:
    """A package's name as registries compare it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def asked_for() -> dict[str, str]:
    """Names in both pyproject.toml, with what asks for them: oiiotex, oiiotex-studio, or extras."""
    import tomllib

    named: dict[str, list[str]] = {}
    for folder in (ROOT, ROOT / "studio"):
        project = tomllib.loads((folder / "pyproject.toml").read_text())["project"]
        extras = {f"`{extra}`": lines for extra, lines in project["optional-dependencies"].items()}
        for extra, lines in ({project["name"]: project["dependencies"]} | extras).items():
            for line in lines:
                match = re.match(r"[\w.-]+", line)
                assert match
                named.setdefault(normalized(match[0]), []).append(extra)
    return {
        name: "oiiotex" if "oiiotex" in extras else ", ".join(sorted(set(extras) - {"`test`", "`benchmark`", "`lint`"}))
        for name, extras in named.items()
    }


def main() -> None:
    """Renew the table."""
    page = PAGE.read_text()
    PAGE.write_text(page.partition(MARK)[0] + MARK + "\n" + table(sys.argv[1]))


if __name__ == "__main__":
    main()
