# SPDX-License-Identifier: Apache-2.0
"""--each: run a command line once for every file that matches a pattern."""

from __future__ import annotations

import functools
import glob
import os
from collections.abc import Sequence

from ....engine.errors import ParameterError, present
from .parse import settings_of

OPTIONS = settings_of(
    (
        "--each PATTERN",
        "Run the line for each matching file, such as 'photos/*.jpg', and read it here. {name}: the file's name"
        " without extension, {ext}: its extension, {dir}: its folder",
    ),
)

_NAMES = ("--each", "-each")


def has_each(words: Sequence[str]) -> bool:
    """Whether a line has --each."""
    return _place_of(words) is not None


def lines_of(words: Sequence[str]) -> list[tuple[str, tuple[str, ...]]]:
    """The files of --each, sorted, and the command line of each.

    Raises
    ------
    ParameterError
        No file matches, or a file name would be parsed as an expression or a modifier.
    """
    place = present(_place_of(words))
    pattern = words[place + 1]
    files = sorted(file for file in glob.glob(pattern, recursive=True) if os.path.isfile(file))
    if not files:
        raise ParameterError(
            f"--each: no files match {pattern!r}; quote the pattern, so that the shell does not expand it"
        )
    return [(file, _line(words, place, file)) for file in files]


def _place_of(words: Sequence[str]) -> int | None:
    """The place of --each; None without it."""
    places = [place for place, word in enumerate(words[:-1]) if word in _NAMES]
    if len(places) > 1:
        raise ParameterError("--each is given twice")
    return places[0] if places else None


def _line(words: Sequence[str], place: int, file: str) -> tuple[str, ...]:
    folder, name = os.path.split(file)
    stem, extension = os.path.splitext(name)
    tokens = {"{name}": stem, "{dir}": folder or ".", "{ext}": extension[1:]}

    def filled(word: str) -> str:
        for token, value in tokens.items():
            if token in word and word.startswith("-") and (":" in value or value[:1] in ("'", '"')):
                raise ParameterError(f"--each: {file!r} cannot be part of {word!r}; rename the file")
            word = word.replace(token, value)
        return word

    own = f"./{file}" if file.startswith("-") else file
    line = (*map(filled, words[:place]), own, *map(filled, words[place + 2 :]))
    if "{" not in file and "}" not in file:
        return line
    if any("{" in functools.reduce(lambda rest, token: rest.replace(token, ""), tokens, word) for word in words):
        raise ParameterError(f"--each: {file!r}: braces begin expressions, and the line has some; rename the file")
    return ("--evaloff", *line)
