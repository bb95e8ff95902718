# SPDX-License-Identifier: Apache-2.0
"""What pyproject.toml cannot say: the stub of the filters' functions is generated from their declarations."""

import os
import subprocess
import sys
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

ROOT = Path(__file__).resolve().parent


class BuildWithStub(build_py):
    """Writes the stub into what is built, or with `pip install -e` into the checkout."""

    def run(self) -> None:
        """Build, then generate; this imports oiiotex, which needs no library for its declarations."""
        super().run()
        folder = ROOT if self.editable_mode else Path(self.build_lib).resolve()
        stub = folder / "oiiotex" / "filters" / "__init__.pyi"
        command = [sys.executable, "-B", "-m", "tools.docs.stubs", str(stub)]
        subprocess.run(command, env={**os.environ, "PYTHONPATH": str(ROOT)}, check=True)


setup(cmdclass={"build_py": BuildWithStub})
