# SPDX-License-Identifier: Apache-2.0
"""Lines that make what the page shows, at full size."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from typing import Any

_SUFFIXES = {"uint8": ".png", "uint16": ".png", "half": ".exr", "float": ".exr"}


def text_of(value: Any) -> str:
    """A modifier's value as a command line has it: floats by as few digits as mean the same number."""
    if isinstance(value, bool):
        return str(int(value))
    if isinstance(value, float):
        return repr(int(value)) if value.is_integer() else repr(value)
    return str(value)


def word_of(flag: str, values: Mapping[str, Any]) -> str:
    """An op with its modifiers, None left out."""
    said = [f"{name}={_quoted(text_of(value))}" for name, value in values.items() if value is not None]
    return ":".join([flag, *said])


def _quoted(text: str) -> str:
    """A modifier's value, in quotes where it holds what separates modifiers."""
    return f'"{text}"' if ":" in text or "'" in text else text


def line(words: Sequence[str]) -> str:
    """Words as a shell reads them."""
    return shlex.join(["oiiotex", *words])


def output_name(stem: str, what: str, pixel_type: str) -> str:
    """A file that holds pixels of a type as they are."""
    return f"{stem}_{what}{_SUFFIXES.get(pixel_type, '.tif')}"
