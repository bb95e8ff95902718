# SPDX-License-Identifier: Apache-2.0
"""The page's document, a small file that is saved automatically: parameters, variants, positions, and their history."""

from __future__ import annotations

import contextlib
import json
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, TypedDict

from oiiotex.engine.errors import Error, ImageError, ParameterError, within

from ..api.files import Allowed, Fraction, Seed, read_as, read_document, sweep, types_of, written
from ..api.painting import MEASURES, PRESETS
from .history import History, Values
from .numbered import is_folder

VERSION = 1
MOST_VARIANTS = 64
LEAST_PAINTED, MOST_PAINTED = 64, 4096  # px, of a painting's side
_MOST_THUMBNAIL = 60_000  # characters

KEPT = "Until the next restart of the computer, --texlive with this document recovers it from"

# as text, because JSON's numbers have fewer digits
_IntegerText = Annotated[str, Allowed(most=80, pattern=r"[+-]?\d+", words="of an integer")]
_Side = Annotated[int, Allowed(16, 16384)]
_Painted = Annotated[int, Allowed(LEAST_PAINTED, MOST_PAINTED)]
_LabelNumber = Annotated[int, Allowed(0, 255)]
_Octaves = Annotated[float, Allowed(0, 60)]
_ShortText = Annotated[str, Allowed(most=200)]
_File = Annotated[int, Allowed(0, 999_999)]  # number of a mask's file; 0: none


class _TileRoom(TypedDict):
    flattening: Fraction | None
    sigma: Annotated[float, Allowed(0.5, 1e6)] | None
    evenness: Fraction | None
    histogram: Fraction | None
    lattice: Fraction
    seed: Seed
    measure: Annotated[str, Allowed(among=MEASURES)]
    preset: Annotated[str, Allowed(among=tuple(PRESETS))] | None
    patch: Annotated[int, Allowed(among=range(5, 23, 2))] | None
    width: _Side | None
    height: _Side | None
    mask: Annotated[int, Allowed(1, 1 << 20)] | Literal["", "dominant", "brush"]  # the id of a label
    fill: Literal["", "brush"]


class _ViewRoom(TypedDict):
    display: _ShortText
    view: _ShortText
    exposure: Annotated[float, Allowed(-20, 20)]


_Name = Annotated[
    str,
    Allowed(
        most=120,
        pattern=r"|[^./\\][^/\\\x00-\x1f]*\.(png|exr|tif|tiff|jpg|jpeg)",
        words="that names a PNG, EXR, TIFF or JPEG file",
    ),
]


class _OutputRoom(TypedDict):
    tile: _Name
    painted: _Name
    type: Literal["", "uint8", "uint16", "half", "float"]


class _Variant(TypedDict):
    tile: _TileRoom
    thumbnail: Annotated[str, Allowed(most=_MOST_THUMBNAIL)]


class _VariantsRoom(TypedDict):
    list: Annotated[list[_Variant], Allowed(most=MOST_VARIANTS)]


class _Key(TypedDict):
    x: _IntegerText
    y: _IntegerText
    zoom: _Octaves


class _ZoomRoom(_Key):
    seed: Seed
    jitter: Fraction | None
    keeplayout: Annotated[int, Allowed(0, 1)]
    keys: Annotated[list[_Key], Allowed(most=256)]
    frames: Annotated[int, Allowed(2, 1 << 16)]


class _PaintRoom(TypedDict):
    width: _Painted
    height: _Painted
    layer: Literal["coarse", "fine"]
    label: _LabelNumber
    finer: _LabelNumber
    brush: Annotated[float, Allowed(1, 1024)]
    seed: Seed


class _MasksRoom(TypedDict):
    mask: _File
    fill: _File


class _PhotoRoom(TypedDict):
    space: _ShortText  # the color space that the page has asked for; "": that of the line or the file


class _PaintingRoom(TypedDict):
    step: Annotated[int, Allowed(-1, 999_999)]


_ROOMS: dict[str, Any] = {
    "tile": _TileRoom, "view": _ViewRoom, "variants": _VariantsRoom, "zoom": _ZoomRoom, "paint": _PaintRoom,
    "photo": _PhotoRoom, "masks": _MasksRoom, "painting": _PaintingRoom, "output": _OutputRoom,
}  # fmt: skip
INNER = "photo", "masks", "painting"  # rooms that only the server sets
# parameters with a history; places of a zoom, brushes and variants have none
_UNDONE = {room: set(types_of(_ROOMS[room])) for room in ("tile", "zoom", "masks", "painting")}
_UNDONE["zoom"] -= {"x", "y", "zoom"}


