# SPDX-License-Identifier: Apache-2.0
"""Names with markers of UDIM tiles, and the files that they stand for."""

from __future__ import annotations

import os
import re
from typing import NamedTuple

from ....engine.errors import ParameterError


class Tile(NamedTuple):
    """A UDIM tile, counted from 0 upwards and to the right."""

    v: int  # first, so that tiles sort by number
    u: int

    @property
    def number(self) -> int | None:
        """1001 and up; None beyond UDIM's ten columns and four digits."""
        number = 1001 + self.u + 10 * self.v
        return number if self.u < 10 and number <= 9999 else None


def matching_names(directory: str, fits: str) -> list[re.Match[str]]:
    """Matches of a regular expression with the names of a directory's files, sorted by name."""
    try:
        with os.scandir(directory) as entries:
            names = sorted(entry.name for entry in entries if entry.is_file())
    except (OSError, ValueError):  # not readable, or an invalid name
        return []
    return [match for name in names if (match := re.fullmatch(fits, name, re.DOTALL))]


# those of OIIO's texture system, except '_u##v##', in which oiiotool reads ## as a frame
_MARKERS = {
    **dict.fromkeys(("<UDIM>", "%(UDIM)d"), "{udim}"),
    **{"<uvtile>": "u{u0}_v{v0}", "<u>": "u{u0}", "<v>": "v{v0}"},
    **{"<UVTILE>": "u{u1}_v{v1}", "<U>": "u{u1}", "<V>": "v{v1}"},
}
_MARKER = re.compile(f"({'|'.join(map(re.escape, _MARKERS))})")


class Groups(dict[str, str]):
    """Named groups of a regular expression; repeated names must match the same text."""

    def __missing__(self, name: str) -> str:
        self[name] = f"(?P={name})"
        return f"(?P<{name}>[0-9]{'{4}' if name == 'udim' else '+'})"


def fitting(text: str, groups: Groups) -> str:
    """A regular expression for a name with markers of tiles."""
    pieces = _MARKER.split(text)  # literal, marker, literal ...
    return "".join(_MARKERS[piece].format_map(groups) if i % 2 else re.escape(piece) for i, piece in enumerate(pieces))


def names_tiles(name: str) -> bool:
    """Whether a name has markers of UDIM tiles: their number, or their column and row."""
    fields = "".join(_MARKERS[marker] for marker in _MARKER.findall(name))
    return "{udim}" in fields or ("{u" in fields and "{v" in fields)


def tile_files(pattern: str) -> dict[Tile, str]:
    """Return the existing files for a name with `<UDIM>`, `<UVTILE>`, `<U>` and `<V>` or the like, in tile order."""
    directory, name = os.path.split(pattern)
    if not names_tiles(name):
        return {}
    matches = matching_names(directory or ".", fitting(name, Groups()))
    files = {_tile(match): os.path.join(directory, match[0]) for match in matches}
    kept = sorted(tile for tile in files if min(tile) >= 0)  # not 1000, nor u0 in names that count from 1
    return {tile: files[tile] for tile in kept}


def _tile(match: re.Match[str]) -> Tile:
    numbers = {name: int(digits) for name, digits in match.groupdict().items()}
    if "udim" in numbers:
        return Tile(*divmod(numbers["udim"] - 1001, 10))
    return Tile(*(numbers[f"{axis}0"] if f"{axis}0" in numbers else numbers[f"{axis}1"] - 1 for axis in "vu"))


def tile_name(pattern: str, tile: Tile) -> str:
    """Return the name of one tile; raises a `ParameterError` if the tile has no UDIM number for it."""
    fields = {"udim": tile.number, "u0": tile.u, "v0": tile.v, "u1": tile.u + 1, "v1": tile.v + 1}
    pieces = [_MARKERS[piece] if i % 2 else piece for i, piece in enumerate(_MARKER.split(pattern))]
    if tile.number is None and "{udim}" in pieces[1::2]:
        raise ParameterError(f"{pattern!r}: tile u{tile.u} v{tile.v} has no UDIM number")
    return "".join(piece.format(**fields) if i % 2 else piece for i, piece in enumerate(pieces))
