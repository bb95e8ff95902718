# SPDX-License-Identifier: Apache-2.0
"""Errors and their messages. Every error of the package is an `oiiotex.Error` with a one-line message."""

from __future__ import annotations

import contextlib
import math
import os
import re
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    import numpy as np

T = TypeVar("T")
_LONGEST = 2000  # characters of a message: libraries quote lines of damaged files, which may be of any length


def one_line(text: str) -> str:
    """A text in one line, with control characters escaped: names come from untrusted files."""
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in " ".join(text.split()))


def reason_of(error: BaseException) -> str:
    """The text of another library's or the system's error in one line; the system's without its number and quotes."""
    if not isinstance(error, OSError) or not error.strerror:
        return one_line(str(error))
    named = isinstance(error.filename, str | bytes) and bool(error.filename)
    return one_line(f"{os.fsdecode(error.filename)}: {error.strerror}" if named else error.strerror)


def present(value: T | None) -> T:
    """The value, for type checkers; AssertionError if it is None."""
    assert value is not None
    return value


LINE, PYTHON = 1, 2  # which notation a text uses: the command line's, or Python's for callers of functions
_SPELLED = re.compile("\ufdd0(.*?)\ufdd1(.*?)\ufdd2", re.DOTALL)  # noncharacters, which no name contains


def either(line: str, python: str) -> str:
    """A word that differs between the command line and Python; `spelled` chooses."""
    return f"\ufdd0{line}\ufdd1{python}\ufdd2"


def spelled(text: str, words: int = LINE) -> str:
    """The text with words marked by `either` in the notation of LINE or PYTHON."""
    return _SPELLED.sub(lambda marked: marked[words], text)


def modifier(**values: object) -> str:
    """Modifiers as part of a text: `mask=1:size=5` or `mask=True, size=5`."""
    line = (f"{name}={int(value) if isinstance(value, bool) else value}" for name, value in values.items())
    return either(":".join(line), ", ".join(f"{name}={value}" for name, value in values.items()))


def texture_filter(name: str, **values: bool) -> str:
    """A filter as part of a text: `--texlabel:photo=1` or `filters.label(photo=True)`."""
    line = "".join(f":{spelled(modifier(**{one: value}))}" for one, value in values.items())
    python = f"({spelled(modifier(**values), PYTHON)})" if values else ""
    return either(f"--tex{name}{line}", f"filters.{name}{python}")


CACHE = either("--cache", "the session's budget")
COLORSPACE = either("--iscolorspace NAME", "colorspace=NAME")
IS_DATA = either("--iscolorspace data", "colorspace='data'")
_REPAIR = either("add --fixnan box3 after it", "repair them with OpenImageIO.ImageBufAlgo.fixNonFinite")
OUT_OF_MEMORY = f"out of memory: lower {CACHE}, or reduce the size of the result or the photo"


class Error(Exception):
    """Base of all oiiotex errors: the problem, the expected value, and a hint.

    Parameters
    ----------
    problem : str
        What is wrong; may be empty if parameter, value and expected are given.
    subject : str
        The image at fault. Its name is printed before `problem`.
    parameter : str
        The parameter at fault.
    value : object
        Its value; ... to show none.
    expected : str
        The values that are valid.
    hint : str
        What to do.

    Attributes
    ----------
    op : str
        The op that raised the error, filled in by its caller.
    step : str
        The option that failed, filled in by the command line.
    where : str
        Context of the error: a file, or a product of a recipe.
    words : int
        LINE or PYTHON: the notation of `str`.
    """

    def __init__(
        self, problem: str = "", *, subject: str = "", parameter: str = "", value: object = ...,
        expected: str = "", hint: str = "",
    ):  # fmt: skip
        # `args` are kept as passed, so that subclasses with other arguments can be pickled
        self.problem, self.subject, self.parameter, self.value = problem, subject, parameter, value
        self.expected, self.hint = expected, hint
        self.op = self.step = self.where = ""
        self.words = LINE

    def __str__(self) -> str:
        return self.said(self.words)

    def said(self, words: int) -> str:
        """The message in one line, in the notation of LINE or PYTHON."""
        value = "" if self.value is ... else f"={shown(self.value, words)}"
        expected = f"expected {self.expected}" if self.expected else ""
        problem = f"{self.subject} {self.problem}".strip()
        text = ": ".join(filter(None, (f"{self.parameter}{value}", problem, expected)))
        at = f"{self.step} : " if self.step else f"{self.op}: " if self.op else ""
        hint = f"; {self.hint}" if self.hint else ""
        line = one_line(spelled(f"{self.where}{at}{text}{hint}", words))
        return line if len(line) <= _LONGEST else f"{line[: _LONGEST // 2]} ... {line[-_LONGEST // 2 :]}"

    def facts(self) -> dict[str, str]:
        """The fields as a dict; `kind` is the class, `text` the message."""
        fields = {name: spelled(str(getattr(self, name))) for name in _FIELDS}
        value = {} if self.value is ... else {"value": shown(self.value, LINE)}
        given = {name: text for name, text in fields.items() if text}
        return {"kind": type(self).__name__, "text": str(self)} | given | value