def default_state(display: str, view: str, side: int) -> Values:
    """The state of a new document.

    `side`: size in pixels of the photo's square or of the graph's root; a zoom starts at its center.
    """
    tile: Values = dict.fromkeys(types_of(_TileRoom))
    tile |= {"lattice": 0.5, "seed": 0, "measure": "histogram", "mask": "", "fill": ""}
    middle = str((side // 2) << PLACE_BITS)
    return {
        "tile": tile,
        "view": {"display": display, "view": view, "exposure": 0.0},
        "variants": {"list": []},
        "zoom": {
            "x": middle,
            "y": middle,
            "zoom": 0.0,
            "seed": 0,
            "jitter": None,
            "keeplayout": 0,
            "keys": [],
            "frames": 96,
        },
        "paint": {"width": 1024, "height": 1024, "layer": "coarse", "label": 1, "finer": 0, "brush": 64.0, "seed": 0},
        "output": {"tile": "", "painted": "", "type": ""},  # file names and pixel type; "": automatic
        "photo": {"space": ""},
        "masks": {"mask": 0, "fill": 0},
        "painting": {"step": -1},  # the step of the painting that is shown; -1: the last
    }


PLACE_BITS = 96  # fraction bits of a zoom position: units of 1/2^96 root pixel


class Document:
    """A document and its file.

    Opening it removes what killed pages have left in its folders, where nothing else is written for a long time.
    """

    def __init__(
        self, path: Path, state: Values, source: str, views: Mapping[str, Sequence[str]], left: Path | None = None
    ):
        self.path, self.state, self._source, self._views, self._left = path, state, source, views, left
        self._changes = self._saved = 0
        self.history = History()
        self._sweep()
        if path.exists():
            self._read(path)
        if left is not None and left.exists():
            self._read(left)
            self._changes += 1

    def _sweep(self) -> None:
        folders = [self.path.parent, self.beside("masks"), self.beside("paint")]
        if self._left is not None:
            folders.append(self._left.parent)
        for folder in filter(is_folder, folders):
            with contextlib.suppress(OSError):  # a page may open in a folder that cannot be read
                sweep(folder, time.time())

    def _read(self, path: Path) -> None:
        content = read_document(path)
        if not isinstance(content, dict) or "oiiotex.live" not in content:
            raise Error(f"{self.path} is not a document of --texlive; choose another one with document=FILE")
        if content["oiiotex.live"] != VERSION:
            raise Error(f"{self.path} has version {content['oiiotex.live']}: expected version {VERSION}")
        if content.get("source") != self._source:
            problem = f"{self.path} belongs to {content.get('source')}, not to {self._source}"
            raise Error(f"{problem}; choose another document with document=FILE")
        with within(str(self.path)):
            self._take(content)

    def _take(self, content: Mapping[str, Any]) -> None:
        """The state and the history in a document."""
        for room, values in content.items():
            if room == "history":
                self.history.read(values, self._undone)
            if room not in _ROOMS:
                continue
            checked = self._checked(room, values)
            if room == "view" and not self._is_view(self.state[room] | checked):
                checked = {name: value for name, value in checked.items() if name not in ("display", "view")}
            self.state[room] |= checked

    def change(self, room: str, values: Mapping[str, Any], text: str = "", gesture: object = None) -> Values:
        """Set values of a room, and return those that have changed; `text` and `gesture` as in `History.record`."""
        checked = self._checked(room, values)
        if room == "view" and not checked.keys().isdisjoint(("display", "view")):
            wanted = self.state[room] | checked
            if not self._is_view(wanted):
                raise ParameterError(
                    f"the color config has no view '{wanted['view']}' for display '{wanted['display']}'"
                )
        changed = {name: value for name, value in checked.items() if self.state[room][name] != value}
        if changed:
            before = self.state[room].copy()
            self.state[room] |= changed
            self._changes += 1
            undone = {name: value for name, value in changed.items() if name in _UNDONE.get(room, ())}
            if undone and before.get("step") != -1:  # the first painting has nothing before it
                self.history.record(room, before, undone, text, gesture)
        return changed

    def go(self, forward: bool) -> tuple[str, dict[str, Values]] | None:
        """Undo or redo a step. Returns its text, and the values that have changed by room; None at the end."""
        gone = self.history.go(forward)
        for room, values in gone[1].items() if gone else ():
            self.state[room] |= values
        self._changes += gone is not None
        return gone

    def _undone(self, room: str, values: Values) -> Values:
        """Values of the history, checked."""
        if not set(values) <= set(_UNDONE.get(room, ())):
            raise ParameterError(f"history: {room[:60]} has no such parameter: {', '.join(values)[:60]}")
        return self._checked(room, values)

    def _checked(self, room: str, values: Mapping[str, Any]) -> Values:
        """Values of a room, checked for type and range."""
        if room not in _ROOMS or not isinstance(values, Mapping):
            raise ParameterError(f"unknown room '{room}': expected one of {', '.join(_ROOMS)}")
        known = types_of(_ROOMS[room])
        for name in values:
            if name not in known:
                raise ParameterError(f"{room}: unknown parameter '{name[:60]}'")
        return {name: read_as(known[name], one, f"{room}.{name}", ParameterError) for name, one in values.items()}

    def _is_view(self, view: Mapping[str, Any]) -> bool:
        return view["view"] in self._views.get(view["display"], ())

    def unsaved(self) -> Callable[..., None] | None:
        """A function that writes the current state atomically, on any thread; None if there are no unsaved changes.

        It raises ImageError if the disk is full or the folder read-only; the changes then stay unsaved.
        """
        if self._changes == self._saved:
            return None
        content = {"oiiotex.live": VERSION, "source": self._source} | self.state | {"history": self.history.content()}
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
        """Write unsaved changes; if that fails, write them to `left`, from which the next server reads them."""
        if write := self.unsaved():
            try:
                write()
            except ImageError as error:
                if self._left is None:
                    raise
                write(self._left)
                raise ImageError(f"{error}. {KEPT} {self._left}") from error

    def beside(self, what: str) -> Path:
        """The path of a file that belongs to the document."""
        return self.path.with_name(f"{self.path.name.removesuffix('.json').removesuffix('.texlive')}.{what}")
