# SPDX-License-Identifier: Apache-2.0
"""oiiotex: texture filters for OpenImageIO and OpenColorIO pipelines, on OpenCL."""

TYPE_CHECKING = False  # as in `typing`, which is slow: until the program handles signals, Ctrl-C prints a traceback
if TYPE_CHECKING:
    from .engine.errors import Error, Interrupted, QualityError

__all__ = ["Error", "Interrupted", "QualityError"]
__version__ = "0.1.0"


def __getattr__(name: str) -> object:
    if name in __all__:
        from .engine import errors

        return getattr(errors, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
