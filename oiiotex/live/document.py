# SPDX-License-Identifier: Apache-2.0
"""What a page works on, as a small file: parameters, variants, places, paintings' names. Saved by itself."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from ..api.files import read_document, written
from ..api.painting import MEASURES, PRESETS
from ..errors import Error, ImageError, ParameterError

VERSION = 1
MOST_VARIANTS = 64
LEAST_PAINTED, MOST_PAINTED = 64, 4096  # px, of a painting's side
_MOST_THUMBNAIL = 60_000  # letters

KEPT = "Until the computer is restarted, the next --texlive of this document finds it in"

State = dict[str, Any]


def _number(low: float, high: float, whole: bool = False) -> Any:
    def check(value: Any) -> float:
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
            raise ValueError
        if not low <= value <= high or (whole and value != int(value)):
            raise ValueError
        return int(value) if whole else float(value)

    return check


def _or_none(check: Any) -> Any:
    return lambda value: None if value is None else check(value)


def _one_of(*choices: Any) -> Any:
    def check(value: Any) -> Any:
        if not isinstance(value, (str, int, type(None))) or value not in choices:
            raise ValueError
        return value

    return check


def _text(most: int) -> Any:
    def check(value: Any) -> str:
        if not isinstance(value, str) or len(value) > most:
            raise ValueError
        return value

    return check


def _mask(value: Any) -> Any:
    """'' everywhere, 'dominant', 'brush', or the number of a label."""
    return _number(1, 1 << 20, whole=True)(value) if isinstance(value, int) else _one_of("", "dominant", "brush")(value)


def _place(value: Any) -> str:
    """A whole number as text: places have more digits than JSON's numbers hold."""
    text = _text(80)(value)
    int(text)
    return text


def _list(check: Any, most: int) -> Any:
    def checked(value: Any) -> list[Any]:
        if not isinstance(value, list) or len(value) > most:
            raise ValueError
        return [check(one) for one in value]

    return checked


def _object(**fields: Any) -> Any:
    def check(value: Any) -> State:
        if not isinstance(value, dict) or set(value) != set(fields):
            raise ValueError
        return {name: checking(value[name]) for name, checking in fields.items()}

    return check


_TILE = {
    "flatten": _or_none(_number(0, 1)),
    "sigma": _or_none(_number(0.5, 1e6)),
    "amount": _or_none(_number(0, 1)),
    "contrast": _or_none(_number(0, 1)),
    "structure": _number(0, 1),
    "seed": _number(0, 2**32 - 1, whole=True),
    "measure": _one_of(*MEASURES),
    "preset": _one_of(*PRESETS, None),
    "patch": _or_none(_one_of(*range(5, 23, 2))),
    "width": _or_none(_number(16, 16384, whole=True)),
    "height": _or_none(_number(16, 16384, whole=True)),
    "mask": _mask,
    "within": _one_of("", "brush"),
}
_VARIANT = _object(tile=_object(**_TILE), thumbnail=_text(_MOST_THUMBNAIL))
_KEY = _object(x=_place, y=_place, zoom=_number(0, 60))
_FIELDS: dict[str, dict[str, Any]] = {
    "tile": _TILE,
    "view": {"display": _text(200), "view": _text(200), "exposure": _number(-20, 20)},
    "variants": {"list": _list(_VARIANT, MOST_VARIANTS)},
    "zoom": {
        "x": _place, "y": _place, "zoom": _number(0, 60), "seed": _number(0, 2**32 - 1, whole=True),
        "lock": _number(0, 1, whole=True), "keys": _list(_KEY, 256), "frames": _number(2, 1 << 16, whole=True),
    },
    "paint": {
        "width": _number(LEAST_PAINTED, MOST_PAINTED, whole=True),
        "height": _number(LEAST_PAINTED, MOST_PAINTED, whole=True),
        "layer": _one_of("coarse", "fine"), "label": _number(0, 255, whole=True),
        "finer": _number(0, 255, whole=True), "brush": _number(1, 1024), "seed": _number(0, 2**32 - 1, whole=True),
    },
    "history": {"step": _number(-1, 999_999, whole=True)},
}  # fmt: skip


