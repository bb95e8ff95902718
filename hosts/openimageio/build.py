# SPDX-License-Identifier: Apache-2.0
"""Build the plugin for the OpenImageIO of this Python's environment: `python hosts/openimageio/build.py`.

For a host with its own library: `--library /of/the/host/libOpenImageIO.so.3.0 --headers 3.0.10.1 --into FOLDER`.

The wheel of OpenImageIO has no headers, so they are taken from its source on PyPI. CMake, a C++ compiler and the
headers of fmt, Imath and nlohmann-json must be installed; `SYSTEM` lists their Debian packages.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tarfile
from importlib import metadata
from pathlib import Path

SYSTEM = "cmake g++ libfmt-dev libimath-dev nlohmann-json3-dev"
HERE = Path(__file__).resolve().parent


def source_of(version: str, folder: Path) -> Path:
    """The headers of a version of OpenImageIO in `folder`, downloaded if necessary."""
    unpacked = folder / f"openimageio-{version}"
    if not (unpacked / "CMakeLists.txt").exists():
        folder.mkdir(parents=True, exist_ok=True)
        wanted = f"OpenImageIO=={version}"
        line = [sys.executable, "-m", "pip", "download", "-q", "--no-deps", "--no-binary", "OpenImageIO", wanted]
        subprocess.run(line, cwd=folder, check=True)
        with tarfile.open(folder / f"{unpacked.name}.tar.gz") as archive:
            parts = ("/CMakeLists.txt", "/src/include/")
            members = [m for m in archive if m.name.removeprefix(unpacked.name).startswith(parts)]
            archive.extractall(folder, members, filter="data")
    return unpacked


def paths(work: Path, source: Path | None = None) -> tuple[Path, Path]:
    """The headers and the library of this environment's OpenImageIO."""
    installed = metadata.distribution("OpenImageIO")
    library = next(Path(str(installed.locate_file("OpenImageIO/lib"))).glob("libOpenImageIO.so*"))
    return source or source_of(installed.version, work), library


def build(into: Path, work: Path, source: Path | None = None, library: Path | None = None) -> Path:
    """Build and install the plugin; returns the folder for OPENIMAGEIO_PLUGIN_PATH.

    Parameters
    ----------
    into : path
        Install prefix: the plugin is installed in its lib/oiiotex.
    work : path
        Build folder.
    source : path, optional
        Unpacked source of OpenImageIO. Default: downloaded.
    library : path, optional
        The host's libOpenImageIO; it requires `source`. Default: that of this environment.

    Raises
    ------
    subprocess.CalledProcessError
        A download or build failed; its output has been printed.
    """
    if library is None:
        source, library = paths(work, source)
    settings = {
        "OIIO_SOURCE": source, "OIIO_LIBRARY": library, "OIIOTEX_PYTHON": sys.executable,
        "OIIOTEX_VERSION": metadata.version("oiiotex"), "CMAKE_INSTALL_PREFIX": into,
    }  # fmt: skip
    tree = work / "tree"
    subprocess.run(["cmake", "-S", HERE, "-B", tree, *(f"-D{k}={v}" for k, v in settings.items())], check=True)
    subprocess.run(["cmake", "--build", tree, "--parallel", "2"], check=True)
    subprocess.run(["cmake", "--install", tree], check=True)
    return into / "lib" / "oiiotex"


def main() -> None:
    """Build with the options of the command line."""
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("--into", type=Path, default=Path(sys.prefix), help="install prefix (default: this environment)")
    words.add_argument("--source", type=Path, help="unpacked source of OpenImageIO (default: downloaded)")
    words.add_argument("--library", type=Path, help="the host's libOpenImageIO (default: that of this environment)")
    words.add_argument("--headers", metavar="VERSION", help="download the headers of this version from PyPI")
    words.add_argument("--work", type=Path, default=HERE / "build", help="build folder (default: build in this folder)")
    words.add_argument(
        "--print-paths", action="store_true", help="print folder of the headers; library (CMakeLists.txt)"
    )
    asked = words.parse_args()
    work, source, library = (path and path.resolve() for path in (asked.work, asked.source, asked.library))
    if asked.print_paths:
        print(*paths(work), sep=";")
        return
    if library and not (source or asked.headers):
        sys.exit("--library requires --headers or --source of the same version")
    if not shutil.which("cmake"):
        sys.exit(f"cmake not found; on Debian: apt install {SYSTEM}")
    try:
        source = source_of(asked.headers, work) if asked.headers else source
        print(build(asked.into.resolve(), work, source, library))
    except subprocess.CalledProcessError as error:
        sys.exit(f"build failed: {error.cmd[0]} exited with {error.returncode}; required Debian packages: {SYSTEM}")


if __name__ == "__main__":
    main()
