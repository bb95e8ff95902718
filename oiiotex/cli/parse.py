# SPDX-License-Identifier: Apache-2.0
"""Words of a command line -> settings of the run, and steps to be done one after the other."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from ..errors import ParameterError
from ..op import Op
from ..params import nearest, parse_modifiers


@dataclass(frozen=True)
class Option:
    """An option that is not an op: what it is called, what follows it, what it does.

    Attributes
    ----------
    name : str
    arguments : tuple of str
        What follows it, for help.
    help : str
    run : callable or None
        Called with the chain, the arguments as text and the modifiers as keywords. None: a setting that holds for the
        whole run wherever it stands.
    modifiers : type or None
        A frozen dataclass whose `param` fields are its modifiers.
    needs : int
        Images that must be on the stack; with fewer it waits for the next ones, as ops do.
    state : bool
        It only sets what later options use, so it may stand between an op and the operands that the op waits for.
    control : bool
        It decides what is done: it is seen even where steps are skipped.
    aliases : tuple of str
        Other spellings.
    """

    name: str
    arguments: tuple[str, ...]
    help: str
    run: Callable[..., None] | None = None
    modifiers: type | None = None
    needs: int = 0
    state: bool = False
    control: bool = False
    aliases: tuple[str, ...] = ()


@dataclass(frozen=True)
class Refused:
    """An option of oiiotool that is not here, and why."""

    name: str
    arguments: int
    reason: str


@dataclass(frozen=True)
class Step:
    """One thing to do, as the user wrote it: expressions in it are evaluated when its turn comes."""

    word: str  # the option with its modifiers, or a file's name
    arguments: tuple[str, ...] = ()
    op: type[Op] | None = None
    option: Option | None = None

    @property
    def name(self) -> str:
        """For messages: the option without modifiers."""
        return self.word.split(":")[0] if self.word.startswith("-") else self.word


@dataclass(frozen=True)
class Language:
    """All that a command line may say.

    Attributes
    ----------
    ops : mapping of str to tuple of Op classes
        By heading, for help.
    groups : mapping of str to tuple of Option
        By heading.
    refused : tuple of Refused
    """

    ops: Mapping[str, tuple[type[Op], ...]]
    groups: Mapping[str, tuple[Option, ...]]
    refused: tuple[Refused, ...] = ()
    _names: dict[str, Any] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        for op in itertools.chain.from_iterable(self.ops.values()):
            self._names.update(dict.fromkeys((op.flag(), *op.aliases), op))
        for option in self.options:
            self._names.update(dict.fromkeys((option.name, *option.aliases), option))
        self._names.update({refused.name: refused for refused in self.refused})

    @property
    def options(self) -> tuple[Option, ...]:
        """All options that are not ops."""
        return tuple(itertools.chain.from_iterable(self.groups.values()))

    def find(self, name: str) -> type[Op] | Option | Refused:
        """What an option's name means; one dash or two mean the same, as in oiiotool.

        Raises
        ------
        ParameterError
            Nothing; the text names the nearest one.
        """
        bare = name.lstrip("-")
        for spelling in (name, f"--{bare}", f"-{bare}"):
            if spelling in self._names:
                return self._names[spelling]
        raise ParameterError(f"unknown option '{name}'{nearest(f'--{bare}', self._names)}")

    def takes(self, word: str) -> int:
        """How many words follow an option; 0 for what is no option."""
        try:
            found = self.find(word.split(":")[0])
        except ParameterError:
            return 0
        if isinstance(found, Refused):
            return found.arguments
        return len(found.arguments) if isinstance(found, Option) else len(found.arguments())


@dataclass(frozen=True)
class CommandLine:
    """A parsed command line."""

    settings: dict[str, tuple[str, ...]]
    steps: tuple[Step, ...]


def parse(words: list[str], language: Language) -> CommandLine:
    """Read a command line.

    What can be known to be wrong before any work begins is refused here.

    Raises
    ------
    ParameterError
        An unknown or refused option, a missing argument, a malformed or unknown modifier.
    """
    settings: dict[str, tuple[str, ...]] = {}
    steps: list[Step] = []
    left = iter(words)
    for word in left:
        if not word.startswith("-") or word == "-":
            steps.append(Step(word))
            continue
        name, modifiers = split_modifiers(word)
        found = language.find(name)
        if isinstance(found, Refused):
            raise ParameterError(f"{name} of oiiotool is not here: {found.reason}")
        if isinstance(found, Option) and found.name == "--help":
            settings[found.name] = tuple(left)[:1]
            continue
        step = _step(word, found, left)
        if step.option is not None and step.option.run is None:
            if modifiers:
                raise ParameterError(f"{word}: {name} has no modifiers")
            settings[step.option.name] = step.arguments
            continue
        _check_early(step, modifiers)
        steps.append(step)
    return CommandLine(settings, tuple(steps))


def _step(word: str, found: type[Op] | Option, left: Iterator[str]) -> Step:
    if isinstance(found, Option):
        return Step(word, tuple(_argument(left, found.name, what) for what in found.arguments), option=found)
    names = [parameter.name.upper() for parameter in found.arguments()]
    return Step(word, tuple(_argument(left, found.flag(), what) for what in names), op=found)


def _check_early(step: Step, modifiers: Mapping[str, str]) -> None:
    """Refuse modifiers that no expression can make right any more."""
    plain = {name: text for name, text in modifiers.items() if "{" not in text}
    try:
        values_of(step, {**plain, **{name: None for name in modifiers if name not in plain}})
    except ParameterError as error:
        raise ParameterError(f"{step.name} : {error}") from None


def values_of(step: Step, modifiers: Mapping[str, str | None]) -> dict[str, Any]:
    """The modifiers' values by name; None stands for a text that is not known yet.

    Raises
    ------
    ParameterError
        An unknown modifier, or a value that is not allowed.
    """
    declaring = step.op or (step.option.modifiers if step.option else None)
    if declaring is None:
        if modifiers:
            raise ParameterError(f"unknown modifier '{next(iter(modifiers))}'; there is none")
        return {}
    return parse_modifiers(declaring, modifiers)


def split_modifiers(word: str) -> tuple[str, dict[str, str]]:
    """'--op:a=1:b="x:y"' -> ('--op', {'a': '1', 'b': 'x:y'}); a value in quotes, or an expression, may hold colons.

    Raises
    ------
    ParameterError
        A modifier without a value, twice the same, or an open quote.
    """
    pieces, quote, braces = [""], "", 0
    for letter in word:
        if quote:
            quote = "" if letter == quote else quote
            pieces[-1] += letter if quote else ""
        elif letter in "\"'" and pieces[-1].endswith("=") and not braces:
            quote = letter
        elif letter == ":" and not braces:
            pieces.append("")
        else:
            braces = max(0, braces + (letter == "{") - (letter == "}"))
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


def _argument(left: Iterator[str], option: str, what: str) -> str:
    value = next(left, None)
    if value is None:
        raise ParameterError(f"{option} wants {what} behind it")
    return value
