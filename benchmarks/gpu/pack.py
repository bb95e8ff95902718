# SPDX-License-Identifier: Apache-2.0
"""Pack what a machine with a GPU but without a network needs into .gpu, which git ignores.

python -m benchmarks.gpu.pack [--python 3.12]

Run it in the root of a checkout with an environment (`make test` builds one). It downloads wheels for CPython on x86-64
and writes the pixels that the CPU here makes, some 40 MB with the checkout. On the machine with the GPU, in a copy of
the checkout: `bash .gpu/run.sh [MINUTES]`. NumPy, SciPy, scikit-image, scikit-learn and pytest are expected there.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
from pathlib import Path

from benchmarks.gpu.compare import expect
from benchmarks.gpu.run import ROOT

_WHEELS = (
    "OpenImageIO", "opencolorio", "pyopencl", "pytools", "siphash24", "platformdirs", "typing-extensions", "mmh3",
    "cityhash", "tqdm", "threadpoolctl", "pytest-xdist", "execnet", "pytest-timeout", "hypothesis", "sortedcontainers",
    "trimesh", "xatlas", "colour-science",
)  # fmt: skip
_GLIBC = (34, 31, 28, 27, 24, 17, 12, 5)  # of the platforms of their wheels, 2.x


def main() -> None:
    """Download the wheels, and write the script and the pixels."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--python", default="3.12", help="version of CPython on the machine with the GPU")
    version = parser.parse_args().python
    folder = ROOT / ".gpu"
    shutil.rmtree(folder, ignore_errors=True)
    wheels = folder / "wheels"
    wheels.mkdir(parents=True)
    platforms = (*(f"manylinux_2_{n}_x86_64" for n in _GLIBC), "manylinux2014_x86_64", "manylinux1_x86_64")
    command = [sys.executable, "-m", "pip", "download", "-q", "--no-deps", "--only-binary=:all:", "-d", str(wheels)]
    command += ["--implementation", "cp", "--python-version", version, *(f"--platform={p}" for p in platforms)]
    if subprocess.run([*command, *_WHEELS]).returncode:
        sys.exit("pip could not download the wheels")
    shutil.copy(Path(__file__).with_name("run.sh"), folder)
    expect(folder / "expected")
    size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    print(f"{folder}: {size / 1e6:.0f} MB. On the machine with the GPU: bash .gpu/run.sh")


if __name__ == "__main__":
    main()
