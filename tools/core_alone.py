# SPDX-License-Identifier: Apache-2.0
"""`make core`: the core's wheel in an environment without oiiotex-studio passes the core's fast tests.

Tests run in a copy of the checkout without both packages, so they can only import the installed one.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FLOORS = ("engine", "analysis", "synthesis", "surfaces", "oiiotool")
NEEDED = ("pytest", "pytest-xdist", "hypothesis", "scikit-image", "scikit-learn", "colour-science")  # by those tests
MOST = 1.0  # CPU seconds of a test file, by tests/budget.toml: slower ones run in `make test` alone
SOURCES = ("test_words", "test_cross_compile")  # read the source of both packages


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
        for option in ("--texlive", "--farm"):
            done = subprocess.run([python, "-m", "oiiotex", option], cwd=work, capture_output=True, text=True)
            if done.stderr != f"oiiotex ERROR: {option} requires oiiotex-studio; pip install ./studio in a checkout\n":
                sys.exit(f"{option} without the studio says: {done.stderr}")
        budget = tomllib.loads((ROOT / "tests" / "budget.toml").read_text())["fast"]
        files = sorted(path for floor in FLOORS for path in (ROOT / "tests" / floor).glob("test_*.py"))
        files = [path for path in files if budget.get(path.stem, MOST) < MOST and path.stem not in SOURCES]
        tests = [path.relative_to(ROOT) for path in files]
        line = [python, "-m", "pytest", "-n", "2", "--dist", "loadfile", "-m", "not slow", *tests]
        clean = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "CI")}
        sys.exit(subprocess.run(line, cwd=work / "checkout", env=clean).returncode)


if __name__ == "__main__":
    main()
