# SPDX-License-Identifier: Apache-2.0
"""Words of a command line -> commands: settings of the run, and actions on the image stack."""

from __future__ import annotations

from dataclasses import dataclass, field

from ..errors import ParameterError
from ..filters import FILTERS
from ..op import Op
from ..params import nearest


@dataclass(frozen=True)
class Option:
    """An option that is not an op: what it is called, what follows it, what it does."""

    name: str
    arguments: tuple[str, ...]
    help: str
    setting: bool = False  # holds for the whole run, wherever it stands


OPTIONS = (
    Option("-i", ("FILE",), "read an image (as naming it does) and put it on the stack"),
    Option("-o", ("FILE",), "write the top image; a run that fails leaves the old file as it was"),
    Option("-d", ("TYPE",), "pixel type of what is written from here on: uint8, uint16, half, float ..."),
    Option("--iscolorspace", ("SPACE",), "say which colour space the top image is in; nothing is converted"),
    Option("--fixnan", ("MODE",), "repair NaN and Inf of the top image: black or box3"),
    Option("--autocc", (), "let the config's file rules name the space of files that do not say it", setting=True),
    Option("--colorconfig", ("FILE",), "OCIO config; else $OCIO, else a built-in one", setting=True),
    Option(
        "--device",
        ("DEVICE",),
        "OpenCL device: number, gpu, cpu or part of its name; else $OIIOTEX_DEVICE",
        setting=True,
    ),
    Option("--devices", (), "list the OpenCL devices", setting=True),
    Option("--threads", ("N",), "CPU threads; 0: as many as the process may use", setting=True),
    Option("--cache", ("MB",), "memory budget; a quarter of the machine's when left out", setting=True),
    Option("-v", (), "say what is done, and measure the results", setting=True),
    Option("--runstats", (), "say where the time went, and measure the results", setting=True),
    Option("--debug", (), "show a traceback where something fails", setting=True),
    Option("--version", (), "print versions", setting=True),
    Option("--help", (), "print this, or with a name behind it that filter's page", setting=True),
)
_ALIASES = {"--verbose": "-v", "-h": "--help"}


@dataclass(frozen=True)
class Action:
    """One step on the stack: an op of ours, or an option with its arguments."""

    word: str  # as the user wrote it, for messages
    op: type[Op] | None = None
    modifiers: dict[str, str] = field(default_factory=dict)
    option: str = ""
    arguments: tuple[str, ...] = ()


@dataclass(frozen=True)
class CommandLine:
    """A parsed command line."""

    settings: dict[str, tuple[str, ...]]
    actions: tuple[Action, ...]


def parse(words: list[str]) -> CommandLine:
    """Read a command line.

    Raises
    ------
    ParameterError
        An unknown option, a missing argument, a malformed modifier.
    """
    ops = {op.flag(): op for op in FILTERS}
    options = {option.name: option for option in OPTIONS}
    settings: dict[str, tuple[str, ...]] = {}
    actions: list[Action] = []
    left = iter(words)
    for word in left:
        if not word.startswith("-") or word == "-":
            actions.append(Action(word, option="-i", arguments=(word,)))
            continue
        name, modifiers = split_modifiers(word)
        name = _canonical(name, ops.keys() | options.keys())
        if name in ops:
            actions.append(Action(word, op=ops[name], modifiers=modifiers))
            continue
        option = options[name]
        if modifiers:
            raise ParameterError(f"{word}: {name} has no modifiers")
        if name == "--help":
            settings[name] = tuple(left)[:1]
            continue
        arguments = tuple(_argument(left, option, what) for what in option.arguments)
        if option.setting:
            settings[name] = arguments
        else:
            actions.append(Action(word, option=name, arguments=arguments))
    return CommandLine(settings, tuple(actions))


def split_modifiers(word: str) -> tuple[str, dict[str, str]]:
    """'--op:a=1:b="x:y"' -> ('--op', {'a': '1', 'b': 'x:y'}); a value in quotes may hold colons.

    Raises
    ------
    ParameterError
        A modifier without a value, twice the same, or an open quote.
    """
    pieces, quote = [""], ""
    for letter in word:
        if quote:
            quote = "" if letter == quote else quote
            pieces[-1] += letter if quote else ""
        elif letter in "\"'" and pieces[-1].endswith("="):
            quote = letter
        elif letter == ":":
            pieces.append("")
        else:
            pieces[-1] += letter
    if quote:
        raise ParameterError(f"{word}: the quote {quote} is not closed")
    modifiers: dict[str, str] = {}
    for piece in pieces[1:]:
        name, equals, value = piece.partition("=")
        if not equals or not name:
            raise ParameterError(f"{word}: '{piece}' is not NAME=VALUE")
        if name in modifiers:
            raise ParameterError(f"{word}: '{name}' is given twice")
        modifiers[name] = value
    return pieces[0], modifiers


def _canonical(name: str, known: set[str]) -> str:
    """The option's own spelling: one dash or two mean the same, as in oiiotool."""
    bare = name.lstrip("-")
    for spelling in (name, f"--{bare}", f"-{bare}"):
        found = _ALIASES.get(spelling, spelling)
        if found in known:
            return found
    raise ParameterError(f"unknown option '{name}'{nearest(f'--{bare}', known)}")


def _argument(left: object, option: Option, what: str) -> str:
    value = next(left, None)  # type: ignore[call-overload]
    if value is None:
        raise ParameterError(f"{option.name} wants {what} behind it")
    return value
