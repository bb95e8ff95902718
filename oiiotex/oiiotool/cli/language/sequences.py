# SPDX-License-Identifier: Apache-2.0
"""Frame sequences, views and UDIM tiles: expand a command line with wildcards into one line per frame.

The rules are those of oiiotool (OpenImageIO 3.2.2), with these differences, where oiiotool guesses, crashes or runs out
of memory:

1. A malformed `--frames` is refused; oiiotool reads it as frame 1, and ignores text after a range.
2. A stray `%` in a name is refused; in oiiotool it raises an exception.
3. Views work with `--frames` (every frame of every view) and without frame numbers; oiiotool crashes on both.
4. Special characters of regular expressions in names are literal.
5. Numbers are not limited to 32 bits, and more than `MOST_FRAMES` frames are refused.
6. `<UDIM>` in an input runs the line once per tile; oiiotool passes the name to its image cache.
7. `FRAME_NUMBER_PAD` uses `--framepadding` wherever that stands; in oiiotool only after it.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import NamedTuple

from ....engine.errors import ImageError, ParameterError
from ....engine.io.reading import read
from .each import has_each, lines_of
from .parse import settings_of
from .tiles import Groups, fitting, matching_names, names_tiles, tile_files, tile_name

MOST_FRAMES = 100_000  # over an hour at 24 fps; each stores a command line
MOST_DIGITS = 255  # of a padded number, the limit of file names

OPTIONS = settings_of(
    (
        "--frames RANGE",
        "Set the frames of #, @ and %04d: 1-10, 1-10x2 (every second), 1-10y2 (all others), 1,5,7-9",
    ),
    ("--framepadding DIGITS", "Set the number of digits of # and @, 1 to 9"),
    ("--views NAMES", "Set the views that %V stands for; %v stands for their first letters. Default: left,right"),
    ("--wildcardoff", "Disable wildcards from here on"),
    ("--wildcardon", "Enable wildcards again"),
    ("--skip-bad-frames", "Continue with the next frame after an error"),
    ("--parallel-frames", "Run several frames at a time, in separate processes"),
)

_WILDCARD = r"[#@]+|%[0-9]*d"
_VIEW = r"%[Vv]"
_ONE_RANGE = r"[0-9]++(?:-[0-9]++(?:[xy]-?[0-9]++)?)?"
_RANGES_AT_END = rf"{_ONE_RANGE}(?:,{_ONE_RANGE})*\Z"
_NUMBER = r"\s*([+-]?[0-9]{1,18})\s*"  # 18 digits: ranges still have a len() in Python
_RANGE = rf"{_NUMBER}(?:-{_NUMBER}(?:([xy]){_NUMBER})?)?"
_ZERO_PADDED = r"%00*([0-9]{1,3})d"  # the only form for which directories are searched
_PERCENT = r"%%|%([0-9]*)d|%(?!\(UDIM\)d)"
_NO_MATCH = "no frame or view matches the wildcards, which are taken literally"
_LITERAL = "for a literal name, put --wildcardoff before it"
_NO_TILES = "no input has UDIM tiles: <UDIM> and the like are taken literally"


@dataclass(frozen=True)
class Frame:
    """The command line of one frame."""

    number: int | None  # FRAME_NUMBER, or the number of a tile; None without a sequence
    words: tuple[str, ...]
    padding: int = 0  # digits of FRAME_NUMBER_PAD by --framepadding; 0: none
    warning: str = ""  # for the user, in one line
    file: str = ""  # of --each
    likes: tuple[tuple[str, str], ...] = ()  # for each input of a sequence a readable file of it: (input, readable)


def frames(words: Sequence[str], takes: Callable[[str], int]) -> list[Frame]:
    """Return the command lines of all frames, views and tiles; at least one.

    `takes` returns the number of arguments of an option ('--echo' -> 1), to distinguish input files from other words
    with `<UDIM>`. Frame wildcards are expanded in every word, as in oiiotool.
    """
    survey = _survey(words)
    lines: list[Frame] = []
    if has_each(words):
        if survey.ranges or survey.places:
            raise ParameterError("--each cannot be combined with --frames, views or wildcards such as #")
        files = lines_of(words)
        _check_count(len(files), "--each")
        likes = _likes_of_each([line for _, line in files]) if "--missingfile" in words else {}
        return [
            Frame(None, line, file=file, likes=tuple((line[n], like) for n, like in likes.items()))
            for file, line in files
        ]
    for frame in _sequence(tuple(words), survey):
        lines += _over_tiles(frame, survey, takes)
        _check_count(len(lines), "the command line")
    return lines


def _likes_of_each(lines: Sequence[tuple[str, ...]]) -> dict[int, str]:
    """For each word that --each changes the first readable file."""
    changed = {index: names for index, names in enumerate(zip(*lines, strict=True)) if len(set(names)) > 1}
    return {index: like for index, names in changed.items() if (like := _readable(names))}


def _readable(names: Iterable[str]) -> str:
    """The first image that can be read; empty: none."""
    for name in names:
        with suppress(ImageError):
            read(name)
            return name
    return ""


def frame_numbers(ranges: str) -> list[int]:
    """Return the frames of '1-10', '1-10x2' (every second), '1-10y2' (all others), '10-1', or a comma-separated list.

    Raises a `ParameterError` for other text, and for more than `MOST_FRAMES` frames.
    """
    numbers: list[int] = []
    for text in ranges.split(","):
        match = re.fullmatch(_RANGE, text)
        if not match:
            raise ParameterError(f"frames {ranges!r}: {text!r}: expected FIRST, FIRST-LAST, FIRST-LASTxSTEP or ySTEP")
        first, last, step = int(match[1]), int(match[2] or match[1]), int(match[4] or 1)
        if step < 0 and first < last:
            first, last = last, first
        towards, stride = 1 if first <= last else -1, abs(step) or 1
        span = range(first, last + towards, towards)
        strides = span[::stride]
        complement = match[3] == "y"
        more = len(span) - len(strides) if complement else len(strides)
        _check_count(len(numbers) + more, f"frames {ranges!r}")
        if not complement:
            numbers += strides
        elif more:  # else the range may be too long to iterate
            numbers += (number for place, number in enumerate(span) if place % stride)
    return numbers


def _check_count(count: int, source: str) -> None:
    if count > MOST_FRAMES:
        raise ParameterError(f"{source} has {count} frames: expected at most {MOST_FRAMES}")


@dataclass
class _Survey:
    """The wildcards and settings of sequences in a command line."""

    ranges: str | None = None
    padding: int = 0
    name_padding: int = 0
    views: tuple[str, ...] = ("left", "right")
    places: dict[int, bool] = field(default_factory=dict)  # words with wildcards -> whether they follow -o
    off: set[int] = field(default_factory=set)  # words between --wildcardoff and --wildcardon


def _survey(words: Sequence[str]) -> _Survey:
    """Read the settings wherever they stand, and find all words with wildcards."""
    survey, on = _Survey(), True
    for index, word in (left := iter(enumerate(words))):
        output = word.startswith("-o") and index + 1 < len(words)
        scanned = on and not (output and ":all=" in word)  # there %d is the number of the image
        cut = output and ":udim=" in word  # there <UDIM> is the number of a written tile
        if output:
            index, word = next(left)
        survey.off |= set() if on and not cut else {index - output, index}
        setting = _option(word)
        if setting in ("--frames", "--framepadding", "--views", "--threads", "--each") and index + 1 < len(words):
            _set(survey, setting, next(left)[1])
        elif setting in ("--wildcardoff", "--wildcardon"):
            on = setting == "--wildcardon"
        elif scanned and (re.search(_WILDCARD, word) or re.search(_VIEW, word)):
            survey.places[index] = output
    return survey


def _set(survey: _Survey, setting: str, value: str) -> None:
    if setting == "--frames":
        survey.ranges = value
    elif setting == "--views":
        # oiiotool sorts its matches by frame, then view: the order of --views has no effect
        survey.views = tuple(sorted(view for view in value.split(",") if view))
    elif setting == "--framepadding":
        if not re.fullmatch("[0-9]{1,3}", value) or int(value) > MOST_DIGITS:
            raise ParameterError(f"--framepadding {value!r}: expected a number of digits from 1 to 9")
        survey.padding = int(value)
        if 1 <= survey.padding <= 9:  # other values apply to FRAME_NUMBER_PAD only, as in oiiotool
            survey.name_padding = survey.padding


def _option(word: str) -> str:
    """The name of an option with two dashes instead of one; '' for other words."""
    return f"--{word[1:].removeprefix('-')}" if word.startswith("-") else ""


class _FrameName(NamedTuple):
    number: int | None
    view: str | None
    name: str


def _sequence(words: tuple[str, ...], survey: _Survey) -> Iterator[Frame]:
    """The command lines of all frames and views."""
    columns = _columns(words, survey)
    numbers = frame_numbers(survey.ranges) if survey.ranges else []
    if columns and numbers and not columns[0]:
        raise ParameterError(f"{words[next(iter(survey.places))]!r} has no frames: expected {len(numbers)} (--frames)")
    likes = _likes(words, survey, columns)
    for row in zip(*columns, strict=True):
        names = {index: name for index, (_, _, name) in zip(survey.places, row, strict=True)}
        line = tuple(names.get(index, word) for index, word in enumerate(words))
        shared = tuple((names[index], like) for index, like in likes.items())
        yield Frame(row[0].number, line, survey.padding, likes=shared)
    for number in numbers if not columns else ():  # a range without wildcards repeats the words
        yield Frame(number, words, padding=survey.padding)
    if not (columns[0] if columns else numbers):
        meant = columns or survey.ranges is not None
        yield Frame(None, words, padding=survey.padding, warning=_NO_MATCH if meant else "")


def _columns(words: tuple[str, ...], survey: _Survey) -> list[list[_FrameName]]:
    """The names of all frames for each word with a wildcard."""
    columns: list[list[_FrameName]] = []
    for index, output in survey.places.items():
        pattern = _pattern(words[index], survey.name_padding)
        ranges = pattern.ranges or survey.ranges
        if ranges:
            numbers, views = frame_numbers(ranges), survey.views if re.search(_VIEW, pattern.text) else (None,)
            _check_count(len(numbers) * len(views), repr(words[index]))
            column = [_FrameName(number, view, pattern.name(number, view)) for number in numbers for view in views]
        elif output:  # follows the first sequence
            column = [_FrameName(n, view, pattern.name(n, view)) for n, view, _ in (columns or [[]])[0]]
        else:
            column = _existing(pattern, survey.views)
        columns.append(column)
        if len(column) != len(columns[0]):
            counts = f"{words[next(iter(survey.places))]!r} has {len(columns[0])}, {words[index]!r} has {len(column)}"
            raise ParameterError(f"expected sequences of equal length: {counts}")
    return columns


def _likes(words: tuple[str, ...], survey: _Survey, columns: list[list[_FrameName]]) -> dict[int, str]:
    """For each input with a wildcard the first readable file of its sequence, in or out of the range.

    The substitute of a missing or damaged file follows it: frames that are run alone, as on a farm, agree.
    """
    likes = {}
    for (index, output), column in zip(survey.places.items(), columns, strict=True) if "--missingfile" in words else ():
        pattern = _pattern(words[index], survey.name_padding)
        views = survey.views if re.search(_VIEW, pattern.text) else (None,)
        files = [file for view in views for _, file in _numbered(_seen(pattern.text, view)) or ()]
        like = "" if output else _readable([*files, *(one.name for one in column)])
        if like:
            likes[index] = like
    return likes


class _Pattern(NamedTuple):
    """A word with a wildcard."""

    word: str  # as the user wrote it
    text: str  # in printf notation
    ranges: str = ""  # the range in the word

    def name(self, number: int | None, view: str | None) -> str:
        """The word for one frame and view."""
        left = [] if number is None else [number]

        def printed(match: re.Match[str]) -> str:
            if match[0] == "%%":
                return "%"
            if match[1] is None:
                raise ParameterError(f"{self.word!r}: a % outside a wildcard must be written %%")
            if not left:
                raise ParameterError(f"{self.word!r}: no frame number for {match[0][:20]}")
            if len(digits := match[1].lstrip("0")) > 3 or int(digits or 0) > MOST_DIGITS:
                raise ParameterError(f"{self.word!r}: expected at most {MOST_DIGITS} digits of a frame number")
            return match[0] % left.pop()

        return re.sub(_PERCENT, printed, _seen(self.text, view))


def _pattern(word: str, padding: int) -> _Pattern:
    wildcard = re.search(_WILDCARD, word)
    if not wildcard:  # a view alone
        return _Pattern(word, word)
    before, conversion, after = word[: wildcard.start()], wildcard[0], word[wildcard.end() :]
    ranges = re.search(_RANGES_AT_END, before)
    if ranges:
        before = before[: ranges.start()]
    if not conversion.startswith("%"):
        conversion = f"%0{padding or 4 * conversion.count('#') + conversion.count('@')}d"
    # oiiotool passes names through std::filesystem, which removes doubled slashes
    return _Pattern(word, re.sub("//+", "/", before + conversion + after), ranges[0] if ranges else "")


def _seen(text: str, view: str | None) -> str:
    return text.replace("%V", view).replace("%v", view[:1]) if view else text


def _existing(pattern: _Pattern, views: tuple[str, ...]) -> list[_FrameName]:
    """The existing files of a pattern; refuses a pattern whose directory does not exist."""
    names = [(view, _seen(pattern.text, view)) for view in views]
    if not re.search(_VIEW, pattern.text):
        if (files := _numbered(pattern.text)) is None:
            raise ParameterError(f"no files match {pattern.word!r}", hint=_LITERAL)
        return [_FrameName(number, None, file) for number, file in files]
    if not re.search(_ZERO_PADDED, pattern.text):
        return [_FrameName(None, view, name) for view, name in names if os.path.exists(name)]
    return sorted(_FrameName(number, view, file) for view, name in names for number, file in _numbered(name) or ())


def _numbered(text: str) -> list[tuple[int, str]] | None:
    """Number and path of the files that match 'dir/name.%04d.tif', sorted; None without a directory or wildcard."""
    directory, name = os.path.split(text)
    directory = directory or "."  # the './' appears in {TOP.filename}, as in oiiotool
    wildcard = re.search(_ZERO_PADDED, name)
    if not wildcard or not os.path.exists(directory):
        return None
    before, after, groups = name[: wildcard.start()], name[wildcard.end() :], Groups()
    # {n,} includes numbers longer than the padding; markers of tiles are kept, and expanded for each frame
    fits = f"{fitting(before, groups)}(?P<frame>[0-9]{{{wildcard[1]},}}){fitting(after, groups)}"
    digits = {match["frame"] for match in matching_names(directory, fits)}
    return sorted((int(number or 0), os.path.join(directory, before + number + after)) for number in digits)


def _over_tiles(frame: Frame, survey: _Survey, takes: Callable[[str], int]) -> list[Frame]:
    """The command lines of all tiles of the first input with markers of tiles."""
    words = frame.words
    named = [i for i, word in enumerate(words) if i not in survey.off and names_tiles(word)]
    named = [i for i in named if not os.path.isfile(words[i])]  # a literal name, as in OIIO
    if not named:
        return [frame]
    inputs = _inputs(words, takes)
    files = {i: tile_files(words[i]) for i in named if i in inputs}
    if not files:
        return [replace(frame, warning=frame.warning or _NO_TILES)]
    first = next(iter(files))
    if not files[first]:
        raise ParameterError(f"no tiles match {words[first]!r}", hint=_LITERAL)
    tiled: list[Frame] = []
    for tile, file in files[first].items():
        line = list(words)
        for i in named:
            line[i] = files[i].get(tile, "") if i in files else tile_name(words[i], tile)
            if not line[i]:
                raise ParameterError(f"{tile_name(words[i], tile)!r} is missing: expected it alongside {file!r}")
        number = tile.number if frame.number is None else frame.number
        tiled.append(replace(frame, number=number, words=tuple(line)))
    return tiled


def _inputs(words: Sequence[str], takes: Callable[[str], int]) -> set[int]:
    """Indices of input files: words that are neither options nor their arguments, and those after -i."""
    inputs: set[int] = set()
    for index, word in (left := iter(enumerate(words))):
        option = word.partition(":")[0]
        if _option(option) in ("", "--"):
            inputs.add(index)
            continue
        arguments = {place for place, _ in islice(left, takes(option))}
        inputs |= arguments if _option(option) == "--i" else set()
    return inputs
