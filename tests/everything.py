# SPDX-License-Identifier: Apache-2.0
"""An op with a parameter of every kind, and what it allows, said once more without the code under test."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import pytest

from oiiotex.engine.core.access import Pointwise
from oiiotex.engine.core.image import Image
from oiiotex.engine.core.op import Kind, Output, Space
from oiiotex.engine.core.parameters import Numbers, Parameter, Size, Words, declared, image, param
from oiiotex.engine.errors import ParameterError


@dataclass(frozen=True, kw_only=True)
class Everything(Pointwise):
    """An op with one parameter of every kind."""

    name: ClassVar[str] = "everything"
    space: ClassVar[Space] = Space.ANY
    outputs: ClassVar[tuple[Output, ...]] = (Output("out", Kind.PIXELS, "nothing"),)

    source: Image = image(help="what to look at")
    mask: Image | None = image(None, help="where to look")
    count: int = param(help="how many", ge=0, le=10, unit="px")
    strength: float = param(1.0, help="how strong", ge=-1, le=2.5)
    sigma: float | None = param(None, help="how far", ge=0.5, unit="px")
    anything: float = param(0.0, help="any number")
    size: Size | None = param(None, help="how large", ge=5, le=65536, unit="px")
    either: bool = param(False, help="whether")
    stmap: bool | Path = param(False, help="whether, or where")
    mode: str = param("xy", help="how", choices=("xy", "x", "none"))
    patch: int = param(0, help="of what side", choices=(0, 1, 5, 7))
    color: Numbers | None = param(None, help="of what color")
    words: Words | None = param(None, help="of what kinds")


FLOAT = (2 - 2**-23) * 2.0**127  # the largest of 32 bits
KNOWN = {p.name: p for p in declared(Everything)[1]}


def refusal(call: Callable, *arguments: object) -> str:
    """The one line that a `ParameterError` says."""
    with pytest.raises(ParameterError) as caught:
        call(*arguments)
    text = str(caught.value)
    assert "\n" not in text
    return text


def is_allowed(parameter: Parameter, value: Any) -> bool:
    """What the declarations above say, once more and without the code under test."""
    if value is None:
        return parameter.name in ("sigma", "size", "color", "words")
    return {
        "count": lambda: type(value) is int and 0 <= value <= 10,
        "strength": lambda: type(value) is float and -1 <= value <= 2.5,
        "sigma": lambda: type(value) is float and 0.5 <= value <= FLOAT,
        "anything": lambda: type(value) is float and abs(value) <= FLOAT,
        "size": lambda: type(value) is Size and all(type(n) is int and 5 <= n <= 65536 for n in value),
        "either": lambda: type(value) is bool,
        "stmap": lambda: type(value) is bool or isinstance(value, Path),
        "mode": lambda: type(value) is str and value in ("xy", "x", "none"),
        "color": lambda: (
            type(value) is Numbers and len(value) > 0 and all(type(n) is float and abs(n) <= FLOAT for n in value)
        ),
        "words": lambda: type(value) is Words and len(value) > 0 and all(type(word) is str for word in value),
        "patch": lambda: type(value) is int and value in (0, 1, 5, 7),
    }[parameter.name]()
