# SPDX-License-Identifier: Apache-2.0
"""What can go wrong, in words for a user. Every error of the package is an `oiiotex.Error` of one line."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, TypeVar

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


LINE, PYTHON = 1, 2  # whose words a text is said in: the command line's, which all but Python's callers read
_SPELLED = re.compile("\ufdd0(.*?)\ufdd1(.*?)\ufdd2", re.DOTALL)  # noncharacters, which no name of a stranger has


def either(line: str, python: str) -> str:
    """A word within a text that the command line and Python spell in their own ways; `spelled` chooses."""
    return f"\ufdd0{line}\ufdd1{python}\ufdd2"


def spelled(text: str, words: int = LINE) -> str:
    """The text, as LINE or PYTHON spells what `either` has marked in it."""
    return _SPELLED.sub(lambda marked: marked[words], text)


def modifier(**values: object) -> str:
    """Modifiers as a word of a text: `mask=1:size=5` or `mask=True, size=5`."""
    line = (f"{name}={int(value) if isinstance(value, bool) else value}" for name, value in values.items())
    return either(":".join(line), ", ".join(f"{name}={value}" for name, value in values.items()))


def texture_filter(name: str, **values: bool) -> str:
    """A filter as a word of a text: `--texlabel:keep=1` or `filters.label(keep=True)`."""
    line = "".join(f":{spelled(modifier(**{one: value}))}" for one, value in values.items())
    python = f"({spelled(modifier(**values), PYTHON)})" if values else ""
    return either(f"--tex{name}{line}", f"filters.{name}{python}")


CACHE = either("--cache", "the session's budget")
COLORSPACE = either("--iscolorspace NAME", "colorspace=NAME")
IS_DATA = either("--iscolorspace data", "colorspace='data'")
_REPAIR = either("add --fixnan box3 after it", "repair them by OpenImageIO.ImageBufAlgo.fixNonFinite")
OUT_OF_MEMORY = f"out of memory: lower {CACHE}, or make the tile or the photo smaller"


class Error(Exception):
    """Base of all errors that oiiotex raises on purpose: what is wrong, what is expected, what to do.

    Parameters
    ----------
    problem : str
        What is wrong, where parameter and value do not say it alone.
    subject : str
        The image that is at fault, whose name begins the sentence of `problem`.
    parameter : str
        The parameter that is at fault.
    value : object
        Its value; ... where none is to be shown.
    expected : str
        What a value must be.
    hint : str
        What to do.

    Attributes
    ----------
    op : str
        The op that refuses, filled in by who runs it.
    step : str
        The word of the command line that failed, filled in by who runs the line.
    where : str
        What the error is part of: a file, a product of a recipe.
    words : int
        LINE or PYTHON: whom `str` speaks to.
    """

    def __init__(
        self, problem: str = "", *, subject: str = "", parameter: str = "", value: object = ...,
        expected: str = "", hint: str = "",
    ):  # fmt: skip
        # `args` stay what the class was called with: so it can be pickled, whatever a subclass takes
        self.problem, self.subject, self.parameter, self.value = problem, subject, parameter, value
        self.expected, self.hint = expected, hint
        self.op = self.step = self.where = ""
        self.words = LINE

    def __str__(self) -> str:
        return self.said(self.words)

    def said(self, words: int) -> str:
        """The error in one line, as LINE or PYTHON says it."""
        value = "" if self.value is ... else f"={shown(self.value, words)}"
        expected = f"expected {self.expected}" if self.expected else ""
        problem = f"{self.subject} {self.problem}".strip()
        text = ": ".join(filter(None, (f"{self.parameter}{value}", problem, expected)))
        at = f"{self.step} : " if self.step else f"{self.op}: " if self.op else ""
        hint = f"; {self.hint}" if self.hint else ""
        return one_line(spelled(f"{self.where}{at}{text}{hint}", words))

    def facts(self) -> dict[str, str]:
        """Its fields, for programs; `kind` is the class, `text` the line."""
        fields = {name: spelled(str(getattr(self, name))) for name in _FIELDS}
        value = {} if self.value is ... else {"value": shown(self.value, LINE)}
        given = {name: text for name, text in fields.items() if text}
        return {"kind": type(self).__name__, "text": str(self)} | given | value


_FIELDS = ("op", "step", "where", "subject", "parameter", "problem", "expected", "hint")


@contextlib.contextmanager
def within(where: str) -> Iterator[None]:
    """Errors that leave this block begin with a name of what they are part of."""
    try:
        yield
    except Error as error:
        error.where = f"{where}: {error.where}"
        raise


def of_facts(facts: Mapping[str, Any]) -> Error:
    """The error whose `facts` another process has sent."""
    error = Error(value=facts.get("value", ...))
    for name in _FIELDS:
        setattr(error, name, facts.get(name, ""))
    return error


def shown(value: object, words: int) -> str:
    """A value of a parameter in one line, as LINE or PYTHON writes it."""
    if words == PYTHON:
        return one_line(repr(tuple(value) if isinstance(value, tuple) else value))
    return one_line(str(int(value) if isinstance(value, bool) else value))


class ParameterError(Error):
    """A parameter or an option is unknown, or its value is not allowed."""


class ParameterTypeError(ParameterError, TypeError):
    """A value of Python is of the wrong type, or the arguments are not those that the function takes."""


class QualityError(Error):
    """A result is beyond a limit of `fail`. `result`: what the function would have returned."""

    def __init__(self, problem: str, result: object):
        super().__init__(problem)
        self.result = result


class ImageError(Error):
    """An image cannot be read, written, or used for what was asked."""


class MemoryBudgetError(ImageError):
    """A task needs more memory than the budget, in bytes. `advice` says what else helps."""

    def __init__(self, task: str, need: int, budget: int, advice: str):
        needs = f"{task} needs {-(-need >> 20)} MB of memory; the budget is {-(-budget >> 20)} MB"
        super().__init__(f"{needs}: raise {CACHE}, or {advice}")
        self.task, self.need, self.budget, self.advice = task, need, budget, advice


class BrokenValues(ImageError):
    """NaN or Inf where there should be color. `counts` says how many of either: (2,) int64."""

    def __init__(self, name: str, counts: np.ndarray):
        super().__init__(f"has {counts[0]} NaN and {counts[1]} Inf values: {_REPAIR}", subject=name)
        self.counts = counts


class ColorError(Error):
    """A color space is unknown, or none is given where one is needed."""


class DeviceError(Error):
    """No usable OpenCL device, or the device is too small."""


class OutOfDeviceMemory(DeviceError):
    """A device has less memory than it says: found out while it works. Smaller pieces may fit."""


class NoDeviceError(DeviceError):
    """No OpenCL device works here. `remedy`: the command that helps; '' where none is known."""

    def __init__(self, problem: str, remedy: str):
        super().__init__(f"{problem}: {remedy or 'install the OpenCL of a GPU driver, or of a CPU'}")
        self.remedy = remedy


class BuildError(DeviceError):
    """A device's compiler refuses one of our programs."""


class Interrupted(Error):
    """The run was stopped from outside: by a signal, or by a progress callback that said no."""


class Unseen(Exception):
    """Pixels or the device were asked for while a line is only looked through: what follows from them is not known yet.

    It is no error, and never leaves `cli.rehearsal`.
    """
