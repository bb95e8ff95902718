# SPDX-License-Identifier: Apache-2.0
"""Parse the words of a command line into settings of the run and steps."""

from __future__ import annotations

import contextlib
import functools
import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ....engine.core.op import Op
from ....engine.core.parameters import Parameter, declared, nearest, parse_modifiers
from ....engine.deferred import Shelf
from ....engine.errors import Error, ParameterError

MOST_THREADS, MOST_MB = 4096, 1 << 40
FURTHER = "Texture filters of other packages"
ADDED = ("Viewing", "Run settings")  # where help lists the options of other distributions


@dataclass(frozen=True)
class Option:
    """An option that is not an op: `Option("--tile WIDTH HEIGHT", set_tile)`."""

    call: str
    run: Callable[..., object] | None = None  # called with (chain, *arguments, modifiers); None: a setting of the run
    modifiers: type | None = None  # a frozen dataclass of `param` fields
    text: str = ""  # help; default: the first line of run's docstring
    needs: int = 0  # images on the stack; it waits for missing ones, as ops do
    flat: bool = False  # reads the pixels of those images, which must not be deep
    state: bool = False  # only sets a value for later steps: allowed between an op and its missing operands
    throughout: bool = False  # also applies to the whole run, wherever it stands
    late: bool = False  # evaluates expressions in its arguments itself
    writes: bool = False  # writes the file of its last argument
    control: bool = False  # controls steps: runs even where steps are skipped
    aliases: tuple[str, ...] = ()
    heading: str = "Run settings"  # of help: where an option of another distribution is listed
    spread: Callable[..., int] | None = None  # a setting that runs all frames elsewhere: see frame_runs

    @functools.cached_property
    def name(self) -> str:
        """The option's name with dashes."""
        return self.call.partition(" ")[0]

    @functools.cached_property
    def arguments(self) -> tuple[str, ...]:
        """Names of its arguments, for help."""
        return tuple(self.call.split()[1:])

    @property
    def help(self) -> str:
        """A sentence without a period."""
        return self.text or (self.run.__doc__ or "").partition("\n")[0].rstrip(".")

    def parameters(self) -> tuple[Parameter, ...]:
        """Its modifiers."""
        return declared(self.modifiers)[1] if self.modifiers else ()


def settings_of(*rows: tuple[str, ...]) -> tuple[Option, ...]:
    """Settings of the whole run, from rows of call, help and aliases."""
    return tuple(Option(call, text=text, aliases=tuple(aliases)) for call, text, *aliases in rows)


@dataclass(frozen=True)
class Refused:
    """An option of oiiotool that is not supported, and why."""

    name: str
    arguments: int
    reason: str


@dataclass(frozen=True)
class Step:
    """An op, an option or a file name as written; expressions are evaluated when it runs."""

    word: str  # the option with its modifiers, or a file's name
    arguments: tuple[str, ...] = ()
    op: type[Op] | None = None
    option: Option | None = None

    @property
    def name(self) -> str:
        """The option without modifiers, for messages."""
        return self.word.split(":")[0] if self.word.startswith("-") else self.word


