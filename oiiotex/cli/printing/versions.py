# SPDX-License-Identifier: Apache-2.0
"""Versions of the program and of what it stands on, as they are installed: none of it is imported."""

from __future__ import annotations

from importlib import metadata

from ... import __version__

_PACKAGES = (
    ("OpenImageIO", "OpenImageIO"),
    ("OpenColorIO", "opencolorio"),
    ("numpy", "numpy"),
    ("PyOpenCL", "pyopencl"),
)


def versions() -> str:
    """A line for each, and what says more."""
    lines = [f"oiiotex {__version__}", *(f"{name} {_installed(package)}" for name, package in _PACKAGES)]
    lines.append("oiiotex --devices: what computes; --buildinfo: how OpenImageIO was built")
    return "\n".join(lines)


def _installed(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:  # built by hand, or by a distribution that says nothing to Python
        return "of a version that its installation does not say"
