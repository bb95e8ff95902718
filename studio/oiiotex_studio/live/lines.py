# SPDX-License-Identifier: Apache-2.0
"""Commands that reproduce at full size what the page shows."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

_SUFFIXES = {"uint8": ".png", "uint16": ".png", "half": ".exr", "float": ".exr"}
_TYPES = {".png": ("uint8", "uint16"), ".exr": ("half", "float"), ".jpg": ("uint8",), ".jpeg": ("uint8",)}


def text_of(value: Any) -> str:
    """A modifier's value as text; floats have the fewest digits that mean the same number."""
    if isinstance(value, bool):
        return str(int(value))
    if isinstance(value, float):
        return repr(int(value)) if value.is_integer() else repr(value)
    return str(value)


def word_of(flag: str, values: Mapping[str, Any]) -> str:
    """An op with its modifiers, except those that are None."""
    said = [f"{name}={_quoted(text_of(value))}" for name, value in values.items() if value is not None]
    return ":".join([flag, *said])


def _quoted(text: str) -> str:
    """A modifier's value, quoted if it contains a separator."""
    return f'"{text}"' if ":" in text or "'" in text else text


def line(words: Sequence[str], name: str, pixel_type: str) -> str:
    """The command that runs `words` and writes a file in a pixel type, quoted for a shell."""
    return shlex.join(["oiiotex", *words, "-d", pixel_type, "-o", name])


def output_name(stem: str, what: str, pixel_type: str) -> str:
    """A file name whose format stores a pixel type without loss."""
    return f"{stem}_{what}{_SUFFIXES.get(pixel_type, '.tif')}"


def type_in(name: str, pixel_type: str) -> str:
    """The pixel type of a file: the given one if its format stores it, else the format's most precise one."""
    types = _TYPES.get(Path(name).suffix.lower(), (pixel_type,))
    if pixel_type in types:
        return pixel_type
    return types[0] if pixel_type == "uint8" else types[-1]