@dataclass(frozen=True)
class Language:
    """All ops and options of a command line."""

    shelves: tuple[Shelf, ...]  # of ops and options, in the order of help; imported when a line names one of them
    refused: tuple[Refused, ...] = ()
    further: Callable[[], tuple[type[Op], ...]] = tuple  # ops of other packages: importing them tells their names
    added: Callable[[str], tuple[Option, ...]] = lambda name: ()  # options of other distributions: of a name, or all
    studio: tuple[str, ...] = ()  # options that oiiotex-studio adds
    words: Mapping[str, str] = field(default_factory=dict)  # by heading: the word by which --help prints the group

    @functools.cached_property
    def ops(self) -> dict[str, tuple[type[Op], ...]]:
        """All ops by heading, for help; imports all of them."""
        return self._where(lambda declaration: not isinstance(declaration, Option))

    @functools.cached_property
    def groups(self) -> dict[str, tuple[Option, ...]]:
        """All options that are not ops, by heading."""
        return self._where(lambda declaration: isinstance(declaration, Option))

    def _where(self, wanted: Callable[[Any], bool]) -> dict[str, tuple[Any, ...]]:
        kept = {heading: tuple(filter(wanted, declarations)) for heading, declarations in self.group("all").items()}
        return {heading: declarations for heading, declarations in kept.items() if declarations}

    def group(self, word: str) -> dict[str, tuple[Any, ...]]:
        """The ops and options of a group by heading, everything for 'all'; imports only these."""
        headings: dict[str, tuple[Any, ...]] = {}
        for shelf in self.shelves:
            if word in ("all", self.words.get(shelf.heading)):
                headings[shelf.heading] = (*headings.get(shelf.heading, ()), *shelf.declarations)
        if word == "all" or word in map(self.words.get, ADDED):
            for option in self.added(""):
                if word in ("all", self.words.get(option.heading)):
                    headings[option.heading] = (*headings.get(option.heading, ()), option)
        if word in ("all", self.words.get(FURTHER)) and self.further():
            headings[FURTHER] = self.further()
        return headings

    @property
    def options(self) -> tuple[Option, ...]:
        """All options that are not ops."""
        return tuple(itertools.chain.from_iterable(self.groups.values()))

    @functools.cached_property
    def _places(self) -> dict[str, Shelf | Refused]:
        places: dict[str, Shelf | Refused] = {name: shelf for shelf in self.shelves for name in shelf.names}
        return places | {refused.name: refused for refused in self.refused}

    def find(self, name: str) -> type[Op] | Option | Refused:
        """The op or option of a name, with one dash or two, as in oiiotool; ParameterError for an unknown name."""
        bare = name.lstrip("-")
        spellings = (name, f"--{bare}", f"-{bare}")
        for spelling in spellings:
            place = self._places.get(spelling)
            if isinstance(place, Refused):
                return place
            if place is not None:
                return next(one for one in place.declarations if spelling in names_of(one))
        for option in self.added(bare) if bare else ():
            return option
        others = {spelling: op for op in self.further() for spelling in names_of(op)}
        for spelling in spellings:
            if spelling in others:
                return others[spelling]
        if f"--{bare}" in self.studio:
            raise ParameterError(f"--{bare} requires oiiotex-studio", hint="pip install ./studio in a checkout")
        near = nearest(f"--{bare}", [*self._places, *self.studio, *others])
        raise ParameterError(f"unknown option '{name}'{near}")

    def takes(self, word: str) -> int:
        """The number of arguments of an option; 0 for other words."""
        try:
            declaration = self.find(word.split(":")[0])
        except ParameterError:
            return 0
        if isinstance(declaration, Refused):
            return declaration.arguments
        return len(declaration.arguments) if isinstance(declaration, Option) else len(declaration.arguments())


def names_of(declaration: type[Op] | Option) -> tuple[str, ...]:
    """The name and the aliases of an op or option."""
    return (declaration.name if isinstance(declaration, Option) else declaration.flag(), *declaration.aliases)


@dataclass(frozen=True)
class CommandLine:
    """A parsed command line."""

    settings: dict[str, tuple[str, ...]]
    steps: tuple[Step, ...]
    spread: Callable[..., int] | None = None  # of the setting that has one

    @property
    def reports(self) -> bool:
        """Whether to log steps and measure results."""
        return "-v" in self.settings or "--runstats" in self.settings

    def first(self, name: str) -> str | None:
        """The first argument of a setting; None without argument or setting."""
        return next(iter(self.settings.get(name, ())), None)

    def whole_number(self, name: str, most: int) -> int:
        """The argument of a setting, an integer from 0 to `most`; 0 without the setting."""
        return whole_number(self.first(name) or "0", name, most)


