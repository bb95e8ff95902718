# SPDX-License-Identifier: Apache-2.0
"""Rez package: `rez build --install` here installs the wheel from PyPI, and dependencies that your packages lack."""

name = "oiiotex"
version = "0.1.0"
description = "Texture filters for OpenImageIO and OpenColorIO pipelines, on OpenCL"
authors = ["Contributors to oiiotex"]
tools = ["oiiotex"]
# A pipeline already has packages of these. Other dependencies are installed into this package.
requires = ["python-3.11+<3.14", "numpy-2+", "OpenImageIO-3.1.19+", "opencolorio-2.5+"]
build_requires = ["python-3.11+<3.14"]
build_command = (
    "python -m pip install --target {install_path}/python --no-deps oiiotex[cpu]=={version}"
    " pyopencl pytools siphash24 pocl-binary-distribution platformdirs scipy mmh3 threadpoolctl cityhash tqdm"
)
tests = {"version": "oiiotex --version"}


def commands():
    """Put the programs and the modules on the paths."""
    env.PYTHONPATH.append("{root}/python")  # noqa: F821 - Rez defines env
    env.PATH.append("{root}/python/bin")  # noqa: F821
