# SPDX-License-Identifier: Apache-2.0
"""oiiotex: texture filters for OpenImageIO and OpenColorIO pipelines, on OpenCL."""

from .engine.errors import Error, Interrupted, QualityError

__all__ = ["Error", "Interrupted", "QualityError"]
__version__ = "0.1.0"
