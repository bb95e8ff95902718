# SPDX-License-Identifier: Apache-2.0
"""`make core`: the core's wheel works in an environment without oiiotex-studio.

Every module of it is imported, what belongs to the studio says so, and a few files of its tests pass: those that find
out whether the wheel has its data (kernels, config, tables), and its words without the studio's. All others run the
same code in `make test`. Tests run in a copy of the checkout without both packages: they import the installed one.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
NEEDED = ("pytest", "hypothesis")  # by these tests
TESTS = (  # of each floor
    "engine/test_color_spaces", "engine/test_runtime", "analysis/test_hierarchy", "synthesis/test_exemplar_op",
    "surfaces/test_preview", "oiiotool/test_parse", "oiiotool/test_service", "oiiotool/test_viewing",
)  # fmt: skip
IMPORTS = """
import importlib, pkgutil, sys, oiiotex
names = [one.name for one in pkgutil.walk_packages(oiiotex.__path__, "oiiotex.") if not one.name.endswith("__main__")]
for name in names:
    importlib.import_module(name)
assert len(names) > 200 and not any(name.startswith("oiiotex_studio") for name in sys.modules), names
"""


def main() -> None:
    """Build the wheel, install it, and run the tests."""
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        left = shutil.ignore_patterns(".*", "*.egg-info", "build", "dist", "site", "__pycache__")
        shutil.copytree(ROOT, work / "checkout", symlinks=True, ignore=left)
        subprocess.run([sys.executable, "-m", "venv", work / "env"], check=True)
        python = work / "env" / "bin" / "python"
        pip = [python, "-m", "pip", "-q", "--disable-pip-version-check"]
        subprocess.run([*pip, "wheel", "--no-deps", "-w", work, work / "checkout"], check=True)
        (wheel,) = work.glob("*.whl")
        subprocess.run([*pip, "install", f"{wheel}[cpu,linker]", *NEEDED], check=True)
        for package in ("oiiotex", "studio"):
            shutil.rmtree(work / "checkout" / package)
        clean = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "CI")}
        subprocess.run([python, "-c", IMPORTS], cwd=work, env=clean, check=True)
        for option in ("--texlive", "--farm"):
            done = subprocess.run([python, "-m", "oiiotex", option], cwd=work, capture_output=True, text=True)
            if done.stderr != f"oiiotex ERROR: {option} requires oiiotex-studio; pip install ./studio in a checkout\n":
                sys.exit(f"{option} without the studio says: {done.stderr}")
        line = [python, "-m", "pytest", "-m", "not slow", *(f"tests/{test}.py" for test in TESTS)]
        sys.exit(subprocess.run(line, cwd=work / "checkout", env=clean).returncode)


if __name__ == "__main__":
    main()