def default_state(display: str, view: str, side: int) -> State:
    """A new document's.

    Parameters
    ----------
    display, view : str
        Of the colour config.
    side : int
        px; of a photo, or of a graph's root: a zoom begins in its middle.
    """
    tile: State = dict.fromkeys(_TILE)
    tile |= {"structure": 0.5, "seed": 0, "measure": "histogram", "mask": "", "within": ""}
    middle = str((side // 2) << PLACE_BITS)
    return {
        "tile": tile,
        "view": {"display": display, "view": view, "exposure": 0.0},
        "variants": {"list": []},
        "zoom": {"x": middle, "y": middle, "zoom": 0.0, "seed": 0, "lock": 0, "keys": [], "frames": 96},
        "paint": {"width": 1024, "height": 1024, "layer": "coarse", "label": 1, "finer": 0, "brush": 64.0, "seed": 0},
        "history": {"step": -1},  # of the painting, that is shown; -1: the last
    }


PLACE_BITS = 96  # of fraction in a place of the zoom: pixels of the root in 1/2^96


class Document:
    """A document and its file.

    Parameters
    ----------
    path : Path
    state : dict
        What it begins with where there is no such file.
    source : str
        The photo, or the graph: another one's document is refused.
    views : dict of str -> list of str
        Displays of the colour config, and their views: no others can be set. A document that was made with another
        config may name others; those of `state` then stay.
    left : Path, optional
        Where `save` writes what cannot be written to `path`.

    Raises
    ------
    Error
        The file is no such document, of a later version, or of another photo.
    """

    def __init__(
        self, path: Path, state: State, source: str, views: Mapping[str, Sequence[str]], left: Path | None = None
    ):
        self.path, self.state, self._source, self._views, self._left = path, state, source, views, left
        self._changes = self._saved = 0
        if path.exists():
            self._read(path)
        if left is not None and left.exists():
            self._read(left)
            self._changes += 1

    def _read(self, path: Path) -> None:
        content = read_document(path)
        if not isinstance(content, dict) or "oiiotex.live" not in content:
            raise Error(f"{self.path} is no document of --texlive: document=FILE says another one")
        if content["oiiotex.live"] != VERSION:
            raise Error(f"{self.path} is of version {content['oiiotex.live']}, this is {VERSION}")
        if content.get("source") != self._source:
            raise Error(f"{self.path} is of {content.get('source')}, not of {self._source}: document=FILE says another")
        for room, values in content.items():
            if room not in _FIELDS:
                continue
            checked = self._checked(room, values)
            if room == "view" and not self._is_view(self.state[room] | checked):
                checked = {name: value for name, value in checked.items() if name not in ("display", "view")}
            self.state[room] |= checked

    def change(self, room: str, values: Mapping[str, Any]) -> State:
        """Take new values of a room; what has changed.

        Raises
        ------
        ParameterError
            There is no such value, or it is not allowed.
        """
        checked = self._checked(room, values)
        if room == "view" and not checked.keys().isdisjoint(("display", "view")):
            wanted = self.state[room] | checked
            if not self._is_view(wanted):
                raise ParameterError(f"the colour config has no view '{wanted['view']}' of '{wanted['display']}'")
        changed = {name: value for name, value in checked.items() if self.state[room][name] != value}
        if changed:
            self.state[room] |= changed
            self._changes += 1
        return changed

    def _checked(self, room: str, values: Mapping[str, Any]) -> State:
        """Values of a room, each of its type and in its range."""
        if room not in _FIELDS or not isinstance(values, Mapping):
            raise ParameterError(f"there is no room '{room}'")
        checked = {}
        for name, value in values.items():
            try:
                checked[name] = _FIELDS[room][name](value)
            except (KeyError, ValueError, TypeError):
                raise ParameterError(f"{room}: {name}={str(value)[:60]} is not allowed") from None
        return checked

    def _is_view(self, view: Mapping[str, Any]) -> bool:
        return view["view"] in self._views.get(view["display"], ())

    def unsaved(self) -> Callable[..., None] | None:
        """What writes the state as it is now, whole or not at all, on any thread; None where it was written.

        As long as it raises ImageError, because the disk is full or the folder read-only, there is something unsaved.
        """
        if self._changes == self._saved:
            return None
        content = {"oiiotex.live": VERSION, "source": self._source} | self.state
        text, changes = json.dumps(content, indent=1) + "\n", self._changes

        def write(path: Path = self.path) -> None:
            with written(path) as file:
                file.write(text.encode())
            if path is not self._left:
                self._saved = changes
                if self._left is not None:
                    self._left.unlink(missing_ok=True)

        return write

    def save(self) -> None:
        """Write it, if something has changed; where that fails, to `left`, from which the next server reads it.

        Raises
        ------
        ImageError
            It cannot be written.
        """
        if write := self.unsaved():
            try:
                write()
            except ImageError as error:
                if self._left is None:
                    raise
                write(self._left)
                raise ImageError(f"{error}. {KEPT} {self._left}") from error

    def beside(self, what: str) -> Path:
        """A file that goes with it."""
        return self.path.with_name(f"{self.path.name.removesuffix('.json').removesuffix('.texlive')}.{what}")
