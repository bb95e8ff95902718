# SPDX-License-Identifier: Apache-2.0
"""Installed versions of the program and its libraries, read without importing them."""

from __future__ import annotations

from importlib import metadata

from .... import __version__

_PACKAGES = (
    ("OpenImageIO", "OpenImageIO"),
    ("OpenColorIO", "opencolorio"),
    ("numpy", "numpy"),
    ("PyOpenCL", "pyopencl"),
)


def versions() -> str:
    """One line per package, and which options print more."""
    lines = [f"oiiotex {__version__}", *(f"{name} {_installed(package)}" for name, package in _PACKAGES)]
    lines.append("OpenCL devices: oiiotex --devices; OpenImageIO's build: oiiotex --buildinfo")
    return "\n".join(lines)


def _installed(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:  # built by hand, or by a distribution without Python metadata
        return "(unknown version)"
