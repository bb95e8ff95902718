# SPDX-License-Identifier: Apache-2.0
"""What can go wrong, in words for a user. Every error of the package is an `oiiotex.Error` of one line."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    import numpy as np

T = TypeVar("T")


def one_line(text: str) -> str:
    """A text in one line, with what steers terminals shown as Python writes it: names come from strangers."""
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in " ".join(text.split()))


def present(value: T | None) -> T:
    """The value itself, which is never None here: type checkers cannot know. AssertionError where it is."""
    assert value is not None
    return value


class Error(Exception):
    """Base of all errors that oiiotex raises on purpose."""

    def __str__(self) -> str:
        return one_line(super().__str__())


class ParameterError(Error):
    """A parameter or an option is unknown, or its value is not allowed."""


class ParameterTypeError(ParameterError, TypeError):
    """A value of Python is of the wrong type, or the arguments are not those that the function takes."""


class QualityError(Error):
    """A result is beyond a limit of `fail`. `result`: what the function would have returned."""

    def __init__(self, text: str, result: object):
        super().__init__(text)
        self.result = result


class ImageError(Error):
    """An image cannot be read, written, or used for what was asked."""


class BrokenValues(ImageError):
    """NaN or Inf where there should be colour. `counts` says how many of either: (2,) int64."""

    def __init__(self, name: str, counts: np.ndarray):
        super().__init__(f"{name} has {counts[0]} NaN and {counts[1]} Inf values: add --fixnan box3 after it")
        self.counts = counts


class ColorError(Error):
    """A colour space is unknown, or none is given where one is needed."""


class DeviceError(Error):
    """No usable OpenCL device, or the device or the memory budget is too small."""


class OutOfDeviceMemory(DeviceError):
    """A device has less memory than it says: found out while it works. Smaller pieces may fit."""


class NoDeviceError(DeviceError):
    """No OpenCL device works here. `remedy`: the command that helps; '' where none is known."""

    def __init__(self, text: str, remedy: str):
        super().__init__(f"{text}: {remedy or 'install the OpenCL of a GPU driver, or of a CPU'}")
        self.remedy = remedy


class BuildError(DeviceError):
    """A device's compiler refuses one of our programs."""


class Interrupted(Error):
    """The run was stopped from outside: by a signal, or by a progress callback that said no."""


class Unseen(Exception):
    """Pixels or the device were asked for while a line is only looked through: what follows from them is not known yet.

    It is no error, and never leaves `cli.rehearsal`.
    """
