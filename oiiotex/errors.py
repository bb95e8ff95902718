# SPDX-License-Identifier: Apache-2.0
"""What can go wrong, in words for a user. Every error of the package is an `oiiotex.Error` of one line."""


class Error(Exception):
    """Base of all errors that oiiotex raises on purpose."""


class ParameterError(Error):
    """A parameter or an option is unknown, or its value is not allowed."""


class ImageError(Error):
    """An image cannot be read, written, or used for what was asked."""


class ColorError(Error):
    """A colour space is unknown, or none is given where one is needed."""


class DeviceError(Error):
    """No usable OpenCL device, or the device or the memory budget is too small."""


class Interrupted(Error):
    """The run was stopped from outside: by a signal, or by a progress callback that said no."""