def parse(words: list[str], language: Language) -> CommandLine:
    """Parse a command line; raises a ParameterError for everything that is wrong without running it."""
    settings: dict[str, tuple[str, ...]] = {}
    steps: list[Step] = []
    spread: Callable[..., int] | None = None
    left = iter(words)
    for word in left:
        if not word.startswith("-") or word == "-":
            steps.append(Step(word))
            continue
        name, modifiers = split_modifiers(word)
        declaration = language.find(name)
        if isinstance(declaration, Refused):
            raise ParameterError(f"{name} of oiiotool is not supported: {declaration.reason}")
        if isinstance(declaration, Option) and declaration.name == "--help":
            settings[declaration.name] = tuple(left)[:1]
            continue
        step = _step(word, declaration, left)
        if step.option is not None and step.option.run is None:
            if modifiers:
                raise ParameterError(f"{word}: {name} takes no modifiers")
            settings[step.option.name] = step.arguments
            spread = step.option.spread or spread
            continue
        if step.option is not None and step.option.throughout:
            settings[step.option.name] = step.arguments
        _check_early(step, modifiers)
        steps.append(step)
    return CommandLine(settings, tuple(steps), spread)


def _step(word: str, declaration: type[Op] | Option, left: Iterator[str]) -> Step:
    if isinstance(declaration, Option):
        return Step(
            word,
            tuple(_argument(left, declaration.name, argument) for argument in declaration.arguments),
            option=declaration,
        )
    names = [parameter.name.upper() for parameter in declaration.arguments()]
    return Step(word, tuple(_argument(left, declaration.flag(), argument) for argument in names), op=declaration)


def _check_early(step: Step, modifiers: Mapping[str, str]) -> None:
    """Check all modifiers without expressions."""
    plain = {name: text for name, text in modifiers.items() if "{" not in text}
    with errors_of_step(step):
        values_of(step, {**plain, **{name: None for name in modifiers if name not in plain}})


@contextlib.contextmanager
def errors_of_step(step: Step) -> Iterator[None]:
    """Add the step's name to errors of a block."""
    try:
        yield
    except Error as error:
        error.step = error.step or (step.name if step.word.startswith("-") else "")
        raise


def values_of(step: Step, modifiers: Mapping[str, str | None]) -> dict[str, Any]:
    """The modifiers' values by name; only names are checked where the text is None."""
    declaring = step.op or (step.option.modifiers if step.option else None)
    if declaring is None:
        if modifiers:
            raise ParameterError(f"unknown modifier '{next(iter(modifiers))}'", expected="no modifier")
        return {}
    return parse_modifiers(declaring, modifiers)


def split_modifiers(word: str) -> tuple[str, dict[str, str]]:
    """'--op:a=1:b="x:y"' -> ('--op', {'a': '1', 'b': 'x:y'}); quoted values and expressions may contain colons."""
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
        raise ParameterError(f"{word}: expected a closing {quote}")
    modifiers: dict[str, str] = {}
    for piece in filter(None, pieces[1:]):  # `--op:a=1:` and `--op::a=1` mean `--op:a=1`
        name, equals, value = piece.partition("=")
        if not equals or not name:
            raise ParameterError(f"{word}: '{piece}': expected NAME=VALUE")
        if name in modifiers:
            raise ParameterError(f"{word}: modifier '{name}' is given twice")
        modifiers[name] = value
    return pieces[0], modifiers


def _argument(left: Iterator[str], option: str, argument: str) -> str:
    value = next(left, None)
    if value is None:
        raise ParameterError(f"{option} requires {argument} after it")
    return value


def whole_number(text: str, name: str = "", most: int = MOST_MB) -> int:
    """The integer from 0 to `most` in a text; `name`: of the setting, for the error."""
    if not (text.isascii() and text.isdigit()) or int(text) > most:
        given = f"{name} {text}" if name else repr(text)
        raise ParameterError(f"{given}: expected an integer from 0" + (f" to {most}" if most < MOST_MB else ""))
    return int(text)


def without(words: Sequence[str], options: Mapping[str, int]) -> tuple[str, ...]:
    """The words without some options (names without dashes) and their numbers of arguments."""
    left = iter(words)
    rest: list[str] = []
    for word in left:
        name = word.partition(":")[0].lstrip("-")
        if word.startswith("-") and name in options:
            tuple(itertools.islice(left, options[name]))
        else:
            rest.append(word)
    return tuple(rest)
