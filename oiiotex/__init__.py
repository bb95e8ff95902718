# SPDX-License-Identifier: Apache-2.0
"""oiiotex: texture filters for OpenImageIO and OpenColorIO pipelines, on OpenCL."""

from .errors import Error

__all__ = ["Error"]
__version__ = "0.1.0"