_FIELDS = ("op", "step", "where", "subject", "parameter", "problem", "expected", "hint")


@contextlib.contextmanager
def within(where: str) -> Iterator[None]:
    """Prefix errors raised in this block with their context."""
    try:
        yield
    except Error as error:
        error.where = f"{where}: {error.where}"
        raise


def of_facts(facts: Mapping[str, Any]) -> Error:
    """An error from the `facts` of another process."""
    error = Error(value=facts.get("value", ...))
    for name in _FIELDS:
        setattr(error, name, facts.get(name, ""))
    return error


def shown(value: object, words: int) -> str:
    """The value of a parameter in one line, in the notation of LINE or PYTHON."""
    if words == PYTHON:
        plain = tuple(value) if isinstance(value, tuple) else str(value) if isinstance(value, str) else value  # no enum
        return one_line(repr(plain))
    return one_line(str(int(value) if isinstance(value, bool) else value))


def failure_of(error: Exception) -> Error:
    """Any exception as one of ours: the system's as its reason, all others as internal errors."""
    if isinstance(error, Error):
        return error
    kind = "" if isinstance(error, OSError) else f"internal error: {type(error).__name__}: "
    return Error(f"{kind}{reason_of(error)}")


class ParameterError(Error):
    """A parameter or an option is unknown, or its value is not valid."""


class ParameterTypeError(ParameterError, TypeError):
    """An argument of a Python function is of the wrong type, missing, or unknown."""


class QualityError(Error):
    """A result exceeds a limit of `fail`. `result`: the return value of the function."""

    def __init__(self, problem: str, result: object):
        super().__init__(problem)
        self.result = result


class ImageError(Error):
    """An image cannot be read, written, or used for the operation."""


def megabytes(size: int) -> int:
    """Bytes in MB, rounded up."""
    return math.ceil(size / (1 << 20))


class MemoryBudgetError(ImageError):
    """A task exceeds the memory budget, in bytes. `advice`: what else helps."""

    def __init__(self, task: str, need: int, budget: int, advice: str):
        needs = f"{task} needs {megabytes(need)} MB of memory; the budget is {megabytes(budget)} MB"
        super().__init__(f"{needs}: raise {CACHE}, or {advice}")
        self.task, self.need, self.budget, self.advice = task, need, budget, advice


@contextlib.contextmanager
def whole_budget(budget: int) -> Iterator[None]:
    """Memory errors raised in this block for the rest of a budget state all of it, and what is held already."""
    try:
        yield
    except MemoryBudgetError as error:
        held = budget - error.budget
        raise MemoryBudgetError(error.task, error.need + held, budget, error.advice) from None


class BrokenValues(ImageError):
    """An image has NaN or Inf values. `counts`: number of each, (2,) int64."""

    def __init__(self, name: str, counts: np.ndarray):
        super().__init__(f"has {counts[0]} NaN and {counts[1]} Inf values: {_REPAIR}", subject=name)
        self.counts = counts


class ColorError(Error):
    """A color space is unknown, or a required one is missing."""


class DeviceError(Error):
    """No usable OpenCL device, or the device is too small."""


class OutOfDeviceMemory(DeviceError):
    """The device ran out of memory during the work. Smaller pieces may fit."""


class NoDeviceError(DeviceError):
    """No working OpenCL device. `remedy`: a command that helps; empty if none is known."""

    def __init__(self, problem: str, remedy: str):
        super().__init__(f"{problem}: {remedy or 'install the OpenCL of a GPU driver, or of a CPU'}")
        self.remedy = remedy


class BuildError(DeviceError):
    """The device's compiler rejects an OpenCL program."""


class Interrupted(Error):
    """The run was stopped by a signal or by the progress callback."""
